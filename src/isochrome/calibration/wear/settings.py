"""The set of a wear calibration: traces over scars or worn volumes, and what made them."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from isochrome.calibration.settings import ImageSet
from isochrome.scene import (
    FileName,
    NonNegative,
    Positive,
    ScenePart,
    plain_value,
    split_uncertainties,
)

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
    distance_m, normal_n : float
        Distance slid, m, and load, N.
    friction : float, optional
        Mean friction coefficient.
    """

    file: FileName


class WearVolume(SlidTest):
    """A worn volume that was measured otherwise; the parameters of `SlidTest` besides.

    Parameters
    ----------
    value_mm3 : float
        The volume, mm³.
    distance_m, normal_n : float
        Distance slid, m, and load, N.
    friction : float, optional
        Mean friction coefficient.
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
        return _with_stated(cls, data) if isinstance(data, dict) else data

    @model_validator(mode="after")
    def _complete(self) -> WearSet:
        if not (self.trace or self.volume):
            raise ValueError("has neither a [[trace]] nor a [[volume]]; add what was measured")
        if self.trace and self.scar is None:
            raise ValueError(
                "the key 'scar.width_mm' is missing, the width of the worn track along the "
                "cylinder's axis, and traces need it; add it"
            )
        for kind, tests in (("trace", self.trace), ("volume", self.volume)):
            for number, (one, other) in enumerate(pairwise(tests), start=2):
                if other.distance_m < one.distance_m:
                    raise ValueError(
                        f"{kind}[{number}].distance_m = {other.distance_m:g} comes after "
                        f"{one.distance_m:g}, and distances must not fall; check it, and sort the "
                        f"[[{kind}]] by distance"
                    )
        if not any(volume.value_mm3 for volume in self.volume) and not self.trace:
            raise ValueError("no [[volume]] is above 0; a coefficient needs one that is")
        own = self.uncertainty.volume_mm3
        if own is not None and len(own) != len(self.volume):
            raise ValueError(
                f"{len(self.volume)} volumes and {len(own)} uncertainties of them; state one "
                "beside each or none"
            )
        if self.trace and self.volume and own is None:
            raise ValueError(
                "a [[volume]] beside traces needs its uncertainty to be weighed against them; "
                "write value_mm3 = { value = ..., standard_uncertainty = ... }"
            )
        files = [trace.file for trace in self.trace]
        twice = next((f for f in files if files.count(f) > 1), None)
        if twice is not None:
            raise ValueError(f"trace file = {twice!r} stands twice; name each trace once")
        return self


_COMMON = {"normal_n": "load_percent", "distance_m": "distance_percent"}
"""Keys of each test whose relative uncertainty is common to all."""


def _with_stated(model: type[WearSet], data: dict[str, Any]) -> dict[str, Any]:
    """A set's tables with plain values, and what stood beside them under [uncertainty]."""
    plain, stated = split_uncertainties(model, data)
    found: dict[str, Any] = {}
    for key, spread in stated.items():
        if key != "scar.width_mm":
            raise ValueError(f"{key} has no standard_uncertainty here; give a plain value")
        found["width_mm"] = spread
    relative: dict[str, list[float]] = {}
    for kind in ("trace", "volume"):
        tests, spreads = _plain_tests(plain.get(kind), kind)
        if tests is not None:
            plain = plain | {kind: tests}
        for name, values in spreads.items():
            relative.setdefault(name, []).extend(values)
    own = relative.pop("value_mm3", None)
    if own:
        found["volume_mm3"] = own
    for name, values in relative.items():
        found[_COMMON[name]] = 100.0 * float(np.sqrt(np.mean(np.square(values))))
    if not found:
        return plain
    given = plain.get("uncertainty")
    table = given if isinstance(given, dict) else {}
    for key in found:
        if key in table:
            raise ValueError(f"uncertainty.{key} is stated beside its value too; remove one")
    return plain | {"uncertainty": table | found}


def _plain_tests(tests: Any, kind: str) -> tuple[Any, dict[str, list[float]]]:
    """Tests with plain values, and the uncertainties beside them: relative, a volume's in mm³."""
    if not isinstance(tests, list | tuple):
        return tests, {}
    plain: list[Any] = []
    found: dict[str, list[float]] = {}
    for number, test in enumerate(tests, start=1):
        if isinstance(test, dict):
            for name in (*_COMMON, "value_mm3"):
                if isinstance(test.get(name), dict):
                    value, spread = plain_value(f"{kind}[{number}].{name}", test[name])
                    test = test | {name: value}
                    if isinstance(value, int | float) and value > 0:
                        size = 1.0 if name == "value_mm3" else value
                        found.setdefault(name, []).append(spread / size)
        plain.append(test)
    return plain, found
