"""What the report of a calibration says, from the files that it left."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from isochrome.calibration.settings import load_set
from isochrome.errors import InputError
from isochrome.output import columns_of, counted, with_uncertainty
from isochrome.reporting import ReportContent, ReportTable, camera_rows, paper_rows
from isochrome.scene import parse_toml

_LISTS = {
    "images": "By image",
    "by_distance": "By distance",
    "laws": "The wear laws",
    "traces": "The traces",
}
"""Lists of a calibration's JSON that are shown as tables, and their captions."""

_WEAR_UNIT = 1e-9
"""mm²/N: wear coefficients of dry contacts are some of these."""

_NO_BUDGET = "The calibration's file holds none; what is known of its goodness stands above."
_NO_CAUSES = "Causes are looked for in images of a beam or a disc alone."
_NONE_FOUND = "None: the images ask for nothing besides the settings."
_ABOUT_CHI = {
    "fringe_value_n_per_mm": "about 1 where the images are described to their noise",
    "coefficient_mm2_per_n": "about 1 where traces and distances scatter as expected",
}
"""What chi means, by the value that it belongs to."""


def calibration_report(folder: Path, name: str, record: Mapping[str, Any]) -> ReportContent:
    """What the report of a calibration says; `name`: 'calibration' or 'scale', of JSON and figure.

    `record` is provenance.json. OSError, KeyError or ValueError where a file of it cannot be read.
    """
    file = f"{name}.json"
    found: dict[str, Any] = json.loads((folder / file).read_text("utf-8"))
    values = list(_values(found))
    said = "; ".join(f"{label} = {text}" for label, text in values)
    said = said if said.startswith("f_") else f"{said[:1].upper()}{said[1:]}"
    budget = _table(f"Shares of the ± ({file})", found.get("budget") or [])
    causes = found.get("causes")
    no_causes = _NO_CAUSES if causes is None else _NONE_FOUND
    own = [*values, ("date of the calibration", str(record.get("date") or "not recorded"))]
    return ReportContent(
        command=str(record.get("command") or "calibrate"),
        title=str(record.get("title") or "Calibration"),
        verdict=f"{said}.",
        budget=budget,
        no_budget=_NO_BUDGET,
        tables=list(_tables(found, file)),
        causes=[_cause(one) for one in causes] if causes else None,
        causes_text=no_causes,
        taken_as_exact=found.get("taken_as_exact") or (),
        warnings=found["warnings"],
        scene=str(record.get("settings") or ""),
        scene_title="Settings",
        paper=[*own, *_of_camera(record), *paper_rows(None, record)],
        picture=(folder / f"{name}.png").read_bytes(),
    )


def _of_camera(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Camera, light and pixel of a beam's or disc's set; other calibrations have no such set."""
    try:
        found = load_set(parse_toml(str(record.get("settings") or ""), "settings"))
    except InputError:
        return []
    rows, pixel = camera_rows(found), found.camera.pixel_mm
    if pixel is None:
        return rows
    spread = None if found.uncertainty is None else found.uncertainty.pixel_mm
    text = f"{pixel:g}" if spread is None else with_uncertainty(pixel, spread)
    own = "no uncertainty stated" if spread is None else "standard uncertainty"
    return [*rows, ("pixel", f"{text} mm ({own})")]


def _values(found: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """What was found, each value with its unit and ±, and how well after the first."""
    first, *others = _own_values(found)
    yield first
    meaning = next((text for key, text in _ABOUT_CHI.items() if key in found), "")
    if found.get("chi") is not None:
        yield "chi", f"{found['chi']:.2f} ({meaning})"
    yield from others


def _own_values(found: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """The same without chi."""
    if "fringe_value_n_per_mm" in found:
        yield from _of_fringe_value(found)
    elif "coefficient_mm2_per_n" in found:
        yield from _of_wear(found)
    elif "pixel_mm" in found:
        yield from _of_scale(found)
    else:
        yield from _of_colours(found)


def _of_fringe_value(found: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    value = with_uncertainty(found["fringe_value_n_per_mm"], found["standard_uncertainty"])
    yield "f_sigma", f"{value} N/mm per fringe (standard uncertainty)"
    order, spread = found["order_at_zero_load"], found["order_at_zero_load_uncertainty"]
    if order is not None and spread is not None:
        yield "order at zero load", f"{with_uncertainty(order, spread)} fringe"
    if found["residual"] is not None:
        yield "residual stress", f"up to {found['residual']['largest_order']:.3f} fringe"
    loads = [image["load_n"] for image in found["images"]]
    yield "loads", f"{min(loads):g} to {max(loads):g} N, {counted(len(loads), 'image')}"


def _of_wear(found: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    pair = found["coefficient_mm2_per_n"], found["standard_uncertainty"]
    value = with_uncertainty(*(number / _WEAR_UNIT for number in pair))
    yield "wear coefficient k", f"({value})e-9 mm²/N (standard uncertainty)"
    low, high = (number / _WEAR_UNIT for number in found["interval_95"])
    yield "95 % interval", f"{low:.4g}e-9 to {high:.4g}e-9 mm²/N"
    yield "law", str(found["law"])


def _of_scale(found: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    units = {"pixel_mm": "mm (standard uncertainty)", "roll_deg": "degrees"}
    for key in ("pixel_mm", "distortion", "keystone_x", "keystone_z", "roll_deg"):
        if found[key] is not None:
            name = {"pixel_mm": "pixel", "roll_deg": "roll"}.get(key, key)
            yield name, f"{_cell(found[key])} {units.get(key, '')}".strip()
    points = counted(found["corners"], "point")
    yield "residual", f"{found['residual_px']:.3f} px over {points}"
    yield "target", str(found["target"])


def _of_colours(found: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    gamma, spread = found["gamma"], found["gamma_standard_uncertainty"]
    yield "gamma", f"{gamma:g} (as given)" if spread is None else with_uncertainty(gamma, spread)
    yield "orders", f"up to {found['highest_order_of_table']:.2f} at {found['wavelength_nm']:g} nm"
    yield "residual", f"{found['residual']:.4f} of the full light (RMS)"
    yield "pixels off by over 0.15", f"{100.0 * found['strange_share']:.2g} %"
    yield "found by", str(found["way"])


def _tables(found: Mapping[str, Any], file: str) -> Iterator[ReportTable]:
    for key, caption in _LISTS.items():
        table = _table(f"{caption} ({file})", found.get(key) or [])
        if table is not None:
            yield table
    channels = found.get("channels")
    if channels:
        yield ReportTable(
            f"By channel ({file})",
            {"of": list(channels), "value": [_cell(value) for value in channels.values()]},
        )
    exposures = found.get("exposures")
    if exposures:
        columns = {"image": list(range(len(exposures))), "exposure": exposures}
        yield ReportTable(f"By image ({file})", columns)


def _table(caption: str, rows: Sequence[Mapping[str, Any]]) -> ReportTable | None:
    """Rows as a table; None where there are none. What a row does not have is not known."""
    if not rows:
        return None
    shown = {name: [_cell(value) for value in own] for name, own in columns_of(rows).items()}
    return ReportTable(caption, shown)


def _cell(value: Any) -> Any:
    """A value as a table shows it: a pair of value and ± as one text."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        if set(value) == {"value", "standard_uncertainty"}:
            return with_uncertainty(value["value"], value["standard_uncertainty"])
        return _joined(f"{name} {_cell(own)}" for name, own in value.items())
    if isinstance(value, list):
        return _joined(str(_cell(own)) for own in value)
    return value


def _joined(parts: Iterable[str]) -> str:
    return ", ".join(parts)


def _cause(cause: Mapping[str, Any]) -> str:
    """What the images asked for, with its value."""
    value = with_uncertainty(cause["value"], cause["standard_uncertainty"])
    return f"{cause['cause']}: {cause['key']} = {value}"
