r"""Absolute fringe order and isoclinic angle from a phase-stepped set.

The steps' light gives cos δ, sin δ exp 2iθ and (1 - cos δ) exp 4iθ in every pixel (`steps`), these
the continuous direction up to 90° (`isoclinic`), along which δ is signed and unwraps without the
ambiguity (δ, θ) ~ (-δ, θ + 90°): n = (φ/2π + m) exp 2iθ does not change with it. The whole number m
of each connected part comes from the user's known orders, from equilibrium and compatibility, or
from a model (`absolute`, `whole_number`); a part that has none is left unknown. A residual stress
is taken off n (`residual`). Then N = |n| and θ = arg(n)/2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fringes.branch import OrderReading, probability
from isochrome.fringes.residual import Residual, direction_told, least_field, least_spread
from isochrome.fringes.step_field import LARGEST_TURN, SettledField, settle_field, smoothed
from isochrome.fringes.step_light import LARGEST_UNCERTAINTY, StepLight, measure_steps
from isochrome.fringes.whole_number import KnownOrder, Part
from isochrome.optics import Chain

Array = NDArray[Any]
Mask = NDArray[np.bool_]

_POOR_CHI = 1.3
_LEAST_ORDER = 4.0
_TINY = 1e-9
_SMALL = 0.15
"""Order below which the least order that the light allows is the order."""

_SMOOTHED = 0.928
"""Of the direction's noise, which is pooled already, what smoothing n leaves: from the kernels'
Gaussians of widths w = 1.2 and W = 1.6, W² (4/(W² + w²) - 4/(W² + 1.5 w²) + 1/(W² + 2 w²))."""

_BRIDGED = 0.1
"""Doubt of 2θ (rad) where the direction is bridged."""


@dataclass(frozen=True)
class SteppedReading:
    """What a phase-stepped set tells; maps (rows, cols) float32, NaN = not known.

    `reading`, the fringe order with its uncertainty and confidence; `isoclinic`, direction of
    sigma_1, degrees counter-clockwise from the image's +x, -90 to 90; `isoclinic_uncertainty`,
    degrees; `dark_field`, (1 - cos δ)/2; all of them of the load alone where a residual stress was
    taken out; `contrast` A V, in the light's unit; `chi`, residual of the light over its noise (NaN
    where the steps leave none); `parts`, the connected parts and what settled their whole numbers;
    `warnings` in plain words.
    """

    reading: OrderReading
    isoclinic: Array
    isoclinic_uncertainty: Array
    dark_field: Array
    contrast: Array
    chi: float
    parts: tuple[Part, ...]
    warnings: tuple[str, ...]

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
    residual: Residual | None = None,
) -> SteppedReading:
    """Read fringe order and isoclinic angle of one state from the images of its steps.

    Equations: the module's. Parameters: `stack` (steps, rows, cols), light in any unit; `chains`,
    the elements of each step, see `isochrome.optics.make_chain`; `sigma`, standard deviation of
    the light's noise, in its unit, a number or (rows, cols); `valid`, True = trusted, (rows, cols)
    or frame by frame, (steps, rows, cols): a frame that is not is left out of that pixel;
    `known_order`, (row, col, N) where the user knows it, and `model`, called for a model's order
    (rows, cols), NaN outside it, where neither these nor the field itself tells the whole number,
    both of what the frames show, residual stress and all; `residual`, to be taken out.
    Returns a SteppedReading. A pixel is not known where it is masked, its contrast low, its noise
    over 0.03 fringe, its fringes finer than 2.5 pixels, its part's whole number open, or the
    residual not known. Raises InputError where the steps cannot tell the order.
    """
    light = measure_steps(stack, chains, sigma=sigma, valid=valid)
    found = settle_field(
        light,
        known_order=known_order,
        model=model,
        residual=None if residual is None else residual.field,
    )
    return _result(light, found, _of_load(light, found, residual), residual is not None)


def _of_load(light: StepLight, found: SettledField, residual: Residual | None) -> _Parts:
    """n of the load alone, smoothed, with its noise along and across it.

    The noise of N and θ lies along and across the n that the frames show; the angle between that
    and the load's own turns it.
    """
    known = found.known
    shown = np.where(known, found.field, 0.0)
    across = 2.0 * np.abs(shown) * light.direction.uncertainty
    if residual is not None:
        across = np.hypot(across, np.where(direction_told(light), 0.0, _BRIDGED * np.abs(shown)))
    small = known & (np.abs(shown) < _SMALL)
    shown, across = _sharper(light, shown, across, small)
    field = shown if residual is None else np.where(known, shown - residual.field, 0.0)
    field, along = smoothed(field, light.uncertainty, known)
    size = np.maximum(np.abs(field), _TINY)
    if residual is None:
        gain = along / np.maximum(light.uncertainty, _TINY)
        alone = gain * across / (2.0 * size)
        turn = np.where(small, alone, _turn(light, gain < 1.0))
        return _Parts(field, along, turn, known)
    lean = (shown / np.maximum(np.abs(shown), _TINY)) * np.conj(field / size)
    uncertainty, swing = (
        np.sqrt(np.square(a * lean.real) + np.square(b * lean.imag) + residual.uncertainty**2)
        for a, b in ((along, across), (across, along))
    )
    known = known & (uncertainty < LARGEST_UNCERTAINTY)
    return _Parts(field, uncertainty, swing / (2.0 * size), known)


def _turn(light: StepLight, smooth: Mask) -> Array:
    """Uncertainty of θ (rad) where n was `smooth`ed, or not: of the noise, that leaves less."""
    less = np.where(smooth, 1.0 - _SMOOTHED**2, 0.0) * np.square(light.direction.scatter)
    return np.asarray(np.sqrt(np.square(light.direction.uncertainty) - less))


def _sharper(light: StepLight, shown: Array, across: Array, small: Mask) -> tuple[Array, Array]:
    """n and its noise across; where it is small, from the pixel itself.

    There its direction by the window is that of the pixels around, about an isotropic point and in
    a valley of the order, or noise; that of the pixel's own light is not.
    """
    least = least_field(light.terms)
    spread = least_spread(least, light.uncertainty)
    return np.where(small, least, shown), np.where(small, spread, across)


def _result(light: StepLight, found: SettledField, load: _Parts, apart: bool) -> SteppedReading:
    """The maps, NaN where they are not known; `apart`, whether a residual was taken out."""
    known, uncertainty = load.known, load.uncertainty
    # nearer to zero its sign is noise
    turned = known & (load.turn < LARGEST_TURN) & (np.abs(load.field) > _LEAST_ORDER * uncertainty)

    def masked(values: Array, where: Mask) -> Array:
        return np.where(where, values, np.nan).astype(np.float32)

    specimen = known | light.specimen
    reading = OrderReading(
        masked(np.abs(load.field), known),
        masked(uncertainty, known),
        np.where(known, probability(uncertainty), 0.0).astype(np.float32),
        float(known.sum() / max(1, np.count_nonzero(specimen))),
    )
    if apart:
        cosine, seen = np.cos(2.0 * np.pi * reading.order), known
    else:
        cosine, seen = light.terms.cosine / np.maximum(light.contrast, 1e-30), specimen
    return SteppedReading(
        reading,
        masked(0.5 * np.degrees(np.angle(load.field)), turned),
        masked(np.degrees(load.turn), turned),
        masked(0.5 - 0.5 * cosine, seen),
        light.contrast.astype(np.float32),
        light.chi,
        found.parts,
        (*found.warnings, *_remarks(light.chi, reading.kept, found.parts)),
    )


def _remarks(chi: float, kept: float, parts: tuple[Part, ...]) -> list[str]:
    """What the user should know of the set as a whole."""
    remarks = []
    if chi > _POOR_CHI:
        remarks.append(
            f"chi = {chi:.2f}: the steps' angles or plates do not describe these frames within "
            "their noise (an element off, light that drifts, a wrong gamma); use them with care"
        )
    if kept < 0.5 and all(part.number is not None for part in parts):
        remarks.append(
            f"only {100 * kept:.0f} % of the specimen's pixels could be read; more steps, less "
            "noise or finer pixels help"
        )
    return remarks
