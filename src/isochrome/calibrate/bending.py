"""Material fringe value from four-point bending.

Between the inner rollers M = P (Lo - Li)/4 and sigma_x = M eta/I with I = d h^3/12, so that
N = sigma_x d/f_sigma = 12 M eta/(f_sigma h^3): the thickness d cancels. The order at the edge,
eta = h/2, rises with the load by k = 3 (Lo - Li)/(2 h^2 f_sigma) fringes per N.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from isochrome.calibrate.beam_fit import fit_beam
from isochrome.calibrate.conclude import Input, conclude
from isochrome.calibrate.result import Calibration
from isochrome.calibrate.settings import Beam, CalibrationSet, Uncertainty, load_set
from isochrome.calibrate.shot import Shot, as_shots, loaded_shots


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
    loaded, said = loaded_shots(shots)
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
    return conclude("beam", images, factor, inputs, said=said)
