"""The patches from which the ends of the light are found: cut from the frame at some unknowns.

The frame is normalised by the ends as they stand, cut into patches and fitted by quadratics as any
frame is (`fringes.patches`); those that can be followed are used, with their light as it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.fringes.ends_problem import TERMS, PatchData, Problem, look, refine
from isochrome.fringes.patches import STRIDE, Array, fit_patches, gather_patches, offsets

Indices = NDArray[np.intp]

_BETTER = 0.97
"""Share of its former cost below which a patch counts as better."""
_MANY = 400
"""Patches from which every second is left out: they overlap, and tell the same twice."""
_LEAST_PATCHES = 12
_WORST_CHI, _LEAST_FILLED, _STEEPEST, _FAINT = 30.0, 0.5, 0.35, 0.1


def fresh_patches(
    problem: Problem, unknowns: Array, before: tuple[PatchData, Array] | None = None
) -> tuple[PatchData, Array, float]:
    """Patches fitted anew at some unknowns, but kept where they were better.

    Parameters: `problem`; `unknowns` (terms,); `before`, the patches in use and their orders, if
    any. Returns the patches, their orders, and the share that was better anew. Raises InputError
    where too few can be followed.
    """
    index, places, window, start, thinned = _fitted(problem, unknowns)
    data = _data(problem, index, places, window, np.ones(len(index)), thinned)
    orders, cost, _ = refine(problem, data, unknowns, start, np.full(len(index), 1e-2), 3)
    stale = 1.0
    if before is not None:
        old = np.zeros_like(orders)
        was = np.full(len(index), np.inf)
        _, here, there = np.intersect1d(index, before[0].index, return_indices=True)
        old[here] = before[1][there]
        was[here] = look(problem, data, unknowns, old).cost[here]
        orders = np.asarray(np.where((was <= cost)[:, None], old, orders))
        stale = float(np.mean(cost < _BETTER * was - 0.02 * data.window))
    misfit = look(problem, data, unknowns, orders).residual
    chi = np.sqrt(np.einsum("pk,pk,pk->p", data.weight, misfit, misfit) / data.window)
    good = (chi < _WORST_CHI) & (np.abs(orders[:, 1:3]).max(axis=1) < _STEEPEST)
    if np.count_nonzero(good) < _LEAST_PATCHES:
        raise InputError(
            "too few fringes can be followed to find background and illumination from them; give "
            "both no-load frames"
        )
    data = _data(problem, index[good], places[good], window[good], chi[good], thinned)
    return data, orders[good], stale


def _fitted(problem: Problem, unknowns: Array) -> tuple[Indices, Indices, Array, Array, bool]:
    """Patches as `fringes.patches` fits them: index, middles, weights, terms; whether thinned."""
    frame = _normalised(problem, unknowns)
    light = gather_patches(*frame)
    fitted = fit_patches(light, *frame)
    use = (light.filled > _LEAST_FILLED) & (fitted.chi.ravel() < _WORST_CHI)
    thinned = bool(np.count_nonzero(use) > _MANY)
    if thinned:
        use &= (np.add.outer(*(np.arange(n) for n in fitted.chi.shape)) % 2 == 0).ravel()
    index = np.flatnonzero(use)
    terms = np.zeros((len(index), TERMS))
    terms[:, :6] = fitted.terms.reshape(-1, 6)[index]
    places = np.stack(np.meshgrid(light.rows, light.cols, indexing="ij"), axis=-1).reshape(-1, 2)
    return index, places[index], light.weight[index].astype(float), terms, thinned


def _normalised(problem: Problem, unknowns: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """The frame's c = cos 2 pi N, its noise, and where it is trusted."""
    dark, bright = problem.ends(problem.shapes, unknowns)
    g = unknowns[-1]
    contrast = bright - dark
    seen = problem.valid & (contrast > _FAINT * problem.scale**g)
    safe = np.where(seen, contrast, 1.0)
    level = np.maximum(problem.light, problem.sigma)
    linear = problem.light if g == 1.0 else level**g
    sigma = 2.0 * g * level ** (g - 1.0) * problem.sigma / safe
    return 1.0 - 2.0 * (linear - dark) / safe, sigma, seen


def _data(
    problem: Problem,
    index: Indices,
    places: Indices,
    window: Array,
    chi: Array,
    thinned: bool,
) -> PatchData:
    """The patches' pixels; one that no cubic describes counts for less."""
    dy, dx, _ = offsets()
    rows, cols = places[:, :1] + dy, places[:, 1:] + dx
    noise = problem.sigma[rows, cols] * np.maximum(chi, 1.0)[:, None]
    dark, bright = problem.shapes
    middle = places[:, 0], places[:, 1]
    return PatchData(
        index,
        problem.light[rows, cols],
        window / noise**2,
        (dark[rows, cols], bright[rows, cols]),
        (dark[middle], bright[middle]),
        np.maximum(window.sum(axis=1), 1e-9),
        chi,
        thinned,
    )


def overlap(data: PatchData) -> float:
    """How often a pixel was counted, being in several patches; `data`, those in use."""
    stride = STRIDE * (np.sqrt(2.0) if data.thinned else 1.0)
    return float(max(1.0, offsets()[2].sum() / stride**2))
