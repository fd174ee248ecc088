r"""The equations of a wearing contact in the frame of its edges, in Hertz's units.

In the frame ξ that moves with the edges, x = m + b ξ,

    ∂h/∂K = p + (m' + b' ξ)/b ∂h/∂ξ,    b A p + h + x²/2 = d,    b ∫ p dξ = (π/2) P'/P'_0,

with x in a, p in p0, h in a²/R and K in a²/(R p0) of the first load, where only mu beta is left of
friction and materials: A p = -(1/π) ∫ p ln|ξ-t| dt - mu beta ∫_ξ^1 p (see `contact.mesh`).
Sources: Archard (1953), J. Appl. Phys. 24, 981; Johnson (1985), Contact Mechanics, sections 2.4,
4.2 and 5.4, written in that frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from isochrome.contact.sliding_history import SlidingHistory
from isochrome.contact.surface import Floats
from isochrome.contact.wear.moving_mesh import Mesh
from isochrome.errors import PhysicsError

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
        """The contact before wear, by Newton's method on (p, m, b, d) from Hertz's solution.

        Raises PhysicsError where it does not converge.
        """
        load, a = self._driven(*self.course.leaving(0.0))
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
        raise PhysicsError("the unworn contact did not converge; lower friction.coefficient")

    def step(
        self, dose: float, span: float, base: Floats, forecast: Floats
    ) -> tuple[MeshPoint, Floats]:
        """The state at a dose where (h, m, b)' = (state - base)/span: one Newton step.

        Parameters: `dose`; `span`, `base` (n+2,), the formula's; `forecast` (n+2,), the state to
        start from. Returns the MeshPoint and the change from the forecast.
        """
        load, a = self._driven(*self.course.at(dose * self.units.dose_mm_per_mpa))
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

    def _driven(self, line_load: float, friction: float) -> tuple[float, Floats]:
        """The load b ∫p dξ, and the matrix of A above the row of ∫p."""
        mesh = self.mesh
        a = mesh.logarithm - friction * self.units.beta * mesh.ahead
        load = 0.5 * math.pi * line_load / self.units.line_load_n_per_mm
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

    Parameters: `radius_mm` R; `modulus_mpa` E*; `coupling_per_mpa` 1/G*; `load` P' (N/mm).
    Returns Units. Source: Johnson (1985), section 4.2.
    """
    length = math.sqrt(4.0 * load * radius_mm / (math.pi * modulus_mpa))
    return Units(
        line_load_n_per_mm=load,
        length_mm=length,
        pressure_mpa=0.5 * modulus_mpa * length / radius_mm,
        depth_mm=length**2 / radius_mm,
        beta=0.25 * modulus_mpa * coupling_per_mpa,
    )
