r"""Damped Gauss-Newton steps for surface tractions, with signs kept and the light eliminated.

The light is A S(D) + C with the polariscope's signal S, the stress difference D = Σ c_j D_j, and
illumination A and background C linear in few coefficients. With w = 1/sigma the misfit is

    |w (light - A S - C)|² + c^T K c,    c_j >= 0 for the tractions' halves,

K a quadratic regularisation. Each step solves a least-squares problem with signs for c, the light's
coefficients projected out (Golub & Pereyra); the contrast that a bin's area leaves follows the
last field. With signs, each step is itself an iteration over the active ones, so that this loop is
not `isochrome.estimation.minimise`; its damping is the one of `isochrome.estimation.least_squares`.

Tractions are as smooth as the frame's noise asks for: c^T K c = s ∫ p''² + q''² dx. Weak enough, it
changes nothing, and the tractions follow the noise; the discrepancy principle raises s until the
residual has grown by what the true tractions would leave more than the best fitting ones, one unit
of chi² for each unknown.
Source: Golub & Pereyra (2003), Inverse Problems 19, R1; Lawson & Hanson (1974), Solving Least
Squares Problems, chapter 23; Morozov (1984), Methods for Solving Incorrectly Posed Problems,
section 8.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from isochrome.estimation import next_damping
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.renderer import FringeOptics
from isochrome.fitting.tractions.binned_pixels import Averaging, Bins, bin_averaging
from isochrome.fitting.tractions.traction_basis import Basis, lattice_px
from isochrome.stress import FieldGrid, PixelGrid, make_field_grid, stress_difference

_CHUNK = 4096
_WEAK = 1e-7
_RIDGE = 1e-10
"""Added to a unit diagonal: rounding of fields in single precision."""

_HALVINGS = 24


@dataclass(frozen=True)
class TractionProblem:
    """What does not change: the `bins`, their place, and the `optics`."""

    bins: Bins
    pixels: PixelGrid
    optics: FringeOptics


@dataclass(frozen=True, kw_only=True)
class Solution:
    """Unknowns c (m,), the misfit's two parts, and the linearisation there.

    `misfit`, sum of squared weighted residuals; `smooth` K (m, m) as used; `gram` J^T J (m, m),
    with the light eliminated; `slope` J^T r (m,); `residual` r (bins,); `light`, the light's
    coefficients; `converged`, whether the steps came to an end.
    """

    unknowns: Array
    misfit: float
    smooth: Array
    gram: Array
    slope: Array
    residual: Array
    light: Array
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
    problem: TractionProblem,
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
    c, damping, converged = start, 1e-3, False
    nothing = np.zeros(len(problem.bins.light))
    averaging = Averaging(nothing + 1.0, nothing)
    for done in range(steps + 1):
        averaging = _averaging(problem, basis, c) if fine else averaging
        here = _evaluate(problem, basis, c, averaging)
        gram, slope = linearise_tractions(problem, basis, here, averaging)
        if done == 0:
            scale = _WEAK * np.trace(gram) / max(np.trace(smooth), 1e-300) if weak else 1.0
            smooth = smooth * scale
            smooth[-1, -1] += hold
        if converged or done == steps:
            break
        value = here.misfit + float(c @ smooth @ c)
        c, gain, damping = _step(
            problem, basis, smooth, c, value, (gram, slope), averaging, damping
        )
        converged = bool(gain < (0.5 if precise else 1e-3 * value))
    return Solution(
        unknowns=c,
        misfit=here.misfit,
        smooth=smooth,
        gram=gram,
        slope=slope,
        residual=here.residual,
        light=here.light,
        converged=converged,
    )


def _step(
    problem: TractionProblem,
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
            return new, value - there, float(next_damping(damping, True))
        damping = float(next_damping(damping, False))
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
    outcome, _ = nnls(root, solve_triangular(root, scale * target, trans="T"), maxiter=30 * signed)
    bound = scale * outcome
    result: Array = np.r_[bound, back[:, -1] - back[:, :-1] @ bound]
    return result


def linearise_tractions(
    problem: TractionProblem, basis: Basis, here: _Point, averaging: Averaging
) -> tuple[Array, Array]:
    """J^T J and J^T r at a point, the light's coefficients eliminated."""
    bins = problem.bins
    along = bins.illuminated(here.light) / bins.sigma
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


def _evaluate(problem: TractionProblem, basis: Basis, c: Array, averaging: Averaging) -> _Point:
    field = basis.columns @ c.astype(np.complex64)
    bins = problem.bins
    signal = _signal(problem, field, averaging)
    columns = np.concatenate([bins.illumination * signal, bins.background]) / bins.sigma
    data = bins.light / bins.sigma
    light = np.linalg.solve(columns @ columns.T, columns @ data)
    return _Point(field, columns, light, data - light @ columns)


def _signal(problem: TractionProblem, field: Array, averaging: Averaging) -> Array:
    """The polariscope's signal S of a stress difference."""
    order = np.abs(field).astype(float) * problem.optics.order_per_mpa + averaging.shift
    return problem.optics.signal(field, order=order, visibility=averaging.contrast)


def _signal_slopes(
    problem: TractionProblem, field: Array, averaging: Averaging
) -> tuple[Array, Array]:
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


def _averaging(problem: TractionProblem, basis: Basis, c: Array) -> Averaging:
    order = np.abs(pixel_field(problem.pixels, basis, c)) * problem.optics.order_per_mpa
    return bin_averaging(order, problem.bins, problem.optics.blur_px)


def smoothness(basis: Basis, pixel_mm: float) -> Array:
    """K of c^T K c = ∫ p''² + q''² dx over runs of neighbouring nodes (m, m), (MPa/mm²)² mm.

    Nothing is asked at the ends of a run: the pressure of a contact leaves its edge steeply.
    Parameters: `basis`; `pixel_mm`. Returns K (m, m), zero for the regular modes.
    """
    h, n, m = basis.spacing_px * pixel_mm, basis.nodes, basis.limit
    next_to = np.diff(basis.nodes_px) == basis.spacing_px
    middle = np.flatnonzero(next_to[1:] & next_to[:-1]) + 1
    second = np.zeros((len(middle), n))
    for k, weight in ((-1, 1.0), (0, -2.0), (1, 1.0)):
        second[np.arange(len(middle)), middle + k] = weight
    square = second.T @ second / h**3
    whole = np.zeros((basis.columns.shape[1],) * 2)
    same, other = (1.0 + m**2) * square, (1.0 - m**2) * square
    whole[: 2 * n, : 2 * n] = np.block([[same, other], [other, same]])
    return whole


def discrepancy_strength(solution: Solution, smooth: Array, signed: int) -> float:
    """The strength s at which the misfit has grown by chi² for each unknown off its bound.

    The misfit is followed by its quadratic model about a solution with weak regularisation.
    Parameters: `solution`; `smooth` K for s = 1; `signed`, how many unknowns are >= 0. Returns s.
    Source: see the module.
    """
    c, gram, slope = solution.unknowns, solution.gram, solution.slope
    free = np.count_nonzero(c[:signed] > 0.0) + len(c) - signed
    allowed = free * solution.chi**2
    # what is no smoothness, such as what holds the surface's place, stays as it is
    selected = solution.smooth * (np.diag(smooth) == 0.0)

    def grown(s: float) -> float:
        new = with_signs(gram + selected + s * smooth, gram @ c + slope, signed)
        step = new - c
        return float(step @ gram @ step - 2.0 * slope @ step)

    unit = np.trace(gram) / np.trace(smooth)
    low, high = np.log(1e-9 * unit), np.log(1e6 * unit)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if grown(np.exp(middle)) < allowed else (low, middle)
    return float(np.exp(low))
