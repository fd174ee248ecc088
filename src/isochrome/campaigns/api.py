"""`process_campaign`: many recordings by one scene, each on its own, and a table of all."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from isochrome.campaigns.figure import campaign_panels, summary_figure
from isochrome.campaigns.outcome import SUMMARIES, Outcome, Task, failed, folder_names, outcome_of
from isochrome.errors import InputError
from isochrome.figures import PaperPanels
from isochrome.frames import FramesPath, recordings_of
from isochrome.messages import message
from isochrome.output import (
    Result,
    columns_of,
    counted,
    load_roifile,
    output_folder,
    over_items,
    write_csv,
    write_figure,
)
from isochrome.processing import check_scene
from isochrome.progress import RunProgress, Tally
from isochrome.runs import (
    PROVENANCE,
    WORTH_WORKERS_S,
    Stopped,
    WorkersLost,
    environment,
    has_own_keys,
    has_run,
    in_flight,
    locked,
    processors,
    seal,
    wipe,
    worker_pool,
    working_folder,
)
from isochrome.scene import Scene, SceneLike, dump_scene, load_scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

T = TypeVar("T")

_TASK: list[tuple[Scene, dict[str, Any]]] = []
"""What a worker process was started for."""


def run_side_by_side(
    tasks: Mapping[int, Task], scene: Scene, options: Mapping[str, Any], workers: int
) -> Generator[tuple[int, Outcome]]:
    """Process recordings by their numbers in worker processes, each of which does one after the
    other.

    Where a worker is killed, those that were in work then are done again, each by a worker of its
    own: what kills that too has failed, and the others go on.
    """
    waiting = dict(tasks)
    while waiting:
        try:
            with closing(_by_pool(waiting, scene, options, min(workers, len(waiting)))) as pool:
                for number, outcome in pool:
                    del waiting[number]
                    yield number, outcome
        except WorkersLost:
            for number in list(waiting)[:workers]:  # as many as are given out at a time, in order
                yield number, _by_itself(number, waiting.pop(number), scene, options)


def _by_pool(
    tasks: Mapping[int, Task], scene: Scene, options: Mapping[str, Any], workers: int
) -> Generator[tuple[int, Outcome]]:
    with worker_pool(workers, _take_task, (scene, dict(options))) as pool:
        given = dict(tasks)
        yield from in_flight(lambda k: pool.submit(_in_worker, given[k]), list(given), workers)


def _by_itself(number: int, task: Task, scene: Scene, options: Mapping[str, Any]) -> Outcome:
    try:
        ((_, outcome),) = _by_pool({number: task}, scene, options, 1)
    except WorkersLost as error:
        lost = InputError("process_worked_killed_twice")
        lost.__cause__ = error
        return failed(task, lost)
    return outcome


def _take_task(scene: Scene, options: dict[str, Any]) -> None:
    _TASK[:] = [(scene, options)]


def _in_worker(task: Task) -> Outcome:
    ((scene, options),) = _TASK
    return outcome_of(task, scene, options | {"workers": 1})


_LAST = ("kept_share", "warnings", "error")


def tabulate_campaign(rows: Sequence[dict[str, Any]]) -> dict[str, list[Any]]:
    """The columns of summary.csv: what all recordings have, the keys of any, and what is said."""
    columns = columns_of(rows)
    unknown: list[Any] = [None] * len(rows)
    last = {name: columns.pop(name, unknown) for name in _LAST}
    return columns | last


def summary_of(scene: Scene, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """What summary.json holds: version, scene, and each recording's row with its files' hashes."""
    text = dump_scene(scene)
    return {
        **environment(),
        "scene": text,
        "scene_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "recordings": [item.row | {"inputs_sha256": item.inputs} for item in outcomes],
    }


def write_summary(out: Path, scene: Scene, outcomes: Sequence[Outcome], beside: Path) -> None:
    """Leave summary.csv, summary.json and, where a key was fitted that has one, summary.png.

    They are made in a folder `beside` the results, on the same drive.
    """
    folder = output_folder(out)
    table, summary, picture = SUMMARIES
    figure = summary_figure(scene.name, outcomes)
    try:
        write_csv(beside / table, tabulate_campaign([item.row for item in outcomes]))
        if figure is not None:
            write_figure(beside / picture, figure)
        left = [name for name in (table, picture) if (beside / name).exists()]
        seal(beside, summary_of(scene, outcomes), file=summary, names=left)
        for name in (summary, table, picture):  # first what says whose they are
            if (beside / name).exists():
                os.replace(beside / name, folder / name)
            else:
                (folder / name).unlink(missing_ok=True)  # that of an earlier campaign
    except OSError as error:
        raise InputError(
            "summary_cannot_written_all", folder=folder, strerror=error.strerror or error
        ) from error


def check_summary(out: Path) -> set[str]:
    """Folders of recordings that a campaign has left in `out`.

    Raises InputError rather than replace files of the summary's names that no campaign has left.
    """
    path, rows = out / SUMMARIES[1], None
    there = [out / name for name in SUMMARIES if os.path.lexists(out / name)]
    try:
        rows = json.loads(path.read_text("utf-8"))["recordings"]
        left = {row["folder"] for row in rows if row["status"] != "failed"}
    except (OSError, ValueError, KeyError, TypeError):
        left = set()
    if there and rows is None and not has_own_keys(path):
        raise InputError("would_replaced_campaign_summary", there=there[0])
    return left


CampaignProgress = Callable[[Tally, Tally | None], None]
"""Called with the recordings' Tally, and that of the frames of the one in work.

The second is None where none is, or several are.
"""


@dataclass(frozen=True, repr=False)
class Campaign(Result):
    """A finished campaign.

    Parameters
    ----------
    out : Path
        Its folder.
    scene : Scene
        The scene as given.
    outcomes : tuple of Outcome
        What became of each recording, in order.
    draw : callable, optional
        Not used: the figure is made of the outcomes.
    """

    out: Path
    scene: Scene
    outcomes: tuple[Outcome, ...]

    @property
    def columns(self) -> dict[str, list[Any]]:
        """Those of summary.csv, a row a recording."""
        return tabulate_campaign([item.row for item in self.outcomes])

    @property
    def failed(self) -> tuple[str, ...]:
        """The recordings in which something, or everything, could not be processed."""
        return tuple(item.row["recording"] for item in self.outcomes if item.exit_code)

    @property
    def exit_code(self) -> int:
        """0; 2 where any recording's input is wrong; 3 where all that failed did by physics."""
        codes = {item.exit_code for item in self.outcomes} - {0}
        return min(codes, default=0)

    def to_json(self) -> dict[str, Any]:
        """What summary.json holds."""
        return summary_of(self.scene, self.outcomes)

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
        count = counted(len(self.outcomes), "recording")
        return f"Campaign of {count} by {self.scene.name}{failed}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """Means over the recordings of what was fitted in each, and chi."""
        columns = self.columns
        for name in columns:
            if name.endswith(" mean") or name == "chi_median":
                yield name, over_items(columns[name], items="recordings")

    def figure(self) -> Figure:
        """Load and friction of each recording. Raises InputError where neither was fitted."""
        return self._drawn(summary_figure(self.scene.name, self.outcomes))

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Load and friction of the recordings of these numbers for a paper; see `paper_figure`."""
        return self._drawn(campaign_panels(self.outcomes, frames))

    def _drawn(self, result: T | None) -> T:
        if result is None:
            raise InputError("neither_load_nor_friction", title=self.title)
        return result


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
        Processes, as for `process`: they share out frames, or whole recordings where these are many
        or short.
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
    >>> scene = isochrome.load_scene("ring").with_values({
    ...     "load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
    ...     "camera.pixel_mm": 0.36, "camera.noise_grey": 1.0})
    >>> simulated = isochrome.simulate(scene, "simulated")
    >>> found = isochrome.process_campaign(["simulated/frames.tif"], scene, "all")
    >>> found.table["status"].tolist()
    ['ok']
    """
    scene = load_scene(scene)
    check_scene(scene)
    if workers is not None and workers < 1:
        raise InputError("workers_give_more", workers=workers)
    if options.get("rois"):
        load_roifile()
    if isinstance(recordings, str | Path):
        recordings = recordings_of([recordings])
    target = Path(out)
    tasks = [
        Task(frames, name, target / name)
        for frames, name in zip(recordings, folder_names(recordings), strict=True)
    ]
    root, made = working_folder(target), not target.exists()
    with locked(root):
        for link in _check_place(target, root, tasks):
            link.unlink()  # the link, never what it points to
        wipe(root)
        try:
            outcomes = _all(tasks, scene, options, workers, progress)
        finally:
            if made:
                with suppress(OSError):  # not empty: the results are there
                    target.rmdir()
        write_summary(target, scene, outcomes, root)
        wipe(root)
    return Campaign(target, scene, tuple(outcomes))


def _check_place(target: Path, root: Path, tasks: Sequence[Task]) -> list[Path]:
    """Refuse a folder that holds something else than recordings' results.

    Returns the links that were put in the place of results since.
    """
    if not tasks:
        raise InputError("no_recordings_named_name")
    if (target / PROVENANCE).exists() or has_run(root):
        raise InputError("holds_results_one_recording", target=target, tasks_count=len(tasks))
    before = check_summary(target)
    links = [task.folder for task in tasks if task.name in before and task.folder.is_symlink()]
    for task in tasks:
        first = task.frames if isinstance(task.frames, str | Path) else task.frames[0]
        place = task.folder
        if place not in links and place.exists() and place.resolve() == Path(first).resolve():
            raise InputError("results_would_put_among", first=first)
    return links


def _all(
    tasks: Sequence[Task],
    scene: Scene,
    options: Mapping[str, Any],
    workers: int | None,
    progress: CampaignProgress | None,
) -> list[Outcome]:
    """All recordings' outcomes in order; what is finished when it is stopped is kept."""
    result: dict[int, Outcome] = {}

    def tell(frames: Tally | None = None) -> None:
        if progress is not None:
            before = sum(item.already for item in result.values())
            flagged = sum(item.row["status"] != "ok" for item in result.values())
            progress(Tally(len(result), len(tasks), before, flagged), frames)

    tell()
    try:
        with closing(_outcomes(tasks, scene, options, workers, tell)) as outcomes:
            for number, outcome in outcomes:
                result[number] = outcome
                tell()
    except KeyboardInterrupt:
        raise Stopped(
            message(
                "stopped_finished_kept_run",
                result_count=len(result),
                counted=counted(len(tasks), "recording"),
                parent=tasks[0].folder.parent,
            )
        ) from None
    return [result[number] for number in range(len(tasks))]


def _outcomes(
    tasks: Sequence[Task],
    scene: Scene,
    options: Mapping[str, Any],
    workers: int | None,
    tell: RunProgress,
) -> Generator[tuple[int, Outcome]]:
    """One recording after the other, until it pays to compute whole ones side by side."""
    most = 1 if options.get("cluster") else workers or processors()
    began = time.perf_counter()
    for number, task in enumerate(tasks):
        each_s = (time.perf_counter() - began) / number if number else None
        if _pays(each_s, len(tasks) - number, most, asked=workers is not None):
            left = dict(enumerate(tasks[number:], number))
            yield from run_side_by_side(left, scene, options, most)
            return
        yield number, outcome_of(task, scene, {**options, "workers": workers}, tell)


def _pays(each_s: float | None, left: int, workers: int, *, asked: bool) -> bool:
    """Whether the recordings left are sooner done side by side, with `each_s` for each so far.

    So it is with many, and with few where each is known to be too short for workers of its own;
    where nobody `asked` for workers, only if all of them are worth the workers' start.
    """
    short = each_s is not None and each_s < WORTH_WORKERS_S
    worth = asked or (each_s is not None and each_s * left > WORTH_WORKERS_S)
    return workers > 1 and worth and left >= (2 if short else 2 * workers)
