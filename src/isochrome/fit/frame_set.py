"""The frames of a fit, prepared one after the other, as often as the fit goes through them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from isochrome.errors import InputError
from isochrome.fit.frame_data import FrameData, prepare_frame
from isochrome.frames import load_no_load, open_scene_frames, with_file_scale
from isochrome.scene import Scene
from isochrome.simulate import state_count

_KEPT = 8
"""Frames that are kept in memory once prepared; of longer sets each pass reads them again."""


class FrameSet:
    """Prepared frames of a path, in order; every iteration starts at the first.

    Attributes: `scene`, with the frames' own distances where their times tell them; `shape` (rows,
    cols); `plain`, indices of frames that get one amplitude for all their light.
    """

    def __init__(self, path: str | Path, scene: Scene) -> None:
        """Raises InputError where the frames cannot be this scene's states."""
        self._reader = open_scene_frames(path, scene)
        self._no_load = load_no_load(scene, full_shape=self._reader.full_shape)
        self._kept: list[FrameData] = []
        self._count = self._reader.count()
        self.plain: set[int] = set()
        self.shape = self._reader.shape
        if self._count == 0:
            raise InputError(f"{path}: holds no frame; check the file")
        self.scene = self._with_distances(with_file_scale(scene, self._reader))
        self._check(path)

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[FrameData]:
        for i, data in enumerate(self._kept if self._kept else self._read()):
            yield data.plain() if i in self.plain else data

    def _read(self) -> Iterator[FrameData]:
        kept = []
        for frame in self._reader:
            data = prepare_frame(
                frame,
                self.scene,
                bit_depth=self._reader.bit_depth,
                no_load=self._no_load,
                gamma_found=True,
            )
            if self._count <= _KEPT:
                kept.append(data)
            yield data
        self._kept = kept

    def _with_distances(self, scene: Scene) -> Scene:
        """The scene with a distance a frame, from the frames' times where a speed is given."""
        speed = scene.frames.sliding_speed_mm_per_s
        if speed is None or scene.wear is None:
            return scene
        distances = []
        for frame in self._reader:
            if frame.time_s is None:
                raise InputError(
                    f"frame {frame.index} ({frame.name}) has no time, which "
                    "frames.sliding_speed_mm_per_s needs; remove that key, or give a video"
                )
            distances.append(1e-3 * speed * frame.time_s)
        moving = scene.with_values({"wear.distances_m": distances})
        if moving.friction is None:
            return moving
        return moving.with_values({"friction.static_state_first": False})

    def _check(self, path: str | Path) -> None:
        states = state_count(self.scene)
        if self._count > 1 and self.scene.model == "contact" and states not in (1, self._count):
            raise InputError(
                f"{path}: {self._count} frames, and the scene has {states} states; give one frame "
                "a state, correct wear.distances_m, or set frames.sliding_speed_mm_per_s for a "
                "video"
            )
