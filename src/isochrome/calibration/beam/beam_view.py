"""A beam's edges in its images: how many pixels high it is, held against height_mm and pixel_mm.

The fringes alone cannot tell a wrong pixel scale: the slope of the order over pixels stays as it
is. Where both edges are in view, their distance can.

Where the beam lies in a frame, and a first guess of its fringes, from a profile over its height.

In pure bending N rises linearly across the height, so that the intensity along the height is a
sinusoid with one frequency, the slope |dN/dy|; outside the beam there is none. A spectral scan
with a window of the beam's known height finds both together, with no knowledge of f_sigma.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.settings import Beam, Uncertainty
from isochrome.calibration.shot import Shot
from isochrome.errors import InputError, PhysicsError
from isochrome.output import with_uncertainty

Array = NDArray[np.float64]

BIN_PX = 0.5
"""Height of a bin of the profile across the beam."""

REACH = 0.25
"""How far an edge is looked for from where the sizes put it, in heights."""

FEWEST_BINS = 8
"""Bins beyond an edge, and within it, at the least."""

BEVEL_PX = 0.5
"""What an edge itself is uncertain by: a bevel, and the light that it scatters."""

UNSURE = 0.02
"""Relative uncertainty of the distance from which it says nothing."""

_MAD = 1.4826
"""Standard deviation over the median of the sizes, of a normal distribution."""

CONTRADICTED = 3.0
"""Standard uncertainties by which the distance must be off, and the least of them."""

SLIGHT = 0.01
"""Relative difference below which a scale that is taken as exact is not refused."""


@dataclass(frozen=True)
class EdgeDistance:
    """The distance of a beam's edges, px, and its standard uncertainty."""

    height_px: float
    standard_uncertainty: float


@dataclass(frozen=True, kw_only=True)
class BeamPicture:
    """An image for its edges: `depth` across the beam (px), `light`, the fringes' `model`, which
    goes on beyond the beam, and `valid` pixels (R, C); the light's noise `sigma`; the `middle`
    depth and `height_px` where the beam is to be.
    """

    depth: Array
    light: Array
    model: Array
    valid: NDArray[np.bool_]
    sigma: float
    middle: float
    height_px: float


def edge_distance(pictures: Sequence[BeamPicture]) -> EdgeDistance | None:
    """The distance of the edges over all images, None where they are not both seen.

    Parameters: `pictures`, the images. The median of their own distances; its uncertainty is by
    theirs, or their scatter where that is more, and an edge's own.
    """
    own = [result for result in (_distance(p) for p in pictures) if result is not None]
    if not own:
        return None
    values, spreads = np.array(own).T
    middle = float(np.median(values))
    scatter = _MAD * float(np.median(np.abs(values - middle)))
    images = max(scatter, float(np.median(spreads))) / np.sqrt(len(own))
    spread = float(np.hypot(images, np.sqrt(2.0) * BEVEL_PX))
    return EdgeDistance(middle, spread) if spread < UNSURE * middle else None


def check_beam_scale(
    found: EdgeDistance, beam: Beam, pixel_mm: float, uncertainty: Uncertainty | None
) -> None:
    """Refuse a height and a pixel size that the edges contradict beyond all their uncertainties.

    Parameters: `found`, see `edge_distance`; the rest as in `bending_from_shots`. Raises InputError
    with both numbers.
    """
    known = uncertainty or Uncertainty()
    stated = beam.height_mm / pixel_mm
    height, pixel = known.height_mm or 0.0, known.pixel_mm or 0.0
    off = abs(found.height_px / stated - 1.0)
    parts = found.standard_uncertainty / stated, height / beam.height_mm, pixel / pixel_mm
    spread = float(np.hypot(np.hypot(parts[0], parts[1]), parts[2]))
    if off <= max(CONTRADICTED * spread, SLIGHT):
        return
    own, share = beam.height_mm / found.height_px, found.standard_uncertainty / found.height_px
    raise InputError(
        "beam_edges_px_apart",
        with_uncertainty=with_uncertainty(found.height_px, found.standard_uncertainty),
        height_mm=beam.height_mm,
        pixel_mm=pixel_mm,
        stated=stated,
        off=off,
        with_uncertainty_2=with_uncertainty(own, own * share),
    )


def _distance(picture: BeamPicture) -> tuple[float, float] | None:
    """The distance of one image's edges and its standard uncertainty, px."""
    depth, image, model, count = _depth_profile(picture)
    height = picture.height_px
    edges = []
    for side in (-1.0, 1.0):
        away = side * (depth - picture.middle) - 0.5 * height  # outwards
        near = np.abs(away) < REACH * height
        noise = picture.sigma / np.sqrt(count[near])
        result = _edge(away[near], image[near], model[near], noise)
        if result is None:
            return None
        edges.append(result)
    (first, one), (last, other) = edges
    return height + first + last, float(np.hypot(one, other))


def _depth_profile(picture: BeamPicture) -> tuple[Array, Array, Array, Array]:
    """Means over the span by depth: depth (px), image, model of the fringes, number of pixels."""
    index = np.floor(picture.depth / BIN_PX).astype(np.intp)
    index, valid = index - int(index.min()), picture.valid
    count = np.bincount(index[valid])
    maps = picture.depth, picture.light, picture.model
    sums = [np.bincount(index[valid], weights=m[valid]) for m in maps]
    enough = count >= max(4, 0.2 * np.median(count[count > 0]))
    place, image, model = (s[enough] / count[enough] for s in sums)
    return place, image, model, count[enough].astype(float)


def _edge(away: Array, image: Array, model: Array, noise: Array) -> tuple[float, float] | None:
    """Place of the edge along `away` and its standard uncertainty; None where none is seen.

    Within it are the fringes, beyond it a straight line, and a Gaussian's integral between.
    """
    from scipy.optimize import least_squares
    from scipy.special import ndtr

    order = np.argsort(away)
    away, image, model, noise = (v[order] for v in (away, image, model, noise))
    costs = np.full(away.size, np.inf)
    inside = np.cumsum(((image - model) / noise) ** 2)
    for i in range(FEWEST_BINS, away.size - FEWEST_BINS):
        line = np.polyfit(away[i:], image[i:], 1, w=1.0 / noise[i:])
        costs[i] = inside[i - 1] + np.sum(((image - np.polyval(line, away)) / noise)[i:] ** 2)
    best = int(np.argmin(costs)) if away.size > 2 * FEWEST_BINS else 0
    if not FEWEST_BINS < best < away.size - FEWEST_BINS - 1:
        return None
    line = np.polyfit(away[best + 2 :], image[best + 2 :], 1)

    def left(values: Array) -> Array:
        place, width, level, slope = values
        part = ndtr((place - away) / width)
        outside = level + slope * (away - away[best])
        return np.asarray((image - part * model - (1.0 - part) * outside) / noise)

    start = [float(away[best]), 0.7, float(np.polyval(line, away[best])), float(line[0])]
    low, high = np.array([-np.inf, 0.2, -np.inf, -np.inf]), np.array([np.inf, 6.0, np.inf, np.inf])
    result = least_squares(left, start, bounds=(low, high), x_scale="jac")
    chi2 = max(1.0, 2.0 * result.cost / max(1, away.size - 4))
    try:
        variance = float(np.linalg.inv(result.jac.T @ result.jac)[0, 0]) * chi2
    except np.linalg.LinAlgError:
        return None
    # a singular matrix whose rounding passes for an inverse has a negative one
    return (float(result.x[0]), float(np.sqrt(variance))) if variance > 0.0 else None


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
