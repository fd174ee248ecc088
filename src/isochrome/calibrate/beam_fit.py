"""One image of a beam in bending: the whole span by least squares on its intensities."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibrate.beam_view import FEWEST, BeamView, find_beam
from isochrome.calibrate.result import ImageFit, View
from isochrome.calibrate.settings import Beam
from isochrome.calibrate.shot import Shot
from isochrome.calibrate.smooth import smooth_starts
from isochrome.errors import PhysicsError
from isochrome.fit import IntensityFit, SeveralStarts

Array = NDArray[np.float64]

PIXELS = 80_000
"""Pixels of an image that are fitted; more add nothing to the uncertainty that matters."""

MARGIN = 0.02
"""Part of the height left out at each edge, where chamfers and blur are."""

FAINTEST = 2.0
"""Standard deviation of the fringes' intensities, in noise sigmas, at the least."""


def fit_beam(
    shot: Shot,
    beam: Beam,
    pixel_mm: float,
    *,
    bright: bool = False,
    light: ArrayLike | None = None,
) -> ImageFit:
    """Fit one image's whole span: slope across the height, neutral axis, tilt, illumination.

    Parameters: as in `bending_from_shots`. Returns the ImageFit, its order at the edge h/2.
    Raises PhysicsError for too few fringes, an ambiguous slope or a fit that did not converge.
    """
    height_px = beam.height_mm / pixel_mm
    view = find_beam(shot, height_px, bright=bright)
    stride = max(1, int(np.ceil(shot.image.size / PIXELS)))
    cols = np.arange(stride // 2, shot.image.shape[1], stride, dtype=float)
    found, model = _fit(shot, view, height_px, cols, bright, light)
    slope, row, tilt = found.best.values
    _check(shot, found, slope, min(height_px, float(shot.image.shape[0])))
    across = slope / np.cos(np.arctan(tilt))  # along the normal of the fringes
    geometry = {
        "tilt_deg": float(np.degrees(np.arctan(-tilt))),
        "neutral_axis_row_px": float(row),
        "top_edge_row_px": view.top,
        "fringes_per_mm": float(across / pixel_mm),
    }
    half = 0.5 * height_px
    relative = float(found.best.standard_uncertainty[0] / slope)
    order = float(across * half)
    shown = _view(shot, found.best, model, cols.astype(int), pixel_mm)
    return ImageFit(
        shot.file, shot.load_n, order, order * relative, found.best.chi, None, geometry, shown
    )


def _fit(
    shot: Shot, view: BeamView, height_px: float, cols: Array, bright: bool, light: ArrayLike | None
) -> tuple[SeveralStarts, Any]:
    """Fit the fringes inside the beam on every column of `cols`; also returns the order's map."""
    pick = cols.astype(int)
    image, sigma = shot.image[:, pick], shot.sigma[:, pick]
    y = np.arange(shot.image.shape[0], dtype=float)[:, None]
    x = (cols - 0.5 * (shot.image.shape[1] - 1))[None, :]
    margin = max(3.0, MARGIN * height_px)
    depth = y - view.tilt * x - view.top
    mask = shot.mask[:, pick] & (depth > margin) & (depth < height_px - margin)

    def order(params: Array) -> Array:
        return np.asarray(params[0] * (y - params[1] - params[2] * x))

    def response(params: Array) -> Array:
        wave = np.square(np.sin(np.pi * order(params)))
        return 1.0 - wave if bright else wave

    known = None if light is None else np.asarray(light, dtype=float)[:, pick]
    found = smooth_starts(
        image,
        response,
        view.starts,
        light=known,
        mask=mask,
        sigma=sigma,
        scale=np.array([0.1 / height_px, 0.1 * height_px, 0.01]),
        lower=[0.0, -np.inf, -0.3],
        upper=[0.5, np.inf, 0.3],
        scan_pixels=20_000,
    )
    return found, order


def _check(shot: Shot, found: SeveralStarts, slope: float, seen_px: float) -> None:
    best = found.best
    used = np.isfinite(best.residual)
    contrast = float(np.std((best.illumination_map * best.signal)[used]))
    if contrast < FAINTEST * float(np.median(shot.sigma)):
        raise PhysicsError(
            f"{shot.file}: too few fringes, or too faint, stand out of the noise to calibrate "
            "from; raise the load until at least two are seen, or expose longer"
        )
    if slope * seen_px < FEWEST or best.standard_uncertainty[0] > 0.2 * slope:
        raise PhysicsError(
            f"{shot.file}: {slope * seen_px:.2f} fringes in view are too few to calibrate from; "
            "raise the load until at least two are seen"
        )
    rivals = [
        m for m in found.others if abs(m.values[0] / slope - 1) > 0.02 and m.chi < 1.05 * best.chi
    ]
    if rivals:
        raise PhysicsError(
            f"{shot.file}: two fringe slopes explain it equally well (chi {best.chi:.2f} and "
            f"{rivals[0].chi:.2f}); raise the load, or crop the image to the beam with roi"
        )
    if not (best.converged and best.positive):
        raise PhysicsError(
            f"{shot.file}: the fringes could not be fitted; check that the image shows the span "
            "between the inner rollers, with the beam along the rows, and the field (dark, bright)"
        )


def _view(shot: Shot, fit: IntensityFit, order: Any, cols: Any, pixel_mm: float) -> View:
    middle = fit.signal.shape[1] // 2
    stride = float(cols[1] - cols[0]) if len(cols) > 1 else 1.0
    orders = order(fit.values)[:, middle]
    model = fit.illumination_map * fit.signal + fit.background_map
    inside = np.isfinite(fit.residual[:, middle])
    place = (np.arange(len(orders)) - fit.values[1]) * pixel_mm
    return View(
        shot.image[:, cols], np.where(np.isfinite(fit.residual), model, np.nan), fit.residual,
        float(np.median(shot.sigma)), (pixel_mm, pixel_mm * stride), place[inside],
        np.abs(orders[inside]), shot.image[inside, cols[middle]], model[inside, middle],
    )  # fmt: skip
