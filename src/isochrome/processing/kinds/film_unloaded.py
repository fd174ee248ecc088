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
from isochrome.processing.kinds.followed_film import (
    NOT_FOLLOWED,
    NOT_KNOWN,
    Array,
    Film,
    FilmData,
    Frames,
    film_time,
)
from isochrome.processing.kinds.image_only import LEAST_ORDER
from isochrome.processing.kinds.kind import FrameKind
from isochrome.processing.result import Capture
from isochrome.scene import Scene

NOT_UNLOADED = (
    "{}: frames.starts_unloaded is set, and the first frame is not the unloaded specimen: it is {} "
    "in {:.0f} % of the specimen; such frames cannot be followed in time: begin the film before "
    "the load, or leave the key out"
)
OWN_CRESTS = "illumination found from the crests that pass, without frames.no_load_bright"
OTHER_LIGHT = (
    "its crests are {:.3g} times as bright as the no-load frames say: the illumination that they "
    "tell is used"
)
FEW_ORDERS = (
    "{}: the film's orders reach {:.2f} alone, and its crests tell its light from {:g} on: give "
    "frames.no_load_bright, or load further"
)
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
            raise InputError(
                f"{name} is for films without a model, and the scene has one, which names the "
                "orders; leave the key out"
            )
        if light.tells_orders:
            raise InputError(
                f"{name}: phase steps and colours tell the order of each state; leave the key out"
            )
        if scene.frames.known_order or scene.frames.known_line or scene.frames.free_boundary:
            raise InputError(
                f"{name}: the orders are counted from zero, and known orders are for single "
                "frames; leave one of them out"
            )
        if scene.frames.gamma == "unknown":
            raise InputError(
                f"{name}: frames.gamma = 'unknown' is for single frames; give a number"
            )
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
            raise PhysicsError(NOT_UNLOADED.format(scene.name, than, 100.0 * share))
        given = None if other is None else np.maximum(data.sign * (other.image - zero), 1e-3)
        try:
            on_blocks = None if given is None else joined_pixels(given, data.by)
            surface = top.surface(data.material) if on_blocks is None else on_blocks
        except InputError as error:
            raise PhysicsError(f"{scene.name}: {error}") from error
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
            where = path.lost[0][0]
            text = f"{NOT_FOLLOWED.format(where - 1, where)}; {NOT_KNOWN}"
            raise PhysicsError(f"{scene.name}: {text}")
        raise PhysicsError(FEW_ORDERS.format(scene.name, path.highest, LEAST_ORDER))
    none = np.zeros(shape, dtype=np.float32)
    level, error, notes = given, none, tuple[str, ...]()
    if crests_tell:
        result, spread = path.crests.illumination(shape)
        scale = 1.0 if given is None else float(np.median((result / given)[data.valid]))
        if given is None or abs(scale - 1.0) > _SAME_LIGHT:
            level, error = result, spread
            notes = (OWN_CRESTS if given is None else OTHER_LIGHT.format(scale),)
    assert level is not None
    light = FilmLight(zero=zero, illumination=level, error=error, zero_error=none, sign=data.sign)
    return light, notes
