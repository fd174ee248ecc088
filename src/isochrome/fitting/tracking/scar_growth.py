"""The scar that a tracked contact has worn so far, and what wore it.

A scar is stepped on from one that is known, never worn again from the start: some are kept on the
way, with the drive that wore them.
"""

from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from isochrome.contact import (
    ContactSetup,
    OutputState,
    contact_grid,
    elastic_state,
    make_site,
    wear_course,
)
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.unknowns import WEAR
from isochrome.fitting.tracking.scar_steps import JUMP, SMALL, STEP, Drive, Growth, WornScar, grow
from isochrome.scene import Scene
from isochrome.simulation import SceneState

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
        self,
        areas: list[float],
        now: tuple[float, float, float],
        *,
        scale: float,
        elastic_mm2: float,
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
