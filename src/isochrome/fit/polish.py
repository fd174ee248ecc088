"""Steps from a start to the least squares of a frame, and how far its noise reaches into them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.linear import scaled_inverse
from isochrome.fit.local import FrameModel, LocalModel
from isochrome.fit.tone import Toned

Array = NDArray[Any]

_NEAR = 0.02
"""Last step in standard uncertainties."""
_FROZEN = 0.3
"""Share of the last step below which the next must lie for the derivatives to be kept."""
_BLOCK_PX = 4


@dataclass(frozen=True)
class Polished:
    """Where the steps ended: `values` (p,), the `local` model of the last derivatives, `toned`.

    `toned` is the exact solution at the last values but a step below 0.02 standard uncertainties.
    """

    values: Array
    local: LocalModel
    toned: Toned
    converged: bool


def polish(
    model: FrameModel,
    start: Array,
    *,
    toned: Toned | None = None,
    tolerance: float = _NEAR,
    iterations: int = 25,
) -> Polished | None:
    """Levenberg's and Marquardt's steps, with derivatives that are kept as long as they serve.

    Parameters: `model`; `start` (p,); `toned`, the solution there if it is known; `tolerance`, the
    last step in standard uncertainties; `iterations`, exact residuals at most. Returns a Polished,
    None where the start makes no scene that can be solved. Raises PhysicsError where only the
    start does.
    """
    values = np.clip(np.asarray(start, float), model.low, model.high)
    toned = toned or model.at(values)
    if toned is None:
        return None
    local = model.linearise(values, toned)
    damping, last = 0.0, np.inf
    for _ in range(iterations):
        step = _step(model, local, values, toned, damping)
        size = _size(local, step, toned)
        if size < tolerance:
            return Polished(values + step, local, toned, True)
        if size > _FROZEN * last and not np.array_equal(local.values, values):
            local, last = model.linearise(values, toned), np.inf
            continue
        trial = model.at(values + step, near=toned.model)
        if trial is None or not _better(trial, toned):
            damping, last = max(10.0 * damping, 1e-2), np.inf
            if not np.array_equal(local.values, values):
                local = model.linearise(values, toned)
            continue
        values, toned, last = values + step, trial, size
        damping = 0.0 if damping < 1e-3 else 0.1 * damping
    return Polished(values, local, toned, False)


def _better(trial: Toned, toned: Toned) -> bool:
    """Whether a step lowers the cost without turning the light negative: another basin's sign."""
    if toned.part.positive and not trial.part.positive:
        return False
    # the costs of two points that differ by less than the noise of their sum are alike
    return trial.cost <= toned.cost * (1.0 + 1e-6)


def _size(local: LocalModel, step: Array, toned: Toned) -> float:
    """A step in standard uncertainties, those of the noise that is left."""
    noise = max(1.0, toned.cost / max(1, toned.residual.size))
    return float(np.sqrt(max(0.0, float(step @ local.normal @ step)) / noise))


def _step(
    model: FrameModel, local: LocalModel, values: Array, toned: Toned, damping: float
) -> Array:
    """The step of the unknowns that are free to move, cut at their bounds."""
    pull = (local.rows @ toned.residual).astype(float)
    held = ((values <= model.low) & (pull < 0)) | ((values >= model.high) & (pull > 0))
    free = np.flatnonzero(~held & local.determined)
    step = np.zeros(len(values))
    if free.size:
        matrix = local.normal[np.ix_(free, free)]
        matrix = matrix + damping * np.diag(np.diag(matrix))
        step[free] = scaled_inverse(matrix, 1e-12) @ pull[free]
    return np.asarray(np.clip(values + step, model.low, model.high) - values)


def covariance(model: FrameModel, polished: Polished) -> Array:
    """Covariance of the values (p, p), as the residuals say and not as the weights hoped.

    Equation: N⁻¹ (Σ r² j jᵀ) N⁻¹ n/(n - k), j the projected derivatives at a pixel, r its residual
    over noise, N = Σ j jᵀ (White 1980, Econometrica 48, 817): right whatever the weights were. It
    is widened by the correlation of the residuals, from their sums over blocks of 4 x 4 pixels.
    """
    local, residual = polished.local, polished.toned.residual
    weighted = local.rows * residual
    middle = (weighted @ weighted.T).astype(float)
    linear = len(polished.toned.part.coefficients)
    freedom = residual.size / max(1, residual.size - len(local.values) - linear)
    wider = max(1.0, block_correlation(model.pixels.keep, residual))
    return np.asarray(local.inverse @ middle @ local.inverse * (freedom * wider))


def block_correlation(keep: NDArray[np.bool_], residual: Array) -> float:
    """Variance of the residuals' sums over blocks of 4 x 4 pixels, over that of independent ones.

    Parameters: `keep` (rows, cols), where the pixels are; `residual` (n,), theirs.
    """
    rows, cols = (n - n % _BLOCK_PX for n in keep.shape)
    if rows == 0 or cols == 0:
        return 1.0
    image = np.zeros(keep.shape, np.float32)
    image[keep] = residual
    blocks = image[:rows, :cols].reshape(rows // _BLOCK_PX, _BLOCK_PX, cols // _BLOCK_PX, _BLOCK_PX)
    alone = float(np.sum(np.square(blocks), dtype=float))
    together = float(np.sum(np.square(blocks.sum(axis=(1, 3))), dtype=float))
    return together / max(alone, 1e-300)
