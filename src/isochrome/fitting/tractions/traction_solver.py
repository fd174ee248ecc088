"""A frame's pixels averaged in squares: few numbers, and nearly all that the frame tells.

Below a surface a stress field is smooth over a fraction of the depth, so that deep pixels may be
averaged by four or sixteen, where no fringe is lost by it, and only those near the surface stand
for themselves. What averaging makes of the fringes is known: see `bin_averaging`.

The stress difference at a frame's bins as a linear map of surface tractions.

Tractions are piecewise linear between nodes, hats whose integrals are known in closed form; what
the rest of the body adds is a regular stress of low degree. Inside Coulomb's cone |q| <= m p the
two tractions of a node are sums of two that cannot be negative,

    p = a + b,    q = m (a - b),    a >= 0,  b >= 0,

so that no pressure pulls, and no shear acts where nothing presses. With the field linear in
c = (a, b, regular modes), the whole inversion is a least-squares problem with signs.
Source: the fields are those of `stress.half_plane`.

Damped Gauss-Newton steps for surface tractions, with signs kept and the light eliminated.

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

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import gcd

import numpy as np
from numpy.typing import NDArray

from isochrome.estimation import FrameData, next_damping
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.frame.renderer import FringeOptics
from isochrome.stress import (
    FieldGrid,
    PixelGrid,
    RegularStress,
    cauchy_of_hat,
    make_field_grid,
    regular_modes,
    stress_difference,
)

_LARGEST = 4
_DEEP = 8.0
"""Depth over a bin's side from which a bin may be that large."""
_FLAT = 0.2
"""Largest slope of the order, fringes a bin."""
_LARGEST_SHIFT = 0.02
"""Largest shift of the order that is believed, fringes: at N = 0 its Laplacian has a pole."""
_NOISE = 0.012
"""Noise over the brightest light for which these are made; less of it shows less of a bin's own
curvature, which grows with the square of its side."""


@dataclass(frozen=True, kw_only=True)
class Bins:
    """Squares of `side` pixels with their centres at `row`, `col` (pixels), sorted by side.

    `light`, its noise `sigma`, and the bases `illumination` (ki, n) and `background` (kb, n), the
    means over each square.
    """

    side: NDArray[np.int64]
    row: Array
    col: Array
    light: Array
    sigma: Array
    illumination: Array
    background: Array

    def where(self, keep: Mask) -> Bins:
        """Some of the bins, in the same order."""
        return Bins(**{name: part[..., keep] for name, part in vars(self).items()})

    def illuminated(self, light: Array) -> Array:
        """The illumination (n,) of the light's coefficients, the background's among them."""
        return light[: len(self.illumination)] @ self.illumination

    def sides(self) -> list[tuple[int, slice]]:
        """The sides that occur, each with the bins that have it."""
        result, first = np.unique(self.side, return_index=True)
        ends = [*first[1:], len(self.side)]
        return [(int(b), slice(i, j)) for b, i, j in zip(result, first, ends, strict=True)]


def make_bins(data: FrameData, depth_px: Array, slope: Array, *, from_px: float) -> Bins:
    """Average a frame's valid pixels in squares of 1, 2 or 4 pixels.

    Parameters: `data`; `depth_px` (rows,), of the pixels' centres below the surface; `slope`
    (rows, cols), fringes a pixel; `from_px`, depth of the first row that is used. Returns Bins;
    pixels at the right and lower rim that fill no square of the largest side are left out.
    """
    valid = data.valid & (depth_px >= from_px)[:, None]
    rows, cols = (n // _LARGEST * _LARGEST for n in valid.shape)
    noise = np.median(data.sigma[valid]) / np.percentile(data.light[valid], 99.0)
    finer = min(1.0, float(np.sqrt(noise / _NOISE)))
    side = np.ones((rows, cols), int)
    for b in (2, 4):
        steep = _squares(slope[:rows, :cols], b).max((-3, -1))
        deep = depth_px[:rows:b] >= _DEEP / finer * b
        whole = np.asarray((steep * b < _FLAT * finer) & deep[:, None])
        if b < _LARGEST:  # squares of one side fill whole squares of the largest
            whole = np.asarray(_squares(whole, _LARGEST // b).all((-3, -1)))
            whole = _repeat(whole, _LARGEST // b)
        side[_repeat(whole, b)] = b
    parts = [_averaged(data, valid, side, b) for b in (1, 2, 4)]
    names = vars(parts[0])
    return Bins(**{n: np.concatenate([vars(part)[n] for part in parts], axis=-1) for n in names})


def _averaged(data: FrameData, valid: Array, side: Array, b: int) -> Bins:
    rows, cols = side.shape

    def mean(image: Array) -> Array:
        return np.asarray(_squares(image[..., :rows, :cols], b).mean((-3, -1)))

    keep = (side[::b, ::b] == b) & _squares(valid[:rows, :cols], b).all((-3, -1))
    row, col = np.nonzero(keep)
    return Bins(
        side=np.full(len(row), b), row=(row + 0.5) * b - 0.5, col=(col + 0.5) * b - 0.5,
        light=mean(data.light)[keep], sigma=np.sqrt(mean(np.square(data.sigma))[keep]) / b,
        illumination=mean(data.illumination)[:, keep], background=mean(data.background)[:, keep],
    )  # fmt: skip


def _squares(image: Array, b: int) -> Array:
    """A view (..., rows/b, b, cols/b, b)."""
    *rest, rows, cols = image.shape
    return image.reshape(*rest, rows // b, b, cols // b, b)


def _repeat(image: Array, b: int) -> Array:
    return np.repeat(np.repeat(image, b, 0), b, 1)


@dataclass(frozen=True)
class Averaging:
    """What is left of the fringes in a bin's mean light: `contrast`, and `shift` of the order."""

    contrast: Array
    shift: Array


def bin_averaging(order: Array, bins: Bins, blur_px: float = 0.0) -> Averaging:
    """What a bin's area, and the camera's blur, make of the fringes.

    Equation: the mean of cos 2 pi N over a square of side b and a Gaussian of width s, in which N
    has slopes g and the Laplacian L, is that of N + (b²/24 + s²/2) L, times
    sinc(b g_x) sinc(b g_z) exp(-2 (pi s)² (g_x² + g_z²)).
    Parameters: `order` N (rows, cols) at every pixel; `bins`; `blur_px` s. Returns an Averaging.
    """
    row, col = bins.row.astype(int), bins.col.astype(int)
    slopes = np.gradient(order)
    down, across = (slope[row, col] for slope in slopes)
    area = np.sinc(bins.side * down) * np.sinc(bins.side * across)
    blur = np.exp(-2.0 * (np.pi * blur_px) ** 2 * (down**2 + across**2))
    bent = sum(np.gradient(slope, axis=k)[row, col] for k, slope in enumerate(slopes))
    shift = (np.square(bins.side) / 24.0 + 0.5 * blur_px**2) * bent
    return Averaging(area * blur, np.clip(shift, -_LARGEST_SHIFT, _LARGEST_SHIFT))


COARSEST = 32
"""Spacing of the coarsest nodes, in units of `picture_unit`: a power of two."""


FRICTION_LIMIT = 1.0
"""Largest |q|/p that is thought of: dry contacts of solids stay well below."""

DEGREE = 2
"""Degree of the regular stress: uniform, its slopes, and the next terms of far sides."""


@dataclass(frozen=True)
class Basis:
    """Fields of unit unknowns: `columns` (bins, 2 nodes + modes), complex64.

    `nodes_px` (n,), places in pixels from the picture's left edge, multiples of `spacing_px`;
    `limit`, m; `modes`, the regular stresses, each about 1 MPa at the picture's rim.
    """

    columns: Array
    nodes_px: NDArray[np.int64]
    spacing_px: int
    limit: float
    modes: tuple[RegularStress, ...]

    @property
    def signed(self) -> int:
        """How many unknowns, the first ones, cannot be negative."""
        return 2 * self.nodes

    @property
    def nodes(self) -> int:
        """Count of nodes n."""
        return len(self.nodes_px)

    def tractions(self, unknowns: Array) -> tuple[Array, Array]:
        """Pressure and shear (n,) of the unknowns (2 n + modes,), MPa."""
        a, b = unknowns[: self.nodes], unknowns[self.nodes : 2 * self.nodes]
        return a + b, self.limit * (a - b)

    @property
    def to_tractions(self) -> Array:
        """The matrix (2 n, unknowns) from the unknowns to pressure above shear."""
        one, m = np.eye(self.nodes), self.limit
        rest = self.columns.shape[1] - self.signed
        return np.pad(np.block([[one, one], [m * one, -m * one]]), ((0, 0), (0, rest)))

    def unknowns(self, pressure: Array, shear: Array, modes: Array) -> Array:
        """The unknowns of tractions (n,), brought into the cone, and of mode amplitudes."""
        inside = np.clip(shear / self.limit, -np.abs(pressure), np.abs(pressure))
        halves = np.r_[0.5 * (pressure + inside), 0.5 * (pressure - inside)]
        return np.asarray(np.r_[np.maximum(0.0, halves), modes])

    def regular(self, unknowns: Array) -> RegularStress:
        """The regular stress of the unknowns."""
        total = RegularStress()
        for k, mode in enumerate(self.modes):
            total = total + mode.times(float(unknowns[2 * self.nodes + k]))
        return total

    def on_lattice(self, unknowns: Array, pixels: PixelGrid) -> tuple[Array, Array]:
        """Pressure and shear of the unknowns at the nodes of `lattice_px`, MPa."""
        places = lattice_px(pixels)
        whole = places[:: self.spacing_px]
        at = (self.nodes_px - places[0]) // self.spacing_px
        result = []
        for traction in self.tractions(unknowns):
            values = np.zeros(len(whole))
            values[at] = traction
            result.append(np.interp(places, whole, values))
        return result[0], result[1]

    def with_top(self, lower: Basis, unknowns: Array) -> Basis:
        """The basis with one unknown more: by how much of a step the surface lies higher.

        Parameters: `lower`, the basis where all bins lie one step deeper; `unknowns`, those whose
        field is moved. Returns a Basis whose last column is that field's change over the step.
        """
        c = unknowns.astype(np.complex64)
        change = (lower.columns @ c - self.columns @ c)[:, None]
        return replace(self, columns=np.concatenate([self.columns, change], axis=1))


def picture_unit(pixels: PixelGrid) -> int:
    """Pixels that stand for one of a picture 659 wide: steps along the surface scale by it."""
    return max(1, round(pixels.cols / 659.0))


def scaled_modes(pixels: PixelGrid, degree: int) -> tuple[RegularStress, ...]:
    """Regular stresses up to a degree, each about 1 MPa at the picture's rim."""
    length = 0.5 * pixels.pixel_mm * max(pixels.rows, pixels.cols)
    return tuple(mode.times(length ** -(len(mode.series) - 1.0)) for mode in regular_modes(degree))


def lattice_px(pixels: PixelGrid) -> NDArray[np.int64]:
    """Nodes a pixel apart, in pixels from the picture's left edge, beyond the widest hats' ends."""
    unit = picture_unit(pixels)
    widest = COARSEST * unit
    return np.arange(-widest, (-(-pixels.cols // widest) + 1) * widest + 1)


def make_basis(
    bins: Bins,
    pixels: PixelGrid,
    nodes_px: Array,
    spacing_px: int,
    *,
    limit: float = FRICTION_LIMIT,
    degree: int = DEGREE,
) -> Basis:
    """Fields of every node's pressure and shear, and of the regular modes, at the bins.

    Parameters: `bins`; `pixels`, the picture's place; `nodes_px` (n,), multiples of `spacing_px`;
    `limit` m of |q| <= m p; `degree` of the regular stress. Returns a Basis.
    """
    n = len(nodes_px)
    modes = scaled_modes(pixels, degree)
    columns = np.empty((len(bins.light), 2 * n + len(modes)), np.complex64)
    for side, part in bins.sides():
        press, shear = _hat_fields(bins, side, part, pixels, nodes_px, spacing_px)
        columns[part, :n] = press + limit * shear
        columns[part, n : 2 * n] = press - limit * shear
    x = pixels.left_mm + pixels.pixel_mm * (bins.col + 0.5)
    z = pixels.top_mm + pixels.pixel_mm * (bins.row + 0.5)
    for k, mode in enumerate(modes):
        columns[:, 2 * n + k] = mode.difference(x, z)
    return Basis(columns, np.asarray(nodes_px), spacing_px, limit, modes)


def _hat_fields(
    bins: Bins, side: int, part: slice, pixels: PixelGrid, nodes_px: Array, spacing_px: int
) -> tuple[Array, Array]:
    """Stress difference of unit hats of pressure and of shear at bins of one side (bins, n).

    It depends on the depth and on the distance along the surface alone, and these take few values:
    a table of them is looked up.
    """
    pixel = pixels.pixel_mm
    depth, row = np.unique(bins.row[part], return_inverse=True)
    z = (pixels.top_mm + pixel * (depth + 0.5))[:, None]
    common = gcd(side, spacing_px)
    centre = np.rint((bins.col[part] + 0.5 - 0.5 * side) / common).astype(np.int32)
    steps = centre[:, None] - (np.asarray(nodes_px) // common).astype(np.int32)
    first, last = int(steps.min()), int(steps.max())
    x = pixel * (common * np.arange(first, last + 1) + 0.5 * side)
    one, two = cauchy_of_hat(x[None, :], z, spacing_px * pixel)
    press = -2.0 / np.pi * z * two
    shear = 1j * press - 2.0 / np.pi * one
    where = row[:, None].astype(np.int32) * len(x) + (steps - first)
    return press.astype(np.complex64).ravel()[where], shear.astype(np.complex64).ravel()[where]


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
        if fine:
            order = np.abs(pixel_field(problem.pixels, basis, c)) * problem.optics.order_per_mpa
            averaging = bin_averaging(order, problem.bins, problem.optics.blur_px)
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
        unknowns=c, misfit=here.misfit, smooth=smooth, gram=gram, slope=slope,
        residual=here.residual, light=here.light, converged=converged,
    )  # fmt: skip


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
    return np.asarray(np.r_[bound, back[:, -1] - back[:, :-1] @ bound])


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
