"""Fits from several starts: fringe patterns have many minima, and only one is the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import PhysicsError
from isochrome.estimation.intensity import IntensityFit, Response, fit_intensity
from isochrome.estimation.separable import evaluate_prepared, prepare

Array = NDArray[np.float64]

APART = 0.1
"""Natural changes of a parameter below which two starts, or two minima, count as one."""


@dataclass(frozen=True)
class Minimum:
    """One minimum that a refined start led to; chi is inf where the light is negative."""

    values: Array
    chi: float

    @classmethod
    def of(cls, fit: IntensityFit) -> Minimum:
        """The minimum that a fit came to."""
        return cls(fit.values, fit.chi if fit.positive else np.inf)


@dataclass(frozen=True)
class SeveralStarts:
    """The best fit, and the other minima by rising chi."""

    best: IntensityFit
    others: tuple[Minimum, ...]


def several_starts(
    image: ArrayLike,
    response: Response,
    starts: ArrayLike,
    *,
    illumination: Array,
    background: Array,
    mask: NDArray[np.bool_] | None = None,
    sigma: ArrayLike = 1.0,
    scale: ArrayLike,
    refine: int = 3,
    scan_pixels: int = 30_000,
    **options: Any,
) -> SeveralStarts:
    """Scan many starts (m, p) on a thinned frame, refine the best few, fit the best one in full.

    Parameters as in `fit_intensity`; `scan_pixels`, those of the thinned frame. PhysicsError where
    no start gives a positive illumination.
    """
    table = np.atleast_2d(np.asarray(starts, dtype=float))
    size = np.abs(np.asarray(scale, dtype=float))
    frame = np.asarray(image, dtype=float)
    valid = np.isfinite(frame) if mask is None else np.asarray(mask, dtype=bool)
    thin = stride_mask(valid, scan_pixels)
    light: dict[str, Any] = {
        "illumination": illumination, "background": background, "sigma": sigma,
    }  # fmt: skip
    problem = prepare(frame, mask=thin, **light)
    chi = np.array([evaluate_prepared(problem, np.asarray(response(s), float)).chi for s in table])
    fits = [
        fit_intensity(frame, response, table[i], mask=thin, scale=size, **light, **options)
        for i in _chosen(table, chi, size, refine)
    ]
    minima = sorted(map(Minimum.of, fits), key=lambda m: m.chi)
    if not minima or not np.isfinite(minima[0].chi):
        raise PhysicsError(
            "no start gives a positive illumination; is the field (dark or bright) the right one?"
        )
    best = fit_intensity(
        frame, response, minima[0].values, mask=valid, scale=size, **light, **options
    )
    others: list[Minimum] = []
    for minimum in minima:
        seen = [best.values, minima[0].values, *(m.values for m in others)]
        if np.isfinite(minimum.chi) and not _near(minimum.values, seen, size):
            others.append(minimum)
    return SeveralStarts(best, tuple(others))


def _near(values: Array, seen: list[Array], size: Array) -> bool:
    return any(float(np.max(np.abs(values - s) / size)) < APART for s in seen)


def _chosen(table: Array, chi: Array, size: Array, count: int) -> list[int]:
    """Indices of the best `count` finite starts that are not next to each other."""
    chosen: list[int] = []
    for i in np.argsort(chi, kind="stable"):
        if len(chosen) == count or not np.isfinite(chi[i]):
            break
        if not _near(table[i], [table[j] for j in chosen], size):
            chosen.append(int(i))
    return chosen


def stride_mask(mask: NDArray[np.bool_], pixels: int) -> NDArray[np.bool_]:
    """Thin a mask to about `pixels` pixels by one stride along rows and columns.

    Parameters: `mask` (rows, cols), True = valid; `pixels`, how many to keep at least.
    Returns a mask of the same shape; the same one where it holds no more pixels than that.
    """
    step = max(1, int(np.sqrt(np.count_nonzero(mask) / max(1, pixels))))
    if step == 1:
        return mask
    thin = np.zeros_like(mask)
    thin[step // 2 :: step, step // 2 :: step] = mask[step // 2 :: step, step // 2 :: step]
    return thin
