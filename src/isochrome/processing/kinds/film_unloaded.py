"""A film that begins without load: its orders are followed in time, without a model or a point."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError, PhysicsError
from isochrome.frames import (
    Frame,
    NoiseModel,
    estimate_noise,
    full_scale,
    noise_between_pixels,
    saturation_level,
    to_linear,
)
from isochrome.fringes import (
    LARGEST_CHANGE,
    BrightestLight,
    FilmLight,
    FilmPath,
    FilmState,
    KeptState,
    follow_frame,
    fringe_response,
    joined_pixels,
    light_wave,
    pixels_together,
    read_followed,
    smooth_zero,
    unloaded_state,
)
from isochrome.processing.result import Capture, ProcessedFrame, frame_fields, order_columns
from isochrome.scene import Scene

Array = NDArray[Any]
Mask = NDArray[np.bool_]
Frames = Iterator[tuple[int, list[Frame]]]

NOT_FOLLOWED = (
    "the film cannot be followed from frame {} to {}: the orders change by more than "
    f"{LARGEST_CHANGE:g} fringe between them, or other things than the load do, and no order is "
    "known from there on; take more frames a second, load more slowly, or give frames one by one "
    "with an order that is known"
)
NOT_UNLOADED = (
    "{}: frames.starts_unloaded is set, and the first frame is not the unloaded specimen: it is {} "
    "in {:.0f} % of the specimen; begin the film before the load, or leave the key out"
)
BOTH_WAYS = (
    "followed forward and back, {:.1f} % of the specimen have two orders in these frames: they are "
    "left out from frame {} on"
)
OWN_CRESTS = "illumination found from the crests that pass, without frames.no_load_bright"
OTHER_LIGHT = (
    "its crests are {:.3g} times as bright as frames.no_load_bright says: the illumination that "
    "they tell is used"
)
LEAST_ORDER = 1.25
"""Highest order below which the crests of a film do not tell its light, as in a single frame."""
FEW_ORDERS = (
    "{}: the film's orders reach {:.2f}, and {:g} at least are needed without frames.no_load_bright"
    ": give that frame, or load further"
)
_FLAWS = 0.015
"""What dust, texture and compression add to any frame, over its contrast."""
_NOISE_FRAMES = 8
_DARKER, _DARKER_SHARE = 0.05, 0.01
"""By how much of the contrast, and in which share of the specimen, light falls below the first
frame's before that was not unloaded: fringes of order 0.07 are as bright."""
_SAME_LIGHT = 0.02


@dataclass(frozen=True, kw_only=True)
class UnloadedFilm:
    """What the frames of a film have in common, and where each chunk of them begins.

    `light` of the frames' size, and `guide` on blocks of `by` pixels a side; `valid` and `material`
    (trusted pixels, and blocks of them); `noise` with the factor `between` pixels, and `wave_noise`
    of a block; `clipped`, the grey level from which pixels are; `kept`, the states at multiples of
    `chunk`; `broken`, the frame into which the film could not be followed; `notes` on the light.
    """

    light: FilmLight = field(repr=False)
    guide: FilmLight = field(repr=False)
    by: int
    valid: Mask = field(repr=False)
    material: Mask = field(repr=False)
    noise: NoiseModel
    between: float
    wave_noise: float
    clipped: float
    kept: tuple[KeptState, ...] = field(repr=False)
    chunk: int
    broken: int | None
    notes: tuple[str, ...]

    def begin(self, index: int) -> KeptState:
        """The kept state of a frame's chunk."""
        return self.kept[index // self.chunk]


def check_unloaded(scene: Scene) -> None:
    """Refuse a scene whose film cannot be followed from zero load. Raises InputError."""
    name, light = f"{scene.name}: frames.starts_unloaded", scene.polariscope
    if scene.model is not None:
        raise InputError(
            f"{name} is for films without a model, and the scene has one, which names the orders; "
            "leave the key out"
        )
    if light.step or light.several_wavelengths:
        raise InputError(
            f"{name}: phase steps and colours tell the order of each state; leave the key out"
        )
    if scene.frames.known_order or scene.frames.known_line or scene.frames.free_boundary:
        raise InputError(
            f"{name}: the orders are counted from zero, and known orders are for single frames; "
            "leave one of them out"
        )
    if scene.frames.gamma == "unknown":
        raise InputError(f"{name}: frames.gamma = 'unknown' is for single frames; give a number")


class _FilmData:
    """The light of a film's frames, on blocks of pixels: what all passes over it share."""

    def __init__(self, first: Frame, scene: Scene, capture: Capture) -> None:
        self.full = full_scale(capture.bit_depth)
        self.gamma, self.capture = scene.frames.stated_gamma, capture
        self.sign = -1.0 if scene.polariscope.field == "bright" else 1.0
        linear = to_linear(first, bit_depth=capture.bit_depth, gamma=self.gamma, allow_blank=True)
        self.valid = linear.valid
        for part in (capture.dark, capture.bright):
            self.valid = self.valid & part.valid if part else self.valid
        if not self.valid.any():
            raise InputError(f"{first.name}: no pixel is trusted; check mask and exposure")
        self.by = pixels_together(self.valid.shape)
        self.material = joined_pixels(self.valid, self.by) > 0.99
        self.first = first
        self.clipped = self.full

    def light(self, frame: Frame) -> Array:
        """Light of a frame (rows, cols), over full scale."""
        return plain_light(frame, self.full, self.gamma)

    def joined(self, frame: Frame) -> tuple[Array, Mask]:
        """Light on blocks, and where none of a block's pixels is clipped or beside the specimen."""
        light = joined_pixels(self.light(frame), self.by)
        return light, self.material & unclipped(frame, self.clipped, self.by)


def plain_light(frame: Frame, full: float, gamma: float) -> Array:
    """Light of a frame (rows, cols) over full scale, float32; 0 where it holds no number."""
    light = frame.image.astype(np.float32) * np.float32(1.0 / full)
    if frame.image.dtype.kind == "f":
        light = np.nan_to_num(light)
    return light if gamma == 1.0 else np.maximum(light, 0.0) ** np.float32(gamma)


def unclipped(frame: Frame, clipped: float, by: int) -> Mask:
    """Blocks of a frame in which no pixel has reached a grey level."""
    return joined_pixels(frame.image >= clipped, by) < np.float32(0.5 / by**2)


def prepare_unloaded(
    captured: Callable[[], Frames], scene: Scene, capture: Capture, *, chunk: int, count: int
) -> UnloadedFilm:
    """Pass over a film that begins without load: its light, and the states of its chunks.

    Parameters: `captured`, gives the film's frames anew, each with its number; `scene`; `capture`;
    `chunk`, frames from one kept state to the next; `count` of the frames. Raises InputError where
    the light is not told, PhysicsError where the film is not one that begins unloaded.
    """
    first = next(iter(captured()))[1][0]
    data = _FilmData(first, scene, capture)
    own, other = (capture.dark, capture.bright)[:: int(data.sign)]
    zero, rough = (own.image, False) if own else smooth_zero(data.light(first), data.valid)
    top, noise, between = _first_pass(captured(), data, zero, count)
    guide = FilmLight(
        zero=joined_pixels(zero, data.by),
        illumination=(
            top.surface(data.material)
            if other is None
            else np.maximum(data.sign * joined_pixels(other.image - zero, data.by), 1e-3)
        ),
        error=np.zeros(data.material.shape, dtype=np.float32),
        sign=data.sign,
    )
    _refuse_loaded(top, data, guide, scene)
    level = float(np.median(guide.illumination[data.material]))
    grey = float(noise.sigma(0.5 * data.full)) / data.full * between * (np.sqrt(2.0) ** rough)
    wave_noise = 2.0 * grey / data.by / level
    path = FilmPath(
        unloaded_state(data.material, _time(first, 0)), guide, noise=wave_noise, chunk=chunk
    )
    path.follow((*data.joined(frames[0]), _time(frames[0], k)) for k, frames in captured())
    light, notes = _final_light(path, data, zero, other.image if other else None, scene)
    guide = replace(guide, illumination=joined_pixels(light.illumination, data.by))
    return UnloadedFilm(
        light=light, guide=guide, by=data.by, valid=data.valid, material=data.material,
        noise=noise, between=between * float(np.sqrt(2.0) ** rough), wave_noise=wave_noise,
        clipped=data.clipped, kept=tuple(path.kept), chunk=chunk, broken=path.broken, notes=notes,
    )  # fmt: skip


def _time(frame: Frame, index: int) -> float:
    """A frame's time (s), or its number where the file knows no times."""
    return float(index) if frame.time_s is None else frame.time_s


def _first_pass(
    frames: Frames, data: _FilmData, zero: Array, count: int
) -> tuple[BrightestLight, NoiseModel, float]:
    """The brightest light of a film, and the noise of the frame of most contrast."""
    top, best = BrightestLight(), -1.0
    below = joined_pixels(zero, data.by)
    depth, between = data.capture.bit_depth, 1.0
    noise = estimate_noise(data.first.image, data.valid, bit_depth=depth)
    for index, (frame, *_) in frames:
        light = joined_pixels(data.light(frame), data.by)
        top.add(np.float32(data.sign) * (light - below))
        if index % max(1, count // _NOISE_FRAMES):
            continue
        data.clipped = min(data.clipped, saturation_level(frame.image, full=data.full))
        contrast = float(np.std(light[data.material]))
        if contrast > best:
            best = contrast
            noise = estimate_noise(frame.image, data.valid, bit_depth=depth)
            between = noise_between_pixels(frame.image, data.valid, noise)
    return top, noise, between


def _refuse_loaded(top: BrightestLight, data: _FilmData, guide: FilmLight, scene: Scene) -> None:
    """Refuse a film whose first frame shows fringes, for later ones fall below its light."""
    least = -_DARKER * guide.illumination
    share = float(np.mean((top.lowest < least)[data.material]))
    if share > _DARKER_SHARE:
        than = "brighter than later ones" if data.sign > 0 else "darker than later ones"
        raise PhysicsError(NOT_UNLOADED.format(scene.name, than, 100.0 * share))


def _final_light(
    path: FilmPath, data: _FilmData, zero: Array, other: Array | None, scene: Scene
) -> tuple[FilmLight, tuple[str, ...]]:
    """The light of the frames' size by the crests that were followed, and what to say of it."""
    shape = data.valid.shape
    known = path.crests.told and path.highest > LEAST_ORDER
    given = None if other is None else np.maximum(data.sign * (other - zero), 1e-3)
    if not known and given is None:
        if path.broken is not None:
            text = NOT_FOLLOWED.format(path.broken - 1, path.broken)
            raise PhysicsError(f"{scene.name}: {text}")
        raise PhysicsError(FEW_ORDERS.format(scene.name, path.highest, LEAST_ORDER))
    if known:
        level, error = path.crests.illumination(shape)
        scale = 1.0 if given is None else float(np.median((level / given)[data.valid]))
        if given is None or abs(scale - 1.0) > _SAME_LIGHT:
            text = OWN_CRESTS if given is None else OTHER_LIGHT.format(scale)
            light = FilmLight(zero=zero, illumination=level, error=error, sign=data.sign)
            return light, (text,)
    assert given is not None
    none = np.zeros(shape, dtype=np.float32)
    return FilmLight(zero=zero, illumination=given, error=none, sign=data.sign), ()


def unloaded_states(
    film: UnloadedFilm, captured: Iterable[tuple[int, list[Frame]]], scene: Scene, capture: Capture
) -> Iterator[ProcessedFrame]:
    """What is found in the frames of a film, from the first of a chunk on.

    Parameters: `film`; `captured`, the frames with their numbers; `scene`; `capture`. Yields a
    ProcessedFrame each.
    """
    full, gamma = full_scale(capture.bit_depth), scene.frames.stated_gamma
    state: FilmState | None = None
    for index, (frame, *_) in captured:
        light = plain_light(frame, full, gamma)
        begin = film.begin(index)
        if state is None or index % film.chunk == 0:
            state = begin.state()
        elif not (film.broken is not None and index >= film.broken):
            wave = light_wave(
                film.guide.rise(joined_pixels(light, film.by)), film.guide.illumination
            )
            trusted = film.material & unclipped(frame, film.clipped, film.by)
            time = _time(frame, index)
            state = follow_frame(state, wave, trusted, time, noise=film.wave_noise)
        known = state.known & ~begin.doubt()
        if film.broken is not None and index >= film.broken:
            known = np.zeros_like(known)
        own = replace(frame, index=index)
        yield _read(film, replace(state, known=known), own, light, scene, capture)


def _read(
    film: UnloadedFilm, state: FilmState, frame: Frame, light: Array, scene: Scene,
    capture: Capture,
) -> ProcessedFrame:  # fmt: skip
    """One frame, read where it was followed."""
    valid = film.valid & (frame.image < film.clipped)
    sigma = film.between * film.noise.linear_sigma(
        frame.image, bit_depth=capture.bit_depth, gamma=scene.frames.stated_gamma
    )
    sigma = np.maximum(sigma, _FLAWS * film.light.illumination).astype(np.float32)
    reading = read_followed(light, state, film.light, sigma=sigma, valid=valid, by=film.by)
    signal = film.light.rise(light) / film.light.illumination
    relative = sigma / film.light.illumination
    known = np.isfinite(reading.order)
    left = (signal - fringe_response(np.where(known, reading.order, 0.0))) / relative
    chi = float(np.sqrt(np.mean(np.square(left[known])))) if known.any() else float("nan")
    return ProcessedFrame(
        **frame_fields(frame, scene),
        normalised=np.where(valid, signal, np.nan).astype(np.float32),
        reading=reading,
        noise=float(np.median(relative[valid])) if valid.any() else float("nan"),
        chi=chi,
        warnings=_warnings(film, frame.index, reading.kept),
        columns={
            "kept_share": reading.kept,
            **order_columns(reading.order, reading.uncertainty),
        },
    )


def _warnings(film: UnloadedFilm, index: int, kept: float) -> tuple[str, ...]:
    """What to say of a frame."""
    said = list(film.notes) if index == 0 else []
    if film.broken is not None and index >= film.broken:
        return (*said, NOT_FOLLOWED.format(film.broken - 1, film.broken))
    begin = film.begin(index)
    if begin.doubts:
        share = 100.0 * begin.doubts / max(1, int(np.count_nonzero(film.material)))
        said.append(BOTH_WAYS.format(share, index - index % film.chunk))
    if kept < 0.5 and index > 0:
        said.append(
            f"only {100.0 * kept:.0f} % of the specimen's pixels could be followed and read: what "
            "changes too fast, or is too fine, is not known from there on"
        )
    return tuple(said)
