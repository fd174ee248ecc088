"""Absolute fringe order and isoclinic angle from a phase-stepped set.

The steps' light gives cos δ, sin δ exp 2iθ and (1 - cos δ) exp 4iθ in every pixel
(`step_equations`), these the continuous direction up to 90° (`isoclinic`), along which δ is signed
and unwraps without the ambiguity (δ, θ) ~ (-δ, θ + 90°): n = (φ/2π + m) exp 2iθ does not change
with it. The whole number m of each connected part comes from the user's known orders, from
equilibrium and compatibility, or from a model (`anchor`, `integer_order`); a part that has none is
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
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import label

from isochrome.estimation import POOR_CHI
from isochrome.fringes.on_branch import OrderReading, make_reading
from isochrome.fringes.stepped.integer_order import FieldPart, KnownOrder
from isochrome.fringes.stepped.step_equations import StepTerms
from isochrome.fringes.stepped.step_light import (
    LARGEST_TURN,
    LARGEST_UNCERTAINTY,
    WINDOW_PX,
    SettledField,
    StepLight,
    measure_steps,
    settle_field,
    smoothed,
)
from isochrome.fringes.windows import Array, Mask, masked
from isochrome.messages import message
from isochrome.optics import Chain

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
    return ResidualStress(field, spread, known_share, _remarks(light, known_share), light.agrees)


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
    whole, _ = label(lit)
    parts, count = label(near)
    owner = np.zeros(count + 1, dtype=int)
    owner[parts.ravel()] = whole.ravel()
    most = np.bincount(parts.ravel()) > _MOST * np.bincount(whole.ravel())[owner]
    most[0] = False
    return most[parts], lit & ~np.isin(whole, owner[most])


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


def _remarks(light: StepLight, known_share: float) -> tuple[str, ...]:
    """What the user should know of the no-load set."""
    remarks = []
    if light.chi > POOR_CHI:
        lost = "" if light.agrees.any() else message("no_isoclinic_given_load")
        remarks.append(message("no_load_steps_chi", chi=light.chi, lost=lost))
    if known_share < _FEW:
        remarks.append(message("no_load_steps_only", known_share=100 * known_share))
    return tuple(remarks)


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
    settled = settle_field(
        light,
        known_order=known_order,
        model=model,
        residual=None if residual is None else residual.field,
    )
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
    lean = (shown / np.maximum(np.abs(shown), _TINY)) * np.conj(field / size)
    uncertainty, swing = (
        np.sqrt(np.square(a * lean.real) + np.square(b * lean.imag) + residual.uncertainty**2)
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
        reading=reading,
        isoclinic=masked(0.5 * np.degrees(np.angle(load.field)), turned),
        isoclinic_uncertainty=masked(np.degrees(load.turn), turned),
        dark_field=masked(0.5 - 0.5 * cosine, readable),
        contrast=light.contrast.astype(np.float32),
        chi=light.chi,
        parts=settled.parts,
        warnings=(*settled.warnings, *_of_steps(light, clear), *few),
    )


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
