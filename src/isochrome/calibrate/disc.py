"""Material fringe value from a disc under diametral compression.

At the centre sigma1 - sigma2 = 8 P/(pi D d), so that N = (8/(pi D f_sigma)) P + N0: the thickness
d cancels, and an order N0 that stays at zero load (residual stress) does not touch the slope.
Elsewhere in the disc residual stress adds as a tensor: see `disc_residual`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibrate.channels import calibrate_channels
from isochrome.calibrate.conclude import Input, conclude
from isochrome.calibrate.disc_fit import fit_disc
from isochrome.calibrate.disc_joint_result import joint_images, residual_of
from isochrome.calibrate.disc_misfit import slope_misfit
from isochrome.calibrate.disc_restarts import own_unknowns, with_no_load
from isochrome.calibrate.disc_rise import fit_rise
from isochrome.calibrate.disc_starts import check_scans, choose_orders, scan_disc
from isochrome.calibrate.disc_together import FEWEST_LOADS, fit_together, plain_fit
from isochrome.calibrate.result import Calibration, ImageFit
from isochrome.calibrate.rim import Circle
from isochrome.calibrate.rise import overlay, rise_with_load
from isochrome.calibrate.settings import CalibrationSet, Disc, Uncertainty, load_set
from isochrome.calibrate.shot import Shot, as_shots, loaded_shots
from isochrome.errors import PhysicsError

Array = NDArray[np.float64]

BARELY = 1.05
"""Pooled chi up to which the closed form is taken to describe the single images."""

FROM_RISE = (
    "the closed form of a disc does not describe the single images (residual stress, bubbles, or "
    "other loads than two opposite points): f_sigma is from the rise of the order with load at "
    "every pixel, and the order at zero load is known up to a whole order"
)


def calibrate_disc(source: str | Path | CalibrationSet) -> Calibration:
    """Calibrate the material fringe value from images of a disc under diametral compression.

    Parameters: `source`, a calibration set (TOML path or CalibrationSet) with [disc].
    Returns the Calibration; its order at zero load is at the centre. Raises InputError for a set
    or a file that is wrong, PhysicsError where the images do not determine the value.
    """
    return calibrate_channels(load_set(source, specimen="disc"), _calibrate_one)


def _calibrate_one(given: CalibrationSet) -> Calibration:
    """Calibrate from one channel, or from grey images."""
    from isochrome.calibrate.load import read_shots

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
    loaded, said = loaded_shots(shots)
    scans = [scan_disc(shot, bright=bright) for shot in loaded]
    circles = [s.circle for s in scans]
    overlaid = overlay(loaded, circles)
    rise = rise_with_load(overlaid)
    clear = rise if rise is not None and rise.clear else None
    orders = choose_orders(
        scans, [s.load_n for s in loaded], rise_per_n=clear.slope if clear else None
    )
    images: Sequence[ImageFit]
    refused: PhysicsError | None = None
    try:
        images = [
            fit_disc(shot, scan.circle, scan.starts(order), disc, bright=bright, light=light)
            for shot, scan, order in zip(loaded, scans, orders, strict=True)
        ]
        own = own_unknowns(images)
    except PhysicsError as error:
        refused, images = error, ()
        own = np.stack([s.starts(o)[0] for s, o in zip(scans, orders, strict=True)])
    found = _look_further(shots, images, own, circles, disc, bright=bright, light=light)
    if found is None and refused is not None:
        if clear is None:
            check_scans(scans, loaded)
            raise refused
        images = fit_rise(loaded, circles, overlaid, clear, disc.diameter_mm, bright=bright)
        found = _Found(images, None, 0.0, None)
        said = (FROM_RISE, *said)
    assert found is not None
    if found.residual is not None:
        size, form = found.residual["largest_order"], found.residual["form"]
        said = (
            f"residual stress up to {size:.2f} fringe is fitted ({form}); f_sigma is free of it",
        )
    known = uncertainty or Uncertainty()
    inputs = (
        Input("load", known.load_percent, "%", 0.01),
        Input("diameter", known.diameter_mm, "mm", 1.0 / disc.diameter_mm),
        Input("thickness", known.thickness_mm, "mm", 0.0),
        *([Input("model misfit", 100.0 * found.misfit, "%", 0.01)] if found.misfit > 0 else []),
    )
    factor = 8.0 / (np.pi * disc.diameter_mm)
    result = conclude("disc", found.images, factor, inputs, covariance=found.covariance, said=said)
    return replace(result, residual=found.residual)


@dataclass(frozen=True)
class _Found:
    """The images' fits, their orders' `covariance`, the slope's relative `misfit`, the residual."""

    images: Sequence[ImageFit]
    covariance: Array | None
    misfit: float
    residual: dict[str, Any] | None


def _look_further(
    shots: Sequence[Shot],
    images: Sequence[ImageFit],
    own: Array,
    circles: Sequence[Circle],
    disc: Disc,
    *,
    bright: bool,
    light: ArrayLike | None,
) -> _Found | None:
    """A residual stress where the single fits leave a misfit; then what the misfit may do.

    None where the single images could not be fitted (`images` empty) and no residual stress
    explains them.
    """
    if images and np.mean([i.chi**2 for i in images]) <= BARELY**2:
        return _Found(images, None, 0.0, None)
    if np.unique([s.load_n for s in shots]).size >= FEWEST_LOADS:
        joint = fit_together(*with_no_load(shots, own), bright=bright, light=light)
        if joint is not None:
            together, covariance = joint_images(
                joint, [c.radius for c in circles], disc.diameter_mm
            )
            residual = residual_of(joint, disc.diameter_mm).to_json()
            return _Found(together, covariance, slope_misfit(joint), residual)
    if not images:
        return None
    plain = plain_fit([s for s in shots if s.load_n > 0], own, bright=bright, light=light)[0]
    return _Found(images, None, slope_misfit(plain), None)
