"""Contact pressure under a fixed load, by an active set.

Find p >= 0 and the approach d with gap = g + u(p) + c p - d >= 0, p·gap = 0 and h Σp = P'. The
diagonal c is zero in a static contact and k ds in an implicit wear step.

On a trial set of nodes the equations are linear (see `contact.trial`). The set then moves
by the signs of pressure and gap (block principal pivoting; Júdice & Pires 1994, Comput. Oper. Res.
21, 587), run by run in the numbers that the root singularity at an edge tells, with Murty's single
pivot as the safeguard, which is finite for this class of operators. A cold start comes from a
coarser grid, and has the edges within a node or two; one or two trial sets then do at any size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.contact.active_set import ActiveSystem
from isochrome.contact.surface import COARSER, Floats, Surface
from isochrome.errors import InputError, PhysicsError

_PATIENCE = 8
_MAX_SETS = 500
_TOO_FAR = 0.15
"""Spacings by which the line through p² ends beyond the edge (measured: 0.1 to 0.3)."""
_WORST = 100.0
"""Residual over tolerance at which a solution is refused, not returned."""


@dataclass(frozen=True)
class ContactState:
    """A solved contact at n nodes, and how well it holds."""

    pressure: Floats  # MPa
    gap: Floats  # mm
    approach_mm: float
    # KKT: the largest violation of gap = 0 in contact and gap >= 0 outside, over the range of the
    # elastic displacement
    residual: float
    iterations: int  # applications of the operator
    sets: int  # trial sets of nodes in contact


def solve_pressure(
    surface: Surface,
    gap_mm: Floats,
    line_load_n_per_mm: float,
    *,
    friction: float = 0.0,
    wear_mm_per_mpa: float = 0.0,
    start: Floats | None = None,
    tolerance: float = 1e-10,
) -> ContactState:
    """Contact pressure under the load P', for an undeformed gap (n,) that includes the worn depth.

    A constant offset of the gap does not matter; mu counts in the coupling alone; `wear_mm_per_mpa`
    is the diagonal c. `start` (n,), MPa: a coarser grid's where it is absent or bears nothing.
    `tolerance` is the KKT residual's. InputError on a gap or load that is none, PhysicsError where
    it does not converge.
    """
    datum = _checked_datum(gap_mm, line_load_n_per_mm)
    gap = gap_mm - datum
    active = None if start is None else start > 0.0
    if start is None or active is None or not active.any():
        start = _from_coarse(surface, gap, line_load_n_per_mm, friction, wear_mm_per_mpa)
        active = start > 0.0
    system = ActiveSystem(surface, gap, line_load_n_per_mm, friction, wear_mm_per_mpa)
    pressure = np.where(active, start, 0.0)
    fewest, patience, iterations = surface.nodes + 1, _PATIENCE, 0
    for sets in range(1, _MAX_SETS + 1):
        trial = system.solve(active, pressure, tolerance, look=patience >= 0)
        pressure, iterations = trial.pressure, iterations + trial.iterations
        count = int(np.count_nonzero(trial.wrong))
        if count == 0:
            residual = system.residual(active, trial.gap)
            if not residual <= _WORST * tolerance:
                break
            approach = datum + trial.approach
            return ContactState(pressure, trial.gap, approach, residual, iterations, sets)
        if count < fewest:
            fewest, patience = count, _PATIENCE
        else:
            patience -= 1
        if patience >= 0:
            active = active ^ _to_the_edge(active, trial.wrong)
        else:
            active = active.copy()
            active[np.flatnonzero(trial.wrong)[-1]] ^= True
        if not active.any():
            active[np.argmin(trial.gap)] = True
    lower = "lower friction.coefficient or " if friction else ""
    raise PhysicsError(
        f"the contact pressure did not converge (friction {friction:g}, {sets} trial sets); "
        f"{lower}refine numerics.spacing_mm"
    )


def _checked_datum(gap: Floats, load: float) -> float:
    """The smallest gap, which is taken off, since its rounding would be felt as roughness."""
    datum = float(gap.min())
    if not (math.isfinite(datum) and math.isfinite(float(gap.max()))):
        raise InputError(
            "the gap between the bodies is not finite everywhere; give every node a number, and a "
            "large one (1000 mm) where there is no body"
        )
    if not 0.0 < load < math.inf:
        raise InputError(
            f"the load is {load:g} N/mm, and must be above 0 and finite; change load.normal_n"
        )
    return datum


def _to_the_edge(active: NDArray[np.bool_], wrong: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The nodes to change: the wrong ones, in numbers that bring an edge of contact to its place.

    At the distance d from an edge that is δ too far out, p ~ (d - δ/2)/√d: only half of what is too
    much pulls. Beyond one that is δ too far in, the bodies overlap over 3δ/2.
    """
    change = wrong.copy()
    pulls = np.diff(np.pad(wrong & active, 1).astype(np.int8))
    for start, end in np.flatnonzero(pulls).reshape(-1, 2):
        more = end - start - 1
        if start == 0 or not active[start - 1]:
            change[end : end + more] = active[end : end + more]
        elif end == len(active) or not active[end]:
            change[max(start - more, 0) : start] = active[max(start - more, 0) : start]
    overlaps = np.diff(np.pad(wrong & ~active, 1).astype(np.int8))
    for start, end in np.flatnonzero(overlaps).reshape(-1, 2):
        less = (end - start) // 3
        if start > 0 and active[start - 1]:
            change[end - less : end] = False
        elif end < len(active) and active[end]:
            change[start : start + less] = False
    return change


def _from_coarse(
    surface: Surface, gap: Floats, load: float, friction: float, wear: float
) -> Floats:
    """A start from an four times coarser grid; on the coarsest, where the bodies would overlap.

    There the overlap at the contact's edge is taken as that of a parabola, x²/(2R) = 2 P'/(pi E*).
    """
    coarse = surface.coarse
    if coarse is None:
        depth = gap.min() + 2.0 * load / (np.pi * surface.modulus_mpa)
        return np.where(gap <= depth, load, 0.0)
    step = COARSER
    state = solve_pressure(
        coarse, gap[::step], load, friction=friction, wear_mm_per_mpa=wear, tolerance=1e-4
    )
    nodes = np.arange(surface.nodes) / step
    start = np.interp(nodes, np.arange(coarse.nodes), state.pressure)
    return np.where(_inside(nodes, state.pressure), np.maximum(start, 1e-3 * start.max()), 0.0)


def _inside(nodes: Floats, pressure: Floats) -> NDArray[np.bool_]:
    """Where a finer grid (its nodes in this one's spacings) is in contact, to within a node of it.

    Near an edge p² falls linearly to zero. The last node is left out of the line: it bears what its
    element bears beyond the edge; the line through the next two ends 0.2 too far (measured).
    """
    square = pressure**2
    inside = np.zeros(len(nodes), dtype=bool)
    for start, end in np.flatnonzero(np.diff(np.pad(square > 0.0, 1).astype(np.int8))).reshape(
        -1, 2
    ):
        run = square[start:end]
        left, right = (start - _reach(run), end - 1 + _reach(run[::-1]))
        inside |= (nodes > left) & (nodes < right)
    return inside


def _reach(square: Floats) -> float:
    """How far beyond the first node of a run p² reaches zero, at most one spacing."""
    if len(square) < 4 or square[2] <= square[1]:
        return 0.5
    return float(np.clip(square[1] / (square[2] - square[1]) - 1.0 - _TOO_FAR, 0.0, 1.0))
