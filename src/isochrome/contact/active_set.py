"""The contact's linear equations on a trial set of nodes.

With contact on the set, g + u(p) + c p = d there, p = 0 elsewhere, and h Σp = P'; the gap g >= 0
has 0 for its smallest, so that no datum is rounded along. On a small grid they are solved directly.
On a larger one by generalised conjugate residuals, which converge for every operator with a
positive definite symmetric part, symmetric or not (Eisenstat, Elman & Schultz 1983, SIAM J. Numer.
Anal. 20, 345); friction's coupling is antisymmetric, so it never spoils that. The preconditioner is
the operator's inverse on an endless lattice, about |k|, projected on the load-free corrections: six
or seven iterations to 1e-10 at any size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from isochrome.contact.surface import Floats, Surface, combined, displacement

_MAX_KRYLOV = 80
_ROUNDING = 4.0 * float(np.finfo(float).eps)
"""Error of an equation over its gap below which nothing can be gained, whatever is asked for."""
_LOOK = 1e-3
"""Residual at which the signs are first looked at, and factor to the next look."""


@dataclass(frozen=True)
class ActiveSet:
    """The linear equations' solution on a trial set, and the nodes whose sign is `wrong`."""

    pressure: Floats
    gap: Floats
    approach: float
    wrong: NDArray[np.bool_]
    iterations: int


class ActiveSystem:
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
        result: Floats = inside * z[: self.surface.nodes]
        return result

    def solve(
        self, active: NDArray[np.bool_], start: Floats, tolerance: float, *, look: bool
    ) -> ActiveSet:
        """Solve with contact on `active` to a relative residual, from a pressure near by.

        With `look` the signs are looked at on the way: a wrong set need not be solved to the end.
        """
        if self.surface.dense is not None:
            return self._directly(active, tolerance)
        return self._iteratively(active, start, tolerance, look)

    def _directly(self, active: NDArray[np.bool_], tolerance: float) -> ActiveSet:
        """Gauss's elimination with the load as the last row, and the approach as unknown."""
        assert self.surface.dense is not None
        normal, coupling = self.surface.dense
        matrix = normal if coupling is None else normal + self.friction * coupling
        on, count = np.flatnonzero(active), int(np.count_nonzero(active))
        bordered = np.ones((count + 1, count + 1))
        bordered[:-1, :-1] = matrix[np.ix_(on, on)] + self.wear * np.eye(count)
        bordered[-1, -1] = 0.0
        solution = np.linalg.solve(bordered, np.append(-self.gap[on], self.total))
        pressure = np.zeros(len(active))
        pressure[on] = solution[:-1]
        u = matrix @ pressure + self.wear * pressure
        return self._judged(active, pressure, u, tolerance, 0.0, 1)

    def _iteratively(
        self, active: NDArray[np.bool_], start: Floats, tolerance: float, look: bool
    ) -> ActiveSet:
        """Generalised conjugate residuals.

        Rows of `state` are p, the equations' error inside, and u; those of `move` their changes.
        """
        inside, count = active.astype(float), int(np.count_nonzero(active))
        along = self.precondition(inside, inside)
        along /= along.sum()
        p = self._start(inside, start)
        u = self.apply(p)
        state = np.stack([p, _project(inside, count, self.gap + u), u])
        scale = _range(u) ** 2
        rounding = count * (_ROUNDING * self.gap[active].max()) ** 2
        level = _LOOK if look else 0.0
        moves, squares = np.empty((min(count, _MAX_KRYLOV), *state.shape)), np.empty(_MAX_KRYLOV)
        used = 0
        while (error := float(_dot(state[1], state[1]))) > max(scale * tolerance**2, rounding):
            if used == len(moves):
                break
            if error <= scale * level**2:
                trial = self._judged(active, state[0], state[2], level, level, used + 1)
                if trial.wrong.any():
                    return trial
                level *= _LOOK
            move = moves[used]
            z = self.precondition(inside, state[1])
            z -= z.sum() * along
            move[0], move[2] = z, self.apply(z)
            move[1] = _project(inside, count, move[2])
            if used:
                part = _dot(moves[:used, 1], move[1]) / squares[:used]
                move -= np.einsum("j,jik->ik", part, moves[:used])
            squares[used] = square = float(_dot(move[1], move[1]))
            if square == 0.0:
                break
            state -= (float(_dot(move[1], state[1])) / square) * move
            used += 1
        return self._judged(active, state[0], state[2], tolerance, 0.0, used + 1)

    def _judged(
        self,
        active: NDArray[np.bool_],
        pressure: Floats,
        u: Floats,
        overlap: float,
        pull: float,
        used: int,
    ) -> ActiveSet:
        """A solution with its gap; wrong is what overlaps or pulls by more than these shares."""
        gap = self.gap + u
        approach = float(gap[active].mean())
        gap -= approach
        pulls = pressure <= -pull * pressure.max()
        wrong = np.where(active, pulls, gap < -overlap * _range(u))
        return ActiveSet(pressure, gap, approach, wrong, used)

    def _start(self, inside: Floats, start: Floats) -> Floats:
        p = inside * start
        total = p.sum()
        result: Floats = (
            p * (self.total / total) if total > 0.0 else inside * (self.total / inside.sum())
        )
        return result

    def residual(self, active: NDArray[np.bool_], gap: Floats) -> float:
        """Largest violation of gap = 0 in contact and gap >= 0 outside, over the displacement."""
        violation = np.where(active, np.abs(gap), np.maximum(-gap, 0.0)).max()
        return float(violation / _range(gap - self.gap))


def _project(inside: Floats, count: int, values: Floats) -> Floats:
    """Values on the contact set less their mean there; zero outside."""
    result: Floats = inside * (values - _dot(inside, values) / count)
    return result


def _dot(rows: Floats, vector: Floats) -> Any:
    """Inner products along the last axis, without the threads of a BLAS, which only cost here."""
    return np.einsum("...i,i->...", rows, vector)


def _range(u: Floats) -> float:
    """Range of the displacement over the whole grid, the scale of a residual."""
    return float(max(u.max() - u.min(), np.finfo(float).tiny))
