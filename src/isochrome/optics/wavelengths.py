"""The light as the camera weighs it: one wavelength, separate lines, or a spectrum in samples.

The light of a spectrum S(l) behind the polariscope, seen by a channel of response R(l), is
I = ∫ S R I(N l0/l) dl / ∫ S R dl, where l0 is the wavelength of the material fringe value: the
stress-optic constant is taken as the same at all wavelengths, so that the order goes as 1/l.
Source: Ajovalasit, Barone & Petrucci (1995), J. Strain Analysis 30, 29, for the integral.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.optics.response import Response
from isochrome.scene import Polariscope, Spectrum

Array = NDArray[np.floating]

WHITE = Spectrum(wavelength_nm=(400.0, 700.0), power=(1.0, 1.0))
"""Equal energy over the visible."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
_LONGEST_NM = 25.0
"""Six nodes a piece hold a Gaussian of 30 nm over this length to 1e-12."""


@dataclass(frozen=True)
class Light:
    """Light as the channels of a camera weigh it."""

    wavelength_nm: Array  # (s,)
    weights: Array  # (channels, s), of sum 1 in each channel
    continuous: bool  # samples of a spectrum, not lines


def make_light(polariscope: Polariscope, response: Response, *, highest_order: float) -> Light:
    """The wavelengths of a scene's light and their weights in each channel of the camera.

    A spectrum is integrated between its own and the response's samples, by Gauss-Legendre with six
    nodes for every half turn of the retardation, at the highest order in the picture, and every 25
    nm: 1e-9. InputError where a channel sees nothing of it, or the wavelength is missing.
    """
    if polariscope.lines is not None:
        places, power = np.array(polariscope.lines.wavelength_nm), np.array(polariscope.lines.power)
    elif polariscope.several_wavelengths:
        assert polariscope.wavelength_nm is not None
        spectrum = polariscope.spectrum or WHITE
        edges = _edges(spectrum, response, polariscope.wavelength_nm * highest_order)
        half, middle = 0.5 * np.diff(edges), 0.5 * (edges[1:] + edges[:-1])
        places = (middle[:, None] + half[:, None] * _NODES).ravel()
        power = (half[:, None] * _WEIGHTS).ravel()
        power *= np.interp(places, spectrum.wavelength_nm, spectrum.power)
    else:
        if polariscope.wavelength_nm is None:
            raise InputError(
                "[polariscope]: wavelength_nm is missing, and a camera with colour or response "
                "needs it; add it"
            )
        places, power = np.array([polariscope.wavelength_nm]), np.ones(1)
    weights = response.at(places) * power
    total = weights.sum(axis=1, keepdims=True)
    for name, light in zip(response.names, total[:, 0], strict=True):
        if not light > 0.0:
            raise InputError(
                f"[polariscope]: the camera's {name} channel sees nothing of the light; change "
                "the light's wavelengths, or camera.response"
            )
    weights /= total
    seen = (weights > 0.0).any(axis=0)
    continuous = polariscope.several_wavelengths and polariscope.lines is None
    return Light(places[seen], weights[:, seen], continuous)


def _edges(spectrum: Spectrum, response: Response, retardation_nm: float) -> Array:
    """Ends of the pieces in which the integrand is smooth and turns by half a fringe at most."""
    places = np.array(spectrum.wavelength_nm)
    if response.wavelength_nm is not None:
        inside = (response.wavelength_nm > places[0]) & (response.wavelength_nm < places[-1])
        places = np.union1d(places, response.wavelength_nm[inside])
    turns = retardation_nm * (1.0 / places[:-1] - 1.0 / places[1:])
    pieces = np.ceil(np.maximum(2.0 * turns, np.diff(places) / _LONGEST_NM)).astype(int)
    # equal steps of 1/l: equal turns
    inner = [
        1.0 / np.linspace(1.0 / a, 1.0 / b, n + 1)[:-1]
        for a, b, n in zip(places[:-1], places[1:], pieces, strict=True)
    ]
    return np.concatenate([*inner, places[-1:]])
