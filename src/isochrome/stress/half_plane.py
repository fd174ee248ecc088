"""Stress in a half-plane under surface tractions that are linear between nodes.

With ζ = x - i z, the pressure p, and q the shear on the surface along +x (MPa),

    (sx - sz) + 2i txz = -(2/π) [ z ∫ (p + iq)/(ζ-t)² dt + ∫ q/(ζ-t) dt ],
    sx + sz            = -(2/π) Re ∫ (q - ip)/(ζ-t) dt.

Of a hat of half-width h the integrals are second differences over h of ζ ln ζ - ζ and of -ln ζ:
finite everywhere and exact at z = 0. A point force on the edge, P normal and Q tangential per
thickness, gives besides, in plane stress and up to a rigid body's motion,

    u_x - i u_z = (1+ν)/E [ κ k ln ζ + k ln ζ* - k* ζ/ζ* ],  k = -(Q - iP)/(2π),  κ = (3-ν)/(1+ν).

On pixels, rows are convolutions in x; the nodes divide the pixels, so that a row's spectrum is
folded before one short inverse FFT. Some pixels down a source between pixel-spaced ones acts as
these do with Lagrange's weights of its 2m neighbours X_k, with a relative error of

    Π_k (t - X_k)/(ζ - X_k)   <=   Π_{k=1..m} (k-1/2)²/((z/pixel)² + (k-1/2)²),

2m + 1 times it at most for z/(ζ-t)². What a half-plane's own field lacks in a real body, stress
along the surface, bending, sides and support, is a power series of its complex potential,

    sigma_x + sigma_z             = Re Σ s_n ζ^n,
    (sigma_x - sigma_z) + 2i tau  = Σ Re(s_n) ζ^n - i z Σ n s_n ζ^(n-1),

free of tractions at z = 0 for any s_n (MPa/mm^n): s_0 is sigma_x along the surface, Re s_1 its
change along x, Im s_1 its change along z, pure bending; and the residual stress of machining,
sigma_x = s exp(-z/λ). Sources: Johnson (1985), Contact Mechanics, 2.3; Muskhelishvili (1953), Some
Basic Problems of the Mathematical Theory of Elasticity, sections 32, 90 and 93; Davis (1963),
Interpolation and Approximation, section 3.6; Brandt & Lubrecht (1990), Journal of Computational
Physics 90.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import NamedTuple

import numpy as np
import scipy.fft
from numpy.polynomial.polynomial import polyval
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.stress.field import PixelGrid, StressComponents, StressDifference

Floats = NDArray[np.floating]
Complexes = NDArray[np.complexfloating]

_FAR = 40.0
"""Distance over h beyond which the hat's moments replace the second differences."""


def cauchy_of_hat(
    x_mm: Floats, z_mm: Floats | float, spacing_mm: float
) -> tuple[Complexes, Complexes]:
    """∫ hat/(ζ-t) dt and ∫ hat/(ζ-t)² dt (1/mm) at ζ = x - i z, z >= 0, from the hat's node. Near
    by, second differences; far off, the hat's moments, where those would cancel. On the surface ln
    ζ is the limit from below; the second integral, infinite at a node there but only ever
    multiplied by z = 0, is given as zero. `spacing_mm` is h."""
    x, z = np.broadcast_arrays(x_mm, z_mm)
    zeta: Complexes = np.empty(x.shape, complex)
    zeta.real, zeta.imag = x / spacing_mm, -(z / spacing_mm)
    far = np.square(zeta.real) + np.square(zeta.imag) > _FAR**2
    inverse: Complexes = np.divide(1.0, zeta, out=np.ones_like(zeta), where=far)
    square: Complexes = inverse * inverse
    first: Complexes = inverse * (1.0 + square * (1 / 6 + square * (1 / 15 + square / 28)))
    second: Complexes = square * (1.0 + square * (3 / 6 + square * (5 / 15 + square * 7 / 28)))
    near, logs = zeta[~far], []
    for at in (near - 1.0, near, near + 1.0):  # the branch of the lower half-plane; at 0 times 0
        size = np.abs(at)
        angle = np.where((at.imag == 0.0) & (at.real < 0.0), -np.pi, np.angle(at))
        logs.append(np.log(np.where(size == 0.0, 1.0, size)) + 1j * angle)
    first[~far] = (near - 1) * logs[0] - 2 * near * logs[1] + (near + 1) * logs[2]
    second[~far] = -(logs[0] - 2 * logs[1] + logs[2])
    return first, second / spacing_mm


class PointForce(NamedTuple):
    """A point force on a half-plane's edge, per thickness (N/mm), or a dipole's moment (N)."""

    normal: float  # P
    tangential: float  # Q
    dipole: bool = False


def point_force_stress(x_mm: Floats, z_mm: Floats, force: PointForce) -> StressComponents:
    """Stress in the half-plane at places from the force, of one shape (mm)."""
    p, q, zeta = force.normal, force.tangential, x_mm - 1j * z_mm
    first, second = (1 / zeta**2, 2 / zeta**3) if force.dipole else (1 / zeta, 1 / zeta**2)
    difference = -2 / np.pi * (z_mm * (p + 1j * q) * second + q * first)
    trace = -2 / np.pi * ((q - 1j * p) * first).real
    return StressComponents.from_invariants(difference, trace)


def point_force_displacement(
    x_mm: Floats, z_mm: Floats, force: PointForce, poisson: float
) -> tuple[Floats, Floats]:
    """Displacement along x and z, times Young's modulus, in plane stress (N/mm)."""
    zeta = x_mm - 1j * z_mm
    conjugate = zeta.conj()
    k = -(force.tangential - 1j * force.normal) / (2 * np.pi)
    kappa = (3 - poisson) / (1 + poisson)
    if force.dipole:
        turned = 1 / conjugate - zeta / conjugate**2
        sum_of_terms = -(kappa * k / zeta + k / conjugate - np.conj(k) * turned)
    else:
        logs = kappa * np.log(zeta) + np.log(conjugate)
        sum_of_terms = k * logs - np.conj(k) * zeta / conjugate
    both = (1 + poisson) * sum_of_terms
    return both.real, -both.imag


HALF_TAPS = 12
"""Neighbours on either side that take over a source (m)."""
DEEP_PX = {np.dtype(np.complex64): 10.0, np.dtype(np.complex128): 20.0}
"""Depth in pixels from which they do: errors below 1e-10 and 1e-16 (times 2m + 1 at most)."""
ROWS_AT_ONCE = 64
"""Rows worked on at a time: what is made of them stays in the processor's cache."""


@dataclass(frozen=True)
class RowBand:
    """Kernel spectra of neighbouring rows that take the same sources. `rows`, which of the
    picture's; `fold`, sources a pixel; `moved`, nodes a source stands for (1: the nodes
    themselves); `cauchy`, `slope` (rows, length), spectra of -(2/π) ∫ hat/(ζ-t) dt and of -(2/π) z
    ∫ hat/(ζ-t)² dt."""

    rows: slice
    fold: int
    moved: int
    cauchy: Complexes = field(repr=False)
    slope: Complexes = field(repr=False)


def make_band(
    rows: slice, z_mm: Floats, cols: int, *, first_mm: float, spacing_mm: float, nodes: int,
    fold: int, deep: bool, dtype: np.dtype[np.complexfloating],
) -> RowBand:  # fmt: skip
    """Kernel spectra of one band of rows at depths `z_mm`; `fold`, nodes a pixel. `first_mm` is the
    first pixel's x from the first node; `deep`, sources move to pixel spacing."""
    step, sources, moved = spacing_mm, nodes, 1
    if deep and fold > 1:
        moved, step = fold, fold * spacing_mm
        sources = -(-nodes // fold) + 2 * HALF_TAPS - 1
        first_mm, fold = first_mm + (HALF_TAPS - 1) * step, 1
    length = fold * int(scipy.fft.next_fast_len(cols - 1 - (-sources // fold)))
    lags = np.arange(length)
    lags[lags > fold * (cols - 1)] -= length
    x = first_mm + step * lags
    both = np.empty((2, len(z_mm), length), dtype=dtype)
    for row, z in enumerate(z_mm):
        first, second = cauchy_of_hat(x, float(z), spacing_mm)
        both[0, row] = scipy.fft.fft(first, overwrite_x=True)
        both[1, row] = scipy.fft.fft(float(z) * second, overwrite_x=True)
    both *= dtype.type(-2.0 / np.pi)
    return RowBand(rows, fold, moved, *both)


def convolve_rows(
    band: RowBand, loads: Sequence[tuple[Complexes, NDArray[np.number]]], out: Complexes
) -> None:
    """Fill `out` (rows, cols) with the sum of kernels of a band convolved with node values (n,)."""
    length = band.cauchy.shape[1]
    short = length // band.fold
    bands = [slice(start, start + short) for start in range(0, length, short)]
    spectra = []
    for _, values in loads:
        sources = values if band.moved == 1 else pixel_sources(values, band.moved)
        spectrum = scipy.fft.fft(sources, length) / band.fold
        spectra.append(spectrum.astype(band.cauchy.dtype))
    for start in range(0, len(out), ROWS_AT_ONCE):
        block = slice(start, start + ROWS_AT_ONCE)
        products = (
            kernel[block, part] * spectrum[part]
            for (kernel, _), spectrum in zip(loads, spectra, strict=True)
            for part in bands
        )
        folded = next(products)
        for product in products:
            folded += product
        out[block] = scipy.fft.ifft(folded, axis=1, overwrite_x=True)[:, : out.shape[1]]


def pixel_sources(values: NDArray[np.number], fold: int) -> NDArray[np.number]:
    """Sources (ceil(n/fold) + 2 m - 1,) at pixel spacing that act as `values` do."""
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


@dataclass(frozen=True)
class RegularStress:
    """A regular stress by its power series, free of tractions on the surface."""

    series: tuple[complex, ...] = ()  # the terms s_n, MPa/mm^n; empty for no stress
    edges: tuple[tuple[float, float], ...] = ()  # s (MPa) and λ (mm) of each machined edge

    def __add__(self, other: RegularStress) -> RegularStress:
        pairs = zip_longest(self.series, other.series, fillvalue=0j)
        return RegularStress(tuple(a + b for a, b in pairs), self.edges + other.edges)

    def __bool__(self) -> bool:
        return any(self.series) or any(s for s, _ in self.edges)

    def times(self, factor: float) -> RegularStress:
        """The same stress, a factor larger."""
        edges = tuple((factor * s, depth) for s, depth in self.edges)
        return RegularStress(tuple(factor * s for s in self.series), edges)

    def difference(self, x_mm: Floats, z_mm: Floats) -> Complexes:
        """(sigma_x - sigma_z) + 2i tau_xz at places of shapes that broadcast (mm), MPa."""
        x, z = np.asarray(x_mm, float), np.asarray(z_mm, float)
        terms, zeta = np.array(self.series or (0j,)), x - 1j * z
        slope = polyval(zeta, (np.arange(len(terms)) * terms)[1:]) if len(terms) > 1 else 0j
        return np.asarray(polyval(zeta, terms.real) - 1j * z * slope + self._along_edges(z))

    def trace(self, x_mm: Floats, z_mm: Floats) -> Floats:
        """sigma_x + sigma_z at places of shapes that broadcast (mm), MPa."""
        zeta = np.asarray(x_mm, float) - 1j * np.asarray(z_mm, float)
        smooth = polyval(zeta, np.array(self.series or (0j,))).real
        return np.asarray(smooth + self._along_edges(np.asarray(z_mm, float)))

    def _along_edges(self, z_mm: Floats) -> Floats:
        """sigma_x of machined edges, MPa; above the surface as on it."""
        below = np.maximum(z_mm, 0.0)
        return np.asarray(sum(s * np.exp(-below / depth) for s, depth in self.edges))


NO_STRESS = RegularStress()
"""Nothing besides the contact's own stress."""


def regular_modes(degree: int) -> tuple[RegularStress, ...]:
    """The real modes s_0 = 1, s_1 = 1, s_1 = i, s_2 = 1, ... up to a degree, each 1 MPa/mm^n."""
    modes = [RegularStress((1 + 0j,))]
    for n in range(1, degree + 1):
        modes += [RegularStress((*(0j,) * n, unit)) for unit in (1 + 0j, 1j)]
    return tuple(modes)


_AT_ONCE = 131_072
"""Pairs of place and node evaluated at once: some tens of MB of scratch at most."""


def difference_and_trace(
    x_mm: Floats, z_mm: Floats, nodes_mm: Floats, pressure_mpa: Floats, shear_mpa: Floats
) -> tuple[Complexes, Floats]:
    """(sigma_x - sigma_z) + 2i tau_xz and sigma_x + sigma_z, MPa, as in `stress_components`."""
    x, z = np.broadcast_arrays(np.asarray(x_mm, float), np.asarray(z_mm, float))
    shape, x, z = x.shape, x.ravel(), z.ravel()
    difference, trace = np.zeros(x.size, complex), np.zeros(x.size)
    loaded = np.flatnonzero((pressure_mpa != 0.0) | (shear_mpa != 0.0))
    if len(loaded):
        h = float(nodes_mm[1] - nodes_mm[0])
        t, p, q = nodes_mm[loaded], pressure_mpa[loaded], shear_mpa[loaded]
        step = max(1, _AT_ONCE // len(loaded))
        for start in range(0, x.size, step):
            part = slice(start, start + step)
            first, second = cauchy_of_hat(x[part, None] - t, z[part, None], h)
            shear = _sum(first, q)
            difference[part] = -2 / np.pi * (z[part] * _sum(second, p + 1j * q) + shear)
            trace[part] = -2 / np.pi * (shear.real + _sum(first.imag, p))
    return difference.reshape(shape), trace.reshape(shape)


def _sum(kernel: Floats | Complexes, traction: Floats | Complexes) -> Complexes:
    """Sums over the nodes; not by BLAS, whose threads wait for each other on a busy machine."""
    return np.asarray(np.einsum("ij,j->i", kernel, traction))


def stress_components(
    x_mm: Floats, z_mm: Floats, nodes_mm: Floats, pressure_mpa: Floats, shear_mpa: Floats
) -> StressComponents:
    """Compute all three stress components at any places, by direct sums over the loaded nodes.

    Source: the module's.

    Parameters
    ----------
    x_mm : ndarray
        Places along the surface (mm).
    z_mm : ndarray
        Depths (mm), not negative; of a shape that broadcasts with that of `x_mm`.
    nodes_mm : ndarray (n,)
        Places of the surface nodes (mm), uniform.
    pressure_mpa : ndarray (n,)
        Pressure at the nodes (MPa).
    shear_mpa : ndarray (n,)
        Shear at the nodes (MPa).

    Returns
    -------
    StressComponents
        Stress (MPa) of the places' shape, float64.

    Examples
    --------
    >>> import isochrome
    >>> static, *_ = isochrome.scene_states(isochrome.load_scene("line-contact-wear"))
    >>> surface = static.surface
    >>> tractions = surface.grid.x_mm, surface.pressure_mpa, surface.shear_mpa
    >>> stress = isochrome.stress_components(0.0, 0.3, *tractions)
    >>> print(f"{stress.sigma_z.item():.1f} MPa")
    -14.6 MPa
    """
    difference, trace = difference_and_trace(x_mm, z_mm, nodes_mm, pressure_mpa, shear_mpa)
    return StressComponents.from_invariants(difference, trace)


_ON_SURFACE = 1e-9
"""Share of a pixel within which a row is taken to lie on the surface: rounding of its place."""
SINGLE_ERROR, DOUBLE_ERROR = 1e-6, 5e-13
"""Errors of a field over the sum of the largest pressure and shear, in complex64 and complex128."""


@dataclass(frozen=True)
class FieldGrid:
    """Kernel spectra for one grid of surface nodes and one of pixels, made once."""

    pixels: PixelGrid
    nodes: int
    dtype: np.dtype[np.complexfloating]  # complex64 or complex128
    bands: tuple[RowBand, ...]  # of the material; rows above the surface have none


def field_dtype(tolerance: float) -> type[np.complexfloating]:
    """The cheapest precision whose error is below a share of the largest pressure and shear.
    complex64: 1e-6 (2e-7 under a smooth contact), the rounding of the transforms, 6e-8, times a
    row's kernel and traction, some ten even for random signs on 65536 nodes. complex128: 5e-13,
    from the hats' second differences 40 spacings away; InputError below that."""
    if not tolerance >= DOUBLE_ERROR:
        raise InputError(
            "tolerance_stress_field_largest", tolerance=tolerance, double_error=DOUBLE_ERROR
        )
    return np.complex64 if tolerance >= SINGLE_ERROR else np.complex128


def make_field_grid(
    pixels: PixelGrid, *, left_mm: float, spacing_mm: float, nodes: int,
    dtype: type[np.complexfloating] = np.complex64,
) -> FieldGrid:  # fmt: skip
    """Kernels from nodes, the first at `left_mm`; InputError: a pixel is not whole spacings."""
    fold = round(pixels.pixel_mm / spacing_mm)
    if fold < 1 or abs(fold * spacing_mm / pixels.pixel_mm - 1.0) > 1e-9:
        raise InputError("pixel_mm_must_whole", pixel_mm=pixels.pixel_mm, spacing_mm=spacing_mm)
    kind = np.dtype(dtype)
    depths = pixels.z_mm / pixels.pixel_mm
    surface = int(np.searchsorted(depths, -_ON_SURFACE))
    deep = int(np.searchsorted(depths, DEEP_PX[kind])) if fold > 1 else pixels.rows
    z = np.where(np.abs(depths) <= _ON_SURFACE, 0.0, pixels.z_mm)
    bands = [
        make_band(
            rows, z[rows], pixels.cols, first_mm=float(pixels.x_mm[0] - left_mm),
            spacing_mm=spacing_mm, nodes=nodes, fold=fold, deep=rows.start >= deep, dtype=kind,
        )
        for rows in (slice(surface, max(surface, deep)), slice(max(surface, deep), pixels.rows))
        if rows.start < rows.stop
    ]  # fmt: skip
    return FieldGrid(pixels, nodes, kind, tuple(bands))


def stress_difference(
    grid: FieldGrid, pressure_mpa: Floats, shear_mpa: Floats | None = None
) -> StressDifference:
    """(sigma_x - sigma_z) + 2i tau_xz (rows, cols), MPa, of tractions (n,); 0 above the surface."""
    field = _empty_field(grid, pressure_mpa, shear_mpa)
    for band in grid.bands:
        loads = [(band.slope, pressure_mpa)]
        if shear_mpa is not None:
            loads = [(band.slope, pressure_mpa + 1j * shear_mpa), (band.cauchy, shear_mpa)]
        convolve_rows(band, loads, field[band.rows])
    return field


def stress_trace(grid: FieldGrid, pressure_mpa: Floats, shear_mpa: Floats | None = None) -> Floats:
    """sigma_x + sigma_z (rows, cols), MPa, of tractions (n,) at the nodes; 0 above the surface."""
    field = _empty_field(grid, pressure_mpa, shear_mpa)
    traction = -1j * pressure_mpa if shear_mpa is None else shear_mpa - 1j * pressure_mpa
    for band in grid.bands:
        convolve_rows(band, [(band.cauchy, traction)], field[band.rows])
    return np.ascontiguousarray(field.real)


def trace_gradient(
    grid: FieldGrid, pressure_mpa: Floats, shear_mpa: Floats | None = None
) -> Complexes:
    """d/dx + i d/dz of sigma_x + sigma_z (rows, cols), MPa/mm, of tractions (n,); 0 down to the
    surface, where it may have no limit. The sum is the real part of an analytic function of ζ, of
    which this is the derivative, (2/π) ∫ (q - ip)/(ζ-t)² dt."""
    field = _empty_field(grid, pressure_mpa, shear_mpa)
    traction = pressure_mpa if shear_mpa is None else pressure_mpa + 1j * shear_mpa
    depths = grid.pixels.z_mm[:, None]
    for band in grid.bands:
        convolve_rows(band, [(band.slope, traction)], field[band.rows])
        z = depths[band.rows]
        below = z > _ON_SURFACE * grid.pixels.pixel_mm
        field[band.rows] *= np.divide(1j, z, out=np.zeros(z.shape, complex), where=below)
    return field


def _empty_field(grid: FieldGrid, *tractions: Floats | None) -> StressDifference:
    """A field that is zero above the surface, and yet to be filled below, by tractions (n,)."""
    for traction in tractions:
        if traction is not None and np.shape(traction) != (grid.nodes,):
            raise InputError("tractions_have_shape_but", shape=np.shape(traction), nodes=grid.nodes)
    field = np.empty((grid.pixels.rows, grid.pixels.cols), dtype=grid.dtype)
    field[: grid.bands[0].rows.start if grid.bands else None] = 0.0
    return field


_GROWTH = 1.2
"""Ratio of neighbouring depths of the scan; at depth z nothing is finer than about z."""
_ACROSS = 17
"""Places each way of the coarse scan that takes in the window's far corners."""
_RIVALS = 12
"""Local maxima of the scans that are climbed before the highest is kept: a scan loses a few per
cent, and there is noise on a plateau, and a cusp at each node of a rough traction."""


class Box(NamedTuple):
    """A part of the material, its outer edges in mm; z from the surface."""

    left: float
    right: float
    top: float
    bottom: float


@dataclass(frozen=True)
class Loads:
    """Loaded nodes and what acts there; a `regular` stress besides."""

    nodes: Floats
    pressure: Floats
    shear: Floats
    spacing: float
    regular: RegularStress

    def size(self, x: Floats, z: Floats) -> Floats:
        """|(sigma_x - sigma_z) + 2i tau_xz| at places of one shape, MPa."""
        field, _ = difference_and_trace(x, z, self.nodes, self.pressure, self.shear)
        return np.abs(field + self.regular.difference(x, z))


def _scans(loads: Loads, box: Box) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Columns, depths and sizes of a coarse scan of all the window and of fine ones at the load. A
    column at each node on graded depths, and four to a spacing near the surface and its cusps."""
    x: Floats = np.linspace(box.left, box.right, _ACROSS)
    z: Floats = np.linspace(box.top, box.bottom, _ACROSS)
    yield x, z, loads.size(x[None, :], z[:, None])
    h, start, end = loads.spacing, loads.nodes[0], loads.nodes[-1]
    left_mm, right = max(box.left, start + start - end), min(box.right, end + end - start)
    count = int(np.ceil(np.log(max(box.bottom / h, 1.0)) / np.log(_GROWTH)))
    graded, near = h * _GROWTH ** np.arange(count + 1), 0.25 * h * np.arange(9)
    both = loads.pressure + 1j * loads.shear
    for split, depths in ((1, graded), (4, near)):
        step = 1.0 / split
        first = np.ceil((left_mm - start) / h / step)
        x = start + h * step * np.arange(first, np.floor((right - start) / h / step) + 1)
        inside = depths[(depths > box.top) & (depths < box.bottom)]
        z = np.unique(np.r_[box.top, inside, box.bottom])
        size = np.empty((len(z), len(x)))
        for col in range(min(split, len(x))):
            cols = x[col::split]
            band = make_band(
                slice(0, len(z)), z, len(cols), first_mm=float(cols[0] - start), spacing_mm=h,
                nodes=len(loads.nodes), fold=1, deep=False, dtype=np.dtype(np.complex64),
            )  # fmt: skip
            field = np.empty((len(z), len(cols)), np.complex64)
            convolve_rows(band, [(band.slope, both), (band.cauchy, loads.shear)], field)
            field += loads.regular.difference(cols[None, :], z[:, None]).astype(np.complex64)
            size[:, col::split] = np.abs(field)
        if x.size:
            yield x, z, size


@dataclass(frozen=True)
class ShearPeak:
    """The largest shear stress (sigma_1 - sigma_2)/2 in the plane, and its place; z is depth."""

    shear_mpa: float
    x_mm: float
    z_mm: float


def largest_shear(
    nodes_mm: Floats, pressure_mpa: Floats, shear_mpa: Floats | None, *,
    within: tuple[float, float, float, float], regular: RegularStress = NO_STRESS,
) -> ShearPeak:  # fmt: skip
    """Find the largest (sigma_1 - sigma_2)/2 in the material under a window, its surface included.
    A scan on graded depths finds the hills, direct sums climb the highest, to 1e-7 of their width.
    The window is (left, right, top, bottom), mm. At the surface the value is the traction's at its
    uniform nodes: beside a worn edge, where friction ends steeply, sigma_x grows with the logarithm
    of that steepness, so with a finer grid. InputError: no material, or not finite."""
    from scipy.ndimage import maximum_filter

    left_mm, right, top, bottom = within
    if not (left_mm <= right and max(top, 0.0) <= bottom):
        raise InputError("window_from_mm_mm", left_mm=left_mm, right=right, top=top, bottom=bottom)
    box = Box(left_mm, right, max(top, 0.0), bottom)
    shear = np.zeros_like(pressure_mpa) if shear_mpa is None else shear_mpa
    for name, traction in (("pressure_mpa", pressure_mpa), ("shear_mpa", shear)):
        if not np.isfinite(traction).all():
            raise InputError("holds_nan_infinity_give", name=name)
    loaded = np.flatnonzero((pressure_mpa != 0.0) | (shear != 0.0))
    # two nodes at least; without a load all
    part = slice(max(loaded[0] - 1, 0), loaded[-1] + 2) if len(loaded) else slice(None)
    spacing = float(nodes_mm[1] - nodes_mm[0])
    loads = Loads(nodes_mm[part], pressure_mpa[part], shear[part], spacing, regular)
    hills = []
    for x, z, size in _scans(loads, box):
        row, col = np.nonzero(size >= maximum_filter(size, 3))
        hills.append(np.stack([size[row, col], x[col], z[row]]))
    size, x, z = np.concatenate(hills, axis=1)
    highest = np.argsort(-size)[:_RIVALS]
    x, z = x[highest], z[highest]
    size = loads.size(x, z)
    step = np.stack([np.maximum(spacing, 0.1 * z), np.maximum(0.5 * spacing, 0.2 * z)])
    x, z, size = _climb(loads, box, x, z, size, step, 0.05)
    best = slice(size.argmax(), size.argmax() + 1)
    x, z, size = _climb(loads, box, x[best], z[best], size[best], 0.05 * step[:, best], 1e-7 / 0.05)
    return ShearPeak(0.5 * float(size[0]), float(x[0]), float(z[0]))


def _climb(
    loads: Loads, box: Box, x: Floats, z: Floats, size: Floats, step: Floats, share: float
) -> tuple[Floats, Floats, Floats]:
    """Move each place to its best neighbour of eight, or halve its step, down to a share of it. No
    slopes: at the surface the field has cusps at the nodes. Source: pattern search, Hooke & Jeeves
    (1961), Journal of the ACM 8."""
    dx, dz = (d.ravel()[:, None] for d in np.meshgrid([0, -1, 1], [0, -1, 1]))
    scale = np.ones_like(x)
    while (moving := np.flatnonzero(scale > share)).size:
        near_x = np.clip(x[moving] + dx * scale[moving] * step[0, moving], box.left, box.right)
        near_z = np.clip(z[moving] + dz * scale[moving] * step[1, moving], box.top, box.bottom)
        sizes = loads.size(near_x, near_z)
        best = sizes.argmax(axis=0), np.arange(moving.size)
        stays = ~(sizes[best] > size[moving] * (1.0 + 1e-15))
        scale[moving[stays]] *= 0.5
        goes, best = moving[~stays], (best[0][~stays], best[1][~stays])
        x[goes], z[goes], size[goes] = near_x[best], near_z[best], sizes[best]
    return x, z, size
