"""What is done to a set: its frames, state after state, each on its own."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice

from isochrome.errors import InputError, IsochromeError
from isochrome.fit.frame_data import light_basis
from isochrome.fit.one_state import frame_distance, frame_scene, scene_at, timed_distance
from isochrome.frames import Frame, FrameReader, FramesPath, load_no_load
from isochrome.fringes.residual import Residual
from isochrome.process.colour import ColourCapture, colour_capture, colour_frames, process_colour
from isochrome.process.image_only import process_image_only
from isochrome.process.result import Capture, ProcessedFrame, failed_frame
from isochrome.process.source import Cursor
from isochrome.process.stepped import load_residual, process_stepped
from isochrome.process.with_model import process_with_model
from isochrome.runs.memory import give_back
from isochrome.scene import Scene
from isochrome.simulate.model import surface_field_grid


@dataclass(frozen=True)
class Recipe:
    """A set and what is to be done to it, for any process: `frames`, the files; `scene`.

    `reader` of the frames, which has counted them and so knows their places; `key`, the same for
    the same recipe on the same content; `rois`, whether fringe lines are wanted of frames with a
    fit too; `keep_going`, whether a frame that fails is left out; `every`, from one key frame of a
    tracked video to the next, None where every frame is processed wholly.
    """

    frames: FramesPath
    scene: Scene
    reader: FrameReader
    key: str
    rois: bool = False
    keep_going: bool = False
    every: int | None = None

    @property
    def coloured(self) -> bool:
        """Whether the orders are read from colours."""
        return self.scene.polariscope.several_wavelengths

    @property
    def steps(self) -> int:
        """Frames that make one state."""
        return max(1, len(self.scene.polariscope.step))


_OPENING = 20
"""Frames that a video is decoded for in the time that it takes to open it and find a place."""


class OpenSet:
    """An opened set: its `reader`, what all frames share, and where its reading stands."""

    def __init__(self, recipe: Recipe) -> None:
        """Open the files besides the frames. Raises InputError."""
        scene = recipe.scene
        self.recipe = recipe
        self.reader = recipe.reader
        self.capture: Capture | ColourCapture = Capture(self.reader.bit_depth)
        self.residual: Residual | None = None
        if recipe.coloured:
            self.capture = colour_capture(scene, self.reader)
        elif scene.polariscope.step:
            self.residual = load_residual(scene, self.reader)
        else:
            dark, bright = load_no_load(scene, full_shape=self.reader.full_shape)
            self.capture = Capture(self.reader.bit_depth, dark, bright)
        self._cursor = Cursor[list[Frame]](self._begin, self._anew)

    def _anew(self, start: int) -> int:
        """As how many states it takes to open the set at a state."""
        if self.reader.kind != "video":
            return 0
        frame = start * self.recipe.steps
        return (frame - self.reader.first_decoded(frame) + _OPENING) // self.recipe.steps

    def _begin(self, start: int) -> Iterator[list[Frame]]:
        """The frames of one state after another, from state `start` on."""
        if self.recipe.coloured:
            yield from islice(colour_frames(self.recipe.frames, self.recipe.scene), start, None)
            return
        steps = self.recipe.steps
        frames = self.reader.iterate(start * steps)
        while len(together := list(islice(frames, steps))) == steps:
            yield together

    def states(self, start: int, stop: int) -> Iterator[ProcessedFrame]:
        """What is found in the states [start, stop). Raises InputError, PhysicsError."""
        for index, frames in self.captured(start, stop):
            yield self.processed(index, frames)

    def captured(self, start: int, stop: int) -> Iterator[tuple[int, list[Frame]]]:
        """The frames of the states [start, stop), with the number of the state."""
        index = start
        for frames in self._cursor.take(start, stop):
            yield index, frames
            index += 1
        if index < stop:
            raise InputError(
                f"{self.reader.path}: breaks off after {index * self.recipe.steps} frames, and had "
                "more when it was counted; is it still being written?"
            )

    def processed(self, index: int, frames: list[Frame]) -> ProcessedFrame:
        """What is found in one state's frames. Raises InputError, PhysicsError."""
        first = replace(frames[0], index=index)
        try:
            found = self._read(first, frames)
        except IsochromeError as error:
            if not self.recipe.keep_going:
                raise
            found = failed_frame(first, str(error))
        return replace(found, time_s=first.time_s)

    def _read(self, first: Frame, frames: list[Frame]) -> ProcessedFrame:
        """One state, with its label and distance."""
        scene, capture, index = self.recipe.scene, self.capture, first.index
        own, label, distance = scene, None, float("nan")
        if scene.model is not None:
            own, label, distance = state_of(scene, first)
        if isinstance(capture, ColourCapture):
            found = process_colour(frames, own, capture)
        elif scene.polariscope.step:
            found = process_stepped(frames, own, capture, index=index, residual=self.residual)
            label = None if label == first.name else label  # its own name says from where to where
        elif scene.model is None:
            found = process_image_only(first, own, capture)
        else:
            found = process_with_model(first, own, capture)
        return replace(found, label=label or found.label, distance_m=distance)

    def close(self) -> None:
        """Close the files."""
        self._cursor.close()
        self.reader.close()


_KEPT = threading.local()
"""A process keeps the set that it read last, so that chunk after chunk goes on in its files."""


def opened(recipe: Recipe) -> OpenSet:
    """The opened set of a recipe, the same as long as it is asked for. Raises InputError."""
    kept: OpenSet | None = getattr(_KEPT, "set", None)
    if kept is None or kept.recipe.key != recipe.key:
        close_kept()
        kept = OpenSet(recipe)
        _KEPT.set = kept
    kept.recipe = recipe
    return kept


def close_kept() -> None:
    """Close what this process has open."""
    kept: OpenSet | None = getattr(_KEPT, "set", None)
    if kept is not None:
        kept.close()
        _KEPT.set = None


def let_go() -> None:
    """Close what this process has open, and free what its frames shared: all of them are done."""
    close_kept()
    light_basis.cache_clear()
    surface_field_grid.cache_clear()
    give_back()


@contextmanager
def keeping_none() -> Iterator[None]:
    """Close what was opened in the block, before the reader that it reads from is closed."""
    try:
        yield
    finally:
        close_kept()


def state_of(scene: Scene, frame: Frame) -> tuple[Scene, str, float]:
    """The one-state scene of a frame, its label and its distance (m). Raises InputError."""
    label, distance = place_of(scene, frame)
    if scene.frames.sliding_speed_mm_per_s is not None:
        return scene_at(scene, distance), label, distance
    return frame_scene(scene, frame.index), label, distance


def place_of(scene: Scene, frame: Frame) -> tuple[str, float]:
    """A frame's label and its distance (m). Raises InputError."""
    speed = scene.frames.sliding_speed_mm_per_s
    if speed is not None:
        distance = timed_distance(frame, speed)
        return f"{distance:.4g} m", distance
    if scene.model != "contact":
        return frame.name, 0.0
    slid = frame_distance(scene, frame.index)
    if slid and scene.wear is not None:
        return f"{slid:g} m", slid
    held = scene.load is not None and scene.load.tangential_n is not None
    slides = scene.friction is not None and (slid is not None or held)
    return "initial sliding" if slides else "static", 0.0
