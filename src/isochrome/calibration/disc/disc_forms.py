"""A disc with residual stress: which form of it the images ask for, and what then is their fit."""

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.disc.disc_joint import (
    JointDisc,
    evaluate_joint,
    fit_joint,
    make_pictures,
)
from isochrome.calibration.disc.disc_residual import FORMS, NONE, ResidualForm, load_field
from isochrome.calibration.result import ImageFit
from isochrome.calibration.shot import Shot
from isochrome.estimation import degrees_of, evidence_gain

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

ROUGH_PIXELS = 3_000
RADII = (0.92, 0.95, 0.98, 1.01)
SIZES = (-0.6, -0.3, 0.0, 0.3, 0.6)
REFINED = 4
"""Starts with a residual: radii over the first one, sizes in fringes, and how many are refined."""


def fit_disc_images(shots: Sequence[Shot], own: Array) -> JointDisc | None:
    """Fit all images with one residual stress, of the form that they ask for.

    More unknowns are taken only where the evidence asks for them, see `evidence_gain`.
    Parameters: `shots` (n,), those without load as well; `own` (n, 5), each image's order, row,
    column, radius (px) and angle (rad) to start from, the order 0 where there is no load.
    Returns the JointDisc, or None where no residual stress is found.
    """
    plain, degrees = plain_fit(shots, own, pixels=SCAN_PIXELS)
    best = plain
    for form in FORMS:
        starts = [(own, np.zeros(form.size))]
        if form.round:
            starts += scan_round(shots, own, form)
        if best.form is not NONE:
            starts.append((best.own, carried(best, form)))
        for start in starts:
            result = _fitted(shots, form, *start, degrees, SCAN_PIXELS)
            if _better(result, best):
                best = result
    if best.form is NONE:
        return None
    for others in degrees_of(shots[0].no_load_light):
        result = _fitted(shots, best.form, best.own, best.coefficients, others, SCAN_PIXELS)
        if _better(result, best):
            best, degrees = result, others
    left, before = (f.cost / f.pixels - 1.0 for f in (best, plain))
    if left > HALF * before or best.explained[own[:, 0] > 0].min() < EXPLAINED:
        return None
    final = _fitted(shots, best.form, best.own, best.coefficients, degrees, PIXELS)
    return final if final.converged else None


def plain_fit(
    shots: Sequence[Shot], own: Array, *, pixels: int = MISFIT_PIXELS
) -> tuple[JointDisc, tuple[int, int]]:
    """All images with no residual stress, each by itself, and the degrees of light they ask for.

    Parameters: as in `fit_disc_images`, and the `pixels` of the square about each disc.
    """
    few, many = (
        (_fitted(shots, NONE, own, np.zeros(0), degrees, pixels), degrees)
        for degrees in degrees_of(shots[0].no_load_light)
    )
    return many if _better(many[0], few[0]) else few


def _fitted(
    shots: Sequence[Shot],
    form: ResidualForm,
    own: Array,
    shared: Array,
    degrees: tuple[int, int],
    pixels: int,
) -> JointDisc:
    """All images with a form of the residual from one start, see `make_pictures`."""
    places = unloaded_beside(own)
    pictures = make_pictures(shots, places, form, pixels=pixels, degrees=degrees)
    return fit_joint(pictures, places, shared)


def _better(new: JointDisc, old: JointDisc) -> bool:
    """Whether the new fit has more evidence."""
    if not all(p.positive for p in new.parts):
        return False
    before, after = ((f.cost / f.pixels, _unknowns(f)) for f in (old, new))
    return evidence_gain(before, after, pixels=new.pixels) > 0.0


def _unknowns(fit: JointDisc) -> int:
    return fit.own.size + fit.coefficients.size + sum(p.coefficients.size for p in fit.parts)


def own_unknowns(images: Sequence[ImageFit]) -> Array:
    """Order, row, column, radius (px) and angle (rad) of each single fit, (n, 5)."""
    names = ("centre_row_px", "centre_col_px", "radius_px", "load_angle_deg")
    own = np.array([[i.order, *(i.geometry[name] for name in names)] for i in images])
    own[:, -1] = np.radians(own[:, -1])
    return own


def scan_round(shots: Sequence[Shot], own: Array, form: ResidualForm) -> list[tuple[Array, Array]]:
    """The best starts with an axisymmetric residual and a uniform one, over radii and sizes.

    Parameters: as in `fit_disc_images`; `form`, the axisymmetric one. Returns a few (own, shared).
    """
    few, scored = degrees_of(shots[0].no_load_light)[0], []
    for factor in RADII:
        start = unloaded_beside(through_origin(shots, own))
        start[:, 3] = factor * own[:, 3].min()
        pictures = make_pictures(shots, start, form, pixels=ROUGH_PIXELS, degrees=few)
        for uniform, middle in product(SIZES, SIZES):
            shared = np.array([uniform, 0.0, middle, 0.0])
            state = evaluate_joint(pictures, start, shared)
            if all(part.positive for part in state.parts):
                scored.append((state.cost / state.pixels, start, shared))
    scored.sort(key=lambda item: item[0])
    return [(start, shared) for _, start, shared in scored[:REFINED]]


def through_origin(shots: Sequence[Shot], own: Array) -> Array:
    """The same start with orders in proportion to the loads, at the slope of the line through them.

    A residual stress may have moved all single fits by a part of a fringe, but hardly their slope.
    """
    loads = np.array([s.load_n for s in shots])
    loaded = loads > 0
    moved = own.copy()
    if np.unique(loads[loaded]).size > 1:
        slope = np.polynomial.polynomial.polyfit(loads[loaded], own[loaded, 0], 1)[1]
        moved[:, 0] = slope * loads
    return moved


def carried(fit: JointDisc, form: ResidualForm) -> Array:
    """The coefficients in another form that come nearest to a fit's residual (k,)."""
    picture, own = fit.pictures[0], fit.own[0]
    x, z = (picture.cols - own[2]) / own[3], (picture.rows - own[1]) / own[3]
    field = fit.coefficients @ picture.basis
    if fit.form.along != form.along:
        turn = load_field(picture.rows, picture.cols, own[1:])[1]
        field = field * (np.conj(turn) if fit.form.along else turn)
    basis = form.basis(x, z)
    stacked = np.concatenate((basis.real, basis.imag), axis=1)
    target = np.concatenate((field.real, field.imag))
    return np.asarray(np.linalg.lstsq(stacked.T, target, rcond=None)[0])


def unloaded_beside(own: Array) -> Array:
    """The unloaded images' discs put where the first loaded one lies."""
    loaded = own[:, 0] > 0
    moved = own.copy()
    moved[~loaded, 1:] = own[np.flatnonzero(loaded)[0], 1:]
    return moved
