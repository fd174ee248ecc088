"""`report`: one HTML file of a run, from the folder that it left."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from isochrome import runs
from isochrome.calibration import calibration_report
from isochrome.comparison import compared_again
from isochrome.errors import InputError, reason_of
from isochrome.fitting import fit_report, restore_values
from isochrome.messages import message
from isochrome.output import output_folder
from isochrome.processing import process_report, restore
from isochrome.reporting import ReportContent, write_report
from isochrome.scene import parse_scene, read_text
from isochrome.simulation import simulation_report

_NEEDED = {
    "frames.csv": ("process", ("scene.toml", runs.STORE)),
    "fit.json": ("fit", ("scene.toml", runs.STORE)),
    "history.csv": ("simulate", ("scene.toml", "frames.tif", "fringe_order.tif", "simulation.png")),
    "calibration.json": ("calibrate", ("calibration.png",)),
    "scale.json": ("calibrate scale", ("scale.png",)),
    "metrics.csv": ("compare", ()),
}
"""The file by which a folder is known, the command that leaves it, and what else it leaves."""

_NAMED = "process, fit, track, simulate, calibrate or compare"


def report(folder: str | Path, out: str | Path | None = None) -> Path:
    """Write the report of a run: one HTML file that opens offline on any machine.

    It has what was found in a sentence; some frames beside their simulation, with N, x and z under
    the mouse; the values over the distance with their bands; causes, budget and warnings with
    their remedies; the scene; and what a paper states. Of a simulation it has the rendered frames,
    of a calibration its figure, images and settings. `process`, `fit`, `track`, `simulate`,
    `calibrate` and `compare` leave it beside their results; this makes it anew, of the files alone:
    of a comparison, of the two sets that were compared.

    Parameters
    ----------
    folder : str or Path
        The folder that process, fit, track, simulate, calibrate or compare left.
    out : str or Path, optional
        Folder for report.html; by default the run's own.

    Returns
    -------
    Path
        The file, below 10 MB.

    Raises
    ------
    InputError
        Where the folder holds no finished run, or its files cannot be read.

    Examples
    --------
    >>> import isochrome
    >>> frames = isochrome.simulate("ring").frames
    >>> found = isochrome.process(frames, "ring", "processed")
    >>> isochrome.report("processed").name
    'report.html'
    """
    place = Path(folder)
    file, again = _kind(place)
    record = runs.opened_record(place)
    assert record is not None
    # maps are many, and are looked at as they are read; of the rest all is small
    record.check(name for name in record.sizes if "/" not in name and name != runs.REPORT)
    try:
        content = _content(place, file, record.record)
    except InputError:
        raise
    except (OSError, KeyError, ValueError, TypeError, IndexError, AttributeError) as error:
        runs.name_damage(place)
        raise InputError(
            "cannot_read", place=place, reason=reason_of(error), again=again
        ) from error
    target = place if out is None else output_folder(out)
    written = write_report(target / runs.REPORT, content)
    runs.reseal(target, runs.REPORT)
    return written


def _kind(place: Path) -> tuple[str, str]:
    """The file by which a finished run's folder is known, and how it is made again."""
    if not place.is_dir():
        raise InputError("no_such_folder_name", place=place, named=_NAMED)
    result = next((name for name in _NEEDED if (place / name).is_file()), None)
    if result is None and (place / "summary.csv").is_file():
        raise InputError(f"{place}: " + message("campaign_name_folder_one"))
    if result is None or not (place / runs.PROVENANCE).is_file():
        hint = f"name a folder that {_NAMED} left"
        if Path(f"{place.resolve()}{runs.WORKING}").is_dir():
            hint = message("run_not_finished_run")
        missing = runs.PROVENANCE if result else " and no ".join(_NEEDED)
        raise InputError("holds_no", place=place, missing=missing, hint=hint)
    command, others = _NEEDED[result]
    # of these two nothing is kept to resume
    begun = "" if command.startswith(("calibrate", "compare")) else " with --restart"
    again = f"run {command} again{begun}"
    for name in others:
        if not (place / name).exists():
            raise InputError("holds_no", place=place, missing=name, hint=again)
    return result, again


def _content(place: Path, file: str, record: Mapping[str, Any]) -> ReportContent:
    if file in ("calibration.json", "scale.json"):
        return calibration_report(place, Path(file).stem, record)
    if file == "metrics.csv" and (place / "scars.csv").is_file():
        raise InputError("comparison_scars_which_has", place=place)
    if file == "metrics.csv":
        return compared_again(record, str(place))
    scene_file = place / "scene.toml"  # of a run, which goes by the folder's name
    name = place.resolve().name
    scene = parse_scene(read_text(scene_file), name=name, folder=place, label=str(scene_file))
    if file == "history.csv":
        return simulation_report(place, scene, record)
    if file == "fit.json":
        return fit_report(place, restore_values(place, scene, record.get("options") or {}), record)
    with runs.open_run(place) as dataset:
        rows, cols = dataset["normalised"].shape[-2:]
        return process_report(dataset, restore(scene, place, (rows, cols), None), record)
