"""A scene's contact states: static, first sliding, and worn at the distances asked for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from isochrome.contact.course import Course, Stop, wear_course
from isochrome.contact.gap import undeformed_gap
from isochrome.contact.limits import refuse_unfit, touches_outside
from isochrome.contact.pressure import ContactState, solve_pressure
from isochrome.contact.profile import (
    Grid,
    contact_grid,
    elastic_constants,
    line_load,
)
from isochrome.contact.regrid import scar_on_nodes
from isochrome.contact.scar import Scar, scar_history
from isochrome.contact.surface import Floats, Surface, displacement, make_surface
from isochrome.contact.wear import WornStart, wear_history
from isochrome.errors import PhysicsError
from isochrome.scene import Scene

_TRIES = 4
_UNWORN = 1e-30
"""Depth over the spacing, at a pressure of E*, that is none: far below any rounding of a gap."""


@dataclass(frozen=True)
class SurfaceState:
    """What acts on the specimen's surface in one state.

    `grid`, with `x_mm` (n,); `pressure_mpa` p and `shear_mpa` q along +x (n,); `wear_depth_mm`
    (n,); `distance_m` slid; `friction`, mu; `sliding`, False in a static state; `residual`, of the
    contact's complementarity; `scar_edges_mm`, where a mesh knew the edges better than the grid.
    """

    grid: Grid
    pressure_mpa: Floats
    shear_mpa: Floats
    wear_depth_mm: Floats
    distance_m: float
    friction: float
    sliding: bool
    residual: float
    scar_edges_mm: tuple[float, float] | None = None

    @property
    def p_max_mpa(self) -> float:
        """Largest nodal pressure (MPa)."""
        return float(self.pressure_mpa.max())

    @property
    def edges_mm(self) -> tuple[float, float]:
        """Outermost places where the pressure reaches zero (mm).

        Near an edge p² is linear in x (p ~ the root of the distance), so p² of the last two nodes
        in contact is carried on to zero, by one spacing at most: second order in the spacing.
        """
        if self.scar_edges_mm is not None:
            return self.scar_edges_mm
        p2, h = self.pressure_mpa**2, self.grid.spacing_mm
        inside = np.flatnonzero(p2 > 0.0)
        first, last = int(inside[0]), int(inside[-1])
        left = self.grid.x_mm[first] - h * _carried(p2[first], p2[min(first + 1, last)])
        right = self.grid.x_mm[last] + h * _carried(p2[last], p2[max(last - 1, first)])
        return float(left), float(right)

    @property
    def contact_width_mm(self) -> float:
        """Distance between the outermost edges of contact (mm)."""
        left, right = self.edges_mm
        return right - left

    @property
    def line_load_n_per_mm(self) -> float:
        """Normal load per thickness that the pressure carries, ∫p dx (N/mm)."""
        return float(self.pressure_mpa.sum() * self.grid.spacing_mm)

    @property
    def worn_area_mm2(self) -> float:
        """Area of the worn cross-section, ∫h dx (mm²)."""
        return float(self.wear_depth_mm.sum() * self.grid.spacing_mm)


def _carried(outer: float, inner: float) -> float:
    """Fraction of a spacing beyond the outer node at which a straight line reaches zero."""
    return min(1.0, outer / (inner - outer)) if inner > outer else 1.0


def contact_states(scene: Scene) -> list[SurfaceState]:
    """Solve the contact at every state of a scene. See `iter_contact_states`."""
    return list(iter_contact_states(scene))


def iter_contact_states(scene: Scene) -> Iterator[SurfaceState]:
    """Solve the contact at every state of a scene, each handed out as soon as it is known.

    A static state first if the scene asks for it, then one at each of `wear.distances_m`, in the
    scene's order; without wear, one state, sliding if there is friction. States wait in memory only
    for others that the scene names before them. A contact that outgrows its grid is solved again
    on a wider one, and what was handed out is passed over.
    Raises PhysicsError where the contact does not converge, reaches the edge of the grid, or is
    beyond what its grid, its profile or linear elasticity carries (see `contact.limits`).
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


def _touches_edge(state: SurfaceState) -> bool:
    """Whether the contact is at the edge of its grid, or was while it wore."""
    ends = [0, -1]
    return bool(state.pressure_mpa[ends].any() or state.wear_depth_mm[ends].any())


def _states_on(
    scene: Scene, grid: Grid, course: Course, stops: list[Stop]
) -> Iterator[SurfaceState]:
    """The states on one grid, in the scene's order."""
    modulus, coupling = elastic_constants(scene)
    surface = make_surface(
        grid.nodes, grid.spacing_mm, contact_modulus_mpa=modulus, coupling_per_mpa=coupling
    )
    gap = undeformed_gap(scene, grid.x_mm)
    static = scene.friction is None or scene.friction.static_state_first
    held = scene.load.tangential_n if scene.load else None
    if (static and not scene.wear) or (static and scene.friction) or held is not None:
        yield _static_state(scene, grid, surface, gap, line_load(scene))
    if held is not None or (scene.friction is None and not scene.wear):
        return
    order = sorted(range(len(stops)), key=lambda i: stops[i].dose_mm_per_mpa)
    worn = _worn_states(scene, grid, surface, gap, course, [stops[i] for i in order])
    waiting: dict[int, SurfaceState] = {}
    place = 0
    for i, state in zip(order, worn, strict=True):
        waiting[i] = state
        while place in waiting:
            yield waiting.pop(place)
            place += 1


def _worn_states(
    scene: Scene, grid: Grid, surface: Surface, gap: Floats, course: Course, stops: list[Stop]
) -> Iterator[SurfaceState]:
    """States at rising doses: under a cylinder on its own mesh as far as that goes, else here."""
    modulus, coupling = elastic_constants(scene)
    nothing = _UNWORN * grid.spacing_mm / modulus
    done = sum(stop.dose_mm_per_mpa <= nothing for stop in stops)
    start = WornStart(0.0, np.zeros(grid.nodes))
    for stop in stops[:done]:
        yield _elastic_state(scene, grid, surface, gap, start.depth_mm, stop)
    indenter = scene.indenter
    assert indenter is not None
    if indenter.shape == "cylinder" and indenter.profile is None and done < len(stops):
        assert indenter.radius_mm is not None
        for scar in scar_history(
            indenter.radius_mm,
            modulus,
            coupling,
            course,
            stops[done:],
            tolerance=scene.numerics.tolerance,
        ):
            state = _scar_state(scene, grid, surface, gap, course, scar)
            start = WornStart(scar.stop.dose_mm_per_mpa, state.wear_depth_mm)
            done += 1
            yield state
    rest = stops[done:]
    if rest:
        tolerance = scene.numerics.tolerance
        history = wear_history(surface, gap, course, rest, tolerance=tolerance, start=start)
        for stop, worn in zip(rest, history, strict=True):
            yield _state(scene, grid, stop, worn.contact, worn.depth_mm)


def _elastic_state(
    scene: Scene, grid: Grid, surface: Surface, gap: Floats, depth: Floats, stop: Stop
) -> SurfaceState:
    """The contact on a surface of known depth, under a stop's own load and friction."""
    contact = solve_pressure(
        surface, gap + depth, stop.line_load_n_per_mm, friction=stop.friction, tolerance=1e-9
    )
    return _state(scene, grid, stop, contact, depth)


def _scar_state(
    scene: Scene, grid: Grid, surface: Surface, gap: Floats, course: Course, scar: Scar
) -> SurfaceState:
    """A scar's state on the grid; solved afresh where its stop has another load than the course."""
    stop = scar.stop
    pressure, depth = scar_on_nodes(scar, grid.x_mm)
    drive = stop.line_load_n_per_mm, stop.friction
    if not np.allclose(drive, course.at(stop.dose_mm_per_mpa), 1e-6, 0.0):
        return _elastic_state(scene, grid, surface, gap, depth, stop)
    u = displacement(surface, pressure, friction=stop.friction)
    total = (gap + depth + u)[(grid.x_mm > scar.x_mm[0]) & (grid.x_mm < scar.x_mm[-1])]
    residual = 0.5 * float(np.ptp(total) / np.ptp(u))
    contact = ContactState(pressure, gap + depth + u, 0.0, residual, 1, 1)
    edges = float(scar.x_mm[0]), float(scar.x_mm[-1])
    return replace(_state(scene, grid, stop, contact, depth), scar_edges_mm=edges)


def _state(
    scene: Scene, grid: Grid, stop: Stop, contact: ContactState, depth: Floats
) -> SurfaceState:
    p = contact.pressure
    return SurfaceState(
        grid=grid,
        pressure_mpa=p,
        shear_mpa=stop.friction * p,
        wear_depth_mm=depth,
        distance_m=stop.distance_m,
        friction=stop.friction,
        sliding=scene.friction is not None,
        residual=contact.residual,
    )


def _static_state(
    scene: Scene, grid: Grid, surface: Surface, gap: Floats, load: float
) -> SurfaceState:
    contact = solve_pressure(surface, gap, load)
    mu = scene.friction_at(0.0)
    held = scene.load.tangential_n if scene.load else None
    shear: Floats = np.zeros(grid.nodes)
    if held and scene.specimen.thickness_mm:
        shear = _partial_slip(surface, gap, contact, load, held / scene.specimen.thickness_mm, mu)
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
    surface: Surface, gap: Floats, contact: ContactState, load: float, tangential: float, mu: float
) -> Floats:
    """Shear of a stuck contact that slips at its edges: q = mu [p(P') - p(P' - Q'/mu)].

    Holds for any profile, without coupling. Sources: Jäger (1998), Arch. Appl. Mech. 68, 159;
    Ciavarella (1998), Int. J. Solids Struct. 35, 2349.
    """
    stuck = load - abs(tangential / mu)
    inner = np.zeros_like(gap)
    if stuck > 1e-9 * load:
        inner = solve_pressure(surface, gap, stuck, start=contact.pressure).pressure
    return np.sign(tangential) * abs(mu) * (contact.pressure - inner)
