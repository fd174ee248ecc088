"""A disc with residual stress: which form of it the images ask for, and what then is their fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibrate.disc_joint import JointDisc, fit_joint, make_pictures
from isochrome.calibrate.disc_residual import FORMS, NONE, Form
from isochrome.calibrate.disc_restarts import (
    carried,
    scan_round,
    unloaded_beside,
)
from isochrome.calibrate.shot import Shot
from isochrome.calibrate.smooth import degrees_of

Array = NDArray[np.float64]

SCAN_PIXELS = 10_000
PIXELS = 80_000
"""Pixels of the square about each disc while the form is chosen, and for the last fit."""

FEWEST_LOADS = 3
"""Different loads, zero among them, below which a residual field is not looked for."""

MISFIT_PIXELS = 20_000
"""Pixels of the square about each disc from which the misfit is judged."""

HALF = 0.5
"""Part of the misfit (chi^2 - 1) that a residual stress must take away to be believed."""

EXPLAINED = 0.6
"""Share of each loaded image's variation that the fit must explain at the least."""


def fit_together(
    shots: Sequence[Shot],
    own: Array,
    *,
    bright: bool = False,
    light: ArrayLike | None = None,
) -> JointDisc | None:
    """Fit all images with one residual stress, of the form that they ask for.

    More unknowns are taken only where they lower Bayes' information criterion (Schwarz, Ann.
    Stat. 6, 1978, 461-464), with chi-square in units of the better fit's.

    Parameters: `shots` (n,), those without load as well; `own` (n, 5), each image's order, row,
    column, radius (px) and angle (rad) to start from, the order 0 where there is no load;
    `bright`, for a bright field; `light` (rows, cols), the no-load bright minus dark frame.
    Returns the JointDisc, or None where no residual stress is found.
    """
    plain, degrees = plain_fit(shots, own, bright=bright, light=light, pixels=SCAN_PIXELS)

    def fitted(
        form: Form, start: Array, shared: Array, light_degrees: tuple[int, int], pixels: int
    ) -> JointDisc:
        places = unloaded_beside(start)
        pictures = make_pictures(
            shots, places, form, pixels=pixels, degrees=light_degrees, light=light
        )
        return fit_joint(pictures, form, places, shared, bright=bright)

    best = plain
    for form in FORMS:
        starts = [(own, np.zeros(form.size))]
        if form.round:
            starts += scan_round(shots, own, form, bright=bright, light=light)
        if best.form is not NONE:
            starts.append((best.own, carried(best, form)))
        for start in starts:
            found = fitted(form, *start, degrees, SCAN_PIXELS)
            if _better(found, best):
                best = found
    if best.form is NONE:
        return None
    for others in degrees_of(light):
        found = fitted(best.form, best.own, best.coefficients, others, SCAN_PIXELS)
        if _better(found, best):
            best, degrees = found, others
    left, before = (f.cost / f.pixels - 1.0 for f in (best, plain))
    if left > HALF * before or best.explained[own[:, 0] > 0].min() < EXPLAINED:
        return None
    final = fitted(best.form, best.own, best.coefficients, degrees, PIXELS)
    return final if final.converged else None


def plain_fit(
    shots: Sequence[Shot],
    own: Array,
    *,
    bright: bool = False,
    light: ArrayLike | None = None,
    pixels: int = MISFIT_PIXELS,
) -> tuple[JointDisc, tuple[int, int]]:
    """All images with no residual stress, each by itself, and the degrees of light they ask for.

    Parameters: as in `fit_together`, and the `pixels` of the square about each disc.
    """
    fits = []
    for degrees in degrees_of(light):
        pictures = make_pictures(shots, own, NONE, pixels=pixels, degrees=degrees, light=light)
        fits.append((fit_joint(pictures, NONE, own, np.zeros(0), bright=bright), degrees))
    few, many = fits
    return many if _better(many[0], few[0]) else few


def _better(new: JointDisc, old: JointDisc) -> bool:
    """Whether Bayes' information criterion prefers the new fit."""
    if not all(p.positive for p in new.parts):
        return False
    noise = min(new.cost / new.pixels, old.cost / old.pixels)
    terms = [f.cost / noise + _unknowns(f) * np.log(f.pixels) for f in (new, old)]
    return bool(terms[0] < terms[1])


def _unknowns(fit: JointDisc) -> int:
    return fit.own.size + fit.coefficients.size + sum(p.coefficients.size for p in fit.parts)
