r"""Contact pressure under a fixed load: an active set, with a preconditioned Krylov solve inside.

Find p >= 0 and the approach d with gap = g + u(p) + c p - d >= 0, p·gap = 0 and h Σp = P'. The
diagonal c is zero in a static contact and k ds in an implicit wear step.

On a trial set the equations are linear. They are solved by generalised conjugate residuals, which
converge for every operator with a positive definite symmetric part, symmetric or not (Eisenstat,
Elman & Schultz 1983); friction's coupling is antisymmetric, so it never spoils that. The
preconditioner is the operator's inverse on an endless lattice, about |k|, projected on the
load-free corrections; it makes some five iterations of the solve at any size. The set then moves
by the signs of pressure and gap (block principal pivoting; Júdice & Pires 1994), with Murty's
single pivot as the safeguard, which is finite for this class of operators. The inverse operator is
of the M-matrix kind, so that in practice the set shrinks monotonically (Hintermüller, Ito &
Kunisch 2003).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from isochrome.contact.surface import Floats, Surface, combined, displacement
from isochrome.errors import PhysicsError

_PATIENCE = 8
_MAX_SETS = 500
_MAX_KRYLOV = 80
_LOOSE = 1e-3
_WORST = 100.0
"""Residual over tolerance at which a solution is refused, not returned."""


@dataclass(frozen=True)
class ContactState:
    """A solved contact: `pressure` (n,) MPa, `gap` (n,) mm, `approach_mm`, and how well it holds.

    `residual` is the complementarity (KKT) residual: the largest violation of gap = 0 in contact
    and gap >= 0 outside, over the range of the elastic displacement. `iterations` counts operator
    applications, `sets` the trial sets.
    """

    pressure: Floats
    gap: Floats
    approach_mm: float
    residual: float
    iterations: int
    sets: int


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
    """Solve for the contact pressure under a given load.

    Parameters: `surface`, the operator; `gap_mm` (n,), the undeformed gap, worn depth included
    (mm; a constant offset does not matter); `line_load_n_per_mm`, P' (N/mm); `friction`, mu, only
    for the coupling; `wear_mm_per_mpa`, the diagonal c (mm/MPa); `start` (n,), a pressure to start
    from, else a coarser grid's; `tolerance`, on the KKT residual.
    Returns a ContactState. Raises PhysicsError where it does not converge.
    """
    if start is None:
        start = _from_coarse(surface, gap_mm, line_load_n_per_mm, friction, wear_mm_per_mpa)
    system = _System(surface, gap_mm, line_load_n_per_mm, friction, wear_mm_per_mpa)
    active = start > 0.0
    pressure = np.where(active, start, 0.0)
    best, patience, iterations = surface.nodes + 1, _PATIENCE, 0
    target = max(_LOOSE, tolerance)
    for sets in range(1, _MAX_SETS + 1):
        pressure, gap, approach, used = system.solve_on(active, pressure, target)
        iterations += used
        depth = target * _range(gap - gap_mm)
        wrong = np.where(active, pressure <= 0.0, gap < -depth)
        count = int(np.count_nonzero(wrong))
        if count == 0 and target <= tolerance:
            residual = system.residual(active, gap)
            if residual > _WORST * tolerance:
                break
            return ContactState(pressure, gap, approach, residual, iterations, sets)
        if count == 0:
            target = tolerance
            continue
        if count < best:
            best, patience = count, _PATIENCE
        else:
            patience -= 1
        if patience >= 0:
            active = active ^ wrong
        else:
            target = tolerance
            active = active.copy()
            active[np.flatnonzero(wrong)[-1]] ^= True
        if not active.any():
            active[np.argmin(gap)] = True
    raise PhysicsError(
        f"the contact pressure did not converge (friction {friction:g}, {sets} trial sets); "
        "lower friction.coefficient or refine numerics.spacing_mm"
    )


class _System:
    """The linear equations on a trial contact set."""

    def __init__(
        self, surface: Surface, gap: Floats, load: float, friction: float, wear: float
    ) -> None:
        self.surface, self.gap, self.friction, self.wear = surface, gap, friction, wear
        self.total = load / surface.spacing_mm
        lattice = combined(surface.lattice_normal, surface.lattice_coupling, friction)
        self.inverse = 1.0 / (lattice + wear)

    def apply(self, pressure: Floats) -> Floats:
        """Displacement and wear that a pressure makes."""
        u = displacement(self.surface, pressure, friction=self.friction)
        return u + self.wear * pressure if self.wear else u

    def precondition(self, inside: Floats, residual: Floats) -> Floats:
        """The lattice's inverse, cut to the contact set (1 inside, 0 outside)."""
        length = self.surface.length
        z = scipy.fft.irfft(self.inverse * scipy.fft.rfft(residual, length), length)
        return inside * z[: self.surface.nodes]

    def solve_on(
        self, active: NDArray[np.bool_], start: Floats, target: float
    ) -> tuple[Floats, Floats, float, int]:
        """Pressure, gap, approach and iterations with contact on `active`, to a relative target."""
        inside = active.astype(float)
        count = int(inside.sum())
        p = self._start(inside, start)
        along = self.precondition(inside, inside)
        along /= along.sum()
        u = self.apply(p)
        r = _project(inside, count, -(self.gap + u))
        limit = (0.3 * target * _range(u)) ** 2
        most = min(count, _MAX_KRYLOV)
        steps, images, fulls = (np.empty((most, len(p))) for _ in range(3))
        used = 0
        while _dot(r, r) > limit and used < most:
            z = self.precondition(inside, r)
            z -= z.sum() * along
            az = self.apply(z)
            q = _project(inside, count, az)
            if used:
                part = _dot(images[:used], q)
                q = q - _mix(part, images[:used])
                z = z - _mix(part, steps[:used])
                az = az - _mix(part, fulls[:used])
            norm = math.sqrt(_dot(q, q))
            if norm == 0.0:
                break
            steps[used], images[used], fulls[used] = z / norm, q / norm, az / norm
            step = _dot(images[used], r)
            p, u, r = p + step * steps[used], u + step * fulls[used], r - step * images[used]
            used += 1
        approach = float(_dot(inside, self.gap + u) / count)
        return p, self.gap + u - approach, approach, used + 1

    def _start(self, inside: Floats, start: Floats) -> Floats:
        p = inside * start
        total = p.sum()
        return p * (self.total / total) if total > 0.0 else inside * (self.total / inside.sum())

    def residual(self, active: NDArray[np.bool_], gap: Floats) -> float:
        """Largest violation of gap = 0 in contact and gap >= 0 outside, over the displacement."""
        violation = np.where(active, np.abs(gap), np.maximum(-gap, 0.0)).max()
        return float(violation / _range(gap - self.gap))


def _project(inside: Floats, count: int, values: Floats) -> Floats:
    """Values on the contact set less their mean there; zero outside."""
    return inside * (values - _dot(inside, values) / count)


def _dot(rows: Floats, vector: Floats) -> Any:
    """Inner products along the last axis, without the threads of a BLAS, which only cost here."""
    return np.einsum("...i,i->...", rows, vector)


def _mix(part: Floats, rows: Floats) -> Floats:
    """Sum of rows with weights, likewise."""
    return np.einsum("j,ji->i", part, rows)


def _range(u: Floats) -> float:
    """Range of the displacement over the whole grid, the scale of a residual."""
    return float(max(u.max() - u.min(), np.finfo(float).tiny))


def _from_coarse(
    surface: Surface, gap: Floats, load: float, friction: float, wear: float
) -> Floats:
    """A start from a four times coarser grid, or from contact everywhere on the coarsest."""
    if surface.coarse is None:
        return np.full(surface.nodes, load / (surface.nodes * surface.spacing_mm))
    state = solve_pressure(
        surface.coarse, gap[::4], load, friction=friction, wear_mm_per_mpa=wear, tolerance=1e-4
    )
    nodes = np.arange(surface.nodes) / 4.0
    return np.interp(nodes, np.arange(surface.coarse.nodes), state.pressure)
