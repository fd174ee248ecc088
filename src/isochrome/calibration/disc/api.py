"""Material fringe value from a disc under diametral compression.

At the centre sigma1 - sigma2 = 8 P/(pi D d), so that N = (8/(pi D f_sigma)) P + N0: the thickness
d cancels, and an order N0 that stays at zero load (residual stress) does not touch the slope.
Elsewhere in the disc residual stress adds as a tensor: see `disc_residual`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.disc.disc_fit import fit_disc
from isochrome.calibration.disc.disc_set import (
    check_diameter,
    disc_images,
    fit_disc_set,
    residual_of,
)
from isochrome.calibration.disc.disc_starts import check_scans, choose_centre_orders, scan_disc
from isochrome.calibration.disc.order_slope import fit_rise, overlay, rise_with_load
from isochrome.calibration.loading import calibrate_channels
from isochrome.calibration.order_line import Input, uncertainty_budget, widened_to_held_out
from isochrome.calibration.result import Calibration, ImageFit
from isochrome.calibration.settings import Disc, SetLike, Uncertainty, load_set
from isochrome.calibration.shot import Shot, by_load, unused
from isochrome.calibration.whole_set.set_model import SetFit
from isochrome.calibration.whole_set.set_result import causes, sentences, stated_values
from isochrome.errors import PhysicsError
from isochrome.messages import message
from isochrome.scene import Camera, Polariscope

Array = NDArray[np.float64]


def calibrate_disc(source: SetLike) -> Calibration:
    """Calibrate the material fringe value from images of a disc under diametral compression.

    The whole field of orders is fitted to each image; at the centre N = 8 P/(pi D f_sigma) under
    the load P. f_sigma is found from the line of the images' orders over their loads, free of
    residual stress, which stays at zero load.

    Parameters
    ----------
    source : str, Path, CalibrationSet or mapping
        A calibration set with [disc]: its TOML file, a CalibrationSet, or its tables as
        dictionaries, in which an [[image]]'s file, and the no-load frames, may be arrays.

    Returns
    -------
    Calibration
        The fringe value (N/mm per fringe) with its standard uncertainty; its order at zero load is
        at the centre.

    Raises
    ------
    InputError
        Where the set or a file is wrong.
    PhysicsError
        Where the images do not determine the value.

    Notes
    -----
    D is the disc's diameter (mm). Source: Dally & Riley (1991), Experimental Stress Analysis,
    section 12.2; Timoshenko & Goodier (1970), Theory of Elasticity, art. 41.

    Examples
    --------
    Half a minute:

    >>> import isochrome
    >>> from isochrome.samples import samples_path
    >>> isochrome.calibrate_disc(samples_path() / "disc" / "set.toml")  # doctest: +SKIP
    Calibration from 3 images of a disc
      fringe_value_n_per_mm  14.599 ± 0.044
      chi                    0.991
      order_at_zero_load     -0.000086 ± 0.000055
      1 warning: see .warnings
    """
    given = load_set(source, specimen="disc")
    disc = given.disc
    assert disc is not None
    return calibrate_channels(
        given,
        lambda shots: disc_from_shots(
            shots, disc, uncertainty=given.uncertainty, camera=given.camera,
            polariscope=given.polariscope,
        ),
    )  # fmt: skip


def disc_from_shots(
    shots: Sequence[Shot],
    disc: Disc,
    *,
    uncertainty: Uncertainty | None = None,
    camera: Camera | None = None,
    polariscope: Polariscope | None = None,
) -> Calibration:
    """`calibrate_disc` on shots, see `as_shots`.

    Parameters
    ----------
    shots : sequence of Shot
        Prepared frames with their loads; one at least is loaded.
    disc : Disc
        The disc's sizes, mm.
    uncertainty : Uncertainty, optional
        Standard uncertainties of the inputs.
    camera : Camera, optional
        What is known of the lens and the blur, and a pixel's size, which the rim is held against.
    polariscope : Polariscope, optional
        What is known of the light's wavelength and band.

    Returns
    -------
    Calibration
        The fringe value (N/mm per fringe) with its standard uncertainty.

    Raises
    ------
    InputError
        Where no shot has a load, or the rim contradicts the diameter and the pixel's size.
    PhysicsError
        Where the images do not determine the value.
    """
    loaded, idle = by_load(shots)
    camera, scope = camera or Camera(), polariscope or Polariscope()
    outcome = _find(loaded, idle, disc, stated_values(camera, scope))
    freed: tuple[dict[str, Any], ...] = ()
    if outcome.whole is None:
        messages = (
            message("closed_form_disc_does"),
            *unused(idle, message("order_zero_load_from")),
        )
    else:
        if camera.pixel_mm is not None:
            check_diameter(outcome.images, disc, camera.pixel_mm, uncertainty)
        freed = causes(outcome.whole, scope.wavelength_nm)
        messages = sentences(outcome.whole, freed)
    if outcome.residual is not None:
        size, form = outcome.residual["largest_order"], outcome.residual["form"]
        messages = (*messages, message("residual_stress_up_fringe", size=size, form=form))
    known = uncertainty or Uncertainty()
    inputs = (
        Input("load", known.load_percent, "%", 0.01),
        Input("diameter", known.diameter_mm, "mm", 1.0 / disc.diameter_mm),
        Input("thickness", known.thickness_mm, "mm", 0.0),
    )
    factor = 8.0 / (np.pi * disc.diameter_mm)
    result = uncertainty_budget(
        "disc", outcome.images, factor, inputs, covariance=outcome.covariance, messages=messages
    )
    return widened_to_held_out(replace(result, residual=outcome.residual, causes=freed))


@dataclass(frozen=True)
class _Found:
    """The images' fits, their orders' `covariance`, the residual, and the `whole` set's fit they
    are of; None where the orders are from their rise, see `fit_rise`.
    """

    images: Sequence[ImageFit]
    covariance: Array | None = None
    residual: dict[str, Any] | None = None
    whole: SetFit | None = None


def _find(
    loaded: Sequence[Shot], idle: Sequence[Shot], disc: Disc, held: dict[str, float]
) -> _Found:
    """The loaded images' orders, all together, or from their rise with the load."""
    scans = [scan_disc(shot) for shot in loaded]
    circles = [s.circle for s in scans]
    overlaid = overlay(loaded, circles)
    rise = rise_with_load(overlaid)
    clear = rise if rise is not None and rise.clear else None
    orders = choose_centre_orders(
        scans, [s.load_n for s in loaded], rise_per_n=clear.slope if clear else None
    )
    starts = [scan.starts(order) for scan, order in zip(scans, orders, strict=True)]
    refused: PhysicsError | None = None
    try:
        own = [fit_disc(*each) for each in zip(loaded, circles, starts, strict=True)]
    except PhysicsError as error:  # which residual stress may explain
        own, refused = [start[0] for start in starts], error
    whole = fit_disc_set(loaded, idle, np.array(own), held)
    if refused is not None and not (whole.model.besides and whole.explained):
        if clear is None:
            check_scans(scans, loaded)
            raise refused
        return _Found(fit_rise(loaded, circles, overlaid, clear, disc.diameter_mm))
    images, covariance = disc_images(whole, [c.radius for c in circles], disc.diameter_mm)
    return _Found(images, covariance, residual_of(whole, disc.diameter_mm), whole)
