"""`process_campaign`: many recordings by one scene, each on its own, and a table of all."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import closing, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome import figures, output, runs
from isochrome.errors import InputError, IsochromeError, PhysicsError
from isochrome.frames import FramesPath, recordings_of
from isochrome.messages import message
from isochrome.processing import SPREAD, Processed, check_scene, process
from isochrome.progress import RunProgress, Tally
from isochrome.scene import Scene, SceneLike, dump_scene, load_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SUMMARIES = ("summary.csv", "summary.json", "summary.png")
"""Files of the campaign itself, in the folder that holds those of its recordings."""

_LONGEST = 200
"""Bytes of a name; file systems take 255, and the working folder's is longer."""

_DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)
"""Names that Windows keeps for its devices."""


def folder_names(recordings: Sequence[FramesPath]) -> tuple[str, ...]:
    """A folder's name for each recording, plain on every system: its file's or folder's own. Equal
    ones get their folder's before them, or a number behind."""
    places = [Path(os.path.abspath(_first(frames))) for frames in recordings]
    plain = [_plain(place.name if place.is_dir() else place.stem) for place in places]
    count = Counter(map(_key, plain))
    taken = dict[str, str]()
    for place, name in zip(places, plain, strict=True):
        if count[_key(name)] > 1:
            name = _plain(f"{place.parent.name}-{name}")
        names = itertools.chain([name], (f"{name}-{number}" for number in itertools.count(2)))
        free = next(new for new in names if _key(new) not in taken)
        taken[_key(free)] = free
    return tuple(taken.values())


def _first(frames: FramesPath) -> str | Path:
    return frames if isinstance(frames, str | Path) else frames[0]


def _key(name: str) -> str:
    """The same for names that some file system takes for one."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def _plain(name: str) -> str:
    """A name that is a folder's on every system, and none of the campaign's own files'."""
    text = re.sub(r'[<>:"/\\|?*\x00-\x1f\x7f\ud800-\udfff]', "_", name)
    text = text.encode()[:_LONGEST].decode(errors="ignore").strip(" .")
    if text.casefold().endswith(runs.WORKING):
        text = f"{text[: -len(runs.WORKING)]}_{runs.WORKING[1:]}"
    if _DEVICE.fullmatch(text) or text.casefold() in SUMMARIES:
        text = f"_{text}"
    return text or "recording"


Array = NDArray[np.float64]

_VALUES = ("frames", "failed_frames", "flagged_frames", "duration_s", "pixel_mm", "chi_median",
           "chi_max", "kept_share")  # fmt: skip
"""Columns of the summary whose values a recording that failed has not."""


@dataclass(frozen=True)
class Task:
    """A recording, and the folder for its results."""

    frames: FramesPath
    folder: Path


@dataclass(frozen=True)
class Outcome:
    """What became of a recording: its `row` of the summary, `inputs` (files' SHA-256); `already`,
    whether an earlier campaign had left it all; `curves`, of as many frames as can be seen."""

    row: dict[str, Any]
    inputs: dict[str, str]
    exit_code: int = 0
    already: bool = False
    curves: dict[str, Array] = field(default_factory=dict)


def outcome_of(
    task: Task, scene: Scene, options: Mapping[str, Any], progress: RunProgress | None = None
) -> Outcome:
    """Process one recording into its folder; what is wrong with it, NoCluster apart, is its row."""
    try:
        if task.folder.is_symlink():
            raise InputError("symbolic_link_results_put", folder=task.folder)
        result = process(task.frames, scene, task.folder, progress=progress, **options)
    except runs.NoCluster:
        raise
    except IsochromeError as error:
        return failed(task, error)
    except MemoryError:
        return failed(task, PhysicsError(message("not_enough_memory_use")))
    return _read(task, result)


def failed(task: Task, error: IsochromeError) -> Outcome:
    """A recording that could not be processed, with the reason."""
    cause = error.__cause__
    # what is kept of an unfinished run depends on when it was stopped; the reason does not
    bare = isinstance(cause, IsochromeError) and str(error).startswith(f"{cause} (")
    row = _row(task, "failed") | {"error": " ".join(str(cause if bare else error).split())}
    hashes: dict[str, str] = {}
    for place in [task.frames] if isinstance(task.frames, str | Path) else task.frames:
        with suppress(InputError, OSError):  # what cannot be read has none
            hashes |= output.provenance(None, [place])["inputs_sha256"]
    return Outcome(row, hashes, error.exit_code)


def _row(task: Task, status: str) -> dict[str, Any]:
    """Columns that every recording has."""
    more = "" if isinstance(task.frames, str | Path) else " ..."
    # what every file can hold
    label = f"{_first(task.frames)}{more}".encode("utf-8", "replace").decode("utf-8")
    names = {"recording": label, "folder": task.folder.name, "status": status}
    return names | dict.fromkeys(_VALUES) | {"warnings": "", "error": ""}


def _read(task: Task, processed: Processed) -> Outcome:
    table = processed.columns
    count = len(table["frame"])
    flagged = sum(bool(text) for text in table["warnings"]) - processed.failed
    status = "flagged" if flagged or processed.failed else "ok"
    with processed.dataset as dataset:
        times, inputs = dataset.time_s.values, json.loads(dataset.attrs["inputs_sha256"])
    chi = _known(table, "chi")
    row = _row(task, "failed" if processed.failed == count else status) | {
        "frames": count,
        "failed_frames": processed.failed,
        "flagged_frames": flagged,
        "duration_s": _of_known(np.max, times[np.isfinite(times)]),
        "pixel_mm": next((p for p in table["pixel_mm"] if p is not None), None),
        "chi_median": _of_known(np.median, chi),
        "chi_max": _of_known(np.max, chi),
        "kept_share": _of_known(np.median, _known(table, "kept_share")),
        "warnings": "; ".join(processed.warnings),
    }
    keys = [name for name in table if f"{name} {SPREAD}" in table]
    for key in keys:
        values, spread = _known(table, key), _known(table, f"{key} {SPREAD}")
        row[f"{key} mean"] = _of_known(np.mean, values)
        row[f"{key} standard_deviation"] = float(values.std(ddof=1)) if values.size > 1 else None
        row[f"{key} median_{SPREAD}"] = _of_known(np.median, spread)
    if processed.failed:
        row["error"] = message("frames_could_not_processed", failed=processed.failed, count=count)
    names = ("distance_m", "frame", *keys, *(f"{key} {SPREAD}" for key in keys))
    step = -(-count // figures.MOST_POINTS)
    curves = {name: output.numbers(table[name])[::step] for name in names}
    code = InputError.exit_code if processed.failed else 0
    return Outcome(row, inputs, code, processed.already, curves)


def _known(table: Mapping[str, Sequence[Any]], name: str) -> Array:
    values = output.numbers(table[name]) if name in table else np.empty(0)
    return values[np.isfinite(values)]


def _of_known(measure: Any, values: Array) -> float | None:
    return float(measure(values)) if values.size else None


def run_side_by_side(
    tasks: Mapping[int, Task], scene: Scene, options: Mapping[str, Any], workers: int
) -> Generator[tuple[int, Outcome]]:
    """Process recordings in worker processes, each one after the other. Where a worker is killed,
    those that were in work are done again, each by a worker of its own."""
    waiting = dict(tasks)
    while waiting:
        try:
            with closing(_by_pool(waiting, scene, options, min(workers, len(waiting)))) as pool:
                for number, outcome in pool:
                    del waiting[number]
                    yield number, outcome
        except runs.WorkersLost:
            for number in list(waiting)[:workers]:  # as many as are given out at a time, in order
                task = waiting.pop(number)
                try:
                    ((_, outcome),) = _by_pool({number: task}, scene, options, 1)
                except runs.WorkersLost as error:
                    lost = InputError("process_worked_killed_twice")
                    lost.__cause__ = error
                    outcome = failed(task, lost)
                yield number, outcome


def _by_pool(
    tasks: Mapping[int, Task], scene: Scene, options: Mapping[str, Any], workers: int
) -> Generator[tuple[int, Outcome]]:
    given, by_one = dict(tasks), {**options, "workers": 1}
    with runs.WorkerPool(workers) as pool:

        def submit(number: int) -> Future[Outcome]:
            return pool.submit(outcome_of, given[number], scene, by_one)

        yield from runs.in_flight(submit, list(given), workers)


DRAWN = ("load.normal_n", "friction.coefficient")
"""Fitted keys that are drawn."""

_BANDED = 12
"""Recordings whose bands can be told apart; of more, lines alone are drawn."""

_NAMED = 30
"""Recordings whose names have room below an axis; more are counted."""


def _panels(every: Sequence[Outcome], rows: Sequence[int]) -> figures.PaperPanels:
    """Of some recordings by their numbers; none where no value of DRAWN was fitted."""
    chosen = [every[k] for k in rows]
    keys = [key for key in DRAWN if any(f"{key} mean" in item.row for item in chosen)]
    if not keys:
        return figures.PaperPanels()
    # at distances, where a recording has several
    slid = [item.curves.get("distance_m", np.empty(0)) for item in chosen]
    slides = any(np.unique(d[np.isfinite(d)]).size > 1 for d in slid)
    across, label = ("distance_m", "sliding distance (m)") if slides else ("frame", "frame")
    colours: list[Any] = list(figures.LINE_COLOURS[: len(chosen)])
    if len(colours) < len(chosen):  # too many to be told apart: they go with the order
        from matplotlib import colormaps

        colours = list(colormaps[figures.VALUE_MAP](np.linspace(0.0, 0.92, len(chosen))))

    def over(key: str, axes: Axes) -> None:
        _over_recordings(axes, key, chosen, colours)
        # below the axis, which rows of the summary the recordings are, from 1
        places = range(0, len(rows), -(-len(rows) // 8))
        axes.set_xlim(-0.6, len(rows) - 0.4)
        axes.set_xticks(places, [str(rows[k] + 1) for k in places])
        figures.style_axes(axes, x_label="recording", z_label=figures.KEY_LABELS[key])

    def within(key: str, axes: Axes) -> None:
        _within(axes, key, chosen, colours, across)
        figures.style_axes(axes, x_label=label, z_label=figures.KEY_LABELS[key])

    plots = [
        figures.Plot(title=name, draw=partial(draw, key))
        for key in keys
        for name, draw in (("mean", over), ("each frame", within))
    ]
    named = [
        f"{k + 1} {figures.plain_name(str(every[k].row['folder']), figures.SHORT_NAME)}"
        for k in rows
    ]
    note = "Recordings: " + ("; ".join(named) if len(rows) <= _NAMED else "as in summary.csv")
    return figures.PaperPanels(plots=plots, plots_across=2, notes=(note,))


def _over_recordings(
    axes: Axes, key: str, outcomes: Sequence[Outcome], colours: Sequence[Any]
) -> None:
    """Means with the scatter over the frames; a cross at the foot where nothing was found."""
    for place, (item, colour) in enumerate(zip(outcomes, colours, strict=True)):
        mean = item.row.get(f"{key} mean")
        if mean is None:
            foot = axes.get_xaxis_transform()
            axes.plot(place, 0.03, "x", color=figures.GREY, ms=5, transform=foot, clip_on=False)
            continue
        scatter = item.row[f"{key} standard_deviation"] or 0.0
        axes.errorbar(
            place, mean, yerr=scatter, fmt="o", color=colour, ms=4.5, capsize=3, lw=figures.LINE_PT
        )


def _within(
    axes: Axes, key: str, outcomes: Sequence[Outcome], colours: Sequence[Any], across: str
) -> None:
    for item, colour in zip(outcomes, colours, strict=True):
        if key not in item.curves:
            continue
        x, y = item.curves[across], item.curves[key]
        marker = "o" if len(x) < 15 else None
        if len(outcomes) <= _BANDED:
            spread = item.curves[f"{key} {SPREAD}"]
            figures.draw_band(
                axes, x, y, spread, colour=colour, lw=figures.LINE_PT, marker=marker, ms=3
            )
        else:
            axes.plot(x, y, color=colour, lw=figures.FINE_PT, alpha=0.7, marker=marker, ms=3)


_LAST = ("kept_share", "warnings", "error")


def write_summary(campaign: Campaign, beside: Path) -> None:
    """Leave summary.csv, .json and, where a key was fitted, .png, by way of a folder `beside`."""
    folder = output.output_folder(campaign.out)
    table, summary, picture = SUMMARIES
    try:
        output.write_csv(beside / table, campaign.columns)
        if _panels(campaign.outcomes, range(len(campaign.outcomes))).plots:
            output.write_figure(beside / picture, campaign.figure())
        written = [name for name in (table, picture) if (beside / name).exists()]
        runs.seal(beside, campaign.to_json(), file=summary, names=written)
        for name in (summary, table, picture):  # first what says whose they are
            if (beside / name).exists():
                os.replace(beside / name, folder / name)
            else:
                (folder / name).unlink(missing_ok=True)  # that of an earlier campaign
    except OSError as error:
        raise InputError(
            "summary_cannot_written_all", folder=folder, strerror=error.strerror or error
        ) from error


CampaignProgress = Callable[[Tally, Tally | None], None]
"""Called with the recordings' Tally, and that of the frames of the one in work, if it is one."""


@dataclass(frozen=True, repr=False)
class Campaign(output.Result):
    """A finished campaign.

    Parameters
    ----------
    out : Path
        Its folder.
    scene : Scene
        The scene as given.
    outcomes : tuple of Outcome
        What became of each recording, in order.
    """

    out: Path
    scene: Scene
    outcomes: tuple[Outcome, ...]

    @property
    def columns(self) -> dict[str, list[Any]]:
        """Those of summary.csv: what all recordings have, the keys of any, and what is said."""
        columns = output.columns_of(item.row for item in self.outcomes)
        none = [None] * len(self.outcomes)
        return columns | {name: columns.pop(name, none) for name in _LAST}

    @property
    def failed(self) -> tuple[str, ...]:
        """The recordings in which something, or everything, could not be processed."""
        return tuple(item.row["recording"] for item in self.outcomes if item.exit_code)

    @property
    def exit_code(self) -> int:
        """0; 2 where any recording's input is wrong; 3 where all that failed did by physics."""
        return min((item.exit_code for item in self.outcomes if item.exit_code), default=0)

    def to_json(self) -> dict[str, Any]:
        """What summary.json holds: version, scene, and each row with its files' hashes."""
        text = dump_scene(self.scene)
        return {
            **runs.environment(),
            "scene": text,
            "scene_sha256": hashlib.sha256(text.encode()).hexdigest(),
            "recordings": [item.row | {"inputs_sha256": item.inputs} for item in self.outcomes],
        }

    @property
    def warnings(self) -> tuple[str, ...]:
        """The recordings' warnings, and why any of them could not be processed."""
        return tuple(
            f"{item.row['recording']}: {item.row[kind]}"
            for item in self.outcomes
            for kind in ("error", "warnings")
            if item.row[kind]
        )

    @property
    def title(self) -> str:
        """The scene and how many recordings there are."""
        failed = f", {len(self.failed)} of them failed" if self.failed else ""
        count = output.counted(len(self.outcomes), "recording")
        return f"Campaign of {count} by {self.scene.name}{failed}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """Means over the recordings of what was fitted in each, and chi."""
        columns = self.columns
        for name in columns:
            if name.endswith(" mean") or name == "chi_median":
                yield name, output.over_items(columns[name], items="recordings")

    def figure(self) -> Figure:
        """Values over recordings, and within each over distance or frames. Raises InputError where
        neither load nor friction was fitted."""
        count = output.counted(len(self.outcomes), "recording")
        failed = sum(item.row["status"] == "failed" for item in self.outcomes)
        head = f"{figures.plain_name(self.scene.name)}: {count}"
        head += f", {failed} of them failed" if failed else ""
        head += "\nmean, and scatter over the frames (standard deviation; cross: nothing was found)"
        if len(self.outcomes) <= _BANDED:
            head += f"; each frame, band ± {figures.BAND:g} standard uncertainties"
        return figures.panels_figure(self.panels(), head)

    def panels(self, frames: tuple[int, ...] | None = None) -> figures.PaperPanels:
        """Give load and friction for a paper; see `paper_figure`.

        `frames`: numbers of the recordings that are shown, by default all. Raises InputError where
        neither was fitted in them.
        """
        count = len(self.outcomes)
        rows = figures.chosen_frames(frames, count, range(count), items="recordings")
        panels = _panels(self.outcomes, rows)
        if not panels.plots:
            raise InputError("neither_load_nor_friction", title=self.title)
        return panels


def process_campaign(
    recordings: str | Path | Sequence[FramesPath],
    scene: SceneLike,
    out: str | Path,
    *,
    workers: int | None = 1,
    progress: CampaignProgress | None = None,
    **options: Any,
) -> Campaign:
    """Process many recordings by one scene, each into a folder of its own in `out`.

    A recording that is bad is reported in its row, and the others are processed. After a crash, the
    same call resumes with what is not complete.

    Parameters
    ----------
    recordings : str, Path or sequence
        A glob, of which each video, TIFF stack or folder is a recording, or a list with what
        `process` takes for each of them.
    scene : str, Path, Scene or mapping
        A TOML file, the name of a scene of the package, a Scene, or its tables.
    out : str or Path
        Folder for NAME/ (what `process` leaves), summary.csv (for each recording its counts, the
        median and largest chi, of each fitted key the mean, the standard deviation over the frames
        and the median standard uncertainty, the median kept_share, and its warnings), summary.json
        (the same, with the hashes of all input) and summary.png (load and friction).
    workers : int or None, default 1
        Processes, as for `process`: they share out frames, or whole recordings where these are
        twice as many or more.
    progress : callable, optional
        Called with a Tally of the recordings, and one of the frames of the recording in work.
    **options : Any
        Options of `process`: rois, cluster, restart, keep_going.

    Returns
    -------
    Campaign
        The outcomes, a row a recording.

    Raises
    ------
    InputError
        Where the scene, the folder or an option is wrong.

    Examples
    --------
    >>> import isochrome
    >>> simulated = isochrome.simulate("ring", "simulated")
    >>> found = isochrome.process_campaign(["simulated/frames.tif"], "ring", "all")
    >>> found.table["status"].tolist()
    ['ok']
    """
    scene = load_scene(scene)
    check_scene(scene)
    if workers is not None and workers < 1:
        raise InputError("workers_give_more", workers=workers)
    if options.get("rois"):
        output.load_roifile()
    if isinstance(recordings, str | Path):
        recordings = recordings_of([recordings])
    target = Path(out)
    names = folder_names(recordings)
    tasks = [Task(frames, target / name) for frames, name in zip(recordings, names, strict=True)]
    root, made = runs.working_folder(target), not target.exists()
    with runs.locked(root):
        _check_place(target, root, tasks)
        runs.wipe(root)
        try:
            outcomes = _all(tasks, scene, options, workers, progress)
        finally:
            if made:
                with suppress(OSError):  # not empty: the results are there
                    target.rmdir()
        campaign = Campaign(target, scene, tuple(outcomes))
        write_summary(campaign, root)
        runs.wipe(root)
    return campaign


def _check_place(target: Path, root: Path, tasks: Sequence[Task]) -> None:
    """Refuse a folder that holds something else than recordings' results and their summary."""
    if not tasks:
        raise InputError("no_recordings_named_name")
    if (target / runs.PROVENANCE).exists() or runs.has_run(root):
        raise InputError("holds_results_one_recording", target=target, tasks_count=len(tasks))
    path, rows = target / SUMMARIES[1], None
    present = [target / name for name in SUMMARIES if os.path.lexists(target / name)]
    with suppress(OSError, ValueError, KeyError, TypeError):
        rows = json.loads(path.read_text("utf-8"))["recordings"]
    if present and rows is None and not runs.has_own_keys(path):
        raise InputError("would_replaced_campaign_summary", there=present[0])
    for task in tasks:
        first = _first(task.frames)
        if task.folder.exists() and task.folder.resolve() == Path(first).resolve():
            raise InputError("results_would_put_among", first=first)


def _all(
    tasks: Sequence[Task],
    scene: Scene,
    options: Mapping[str, Any],
    workers: int | None,
    progress: CampaignProgress | None,
) -> list[Outcome]:
    """Outcomes in order; what is finished when it is stopped is kept."""
    result: dict[int, Outcome] = {}

    def tell(frames: Tally | None = None) -> None:
        if progress is not None:
            before = sum(item.already for item in result.values())
            flagged = sum(item.row["status"] != "ok" for item in result.values())
            progress(Tally(len(result), len(tasks), before, flagged), frames)

    most = 1 if options.get("cluster") else workers or runs.processors()
    by_one = {**options, "workers": workers}
    # many recordings are done side by side; few share out their frames
    outcomes = (
        run_side_by_side(dict(enumerate(tasks)), scene, options, most)
        if 1 < most <= len(tasks) // 2
        else ((k, outcome_of(task, scene, by_one, tell)) for k, task in enumerate(tasks))
    )
    tell()
    try:
        with closing(outcomes):
            for number, outcome in outcomes:
                result[number] = outcome
                tell()
    except KeyboardInterrupt:
        text = message(
            "stopped_finished_kept_run", result_count=len(result),
            counted=output.counted(len(tasks), "recording"), parent=tasks[0].folder.parent,
        )  # fmt: skip
        raise runs.Stopped(text) from None
    return [result[number] for number in range(len(tasks))]
