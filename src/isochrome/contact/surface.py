r"""Elastic displacement of the contact's surface, by convolution on a uniform grid.

Pressure is linear between nodes (a sum of hats of half-width h). The displacement into the block,

    u(x) = -(2/(pi E*)) ∫ p(t) ln|x-t| dt - (mu/(2 G*)) ∫_x^{x2} p(t) dt + C,

is then exact at every node, and a sum over differences of nodes: one FFT each way, zero-padded so
that nothing is periodic. Source: Johnson (1985), Contact Mechanics, sections 2.4 and 5.4. The
second integral is antisymmetric up to a constant, which the approach of the bodies takes up.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.linalg import toeplitz

Floats = NDArray[np.floating]

COARSER = 4
"""Spacing of the next coarser grid over this one's."""
_DENSE = 256
"""Nodes up to which the operator is kept as a matrix: there a direct solve is the fastest."""

_NEAR = 20
"""Lags below which the antiderivative's second difference is used; above, its series."""


@dataclass(frozen=True, kw_only=True)
class Surface:
    """The surface operator of one grid of n nodes: spectra made once, used by every solve.

    The symbols on an endless grid are those of the same kernels; their inverse is the
    preconditioner.
    """

    nodes: int
    spacing_mm: float  # h
    modulus_mpa: float  # E*
    normal: NDArray[np.complex128] = field(repr=False)  # spectrum of the normal influence, mm/MPa
    # mm/MPa per unit mu; None: no coupling
    coupling: NDArray[np.complex128] | None = field(repr=False)
    lattice_normal: Floats = field(repr=False)  # symbol on an endless grid
    lattice_coupling: NDArray[np.complex128] | None = field(repr=False)
    # small grids: the kernels (n, n)
    dense: tuple[Floats, Floats | None] | None = field(repr=False)
    # large grids: every fourth node, where a cold start begins
    coarse: Surface | None = field(repr=False)

    @property
    def length(self) -> int:
        """Length of the zero-padded transforms."""
        return int(scipy.fft.next_fast_len(2 * self.nodes, real=True))


@lru_cache(maxsize=8)
def make_surface(
    nodes: int, spacing_mm: float, *, contact_modulus_mpa: float, coupling_per_mpa: float = 0.0
) -> Surface:
    """The surface operator of a grid, for E* and the coupling 1/G* (0: none).

    The last ones are kept: a video's frames are solved on one. Source: see the module.
    """
    n, h = nodes, spacing_mm
    length = int(scipy.fft.next_fast_len(2 * n, real=True))
    half = -2.0 / (np.pi * contact_modulus_mpa) * log_of_hat(n, h)
    theta = 2.0 * np.pi * np.arange(length // 2 + 1) / length
    coupling = lattice_coupling = ahead = None
    if coupling_per_mpa != 0.0:
        step = 0.25 * coupling_per_mpa * h
        ahead = np.r_[0.0, np.full(n - 1, step)]
        coupling = scipy.fft.rfft(_circular(ahead, length, odd=True))
        with np.errstate(divide="ignore", invalid="ignore"):
            lattice_coupling = -1j * step / np.tan(theta / 2.0)
        lattice_coupling[0] = 0.0
    return Surface(
        nodes=n,
        spacing_mm=h,
        modulus_mpa=contact_modulus_mpa,
        normal=scipy.fft.rfft(_circular(half, length)),
        coupling=coupling,
        lattice_normal=2.0 * h / contact_modulus_mpa * _lattice_symbol(theta),
        lattice_coupling=lattice_coupling,
        dense=None
        if n > _DENSE
        else (toeplitz(half), None if ahead is None else toeplitz(ahead, -ahead)),
        coarse=None
        if n <= _DENSE
        else make_surface(
            (n - 1) // COARSER + 1,
            COARSER * h,
            contact_modulus_mpa=contact_modulus_mpa,
            coupling_per_mpa=coupling_per_mpa,
        ),
    )


def displacement(surface: Surface, pressure: Floats, *, friction: float = 0.0) -> Floats:
    """Displacement u into the block at the nodes (..., n), mm, up to a constant; mu of q = mu p."""
    spectrum = combined(surface.normal, surface.coupling, friction)
    product = spectrum * scipy.fft.rfft(pressure, surface.length)
    return np.asarray(scipy.fft.irfft(product, surface.length)[..., : surface.nodes])


def combined(
    normal: NDArray[Any], coupling: NDArray[np.complex128] | None, friction: float
) -> NDArray[Any]:
    """Spectrum of the normal kernel plus mu times the coupling's, which may be absent."""
    return normal if coupling is None or friction == 0.0 else normal + friction * coupling


def log_of_hat(nodes: int, spacing_mm: float) -> Floats:
    r"""Integrals ∫ hat(t) ln|x_j - t| dt for lags j = 0 .. nodes-1, hat of half-width h.

    Equation: [F(x+h) - 2F(x) + F(x-h)]/h with F = x² ln|x|/2 - 3x²/4 near by, and the hat's
    moments, h (ln x - Σ_m (h/x)^{2m} / (m (2m+1) (2m+2))), from lag 20, where F cancels.
    Parameters: `nodes`; `spacing_mm` h (mm). Returns (nodes,), mm.
    """
    lag = np.arange(nodes, dtype=float)
    far_lag = np.maximum(lag, _NEAR)
    series = np.log(far_lag)
    for m in range(1, 6):
        series -= far_lag ** (-2.0 * m) / (m * (2 * m + 1) * (2 * m + 2))
    near = lag[:_NEAR]
    series[:_NEAR] = _second_antiderivative(near + 1) + _second_antiderivative(near - 1)
    series[:_NEAR] -= 2.0 * _second_antiderivative(near)
    result: Floats = spacing_mm * (series + np.log(spacing_mm))
    return result


def _second_antiderivative(x: Floats) -> Floats:
    safe = np.where(x == 0.0, 1.0, np.abs(x))
    return x * x * (0.5 * np.log(safe) - 0.75)


def _circular(half: Floats, length: int, *, odd: bool = False) -> Floats:
    """A kernel of lags 0 .. n-1 laid out on a circle, even or odd in the lag."""
    full = np.zeros(length)
    full[: len(half)] = half
    full[length - len(half) + 1 :] = (-1.0 if odd else 1.0) * half[:0:-1]
    return full


def _lattice_symbol(theta: Floats) -> Floats:
    """Transform of -ln|x|/pi against hats on an endless unit lattice: Σ_l sinc²(w/2)/|w|.

    w = theta + 2 pi l; the zero mode, which the load fixes, is given a finite stand-in.
    """
    shifts = theta[:, None] + 2.0 * np.pi * np.arange(-8, 9)[None, :]
    w = np.where(shifts == 0.0, theta[1] / 4.0, np.abs(shifts))
    return np.asarray((np.sinc(w / (2.0 * np.pi)) ** 2 / w).sum(axis=1))
