"""The scar that a tracked contact has worn so far, what wore it, and how it grows.

Wear is followed over the worn area W itself: by dh = p dK and ∫p dx = P' a step of area takes the
dose dK = dW/P', whatever the law and its coefficient, which only say how far W has come. Each step
is implicit, h₁ = h₀ + dK p(h₁), under the mean load of its stretch; once whole and once in halves,
of which the first order's error is taken off, 2 h(halves) - h(whole): Hairer, Nørsett & Wanner
(1993), Solving ODEs I, section II.9. A scar is stepped on from one that is known, never worn again
from the start: some are kept on the way, with the drive that wore them.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass
from typing import Any

import numpy as np

from isochrome.contact import (
    ContactSetup,
    OutputState,
    SlidingHistory,
    contact_grid,
    elastic_constants,
    elastic_state,
    make_site,
    solve_pressure,
    wear_course,
    worn_states,
)
from isochrome.errors import PhysicsError
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.unknowns import FRICTION, LOAD, WEAR
from isochrome.fitting.joint.frame_sequence import local_values
from isochrome.scene import DistanceTable, Scene
from isochrome.simulation import SceneState

TOLERANCE = 1e-5
"""Of the wear from the unworn contact on: at 1e-4 a scar's own error is a load's uncertainty."""

STEP, SMALL = 0.0075, 5e-4
"""Largest growth in a step, over the worn and the elastic area; below the second no halves are
needed."""

JUMP = 1e-9
"""Share of the worn area over which a load jumps: one value on arriving, another on leaving."""

_EQUATIONS = 1e-8
"""Tolerance of a step's contact."""

_NEW, _OLD = 250, 500
"""Frames of the past that a state holds one by one, and points that stand for all before."""

_SCARS = 4
"""Last scars that are kept: a worn area that is tracked falls back behind them by its noise."""

_APART = 0.01
"""Growth from one to the next of the older ones: a box of worn areas begins some per cent behind
the last, and a scar that is not stepped on from one below it would lack what wore it."""

_BACK = 0.9
"""Share of the oldest one's area from which on frames are remembered."""


@dataclass(frozen=True)
class Drive:
    """What wears a scar: line load P' (N/mm) and mu, over the worn area.

    `worn_mm2` W, rising; `line_load_n_per_mm`; `friction`, all (m,), linear between; the ends'
    values hold beyond them.
    """

    worn_mm2: Array
    line_load_n_per_mm: Array
    friction: Array

    @property
    def columns(self) -> tuple[Array, Array, Array]:
        """All three."""
        return self.worn_mm2, self.line_load_n_per_mm, self.friction

    def mean(self, low: float, high: float) -> tuple[float, float]:
        """Mean line load (N/mm) and mu while the worn area grows from `low` to `high` (mm²)."""
        inside = (self.worn_mm2 > low) & (self.worn_mm2 < high)
        worn = np.concatenate(([low], self.worn_mm2[inside], [high]))
        weight = np.gradient(worn) if high > low else np.ones(len(worn))
        weight[[0, -1]] *= 0.5 if high > low else 1.0
        load, friction = (float(np.average(row, weights=weight)) for row in self.at(worn))
        return load, friction

    def at(self, worn_mm2: Array) -> tuple[Array, Array]:
        """Line load and mu at worn areas (mm²)."""
        load, friction = (np.interp(worn_mm2, self.worn_mm2, row) for row in self.columns[1:])
        return load, friction

    def then(self, worn_mm2: float, line_load_n_per_mm: float, friction: float) -> Drive:
        """This up to a worn area (mm²), and from there on something else, constant."""
        kept = self.worn_mm2 < worn_mm2
        ends = np.array([worn_mm2, worn_mm2 * (1.0 + JUMP)])
        load, mu = (
            np.concatenate((row[kept], start, [new]))
            for row, start, new in zip(
                self.columns[1:], self.at(ends[:1]), (line_load_n_per_mm, friction), strict=True
            )
        )
        return Drive(np.concatenate((self.worn_mm2[kept], ends)), load, mu)


@dataclass(frozen=True)
class WornScar:
    """A scar on a contact's grid: its area `worn_mm2`, and `depth_mm` (n,) at the nodes.

    `pressure_mpa` (n,), under which it was worn last, None where that is not known.
    """

    worn_mm2: float
    depth_mm: Array
    pressure_mpa: Array | None = None

    def on(self, nodes: int) -> WornScar:
        """The same on a grid of another width about the same middle."""
        room = (nodes - len(self.depth_mm)) // 2
        if room == 0:
            return self
        if room > 0:
            return WornScar(self.worn_mm2, np.pad(self.depth_mm, room))
        if self.depth_mm[:-room].any() or self.depth_mm[room:].any():
            raise PhysicsError("the scar is wider than the grid; raise numerics.window_mm")
        return WornScar(self.worn_mm2, self.depth_mm[-room:room])


def grow(
    site: ContactSetup, scar: WornScar, drive: Drive, areas: list[float], elastic_mm2: float
) -> list[WornScar]:
    """Scars of some areas, one worn out of the other.

    Parameters: `site`, the contact's grid; `scar`, on it, where the wear begins (area 0: unworn);
    `drive`; `areas` (m,), mm², rising, none below the scar's own; `elastic_mm2`, the area that the
    elasticity takes up. Returns m scars. Raises PhysicsError where a contact does not converge or
    reaches the edge of its grid.
    """
    if scar.worn_mm2 <= 0.0:
        course, stops = _course(drive, areas)
        states = list(worn_states(site, course, stops))
        found = [
            WornScar(area, state.wear_depth_mm, state.pressure_mpa)
            for area, state in zip(areas, states, strict=True)
        ]
    else:
        found = []
        for area in areas:
            count = math.ceil((area - scar.worn_mm2) / (STEP * (area + elastic_mm2)) - 1e-6)
            for worn in np.linspace(scar.worn_mm2, area, max(1, count) + 1)[1:].tolist():
                scar = _stepped(site, scar, drive, worn, elastic_mm2)
            found.append(scar)
    if any(one.depth_mm[[0, -1]].any() for one in found):
        raise PhysicsError(
            f"{site.scene.name}: the scar reaches the edge of its grid; raise (or leave out) "
            "numerics.window_mm"
        )
    return found


def _stepped(
    site: ContactSetup, scar: WornScar, drive: Drive, worn: float, elastic: float
) -> WornScar:
    """A scar grown to an area in one step."""
    if worn <= scar.worn_mm2:
        return scar
    whole = _implicit(site, scar, drive, worn, scar.pressure_mpa)
    if worn - scar.worn_mm2 < SMALL * (worn + elastic):
        return whole
    half = _implicit(site, scar, drive, 0.5 * (scar.worn_mm2 + worn), whole.pressure_mpa)
    both = _implicit(site, half, drive, worn, whole.pressure_mpa)
    # nothing heals where the edge has just come by
    depth = np.maximum(2.0 * both.depth_mm - whole.depth_mm, scar.depth_mm)
    return WornScar(worn, depth, both.pressure_mpa)


def _implicit(
    site: ContactSetup, scar: WornScar, drive: Drive, worn: float, start: Array | None
) -> WornScar:
    """One implicit step under the mean load on its way; `start`, a pressure near by."""
    load, friction = drive.mean(scar.worn_mm2, worn)
    dose = (worn - scar.worn_mm2) / load
    contact = solve_pressure(
        site.surface,
        site.gap_mm + scar.depth_mm,
        load,
        friction=friction,
        wear_mm_per_mpa=dose,
        start=start,
        tolerance=_EQUATIONS,
    )
    return WornScar(worn, scar.depth_mm + dose * contact.pressure, contact.pressure)


def _course(drive: Drive, areas: list[float]) -> tuple[SlidingHistory, list[OutputState]]:
    """Load and friction over the dose from the unworn contact on, and where areas are reached."""
    inside = (drive.worn_mm2 > 0.0) & (drive.worn_mm2 < areas[-1])
    there = np.concatenate(([0.0], drive.worn_mm2[inside], areas))
    load, friction = (
        np.concatenate((ends[:1], row[inside], ends[1:]))
        for row, ends in zip(drive.columns[1:], drive.at(np.array([0.0, *areas])), strict=True)
    )
    order = np.argsort(there, kind="stable")
    there, load, friction = there[order], load[order], friction[order]
    grown = np.where(np.diff(there) > 2.0 * JUMP * there[1:], np.diff(there), 0.0)
    dose = np.concatenate(([0.0], np.cumsum(2.0 * grown / (load[1:] + load[:-1]))))
    jumps = np.unique(dose[1:][(np.diff(dose) <= 0.0) & (np.diff(load) != 0.0)])
    breaks = tuple(float(k) for k in jumps if 0.0 < k < dose[-1])
    course = SlidingHistory(dose, dose, load, friction, breaks)
    at = dose[np.searchsorted(there, areas)].tolist()
    return course, [OutputState(0.0, k, *course.at(k)) for k in at]


def _with_last(kept: list[WornScar], last: WornScar) -> list[WornScar]:
    """Scars that are kept, with one more: the last ones, and of the older some down to `_BACK`."""
    every = [*kept, last]
    older: list[WornScar] = []
    for scar in every[:-_SCARS]:
        if not older or scar.worn_mm2 > (1.0 + _APART) * older[-1].worn_mm2:
            older.append(scar)
    while len(older) > 1 and older[1].worn_mm2 < _BACK * last.worn_mm2:
        older.pop(0)
    return [*older, *every[-_SCARS:]]


def elastic_area(scene: Scene, line_load_n_per_mm: float) -> float:
    """Area (mm²) that the indenter would cut off were it not for the elasticity, P' a / E*.

    Parameters: `scene`; `line_load_n_per_mm` P'. Source: Johnson (1985), Contact Mechanics,
    section 4.2, for the half-width a under a cylinder; that of a flat is its own.
    """
    modulus, _ = elastic_constants(scene)
    indenter = scene.indenter
    assert indenter is not None
    width = indenter.half_width_mm
    if width is None:
        radius = indenter.radius_mm or 1.0
        width = 2.0 * math.sqrt(line_load_n_per_mm * radius / (math.pi * modulus))
    return line_load_n_per_mm * width / modulus


class TrackPast:
    """The course of a worn contact up to the frame that is being tracked, and what it has worn."""

    def __init__(self) -> None:
        self._before: Drive | None = None
        self._frames: list[tuple[float, float, float]] = []
        self._kept: list[WornScar] = []
        self._scars: list[WornScar] = []
        self._low: WornScar | None = None
        self._ahead = (0.0, 0.0)
        self._site: ContactSetup | None = None
        self._pressure: Array | None = None

    def state(self) -> dict[str, Any]:
        """What wore the contact, and its scars, as plain numbers for `resume`.

        Frames long past become means of neighbours: hours of video are as few numbers as minutes.
        """
        before, (first, rest) = self._before, (self._frames[:1], self._frames[1:])
        old, new = rest[:-_NEW], rest[-_NEW:]
        if len(old) > _OLD:
            groups = np.array_split(np.array(old), _OLD)
            old = [(float(w), float(p), float(mu)) for w, p, mu in (g.mean(axis=0) for g in groups)]
        return {
            "before": None if before is None else [part.tolist() for part in before.columns],
            "frames": [*first, *old, *new],
            "scars": [[scar.worn_mm2, scar.depth_mm.tolist()] for scar in self._kept],
        }

    def resume(self, state: dict[str, Any]) -> None:
        """Go on from a `state`."""
        before = state["before"]
        self._before = None if before is None else Drive(*(np.array(part) for part in before))
        self._frames = [(row[0], row[1], row[2]) for row in state["frames"]]
        self._kept = [WornScar(worn, np.array(depth)) for worn, depth in state["scars"]]

    def begin(self, before: Drive) -> None:
        """What wore the contact before the first frame, over the area by the scene's law."""
        self._before = before

    def passed(self, worn_mm2: float, line_load_n_per_mm: float, friction: float) -> None:
        """One frame more: its area by the scene's law, its line load and friction."""
        self._frames.append((worn_mm2, line_load_n_per_mm, friction))

    def use(self, scene: Scene) -> None:
        """Solve on the grid of a scene with its own numerics from now on."""
        numerics = scene.numerics.model_copy(update={"tolerance": TOLERANCE})
        scene = scene.model_copy(update={"numerics": numerics})
        course, _ = wear_course(scene)
        grid = contact_grid(scene, largest_dose_mm_per_mpa=float(course.dose_mm_per_mpa[-1]))
        self._site, self._pressure = make_site(scene, grid), None
        self._kept = [scar.on(grid.nodes) for scar in self._kept]

    def wear(
        self,
        areas: list[float],
        now: tuple[float, float, float],
        *,
        scale: float,
        elastic_mm2: float,
    ) -> None:
        """Wear scars of some areas (mm², rising), on which `solve` puts its contacts.

        Beyond the first of them the contact wears on by the mean drive of as much before it.
        Parameters: `areas`; `now`, of the frame in hand: area by the law (mm²), line load (N/mm),
        friction; `scale`, areas over the law's; `elastic_mm2`, see `grow`.
        """
        assert self._site is not None
        drive = self._drive(now, scale)
        low, high = areas[0], areas[-1]
        if high > low:
            self._ahead = drive.mean(max(0.0, 2.0 * low - high), low)
            drive = drive.then(low, *self._ahead)
        start = WornScar(0.0, np.zeros(self._site.grid.nodes))
        last = 0.0
        if self._frames:
            if not self._kept:
                first = scale * self._frames[0][0]
                began = grow(self._site, start, drive, [first], elastic_mm2) if first > 0.0 else []
                self._kept = [scar for scar in began if first <= low]
            # what the last frame left is certain, and where the next scars begin
            last = min(low, scale * self._frames[-1][0])
            if low - last < SMALL * (low + elastic_mm2):
                last = low  # what the frame in hand adds is next to nothing
            start = next((s for s in reversed(self._kept) if s.worn_mm2 <= last), start)
        there = sorted({area for area in (last, *areas) if area > start.worn_mm2})
        grown = grow(self._site, start, drive, there, elastic_mm2)
        if last > start.worn_mm2:
            self._kept = _with_last(self._kept, grown[0])
            worn = [row[0] for row in self._frames]
            oldest = bisect_left(worn, _BACK * self._kept[0].worn_mm2 / scale)
            self._frames = self._frames[max(0, oldest - 1) :]
        self._scars = [start, *grown]
        self._low = min(self._scars, key=lambda one: abs(one.worn_mm2 - low))

    def lean(self, share: float, elastic_mm2: float) -> tuple[float, float]:
        """Wear on, by a step, under `share` of the mean load: what `solve` then stands on.

        From the lower end of the scars of `wear`. Returns the mean line load (N/mm) and the
        step's area (mm²).
        """
        assert self._site is not None and self._low is not None
        worn = self._low.worn_mm2
        step = STEP * (worn + elastic_mm2)
        load, friction = self._ahead
        drive = Drive(np.array([worn]), np.array([share * load]), np.array([friction]))
        self._scars = grow(self._site, self._low, drive, [worn + step], elastic_mm2)
        return load, step

    def solve(self, scene: Scene) -> SceneState:
        """The contact of a one-state scene under its own load on the scar of its own area."""
        assert self._site is not None and scene.load is not None
        assert scene.specimen.thickness_mm is not None
        line = scene.load_at(1.0) / scene.specimen.thickness_mm
        worn = 1e3 * scene.get(WEAR) * line if scene.wear else 0.0
        scar = min(self._scars, key=lambda one: abs(one.worn_mm2 - worn))
        mu = float(scene.friction_at(1.0)) if scene.friction else 0.0
        stop = OutputState(1.0, 0.0, line, mu)
        surface = elastic_state(self._site, scar.depth_mm, stop, start=self._pressure)
        self._pressure = surface.pressure_mpa
        return SceneState("", surface.distance_m, surface)

    def _drive(self, now: tuple[float, float, float], scale: float) -> Drive:
        """All that wore the contact until now, over the area worn: `scale` times the law's."""
        before = self._before
        assert before is not None
        first = self._frames[0][0] if self._frames else now[0]
        earlier = before.worn_mm2 <= first
        parts = (part[earlier] for part in before.columns)
        rows = [*zip(*parts, strict=True), *self._frames, now]
        worn, load, friction = (np.array(column) for column in zip(*rows, strict=True))
        still = np.flatnonzero(np.diff(worn) <= 0.0) + 1  # loads that change at one place
        worn[still] = worn[still - 1] * (1.0 + JUMP)
        return Drive(scale * worn, load, friction)


def drive_before(scene: Scene, distance_m: float, load_n: float, friction: float) -> Drive:
    """What wore a contact until a distance: the scene's tables, or what the first frame shows.

    Parameters: `scene`; `distance_m` of the first frame, and its own `load_n` and `friction`, held
    for all the time before where the scene has a number. Returns a Drive.
    """
    tables = [scene.get(LOAD), scene.get(FRICTION) if scene.friction else friction]
    s = np.array([0.0, distance_m])
    for value in tables:
        if isinstance(value, DistanceTable):
            s = np.concatenate((s, value.distance_m))
    s = np.unique(s[s <= distance_m])
    loads, mus = (isinstance(value, DistanceTable) for value in tables)
    assert scene.specimen.thickness_mm is not None
    load = np.array(scene.load_at(s)) if loads else np.full(len(s), load_n)
    return Drive(
        local_values(scene, tuple(s.tolist()))[:, 2],
        load / scene.specimen.thickness_mm,
        np.array(scene.friction_at(s)) if mus else np.full(len(s), friction),
    )
