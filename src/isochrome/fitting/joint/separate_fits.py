"""The frames' own fits: all that can be known where nothing ties them, else where a fit starts."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import CUTOFF, budgets_of, scaled_inverse, standard_uncertainty
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.frame_fit import FrameFit
from isochrome.fitting.frame.unknowns import LOAD, WEAR
from isochrome.fitting.joint.frame_sequence import COURSE, Sequence, Unknown, local_values
from isochrome.fitting.joint.joint_fit import JointFit
from isochrome.fitting.joint.measured_scars import scar_rows
from isochrome.scene import DistanceTable

_LEAST = 1e-2
"""Least share of the scene's own wear that a fit starts with."""
_STEPS = 4
"""Steps to what a frame and scars say together: W is all but linear over their uncertainties."""


def is_each(sequence: Sequence) -> bool:
    """Whether each frame's own fit is all that can be known of it: nothing is shared, no history.

    Not where a frame shows a state that other distances led to, nor where scars were measured of a
    run of several.
    """
    if sequence.areas and sequence.count > 1:
        return False
    scene = sequence.scene
    given = [key for key in COURSE if getattr(scene, key.partition(".")[0]) is not None]
    if any(isinstance(scene.get(key), DistanceTable) for key in given):
        return False
    shared = any(unknown.shared for unknown in sequence.unknowns)
    return sequence.count == 1 or not (sequence.run or shared)


def fit_of_each(sequence: Sequence, single_fits: list[FrameFit]) -> JointFit:
    """The fits of frames that nothing ties together as one of all of them, without matrices."""
    wider = _with_own_keys(sequence, single_fits)
    first = [(single_fits[unknown.frames[0]], unknown.key) for unknown in wider.unknowns]
    values, spread, noise, bound = (
        np.array([getattr(fit, name)[fit.keys.index(key)] for fit, key in first])
        for name in ("values", "standard_uncertainty", "noise_uncertainty", "cramer_rao_bound")
    )
    known = tuple(dict.fromkeys(key for fit in single_fits for key in fit.inputs.keys))
    cost = sum(fit.chi**2 * fit.freedom for fit in single_fits)
    freedom = sum(fit.freedom for fit in single_fits)
    return JointFit(
        sequence=wider,
        values=values,
        standard_uncertainty=spread,
        cramer_rao_bound=bound,
        covariance=None,
        information=None,
        chi=float(np.sqrt(cost / freedom)),
        frame_chi=tuple(fit.chi for fit in single_fits),
        cost=cost,
        freedom=freedom,
        scene=wider.whole(values),
        scenes=tuple(fit.scene for fit in single_fits),
        converged=all(fit.converged for fit in single_fits),
        lost=tuple(i for i, fit in enumerate(single_fits) if not fit.positive),
        noise_uncertainty=noise,
        budget=tuple(fit.budget_of_key(key) if known else () for fit, key in first),
        known=known,
    )


def _with_own_keys(sequence: Sequence, single_fits: list[FrameFit]) -> Sequence:
    """A sequence with what its frames' own fits have more, of a smooth stress, as unknowns."""
    own_load = any(u.key == LOAD and not u.shared for u in sequence.unknowns)
    shared = sequence.count == 1 and not own_load
    more = dict.fromkeys(
        key for i, fit in enumerate(single_fits) for key in fit.keys[len(sequence.acting(i)) :]
    )
    added = [
        Unknown(key, (i,), shared)
        for key in more
        for i, fit in enumerate(single_fits)
        if key in fit.keys
    ]
    return replace(sequence, unknowns=(*sequence.unknowns, *added))


def with_scars(joint: JointFit, single_fit: FrameFit) -> JointFit:
    """The fit of a single frame, by `fit_of_each`, with the worn areas measured beside it.

    The frame says v0 with covariance C of all but what is held; an area A of uncertainty u says
    W(v), H = dW/dv / u: v = v0 + K ((A - W(v))/u + H (v - v0)), K = C H^T (H C H^T + 1)^-1, of
    covariance (1 - K H) C. Source: Rodgers (2000), Inverse methods for atmospheric sounding, 5.3.
    """
    keys, known, sensitivity = single_fit.keys, single_fit.inputs, single_fit.sensitivity
    held = known.some(keys, free=False)
    added = tuple(Unknown(key, (0,), True) for key in held.keys)
    wider = replace(joint.sequence, unknowns=(*joint.sequence.unknowns, *added))
    size, free = single_fit.values.size, sensitivity.shape[1] - len(held.keys)
    by_held = sensitivity[:, free:]
    prior = single_fit.covariance - (by_held * held.spread**2) @ by_held.T
    values = single_fit.values
    for _ in range(_STEPS):
        rows, residual = scar_rows(wider, np.r_[values, held.values])
        slope = rows[:size].T
        spread = slope @ prior @ slope.T + np.eye(residual.size)
        gain = np.linalg.solve(spread, slope @ prior).T
        values = single_fit.values + gain @ (residual + slope @ (values - single_fit.values))
    _, residual = scar_rows(wider, np.r_[values, held.values])
    complement = np.eye(size) - gain @ slope
    noise = single_fit.covariance - (sensitivity * known.spread**2) @ sensitivity.T
    noise = complement @ noise @ complement.T + gain @ gain.T
    sensitivity = complement @ sensitivity
    sensitivity[:, free:] -= gain @ rows[size:].T  # what is held moves the areas too
    covariance = noise + (sensitivity * known.spread**2) @ sensitivity.T
    information = single_fit.information + slope.T @ slope
    inverse = scaled_inverse(information + known.prior(keys).normal, CUTOFF)
    every = np.ones(size, dtype=bool)
    moved = values - single_fit.values
    cost = joint.cost + float(moved @ single_fit.information @ moved + residual @ residual)
    noise_spread = standard_uncertainty(noise, every)
    freedom = joint.freedom + residual.size
    return replace(
        joint,
        values=values,
        standard_uncertainty=standard_uncertainty(covariance, every),
        cramer_rao_bound=standard_uncertainty(inverse, every),
        covariance=covariance,
        information=information,
        chi=float(np.sqrt(cost / freedom)),
        cost=cost,
        freedom=freedom,
        scene=joint.sequence.whole(values),
        scenes=(single_fit.scene.with_values(dict(zip(keys, values.tolist(), strict=True))),),
        noise_uncertainty=noise_spread,
        budget=budgets_of(noise_spread, known.rows, sensitivity),
    )


def starting_values(sequence: Sequence, single_fits: list[FrameFit]) -> Array:
    """Where the joint fit starts: own values, means weighted by uncertainty, wear by worn areas.

    PhysicsError for an unknown that no frame tells, nor a measured scar.
    """
    for unknown in sequence.unknowns:
        if sequence.areas and unknown.key in COURSE:
            continue  # a scar may tell it; what nothing tells is refused where the fit ends
        refuse_undetermined(unknown.key, [single_fits[i] for i in unknown.frames])
    values = np.empty(len(sequence.unknowns))
    for k, unknown in enumerate(sequence.unknowns):
        fits = [single_fits[i] for i in unknown.frames]
        weights = [1.0 / max(_spread(fit, unknown.key), 1e-300) ** 2 for fit in fits]
        each = [fit.values[fit.keys.index(unknown.key)] for fit in fits]
        values[k] = np.average(each, weights=weights if any(weights) else None)
    worn = [k for k, u in enumerate(sequence.unknowns) if u.key == WEAR]
    if worn:
        coefficient = sequence.scene.get(WEAR)
        values[worn] = (
            np.mean(coefficient.value) if isinstance(coefficient, DistanceTable) else coefficient
        )
        values[worn] *= _wear_factors(sequence, values, single_fits, worn)
    return values


def refuse_undetermined(key: str, fits: Iterable[FrameFit]) -> None:
    """Raise PhysicsError where none of some frames' own fits tells a key."""
    if not any(np.isfinite(_spread(fit, key)) for fit in fits):
        raise PhysicsError("does_not_change_fringes", key=key)


def _wear_factors(
    sequence: Sequence, values: Array, single_fits: list[FrameFit], worn: list[int]
) -> Array:
    """Worn area between frames, over what the scene's own wear coefficient gives there."""
    common, fitted, given, weights = sequence.whole(values), [], [], []
    for k in worn:
        for i in sequence.unknowns[k].frames:
            fit, distance = single_fits[i], sequence.distances_m[i]
            assert distance is not None
            fitted.append(local_values(fit.scene, (distance,))[0, 2])
            given.append(local_values(sequence.frame(common, values, i), (distance,))[0, 2])
            known = fit.values[fit.keys.index(WEAR)] / _spread(fit, WEAR)
            weights.append(max(1.0, known) ** 2)
    # a start of next to no wear, and not of none: a step is a share of it
    average = max(_LEAST, float(np.average(np.divide(fitted, given), weights=weights)))
    even = np.full(len(worn), average)
    if len(worn) == 1 or not sequence.run:
        return even
    order = np.argsort([sequence.distances_m[sequence.unknowns[k].frames[0]] or 0.0 for k in worn])
    last = [sum(len(sequence.unknowns[k].frames) for k in worn[: j + 1]) - 1 for j in order]
    worn_since, expected = (np.diff(np.array(v)[last], prepend=0.0) for v in (fitted, given))
    factors = np.empty(len(worn))
    factors[order] = worn_since / expected
    return factors if np.all(factors > 0.1 * even) else even


def _spread(fit: FrameFit, key: str) -> float:
    """A key's standard uncertainty from one frame alone, infinite where it says nothing."""
    return float(fit.standard_uncertainty[fit.keys.index(key)]) if key in fit.keys else np.inf
