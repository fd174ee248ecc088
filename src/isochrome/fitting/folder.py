"""The files that `fit` leaves, their report, and a fit from the files of an earlier run."""

import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.estimation import POOR_CHI, BudgetInput
from isochrome.fitting.figure import budget_figure, fit_figure, over_distance_figure
from isochrome.fitting.frame.unknowns import WEAR
from isochrome.fitting.frame_set import PreparedFrames
from isochrome.fitting.joint.joint_fit import JointFit
from isochrome.fitting.result import PARTS, Fit, Found, KeyBudget, column_name, keys_of
from isochrome.fitting.tracking.result import Track, restored
from isochrome.fitting.tractions.api import write_tractions
from isochrome.fitting.wear_laws import LawFit, WearLaws
from isochrome.messages import read_warnings
from isochrome.output import saved_picture, write_csv, write_figure, write_json, write_text
from isochrome.reporting import ReportContent, ReportTable, fitted_report, write_report
from isochrome.runs import (
    REPORT,
    STORE,
    Column,
    Job,
    RunFolder,
    add_columns,
    attributes,
    column,
    named_units,
)
from isochrome.scene import Scene, dump_scene, parse_scene

_NO_BUDGET = (
    "The scene states no number with an uncertainty, so there are no shares: the ± is that of the "
    "images' noise alone."
)
_TRACK_BUDGET = (
    "A track gives each value the ± of its frame's noise, and no shares; isochrome fit of a few "
    "of its frames gives them."
)
_TRACK_CAUSES = (
    "What one of its frames asked of the apparatus is held in all of them, and named in the "
    "warnings."
)


def fit_report(folder: Path, result: Fit | Track, record: Mapping[str, Any]) -> ReportContent:
    """What the report of a fit or a track says; `record`, what provenance.json holds."""
    options = record.get("options") or {}
    if isinstance(result, Track):
        of_kind: dict[str, Any] = {
            "command": "fit --track",
            "verdict": result.summary_text,
            "no_budget": _TRACK_BUDGET,
            "causes_text": "" if options.get("as_stated", False) else _TRACK_CAUSES,
        }
    else:
        of_kind = _of_fit(result)
    chi = result.over_frames.chi[np.isfinite(result.over_frames.chi)]
    goodness = f"{chi.max():.2f} at most" if chi.size else "not known"
    text = (
        f"Residual over noise: {goodness} (about 1 where the frames are described to their noise)."
    )
    picture = (folder / PICTURE).read_bytes()
    return fitted_report(result, record, goodness=text, picture=picture, **of_kind)


def _of_fit(result: Fit) -> dict[str, Any]:
    verdict = result.summary_text
    tables = [ReportTable("The fitted values (fit.csv)", result.columns)]
    if result.wear_laws is not None:
        tables.append(ReportTable("The wear laws (wear_laws.csv)", result.wear_laws.table()))
        verdict += f"; wear law: {result.wear_laws.sentence()}"
    budget = ReportTable("Shares of each ± (budget.csv)", result.budget_columns)
    return {
        "command": "fit",
        "verdict": verdict,
        "budget": budget if result.budget else None,
        "no_budget": _NO_BUDGET,
        "tables": tables,
        "causes": result.causes,
        "refined": result.refined,
    }


PICTURE = "fit.png"


def write_fit(
    run_folder: RunFolder, job: Job, name: str, data: PreparedFrames, result: Fit, joint: JointFit
) -> None:
    """Leave a fit's files in the folder of its run."""
    folder = run_folder.results
    if result.wear_laws is not None:
        write_csv(folder / "wear_laws.csv", result.wear_laws.table())
    write_figure(folder / PICTURE, fit_figure(name, data, joint.scenes))
    if result.budget:
        write_csv(folder / "budget.csv", result.budget_columns)
        write_figure(folder / "budget.png", budget_figure(name, result))
    if result.tractions:
        write_tractions(folder, data, joint, result)
    over_distance = over_distance_figure(name, result)
    if over_distance is not None:
        write_figure(folder / "fit_over_distance.png", over_distance)
    good = [chi <= POOR_CHI for chi in result.frame_chi]
    columns: dict[str, Any] = {
        "chi": column(result.frame_chi, "frame", "chi"),
        "status": column(["ok" if ok else "flagged" for ok in good], "frame", "status"),
    }
    for key in keys_of(result.frames):
        for part in PARTS:
            values = [
                estimates[key][part] if key in estimates else None for estimates in result.frames
            ]
            columns[column_name(key, part)] = column(values, "frame", key)
    for key, estimate in result.shared.items():
        for part in PARTS:
            single = Column((), np.array(estimate[part], float), named_units(key))
            columns[column_name(key, part)] = single
    keep_values(folder, job, result, columns)


def keep_values(folder: Path, job: Job, result: Fit | Track, columns: dict[str, Column]) -> None:
    """Leave what every fit leaves: fit.csv, fit.json, scene, values over frame, report."""
    write_csv(folder / "fit.csv", result.columns)
    write_text(folder / "scene.toml", dump_scene(result.scene))
    write_json(folder / "fit.json", result.to_json())
    distances = list(result.distance_m)
    axes = {
        "frame": column(list(range(len(distances))), "frame", "frame"),
        "distance_m": column(distances, "frame", "distance_m"),
    }
    add_columns(folder / STORE, columns, axes, attributes(job.identity))
    write_report(folder / REPORT, fit_report(folder, result, job.identity))


def kept_values(out: Path, scene: Scene) -> tuple[dict[str, Any], Scene]:
    """A fit's JSON and its fitted scene, from the folder that an earlier run left complete."""
    text = (out / "scene.toml").read_text("utf-8")
    fitted = parse_scene(text, name=scene.name, folder=scene.folder)
    return json.loads((out / "fit.json").read_text("utf-8")), fitted


def restore_fit(out: Path, scene: Scene, keys: tuple[str, ...] | None = None) -> Fit:
    """A fit without tractions, from the folder that an earlier run left complete."""
    estimates, fitted = kept_values(out, scene)
    rows = estimates["frames"]
    of_frame = rows[0] if len(rows) == 1 else {}
    shared = {k: v for k, v in estimates.items() if _is_value(v) and k not in of_frame}
    budget = _budgets(shared, None)
    for i, row in enumerate(rows):
        budget += _budgets(row, i)
    return Fit(
        shared=_whole(shared),
        frames=[_whole({k: v for k, v in row.items() if _is_value(v)}) for row in rows],
        distance_m=[row["distance_m"] for row in rows],
        frame_chi=[_number(row["chi"], np.nan) for row in rows],
        chi=_number(estimates["chi"], np.nan), scene=fitted,
        other_minima=[row["other_minima"] for row in rows],
        wear_laws=_laws(estimates) if "wear_laws" in estimates else None,
        warnings=read_warnings(estimates), budget=tuple(budget),
        taken_as_exact=tuple(estimates["taken_as_exact"]), asked=keys, already=True,
        draw=partial(saved_picture, out.absolute() / PICTURE),
    )  # fmt: skip


def restore_values(out: Path, scene: Scene, options: Mapping[str, Any]) -> Fit | Track:
    """A fit, without its tractions, or a track, from the folder that a run left complete."""
    if "track" not in options:
        keys = (*options.get("free", ()), *options.get("per_frame", ()))
        return restore_fit(out, scene, None if options.get("as_stated") else keys)
    estimates, fitted = kept_values(out, scene)
    return restored(estimates, tuple(options["track"]), fitted)


def _is_value(values: Any) -> bool:
    return isinstance(values, dict) and set(PARTS) <= set(values)


def _budgets(estimates: dict[str, Any], frame: int | None) -> list[KeyBudget]:
    """The budgets of values by key, from a fit's JSON."""
    stated = {k: v["budget"] for k, v in estimates.items() if _is_value(v) and "budget" in v}
    return [
        KeyBudget(frame, key, tuple(BudgetInput(**row) for row in rows))
        for key, rows in stated.items()
    ]


def _whole(table: dict[str, dict[str, Any]]) -> Found:
    """JSON knows no infinity: an uncertainty that is not there is one."""
    unknown = dict.fromkeys(PARTS, np.inf) | {"value": np.nan}
    return {
        key: {part: _number(estimate[part], nothing) for part, nothing in unknown.items()}
        for key, estimate in table.items()
    }


def _number(value: float | None, unknown: float) -> float:
    return unknown if value is None else value


def _laws(table: dict[str, Any]) -> WearLaws:
    """The wear laws, compared."""
    short = WEAR.removeprefix("wear.")
    laws = [
        LawFit(
            law=row["law"],
            parameters={
                WEAR if name == short else name: values
                for name, values in row.items()
                if isinstance(values, dict)
            },
            between=tuple(row["between"]),
            misfit=row["misfit"],
            freedom=row["degrees_of_freedom"],
            chi=row["chi"],
            log_evidence=row["log_evidence"],
        )
        for row in table["wear_laws"]
    ]
    return WearLaws(tuple(laws), tuple(table["wear_between_frames"]), table["wear_chi"])
