"""Contact pressures over load and wear as short series, for a search that tries thousands of them.

On a contact of half-width a about c the pressure is p = √(1 - t²) Σ b_n U_n(t), t = (x - c)/a. Its
Cauchy transform is then a polynomial in u = ζ - √(ζ² - 1), ζ = (x + iz - c)/a:
F = ∫ p(t) dt/(s - t) = (2 P'/a) Σ g_n u^(n+1), with g_n = b_n/b_0 and P' the load per thickness.
Hertz's pressure is the first term alone. Between a few solved contacts a and g_n go with the
logarithms of load and wear.
Source: Mason & Handscomb (2003), Chebyshev Polynomials, section 9.5 (transform of U_n).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import SurfaceState
from isochrome.errors import PhysicsError
from isochrome.scene import Scene
from isochrome.simulate import scene_states

Array = NDArray[np.float64]

_LOADS = np.geomspace(0.02, 5.0, 8)
"""Loads over the scene's: down to what sticks of a contact that slips nearly everywhere."""

_WORN_LOADS = np.geomspace(0.2, 5.0, 6)
_DOSES = np.geomspace(0.25, 4.0, 6)
_TERMS = 10
_NOTHING = 3e-3
_TOLERANCE = 1e-2


@dataclass(frozen=True)
class PressureTable:
    """Solved contacts over wear and load.

    `log_wear` (w,), logarithms of the worn dose over the scene's; `log_load` (l,), of P/N;
    `log_half` (w, l), of the half-width a/mm; `centre` (w, l), c over a; `series` (w, l, k), g_n.
    `friction`, that they were solved with; `even`, whether the indenter is symmetric, so that what
    is odd in p comes from friction alone.
    """

    log_wear: Array
    log_load: Array
    log_half: Array
    centre: Array
    series: Array
    friction: float
    even: bool

    def at(self, log_load: Array, log_wear: Array, friction: Array) -> tuple[Array, Array, Array]:
        """Half-width a (m,) and centre c (m,), mm, and g_n (m, k), at m loads, doses, frictions."""
        load, along = _between(self.log_load, log_load)
        wear, across = _between(self.log_wear, log_wear)
        half = np.exp(_bilinear(self.log_half, wear, across, load, along))
        inside, between = np.clip(across, 0.0, 1.0), np.clip(along, 0.0, 1.0)
        centre = half * _bilinear(self.centre, wear, inside, load, between)
        series = _bilinear(self.series, wear, inside, load, between)
        if self.even and self.friction:
            lean = friction / self.friction
            centre = centre * lean
            series[:, 1::2] *= lean[:, None]
        return half, centre, series


def pressure_table(scene: Scene) -> PressureTable:
    """Solve a one-state contact scene at a few loads and worn doses about its own.

    Parameters: `scene`, one state, its wear coefficient a number. Returns a PressureTable. Raises
    PhysicsError where none of its contacts can be solved.
    """
    wear = scene.wear
    worn = wear is not None and wear.coefficient_mm2_per_n != 0.0 and max(wear.distances_m) > 0.0
    found = [(factor, _states(scene, factor, worn)) for factor in (_WORN_LOADS if worn else _LOADS)]
    solved = [(factor, states) for factor, states in found if states is not None]
    if not solved:
        raise PhysicsError(
            f"{scene.name}: the contact cannot be solved at any load near load.normal_n; check the "
            "indenter and the wear"
        )
    rows = np.array([[_series(state) for state in states] for _, states in solved])
    table = rows.swapaxes(0, 1)
    series = table[..., 2:]
    kept = np.flatnonzero(np.abs(series).max(axis=(0, 1)) > _NOTHING)
    indenter = scene.indenter
    return PressureTable(
        np.log(_DOSES) if worn else np.zeros(1),
        np.log([scene.load_at(0.0) * factor for factor, _ in solved]),
        table[..., 0],
        table[..., 1],
        series[..., : int(kept.max()) + 1],
        scene.friction_at(0.0) if scene.friction and not _held(scene) else 0.0,
        indenter is not None and indenter.profile is None,
    )


def _held(scene: Scene) -> bool:
    return scene.load is not None and scene.load.tangential_n is not None


def _states(scene: Scene, factor: float, worn: bool) -> list[SurfaceState] | None:
    """The states at one load and all doses; None where they cannot be solved."""
    assert scene.load is not None
    load = scene.load.model_copy(
        update={"normal_n": factor * scene.load_at(0.0), "tangential_n": None}
    )
    numerics = scene.numerics.model_copy(update={"window_mm": None, "tolerance": _TOLERANCE})
    # a held contact is solved without its shear, which follows from the pressures
    one = scene.model_copy(update={"load": load, "numerics": numerics})
    if _held(scene):
        one = one.model_copy(update={"friction": None})
    if scene.wear is not None and worn:
        distances = tuple(float(scene.wear.distances_m[-1] * dose) for dose in _DOSES)
        one = one.model_copy(
            update={"wear": scene.wear.model_copy(update={"distances_m": distances})}
        )
    try:
        surfaces = [state.surface for state in scene_states(one)]
    except PhysicsError:
        return None
    return [s for s in surfaces if s is not None]


def _series(state: SurfaceState) -> Array:
    """ln a, c/a, and g_0 = 1, g_1, ...: moments of the pressure with U_n."""
    left, right = state.edges_mm
    half = 0.5 * (right - left)
    place = np.clip((state.grid.x_mm - 0.5 * (left + right)) / half, -1.0, 1.0)
    polynomials = [np.ones_like(place), 2.0 * place]
    while len(polynomials) < _TERMS:
        polynomials.append(2.0 * place * polynomials[-1] - polynomials[-2])
    moments = np.array(polynomials) @ state.pressure_mpa
    return np.array([np.log(half), 0.5 * (left + right) / half, *(moments / moments[0])])


def _between(nodes: Array, at: Array) -> tuple[NDArray[np.intp], Array]:
    """The node below each value, and the fraction of the way to the next (beyond the ends too)."""
    if len(nodes) == 1:
        return np.zeros(len(at), dtype=np.intp), np.zeros(len(at))
    below = np.clip(np.searchsorted(nodes, at) - 1, 0, len(nodes) - 2)
    return below, (at - nodes[below]) / (nodes[below + 1] - nodes[below])


def _bilinear(
    table: Array, row: NDArray[np.intp], down: Array, col: NDArray[np.intp], along: Array
) -> Array:
    """Values between a table's (w, l[, k]) nodes; one node in a direction: no change along it."""
    shape = (-1,) + (1,) * (table.ndim - 2)
    down, along = down.reshape(shape), along.reshape(shape)
    last_row, last_col = table.shape[0] - 1, table.shape[1] - 1
    lower, right = np.minimum(row + 1, last_row), np.minimum(col + 1, last_col)
    upper = (1.0 - along) * table[row, col] + along * table[row, right]
    under = (1.0 - along) * table[lower, col] + along * table[lower, right]
    return np.asarray((1.0 - down) * upper + down * under)
