r"""Stress in a half-plane under surface tractions that are linear between nodes.

With ζ = x - i z, the pressure p, and q the shear on the surface along +x,

    (sx - sz) + 2i txz = -(2/π) [ z ∫ (p + iq)/(ζ-t)² dt + ∫ q/(ζ-t) dt ],
    sx + sz            = -(2/π) Re ∫ (q - ip)/(ζ-t) dt.

Source: the stresses of a distributed load, Johnson (1985), Contact Mechanics, eq. 2.23, added up
into complex form. For a hat of half-width h both integrals are second differences over h, of
ζ ln ζ - ζ and of -ln ζ: finite everywhere, exact at z = 0, and so without the spikes that stepwise
constant tractions leave at the surface. Rows are convolutions in x: one complex inverse FFT each.
The tractions' nodes divide the pixels, so the wanted columns are every m-th sample, which are had
by folding the spectrum before the transform.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.stress.field import StressComponents, StressDifference
from isochrome.stress.pixels import Floats, PixelGrid

_FAR = 40.0
"""Distance over h beyond which the hat's moments replace the second differences."""


@dataclass(frozen=True)
class FieldGrid:
    """Kernel spectra for one surface grid and one pixel grid, made once.

    `normal` and `shear` (rows, length): responses to p and q; `fold`: nodes a pixel; `nodes`.
    """

    pixels: PixelGrid
    nodes: int
    fold: int
    normal: NDArray[np.complexfloating] = field(repr=False)
    shear: NDArray[np.complexfloating] = field(repr=False)


def make_field_grid(
    pixels: PixelGrid,
    *,
    left_mm: float,
    spacing_mm: float,
    nodes: int,
    dtype: type[np.complexfloating] = np.complex64,
) -> FieldGrid:
    """Precompute the kernels from surface nodes to pixels.

    Parameters: `pixels`; `left_mm`, `spacing_mm`, `nodes`, the surface nodes; `dtype`, complex64
    (error about 1e-7 of the peak) or complex128. Returns a FieldGrid. Raises InputError where the
    pixel is no whole number of spacings, or pixels lie above the surface.
    """
    fold = round(pixels.pixel_mm / spacing_mm)
    if fold < 1 or abs(fold * spacing_mm / pixels.pixel_mm - 1.0) > 1e-9:
        raise InputError(
            f"the pixel, {pixels.pixel_mm:g} mm, must be a whole number of surface spacings, "
            f"{spacing_mm:g} mm; change the spacing"
        )
    needed = fold * (pixels.cols - 1) + nodes
    length = fold * int(scipy.fft.next_fast_len(-(-needed // fold)))
    lags = np.arange(length)
    lags[lags > fold * (pixels.cols - 1)] -= length
    x = pixels.x_mm[0] - left_mm + spacing_mm * lags
    normal = np.empty((pixels.rows, length), dtype=dtype)
    shear = np.empty_like(normal)
    for row, z in enumerate(pixels.z_mm):
        kernels = hat_kernels(x, float(z), spacing_mm)
        normal[row], shear[row] = scipy.fft.fft(np.stack(kernels)).astype(dtype)
    return FieldGrid(pixels, nodes, fold, normal, shear)


def hat_kernels(
    x_mm: Floats, z_mm: float, spacing_mm: float
) -> tuple[NDArray[np.complexfloating], NDArray[np.complexfloating]]:
    """Stress difference of a unit hat of pressure and of one of shear, along one row.

    Parameters: `x_mm` (n,), place from the hat's node; `z_mm`, depth, zero above the surface
    (where there is no material); `spacing_mm`, the hat's half-width. Returns two (n,), complex,
    MPa per MPa. Source: see the module.
    """
    if z_mm < 0.0:
        return np.zeros(len(x_mm), complex), np.zeros(len(x_mm), complex)
    first, second = cauchy_of_hat(x_mm, z_mm, spacing_mm)
    shear = np.asarray(-2.0 / np.pi * (1j * z_mm * second + first), dtype=complex)
    return -2.0 / np.pi * z_mm * second, shear


def cauchy_of_hat(
    x_mm: Floats, z_mm: float, spacing_mm: float
) -> tuple[NDArray[np.complexfloating], NDArray[np.complexfloating]]:
    """Integrals ∫ hat/(ζ-t) dt and ∫ hat/(ζ-t)² dt at ζ = x - i z.

    Near by, second differences of ζ ln ζ and -ln ζ; far off, the hat's moments, where those would
    cancel. On the surface, ln ζ is the limit from below. The second integral is infinite at a node
    on the surface, where it is only ever multiplied by z = 0, and is given as zero there.
    Parameters: `x_mm` (n,); `z_mm` >= 0; `spacing_mm`. Returns two (n,), the second in 1/mm.
    """
    zeta = np.asarray(x_mm / spacing_mm - 1j * (z_mm / spacing_mm), dtype=complex)
    far = np.abs(zeta) > _FAR
    inverse = np.ones_like(zeta)
    inverse[far] = 1.0 / zeta[far]
    square = np.square(inverse)
    first = np.multiply(inverse, 1.0 + square * (1 / 6 + square * (1 / 15 + square * (1 / 28))))
    second = np.multiply(square, 1.0 + square * (3 / 6 + square * (5 / 15 + square * (7 / 28))))
    near = zeta[~far]
    logs = [_log_from_below(near + k) for k in (-1.0, 0.0, 1.0)]
    first[~far] = (near - 1) * logs[0] - 2 * near * logs[1] + (near + 1) * logs[2]
    second[~far] = -(logs[0] - 2 * logs[1] + logs[2])
    return first, second / spacing_mm


def _log_from_below(zeta: NDArray[np.complexfloating]) -> NDArray[np.complexfloating]:
    """Natural logarithm with the branch of the lower half-plane; zero at zero (times zero)."""
    size = np.abs(zeta)
    angle = np.where((zeta.imag == 0.0) & (zeta.real < 0.0), -np.pi, np.angle(zeta))
    return np.log(np.where(size == 0.0, 1.0, size)) + 1j * angle


def stress_difference(
    grid: FieldGrid, pressure_mpa: Floats, shear_mpa: Floats | None = None
) -> StressDifference:
    """(sigma_x - sigma_z) + 2i tau_xz on the pixels, from tractions at the surface nodes.

    Parameters: `grid`; `pressure_mpa` p (n,); `shear_mpa` q (n,), None for none.
    Returns (rows, cols), complex, MPa; zero above the surface.
    """
    length, kind = grid.normal.shape[1], grid.normal.dtype
    short = length // grid.fold
    loads = [(grid.normal, pressure_mpa)]
    if shear_mpa is not None:
        loads.append((grid.shear, shear_mpa))
    folded = np.zeros((grid.pixels.rows, short), dtype=kind)
    for kernel, traction in loads:
        spectrum = (scipy.fft.fft(traction, length) / grid.fold).astype(kind)
        for start in range(0, length, short):
            part = slice(start, start + short)
            folded += kernel[:, part] * spectrum[part]
    rows = scipy.fft.ifft(folded, axis=1, overwrite_x=True)
    return np.asarray(rows[:, : grid.pixels.cols])


def stress_components(
    x_mm: Floats, z_mm: Floats, nodes_mm: Floats, pressure_mpa: Floats, shear_mpa: Floats
) -> StressComponents:
    """All three stress components at any places, by direct sums over the loaded nodes.

    Parameters: `x_mm`, `z_mm`, places of one shape (mm, z >= 0); `nodes_mm` (n,), uniform;
    `pressure_mpa`, `shear_mpa` (n,). Returns StressComponents of that shape, float64.
    """
    x, z = np.broadcast_arrays(np.asarray(x_mm, float), np.asarray(z_mm, float))
    h = float(nodes_mm[1] - nodes_mm[0])
    difference = np.zeros(x.size, complex)
    trace = np.zeros(x.size)
    loaded = np.flatnonzero((pressure_mpa != 0.0) | (shear_mpa != 0.0))
    for k, (xi, zi) in enumerate(zip(x.ravel(), z.ravel(), strict=True)):
        first, second = cauchy_of_hat(xi - nodes_mm[loaded], float(zi), h)
        p, q = pressure_mpa[loaded], shear_mpa[loaded]
        difference[k] = -2 / np.pi * (zi * (second @ (p + 1j * q)) + first @ q)
        trace[k] = (-2 / np.pi * (first @ (q - 1j * p))).real
    sx = 0.5 * (trace + difference.real).reshape(x.shape)
    sz = 0.5 * (trace - difference.real).reshape(x.shape)
    return StressComponents(sx, sz, 0.5 * difference.imag.reshape(x.shape))
