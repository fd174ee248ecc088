"""Loads held out: what the other loads predict of each, against what is stated of the value.

A fringe value is used to tell loads from orders. Where it cannot do so for one of its own loads
within what is stated, its uncertainty is no promise: it is widened until all of them agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.result import BudgetItem, Calibration, ImageFit

Array = NDArray[np.float64]

CONTRADICTED = 3.0
"""Standard uncertainties by which a held-out load is off at the most, when all agree."""


def widened_to_held_out(found: Calibration) -> Calibration:
    """A calibration whose uncertainty no held-out load contradicts.

    Each order n_i is held against the other loads' line, with u_i² = v_i + v(line) + (n_i U)², its
    own noise and misfit, the line's, and the value's relative standard uncertainty U. Where one is
    off by more than 3 u_i, U grows until none is.

    Parameters: `found`. Returns it, or one with 'held-out loads' in its budget, and a sentence.
    """
    if any(image.predicted_order is None for image in found.images):
        return found
    away, own = _away(found.images)
    orders = np.array([i.order for i in found.images])
    value = found.fringe_value_n_per_mm
    stated = found.standard_uncertainty / value
    pulls = np.abs(away) / np.hypot(own, orders * stated)
    worst = int(np.argmax(pulls))
    if pulls[worst] <= CONTRADICTED:
        return replace(found, images=_expected(found.images, np.hypot(own, orders * stated)))
    needed = np.sqrt(np.maximum((away / CONTRADICTED) ** 2 - own**2, 0.0)) / orders
    total = value * float(max(needed.max(), stated))
    part = float(np.sqrt(max(total**2 - found.standard_uncertainty**2, 0.0)))
    image = found.images[worst]
    items = (*found.budget, BudgetItem("held-out loads", part / value, "", part, 0.0))
    budget = [replace(i, share=(i.contribution_n_per_mm / total) ** 2) for i in items]
    said = (
        f"{image.file} at {image.load_n:g} N shows order {image.order:.3f} where the other loads "
        f"predict {image.predicted_order:.3f}, {pulls[worst]:.1f} times what was to be expected: "
        f"the uncertainty is widened from {found.standard_uncertainty:.2g} to {total:.2g} N/mm; "
        "check this load and its image"
    )
    return replace(
        found,
        images=_expected(found.images, np.hypot(own, orders * total / value)),
        standard_uncertainty=total,
        budget=tuple(budget),
        warnings=(said, *found.warnings),
    )


def _expected(images: Sequence[ImageFit], spread: Array) -> tuple[ImageFit, ...]:
    """The images with what their predictions were expected to be off by."""
    return tuple(
        replace(i, predicted_uncertainty=float(u)) for i, u in zip(images, spread, strict=True)
    )


def _away(images: Sequence[ImageFit]) -> tuple[Array, Array]:
    """Each order less what the others predict, and the standard uncertainty of that by the images.

    Both (n,), fringes; the line through the others is weighted by their own uncertainties.
    """
    loads, orders = np.array([(i.load_n, i.order) for i in images]).T
    variance = np.array([i.standard_uncertainty**2 + i.misfit**2 for i in images])
    predicted = np.array([i.predicted_order for i in images], dtype=float)
    spread = np.empty(len(images))
    for i, load in enumerate(loads):
        others = np.arange(len(images)) != i
        design = np.stack([loads[others], np.ones(others.sum())])
        covariance = np.linalg.pinv((design / variance[others]) @ design.T)
        at = np.array([load, 1.0])
        spread[i] = np.sqrt(variance[i] + at @ covariance @ at)
    return orders - predicted, spread
