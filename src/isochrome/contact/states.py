"""A scene's contact states: static, first sliding, and worn at the distances asked for."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import numpy as np

from isochrome.contact.pressure import ContactState, solve_pressure
from isochrome.contact.profile import ContactGrid, contact_grid, line_load
from isochrome.contact.sliding_history import OutputState, SlidingHistory, wear_course
from isochrome.contact.state import SurfaceState
from isochrome.contact.surface import Floats
from isochrome.contact.validity import refuse_unfit, touches_outside
from isochrome.contact.wear.worn_states import (
    PATH_TOLERANCE,
    ContactSetup,
    make_site,
    worn_states,
)
from isochrome.errors import PhysicsError
from isochrome.scene import Scene

_TRIES = 4


def contact_states(scene: Scene) -> list[SurfaceState]:
    """The contact at every state of a scene, in its order; see `iter_contact_states`."""
    return list(iter_contact_states(scene))


def iter_contact_states(scene: Scene) -> Iterator[SurfaceState]:
    """Solve the contact at every state of a scene, each handed out as soon as it is known.

    A static state first if the scene asks for it, then those of `wear.distances_m` in its order;
    without wear one, sliding if there is friction. States wait only for others named before them. A
    contact that outgrows its grid is solved again on a wider one. PhysicsError where it does not
    converge, reaches the grid's edge, or as `contact.validity` says.
    """
    course, stops = wear_course(scene)
    loads = course.line_load_n_per_mm
    given = 0
    for attempt in range(_TRIES):
        grid = contact_grid(
            scene,
            largest_dose_mm_per_mpa=float(course.dose_mm_per_mpa[-1]),
            line_loads_n_per_mm=(float(loads.min()), float(loads.max())),
            growth=1.5**attempt,
        )
        for state in islice(_states_on(scene, grid, course, stops), given, None):
            if _touches_edge(state) or touches_outside(scene, state):
                break
            refuse_unfit(scene, state)
            given += 1
            yield state
        else:
            return
        if scene.numerics.window_mm is not None:
            break
    width = grid.spacing_mm * (grid.nodes - 1)
    raise PhysicsError(
        f"{scene.name}: the contact reaches the edge of its grid, {width:.3g} mm wide; raise (or "
        "leave out) numerics.window_mm, or lower the load or the wear"
    )


def _path(scene: Scene, course: SlidingHistory) -> SlidingHistory:
    """The scene's course as it is sampled at PATH_TOLERANCE, see `worn_states`."""
    if course.steady or scene.numerics.tolerance == PATH_TOLERANCE:
        return course
    return wear_course(scene.with_values({"numerics.tolerance": PATH_TOLERANCE}))[0]


def _touches_edge(state: SurfaceState) -> bool:
    """Whether the contact is at the edge of its grid, or was while it wore."""
    ends = [0, -1]
    return bool(state.pressure_mpa[ends].any() or state.wear_depth_mm[ends].any())


def _states_on(
    scene: Scene, grid: ContactGrid, course: SlidingHistory, stops: list[OutputState]
) -> Iterator[SurfaceState]:
    """The states on one grid, in the scene's order."""
    site = make_site(scene, grid)
    static = scene.friction is None or scene.friction.static_state_first
    held = scene.load.tangential_n if scene.load else None
    if (static and not scene.wear) or (static and scene.friction) or held is not None:
        yield _static_state(site, line_load(scene))
    if held is not None or (scene.friction is None and not scene.wear):
        return
    order = sorted(range(len(stops)), key=lambda i: stops[i].dose_mm_per_mpa)
    rising = [stops[i] for i in order]
    worn = worn_states(site, course, rising, path=_path(scene, course))
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
    result: Floats = np.sign(tangential) * abs(mu) * (contact.pressure - inner)
    return result
