"""Wear under a cylinder, on a mesh that moves with the edges of the contact.

While both edges advance, the contact is one interval, the depth vanishes at its ends, and all is
smooth in their frame, x = m + b ξ, in Hertz's units (lengths in a, p in p0, h in a²/R, K in a²/(R
p0) of the first load; only mu beta is left of friction and materials):

    ∂h/∂K = p + (m' + b' ξ)/b ∂h/∂ξ,    b A p + h + x²/2 = d,    b ∫ p dξ = (π/2) P'/P'_0,
    A p = -(1/π) ∫ p ln|ξ-t| dt - mu beta ∫_ξ^1 p.

Nodes ξ = (3c - c³)/2, c = cos φ, φ equally spaced, crowd as φ⁴ at the edges: the broken powers of
pressure and depth there, p ~ distance^γ with tan(πγ) = 2V/E* at an edge of speed V, become smooth
enough for formulas of fourth order. With the load per φ, w = p (3/2) sin³φ = Σ c_k cos kφ,

    ∫ p ln|ξ-t| dt = const - π Σ_{k>=1} (c_k/k) cos kφ + ∫ w(φ') ln(3 - c² - c c' - c'²) dφ',
    ∫_ξ^1 p dt     = c_0 φ + Σ_{k>=1} (c_k/k) sin kφ,

matrices that no width changes. Steps are those of the fourth-order backward differentiation with
variable steps: (h, m, b, d) are corrected by one Newton step from their forecast, whose error is
the step's control; states between steps are read off the same polynomial. Sources: Archard (1953),
J. Appl. Phys. 24, 981; Johnson (1985), Contact Mechanics, sections 2.4, 4.2 and 5.4; Mason &
Handscomb (2003), Chebyshev Polynomials, section 9.5; Kress (1990), Numer. Math. 58, 145, for the
crowding; Hairer, Nørsett & Wanner (1993), Solving ODEs I, section III.5.
"""

import math
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from threading import Lock

import numpy as np
from scipy.linalg import lapack

from isochrome.contact.pressure import Floats
from isochrome.contact.sliding_history import SAME, Drive, OutputState, SlidingHistory
from isochrome.errors import PhysicsError

_BACK, _AHEAD = 3, 1
"""Neighbours in the derivative along φ, towards the nearer edge and away from it: fourth order, and
since the surface enters at the edges, upwind: central differences ring near them."""
_POWERS = ((2.0, 5.0), (2.0, 4.0, 6.0), (2.0, 4.0, 5.0, 6.0))
"""Powers of φ of which the derivative is exact at the first nodes: depth goes as φ² before its edge
has moved, and as φ⁴ to φ⁶ after."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Matrices of a mesh of n intervals on -1..1, for values at its n-1 inner nodes. `xi` (n+1,):
    all nodes, from the right edge to the left; `logarithm` (n+1, n-1): -(1/π) ∫ p ln|ξ-t| dt up to
    a constant; `ahead` (n+1, n-1): ∫_ξ^1 p dt; `total` (n-1,): ∫ p dt; `slope` (n-1, n-1):
    derivative along ξ of what vanishes at both ends."""

    xi: Floats
    logarithm: Floats = field(repr=False)
    ahead: Floats = field(repr=False)
    total: Floats = field(repr=False)
    slope: Floats = field(repr=False)


def angles(intervals: int) -> Floats:
    """φ of a mesh's nodes (n+1,), from 0 to π."""
    return np.linspace(0.0, np.pi, intervals + 1)


def angle_of(xi: Floats) -> Floats:
    """φ of places ξ, those beyond the edges at them: with c = 2 sin α, ξ = sin 3α."""
    cosine = 2.0 * np.sin(np.arcsin(np.clip(xi, -1.0, 1.0)) / 3.0)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def crowding(phi: Floats) -> Floats:
    """-dξ/dφ = (3/2) sin³φ."""
    return np.asarray(1.5 * np.sin(phi) ** 3)


@lru_cache(maxsize=4)
def make_mesh(intervals: int) -> Mesh:
    """The matrices of a mesh, which depend on the count of its intervals, 8 at least, alone."""
    n = intervals
    phi, k = angles(n), np.arange(1, n + 1)
    inner, c = phi[1:-1], np.cos(phi)
    weight = crowding(inner)
    mean = weight / n  # c_0 of w
    share = np.r_[np.full(n - 1, 2.0 / n), 1.0 / n] / k
    terms = share[:, None] * np.cos(np.outer(k, inner)) * weight  # c_k/k
    ratio = 3.0 - c[:, None] ** 2 - np.outer(c, c[1:-1]) - c[1:-1] ** 2
    logarithm = np.cos(np.outer(phi, k)) @ terms - np.log(ratio) * mean
    ahead = np.outer(phi, mean) + np.sin(np.outer(phi, k)) @ terms
    xi, slope = 0.5 * c * (3.0 - c * c), _slope(n) / -weight[:, None]
    return Mesh(xi=xi, logarithm=logarithm, ahead=ahead, total=np.pi * mean, slope=slope)


def _slope(n: int) -> Floats:
    """Differences along φ for a function that is even about both ends and zero there. Low order and
    local on purpose: the depth grows as a broken power of the distance from an edge, and a
    derivative by the whole series would send the error of that all over the contact."""
    offsets = np.arange(-_BACK, _AHEAD + 1.0)
    stencil = _exact_slope(offsets, np.arange(float(len(offsets))), np.eye(len(offsets))[1])
    half = np.zeros((n + 1, n + 1))
    rows = np.arange(1, n // 2 + 1)
    for offset, value in zip(offsets.astype(int), stencil, strict=True):
        np.add.at(half, (rows, np.abs(rows + offset)), value)
    for row, some in enumerate(_POWERS, start=1):
        powers, nodes = np.array(some), np.arange(1.0, len(some) + 1.0)
        half[row] = 0.0
        slopes = powers * float(row) ** (powers - 1.0)
        half[row, 1 : len(some) + 1] = _exact_slope(nodes, powers, slopes)
    matrix = half - half[::-1, ::-1]
    if n % 2 == 0:
        matrix[n // 2] *= 0.5  # the middle has both neighbourhoods
    return n / np.pi * matrix[1:-1, 1:-1]


def _exact_slope(nodes: Floats, powers: Floats, slopes: Floats) -> Floats:
    """Weights of values at nodes for which each power has its slope."""
    return np.asarray(np.linalg.solve(nodes ** powers[:, None], slopes))


_NEWTON, _CLOSE = 50, 1e-10


@dataclass(frozen=True)
class Units:
    """Hertz's load P'_0, half-width a, peak pressure p0, and a²/R; `beta` is E*/(4 G*)."""

    line_load_n_per_mm: float
    length_mm: float
    pressure_mpa: float
    depth_mm: float
    beta: float

    @property
    def dose_mm_per_mpa(self) -> float:
        """The unit of the dose, a²/(R p0)."""
        return self.depth_mm / self.pressure_mpa


@dataclass(frozen=True)
class MeshPoint:
    """Where a run has been: dose, state (h at the inner nodes, m, b, d), and pressure there."""

    dose: float
    state: Floats
    pressure: Floats


@dataclass(frozen=True)
class ScarEquations:
    """The equations on one mesh, driven by one course."""

    mesh: Mesh
    units: Units
    course: SlidingHistory

    def unworn(self) -> MeshPoint:
        """The contact before wear, by Newton's method on (p, m, b, d) from Hertz's solution. Raises
        PhysicsError where it does not converge."""
        load, a = self._driven(self.course.leaving(0.0))
        xi, n = self.mesh.xi, len(self.mesh.xi) - 2
        y = np.r_[np.sqrt(1.0 - xi[1:-1] ** 2), 0.0, 1.0, 0.5]
        scale = np.r_[self.mesh.total, np.ones(3)]  # p counts by its load: rounding at an edge
        for _ in range(_NEWTON):
            p, (m, b, d) = y[:n], y[n:]
            x, u = m + b * xi, a @ p
            jacobian = np.pad(b * a, ((0, 0), (0, 3)))
            _add_place(jacobian, u, x, xi)
            residual = b * u
            residual[:-1] += 0.5 * x * x - d
            residual[-1] -= load
            change = lapack.dgesv(jacobian, -residual)[2]
            y = y + change
            if np.abs(scale * change).max() < _CLOSE:
                return MeshPoint(0.0, np.r_[np.zeros(n), y[n:]], y[:n])
        raise PhysicsError("unworn_contact_did_not")

    def step(
        self, dose: float, span: float, base: Floats, forecast: Floats
    ) -> tuple[MeshPoint, Floats]:
        """The state at a dose where (h, m, b)' = (state - base)/span, and its change. One Newton
        step from the `forecast` (n+2,) of the state."""
        load, a = self._driven(self.course.at(dose * self.units.dose_mm_per_mpa))
        xi, n = self.mesh.xi, len(self.mesh.xi) - 2
        h, (m, b, d) = forecast[:n], forecast[n:]
        flow = (m - base[n] + (b - base[n + 1]) * xi[1:-1]) / (span * b)
        tilt = self.mesh.slope @ h
        pressure = (h - base[:n]) / span - flow * tilt
        by_state = np.zeros((n, n + 3))
        np.multiply(-flow[:, None], self.mesh.slope, out=by_state[:, :n])
        by_state.ravel()[:: n + 4] += 1.0 / span  # the diagonal
        by_state[:, n] = -tilt / (span * b)
        by_state[:, n + 1] = (flow - xi[1:-1] / span) * tilt / b
        x, u = m + b * xi, a @ pressure
        jacobian = b * (a @ by_state)
        inner = np.arange(n)
        jacobian[inner + 1, inner] += 1.0  # h itself, which is zero at both ends
        _add_place(jacobian, u, x, xi)
        residual = b * u
        residual[1:-2] += h
        residual[:-1] += 0.5 * x * x - d
        residual[-1] -= load
        change = lapack.dgesv(jacobian, -residual)[2]
        return MeshPoint(dose, forecast + change, pressure + by_state @ change), change

    def _driven(self, drive: Drive) -> tuple[float, Floats]:
        """The load b ∫p dξ, and the matrix of A above the row of ∫p."""
        mesh = self.mesh
        a = mesh.logarithm - drive.friction * self.units.beta * mesh.ahead
        load = 0.5 * math.pi * drive.line_load_n_per_mm / self.units.line_load_n_per_mm
        return load, np.vstack([a, mesh.total])


def _add_place(jacobian: Floats, u: Floats, x: Floats, xi: Floats) -> None:
    """Derivatives of b A p + x²/2 - d and of b ∫p by m, b and d, added to the last columns."""
    jacobian[:-1, -3] += x
    jacobian[:-1, -2] += xi * x
    jacobian[:, -2] += u
    jacobian[:-1, -1] -= 1.0


def hertz_units(
    radius_mm: float, modulus_mpa: float, coupling_per_mpa: float, load: float
) -> Units:
    """Units of a cylinder's contact under a line load: a² = 4 P' R/(π E*), p0 = E* a/(2R).
    `coupling_per_mpa` is 1/G*. Source: Johnson (1985), section 4.2."""
    length = math.sqrt(4.0 * load * radius_mm / (math.pi * modulus_mpa))
    pressure, beta = 0.5 * modulus_mpa * length / radius_mm, 0.25 * modulus_mpa * coupling_per_mpa
    return Units(load, length, pressure, length**2 / radius_mm, beta)


_ORDER = 4
_GROW, SHRINK, SAFETY = 1.25, 0.3, 0.9
_SHARE, _LOOSEST, _SHARPER = 0.5, 5e-4, 0.12
"""Allowed error of a forecast over the tolerance, at 1e-3 and above, and at most; below, it falls
with the tolerance by this power besides. p_max and depth then err 0.1 to 0.4 of the tolerance
(measured). Far above it the high order is not stable."""
_FINEST_ERROR = 1e-8
"""Least error that is allowed: rounding is felt below it at the first doses of a strongly coupled
contact (measured: with 1.5e-9 the steps of course 69 shrink to nothing, and nobody is told)."""
_REPEATED = 2
"""Newton steps taken again in as many first steps, whose forecast knows too little of the past."""
_REJECT = 4.0
"""Forecast errors over the allowed one at which a step is taken again."""
_FIRST = 1.5e-3
"""First step over the root of the allowed error, in the units of the dose."""
_COARSEST, _COARSEST_ERROR, _MESH_ORDER = 24, 2e-3, 4.4
"""A mesh of 24 intervals errs up to 2.5e-3 in the pressure that its scar gives where a larger load
overruns the edge, with an order of 4.4, and far less where none does (measured); two fifths of the
tolerance are allowed."""
_RISEN, _OVERRUN, _BEND = 1.05, 0.12, 0.01
"""Load over the first from which a contact may overrun its own scar's edge while it wears, and the
shares of the tolerance that its steps and its mesh then keep: the bend goes inwards, where the mesh
is coarser. Measured where the load doubles in a third of the dose before: p_max errs 4.7 of 1e-4 on
a mesh that keeps the first, a quarter on one that keeps the second."""
_FINEST, _FINEST_BEND = 160, 240
"""Most intervals of a mesh, and where there may be a bend in it (measured of courses 178 and 297:
p_max errs up to 2.1e-5 with 160, 2.4e-6 with 240)."""
_MAX_STEPS = 20_000
_ROUNDING = 3e-14
"""Change of a depth that is none, in its unit: it would be felt where there is little depth yet."""
_SHORTEST, _NEARLY, _ANEW = 1e-9, 1e-3, 1e-6
"""Shortest step over the dose: what errs in it is far below any tolerance. Its forecast's error at
which load or friction nearly jump within it, and one Newton step no longer holds. First step beyond
a kink: shorter ones feel rounding, which shrinks them further (measured: 6000 of them, to 1e-9)."""
_STILL = 4e-6
"""First half-widths by which an edge may draw back before its trail counts: where an edge nearly
stands still the steps must not decide."""


@dataclass(frozen=True)
class Scar:
    """A worn contact at n+1 nodes from its left to its right edge (see above)."""

    stop: OutputState
    x_mm: Floats
    pressure_mpa: Floats
    depth_mm: Floats


def scar_history(
    radius_mm: float, contact_modulus_mpa: float, coupling_per_mpa: float, history: SlidingHistory,
    stops: Sequence[OutputState], *, tolerance: float, held: bool = False,
) -> Iterator[Scar]:  # fmt: skip
    """Solve worn contacts of a cylinder at rising doses, as long as both edges advance. They end
    before the first stop on whose way an edge draws back, which leaves worn surface behind, or
    jumps: neither is held in this frame. `held`: both edges are known to advance that far. E* and
    1/G* (1/MPa) are the contact's, `tolerance` the wanted relative error of the pressure.
    PhysicsError where the steps do not converge."""
    load = history.leaving(0.0)[0]
    bend, finest = tolerance, _FINEST
    if load_rises(history):
        tolerance, bend, finest = _OVERRUN * tolerance, _BEND * tolerance, _FINEST_BEND
    units = hertz_units(radius_mm, contact_modulus_mpa, coupling_per_mpa, load)
    finer = max(1.0, (_COARSEST_ERROR / bend) ** (1.0 / _MESH_ORDER))
    mesh = make_mesh(min(finest, 2 * math.ceil(0.5 * _COARSEST * finer)))
    equations = ScarEquations(mesh, units, history)
    unit = units.dose_mm_per_mpa
    jump = history.next_jump(0.0) / unit
    allowed = _SHARE * tolerance * (1e3 * tolerance) ** _SHARPER
    allowed = min(max(allowed, _FINEST_ERROR), _LOOSEST)
    if history.steady:
        walk = _steady_walk(mesh, units.beta * float(history.friction[0]), allowed, held)
    else:
        walk = Walk(equations, min(jump, stops[-1].dose_mm_per_mpa / unit), allowed, held)
    for stop in stops:
        target = stop.dose_mm_per_mpa / unit
        if target > jump * (1.0 + SAME):
            return
        points = walk.to(target, stop.distance_m)
        if not points:
            return
        yield _scar(equations, stop, _at(points, target))


class Walk:
    """The last points after each step of `_walk`, made as far as they are asked for."""

    def __init__(self, equations: ScarEquations, end: float, allowed: float, held: bool) -> None:
        first = [equations.unworn()]
        self._made, self._lock = [first], Lock()
        self._steps = _walk(equations, first, end, allowed, held)

    def to(self, dose: float, distance_m: float) -> list[MeshPoint]:
        """The points whose last is the first not before a dose; none where they end before it.
        PhysicsError names the distance of a dose that so many steps do not reach."""
        least = dose * (1.0 - SAME)
        with self._lock:
            while self._made[-1][0].dose < least:
                points = next(self._steps, [])
                if not points:
                    return []
                if len(self._made) > _MAX_STEPS:
                    raise PhysicsError("wear_steps_did_not", distance_m=distance_m)
                self._made.append(points)
            return self._made[bisect_left(self._made, least, key=lambda some: some[0].dose)]


@lru_cache(maxsize=16)
def _steady_walk(mesh: Mesh, pull: float, allowed: float, held: bool) -> Walk:
    """The walk of all contacts under one load and one friction: in their units they differ by
    `pull` = mu beta alone."""
    course = SlidingHistory(np.arange(2.0), np.arange(2.0), np.ones(2), np.full(2, pull))
    equations = ScarEquations(mesh, Units(1.0, 1.0, 1.0, 1.0, 1.0), course)
    return Walk(equations, math.inf, allowed, held)


def load_rises(history: SlidingHistory) -> bool:
    """Whether a contact may overrun its own scar's edge while it wears."""
    return bool(history.line_load_n_per_mm.max() > _RISEN * history.leaving(0.0)[0])


def unresolved(scar: Scar) -> float:
    """How much of a scar's pressure its mesh may miss, a ratio: what every second node alone does.
    Equation: max |w - w_2| / max w of the load per φ, w = p (3/2) sin³φ, with w_2 the spline
    through every second node. Where a bend of the depth lies between few nodes, p_max errs by 0.15
    to 1.6 of it, for errors of 1e-6 to 5e-4 and 78 to 240 intervals (measured)."""
    from scipy.interpolate import CubicSpline

    phi = angles(len(scar.x_mm) - 1)
    load = scar.pressure_mpa * crowding(phi)
    half = CubicSpline(phi[::2], load[::2], bc_type="clamped")(phi)
    return float(np.abs(half - load).max() / load.max())


def _walk(
    equations: ScarEquations, points: list[MeshPoint], end: float, allowed: float, held: bool
) -> Iterator[list[MeshPoint]]:
    """The last points after each step to a dose; ends where an edge draws back, or nearly jumps. A
    step that errs since load or friction have a kink in it ends there, and the next ones begin
    anew: what was before does not foretell what comes, and edges forecast across it would ring."""
    history, unit = equations.course, equations.units.dose_mm_per_mpa
    edges, first = _edges(points[0]), _FIRST * math.sqrt(allowed)
    step, kink = first, math.inf
    while (dose := points[0].dose) < end:
        shortest = _SHORTEST * max(dose, first)
        if dose >= kink * (1.0 - SAME):
            points, step, kink = points[:1], _ANEW * max(dose, first), math.inf
        remaining, step = min(end, kink) - dose, max(step, shortest)
        size = remaining if remaining <= step else min(step, 0.5 * remaining)
        new, error = _advance(equations, points, size)
        factor = SAFETY * (allowed / max(error, 1e-300)) ** (1.0 / (min(len(points), _ORDER) + 1))
        if size <= shortest and error > _NEARLY:
            return
        if size > shortest and error > _REJECT * allowed and len(points) > _ORDER:
            ahead = history.next_break(dose * (1.0 + SAME) * unit) / unit
            kink = ahead if ahead < dose + size else kink
            step = size * max(SHRINK, factor)
            continue
        edges = np.maximum(edges, _edges(new))
        reach = _edges(new) + np.minimum(_growth(points, new), 0.0)
        if not held and np.any(reach < edges - _STILL):
            return
        points = [new, *points[:_ORDER]]
        step = size * min(_GROW, max(SHRINK, factor))
        yield points


def _advance(
    equations: ScarEquations, points: list[MeshPoint], size: float
) -> tuple[MeshPoint, float]:
    """One step, and the forecast's error: of the depth over the depth, or over what the contact
    gives elastically where that is less; or of the edges over the half-width."""
    dose = points[0].dose + size
    past = points[:_ORDER]
    slope = _slope_weights([dose, *(point.dose for point in past)])
    span = 1.0 / slope[0]
    base = -span * _mix(slope[1:], [point.state for point in past])
    forecast = _at(points, dose).state
    new, change = equations.step(dose, span, base, forecast)
    for _ in range(_REPEATED if len(points) <= _REPEATED else 0):
        new, more = equations.step(dose, span, base, new.state)
        change = change + more
    n = len(new.pressure)
    width = float(forecast[n + 1])
    depth = max(0.0, float(np.abs(change[:n]).max()) - _ROUNDING)
    depth /= min(dose, width) * float(new.pressure.max())
    return new, max(depth, float(np.abs(change[n : n + 2]).max()) / width)


def _edges(point: MeshPoint) -> Floats:
    """How far the contact reaches to the left and to the right, b - m and b + m."""
    m, b, _ = point.state[-3:]
    return np.array([b - m, b + m])


def _growth(points: list[MeshPoint], new: MeshPoint) -> Floats:
    """How far the edges would go in another step like the last, by their speed at its end. A step
    may pass over the dose at which an edge turns."""
    past = [new, *points[:_ORDER]]
    speeds = _slope_weights([point.dose for point in past])
    size = new.dose - points[0].dose
    return np.asarray(size * sum(v * _edges(point) for v, point in zip(speeds, past, strict=True)))


def _scar(equations: ScarEquations, stop: OutputState, point: MeshPoint) -> Scar:
    """A point in mm and MPa, from the left edge to the right. Between steps the polynomials of p
    and b carry the load only to their order: p is scaled to it."""
    mesh, units, n = equations.mesh, equations.units, len(point.pressure)
    m, b = point.state[n : n + 2]
    borne = units.pressure_mpa * units.length_mm * b * float(mesh.total @ point.pressure)
    scale = units.pressure_mpa * stop.line_load_n_per_mm / borne
    x_mm, pressure = units.length_mm * (m + b * mesh.xi[::-1]), np.pad(point.pressure[::-1], 1)
    return Scar(stop, x_mm, scale * pressure, units.depth_mm * np.pad(point.state[:n][::-1], 1))


def _at(points: list[MeshPoint], dose: float) -> MeshPoint:
    """The polynomial through the points, at a dose between or beyond them."""
    doses = [point.dose for point in points]
    weights = [math.prod((dose - s) / (r - s) for s in doses if s != r) for r in doses]
    state = _mix(weights, [point.state for point in points])
    return MeshPoint(dose, state, _mix(weights, [point.pressure for point in points]))


def _mix(weights: list[float], rows: list[Floats]) -> Floats:
    return np.asarray(np.array(weights) @ np.array(rows))


def _slope_weights(nodes: list[float]) -> list[float]:
    """Weights of the values at the nodes in their polynomial's slope at the first of them."""
    first, *others = nodes
    weights = [
        math.prod((first - s) / (r - s) for s in others if s != r) / (r - first) for r in others
    ]
    return [-sum(weights), *weights]
