"""A film that begins without load: its orders are counted from zero, without a known point."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.fringes import (
    BrightestLight,
    FilmLight,
    FilmPath,
    joined_pixels,
    smooth_zero,
    unloaded_state,
)
from isochrome.messages import message
from isochrome.processing.kinds.followed_film import (
    NOT_KNOWN,
    Array,
    Film,
    FilmData,
    Frames,
    film_time,
    not_followed,
)
from isochrome.processing.kinds.image_only import LEAST_ORDER
from isochrome.processing.kinds.kind import FrameKind
from isochrome.processing.result import Capture
from isochrome.scene import Scene

NOT_UNLOADED = "frames_starts_unloaded_set_first"
OWN_CRESTS = "illumination_found_from_crests"
OTHER_LIGHT = "crests_times_bright_no"
FEW_ORDERS = "film_orders_reach_alone"
_NOISE_FRAMES = 8
_DARKER, _DARKER_SHARE = 0.05, 0.01
"""By how much of the contrast, and in which share of the specimen, light falls below the first
frame's before that was not unloaded: fringes of order 0.07 are as bright."""
_SAME_LIGHT = 0.02
"""Of the illumination: by so much lamps and exposures differ from day to day."""


@dataclass(frozen=True, kw_only=True)
class UnloadedFilm(Film):
    """A film that begins without load, from whose zero orders it is followed."""

    def check(self, scene: Scene) -> None:
        """Refuse a film that cannot begin without load. Raises InputError."""
        name, light = f"{scene.name}: frames.starts_unloaded", scene.polariscope
        if scene.has_model:
            raise InputError("films_without_model_scene", name=name)
        if light.tells_orders:
            raise InputError("phase_steps_colours_tell", name=name)
        if scene.frames.known_order or scene.frames.known_line or scene.frames.free_boundary:
            raise InputError("orders_counted_from_zero", name=name)
        if scene.frames.gamma == "unknown":
            raise InputError("frames_gamma_unknown_single", name=name)
        super().check(scene)

    def followed(
        self, captured: Callable[[], Frames], scene: Scene, capture: Capture, chunk: int, count: int
    ) -> FrameKind:
        """Followed from its first frame."""
        first = next(iter(captured()))[1][0]
        data = FilmData(first, scene, capture)
        field_zero, other = (capture.dark, capture.bright)[:: int(data.sign)]
        zero, rough = (
            (field_zero.image, False) if field_zero else smooth_zero(data.light(first), data.valid)
        )
        top, below = BrightestLight(), joined_pixels(zero, data.by)
        for index, (frame, *_) in captured():
            top.add(np.float32(data.sign) * (joined_pixels(data.light(frame), data.by) - below))
            if index % max(1, count // _NOISE_FRAMES) == 0:
                data.take_noise(frame)
        least = -_DARKER * top.contrast(data.material)
        share = float(np.mean((top.lowest < least)[data.material]))
        if share > _DARKER_SHARE:  # later ones fall below its light
            than = "brighter than later ones" if data.sign > 0 else "darker than later ones"
            raise PhysicsError(NOT_UNLOADED, name=scene.name, than=than, share=100.0 * share)
        given = None if other is None else np.maximum(data.sign * (other.image - zero), 1e-3)
        try:
            on_blocks = None if given is None else joined_pixels(given, data.by)
            surface = top.surface(data.material) if on_blocks is None else on_blocks
        except InputError as error:
            raise PhysicsError(f"{scene.name}: " + error.message) from error
        none = np.zeros_like(surface)
        guide = FilmLight(
            zero=joined_pixels(zero, data.by), illumination=surface, error=none, zero_error=none,
            sign=data.sign,
        )  # fmt: skip
        if rough:  # the first frame's own noise is in all differences from it
            data.between *= float(np.sqrt(2.0))
        level = float(np.median(surface[data.material]))
        start = unloaded_state(data.material, film_time(first, 0))
        path = FilmPath(start, guide, noise=data.wave_noise(level), chunk=chunk)
        path.follow((*data.joined(frames[0]), film_time(frames[0], k)) for k, frames in captured())
        light, notes = _final_light(path, data, zero, given, scene)
        return replace(self, film=data.film(path, light, count, notes))


def _final_light(
    path: FilmPath, data: FilmData, zero: Array, given: Array | None, scene: Scene
) -> tuple[FilmLight, tuple[str, ...]]:
    """The light of the frames' size by the crests that were followed, and what to say of it."""
    shape = (zero.shape[0], zero.shape[1])
    crests_tell = path.crests.told and path.highest > LEAST_ORDER
    if not crests_tell and given is None:
        if path.lost:
            lost = not_followed(path.lost[0][0]) + "; " + message(NOT_KNOWN)
            raise PhysicsError(f"{scene.name}: " + lost)
        raise PhysicsError(
            FEW_ORDERS, name=scene.name, highest=path.highest, least_order=LEAST_ORDER
        )
    none = np.zeros(shape, dtype=np.float32)
    level, error, notes = given, none, tuple[str, ...]()
    if crests_tell:
        result, spread = path.crests.illumination(shape)
        scale = 1.0 if given is None else float(np.median((result / given)[data.valid]))
        if given is None or abs(scale - 1.0) > _SAME_LIGHT:
            level, error = result, spread
            notes = (message(OWN_CRESTS) if given is None else message(OTHER_LIGHT, scale=scale),)
    assert level is not None
    light = FilmLight(zero=zero, illumination=level, error=error, zero_error=none, sign=data.sign)
    return light, notes
