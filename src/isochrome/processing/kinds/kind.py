"""What a kind of processing is: a class in a module of its own, imported when a set is of it, with
what it needs to read frames, such as a follower or a table of colours."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from isochrome.errors import InputError, IsochromeError
from isochrome.fitting import frame_distance, frame_scene, scene_at, timed_distance
from isochrome.frames import Frame, FrameReader, load_no_load, misfits, open_scene_frames
from isochrome.processing.result import Capture, ProcessedFrame, frame_fields, row_of_set
from isochrome.progress import RunProgress
from isochrome.runs import Layer, run_identity
from isochrome.scene import ArrayFrames, FramesLike, Scene, dump_scene

NORMALISED = Layer("normalised", "1", "signal, 0 in darkness and 1 in the brightest field")
ORDER = Layer("fringe_order", "1", "fringe order N")
CONFIDENCE = Layer("confidence", "1", "probability that the order is right to 1/20 fringe")
ISOCLINIC = Layer("isoclinic", "degree", "direction of sigma_1, counter-clockwise from x")

ACCEPTS: Mapping[str, Callable[[Scene], bool]] = {
    "followed_film.UnloadedFilm": lambda scene: scene.frames.starts_unloaded,
    "colour_light.ColourLight": lambda scene: scene.polariscope.several_wavelengths,
    "phase_stepped.PhaseStepped": lambda scene: bool(scene.polariscope.step),
    "image_only.ImageOnly": lambda scene: not scene.has_model,
    "known_loads.KnownLoads": lambda scene: bool(scene.frames.known_loads_n),
    "with_model.WithModel": lambda scene: scene.has_model,
}
"""The kinds, as module and class: a scene is of the first that accepts it."""

KEY_EVERY = 200
"""Frames from one key frame to the next where none is named. One costs as much as some 200 that a
contact's model is followed through, or some fifty without a model; and what is done between two is
lost when a run is killed."""

MOST_IN_MEMORY = 8_000_000_000
"""Bytes of maps beyond which a result belongs on the disk."""


def kind_of(scene: Scene) -> FrameKind:
    """The kind of a scene's frames, each state read by itself."""
    module, name = next(k for k, accepts in ACCEPTS.items() if accepts(scene)).split(".")
    kind: FrameKind = getattr(import_module(f"{__package__}.{module}"), name)()
    return kind


def accepts_keys(scene: Scene) -> bool:
    """Whether a scene's film can be followed from key frames that are read without a model."""
    frames = scene.frames
    return (
        not scene.has_model
        and not frames.starts_unloaded
        and frames.orders_known
        and frames.gamma != "unknown"
        and not scene.polariscope.tells_orders
    )


@dataclass(frozen=True, kw_only=True)
class FrameKind:
    """How the frames of a set are read; `note`, what the first frame says of that. `as_stated`,
    whether all that a scene states is held. `read` and `values` are of each kind."""

    note: str = ""
    as_stated: bool = False

    channels: ClassVar[tuple[str, ...]] = ()
    """Those that are read of each frame, where there are several."""

    draws_lines: ClassVar[bool] = True
    """Whether fringe lines are kept of frames without a fit, though nobody asks for them."""

    @property
    def key_step(self) -> int | None:
        """Frames from one key frame to the next, where a model is followed through others."""
        return None

    def check(self, scene: Scene) -> None:
        """Refuse a scene whose frames cannot be read, before they are opened. Raises InputError."""
        frames, light = scene.frames, scene.polariscope
        if frames.colour_table is not None and not light.several_wavelengths:
            raise InputError("frames_colour_table_light_several", name=scene.name)
        if not scene.has_model and not light.step and light.field == "plane":
            raise InputError("polariscope_field_plane_without", name=scene.name)
        if frames.no_load_steps is not None and not light.step:
            raise InputError("frames_no_load_steps_needs_polariscope", name=scene.name)

    def prepare(self, scene: Scene, reader: FrameReader) -> Capture:
        """What all frames share: the files besides them. Raises InputError."""
        return Capture(reader.bit_depth, *load_no_load(scene, full_shape=reader.full_shape))

    def shared(
        self, source: FrameSource, count: int, progress: RunProgress | None, *, on_disk: bool
    ) -> FrameKind:
        """The kind with what the `count` frames of an opened set have in common."""
        return self

    def held(self, scene: Scene) -> Scene:
        """The scene with what all frames have in common."""
        return scene

    def states(self, source: FrameSource, start: int, stop: int) -> Iterator[ProcessedFrame]:
        """What is read in the states [start, stop). Raises InputError, PhysicsError."""
        for index, frames in source.captured(start, stop):
            yield source.processed(index, frames)

    def read(self, frames: Sequence[Frame], scene: Scene, capture: Capture) -> ProcessedFrame:
        """One state: its `frames`, its own `scene`. Raises InputError, PhysicsError."""
        raise NotImplementedError

    def values(self, scene: Scene) -> tuple[str, ...]:
        """Columns of what is read in a frame, which depend on the scene alone."""
        raise NotImplementedError

    def columns(self, scene: Scene) -> tuple[str, ...]:
        """The columns of frames.csv, which depend on the scene alone and not on what is read."""
        place = ("distance_m", "chi", "noise", "pixel_mm")
        return ("frame", "name", "label", *place, *self.values(scene), "warnings")

    def row(self, item: ProcessedFrame, scene: Scene) -> dict[str, Any]:
        """A frame's row of frames.csv."""
        return row_of_set(item.row(), self.columns(scene), scene)

    def layers(self, scene: Scene) -> tuple[Layer, ...]:
        """The maps that a set's run leaves."""
        return (NORMALISED, ORDER, CONFIDENCE) if scene.orders_are_read else (NORMALISED,)

    @property
    def identity(self) -> dict[str, Any]:
        """What a result depends on besides the set, as provenance.json keeps it."""
        return {}


@dataclass(frozen=True, kw_only=True)
class FrameTask:
    """A set, its kind, and what is wanted of it, for any process. `reader` has counted the frames;
    `rois`: fringe lines are wanted of frames with a fit too."""

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
        scenes = [task.scene.with_values({"frames.channel": k}) for k in task.kind.channels]
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
            result = kind.read([first, *frames[1:]], state, self.capture)
            if label == first.name:
                label = result.label  # of several frames, from where to where
            notes = (kind.note,) if index == 0 and kind.note else ()
            warnings = (*notes, *result.warnings)
            return replace(result, label=label, distance_m=distance, warnings=warnings)
        except IsochromeError as error:
            if not self.task.keep_going:
                raise
            nothing = np.full(first.image.shape[:2], np.nan, dtype=np.float32)
            return ProcessedFrame(
                **frame_fields(first), normalised=nothing, warnings=(str(error),), failed=True
            )

    def close(self) -> None:
        """Close all files."""
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
