"""Distance between the fringe centre lines of a simulated and a captured image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from isochrome.errors import InputError
from isochrome.fringes import Skeleton

Floats = NDArray[np.float64]

_REACH_PX, _REACH_KNOWN_PX = 20.0, 100.0
_STEP_PX = 0.2  # lines are filled up to this spacing before distances are taken


@dataclass(frozen=True)
class SkeletonDistance:
    """How far the fringe centre lines of two images are apart; NaN where no line has a partner.

    Parameters
    ----------
    mean_px : float
        Mean distance, pixels.
    p95_px : float
        The 95th percentile of the distance, pixels.
    mean_mm : float
        Mean distance, mm; NaN where the scale is not known.
    matched_share : float
        Length of line, on both sides, that found a partner within reach, as a share of all.
    """

    mean_px: float
    p95_px: float
    mean_mm: float
    matched_share: float


def skeleton_distance(
    experiment: Sequence[Skeleton],
    simulation: Sequence[Skeleton],
    *,
    pixel_mm: float | None = None,
    reach_px: float | None = None,
) -> SkeletonDistance:
    """Mean distance between the fringe centre lines of two images; InputError where no line is.

    To the nearest line of the same kind (and order, where both know it); mean of both directions',
    so that neither side's longer lines rule. A point without a partner within `reach_px` only
    lowers `matched_share`: a missing line shows there alone. By default 20 px, about half the
    distance of like fringes, or 100 with orders, as no line is taken for its neighbour there.
    """
    if not (len(experiment) or len(simulation)):
        raise InputError("no fringe line in either image: nothing to compare; check the frames")
    by_order = all(line.order is not None for line in (*experiment, *simulation))
    if reach_px is None:
        reach_px = _REACH_KNOWN_PX if by_order else _REACH_PX
    there = _nearest(experiment, simulation, by_order)
    back = _nearest(simulation, experiment, by_order)
    both = np.concatenate([there, back])
    near, *sides = (each[(each <= reach_px) & np.isfinite(each)] for each in (both, there, back))
    means = [side.mean() for side in sides if side.size]
    mean_px = float(np.mean(means)) if means else np.nan
    return SkeletonDistance(
        mean_px=mean_px,
        p95_px=float(np.percentile(near, 95.0)) if near.size else np.nan,
        mean_mm=np.nan if pixel_mm is None else mean_px * pixel_mm,
        matched_share=near.size / both.size,
    )


def _nearest(source: Sequence[Skeleton], target: Sequence[Skeleton], by_order: bool) -> Floats:
    """Distances in px from every source point to the nearest like target line; inf if none."""

    def key(line: Skeleton) -> tuple[str, float | None]:
        return line.kind, line.order if by_order else None

    clouds: dict[tuple[str, float | None], list[Floats]] = {}
    for line in target:
        clouds.setdefault(key(line), []).append(_filled_up(line))
    trees = {name: cKDTree(np.vstack(parts)) for name, parts in clouds.items()}
    distances = [np.zeros(0)]
    for line in source:
        points = np.column_stack([line.rows, line.cols])
        tree = trees.get(key(line))
        distances.append(np.full(len(points), np.inf) if tree is None else tree.query(points)[0])
    return np.concatenate(distances)


def _filled_up(line: Skeleton) -> Floats:
    """Fill a line up with points, so that the nearest point is as near as the line itself."""
    if line.rows.size < 2:
        return np.column_stack([line.rows, line.cols])
    run = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(line.rows), np.diff(line.cols)))])
    at = np.union1d(np.arange(0.0, run[-1], _STEP_PX), run)
    return np.column_stack([np.interp(at, run, line.rows), np.interp(at, run, line.cols)])
