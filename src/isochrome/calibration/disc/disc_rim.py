"""The disc's rim in a frame: where fringes begin, and a circle through the outermost of them.

The free rim carries no principal difference, so that in a dark field it is as dark as the air and
fringes begin a little inside: the circle is a start, which the whole-field fit corrects.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import PhysicsError
from isochrome.estimation import Observation

Array = NDArray[np.float64]

RAYS = 180
"""Directions in which the rim is looked for."""

_SPARE = 0.03
"""How far a circle may leave the frame, over its radius: about what its outline is uncertain by."""


@dataclass(frozen=True)
class Circle:
    """A circle in pixels.

    Parameters
    ----------
    row, col : float
        The centre, px.
    radius : float
        The radius, px.
    scatter : float
        Its points' scatter, px.
    """

    row: float
    col: float
    radius: float
    scatter: float


def find_rim(frame: Observation) -> Circle:
    """Find the disc: the largest patch where the intensity changes, unlike the air at the corners.

    Parameters
    ----------
    frame : Observation
        A frame that holds the whole disc with air in its corners.

    Returns
    -------
    Circle
        The circle through its outline.

    Raises
    ------
    PhysicsError
        Where there is no disc, or the frame cuts it.
    """
    patch = _patch(frame)
    rows, cols = np.nonzero(patch)
    centre = np.array([rows.mean(), cols.mean()])
    points = _outline(patch, centre)
    circle = fit_circle(points)
    height, width = patch.shape
    spare, middle = _SPARE * circle.radius, np.array([circle.row, circle.col])
    low, high = middle - circle.radius, middle + circle.radius
    inside = np.all((low >= -spare) & (high <= np.array(patch.shape) + spare))
    edge = np.concatenate([patch[0], patch[-1], patch[:, 0], patch[:, -1]])
    if not inside or np.count_nonzero(edge) > 0.1 * min(height, width):
        raise PhysicsError(
            "disc_rim_leaves_frame",
            name=frame.name,
            row=circle.row,
            col=circle.col,
            radius=circle.radius,
            height=height,
            width=width,
        )
    if circle.scatter > 0.12 * circle.radius:
        raise PhysicsError(
            "no_round_disc_seen", name=frame.name, radius=circle.scatter / circle.radius
        )
    return circle


def fit_circle(points: Array) -> Circle:
    """Fit a circle by least squares on radial distances, outliers down-weighted (soft L1).

    Parameters
    ----------
    points : (n, 2) array
        Row and column of each point, px.

    Returns
    -------
    Circle
        The circle; its `scatter` is the median distance.
    """
    from scipy.optimize import least_squares

    centre = points.mean(axis=0)
    radius = float(np.median(np.hypot(*(points - centre).T)))

    def distance(p: Array) -> Array:
        return np.asarray(np.hypot(points[:, 0] - p[0], points[:, 1] - p[1]) - p[2])

    result = least_squares(
        distance, [*centre, radius], loss="soft_l1", f_scale=max(0.5, 0.01 * radius)
    )
    row, col, size = (float(v) for v in result.x)
    return Circle(row, col, size, float(np.median(np.abs(distance(result.x)))))


def _patch(frame: Observation) -> NDArray[np.bool_]:
    from scipy import ndimage

    size = min(frame.light.shape)
    blur = max(2.0, size / 250.0)
    image = np.where(frame.valid, frame.light, np.median(frame.light))
    slope = ndimage.gaussian_gradient_magnitude(image, blur)
    corner = max(4, size // 25)
    ends = (slice(0, corner), slice(-corner, None))
    air = np.median([np.median(slope[r, c]) for r in ends for c in ends])
    noise = float(np.median(frame.sigma)) / (2.0 * np.sqrt(2.0 * np.pi) * blur**2)
    limit = max(6.0 * noise, 3.0 * float(air), 0.05 * float(np.percentile(slope, 98)))
    patch = _closed(slope > limit, max(2, size // 40))
    labels, count = ndimage.label(patch)
    if count == 0:
        raise PhysicsError("nothing_but_even_light", name=frame.name)
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return np.asarray(ndimage.binary_fill_holes(labels == int(np.argmax(sizes))))


def _closed(patch: NDArray[np.bool_], steps: int) -> NDArray[np.bool_]:
    """Binary closing that does not eat the frame's border."""
    from scipy import ndimage

    wide = np.pad(patch, steps)
    closed = ndimage.binary_closing(wide, iterations=steps)
    return np.asarray(closed[steps:-steps, steps:-steps])


def _outline(patch: NDArray[np.bool_], centre: Array) -> Array:
    """The outermost patch pixel in each of RAYS sectors, (n, 2)."""
    rows, cols = np.nonzero(patch)
    dr, dc = rows - centre[0], cols - centre[1]
    sector = ((np.arctan2(dr, dc) / (2.0 * np.pi) + 0.5) * RAYS).astype(int) % RAYS
    order = np.lexsort((np.hypot(dr, dc), sector))
    last = np.flatnonzero(np.diff(np.append(sector[order], -1)))
    chosen = order[last]
    return np.stack([rows[chosen], cols[chosen]], axis=1).astype(float)
