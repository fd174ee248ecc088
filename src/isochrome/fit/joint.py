"""Several frames fitted together: unknowns that they share, and unknowns of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError, PhysicsError
from isochrome.fit.frame_data import FrameData
from isochrome.fit.frame_fit import EDGE_PX, FrameFit, fit_frame, thinning
from isochrome.fit.intensity import IntensityFit, fit_intensity
from isochrome.fit.one_state import with_numerics
from isochrome.fit.renderer import SceneRenderer, safe_signal
from isochrome.fit.unknowns import bounds, fit_region, scales
from isochrome.scene import Scene

Array = NDArray[Any]

MAX_FRAMES = 16
"""Frames that are fitted together: beyond, the linear parts no longer fit in memory."""

_PIXELS = 120_000


@dataclass(frozen=True)
class Unknown:
    """One unknown of a joint fit: its `key`, and its `frame` (None where all frames share it)."""

    key: str
    frame: int | None


@dataclass(frozen=True)
class JointFit:
    """Fitted `unknowns` (p,), `values`, `standard_uncertainty`, `chi`; and each frame's scene."""

    unknowns: tuple[Unknown, ...]
    values: Array
    standard_uncertainty: Array
    covariance: Array
    chi: float
    scenes: tuple[Scene, ...]
    converged: bool


def has_key(scene: Scene, key: str) -> bool:
    """Whether a one-state scene has a number under a key (a static state has no friction)."""
    try:
        return isinstance(scene.get(key), int | float)
    except InputError:
        return False


def fit_jointly(
    frames: list[FrameData], scenes: list[Scene], shared: tuple[str, ...], own: tuple[str, ...]
) -> JointFit:
    """Fit unknowns that all frames share together with unknowns that each frame has of its own.

    Each frame is first fitted alone, from several starts, for all keys: the mean (weighted by the
    uncertainties) starts the shared ones. Then one least squares over all frames' intensities,
    each with its own illumination and background.
    Parameters: `frames` and their one-state `scenes`; `shared`, `own`, keys. Returns a JointFit.
    Raises InputError for too many frames or a key that no frame has, PhysicsError
    for one that has no effect.
    """
    if len(frames) > MAX_FRAMES:
        raise InputError(
            f"{len(frames)} frames to fit together, and {MAX_FRAMES} is the most; fit fewer, or "
            "give all keys as --per-frame"
        )
    keys = tuple(dict.fromkeys((*shared, *own)))
    alone = []
    for data, scene in zip(frames, scenes, strict=True):
        alone.append(fit_frame(data, scene, tuple(k for k in keys if has_key(scene, k))))
    unknowns = [Unknown(key, None) for key in shared]
    unknowns += [Unknown(key, i) for i, fit in enumerate(alone) for key in own if key in fit.keys]
    for unknown in unknowns:
        if not any(unknown.key in fit.keys for fit in alone):
            raise InputError(f"{unknown.key}: no frame's scene has this key; leave it out")
    for key in keys:
        if not any(np.isfinite(_spread(fit, key)) for fit in alone):
            raise PhysicsError(
                f"{key} does not change the fringes of these frames, so that they cannot tell it; "
                "leave it out"
            )
    if len(frames) == 1:
        only = alone[0]
        names = tuple(Unknown(key, None if key in shared else 0) for key in only.keys)
        return JointFit(
            names, only.values, only.standard_uncertainty, only.covariance, only.chi,
            (only.scene,), only.converged,
        )  # fmt: skip
    return _together(frames, [fit.scene for fit in alone], tuple(unknowns), alone)


def _spread(fit: FrameFit, key: str) -> float:
    """A key's standard uncertainty from one frame alone, infinite where it says nothing."""
    return float(fit.standard_uncertainty[fit.keys.index(key)]) if key in fit.keys else np.inf


def _together(
    frames: list[FrameData],
    scenes: list[Scene],
    unknowns: tuple[Unknown, ...],
    alone: list[FrameFit],
) -> JointFit:
    shape = frames[0].light.shape
    stride = thinning(shape[0] * shape[1] * len(frames), _PIXELS)
    thin = [data.every(stride) for data in frames]
    start = np.array([_start(unknown, alone) for unknown in unknowns])
    fine = [
        with_numerics(scene, nodes_per_pixel=2, tolerance=3e-4, room=1.2)
        for scene in _apply(scenes, unknowns, start)
    ]
    renderers = [SceneRenderer(scene, (shape[0], shape[1]), stride=stride) for scene in fine]

    def response(values: Array) -> Array:
        moved = _apply(fine, unknowns, values)
        return np.concatenate([safe_signal(r, s) for r, s in zip(renderers, moved, strict=True)])

    mask = np.concatenate(
        [
            data.valid & fit_region(scene, shape, stride, EDGE_PX)
            for data, scene in zip(thin, fine, strict=True)
        ]
    )
    of_key = [next(s for s in fine if has_key(s, u.key)) for u in unknowns]
    limits = [bounds(scene, (u.key,)) for scene, u in zip(of_key, unknowns, strict=True)]
    result: IntensityFit = fit_intensity(
        np.concatenate([data.light for data in thin]),
        response,
        start,
        illumination=_blocks([data.illumination for data in thin]),
        background=_blocks([data.background for data in thin]),
        mask=mask & np.isfinite(response(start)),
        sigma=np.concatenate([data.sigma for data in thin]),
        scale=np.array([scales(s, (u.key,))[0] for s, u in zip(of_key, unknowns, strict=True)]),
        lower=np.concatenate([limit["lower"] for limit in limits]),
        upper=np.concatenate([limit["upper"] for limit in limits]),
        tolerance=0.03,
        central=False,
    )
    fitted = tuple(_apply(scenes, unknowns, result.values))
    return JointFit(
        unknowns, result.values, result.standard_uncertainty, result.covariance, result.chi,
        fitted, result.converged,
    )  # fmt: skip


def _start(unknown: Unknown, alone: list[FrameFit]) -> float:
    """A frame's own value, or the weighted mean of all frames'."""
    if unknown.frame is not None:
        fit = alone[unknown.frame]
        return float(fit.values[fit.keys.index(unknown.key)])
    found = [
        (
            fit.values[fit.keys.index(unknown.key)],
            fit.standard_uncertainty[fit.keys.index(unknown.key)],
        )
        for fit in alone
        if unknown.key in fit.keys
    ]
    values, spread = np.array(found).T
    weight = 1.0 / np.maximum(spread, 1e-300) ** 2
    return float(np.sum(weight * values) / np.sum(weight))


def _apply(scenes: list[Scene], unknowns: tuple[Unknown, ...], values: Array) -> list[Scene]:
    """The frames' scenes with the unknowns at given values."""
    moved = []
    for i, scene in enumerate(scenes):
        own = {
            u.key: float(value)
            for u, value in zip(unknowns, values, strict=True)
            if u.frame in (None, i) and has_key(scene, u.key)
        }
        moved.append(scene.with_values(own))
    return moved


def _blocks(stacks: list[Array]) -> Array:
    """Bases of frames set one below the other: each is zero in the others' rows."""
    rows = [stack.shape[1] for stack in stacks]
    total = np.zeros((sum(len(s) for s in stacks), sum(rows), stacks[0].shape[2]))
    member = top = 0
    for stack, height in zip(stacks, rows, strict=True):
        total[member : member + len(stack), top : top + height] = stack
        member, top = member + len(stack), top + height
    return total
