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

from isochrome.calibrate.beam_fit import PIXELS, BeamFit, fit_beam
from isochrome.calibrate.beam_image import beam_image
from isochrome.calibrate.beam_joint import Together, fit_together
from isochrome.calibrate.beam_misfit import band_misfit, check_span
from isochrome.calibrate.beam_tone import Tone, find_tone, undo_tone
from isochrome.calibrate.channels import calibrate_channels
from isochrome.calibrate.conclude import Input, conclude
from isochrome.calibrate.rest import Rest
from isochrome.calibrate.result import Calibration
from isochrome.calibrate.settings import Beam, CalibrationSet, Uncertainty, load_set
from isochrome.calibrate.shot import Shot, as_shots, loaded_shots

Array = NDArray[np.float64]

DOUBTFUL_CHI = 1.05
"""Above this the noise alone does not explain an image, whose tone curve and misfit are looked at.
"""

MOST_PIXELS = 300_000
"""Pixels of all images that are fitted together."""


def calibrate_bending(source: str | Path | CalibrationSet) -> Calibration:
    """Calibrate the material fringe value from images of a beam in four-point bending.

    Parameters: `source`, a calibration set (TOML path or CalibrationSet) with [beam].
    Returns the Calibration; its order at zero load is at the beam's edge. Raises InputError for
    a set or a file that is wrong, PhysicsError where the images do not determine the value.
    """
    return calibrate_channels(load_set(source, specimen="beam"), _calibrate_one)


def _calibrate_one(given: CalibrationSet) -> Calibration:
    """Calibrate from one channel, or from grey images."""
    from isochrome.calibrate.load import read_shots

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
    loaded, _ = loaded_shots(shots)
    idle = [s for s in shots if s.load_n == 0]
    height_px = beam.height_mm / pixel_mm
    common: dict[str, Any] = {"bright": bright, "light": light}
    fits, joined = _fit_all(loaded, idle, beam, pixel_mm, common)
    tone: Tone | None = None
    said: tuple[str, ...] = ()
    if max(f.best.chi for f in fits) > DOUBTFUL_CHI:
        tone = find_tone(fits, height_px, **common)
    if tone is not None:
        loaded, idle = ([undo_tone(s, tone.gamma) for s in group] for group in (loaded, idle))
        fits, joined = _fit_all(loaded, idle, beam, pixel_mm, common)
        said = (
            f"the grey levels are not linear in light: gamma = {tone.gamma:.2f} +- "
            f"{tone.standard_uncertainty:.2f} times the one given describes the fringes, and was "
            "used; set camera.gamma to the product",
        )
    for fit in fits:
        check_span(fit, height_px, **common)
    misfit = np.full(len(fits), tone.slope_change if tone else 0.0)
    if max(f.best.chi for f in fits) > DOUBTFUL_CHI:
        misfit = np.hypot(misfit, _misfit(fits, joined, height_px, common))
    images = [
        beam_image(f, height_px, pixel_mm, misfit=m) for f, m in zip(fits, misfit, strict=True)
    ]
    rest, left = _rest(idle, joined)
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
    orders = np.array([i.order for i in images])
    covariance = joined.covariance * np.outer(orders, orders) if joined else None
    return conclude(
        "beam", images, factor, inputs, covariance=covariance, rest=rest, said=(*said, *left)
    )


def _fit_all(
    loaded: Sequence[Shot],
    idle: Sequence[Shot],
    beam: Beam,
    pixel_mm: float,
    common: dict[str, Any],
) -> tuple[Sequence[BeamFit], Together | None]:
    """Each loaded image's fit, under one light where they share it (then the Together as well)."""
    pixels = min(PIXELS, MOST_PIXELS // (len(loaded) + len(idle)))
    fits = [fit_beam(shot, beam, pixel_mm, pixels=pixels, **common) for shot in loaded]
    joined = fit_together(fits, idle, beam.height_mm / pixel_mm, **common)
    return (joined.fits if joined else fits), joined


def _misfit(
    fits: Sequence[BeamFit], joined: Together | None, height_px: float, common: dict[str, Any]
) -> Array:
    """What is not described, as fractions (n,) of the slopes: of all images, or of each."""
    if joined is not None:
        return band_misfit(fits, height_px, scaled=joined.scaled, **common)
    return np.array([float(band_misfit([f], height_px, **common)[0]) for f in fits])


def _rest(
    idle: Sequence[Shot], joined: Together | None
) -> tuple[tuple[Rest, ...], tuple[str, ...]]:
    """What the unloaded images show, and a sentence where they could not be used."""
    if joined is not None and len(joined.rest) == len(idle):
        return tuple(Rest(s.file, *q) for s, q in zip(idle, joined.rest, strict=True)), ()
    names = ", ".join(s.file for s in idle)
    said = (f"{names}: no load, not used, because its light is not the loaded images'",)
    return (), said if idle else ()
