"""A scene's contact states: static, first sliding, and worn, each held to the theory's limits."""

from collections.abc import Iterator
from itertools import islice

import numpy as np

from isochrome.contact.pressure import (
    ContactState,
    Floats,
    log_of_hat,
    read_profile,
    solve_pressure,
    undeformed_gap,
)
from isochrome.contact.profile import ContactGrid, contact_grid, elastic_constants, line_load
from isochrome.contact.sliding_history import OutputState, SlidingHistory, wear_course
from isochrome.contact.state import SurfaceState
from isochrome.contact.wear import PATH_TOLERANCE, ContactSetup, make_site, worn_states
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
            "contact_has_only_nodes",
            name=scene.name,
            count=count,
            spacing_mm=grid.spacing_mm,
            fewest_nodes=FEWEST_NODES,
        )
    _refuse_end_of_profile(scene, grid, inside)
    modulus, _ = elastic_constants(scene)
    mean = float(state.pressure_mpa[inside].mean())
    if not mean <= STRONGEST * modulus:
        raise PhysicsError(
            "mean_pressure_would_mpa",
            name=scene.name,
            mean=mean,
            strongest=STRONGEST,
            modulus=modulus,
        )
    half, depth = 0.5 * count * grid.spacing_mm, float(state.wear_depth_mm.max())
    if not depth <= DEEPEST * half:
        raise PhysicsError(
            "scar_would_mm_deep",
            name=scene.name,
            distance_m=state.distance_m,
            depth=depth,
            deepest=DEEPEST,
            half=half,
        )


def _refuse_end_of_profile(scene: Scene, grid: ContactGrid, inside: np.ndarray) -> None:
    """A file's last row is where the measurement ends, not a corner of the body."""
    if scene.profile_file is None:
        return
    x, _ = read_profile(scene.path(scene.profile_file))
    known = np.flatnonzero((grid.x_mm >= x[0]) & (grid.x_mm <= x[-1]))
    ends = [(k, end) for k, end in ((known[0], x[0]), (known[-1], x[-1])) if inside[k]]
    if ends:
        raise PhysicsError(
            "contact_reaches_end_profile",
            name=scene.name,
            profile_file=scene.profile_file,
            ends=ends[0][1],
        )


def touches_outside(scene: Scene, state: SurfaceState) -> bool:
    """Whether a measured profile meets the specimen beyond the grid, where no node would know.

    gap + u < d at the profile's rows and at places between them, with u of `displacement` carried
    on beyond the grid, where a hat of pressure is a line force.
    """
    if scene.profile_file is None:
        return False
    rows, _ = read_profile(scene.path(scene.profile_file))
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


_TRIES = 4


def contact_states(scene: Scene) -> list[SurfaceState]:
    """The contact at every state of a scene, in its order; see `iter_contact_states`."""
    return list(iter_contact_states(scene))


def iter_contact_states(scene: Scene) -> Iterator[SurfaceState]:
    """Solve the contact at every state of a scene, each handed out as soon as it is known.

    A static state first if the scene asks for it, then those of `wear.distances_m` in its order;
    without wear one, sliding if there is friction. States wait only for others named before them. A
    contact that outgrows its grid is solved again on a wider one. PhysicsError where it does not
    converge, reaches the grid's edge, or as `refuse_unfit` says.
    """
    history, stops = wear_course(scene)
    loads = history.line_load_n_per_mm
    given = 0
    for attempt in range(_TRIES):
        grid = contact_grid(
            scene,
            largest_dose_mm_per_mpa=float(history.dose_mm_per_mpa[-1]),
            line_loads_n_per_mm=(float(loads.min()), float(loads.max())),
            growth=1.5**attempt,
        )
        for state in islice(_states_on(scene, grid, history, stops), given, None):
            ends = state.pressure_mpa[[0, -1]], state.wear_depth_mm[[0, -1]]
            if np.any(ends) or touches_outside(scene, state):
                break
            refuse_unfit(scene, state)
            given += 1
            yield state
        else:
            return
        if scene.numerics.window_mm is not None:
            break
    width = grid.spacing_mm * (grid.nodes - 1)
    raise PhysicsError("contact_reaches_edge_grid", name=scene.name, width=width)


def _states_on(
    scene: Scene, grid: ContactGrid, history: SlidingHistory, stops: list[OutputState]
) -> Iterator[SurfaceState]:
    """The states on one grid, in the scene's order."""
    site = make_site(scene, grid)
    static = scene.friction is None or scene.friction.static_state_first
    held = scene.load.tangential_n if scene.load else None
    if (static and (not scene.wear or scene.friction)) or held is not None:
        yield _static_state(site, line_load(scene))
    if held is not None or (scene.friction is None and not scene.wear):
        return
    order = sorted(range(len(stops)), key=lambda i: stops[i].dose_mm_per_mpa)
    rising = [stops[i] for i in order]
    path = history  # as it is sampled at PATH_TOLERANCE, see `worn_states`
    if not history.steady and scene.numerics.tolerance != PATH_TOLERANCE:
        path, _ = wear_course(scene.with_values({"numerics.tolerance": PATH_TOLERANCE}))
    worn = worn_states(site, history, rising, path=path)
    waiting: dict[int, SurfaceState] = {}
    place = 0
    for i, state in zip(order, worn, strict=True):
        waiting[i] = state
        while place in waiting:
            yield waiting.pop(place)
            place += 1


def _static_state(site: ContactSetup, load: float) -> SurfaceState:
    scene, grid = site.scene, site.grid
    contact = solve_pressure(site.surface, site.gap_mm, load)
    mu = scene.friction_at(0.0)
    held = scene.load.tangential_n if scene.load else None
    shear: Floats = np.zeros(grid.nodes)
    if held and scene.specimen.thickness_mm:
        shear = _partial_slip(site, contact, load, held / scene.specimen.thickness_mm, mu)
    return SurfaceState(
        grid=grid,
        pressure_mpa=contact.pressure,
        shear_mpa=shear,
        wear_depth_mm=np.zeros(grid.nodes),
        distance_m=0.0,
        friction=mu if held else 0.0,
        sliding=False,
        residual=contact.residual,
    )


def _partial_slip(
    site: ContactSetup, contact: ContactState, load: float, tangential: float, mu: float
) -> Floats:
    """Shear of a stuck contact that slips at its edges: q = mu [p(P') - p(P' - Q'/mu)].

    Holds for any profile, without coupling. Sources: Jäger (1998), Arch. Appl. Mech. 68, 159;
    Ciavarella (1998), Int. J. Solids Struct. 35, 2349.
    """
    stuck = load - abs(tangential / mu)
    inner: Floats = np.zeros(site.grid.nodes)
    if stuck > 1e-9 * load:
        held = solve_pressure(site.surface, site.gap_mm, stuck, start=contact.pressure)
        inner = held.pressure
    return np.asarray(np.sign(tangential) * abs(mu) * (contact.pressure - inner))
