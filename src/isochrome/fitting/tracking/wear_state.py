"""A scar that grows by steps of the worn area, and what wears it.

Wear is followed over the worn area W itself: by dh = p dK and ∫p dx = P' a step of area takes the
dose dK = dW/P', whatever the law and its coefficient, which only say how far W has come. Each step
is implicit, h₁ = h₀ + dK p(h₁), under the mean load of its stretch; once whole and once in halves,
of which the first order's error is taken off, 2 h(halves) - h(whole): Hairer, Nørsett & Wanner
(1993), Solving ODEs I, section II.9.

The scar that a tracked contact has worn so far, and what wore it.

A scar is stepped on from one that is known, never worn again from the start: some are kept on the
way, with the drive that wore them.

The scenes that tracked values stand for: what a frame shows now, on what was worn before.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
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
    wear_rate,
    worn_states,
)
from isochrome.errors import PhysicsError
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.single_state import scene_at
from isochrome.fitting.frame.unknowns import FRICTION, LEFT, LOAD, TOP, WEAR
from isochrome.fitting.frame_set import refuse_untracked
from isochrome.fitting.joint.frame_sequence import local_values
from isochrome.fitting.tracking.field_polynomial import CHECKED
from isochrome.scene import DistanceTable, Numerics, Scene
from isochrome.simulation import SceneState, scene_states

STEP, SMALL = 0.0075, 5e-4
"""Largest growth in a step, over the worn and the elastic area; below the second no halves are
needed."""

JUMP = 1e-9
"""Share of the worn area over which a load jumps: one value on arriving, another on leaving."""

_EQUATIONS = 1e-8
"""Tolerance of a step's contact."""


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
        selected = self.worn_mm2 < worn_mm2
        ends = np.array([worn_mm2, worn_mm2 * (1.0 + JUMP)])
        load, mu = (
            np.concatenate((row[selected], start, [new]))
            for row, start, new in zip(
                self.columns[1:], self.at(ends[:1]), (line_load_n_per_mm, friction), strict=True
            )
        )
        return Drive(np.concatenate((self.worn_mm2[selected], ends)), load, mu)


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
            raise PhysicsError("scar_wider_grid_raise")
        return WornScar(self.worn_mm2, self.depth_mm[-room:room])


_NEAR_END, _NEAR_DRIVE = 0.8, 1e-3
"""Share of a growth from which on a scar between its ends is one of both, and how much another load
or friction may differ: of a growth of a hundredth either leaves some millionths."""


@dataclass(frozen=True)
class Growth:
    """How a scar has grown to where a frame was looked for, `end`, from the last one's, `begun`.

    `drive`, line load (N/mm) and friction there. A frame's values are next to where they were
    looked for, and so is its scar: it is not worn again.
    """

    begun: WornScar
    end: WornScar
    drive: tuple[float, float]

    def towards(self, start: WornScar, worn_mm2: float, drive: tuple[float, float]) -> WornScar:
        """A scar that is nearer to an area than `start`, and not beyond it; else `start` itself."""
        low, high = self.begun.worn_mm2, self.end.worn_mm2
        share = (worn_mm2 - low) / (high - low)
        alike = np.allclose(drive, self.drive, rtol=_NEAR_DRIVE, atol=_NEAR_DRIVE)
        if start.worn_mm2 != low or share < _NEAR_END or not alike:
            return start
        if share >= 1.0:
            return self.end
        depth = self.begun.depth_mm + share * (self.end.depth_mm - self.begun.depth_mm)
        return WornScar(worn_mm2, depth, self.end.pressure_mpa)


def grow(
    site: ContactSetup, scar: WornScar, drive: Drive, areas: list[float], elastic_mm2: float
) -> list[WornScar]:
    """Scars of some areas, one worn out of the other.

    Parameters: `site`, the contact's grid; `scar`, on it, where the wear begins (area 0: unworn);
    `drive`; `areas` (m,), mm², rising, none below the scar's own; `elastic_mm2`, the area that the
    elasticity takes up. Returns m scars. Raises PhysicsError where a contact does not converge or
    reaches the edge of its grid.
    """
    if not areas:
        return []
    if scar.worn_mm2 <= 0.0:
        course, stops = _course(drive, areas)
        states = list(worn_states(site, course, stops))
        result = [
            WornScar(area, state.wear_depth_mm, state.pressure_mpa)
            for area, state in zip(areas, states, strict=True)
        ]
    else:
        result = []
        for area in areas:
            count = math.ceil((area - scar.worn_mm2) / (STEP * (area + elastic_mm2)) - 1e-6)
            for worn in np.linspace(scar.worn_mm2, area, max(1, count) + 1)[1:].tolist():
                scar = _stepped(site, scar, drive, worn, elastic_mm2)
            result.append(scar)
    if any(one.depth_mm[[0, -1]].any() for one in result):
        raise PhysicsError("scar_reaches_edge_grid", name=site.scene.name)
    return result


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
        site.surface, site.gap_mm + scar.depth_mm, load, friction=friction, wear_mm_per_mpa=dose,
        start=start, tolerance=_EQUATIONS,
    )  # fmt: skip
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


TOLERANCE = 1e-5
"""Of the wear from the unworn contact on: at 1e-4 a scar's own error is a load's uncertainty."""

_NEW, _OLD = 250, 500
"""Frames of the past that a state holds one by one, and points that stand for all before."""

_SCARS = 4
"""Last scars that are kept: a worn area that is tracked falls back behind them by its noise."""

_APART, _BACK = 0.01, 0.1
"""Growth from one to the next of the older ones, and how far back they are kept, and the frames
that wore them, over the worn and elastic area: a box of worn areas begins up to 0.012 of that
behind the last, and a scar that is not stepped on from one below it would lack what wore it."""


_ROOT, _ALIKE = 0.9, 1e-3
"""Share of a long wear's area from which its scars are worn in few steps, and how much another
scale may shift its loads."""


def _with_one_more(kept: list[WornScar], more: WornScar, elastic_mm2: float) -> list[WornScar]:
    """Scars by their areas with one more: the last ones, and some as far back as boxes reach."""
    every = sorted([*kept, more], key=lambda scar: scar.worn_mm2)
    older: list[WornScar] = []
    for scar in every[:-_SCARS]:
        if not older or _grown(older[-1], scar, elastic_mm2) > _APART:
            older.append(scar)
    while len(older) > 1 and _grown(every[-1], older[1], elastic_mm2) < -_BACK:
        older.pop(0)
    return [*older, *every[-_SCARS:]]


def _grown(scar: WornScar, other: WornScar, elastic_mm2: float) -> float:
    """Growth from a scar to another over the first one's worn and elastic area."""
    return (other.worn_mm2 - scar.worn_mm2) / (scar.worn_mm2 + elastic_mm2)


class TrackPast:
    """The course of a worn contact up to the frame that is being tracked, and what it has worn."""

    def __init__(self) -> None:
        self._before: Drive | None = None
        self._frames: list[tuple[float, float, float]] = []
        self._kept: list[WornScar] = []
        self._aside: list[WornScar] = []
        self._root: tuple[Array, float, WornScar] | None = None
        self._scars: list[WornScar] = []
        self._low: WornScar | None = None
        self._ahead_of: Growth | None = None
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
        self._ahead_of = None
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
        self._aside, self._root, self._ahead_of = [], None, None

    def wear(
        self, areas: list[float], now: tuple[float, float, float], scale: float, elastic_mm2: float
    ) -> None:
        """Wear scars of some areas (mm², rising), on which `solve` puts its contacts.

        Beyond the first of them the contact wears on by the drive of the frame in hand, before a
        first frame by what wore it until then: what more or less has worn shows as that does.
        Parameters: `areas`; `now`, of the frame in hand: area by the law (mm²), line load (N/mm),
        friction; `scale`, areas over the law's; `elastic_mm2`, see `grow`.
        """
        assert self._site is not None
        drive = self._drive(now, scale)
        low, high = areas[0], areas[-1]
        if high > low:
            self._ahead = now[1:] if self._frames else drive.mean(0.0, low)
            drive = drive.then(low, *self._ahead)
        start = WornScar(0.0, np.zeros(self._site.grid.nodes))
        last = 0.0
        if self._frames:
            if not self._kept:
                first = scale * self._frames[0][0]
                wanted = [first] if 0.0 < first <= low else []
                self._kept = grow(self._site, start, drive, wanted, elastic_mm2)
            # what the last frame left is certain, and where the next scars begin
            last = min(low, scale * self._frames[-1][0])
            if low - last < SMALL * (low + elastic_mm2):
                last = low  # what the frame in hand adds is next to nothing
            start = next((s for s in reversed(self._kept) if s.worn_mm2 <= last), start)
            if self._ahead_of is not None:
                start = self._ahead_of.towards(start, last, self._frames[-1][1:])
                if self._kept and start.worn_mm2 == last > self._kept[-1].worn_mm2:
                    self._kept = _with_one_more(self._kept, start, elastic_mm2)
        if self._ahead_of is not None and low == high:
            start = self._ahead_of.towards(start, low, now[1:])
        if start.worn_mm2 == 0.0 < low and _ROOT * high < low:
            start = self._rooted(drive, scale, low, elastic_mm2)
        there = sorted({area for area in (last, *areas) if area > start.worn_mm2})
        grown = grow(self._site, start, drive, there, elastic_mm2)
        if last > start.worn_mm2:
            self._kept = _with_one_more(self._kept, grown[0], elastic_mm2)
            worn = [row[0] for row in self._frames]
            behind = self._kept[0].worn_mm2 - _BACK * (last + elastic_mm2)
            oldest = bisect_left(worn, behind / scale)
            self._frames = self._frames[max(0, oldest - 1) :]
        if low == high and grown and last < low:
            begun = grown[0] if len(grown) > 1 else start
            self._ahead_of = Growth(begun, grown[-1], now[1:])
        self._scars = [start, *grown]
        self._low = min(self._scars, key=lambda one: abs(one.worn_mm2 - low))

    def _rooted(self, drive: Drive, scale: float, low: float, elastic_mm2: float) -> WornScar:
        """A scar below an area, of what wore the contact before its first frame: made once."""
        assert self._site is not None and self._before is not None
        before = np.array(self._before.columns)
        if self._root is not None:
            known, its_scale, scar = self._root
            alike = np.array_equal(known, before) and abs(scale / its_scale - 1.0) < _ALIKE
            if alike and scar.worn_mm2 <= low:
                return scar
        unworn = WornScar(0.0, np.zeros(self._site.grid.nodes))
        (scar,) = grow(self._site, unworn, drive, [_ROOT * low], elastic_mm2)
        self._root = before, scale, scar
        return scar

    @contextmanager
    def as_it_is(self) -> Iterator[None]:
        """Wear and solve within this: what is worn here serves the next time, here alone."""
        own = dict(vars(self))
        worn = self._kept[-1].worn_mm2 if self._kept else np.inf
        self._kept = [*self._kept, *(scar for scar in self._aside if scar.worn_mm2 > worn)]
        try:
            yield
        finally:
            vars(self).update(own | {"_aside": self._kept[-1:], "_root": self._root})

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


WORN = "worn area (mm²)"
"""The axis that stands for all the wear until a frame."""

TRACKED = (LOAD, "load.tangential_n", "load.bulk_mpa", FRICTION, WEAR, LEFT, TOP)
"""Keys that can be tracked: what the mechanics follow smoothly, and the place."""

_PLACES = (-1.0, -CHECKED, 0.0, CHECKED, 1.0)
"""Where along the worn area a polynomial is made and checked, in half-widths."""
_NO_WEAR = 1e-9
"""Worn area, over what the elasticity takes up, that is none: below any rounding of a gap."""

_BOX = {FRICTION: 0.05, "load.bulk_mpa": 0.3}
_OF_LOAD, _OF_WEAR, _PLACE_PX, _BEHIND, _ROUNDING = 0.12, 0.1, 1.5, 0.2, 0.02
"""Half-widths of a box, over its size: loads swing and scars grow more than a camera moves, and a
polynomial errs most by the place."""


class TrackCourse:
    """One-state scenes of a contact along a run, by the values of `axes`.

    Attributes: `axes`, what moves the field: the tracked keys (of the wear, the worn area), then
    what the scene knows to change; `count`, how many of them are tracked; `places`, those that only
    move the contact in the picture; `numerics`, of the grid in use, None before there is one;
    `past_load_n`, the load before the first frame, None for that frame's own.
    """

    def __init__(self, scene: Scene, keys: tuple[str, ...]) -> None:
        """`scene`, placed in its picture. Raises InputError for what cannot be tracked."""
        refuse_untracked(scene, keys, TRACKED)
        self.scene, self.keys, self.count = scene, keys, len(keys)
        axes = [WORN if key == WEAR else key for key in keys]
        self._base = scene if scene.wear else scene_at(scene, 0.0)
        if scene.wear is not None:
            axes += [key for key in (LOAD, FRICTION) if key not in keys and _table(scene, key)]
            axes += [] if WEAR in keys else [WORN]
        self.axes = tuple(axes)
        self._at = axes.index(WORN) if WORN in axes else -1
        self.places = tuple(j for j, axis in enumerate(axes) if axis in (LEFT, TOP))
        self._past = TrackPast()
        self._worn, self._area, self._slid, self._now = 0.0, 0.0, 0.0, 0.0
        self._moment = 0.0
        self._last: tuple[float, float] | None = None
        self.numerics: Numerics | None = None
        self.past_load_n: float | None = None

    @property
    def unsure(self) -> bool:
        """Whether another load may have worn the contact before the first frame than that one's."""
        worn = self.scene.wear is not None and self._now > 0.0 and self._last is None
        return worn and LOAD in self.keys and not _table(self.scene, LOAD)

    def _begin(self, values: Array) -> None:
        """Tell the history what wore the contact before its first frame, of some values (axes,)."""
        if self._last is None:
            friction = self._value(FRICTION, values, self._now)
            drive = _drive_before(self.scene, self._now, self.load_before(values), friction)
            # worn by the load that it was, up to what it is in this frame: no ramp to its own
            area, law = self._area_at(values), drive.worn_mm2[-1]
            worn = np.minimum(drive.worn_mm2 * (area / law if law > 0.0 else 1.0), area)
            self._past.begin(replace(drive, worn_mm2=worn))

    def state(self) -> dict[str, Any]:
        """The history up to the last frame, as plain numbers for `resume`."""
        grid = None if self.numerics is None else self.numerics.model_dump()
        course = [self._worn, self._area, self._slid, self._now, self._moment]
        return {"course": course, "last": self._last, "grid": grid, "past": self._past.state()}

    def resume(self, state: dict[str, Any]) -> None:
        """Go on from a `state`."""
        self._worn, self._area, self._slid, self._now, self._moment = state["course"]
        last, grid = state["last"], state["grid"]
        self._last = None if last is None else (last[0], last[1])
        self.numerics = None if grid is None else Numerics(**grid)
        self._past.resume(state["past"])

    def start(self, distance_m: float | None) -> Array:
        """The scene's own values (axes,) at a distance (m), and so its history's."""
        self._now = distance_m or 0.0
        return np.array([self._own(axis, distance_m) for axis in self.axes])

    def with_past(self, values: Array, past_n: float) -> Array:
        """The values (axes,) of a first frame if another load (N) wore it than the one so far."""
        result = self.moved(values, np.zeros(self.count))
        if WORN in self.axes:
            result[self._at] *= past_n / self.load_before(values)
        return result

    def carried(self, values: Array, distance_m: float | None) -> Array:
        """The last frame's tracked values with what is known of the next frame's distance (m)."""
        self._now = distance_m or 0.0
        result = values.copy()
        for j in range(self.count, len(self.axes)):
            if self.axes[j] != WORN:
                result[j] = self._own(self.axes[j], distance_m)
        if WORN in self.axes:
            area = self._area_at(result)
            # before anything has worn, the scene's own coefficient is where to start
            result[self._at] = area * (self._worn / self._area if self._area > 0.0 else 1.0)
        return self.moved(result, np.zeros(self.count))

    def passed(self, values: Array, distance_m: float | None) -> None:
        """Take a frame's values into the history of those that follow."""
        if self.scene.wear is None:
            return
        s = distance_m or 0.0
        load, friction = (self._value(key, values, s) for key in (LOAD, FRICTION))
        self._begin(values)
        self._area, self._moment = self.mark(values)
        self._past.passed(self._area, self._line_load(load), friction)
        self._worn, self._slid = self._value(WORN, values, s), s
        self._last = (load, friction)

    def load_before(self, values: Array) -> float:
        """The load (N) that wore the contact before its first frame, of some values (axes,)."""
        own = self._value(LOAD, values, self._now)
        return own if self.past_load_n is None else self.past_load_n

    def reported(self) -> Array:
        """Factors (tracked,) from the last frame's axes to the keys: area to wear coefficient."""
        factors = np.ones(self.count)
        if WEAR in self.keys:
            k = float(self.scene.wear_coefficient_at(self._slid))
            factors[self.keys.index(WEAR)] = k / self._area if self._area > 0.0 else np.nan
        return factors

    def _area_at(self, values: Array) -> float:
        """Area (mm²) worn by the scene's law until now, by the loads and frictions so far."""
        load, friction = (self._value(key, values, self._now) for key in (LOAD, FRICTION))
        if self._last is None:
            area, own = self._own(WORN, self._now), self._own(LOAD, self._now)
            return area if _table(self.scene, LOAD) else area * self.load_before(values) / own
        ends = ((*self._last, self._slid), (load, friction, self._now))
        law = self.scene.wear
        assert law is not None
        rates = [1e3 * float(wear_rate(law, mu, at)) * self._line_load(p) for p, mu, at in ends]
        return self._area + max(0.0, self._now - self._slid) * 0.5 * sum(rates)

    def grown(self, values: Array, others: Array) -> tuple[float, float]:
        """Growth of the scar since other values (axes,) and since the last frame.

        Over what is worn and elastic; 0 where nothing wears.
        """
        if WORN not in self.axes:
            return 0.0, 0.0
        worn = values[self._at]
        whole = worn + self._elastic_area(self._value(LOAD, values, self._now))
        return abs(worn - others[self._at]) / whole, abs(worn - self._worn) / whole

    def use(self, scene: Scene) -> None:
        """Solve on the grid of the widest scene so far, with its own numerics, from now on."""
        self.numerics = scene.numerics
        if self.scene.wear is not None:
            self._past.use(scene)

    def wear(self, values: Array, low: Array, high: Array) -> None:
        """Wear the scars of a box for `solve`, or, where its ends are the values, theirs alone.

        Parameters: `values` (axes,) of the frame in hand; `low`, `high` (axes,), the box's ends.
        """
        if self.scene.wear is None:
            return
        area = self._area_at(values)
        load, friction = (self._value(key, values, self._now) for key in (LOAD, FRICTION))
        self._begin(values)
        at = self._at
        middle, half = 0.5 * (low[at] + high[at]), 0.5 * (high[at] - low[at])
        self._past.wear(
            sorted({float(middle + t * half) for t in _PLACES}),
            (area, self._line_load(load), friction),
            scale=float(values[at] / area) if area > 0.0 else 1.0,
            elastic_mm2=self._elastic_area(load),
        )

    def mark(self, values: Array) -> tuple[float, float]:
        """Area A (mm²) worn by the scene's law until now, and ∫P' dA since the first frame."""
        if self.scene.wear is None:
            return 0.0, 0.0
        area = self._area_at(values)
        if self._last is None:
            return area, 0.0
        line = self._line_load(self._last[0] + self._value(LOAD, values, self._now))
        return area, self._moment + 0.5 * line * (area - self._area)

    def lean(self, share: float, values: Array) -> tuple[float, float]:
        """See `TrackPast.lean`."""
        return self._past.lean(share, self._elastic_area(self._value(LOAD, values, self._now)))

    def solve(self, scene: Scene) -> SceneState:
        """The contact of a `field_scene` on the scar that its history has worn."""
        return scene_states(scene)[-1] if self.scene.wear is None else self._past.solve(scene)

    def whole_state(self, values: Array) -> tuple[Scene, SceneState]:
        """The scene of the values (axes,) of the last frame that `passed`, and its contact.

        The history stays as it is. Raises PhysicsError where the contact cannot be solved.
        """
        scene = self.field_scene(values).model_copy(update={"numerics": self.numerics})
        with self._past.as_it_is():
            self.wear(values, values, values)
            # on nodes that divide the pixels where the track began
            return scene, self.solve(scene.model_copy(update={"camera": self.scene.camera}))

    def moved(self, values: Array, step: Array) -> Array:
        """Values (axes,) after a step (count,) of the tracked ones; no worn area below zero.

        A worn area that is not tracked is what the frame's load and friction wear until it.
        """
        result = values.copy()
        result[: self.count] += step
        if WORN in self.axes:
            worn = result[self._at]
            result[self._at] = max(0.0, worn) if self._at < self.count else self._area_at(result)
        return result

    def field_scene(self, values: Array) -> Scene:
        """The one-state scene of some values (axes,), worn as if under its own load all the time.

        `solve` puts it on the scar of its history.
        """
        given = dict(zip(self.axes, values.tolist(), strict=True))
        worn = given.pop(WORN, None)
        if worn is None:
            return self._base.with_values(given)
        load, friction = (self._value(key, values, self._now) for key in (LOAD, FRICTION))
        given[LOAD] = load
        if self.scene.friction:
            given[FRICTION] = friction
        if worn <= _NO_WEAR * self._elastic_area(load):
            return self.scene.model_copy(update={"wear": None}).with_values(given)
        coefficient = worn / (1e3 * self._line_load(load))
        even = {WEAR: coefficient, "wear.law": "archard", "wear.distances_m": [1.0]}
        return self.scene.with_values(given | even)

    def from_scene(self, scene: Scene, values: Array, distance_m: float | None) -> Array:
        """The values (axes,) of a fitted scene at a distance; what it does not hold is kept."""
        result = values.copy()
        for j, axis in enumerate(self.axes):
            if axis != WORN:
                result[j] = scene.get(axis)
            elif scene.wear is not None:
                result[j] = local_values(scene, (distance_m or 0.0,))[0, 2]
        return result

    def box(self, values: Array, size: float) -> tuple[Array, Array, tuple[int, ...]]:
        """Low and high ends (axes,) of a box of values, and the degrees of its polynomial.

        `size`, of the box, over the usual one.
        """
        assert self.scene.camera is not None and self.scene.camera.pixel_mm is not None
        pixels = _PLACE_PX * self.scene.camera.pixel_mm
        load = self._value(LOAD, values, self._now)
        low, high, degrees = values.copy(), values.copy(), []
        for j, axis in enumerate(self.axes):
            # a worn contact's is held to the exact field again and again, and only its slopes count
            degrees.append(2 if axis == "load.bulk_mpa" or WORN in self.axes else 4)
            if axis == WORN:
                half = size * _OF_WEAR * (values[j] + self._elastic_area(load))
                behind = _BEHIND if j < self.count else _ROUNDING
                low[j] = max(0.0, values[j] - behind * half)
                high[j] = low[j] + 2.0 * half  # a scar only grows
                continue
            half = size * (pixels if j in self.places else _BOX.get(axis, _OF_LOAD * load))
            low[j], high[j] = values[j] - half, values[j] + half
        return low, high, tuple(degrees)

    def _elastic_area(self, load: float) -> float:
        return elastic_area(self.scene, self._line_load(load))

    def _line_load(self, load: float) -> float:
        assert self.scene.specimen.thickness_mm is not None
        return load / self.scene.specimen.thickness_mm

    def _value(self, axis: str, values: Array, distance_m: float) -> float:
        if axis in self.axes:
            return float(values[self.axes.index(axis)])
        return self._own(axis, distance_m)

    def _own(self, axis: str, distance_m: float | None) -> float:
        """The scene's own value of an axis at a distance."""
        s = distance_m or 0.0
        if axis == WORN:
            return float(local_values(self.scene, (s,))[0, 2])
        if axis == LOAD:
            return self.scene.load_at(s)
        if axis == FRICTION:
            return float(self.scene.friction_at(s)) if self.scene.friction else 0.0
        return float(self.scene.get(axis))


def _table(scene: Scene, key: str) -> bool:
    there = key == LOAD or scene.friction is not None
    return there and isinstance(scene.get(key), DistanceTable)


def _drive_before(scene: Scene, distance_m: float, load_n: float, friction: float) -> Drive:
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
