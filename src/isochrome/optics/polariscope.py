"""The polariscope by Jones calculus (analyser, plate, specimen, plate, polariser), and its law.

A retarder of retardance δ with its fast axis at θ is J = cos(δ/2) I - i sin(δ/2) [[cos 2θ, sin 2θ],
[sin 2θ, -cos 2θ]]. The field behind the analyser is then α cos(δ/2) - i w sin(δ/2) with w = β cos
2θ + γ sin 2θ, and α, β, γ three complex numbers of the elements alone: real plates and any angles
cost no more than ideal ones. The specimen's axis is the direction of sigma_1; which of its axes is
the fast one only turns the sign of δ, which no frame of matched plates shows. Source: Theocaris &
Gdoutos (1979), Matrix Theory of Photoelasticity; Jones (1941), JOSA 31, 488.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.scene import Polariscope
from isochrome.stress import StressDifference


def fringe_order(
    difference_mpa: StressDifference, *, thickness_mm: float, fringe_value_n_per_mm: float
) -> NDArray[np.floating]:
    """Fringe order N (rows, cols) of the stress difference (sigma_x - sigma_z) + 2i tau_xz, MPa.

    N = (sigma_1 - sigma_2) d / f_sigma, f_sigma in N/mm per fringe; the retardation is 2 pi N.
    Source: Dally & Riley (1991), Experimental Stress Analysis, section 12.2.
    """
    order = np.asarray(np.abs(difference_mpa))
    order *= thickness_mm / fringe_value_n_per_mm
    return order


Array = NDArray[np.floating]

_HALF_HEIGHT = 2.0 * math.sqrt(2.0 * math.log(2.0))
"""Width of a Gaussian at half its height over its standard deviation."""

_Angles = tuple[float, float | None, float | None, float]
"""Polariser, input plate, output plate, analyser (degrees); no plates in a plane polariscope."""

_DARK: _Angles = (90.0, 45.0, -45.0, 0.0)
_BRIGHT: _Angles = (90.0, 45.0, -45.0, 90.0)


@dataclass(frozen=True)
class Chain:
    """The elements' three amplitudes: I = |α cos(δ/2) - i (β cos 2θ + γ sin 2θ) sin(δ/2)|²."""

    alpha: complex  # of light that the specimen leaves as it is
    beta: complex  # of what it changes, over cos 2θ
    gamma: complex  # over sin 2θ
    # +1 for the ideal dark field, -1 for the ideal bright one, where θ drops out; else 0
    ideal: int = 0
    band: float = 0.0  # standard deviation of the wavelengths over their mean


def make_chain(
    polariscope: Polariscope, step: int | None = None, *, wavelength_nm: float | None = None
) -> Chain:
    """The amplitudes of a scene's polariscope at one wavelength, by default the scene's one.

    The elements' errors are added to their angles. Plates are quarter-wave at `plate_wavelength_nm`
    (at every wavelength when absent), their retardance (π/2) plate_wavelength/wavelength: the
    dispersion of the birefringence is left out. The plane field is crossed, its polariser at
    `axis_deg`. `step`: which phase step. InputError where several wavelengths leave it open.
    """
    if wavelength_nm is None:
        if polariscope.several_wavelengths:
            raise InputError(message("polariscope_light_has_several"))
        wavelength_nm = polariscope.wavelength_nm
    ratio = 1.0
    if polariscope.plate_wavelength_nm is not None and wavelength_nm is not None:
        ratio = polariscope.plate_wavelength_nm / wavelength_nm
    band = 0.0
    if polariscope.bandwidth_nm is not None and polariscope.wavelength_nm is not None:
        band = polariscope.bandwidth_nm / _HALF_HEIGHT / polariscope.wavelength_nm
    nominal = _nominal_angles(polariscope, step)
    polariser, first, second, analyser = _with_errors(nominal, polariscope)
    if step is None and ratio == 1.0 and (polariser, first, second, analyser) in (_DARK, _BRIGHT):
        dark = analyser == _DARK[3]
        return Chain(0j, 1 + 0j, 1j, 1, band) if dark else Chain(1 + 0j, 0j, 0j, -1, band)
    light, output = _axis(polariser), _axis(analyser)
    if first is not None and second is not None:
        light = retarder(0.5 * math.pi * ratio, first) @ light
        output = output @ retarder(0.5 * math.pi * ratio, second)
    return Chain(
        complex(output @ light),
        complex(output[0] * light[0] - output[1] * light[1]),
        complex(output[0] * light[1] + output[1] * light[0]),
        band=band,
    )


def band_pass(order: Array, width: float) -> tuple[Array, Array]:
    """What a band of wavelengths takes from the fringes' contrast, V, and how it moves them, φ.

    The mean of exp(i a/(1+x)), a = 2 pi N, over Gaussian x of standard deviation s = `width`, with
    1/(1+x) = 1 - x + x², q = 2 a s², is exp(i a) V exp(i φ): V = (1+q²)^(-1/4) exp(-a² s²/(2 +
    2q²)), φ = atan(q)/2 - a³ s⁴/(1+q²), rad. What is left out moves a fringe by a s³ of a turn at
    most.
    """
    phase = np.asarray(2.0 * np.pi * order)
    bent = 2.0 * width**2 * phase
    below = 1.0 + bent**2
    contrast = below**-0.25 * np.exp(-0.5 * (width * phase) ** 2 / below)
    return contrast, 0.5 * np.arctan(bent) - width**4 * phase**3 / below


def _nominal_angles(polariscope: Polariscope, step: int | None) -> _Angles:
    """Angles of the elements as they should stand (degrees)."""
    if step is not None:
        angles = polariscope.step[step]
        plates = angles.input_plate_deg, angles.output_plate_deg
        return angles.polariser_deg, *plates, angles.analyser_deg
    if polariscope.field == "plane":
        axis = 90.0 if polariscope.axis_deg is None else polariscope.axis_deg
        return axis, None, None, axis + 90.0
    return _DARK if polariscope.field == "dark" else _BRIGHT


def _with_errors(angles: _Angles, polariscope: Polariscope) -> _Angles:
    """Angles of the elements as they do stand (degrees)."""
    polariser, first, second, analyser = angles
    if first is not None and second is not None:
        first += polariscope.input_plate_error_deg
        second += polariscope.output_plate_error_deg
    polariser += polariscope.polariser_error_deg
    return polariser, first, second, analyser + polariscope.analyser_error_deg


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
    """The light behind the analyser, 1 for the full light of the ideal bright field.

    |α|² cos²(δ/2) + |w|² sin²(δ/2) - Im(α w*) sin δ with δ = 2 pi N, where the pixel's area scales
    cos δ and sin δ by its visibility; ideal dark field: sin²(pi N). `direction` θ of sigma_1 (rad)
    is needed where the chain is not ideal (ValueError). Precise to 1e-14 in float64; in float32 to
    2e-7 and what the order carries: whole fringes are taken off first, which loses no digit.
    """
    # in place: a fresh array of a frame costs more than the arithmetic on it
    turns = np.asarray(np.rint(order))
    np.subtract(order, turns, out=turns)
    turns *= 2.0 * np.pi
    if chain.band:
        contrast, shift = band_pass(order, chain.band)
        visibility, turns = visibility * contrast, turns + shift
    if chain.ideal:
        light = np.cos(turns, out=turns)
        light *= visibility
        light *= -0.5 * chain.ideal
        light += 0.5
        return np.asarray(light)
    if direction is None:
        raise ValueError(message("chain_not_ideal_needs"))
    w = chain.beta * np.cos(2.0 * direction) + chain.gamma * np.sin(2.0 * direction)
    straight, crossed = abs(chain.alpha) ** 2, np.abs(w) ** 2
    mixed = np.imag(chain.alpha * np.conj(w))
    wave = 0.5 * (straight - crossed) * np.cos(turns) - mixed * np.sin(turns)
    return np.asarray(0.5 * (straight + crossed) + visibility * wave)
