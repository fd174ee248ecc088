"""The files that `fit` leaves, and a fit from the files of an earlier run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.fit.figure import fit_figure
from isochrome.fit.frame_set import FrameSet
from isochrome.fit.joint import JointFit
from isochrome.fit.laws import WEAR, LawFit
from isochrome.fit.over_distance import over_distance_figure
from isochrome.fit.result import POOR_CHI, Fit, Found
from isochrome.fit.told import WearLaws
from isochrome.fit.tractions_run import write_tractions
from isochrome.output import write_csv, write_figure, write_json, write_text
from isochrome.runs import STORE, Bench, Job
from isochrome.runs.store import Column, add_columns, attributes, column, named_units
from isochrome.scene import Scene, dump_scene, parse_scene

_PARTS = ("value", "standard_uncertainty", "cramer_rao_bound")


def write_fit(
    bench: Bench, job: Job, name: str, data: FrameSet, result: Fit, joint: JointFit
) -> None:
    """Leave a fit's files.

    Parameters: `bench`, in whose folder; `job`; `name` of the scene; `data`, the frames; `result`;
    `joint`, the fit behind it. Raises OSError.
    """
    folder = bench.results
    write_csv(folder / "fit.csv", result.table())
    if result.wear_laws is not None:
        write_csv(folder / "wear_laws.csv", result.wear_laws.table())
    write_text(folder / "scene.toml", dump_scene(result.scene))
    write_json(folder / "fit.json", result.to_json())
    write_figure(folder / "fit.png", fit_figure(name, data, joint.scenes))
    if result.tractions:
        write_tractions(folder, data, joint, result)
    over_distance = over_distance_figure(name, result)
    if over_distance is not None:
        write_figure(folder / "fit_over_distance.png", over_distance)
    _add(folder / STORE, result, job)


def _add(store: Path, result: Fit, job: Job) -> None:
    """Values of each frame over frame, shared ones as single numbers, with their uncertainties."""
    good = [chi <= POOR_CHI for chi in result.frame_chi]
    columns: dict[str, Any] = {
        "chi": column(result.frame_chi, "frame", "chi"),
        "status": column(["ok" if ok else "flagged" for ok in good], "frame", "status"),
    }
    for key in dict.fromkeys(key for own in result.frames for key in own):
        for part in _PARTS:
            name = key if part == "value" else f"{key} {part}"
            values = [own[key][part] if key in own else None for own in result.frames]
            columns[name] = column(values, "frame", key)
    for key, found in result.shared.items():
        for part in _PARTS:
            name = key if part == "value" else f"{key} {part}"
            columns[name] = Column((), np.array(found[part], float), named_units(key))
    axes = {
        "frame": column(list(range(len(good))), "frame", "frame"),
        "distance_m": column(result.distance_m, "frame", "distance_m"),
    }
    add_columns(store, columns, axes, attributes(job.identity))


def restore_fit(out: Path, scene: Scene) -> Fit:
    """A fit without tractions, from the folder that an earlier run left complete.

    Parameters: `out`; `scene`, as given. Returns a Fit.
    """
    found = json.loads((out / "fit.json").read_text("utf-8"))
    text = (out / "scene.toml").read_text("utf-8")
    rows = found["frames"]
    single = len(rows) == 1
    shared = {key: values for key, values in found.items() if _is_value(values)}
    return Fit(
        _whole({k: v for k, v in shared.items() if not (single and k in rows[0])}),
        [_whole({k: v for k, v in row.items() if _is_value(v)}) for row in rows],
        [row["distance_m"] for row in rows],
        [_number(row["chi"], np.nan) for row in rows],
        _number(found["chi"], np.nan),
        parse_scene(text, name=scene.name, folder=scene.folder),
        [row["other_minima"] for row in rows],
        _laws(found) if "wear_laws" in found else None,
        tuple(found["warnings"]),
        already=True,
    )


def _is_value(values: Any) -> bool:
    return isinstance(values, dict) and set(values) == set(_PARTS)


def _whole(found: dict[str, dict[str, Any]]) -> Found:
    """JSON knows no infinity: an uncertainty that is not there is one."""
    return {
        key: {part: _number(own[part], np.nan if part == "value" else np.inf) for part in _PARTS}
        for key, own in found.items()
    }


def _number(value: float | None, unknown: float) -> float:
    return unknown if value is None else value


def _laws(found: dict[str, Any]) -> WearLaws:
    """The wear laws, compared."""
    laws = []
    for row in found["wear_laws"]:
        parameters = {name: own for name, own in row.items() if isinstance(own, dict)}
        short = WEAR.removeprefix("wear.")
        laws.append(
            LawFit(
                row["law"],
                {WEAR if name == short else name: own for name, own in parameters.items()},
                tuple(row["between"]),
                row["misfit"],
                row["degrees_of_freedom"],
                row["chi"],
                row["log_evidence"],
            )
        )
    return WearLaws(tuple(laws), tuple(found["wear_between_frames"]), found["wear_chi"])
