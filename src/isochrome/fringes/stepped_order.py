"""Absolute fringe order and isoclinic angle from a phase-stepped set.

The steps' light gives cos δ, sin δ exp 2iθ and (1 - cos δ) exp 4iθ in every pixel
(`step_equations`), these the continuous direction up to 90°, along which δ is signed and
unwraps without the ambiguity (δ, θ) ~ (-δ, θ + 90°): n = (φ/2π + m) exp 2iθ does not change
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
)

from isochrome.estimation import POOR_CHI
from isochrome.fringes.integer_order import FieldPart, KnownOrder, settle
from isochrome.fringes.on_branch import LARGEST_UNCERTAINTY, SURE, OrderReading, make_reading
from isochrome.fringes.step_equations import Direction, StepLight, StepTerms, measure_steps, unwrap
from isochrome.fringes.windows import Array, Mask, masked
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


def settle_field(
    light: StepLight,
    *,
    known_order: Sequence[KnownOrder] = (),
    model: Callable[[], Array] | None = None,
    residual: Array | None = None,
    compatible: bool = True,
) -> tuple[Array, tuple[FieldPart, ...], tuple[str, ...]]:
    """The field n of a set, with the whole numbers that phase leaves open, see `settle`.

    It is N exp 2iθ (rows, cols), complex, fringes, NaN = not known; then the connected parts and
    what settled their whole numbers, and warnings.
    """
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
    return np.where(known, (turns + numbers) * direction.twice, np.nan), parts, warnings


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
    followed, *_ = settle_field(
        light, model=lambda: np.where(main, np.abs(field), np.nan), compatible=False
    )
    clear = np.isfinite(followed) & direction_known(light)
    beyond, least = _believed(main, free, clear, np.abs(followed - field) > _APART)
    sharp = np.hypot(along, 2.0 * np.abs(followed) * light.direction.uncertainty)
    across = least_spread(field, along)
    least &= ~(beyond & (sharp < across))
    spread = np.where(least, across, sharp)
    known = (least | beyond) & (spread < LARGEST_UNCERTAINTY)
    field = np.where(known, np.where(least, field, followed), np.nan)
    pooled, less = field, spread
    for window in _WINDOWS_PX:  # the widest that it allows: a residual stress varies little
        smooth, smooth_spread = smoothed(field, spread, known, window_px=window)
        wider = smooth_spread < less
        pooled, less = np.where(wider, smooth, pooled), np.where(wider, smooth_spread, less)
    known_share = float(known.sum() / max(1, np.count_nonzero(known | light.specimen)))
    spread = np.where(known, less, np.nan)
    remarks = []
    if light.chi > POOR_CHI:
        lost = "" if light.agrees.any() else message("no_isoclinic_given_load")
        remarks.append(message("no_load_steps_chi", chi=light.chi, lost=lost))
    if known_share < _FEW:
        remarks.append(message("no_load_steps_only", known_share=100 * known_share))
    return ResidualStress(pooled, spread, known_share, tuple(remarks), light.agrees)


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
    told = np.abs(light.terms.sine) > _LEAST_SINE * light.contrast
    return np.asarray((not light.bridges) | (light.terms.cosine > 0.0) | told)


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
    unloaded = None if residual is None else residual.field
    shown, parts, warnings = settle_field(
        light, known_order=known_order, model=model, residual=unloaded
    )
    field, uncertainty, turn, known = _of_load(light, shown, residual)
    # nearer to zero its sign is noise
    clear = known & (turn < LARGEST_TURN) & (np.abs(field) > _LEAST_ORDER * uncertainty)
    turned = clear & light.agrees & (True if residual is None else residual.agrees)

    specimen = known | light.specimen
    reading = make_reading(np.abs(field), uncertainty, known, of=specimen)
    if residual is not None:
        cosine, readable = np.cos(2.0 * np.pi * reading.order), known
    else:
        cosine, readable = light.terms.cosine / np.maximum(light.contrast, 1e-30), specimen
    few = []
    if reading.kept < 0.5 and all(part.number is not None for part in parts):
        few.append(message("only_specimen_pixels_could_read", kept=100 * reading.kept))
    return SteppedReading(
        reading=reading, isoclinic=masked(0.5 * np.degrees(np.angle(field)), turned),
        isoclinic_uncertainty=masked(np.degrees(turn), turned),
        dark_field=masked(0.5 - 0.5 * cosine, readable), contrast=light.contrast.astype(np.float32),
        chi=light.chi, parts=parts, warnings=(*warnings, *_of_steps(light, clear), *few),
    )  # fmt: skip


def _of_load(
    light: StepLight, shown: Array, residual: ResidualStress | None
) -> tuple[Array, Array, Array, Mask]:
    """n of the load alone, smoothed, with its noise along and across it.

    The noise of N and θ lies along and across the n that the frames show; the angle between that
    and the load's own turns it. Returns n, the noise of |n| and of arg(n)/2 (fringes, rad), and
    where n is known.
    """
    known = np.isfinite(shown)
    shown = np.where(known, shown, 0.0)
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
        return field, along, np.where(small, gain * across / (2.0 * size), turn), known
    unit = (shown / np.maximum(np.abs(shown), _TINY)) * np.conj(field / size)
    uncertainty, swing = (
        np.sqrt(np.square(a * unit.real) + np.square(b * unit.imag) + residual.uncertainty**2)
        for a, b in ((along, across), (across, along))
    )
    known = known & (uncertainty < LARGEST_UNCERTAINTY)
    return field, uncertainty, swing / (2.0 * size), known


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
