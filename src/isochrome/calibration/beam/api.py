"""Material fringe value from four-point bending.

Between the inner rollers M = P (Lo - Li)/4 and sigma_x = M eta/I with I = d h^3/12, so that
N = sigma_x d/f_sigma = 12 M eta/(f_sigma h^3): the thickness d cancels. The order at the edge,
eta = h/2, rises with the load by k = 3 (Lo - Li)/(2 h^2 f_sigma) fringes per N.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.beam.beam_edges import (
    BeamPicture,
    beam_pictures,
    check_beam_scale,
    edge_distance,
)
from isochrome.calibration.beam.beam_fit import PIXELS, BeamFit, beam_image, fit_beam
from isochrome.calibration.beam.beam_gamma import Tone, find_tone, undo_tone
from isochrome.calibration.beam.beam_joint import BeamJointFit, fit_beam_images
from isochrome.calibration.beam.beam_misfit import band_misfit, check_span
from isochrome.calibration.beam.beam_set import (
    beam_set_images,
    check_set_span,
    fit_beam_set,
    set_pictures,
)
from isochrome.calibration.loading import calibrate_channels
from isochrome.calibration.order_line import (
    Input,
    ResidualOrder,
    uncertainty_budget,
    widened_to_held_out,
)
from isochrome.calibration.result import Calibration, ImageFit
from isochrome.calibration.settings import Beam, SetLike, Uncertainty, load_set
from isochrome.calibration.shot import Shot, by_load, unused
from isochrome.calibration.whole_set.set_result import causes, sentences, stated_values
from isochrome.messages import message
from isochrome.output import with_uncertainty
from isochrome.scene import Camera, Polariscope

Array = NDArray[np.float64]

DOUBTFUL_CHI = 1.05
"""Above this the noise alone does not explain an image, whose tone curve and misfit are looked at.
"""

MOST_PIXELS = 300_000
"""Pixels of all images that are fitted together."""


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
      fringe_value_n_per_mm  14.601 ± 0.066
      chi                    0.996
      order_at_zero_load     0.050071 ± 0.000069
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
    held = stated_values(camera or Camera(), scope)
    fits, joined = _fit_all(loaded, idle, beam, pixel_mm)
    whole = fit_beam_set(fits, held)
    if whole is None:
        images, covariance, messages, pictures = _plain(fits, joined, loaded, idle, beam, pixel_mm)
        outcome: tuple[dict[str, Any], ...] = ()
    else:
        check_set_span(whole)
        images, covariance = beam_set_images(whole, fits, pixel_mm, doubtful=DOUBTFUL_CHI)
        outcome = causes(whole, scope.wavelength_nm)
        messages = sentences(whole, outcome)
        pictures = set_pictures(whole, fits)
    distance = edge_distance(pictures)
    if distance is not None:
        check_beam_scale(distance, beam, pixel_mm, uncertainty)
    rest, left = _rest(idle, joined)
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
        "beam",
        images,
        factor,
        inputs,
        covariance=covariance,
        unloaded=rest,
        messages=(*messages, *left),
    )
    return widened_to_held_out(replace(result, causes=outcome))


def _plain(
    fits: Sequence[BeamFit],
    joined: BeamJointFit | None,
    loaded: Sequence[Shot],
    idle: Sequence[Shot],
    beam: Beam,
    pixel_mm: float,
) -> tuple[list[ImageFit], Array | None, tuple[str, ...], list[BeamPicture]]:
    """The images' results as they are fitted at first, or with another tone."""
    tone: Tone | None = None
    messages: tuple[str, ...] = ()
    if max(f.best.chi for f in fits) > DOUBTFUL_CHI:
        tone = find_tone(fits)
    if tone is not None:
        loaded, idle = ([undo_tone(s, tone.gamma) for s in group] for group in (loaded, idle))
        fits, joined = _fit_all(loaded, idle, beam, pixel_mm)
        messages = (
            message(
                "grey_levels_not_linear",
                with_uncertainty=with_uncertainty(tone.gamma, tone.standard_uncertainty),
            ),
        )
    for fit in fits:
        check_span(fit)
    misfit = np.full(len(fits), tone.slope_change if tone else 0.0)
    if max(f.best.chi for f in fits) > DOUBTFUL_CHI:
        misfit = np.hypot(misfit, _misfit(fits, joined))
    images = [beam_image(f, pixel_mm, misfit=m) for f, m in zip(fits, misfit, strict=True)]
    orders = np.array([i.order for i in images])
    covariance = joined.covariance * np.outer(orders, orders) if joined else None
    return images, covariance, messages, beam_pictures(fits)


def _fit_all(
    loaded: Sequence[Shot], idle: Sequence[Shot], beam: Beam, pixel_mm: float
) -> tuple[Sequence[BeamFit], BeamJointFit | None]:
    """Each loaded image's fit, under one light where they share it (then the joint fit as well)."""
    pixels = min(PIXELS, MOST_PIXELS // (len(loaded) + len(idle)))
    fits = [fit_beam(shot, beam, pixel_mm, pixels=pixels) for shot in loaded]
    joined = fit_beam_images(fits, idle)
    return (joined.fits if joined else fits), joined


def _misfit(fits: Sequence[BeamFit], joined: BeamJointFit | None) -> Array:
    """What is not described, as fractions (n,) of the slopes: of all images, or of each."""
    if joined is not None:
        return band_misfit(fits, scaled=joined.scaled)
    return np.concatenate([band_misfit([f]) for f in fits])


def _rest(
    idle: Sequence[Shot], joined: BeamJointFit | None
) -> tuple[tuple[ResidualOrder, ...], tuple[str, ...]]:
    """What the unloaded images show, and a sentence where they could not be used."""
    if joined is not None and len(joined.rest) == len(idle):
        return joined.rest, ()
    return (), unused(idle, message("because_light_not_loaded"))
