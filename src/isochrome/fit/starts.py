"""Fits from several starts: fringe patterns have many minima, and only one is the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import PhysicsError
from isochrome.fit.basis import stride_mask
from isochrome.fit.intensity import IntensityFit, Response, fit_intensity
from isochrome.fit.linear import evaluate_prepared, prepare

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Minimum:
    """One minimum that a refined start led to: parameters (p,) and chi (inf: negative light)."""

    values: Array
    chi: float


@dataclass(frozen=True)
class SeveralStarts:
    """The best fit, the other minima by rising chi, and the scan (starts (m, p), chi (m,))."""

    best: IntensityFit
    others: tuple[Minimum, ...]
    starts: Array
    scan_chi: Array

    def ambiguous(self, within: float = 0.05) -> bool:
        """Whether another minimum's chi lies within a fraction of the best one's."""
        return any(m.chi <= (1.0 + within) * self.best.chi for m in self.others)


def several_starts(
    image: ArrayLike,
    response: Response,
    starts: ArrayLike,
    *,
    illumination: Array,
    background: Array,
    mask: NDArray[np.bool_] | None = None,
    sigma: ArrayLike = 1.0,
    scale: ArrayLike | None = None,
    refine: int = 3,
    scan_pixels: int = 30_000,
    apart: float = 0.1,
    **options: Any,
) -> SeveralStarts:
    """Scan many starts on a thinned frame, refine the best few, fit the best one in full.

    Parameters: `starts` (m, p); `refine`, how many starts to refine; `scan_pixels`, the pixels of
    the thinned frame; `apart`, the distance in units of `scale` (default: the starts' standard
    deviation, or 1) below which two starts, or two minima, count as one; the rest, and
    `options`, as in `fit_intensity`.
    Returns SeveralStarts. Raises PhysicsError where no start gives a positive illumination.
    """
    table = np.atleast_2d(np.asarray(starts, dtype=float))
    size = _scale(table) if scale is None else np.abs(np.asarray(scale, dtype=float))
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
        for i in _chosen(table, chi, size, refine, apart)
    ]
    minima = sorted((_minimum(fit) for fit in fits), key=lambda m: m.chi)
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
        if np.isfinite(minimum.chi) and not _near(minimum.values, seen, size, apart):
            others.append(minimum)
    return SeveralStarts(best, tuple(others), table, chi)


def _minimum(fit: IntensityFit) -> Minimum:
    return Minimum(fit.values, fit.chi if fit.positive else np.inf)


def _scale(table: Array) -> Array:
    spread = table.std(axis=0)
    return np.where(spread > 0, spread, np.where(table[0] == 0, 1.0, np.abs(table[0])))


def _near(values: Array, seen: list[Array], size: Array, apart: float) -> bool:
    return any(float(np.max(np.abs(values - s) / size)) < apart for s in seen)


def _chosen(table: Array, chi: Array, size: Array, count: int, apart: float) -> list[int]:
    """Indices of the best `count` finite starts that are not next to each other."""
    chosen: list[int] = []
    for i in np.argsort(chi, kind="stable"):
        if len(chosen) == count or not np.isfinite(chi[i]):
            break
        if not _near(table[i], [table[j] for j in chosen], size, apart):
            chosen.append(int(i))
    return chosen
