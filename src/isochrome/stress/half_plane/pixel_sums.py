r"""Stress in a half-plane under surface tractions that are linear between nodes, on the pixels.

With ζ = x - i z, the pressure p, and q the shear on the surface along +x,

    (sx - sz) + 2i txz = -(2/π) [ z ∫ (p + iq)/(ζ-t)² dt + ∫ q/(ζ-t) dt ],
    sx + sz            = -(2/π) Re ∫ (q - ip)/(ζ-t) dt.

Source: the stresses of a distributed load, Johnson (1985), Contact Mechanics, eq. 2.23, added up
into complex form. Rows are convolutions in x: see `half_plane.rows`. Both fields use the
same two kernels, so that whoever wants fringes alone pays nothing for the principal stresses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isochrome.errors import InputError
from isochrome.stress.field import StressComponents, StressDifference
from isochrome.stress.half_plane.hats import Floats
from isochrome.stress.half_plane.regular import NO_STRESS, RegularStress
from isochrome.stress.half_plane.rows import DEEP_PX, RowBand, convolve_rows, make_band
from isochrome.stress.pixels import PixelGrid

_ON_SURFACE = 1e-9
"""Share of a pixel within which a row is taken to lie on the surface: rounding of its place."""
SINGLE_ERROR, DOUBLE_ERROR = 1e-6, 5e-13
"""Errors of a field over the sum of the largest pressure and shear, in complex64 and complex128."""


@dataclass(frozen=True)
class FieldGrid:
    """Kernel spectra for one grid of surface nodes and one of pixels, made once."""

    pixels: PixelGrid
    nodes: int
    fold: int  # nodes a pixel
    dtype: np.dtype[np.complexfloating]  # complex64 or complex128
    bands: tuple[RowBand, ...]  # of the material; rows above the surface have none

    @property
    def nbytes(self) -> int:
        """Memory of all spectra, bytes."""
        return sum(band.nbytes for band in self.bands)


def field_dtype(tolerance: float) -> type[np.complexfloating]:
    """The cheapest precision whose error is below a share of the largest pressure and shear.

    complex64: 1e-6 (2e-7 under a smooth contact), the rounding of the transforms, 6e-8, times a
    row's kernel and traction, some ten even for random signs on 65536 nodes. complex128: 5e-13,
    from the hats' second differences 40 spacings away; InputError below that.
    """
    if not tolerance >= DOUBLE_ERROR:
        raise InputError(
            f"the tolerance of a stress field is {tolerance:g} of the largest tractions, but "
            f"double precision reaches {DOUBLE_ERROR:g}; raise it"
        )
    return np.complex64 if tolerance >= SINGLE_ERROR else np.complex128


def make_field_grid(
    pixels: PixelGrid,
    *,
    left_mm: float,
    spacing_mm: float,
    nodes: int,
    dtype: type[np.complexfloating] = np.complex64,
) -> FieldGrid:
    """The kernels from surface nodes to pixels; for `dtype` see `field_dtype`.

    `left_mm` is the first node's place. InputError where the pixel is no whole number of spacings.
    """
    fold = round(pixels.pixel_mm / spacing_mm)
    if fold < 1 or abs(fold * spacing_mm / pixels.pixel_mm - 1.0) > 1e-9:
        raise InputError(
            f"the pixel, {pixels.pixel_mm:g} mm, must be a whole number of surface spacings, "
            f"{spacing_mm:g} mm; change the spacing"
        )
    kind = np.dtype(dtype)
    depths = pixels.z_mm / pixels.pixel_mm
    surface = int(np.searchsorted(depths, -_ON_SURFACE))
    deep = int(np.searchsorted(depths, DEEP_PX[kind])) if fold > 1 else pixels.rows
    z = np.where(np.abs(depths) <= _ON_SURFACE, 0.0, pixels.z_mm)
    bands = [
        make_band(
            rows,
            z[rows],
            pixels.cols,
            first_mm=float(pixels.x_mm[0] - left_mm),
            spacing_mm=spacing_mm,
            nodes=nodes,
            fold=fold,
            deep=rows.start >= deep,
            dtype=kind,
        )
        for rows in (slice(surface, max(surface, deep)), slice(max(surface, deep), pixels.rows))
        if rows.start < rows.stop
    ]
    return FieldGrid(pixels, nodes, fold, kind, tuple(bands))


def stress_difference(
    grid: FieldGrid, pressure_mpa: Floats, shear_mpa: Floats | None = None
) -> StressDifference:
    """(sigma_x - sigma_z) + 2i tau_xz (rows, cols), MPa, of tractions p and q (n,) at the nodes.

    Zero above the surface; InputError where they are not as many as the nodes. Source: see the
    module.
    """
    _check_nodes(grid, pressure_mpa, shear_mpa)
    field = _empty_field(grid)
    for band in grid.bands:
        if shear_mpa is None:
            loads = [(band.slope, pressure_mpa)]
        else:
            loads = [(band.slope, pressure_mpa + 1j * shear_mpa), (band.cauchy, shear_mpa)]
        convolve_rows(band, loads, field[band.rows])
    return field


def stress_trace(grid: FieldGrid, pressure_mpa: Floats, shear_mpa: Floats | None = None) -> Floats:
    """sigma_x + sigma_z (rows, cols), MPa, of tractions p and q (n,) at the nodes.

    Equation: -(2/π) Re ∫ (q - ip)/(ζ-t) dt, zero above the surface; InputError where they are not
    as many as the nodes. Source: see the module.
    """
    _check_nodes(grid, pressure_mpa, shear_mpa)
    traction = -1j * pressure_mpa if shear_mpa is None else shear_mpa - 1j * pressure_mpa
    field = _empty_field(grid)
    for band in grid.bands:
        convolve_rows(band, [(band.cauchy, traction)], field[band.rows])
    return np.ascontiguousarray(field.real)


def components_on_grid(
    grid: FieldGrid,
    pressure_mpa: Floats,
    shear_mpa: Floats | None = None,
    *,
    regular: RegularStress = NO_STRESS,
) -> StressComponents:
    """All three stress components on the pixels: the principal stresses apart.

    Of tractions (n,) at the nodes, and a stress besides the contact's; (rows, cols) in the grid's
    precision, zero above the surface.
    """
    difference = stress_difference(grid, pressure_mpa, shear_mpa)
    trace = stress_trace(grid, pressure_mpa, shear_mpa)
    if regular:
        material = slice(grid.bands[0].rows.start if grid.bands else grid.pixels.rows, None)
        x, z = grid.pixels.x_mm[None, :], grid.pixels.z_mm[material, None]
        difference[material] += regular.difference(x, z).astype(difference.dtype)
        trace[material] += regular.trace(x, z).astype(trace.dtype)
    return StressComponents.from_invariants(difference, trace)


def _empty_field(grid: FieldGrid) -> StressDifference:
    """A field that is zero above the surface, and yet to be filled below."""
    field = np.empty((grid.pixels.rows, grid.pixels.cols), dtype=grid.dtype)
    field[: grid.bands[0].rows.start if grid.bands else None] = 0.0
    return field


def _check_nodes(grid: FieldGrid, *tractions: Floats | None) -> None:
    for traction in tractions:
        if traction is not None and np.shape(traction) != (grid.nodes,):
            raise InputError(
                f"tractions have shape {np.shape(traction)}, but the grid has {grid.nodes} surface "
                "nodes; give one value a node"
            )
