"""The set of a wear calibration, and its worn volumes by distance.

The traces of a distance see one scar at several places of its width w: V = w mean(A_i). The
variance v_i of each area by roughness and levelling is known from the shoulders with ν_0 degrees
of freedom, and the traces' scatter about their means adds ν_1 = Σ (n_d - 1):

    φ = (ν_0 + Σ (A_i - mean A)²/v_i) / (ν_0 + ν_1),    var V = φ w² mean(v_i)/n,

the mean of the scaled inverse chi-squared distribution that both make together, with ν_0 + ν_1
degrees of freedom. Source: Gelman et al. (2013), Bayesian Data Analysis, section 2.6.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from isochrome.calibration.settings import ImageSet, common_percent, plain_rows, under_uncertainty
from isochrome.messages import message
from isochrome.scars import LevelledTrace, UnclearScarError, levelled, read_trace, student_factor_of
from isochrome.scene import FileName, NonNegative, Positive, ScenePart, split_uncertainties

Friction = Annotated[float, Field(ge=0, le=5, allow_inf_nan=False)]


class ScarTrack(ScenePart):
    """What all scars of a set share.

    Parameters
    ----------
    width_mm : float
        Width of the worn track along the cylinder's axis, across the traces, mm: the worn volume
        is area times width.
    scene : str, optional
        A scene's file or name, whose simulated scars the measured ones are held against.
    """

    width_mm: Positive
    scene: FileName | None = None


class SlidTest(ScenePart):
    """What a scar was worn by.

    Parameters
    ----------
    distance_m : float
        Distance slid, m.
    normal_n : float
        Normal load, N.
    friction : float, optional
        Mean friction coefficient until then, for laws that use it.
    """

    distance_m: Positive
    normal_n: Positive
    friction: Friction | None = None


class WearTrace(SlidTest):
    """One trace across a scar; the parameters of `SlidTest` besides.

    Parameters
    ----------
    file : str
        The trace's file, relative to the set's.
    """

    file: FileName


class WearVolume(SlidTest):
    """A worn volume that was measured otherwise; the parameters of `SlidTest` besides.

    Parameters
    ----------
    value_mm3 : float
        The volume, mm³.
    """

    value_mm3: NonNegative


class WearUncertainty(ScenePart):
    """Standard uncertainties that all traces and volumes share.

    Parameters
    ----------
    height_percent, lateral_percent : float, optional
        Those of the profilometer's scales, of its heights and along its traces, per cent.
    load_percent, distance_percent : float, optional
        Those of load and distance, per cent; or stated beside the values.
    width_mm : float, optional
        That of the width, mm; or stated beside it.
    volume_mm3 : tuple of float, optional
        Those of the volumes, mm³, in their order; each its own error. Stated beside the values.
    """

    height_percent: NonNegative | None = None
    lateral_percent: NonNegative | None = None
    load_percent: NonNegative | None = None
    distance_percent: NonNegative | None = None
    width_mm: NonNegative | None = None
    volume_mm3: tuple[NonNegative, ...] | None = None


class WearSet(ImageSet):
    """A set of measured scars.

    Parameters
    ----------
    folder : Path, optional
        Folder of the set's file.
    name : str, optional
        The set's name in messages.
    scar : ScarTrack, optional
        What the scars share; traces need it.
    trace : tuple of WearTrace, optional
        Traces, by rising distance.
    volume : tuple of WearVolume, optional
        Volumes, by rising distance.
    uncertainty : WearUncertainty, optional
        Standard uncertainties of the inputs. A load, a distance, the width and a volume may be
        { value = 44.0, standard_uncertainty = 0.2 } instead; all loads' are taken as common, all
        distances' too, and a volume's as its own.
    """

    scar: ScarTrack | None = None
    trace: tuple[WearTrace, ...] = ()
    volume: tuple[WearVolume, ...] = ()
    uncertainty: WearUncertainty = WearUncertainty()

    @model_validator(mode="before")
    @classmethod
    def _plain_values(cls, data: Any) -> Any:
        """A set's tables with plain values, and what stood beside them under [uncertainty]."""
        if not isinstance(data, dict):
            return data
        plain, stated = split_uncertainties(cls, data)
        spreads: dict[str, Any] = {}
        for key, spread in stated.items():
            if key != "scar.width_mm":
                raise ValueError(message("has_no_standard_uncertainty_here", key=key))
            spreads["width_mm"] = spread
        # of loads and of distances the relative uncertainty is common to all
        common = {"normal_n": "load_percent", "distance_m": "distance_percent"}
        names = (*common, "value_mm3")
        plain, beside = plain_rows(plain, ("trace", "volume"), names, "value_mm3")
        if "value_mm3" in beside:
            spreads["volume_mm3"] = beside.pop("value_mm3")
        spreads |= {common[name]: common_percent(values) for name, values in beside.items()}
        return under_uncertainty(plain, spreads)

    @model_validator(mode="after")
    def _complete(self) -> WearSet:
        if not (self.trace or self.volume):
            raise ValueError(message("has_neither_trace_nor"))
        if self.trace and self.scar is None:
            raise ValueError(message("key_car_width_mm_missing"))
        if not any(volume.value_mm3 for volume in self.volume) and not self.trace:
            raise ValueError(message("no_volume_above_coefficient"))
        stated, count = self.uncertainty.volume_mm3, len(self.volume)
        if stated is not None and len(stated) != count:
            given = len(stated)
            raise ValueError(
                message("volumes_uncertainties_them_state", volume_count=count, stated_count=given)
            )
        if self.trace and self.volume and stated is None:
            raise ValueError(message("volume_beside_traces_needs"))
        return self

    @model_validator(mode="after")
    def _in_order(self) -> WearSet:
        rows: dict[str, Sequence[SlidTest]] = {"trace": self.trace, "volume": self.volume}
        for kind, tests in rows.items():
            for number, (one, other) in enumerate(pairwise(tests), start=2):
                if other.distance_m < one.distance_m:
                    raise ValueError(
                        message(
                            "distance_m_comes_after_distances", kind=kind, number=number,
                            distance_m=other.distance_m, distance_m_2=one.distance_m,
                        )
                    )  # fmt: skip
        for file, times in Counter(trace.file for trace in self.trace).items():
            if times > 1:
                raise ValueError(message("trace_file_stands_twice", file=file))
        return self


Array = NDArray[Any]

MOST_FREEDOM = 30.0
"""Degrees of freedom that a spectrum is believed with: its bands are a model."""


@dataclass(frozen=True)
class TraceScar:
    """A trace of the set and what levelling gave, None where no scar stands out."""

    test: WearTrace
    levelled: LevelledTrace | None
    why_not: str = ""


def levelled_of(scars: Sequence[TraceScar]) -> list[LevelledTrace]:
    """The traces in which a scar stands out."""
    return [scar.levelled for scar in scars if scar.levelled is not None]


@dataclass(frozen=True, kw_only=True)
class WornVolume:
    """The worn volume at one distance and load; `own_uncertainty_mm3` is by its own errors alone.
    `scars`, its traces, none of a volume that was given; `roughness_mm3` and `levelling_mm3`, parts
    of the uncertainty by the shoulders alone.
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
    """The factor φ on the traces' variances, its freedom, and their scatter about their means."""

    factor: float
    degrees_of_freedom: float
    chi_square: float
    freedom: int


def trace_scars(settings: WearSet) -> tuple[TraceScar, ...]:
    """Read and level the traces of a set. Raises InputError for one that cannot be."""
    scars = []
    for test in settings.trace:
        try:
            scars.append(TraceScar(test, levelled(read_trace(settings.path(test.file)))))
        except UnclearScarError as error:
            scars.append(TraceScar(test, None, str(error)))
    return tuple(scars)


def worn_volumes(
    settings: WearSet, scars: Sequence[TraceScar]
) -> tuple[tuple[WornVolume, ...], TraceScatter]:
    """The volumes by distance, those of traces first, and how the traces scatter. A distance with
    an unclear trace is left out: the others alone would be those that chance made deep.
    """
    groups: dict[tuple[Any, ...], list[TraceScar]] = {}
    for scar in scars:
        groups.setdefault(tuple(_slid(scar.test).values()), []).append(scar)
    volumes: list[WornVolume] = []
    square, freedom, weights, known = 0.0, 0, [], []
    width = settings.scar.width_mm if settings.scar else 1.0
    for group in groups.values():
        traces = levelled_of(group)
        count = len(traces)
        if count < len(group):
            continue
        # by the spectra: how well those are known is in φ, and not in each
        area = np.array([trace.worn_area_mm2 for trace in traces])
        factor = np.array([trace.student_factor for trace in traces])
        variance = np.array([t.worn_area_uncertainty_mm2 for t in traces]) ** 2 / factor
        level = np.array([t.levelling_uncertainty_mm2 for t in traces]) ** 2 / factor
        freedoms = [trace.degrees_of_freedom for trace in traces]
        known += freedoms
        expected = float(variance.mean()) * student_factor_of(sum(freedoms))
        square += float(np.sum((area - area.mean()) ** 2)) / expected
        freedom += count - 1
        # a distance's share of the coefficient goes with its load times distance
        test = group[0].test
        weights += [(test.distance_m * test.normal_n) ** 2 / count] * count
        total = float(variance.mean()) / count
        by_level = min(float(level.mean()) / count, total)
        volumes.append(
            WornVolume(
                **_slid(test), volume_mm3=width * float(area.mean()), scars=tuple(group),
                own_uncertainty_mm3=width * float(np.sqrt(total)),
                roughness_mm3=width * float(np.sqrt(total - by_level)),
                levelling_mm3=width * float(np.sqrt(by_level)),
            )
        )  # fmt: skip
    scatter = TraceScatter(1.0, np.inf, 0.0, 0)
    if volumes:
        share = np.array(weights) / np.sum(weights)
        before = min(MOST_FREEDOM, float(1.0 / np.sum(share**2 / np.array(known))))
        both = before + freedom
        phi = (before + square) / both * student_factor_of(both)
        scatter = TraceScatter(phi, both, square, freedom)
    wider = float(np.sqrt(scatter.factor))
    volumes = [replace(v, own_uncertainty_mm3=wider * v.own_uncertainty_mm3) for v in volumes]
    spreads = settings.uncertainty.volume_mm3 or [np.nan] * len(settings.volume)
    for given, spread in zip(settings.volume, spreads, strict=True):
        volume = WornVolume(**_slid(given), volume_mm3=given.value_mm3, own_uncertainty_mm3=spread)
        volumes.append(volume)
    return tuple(volumes), scatter


def _slid(test: SlidTest) -> dict[str, Any]:
    return {name: getattr(test, name) for name in SlidTest.model_fields}
