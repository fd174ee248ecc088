"""What a contact's frames stand on, one after the other: a grid, and the scar that was worn so far.

A frame shows its own load and friction on what was worn before. The scar goes on from the last
frame's by the dose of the scene's law, dK = ∫ kappa ds, while load and friction go over to the
frame's. What wore the contact before the first frame are the scene's tables, or a course of loads
that that frame tells: a scar remembers the last loads by its edges, and the others by its depth.

The worn area is W = ∫ P' dK. By the scene's own coefficient it would be A: a wear coefficient that
is tracked is W/A times that.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np

from isochrome.contact import (
    ContactSetup,
    Drive,
    GrowingScar,
    OutputState,
    contact_grid,
    elastic_constants,
    elastic_state,
    make_site,
    mean_state,
    slice_loads,
    wear_course,
    wear_rate,
    worn_states,
)
from isochrome.errors import InputError, PhysicsError
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.single_state import is_held, with_between, with_numerics, with_part
from isochrome.fitting.frame.unknowns import FRICTION, LEFT, LOAD, TOP, WEAR
from isochrome.fitting.joint.frame_sequence import local_values
from isochrome.scene import DistanceTable, Scene
from isochrome.simulation import SceneState, scene_states

_TO_GO = (*(10.0**-k for k in range(4)), 0.0)
PAST = tuple(f"load before the first frame, {s:g} of the wear to go (N)" for s in _TO_GO[1:-1])
"""Loads that wore a contact before its first frame, constant from the beginning to the first of
these places and linear from there to the frame's own: unknowns of that frame."""

TRACKED = (LOAD, "load.tangential_n", "load.bulk_mpa", FRICTION, WEAR, LEFT, TOP)
"""Keys that can be tracked: what the mechanics follow smoothly, and the place."""

TOLERANCE, GROWTH = 1e-5, 3e-4
"""Of the wear until the first frame: at 1e-4 a scar's own error is a load's uncertainty; and of
that from a frame to the next, which at 1e-3 errs by five of a wear coefficient's, in fine noise."""

_STEP, _STEP_BEFORE = 1e-3, 0.03
"""Of a dose and what the elasticity makes up for, and of a load before the first frame: shows what
more of it does. The last of these have worn little, of which a scar errs by its tolerance."""

_RIM, _WIDER, _WIDENED = 0.04, 1.3, 5
"""Share of the grid that a contact leaves free at either end, or is solved on one so much wider, at
most so often."""


class Worn(NamedTuple):
    """What wears until a frame: the distance (m), and the area (mm²) by the law and as it is."""

    distance_m: float = 0.0
    law_mm2: float = 0.0
    worn_mm2: float = 0.0


def of_slice(drive: Drive, share: float) -> Drive:
    """The drive of a slice with a share of the mean load."""
    return drive._replace(line_load_n_per_mm=share * drive.line_load_n_per_mm)


class SlicedScar(NamedTuple):
    """The scars of the slices through the thickness, one without a tilt, whose mean is under a
    drive; `loads`, of the slices over their mean.
    """

    drive: Drive
    loads: tuple[float, ...]
    parts: tuple[GrowingScar, ...]

    @property
    def depth_mm(self) -> Array:
        """Worn depth (slices, n), mm."""
        return np.stack([part.depth_mm for part in self.parts])

    def drives(self, drive: Drive) -> list[Drive]:
        """The slices' drives of a mean one."""
        return [of_slice(drive, share) for share in self.loads]

    def _each(self, drive: Drive, parts: Iterable[GrowingScar]) -> SlicedScar:
        return self._replace(drive=drive, parts=tuple(parts))

    def grown(
        self, site: ContactSetup, dose_mm_per_mpa: float, drive: Drive, *, tolerance: float
    ) -> SlicedScar:
        """As `GrowingScar.grown`, each slice by its own pressure."""
        pairs = zip(self.parts, self.drives(drive), strict=True)
        return self._each(
            drive, (s.grown(site, dose_mm_per_mpa, d, tolerance=tolerance) for s, d in pairs)
        )

    def under(self, drive: Drive) -> SlicedScar:
        """The same under another drive."""
        pairs = zip(self.parts, self.drives(drive), strict=True)
        return self._each(drive, (replace(part, drive=own) for part, own in pairs))

    def deeper(self, by_mm: Array) -> SlicedScar:
        """The same, worn deeper (slices, n) mm."""
        pairs = zip(self.parts, by_mm, strict=True)
        return self._each(
            self.drive, (replace(part, depth_mm=part.depth_mm + by) for part, by in pairs)
        )

    def on(self, nodes: int) -> SlicedScar:
        """As `GrowingScar.on`."""
        return self._each(self.drive, (part.on(nodes) for part in self.parts))

    def to_json(self) -> dict[str, Any]:
        """Plain numbers for `from_json`."""
        return self._asdict() | {"parts": [part.to_json() for part in self.parts]}

    @classmethod
    def from_json(cls, plain: dict[str, Any]) -> SlicedScar:
        """The scars of some plain numbers."""
        parts = tuple(GrowingScar.from_json(part) for part in plain["parts"])
        return cls(Drive(*plain["drive"]), tuple(plain["loads"]), parts)


class WornCourse:
    """One-state scenes of a contact along a run, by the values of `keys`. `tracked`, the keys that
    are reported; `now`, the scene of the frame in hand without its wear; `past`, the loads (k,)
    before the first frame and their covariance (k, k), once that told them.
    """

    def __init__(self, scene: Scene, tracked: tuple[str, ...]) -> None:
        """`scene`, placed in its picture. Raises InputError for what cannot be tracked."""
        if not scene.is_contact:
            raise InputError("cannot_tracked_only_contacts", model=scene.model)
        if unknown := [key for key in tracked if key not in TRACKED]:
            known = ", ".join(TRACKED)
            raise InputError("cannot_tracked_video_frames", key=unknown[0], known=known)
        if scene.friction and scene.friction.static_state_first:
            raise InputError("friction_static_state_first_true_tracked")
        self.scene, self.tracked = scene, tracked
        self._thickness_mm = float(scene.get("specimen.thickness_mm"))
        self.past: tuple[Array, Array] | None = None
        self._by_past: dict[str, Array] = {}  # worn depth (slices, n) by each of those loads
        self._site: ContactSetup | None = None
        self._pressures: list[Array] = []  # of the slices, (n,) each
        self._last: SlicedScar | None = None  # that the frame before has left
        self._scar: SlicedScar | None = None  # that the frame in hand stands on
        self._until = self.after = Worn()  # of the last frame, and in hand
        self._share = 1.0  # of the law, by which the contact wears on
        self.at(None)

    def state(self) -> dict[str, Any]:
        """What is left of the frames so far, as plain numbers for `resume`."""
        last, site, past = self._last, self._site, self.past
        return {
            "last": last and last.to_json(), "until": self._until, "share": self._share,
            "grid": site and site.scene.numerics.model_dump(),
            "past": past and [part.tolist() for part in past],
            "by_past": {key: depth.tolist() for key, depth in self._by_past.items()},
        }  # fmt: skip

    def resume(self, state: dict[str, Any]) -> None:
        """Go on from a `state`."""
        last, past = state["last"], state["past"]
        self._until, self._share = Worn(*state["until"]), state["share"]
        self.past = past and (np.array(past[0]), np.array(past[1]))
        self._by_past = {key: np.array(depth) for key, depth in state["by_past"].items()}
        if state["grid"] is not None:
            self._use(with_part(self.now, "numerics", **state["grid"]))
        self._last = last and SlicedScar.from_json(last)

    def at(self, distance_m: float | None) -> None:
        """Go on to a frame, at a distance (m), None where nothing wears."""
        self._s = s = distance_m or 0.0
        now = with_part(with_between(self.scene, s), "load", normal_n=self.scene.load_at(s))
        if now.friction is not None:
            now = with_part(now, "friction", coefficient=float(self.scene.friction_at(s)))
        self.now = now.model_copy(update={"wear": None})

    @property
    def keys(self) -> tuple[str, ...]:
        """The unknowns of the frame in hand."""
        worn = self.scene.wear is not None and self._last is None and self._s > 0.0
        unsure = worn and LOAD in self.tracked and not self._is_table(LOAD)
        return (*self.tracked, *PAST) if unsure else self.tracked

    def own_values(self) -> Array:
        """The scene's own values (tracked,) at the frame in hand."""
        return np.array(
            [self._own_wear if key == WEAR else self.now.get(key) for key in self.tracked], float
        )

    def fitted(self, scene: Scene, distance_m: float, usual_load_n: float) -> Array:
        """The frame's values (keys,) by a fitted scene of its own, worn until a distance (m) there.
        `usual_load_n`, about the load that wore the contact before its first frame.
        """
        values = self.own_values()
        for j, key in enumerate(self.tracked):
            values[j] = values[j] if key == WEAR else scene.get(key)
        values = np.append(values, np.full(len(self.keys) - len(values), usual_load_n))
        if WEAR in self.tracked and scene.wear is not None:
            law = self._areas(values)[1]
            if law > 0.0:
                shown = float(local_values(scene, (distance_m,))[0, 2])
                values[self.tracked.index(WEAR)] = self._own_wear * shown / law
        return values

    def moved(self, keys: tuple[str, ...], values: Array) -> Scene:
        """The frame's scene with some values at its keys, on the scar that it stands on."""
        scene = self.now
        for key, value in zip(keys, np.asarray(values, float).tolist(), strict=False):
            part, _, name = key.partition(".")
            if key not in (WEAR, *PAST):  # unchecked: it is asked for many times a frame
                scene = with_part(scene, part, **{name: value})
        return scene

    def take(self, values: Array) -> Array:
        """Wear the contact until the frame in hand, by some values of its `keys`. Returns the
        values that the scar stands for: of a wear coefficient, what has worn until now. Raises
        PhysicsError where a contact does not converge.
        """
        self.after, drive = self._areas(values), self._drive(values)
        if self._site is None:
            self._use(with_numerics(self.even_scene(values)))
        if self._last is None:
            self._scar = self._worn_before(values)
        else:
            dose = self._share * self._dose(drive[1])
            self._scar = self._last
            if dose > 0.0:
                self._scar = self._last.grown(self.site, dose, drive, tolerance=GROWTH)
        place, (_, law, worn) = np.array(values, float), self.after
        if WEAR in self.tracked and law > 0.0:
            place[self.tracked.index(WEAR)] = self._own_wear * worn / law
        return place

    def passed(self, values: Array) -> None:
        """Leave the frame in hand with its values (keys,): the next goes on from its scar."""
        assert self._scar is not None
        if WEAR in self.tracked and self.after[1] > 0.0:
            self._share = max(0.0, values[self.tracked.index(WEAR)] / self._own_wear)
        self._last, self._until = self._scar.under(self._drive(values)), self.after

    @contextmanager
    def beside(self, key: str, values: Array) -> Iterator[float]:
        """Stand, within this, on what a step of a key more has worn; gives the step, nought: none.
        `values` (keys,), for which the frame's own scar was taken.
        """
        scar, step, (_, law, worn) = self._scar, 0.0, self.after
        assert scar is not None
        if key in PAST:
            k = PAST.index(key) - len(PAST)
            step = _STEP_BEFORE * (values if self.past is None else self.past[0])[k]
            if self.past is None:
                more = values.copy()
                more[k] += step
                self._by_past[key] = (self._worn_before(more).depth_mm - scar.depth_mm) / step
            self._scar = scar.deeper(step * self._by_past[key])
        elif self._last is None and law > 0.0:
            more = values.copy()
            more[self.tracked.index(WEAR)] *= 1.0 + _STEP
            step = _STEP * self._value(WEAR, values)
            self._scar = self._worn_before(more)
        elif law > 0.0:
            drive = self._drive(values)
            line = drive.line_load_n_per_mm
            dose = _STEP * (worn + self._elastic_mm2(values)) / line
            self._scar = scar.grown(self.site, dose, drive, tolerance=GROWTH)
            step = self._own_wear * dose * line / law
        try:
            yield step
        finally:  # a wider grid may have been asked for meanwhile
            self._scar = scar.on(self.site.grid.nodes)

    def solve(self, scene: Scene) -> SceneState:
        """The contact of a scene of the frame in hand, under its own load on the frame's scar."""
        if is_held(scene):
            return scene_states(scene.model_copy(update={"numerics": self.site.scene.numerics}))[-1]
        line = scene.load_at(0.0) / self._thickness_mm
        mu = float(scene.friction_at(0.0)) if scene.friction else 0.0
        drive = Drive(line, mu, scene.layer_at(self._s), scene.roughness_at(self._s))
        for _ in range(_WIDENED):
            assert self._scar is not None
            stops = [OutputState(self._s, 0.0, *own) for own in self._scar.drives(drive)]
            slices = zip_longest(self._scar.depth_mm, stops, self._pressures)
            states = tuple(
                elastic_state(self.site, depth, stop, start=start) for depth, stop, start in slices
            )
            rim, surface = int(_RIM * self.site.grid.nodes), mean_state(scene, states)
            self._pressures = [state.pressure_mpa for state in states]
            pressure = surface.pressure_mpa
            if not (pressure[:rim].any() or pressure[-rim:].any()):
                return SceneState("", self._s, surface)
            width = _WIDER * surface.grid.spacing_mm * surface.grid.nodes
            self._use(with_part(self.site.scene, "numerics", window_mm=width))
        raise PhysicsError("scar_reaches_edge_grid", name=scene.name)

    def even_scene(self, values: Array) -> Scene:
        """The frame's scene, worn as much as it is, as if under its own load over one metre."""
        scene, worn = self.moved(self.tracked, values), self._areas(values)[2]
        if self.scene.wear is None or not worn > 0.0:
            return scene
        coefficient = 1e-3 * worn / self._drive(values)[0]
        even = {WEAR: coefficient, "wear.law": "archard", "wear.distances_m": [1.0]}
        return scene.model_copy(update={"wear": self.scene.wear}).with_values(even)

    @property
    def begun(self) -> bool:
        """Whether a frame has passed."""
        return self._last is not None

    def grown(self, since_mm2: float, values: Array) -> float:
        """Growth of the worn area since another, over it and what the elasticity takes up."""
        return (self.after.worn_mm2 - since_mm2) / (since_mm2 + self._elastic_mm2(values))

    def _elastic_mm2(self, values: Array) -> float:
        """Area that elasticity keeps, P' a / E*, of half width a: Johnson (1985), 4.2."""
        half = 0.5 * self.site.grid.spacing_mm * np.count_nonzero(self._pressures[-1])
        return self._drive(values)[0] * half / elastic_constants(self.now)[0]

    @property
    def site(self) -> ContactSetup:
        """The contact's grid."""
        assert self._site is not None
        return self._site

    def _use(self, scene: Scene) -> None:
        """Solve on the grid of a scene's own numerics, on whose nodes the scars lie."""
        grid = contact_grid(scene, largest_dose_mm_per_mpa=0.0)
        self._site, self._pressures = make_site(scene.model_copy(update={"wear": None}), grid), []
        self._last, self._scar = (scar and scar.on(grid.nodes) for scar in (self._last, self._scar))
        for key, depth in self._by_past.items():
            more = (grid.nodes - depth.shape[-1]) // 2
            self._by_past[key] = np.pad(depth, ((0, 0), (more, more)))

    def _worn_before(self, values: Array) -> SlicedScar:
        """The scar that a contact has at its first frame."""
        drive, loads = self._drive(values), tuple(slice_loads(self.scene)[0].tolist())
        parts = (self._slice_before(values, load) for load in loads)
        return SlicedScar(drive, loads, tuple(parts))

    def _slice_before(self, values: Array, share: float) -> GrowingScar:
        """That of a slice with a share of the mean load."""
        s, drive = self._s, of_slice(self._drive(values), share)
        if self.scene.wear is None or not s > 0.0:
            return GrowingScar(np.zeros(self.site.grid.nodes), drive)
        before = self._before(values)
        history, (stop,) = wear_course(before)
        history = replace(history, line_load_n_per_mm=share * history.line_load_n_per_mm)
        numerics = self.site.scene.numerics.model_copy(update={"tolerance": TOLERANCE})
        site = replace(self.site, scene=before.model_copy(update={"numerics": numerics}))
        loads = [share * line for line in self._lines_before(values)]
        doses = stop.dose_mm_per_mpa * (-np.diff(_TO_GO) if len(loads) > 1 else np.ones(1))
        # under the load that the frame shows: the scar's edge must be as sharp as that asks for
        stop = OutputState(stop.distance_m, doses[0], *drive)
        (state,) = worn_states(site, history, [stop])
        if len(loads) == 1:
            return GrowingScar(state.wear_depth_mm, drive, state.pressure_mpa)
        drive = drive._replace(line_load_n_per_mm=loads[0])
        scar = GrowingScar(state.wear_depth_mm, drive)
        for load, dose in zip(loads[1:], doses[1:], strict=True):
            drive = drive._replace(line_load_n_per_mm=load)
            scar = scar.grown(self.site, dose, drive, tolerance=TOLERANCE)
        return scar

    def _lines_before(self, values: Array) -> list[float]:
        """Line loads (N/mm) at the first frame's PAST and in it; or one, of the scene's tables."""
        line, past = self._drive(values)[0], values[len(self.tracked) :]
        own = [line] if len(past) else []
        return [*(past / self._thickness_mm).tolist(), *own] or [line]

    def _before(self, values: Array) -> Scene:
        """The scene until the first frame: its tables, or what that frame says for all the time,
        of its loads the first."""
        known = dict(zip(self.keys, values.tolist(), strict=True))
        known = {key: known[key] for key in (FRICTION, WEAR) if key in known} | {
            LOAD: known.get(PAST[0], self.now.load_at(0.0))
        }
        fixed = {key: value for key, value in known.items() if not self._is_table(key)}
        return with_part(self.scene.with_values(fixed), "wear", distances_m=(self._s,))

    def _areas(self, values: Array) -> Worn:
        """What has worn at the frame in hand."""
        if self.scene.wear is None or (self._last is None and not self._s > 0.0):
            return Worn()
        if self._last is None:
            worn = float(local_values(self._before(values), (self._s,))[0, 2])
            loads = self._lines_before(values)
            if len(loads) > 1:
                worn *= -float(np.trapezoid([loads[0], *loads], _TO_GO)) / loads[0]
            share = self._value(WEAR, values) / self._own_wear if WEAR in self.tracked else 1.0
            return Worn(self._s, worn / share, worn)
        line, mu, *_ = self._drive(values)
        _, law, worn = self._until
        more = 0.5 * (self._last.drive[0] + line) * self._dose(mu)
        return Worn(self._s, law + more, worn + self._share * more)

    def _dose(self, friction: float) -> float:
        """The law's dose (mm/MPa) since the last frame."""
        law, (slid, _, _) = self.scene.wear, self._until
        if law is None or self._last is None:
            return 0.0
        ends = (self._last.drive[1], slid), (friction, self._s)
        return max(0.0, self._s - slid) * 0.5e3 * sum(float(wear_rate(law, *end)) for end in ends)

    def _drive(self, values: Array) -> Drive:
        """What the frame's contact is under by some values."""
        mu = self._value(FRICTION, values) if self.scene.friction else 0.0
        between = self.scene.layer_at(self._s), self.scene.roughness_at(self._s)
        return Drive(self._value(LOAD, values) / self._thickness_mm, mu, *between)

    def _value(self, key: str, values: Array) -> float:
        if key in self.tracked:
            return float(values[self.tracked.index(key)])
        return float(self.now.get(key))

    @property
    def _own_wear(self) -> float:
        """The scene's own wear coefficient (mm²/N) at the frame in hand."""
        return float(self.scene.wear_coefficient_at(self._s))

    def _is_table(self, key: str) -> bool:
        there = key != FRICTION or self.scene.friction is not None
        return there and isinstance(self.scene.get(key), DistanceTable)
