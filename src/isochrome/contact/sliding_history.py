"""The course of a run: wear dose, load and friction over the sliding distance. Every wear law has
the form dh = kappa(s) p ds, so that the distance enters only through the dose K(s) = ∫ kappa ds
(mm/MPa), dh/dK = p. kappa is smooth between the points of the scene's tables: Gauss-Legendre
quadrature of each smooth stretch gives the dose, to rounding where a coefficient is a number or a
table; other stretches are halved until a second rule gives the same dose, and until load and
friction are linear in the dose, as they are in the distance."""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np

from isochrome.contact.pressure import Floats
from isochrome.messages import message
from isochrome.scene import DistanceTable, Scene, Wear

Rate = Callable[[Floats], Floats]
"""Dose over the distance slid, at distances (m)."""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
_LEGENDRE = np.polynomial.Legendre.basis(len(NODES))
_INNER = np.real(_LEGENDRE.deriv().roots())
_INNER_WEIGHTS = 2.0 / (72.0 * _LEGENDRE(_INNER) ** 2)
"""Gauss-Lobatto's rule, as exact as Gauss's by other nodes, of which these lie inside."""
SAME, _ROUNDING = 1e-12, 1e-14
"""Relative difference of values, such as doses, that are one: rounding of a whole run, and of one
number."""
_STRAIGHT, _STRAIGHTEST = 1e-3, 1e-9
"""Largest error of the linear interpolation in the dose, over the largest value: this share of the
wear's tolerance, and no less than the second. A long measured table would else need millions of
samples."""
_FRICTION_STRETCH = 0.25
"""Change of mu over a stretch: sqrt(1 + 3 mu²), singular at mu = ± i/√3, is then exact to 1e-15."""
_MAX_HALVINGS = 40


def kinks_of(scene: Scene, end: float) -> Floats:
    """Distances (m,), m, from 0 to `end`, at which a slope changes: tables' points, zeros of mu."""
    assert scene.load is not None
    friction = scene.friction.coefficient if scene.friction else 0.0
    wear = dict(scene.wear).values() if scene.wear else ()
    breaks = [0.0, end]
    between = scene.contact.layer_um_per_mpa, scene.contact.roughness_um
    for table in (scene.load.normal_n, friction, *between, *wear):
        if isinstance(table, DistanceTable):
            breaks += table.distance_m
    if isinstance(friction, DistanceTable):
        s, mu = np.array(friction.distance_m), np.array(friction.value)
        i = np.flatnonzero(mu[:-1] * mu[1:] < 0.0)
        breaks += (s[i] - mu[i] * (s[i + 1] - s[i]) / (mu[i + 1] - mu[i])).tolist()
    kinks = np.unique(breaks)
    return kinks[kinks <= end]


def integral(
    rate: Rate, a: Floats, b: Floats, *, nodes: Floats = NODES, weights: Floats = WEIGHTS
) -> Floats:
    """Integrals ∫ rate ds (m,) over smooth stretches from `a` to `b` (m,), m, by Gauss-Legendre.
    `nodes`, `weights` (k,) of another rule on -1 to 1."""
    half = 0.5 * (b - a)
    values = rate((0.5 * (a + b))[:, None] + half[:, None] * nodes)
    return np.asarray(half * np.einsum("ij,j->i", values, weights))


def _resolved(rate: Rate, s: Floats) -> Floats:
    """Distances, and points between them so that quadrature between neighbours gives the dose. A
    stretch is halved where two rules of quadrature differ; the second sees its ends, where a
    running-in far shorter than the stretch shows. Source: Gander & Gautschi (2000), BIT 40, 84."""
    for _ in range(_MAX_HALVINGS):
        a, b = s[:-1], s[1:]
        dose = integral(rate, a, b)
        ends = (b - a) / 72.0 * (rate(a) + rate(b))  # at the ends exactly: beyond may be a jump
        other = ends + integral(rate, a, b, nodes=_INNER, weights=_INNER_WEIGHTS)
        largest = float(np.max(dose / (b - a), initial=0.0))
        bent = np.abs(other - dose) > SAME * dose.sum() + _ROUNDING * largest * s[-1]
        if not bent.any():
            break
        s = np.union1d(s, (0.5 * (a + b))[bent])
    return s


def sampled(scene: Scene, rate: Rate, kinks: Floats) -> Floats:
    """Distances (m,), m, between which the drive is linear in the dose ∫ rate ds.
    Stretches are halved until quadrature gives their dose, and two places in each show the line: in
    one place, an inflection of the dose could pass for a straight line. For `kinks` see
    `kinks_of`."""
    change = np.abs(np.diff(scene.friction_at(kinks)))
    parts = np.maximum(1, np.ceil(change / _FRICTION_STRETCH)).astype(int)
    pieces = [
        np.linspace(a, b, n, endpoint=False)
        for a, b, n in zip(kinks[:-1], kinks[1:], parts, strict=True)
    ]
    s = _resolved(rate, np.concatenate([*pieces, kinks[-1:]]))
    samples, a, b = [s], s[:-1], s[1:]
    courses = scene.load_at, scene.friction_at, scene.layer_at, scene.roughness_at
    scale = [np.abs(f(s)).max() or 1.0 for f in courses]
    straight = max(_STRAIGHTEST, _STRAIGHT * scene.numerics.tolerance)
    for _ in range(_MAX_HALVINGS):
        if not len(a):
            break
        bent = np.zeros(len(a), dtype=bool)
        total = integral(rate, a, b)
        change = np.max(
            [np.abs(f(b) - f(a)) / most for f, most in zip(courses, scale, strict=True)], axis=0
        )
        for place in (0.25, 0.5):
            part = integral(rate, a, a + place * (b - a))
            share = np.divide(part, total, out=np.full(len(a), place), where=total > 0.0)
            bent |= np.abs(share - place) * change > straight
        a, b = a[bent], b[bent]
        middle = 0.5 * (a + b)
        samples.append(middle)
        a, b = np.concatenate([a, middle]), np.concatenate([middle, b])
    return np.sort(np.concatenate(samples))


Value = TypeVar("Value", float, Floats)

_SAME_DRIVE = 1e-6
"""Relative difference of load or friction at one dose that is no jump."""


class Drive(NamedTuple):
    """What a contact is under: line load P', friction mu, and what lies between the bodies."""

    line_load_n_per_mm: float
    friction: float
    layer_mm_per_mpa: float = 0.0
    roughness_mm: float = 0.0


def same_drive(one: Drive, other: Drive) -> bool:
    """Whether two drives are the same, to 1e-6 of each; friction that changes its sign is none
    within rounding."""
    return all(abs(a - b) <= SAME + _SAME_DRIVE * abs(b) for a, b in zip(one, other, strict=True))


@dataclass(frozen=True)
class SlidingHistory:
    """Dose and drive sampled at m rising distances, linear in the dose between."""

    distance_m: Floats
    dose_mm_per_mpa: Floats  # K, not falling
    line_load_n_per_mm: Floats
    friction: Floats
    # doses inside the run where the drive may have a kink or a jump
    breaks_mm_per_mpa: tuple[float, ...] = ()
    # layer (mm/MPa) and roughness (mm) between the bodies, where there are any
    between: tuple[Floats, ...] = ()

    @property
    def steady(self) -> bool:
        """Whether load and friction are the same throughout."""
        return not (np.ptp(self.line_load_n_per_mm) or np.ptp(self.friction))

    @property
    def wears_in(self) -> bool:
        """Whether what lies between the bodies changes."""
        return any(np.ptp(column) for column in self.between)

    @property
    def _columns(self) -> tuple[Floats, ...]:
        """The drive's values (m,), in the order of its fields."""
        return self.line_load_n_per_mm, self.friction, *self.between

    def at(self, dose_mm_per_mpa: float) -> Drive:
        """The drive on arriving at a dose (mm/MPa)."""
        return self._at(dose_mm_per_mpa, "left")

    def leaving(self, dose_mm_per_mpa: float) -> Drive:
        """The drive on leaving a dose, which wear may have stood still at."""
        return self._at(dose_mm_per_mpa, "right")

    def next_break(self, dose_mm_per_mpa: float) -> float:
        """The first break beyond a dose (mm/MPa), or infinity."""
        return _next(self.breaks_mm_per_mpa, dose_mm_per_mpa)

    def next_jump(self, dose_mm_per_mpa: float) -> float:
        """The first dose beyond this at which the drive jumps (mm/MPa), or infinity."""
        return _next(self._jumps, dose_mm_per_mpa)

    @cached_property
    def _exact(self) -> tuple[float, ...]:
        """Doses that steps end on exactly."""
        return *self.breaks_mm_per_mpa, float(self.dose_mm_per_mpa[-1])

    @cached_property
    def _jumps(self) -> tuple[float, ...]:
        breaks = self.breaks_mm_per_mpa
        return tuple(d for d in breaks if not same_drive(self.leaving(d), self.at(d)))

    def _at(self, dose: float, side: Literal["left", "right"]) -> Drive:
        doses = self.dose_mm_per_mpa
        near = _next(self._exact, dose * (1.0 - _ROUNDING))
        dose = near if near <= dose * (1.0 + _ROUNDING) else dose
        i = int(np.searchsorted(doses, dose, side=side))
        if i == 0 or i == len(doses):
            i = min(i, len(doses) - 1)
            return Drive(*(float(v[i]) for v in self._columns))
        t = (dose - doses[i - 1]) / (doses[i] - doses[i - 1])
        return Drive(*(float(v[i - 1] + t * (v[i] - v[i - 1])) for v in self._columns))


def _next(doses: tuple[float, ...], dose: float) -> float:
    """The first of rising doses beyond another, or infinity."""
    place = bisect_right(doses, dose)
    return doses[place] if place < len(doses) else float("inf")


@dataclass(frozen=True)
class OutputState:
    """A state asked for, with its own dose K and drive."""

    distance_m: float
    dose_mm_per_mpa: float
    line_load_n_per_mm: float
    friction: float
    layer_mm_per_mpa: float = 0.0
    roughness_mm: float = 0.0

    @property
    def drive(self) -> Drive:
        """What the contact is under in this state."""
        return Drive(
            self.line_load_n_per_mm, self.friction, self.layer_mm_per_mpa, self.roughness_mm
        )


def paused_doses(history: SlidingHistory, stops: Sequence[OutputState]) -> frozenset[float]:
    """Doses (mm/MPa) at which a state has another drive than the course on arriving."""
    others = (s for s in stops if not same_drive(s.drive, history.at(s.dose_mm_per_mpa)))
    return frozenset(stop.dose_mm_per_mpa for stop in others)


def wear_rate(wear: Wear, friction: Value, distance_m: Value) -> Value:
    """Depth per pressure and distance, kappa of dh = kappa p ds, mm²/N: the one place of a law.
    'archard': k; 'sarkar': k sqrt(1 + 3 mu²); 'dissipated_energy': k |mu|, as the energy per area
    is |mu| p ds (k is worn volume per energy, 1 mm³/J = 1e-3 mm²/N). Sources: Archard (1953), J.
    Appl. Phys. 24, 981; Sarkar (1980), Friction and Wear; Fouvry et al. (1997), Wear 203-204,
    393."""
    coefficient = wear.coefficient_at(distance_m)
    if wear.law == "archard":
        return coefficient
    if wear.law == "sarkar":
        result: Value = coefficient * (1.0 + 3.0 * friction**2) ** 0.5
        return result
    if wear.law == "dissipated_energy":
        return coefficient * abs(friction)
    raise ValueError(message("no_wear_law", law=wear.law))


def mean_wear_rate(wear: Wear, friction: float | Floats, distance_m: float) -> Floats:
    """Mean of kappa from the start to a distance, at one friction, mm²/N: where a search starts. By
    eight points, and exactly kappa where it does not go with the distance; `wear_course` gives the
    dose itself. The coefficient of [wear] may be an array (m,) of those that a search tries."""
    mu: Any = friction
    places = [0.5 * distance_m * (1.0 + float(node)) for node in NODES]
    first, *others = [wear_rate(wear, mu, np.full(np.shape(mu), s)) for s in places]
    steps = [0.5 * w * (r - first) for w, r in zip(WEIGHTS[1:], others, strict=True)]
    return np.asarray(first + np.sum(steps, axis=0))


def wear_course(scene: Scene) -> tuple[SlidingHistory, list[OutputState]]:
    """The sliding history of a contact scene, and its states in the order of `wear.distances_m`.
    Without wear there is one state, at no distance."""
    thickness = scene.specimen.thickness_mm
    assert thickness is not None
    wanted = np.array(scene.wear.distances_m if scene.wear else (0.0,), dtype=float)
    change = scene.friction.earlier_change if scene.friction else 0.0

    def friction_before(s: Floats) -> Floats:
        return np.asarray(scene.friction_at(s) + change)

    def rate(s: Floats) -> Floats:
        if scene.wear is None:
            return np.zeros(np.shape(s))
        return 1e3 * wear_rate(scene.wear, friction_before(s), s)

    kinks = kinks_of(scene, float(wanted.max()))
    s = sampled(scene, rate, kinks)
    courses = scene.load_at, friction_before, scene.layer_at, scene.roughness_at
    if any(np.ptp(values(s)) > 0.0 for values in courses):
        s = np.union1d(s, wanted)  # a state has the course's load there, not nearly
    dose = np.concatenate([[0.0], np.cumsum(integral(rate, s[:-1], s[1:]))])
    below = np.searchsorted(s, wanted, side="right") - 1
    doses = dose[below] + integral(rate, s[below], wanted)
    breaks = tuple(float(d) for d in np.unique(dose[np.isin(s, kinks)]) if 0.0 < d < dose[-1])
    between = () if scene.is_bare else (scene.layer_at(s), scene.roughness_at(s))
    history = SlidingHistory(
        s, dose, scene.load_at(s) / thickness, friction_before(s), breaks, between
    )
    loads, friction = scene.load_at(wanted) / thickness, scene.friction_at(wanted)
    columns = wanted, doses, loads, friction, scene.layer_at(wanted), scene.roughness_at(wanted)
    return history, [OutputState(*row) for row in np.transpose(columns).tolist()]
