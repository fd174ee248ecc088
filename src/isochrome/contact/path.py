r"""One wear run, used for every load and wear coefficient near it: what a fit needs.

A worn contact under a cylinder has one shape for each dimensionless dose. With the half-width
a ~ √P' and the pressure p0 ~ √P', the depth scales as a² and the dose K as a²/p0, so that

    h(x; λP', K) = λ h(x/√λ; P', K/√λ).

The depth between two stored doses is a cubic Hermite polynomial, since dh/dK = p is known at both.
The contact on that depth is then solved, not interpolated: one solve in the place of a whole run.
Elastic coupling keeps this similarity at constant friction; friction that differs from the path's
changes only the depth, and there by the coupling alone (of the order of beta times the difference).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isochrome.contact.course import constant_course, wear_rate
from isochrome.contact.pressure import solve_pressure
from isochrome.contact.profile import (
    Grid,
    contact_grid,
    elastic_constants,
    line_load,
    undeformed_gap,
)
from isochrome.contact.states import SurfaceState
from isochrome.contact.surface import Floats, Surface, make_surface
from isochrome.contact.wear import wear_history
from isochrome.scene import DistanceTable, Scene

_DOSES = np.geomspace(0.6, 1.6, 13)
"""Stored doses over the middle one: 9 % apart, a Hermite error below 1e-6 of the depth."""


@dataclass(frozen=True)
class WearPath:
    """Worn depths of one load at a few doses: `depth_mm`, `pressure_mpa` (m, n)."""

    grid: Grid
    surface: Surface
    gap_mm: Floats
    line_load_n_per_mm: float
    doses_mm_per_mpa: Floats
    depth_mm: Floats
    pressure_mpa: Floats


def has_path(scene: Scene) -> bool:
    """Whether a one-state scene is worn under a cylinder alone, so that similarity holds."""
    indenter, wear = scene.indenter, scene.wear
    tables = (
        wear and wear.coefficient_mm2_per_n,
        scene.load and scene.load.normal_n,
        scene.friction and scene.friction.coefficient,
    )
    return (
        wear is not None
        and wear.distances_m[0] > 0.0
        and not any(isinstance(value, DistanceTable) for value in tables)
        and indenter is not None
        and indenter.shape == "cylinder"
        and indenter.profile is None
    )


def wear_path(scene: Scene) -> WearPath:
    """Run the wear of a one-state scene to doses about its own.

    Parameters: `scene`, see `has_path`. Returns a WearPath. Raises PhysicsError as a run does.
    """
    dose, distance = _dose(scene)
    doses = dose * _DOSES
    grid = contact_grid(scene, largest_dose_mm_per_mpa=float(doses[-1]))
    modulus, coupling = elastic_constants(scene)
    surface = make_surface(
        grid.nodes, grid.spacing_mm, contact_modulus_mpa=modulus, coupling_per_mpa=coupling
    )
    gap, load = undeformed_gap(scene, grid.x_mm), line_load(scene)
    course, stops = constant_course(
        load,
        distance * _DOSES,
        dose_per_m=dose / distance,
        friction=scene.friction_at(distance),
    )
    worn = list(wear_history(surface, gap, course, stops, tolerance=scene.numerics.tolerance))
    return WearPath(
        grid,
        surface,
        gap,
        load,
        doses,
        np.stack([state.depth_mm for state in worn]),
        np.stack([state.contact.pressure for state in worn]),
    )


def on_path(path: WearPath, scene: Scene) -> bool:
    """Whether a scene's load and dose lie within a path."""
    dose = _dose(scene)[0] / np.sqrt(line_load(scene) / path.line_load_n_per_mm)
    return bool(path.doses_mm_per_mpa[0] <= dose <= path.doses_mm_per_mpa[-1])


def state_on_path(path: WearPath, scene: Scene) -> SurfaceState:
    """The worn state of a scene that differs from the path's in load, wear or friction.

    Parameters: `path`; `scene`, one state, see `on_path`. Returns its SurfaceState.
    """
    dose, distance = _dose(scene)
    load = line_load(scene)
    stretch = float(np.sqrt(load / path.line_load_n_per_mm))
    depth, pressure = _at(path, dose / stretch)
    x = path.grid.x_mm
    depth = stretch**2 * np.interp(x / stretch, x, depth)
    mu = scene.friction_at(distance)
    contact = solve_pressure(
        path.surface,
        path.gap_mm + depth,
        load,
        friction=mu,
        start=stretch * np.interp(x / stretch, x, pressure),
        tolerance=1e-8,
    )
    return SurfaceState(
        grid=path.grid,
        pressure_mpa=contact.pressure,
        shear_mpa=mu * contact.pressure,
        wear_depth_mm=depth,
        distance_m=distance,
        friction=mu,
        sliding=scene.friction is not None,
        residual=contact.residual,
    )


def _dose(scene: Scene) -> tuple[float, float]:
    """Dose K = kappa s (mm/MPa) and distance s (m) of a one-state scene."""
    assert scene.wear is not None
    distance = scene.wear.distances_m[0]
    rate = wear_rate(scene.wear.law, scene.wear_coefficient_at(0.0), scene.friction_at(distance))
    return 1e3 * rate * distance, distance


def _at(path: WearPath, dose: float) -> tuple[Floats, Floats]:
    """Depth at a dose by cubic Hermite interpolation, and the pressure near it."""
    doses = path.doses_mm_per_mpa
    i = int(np.clip(np.searchsorted(doses, dose) - 1, 0, len(doses) - 2))
    step = doses[i + 1] - doses[i]
    t = (dose - doses[i]) / step
    depth = (
        (1 + 2 * t) * (1 - t) ** 2 * path.depth_mm[i]
        + t**2 * (3 - 2 * t) * path.depth_mm[i + 1]
        + step * t * (1 - t) ** 2 * path.pressure_mpa[i]
        - step * t**2 * (1 - t) * path.pressure_mpa[i + 1]
    )
    return depth, (1 - t) * path.pressure_mpa[i] + t * path.pressure_mpa[i + 1]
