"""`fit`: a scene's unknowns from captured frames, each with its standard uncertainty."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path

from isochrome.errors import InputError
from isochrome.fit.conclude import conclude
from isochrome.fit.folder import restore_fit, write_fit
from isochrome.fit.frame_fit import placed
from isochrome.fit.frame_set import FrameSet
from isochrome.fit.frame_work import FrameWork, Row
from isochrome.fit.history import alone_scene
from isochrome.fit.joint import JointFit
from isochrome.fit.joint_each import is_each
from isochrome.fit.local import GAMMA
from isochrome.fit.refuse import refuse_keys
from isochrome.fit.result import Fit, fitted_scene
from isochrome.fit.sequence import make_sequence
from isochrome.fit.tractions import refuse_without_contact
from isochrome.fit.tractions_run import asked_for, with_tractions
from isochrome.frames import FramesPath, absolute, input_files, open_scene_frames
from isochrome.output import provenance
from isochrome.progress import RunProgress, Tally
from isochrome.runs import (
    Bench,
    Job,
    Layout,
    Means,
    chunk_size,
    environment,
    run_job,
    single_threaded,
)
from isochrome.runs.chunks import rows
from isochrome.scene import Scene, dump_scene, load_scene

__all__ = ["Fit", "fit", "fitted_scene"]

_PASSES = 12
"""Times that a joint fit mostly goes through all frames."""


def fit(
    frames: FramesPath,
    scene: str | Path | Scene,
    free: list[str] | tuple[str, ...],
    *,
    per_frame: list[str] | tuple[str, ...] = (),
    follow: bool = False,
    tractions: bool = False,
    out: str | Path | None = None,
    workers: int | None = 1,
    cluster: str | None = None,
    restart: bool = False,
    progress: RunProgress | None = None,
) -> Fit:
    """Fit unknowns of a scene, named by their keys, to the intensities of captured frames.

    Each frame is fitted on its own first, then all together. Frames of a worn contact are states
    of one run: the wear is simulated with the load, friction and wear that the unknowns stand for,
    over all distances, in every step of the fit. Where frames share neither an unknown nor a
    history, their own fits are the result.
    Parameters: `frames`, one a state; `scene`, where the fit starts; `free`, keys that all frames
    share, such as 'load.normal_n' (an unknown frames.gamma is one of them); `per_frame`, keys with
    a value a frame; `follow`, whether a frame is looked for where the last one was, and there
    alone; `tractions`, whether each frame's pressure and shear are found without a contact model
    too; `out`, a folder for fit.csv, scene.toml (fitted), fit.json, provenance.json, fit.png,
    run.zarr (values over frame, `isochrome.open_run`), of several frames fit_over_distance.png and
    wear_laws.csv, and with `tractions` tractions.csv, tractions.png, sigma_1_mpa.tif,
    sigma_2_mpa.tif and fringe_order.tif; `workers`, `cluster`, `restart` and what becomes of a
    killed run as in `process`: the frames' own fits are kept in OUT.partial; `progress`, called
    with a Tally of frames, a pass over them counting as often as there are.
    Returns a Fit. Raises InputError for unknown keys and those that cannot be told apart,
    PhysicsError where the frames do not hold the scene's fringes.
    """
    scene = load_scene(scene)
    shared, own = tuple(free), tuple(per_frame)
    refuse_keys(scene, shared, own)
    if tractions:
        refuse_without_contact(scene)
    if out is None and (cluster is not None or workers != 1):
        raise InputError("workers and a cluster write to a folder: give out")
    if scene.frames.gamma == "unknown":
        scene = scene.with_values({GAMMA: scene.frames.first_gamma})
        shared += () if GAMMA in own + shared else (GAMMA,)
    frames = frames if isinstance(frames, str | Path) else tuple(frames)
    files = input_files(open_scene_frames(frames, scene), scene)
    if cluster is not None:
        frames, scene = absolute(frames, scene)
    with single_threaded(), closing(FrameSet(frames, scene)) as data:
        task = _Task(data, shared, own, follow, tractions, progress)
        if out is None:
            return task.in_memory()
        keys = {"free": list(shared), "per_frame": list(own)}
        options = {"options": keys | {"follow": follow, "tractions": tractions}}
        identity = provenance(dump_scene(data.given), files) | environment() | options
        work = task.work.following if follow else task.work
        job = Job(work, task.layout, identity, in_turn=follow)
        return task.to_folder(job, Path(out), Means(workers, cluster, restart))


class _Task:
    """A fit that was begun: its frames, unknowns, and how far it is."""

    def __init__(
        self,
        data: FrameSet,
        shared: tuple[str, ...],
        own: tuple[str, ...],
        follow: bool,
        tractions: bool,
        progress: RunProgress | None,
    ) -> None:
        sequence = make_sequence(placed(data.scene, data.shape), len(data), shared, own)
        rows, cols = data.shape
        self.data, self.follow, self.tractions = data, follow, tractions
        self.free_top = "camera.top_mm" in shared + own
        self.work = FrameWork(data, sequence)
        self.layout = Layout({"frame": len(data)}, {}, (), chunk_size(len(data), 4 * rows * cols))
        passes = 0 if is_each(sequence) else _PASSES
        self.steps = _Steps(progress, len(data), 1 + passes + tractions)

    def in_memory(self) -> Fit:
        """The fit, which leaves no files."""
        found: list[Row] = []
        left = None
        for i in range(len(self.data)):
            part = self.work.following(i, i + 1, left) if self.follow else self.work(i, i + 1)
            left = part.left
            found += part.rows
            self.steps.one()
        return self._concluded(found)[0]

    def to_folder(self, job: Job, out: Path, means: Means) -> Fit:
        """The fit, its files and what is kept of it on the way in a folder."""

        def finish(bench: Bench) -> Fit:
            result, joint = self._concluded([row for row, _ in rows(bench)])
            write_fit(bench, job, self.data.given.name, self.data, result, joint)
            return result

        found = run_job(job, out, finish, means=means, progress=self.steps.run)
        if found is None and self.tractions:  # a folder does not hold all of them
            found = run_job(
                job, out, finish, means=replace(means, restart=True), progress=self.steps.run
            )
        return found or restore_fit(out, self.data.given)

    def _concluded(self, found: list[Row]) -> tuple[Fit, JointFit]:
        data, sequence = self.data, self.work.sequence
        alone = [self.work.restored(i, row) for i, row in enumerate(found)]
        said = [(i, text) for i, row in enumerate(found) for text in row["said"]]
        result, joint = conclude(data, sequence, alone, said, self.steps.one)
        if self.tractions:
            given = [placed(alone_scene(data.scene, i), data.shape) for i in range(len(data))]
            result = with_tractions(
                result, data, joint, given, free_top=self.free_top, told=self.steps.one
            )
        else:
            result = replace(result, warnings=(*result.warnings, *asked_for(result)))
        self.steps.end()
        return result, joint


class _Steps:
    """Progress over passes whose number is not known before."""

    def __init__(self, progress: RunProgress | None, count: int, passes: int) -> None:
        self.progress, self.count = progress, count
        self.tally = Tally(0, count * passes, 0, 0)

    def run(self, tally: Tally) -> None:
        """How far the first pass is."""
        self._tell(replace(tally, count=self.tally.count))

    def one(self) -> None:
        """One frame of one pass is done."""
        done, count = self.tally.done + 1, self.tally.count
        self._tell(replace(self.tally, done=done, count=count + self.count * (done > count)))

    def end(self) -> None:
        """All is done."""
        self._tell(replace(self.tally, done=self.tally.count))

    def _tell(self, tally: Tally) -> None:
        self.tally = tally
        if self.progress is not None:
            self.progress(tally)
