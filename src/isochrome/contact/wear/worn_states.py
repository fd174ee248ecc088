"""The worn states of a scene on one grid."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import takewhile

import numpy as np

from isochrome.contact.gap import undeformed_gap
from isochrome.contact.pressure import ContactState, solve_pressure
from isochrome.contact.profile import ContactGrid, elastic_constants
from isochrome.contact.sliding_history import (
    OutputState,
    SlidingHistory,
    paused_doses,
    same_drive,
)
from isochrome.contact.state import SurfaceState
from isochrome.contact.surface import Floats, Surface, displacement, make_surface
from isochrome.contact.wear.fixed_grid import WornStart, wear_history
from isochrome.contact.wear.moving_mesh import angle_of, angles, crowding
from isochrome.contact.wear.scar import Scar, load_rises, scar_history, unresolved
from isochrome.errors import PhysicsError
from isochrome.scene import Scene

_UNWORN = 1e-30
"""Depth over the spacing, at a pressure of E*, that is none: far below any rounding of a gap."""

_SHARP = 4.0
"""Over the nodes of the grid: share of the tolerance at which a scar is run that will be overrun
(measured: p_max then errs by a third of the tolerance, on scars of any age)."""

_AFTER = 0.05
"""Share of the tolerance at which the grid goes where load or friction change, so that an edge may
draw back or be overrun: each of its nodes there is passed once, by one step (measured: p_max errs
up to 4 tolerances without, 1.3 with an eighth, on course 186 where a larger load stands on the
scar's bend, and 0.4 with this)."""

PATH_TOLERANCE = 1e-4
"""Tolerance at which it is decided how far the moving mesh goes. Mesh and grid differ in space, so
that no other tolerance may decide otherwise: two runs would differ by more than both of them."""

_UNRESOLVED = 1e-4
"""What a mesh at that tolerance may miss of a pressure with a bend inside; the finest then misses a
tenth. Where the load rises more steeply on a scar the grid goes on from the state before."""

_SHARPEST = 1e-6
"""Tolerance below which the finest mesh of a scar would be no better."""


@dataclass(frozen=True)
class ContactSetup:
    """A scene's contact on one grid of n nodes."""

    scene: Scene
    grid: ContactGrid
    surface: Surface
    gap_mm: Floats  # before load and wear


def make_site(scene: Scene, grid: ContactGrid) -> ContactSetup:
    """The operator and the gap of a scene on a grid; InputError on an unusable profile."""
    modulus, coupling = elastic_constants(scene)
    surface = make_surface(
        grid.nodes, grid.spacing_mm, contact_modulus_mpa=modulus, coupling_per_mpa=coupling
    )
    return ContactSetup(scene, grid, surface, undeformed_gap(scene, grid.x_mm))


def worn_states(
    site: ContactSetup,
    course: SlidingHistory,
    stops: list[OutputState],
    *,
    path: SlidingHistory | None = None,
) -> Iterator[SurfaceState]:
    """States at rising doses: a cylinder's on a mesh of its own as far as it goes, else here.

    How far is decided on `path`, the course as sampled at PATH_TOLERANCE. PhysicsError where a
    contact does not converge.
    """
    tolerance = site.scene.numerics.tolerance
    modulus, _ = elastic_constants(site.scene)
    nothing = _UNWORN * site.grid.spacing_mm / modulus
    done = sum(stop.dose_mm_per_mpa <= nothing for stop in stops)
    start = WornStart(0.0, np.zeros(site.grid.nodes))
    for stop in stops[:done]:
        yield elastic_state(site, start.depth_mm, stop)
    pauses = paused_doses(course, stops)
    jump = course.next_jump(0.0)
    last: tuple[Scar, Floats | None] | None = None
    for scar in _scars(site, course, stops[done:], tolerance, path=path or course):
        dose, depth = scar.stop.dose_mm_per_mpa, None
        if dose in pauses or dose == jump:
            same = last is not None and last[0].stop.dose_mm_per_mpa == dose
            depth = last[1] if last is not None and same else _sharp_depth(site, course, scar)
        last, done = (scar, depth), done + 1
        yield _scar_state(site, course, scar, depth)
    rest = stops[done:]
    if rest and last is not None:
        scar, depth = last
        dose = scar.stop.dose_mm_per_mpa
        if depth is None and (course.next_jump(dose) < np.inf or max(pauses, default=0.0) > dose):
            depth = _sharp_depth(site, course, scar)
        if depth is None:
            _, depth = scar_on_nodes(scar, site.grid.x_mm)
        start = WornStart(dose, depth)
    if rest:
        share = 1.0 if course.steady else _AFTER
        history = wear_history(
            site.surface, site.gap_mm, course, rest, tolerance=share * tolerance, start=start
        )
        for stop, worn in zip(rest, history, strict=True):
            yield _state(site, stop, worn.contact, worn.depth_mm)


def _scars(
    site: ContactSetup,
    course: SlidingHistory,
    stops: list[OutputState],
    tolerance: float,
    *,
    path: SlidingHistory | None = None,
) -> Iterator[Scar]:
    """What the moving mesh holds of the stops: nothing but under a cylinder.

    How far that is must not depend on the tolerance, nor on how finely it samples the course: the
    `path` decides it. Without one it is all of them.
    """
    indenter = site.scene.indenter
    assert indenter is not None
    if indenter.shape != "cylinder" or indenter.profile is not None:
        return
    assert indenter.radius_mm is not None
    modulus, coupling = elastic_constants(site.scene)
    run = partial(scar_history, indenter.radius_mm, modulus, coupling)
    held = path is None
    if stops and path is not None and not course.steady:
        scars = run(path, stops, tolerance=PATH_TOLERANCE)
        if load_rises(path):
            scars = takewhile(lambda scar: unresolved(scar) <= _UNRESOLVED, scars)
        if tolerance >= PATH_TOLERANCE:
            yield from scars
            return
        stops, held = stops[: sum(1 for _ in scars)], True
    reached = 0
    for scar in run(course, stops, tolerance=tolerance, held=held) if stops else ():
        reached += 1
        yield scar
    if path is not None and held and reached < len(stops):
        # on the grid it would go on with another error in space, and nobody would be told
        raise PhysicsError(
            f"{site.scene.name}: the wear until {stops[reached].distance_m:g} m does not converge "
            f"at numerics.tolerance = {tolerance:g}; raise it"
        )


def _sharp_depth(site: ContactSetup, course: SlidingHistory, scar: Scar) -> Floats:
    """A scar's depth (n,) on the grid, for a contact that may overrun its edge.

    There the depth bends sharply. A pressure that stands on the bend feels an error of the edge's
    place over the spacing, not over the width: the scar is run again that much more precisely.
    """
    wanted = site.scene.numerics.tolerance
    tolerance = max(wanted * min(1.0, _SHARP / site.grid.nodes), min(wanted, _SHARPEST))
    while tolerance < wanted:
        for sharp in _scars(site, course, [scar.stop], tolerance):
            return scar_on_nodes(sharp, site.grid.x_mm)[1]
        tolerance *= 10.0  # at the strongest coupling the finest meshes do not get that far
    return scar_on_nodes(scar, site.grid.x_mm)[1]


def elastic_state(
    site: ContactSetup, depth_mm: Floats, stop: OutputState, *, start: Floats | None = None
) -> SurfaceState:
    """The contact on a surface of known depth (n,), under a stop's own load and friction.

    `start` is a pressure near by, MPa. PhysicsError where it does not converge.
    """
    contact = solve_pressure(
        site.surface,
        site.gap_mm + depth_mm,
        stop.line_load_n_per_mm,
        friction=stop.friction,
        start=start,
        tolerance=1e-9,
    )
    return _state(site, stop, contact, depth_mm)


def _scar_state(
    site: ContactSetup, course: SlidingHistory, scar: Scar, sharp_depth: Floats | None
) -> SurfaceState:
    """A scar's state on the grid; solved afresh where its stop has another load than the course."""
    stop, x = scar.stop, site.grid.x_mm
    pressure, depth = scar_on_nodes(scar, x)
    if sharp_depth is not None:
        depth = sharp_depth
        if not same_drive(stop.drive, course.at(stop.dose_mm_per_mpa)):
            return elastic_state(site, depth, stop)
    u = displacement(site.surface, pressure, friction=stop.friction)
    gap = site.gap_mm + depth + u
    residual = 0.5 * float(np.ptp(gap[(x > scar.x_mm[0]) & (x < scar.x_mm[-1])]) / np.ptp(u))
    contact = ContactState(pressure, gap, 0.0, residual, 1, 1)
    edges = float(scar.x_mm[0]), float(scar.x_mm[-1])
    return replace(_state(site, stop, contact, depth), scar_edges_mm=edges)


def _state(
    site: ContactSetup, stop: OutputState, contact: ContactState, depth: Floats
) -> SurfaceState:
    p = contact.pressure
    return SurfaceState(
        grid=site.grid,
        pressure_mpa=p,
        shear_mpa=stop.friction * p,
        wear_depth_mm=depth,
        distance_m=stop.distance_m,
        friction=stop.friction,
        sliding=site.scene.friction is not None,
        residual=contact.residual,
    )


def scar_on_nodes(scar: Scar, x_mm: Floats) -> tuple[Floats, Floats]:
    """Pressure (MPa) and worn depth (mm) of a scar at uniform nodes (n,), to second order in h.

    p_i = (1/h) ∫ p(t) hat((t - x_i)/h) dt, the mean over a hat, keeps the load and its moment
    wherever the edges lie between the nodes. It is the difference of the mean loads behind, F, in
    the elements to the right and left of the node, over h; each mean is by Simpson's rule.
    """
    from scipy.interpolate import CubicSpline

    spacing = float(x_mm[1] - x_mm[0])
    middle, half = 0.5 * (scar.x_mm[0] + scar.x_mm[-1]), 0.5 * (scar.x_mm[-1] - scar.x_mm[0])
    phi = angles(len(scar.x_mm) - 1)
    halves = x_mm[0] + 0.5 * spacing * np.arange(-2, 2 * len(x_mm) + 1)
    at = angle_of((middle - halves) / half)
    # load per φ and depth are even in φ about the edges and zero there: their slopes vanish
    load = CubicSpline(phi, scar.pressure_mpa * crowding(phi), bc_type="clamped")
    behind = load.antiderivative()(at)
    mean = (behind[:-2:2] + 4.0 * behind[1:-1:2] + behind[2::2]) / 6.0
    depth = CubicSpline(phi, scar.depth_mm, bc_type="clamped")(at[2:-2:2])
    distance = np.abs(x_mm - middle) - half
    pressure = np.where(distance < spacing, np.diff(mean), 0.0)
    pressure *= scar.stop.line_load_n_per_mm / (spacing * pressure.sum())
    return np.maximum(pressure, 0.0), np.where(distance < 0.0, np.maximum(depth, 0.0), 0.0)
