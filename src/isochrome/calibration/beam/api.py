"""Material fringe value from four-point bending.

Between the inner rollers M = P (Lo - Li)/4 and sigma_x = M eta/I with I = d h^3/12, so that
N = sigma_x d/f_sigma = 12 M eta/(f_sigma h^3): the thickness d cancels. The order at the edge,
eta = h/2, rises with the load by k = 3 (Lo - Li)/(2 h^2 f_sigma) fringes per N.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from isochrome.calibration.beam.beam_edges import check_beam_scale, edge_distance
from isochrome.calibration.beam.beam_fit import fit_beam
from isochrome.calibration.beam.beam_set import (
    beam_images,
    check_span,
    fit_beam_set,
    moment_sentence,
    set_pictures,
)
from isochrome.calibration.loading import calibrate_channels
from isochrome.calibration.order_line import Input, uncertainty_budget, widened_to_held_out
from isochrome.calibration.result import Calibration
from isochrome.calibration.settings import Beam, SetLike, Uncertainty, load_set
from isochrome.calibration.shot import Shot, by_load, unused
from isochrome.calibration.whole_set.set_result import causes, sentences, stated_values
from isochrome.messages import message
from isochrome.scene import Camera, Polariscope


def calibrate_bending(source: SetLike) -> Calibration:
    """Calibrate the material fringe value from images of a beam in four-point bending.

    Between the inner loads the order grows linearly across the height, to N = 3 P (L_o - L_i)/(2 h²
    f_sigma) at the edge under the load P; f_sigma is found from the line of the images' orders over
    their loads, free of residual stress, which stays at zero load.

    Parameters
    ----------
    source : str, Path, CalibrationSet or mapping
        A calibration set with [beam]: its TOML file, a CalibrationSet, or its tables as
        dictionaries, in which an [[image]]'s file, and the no-load frames, may be arrays.

    Returns
    -------
    Calibration
        The fringe value (N/mm per fringe) with its standard uncertainty; its order at zero load is
        at the beam's edge.

    Raises
    ------
    InputError
        Where the set or a file is wrong.
    PhysicsError
        Where the images do not determine the value.

    Notes
    -----
    h is the beam's height and L_o, L_i are the outer and inner spans (mm). Source: Dally & Riley
    (1991), Experimental Stress Analysis, section 12.2; Timoshenko & Goodier (1970), Theory of
    Elasticity, art. 21.

    Examples
    --------
    Some ten seconds:

    >>> import isochrome
    >>> from isochrome.samples import samples_path
    >>> isochrome.calibrate_bending(samples_path() / "bending" / "set.toml")  # doctest: +SKIP
    Calibration from 4 images of a beam
      fringe_value_n_per_mm  14.600 ± 0.066
      chi                    0.996
      order_at_zero_load     0.04997 ± 0.00013
      1 warning: see .warnings
    """
    given = load_set(source, specimen="beam")
    beam, pixel_mm = given.beam, given.camera.pixel_mm
    assert beam is not None and pixel_mm is not None
    return calibrate_channels(
        given,
        lambda shots: bending_from_shots(
            shots, beam, pixel_mm, uncertainty=given.uncertainty, camera=given.camera,
            polariscope=given.polariscope,
        ),
    )  # fmt: skip


def bending_from_shots(
    shots: Sequence[Shot],
    beam: Beam,
    pixel_mm: float,
    *,
    uncertainty: Uncertainty | None = None,
    camera: Camera | None = None,
    polariscope: Polariscope | None = None,
) -> Calibration:
    """`calibrate_bending` on shots, see `as_shots`.

    Parameters
    ----------
    shots : sequence of Shot
        Prepared frames with their loads; one at least is loaded.
    beam : Beam
        The beam's sizes, mm.
    pixel_mm : float
        Size of a pixel, mm.
    uncertainty : Uncertainty, optional
        Standard uncertainties of the inputs.
    camera : Camera, optional
        What is known of the lens and the blur.
    polariscope : Polariscope, optional
        What is known of the light's wavelength and band.

    Returns
    -------
    Calibration
        The fringe value (N/mm per fringe) with its standard uncertainty.

    Raises
    ------
    InputError
        Where no shot has a load, or the beam's edges contradict its height and the pixel's size.
    PhysicsError
        Where the images do not determine the value.
    """
    loaded, idle = by_load(shots)
    scope = polariscope or Polariscope()
    fits = [fit_beam(shot, beam, pixel_mm) for shot in loaded]
    whole = fit_beam_set(fits, idle, stated_values(camera or Camera(), scope))
    check_span(whole)
    images, covariance, rest = beam_images(whole, fits, pixel_mm)
    outcome = causes(whole, scope.wavelength_nm)
    messages = (*sentences(whole, outcome), *moment_sentence(whole))
    if not rest:
        messages = (*messages, *unused(idle, message("because_light_not_loaded")))
    distance = edge_distance(set_pictures(whole, fits))
    if distance is not None:
        check_beam_scale(distance, beam, pixel_mm, uncertainty)
    arm = beam.outer_span_mm - beam.inner_span_mm
    factor = 1.5 * arm / beam.height_mm**2
    known = uncertainty or Uncertainty()
    inputs = (
        Input("load", known.load_percent, "%", 0.01),
        Input("height", known.height_mm, "mm", 3.0 / beam.height_mm),
        Input("spans", known.span_mm, "mm", float(np.sqrt(2.0)) / arm),
        Input("pixel scale", known.pixel_mm, "mm", 1.0 / pixel_mm),
        Input("thickness", known.thickness_mm, "mm", 0.0),
    )
    result = uncertainty_budget(
        "beam", images, factor, inputs, covariance=covariance, unloaded=rest, messages=messages
    )
    return widened_to_held_out(replace(result, causes=outcome))
