r"""Damped Gauss-Newton steps for surface tractions, with signs kept and the light eliminated.

The light is A S(D) + C with the polariscope's signal S, the stress difference D = Σ c_j D_j, and
illumination A and background C linear in few coefficients. With w = 1/sigma the misfit is

    |w (light - A S - C)|² + c^T K c,    c_j >= 0 for the tractions' halves,

K a quadratic regularisation. Each step solves a least-squares problem with signs for c, the light's
coefficients projected out (Golub & Pereyra); the contrast that a bin's area leaves follows the
last field.
Source: Golub & Pereyra (2003), Inverse Problems 19, R1; Lawson & Hanson (1974), Solving Least
Squares Problems, chapter 23.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.tractions_basis import Basis, lattice_px
from isochrome.fit.tractions_bins import Averaging, Bins, bin_averaging
from isochrome.optics import Chain, polariscope_signal
from isochrome.stress import (
    FieldGrid,
    PixelGrid,
    make_field_grid,
    principal_direction,
    stress_difference,
)

Array = NDArray[Any]

_CHUNK = 4096
_WEAK = 1e-7
_RIDGE = 1e-10
"""Added to a unit diagonal: rounding of fields in single precision."""


@dataclass(frozen=True)
class Optics:
    """The polariscope's `chain`; `order_per_mpa`, d/f_sigma; the camera's blur."""

    chain: Chain
    order_per_mpa: float
    blur_px: float


@dataclass(frozen=True)
class Problem:
    """What does not change: the `bins`, their place, and the `optics`."""

    bins: Bins
    pixels: PixelGrid
    optics: Optics


@dataclass(frozen=True)
class Solution:
    """Unknowns c (m,), the misfit's two parts, and the linearisation there.

    `misfit`, sum of squared weighted residuals; `smooth` K (m, m) as used; `gram` J^T J (m, m),
    with the light eliminated; `slope` J^T r (m,); `residual` r (bins,); `light`, the light's
    coefficients; `steps` taken, and whether they `converged`.
    """

    unknowns: Array
    misfit: float
    smooth: Array
    gram: Array
    slope: Array
    residual: Array
    light: Array
    steps: int
    converged: bool

    @property
    def chi(self) -> float:
        """Residual over noise."""
        return float(np.sqrt(self.misfit / len(self.residual)))


@dataclass(frozen=True)
class _Point:
    """One evaluation at given unknowns and contrast."""

    field: Array
    columns: Array
    light: Array
    residual: Array

    @property
    def misfit(self) -> float:
        return float(self.residual @ self.residual)


def solve_tractions(
    problem: Problem,
    basis: Basis,
    smooth: Array,
    start: Array,
    *,
    steps: int,
    hold: float = 0.0,
    weak: bool = True,
    precise: bool = False,
    fine: bool = True,
) -> Solution:
    """Least squares for the unknowns from a start near the solution.

    Parameters: `problem`; `basis`; `smooth` K (m, m); `start` (m,); `steps`, at most; `hold`,
    weight that holds the last unknown at zero; `weak`, whether K is scaled to a ten-millionth of
    the data's own weight; `precise`, whether to go on until a step gains less than half a unit of
    the misfit, or only a thousandth of it; `fine`, whether the fringes' contrast is looked at.
    Returns a Solution.
    """
    c, damping = start, 1e-3
    nothing = np.zeros(len(problem.bins.light))
    averaging = _averaging(problem, basis, c) if fine else Averaging(nothing + 1.0, nothing)
    here = _evaluate(problem, basis, c, averaging)
    done, converged = 0, False
    gram, slope = linearise(problem, basis, here, averaging)
    if weak:
        smooth = smooth * (_WEAK * np.trace(gram) / max(np.trace(smooth), 1e-300))
    smooth = smooth.copy()
    smooth[-1, -1] += hold
    while done < steps and not converged:
        done += 1
        value = here.misfit + float(c @ smooth @ c)
        c, gain, damping = _step(
            problem, basis, smooth, c, value, (gram, slope), averaging, damping
        )
        converged = bool(gain < (0.5 if precise else 1e-3 * value))
        averaging = _averaging(problem, basis, c) if fine else averaging
        here = _evaluate(problem, basis, c, averaging)
        gram, slope = linearise(problem, basis, here, averaging)
    return Solution(c, here.misfit, smooth, gram, slope, here.residual, here.light, done, converged)


def _step(
    problem: Problem,
    basis: Basis,
    smooth: Array,
    c: Array,
    value: float,
    linear: tuple[Array, Array],
    averaging: Averaging,
    damping: float,
) -> tuple[Array, float, float]:
    """One step, damped until it does not rise: new unknowns, what they gain, the next damping."""
    gram, slope = linear
    matrix = gram + smooth
    while damping < 1e8:
        extra = damping * np.diag(matrix)
        right = gram @ c + slope + extra * c
        new = with_signs(matrix + np.diag(extra), right, basis.signed)
        there = _evaluate(problem, basis, new, averaging).misfit + float(new @ smooth @ new)
        if there <= value * (1.0 + 1e-12):
            return new, value - there, 0.2 * damping
        damping *= 8.0
    return c, 0.0, damping


def with_signs(matrix: Array, right: Array, signed: int) -> Array:
    """The c that minimises c^T M c / 2 - c^T b with its first `signed` members >= 0.

    Parameters: `matrix` M (m, m), positive definite; `right` b (m,). Returns c (m,).
    Source: Lawson & Hanson (1974), Solving Least Squares Problems, chapter 23.
    """
    from scipy.linalg import cholesky, solve_triangular
    from scipy.optimize import nnls

    free = slice(signed, None)
    back = np.linalg.solve(matrix[free, free], np.c_[matrix[free, :signed], right[free]])
    reduced = matrix[:signed, :signed] - matrix[:signed, free] @ back[:, :-1]
    target = right[:signed] - matrix[:signed, free] @ back[:, -1]
    scale = 1.0 / np.sqrt(np.diag(reduced))
    scaled = reduced * np.outer(scale, scale) + _RIDGE * np.eye(signed)
    root = cholesky(scaled)
    found, _ = nnls(root, solve_triangular(root, scale * target, trans="T"), maxiter=30 * signed)
    bound = scale * found
    return np.r_[bound, back[:, -1] - back[:, :-1] @ bound]


def linearise(
    problem: Problem, basis: Basis, here: _Point, averaging: Averaging
) -> tuple[Array, Array]:
    """J^T J and J^T r at a point, the light's coefficients eliminated."""
    bins = problem.bins
    along = _amplitude(problem, here.light) / bins.sigma
    real, imag = (
        (along * d).astype(np.float32)[:, None]
        for d in _signal_slopes(problem, here.field, averaging)
    )
    m = basis.columns.shape[1]
    gram, slope, mixed = np.zeros((m, m)), np.zeros(m), np.zeros((len(here.columns), m))
    for start in range(0, len(here.residual), _CHUNK):
        part = slice(start, start + _CHUNK)
        columns = basis.columns[part]
        jacobian = (real[part] * columns.real + imag[part] * columns.imag).astype(float)
        gram += jacobian.T @ jacobian
        slope += here.residual[part] @ jacobian
        mixed += here.columns[:, part] @ jacobian
    gram -= mixed.T @ np.linalg.solve(here.columns @ here.columns.T, mixed)
    return gram, slope


def _evaluate(problem: Problem, basis: Basis, c: Array, averaging: Averaging) -> _Point:
    field = basis.columns @ c.astype(np.complex64)
    bins = problem.bins
    signal = _signal(problem, field, averaging)
    columns = np.concatenate([bins.illumination * signal, bins.background]) / bins.sigma
    data = bins.light / bins.sigma
    light = np.linalg.solve(columns @ columns.T, columns @ data)
    return _Point(field, columns, light, data - light @ columns)


def _amplitude(problem: Problem, light: Array) -> Array:
    """The illumination A at the bins."""
    bins = problem.bins
    return light[: len(bins.illumination)] @ bins.illumination


def _signal(problem: Problem, field: Array, averaging: Averaging) -> Array:
    """The polariscope's signal S of a stress difference."""
    order = np.abs(field).astype(float) * problem.optics.order_per_mpa + averaging.shift
    chain = problem.optics.chain
    direction = None if chain.ideal else principal_direction(field)
    return polariscope_signal(order, chain, direction=direction, visibility=averaging.contrast)


def _signal_slopes(problem: Problem, field: Array, averaging: Averaging) -> tuple[Array, Array]:
    """dS/d(Re D) and dS/d(Im D), by central differences of a thousandth of a fringe."""
    small = 1e-3 / problem.optics.order_per_mpa
    field = field.astype(complex)
    pairs = (
        (_signal(problem, field + step, averaging), _signal(problem, field - step, averaging))
        for step in (small, 1j * small)
    )
    real, imag = ((ahead - behind) / (2.0 * small) for ahead, behind in pairs)
    return real, imag


def pixel_field(pixels: PixelGrid, basis: Basis, unknowns: Array) -> Array:
    """The stress difference of some unknowns at every pixel (rows, cols), MPa."""
    pressure, shear = basis.on_lattice(unknowns, pixels)
    regular = basis.regular(unknowns).difference(pixels.x_mm[None, :], pixels.z_mm[:, None])
    return np.asarray(stress_difference(field_grid(pixels), pressure, shear) + regular)


@lru_cache(maxsize=2)
def field_grid(pixels: PixelGrid) -> FieldGrid:
    """Kernels from the lattice of `lattice_px` to the pixels; the last two are kept."""
    places = lattice_px(pixels)
    left = pixels.left_mm + float(places[0]) * pixels.pixel_mm
    return make_field_grid(pixels, left_mm=left, spacing_mm=pixels.pixel_mm, nodes=len(places))


def _averaging(problem: Problem, basis: Basis, c: Array) -> Averaging:
    order = np.abs(pixel_field(problem.pixels, basis, c)) * problem.optics.order_per_mpa
    return bin_averaging(order, problem.bins, problem.optics.blur_px)
