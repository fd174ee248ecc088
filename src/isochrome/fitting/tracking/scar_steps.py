"""A scar that grows by steps of the worn area, and what wears it.

Wear is followed over the worn area W itself: by dh = p dK and ∫p dx = P' a step of area takes the
dose dK = dW/P', whatever the law and its coefficient, which only say how far W has come. Each step
is implicit, h₁ = h₀ + dK p(h₁), under the mean load of its stretch; once whole and once in halves,
of which the first order's error is taken off, 2 h(halves) - h(whole): Hairer, Nørsett & Wanner
(1993), Solving ODEs I, section II.9.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from isochrome.contact import ContactSetup, OutputState, SlidingHistory, solve_pressure, worn_states
from isochrome.errors import PhysicsError
from isochrome.fitting.arrays import Array

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
