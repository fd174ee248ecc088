"""A beam's edges in its images: how many pixels high it is, held against height_mm and pixel_mm.

The fringes alone cannot tell a wrong pixel scale: the slope of the order over pixels stays as it
is. Where both edges are in view, their distance can.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.settings import Beam, Uncertainty
from isochrome.errors import InputError
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
    depth, image, model, count = _profile(picture)
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


def _profile(picture: BeamPicture) -> tuple[Array, Array, Array, Array]:
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
