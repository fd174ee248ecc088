"""Stress in a half-plane by the tractions' Fourier series: at any place, without kernels.

With ζ = x - i z below the surface, 1/(ζ-t) = i ∫_0^∞ exp(-iκ(ζ-t)) dκ, so that

    (sx - sz) + 2i txz = (2/π) ∫_0^∞ exp(-iκx - κz) [ zκ ŝ(κ) - i q̂(κ) ] dκ,

s = p + iq, ŝ(κ) = ∫ s exp(iκt) dt. A sum over κ = 2πn/L is the same for tractions repeated at every
L, and one FFT a row; where the contact stands is a phase, and its depth a factor. What the
repetitions add is smooth, a power series in (ζ-t)/L from the tractions' moments, by

    Σ_m 1/(u-mL) = 1/u - Σ_j 2 ζ_R(2j) u^(2j-1)/L^(2j),    |u| < L    (ζ_R Riemann's),

and is taken off by interpolation between few places. So are rows made between 14 of them, from a
depth to four times that: Chebyshev's coefficients of exp(-κz) beyond are I_14(3y/2) exp(-5y/2) <
2e-8.
Sources: Johnson (1985), Contact Mechanics, eq. 2.23, for the stress; Abramowitz & Stegun (1964),
4.3.70, for the series; Bluestein (1970), IEEE Trans. Audio 18, 451, for waves of any length.
"""

import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from isochrome.messages import message
from isochrome.stress.field import StressDifference

Floats = NDArray[np.floating]
Complexes = NDArray[np.complexfloating]

SHALLOWEST = 0.3
"""Rows nearer to the surface than this share of a node's spacing are taken to lie there."""

_DECAY = 18.0
"""κz beyond which a wave is left out: exp(-18) = 1.5e-8."""
_TERMS = 12
_PLACES = 14
_COSINES = np.cos(np.pi * (np.arange(_PLACES) + 0.5) / _PLACES)
"""Chebyshev's places on -1..1, (m,)."""
_REACH = 1.9
"""Period over the largest distance from a traction to a pixel: 12 terms then leave 2e-7 of the
repetitions, and the interpolation between 14 x 14 places less."""
_FARTHEST = 0.62


@dataclass(frozen=True, kw_only=True)
class SeriesGrid:
    """A lattice of pixels, and one of surface nodes, whose places are free."""

    rows: int
    cols: int
    pitch_mm: float
    nodes: int
    spacing_mm: float
    length: int  # period in pixels
    across: Floats = field(repr=False)  # (m, cols): interpolation from m places
    # (24, nodes): powers of the nodes' places over the period, for the tractions' moments
    powers: Floats = field(repr=False)
    # (24, 24): from moments to the power series of the repetitions' simple poles
    pairs: Floats = field(repr=False)
    poles: Floats = field(repr=False)  # (24, 24): the same, of their double poles

    @property
    def period_mm(self) -> float:
        """Distance L of the repetitions (mm)."""
        return self.length * self.pitch_mm


def make_series_grid(
    rows: int, cols: int, pitch_mm: float, *, nodes: int, spacing_mm: float, reach_mm: float
) -> SeriesGrid:
    """A lattice of pixels over one of surface nodes; quickest where `spacing_mm` divides the pitch.
    `reach_mm` is the largest distance of a loaded node from a pixel."""
    wanted = max(_REACH * reach_mm / pitch_mm, cols, nodes * spacing_mm / pitch_mm)
    length = int(scipy.fft.next_fast_len(math.ceil(wanted)))
    pairs, poles = _power_series()
    places = spacing_mm / (length * pitch_mm) * (np.arange(nodes) - 0.5 * (nodes - 1))
    return SeriesGrid(
        rows=rows, cols=cols, pitch_mm=pitch_mm, nodes=nodes, spacing_mm=spacing_mm, length=length,
        across=_interpolation(_steps(cols)).T.astype(np.float32),
        powers=np.vander(places, 2 * _TERMS, increasing=True).T.copy(), pairs=pairs, poles=poles,
    )  # fmt: skip


@dataclass(frozen=True)
class SeriesField:
    """A field (rows, cols), complex64, on a lattice of pixels; zero above the surface."""

    difference: StressDifference  # (sigma_x - sigma_z) + 2i tau_xz, MPa
    along: StressDifference | None  # its derivative along x, MPa/mm; None: not asked for
    down: StressDifference | None  # along z
    bending: Complexes | None = None  # d/dx + i d/dz of sigma_x + sigma_z, MPa/mm

    @property
    def slopes(self) -> tuple[StressDifference | None, StressDifference | None]:
        """Both derivatives."""
        return self.along, self.down


def series_difference(
    grid: SeriesGrid, *, x_mm: float, z_mm: float, left_mm: float, pressure_mpa: Floats,
    shear_mpa: Floats | None = None, slopes: bool = False, bending: bool = False,
    least_mm: float = 0.0,
) -> SeriesField:  # fmt: skip
    """(sigma_x - sigma_z) + 2i tau_xz on a lattice of pixels, with `slopes` its derivatives, with
    `bending` the gradient of sigma_x + sigma_z. Errs by 2e-7 of the largest traction; the slopes
    lack those of the repetitions, 1e-3 of them. `x_mm`, `z_mm`: of the first pixel; `left_mm`:
    the first node. Nothing is computed above `least_mm`: rows near the surface cost most.
    ValueError where a pixel is beyond the series' reach."""
    depth = z_mm + grid.pitch_mm * np.arange(grid.rows)
    first = int(np.searchsorted(depth, max(least_mm, SHALLOWEST * grid.spacing_mm)))
    count = 1 + 2 * slopes + bending
    maps = [np.zeros((grid.rows, grid.cols), np.complex64) for _ in range(count)]
    if first < grid.rows:
        groups, stop = [], first
        while stop < grid.rows:  # neighbouring rows that are alike: to four times a depth
            start, stop = stop, int(np.searchsorted(depth, 4.0 * depth[stop], side="right"))
            groups.append(slice(start, stop))
        few = [_few(depth[rows]) for rows in groups]
        fields = _repeated(
            grid, float(depth[first]), x_mm, left_mm, pressure_mpa, shear_mpa, few, slopes, bending
        )
        z, span = np.concatenate(few), (float(depth[0]), float(depth[-1]))
        repeated = _repetitions(grid, x_mm, z, span, left_mm, pressure_mpa, shear_mpa)
        fields[0] -= repeated[0]
        if bending:
            fields[-1] -= repeated[1]
        ends = np.cumsum([len(places) for places in few])[:-1]
        for rows, made_rows in zip(groups, np.split(fields, ends, axis=1), strict=True):
            for part, made in zip(maps, made_rows, strict=True):
                if len(made) == len(part[rows]):
                    part[rows] = made
                else:  # a real matrix times a complex one, by one product of real matrices
                    between = _between(len(part[rows]))
                    np.matmul(between, made.view(np.float32), out=part[rows].view(np.float32))
    along, down = maps[1:3] if slopes else (None, None)
    return SeriesField(maps[0], along, down, maps[-1] if bending else None)


def _repeated(
    grid: SeriesGrid, shallowest_mm: float, x_mm: float, left_mm: float, pressure: Floats,
    shear: Floats | None, depths: list[Floats], steep: bool, bending: bool,
) -> Complexes:  # fmt: skip
    """The repeated tractions' field in rows of depths that are alike, where `steep` its slopes, and
    where light is `bending` the gradient of the sum.
    Waves that the pixels cannot tell apart are added before the transform."""
    n, length = np.arange(_count(grid, shallowest_mm)), grid.length
    kappa = (2.0 * np.pi / grid.period_mm) * n
    hat = np.sinc(0.5 / np.pi * grid.spacing_mm * kappa) ** 2
    phase = np.exp(1j * (kappa * (left_mm - x_mm))) * hat
    phase *= 4.0 * grid.spacing_mm / grid.period_mm
    loads = pressure if shear is None else pressure + 1j * shear
    slopes = (kappa * phase * _transform(grid, loads, len(n))).astype(np.complex64)
    cauchy: Complexes | None = None
    if shear is not None:
        cauchy = -1j * phase * _transform(grid, shear, len(n))
        cauchy[0] *= 0.5
        cauchy = cauchy.astype(np.complex64)
    kappa = kappa.astype(np.float32)
    count = 1 + 2 * steep + bending
    spectra = np.zeros((count, sum(map(len, depths)), length), np.complex64)
    row = 0
    for depth in depths:
        part, z = spectra[:, row : row + len(depth)], depth.astype(np.float32)[:, None]
        row += len(depth)
        total = min(len(kappa), _count(grid, float(depth.min())))
        for start in range(0, total, length):
            waves = slice(start, min(start + length, total))
            size, k, slope = waves.stop - start, kappa[waves], slopes[waves]
            decay = np.exp(-z * k)
            spectrum = z * slope
            if cauchy is not None:
                spectrum += cauchy[waves]
            spectrum *= decay
            part[0, :, :size] += spectrum
            if steep:
                part[1, :, :size] += spectrum * (np.complex64(-1j) * k)
                part[2, :, :size] += decay * slope - k * spectrum
            if bending:
                part[-1, :, :size] += decay * (np.complex64(1j) * slope)
    return np.asarray(scipy.fft.fft(spectra, axis=2, overwrite_x=True)[..., : grid.cols])


def _count(grid: SeriesGrid, depth_mm: float) -> int:
    """Waves that are felt at a depth."""
    return 1 + math.ceil(_DECAY * grid.period_mm / (2.0 * np.pi * depth_mm))


def _transform(grid: SeriesGrid, values: NDArray[np.number], count: int) -> Complexes:
    """Σ_j v_j exp(i κ_n j spacing), n = 0 .. count-1."""
    turns = grid.period_mm / grid.spacing_mm
    total = round(turns)
    if abs(total / turns - 1.0) < 1e-12:
        return np.asarray(np.resize(scipy.fft.ifft(values, total, norm="forward"), count))
    # jn = (j² + n² - (n-j)²)/2 makes a convolution of it; scipy.signal's takes a second to start
    size = scipy.fft.next_fast_len(len(values) + count - 1)
    chirp = np.exp(1j * np.pi / turns * np.arange(max(len(values), count)) ** 2)
    kernel = np.zeros(size, complex)
    kernel[:count] = chirp[:count].conj()
    kernel[size - len(values) + 1 :] = chirp[len(values) - 1 : 0 : -1].conj()
    wave = scipy.fft.fft(values * chirp[: len(values)], size) * scipy.fft.fft(kernel)
    return np.asarray(chirp[:count] * scipy.fft.ifft(wave)[:count])


def _few(depth: Floats) -> Floats:
    """Depths that tell the field at those of neighbouring rows, see `_between`."""
    if len(depth) <= _PLACES:
        return depth
    return np.asarray(0.5 * (depth[0] + depth[-1] + (depth[-1] - depth[0]) * _COSINES))


@lru_cache(maxsize=64)
def _between(count: int) -> Floats:
    """Interpolation (count, m) from those to so many neighbouring rows."""
    return _interpolation(_steps(count)).astype(np.float32)


def _repetitions(
    grid: SeriesGrid, x_mm: float, depth: Floats, span: tuple[float, float], left_mm: float,
    p: Floats, q: Floats | None,
) -> Complexes:  # fmt: skip
    """What the repeated tractions add to the field and to the gradient of the sum (2, depths,
    cols); `span`, of the picture (mm)."""
    period, middle = grid.period_mm, left_mm + 0.5 * grid.spacing_mm * (grid.nodes - 1)
    x = x_mm - middle + 0.5 * grid.pitch_mm * (grid.cols - 1) * (1.0 + _COSINES)
    deep, half = 0.5 * (span[0] + span[1]), 0.5 * (span[1] - span[0])
    z = deep + half * _COSINES
    v = (x[None, :] - 1j * z[:, None]) / period
    loaded = np.flatnonzero(p)
    ends = grid.powers[1, loaded[[0, -1]]] if len(loaded) else np.zeros(2)
    if max(np.abs(v - ends[0]).max(), np.abs(v - ends[1]).max()) > _FARTHEST:
        raise ValueError(message("pixel_beyond_reach_series"))
    moments = grid.spacing_mm * (grid.powers @ p)
    if q is not None:
        across = grid.spacing_mm * (grid.powers @ q)
        moments = moments + 1j * across
    steep = np.polynomial.polynomial.polyval(v, grid.poles @ moments) / period**2
    total = z[:, None] * steep
    if q is not None:
        total = total + np.polynomial.polynomial.polyval(v, grid.pairs @ across) / period
    both = (-2.0 / np.pi * np.array([total, 1j * steep])).astype(np.complex64)
    down = _interpolation((depth - deep) / half if half else np.zeros(len(depth)))
    return np.asarray((down.astype(np.float32) @ both) @ grid.across)


def _power_series() -> tuple[Floats, Floats]:
    """From moments ∫ f τ^k to coefficients of v^d: of Σ_m 1/(v-τ-m) and Σ_m 1/(v-τ-m)², m ≠ 0."""
    from scipy.special import zeta

    pairs, poles = np.zeros((2, 2 * _TERMS, 2 * _TERMS))
    for j in range(1, _TERMS + 1):
        value = 2.0 * float(zeta(2 * j))
        for m, matrix, factor, times in (
            (2 * j - 1, pairs, -value, 1.0), (2 * j - 2, poles, value, 2 * j - 1),
        ):  # fmt: skip
            for k in range(m + 1):
                matrix[m - k, k] += factor * ((-1.0) ** k * math.comb(m, k)) * times
    return pairs, poles


def _steps(count: int) -> Floats:
    """So many equal steps over -1..1."""
    return np.linspace(-1.0, 1.0, count) if count > 1 else np.full(1, -1.0)


def _interpolation(places: Floats) -> Floats:
    """From values at Chebyshev's places to others (n,) on -1..1: (n, m)."""
    chebyshev, degree = np.polynomial.chebyshev.chebvander, _PLACES - 1
    return np.asarray(np.linalg.solve(chebyshev(_COSINES, degree).T, chebyshev(places, degree).T).T)
