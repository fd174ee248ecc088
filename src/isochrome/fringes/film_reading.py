"""The order of each pixel of a film's frame, on the branch that it was followed on.

The way of a film's orders from its first frame to its last, and where it can be taken up again.

The frames are passed over once, on blocks of pixels. At the start of every chunk the state is
kept, so that a chunk's frames can be read by whoever has it, with the same result. Where single
frames can be read from nothing, key frames are, now and then and where a film breaks: what they and
the followed orders have in common is checked, what only one of them knows is taken from it, and
where they differ nothing is known since the key frame before. What lies beside what is known is
regained in such a film, at each kept state, where its light bears it out; the next key frame is
held against it as well.

The light of a film that begins without load: what its own frames show of it.

A frame's light is I = Z + A sin² pi N, or Z - A sin² pi N in the bright field. The unloaded first
frame is Z. A, the illumination, shows at crests: what a pixel reaches at most as fringes pass over
it lies on one smooth surface, and below it where none passed (`BrightestLight`). Orders that are
followed with that first surface say where crests are to a few thousandths of a fringe, and those
crests together the polynomial that is used in the end (`CrestLight`).
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from isochrome.errors import InputError
from isochrome.estimation import light_basis, total_degree
from isochrome.frames import Frame
from isochrome.fringes.follower import (
    SYSTEMATIC,
    WINDOWS,
    FilmState,
    continued,
    faded_fringes,
    follow_frame,
    near_crest,
    regained,
)
from isochrome.fringes.on_branch import BRANCH, OrderReading, make_reading, read_order, widened
from isochrome.fringes.windows import (
    LIGHT_ERROR,
    MOSTLY,
    STRIDE,
    Array,
    Mask,
    block_means,
    nearest_known,
    valid_means,
)
from isochrome.optics import FringeWave

_DEGREES = (2, 4)
"""Of the illumination by the brightest light, and by all crests: a lamp falls off to corners."""
_ROUNDS = 30
_SQUARE, _EVEN = 8, 1.5
"""Pixels a side of the blocks by which unloaded light is judged, and how much their means may
scatter over what noise alone makes them."""
NO_CREST = "no_crest_passes_over"


@dataclass(frozen=True, kw_only=True)
class FilmLight:
    """The light (rows, cols) of a film."""

    zero: Array = field(repr=False)  # of the unloaded specimen, Z
    illumination: Array = field(repr=False)  # A
    # standard uncertainties of A and Z, over A
    error: Array | float = field(default=0.0, repr=False)
    zero_error: Array | float = field(default=0.0, repr=False)
    sign: float = 1.0  # 1 in the dark field, -1 in the bright one

    def joined(self, by: int) -> FilmLight:
        """The same on blocks of pixels, on which it guides alone."""
        zero, level = (joined_pixels(part, by) for part in (self.zero, self.illumination))
        return FilmLight(zero=zero, illumination=level, sign=self.sign)

    def rise(self, light: Array) -> Array:
        """What fringes add to or take off the unloaded light, A sin² pi N (rows, cols)."""
        return np.asarray(np.float32(self.sign) * (light - self.zero))

    def wave(self, light: Array) -> Array:
        """The wave cos 2 pi N, float32, whose ends noise may pass."""
        return np.asarray(np.float32(1.0) - np.float32(2.0) * self.rise(light) / self.illumination)


def smooth_zero(light: Array, valid: Mask) -> tuple[Array, bool]:
    """The unloaded light, without noise where it is a polynomial; and whether it has its noise."""
    basis = light_basis(light.shape, total_degree(_DEGREES[1]))
    thin = slice(None, None, STRIDE)
    terms = basis[:, thin, thin][:, valid[thin, thin]].astype(float)
    coefficients = np.linalg.lstsq(terms.T, light[thin, thin][valid[thin, thin]], rcond=None)[0]
    smooth = np.tensordot(coefficients.astype(np.float32), basis, 1)
    residual = np.where(valid, light - smooth, 0.0)
    noise = float(np.sqrt(np.mean(np.square(residual[valid]))))
    blocks = valid_means(residual, valid, _SQUARE)[block_means(valid.astype(float), _SQUARE) > 0.99]
    even = blocks.size > 0 and np.sqrt(np.mean(blocks**2)) < _EVEN * noise / _SQUARE
    return (smooth, False) if even else (light.astype(np.float32), True)


class BrightestLight:
    """The highest light that each pixel of a film goes over, gathered frame by frame."""

    lowest: Array  # rise of each pixel (rows, cols)
    _top: Array
    _highest: Array

    def __init__(self) -> None:
        self._before: list[Array] = []

    def contrast(self, valid: Mask) -> float:
        """The range of the light over most of the valid pixels (rows, cols)."""
        reach = (self._highest - self.lowest)[valid]
        return float(np.percentile(reach, MOSTLY)) if reach.size else 0.0

    def add(self, rise: Array) -> None:
        """Take a frame's rise over the unloaded light (rows, cols)."""
        smooth = cv2.GaussianBlur(rise, (0, 0), 1.0)
        if not self._before:
            self._top, self.lowest, self._highest = np.zeros_like(smooth), smooth, smooth
        self.lowest = np.minimum(self.lowest, smooth)
        self._highest = np.maximum(self._highest, smooth)
        if len(self._before) == 2:
            earlier, middle = self._before
            passed = (middle >= earlier) & (middle >= smooth)
            self._top = np.maximum(self._top, np.where(passed, middle, 0.0))
        self._before = [*self._before[-1:], smooth]

    def surface(self, valid: Mask) -> Array:
        """The illumination that the crests lie on (rows, cols). Raises InputError without any."""
        basis = light_basis(self._top.shape, total_degree(_DEGREES[0]))
        thin = slice(None, None, STRIDE)
        use = valid[thin, thin]
        brightest, terms = self._top[thin, thin][use], basis[:, thin, thin][:, use]
        if brightest.size < 100 or not brightest.max() > 0.0:
            raise InputError(NO_CREST)
        weight = (brightest >= np.median(brightest)).astype(np.float32)
        coefficients = np.zeros(len(terms))
        for _ in range(_ROUNDS):
            matrix = (terms * weight) @ terms.T + 1e-6 * weight.sum() * np.eye(len(terms))
            coefficients = np.linalg.solve(matrix.astype(float), (terms * weight) @ brightest)
            level = coefficients.astype(np.float32) @ terms
            away = (brightest - level) / np.median(level)
            weight = np.exp(-((np.minimum(away, 0.0) / SYSTEMATIC) ** 2)).astype(np.float32)
        surface = np.tensordot(coefficients.astype(np.float32), basis, 1)
        if not surface[valid].min() > 0.2 * np.median(surface[valid]):
            raise InputError(NO_CREST)
        return np.asarray(surface)


class CrestLight:
    """The illumination by the followed orders of a film, gathered frame by frame."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._shape = shape
        count = len(light_basis(shape, total_degree(_DEGREES[1])))
        self._matrix, self._right = np.zeros((count, count)), np.zeros(count)
        self._square, self._count = 0.0, 0

    def add(self, rise: Array, order: Array, contrast: Array, known: Mask) -> None:
        """Take a frame's crests by the `rise` over the unloaded light and the followed order."""
        thin = slice(None, None, STRIDE)
        use = near_crest(order[thin, thin]) & known[thin, thin]
        orders = order[thin, thin][use]
        signal = 0.5 - 0.5 * contrast[thin, thin][use] * np.cos(np.float32(2.0 * np.pi) * orders)
        risen = rise[thin, thin][use]
        basis = light_basis(self._shape, total_degree(_DEGREES[1]))
        terms = basis[:, thin, thin][:, use] * signal
        self._matrix += terms @ terms.T
        self._right += terms @ risen
        self._square += float(np.sum(risen.astype(float) ** 2))
        self._count += risen.size

    @property
    def told(self) -> bool:
        """Whether as many places of crests were passed as the illumination has terms."""
        return self._count >= self._alike * len(self._right)

    @property
    def _alike(self) -> float:
        """Pixels gathered whose orders are found together, so that their errors are one."""
        return float(2.0 * np.pi * (WINDOWS[-1] / STRIDE) ** 2)

    def illumination(self, shape: tuple[int, int]) -> tuple[Array, Array]:
        """The illumination, and its standard uncertainty over it, on pixels of any size."""
        basis, count = light_basis(shape, total_degree(_DEGREES[1])), len(self._right)
        ridge = 1e-6 * np.trace(self._matrix) / count * np.eye(count)
        inverse = np.linalg.inv(self._matrix + ridge)
        coefficients = inverse @ self._right
        square = self._square - coefficients @ (2.0 * self._right - self._matrix @ coefficients)
        variance = max(float(square) / self._count, 1e-12)
        level = np.tensordot(coefficients.astype(np.float32), basis, 1)
        root = np.linalg.cholesky(inverse * variance * self._alike)
        squares = (np.tensordot(part.astype(np.float32), basis, 1) ** 2 for part in root.T)
        spread = np.sqrt(sum(squares))
        level = np.maximum(level, 1e-3)
        return level, np.asarray(np.hypot(spread / level, LIGHT_ERROR))


_STEPS = 1e-3
"""Fringes of which a kept order is a whole number; far below what one frame says."""


@dataclass(frozen=True)
class KeptState:
    """A state that can be taken up again, packed."""

    packed: bytes = field(repr=False)  # orders, rates, and where the orders are known
    shape: tuple[int, ...]
    time: float  # of its frame
    doubted: int = 0  # pixels left out since the next key frame disagrees

    def doubting(self, where: Mask) -> KeptState:
        """The same with less that is known (rows, cols)."""
        state = self.state()
        doubted = self.doubted + int(np.count_nonzero(state.known & where))
        return keep_state(replace(state, known=state.known & ~where), doubted)

    def state(self) -> FilmState:
        """The state of the chunk's first frame."""
        values = np.frombuffer(zlib.decompress(self.packed), np.int32).reshape(self.shape)
        order, rate, known = np.cumsum(values, axis=2, dtype=np.int32)
        order, rate = (part.astype(np.float32) * np.float32(_STEPS) for part in (order, rate))
        return FilmState(order=order, rate=rate, known=known.astype(bool), time=self.time)


def keep_state(state: FilmState, doubted: int = 0) -> KeptState:
    """Pack a state."""
    parts = np.stack((state.order, state.rate)) / np.float32(_STEPS)
    steps = np.rint(np.concatenate((parts, state.known[None]))).astype(np.int32)
    packed = zlib.compress(np.diff(steps, axis=2, prepend=np.int32(0)).tobytes(), 1)
    return KeptState(packed, steps.shape, state.time, doubted)


class FilmPath:
    """A film that is followed from its first frame on, in chunks of frames, on blocks of pixels.

    `noise`, the wave's deviation; of frames before `begin` nothing is known. `kept`: states of each
    chunk's first frame, and each key frame; `highest` order, but for a few pixels; `lost`: [from,
    to) of which nothing is known; `count` of the frames.
    """

    def __init__(
        self, start: FilmState, light: FilmLight, *, noise: float, chunk: int, begin: int = 0
    ) -> None:
        self.light, self.noise, self.chunk = light, noise, chunk
        self.crests = CrestLight(start.known.shape)
        self.highest, self.count = 0.0, 0
        self.kept: dict[int, KeptState] = {}
        self.lost: list[list[int]] = [[0, begin]] if begin else []
        self._last_key = self._begin = begin
        self._state = replace(start, known=np.zeros_like(start.known)) if begin else start
        self._start, self._broken = start, False

    def begin(self, index: int) -> int:
        """The number of the last frame up to this one whose state is kept."""
        return max(place for place in self.kept if place <= index)

    def end(self, index: int) -> int:
        """The number of the frame before the next one whose state is kept."""
        return min((place - 1 for place in self.kept if place > index), default=self.count - 1)

    def lost_at(self, index: int) -> tuple[int, int] | None:
        """From which frame to which, not included, nothing is known; the first may be read anew."""
        spans = ((first, behind) for first, behind in self.lost)
        return next((s for s in spans if s[0] <= index < s[1] or index == s[0]), None)

    def follow(
        self, frames: Iterable[tuple[Frame, Array, Mask, float]],
        key: Callable[[Frame, float], FilmState | None] | None = None, every: int = 1,
    ) -> None:  # fmt: skip
        """Follow the film through its frames: with each its light on blocks, where it is trusted,
        and its time. `key` reads each `every`-th from nothing, None where it cannot.
        """
        for index, (frame, light, valid, time) in enumerate(frames):
            self.count = index + 1
            rise = self.light.rise(light)
            wave = self.light.wave(light)
            breaks = index > self._begin and self._take(rise, wave, valid, time, index)
            if index == self._begin:
                self._state = self._start
            read = key if index > self._begin else None
            due = read is not None and (breaks or index % every == 0)
            if due or index in (0, self._begin) or index % self.chunk == 0:
                if read is not None:  # the next key frame finds what is not right of it
                    order, known = regained(self._state.order, self._state.known, wave, valid)
                    self._state = replace(self._state, order=order, known=known)
                if read is not None and due and (new := read(frame, time)) is not None:
                    self._settle(new, index)
                self.kept[index] = keep_state(self._state)
        if self._broken:
            self.lost[-1].append(self.count)

    def _take(self, rise: Array, wave: Array, valid: Mask, time: float, index: int) -> bool:
        """One frame more, and what it says of the illumination; whether the film breaks there."""
        if self._broken:
            self._state = replace(self._state, time=time)
            return False
        state = self._state = follow_frame(self._state, wave, valid, time, noise=self.noise)
        if state.broken:
            self._broken = True
            self.lost.append([index])
            return True
        self.crests.add(rise, state.order, faded_fringes(state.order)[0], state.known)
        known = state.order[state.known][::7]
        self.highest = max(self.highest, float(np.percentile(known, 99.5)) if known.size else 0.0)
        return False

    def _settle(self, new: FilmState, index: int) -> None:
        """Hold a key frame, read from nothing, against what was followed to it."""
        old = self._state
        if self._broken:
            self._broken = False
            self.lost[-1].append(index)
            self._state = replace(new, time=old.time)
        else:
            differ = old.known & new.known & (np.abs(old.order - new.order) > BRANCH)
            if differ.any():
                for place in self.kept:
                    if place >= self._last_key:
                        self.kept[place] = self.kept[place].doubting(differ)
            order = np.where(new.known, new.order, old.order)
            known = (old.known | new.known) & ~differ
            self._state = replace(old, order=order, known=known)
        self._last_key = index


_GUIDE_ROWS = 247
"""Rows, or columns if they are fewer, on which a film is followed at most, or nearly so."""


def pixels_together(shape: tuple[int, int]) -> int:
    """How many pixels of a frame, along each side, are followed as one."""
    return max(1, round(min(shape) / _GUIDE_ROWS))


def joined_pixels(values: Array, by: int) -> Array:
    """Means over blocks of pixels, float32; a rim narrower than a block is left out."""
    rows, cols = (n // by for n in values.shape)
    single = np.ascontiguousarray(values[: rows * by, : cols * by], dtype=np.float32)
    if by == 1:
        return single
    return np.asarray(cv2.resize(single, (cols, rows), interpolation=cv2.INTER_AREA))


def read_followed(
    light: Array, state: FilmState, film_light: FilmLight, *, sigma: Array, valid: Mask, by: int
) -> OrderReading:
    """Read the orders of a frame where they were followed to, on blocks of `by` pixels a side."""
    order = _spread(state.order, by, light.shape, smooth=True)
    blocks = _spread(state.known.astype(np.float32), by, light.shape, smooth=False)
    beside = valid & (cv2.dilate(blocks, np.ones((2 * by + 1, 2 * by + 1), np.uint8)) > 0.5)
    known = blocks > 0.5
    trusted = _spread(_whole_blocks(valid, by).astype(np.float32), by, light.shape, smooth=False)
    known |= beside & (trusted <= 0.5)  # at a rim, blocks that are cut are not followed
    rise = film_light.rise(light)
    wave = FringeWave(0.5, -0.5, None, np.float32(2.0 * np.pi) * order)
    reading = read_order(
        rise, order, wave, illumination=film_light.illumination,
        background=np.zeros_like(rise), sigma=sigma, valid=beside,
    )  # fmt: skip
    signal = np.clip(rise / film_light.illumination, 0.0, 1.0)
    by_ends = np.hypot(signal * film_light.error, (1.0 - signal) * film_light.zero_error)
    reading = widened(reading, by_ends)
    known &= np.isfinite(reading.order)
    return make_reading(reading.order, reading.uncertainty, known, of=valid)


def _whole_blocks(which: Mask, by: int) -> Mask:
    """Blocks of pixels all of which are among some (rows, cols)."""
    return np.asarray(joined_pixels(which, by) > 1.0 - 0.5 / by**2)


def unloaded_state(material: Mask, time: float) -> FilmState:
    """Start a film at zero load, order 0 all over the specimen, at a time, s, or frame number."""
    nothing = np.zeros(material.shape, dtype=np.float32)
    return FilmState(order=nothing, rate=nothing, known=material.copy(), time=time)


def joined_reading(reading: OrderReading, by: int, time: float) -> FilmState:
    """A frame's reading as a state that a film can be followed from, on blocks that are whole."""
    read = np.isfinite(reading.order)
    known = _whole_blocks(read, by)
    order = joined_pixels(np.where(read, reading.order, 0.0), by)
    if known.any():
        order = continued(nearest_known(order, known), known)
    return replace(unloaded_state(known, time), order=order)


def _spread(values: Array, by: int, shape: tuple[int, ...], *, smooth: bool) -> Array:
    """Values of blocks on the pixels; a rim that is no whole block has its neighbours'."""
    rows, cols = values.shape
    how = cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST
    large = cv2.resize(values, (cols * by, rows * by), interpolation=how) if by > 1 else values
    below, beside = shape[0] - rows * by, shape[1] - cols * by
    return np.asarray(cv2.copyMakeBorder(large, 0, below, 0, beside, cv2.BORDER_REPLICATE))
