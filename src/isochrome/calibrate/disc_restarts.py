"""Starts for all images of a disc together, with a residual stress and without one."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibrate.disc_joint import JointDisc, evaluate_joint, make_pictures
from isochrome.calibrate.disc_residual import Form, load_field
from isochrome.calibrate.result import ImageFit
from isochrome.calibrate.shot import Shot
from isochrome.calibrate.smooth import degrees_of

Array = NDArray[np.float64]

ROUGH_PIXELS = 3_000
RADII = (0.92, 0.95, 0.98, 1.01)
SIZES = (-0.6, -0.3, 0.0, 0.3, 0.6)
REFINED = 4
"""Starts with a residual: radii over the first one, sizes in fringes, and how many are refined."""


def own_unknowns(images: Sequence[ImageFit]) -> Array:
    """Order, row, column, radius (px) and angle (rad) of each single fit, (n, 5)."""
    names = ("centre_row_px", "centre_col_px", "radius_px", "load_angle_deg")
    own = np.array([[i.order, *(i.geometry[name] for name in names)] for i in images])
    own[:, -1] = np.radians(own[:, -1])
    return own


def with_no_load(shots: Sequence[Shot], own: Array) -> tuple[list[Shot], Array]:
    """Loaded shots first, then those without load, whose discs lie where the first one's does.

    Parameters: `shots` (n,); `own` (m, 5) of the loaded ones. Returns n shots and (n, 5).
    """
    unloaded = [s for s in shots if s.load_n == 0]
    rest = np.tile(own[0] * [0.0, 1.0, 1.0, 1.0, 1.0], (len(unloaded), 1))
    return [*(s for s in shots if s.load_n > 0), *unloaded], np.concatenate((own, rest))


def scan_round(
    shots: Sequence[Shot], own: Array, form: Form, *, bright: bool, light: ArrayLike | None
) -> list[tuple[Array, Array]]:
    """The best starts with an axisymmetric residual and a uniform one, over radii and sizes.

    Parameters: as in `fit_together`; `form`, the axisymmetric one. Returns a few (own, shared).
    """
    scored = []
    for factor in RADII:
        start = unloaded_beside(through_origin(shots, own))
        start[:, 3] = factor * own[:, 3].min()
        pictures = make_pictures(
            shots, start, form, pixels=ROUGH_PIXELS, degrees=degrees_of(light)[0], light=light
        )
        for uniform, middle in product(SIZES, SIZES):
            shared = np.array([uniform, 0.0, middle, 0.0])
            state = evaluate_joint(pictures, form, bright, start, shared)
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


def carried(fit: JointDisc, form: Form) -> Array:
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
