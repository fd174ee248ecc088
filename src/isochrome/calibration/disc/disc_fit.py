"""One image of a loaded disc: the whole field by least squares on its intensities."""

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.disc.disc_field import (
    DiscPixels,
    disc_mask,
    disc_order,
    squared_wave,
    thin_grid,
)
from isochrome.calibration.disc.disc_rim import Circle
from isochrome.calibration.disc.order_slope import FEWEST_LOADS
from isochrome.calibration.shot import Shot
from isochrome.errors import PhysicsError
from isochrome.estimation import ALIKE_CHI, IntensityFit, SeveralStarts, smooth_starts

Array = NDArray[np.float64]

PIXELS = 20_000
"""Pixels of the square about the disc from which the set starts."""

FEWEST = 0.5
"""Centre order at the least."""

EXPLAINED = 0.6
"""Share of an image's variation that the model must explain at least."""


def fit_disc(shot: Shot, circle: Circle, starts: Array) -> Array:
    """Fit one image's whole field: centre order, centre, radius and load direction (5,).

    Parameters: `circle`, the rim as found; `starts` (m, 5), see `disc_order`. Raises PhysicsError
    for too low an order, one that is ambiguous, or a fit that did not converge.
    """
    grid = thin_grid(shot.light.shape, circle, PIXELS)
    start, ambiguous = starts, False
    for within in (0.75, 0.97):
        result = _fit(shot, grid, start, within)
        rivals = [m for m in result.others if abs(m.values[0] - result.best.values[0]) > 0.1]
        ambiguous |= any(m.chi < ALIKE_CHI * result.best.chi for m in rivals)
        _check_explained(shot, result.best)
        start = result.best.values[None, :]
    best = result.best
    _check(shot, best, ambiguous)
    return best.values


def _check_explained(shot: Shot, best: IntensityFit) -> None:
    """Refuse a fit that leaves most of an image's variation: another basin, or no such disc."""
    used = np.isfinite(best.residual)
    image = (best.residual + best.illumination_map * best.signal + best.background_map)[used]
    explained = 1.0 - float(np.var(best.residual[used]) / np.var(image))
    if explained < EXPLAINED:
        raise PhysicsError(
            "loaded_disc_fringes_explain",
            name=shot.name,
            explained=explained,
            fewest_loads=FEWEST_LOADS,
        )


def _check(shot: Shot, best: IntensityFit, ambiguous: bool) -> None:
    order, spread = float(best.values[0]), float(best.standard_uncertainty[0])
    if order < FEWEST:
        raise PhysicsError("centre_order_too_low", name=shot.name, order=order)
    if ambiguous:
        raise PhysicsError("two_centre_orders_near", name=shot.name, order=order)
    if not best.converged or not best.positive or spread > 0.2 * order:
        raise PhysicsError("fringes_could_not_fitted", name=shot.name)


def _fit(shot: Shot, grid: DiscPixels, starts: Array, within: float) -> SeveralStarts:
    """One stage of the fit: the mask follows the best start."""
    pick, first = grid.pick, starts[0]
    radius = first[3]
    reach = np.array([0.5, 0.1 * radius, 0.1 * radius, 0.1 * radius, np.radians(6.0)])
    return smooth_starts(
        shot.light[pick],
        lambda p: squared_wave(np.pi * disc_order(grid, p), shot.bright),
        starts,
        light=shot.lamp(*pick),
        mask=shot.valid[pick] & disc_mask(grid, first, within=within),
        sigma=shot.sigma[pick],
        scale=np.array([0.2, 0.02 * radius, 0.02 * radius, 0.02 * radius, 0.05]),
        lower=starts.min(axis=0) - reach,
        upper=starts.max(axis=0) + reach,
        refine=min(3, len(starts)),
    )
