"""What is done to a set: its frames, state after state, each on its own."""

import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from isochrome.errors import InputError, IsochromeError
from isochrome.estimation import light_basis
from isochrome.fitting import frame_distance, frame_scene, scene_at, timed_distance
from isochrome.frames import Frame, FrameReader, misfits, open_scene_frames
from isochrome.processing.kinds.kind import FrameKind
from isochrome.processing.result import ProcessedFrame, failed_frame
from isochrome.runs import run_identity, trim_heap
from isochrome.scene import ArrayFrames, FramesLike, Scene, dump_scene
from isochrome.specimens import surface_field_grid


@dataclass(frozen=True, kw_only=True)
class FrameTask:
    """A set, its kind, and what is wanted of it, for any process.

    `reader` has counted the frames and so knows their places; `rois`, whether fringe lines are
    wanted of frames with a fit too; `preview`, the picture that is written now and then of the last
    frame.
    """

    frames: FramesLike
    scene: Scene
    reader: FrameReader
    kind: FrameKind
    rois: bool = False
    keep_going: bool = False
    preview: Path | None = None

    @property
    def steps(self) -> int:
        """Frames that make one state."""
        return self.scene.polariscope.frames_a_state


class FrameSource:
    """An opened set: its `reader`, and what all frames share."""

    def __init__(self, task: FrameTask) -> None:
        """Open the files besides the frames. Raises InputError."""
        self.task, self.reader = task, task.reader
        self.capture = task.kind.prepare(task.scene, task.reader)
        channels = task.kind.channels
        scenes = [task.scene.with_values({"frames.channel": name}) for name in channels]
        self._readers = [open_scene_frames(task.frames, scene) for scene in scenes] or [self.reader]

    def captured(self, start: int, stop: int) -> Iterator[tuple[int, list[Frame]]]:
        """The frames of the states [start, stop), with the number of the state."""
        steps = self.task.steps
        for index in range(start, stop):
            numbers = range(index * steps, (index + 1) * steps)
            yield index, [reader.frame(k) for k in numbers for reader in self._readers]

    def processed(self, index: int, frames: list[Frame]) -> ProcessedFrame:
        """What is found in one state's frames. Raises InputError, PhysicsError."""
        first = replace(frames[0], index=index)
        kind = self.task.kind
        try:
            state = scene = kind.held(self.task.scene)
            label, distance = first.name, float("nan")
            if scene.has_model:
                label, distance = place_of(scene, first)
                state = own_scene(scene, first)
            every = [first, *frames[1:]]
            result = kind.read(every, state, self.capture)
            if label == first.name:
                label = result.label  # of several frames, from where to where
            notes = (kind.note,) if index == 0 and kind.note else ()
            warnings = (*notes, *result.warnings)
            return replace(result, label=label, distance_m=distance, warnings=warnings)
        except IsochromeError as error:
            if not self.task.keep_going:
                raise
            return failed_frame(first, str(error))

    def close(self) -> None:
        """Close the files."""
        for reader in (*self._readers, self.reader):
            reader.close()


_KEPT = threading.local()
"""A process keeps the set that it read last, so that chunk after chunk goes on in its files."""


def open_set(task: FrameTask) -> FrameSource:
    """The opened set of a task, the same as long as it is asked for. Raises InputError."""
    selected: FrameSource | None = getattr(_KEPT, "set", None)
    if selected is None or selected.task is not task:
        close_kept()
        selected = _KEPT.set = FrameSource(task)
    return selected


def close_kept() -> None:
    """Close what this process has open."""
    selected: FrameSource | None = getattr(_KEPT, "set", None)
    if selected is not None:
        selected.close()
        _KEPT.set = None


def release_caches() -> None:
    """Close what this process has open, and free what its frames shared: all of them are done."""
    close_kept()
    light_basis.cache_clear()
    surface_field_grid.cache_clear()
    trim_heap()


def count_of(task: FrameTask) -> int:
    """The number of a set's frames. InputError where they cannot be its scene's."""
    scene, reader = task.scene, task.reader
    count = reader.count(decode=task.kind.key_step is None)
    if count == 0:
        raise InputError("holds_no_frame_check", path=reader.path)
    by_model = scene.has_model and not scene.polariscope.tells_orders
    fitted = by_model and scene.rim_diameter_mm is None
    if fitted and (scene.camera is None or scene.camera.pixel_mm is None):
        raise InputError("camera_pixel_mm_missing_fit", name=scene.name)
    for name, text in misfits(reader, scene, count):
        raise InputError(f"{name}: " + text)
    return count


def own_scene(scene: Scene, frame: Frame) -> Scene:
    """The scene of a frame alone, by its time or its number. Raises InputError."""
    if (speed := scene.frames.sliding_speed_mm_per_s) is not None:
        return scene_at(scene, timed_distance(frame, speed))
    return frame_scene(scene, frame.index)


def place_of(scene: Scene, frame: Frame) -> tuple[str, float]:
    """A frame's label and its distance (m). Raises InputError."""
    if (speed := scene.frames.sliding_speed_mm_per_s) is not None:
        distance = timed_distance(frame, speed)
        return f"{distance:.4g} m", distance
    if not scene.is_contact:
        return frame.name, 0.0
    slid = frame_distance(scene, frame.index)
    if slid and scene.wear is not None:
        return f"{slid:g} m", slid
    held = scene.load is not None and scene.load.tangential_n is not None
    slides = scene.friction is not None and (slid is not None or held)
    return "initial sliding" if slides else "static", 0.0


def identity_of(task: FrameTask, files: Sequence[Path | ArrayFrames]) -> Mapping[str, Any]:
    """What a run on a set is a result of, as provenance.json keeps it. Raises InputError."""
    scene = task.scene
    seed = scene.camera.seed if scene.camera else None
    stated = {"as_stated": True} if task.kind.as_stated else {}
    options = {"rois": task.rois} | task.kind.identity | stated
    return run_identity(dump_scene(scene), files, options, seed)
