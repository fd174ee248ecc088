"""`fit --track`: a video's frames one after the other, each followed from the one before."""

from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from isochrome.errors import InputError
from isochrome.fitting.folder import keep_values, kept_values
from isochrome.fitting.frame.frame_fit import placed
from isochrome.fitting.frame.single_state import slid_until, sliding_scene
from isochrome.fitting.frame_set import refuse_keys, refuse_states
from isochrome.fitting.result import column_name
from isochrome.fitting.tracking.result import TRACK_PARTS, Track, make_track, restored, track_row
from isochrome.fitting.tracking.tracker import Apparatus, Tracker, find_apparatus
from isochrome.frames import (
    FrameReader,
    input_files,
    load_no_load,
    open_scene_frames,
    with_file_scale,
)
from isochrome.output import write_figure
from isochrome.progress import RunProgress
from isochrome.runs import (
    Job,
    Results,
    RunFolder,
    RunLayout,
    RunOptions,
    column,
    computed,
    rows,
    run_identity,
    run_job,
    single_threaded,
)
from isochrome.scene import (
    FramesLike,
    Scene,
    SceneLike,
    check_pixel,
    dump_scene,
    frames_of,
    load_scene,
)

__all__ = ["Track", "track"]

CHUNK = 250
"""Frames that are kept together: a killed track goes on from the last of them."""


def track(
    frames: FramesLike,
    scene: SceneLike,
    keys: list[str] | tuple[str, ...],
    *,
    as_stated: bool = False,
    out: str | Path | None = None,
    workers: int | None = None,
    cluster: str | None = None,
    restart: bool = False,
    progress: RunProgress | None = None,
) -> Track:
    """Follow keys of a contact scene through a video, each frame from the one before.

    One frame is in memory. Of a worn contact, the worn area at a frame is what the tracked loads
    and frictions have worn until then by the scene's law; its distance comes from the frames' times
    and frames.sliding_speed_mm_per_s, or from wear.distances_m, one a frame.

    Parameters
    ----------
    frames : str, Path, sequence of them, array or sequence of arrays
        A TIFF stack, image, video, or a folder, list or glob of them, or frames in memory, as for
        `open_frames`.
    scene : str, Path, Scene or mapping
        A TOML file, the name of a scene of the package, a Scene, or its tables, where the first
        frame's search starts.
    keys : list or tuple of str
        Keys to follow: load.normal_n, load.tangential_n, load.bulk_mpa, friction.coefficient,
        wear.coefficient_mm2_per_n, camera.left_mm, camera.top_mm.
    as_stated : bool, default False
        Whether all that the scene states is held; else the first frame (or the middle or last one,
        where that shows nothing) is asked for what belongs to the apparatus (the camera's roll,
        distortion and keystone, gamma, blur, plates, band of wavelengths, uneven light, dust), and
        what is found is held in all frames and named in the warnings.
    out : str or Path, optional
        Folder for fit.csv, scene.toml (the means), fit.json, provenance.json, fit.png,
        report.html, run.zarr (values over frame, see `open_run`).
    workers : int or None, optional
        Only one process can follow a track: more than one is refused.
    cluster : str, optional
        Refused, as more than one worker is.
    restart : bool, default False
        Whether to begin anew where an earlier run was interrupted or is complete.
    progress : callable, optional
        Called with a Tally of the frames.

    Returns
    -------
    Track
        Values and standard uncertainties (frame, key), in the units that the keys name, and chi
        (frame,).

    Raises
    ------
    InputError
        Where keys or the scene cannot be tracked, or frames are bad.
    PhysicsError
        Where no frame determines a value.

    Notes
    -----
    What is finished is kept in ``OUT.partial`` until all is: after a crash, the same call
    resumes from there. The worn area is W' = ∫ k P' ds over the sliding distance s, with the
    wear coefficient k (mm²/N) and the load P' on a unit of thickness (N/mm): Archard (1953), J.
    Appl. Phys. 24, 981.

    Examples
    --------
    A video of a contact, which this page has none of:

    >>> import isochrome
    >>> found = isochrome.track(
    ...     "recording.avi", "scene.toml", ["load.normal_n", "camera.left_mm"], out="tracked"
    ... )  # doctest: +SKIP
    >>> found.table  # doctest: +SKIP
    """
    scene = load_scene(scene)
    keys = tuple(keys)
    refuse_keys(scene, (), keys)
    frames = frames_of(frames)
    with single_threaded(), open_scene_frames(frames, scene) as reader:
        scene = with_file_scale(scene, reader)
        check_pixel(scene, reader.shape)
        work = _TrackWork(reader, sliding_scene(scene), keys)
        count = reader.count(decode=False)
        if count == 0:
            raise InputError("holds_no_frame_check", path=reader.path)
        if scene.frames.sliding_speed_mm_per_s is None:
            refuse_states(reader.path, count, work.scene)
        if not as_stated:
            work.ask(count)
        layout = RunLayout(axes={"frame": count}, chunk=CHUNK)
        if out is None:
            return work.result(computed(Job(work, layout, {}, in_turn=True), progress))
        options = {"track": list(keys)} | ({"as_stated": True} if as_stated else {})
        identity = run_identity(dump_scene(scene), input_files(reader, scene), options)
        job = Job(work, layout, identity, in_turn=True)
        result = run_job(
            job, out, partial(_finish, job, work),
            options=RunOptions(workers, cluster, restart), progress=progress,
        )  # fmt: skip
    if result is not None:
        return result
    selected, fitted = kept_values(Path(out), scene)
    return restored(selected, keys, fitted)


class _TrackWork:
    """Tracks chunks of frames in turn: the polynomials are made anew in each."""

    def __init__(self, reader: FrameReader, scene: Scene, keys: tuple[str, ...]) -> None:
        self.scene, self.keys, self.reader = scene, keys, reader
        self._no_load = load_no_load(scene, full_shape=reader.full_shape)
        self.apparatus = Apparatus(scene=placed(scene, reader.shape))
        self._tracker()  # what cannot be tracked is refused

    def ask(self, count: int) -> None:
        """Ask a few of the frames what belongs to the apparatus."""
        self.apparatus = find_apparatus(
            self.reader, self.scene, self.keys, count=count, no_load=self._no_load
        )
        self.scene = self.apparatus.scene

    def __call__(self, start: int, stop: int, left: Any) -> Results:
        """Frames [start, stop), from what the frames before have `left`."""
        tracker = self._tracker()
        if left is not None:
            tracker.resume(left)
        result = []
        for index in range(start, stop):
            frame = self.reader.frame(index)
            distance = slid_until(self.scene, frame)
            result.append(track_row(index, distance, self.keys, tracker.track(frame, distance)))
        more = [{"status": "flagged" if row["messages"] else "ok"} for row in result]
        return Results({}, result, more, {}, tracker.state())

    def result(self, rows: Iterable[Mapping[str, Any]]) -> Track:
        """The track of all frames' rows. Raises PhysicsError where none tells any value."""
        return make_track(rows, self.keys, self.scene, self.apparatus.warnings)

    def _tracker(self) -> Tracker:
        one, depth = self.apparatus, self.reader.bit_depth
        return Tracker(one.scene, self.keys, bit_depth=depth, no_load=self._no_load, apparatus=one)


def _finish(job: Job, work: _TrackWork, run_folder: RunFolder) -> Track:
    """Make the files that need all frames, from what is kept of their chunks."""
    result = work.result(row for row, _ in rows(run_folder))
    write_figure(run_folder.results / "fit.png", result.figure())
    status = [more["status"] for _, more in rows(run_folder)]
    searched = result.over_frames.searched.astype(int).tolist()
    columns = {
        "chi": column(result.chi.tolist(), "frame", "chi"),
        "searched": column(searched, "frame", "searched"),
        "status": column(status, "frame", "status"),
    }
    for j, key in enumerate(result.keys):
        for part, name in TRACK_PARTS.items():
            values = getattr(result, name)[:, j].tolist()
            columns[column_name(key, part)] = column(values, "frame", key)
    keep_values(run_folder.results, job, result, columns)
    return result
