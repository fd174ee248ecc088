"""The frames' own fits: all that can be known where nothing ties them, else where a fit starts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import (
    CUTOFF,
    BudgetInput,
    budget_of,
    information_bound,
    scaled_inverse,
    standard_uncertainty,
)
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
    """Whether each frame's own fit is all that can be known of it.

    So it is where frames share neither unknowns nor a history, and for a single frame, but where a
    frame shows a state that other distances led to, which its own fit does not follow, or scars
    were measured of a run of several.
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
    """The fits of frames that nothing ties together as one of all of them.

    Memory grows with the frames, not with the square of their number. A frame's own fit may have
    more keys than the sequence, of a smooth stress: they become unknowns too.
    Parameters: `sequence`; `single_fits`, each frame's fit. Returns a JointFit, without matrices.
    """
    own_load = any(u.key == LOAD and not u.shared for u in sequence.unknowns)
    shared = sequence.count == 1 and not own_load
    more = dict.fromkeys(
        key for i, fit in enumerate(single_fits) for key in fit.keys[len(sequence.acting(i)) :]
    )
    places = [(key, i) for key in more for i, fit in enumerate(single_fits) if key in fit.keys]
    added = tuple(Unknown(key, (i,), shared) for key, i in places)
    wider = replace(sequence, unknowns=(*sequence.unknowns, *added))
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
        budget=tuple(
            budget_of(noise_of, fit.inputs.rows, fit.sensitivity[fit.keys.index(key)])
            if known
            else ()
            for noise_of, (fit, key) in zip(noise.tolist(), first, strict=True)
        ),
        known=known,
    )


def with_scars(joint: JointFit, single_fit: FrameFit) -> JointFit:
    """The fit of a single frame, with the worn areas that were measured beside it.

    The frame says v0 with covariance C, all that it leaves undecided among it but what is held, and
    an area A with uncertainty u says W(v). With H = dW/dv over u, the values of both,

        v = v0 + K ((A - W(v))/u + H (v - v0)),  K = C H^T (H C H^T + 1)^-1,

    have the covariance (1 - K H) C: they are never less sure than the frame's own.
    Parameters: `joint`, of the frame alone, by `fit_of_each`; `single_fit`, which tells all its
    keys.
    Source: Rodgers (2000), Inverse methods for atmospheric sounding, sections 4.1 and 5.3.
    """
    update = _scar_update(joint.sequence, single_fit)
    known, complement, gain = single_fit.inputs, update.left, update.gain
    noise = (
        single_fit.covariance
        - (single_fit.sensitivity * known.spread**2) @ single_fit.sensitivity.T
    )
    noise = complement @ noise @ complement.T + gain @ gain.T
    sensitivity = complement @ single_fit.sensitivity
    # of the inputs, those that are held come last, and move the areas too
    sensitivity[:, sensitivity.shape[1] - update.by_held.shape[1] :] -= gain @ update.by_held
    covariance = noise + (sensitivity * known.spread**2) @ sensitivity.T
    information = single_fit.information + update.slope.T @ update.slope
    inverse = scaled_inverse(information + known.prior(single_fit.keys).normal, CUTOFF)
    values, every = update.values, np.ones(len(single_fit.keys), dtype=bool)
    moved, residual = values - single_fit.values, update.residual
    cost = joint.cost + float(moved @ single_fit.information @ moved + residual @ residual)
    noise_spread = standard_uncertainty(noise, every)
    return replace(
        joint,
        values=values,
        standard_uncertainty=standard_uncertainty(covariance, every),
        cramer_rao_bound=information_bound(inverse, every),
        covariance=covariance,
        information=information,
        chi=float(np.sqrt(cost / (joint.freedom + residual.size))),
        cost=cost,
        freedom=joint.freedom + residual.size,
        scene=joint.sequence.whole(values),
        scenes=(
            single_fit.scene.with_values(dict(zip(single_fit.keys, values.tolist(), strict=True))),
        ),
        noise_uncertainty=noise_spread,
        budget=_budgets(noise_spread, single_fit, sensitivity),
    )


@dataclass(frozen=True, kw_only=True)
class _ScarUpdate:
    """A frame's `values` (p,) with scars: what `with_scars` calls K, `gain` (p, m), and H, `slope`.

    `left` (p, p), 1 - K H; `by_held` (m, k), change of the areas with what is held, over their
    uncertainties; `residual` (m,), what the areas differ by in the end.
    """

    values: Array
    gain: Array
    slope: Array
    left: Array
    by_held: Array
    residual: Array


def _scar_update(sequence: Sequence, single_fit: FrameFit) -> _ScarUpdate:
    """The values of a frame and its scars, by repeated steps."""
    held = single_fit.inputs.some(single_fit.keys, free=False)
    added = tuple(Unknown(key, (0,), True) for key in held.keys)
    wider = replace(sequence, unknowns=(*sequence.unknowns, *added))
    values, size = single_fit.values, single_fit.values.size
    by_input = single_fit.sensitivity[:, single_fit.sensitivity.shape[1] - len(held.keys) :]
    noise_covariance = single_fit.covariance - (by_input * held.spread**2) @ by_input.T
    for _ in range(_STEPS):
        rows, residual = scar_rows(wider, np.r_[values, held.values])
        slope = rows[:size].T
        spread = slope @ noise_covariance @ slope.T + np.eye(residual.size)
        gain = np.linalg.solve(spread, slope @ noise_covariance).T
        values = single_fit.values + gain @ (residual + slope @ (values - single_fit.values))
    _, residual = scar_rows(wider, np.r_[values, held.values])
    complement = np.eye(size) - gain @ slope
    return _ScarUpdate(
        values=values,
        gain=gain,
        slope=slope,
        left=complement,
        by_held=rows[size:].T,
        residual=residual,
    )


def _budgets(
    noise: Array, fit: FrameFit, sensitivity: Array
) -> tuple[tuple[BudgetInput, ...], ...]:
    """The budget of each unknown (p,), by the fit's inputs; empty ones where it has none."""
    if not fit.inputs.keys:
        return tuple(() for _ in noise)
    pairs = zip(noise.tolist(), sensitivity, strict=True)
    return tuple(budget_of(noise_of, fit.inputs.rows, row) for noise_of, row in pairs)


def starting_values(sequence: Sequence, single_fits: list[FrameFit]) -> Array:
    """Where the joint fit starts, from the frames' own fits.

    A frame's own value is its own; a shared one, the mean weighted by the uncertainties. The wear
    coefficient is found from the areas that the frames say were worn, under their own friction.
    Raises PhysicsError for an unknown that no frame tells, nor a measured scar.
    """
    for unknown in sequence.unknowns:
        if sequence.areas and unknown.key in COURSE:
            continue  # a scar may tell it; what nothing tells is refused where the fit ends
        refuse_undetermined(unknown.key, [single_fits[i] for i in unknown.frames])
    values = np.array([_mean([single_fits[i] for i in u.frames], u.key) for u in sequence.unknowns])
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
        raise PhysicsError(
            f"{key} does not change the fringes of these frames, so that they cannot "
            "determine it; leave it out"
        )


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
    own = np.diff(np.array(fitted)[last], prepend=0.0) / np.diff(np.array(given)[last], prepend=0.0)
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
