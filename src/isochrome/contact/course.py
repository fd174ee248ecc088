r"""The course of a run: wear dose, load and friction over the sliding distance.

Every wear law here has the form dh = kappa(s) p ds, so that the distance enters only through the
dose K(s) = ∫ kappa ds (mm/MPa) and dh/dK = p.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np

from isochrome.contact.sampling import integral, kinks_of, sampled
from isochrome.contact.surface import Floats
from isochrome.scene import Scene

Value = TypeVar("Value", float, Floats)

_SAME_DRIVE = 1e-6
"""Relative difference of load or friction at one dose that is no jump."""
_NO_DRIVE = 1e-12
"""Friction that is none: rounding, where it changes its sign."""


def same_drive(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Whether two pairs of line load and mu are the same, to 1e-6 of each."""
    return bool(np.allclose(one, other, _SAME_DRIVE, _NO_DRIVE))


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

    def next_jump(self, dose_mm_per_mpa: float) -> float:
        """The first dose beyond this at which load or friction jump (mm/MPa), or infinity."""
        for dose in self.breaks_mm_per_mpa:
            if dose > dose_mm_per_mpa and not same_drive(self.leaving(dose), self.at(dose)):
                return dose
        return float("inf")

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

    kinks = kinks_of(scene, float(asked.max()))
    s = sampled(scene, rate, kinks)
    if any(np.ptp(values(s)) > 0.0 for values in (scene.load_at, scene.friction_at)):
        s = np.union1d(s, asked)  # a state has the course's load there, not nearly
    dose = np.concatenate([[0.0], np.cumsum(integral(rate, s[:-1], s[1:]))])
    below = np.searchsorted(s, asked, side="right") - 1
    doses = dose[below] + integral(rate, s[below], asked)
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
