r"""Convolution of surface tractions with one kernel a row, on the pixels alone.

The tractions' nodes divide the pixels, so the wanted columns are every `fold`-th sample of a row,
had by folding its spectrum before one short inverse FFT. That needs the spectrum at the nodes'
resolution only near the surface. From a few pixels down the kernels are smooth in the place t of
their source, and a source between pixel-spaced ones acts as these do with Lagrange's weights. For
1/(ζ-t), the source of both kernels, with 2m neighbours X_k the relative error of that is exactly

    Π_k (t - X_k)/(ζ - X_k)   <=   Π_{k=1..m} (k-1/2)²/((z/pixel)² + (k-1/2)²),

and 2m + 1 times it at most for z/(ζ-t)². Deep rows therefore cost as much as with one node a pixel.
Source: the remainder of polynomial interpolation of a simple pole, Davis (1963), Interpolation and
Approximation, section 3.6; moving sources to a coarser lattice by the transpose of interpolation:
Brandt & Lubrecht (1990), Journal of Computational Physics 90.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from isochrome.stress.half_plane.hats import Complexes, Floats, cauchy_of_hat

HALF_TAPS = 12
"""Neighbours on either side that take over a source (m)."""
DEEP_PX = {np.dtype(np.complex64): 10.0, np.dtype(np.complex128): 20.0}
"""Depth in pixels from which they do: errors below 1e-10 and 1e-16 (times 2m + 1 at most)."""
_BLOCK = 64
"""Rows worked on at once: a block's products stay in the cache."""


@dataclass(frozen=True)
class RowBand:
    """Kernel spectra of neighbouring rows that take the same sources.

    `rows`, which of the picture's; `fold`, sources a pixel; `moved`, nodes a source stands for (1:
    the nodes themselves); `cauchy`, `slope` (rows, length), spectra of -(2/π) ∫ hat/(ζ-t) dt and
    of -(2/π) z ∫ hat/(ζ-t)² dt.
    """

    rows: slice
    fold: int
    moved: int
    cauchy: Complexes = field(repr=False)
    slope: Complexes = field(repr=False)

    @property
    def nbytes(self) -> int:
        """Memory of the spectra, bytes."""
        return self.cauchy.nbytes + self.slope.nbytes


def make_band(
    rows: slice,
    z_mm: Floats,
    cols: int,
    *,
    first_mm: float,
    spacing_mm: float,
    nodes: int,
    fold: int,
    deep: bool,
    dtype: np.dtype[np.complexfloating],
) -> RowBand:
    """Kernel spectra of one band of rows at depths `z_mm`. Source: see the module.

    `first_mm` is the first pixel's x from the first node; `fold`, nodes a pixel; `deep`, whether
    sources move to pixel spacing.
    """
    step, sources, moved = spacing_mm, nodes, 1
    if deep and fold > 1:
        moved, step = fold, fold * spacing_mm
        sources = -(-nodes // fold) + 2 * HALF_TAPS - 1
        first_mm, fold = first_mm + (HALF_TAPS - 1) * step, 1
    needed = fold * (cols - 1) + sources
    length = fold * int(scipy.fft.next_fast_len(-(-needed // fold)))
    lags = np.arange(length)
    lags[lags > fold * (cols - 1)] -= length
    x = first_mm + step * lags
    cauchy = np.empty((len(z_mm), length), dtype=dtype)
    slope = np.empty_like(cauchy)
    for row, z in enumerate(z_mm):
        first, second = cauchy_of_hat(x, float(z), spacing_mm)
        cauchy[row] = scipy.fft.fft(first, overwrite_x=True)
        slope[row] = scipy.fft.fft(float(z) * second, overwrite_x=True)
    cauchy *= dtype.type(-2.0 / np.pi)
    slope *= dtype.type(-2.0 / np.pi)
    return RowBand(rows, fold, moved, cauchy, slope)


def convolve_rows(
    band: RowBand, loads: Sequence[tuple[Complexes, NDArray[np.number]]], out: Complexes
) -> None:
    """Fill `out` (rows, cols) with the sum of kernels convolved with node values.

    Parameters: `band`; `loads`, pairs of a kernel of the band and values at the nodes (n,).
    """
    length = band.cauchy.shape[1]
    short = length // band.fold
    bands = [slice(start, start + short) for start in range(0, length, short)]
    spectra = [_spectrum(values, band, length) for _, values in loads]
    for start in range(0, len(out), _BLOCK):
        block = slice(start, start + _BLOCK)
        products = (
            kernel[block, part] * spectrum[part]
            for (kernel, _), spectrum in zip(loads, spectra, strict=True)
            for part in bands
        )
        folded = next(products)
        for product in products:
            folded += product
        out[block] = scipy.fft.ifft(folded, axis=1, overwrite_x=True)[:, : out.shape[1]]


def _spectrum(values: NDArray[np.number], band: RowBand, length: int) -> Complexes:
    sources = values if band.moved == 1 else pixel_sources(values, band.moved)
    return np.asarray((scipy.fft.fft(sources, length) / band.fold).astype(band.cauchy.dtype))


def pixel_sources(values: NDArray[np.number], fold: int) -> NDArray[np.number]:
    """Sources at pixel spacing that act, some pixels away, as those at the nodes do.

    Parameters: `values` (n,) at the nodes; `fold`, nodes a pixel. Returns the sources
    (ceil(n/fold) + 2 m - 1,), the first of them m - 1 pixels before the first node.
    Source: see the module.
    """
    count = -(-len(values) // fold)
    shares = np.pad(values, (0, fold * count - len(values))).reshape(count, fold) @ _weights(fold)
    sources = np.zeros(count + 2 * HALF_TAPS - 1, dtype=shares.dtype)
    for tap in range(2 * HALF_TAPS):
        sources[tap : tap + count] += shares[:, tap]
    return sources


def _weights(fold: int) -> Floats:
    """Lagrange's weights (fold, 2m) of the 2m nearest pixels for sources at 0, 1/fold, ..."""
    at = np.arange(1 - HALF_TAPS, HALF_TAPS + 1)
    t = (np.arange(fold) / fold)[:, None, None]
    itself = np.eye(len(at), dtype=bool)
    ratios = np.where(itself, 1.0, t - at) / np.where(itself, 1.0, at[:, None] - at)
    return np.asarray(ratios.prod(axis=2))
