r"""Worn volumes by distance, each with the variance of its own errors.

The traces of a distance see one scar at several places of its width w: V = w mean(A_i). The
variance v_i of each area by roughness and levelling is known from the shoulders with ν_0 degrees
of freedom, and what the traces scatter about their means adds ν_1 = Σ (n_d - 1):

    φ = (ν_0 + Σ (A_i - mean A)²/v_i) / (ν_0 + ν_1),    var V = φ w² mean(v_i)/n,

the mean of the scaled inverse chi-squared distribution that both make together, with ν_0 + ν_1
degrees of freedom. Source: Gelman et al. (2013), Bayesian Data Analysis, section 2.6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from isochrome.calibration.wear.settings import SlidTest, WearSet, WearTrace
from isochrome.scars import (
    LevelledTrace,
    UnclearScarError,
    levelled,
    read_trace,
    student_factor_of,
)

Array = NDArray[Any]

MOST_FREEDOM = 30.0
"""Degrees of freedom that a spectrum is believed with: its bands are a model."""

UNLIKELY = 1e-3
"""Chance of a scatter below which it is said."""


@dataclass(frozen=True)
class TraceScar:
    """A trace of the set and what levelling gave, None where no scar stands out."""

    test: WearTrace
    levelled: LevelledTrace | None
    why_not: str = ""


@dataclass(frozen=True, kw_only=True)
class WornVolume:
    """The worn volume at one distance and load.

    `distance_m`, `normal_n`, `friction`: its test; `volume_mm3` and `own_uncertainty_mm3`, by its
    own errors alone; `scars`, its traces, none of a volume that was given; `roughness_mm3` and
    `levelling_mm3`, parts of the uncertainty by the shoulders alone.
    """

    distance_m: float
    normal_n: float
    friction: float | None
    volume_mm3: float
    own_uncertainty_mm3: float
    scars: tuple[TraceScar, ...] = ()
    roughness_mm3: float = 0.0
    levelling_mm3: float = 0.0

    @property
    def work_n_mm(self) -> float:
        """Load times distance P s, N mm."""
        return self.normal_n * 1e3 * self.distance_m

    @property
    def place(self) -> str:
        """Its distance in words."""
        return f"{self.distance_m:g} m"


@dataclass(frozen=True)
class TraceScatter:
    """The factor φ on the traces' variances, its degrees of freedom, and the scatter alone.

    `chi_square` of `freedom`: of the traces about the mean of their distance.
    """

    factor: float
    degrees_of_freedom: float
    chi_square: float
    freedom: int

    @property
    def is_unlikely(self) -> bool:
        """Whether the traces scatter more than their roughness explains."""
        return self.freedom > 0 and float(chdtrc(self.freedom, self.chi_square)) < UNLIKELY


def trace_scars(settings: WearSet) -> tuple[TraceScar, ...]:
    """Read and level the traces of a set. Raises InputError for one that cannot be."""
    found = []
    for test in settings.trace:
        trace = read_trace(settings.path(test.file))
        try:
            found.append(TraceScar(test, levelled(trace)))
        except UnclearScarError as error:
            found.append(TraceScar(test, None, str(error)))
    return tuple(found)


def worn_volumes(
    settings: WearSet, scars: Sequence[TraceScar]
) -> tuple[tuple[WornVolume, ...], TraceScatter]:
    """The volumes by distance, those of traces first, and how the traces scatter.

    A distance of which one trace shows no clear scar is left out: to take the others alone would
    take those that chance made deep.
    """
    groups = [group for group in _groups(scars) if all(scar.levelled for scar in group)]
    scatter = _scatter(groups)
    found = [_of_traces(settings, group, scatter) for group in groups]
    own = settings.uncertainty.volume_mm3
    for k, test in enumerate(settings.volume):
        found.append(
            WornVolume(
                distance_m=test.distance_m,
                normal_n=test.normal_n,
                friction=test.friction,
                volume_mm3=test.value_mm3,
                own_uncertainty_mm3=own[k] if own is not None else np.nan,
            )
        )
    return tuple(found), scatter


def _key(test: SlidTest) -> tuple[float, float, float | None]:
    return test.distance_m, test.normal_n, test.friction


def _groups(scars: Sequence[TraceScar]) -> list[tuple[TraceScar, ...]]:
    """Traces of one distance, load and friction, in the set's order."""
    keys = dict.fromkeys(_key(scar.test) for scar in scars)
    return [tuple(scar for scar in scars if _key(scar.test) == key) for key in keys]


def _areas(group: Sequence[TraceScar]) -> tuple[Array, Array]:
    """Areas (n,), mm², and their variances by the spectra, mm⁴.

    How well those are known is in the factor φ here, and not in each.
    """
    scars = [scar.levelled for scar in group if scar.levelled is not None]
    areas = np.array([scar.worn_area_mm2 for scar in scars])
    return areas, np.array(
        [scar.worn_area_uncertainty_mm2**2 / scar.student_factor for scar in scars]
    )


def _scatter(groups: Sequence[tuple[TraceScar, ...]]) -> TraceScatter:
    """How far the traces scatter, joined with what their shoulders promise."""
    square, freedom, weights, known = 0.0, 0, [], []
    for group in groups:
        areas, variances = _areas(group)
        own = [scar.levelled.degrees_of_freedom for scar in group if scar.levelled is not None]
        known += own
        mean = float(variances.mean()) * student_factor_of(sum(own))
        square += float(np.sum((areas - areas.mean()) ** 2)) / mean
        freedom += len(areas) - 1
        # a distance's share of the coefficient goes with its load times distance
        size = (group[0].test.distance_m * group[0].test.normal_n) ** 2
        weights += [size / len(areas)] * len(areas)
    if not groups:
        return TraceScatter(1.0, np.inf, 0.0, 0)
    share = np.array(weights) / np.sum(weights)
    before = min(MOST_FREEDOM, float(1.0 / np.sum(share**2 / np.array(known))))
    both = before + freedom
    factor = (before + square) / both * student_factor_of(both)
    return TraceScatter(factor, both, square, freedom)


def _of_traces(
    settings: WearSet, group: tuple[TraceScar, ...], scatter: TraceScatter
) -> WornVolume:
    assert settings.scar is not None
    areas, variances = _areas(group)
    width, count = settings.scar.width_mm, len(areas)
    levels = np.array(
        [s.levelled.levelling_uncertainty_mm2**2 / s.levelled.student_factor
         for s in group if s.levelled is not None]
    )  # fmt: skip
    total = float(np.mean(variances)) / count
    level = min(float(np.mean(levels)) / count, total)
    first = group[0].test
    return WornVolume(
        distance_m=first.distance_m,
        normal_n=first.normal_n,
        friction=first.friction,
        volume_mm3=width * float(areas.mean()),
        own_uncertainty_mm3=width * float(np.sqrt(scatter.factor * total)),
        scars=group,
        roughness_mm3=width * float(np.sqrt(total - level)),
        levelling_mm3=width * float(np.sqrt(level)),
    )
