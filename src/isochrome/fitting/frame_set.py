"""The frames of a fit, prepared as often as it goes through them, and what it refuses."""

from collections.abc import Iterator
from copy import copy
from dataclasses import replace
from typing import Any, Self

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import FrameData, Unevenness, prepare_frame, scaled_inverse
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.frame.single_state import sliding_scene, timed_distance
from isochrome.frames import load_no_load, open_scene_frames, with_file_scale
from isochrome.output import counted
from isochrome.scene import DistanceTable, FramesLike, Scene, check_pixel
from isochrome.simulation import required_model, state_count

Lights = dict[int, Unevenness]
"""How uneven a frame's light is, by its number."""

_KEPT = 8
"""Frames that are kept in memory once prepared; of longer sets each pass reads them again."""


class PreparedFrames:
    """Prepared frames (rows, cols) of a path, which other processes may take. `given`, the scene
    with their scale; `scene`, with their own distances too; `plain`, numbers of those with one
    amplitude for all their light, `lights` of those with an uneven one; `noises`, by how much more
    noise some have than they show; `outside` (rows, cols), pixels that are left out.
    """

    def __init__(self, path: FramesLike, scene: Scene) -> None:
        """Raises InputError where the frames cannot be this scene's states."""
        self.path, self.reader = path, open_scene_frames(path, scene)
        self.shape, self._kept = self.reader.shape, dict[int, FrameData]()
        self.plain: set[int] = set()
        self.lights: Lights = {}
        self.noises: dict[int, float] = {}
        self.outside: Mask | None = None
        self.given = with_file_scale(scene, self.reader)
        check_pixel(self.given, self.shape)
        self._no_load = load_no_load(scene, full_shape=self.reader.full_shape)
        self._count = self.reader.count()
        if self._count == 0:
            raise InputError("holds_no_frame_check", path=path)
        self.scene, speed = self.given, self.given.frames.sliding_speed_mm_per_s
        if speed is not None and self.given.wear is not None:
            distances = [timed_distance(frame, speed) for frame in self.reader]
            self.scene = sliding_scene(self.given.with_values({"wear.distances_m": distances}))
        if self._count > 1 and self.scene.is_contact:
            refuse_states(path, self._count, self.scene)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_kept": {}}

    def close(self) -> None:
        """Close the file."""
        self.reader.close()

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[FrameData]:
        return self.some(0, self._count)

    def __getitem__(self, index: int) -> FrameData:
        (data,) = self.some(index, index + 1)
        return data

    def some(self, start: int, stop: int) -> Iterator[FrameData]:
        """Prepared frames [start, stop). Raises InputError on a bad one."""
        for i in range(start, stop):
            data = self._kept.get(i) or self._read(i)
            if i in self.lights:
                data = replace(data, lamp=data.lamp.of(self.lights[i]))
            if i in self.noises:
                data = data.with_noise(self.noises[i])
            if self.outside is not None:
                data = replace(data, valid=data.valid & ~self.outside)
            yield data.plain() if i in self.plain else data

    def seen(self, uneven: Unevenness | None, outside: Mask | None) -> Self:
        """The same frames with such light in all of them, and without the pixels `outside`."""
        view = copy(self)
        view._kept = self._kept
        view.lights = {} if uneven is None else dict.fromkeys(range(self._count), uneven)
        if outside is not None:
            view.outside = outside if self.outside is None else outside | self.outside
        return view

    def _read(self, i: int) -> FrameData:
        """A frame with its own light and all its pixels."""
        frame, depth = self.reader.frame(i), self.reader.bit_depth
        data = prepare_frame(
            frame, self.scene, bit_depth=depth, no_load=self._no_load, gamma_found=True
        )
        if self._count <= _KEPT:
            self._kept[i] = data
        return data


_SAME_EFFECT = {
    "specimen.fringe_value_n_per_mm": "only load over fringe value sets the fringe order",
    "specimen.thickness_mm": "only load and thickness together set the fringe order",
    "camera.pixel_mm": "a larger pixel and a larger load spread the fringes alike",
}
"""Keys that cannot be told from the load, and why."""

TOO_FAR = 0.12
"""Residual over contrast beyond which a model tells nothing: no value, and no pixel's branch.
A right model leaves the noise, about 0.02; one that is 3 % off in load 0.05; wrong ones 0.15 on."""

CORRECT = "correct_scene_what_stood"
"""What to do where nothing could be read."""

_ALIKE = 0.9995
_PLACE = ("camera.left_mm", "camera.top_mm")
_SENSOR = ("camera.pixel_mm", "camera.blur_px", "frames.gamma")


def refuse_keys(scene: Scene, shared: tuple[str, ...], per_frame: tuple[str, ...]) -> None:
    """InputError for keys that are unknown, doubled, or have the same effect as the load."""
    required_model(scene)
    keys = shared + per_frame
    if not keys:
        raise InputError("nothing_fit_name_key")
    for key in keys:
        _refuse_unfitted(scene, key, is_own=key in per_frame)
        if keys.count(key) > 1:
            raise InputError("named_twice_name_once", key=key)
        if scene.uncertainties.get(key) == 0.0:
            raise InputError("stated_exact_standard_uncertainty_cannot", key=key)
    for key, reason in _SAME_EFFECT.items():
        pair = {key, "load.normal_n"}
        if pair <= set(keys) and not pair & set(scene.uncertainties):
            raise InputError("load_normal_n_cannot_both", key=key, reason=reason)


def _refuse_unfitted(scene: Scene, key: str, *, is_own: bool) -> None:
    """Refuse a key that is no number, or that does not change the simulated fringes."""
    value = scene.get(key)
    if key in _PLACE:
        return
    if isinstance(value, DistanceTable) and key != "friction.coefficient" and not is_own:
        raise InputError("cannot_fitted_table_over", key=key)
    if key.split(".")[0] in ("camera", "frames", "numerics") and key not in _SENSOR:
        raise InputError("cannot_fitted_fringes_do", key=key, value=", ".join((*_PLACE, *_SENSOR)))
    if key == "frames.gamma" and value == "unknown":
        return
    if isinstance(value, bool) or not isinstance(value, int | float | DistanceTable):
        raise InputError("cannot_fitted_no_number_scene", key=key, value=value)


def refuse_states(path: FramesLike, count: int, scene: Scene) -> None:
    """InputError where a scene has other states than one, or one for each of `count` frames."""
    states = state_count(scene)
    if states not in (1, count):
        frames, has = counted(count, "frame"), counted(states, "state")
        raise InputError("scene_has_give_one", path=path, counted=frames, counted_2=has)


def refuse_alike(keys: tuple[str, ...], information: Array, known: tuple[str, ...] = ()) -> None:
    """PhysicsError for unknowns (p,) that the frames' information (p, p) cannot tell apart. `known`
    keys, whose uncertainty the scene states, are held: what it leaves uncertain in all others
    together makes no two of them alike.
    """
    unknown = [k for k, key in enumerate(keys) if key not in known]
    keys, information = tuple(keys[k] for k in unknown), information[np.ix_(unknown, unknown)]
    if not unknown or not np.all(np.diag(information) > 0.0):
        return
    covariance = scaled_inverse(information)
    spread = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(spread, spread)
    np.fill_diagonal(correlation, 0.0)
    i, j = np.unravel_index(int(np.abs(correlation).argmax()), correlation.shape)
    if abs(correlation[i, j]) > _ALIKE:
        raise PhysicsError(
            "cannot_told_apart_these", keys=keys[i], keys_2=keys[j], correlation=correlation[i, j]
        )
