"""`process_campaign`: many recordings by one scene, each on its own, and a table of all."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from isochrome.campaign.names import folder_names
from isochrome.campaign.outcome import Outcome, Task, outcome_of
from isochrome.campaign.side_by_side import side_by_side
from isochrome.campaign.summary import check_summary, summary_of, tabulate, write_summary
from isochrome.errors import InputError
from isochrome.frames import FramesPath, recordings_of
from isochrome.output.roi import load_roifile
from isochrome.process.run import check_scene
from isochrome.progress import RunProgress, Tally
from isochrome.runs import Stopped
from isochrome.runs.lock import locked
from isochrome.runs.run import WORTH_WORKERS_S
from isochrome.runs.workers import processors
from isochrome.runs.workplace import PROVENANCE, has_run, wipe, working_folder
from isochrome.scene import Scene, load_scene

CampaignProgress = Callable[[Tally, Tally | None], None]
"""Called with the recordings' Tally, and that of the frames of the one in work.

The second is None where none is, or several are.
"""


@dataclass(frozen=True)
class Campaign:
    """A finished campaign: `out`, its folder; `outcomes`, one a recording; `scene`, as given."""

    out: Path
    scene: Scene
    outcomes: tuple[Outcome, ...]

    @property
    def table(self) -> dict[str, list[Any]]:
        """The columns of summary.csv, a row a recording."""
        return tabulate([item.row for item in self.outcomes])

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


def process_campaign(
    recordings: str | Path | Sequence[FramesPath],
    scene: str | Path | Scene,
    out: str | Path,
    *,
    workers: int | None = 1,
    progress: CampaignProgress | None = None,
    **options: Any,
) -> Campaign:
    """Process many recordings by one scene, each into a folder of its own in `out`.

    A recording that is bad is reported in its row, and the others go on. Killed, the same call
    goes on with what is not complete.
    Parameters: `recordings`, a glob, of which each video, TIFF stack or folder is a recording, or a
    list with what `process` takes for each of them; `scene`; `out`, a folder for NAME/ (what
    `process` leaves), summary.csv (for each recording its counts, the median and largest chi, of
    each fitted key the mean, the standard deviation over the frames and the median standard
    uncertainty, the median kept_share, and what is said of it), summary.json (the same, with the
    hashes of all input) and summary.png (load and friction); `workers`, as for `process`: they
    share out frames, or whole recordings where these are many or short; `progress`;
    `options` of `process`: rois, cluster, restart, keep_going.
    Returns Campaign. Raises InputError where the scene, the folder or an option is wrong.
    """
    scene = load_scene(scene)
    check_scene(scene)
    if workers is not None and workers < 1:
        raise InputError(f"--workers {workers}: give 1 or more")
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
        _check_place(target, root, tasks)
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


def _check_place(target: Path, root: Path, tasks: Sequence[Task]) -> None:
    """Refuse a folder that holds something else than recordings' results."""
    if not tasks:
        raise InputError("no recordings are named; name at least one")
    if (target / PROVENANCE).exists() or has_run(root):
        raise InputError(
            f"{target}: holds the results of one recording, or an unfinished run of it, and these "
            f"are {len(tasks)}; name another --out folder"
        )
    check_summary(target)
    for task in tasks:
        own = task.frames if isinstance(task.frames, str | Path) else task.frames[0]
        if task.folder.exists() and task.folder.resolve() == Path(own).resolve():
            raise InputError(
                f"{own}: its results would be put among its images; name another --out folder"
            )


def _all(
    tasks: Sequence[Task],
    scene: Scene,
    options: Mapping[str, Any],
    workers: int | None,
    progress: CampaignProgress | None,
) -> list[Outcome]:
    """All recordings' outcomes in order; what is finished when it is stopped is kept."""
    found: dict[int, Outcome] = {}

    def tell(frames: Tally | None = None) -> None:
        if progress is not None:
            before = sum(item.already for item in found.values())
            flagged = sum(item.row["status"] != "ok" for item in found.values())
            progress(Tally(len(found), len(tasks), before, flagged), frames)

    tell()
    try:
        with closing(_outcomes(tasks, scene, options, workers, tell)) as outcomes:
            for number, outcome in outcomes:
                found[number] = outcome
                tell()
    except KeyboardInterrupt:
        raise Stopped(
            f"stopped; {len(found)} of {len(tasks)} recordings are finished and kept in "
            f"{tasks[0].folder.parent}: the same command goes on"
        ) from None
    return [found[number] for number in range(len(tasks))]


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
            yield from side_by_side(left, scene, options, most)
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
