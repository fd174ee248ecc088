"""How sure a number is that follows from a fitted scene: its largest order, its pressure."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import STEP
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.frame_estimate import FrameFit
from isochrome.fitting.frame.unknowns import moved_scene, scales, values_of
from isochrome.scene import Scene


def propagated(fit: FrameFit, numbers: Callable[[Scene], Array]) -> tuple[Array, Array]:
    """Give numbers of a fitted scene, and their standard uncertainties.

    Equation: u² = g C gᵀ + Σ (g c + h)² u_i² with g, h the derivatives by the unknowns and by the
    inputs that the fit holds, C the covariance by noise, c the values' sensitivity to the inputs: a
    load that makes up for a wrong fringe value leaves the order as it is.
    Source: JCGM 102:2011, 6.2.

    Parameters
    ----------
    fit : FrameFit
        The fit.
    numbers : callable
        Gives the numbers (m,) of a scene.

    Returns
    -------
    values : ndarray, (m,)
        The numbers.
    standard_uncertainty : ndarray, (m,)
        Theirs; inf where a value matters that the frame does not tell.

    Raises
    ------
    PhysicsError
        Where the scene cannot be solved beside its values.
    """
    keys = tuple(dict.fromkeys((*fit.keys, *fit.inputs.keys)))
    values, steps = values_of(fit.scene, keys), STEP * scales(fit.scene, keys)
    here = numbers(fit.scene)
    slopes = np.transpose([
        _slope(fit.scene, numbers, here, key, value, step)
        for key, value, step in zip(keys, values, steps, strict=True)
    ])  # fmt: skip
    count = len(fit.keys)
    own, held = slopes[:, :count], np.zeros((len(here), len(fit.inputs.keys)))
    for k, key in enumerate(fit.inputs.keys):
        if key not in fit.keys:
            held[:, k] = slopes[:, keys.index(key)]
    noise = fit.covariance - (fit.sensitivity * fit.inputs.spread**2) @ fit.sensitivity.T
    by_inputs = (own @ fit.sensitivity + held) * fit.inputs.spread
    variance = np.einsum("ij,jk,ik->i", own, noise, own) + (by_inputs**2).sum(axis=1)
    untold = (own[:, ~np.isfinite(fit.standard_uncertainty)] != 0.0).any(axis=1)
    return here, np.where(untold, np.inf, np.sqrt(np.maximum(variance, 0.0)))


def _slope(
    scene: Scene,
    numbers: Callable[[Scene], Array],
    here: Array,
    key: str,
    value: float,
    step: float,
) -> Array:
    """The numbers' derivatives by a key, to whichever side of its value there is a scene."""
    for one in (step, -step):
        try:
            moved = numbers(moved_scene(scene, (key,), np.array([value + one])))
        except (InputError, PhysicsError):
            continue
        return np.asarray((moved - here) / one)
    raise PhysicsError(f"{key} = {value:g}: the scene cannot be solved beside it")
