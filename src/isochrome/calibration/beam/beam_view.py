"""Where the beam lies in a frame, and a first guess of its fringes, from a profile over its height.

In pure bending N rises linearly across the height, so that the intensity along the height is a
sinusoid with one frequency, the slope |dN/dy|; outside the beam there is none. A spectral scan
with a window of the beam's known height finds both together, with no knowledge of f_sigma.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.shot import Shot
from isochrome.errors import InputError, PhysicsError

Array = NDArray[np.float64]

LARGEST_TILT = 8.0
"""Degrees; a beam tilted by more is asked to be turned."""

FINEST_PX = 4.0
"""Samples of the profile a fringe at the least."""

SAMPLES = 512
"""Samples of the profile that is scanned, at most about."""

SMALLEST_PX = 16.0
LARGEST_FRAMES = 20.0
"""A beam's height in pixels, and in heights of the frame, at the least and at the most."""

FEWEST_VALID = 0.3
"""Part of the pixels that must be usable."""

FEWEST = 0.5
"""Fringes in view at the least."""


@dataclass(frozen=True)
class BeamView:
    """The beam's `height_px`, its `top` row at the middle column (float, may be outside), its
    `tilt` (rows a column) and `starts` (m, 3): slope (fringe/px across the rows), row of N = 0,
    tilt.
    """

    height_px: float
    top: float
    tilt: float
    starts: Array

    @property
    def scale(self) -> Array:
        """Natural changes (3,) of slope, row and tilt."""
        return np.array([0.1 / self.height_px, 0.1 * self.height_px, 0.01])


def find_beam(shot: Shot, height_px: float) -> BeamView:
    """Find a beam's tilt, top edge and candidate fringe slopes.

    Parameters: `shot`; `height_px`, the beam's height in pixels. Returns a BeamView. Raises
    PhysicsError where no fringes rise across the height, InputError for another size.
    """
    lines = shot.light.shape[0]
    if not SMALLEST_PX <= height_px <= LARGEST_FRAMES * lines:
        raise InputError(
            "beam_height_mm_camera_pixel_mm", name=shot.name, height_px=height_px, seen=lines,
            smallest_px=SMALLEST_PX, seen_2=LARGEST_FRAMES * lines,
        )  # fmt: skip
    if np.mean(shot.valid) < FEWEST_VALID:
        raise PhysicsError("only_pixels_can_used", name=shot.name, mean=np.mean(shot.valid))
    tilt = _tilt(shot)
    rows, values, count = _binned(*_profile(shot, tilt))
    tops = _tops(rows, height_px)
    seen = min(height_px, float(rows[-1] - rows[0] + 1))
    finest = 1.0 / (FINEST_PX * float(rows[1] - rows[0]))
    slopes = np.arange(FEWEST / seen, finest, 0.2 / seen)
    coarse = tops[:: max(1, len(tops) // 12)]
    cost, _ = _scan(rows, values, count, coarse, height_px, slopes)
    best = _peaks(cost.min(axis=0), 4)
    cost, phase = _scan(rows, values, count, tops, height_px, slopes[best])
    place = int(np.argmin(cost.min(axis=1)))
    smooth = np.polynomial.Polynomial.fit(rows, values, 2, w=np.sqrt(count))(rows)
    if cost.min() > 0.95 * float(np.sum(count * (values - smooth) ** 2)):
        raise PhysicsError("no_fringes_rise_across", name=shot.name)
    middle = tops[place] + 0.5 * height_px
    starts = []
    for slope, angle in zip(slopes[best], phase[place], strict=True):
        row = (angle + (0.0 if shot.bright else np.pi)) / (2.0 * np.pi * slope)
        starts.append([slope, row + np.round((middle - row) * slope) / slope, tilt])
    return BeamView(height_px, float(tops[place]), tilt, np.array(starts))


def _tilt(shot: Shot) -> float:
    """Shear (rows a column) under which the profile over the rows has the most contrast."""
    limit = np.tan(np.radians(LARGEST_TILT))
    centre, half = 0.0, limit
    for step in (0.25, 0.05):
        shears = centre + np.arange(-half, half + 1e-9, np.tan(np.radians(step)))
        sharp = [_sharpness(*_profile(shot, s)) for s in shears]
        centre, half = float(shears[int(np.argmax(sharp))]), np.tan(np.radians(step))
    return centre


def _sharpness(rows: Array, values: Array, count: Array) -> float:
    weight = count / count.sum()
    return float(np.sum(weight * (values - np.sum(weight * values)) ** 2))


def _profile(shot: Shot, shear: float) -> tuple[Array, Array, Array]:
    """Mean intensity over sheared rows: row at the middle column, mean, number of pixels."""
    height, width = shot.light.shape
    stride = max(1, width // 160)
    cols = np.arange(stride // 2, width, stride)
    drop = shear * (cols - 0.5 * (width - 1))
    place = np.rint(np.arange(height)[:, None] - drop[None, :]).astype(int)
    low = int(place.min())
    keep = shot.valid[:, cols]
    index = (place - low)[keep]
    count = np.bincount(index)
    total = np.bincount(index, weights=shot.light[:, cols][keep])
    good = count >= 0.3 * len(cols)
    row = np.flatnonzero(good).astype(float) + low
    return row, total[good] / count[good], count[good].astype(float)


def _binned(rows: Array, values: Array, count: Array) -> tuple[Array, Array, Array]:
    """A profile's means over so many rows that about SAMPLES remain."""
    step = -(-rows.size // SAMPLES)
    if step == 1:
        return rows, values, count
    selected = rows.size - rows.size % step
    pixels, place, light = (
        v[:selected].reshape(-1, step).sum(axis=1) for v in (count, rows * count, values * count)
    )
    return place / pixels, light / pixels, pixels


def _tops(rows: Array, height_px: float) -> Array:
    """Candidate rows of the top edge: at least 60 % of the smaller of beam and frame in view."""
    seen = float(rows[-1] - rows[0] + 1)
    room = 0.4 * min(height_px, seen)
    low, high = sorted((rows[0] - room, rows[-1] + 1 - height_px + room))
    if height_px > seen:
        low, high = rows[-1] + 1 - height_px - room, rows[0] + room
    step = max(1.0, 0.01 * min(height_px, seen))
    return np.arange(low, high + step, step)


def _scan(
    rows: Array, values: Array, count: Array, tops: Array, height_px: float, slopes: Array
) -> tuple[Array, Array]:
    """Residual (tops, slopes) of a sinusoid inside and a line outside; phase of the maximum."""
    cost, phase = np.empty((2, len(tops), len(slopes)))
    angle = 2.0 * np.pi * slopes[:, None] * rows
    waves = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    place = (rows - rows.mean()) / max(1.0, float(np.ptp(rows)))
    smooth = np.broadcast_to(
        np.stack([np.ones_like(place), place, place**2]), (len(slopes), 3, rows.size)
    )
    design = np.concatenate([waves, smooth], axis=1)
    for i, top in enumerate(tops):
        inside = (rows >= top) & (rows < top + height_px)
        d, w, y = design[:, :, inside], count[inside], values[inside]
        gram = (d * w) @ d.transpose(0, 2, 1) + 1e-9 * w.sum() * np.eye(5)
        right = (d * w) @ y
        result = np.linalg.solve(gram, right[..., None])[..., 0]
        outside = _line_cost(rows, values, count, rows < top)
        outside += _line_cost(rows, values, count, rows >= top + height_px)
        cost[i] = np.sum(w * (y - np.einsum("sk,skn->sn", result, d)) ** 2, axis=1) + outside
        phase[i] = np.arctan2(result[:, 1], result[:, 0])
    return cost, phase


def _line_cost(rows: Array, values: Array, count: Array, where: NDArray[np.bool_]) -> float:
    x, y, w = rows[where], values[where], count[where]
    if x.size < 3:
        return 0.0
    x = x - np.average(x, weights=w)
    y = y - np.average(y, weights=w)
    slope = np.sum(w * x * y) / np.sum(w * x * x)
    return float(np.sum(w * (y - slope * x) ** 2))


def _peaks(cost: Array, number: int) -> NDArray[np.intp]:
    """Indices of the deepest local minima."""
    padded = np.concatenate([[np.inf], cost, [np.inf]])
    local = np.flatnonzero((cost <= padded[:-2]) & (cost <= padded[2:]))
    return local[np.argsort(cost[local], kind="stable")][:number]
