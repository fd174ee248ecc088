r"""The field of a residual stress, from a phase-stepped set of the unloaded specimen.

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

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fringes.step_field import WINDOW_PX, SettledField, settle_field, smoothed
from isochrome.fringes.step_light import LARGEST_UNCERTAINTY, measure_steps
from isochrome.fringes.steps import StepTerms
from isochrome.optics import Chain

Array = NDArray[Any]
Mask = NDArray[np.bool_]

_WINDOWS_PX = (WINDOW_PX, 2.0, 4.0)
_NEAR_HALF = 0.4
"""Order beyond which noise, or fringes, may lead past the half order, where the least one ends."""

_APART = 0.25
_MOST = 0.5
"""Of the pixels that are seen: a part so large, and below half an order, is believed to be so."""

_POOR_CHI = 1.3
_FEW = 0.9
_TELLING = 3.0
_SURELY = 5.5
"""Standard uncertainties that the largest of a million pixels of noise does not reach."""


@dataclass(frozen=True)
class Residual:
    """n₀ of a residual stress: `field` N exp 2iθ, complex, fringes, NaN = not known.

    `uncertainty`, of N, and of N times twice the angle, fringes (both (rows, cols)); `kept`, share
    of the specimen that is known; `warnings` in plain words.
    """

    field: Array
    uncertainty: Array
    kept: float
    warnings: tuple[str, ...]

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
        """Its direction of sigma_1 (rows, cols) float32, degrees; NaN where it is nearly nil."""
        told = np.abs(self.field) > _TELLING * self.uncertainty
        return np.where(told, 0.5 * np.degrees(np.angle(self.field)), np.nan).astype(np.float32)


def read_residual(
    stack: Array, chains: Sequence[Chain], *, sigma: Array | float, valid: Mask | None = None
) -> Residual:
    """Read the field of the residual stress from the images of an unloaded specimen's steps.

    Equations: the module's. Parameters: `stack` (steps, rows, cols), light in any unit; `chains`,
    `sigma` and `valid` as in `isochrome.fringes.stepped.read_steps`. Returns a Residual. Raises
    InputError where the steps cannot tell the order.
    """
    light = measure_steps(stack, chains, sigma=sigma, valid=valid)
    field, spread = least_field(light.terms), light.uncertainty
    near = light.seen & (np.abs(field) < _NEAR_HALF)
    main = _main_part(near, int(light.seen.sum()))
    followed = settle_field(
        light, model=lambda: np.where(main, np.abs(field), np.nan), compatible=False
    )
    least = _believed(near, main, field, followed)
    # across the direction the noise is that of sin δ, which falls towards the half order
    turn = 2.0 * np.pi * np.minimum(np.abs(field), _NEAR_HALF)
    across = spread * turn / np.maximum(np.sin(turn), 1e-9)
    sharp = 2.0 * np.abs(followed.field) * light.direction.uncertainty
    across, sharp = np.fmax(across, spread), np.hypot(spread, sharp)
    least &= ~(followed.known & (sharp < across))
    spread = np.where(least, across, sharp)
    field = np.where(least, field, followed.field)
    known = (least | followed.known) & (spread < LARGEST_UNCERTAINTY)
    field, spread = _pooled(np.where(known, field, np.nan), spread, known)
    kept = float(known.sum() / max(1, np.count_nonzero(known | light.specimen)))
    return Residual(field, np.where(known, spread, np.nan), kept, _remarks(light.chi, kept))


def least_field(terms: StepTerms) -> Array:
    """n of the least order that the light allows, 1/2 at most, pixel by pixel.

    Equation: the module's. Parameters: `terms`, see `isochrome.fringes.steps`. Returns N exp 2iθ
    (rows, cols), complex, fringes.
    """
    size = np.abs(terms.sine)
    order = np.arctan2(size, terms.cosine) / (2.0 * np.pi)
    return np.asarray(order * terms.sine / np.maximum(size, 1e-30))


def _main_part(near: Mask, seen: int) -> Mask:
    """The largest connected part of some pixels, none where it is not most of those seen."""
    from scipy.ndimage import label

    labels, _ = label(near)
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return np.asarray((labels == sizes.argmax()) & near & (sizes.max() > _MOST * seen))


def _believed(near: Mask, main: Mask, least: Array, followed: SettledField) -> Mask:
    """Where the least order is the order: connected parts in which the followed field says so.

    The main part is one too where the followed field says nothing else.
    """
    from scipy.ndimage import label

    agrees = followed.known & (np.abs(followed.field - least) < _APART)
    labels, count = label(near & (agrees | ~followed.known))
    sure = np.bincount(labels[agrees], minlength=count + 1) > 0
    sure[0] = False
    plain = main if not (main & followed.known & ~agrees).any() else np.zeros_like(main)
    return np.asarray(sure[labels] | plain)


def _pooled(field: Array, uncertainty: Array, known: Mask) -> tuple[Array, Array]:
    """The field under the widest window that it allows: a residual stress varies little."""
    pooled, spread = field, uncertainty
    for window in _WINDOWS_PX:
        smooth, less = smoothed(field, uncertainty, known, window_px=window)
        wider = less < spread
        pooled, spread = np.where(wider, smooth, pooled), np.where(wider, less, spread)
    return pooled, spread


def _remarks(chi: float, kept: float) -> tuple[str, ...]:
    """What the user should know of the no-load set."""
    remarks = []
    if chi > _POOR_CHI:
        remarks.append(
            f"no-load steps: chi = {chi:.2f}: the steps' angles or plates do not describe "
            "these frames within their noise; capture them as the loaded ones"
        )
    if kept < _FEW:
        remarks.append(
            f"no-load steps: only {100 * kept:.0f} % of the specimen could be read (too dim, noisy "
            "or faulty, or a residual stress that may pass half an order, where nothing tells how "
            "far); the load's order is left out elsewhere"
        )
    return tuple(remarks)
