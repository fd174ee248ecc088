"""Material fringe value from four-point bending.

Between the inner rollers M = P (Lo - Li)/4 and sigma_x = M eta/I with I = d h^3/12, so that
N = sigma_x d/f_sigma = 12 M eta/(f_sigma h^3): the thickness d cancels. The order at the edge,
eta = h/2, rises with the load by k = 3 (Lo - Li)/(2 h^2 f_sigma) fringes per N.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibrate.beam_view import FEWEST, BeamView, find_beam
from isochrome.calibrate.conclude import Input, conclude
from isochrome.calibrate.result import Calibration, ImageFit, View
from isochrome.calibrate.settings import Beam, CalibrationSet, Uncertainty, load_set
from isochrome.calibrate.shot import Shot, as_shots
from isochrome.calibrate.smooth import smooth_starts
from isochrome.errors import InputError, PhysicsError
from isochrome.fit import IntensityFit, SeveralStarts

Array = NDArray[np.float64]

PIXELS = 150_000
"""Pixels of an image that are fitted; more add nothing to the uncertainty that matters."""

MARGIN = 0.02
"""Part of the height left out at each edge, where chamfers and blur are."""


def calibrate_bending(source: str | Path | CalibrationSet) -> Calibration:
    """Calibrate the material fringe value from images of a beam in four-point bending.

    Parameters: `source`, a calibration set (TOML path or CalibrationSet) with [beam].
    Returns the Calibration; its order at zero load is at the beam's edge. Raises InputError for
    a set or a file that is wrong, PhysicsError where the images do not determine the value.
    """
    from isochrome.calibrate.load import read_shots

    given = load_set(source, specimen="beam")
    assert given.beam is not None and given.camera.pixel_mm is not None
    shots, light = read_shots(given)
    return bending_from_shots(
        shots,
        given.beam,
        given.camera.pixel_mm,
        bright=given.polariscope.field == "bright",
        uncertainty=given.uncertainty,
        light=light,
    )


def bending_from_images(
    images: Sequence[ArrayLike],
    loads_n: Sequence[float],
    beam: Beam,
    pixel_mm: float,
    *,
    sigma: float | Sequence[ArrayLike] | None = None,
    bright: bool = False,
    uncertainty: Uncertainty | None = None,
) -> Calibration:
    """`calibrate_bending` on arrays: `images` linear in light, each (rows, cols), at `loads_n`.

    Parameters: `beam`, its sizes in mm; `pixel_mm`; `sigma`, the images' noise (estimated where
    None); `bright`, for a bright field; `uncertainty` of the inputs.
    """
    shots = as_shots(images, loads_n, sigma=sigma)
    return bending_from_shots(shots, beam, pixel_mm, bright=bright, uncertainty=uncertainty)


def bending_from_shots(
    shots: Sequence[Shot],
    beam: Beam,
    pixel_mm: float,
    *,
    bright: bool = False,
    uncertainty: Uncertainty | None = None,
    light: ArrayLike | None = None,
) -> Calibration:
    """`bending_from_images` on shots; `light` (rows, cols), the no-load bright minus dark frame."""
    loaded = [s for s in shots if s.load_n > 0]
    if not loaded:
        raise InputError("no image has a load above zero; a calibration needs a loaded one")
    images = [fit_beam(shot, beam, pixel_mm, bright=bright, light=light) for shot in loaded]
    factor = 1.5 * (beam.outer_span_mm - beam.inner_span_mm) / beam.height_mm**2
    known = uncertainty or Uncertainty()
    arm = beam.outer_span_mm - beam.inner_span_mm
    inputs = (
        Input("load", known.load_percent, "%", 0.01),
        Input("height", known.height_mm, "mm", 3.0 / beam.height_mm),
        Input("spans", known.span_mm, "mm", float(np.sqrt(2.0)) / arm),
        Input("pixel scale", known.pixel_mm, "mm", 1.0 / pixel_mm),
        Input("thickness", known.thickness_mm, "mm", 0.0),
    )
    return conclude("beam", images, factor, inputs)


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
