"""The frames of a fit, prepared one after the other, as often as the fit goes through them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from isochrome.errors import InputError
from isochrome.fit.frame_data import FrameData, prepare_frame
from isochrome.fit.one_state import timed_distance
from isochrome.frames import FramesPath, load_no_load, open_scene_frames, with_file_scale
from isochrome.frames.onward import Onward
from isochrome.scene import Scene, check_pixel
from isochrome.simulate import state_count

_KEPT = 8
"""Frames that are kept in memory once prepared; of longer sets each pass reads them again."""


class FrameSet:
    """Prepared frames of a path, in order; every iteration starts at the first.

    It may be handed to other processes. Attributes: `reader`; `given`, the scene, with the frames'
    scale; `scene`, with the frames' own distances too where their times tell them; `shape` (rows,
    cols); `plain`, indices of frames that get one amplitude for all their light.
    """

    def __init__(self, path: FramesPath, scene: Scene) -> None:
        """Raises InputError where the frames cannot be this scene's states."""
        self.reader = open_scene_frames(path, scene)
        self.given = with_file_scale(scene, self.reader)
        check_pixel(self.given, self.reader.shape)
        self._no_load = load_no_load(scene, full_shape=self.reader.full_shape)
        self._kept: dict[int, FrameData] = {}
        self._frames = Onward(self.reader)
        self._count = self.reader.count()
        self.plain: set[int] = set()
        self.shape = self.reader.shape
        if self._count == 0:
            raise InputError(f"{path}: holds no frame; check the file")
        self.scene = self._with_distances(self.given)
        self._check(path)

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[FrameData]:
        return self.some(0, self._count)

    def __getitem__(self, index: int) -> FrameData:
        (found,) = self.some(index, index + 1)
        return found

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k != "_kept"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _kept={})

    def some(self, start: int, stop: int) -> Iterator[FrameData]:
        """Prepared frames [start, stop). Raises InputError on a bad one."""
        there = all(i in self._kept for i in range(start, stop))
        kept = (self._kept[i] for i in range(start, stop))
        for i, data in enumerate(kept if there else self._read(start, stop), start):
            yield data.plain() if i in self.plain else data

    def close(self) -> None:
        """Close the file."""
        self._frames.close()

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
        moving = scene.with_values({"wear.distances_m": distances})
        if moving.friction is None:
            return moving
        return moving.with_values({"friction.static_state_first": False})

    def _check(self, path: FramesPath) -> None:
        states = state_count(self.scene)
        if self._count > 1 and self.scene.model == "contact" and states not in (1, self._count):
            raise InputError(
                f"{path}: {self._count} frames, and the scene has {states} states; give one frame "
                "a state, correct wear.distances_m, or set frames.sliding_speed_mm_per_s for a "
                "video"
            )
