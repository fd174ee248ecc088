"""The frames' own fits: all that can be known where nothing ties them, else where a fit starts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import budget_of
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.frame_estimate import FrameFit
from isochrome.fitting.frame.unknowns import LOAD, WEAR
from isochrome.fitting.joint.frame_sequence import COURSE, Sequence, Unknown, local_values
from isochrome.fitting.joint.joint_fit import JointFit
from isochrome.scene import DistanceTable

_LEAST = 1e-2
"""Least share of the scene's own wear that a fit starts with."""


def is_each(sequence: Sequence) -> bool:
    """Whether each frame's own fit is all that can be known of it.

    So it is where frames share neither unknowns nor a history, and for a single frame, but where a
    frame shows a state that other distances led to, which its own fit does not follow, or a scar
    was measured.
    """
    if sequence.areas:
        return False
    scene = sequence.scene
    given = [key for key in COURSE if getattr(scene, key.partition(".")[0]) is not None]
    if any(isinstance(scene.get(key), DistanceTable) for key in given):
        return False
    shared = any(unknown.shared for unknown in sequence.unknowns)
    return sequence.count == 1 or not (sequence.run or shared)


def fit_of_each(sequence: Sequence, alone: list[FrameFit]) -> JointFit:
    """The fits of frames that nothing ties together as one of all of them.

    Memory grows with the frames, not with the square of their number. A frame's own fit may have
    more keys than the sequence, of a smooth stress: they become unknowns too.
    Parameters: `sequence`; `alone`, each frame's fit. Returns a JointFit, without matrices.
    """
    own_load = any(u.key == LOAD and not u.shared for u in sequence.unknowns)
    shared = sequence.count == 1 and not own_load
    more = dict.fromkeys(
        key for i, fit in enumerate(alone) for key in fit.keys[len(sequence.acting(i)) :]
    )
    places = [(key, i) for key in more for i, fit in enumerate(alone) if key in fit.keys]
    added = tuple(Unknown(key, (i,), shared) for key, i in places)
    wider = replace(sequence, unknowns=(*sequence.unknowns, *added))
    first = [(alone[unknown.frames[0]], unknown.key) for unknown in wider.unknowns]
    values, spread, noise, bound = (
        np.array([getattr(fit, name)[fit.keys.index(key)] for fit, key in first])
        for name in ("values", "standard_uncertainty", "noise_uncertainty", "cramer_rao_bound")
    )
    known = tuple(dict.fromkeys(key for fit in alone for key in fit.inputs.keys))
    cost = sum(fit.chi**2 * fit.freedom for fit in alone)
    freedom = sum(fit.freedom for fit in alone)
    return JointFit(
        sequence=wider,
        values=values,
        standard_uncertainty=spread,
        cramer_rao_bound=bound,
        covariance=None,
        information=None,
        chi=float(np.sqrt(cost / freedom)),
        frame_chi=tuple(fit.chi for fit in alone),
        cost=cost,
        freedom=freedom,
        scene=wider.whole(values),
        scenes=tuple(fit.scene for fit in alone),
        converged=all(fit.converged for fit in alone),
        lost=tuple(i for i, fit in enumerate(alone) if not fit.positive),
        noise_uncertainty=noise,
        budget=tuple(
            budget_of(own, fit.inputs.rows, fit.sensitivity[fit.keys.index(key)]) if known else ()
            for own, (fit, key) in zip(noise.tolist(), first, strict=True)
        ),
        known=known,
    )


def starting_values(sequence: Sequence, alone: list[FrameFit]) -> Array:
    """Where the joint fit starts, from the frames' own fits.

    A frame's own value is its own; a shared one, the mean weighted by the uncertainties. The wear
    coefficient is found from the areas that the frames say were worn, under their own friction.
    Raises PhysicsError for an unknown that no frame tells, nor a measured scar.
    """
    for unknown in sequence.unknowns:
        if sequence.areas and unknown.key in COURSE:
            continue  # a scar may tell it; what nothing tells is refused where the fit ends
        refuse_undetermined(unknown.key, [alone[i] for i in unknown.frames])
    values = np.array([_mean([alone[i] for i in u.frames], u.key) for u in sequence.unknowns])
    worn = [k for k, u in enumerate(sequence.unknowns) if u.key == WEAR]
    if worn:
        own = sequence.scene.get(WEAR)
        values[worn] = np.mean(own.value) if isinstance(own, DistanceTable) else own
        values[worn] *= _wear_factors(sequence, values, alone, worn)
    return values


def refuse_undetermined(key: str, fits: Iterable[FrameFit]) -> None:
    """Raise PhysicsError where none of some frames' own fits tells a key."""
    if not any(np.isfinite(_spread(fit, key)) for fit in fits):
        raise PhysicsError(
            f"{key} does not change the fringes of these frames, so that they cannot "
            "determine it; leave it out"
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


def _spread(fit: FrameFit, key: str) -> float:
    """A key's standard uncertainty from one frame alone, infinite where it says nothing."""
    return float(fit.standard_uncertainty[fit.keys.index(key)]) if key in fit.keys else np.inf


def _mean(fits: list[FrameFit], key: str) -> float:
    values = [fit.values[fit.keys.index(key)] for fit in fits]
    weights = [1.0 / max(_spread(fit, key), 1e-300) ** 2 for fit in fits]
    return float(np.average(values, weights=weights)) if any(weights) else float(np.mean(values))
