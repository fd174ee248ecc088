"""Ridges and valleys of an image: the arithmetic behind `skeletons`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import csgraph, csr_matrix
from scipy.spatial import cKDTree

from isochrome.fringes.windows import Indices, Mask, nearest_known

Floats = NDArray[np.float64]

FOLLOW_SHARE = 0.5
"""A line that reached the threshold is followed down to this share of it."""

_WHOLE_SHARE = 0.95  # of the smoothing window must be known pixels
_TRUNCATE = 6.0  # in sigma: at scipy's 4 a flat image has a second derivative of 1e-4
_RUN = 2.0  # a fringe centre is level along its run; the flank of a round fringe is not
_REACH_PX = 1.5  # neighbours: side by side or corner to corner


def _whole(known: Mask, sigma_px: float) -> Mask:
    """Mark the pixels whose neighbourhood is known, and not a continuation past the border."""
    share = ndimage.gaussian_filter(known.astype(float), sigma_px, mode="reflect")
    rim = int(np.ceil(sigma_px))
    whole = np.zeros_like(known)
    whole[rim:-rim, rim:-rim] = True
    return np.asarray(whole & known & (share >= _WHOLE_SHARE))


def ridge_noise(image: Floats) -> float:
    """Estimate the noise's deviation from second differences (Immerkær 1996, with a median)."""
    kernel = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]])
    rough = np.abs(ndimage.convolve(image, kernel)[1:-1, 1:-1])
    rough = rough[np.isfinite(rough)]
    return float(np.median(rough)) / (0.6745 * 6.0) if rough.size else 0.0


def noise_gain(sigma_px: float) -> float:
    """Deviation of sigma² g_xx for an image of white noise of deviation 1."""
    half = int(np.ceil(6.0 * sigma_px)) + 2
    impulse = np.zeros((2 * half + 1, 2 * half + 1))
    impulse[half, half] = 1.0
    curved = ndimage.gaussian_filter(_sharpened(impulse, sigma_px), sigma_px, order=(0, 2))
    return sigma_px**2 * float(np.sqrt(np.sum(curved**2)))


def _sharpened(image: Floats, sigma_px: float) -> Floats:
    """Take back, to first order, what a Gaussian of sigma_px will do: f - sigma²/2 ∇²f."""
    return np.asarray(image - 0.5 * sigma_px**2 * ndimage.laplace(image))


def line_points(image: Floats, sigma_px: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Find the lines that pass each pixel of `image` (row, col; NaN = not known).

    Returns strength (sigma² times the curvature across the line, > 0 dark, < 0 bright, 0 where no
    line passes or the neighbourhood is not known), line point (row, col) and smoothed level.
    """
    known = np.isfinite(image)
    if not known.all():
        image = nearest_known(image, known)
    pad = int(np.ceil(_TRUNCATE * sigma_px)) + 1
    pad = min(pad, min(image.shape) - 1)
    wide = _sharpened(np.pad(image, pad, mode="reflect", reflect_type="odd"), sigma_px)
    core = (slice(pad, -pad), slice(pad, -pad))
    level, g_r, g_c, h_rr, h_rc, h_cc = (
        ndimage.gaussian_filter(wide, sigma_px, order=which, truncate=_TRUNCATE)[core]
        for which in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    )
    mean, half = 0.5 * (h_rr + h_cc), 0.5 * (h_rr - h_cc)
    bent = mean + np.where(mean >= 0.0, 1.0, -1.0) * np.hypot(half, h_rc)
    angle = 0.5 * np.arctan2(h_rc, half) + np.where(mean >= 0.0, 0.0, 0.5 * np.pi)
    n_r, n_c = np.cos(angle), np.sin(angle)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        step = -(g_r * n_r + g_c * n_c) / bent
        off_r, off_c = step * n_r, step * n_c  # NaN beside a level of one value: no line there
    level_run = np.abs(g_c * n_r - g_r * n_c) <= _RUN * sigma_px * np.abs(bent)
    on_line = level_run & (np.abs(off_r) <= 0.6) & (np.abs(off_c) <= 0.6) & _whole(known, sigma_px)
    rows, cols = np.indices(image.shape, dtype=float)
    strength = np.where(on_line, sigma_px**2 * bent, 0.0)
    return strength, rows + np.where(on_line, off_r, 0), cols + np.where(on_line, off_c, 0), level


def beside(shape: tuple[int, ...], lines: list[tuple[Floats, Floats]], reach_px: float) -> Mask:
    """Mark the pixels closer than `reach_px` to any of the lines (rows, cols)."""
    free = np.ones(shape, dtype=bool)
    for rows, cols in lines:
        free[line_pixels(rows, cols, shape)] = False
    if free.all():
        return ~free
    return np.asarray(ndimage.distance_transform_edt(free) < reach_px)


def line_pixels(rows: Floats, cols: Floats, shape: tuple[int, ...]) -> tuple[Indices, ...]:
    """Rows and columns of the pixels that are nearest to places (rows, cols)."""
    return tuple(
        np.clip(np.rint(places).astype(int), 0, count - 1)
        for places, count in zip((rows, cols), shape, strict=True)
    )


def linked(
    weight: Floats, threshold: float, min_length: float
) -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
    """Link neighbouring line pixels into ordered lines; yields index pairs (rows, cols)."""
    labels, count = ndimage.label(weight > FOLLOW_SHARE * threshold, structure=np.ones((3, 3)))
    peaks = np.atleast_1d(ndimage.maximum(weight, labels, np.arange(1, count + 1)))
    for number, where in enumerate(ndimage.find_objects(labels)):
        if peaks[number] < threshold:
            continue
        points = np.argwhere(labels[where] == number + 1)
        for path in _paths(points + np.array([where[0].start, where[1].start]), min_length):
            yield path[:, 0], path[:, 1]


def _paths(points: NDArray[Any], min_length: float) -> Iterator[NDArray[Any]]:
    """Cut a cloud of pixels into ordered paths, the longest of each connected part first."""
    if len(points) < min_length:
        return
    cloud = cKDTree(points)
    near = cloud.sparse_distance_matrix(cloud, _REACH_PX, output_type="coo_matrix").tocsr()
    count, part = csgraph.connected_components(near, directed=False)
    if count > 1:
        for number in range(count):
            yield from _paths(points[part == number], min_length)
        return
    path = points[_longest_path(csgraph.minimum_spanning_tree(near))]
    if len(path) >= min_length:
        yield path
        beside = cKDTree(path).query(points, distance_upper_bound=_REACH_PX)[0]
        yield from _paths(points[~np.isfinite(beside)], min_length)


def _longest_path(tree: csr_matrix) -> list[int]:
    """Find the longest path through a tree: the farthest point from the farthest point."""
    begin = int(np.argmax(csgraph.dijkstra(tree, directed=False, indices=0)))
    reach, before = csgraph.dijkstra(tree, directed=False, indices=begin, return_predecessors=True)
    path = [int(np.argmax(reach))]
    while path[-1] != begin:
        path.append(int(before[path[-1]]))
    return path
