"""What was tracked so far: the drive that wore a contact, and the scars kept on the way."""

from __future__ import annotations

from bisect import bisect_left
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import Site, Stop, contact_grid, elastic_state, make_site, wear_course
from isochrome.fit.history import local_values
from isochrome.fit.sequence import COURSE, FRICTION, WEAR
from isochrome.fit.track_scar import JUMP, SMALL, STEP, TOLERANCE, Drive, WornScar, grow
from isochrome.scene import DistanceTable, Scene
from isochrome.simulate import SceneState

Array = NDArray[Any]

LOAD = COURSE[0]

_NEW, _OLD = 250, 500
"""Frames of the past that a state holds one by one, and points that stand for all before."""
_SCARS = 4
"""Scars that are kept: a worn area that is tracked falls back behind the last by its noise."""
_BACK = 0.9
"""Share of the oldest one's area from which on frames are remembered."""


class TrackPast:
    """The course of a worn contact up to the frame that is being tracked, and what it has worn."""

    def __init__(self) -> None:
        self._before: Drive | None = None
        self._frames: list[tuple[float, float, float]] = []
        self._kept: list[WornScar] = []
        self._scars: list[WornScar] = []
        self._low: WornScar | None = None
        self._ahead = (0.0, 0.0)
        self._site: Site | None = None
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
            self._kept = [*self._kept, grown[0]][-_SCARS:]
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
        stop = Stop(1.0, 0.0, line, mu)
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
