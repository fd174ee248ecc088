"""Material fringe value from a disc under diametral compression.

At the centre sigma1 - sigma2 = 8 P/(pi D d), so that N = (8/(pi D f_sigma)) P + N0: the thickness
d cancels, and an order N0 that stays at zero load (residual stress) does not touch the slope.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibrate.conclude import Input, conclude
from isochrome.calibrate.disc_field import Grid, disc_mask, disc_order, disc_signal, thin_grid
from isochrome.calibrate.disc_starts import choose_orders, scan_disc
from isochrome.calibrate.result import Calibration, ImageFit, View
from isochrome.calibrate.rim import Circle
from isochrome.calibrate.settings import CalibrationSet, Disc, Uncertainty, load_set
from isochrome.calibrate.shot import Shot, as_shots
from isochrome.calibrate.smooth import smooth_starts
from isochrome.errors import InputError, PhysicsError
from isochrome.fit import IntensityFit, SeveralStarts

Array = NDArray[np.float64]

PIXELS = 150_000
"""Pixels of the square about the disc that are fitted."""

FEWEST = 0.5
"""Centre order at the least."""


def calibrate_disc(source: str | Path | CalibrationSet) -> Calibration:
    """Calibrate the material fringe value from images of a disc under diametral compression.

    Parameters: `source`, a calibration set (TOML path or CalibrationSet) with [disc].
    Returns the Calibration; its order at zero load is at the centre. Raises InputError for a set
    or a file that is wrong, PhysicsError where the images do not determine the value.
    """
    from isochrome.calibrate.load import read_shots

    given = load_set(source, specimen="disc")
    assert given.disc is not None
    shots, light = read_shots(given)
    return disc_from_shots(
        shots,
        given.disc,
        bright=given.polariscope.field == "bright",
        uncertainty=given.uncertainty,
        light=light,
    )


def disc_from_images(
    images: Sequence[ArrayLike],
    loads_n: Sequence[float],
    disc: Disc,
    *,
    sigma: float | Sequence[ArrayLike] | None = None,
    bright: bool = False,
    uncertainty: Uncertainty | None = None,
) -> Calibration:
    """`calibrate_disc` on arrays: `images` linear in light, each (rows, cols), at `loads_n`.

    Parameters: `disc`, its sizes in mm; `sigma`, the images' noise (estimated where None);
    `bright`, for a bright field; `uncertainty` of the inputs.
    """
    shots = as_shots(images, loads_n, sigma=sigma)
    return disc_from_shots(shots, disc, bright=bright, uncertainty=uncertainty)


def disc_from_shots(
    shots: Sequence[Shot],
    disc: Disc,
    *,
    bright: bool = False,
    uncertainty: Uncertainty | None = None,
    light: ArrayLike | None = None,
) -> Calibration:
    """`disc_from_images` on shots; `light` (rows, cols), the no-load bright minus dark frame."""
    loaded = [s for s in shots if s.load_n > 0]
    if not loaded:
        raise InputError("no image has a load above zero; a calibration needs a loaded one")
    scans = [scan_disc(shot, bright=bright) for shot in loaded]
    orders = choose_orders(scans, [s.load_n for s in loaded])
    images = [
        fit_disc(shot, scan.circle, scan.starts(order), disc, bright=bright, light=light)
        for shot, scan, order in zip(loaded, scans, orders, strict=True)
    ]
    known = uncertainty or Uncertainty()
    inputs = (
        Input("load", known.load_percent, "%", 0.01),
        Input("diameter", known.diameter_mm, "mm", 1.0 / disc.diameter_mm),
        Input("thickness", known.thickness_mm, "mm", 0.0),
    )
    return conclude("disc", images, 8.0 / (np.pi * disc.diameter_mm), inputs)


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
    `disc_from_shots`. Returns the ImageFit, its order at the centre. Raises PhysicsError for too
    low an order, one that is ambiguous, or a fit that did not converge.
    """
    grid = thin_grid(shot.image.shape, circle, PIXELS)
    start, ambiguous = starts, False
    for within in (0.75, 0.97):
        found = _fit(shot, grid, start, within, bright, light)
        rivals = [m for m in found.others if abs(m.values[0] - found.best.values[0]) > 0.1]
        ambiguous |= any(m.chi < 1.05 * found.best.chi for m in rivals)
        start = found.best.values[None, :]
    best = found.best
    order, row, col, radius, angle = best.values
    spread = float(best.standard_uncertainty[0])
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
    geometry = {
        "centre_row_px": float(row),
        "centre_col_px": float(col),
        "radius_px": float(radius),
        "rim_radius_px": circle.radius,
        "load_angle_deg": float(np.degrees(angle)),
    }
    pixel_mm = 0.5 * disc.diameter_mm / float(radius)
    shown = _view(shot, grid, best, pixel_mm)
    return ImageFit(
        shot.file, shot.load_n, float(order), spread, best.chi, None, geometry, shown
    )  # fmt: skip


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
