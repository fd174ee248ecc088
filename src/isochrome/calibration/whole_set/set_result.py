"""From a whole set's fit to its misfit, its images' maps, and what it found, in words."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.settings import CalibrationSet
from isochrome.calibration.whole_set.set_fit import fitted_names, unexplained_order
from isochrome.calibration.whole_set.set_model import (
    BAND,
    BLUR,
    EVEN,
    FULL_WIDTH,
    GAMMA,
    LENS,
    SetFit,
    band_share,
)
from isochrome.fitting import NAMED, ORDER, SUSPECTED
from isochrome.messages import message
from isochrome.output import per_cent, with_uncertainty

Array = NDArray[np.float64]

CONTRADICTED = 3.0
"""Standard uncertainties by which a size must be off, and the least of them."""

SLIGHT = 0.01
"""Relative difference below which a scale that is taken as exact is not refused."""

NAMES = {
    "camera.distortion": "the lens's distortion",
    "camera.keystone_x": "a camera that looks from the side",
    "camera.keystone_z": "a camera that looks from above or below",
    BAND: "the light's band of wavelengths",
    BLUR: "blur",
    GAMMA: "the camera's tone curve",
}


def image_maps(fit: SetFit, index: int) -> dict[str, Any]:
    """An image's `image`, `model`, `residual` and `order` maps on the fit's pixels, NaN outside."""
    model, point = fit.model, fit.point
    own, image = model.images[index], model.shots[index].light[np.ix_(model.rows, model.cols)]
    residual, order = np.full((2, *own.mask.shape), np.nan)
    residual[own.mask] = point.linear[2][index] * own.sigma
    order[own.mask] = np.abs(model.order(index, fit.values))
    return {"image": image, "model": image - residual, "residual": residual, "order": order}


def image_chi(fit: SetFit, index: int) -> float:
    """Residual over noise of one image."""
    left = fit.point.linear[2][index]
    share = fit.unknowns / len(fit.model.shots)
    return float(np.sqrt(left @ left / max(1.0, left.size - share)))


def causes(fit: SetFit, wavelength_nm: float | None) -> tuple[dict[str, Any], ...]:
    """What was freed: key, value and standard uncertainty as a scene states them.

    A band's width needs the `wavelength_nm`; without, it is a share of it, and has no key.
    """
    result = []
    for key, (value, spread) in fit.shared.items():
        name: str | None = key
        if key in EVEN:
            value, spread = float(np.sqrt(value)), 0.5 * spread / float(np.sqrt(value))
            factor = 1.0 / float(np.sqrt(2.0) * np.pi)
            if key == BAND:
                factor *= FULL_WIDTH * (wavelength_nm or 1.0)
                name = key if wavelength_nm else None
            value, spread = factor * value, factor * spread
        result.append(
            {"key": name, "cause": NAMES[key], "value": value, "standard_uncertainty": spread}
        )
    return tuple(result)


def cause_sentence(cause: Mapping[str, Any]) -> str:
    """Say of a cause that a calibration found and used what it is, and where a set states it.

    Parameters
    ----------
    cause : mapping
        One of `Calibration.causes`.

    Returns
    -------
    str
        As it stands in the calibration's warnings.
    """
    value = with_uncertainty(cause["value"], cause["standard_uncertainty"])
    if cause["key"] == GAMMA:
        return message("grey_levels_not_linear", with_uncertainty=value)
    if cause["key"]:
        return message(
            "describes_fringes_used_set", cause=cause["cause"], key=cause["key"], value=value
        )
    return message("wavelength_full_width_half", cause=cause["cause"], value=value)


def sentences(fit: SetFit, found: tuple[dict[str, Any], ...]) -> tuple[str, ...]:
    """What was found and used, a sentence each."""
    messages = [cause_sentence(item) for item in found]
    count = sum(len(t) for t in fit.model.terms)
    plain = 9 if fit.model.shots[0].no_load_light is None else 6
    if count > plain:
        messages.append(message("light_more_uneven_quadratic", plain=count - plain))
    if fit.left_out > 0:
        messages.append(message("pixels_fit_nothing_dust", per_cent=per_cent(fit.left_out)))
    if fit.weighed is None:
        return tuple(messages)
    fitted = fitted_names(fit.model)
    chances = {n: c for n, c in fit.weighed.sets.chances.items() if n not in fitted}
    if chances.pop(ORDER, 0.0) > NAMED:
        size = 100.0 * unexplained_order(fit.weighed.sets)
        messages.append(message("orders_differ_unexplained", size=size))
    likely = [f"{NAMES.get(n, n)} ({per_cent(c)})" for n, c in chances.items() if c > SUSPECTED]
    if likely:
        messages.append(message("frames_may_show", who="the images", parts=" or ".join(likely)))
    return tuple(messages)


def stated_values(given: CalibrationSet) -> dict[str, float]:
    """What a set states of its camera and its light, as the model holds it."""
    held = {key: float(getattr(given.camera, key.partition(".")[2])) for key in LENS}
    wavelength, band = given.polariscope.wavelength_nm, given.polariscope.bandwidth_nm
    if wavelength and band:
        held[BAND] = band_share(band, wavelength)
    held[BLUR] = 2.0 * (np.pi * given.camera.blur_px) ** 2
    return {key: value for key, value in held.items() if value}


def contradiction(
    size_px: float, spread_px: float, name: str, size_mm: float, given: CalibrationSet
) -> dict[str, Any] | None:
    """What the images say against a size and a pixel's, beyond all their uncertainties.

    Parameters: the size as seen, with its standard uncertainty; the `name` of its key and its value
    in the set `given`. Returns the values of a message, None where they agree.
    """
    known, pixel_mm = given.uncertainty, given.camera.pixel_mm
    assert pixel_mm is not None
    stated = size_mm / pixel_mm
    size, pixel = getattr(known, name) or 0.0, known.pixel_mm or 0.0
    off, parts = abs(size_px / stated - 1.0), (spread_px / stated, size / size_mm, pixel / pixel_mm)
    if off <= max(CONTRADICTED * float(np.linalg.norm(parts)), SLIGHT):
        return None
    seen = with_uncertainty(size_px, spread_px)
    return {
        "with_uncertainty": seen,
        name: size_mm,
        "pixel_mm": pixel_mm,
        "stated": stated,
        "off": off,
    }
