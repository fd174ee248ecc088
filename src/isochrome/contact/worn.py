"""The worn states of a scene on one grid."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from isochrome.contact.course import Course, Stop, same_drive
from isochrome.contact.gap import undeformed_gap
from isochrome.contact.pressure import ContactState, solve_pressure
from isochrome.contact.profile import Grid, elastic_constants
from isochrome.contact.regrid import scar_on_nodes
from isochrome.contact.scar import Scar, scar_history
from isochrome.contact.state import SurfaceState
from isochrome.contact.surface import Floats, Surface, displacement, make_surface
from isochrome.contact.wear import WornStart, wear_history
from isochrome.scene import Scene

_UNWORN = 1e-30
"""Depth over the spacing, at a pressure of E*, that is none: far below any rounding of a gap."""

_SHARP = 4.0
"""Over the nodes of the grid: share of the tolerance at which a scar is run that will be overrun
(measured: p_max then errs by a third of the tolerance, on scars of any age)."""

_AFTER = 0.125
"""Share of the tolerance at which the grid goes on from a scar whose edge is then drawn back or
overrun: each of its nodes there is passed once, by one step (measured: p_max errs up to 1.9 of the
tolerance without, 0.5 with)."""

_SHARPEST = 1e-6
"""Tolerance below which the finest mesh of a scar would be no better."""


@dataclass(frozen=True)
class Site:
    """A scene's contact on one grid: the surface operator and the gap (n,) before load and wear."""

    scene: Scene
    grid: Grid
    surface: Surface
    gap_mm: Floats


def make_site(scene: Scene, grid: Grid) -> Site:
    """The operator and the gap of a scene on a grid. Raises InputError on an unusable profile."""
    modulus, coupling = elastic_constants(scene)
    surface = make_surface(
        grid.nodes, grid.spacing_mm, contact_modulus_mpa=modulus, coupling_per_mpa=coupling
    )
    return Site(scene, grid, surface, undeformed_gap(scene, grid.x_mm))


def worn_states(site: Site, course: Course, stops: list[Stop]) -> Iterator[SurfaceState]:
    """States at rising doses: under a cylinder on its own mesh as far as that goes, else here.

    Parameters: `site`; `course`, load and friction over the dose; `stops`, their doses rising.
    Yields a SurfaceState for each stop. Raises PhysicsError where a contact does not converge.
    """
    tolerance = site.scene.numerics.tolerance
    modulus, _ = elastic_constants(site.scene)
    nothing = _UNWORN * site.grid.spacing_mm / modulus
    done = sum(stop.dose_mm_per_mpa <= nothing for stop in stops)
    start = WornStart(0.0, np.zeros(site.grid.nodes))
    for stop in stops[:done]:
        yield elastic_state(site, start.depth_mm, stop)
    pauses = {
        stop.dose_mm_per_mpa
        for stop in stops
        if not same_drive(_drive(stop), course.at(stop.dose_mm_per_mpa))
    }
    jump = course.next_jump(0.0)
    last: tuple[Scar, Floats | None] | None = None
    for scar in _scars(site, course, stops[done:], tolerance):
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
        share = _AFTER if last is not None else 1.0
        history = wear_history(
            site.surface, site.gap_mm, course, rest, tolerance=share * tolerance, start=start
        )
        for stop, worn in zip(rest, history, strict=True):
            yield _state(site, stop, worn.contact, worn.depth_mm)


def _scars(site: Site, course: Course, stops: list[Stop], tolerance: float) -> Iterator[Scar]:
    """What the moving mesh holds of the stops: nothing but under a cylinder."""
    indenter = site.scene.indenter
    assert indenter is not None
    if indenter.shape != "cylinder" or indenter.profile is not None or not stops:
        return
    assert indenter.radius_mm is not None
    modulus, coupling = elastic_constants(site.scene)
    yield from scar_history(
        indenter.radius_mm, modulus, coupling, course, stops, tolerance=tolerance
    )


def _sharp_depth(site: Site, course: Course, scar: Scar) -> Floats:
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


def _drive(stop: Stop) -> tuple[float, float]:
    return stop.line_load_n_per_mm, stop.friction


def elastic_state(
    site: Site, depth_mm: Floats, stop: Stop, *, start: Floats | None = None
) -> SurfaceState:
    """The contact on a surface of known depth, under a stop's own load and friction.

    Parameters: `site`; `depth_mm` (n,), worn at its nodes; `stop`; `start` (n,), a pressure near
    by, MPa. Returns a SurfaceState. Raises PhysicsError where the contact does not converge.
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


def _scar_state(site: Site, course: Course, scar: Scar, sharp_depth: Floats | None) -> SurfaceState:
    """A scar's state on the grid; solved afresh where its stop has another load than the course."""
    stop, x = scar.stop, site.grid.x_mm
    pressure, depth = scar_on_nodes(scar, x)
    if sharp_depth is not None:
        depth = sharp_depth
        if not same_drive(_drive(stop), course.at(stop.dose_mm_per_mpa)):
            return elastic_state(site, depth, stop)
    u = displacement(site.surface, pressure, friction=stop.friction)
    gap = site.gap_mm + depth + u
    residual = 0.5 * float(np.ptp(gap[(x > scar.x_mm[0]) & (x < scar.x_mm[-1])]) / np.ptp(u))
    contact = ContactState(pressure, gap, 0.0, residual, 1, 1)
    edges = float(scar.x_mm[0]), float(scar.x_mm[-1])
    return replace(_state(site, stop, contact, depth), scar_edges_mm=edges)


def _state(site: Site, stop: Stop, contact: ContactState, depth: Floats) -> SurfaceState:
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
