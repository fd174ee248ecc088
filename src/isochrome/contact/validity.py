"""The limits of grid, profile and theory that a solved contact is held to before it is returned."""

from __future__ import annotations

import numpy as np

from isochrome.contact.gap import read_profile, undeformed_gap
from isochrome.contact.profile import ContactGrid, elastic_constants
from isochrome.contact.state import SurfaceState
from isochrome.contact.surface import Floats, log_of_hat
from isochrome.errors import PhysicsError
from isochrome.scene import Scene

FEWEST_NODES = 8
"""Nodes in contact below which the spacing, not the physics, sets the pressure."""

STRONGEST = 0.12
"""Largest mean pressure over E*: that of a cylinder whose half-width is 0.3 of its radius."""

DEEPEST = 0.3
"""Largest scar over the contact's half-width: beyond it, the worn surface is no half-plane's."""

_PLACES = 1024


def refuse_unfit(scene: Scene, state: SurfaceState) -> None:
    """Refuse a state that its grid, its profile or linear elasticity does not carry.

    Conditions: at least 8 nodes in contact; no contact at the end of a measured profile; mean
    pressure P'/(n h) <= 0.12 E*; scar no deeper than 0.3 of the contact's half-width. The two last:
    the parabola's own limit, a <= 0.3 R, where p_mean = pi E* a/(8 R); Johnson (1985), section 4.2.
    PhysicsError says what to change.
    """
    grid, inside = state.grid, state.pressure_mpa > 0.0
    count = int(np.count_nonzero(inside))
    if count < FEWEST_NODES:
        raise PhysicsError(
            f"{scene.name}: the contact has only {count} nodes of {grid.spacing_mm:.3g} mm, fewer "
            f"than {FEWEST_NODES}; set a finer numerics.spacing_mm"
        )
    _refuse_end_of_profile(scene, grid, inside)
    modulus, _ = elastic_constants(scene)
    mean = float(state.pressure_mpa[inside].mean())
    if not mean <= STRONGEST * modulus:
        raise PhysicsError(
            f"{scene.name}: the mean pressure would be {mean:.3g} MPa, over {STRONGEST:g} of the "
            f"contact modulus {modulus:.4g} MPa, where linear elasticity no longer holds; lower "
            "the load (load.normal_n), or widen the indenter or flatten its profile"
        )
    half, depth = 0.5 * count * grid.spacing_mm, float(state.wear_depth_mm.max())
    if not depth <= DEEPEST * half:
        raise PhysicsError(
            f"{scene.name}: at {state.distance_m:g} m the scar would be {depth:.3g} mm deep, over "
            f"{DEEPEST:g} of the contact's half-width {half:.3g} mm, where the specimen is no "
            "half-plane any more; shorten wear.distances_m or lower wear.coefficient_mm2_per_n"
        )


def _refuse_end_of_profile(scene: Scene, grid: ContactGrid, inside: np.ndarray) -> None:
    """A file's last row is where the measurement ends, not a corner of the body."""
    assert scene.indenter is not None
    if scene.indenter.profile is None:
        return
    x, _ = read_profile(scene.path(scene.indenter.profile))
    known = np.flatnonzero((grid.x_mm >= x[0]) & (grid.x_mm <= x[-1]))
    ends = [(k, end) for k, end in ((known[0], x[0]), (known[-1], x[-1])) if inside[k]]
    if ends:
        raise PhysicsError(
            f"{scene.name}: the contact reaches the end of the profile {scene.indenter.profile} at "
            f"x = {ends[0][1]:g} mm; extend the profile, or add a row with a large gap if the body "
            "ends there"
        )


def touches_outside(scene: Scene, state: SurfaceState) -> bool:
    """Whether a measured profile meets the specimen beyond the grid, where no node would know.

    Equation: gap + u < d at the profile's rows and at places between them, with u of `displacement`
    carried on beyond the grid, where a hat of pressure is a line force.
    Parameters: `scene`; `state`, solved. Returns True if the window is too small.
    """
    assert scene.indenter is not None
    if scene.indenter.profile is None:
        return False
    rows, _ = read_profile(scene.path(scene.indenter.profile))
    x = np.union1d(rows, np.linspace(rows[0], rows[-1], _PLACES))
    x = x[(x < state.grid.x_mm[0]) | (x > state.grid.x_mm[-1])]
    if not len(x):
        return False
    peak = int(state.pressure_mpa.argmax())
    lags = np.abs(np.arange(state.grid.nodes) - peak)
    here = log_of_hat(state.grid.nodes, state.grid.spacing_mm)[lags]
    level = undeformed_gap(scene, state.grid.x_mm[[peak]]) + state.wear_depth_mm[peak]
    level += _displacement(scene, state, state.grid.x_mm[[peak]], here[None, :])
    loaded = np.flatnonzero(state.pressure_mpa)
    away = np.zeros((len(x), state.grid.nodes))
    distance = np.abs(x[:, None] - state.grid.x_mm[None, loaded])
    away[:, loaded] = state.grid.spacing_mm * np.log(distance)
    return bool((undeformed_gap(scene, x) + _displacement(scene, state, x, away) < level).any())


def _displacement(scene: Scene, state: SurfaceState, x: Floats, logarithms: Floats) -> Floats:
    """Displacement at places (m,), from the logarithms' integrals (m, n) over the nodes' hats."""
    modulus, coupling = elastic_constants(scene)
    mu = state.friction if state.sliding else 0.0
    ahead = np.sign(x[:, None] - state.grid.x_mm[None, :])
    kernel = -2.0 / (np.pi * modulus) * logarithms
    kernel += 0.25 * mu * coupling * state.grid.spacing_mm * ahead
    return np.asarray(kernel @ state.pressure_mpa)
