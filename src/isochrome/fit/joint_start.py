"""Where a joint fit starts: from what each frame says on its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import PhysicsError
from isochrome.fit.frame_data import FrameData
from isochrome.fit.frame_fit import FrameFit, fit_frame
from isochrome.fit.history import alone_scene, local_values
from isochrome.fit.sequence import Sequence
from isochrome.scene import DistanceTable, Scene

Array = NDArray[Any]

WEAR = "wear.coefficient_mm2_per_n"


def fit_alone(
    frames: Iterable[FrameData],
    sequence: Sequence,
    *,
    follow: bool = False,
    told: Callable[[], None],
) -> list[FrameFit]:
    """Each frame on its own, from several starts, for all the keys that act in it.

    Parameters: `frames`; `sequence`; `follow`, whether a frame starts where the last one ended,
    and from there alone; `told`, called with each frame done. Returns a FrameFit of each.
    """
    found: list[FrameFit] = []
    for i, data in enumerate(frames):
        scene, keys = alone_scene(sequence.scene, i), sequence.acting(i)
        options: dict[str, Any] = {}
        if follow and found and found[-1].positive:
            last = dict(zip(found[-1].keys, found[-1].values.tolist(), strict=True))
            scene = scene.with_values({key: last[key] for key in keys if key in last})
            options = {"load_factors": (1.0,), "place_px": (0.0,)}
        found.append(fit_frame(data, scene, keys, **options))
        told()
    return found


def starting_values(sequence: Sequence, alone: list[FrameFit]) -> Array:
    """Where the joint fit starts, from the frames' own fits.

    A frame's own value is its own; a shared one, the mean weighted by the uncertainties. The wear
    coefficient is found from the areas that the frames say were worn, under their own friction.
    Raises PhysicsError for a key that no frame tells.
    """
    for unknown in sequence.unknowns:
        if not any(np.isfinite(_spread(alone[i], unknown.key)) for i in unknown.frames):
            raise PhysicsError(
                f"{unknown.key} does not change the fringes of these frames, so that they cannot "
                "tell it; leave it out"
            )
    values = np.array([_mean([alone[i] for i in u.frames], u.key) for u in sequence.unknowns])
    worn = [k for k, u in enumerate(sequence.unknowns) if u.key == WEAR]
    values[worn] = _scene_wear(sequence.scene) if worn else 0.0
    for k in worn:
        values[k] *= _wear_factor(sequence, values, alone, sequence.unknowns[k].frames)
    return values


def _wear_factor(
    sequence: Sequence, values: Array, alone: list[FrameFit], frames: tuple[int, ...]
) -> float:
    """Worn area that frames show, over that of the scene's own wear coefficient."""
    whole, factors, weights = sequence.whole(values), [], []
    for i in frames:
        fit, distance = alone[i], sequence.distances_m[i]
        own = fit.values[fit.keys.index(WEAR)]
        assert distance is not None
        found = local_values(fit.scene, (distance,))[0, 2]
        given = local_values(sequence.frame(whole, values, i), (distance,))[0, 2]
        factors.append(found / given)
        weights.append((own / _spread(fit, WEAR)) ** 2)
    return float(np.average(factors, weights=weights))


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
