"""A calibration on disk: its files, its report, and its values in a scene, layout untouched."""

import datetime
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from os.path import isfile
from pathlib import Path
from typing import Any

from isochrome.calibration.camera_scale import LENS, ScaleCalibration
from isochrome.calibration.colour import ColourCalibration, write_colours
from isochrome.calibration.result import CONTRADICTED, CUTS, Calibration
from isochrome.calibration.settings import load_set
from isochrome.calibration.wear_coefficient import WEAR_UNIT, WearCalibration, trace_json
from isochrome.errors import InputError
from isochrome.messages import read_warnings
from isochrome.output import (
    columns_of,
    counted,
    provenance,
    replacing,
    rounded_texts,
    staged,
    with_uncertainty,
    write_csv,
    write_figure,
    write_json,
)
from isochrome.reporting import (
    ReportContent,
    ReportTable,
    camera_rows,
    paper_rows,
    stated_text,
    write_report,
)
from isochrome.runs import REPORT, environment, seal
from isochrome.scene import Scene, parse_scene, parse_toml, read_text, scene_names, with_value

MARK = "calibrated: "
"""What a comment of ours begins with: a second calibration replaces it."""

BYTE_ORDER_MARK = "\ufeff"
"""What some editors begin a file with; it stays."""

FRINGE_VALUE = "specimen.fringe_value_n_per_mm"
"""It ages with the material, so its day is written beside it."""


SceneCalibration = Calibration | ScaleCalibration | WearCalibration
"""Those whose values are a scene's."""

AnyCalibration = SceneCalibration | ColourCalibration


def calibration_day() -> str:
    """Today's date, universal time, as ISO text."""
    return datetime.datetime.now(datetime.UTC).date().isoformat()


def check_scene_file(path: str | Path) -> str:
    """Text of a scene file that values may be written into. InputError for one of the package."""
    place = Path(path)
    if not place.is_file() and str(path) in scene_names():
        raise InputError("scene_ships_inside_package", path=path)
    # refusals of reading: missing, too large, not UTF-8
    parse_scene(read_text(place), folder=place.parent, label=str(path))
    return place.read_bytes().decode("utf-8")


def write_into_scene(
    calibration: SceneCalibration, scene: str | Path, *, source: str | Path | None = None
) -> float:
    """Set `specimen.fringe_value_n_per_mm` in a scene file to a calibration's value.

    Of a scale it is `camera.pixel_mm`, and `camera.distortion`, `camera.keystone_x` and
    `camera.keystone_z` where they are beyond three of their uncertainties, or the file states them.
    Of wear it is `wear.coefficient_mm2_per_n`, by the law that the scene states.

    It is written as { value = ..., standard_uncertainty = ... }, from which a fit has its prior, or
    an input of its budget; a fringe value has its `date` beside these, today's. The value is
    rounded two digits beyond the uncertainty's first. A comment beside it states chi, or a scale's
    residual; all else in the file stays, to the byte. The file is replaced as a whole or not at
    all.

    Parameters
    ----------
    calibration : Calibration, ScaleCalibration or WearCalibration
        What `calibrate_bending`, `calibrate_disc`, `calibrate_scale` or `calibrate_wear` found.
    scene : str or Path
        The TOML file.
    source : str or Path, optional
        The calibration set or image, which the comment names.

    Returns
    -------
    float
        The value written, N/mm per fringe; of a scale mm a pixel, of wear mm²/N.

    Raises
    ------
    InputError
        Where the scene is one of the package, or the file is missing, is no scene or cannot be
        written, or its layout cannot be edited; or where its frames are not the whole pictures
        that a scale is of, or has no wear by a law that was asked.

    Examples
    --------
    >>> import isochrome
    >>> from isochrome.samples import samples_path
    >>> set_file = samples_path() / "disc" / "set.toml"
    >>> found = isochrome.calibrate_disc(set_file)  # doctest: +SKIP
    >>> isochrome.write_into_scene(found, "scene.toml", source=set_file)  # doctest: +SKIP
    14.599
    """
    text = check_scene_file(scene)
    mark = text[: text.startswith(BYTE_ORDER_MARK)]
    text = text.removeprefix(mark)
    if isinstance(calibration, ScaleCalibration):
        _check_picture(calibration, parse_scene(text, folder=Path(scene).parent), str(scene))
    if isinstance(calibration, WearCalibration):
        wear = parse_scene(text).wear
        if wear is None:
            raise InputError("has_no_wear_coefficient", name=str(scene))
        coefficient = calibration.coefficient_by(wear.law)
        if coefficient is None:
            raise InputError("wear_law_set_states", name=str(scene), law=wear.law)
        k, u = coefficient
        calibration = replace(calibration, coefficient_mm2_per_n=k, standard_uncertainty=u)
    origin = "" if source is None else f", {Path(source).name}"
    words = f"{MARK}{calibration.scene_comment}{origin}"
    comment = "".join(c for c in words if c.isprintable() and c != ";")  # which ends it
    stated = parse_toml(text, "scene")
    entries: list[tuple[str, tuple[str, str]]] = []
    for key, (value, spread) in calibration.scene_values.items():
        table, _, entry = key.partition(".")
        # the first value, and of the others those that are clear or that the scene states
        if not entries or abs(value) > CONTRADICTED * spread or entry in stated.get(table, {}):
            entries.append((key, rounded_texts(value, spread)))
    for key, texts in reversed(entries):  # each is put on top of its table
        dated = f', date = "{calibration_day()}"' if key == FRINGE_VALUE else ""
        written = "{{ value = {}, standard_uncertainty = {}{} }}".format(*texts, dated)
        text = with_value(text, key, written, comment=comment, mark=MARK, name=str(scene))
    target = Path(scene).resolve()  # a link stays a link
    with replacing(target) as beside:
        beside.write_bytes((mark + text).encode("utf-8"))
        shutil.copymode(target, beside)
    return float(entries[0][1][0])


def _check_picture(calibration: ScaleCalibration, scene: Scene, name: str) -> None:
    """Refuse a scene whose frames are turned, cut or of another size than a scale's pictures."""
    camera, frames = scene.camera, scene.frames
    bent = any(
        abs(measured.value) > CONTRADICTED * measured.standard_uncertainty
        for key, measured in calibration.values.items()
        if key in LENS
    )
    moved = [key for key in ("roi", "rotate_deg", "flip") if getattr(frames, key)]
    if bent and moved:
        raise InputError("has_frames_lens_found", name=name, moved=moved[0])
    height, width = (camera.height_px, camera.width_px) if camera and not moved else (None, None)
    shown = calibration.shape
    if height not in (None, shown[0]) or width not in (None, shown[1]):
        raise InputError(
            "camera_has_pixels_target", name=name, size=width, size_2=height, shape=shown[1],
            shape_2=shown[0],
        )  # fmt: skip


_LISTS = {
    "images": "By image",
    "by_distance": "By distance",
    "laws": "The wear laws",
    "traces": "The traces",
}
"""Lists of a calibration's JSON that are shown as tables, and their captions."""

_NO_BUDGET = "The calibration's file holds none; what is known of its goodness stands above."
_NO_CAUSES = "Causes are looked for in images of a beam or a disc alone."
_NONE_FOUND = "None: the images ask for nothing besides the settings."


def calibration_report(folder: Path, name: str, record: Mapping[str, Any]) -> ReportContent:
    """The report of `name`.json. OSError, KeyError or ValueError where it cannot be read."""
    file = f"{name}.json"
    content: dict[str, Any] = json.loads((folder / file).read_text("utf-8"))
    values = _values(content)
    verdict = "; ".join(f"{label} = {text}" for label, text in values)
    verdict = verdict if verdict.startswith("f_") else f"{verdict[:1].upper()}{verdict[1:]}"
    causes = content.get("causes")
    rows = [*values, ("date of the calibration", str(record.get("date") or "not recorded"))]
    return ReportContent(
        command=str(record.get("command") or "calibrate"),
        title=str(record.get("title") or "Calibration"),
        verdict=f"{verdict}.",
        budget=_table(f"Shares of the ± ({file})", content.get("budget")),
        no_budget=_NO_BUDGET,
        tables=_report_tables(content, file),
        causes=[
            f"{one['cause']}: {one['key']} = "
            f"{with_uncertainty(one['value'], one['standard_uncertainty'])}"
            for one in causes
        ]
        if causes
        else None,
        causes_text=_NO_CAUSES if causes is None else _NONE_FOUND,
        taken_as_exact=content.get("taken_as_exact") or (),
        warnings=read_warnings(content),
        scene=str(record.get("settings") or ""),
        scene_title="Settings",
        paper=[*rows, *_of_camera(record), *paper_rows(None, record)],
        picture=(folder / f"{name}.png").read_bytes(),
    )


def _of_camera(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Camera, light and pixel of a beam's or disc's set; other calibrations have no such set."""
    try:
        settings = load_set(parse_toml(str(record.get("settings") or ""), "settings"))
    except InputError:
        return []
    pixel = settings.camera.pixel_mm
    rows = camera_rows(settings.camera, settings.polariscope, settings.frames)
    if pixel is None:
        return rows
    return [*rows, ("pixel", stated_text(pixel, settings.uncertainty.pixel_mm, "mm"))]


def _values(content: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What was found, each value with its unit and ±, and how well after the first."""
    chi, about = content.get("chi"), ""
    if "fringe_value_n_per_mm" in content:
        about = "about 1 where the images are described to their noise"
        value = with_uncertainty(content["fringe_value_n_per_mm"], content["standard_uncertainty"])
        rows = [("f_sigma", f"{value} N/mm per fringe (standard uncertainty)")]
        order, spread = content["order_at_zero_load"], content["order_at_zero_load_uncertainty"]
        if order is not None and spread is not None:
            rows.append(("order at zero load", f"{with_uncertainty(order, spread)} fringe"))
        if content["residual"] is not None:
            largest = content["residual"]["largest_order"]
            rows.append(("residual stress", f"up to {largest:.3f} fringe"))
        loads = [image["load_n"] for image in content["images"]]
        text = f"{min(loads):g} to {max(loads):g} N, {counted(len(loads), 'image')}"
        rows.append(("loads", text))
    elif "coefficient_mm2_per_n" in content:
        about = "about 1 where traces and distances scatter as expected"
        names = "coefficient_mm2_per_n", "standard_uncertainty"
        value = with_uncertainty(*(content[name] / WEAR_UNIT for name in names))
        low, high = (number / WEAR_UNIT for number in content["interval_95"])
        rows = [
            ("wear coefficient k", f"({value})e-9 mm²/N (standard uncertainty)"),
            ("95 % interval", f"{low:.4g}e-9 to {high:.4g}e-9 mm²/N"),
            ("law", str(content["law"])),
        ]
    elif "pixel_mm" in content:
        named = {
            "pixel_mm": ("pixel", " mm (standard uncertainty)"),
            **{name: (name, "") for name in LENS},
            "roll_deg": ("roll", " degrees"),
        }
        rows = [
            (label, f"{_cell(content[key])}{unit}")
            for key, (label, unit) in named.items()
            if content[key] is not None
        ]
        text = f"{content['residual_px']:.3f} px over {counted(content['corners'], 'point')}"
        rows += [("residual", text), ("target", str(content["target"]))]
    else:
        gamma, spread = content["gamma"], content["gamma_standard_uncertainty"]
        given = f"{gamma:g} (as given)"
        highest, wavelength = content["highest_order_of_table"], content["wavelength_nm"]
        rows = [
            ("gamma", given if spread is None else with_uncertainty(gamma, spread)),
            ("orders", f"up to {highest:.2f} at {wavelength:g} nm"),
            ("residual", f"{content['residual']:.4f} of the full light (RMS)"),
            ("pixels off by over 0.15", f"{100.0 * content['strange_share']:.2g} %"),
            ("found by", str(content["way"])),
        ]
    return rows if chi is None else [rows[0], ("chi", f"{chi:.2f} ({about})"), *rows[1:]]


def _report_tables(content: Mapping[str, Any], file: str) -> list[ReportTable]:
    channels, exposures = content.get("channels") or {}, content.get("exposures") or []
    lists = [
        *((caption, content.get(key)) for key, caption in _LISTS.items()),
        ("By channel", [{"of": of, "value": value} for of, value in channels.items()]),
        ("By image", [{"image": i, "exposure": value} for i, value in enumerate(exposures)]),
    ]
    return [table for name, rows in lists if (table := _table(f"{name} ({file})", rows))]


def _table(caption: str, rows: Sequence[Mapping[str, Any]] | None) -> ReportTable | None:
    """Rows as a table; None where there are none. What a row does not have is not known."""
    columns = columns_of(rows or []).items()
    return ReportTable(caption, {n: list(map(_cell, c)) for n, c in columns}) if rows else None


def _cell(value: Any) -> Any:
    """A value as a table shows it: a pair of value and ± as one text."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        if set(value) == {"value", "standard_uncertainty"}:
            return with_uncertainty(value["value"], value["standard_uncertainty"])
        return ", ".join(f"{name} {_cell(item)}" for name, item in value.items())
    if isinstance(value, list):
        return ", ".join(str(_cell(item)) for item in value)
    return value


_KINDS: dict[type[AnyCalibration], tuple[str, str]] = {
    ColourCalibration: ("colour", ""),
    ScaleCalibration: ("scale", "scale.csv"),
    WearCalibration: ("wear", "distances.csv"),
}
"""What calibrates other things than a fringe value, and its table."""


def save_calibration(
    calibration: AnyCalibration,
    out: str | Path,
    *,
    source: str | Path | Sequence[str | Path] | None = None,
) -> None:
    """Write JSON, figure, tables, provenance and report, all or none; of colours also images of
    light. `source`: set or images, for the hashes of all their files; the set's text is kept too.
    """
    name = "scale" if isinstance(calibration, ScaleCalibration) else "calibration"
    inputs = [source] if isinstance(source, str | Path) else list(source or ())
    texts = {Path(i): read_text(Path(i)) for i in inputs if Path(i).suffix == ".toml"}
    if isinstance(calibration, Calibration):
        command, table = CUTS[calibration.specimen].command, "images.csv"
    else:
        command, table = _KINDS[type(calibration)]
    with staged(out) as folder:
        write_json(folder / f"{name}.json", calibration.to_json())
        files = [*inputs]
        for settings, text in texts.items():  # with the images, traces and no-load frames of a set
            named = dict.fromkeys(_texts(parse_toml(text, str(settings))))
            files += [file for one in named if isfile(file := settings.parent / one)]
        record = provenance(None, files) | environment()
        record |= {
            "command": f"calibrate {command}",
            "title": calibration.title,
            "date": calibration_day(),
            "settings": "\n".join(texts.values()) or None,
        }
        write_figure(folder / f"{name}.png", calibration.figure())
        if isinstance(calibration, ColourCalibration):
            write_colours(calibration, folder)
        else:
            write_csv(folder / table, calibration.columns)
            write_csv(folder / "budget.csv", calibration.budget_columns)
        # a set may state worn volumes alone
        if isinstance(calibration, WearCalibration) and calibration.traces:
            rows = map(trace_json, calibration.traces)
            traces = columns_of([row | {"is_clear": int(row["is_clear"])} for row in rows])
            write_csv(folder / "traces.csv", traces)
        write_report(folder / REPORT, calibration_report(folder, name, record))
        seal(folder, record)


def _texts(value: Any) -> Iterator[str]:
    """All texts in what a TOML file holds."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list):
        for item in value.values() if isinstance(value, Mapping) else value:
            yield from _texts(item)
