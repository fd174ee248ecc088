"""One image of a loaded disc: the whole field by least squares on its intensities."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibrate.disc_field import Grid, disc_mask, disc_order, disc_signal, thin_grid
from isochrome.calibrate.result import ImageFit, View
from isochrome.calibrate.rim import Circle
from isochrome.calibrate.rise import FEWEST_LOADS
from isochrome.calibrate.settings import Disc
from isochrome.calibrate.shot import Shot
from isochrome.calibrate.smooth import smooth_starts
from isochrome.errors import PhysicsError
from isochrome.fit import IntensityFit, SeveralStarts

Array = NDArray[np.float64]

PIXELS = 80_000
"""Pixels of the square about the disc that are fitted."""

FEWEST = 0.5
"""Centre order at the least."""

EXPLAINED = 0.6
"""Share of an image's variation that the model must explain at least."""


def fit_disc(
    shot: Shot,
    circle: Circle,
    starts: Array,
    disc: Disc,
    *,
    bright: bool = False,
    light: ArrayLike | None = None,
) -> ImageFit:
    """Fit one image's whole field: centre order, centre, radius and load direction.

    Parameters: `circle`, the rim as found; `starts` (m, 5), see `disc_order`; the rest as in
    `isochrome.calibrate.disc_from_shots`. Returns the ImageFit, its order at the centre. Raises
    PhysicsError for too low an order, one that is ambiguous, or a fit that did not converge.
    """
    grid = thin_grid(shot.image.shape, circle, PIXELS)
    start, ambiguous = starts, False
    for within in (0.75, 0.97):
        found = _fit(shot, grid, start, within, bright, light)
        rivals = [m for m in found.others if abs(m.values[0] - found.best.values[0]) > 0.1]
        ambiguous |= any(m.chi < 1.05 * found.best.chi for m in rivals)
        _check_explained(shot, found.best)
        start = found.best.values[None, :]
    best = found.best
    order, row, col, radius, angle = best.values
    _check(shot, best, ambiguous)
    geometry = {
        "centre_row_px": float(row),
        "centre_col_px": float(col),
        "radius_px": float(radius),
        "rim_radius_px": circle.radius,
        "load_angle_deg": float(np.degrees(angle)),
    }
    pixel_mm = 0.5 * disc.diameter_mm / float(radius)
    shown = _view(shot, grid, best, pixel_mm)
    spread = float(best.standard_uncertainty[0])
    return ImageFit(shot.file, shot.load_n, float(order), spread, best.chi, None, geometry, shown)


def _check_explained(shot: Shot, best: IntensityFit) -> None:
    """Refuse a fit that leaves most of an image's variation: another basin, or no such disc."""
    used = np.isfinite(best.residual)
    image = (best.residual + best.illumination_map * best.signal + best.background_map)[used]
    explained = 1.0 - float(np.var(best.residual[used]) / np.var(image))
    if explained < EXPLAINED:
        raise PhysicsError(
            f"{shot.file}: a loaded disc's fringes explain {explained:.0%} of its intensities; "
            "check the field (dark or bright), that the loads press along the image's columns, "
            f"and that the disc is free of stress at no load, or give {FEWEST_LOADS} loads or more"
        )


def _check(shot: Shot, best: IntensityFit, ambiguous: bool) -> None:
    order, spread = float(best.values[0]), float(best.standard_uncertainty[0])
    if order < FEWEST:
        raise PhysicsError(
            f"{shot.file}: a centre order of {order:.2f} is too low to calibrate from; raise the "
            "load until the order at the centre is one at least"
        )
    if ambiguous:
        raise PhysicsError(
            f"{shot.file}: two centre orders near {order:.2f} explain it equally well; add images "
            "at other loads, or use frames.roi to show the disc larger"
        )
    if not best.converged or not best.positive or spread > 0.2 * order:
        raise PhysicsError(
            f"{shot.file}: the fringes could not be fitted; check the field (dark or bright), the "
            "focus, and that the loads press along the columns of the image"
        )


def _fit(
    shot: Shot, grid: Grid, starts: Array, within: float, bright: bool, light: ArrayLike | None
) -> SeveralStarts:
    """One stage of the fit: the mask follows the best start."""
    pick = np.ix_(grid.rows[:, 0].astype(int), grid.cols[0].astype(int))
    first = starts[0]
    radius = first[3]
    reach = np.array([0.5, 0.1 * radius, 0.1 * radius, 0.1 * radius, np.radians(6.0)])
    return smooth_starts(
        shot.image[pick],
        lambda p: disc_signal(grid, p, bright=bright),
        starts,
        light=None if light is None else np.asarray(light, dtype=float)[pick],
        mask=shot.mask[pick] & disc_mask(grid, first, within=within),
        sigma=shot.sigma[pick],
        scale=np.array([0.2, 0.02 * radius, 0.02 * radius, 0.02 * radius, 0.05]),
        lower=starts.min(axis=0) - reach,
        upper=starts.max(axis=0) + reach,
        refine=min(3, len(starts)),
    )


def _view(shot: Shot, grid: Grid, fit: IntensityFit, pixel_mm: float) -> View:
    rows, cols = grid.rows[:, 0].astype(int), grid.cols[0].astype(int)
    image = shot.image[np.ix_(rows, cols)]
    model = fit.illumination_map * fit.signal + fit.background_map
    middle = int(np.argmin(np.abs(rows - fit.values[1])))
    inside = np.isfinite(fit.residual[middle])
    spacing = pixel_mm * grid.step
    return View(
        image, np.where(np.isfinite(fit.residual), model, np.nan), fit.residual,
        float(np.median(shot.sigma)), (spacing, spacing),
        (cols[inside] - fit.values[2]) * pixel_mm, disc_order(grid, fit.values)[middle, inside],
        image[middle, inside], model[middle, inside],
    )  # fmt: skip
