"""Where a joint fit starts: from what each frame says on its own."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import PhysicsError
from isochrome.fit.frame_fit import FrameFit
from isochrome.fit.history import local_values
from isochrome.fit.sequence import WEAR, Sequence
from isochrome.scene import DistanceTable, Scene

Array = NDArray[Any]

_LEAST = 1e-2
"""Least share of the scene's own wear that a fit starts with."""


def starting_values(sequence: Sequence, alone: list[FrameFit]) -> Array:
    """Where the joint fit starts, from the frames' own fits.

    A frame's own value is its own; a shared one, the mean weighted by the uncertainties. The wear
    coefficient is found from the areas that the frames say were worn, under their own friction.
    Raises PhysicsError for an unknown that no frame tells.
    """
    for unknown in sequence.unknowns:
        refuse_untold(unknown.key, [alone[i] for i in unknown.frames])
    values = np.array([_mean([alone[i] for i in u.frames], u.key) for u in sequence.unknowns])
    worn = [k for k, u in enumerate(sequence.unknowns) if u.key == WEAR]
    if worn:
        values[worn] = _scene_wear(sequence.scene)
        values[worn] *= _wear_factors(sequence, values, alone, worn)
    return values


def refuse_untold(key: str, fits: Iterable[FrameFit]) -> None:
    """Raise PhysicsError where none of some frames' own fits tells a key."""
    if not any(np.isfinite(_spread(fit, key)) for fit in fits):
        raise PhysicsError(
            f"{key} does not change the fringes of these frames, so that they cannot tell it; "
            "leave it out"
        )


def _wear_factors(
    sequence: Sequence, values: Array, alone: list[FrameFit], worn: list[int]
) -> Array:
    """Worn area between frames, over what the scene's own wear coefficient gives there."""
    whole, found, given, weights = sequence.whole(values), [], [], []
    for k in worn:
        for i in sequence.unknowns[k].frames:
            fit, distance = alone[i], sequence.distances_m[i]
            assert distance is not None
            found.append(local_values(fit.scene, (distance,))[0, 2])
            given.append(local_values(sequence.frame(whole, values, i), (distance,))[0, 2])
            known = fit.values[fit.keys.index(WEAR)] / _spread(fit, WEAR)
            weights.append(max(1.0, known) ** 2)
    # a start of next to no wear, and not of none: a step is a share of it
    average = max(_LEAST, float(np.average(np.divide(found, given), weights=weights)))
    even = np.full(len(worn), average)
    if len(worn) == 1 or not sequence.run:
        return even
    order = np.argsort([sequence.distances_m[sequence.unknowns[k].frames[0]] or 0.0 for k in worn])
    last = [sum(len(sequence.unknowns[k].frames) for k in worn[: j + 1]) - 1 for j in order]
    own = np.diff(np.array(found)[last], prepend=0.0) / np.diff(np.array(given)[last], prepend=0.0)
    factors = np.empty(len(worn))
    factors[order] = own
    return factors if np.all(own > 0.1 * even) else even


def _scene_wear(scene: Scene) -> float:
    assert scene.wear is not None
    value = scene.wear.coefficient_mm2_per_n
    return float(np.mean(value.value)) if isinstance(value, DistanceTable) else value


def _spread(fit: FrameFit, key: str) -> float:
    """A key's standard uncertainty from one frame alone, infinite where it says nothing."""
    return float(fit.standard_uncertainty[fit.keys.index(key)]) if key in fit.keys else np.inf


def _mean(fits: list[FrameFit], key: str) -> float:
    values = [fit.values[fit.keys.index(key)] for fit in fits]
    weights = [1.0 / max(_spread(fit, key), 1e-300) ** 2 for fit in fits]
    return float(np.average(values, weights=weights)) if any(weights) else float(np.mean(values))
