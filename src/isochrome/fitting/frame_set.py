"""The frames of a fit, prepared one after the other, as often as the fit goes through them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from typing import Any, Self

from isochrome.errors import InputError
from isochrome.estimation import FrameData, Terms, prepare_frame
from isochrome.fitting.arrays import Mask
from isochrome.fitting.frame.single_state import sliding_scene, timed_distance
from isochrome.fitting.refusals import refuse_states
from isochrome.frames import (
    SequentialFrames,
    load_no_load,
    open_scene_frames,
    with_file_scale,
)
from isochrome.scene import FramesLike, Scene, check_pixel

Lights = dict[int, tuple[Terms, Terms]]
"""Polynomial products of illumination and background, by the number of their frame."""

_KEPT = 8
"""Frames that are kept in memory once prepared; of longer sets each pass reads them again."""


def light_terms(stored: list[list[list[int]]]) -> tuple[Terms, Terms]:
    """The products of illumination and background, from a row of a run."""
    light, dark = (tuple((i, j) for i, j in part) for part in stored)
    return light, dark


class FrameSet:
    """Prepared frames in memory, in order; every iteration starts at the first.

    Attributes: `shape` (rows, cols); `plain`, indices of frames that get one amplitude for all
    their light, and `lights` of those that get a richer one; `noises`, by how much more noise some
    have than their finest part shows; `outside` (rows, cols), pixels that are left out.
    """

    def __init__(self, shape: tuple[int, int], frames: Sequence[FrameData] = ()) -> None:
        """`shape` (rows, cols) of a frame; `frames`, those that are there already."""
        self.shape = shape
        self._count = len(frames)
        self._kept = dict(enumerate(frames))
        self.plain: set[int] = set()
        self.lights: Lights = {}
        self.noises: dict[int, float] = {}
        self.outside: Mask | None = None

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[FrameData]:
        return self.some(0, self._count)

    def __getitem__(self, index: int) -> FrameData:
        (found,) = self.some(index, index + 1)
        return found

    def some(self, start: int, stop: int) -> Iterator[FrameData]:
        """Prepared frames [start, stop). Raises InputError on a bad one."""
        for i, data in enumerate(self._as_read(start, stop), start):
            if i in self.lights:
                data = replace(data, lamp=data.lamp.of(self.lights[i]))
            if i in self.noises:
                data = data.with_noise(self.noises[i])
            if self.outside is not None:
                data = replace(data, valid=data.valid & ~self.outside)
            yield data.plain() if i in self.plain else data

    def seen(self, terms: tuple[Terms, Terms] | None, outside: Mask | None) -> Self:
        """The same frames with some light in all of them, and without some pixels.

        Parameters: `terms` of the light, None for that of today; `outside` (rows, cols) or None.
        """
        view = copy(self)
        if terms is not None:
            view.lights = dict.fromkeys(range(self._count), terms)
        if outside is not None:
            view.outside = outside if self.outside is None else outside | self.outside
        return view

    def _as_read(self, start: int, stop: int) -> Iterator[FrameData]:
        """The frames [start, stop) with their own light and all their pixels."""
        return (self._kept[i] for i in range(start, stop))


class PreparedFrames(FrameSet):
    """Prepared frames of a path.

    It may be handed to other processes. Attributes: `path`; `reader`; `given`, the scene, with the
    frames' scale; `scene`, with the frames' own distances too where their times tell them.
    """

    def __init__(self, path: FramesLike, scene: Scene) -> None:
        """Raises InputError where the frames cannot be this scene's states."""
        self.path, self.reader = path, open_scene_frames(path, scene)
        super().__init__(self.reader.shape)
        self.given = with_file_scale(scene, self.reader)
        check_pixel(self.given, self.reader.shape)
        self._no_load = load_no_load(scene, full_shape=self.reader.full_shape)
        self._frames = SequentialFrames(self.reader)
        self._count = self.reader.count()
        if self._count == 0:
            raise InputError(f"{path}: holds no frame; check the file")
        self.scene = self._with_distances(self.given)
        if self._count > 1 and self.scene.indenter is not None:
            refuse_states(path, self._count, self.scene)

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k != "_kept"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _kept={})

    def close(self) -> None:
        """Close the file."""
        self._frames.close()

    def _as_read(self, start: int, stop: int) -> Iterator[FrameData]:
        there = all(i in self._kept for i in range(start, stop))
        return super()._as_read(start, stop) if there else self._read(start, stop)

    def _read(self, start: int, stop: int) -> Iterator[FrameData]:
        for i in range(start, stop):
            data = prepare_frame(
                self._frames.frame(i),
                self.scene,
                bit_depth=self.reader.bit_depth,
                no_load=self._no_load,
                gamma_found=True,
            )
            if self._count <= _KEPT:
                self._kept[i] = data
            yield data

    def _with_distances(self, scene: Scene) -> Scene:
        """The scene with a distance a frame, from the frames' times where a speed is given."""
        speed = scene.frames.sliding_speed_mm_per_s
        if speed is None or scene.wear is None:
            return scene
        distances = [timed_distance(frame, speed) for frame in self.reader]
        return sliding_scene(scene.with_values({"wear.distances_m": distances}))
