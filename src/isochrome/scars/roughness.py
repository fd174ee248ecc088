r"""Roughness by the power of its own bands: a spectrum from what is not worn, and what it does.

The heights beside a scar, less a smooth form, are a sum of waves of random phase, whose power
S(f) is constant in each of some octaves of the frequency f. The powers are those of the largest
restricted likelihood of the heights (which counts the form that was taken off), with the prior
that the logarithm of the power walks from octave to octave. A value w^T z that is linear in the
heights then has the variance

    u² = w^T C w = Σ_j S_j ∫_band |W(f)|² df,   W the transform of w.

Sources: Patterson & Thompson (1971), Biometrika 58, 545, for the restricted likelihood; ISO 21920-2
for roughness as the part of a profile in a band of wavelengths; Rasmussen & Williams (2006),
Gaussian Processes for Machine Learning, section 2.2, for the covariance of a smooth process.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

WALK = 0.6
"""Standard deviation of the prior's step of ln S from one octave to the next: between a plateau and
f^-0.9, so that f^-2, two of them, and tool marks come out of the data. Measured on 150 traces: the
pull of the worn area is 1.14 with it, and 1.25 with 1, which leaves each band to itself."""

_LONGER = 1.3
"""Period of the waves over the trace, so that its two ends are not neighbours."""

_STEPS, _SETTLED, _LONGEST_STEP = 30, 0.03, 2.0
"""Most steps of a fit, the change of ln S that ends it, and the largest change in one of them."""


@dataclass(frozen=True)
class Bands:
    """The waves of a uniform grid, by octaves of their frequency.

    `waves` (n, q): cosines and sines, unit amplitude; `band` (q,): the octave of each;
    `edges_per_mm` (m+1,): where the octaves end.
    """

    waves: Array
    band: NDArray[np.intp]
    edges_per_mm: Array

    @property
    def count(self) -> int:
        """Octaves."""
        return len(self.edges_per_mm) - 1


@lru_cache(maxsize=32)
def make_bands(points: int, spacing_mm: float) -> Bands:
    """Waves from one period over twice the trace to two points a period."""
    period = 2 * round(0.5 * _LONGER * points)
    number = np.arange(1, period // 2 + 1)
    phase = 2.0 * np.pi * np.outer(np.arange(points), number) / period
    waves = np.concatenate([np.cos(phase), np.sin(phase)], axis=1)
    frequency = number / (period * spacing_mm)
    lowest = 2.0 / (period * spacing_mm)
    octaves = max(2, int(np.floor(np.log2(frequency[-1] / lowest))))
    edges = np.r_[frequency[0], lowest * 2.0 ** np.arange(octaves), frequency[-1]]
    band = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, octaves)
    return Bands(waves, np.r_[band, band], edges)


@dataclass(frozen=True)
class Roughness:
    """The spectrum of a trace's roughness in m bands, as its unworn parts show it."""

    spacing_mm: float  # of the grid on which it was found
    edges_per_mm: Array  # (m+1,)
    power_um2: Array  # (m,): mean square of the heights that lie in a band
    log_covariance: Array  # (m, m), of the logarithms of the powers

    @property
    def rq_um(self) -> float:
        """Root mean square height over all its bands, µm."""
        return float(np.sqrt(self.power_um2.sum()))

    def covariance(self, points: int) -> Array:
        """Covariance of the heights on a uniform grid of so many points (n, n), µm²."""
        bands = make_bands(points, self.spacing_mm)
        return np.asarray((bands.waves * self._per_wave(bands)) @ bands.waves.T)

    def variance(self, weights: Array) -> tuple[float, float]:
        """Variance of w^T z for weights w (n,) on the grid, and the degrees of freedom it has.

        The variance is Σ S_j v_j; its own relative uncertainty by that of the powers, r, stands
        for 2/r² degrees of freedom (JCGM 100:2008, G.4.2).
        """
        bands = make_bands(len(weights), self.spacing_mm)
        parts = self._per_wave(bands) * (weights @ bands.waves) ** 2
        each = np.bincount(bands.band, parts, minlength=bands.count)
        total = float(each.sum())
        if not total > 0.0:
            return 0.0, np.inf
        share = each / total
        return total, float(2.0 / (share @ self.log_covariance @ share))

    def _per_wave(self, bands: Bands) -> Array:
        """Variance of each wave's amplitude (q,): half of the waves are cosines, half sines."""
        members = np.bincount(bands.band, minlength=bands.count) / 2.0
        return np.asarray((self.power_um2 / members)[bands.band])


def fit_roughness(
    heights_um: Array,
    unworn: NDArray[np.bool_],
    form: Array,
    spacing_mm: float,
    start: Roughness | None = None,
) -> Roughness:
    """The spectrum of the largest restricted likelihood of the unworn heights (n,).

    With C = Σ θ_j C_j and P = C⁻¹ - C⁻¹F(FᵀC⁻¹F)⁻¹FᵀC⁻¹ of a form F (n, p), the steps are those of
    Fisher's scoring in ln θ: gradient (θ_j/2)(zᵀP C_j P z - tr P C_j), information (θ_j θ_k/2) tr(P
    C_j P C_k), and the prior's of a walk. `start` is a spectrum near it.
    """
    bands = make_bands(len(heights_um), spacing_mm)
    waves, z, basis = bands.waves[unworn], heights_um[unworn], form[unworn]
    members = np.bincount(bands.band, minlength=bands.count) / 2.0
    residual = z - basis @ np.linalg.lstsq(basis, z, rcond=None)[0]
    size = max(float(residual @ residual) / len(z), 1e-12)
    starts = np.r_[0, np.cumsum(2.0 * members).astype(int)][:-1]
    order = np.argsort(bands.band, kind="stable")
    waves, band = waves[:, order], bands.band[order]
    walk = np.diff(np.eye(bands.count), axis=0) / WALK
    # a band of n times the width has n times the power where the spectrum is flat
    width = np.log(np.diff(bands.edges_per_mm))
    precision = walk.T @ walk
    log_power = np.log(size) + width - np.log(np.exp(width).sum())
    if start is not None:
        log_power = np.log(start.power_um2)
    for _ in range(_STEPS):
        theta = np.exp(log_power)
        gradient, information = _score(waves, band, starts, theta / members, z, basis)
        gradient = gradient - precision @ (log_power - width)
        step = np.linalg.solve(information + precision, gradient)
        step = np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
        log_power = log_power + step
        if float(np.abs(step).max()) < _SETTLED:
            break
    covariance = np.linalg.inv(information + precision)
    return Roughness(spacing_mm, bands.edges_per_mm, np.exp(log_power), covariance)


def _score(
    waves: Array,
    band: NDArray[np.intp],
    starts: NDArray[np.intp],
    each: Array,
    z: Array,
    basis: Array,
) -> tuple[Array, Array]:
    """Gradient and Fisher's information of the restricted likelihood in ln θ, (m,) and (m, m)."""
    scaled = waves * np.sqrt(each)[band]
    covariance = scaled @ scaled.T
    covariance[np.diag_indices_from(covariance)] *= 1.0 + 1e-9
    inverse = np.linalg.inv(covariance)
    carried = inverse @ basis
    projector = inverse - carried @ np.linalg.solve(basis.T @ carried, carried.T)
    weighted = scaled.T @ projector
    products = weighted @ scaled
    sizes = (weighted @ z) ** 2 - np.diag(products)
    gradient = 0.5 * np.bincount(band, sizes, minlength=len(each))
    squares = np.add.reduceat(np.add.reduceat(products**2, starts, axis=0), starts, axis=1)
    return gradient, 0.5 * squares
