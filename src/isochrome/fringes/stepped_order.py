"""Absolute fringe order and isoclinic angle from a phase-stepped set.

The steps' light gives cos δ, sin δ exp 2iθ and (1 - cos δ) exp 4iθ in every pixel
(`step_equations`), these the continuous direction up to 90° (`isoclinic`), along which δ is signed
and unwraps without the ambiguity (δ, θ) ~ (-δ, θ + 90°): n = (φ/2π + m) exp 2iθ does not change
with it. The whole number m of each connected part comes from the user's known orders, from
equilibrium and compatibility, or from a model (`integer_order`); a part that has none is
left unknown. A residual stress is taken off n (`read_residual`). Then N = |n| and θ = arg(n)/2.

The field of a residual stress, from a phase-stepped set of the unloaded specimen.

Stresses add up as tensors, and so do n = N exp 2iθ, which is the tensor's difference: the load's
own is n - n₀, not N - N₀. This holds for plane stress that is uniform through the thickness, where
the specimen is one retarder; where stress varies through it, retarders stand one behind the other,
and n adds up where they are weak or turned alike.

A residual stress is weak: below half an order sin δ > 0, and the steps' A sin δ exp 2iθ, A cos δ
are n₀ itself, pixel by pixel, with no direction to follow and no whole number to settle, as well
where it is nearly nil: n₀ = δ/2π exp 2iθ with δ = atan2(|A sin δ exp 2iθ|, A cos δ). Beyond, the
field is followed as a loaded one's is; its whole number comes from equilibrium (a residual stress
obeys no compatibility) or, where that does not tell, from most of the specimen being below half an
order. What cannot be followed, and might be beyond, is left unknown.
Source: Frocht (1941), Photoelasticity, vol. 1, for stresses that add up in one plane; Aben &
Guillemet (1993), Photoelasticity of Glass, for those that vary along the light.

What the light of a phase-stepped set says in each pixel, before any whole number is settled.

Least squares over the steps gives the maps of `step_equations`, these the direction of sigma_1
(`isoclinic`) and, with contrast and misfit, how far each pixel is to be trusted. A frame that
cannot be trusted in a pixel, saturated there or faulty, is left out of that pixel alone, where the
other frames still tell.

From what a stepped set's light says to the field n: unwrapped, settled, and smoothed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.ndimage import (
    binary_dilation,
    binary_opening,
    distance_transform_edt,
    gaussian_filter,
    label,
    maximum_filter,
)

from isochrome.estimation import POOR_CHI
from isochrome.fringes.integer_order import (
    Direction,
    FieldPart,
    KnownOrder,
    find_direction,
    settle,
    unwrap,
)
from isochrome.fringes.on_branch import SURE, OrderReading, make_reading
from isochrome.fringes.step_equations import (
    BACKGROUND,
    COSINE,
    CROSS,
    CROSS_SINE,
    SINE,
    SINE_SINE,
    StepDesign,
    StepTerms,
    make_design,
    solve_steps,
)
from isochrome.fringes.windows import Array, Mask, masked, pooled
from isochrome.messages import message
from isochrome.optics import Chain

STEEPEST = 0.4
"""Fringes a pixel: beyond half a fringe phase turns back on itself."""

WINDOW_PX = 1.2
LARGEST_TURN = np.radians(2.0)
"""Standard uncertainty of θ (rad) beyond which a direction is not known."""

_COHERENT = 0.7
_LOST = 0.15
"""Scatter of θ (rad) at which a break of 90 degrees in θ, 45 either way, is five of it."""

_SMOOTH = 0.18
"""Fringes over a window of one standard deviation, beyond which smoothing would bend n."""


@dataclass(frozen=True)
class SettledField:
    """n = N exp 2iθ (rows, cols), complex, fringes, of `known` pixels, NaN elsewhere.

    `parts`, the connected parts and what settled their whole numbers; `warnings` in plain words.
    """

    field: Array
    known: Mask
    parts: tuple[FieldPart, ...]
    warnings: tuple[str, ...]


def settle_field(
    light: StepLight,
    *,
    known_order: Sequence[KnownOrder] = (),
    model: Callable[[], Array] | None = None,
    residual: Array | None = None,
    compatible: bool = True,
) -> SettledField:
    """The field n of a set, with the whole numbers that phase leaves open, see `settle`."""
    direction = light.direction
    terms = light.terms  # φ/2π unwrapped along the direction
    phase = np.arctan2((terms.sine * np.conj(direction.twice)).real, terms.cosine)
    turns = unwrap(phase, light.seen) / (2.0 * np.pi)
    # where the direction turns within its window the sign of sin δ is open; no harm near N = 0
    open_sign = np.abs(terms.sine) > 2.0 * np.pi * LARGEST_UNCERTAINTY * np.abs(terms.cosine)
    known = light.seen & np.isfinite(turns) & ~(open_sign & (direction.coherence < _COHERENT))
    if residual is not None:
        known &= np.isfinite(residual)
    # nearer to a whole order than to be told from zero, a sign that breaks may do no harm
    known = _solid(known & ~_broken(turns - np.rint(turns), turns, direction))

    settled = partial(settle, turns, direction, known_order=known_order, model=model)
    settled = partial(settled, residual=residual, compatible=compatible)
    numbers, parts, warnings = settled(known)
    harmful = known & _broken(np.nan_to_num(turns + numbers), turns, direction)
    if harmful.any():
        known = _solid(known & ~harmful)
        numbers, parts, warnings = settled(known)
    known &= np.isfinite(numbers)
    field = np.where(known, (turns + numbers) * direction.twice, np.nan)
    return SettledField(field, known, parts, warnings)


def _broken(order: Array, turns: Array, direction: Direction) -> Mask:
    """Where fringes are too steep, or the sign of the direction breaks between neighbours.

    A broken sign does harm where the signed order is not zero, or a direction is seen; one that is
    lost over a wide window, in noise or in elements a little off, may have broken unseen.
    """
    loaded = np.abs(order) > SURE
    off = loaded | (direction.uncertainty < LARGEST_TURN)
    broken = np.zeros(turns.shape, dtype=bool)
    for axis in (0, 1):
        here, twice, may, estimate = (
            values.swapaxes(0, axis) for values in (turns, direction.twice, off, broken)
        )
        flipped = (twice[1:] * np.conj(twice[:-1])).real < 0.0
        steep = (np.abs(np.diff(here, axis=0)) > STEEPEST) | (flipped & may[1:])
        estimate[1:] |= steep
        estimate[:-1] |= steep
    return np.asarray(binary_dilation(broken) | (loaded & (direction.bridge > _LOST)))


def _solid(known: Mask) -> Mask:
    """Without slivers under three pixels: what is left between breaks hangs on by chance."""
    return np.asarray(binary_opening(np.pad(known, 2, mode="edge"), np.ones((3, 3))))[2:-2, 2:-2]


def smoothed(
    field: Array, uncertainty: Array, known: Mask, *, window_px: float = WINDOW_PX
) -> tuple[Array, Array]:
    """n under a kernel that leaves quadratics as they are, where its whole support is known.

    2 G(w) - G(√2 w), G a Gaussian of standard deviation w, has no second moment; white noise is
    left with the factor √(0.458/π)/w of it. Where fringes are fine, or beside a mask, n stays that
    of the pixel.
    """
    filled = np.where(known, field, 0.0).astype(np.complex64)
    narrow, wide = (gaussian_filter(filled, w * window_px, truncate=3.0) for w in (1.0, 2**0.5))
    smooth = 2.0 * narrow - wide
    rows, cols = np.gradient(np.abs(smooth))
    depth = distance_transform_edt(np.pad(known, 1))[1:-1, 1:-1]
    use = known & (depth > 4.5 * window_px) & (np.hypot(rows, cols) * window_px < _SMOOTH)
    gain = np.sqrt(0.458 / np.pi) / window_px
    return np.where(use, smooth, field), np.where(use, gain * uncertainty, uncertainty)


LARGEST_UNCERTAINTY = 0.03
"""Fringes: a pixel whose noise is more is not known."""

_PASSES = 3
"""Solutions where the steps leave something out, each with the direction of the one before."""

_LOCAL = 0.05
"""Share of the pixels that dust or glare may spoil, before it is the steps that do not fit."""

_COMPARED = 0.5
"""Share of the window that must be seen for its misfit to tell."""

_LARGEST_MISFIT = 0.1
_MOST_NOISE = 3.0
"""Times the noise of the whole set that a pixel may have for want of some of its frames."""

_LEAST_CONTRAST = 0.7
"""Of the contrast around: a pixel's area takes that much of it at 0.45 fringe a pixel."""

_DIMMEST = 0.1
_BLOCK = 16
_WINDOW_PX = 2.0


@dataclass(frozen=True, kw_only=True)
class StepLight:
    """What a set's light says; maps (rows, cols)."""

    terms: StepTerms
    direction: Direction
    seen: Mask  # the fringes can be read
    specimen: Mask  # light comes through at all
    contrast: Array  # A V, in the light's unit
    uncertainty: Array  # of φ/2π, fringes
    chi: float  # residual of the light over its noise
    # the steps tell no direction about half orders, or leave out what changes it there
    bridges: bool
    agrees: Mask  # the light fits the steps, whose angles the direction follows


def measure_steps(
    stack: Array, chains: Sequence[Chain], *, sigma: Array | float, valid: Mask | None = None
) -> StepLight:
    """Read δ, the direction of sigma_1 and their noise from the images of a set's steps.

    `valid`, True = trusted, (rows, cols) or frame by frame, (steps, rows, cols). InputError where
    the steps cannot tell the order.
    """
    design = make_design(chains)
    light = np.asarray(stack, dtype=np.promote_types(stack.dtype, np.float32))
    good = np.isfinite(light)
    good = good if valid is None else good & valid
    light, gain, turn_gain = fill_gaps(np.where(good, light, 0.0), good, design)
    trusted, complete, swing = np.isfinite(gain), good.all(axis=0), sigma
    if (gain > 1.0).any():
        swing, sigma = sigma * np.fmax(turn_gain, 1.0), sigma * np.fmax(gain, 1.0)
    twice = None
    for _ in range(_PASSES if design.leaks else 1):
        terms = solve_steps(light, design, twice)
        direction = find_direction(terms, design, sigma=swing, valid=trusted)
        twice = direction.twice
    contrast = np.hypot(terms.cosine, np.abs(terms.sine))
    readable = trusted & bright_enough(contrast, trusted)
    misfit, chi = step_misfit(light, design, sigma, readable & complete)
    agrees = steps_agree(misfit, readable & complete)
    direction = direction.noisier(np.maximum(misfit, 1.0))
    uncertainty = phase_uncertainty(terms, design, direction, sigma) * np.maximum(misfit, 1.0)
    readable &= (uncertainty < LARGEST_UNCERTAINTY) & (
        misfit * sigma < np.maximum(_LARGEST_MISFIT * contrast, 2.0 * sigma)
    )
    return StepLight(
        terms=terms, direction=direction, seen=readable,
        specimen=trusted & fringed(contrast, design, sigma), contrast=contrast,
        uncertainty=uncertainty, chi=chi, bridges=design.leaks, agrees=agrees,
    )  # fmt: skip


def fill_gaps(light: Array, good: Mask, design: StepDesign) -> tuple[Array, Array, Array]:
    """Give frames that cannot be trusted in a pixel (nought there) the light that the others ask.

    I = M x there, x the least squares of the others, which is that of all together then. Also how
    many times the noise is a whole pixel's, at most of any unknown, and of those that tell the
    direction (rows, cols): 1 where all are there, NaN where the rest cannot tell the order. Source:
    Yates (1933), Empire J. Exp. Agric. 1, 129 (missing observations in least squares).
    """
    gains = np.where(good.all(axis=0), 1.0, np.nan)[None].repeat(2, axis=0).astype(np.float32)
    wanting = np.isnan(gains[0]) & good.any(axis=0)
    if design.leaks or not wanting.any():
        return light, gains[0], gains[1]
    code = np.int64(1) << np.arange(len(light), dtype=np.int64)
    kinds = np.tensordot(code, good[:, wanting].astype(np.int64), axes=1)
    values, noise = light[:, wanting], np.full((2, kinds.size), np.nan, dtype=np.float32)
    for kind in np.unique(kinds):
        present, here = (kind & code) > 0, kinds == kind
        inverse, *more = _part_inverse(design, present)
        if more[0] <= _MOST_NOISE:
            missing = design.matrix[~present][:, design.solved] @ inverse
            chosen = values[np.ix_(present, here)]
            values[np.ix_(~present, here)] = missing.astype(light.dtype) @ chosen
            noise[:, here] = np.reshape(more, (2, 1))
    filled = light.copy()
    filled[:, wanting] = values
    gains[:, wanting] = noise
    return filled, gains[0], gains[1]


def _part_inverse(design: StepDesign, present: Mask) -> tuple[Array, float, float]:
    """Least squares over some of the frames, and the growth of the unknowns' noise by it.

    The largest, and the mean of those that tell the direction; the background is not used, and
    counts for nothing.
    """
    part = design.matrix[present][:, design.solved]
    inverse = np.linalg.pinv(part)
    if np.linalg.matrix_rank(part, tol=1e-6) < len(design.solved):
        return inverse, float("inf"), float("inf")
    growth = np.square(inverse).sum(axis=1) / np.diag(design.covariance)
    unknowns = np.array(design.solved)
    largest = growth[unknowns != BACKGROUND].max()
    turning = growth[np.isin(unknowns, (CROSS, CROSS_SINE, SINE, SINE_SINE))].mean()
    return inverse, float(np.sqrt(largest)), float(np.sqrt(turning))


def bright_enough(contrast: Array, trusted: Mask) -> Mask:
    """Where the fringes' contrast A V is near that of the surroundings: elsewhere they are too
    fine.

    A pixel's area leaves sinc(g_x) sinc(g_y) of it, g the gradient in fringes a pixel; beyond half
    a fringe a pixel phase turns back on itself, and only the contrast tells.
    """
    import cv2

    brightest = float(np.percentile(contrast[trusted], 90)) if trusted.any() else 0.0
    rows, cols = (n // _BLOCK for n in contrast.shape)
    floor = contrast > _DIMMEST * brightest
    if min(rows, cols) < 1:
        return np.asarray(floor)
    cut = np.where(trusted, contrast, 0.0)[: rows * _BLOCK, : cols * _BLOCK]
    blocks = cut.reshape(rows, _BLOCK, cols, _BLOCK).swapaxes(1, 2).reshape(rows, cols, -1)
    usual = maximum_filter(np.percentile(blocks, 80, axis=2), 3).astype(np.float32)
    around = cv2.resize(usual, contrast.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(floor & (contrast > _LEAST_CONTRAST * around))


def fringed(contrast: Array, design: StepDesign, sigma: Array | float) -> Mask:
    """Where light comes through at all, coarse fringes or fine: the specimen, not a dark
    surround.
    """
    noise = sum(design.variance(j) for j in (COSINE, SINE, SINE_SINE)) * np.square(sigma)
    power = pooled(contrast**2 - noise, _WINDOW_PX)
    return np.asarray(power > (2.0 * _DIMMEST) ** 2 * np.percentile(power, 90))


def step_misfit(
    light: Array, design: StepDesign, sigma: Array | float, readable: Mask
) -> tuple[Array, float]:
    """Residual of the light over its noise, pooled about each pixel, and over all of them.

    What no choice of the seven unknowns can explain: moved or dirty elements, a wrong gamma. 1
    where the steps leave nothing to compare, and chi, NaN then.
    """
    directions, values, _ = np.linalg.svd(design.matrix)
    rank = int((values > 1e-6).sum())
    free = len(light) - rank
    if free == 0:
        return np.ones(light.shape[1:]), float("nan")
    over = np.tensordot(directions[:, rank:].T.astype(light.dtype), light, axes=1)
    square = (over**2).sum(axis=0) / (free * np.square(sigma))
    weight = np.maximum(pooled(readable, _WINDOW_PX), 1e-6)
    misfit = np.sqrt(np.maximum(pooled(np.where(readable, square, 0.0), _WINDOW_PX), 0.0) / weight)
    return misfit, float(np.sqrt(np.mean(square[readable]))) if readable.any() else float("nan")


def steps_agree(misfit: Array, readable: Mask) -> Mask:
    """Where the light fits the steps as they are stated, so that its direction may be believed.

    An element that is off turns the direction everywhere, also where the light hardly shows it:
    where most of the picture does not fit, nothing of it is believed; where a part does not, that
    part.
    """
    least = np.sort(misfit[readable])[: int((1.0 - _LOCAL) * np.count_nonzero(readable))]
    usual = float(np.sqrt(np.mean(np.square(least)))) if least.size else 1.0
    if usual > POOR_CHI:
        return np.zeros(misfit.shape, dtype=bool)
    isolated = pooled(readable, _WINDOW_PX) < _COMPARED  # too few about it to compare with
    return np.asarray(isolated | (misfit <= POOR_CHI * max(usual, 1.0)))


def phase_uncertainty(
    terms: StepTerms, design: StepDesign, direction: Direction, sigma: Array | float
) -> Array:
    """Standard uncertainty of φ/2π from the noise, φ = atan2(A sin δ, A cos δ) along the direction.

    var φ = σ² gᵀ Σ g with g = (-sin φ, cos φ cos 2θ, cos φ sin 2θ)/(A V). Source: propagation of
    uncertainty, first order (JCGM 100:2008, 5.1.2).
    """
    along = (terms.sine * np.conj(direction.twice)).real
    contrast = np.hypot(terms.cosine, along) + 1e-30
    cosine = terms.cosine / contrast
    slopes = (-along / contrast, cosine * direction.twice.real, cosine * direction.twice.imag)
    total = np.zeros(cosine.shape, dtype=cosine.dtype)
    for i, first in enumerate((COSINE, SINE, SINE_SINE)):
        total += design.variance(first) * slopes[i] ** 2
        for j, second in enumerate((COSINE, SINE, SINE_SINE)[:i]):
            if abs(design.variance(first, second)) > 1e-12:
                total += 2.0 * design.variance(first, second) * slopes[i] * slopes[j]
    return np.asarray(sigma * np.sqrt(total) / contrast / (2.0 * np.pi))


_WINDOWS_PX = (WINDOW_PX, 2.0, 4.0)
_NEAR_HALF = 0.4
"""Order beyond which noise, or fringes, may lead past the half order, where the least one ends."""

_APART = 0.25
_MOST = 0.5
"""Of the pixels that hang together: a part so large, below half an order, is believed to be so."""

_LEAST_SINE = 0.3

_FEW = 0.9
_TELLING = 3.0
_SURELY = 5.5
"""Standard uncertainties that the largest of a million pixels of noise does not reach."""


@dataclass(frozen=True)
class ResidualStress:
    """The field n₀ = N exp 2iθ (rows, cols) of a residual stress, fringes; NaN = not known."""

    field: Array
    uncertainty: Array  # standard, of N, and of N times twice the angle
    kept: float  # share of the specimen that is known
    warnings: tuple[str, ...]  # in plain words
    # where the no-load light fits the steps: its direction may be believed
    agrees: Mask | bool = True

    @property
    def order(self) -> Array:
        """The residual stress's own fringe order (rows, cols) float32."""
        return np.abs(self.field).astype(np.float32)

    @property
    def largest(self) -> float:
        """The largest order that stands out of its noise, 0 where none does (fringes)."""
        order = np.abs(self.field)
        return float(np.max(order, where=order > _SURELY * self.uncertainty, initial=0.0))

    @property
    def isoclinic(self) -> Array:
        """Its direction of sigma_1 (rows, cols) float32, degrees.

        NaN where it is nearly nil, and where the light does not fit the steps.
        """
        known = (np.abs(self.field) > _TELLING * self.uncertainty) & self.agrees
        return np.where(known, 0.5 * np.degrees(np.angle(self.field)), np.nan).astype(np.float32)


def read_residual(
    stack: Array, chains: Sequence[Chain], *, sigma: Array | float, valid: Mask | None = None
) -> ResidualStress:
    """Read the residual stress from the images (steps, rows, cols) of an unloaded specimen's steps.

    Equations: the module's. One chain a step; `sigma` in the light's unit; `valid` for all frames
    or each. InputError where the steps cannot tell the order.
    """
    light = measure_steps(stack, chains, sigma=sigma, valid=valid)
    field, along = least_field(light.terms), light.uncertainty
    lit = light.specimen | light.seen
    main, free = _main_parts(lit, light.seen & (np.abs(field) < _NEAR_HALF))
    followed = settle_field(
        light, model=lambda: np.where(main, np.abs(field), np.nan), compatible=False
    )
    clear = followed.known & direction_known(light)
    beyond, least = _believed(main, free, clear, np.abs(followed.field - field) > _APART)
    sharp = np.hypot(along, 2.0 * np.abs(followed.field) * light.direction.uncertainty)
    across = least_spread(field, along)
    least &= ~(beyond & (sharp < across))
    spread = np.where(least, across, sharp)
    known = (least | beyond) & (spread < LARGEST_UNCERTAINTY)
    field = np.where(known, np.where(least, field, followed.field), np.nan)
    pooled, less = field, spread
    for window in _WINDOWS_PX:  # the widest that it allows: a residual stress varies little
        smooth, smooth_spread = smoothed(field, spread, known, window_px=window)
        wider = smooth_spread < less
        pooled, less = np.where(wider, smooth, pooled), np.where(wider, smooth_spread, less)
    field, spread = pooled, less
    known_share = float(known.sum() / max(1, np.count_nonzero(known | light.specimen)))
    spread = np.where(known, spread, np.nan)
    remarks = []
    if light.chi > POOR_CHI:
        lost = "" if light.agrees.any() else message("no_isoclinic_given_load")
        remarks.append(message("no_load_steps_chi", chi=light.chi, lost=lost))
    if known_share < _FEW:
        remarks.append(message("no_load_steps_only", known_share=100 * known_share))
    return ResidualStress(field, spread, known_share, tuple(remarks), light.agrees)


def least_field(terms: StepTerms) -> Array:
    """n of the least order that the light allows, 1/2 at most, pixel by pixel: N exp 2iθ, see the
    module.
    """
    size = np.abs(terms.sine)
    order = np.arctan2(size, terms.cosine) / (2.0 * np.pi)
    return np.asarray(order * terms.sine / np.maximum(size, 1e-30))


def least_spread(field: Array, along: Array) -> Array:
    """The noise of `least_field`, the larger of that along n and across.

    Across n it is that of N along, times δ/sin δ, which grows towards the half order.
    """
    delta = 2.0 * np.pi * np.minimum(np.abs(field), _NEAR_HALF)
    return np.asarray(along * np.fmax(1.0, delta / np.maximum(np.sin(delta), 1e-9)))


def direction_known(light: StepLight) -> Mask:
    """Where the steps tell the direction: without plane images, not about half orders.

    There sin δ, which alone tells, is of the size of what is left out.
    """
    sine, cosine = np.abs(light.terms.sine), light.terms.cosine
    if not light.bridges:
        return np.ones(sine.shape, dtype=bool)
    return np.asarray((cosine > 0.0) | (sine > _LEAST_SINE * light.contrast))


def _main_parts(lit: Mask, near: Mask) -> tuple[Mask, Mask]:
    """Where the order is below a half for most of what hangs together, and pixels of connected
    parts of the specimen without such a part. `near`, where its least order is well below a half.
    """
    labels, _ = label(lit)
    parts, count = label(near)
    owner = np.zeros(count + 1, dtype=int)
    owner[parts.ravel()] = labels.ravel()
    most = np.bincount(parts.ravel()) > _MOST * np.bincount(labels.ravel())[owner]
    most[0] = False
    return most[parts], lit & ~np.isin(labels, owner[most])


def _believed(main: Mask, free: Mask, clear: Mask, apart: Mask) -> tuple[Mask, Mask]:
    """Where the followed field is believed, and where the least one is.

    The followed one in parts that reach into a main part or have none: what lies behind a half
    order that could not be followed has the whole number of nothing. The least one in main parts
    that it does not gainsay.
    """
    labels, count = label(clear)
    reaches = np.bincount(labels[main & clear], minlength=count + 1) > 0
    parts, count = label(main)
    gainsaid = np.bincount(parts[main & clear & apart], minlength=count + 1) > 0
    return clear & (reaches[labels] | free), main & ~gainsaid[parts]


_LEAST_ORDER = 4.0
_TINY = 1e-9
_SMALL = 0.15
"""Order below which the least order that the light allows is the order."""

_SMOOTHED = 0.928
"""Of the direction's noise, which is pooled already, what smoothing n leaves: from the kernels'
Gaussians of widths w = 1.2 and W = 1.6, W² (4/(W² + w²) - 4/(W² + 1.5 w²) + 1/(W² + 2 w²))."""

_NOTABLE = 0.02
"""Share of the directions that is left out and said."""

_BRIDGED = 0.1
"""Doubt of 2θ (rad) where the direction is bridged."""


@dataclass(frozen=True, kw_only=True)
class SteppedReading:
    """What a phase-stepped set tells; maps (rows, cols) float32, NaN = not known.

    All maps are of the load alone where a residual stress was taken out.
    """

    reading: OrderReading
    # direction of sigma_1, degrees counter-clockwise from the image's +x, -90 to 90; NaN too
    # where the light does not fit the steps, whose angles it follows
    isoclinic: Array
    isoclinic_uncertainty: Array  # standard, degrees
    dark_field: Array  # ideal, (1 - cos δ)/2
    contrast: Array  # A V, in the light's unit
    chi: float  # residual of the light over its noise; NaN: the steps leave none
    parts: tuple[FieldPart, ...]  # connected, and what settled their whole numbers
    warnings: tuple[str, ...]  # in plain words

    @property
    def order(self) -> Array:
        """The fringe order (rows, cols)."""
        return self.reading.order


@dataclass(frozen=True)
class _Parts:
    """n, the noise of |n| and of arg(n)/2 (fringes, rad), and where n is known (rows, cols)."""

    field: Array
    uncertainty: Array
    turn: Array
    known: Mask


def read_steps(
    stack: Array,
    chains: Sequence[Chain],
    *,
    sigma: Array | float,
    valid: Mask | None = None,
    known_order: Sequence[KnownOrder] = (),
    model: Callable[[], Array] | None = None,
    residual: ResidualStress | None = None,
) -> SteppedReading:
    """Read order and isoclinic angle of one state from the images (steps, rows, cols) of its steps.

    Equations: the module's. Not known: masked, low contrast, noise over 0.03 fringe, fringes finer
    than 2.5 pixels, a part's whole number open, or the residual not known. A frame not `valid` is
    left out there. `known_order` (row, col, N) and `model`, called where nothing else tells, are
    orders that the frames show, residual stress and all. InputError as `read_residual`.
    """
    light = measure_steps(stack, chains, sigma=sigma, valid=valid)
    field = None if residual is None else residual.field
    settled = settle_field(light, known_order=known_order, model=model, residual=field)
    return _result(light, settled, _of_load(light, settled, residual), residual)


def _of_load(light: StepLight, settled: SettledField, residual: ResidualStress | None) -> _Parts:
    """n of the load alone, smoothed, with its noise along and across it.

    The noise of N and θ lies along and across the n that the frames show; the angle between that
    and the load's own turns it.
    """
    known = settled.known
    shown = np.where(known, settled.field, 0.0)
    across = 2.0 * np.abs(shown) * light.direction.uncertainty
    if residual is not None:
        across = np.hypot(across, np.where(direction_known(light), 0.0, _BRIDGED * np.abs(shown)))
    small = known & (np.abs(shown) < _SMALL)
    # about an isotropic point and in a valley the window's direction is that of the pixels around,
    # or noise; that of the pixel's own light is not
    least = least_field(light.terms)
    shown = np.where(small, least, shown)
    across = np.where(small, least_spread(least, light.uncertainty), across)
    field = shown if residual is None else np.where(known, shown - residual.field, 0.0)
    field, along = smoothed(field, light.uncertainty, known)
    size = np.maximum(np.abs(field), _TINY)
    if residual is None:
        gain = along / np.maximum(light.uncertainty, _TINY)
        direction = light.direction
        less = np.where(gain < 1.0, 1.0 - _SMOOTHED**2, 0.0) * np.square(direction.scatter)
        turn = np.sqrt(np.square(direction.uncertainty) - less)
        return _Parts(field, along, np.where(small, gain * across / (2.0 * size), turn), known)
    unit = (shown / np.maximum(np.abs(shown), _TINY)) * np.conj(field / size)
    uncertainty, swing = (
        np.sqrt(np.square(a * unit.real) + np.square(b * unit.imag) + residual.uncertainty**2)
        for a, b in ((along, across), (across, along))
    )
    known = known & (uncertainty < LARGEST_UNCERTAINTY)
    return _Parts(field, uncertainty, swing / (2.0 * size), known)


def _result(
    light: StepLight, settled: SettledField, load: _Parts, residual: ResidualStress | None
) -> SteppedReading:
    """The maps, NaN where they are not known; `residual`, what was taken out."""
    known, uncertainty = load.known, load.uncertainty
    # nearer to zero its sign is noise
    clear = known & (load.turn < LARGEST_TURN) & (np.abs(load.field) > _LEAST_ORDER * uncertainty)
    turned = clear & light.agrees & (True if residual is None else residual.agrees)

    specimen = known | light.specimen
    reading = make_reading(np.abs(load.field), uncertainty, known, of=specimen)
    if residual is not None:
        cosine, readable = np.cos(2.0 * np.pi * reading.order), known
    else:
        cosine, readable = light.terms.cosine / np.maximum(light.contrast, 1e-30), specimen
    few = []
    if reading.kept < 0.5 and all(part.number is not None for part in settled.parts):
        few.append(message("only_specimen_pixels_could_read", kept=100 * reading.kept))
    return SteppedReading(
        reading=reading, isoclinic=masked(0.5 * np.degrees(np.angle(load.field)), turned),
        isoclinic_uncertainty=masked(np.degrees(load.turn), turned),
        dark_field=masked(0.5 - 0.5 * cosine, readable), contrast=light.contrast.astype(np.float32),
        chi=light.chi, parts=settled.parts,
        warnings=(*settled.warnings, *_of_steps(light, clear), *few),
    )  # fmt: skip


def _of_steps(light: StepLight, clear: Mask) -> list[str]:
    """What to say where the light does not fit the steps; `clear`, where it has a direction."""
    lost = float(np.mean(~light.agrees[clear])) if clear.any() else 0.0
    remarks = []
    if light.chi > POOR_CHI:
        none = "" if light.agrees.any() else ": no isoclinic is given"
        remarks.append(message("chi_steps_angles_plates", chi=light.chi, none=none))
    if _NOTABLE < lost < 1.0:
        remarks.append(message("no_isoclinic_given_pixels", lost=100.0 * lost, poor_chi=POOR_CHI))
    return remarks
