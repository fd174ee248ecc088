"""Wear of the specimen on a fixed grid, for every profile, stepped implicitly.

With the dose K(s) = ∫ kappa ds (mm/MPa) a law dh = kappa p ds is dh/dK = p(h): a stiff equation,
since the pressure answers a short wave of depth with a stiffness of about E*/4 per wavelength.
Each step of the second-order backward differentiation formula with a variable ratio w,

    h_{n+1} = [(1+w)² h_n - w² h_{n-1}]/(1+2w) + dK (1+w)/(1+2w) p_{n+1},

is one contact solve with dK (1+w)/(1+2w) added to the operator's diagonal, stable for any step.
Steps are chosen so that the pressure stays near its own linear forecast in two measures: the
displacement that the difference would make, in which a kink one node wide at the moving edge is as
small as its effect below the surface, and the pressure itself where it is largest.
Sources: Archard (1953), J. Appl. Phys. 24, 981; Hairer, Nørsett & Wanner (1993), Solving ODEs I,
section III.5.

A scene's contact states: static, first sliding, and worn, each held to the theory's limits.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, takewhile
from typing import Any

import numpy as np

from isochrome.contact.pressure import (
    NO_PRESSURE,
    ContactState,
    Floats,
    Surface,
    displacement,
    log_of_hat,
    make_surface,
    read_profile,
    solve_pressure,
    undeformed_gap,
)
from isochrome.contact.scar import (
    SAFETY,
    SHRINK,
    Scar,
    angle_of,
    angles,
    crowding,
    load_rises,
    scar_history,
    unresolved,
)
from isochrome.contact.sliding_history import (
    SAME,
    Drive,
    OutputState,
    SlidingHistory,
    paused_doses,
    same_drive,
    wear_course,
)
from isochrome.contact.state import (
    STEEPEST,
    ContactGrid,
    SurfaceState,
    contact_grid,
    elastic_constants,
    line_load,
    mean_state,
    slices,
)
from isochrome.errors import PhysicsError
from isochrome.scene import Scene

_ACCURACY = 1e-3
"""Residual of each step's contact over the tolerance."""
_GROW = 2.0
_FORECAST, _LARGEST_FORECAST = 30.0, 0.01
_PEAK_FORECAST, _LARGEST_PEAK_FORECAST = 2.0, 0.05
"""Largest forecast errors over the tolerance, in the displacement and in the largest pressure (both
where it is and where it was), and their caps: forecast and result both err by the step squared.
Measured under cylinders, corners, ledges and roughness: p_max and depth are then within the
tolerance from 1e-3 to 1e-5, and under cylinders and corners to 1e-6 (tests/contact, tests/hard)."""
_CHANGING = 0.1
"""Share of the first where load or friction change: a contact that overruns an edge which it left
behind stands on nodes that were each passed once, by one step (measured: p_max errs up to 1.5 of
the tolerance without, 0.5 with)."""
_APPROACH, _SETTLE = 0.6, 0.05
"""Steps shorten towards a dose that is asked for, to this share of what is left, until what is left
is this share of the dose in which the shortest wave of depth relaxes. A long step leaves too much
depth on the nodes that the edge of the contact passed in it, and so a spike of pressure there."""
_CAREFUL = 3.0
"""Over the root of the tolerance: share of what is left towards a jump of load or friction. A
contact that grows there finds each node by itself where the edge was, and not the mean of many."""


@dataclass(frozen=True)
class WornState:
    """The contact at a dose, and the worn depth h (n,) there."""

    dose_mm_per_mpa: float
    contact: ContactState
    depth_mm: Floats


@dataclass(frozen=True)
class _Past:
    """What the formula remembers: the last depth and pressure, and the step that led from them."""

    depth: Floats
    pressure: Floats
    step: float


def wear_history(
    surface: Surface, gap_mm: Floats, history: SlidingHistory, stops: Sequence[OutputState], *,
    tolerance: float = 1e-4, start: tuple[float, Floats] | None = None,
) -> Iterator[WornState]:  # fmt: skip
    """Solve a worn contact at rising doses, hit exactly, each state yielded as soon as it is known.
    `gap_mm` (n,) is the unworn gap; the friction counts in the coupling alone; `stops` are sorted
    by dose, each with its own drive; `tolerance` is the wanted relative error of the
    pressure; `start`, dose and depth (n,) where the run goes on. PhysicsError where a contact does
    not converge."""
    dose, depth = start or (0.0, np.zeros(surface.nodes))
    contact = _settled(surface, gap_mm + depth, history.leaving(dose), None, tolerance=1e-10)
    now = WornState(dose, contact, depth)
    past: _Past | None = None
    share = 1.0 if history.steady and not history.wears_in else _CHANGING
    scale = (gap_mm[contact.pressure > 0.0].max() - gap_mm.min()) / contact.pressure.max()
    # the dose in which the shortest wave relaxes, and the share of what is left to a jump
    near = float(surface.lattice_normal[-1]), min(_CAREFUL * tolerance**0.5, _APPROACH)
    pauses = paused_doses(history, stops)
    step = first = 1e-3 * tolerance**0.5 * max(scale, stops[-1].dose_mm_per_mpa * 1e-6)
    for stop in stops:
        while stop.dose_mm_per_mpa - now.dose_mm_per_mpa > SAME * stop.dose_mm_per_mpa:
            size, target = _size(history, now.dose_mm_per_mpa, stop, step, near, pauses)
            drive, least = history.at(target), SAME * stop.dose_mm_per_mpa
            new, step = _advance(surface, gap_mm, drive, now, past, size, tolerance, least, share)
            if new is None:
                continue
            past = _Past(now.depth_mm, now.contact.pressure, size)
            now = replace(new, dose_mm_per_mpa=target)
            after = history.leaving(target)
            if stop.dose_mm_per_mpa > target and not same_drive(after, drive):
                past, step = None, first
                worn, pressure = gap_mm + now.depth_mm, now.contact.pressure
                now = replace(now, contact=_settled(surface, worn, after, pressure))
        settled = _settled(surface, gap_mm + now.depth_mm, stop.drive, now.contact.pressure)
        yield replace(now, contact=settled)


def _size(
    history: SlidingHistory, dose: float, stop: OutputState, step: float,
    near: tuple[float, float], pauses: frozenset[float],
) -> tuple[float, float]:  # fmt: skip
    """The next step's size and the dose where it ends: the stop and breaks are met exactly."""
    relaxing, careful = near

    def longest(remaining: float, share: float) -> float:
        settle = min(share, _SETTLE) * relaxing
        return remaining if remaining <= settle else max(settle, share * remaining)

    beyond = dose * (1.0 + SAME)
    remaining, until = stop.dose_mm_per_mpa - dose, history.next_break(beyond) - dose
    size = min(step, longest(remaining, _APPROACH))
    jump = min(history.next_jump(beyond), _after(pauses, beyond)) - dose
    if jump < np.inf:
        size = min(size, longest(jump, careful))
    if size >= until and until < remaining:
        return until, dose + until
    if 2.0 * size > until and until < remaining:  # two halves, not a whole and a sliver
        size = 0.5 * until
    return size, stop.dose_mm_per_mpa if size == remaining else dose + size


def _after(doses: frozenset[float], dose: float) -> float:
    """The first of some doses beyond another, or infinity."""
    return min((k for k in doses if k > dose), default=float("inf"))


def _settled(
    surface: Surface, worn_gap: Floats, drive: Drive, start: Floats | None, *,
    tolerance: float = 1e-9,
) -> ContactState:  # fmt: skip
    """The contact on a worn surface under a drive, solved afresh."""
    return solve_pressure(
        surface, worn_gap, drive.line_load_n_per_mm, friction=drive.friction,
        layer_mm_per_mpa=drive.layer_mm_per_mpa, roughness_mm=drive.roughness_mm, start=start,
        tolerance=tolerance,
    )  # fmt: skip


def _advance(
    surface: Surface, gap: Floats, drive: Drive, now: WornState, past: _Past | None,
    size: float, tolerance: float, shortest: float, share: float = 1.0,
) -> tuple[WornState | None, float]:  # fmt: skip
    """One implicit step, None where its forecast errs too much, and the next step's size. A step of
    the `shortest` size is taken whatever it errs; `share` of what the tolerance of the pressure
    allows in the displacement."""
    if past is None:
        base, diagonal, forecast = now.depth_mm, size, now.contact.pressure
    else:
        w = size / past.step
        base = ((1.0 + w) ** 2 * now.depth_mm - w * w * past.depth) / (1.0 + 2.0 * w)
        diagonal = size * (1.0 + w) / (1.0 + 2.0 * w)
        forecast = now.contact.pressure + w * (now.contact.pressure - past.pressure)
    contact = solve_pressure(
        surface, gap + base, drive.line_load_n_per_mm, friction=drive.friction,
        layer_mm_per_mpa=drive.layer_mm_per_mpa + diagonal, roughness_mm=drive.roughness_mm,
        start=np.maximum(forecast, 0.0), tolerance=_ACCURACY * tolerance,
    )  # fmt: skip
    pressure = contact.pressure
    miss, peak = pressure - forecast, pressure.max()
    u = displacement(surface, np.stack([miss, pressure]), friction=0.0)
    at = [int(pressure.argmax()), int(now.contact.pressure.argmax())]
    in_displacement = share * min(_FORECAST * tolerance, _LARGEST_FORECAST)
    in_peak = min(_PEAK_FORECAST * tolerance, _LARGEST_PEAK_FORECAST)
    below = np.ptp(u[0]) / np.ptp(u[1]) / in_displacement
    error = float(max(below, np.abs(miss[at]).max() / peak / in_peak))
    factor = max(SHRINK, SAFETY / max(error, 1e-300) ** 0.5)
    if error > 1.0 and size > shortest:
        return None, size * factor
    new = WornState(now.dose_mm_per_mpa + size, contact, base + diagonal * pressure)
    return new, size * min(_GROW, factor)


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


@dataclass(frozen=True)
class GrowingScar:
    """A scar (n,) on a grid where a stretch of wear has ended, which goes on from there. `drive`,
    what it was under at the end; `pressure_mpa` (n,), under which it was worn last;
    `before`, what the formula remembers. None of both where a run begins."""

    depth_mm: Floats
    drive: Drive
    pressure_mpa: Floats | None = None
    before: _Past | None = None

    def grown(
        self, site: ContactSetup, dose_mm_per_mpa: float, drive: Drive, *, tolerance: float
    ) -> GrowingScar:
        """The scar after a dose more, over which the drive goes to another, linearly.
        Steps are chosen as in `wear_history`. PhysicsError where a contact does not converge."""
        past, depth, worn_under = self.before, self.depth_mm, self.pressure_mpa
        pressure = _settled(site.surface, site.gap_mm + depth, self.drive, worn_under).pressure
        if past is not None and worn_under is not None:  # a corrected drive is no jump to follow
            past = replace(past, pressure=past.pressure + (pressure - worn_under))
        now = WornState(0.0, ContactState(pressure, site.gap_mm, 0.0, 1, 1), depth)
        step, whole = dose_mm_per_mpa, dose_mm_per_mpa * (1.0 - SAME)
        while now.dose_mm_per_mpa < whole:
            step = min(step, dose_mm_per_mpa - now.dose_mm_per_mpa)
            size = step if past is None else min(step, _GROW * past.step)
            share = (now.dose_mm_per_mpa + size) / dose_mm_per_mpa
            between = Drive(*(a + share * (b - a) for a, b in zip(self.drive, drive, strict=True)))
            new, step = _advance(
                site.surface, site.gap_mm, between, now, past, size, tolerance,
                SAME * dose_mm_per_mpa,
            )  # fmt: skip
            if new is None:
                continue
            past = _Past(now.depth_mm, now.contact.pressure, size)
            # nothing heals where the edge has just come by
            now = replace(new, depth_mm=np.maximum(new.depth_mm, now.depth_mm))
        return GrowingScar(now.depth_mm, drive, now.contact.pressure, past)

    def on(self, nodes: int) -> GrowingScar:
        """The same on a grid of more nodes about the same middle."""
        wide = partial(np.pad, pad_width=(nodes - len(self.depth_mm)) // 2)
        before, pressure = self.before, self.pressure_mpa
        if before is not None:
            before = _Past(wide(before.depth), wide(before.pressure), before.step)
        pressure = None if pressure is None else wide(pressure)
        return GrowingScar(wide(self.depth_mm), self.drive, pressure, before)

    def to_json(self) -> dict[str, Any]:
        """Plain numbers for `from_json`."""
        pressure, before = self.pressure_mpa, self.before
        return {
            "depth_mm": self.depth_mm.tolist(), "drive": self.drive,
            "pressure_mpa": None if pressure is None else pressure.tolist(),
            "before": before and (before.depth.tolist(), before.pressure.tolist(), before.step),
        }  # fmt: skip

    @classmethod
    def from_json(cls, plain: dict[str, Any]) -> GrowingScar:
        """The scar of some plain numbers."""
        drive, pressure, before = Drive(*plain["drive"]), plain["pressure_mpa"], plain["before"]
        pressure = None if pressure is None else np.array(pressure)
        before = before and _Past(np.array(before[0]), np.array(before[1]), before[2])
        return cls(np.array(plain["depth_mm"]), drive, pressure, before)


def worn_states(
    site: ContactSetup,
    course: SlidingHistory,
    stops: list[OutputState],
    *,
    path: SlidingHistory | None = None,
) -> Iterator[SurfaceState]:
    """States at rising doses: a cylinder's on a mesh of its own as far as it goes, else here. How
    far is decided on `path`, the course as sampled at PATH_TOLERANCE. PhysicsError where a contact
    does not converge."""
    tolerance = site.scene.numerics.tolerance
    modulus, _ = elastic_constants(site.scene)
    nothing = _UNWORN * site.grid.spacing_mm / modulus
    done = sum(stop.dose_mm_per_mpa <= nothing for stop in stops)
    dose = 0.0
    depth: Floats = np.zeros(site.grid.nodes)
    for stop in stops[:done]:
        yield elastic_state(site, depth, stop)
    pauses, jump = paused_doses(course, stops), course.next_jump(0.0)
    last: Scar | None = None
    sharp: Floats | None = None  # depth under the last scar, where its edge may be overrun
    for scar in _scars(site, course, stops[done:], tolerance, path=path or course):
        dose = scar.stop.dose_mm_per_mpa
        if dose not in pauses and dose != jump:
            sharp = None
        elif last is None or last.stop.dose_mm_per_mpa != dose:
            sharp = _sharp_depth(site, course, scar)
        last, done = scar, done + 1
        yield _scar_state(site, course, scar, sharp)
    later = stops[done:]
    if not later:
        return
    if last is not None:
        dose = last.stop.dose_mm_per_mpa
        if sharp is None:
            ahead = min(course.next_jump(dose), _after(pauses, dose))
            on_grid = scar_on_nodes(last, site.grid.x_mm)[1]
            sharp = _sharp_depth(site, course, last) if ahead < np.inf else on_grid
        depth = sharp
    share, start = 1.0 if course.steady else _AFTER, (dose, depth)
    history = wear_history(
        site.surface, site.gap_mm, course, later, tolerance=share * tolerance, start=start
    )
    for stop, worn in zip(later, history, strict=True):
        yield _state(site, stop, worn.contact, worn.depth_mm)


def _scars(
    site: ContactSetup, history: SlidingHistory, stops: list[OutputState], tolerance: float, *,
    path: SlidingHistory | None = None,
) -> Iterator[Scar]:  # fmt: skip
    """What the moving mesh holds of the stops: nothing but under a cylinder. How far that is must
    not depend on the tolerance, nor on how finely it samples the course: the `path` decides it.
    Without one it is all of them."""
    indenter = site.scene.pressed_body
    if indenter.shape != "cylinder" or indenter.profile is not None or not site.scene.is_bare:
        return  # the mesh's places are those of a pressure that ends as the root of the distance
    assert indenter.radius_mm is not None
    run = partial(scar_history, indenter.radius_mm, *elastic_constants(site.scene))
    held = path is None
    if stops and path is not None and not history.steady:
        scars = run(path, stops, tolerance=PATH_TOLERANCE)
        if load_rises(path):
            # of a pressure with a bend inside: the finest mesh then misses a tenth of it; where the
            # load rises more steeply on a scar the grid goes on from the state before
            scars = takewhile(lambda scar: unresolved(scar) <= PATH_TOLERANCE, scars)
        if tolerance >= PATH_TOLERANCE:
            yield from scars
            return
        stops, held = stops[: sum(1 for _ in scars)], True
    reached = 0
    for scar in run(history, stops, tolerance=tolerance, held=held) if stops else ():
        reached += 1
        yield scar
    if path is not None and held and reached < len(stops):
        # on the grid it would go on with another error in space, and nobody would be told
        name, distance = site.scene.name, stops[reached].distance_m
        raise PhysicsError(
            "wear_until_does_not", name=name, distance_m=distance, tolerance=tolerance
        )


def _sharp_depth(site: ContactSetup, history: SlidingHistory, scar: Scar) -> Floats:
    """A scar's depth (n,) on the grid, for a contact that may overrun its edge. There the depth
    bends sharply. A pressure that stands on the bend feels an error of the edge's place over the
    spacing, not over the width: the scar is run again that much more precisely."""
    wanted = site.scene.numerics.tolerance
    tolerance = max(wanted * min(1.0, _SHARP / site.grid.nodes), min(wanted, _SHARPEST))
    while tolerance < wanted:
        for sharp in _scars(site, history, [scar.stop], tolerance):
            return scar_on_nodes(sharp, site.grid.x_mm)[1]
        tolerance *= 10.0  # at the strongest coupling the finest meshes do not get that far
    return scar_on_nodes(scar, site.grid.x_mm)[1]


def elastic_state(
    site: ContactSetup, depth_mm: Floats, stop: OutputState, *, start: Floats | None = None
) -> SurfaceState:
    """The contact on a surface of known depth (n,), under a stop's own load and friction. `start`
    is a pressure near by, MPa. PhysicsError where it does not converge."""
    contact = _settled(site.surface, site.gap_mm + depth_mm, stop.drive, start)
    return _state(site, stop, contact, depth_mm)


def pressed_again(scene: Scene, state: SurfaceState, share: float) -> SurfaceState:
    """A state's surface, as it is worn, under `share` times the load: what the load changes of the
    tractions is added to those that are there. PhysicsError where it does not converge."""
    site, load = make_site(scene, state.grid), scene.load_at(state.distance_m)
    assert scene.specimen.thickness_mm is not None
    pressed = []
    for line in load / scene.specimen.thickness_mm * np.array([1.0, share]):
        if state.sliding or scene.friction is None:
            between = scene.layer_at(state.distance_m), scene.roughness_at(state.distance_m)
            stop = OutputState(state.distance_m, 0.0, float(line), state.friction, *between)
            pressed.append(elastic_state(site, state.wear_depth_mm, stop))
        else:
            held = scene.load.tangential_n if scene.load else None
            pressed.append(_static_state(site, float(line), held))
    now, then = pressed
    return replace(
        state, pressure_mpa=state.pressure_mpa + (then.pressure_mpa - now.pressure_mpa),
        shear_mpa=state.shear_mpa + (then.shear_mpa - now.shear_mpa),
        scar_edges_mm=then.edges_mm,
    )  # fmt: skip


def _scar_state(
    site: ContactSetup, history: SlidingHistory, scar: Scar, sharp_depth: Floats | None
) -> SurfaceState:
    """A scar's state on the grid; solved afresh where its stop has another load than the course."""
    stop, x = scar.stop, site.grid.x_mm
    pressure, depth = scar_on_nodes(scar, x)
    if sharp_depth is not None:
        depth = sharp_depth
        if not same_drive(stop.drive, history.at(stop.dose_mm_per_mpa)):
            return elastic_state(site, depth, stop)
    u = displacement(site.surface, pressure, friction=stop.friction)
    gap = site.gap_mm + depth + u
    residual = 0.5 * float(np.ptp(gap[(x > scar.x_mm[0]) & (x < scar.x_mm[-1])]) / np.ptp(u))
    contact = ContactState(pressure, gap, residual, 1, 1)
    edges = float(scar.x_mm[0]), float(scar.x_mm[-1])
    return replace(_state(site, stop, contact, depth), scar_edges_mm=edges)


def _state(
    site: ContactSetup, stop: OutputState, contact: ContactState, depth: Floats
) -> SurfaceState:
    p = contact.pressure
    return SurfaceState(
        grid=site.grid, pressure_mpa=p, shear_mpa=stop.friction * p, wear_depth_mm=depth,
        distance_m=stop.distance_m, friction=stop.friction, sliding=site.scene.friction is not None,
        residual=contact.residual, rough=stop.roughness_mm > 0.0,
    )  # fmt: skip


def scar_on_nodes(scar: Scar, x_mm: Floats) -> tuple[Floats, Floats]:
    """Pressure (MPa) and worn depth (mm) of a scar at uniform nodes (n,), to second order in h. p_i
    = (1/h) ∫ p(t) hat((t - x_i)/h) dt, the mean over a hat, keeps the load and its moment wherever
    the edges lie between the nodes. It is the difference of the mean loads behind, F, in the
    elements to the right and left of the node, over h; each mean is by Simpson's rule."""
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
    pressure = np.maximum(np.where(distance < spacing, np.diff(mean), 0.0), 0.0)
    pressure *= scar.stop.line_load_n_per_mm / (spacing * pressure.sum())
    return pressure, np.where(distance < 0.0, np.maximum(depth, 0.0), 0.0)


FEWEST_NODES = 8
"""Nodes in contact below which the spacing, not the physics, sets the pressure."""

STRONGEST = 0.12
"""Largest mean pressure over E*: that of a cylinder whose half-width is 0.3 of its radius."""

_PLACES = 1024


def refuse_unfit(scene: Scene, state: SurfaceState) -> None:
    """Refuse a state that its grid, its profile or linear elasticity does not carry. Conditions: at
    least 8 nodes in contact; no contact at the end of a measured profile; mean pressure P'/(n h) <=
    0.12 E*; scar no deeper than 0.3 of the contact's half-width. The two last: the parabola's own
    limit, a <= 0.3 R, where p_mean = pi E* a/(8 R); Johnson (1985), section 4.2. PhysicsError says
    what to change."""
    name, h, inside = scene.name, state.grid.spacing_mm, state.pressure_mpa > 0.0
    count, fewest = int(np.count_nonzero(inside)), FEWEST_NODES
    if count < fewest:
        raise PhysicsError(
            "contact_has_only_nodes", name=name, count=count, spacing_mm=h, fewest_nodes=fewest
        )
    file = scene.profile_file
    if file is not None:  # its last row is where the measurement ends, not a corner of the body
        x, _ = read_profile(scene.path(file))
        known = np.flatnonzero((state.grid.x_mm >= x[0]) & (state.grid.x_mm <= x[-1]))
        ends = [(k, end) for k, end in ((known[0], x[0]), (known[-1], x[-1])) if inside[k]]
        if ends:
            raise PhysicsError(
                "contact_reaches_end_profile", name=name, profile_file=file, ends=ends[0][1]
            )
    modulus, _ = elastic_constants(scene)
    mean = float(state.pressure_mpa[inside].mean())
    if not mean <= STRONGEST * modulus:
        raise PhysicsError(
            "mean_pressure_would_mpa", name=name, mean=mean, strongest=STRONGEST, modulus=modulus
        )
    half, depth, s = 0.5 * count * h, float(state.wear_depth_mm.max()), state.distance_m
    if not depth <= STEEPEST * half:
        raise PhysicsError(
            "scar_would_mm_deep", name=name, distance_m=s, depth=depth, deepest=STEEPEST, half=half
        )


def touches_outside(scene: Scene, state: SurfaceState) -> bool:
    """Whether a measured profile meets the specimen beyond the grid, where no node would know. gap
    + u < d at the profile's rows and at places between them, with u of `displacement` carried on
    beyond the grid, where a hat of pressure is a line force."""
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
    level += scene.layer_at(state.distance_m) * state.pressure_mpa[peak]
    level -= scene.roughness_at(state.distance_m) * np.log(NO_PRESSURE)
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
    """Solve the contact at every state of a scene, each handed out as soon as it is known. A static
    state first if the scene asks for it, then those of `wear.distances_m` in its order; without
    wear one, sliding if there is friction. States wait only for others named before them. A contact
    that outgrows its grid is solved again on a wider one. PhysicsError where it does not converge,
    reaches the grid's edge, or as `refuse_unfit` says."""
    course = wear_course(scene)
    loads, dose = course[0].line_load_n_per_mm, float(course[0].dose_mm_per_mpa[-1])
    ends, given = (float(loads.min()), float(loads.max())), 0
    for attempt in range(_TRIES):
        grid = contact_grid(
            scene, largest_dose_mm_per_mpa=dose, line_loads_n_per_mm=ends, growth=1.5**attempt
        )
        for sliced in islice(_sliced_states(scene, grid, course), given, None):
            state = sliced[-1]  # of the largest load
            outermost = state.pressure_mpa[[0, -1]], state.wear_depth_mm[[0, -1]]
            if np.any(outermost) or touches_outside(scene, state):
                break
            refuse_unfit(scene, state)
            given += 1
            yield mean_state(scene, sliced)
        else:
            return
        if scene.numerics.window_mm is not None:
            break
    width = grid.spacing_mm * (grid.nodes - 1)
    raise PhysicsError("contact_reaches_edge_grid", name=scene.name, width=width)


def _sliced_states(
    scene: Scene, grid: ContactGrid, course: tuple[SlidingHistory, list[OutputState]]
) -> Iterator[tuple[SurfaceState, ...]]:
    """The states, each of all slices through the thickness, that of the largest load last."""
    parts = slices(scene)
    courses = [course] if len(parts) == 1 else [wear_course(part) for part in parts]
    return zip(
        *(_states_on(one, grid, *own) for one, own in zip(parts, courses, strict=True)), strict=True
    )


def _states_on(
    scene: Scene, grid: ContactGrid, history: SlidingHistory, stops: list[OutputState]
) -> Iterator[SurfaceState]:
    site = make_site(scene, grid)
    static = scene.friction is None or scene.friction.static_state_first
    held = scene.load.tangential_n if scene.load else None
    if (static and (not scene.wear or scene.friction)) or held is not None:
        yield _static_state(site, line_load(scene), held)
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


def _static_state(site: ContactSetup, load: float, held: float | None) -> SurfaceState:
    scene, grid = site.scene, site.grid
    drive = Drive(load, 0.0, scene.layer_at(0.0), scene.roughness_at(0.0))
    contact = _settled(site.surface, site.gap_mm, drive, None, tolerance=1e-10)
    mu = scene.friction_at(0.0)
    shear: Floats = np.zeros(grid.nodes)
    if held and scene.specimen.thickness_mm:
        # q = mu [p(P') - p(P' - Q'/mu)], for any profile, without coupling. Sources: Jäger (1998),
        # Arch. Appl. Mech. 68, 159; Ciavarella (1998), Int. J. Solids Struct. 35, 2349
        tangential = held / scene.specimen.thickness_mm
        stuck, inner = load - abs(tangential / mu), shear
        if stuck > 1e-9 * load:
            drive = drive._replace(line_load_n_per_mm=stuck)
            start = contact.pressure
            inner = _settled(site.surface, site.gap_mm, drive, start, tolerance=1e-10).pressure
        shear = np.asarray(np.sign(tangential) * abs(mu) * (contact.pressure - inner))
    return SurfaceState(
        grid=grid, pressure_mpa=contact.pressure, shear_mpa=shear,
        wear_depth_mm=np.zeros(grid.nodes), distance_m=0.0, friction=mu if held else 0.0,
        sliding=False, residual=contact.residual, rough=drive.roughness_mm > 0.0,
    )  # fmt: skip
