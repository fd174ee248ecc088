"""The fringe order of each pixel followed through time, from an order that is known.

The light of a pixel on a crest does not say whether its order goes on or back. Its neighbours do,
whose change is its own but for little: that of the whole picture (`fit_order_change`) predicts each
pixel's order, and the wave w = cos 2 pi N corrects it by least squares over a wide and a narrow
window, d = Σ J r / (Σ J² + (sigma² + e² Σ 1)/u²), r = w - C cos 2 pi N, J = dw/dN; u is what the
prediction leaves open, and e what the light does. What lies below the narrow window is smoothed a
little in each frame, for no light would ever correct it. C is what the size of a pixel leaves of
fringes of the gradient g, 1 - pi² g²/6.

A pixel is known as long as its neighbourhood's light is explained, its fringes are wide enough and
its order changes by no more than a stated part of a fringe; once it is not, it stays so, and says
nothing to its neighbours.

How a whole picture's fringe order changes from one frame of a film to the next.

The wave w = cos 2 pi N of a frame says N up to its sign and a whole number. All pixels together say
more: the change is smooth over the picture, and loads change mostly in proportion, by c N. The
factor c is searched over all that a stated largest change allows, alone or after the change that
went before; from the best of them the change is fitted as a sum of few fields: N, its gradient in
the picture (the fringes move), the change before, a constant.

Orders a little beyond where they are known, and which of them their light bears out.

Beside known orders N goes on as a plane through them: min over a, b, c of
Σ w (N(p + u) - a - b u_1 - c u_2)², w a Gaussian window times where orders are known; N(p) = a.
What a key frame could not read is regained where the light, on a flank, says the same:
d = (w - C cos 2 pi N)/(dw/dN). On a crest both of its sides are as bright, and nothing is gained
there until the fringes move.
"""

from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from isochrome.fringes.on_branch import SURE
from isochrome.fringes.windows import (
    FEWEST,
    LARGEST_CHANGE,
    MOSTLY,
    POOLED_PX,
    REACH,
    ROUNDS,
    STRIDE,
    TURN,
    Array,
    Mask,
)

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
    """Fit the change of a picture's order to the wave cos 2 pi N of the next frame.

    `expected`, the change that went before, over the time to the new frame; `gradient` of the order
    along rows and columns. Returns the change, fringes, the mean square of what it leaves of the
    wave, and the largest of any field in it, and of all together, fringes; None where too few
    orders are known.
    """
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
    start = _searched(basis, shown, faded, max(float(np.percentile(basis[0], MOSTLY)), 1e-3))
    solution = start.copy()
    ridge = _RIDGE * shown.size
    for _ in range(ROUNDS):
        residual, slope = _residual(basis[0], solution.astype(np.float32) @ basis, shown, faded)
        turned = basis * slope
        weighted = turned * on_flank(slope) * _weight(residual)
        matrix = (weighted @ turned.T).astype(float) + ridge * np.eye(len(basis))
        pull = weighted @ residual - ridge * (solution - start)
        solution = solution + np.linalg.solve(matrix, pull)
    single = solution.astype(np.float32)
    change = single @ basis
    residual, _ = _residual(basis[0], change, shown, faded)
    parts = np.percentile(np.abs(basis), MOSTLY, axis=1) * np.abs(solution)
    largest_change = np.percentile(np.abs(change), MOSTLY)
    # tilts of the factor and what the fringes move are judged by their sum alone
    largest = float(max(largest_change, parts[0], parts[6]))
    full_change = np.zeros_like(order)
    for share, shape in zip(single, fields, strict=True):
        full_change += share * shape
    return full_change, _mean_misfit(residual), largest


def on_flank(slope: Array) -> Array:
    """How far pixels tell a change of the order, by the slope of their wave dw/dN: 0 on a crest.

    Light that is not known exactly, by an e of the wave, stands off from a crest as the light of
    another order does, e/J away: such pixels are to follow the others, not to hold them up. Where
    the prediction is good to u, that is 1/(1 + (e/(J u))²), with twice the e that is usual.
    """
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
    contrast = 1.0 - np.float32(np.pi**2 / 6.0) * square
    return contrast, square, (along, across)


def _searched(basis: Array, shown: Array, faded: Array, top: float) -> Array:
    """Coefficients to start from: the best factor of N (first) alone, or after the fourth field."""
    best, solution, order = np.inf, np.zeros(len(basis)), basis[0]
    reach = LARGEST_CHANGE / top
    for goes_on in (0.0, 1.0):
        ahead = np.float32(goes_on) * basis[3]
        for factor in np.linspace(-reach, reach, _FACTORS):
            residual, _ = _residual(order, np.float32(factor) * order + ahead, shown, faded)
            misfit = _mean_misfit(residual)
            if misfit < best:
                best = misfit
                solution[0], solution[3] = factor, goes_on
    return solution


def _residual(order: Array, change: Array, shown: Array, faded: Array) -> tuple[Array, Array]:
    """What a change leaves of the wave, and how the wave answers to it."""
    angle = _TURN * (order + change)
    return shown - faded * np.cos(angle), -_TURN * faded * np.sin(angle)


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
    """Follow the orders into the next frame, or, with times that fall, into the one before.

    `wave` is its cos 2 pi N, `noise` the wave's standard deviation.
    """
    before = state.order
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
            return _lost(state, time)
        order, known = np.abs(before + change), state.known
        telling = weight * known * (steep < LARGEST_CHANGE**2)
        order = _corrected(order, wave, contrast, telling, noise)
    trust = weight * known
    residual = (wave - contrast * np.cos(_TURN * order)) * trust
    known = (
        known
        & (_window_mean(residual * residual, trust, POOLED_PX) < usual)
        & (steep < LARGEST_CHANGE**2)  # fringes are wide enough
        & (np.abs(order - before) < LARGEST_CHANGE)
    )
    if not known.any():
        return _lost(state, time)
    order = continued(order, known)
    change = cv2.GaussianBlur((order - before) * weight, (0, 0), POOLED_PX)
    rate = change / np.float32(apart) if apart else np.zeros_like(change)
    return FilmState(order=order, rate=rate, known=known, time=time)


def _lost(state: FilmState, time: float) -> FilmState:
    """Nothing is known from here on."""
    return replace(state, known=np.zeros_like(state.known), time=time, broken=True)


def _corrected(order: Array, wave: Array, contrast: Array, weight: Array, noise: float) -> Array:
    """The predicted orders as their neighbourhoods' light corrects them."""
    for width in WINDOWS:
        angle = _TURN * order
        residual = (wave - contrast * np.cos(angle)) * weight
        slope = -_TURN * contrast * np.sin(angle) * weight
        flank = on_flank(slope)
        spread = (noise**2 + (2.0 * np.pi * width**2) * SYSTEMATIC**2) / _SPREAD**2
        weight_of_slope = slope * flank
        informed = _window_sum(weight_of_slope * slope, width) + np.float32(spread)
        step = _window_sum(weight_of_slope * residual, width) / informed
        order = np.abs(order + step)
    fine = np.float32(_SMOOTHED) * (cv2.GaussianBlur(order, (0, 0), _SMOOTH_PX) - order)
    return np.asarray(order + np.where(order > _AT_FIRST, fine, np.float32(0.0)))


def _window_sum(values: Array, width_px: float) -> Array:
    """Sum over a Gaussian window whose weight is 1 in the middle."""
    kernel = cv2.getGaussianKernel(2 * int(np.ceil(2.5 * width_px)) + 1, width_px, cv2.CV_32F)
    area = np.float32(2.0 * np.pi * width_px**2)
    summed = cv2.sepFilter2D(values, cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(area * summed)


def _window_mean(values: Array, weight: Array, width_px: float) -> Array:
    """Mean over a Gaussian window of the pixels that count."""
    total = np.maximum(_window_sum(weight, width_px), np.float32(1e-3))
    return np.asarray(_window_sum(values * weight, width_px) / total)


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
    matrix = np.array(
        [[sums[a + c, b + d] for c, d in powers] for a, b in powers], dtype=float
    ).transpose(2, 0, 1)
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
        new, move = _borne_out(order, known, wave, valid)
        if not new.any():
            break
        order, known = np.where(new, np.abs(order + move), order), known | new
    return order, known


def _borne_out(order: Array, known: Mask, wave: Array, valid: Mask) -> tuple[Mask, Array]:
    """Which continued orders the light bears out, and how far it moves them (rows, cols)."""
    near = cv2.boxFilter(known.astype(np.float32), -1, (3, 3), normalize=False) > 2.5  # a plane's
    contrast, steep, _ = faded_fringes(order)
    angle = _TURN * order
    sine = np.sin(angle)
    flank = np.abs(sine) > _FLANK
    move = (wave - contrast * np.cos(angle)) / (-_TURN * contrast * np.where(flank, sine, np.inf))
    determined = flank & (np.abs(move) < SURE)  # less than to the crest, beyond which it is alike
    return near & ~known & valid & (steep < LARGEST_CHANGE**2) & determined, move
