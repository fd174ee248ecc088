"""The scar that a tracked contact has worn so far, and how it grows.

Wear is followed over the worn area W itself: by dh = p dK and ∫p dx = P' a step of area takes the
dose dK = dW/P', whatever the law and its coefficient, which only say how far W has come. Each step
is implicit, h₁ = h₀ + dK p(h₁), under the mean load of its stretch; once whole and once in halves,
of which the first order's error is taken off, 2 h(halves) - h(whole): Hairer, Nørsett & Wanner
(1993), Solving ODEs I, section II.9. A scar is stepped on from one that is known, never worn again
from the start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import (
    Course,
    Site,
    Stop,
    elastic_constants,
    solve_pressure,
    worn_states,
)
from isochrome.errors import PhysicsError
from isochrome.scene import Scene

Array = NDArray[Any]

TOLERANCE = 1e-5
"""Of the wear from the unworn contact on: at 1e-4 a scar's own error is a load's uncertainty."""
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
        return (
            float(np.average(self._at(worn, self.line_load_n_per_mm), weights=weight)),
            float(np.average(self._at(worn, self.friction), weights=weight)),
        )

    def then(self, worn_mm2: float, line_load_n_per_mm: float, friction: float) -> Drive:
        """This up to a worn area (mm²), and from there on something else, constant."""
        kept = self.worn_mm2 < worn_mm2
        ends = np.array([worn_mm2, worn_mm2 * (1.0 + JUMP)])
        load, mu = (
            np.concatenate((row[kept], self._at(ends[:1], row), [new]))
            for row, new in (
                (self.line_load_n_per_mm, line_load_n_per_mm),
                (self.friction, friction),
            )
        )
        return Drive(np.concatenate((self.worn_mm2[kept], ends)), load, mu)

    def _at(self, worn_mm2: Array, row: Array) -> Array:
        return np.asarray(np.interp(worn_mm2, self.worn_mm2, row))


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
    site: Site, scar: WornScar, drive: Drive, areas: list[float], elastic_mm2: float
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


def _stepped(site: Site, scar: WornScar, drive: Drive, worn: float, elastic: float) -> WornScar:
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
    site: Site, scar: WornScar, drive: Drive, worn: float, start: Array | None
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


def _course(drive: Drive, areas: list[float]) -> tuple[Course, list[Stop]]:
    """Load and friction over the dose from the unworn contact on, and where areas are reached."""
    inside = (drive.worn_mm2 > 0.0) & (drive.worn_mm2 < areas[-1])
    there = np.concatenate(([0.0], drive.worn_mm2[inside], areas))
    load, friction = (
        np.concatenate((ends[:1], row[inside], ends[1:]))
        for row, ends in (
            (row, np.interp([0.0, *areas], drive.worn_mm2, row))
            for row in (drive.line_load_n_per_mm, drive.friction)
        )
    )
    order = np.argsort(there, kind="stable")
    there, load, friction = there[order], load[order], friction[order]
    grown = np.where(np.diff(there) > 2.0 * JUMP * there[1:], np.diff(there), 0.0)
    dose = np.concatenate(([0.0], np.cumsum(2.0 * grown / (load[1:] + load[:-1]))))
    jumps = np.unique(dose[1:][(np.diff(dose) <= 0.0) & (np.diff(load) != 0.0)])
    breaks = tuple(float(k) for k in jumps if 0.0 < k < dose[-1])
    course = Course(dose, dose, load, friction, breaks)
    at = dose[np.searchsorted(there, areas)].tolist()
    return course, [Stop(0.0, k, *course.at(k)) for k in at]


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
