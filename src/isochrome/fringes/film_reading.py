"""The fringe order of each pixel of a film, followed through time from an order that is known.

The light of a pixel on a crest does not say whether its order goes on or back. Its neighbours do,
whose change is its own but for little: that of the whole picture (`fit_order_change`) predicts each
pixel's order, and the wave w = cos 2 pi N corrects it by least squares over a wide and a narrow
window, d = Σ J r / (Σ J² + (sigma² + e² Σ 1)/u²), r = w - C cos 2 pi N, J = dw/dN; u is what the
prediction leaves open, e what the light does, and C what the size of a pixel leaves of fringes of
the gradient g, 1 - pi² g²/6. What lies below the narrow window is smoothed a little in each frame,
for no light would ever correct it. A pixel is known as long as its neighbourhood's light is
explained, its fringes are wide enough and its order changes by no more than a stated part of a
fringe; once it is not, it stays so, and says nothing to its neighbours.

The change of a whole picture is smooth over it, and loads change mostly in proportion, by c N. The
factor c is searched over all that a stated largest change allows, alone or after the change that
went before; from the best of them the change is fitted as a sum of few fields: N, its gradient in
the picture (the fringes move), the change before, a constant.

Beside known orders N goes on as a plane through them: min over a, b, c of
Σ w (N(p + u) - a - b u_1 - c u_2)², w a Gaussian window times where orders are known; N(p) = a.
What a key frame could not read is regained where the light, on a flank, says the same:
d = (w - C cos 2 pi N)/(dw/dN); on a crest nothing is gained there until the fringes move.

The frames are passed over once, on blocks of pixels. At the start of every chunk the state is
kept, so that a chunk's frames can be read by whoever has it, with the same result. Where single
frames can be read from nothing, key frames are, now and then and where a film breaks: what they and
the followed orders have in common is checked, what only one of them knows is taken from it, and
where they differ nothing is known since the key frame before.

The light of a film that begins without load is I = Z + A sin² pi N, or Z - A sin² pi N in the
bright field. The unloaded first frame is Z. A, the illumination, shows at crests: what a pixel
reaches at most as fringes pass over it lies on one smooth surface, and below it where none passed
(`BrightestLight`). Orders that are followed with that first surface say where crests are, and those
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
from isochrome.fringes.on_branch import (
    BRANCH,
    SURE,
    OrderReading,
    make_reading,
    read_order,
    widened,
)
from isochrome.fringes.windows import (
    FEWEST,
    LARGEST_CHANGE,
    LIGHT_ERROR,
    MOSTLY,
    POOLED_PX,
    REACH,
    ROUNDS,
    STRIDE,
    TURN,
    Array,
    Mask,
    block_means,
    gaussian_sum,
    nearest_known,
    valid_means,
)
from isochrome.optics import FringeWave

_TURN = np.float32(TURN)
_FACTORS = 31
"""Steps of the search; the finest fringes move by a fortieth from one to the next."""
_OUTLIER = 0.3
"""Of the wave: a residual that counts half."""
_RIDGE = 1e-3
"""How little a coefficient is let go from the search, of the pixels' information."""
_SPREAD, SYSTEMATIC = 0.01, 0.03
"""Of the prediction, fringes, and of the wave by light that is not known exactly, which no window
averages out: a region of even order that passes a crest is not to be held up on its near side."""
_FLANK = 0.5
"""Least |sin 2 pi N| of a flank, 0.08 fringe from a crest."""


def fit_order_change(
    order: Array, expected: Array, wave: Array, contrast: Array,
    gradient: tuple[Array, Array], known: Mask,
) -> tuple[Array, float, float] | None:  # fmt: skip
    """Fit the change of a picture's order to the wave cos 2 pi N of the next frame, fringes.
    `expected`, the change that went before, over the time to the new frame; `gradient` along rows
    and columns. Also the mean square of what it leaves of the wave, and the largest of any field in
    it, and of all together, fringes; None where too few orders are known."""
    thin = slice(STRIDE // 2, None, STRIDE)
    use = known[thin, thin]
    if np.count_nonzero(use) < FEWEST:
        return None
    y, x = (np.linspace(-1.0, 1.0, n, dtype=np.float32) for n in order.shape)
    one = np.ones((1, 1), dtype=np.float32)
    along, across = gradient
    fields = [order, order * x, order * y[:, None], expected, across, along, one]
    basis = np.stack([np.broadcast_to(f, order.shape)[thin, thin][use] for f in fields])
    shown, faded = wave[thin, thin][use], contrast[thin, thin][use]
    # the best factor of N alone, or after the change before
    reach = LARGEST_CHANGE / max(float(np.percentile(basis[0], MOSTLY)), 1e-3)
    best, start = np.inf, np.zeros(len(basis))
    for goes_on in (0.0, 1.0):
        ahead = np.float32(goes_on) * basis[3]
        for factor in np.linspace(-reach, reach, _FACTORS):
            tried = basis[0] + (np.float32(factor) * basis[0] + ahead)
            misfit = _mean_misfit(_residual(tried, shown, faded)[0])
            if misfit < best:
                best, start[0], start[3] = misfit, factor, goes_on
    solution = start.copy()
    ridge = _RIDGE * shown.size
    for _ in range(ROUNDS):
        residual, slope = _residual(basis[0] + solution.astype(np.float32) @ basis, shown, faded)
        turned = basis * slope
        weighted = turned * on_flank(slope) * _weight(residual)
        matrix = (weighted @ turned.T).astype(float) + ridge * np.eye(len(basis))
        pull = weighted @ residual - ridge * (solution - start)
        solution = solution + np.linalg.solve(matrix, pull)
    single = solution.astype(np.float32)
    change = single @ basis
    residual, _ = _residual(basis[0] + change, shown, faded)
    parts = np.percentile(np.abs(basis), MOSTLY, axis=1) * np.abs(solution)
    # tilts of the factor and what the fringes move are judged by their sum alone
    largest = float(max(np.percentile(np.abs(change), MOSTLY), parts[0], parts[6]))
    full_change = np.zeros_like(order)
    for share, shape in zip(single, fields, strict=True):
        full_change += share * shape
    return full_change, _mean_misfit(residual), largest


def on_flank(slope: Array) -> Array:
    """How far pixels tell a change of the order, by the slope J of their wave: 0 on a crest. Light
    that is off by an e of the wave stands off from a crest as that of another order does, e/J away.
    Where the prediction is good to u it counts 1/(1 + (e/(J u))²), with twice the usual e."""
    square = slope * slope
    return np.asarray(square / (square + np.float32((2.0 * SYSTEMATIC / _SPREAD) ** 2)))


def near_crest(order: Array) -> Mask:
    """Where orders are so near to a crest that the light does not tell them."""
    return np.asarray(np.cos(_TURN * order) < -np.sqrt(np.float32(1.0 - _FLANK**2)))


def faded_fringes(order: Array) -> tuple[Array, Array, tuple[Array, Array]]:
    """What a pixel's size leaves of the fringes, and their gradient: squared, and its parts."""
    along, across = (
        cv2.Sobel(order, cv2.CV_32F, dx, 1 - dx, ksize=3, scale=0.125) for dx in (0, 1)
    )
    square = along * along + across * across
    return 1.0 - np.float32(np.pi**2 / 6.0) * square, square, (along, across)


def _residual(order: Array, wave: Array, contrast: Array) -> tuple[Array, Array]:
    """What an order leaves of the wave, and how the wave answers to it."""
    angle = _TURN * order
    return wave - contrast * np.cos(angle), -_TURN * contrast * np.sin(angle)


def _mean_misfit(residual: Array) -> float:
    return float(np.mean(residual * residual * _weight(residual)))


def _weight(residual: Array) -> Array:
    return np.asarray(1.0 / (1.0 + (residual / np.float32(_OUTLIER)) ** 2))


WINDOWS = (5.0, 2.5)
"""Standard deviations, pixels."""
_SMOOTHED, _SMOOTH_PX = 0.2, 1.0
"""Share of what is taken off below the narrow window."""
_LARGEST_MISFIT = 3.0
"""RMS of what a followed order, or the change of the whole picture, leaves of the wave, over what
noise and light that is not known exactly make."""
_AT_FIRST = 0.1
"""Highest order, from zero load, up to which the light alone tells orders: no crest is passed. So
far from nought the order's crease is not smoothed."""


@dataclass(frozen=True, kw_only=True)
class FilmState:
    """Where a film stands: (rows, cols) of the pixels on which it is followed."""

    order: Array = field(repr=False)  # N, fringes
    # its change from the frame before, fringes a second; without times a frame
    rate: Array = field(repr=False)
    known: Mask = field(repr=False)
    time: float  # of the frame, s, or its number
    broken: bool = False  # the whole picture could not be followed into this frame


def follow_frame(
    state: FilmState, wave: Array, valid: Mask, time: float, *, noise: float
) -> FilmState:
    """Follow the orders into a next frame's `wave`, cos 2 pi N, or, with times that fall, back."""
    before = state.order
    lost = replace(state, known=np.zeros_like(state.known), time=time, broken=True)
    weight = valid.astype(np.float32)
    apart = time - state.time
    usual = _LARGEST_MISFIT**2 * (SYSTEMATIC**2 + noise**2)
    contrast, steep, gradient = faded_fringes(before)
    highest = state.order[state.known][::7]
    if not highest.size or np.percentile(highest, 99.8) < _AT_FIRST:
        # below the first crest the light tells orders, but not where they may be beyond it
        signal = _window_mean(0.5 - 0.5 * wave, weight, POOLED_PX)
        order = np.arcsin(np.sqrt(np.clip(signal, 0.0, 1.0))) / np.float32(np.pi)
        beyond = (valid & near_crest(order)).astype(np.uint8)
        known = state.known & valid & (cv2.dilate(beyond, np.ones((3, 3), np.uint8)) == 0)
    else:
        expected = state.rate * np.float32(apart)
        fitted = fit_order_change(before, expected, wave, contrast, gradient, state.known & valid)
        change, square, largest = fitted or (before, np.inf, np.inf)
        if square > usual or largest > 1.1 * LARGEST_CHANGE:
            return lost
        order, known = np.abs(before + change), state.known
        telling = weight * known * (steep < LARGEST_CHANGE**2)
        for width in WINDOWS:  # the predicted orders as their neighbourhoods' light corrects them
            residual, slope = (part * telling for part in _residual(order, wave, contrast))
            spread = (noise**2 + (2.0 * np.pi * width**2) * SYSTEMATIC**2) / _SPREAD**2
            pull = slope * on_flank(slope)
            informed = gaussian_sum(pull * slope, width, reach=REACH) + np.float32(spread)
            order = np.abs(order + gaussian_sum(pull * residual, width, reach=REACH) / informed)
        fine = np.float32(_SMOOTHED) * (cv2.GaussianBlur(order, (0, 0), _SMOOTH_PX) - order)
        order = np.asarray(order + np.where(order > _AT_FIRST, fine, np.float32(0.0)))
    trust = weight * known
    residual = _residual(order, wave, contrast)[0] * trust
    known = (
        known
        & (_window_mean(residual * residual, trust, POOLED_PX) < usual)
        & (steep < LARGEST_CHANGE**2)  # fringes are wide enough
        & (np.abs(order - before) < LARGEST_CHANGE)
    )
    if not known.any():
        return lost
    order = continued(order, known)
    change = cv2.GaussianBlur((order - before) * weight, (0, 0), POOLED_PX)
    rate = change / np.float32(apart) if apart else np.zeros_like(change)
    return FilmState(order=order, rate=rate, known=known, time=time)


def _window_mean(values: Array, weight: Array, width_px: float) -> Array:
    """Mean over a Gaussian window of the pixels that count."""
    total = np.maximum(gaussian_sum(weight, width_px, reach=REACH), np.float32(1e-3))
    return np.asarray(gaussian_sum(values * weight, width_px, reach=REACH) / total)


_WIDTH_PX = 1.5
_HALF_PX = int(REACH * _WIDTH_PX)
"""Standard deviation of the window, pixels, and how far it reaches: a plane is to bend with the
order, and an order that is needed lies beside a known one."""
_LEAST = 0.2
"""Weight of the known pixels from which there are enough of them: those of one side have 7."""
_HELD = 0.02
"""Of the window's weight: gradients that few pixels tell are held near to nought."""


def continued(order: Array, known: Mask) -> Array:
    """Orders that go on beyond where they are known; what lies too far beyond stays as it is."""
    weight = known.astype(np.float32)
    values = order * weight
    beyond = ~known & (_moment(weight, 0, 0) > _LEAST)
    if not beyond.any():
        return order
    powers = ((0, 0), (1, 0), (0, 1))
    sums = {(i, j): _moment(weight, i, j)[beyond] for i in range(3) for j in range(3 - i)}
    products = [[sums[a + c, b + d] for c, d in powers] for a, b in powers]
    matrix = np.array(products, dtype=float).transpose(2, 0, 1)
    matrix[:, 1, 1] += _HELD * sums[0, 0]
    matrix[:, 2, 2] += _HELD * sums[0, 0]
    right = np.stack([_moment(values, i, j)[beyond] for i, j in powers], axis=1).astype(float)
    filled = order.copy()
    filled[beyond] = np.linalg.solve(matrix, right[..., None])[:, 0, 0]
    return np.abs(filled)


def _moment(values: Array, down: int, across: int) -> Array:
    """Σ w u_1^down u_2^across times values about each pixel (rows, cols)."""
    away = np.arange(-_HALF_PX, _HALF_PX + 1, dtype=np.float32)
    window = np.exp(-0.5 * (away / np.float32(_WIDTH_PX)) ** 2)
    x, y = window * away**across, window * away**down
    return np.asarray(cv2.sepFilter2D(values, cv2.CV_32F, x, y, borderType=cv2.BORDER_CONSTANT))


def regained(order: Array, known: Mask, wave: Array, valid: Mask) -> tuple[Array, Mask]:
    """Orders and where they are known, with what their light bears out beside those known."""
    for _ in range(_HALF_PX):  # beyond, nothing that is known says how the order goes on
        order = continued(order, known)
        near = cv2.boxFilter(known.astype(np.float32), -1, (3, 3), normalize=False)
        contrast, steep, _ = faded_fringes(order)
        residual, slope = _residual(order, wave, contrast)
        flank = np.abs(np.sin(_TURN * order)) > _FLANK
        move = residual / np.where(flank, slope, np.inf)
        # less than to the crest, beyond which it is alike
        determined = flank & (np.abs(move) < SURE)
        new = (near > 2.5) & ~known & valid & (steep < LARGEST_CHANGE**2) & determined  # a plane's
        if not new.any():
            break
        order, known = np.where(new, np.abs(order + move), order), known | new
    return order, known


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
        thin = slice(None, None, STRIDE)
        self._basis = light_basis(shape, total_degree(_DEGREES[1]))[:, thin, thin]
        count = len(self._basis)
        self._matrix, self._right = np.zeros((count, count)), np.zeros(count)
        self._square, self._count = 0.0, 0
        # pixels gathered whose orders are found together, so that their errors are one
        self._alike = float(2.0 * np.pi * (WINDOWS[-1] / STRIDE) ** 2)

    def add(self, rise: Array, order: Array, contrast: Array, known: Mask) -> None:
        """Take a frame's crests by the `rise` over the unloaded light and the followed order."""
        thin = slice(None, None, STRIDE)
        use = near_crest(order[thin, thin]) & known[thin, thin]
        orders = order[thin, thin][use]
        signal = 0.5 - 0.5 * contrast[thin, thin][use] * np.cos(np.float32(2.0 * np.pi) * orders)
        risen = rise[thin, thin][use]
        terms = self._basis[:, use] * signal
        self._matrix += terms @ terms.T
        self._right += terms @ risen
        self._square += float(np.sum(risen.astype(float) ** 2))
        self._count += risen.size

    @property
    def told(self) -> bool:
        """Whether as many places of crests were passed as the illumination has terms."""
        return self._count >= self._alike * len(self._right)

    def illumination(self, shape: tuple[int, int]) -> tuple[Array, Array]:
        """The illumination, and its standard uncertainty over it, on pixels of any size."""
        basis, count = light_basis(shape, total_degree(_DEGREES[1])), len(self._right)
        ridge = 1e-6 * np.trace(self._matrix) / count * np.eye(count)
        inverse = np.linalg.inv(self._matrix + ridge)
        coefficients = inverse @ self._right
        square = self._square - coefficients @ (2.0 * self._right - self._matrix @ coefficients)
        level = np.tensordot(coefficients.astype(np.float32), basis, 1)
        root = np.linalg.cholesky(inverse * max(float(square) / self._count, 1e-12) * self._alike)
        squares = (np.tensordot(part.astype(np.float32), basis, 1) ** 2 for part in root.T)
        level = np.maximum(level, 1e-3)
        return level, np.asarray(np.hypot(np.sqrt(sum(squares)) / level, LIGHT_ERROR))


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
    chunk's first frame, and each key frame; `lost`: [from, to) of which nothing is known."""

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
        return next(((a, b) for a, b in self.lost if a <= index < b or index == a), None)

    def follow(
        self, frames: Iterable[tuple[Frame, Array, Mask, float]],
        key: Callable[[Frame, float], FilmState | None] | None = None, every: int = 1,
    ) -> None:  # fmt: skip
        """Follow the film through its frames: with each its light on blocks, where it is trusted,
        and its time. `key` reads each `every`-th from nothing, None where it cannot."""
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
            self._state = replace(old, order=order, known=(old.known | new.known) & ~differ)
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
