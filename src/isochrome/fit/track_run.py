"""`fit --track`: a video's frames one after the other, each followed from the one before."""

from __future__ import annotations

import json
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any

from isochrome.errors import InputError
from isochrome.fit.frame_fit import placed
from isochrome.fit.one_state import frame_distance, timed_distance
from isochrome.fit.refuse import refuse_keys
from isochrome.fit.track_figure import track_figure
from isochrome.fit.track_result import Track, TrackRows, columns_of, is_good, restored, row_of
from isochrome.fit.tracker import Tracker
from isochrome.frames import (
    Frame,
    FrameReader,
    FramesPath,
    input_files,
    load_no_load,
    open_scene_frames,
    with_file_scale,
)
from isochrome.frames.onward import Onward
from isochrome.output import TableWriter, provenance, write_figure, write_json, write_text
from isochrome.progress import RunProgress, Tally
from isochrome.runs import (
    STORE,
    Bench,
    Job,
    Layout,
    Means,
    Results,
    environment,
    run_job,
    single_threaded,
)
from isochrome.runs.chunks import rows
from isochrome.runs.store import add_columns, attributes, column
from isochrome.scene import Scene, check_pixel, dump_scene, load_scene, parse_scene
from isochrome.simulate import state_count

__all__ = ["Track", "refuse_shared", "track"]

CHUNK = 250
"""Frames that are kept together: a killed track goes on from the last of them."""


def refuse_shared(keys: tuple[str, ...]) -> None:
    """Refuse keys that all frames share: a frame is tracked before the others are seen.

    Raises InputError that names the key and what to do.
    """
    if keys:
        raise InputError(
            f"--free {keys[0]} together with --track: a tracked frame's values are its own; name "
            f"it with --per-frame, or fit it on a few frames first and put it into the scene"
        )


def track(
    frames: FramesPath,
    scene: str | Path | Scene,
    keys: list[str] | tuple[str, ...],
    *,
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
    Parameters: `frames`; `scene`, where the first frame's search starts; `keys`, see
    `isochrome.fit.track_course.TRACKED`; `out`, a folder for fit.csv, scene.toml (the means),
    fit.json, provenance.json, fit.png, run.zarr (values over frame, `isochrome.open_run`): what is
    finished is kept in OUT.partial until all is, and the same call after a crash goes on there;
    `workers`, `cluster`: only one process can do this, and more are refused; `restart`, to begin
    anew; `progress`, called with a Tally. Returns a Track. Raises InputError for keys and scenes
    that cannot be tracked, and for frames that are bad, PhysicsError where no frame tells a value.
    """
    scene = load_scene(scene)
    keys = tuple(keys)
    refuse_keys(scene, (), keys)
    with single_threaded(), open_scene_frames(frames, scene) as reader:
        scene = with_file_scale(scene, reader)
        check_pixel(scene, reader.shape)
        files = input_files(reader, scene)
        identity = provenance(dump_scene(scene), files) | environment()
        identity |= {"options": {"track": list(keys)}}
        if scene.frames.sliding_speed_mm_per_s is not None and scene.friction is not None:
            scene = scene.with_values({"friction.static_state_first": False})
        with closing(_TrackWork(reader, scene, keys)) as work:
            count = _counted(reader, scene)
            if out is None:
                return _in_memory(work, count, progress)
            job = Job(work, Layout({"frame": count}, {}, (), CHUNK), identity, in_turn=True)
            found = run_job(
                job, out, lambda bench: _finish(bench, job, work),
                means=Means(workers, cluster, restart), progress=progress,
            )  # fmt: skip
    return found or _restored(Path(out), scene, keys)


class _TrackWork:
    """Tracks chunks of frames in turn: the polynomials are made anew in each."""

    def __init__(self, reader: FrameReader, scene: Scene, keys: tuple[str, ...]) -> None:
        self.scene, self.keys, self.reader = scene, keys, reader
        self._frames = Onward(reader)
        self._no_load = load_no_load(scene, full_shape=reader.full_shape)
        self._tracker()

    def __call__(self, start: int, stop: int, left: Any) -> Results:
        """Frames [start, stop), from what the frames before have `left`."""
        tracker = self._tracker()
        if left is not None:
            tracker.resume(left)
        found = []
        for index in range(start, stop):
            frame = self._frames.frame(index)
            distance = _distance(frame, self.scene)
            found.append(row_of(index, distance, tracker.track(frame, distance)))
        more = [{"status": "ok" if is_good(row) else "flagged"} for row in found]
        return Results({}, found, more, {}, tracker.state())

    def close(self) -> None:
        """Close the file."""
        self._frames.close()

    def _tracker(self) -> Tracker:
        scene = placed(self.scene, self.reader.shape)
        return Tracker(scene, self.keys, bit_depth=self.reader.bit_depth, no_load=self._no_load)


def _in_memory(work: _TrackWork, count: int, progress: RunProgress | None) -> Track:
    """All frames, in the same chunks as into a folder."""
    found, left, flagged = TrackRows(work.keys), None, 0
    for start in range(0, count, CHUNK):
        stop = min(start + CHUNK, count)
        part = work(start, stop, left)
        left = json.loads(json.dumps(part.left))
        for row in part.rows:
            found.add(row)
            flagged += not is_good(row)
        if progress is not None:
            progress(Tally(stop, count, 0, flagged))
    return found.result(work.scene)


def _finish(bench: Bench, job: Job, work: _TrackWork) -> Track:
    """Make the files that need all frames, from what is kept of their chunks."""
    folder, found = bench.results, TrackRows(work.keys)
    each = (row for row, _ in rows(bench))
    with TableWriter(folder / "fit.csv") as table:
        while some := list(islice(each, CHUNK)):
            table.append(columns_of(work.keys, some))
            for row in some:
                found.add(row)
    result = found.result(work.scene)
    write_text(folder / "scene.toml", dump_scene(result.scene))
    write_json(folder / "fit.json", result.to_json())
    write_figure(folder / "fit.png", track_figure(work.scene.name, result))
    status = [more["status"] for _, more in rows(bench)]
    _add(folder / STORE, job, result, status)
    return result


def _add(store: Path, job: Job, result: Track, status: list[str]) -> None:
    """Values over frame, with their uncertainties."""
    searched = set(result.searched)
    columns = {
        "chi": column(result.chi.tolist(), "frame", "chi"),
        "searched": column([int(i in searched) for i in range(len(status))], "frame", "searched"),
        "status": column(status, "frame", "status"),
    }
    for j, key in enumerate(result.keys):
        for name, part in (
            (key, result.values),
            (f"{key} standard_uncertainty", result.standard_uncertainty),
            (f"{key} cramer_rao_bound", result.cramer_rao_bound),
        ):
            columns[name] = column(part[:, j].tolist(), "frame", key)
    axes = {
        "frame": column(list(range(len(status))), "frame", "frame"),
        "distance_m": column(result.distance_m.tolist(), "frame", "distance_m"),
    }
    add_columns(store, columns, axes, attributes(job.identity))


def _restored(out: Path, scene: Scene, keys: tuple[str, ...]) -> Track:
    """What an earlier run found, from the folder that it left complete."""
    text = (out / "scene.toml").read_text("utf-8")
    fitted = parse_scene(text, name=scene.name, folder=scene.folder)
    return restored(json.loads((out / "fit.json").read_text("utf-8")), keys, fitted)


def _distance(frame: Frame, scene: Scene) -> float | None:
    """The distance (m) slid until a frame; None where nothing wears."""
    if scene.wear is None:
        return None
    speed = scene.frames.sliding_speed_mm_per_s
    if speed is None:
        return frame_distance(scene, frame.index)
    return timed_distance(frame, speed)


def _counted(reader: FrameReader, scene: Scene) -> int:
    """How many frames there are. Raises InputError where there are none, or other states."""
    count = reader.count(decode=False)
    if count == 0:
        raise InputError(f"{reader.path}: holds no frame; check the file")
    states = state_count(scene)
    if scene.frames.sliding_speed_mm_per_s is None and states not in (1, count):
        raise InputError(
            f"{reader.path}: {count} frames, and the scene has {states} states; give one frame a "
            "state, correct wear.distances_m, or set frames.sliding_speed_mm_per_s for a video"
        )
    return count
