r"""The course of a run: wear dose, load and friction over the sliding distance.

Every wear law here has the form dh = kappa(s) p ds, so that the distance enters only through the
dose K(s) = ∫ kappa ds (mm/MPa) and dh/dK = p. kappa is piecewise smooth between the points of the
scene's tables: Gauss-Legendre quadrature of each smooth stretch gives K to rounding. Load and
friction are linear in the distance, not in the dose; each stretch is halved until they are linear
in the dose as well, which puts samples densely where kappa vanishes and sparsely elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np

from isochrome.contact.surface import Floats
from isochrome.scene import DistanceTable, Scene

Value = TypeVar("Value", float, Floats)

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_STRAIGHT = 1e-9
"""Largest error of the linear interpolation in the dose, over the largest value."""
_FRICTION_STRETCH = 0.25
"""Change of mu over a stretch: sqrt(1 + 3 mu²), singular at mu = ± i/√3, is then exact to 1e-15."""
_MAX_HALVINGS = 40


@dataclass(frozen=True)
class Course:
    """Dose, load and friction sampled along the distance, all (m,), linear in the dose between.

    `distance_m`, rising; `dose_mm_per_mpa` K, not falling; `line_load_n_per_mm` P'; `friction` mu;
    `breaks_mm_per_mpa`, doses inside the run at which load or friction may have a kink or a jump.
    """

    distance_m: Floats
    dose_mm_per_mpa: Floats
    line_load_n_per_mm: Floats
    friction: Floats
    breaks_mm_per_mpa: tuple[float, ...] = ()

    def at(self, dose_mm_per_mpa: float) -> tuple[float, float]:
        """Line load (N/mm) and mu on arriving at a dose (mm/MPa)."""
        return self._at(dose_mm_per_mpa, "left")

    def leaving(self, dose_mm_per_mpa: float) -> tuple[float, float]:
        """Line load (N/mm) and mu on leaving a dose, which wear may have stood still at."""
        return self._at(dose_mm_per_mpa, "right")

    def next_break(self, dose_mm_per_mpa: float) -> float:
        """The first break beyond a dose (mm/MPa), or infinity."""
        later = np.searchsorted(self.breaks_mm_per_mpa, dose_mm_per_mpa, side="right")
        rest = self.breaks_mm_per_mpa[int(later) :]
        return rest[0] if rest else float("inf")

    def _at(self, dose: float, side: Literal["left", "right"]) -> tuple[float, float]:
        doses = self.dose_mm_per_mpa
        i = int(np.searchsorted(doses, dose, side=side))
        if i == 0 or i == len(doses):
            i = min(i, len(doses) - 1)
            return float(self.line_load_n_per_mm[i]), float(self.friction[i])
        t = (dose - doses[i - 1]) / (doses[i] - doses[i - 1])
        load, mu = (
            float(values[i - 1] + t * (values[i] - values[i - 1]))
            for values in (self.line_load_n_per_mm, self.friction)
        )
        return load, mu


@dataclass(frozen=True)
class Stop:
    """A state asked for: `distance_m`, its dose K, and its own load P' and friction mu."""

    distance_m: float
    dose_mm_per_mpa: float
    line_load_n_per_mm: float
    friction: float


def wear_rate(law: str, coefficient: Value, friction: Value) -> Value:
    """Depth per pressure and distance, kappa of dh = kappa p ds.

    Equations: 'archard', kappa = k; 'sarkar', kappa = k sqrt(1 + 3 mu²); 'dissipated_energy',
    kappa = k |mu|, since the energy dissipated per area is |mu| p ds.
    Parameters: `law`; `coefficient` k (mm²/N) and `friction` mu, numbers or arrays of one shape; k
    is the worn volume per energy in the last law, where 1 mm³/J is 1e-3 mm²/N.
    Returns kappa (mm²/N) of that shape. Raises ValueError on another law.
    Sources: Archard (1953), J. Appl. Phys. 24, 981; Sarkar (1980), Friction and Wear; Fouvry,
    Kapsa, Zahouani & Vincent (1997), Wear 203-204, 393.
    """
    if law == "archard":
        return coefficient
    if law == "sarkar":
        return coefficient * (1.0 + 3.0 * friction**2) ** 0.5
    if law == "dissipated_energy":
        return coefficient * abs(friction)
    raise ValueError(f"no wear law {law!r}")


def wear_course(scene: Scene) -> tuple[Course, list[Stop]]:
    """The course of a contact scene and the states that it asks for.

    Parameters: `scene`, with a load; without wear there is one state, at no distance.
    Returns the Course, from distance 0 to the largest asked for, and a Stop for each of
    `wear.distances_m`, in the scene's order.
    """
    thickness = scene.specimen.thickness_mm
    assert thickness is not None
    asked = np.array(scene.wear.distances_m if scene.wear else (0.0,), dtype=float)

    def rate(s: Floats) -> Floats:
        law = scene.wear.law if scene.wear else "archard"
        return 1e3 * wear_rate(law, scene.wear_coefficient_at(s), scene.friction_at(s))

    kinks = _kinks(scene, float(asked.max()))
    s = _sampled(scene, rate, _stretches(scene, kinks))
    dose = np.concatenate([[0.0], np.cumsum(_integral(rate, s[:-1], s[1:]))])
    below = np.searchsorted(s, asked, side="right") - 1
    doses = dose[below] + _integral(rate, s[below], asked)
    inside = np.unique(dose[np.isin(s, kinks)])
    course = Course(
        s,
        dose,
        scene.load_at(s) / thickness,
        scene.friction_at(s),
        tuple(float(d) for d in inside if 0.0 < d < dose[-1]),
    )
    loads, friction = scene.load_at(asked) / thickness, scene.friction_at(asked)
    columns = (asked.tolist(), doses.tolist(), loads.tolist(), friction.tolist())
    return course, [Stop(*row) for row in zip(*columns, strict=True)]


def constant_course(
    line_load_n_per_mm: float,
    distances_m: Floats | Sequence[float],
    *,
    dose_per_m: float,
    friction: float = 0.0,
) -> tuple[Course, list[Stop]]:
    """The course of a run at constant load, friction and wear rate.

    Parameters: `line_load_n_per_mm` P'; `distances_m` (m,), in any order; `dose_per_m`, 1000 kappa
    (mm/MPa per m); `friction`, mu. Returns the Course and a Stop for each distance.
    """
    asked = np.asarray(distances_m, dtype=float)
    ends = np.unique([0.0, asked.max()])
    shape = np.ones(len(ends))
    course = Course(ends, dose_per_m * ends, line_load_n_per_mm * shape, friction * shape)
    stops = [Stop(d, dose_per_m * d, line_load_n_per_mm, friction) for d in asked.tolist()]
    return course, stops


def _kinks(scene: Scene, end: float) -> Floats:
    """Distances in 0..end at which a slope changes: table points, and zeros of mu in |mu|."""
    assert scene.load is not None
    friction = scene.friction.coefficient if scene.friction else 0.0
    wear = scene.wear.coefficient_mm2_per_n if scene.wear else 0.0
    found = [0.0, end]
    for table in (scene.load.normal_n, friction, wear):
        if isinstance(table, DistanceTable):
            found += table.distance_m
    if isinstance(friction, DistanceTable):
        s, mu = np.array(friction.distance_m), np.array(friction.value)
        i = np.flatnonzero(mu[:-1] * mu[1:] < 0.0)
        found += (s[i] - mu[i] * (s[i + 1] - s[i]) / (mu[i + 1] - mu[i])).tolist()
    kinks = np.unique(found)
    return kinks[kinks <= end]


def _stretches(scene: Scene, kinks: Floats) -> Floats:
    """The kinks, and points between them so that mu changes little from one to the next."""
    change = np.abs(np.diff(scene.friction_at(kinks)))
    parts = np.maximum(1, np.ceil(change / _FRICTION_STRETCH)).astype(int)
    pieces = [
        np.linspace(a, b, n, endpoint=False)
        for a, b, n in zip(kinks[:-1], kinks[1:], parts, strict=True)
    ]
    return np.concatenate([*pieces, kinks[-1:]])


def _integral(rate: Callable[[Floats], Floats], a: Floats, b: Floats) -> Floats:
    """∫ rate ds from a to b (m,), each within a smooth stretch, by Gauss-Legendre quadrature."""
    half = 0.5 * (b - a)
    values = rate((0.5 * (a + b))[:, None] + half[:, None] * _NODES)
    return half * np.einsum("ij,j->i", values, _WEIGHTS)


def _sampled(scene: Scene, rate: Callable[[Floats], Floats], s: Floats) -> Floats:
    """Stretches halved until load and mu are linear in the dose, looked at in two places.

    In one place, an inflection of the dose could pass for a straight line.
    """
    samples, a, b = [s], s[:-1], s[1:]
    scale = [np.abs(f(s)).max() or 1.0 for f in (scene.load_at, scene.friction_at)]
    for _ in range(_MAX_HALVINGS):
        bent = np.zeros(len(a), dtype=bool)
        whole = _integral(rate, a, b)
        change = np.maximum(
            np.abs(scene.load_at(b) - scene.load_at(a)) / scale[0],
            np.abs(scene.friction_at(b) - scene.friction_at(a)) / scale[1],
        )
        for place in (0.25, 0.5):
            part = _integral(rate, a, a + place * (b - a))
            share = np.divide(part, whole, out=np.full(len(a), place), where=whole > 0.0)
            bent |= np.abs(share - place) * change > _STRAIGHT
        if not bent.any():
            break
        a, b = a[bent], b[bent]
        middle = 0.5 * (a + b)
        samples.append(middle)
        a, b = np.concatenate([a, middle]), np.concatenate([middle, b])
    return np.sort(np.concatenate(samples))
