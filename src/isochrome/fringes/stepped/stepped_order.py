r"""Absolute fringe order and isoclinic angle from a phase-stepped set.

The steps' light gives cos δ, sin δ exp 2iθ and (1 - cos δ) exp 4iθ in every pixel
(`step_equations`), these the continuous direction up to 90° (`isoclinic`), along which δ is signed
and unwraps without the ambiguity (δ, θ) ~ (-δ, θ + 90°): n = (φ/2π + m) exp 2iθ does not change
with it. The whole number m of each connected part comes from the user's known orders, from
equilibrium and compatibility, or from a model (`anchor`, `integer_order`); a part that has none is
left unknown. A residual stress is taken off n (`residual_stress`). Then N = |n| and θ = arg(n)/2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from isochrome.estimation import POOR_CHI
from isochrome.fringes.on_branch import OrderReading, make_reading
from isochrome.fringes.stepped.integer_order import FieldPart, KnownOrder
from isochrome.fringes.stepped.residual_stress import (
    ResidualStress,
    direction_known,
    least_field,
    least_spread,
)
from isochrome.fringes.stepped.step_field import LARGEST_TURN, SettledField, settle_field, smoothed
from isochrome.fringes.stepped.step_light import LARGEST_UNCERTAINTY, StepLight, measure_steps
from isochrome.fringes.windows import Array, Mask, masked
from isochrome.optics import Chain

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
    found = settle_field(
        light,
        known_order=known_order,
        model=model,
        residual=None if residual is None else residual.field,
    )
    return _result(light, found, _of_load(light, found, residual), residual)


def _of_load(light: StepLight, found: SettledField, residual: ResidualStress | None) -> _Parts:
    """n of the load alone, smoothed, with its noise along and across it.

    The noise of N and θ lies along and across the n that the frames show; the angle between that
    and the load's own turns it.
    """
    known = found.known
    shown = np.where(known, found.field, 0.0)
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
    light: StepLight, found: SettledField, load: _Parts, residual: ResidualStress | None
) -> SteppedReading:
    """The maps, NaN where they are not known; `residual`, what was taken out."""
    known, uncertainty = load.known, load.uncertainty
    # nearer to zero its sign is noise
    clear = known & (load.turn < LARGEST_TURN) & (np.abs(load.field) > _LEAST_ORDER * uncertainty)
    turned = clear & light.agrees & (True if residual is None else residual.agrees)

    specimen = known | light.specimen
    reading = make_reading(np.abs(load.field), uncertainty, known, of=specimen)
    if residual is not None:
        cosine, seen = np.cos(2.0 * np.pi * reading.order), known
    else:
        cosine, seen = light.terms.cosine / np.maximum(light.contrast, 1e-30), specimen
    return SteppedReading(
        reading=reading,
        isoclinic=masked(0.5 * np.degrees(np.angle(load.field)), turned),
        isoclinic_uncertainty=masked(np.degrees(load.turn), turned),
        dark_field=masked(0.5 - 0.5 * cosine, seen),
        contrast=light.contrast.astype(np.float32),
        chi=light.chi,
        parts=found.parts,
        warnings=(
            *found.warnings,
            *_of_steps(light, clear),
            *_of_share(reading.kept, found.parts),
        ),
    )


def _of_steps(light: StepLight, clear: Mask) -> list[str]:
    """What to say where the light does not fit the steps; `clear`, where it has a direction."""
    lost = float(np.mean(~light.agrees[clear])) if clear.any() else 0.0
    remarks = []
    if light.chi > POOR_CHI:
        none = "" if light.agrees.any() else ": no isoclinic is given"
        remarks.append(
            f"chi = {light.chi:.2f}: the steps' angles or plates do not describe these frames "
            f"within their noise (an element off, light that drifts, a wrong gamma){none}; correct "
            "[[polariscope.step]], or use the orders with care"
        )
    if _NOTABLE < lost < 1.0:
        remarks.append(
            f"no isoclinic is given in {100.0 * lost:.0f} % of the pixels that show one: there "
            f"chi is over {POOR_CHI:g}, and the light not that of the stated steps"
        )
    return remarks


def _of_share(kept: float, parts: tuple[FieldPart, ...]) -> list[str]:
    """What to say where little could be read."""
    remarks = []
    if kept < 0.5 and all(part.number is not None for part in parts):
        remarks.append(
            f"only {100 * kept:.0f} % of the specimen's pixels could be read; more steps, less "
            "noise or finer pixels help"
        )
    return remarks
