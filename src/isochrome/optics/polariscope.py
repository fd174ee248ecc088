r"""The polariscope by Jones calculus: analyser · plate · specimen · plate · polariser.

A retarder of retardance δ with its fast axis at θ is J = cos(δ/2) I - i sin(δ/2) [[cos 2θ, sin 2θ],
[sin 2θ, -cos 2θ]]. The field behind the analyser is then α cos(δ/2) - i w sin(δ/2) with
w = β cos 2θ + γ sin 2θ, and α, β, γ three complex numbers of the elements alone. Real plates and
any angles so cost no more than ideal ones. The specimen's axis is the direction of sigma_1; which
of its axes is the fast one only turns the sign of δ, which no frame of matched plates shows.
Source: Theocaris & Gdoutos (1979), Matrix Theory of Photoelasticity; Jones (1941), JOSA 31, 488.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.scene import Polariscope, PolariscopeStep

Array = NDArray[np.floating]

_DARK = PolariscopeStep(
    polariser_deg=90.0, input_plate_deg=45.0, output_plate_deg=-45.0, analyser_deg=0.0
)
_BRIGHT = _DARK.model_copy(update={"analyser_deg": 90.0})


@dataclass(frozen=True)
class Chain:
    """The elements' three amplitudes: I = |α cos(δ/2) - i (β cos 2θ + γ sin 2θ) sin(δ/2)|².

    `ideal` is +1 for the ideal dark field, -1 for the ideal bright one, where θ drops out; else 0.
    """

    alpha: complex
    beta: complex
    gamma: complex
    ideal: int = 0


def make_chain(polariscope: Polariscope, step: int | None = None) -> Chain:
    """The amplitudes of a scene's polariscope.

    Parameters: `polariscope`; `step`, which of its phase steps (None: the dark or bright field).
    Plates are quarter-wave at `plate_wavelength_nm` (ideal when absent), so that their retardance
    is (π/2) plate_wavelength/wavelength: dispersion of the plate itself is left out.
    Returns a Chain.
    """
    ratio = 1.0
    if polariscope.plate_wavelength_nm is not None and polariscope.wavelength_nm is not None:
        ratio = polariscope.plate_wavelength_nm / polariscope.wavelength_nm
    if step is None:
        elements = _DARK if polariscope.field == "dark" else _BRIGHT
        if ratio == 1.0:
            dark = polariscope.field == "dark"
            return Chain(0j, 1 + 0j, 1j, 1) if dark else Chain(1 + 0j, 0j, 0j, -1)
    else:
        elements = polariscope.step[step]
    light = _axis(elements.polariser_deg)
    seen = _axis(elements.analyser_deg)
    if elements.input_plate_deg is not None and elements.output_plate_deg is not None:
        light = retarder(0.5 * math.pi * ratio, elements.input_plate_deg) @ light
        seen = seen @ retarder(0.5 * math.pi * ratio, elements.output_plate_deg)
    return Chain(
        complex(seen @ light),
        complex(seen[0] * light[0] - seen[1] * light[1]),
        complex(seen[0] * light[1] + seen[1] * light[0]),
    )


def retarder(retardance_rad: float, fast_axis_deg: float) -> NDArray[np.complex128]:
    """Jones matrix (2, 2) of a retarder with its fast axis at an angle from +x."""
    c, s = math.cos(0.5 * retardance_rad), math.sin(0.5 * retardance_rad)
    a, b = math.cos(math.radians(2 * fast_axis_deg)), math.sin(math.radians(2 * fast_axis_deg))
    return np.array([[c - 1j * s * a, -1j * s * b], [-1j * s * b, c + 1j * s * a]])


def _axis(angle_deg: float) -> NDArray[np.complex128]:
    """Unit vector along a polariser's axis."""
    angle = math.radians(angle_deg)
    return np.array([math.cos(angle), math.sin(angle)], dtype=complex)


def polariscope_signal(
    order: Array, chain: Chain, *, direction: Array | None = None, visibility: Array | float = 1.0
) -> Array:
    """Light behind the analyser, 1 for the full light of the ideal bright field.

    Equation: |α|² cos²(δ/2) + |w|² sin²(δ/2) - Im(α w*) sin δ with δ = 2 pi N, where the pixel's
    area scales cos δ and sin δ by its visibility. Ideal dark field: sin²(pi N).
    Parameters: `order` N (rows, cols); `chain`; `direction` θ of sigma_1 (rows, cols), rad, only
    needed where the chain is not ideal; `visibility` V in 0..1, see `pixel_visibility`.
    Returns (rows, cols).
    """
    cosine = visibility * np.cos(2.0 * np.pi * order)
    if chain.ideal:
        return 0.5 - 0.5 * chain.ideal * cosine
    if direction is None:
        raise ValueError("a chain that is not ideal needs the direction of sigma_1")
    w = chain.beta * np.cos(2.0 * direction) + chain.gamma * np.sin(2.0 * direction)
    straight, crossed = abs(chain.alpha) ** 2, np.abs(w) ** 2
    sine = visibility * np.sin(2.0 * np.pi * order)
    mixed = np.imag(chain.alpha * np.conj(w))
    return 0.5 * (straight + crossed) + 0.5 * (straight - crossed) * cosine - mixed * sine


def pixel_visibility(order: Array) -> tuple[Array, float]:
    r"""How much of the fringes' contrast is left by square pixels, and the share too fine to see.

    Equation: the mean of cos 2 pi N over a pixel in which N has the gradient g (fringes a pixel)
    is sinc(g_x) sinc(g_y) cos 2 pi N, with sinc(x) = sin(pi x)/(pi x).
    Parameters: `order` N (rows, cols), NaN where there is no specimen. Returns V (rows, cols), in
    0..1, and the share, of the pixels that bear fringes (N > 1/2), with one finer than two pixels.
    """
    rows, cols = _slope(order, 0), _slope(order, 1)
    visibility = np.maximum(np.sinc(rows), 0.0) * np.maximum(np.sinc(cols), 0.0)
    fine = np.hypot(rows, cols)[order > 0.5] > 0.5
    return visibility, float(fine.mean()) if fine.size else 0.0


def _slope(order: Array, axis: int) -> Array:
    """Fringes a pixel along an axis: the mean of the differences to the neighbours with an order.

    An edge of the specimen is so no fringe; 0 where there is neither neighbour.
    """
    step = np.diff(order, axis=axis)
    known = np.isfinite(step)
    if known.all():
        return np.asarray(np.gradient(order, axis=axis)) if step.size else np.zeros_like(order)
    before, after = [(0, 0), (0, 0)], [(0, 0), (0, 0)]
    before[axis], after[axis] = (1, 0), (0, 1)
    step = np.where(known, step, 0.0)
    count = np.pad(known.astype(int), before) + np.pad(known.astype(int), after)
    return np.asarray((np.pad(step, before) + np.pad(step, after)) / np.maximum(count, 1))
