"""A fitted image of a beam as a calibration reports it: its order at the edge, and what to show."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from isochrome.calibrate.beam_fit import BeamFit, beam_order
from isochrome.calibrate.result import ImageFit, View

Array = NDArray[np.float64]


def beam_image(fit: BeamFit, height_px: float, pixel_mm: float, *, misfit: float = 0.0) -> ImageFit:
    """The order at the edge eta = h/2, the geometry and the view of one fitted image.

    Parameters: `fit`; `height_px`, the beam's height, px; `pixel_mm`; `misfit`, standard
    uncertainty of the order from what the model does not describe, as a fraction of it.
    Returns the ImageFit.
    """
    slope, row, tilt = fit.best.values
    order = fit.gradient * 0.5 * height_px
    relative = float(fit.best.standard_uncertainty[0] / slope)
    geometry = {
        "tilt_deg": float(np.degrees(np.arctan(-tilt))),
        "neutral_axis_row_px": float(row),
        "top_edge_row_px": fit.view.top,
        "fringes_per_mm": fit.gradient / pixel_mm,
    }
    return ImageFit(
        fit.shot.file, fit.shot.load_n, order, order * relative, fit.best.chi, None, geometry,
        _view(fit, pixel_mm), order * misfit,
    )  # fmt: skip


def _view(fit: BeamFit, pixel_mm: float) -> View:
    shot, best, cols = fit.shot, fit.best, fit.pick
    middle = best.signal.shape[1] // 2
    stride = float(cols[1] - cols[0]) if len(cols) > 1 else 1.0
    orders = beam_order(best.values, *fit.places)[:, middle]
    model = best.illumination_map * best.signal + best.background_map
    inside = fit.mask[:, middle]
    place = (np.arange(len(orders)) - best.values[1]) * pixel_mm
    return View(
        shot.image[:, cols], np.where(fit.mask, model, np.nan), best.residual,
        float(np.median(shot.sigma)), (pixel_mm, pixel_mm * stride), place[inside],
        np.abs(orders[inside]), shot.image[inside, cols[middle]], model[inside, middle],
    )  # fmt: skip
