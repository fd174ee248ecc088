"""What a user knows of the order, as the patches of one part see it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from isochrome.fringes.single_frame.patch_labels import Labels
from isochrome.fringes.single_frame.patches import Patches, basis
from isochrome.fringes.single_frame.sign_ambiguity import AnchorPatch
from isochrome.fringes.windows import Array

KnownPoint = tuple[float, float, float]
"""Row and column of a pixel, and the fringe order there."""

_STATED = 0.035
"""Standard deviation, in fringes, of an order that a user counts and estimates between lines."""
_MOST = 16.0
"""Most that a point costs, chi²: many outvote one that is off."""
_WITHIN = 0.24
"""Fringes within which an order fits the light: estimates may be rough."""
_BESIDE_LINE_PX = 1.5
"""Standard deviation of a place that a user marks across a fringe line, and how many of them it"""
_FAR_BESIDE = 3.0
"""may lie beside it."""
_TURNED = 0.05
"""Fringes by which all around a point must lie below it for a maximum, or above for a minimum."""
CLEAR = 8.0
"""By how much a whole number must be better than another, chi²: odds of 50 to 1."""


@dataclass(frozen=True)
class KnownPlaces:
    """An order that is known at a place, or at several along one fringe line.

    Parameters
    ----------
    places : tuple of (row, col)
        The places, pixels.
    order : float
        The order there, fringes.
    key : str, default 'frames.known_order'
        What messages call it.
    says_zero_line : bool, default True
        Whether an order of 0 may be that of a line; a free corner's is the corner's alone.
    extremum : {'maximum', 'minimum'}, optional
        Whether it is the highest or the lowest of its surroundings.
    """

    places: tuple[tuple[float, float], ...]
    order: float
    key: str = "frames.known_order"
    says_zero_line: bool = True
    extremum: str | None = None

    @property
    def is_line(self) -> bool:
        """Whether it is a line's."""
        return len(self.places) > 1


@dataclass(frozen=True)
class StatedPlace:
    """A place of known order: its quadratic's `basis` (6,) in the `patch` about it, its part's f.

    `sigma`, standard deviation of the order; `within`, by how much it may miss at all (fringes);
    `around`, how far f lies above that all around, below it where negative, nought where it turns
    neither way; `extremum`, which one it is said to be, if any.
    """

    point: KnownPoint
    patch: tuple[int, int]
    basis: Array = field(repr=False)
    field: float
    sigma: float
    within: float
    around: float = 0.0
    extremum: str | None = None

    def miss(self, j: int) -> float:
        """How far the order is from |f + j|, fringes."""
        return abs(abs(self.field + j) - self.point[2])

    def cost(self, j: int) -> float:
        """What the place costs with j, chi²."""
        return min((self.miss(j) / self.sigma) ** 2, _MOST) if self.turns(j) else _MOST

    def fits(self, j: int) -> bool:
        """Whether the order is that of j, roughly estimated."""
        return self.miss(j) < self.within and self.turns(j)

    def turns(self, j: int) -> bool:
        """Whether |f + j| is the extremum that the place is said to be, if it is."""
        if self.extremum is None:
            return True
        above = self.around * np.sign(self.field + j)
        return bool(above > 0.0 if self.extremum == "maximum" else above < 0.0)


@dataclass(frozen=True)
class Stated:
    """What is known in one part: a point, or the places of a line there."""

    known: KnownPlaces
    places: tuple[StatedPlace, ...]

    @property
    def order(self) -> float:
        """The known order."""
        return self.known.order

    @property
    def first(self) -> StatedPlace:
        """The point, or a line's first place."""
        return self.places[0]

    def cost(self, j: int) -> float:
        """What it costs with j, chi²: a line has one voice."""
        return sum(p.cost(j) for p in self.places) / len(self.places)

    def fits(self, j: int) -> bool:
        """Whether the order is that of j: in most of a line's places."""
        return 2 * sum(p.fits(j) for p in self.places) > len(self.places)

    @property
    def on_line(self) -> bool:
        """Whether the light beside it says the order, and not on which side it is higher."""
        from_line = abs(2.0 * self.first.field - round(2.0 * self.first.field))
        near = from_line**2 < CLEAR * _STATED**2
        return self.known.is_line or (self.known.says_zero_line and bool(near))

    def source(self, p: StatedPlace, terms: Array) -> AnchorPatch:
        """One of its places to look at seams from, by the order's terms (m, n, 6)."""
        crest = round(2.0 * float(p.basis @ terms[p.patch])) if self.on_line else None
        return AnchorPatch(p.patch, p.basis, crest)

    def __str__(self) -> str:
        row, col, order = self.first.point
        return f"{self.known.key} = {order:g} at row {row:g}, column {col:g}"


def stated_place(
    patches: Patches,
    labels: Labels,
    terms: Array,
    known: KnownPlaces,
    place: tuple[float, float],
) -> StatedPlace:
    """What the nearest patch that is followed says of a place, by the parts' `terms` (m, n, 6)."""
    row, col = place
    patch = _nearest(patches, labels, place)
    off = np.array(row - patches.rows[patch[0]]), np.array(col - patches.cols[patch[1]])
    sigma, within = _STATED, _WITHIN
    if known.is_line:
        slope = float(np.hypot(*terms[patch][1:3]))
        sigma = float(np.hypot(sigma, _BESIDE_LINE_PX * slope))
        within = min(within, _FAR_BESIDE * sigma)
    in_patch = basis(*off)
    order, around = float(in_patch @ terms[patch]), 0.0
    if not known.is_line:
        part = np.where(labels.part == labels.part[patch], terms[..., 0], np.nan)
        around = _above(part, patch, order)
    return StatedPlace(
        (row, col, known.order), patch, in_patch, order, sigma, within, around, known.extremum
    )


def _nearest(patches: Patches, labels: Labels, place: tuple[float, float]) -> tuple[int, int]:
    """The nearest patch that is followed: one on a flat crest may not be, and others reach it."""
    down, right = np.abs(patches.rows - place[0]), np.abs(patches.cols - place[1])
    far = np.hypot(down[:, None], right[None, :])
    at = np.where(labels.part >= 0, far, np.inf).argmin()
    row, col = np.unravel_index(at, far.shape)
    return int(row), int(col)


def _above(values: Array, patch: tuple[int, int], at: float) -> float:
    """How far a field lies above the nearest square about a patch that is all above or below it.

    Parameters: `values` (m, n), NaN outside the part; `patch`; `at`, the field there. Returns
    nought where some of the square about it lies above and some below, or half is not known.
    """
    away = np.abs(np.indices(values.shape) - np.reshape(patch, (2, 1, 1))).max(axis=0)
    for k in range(1, int(away.max()) + 1):
        around = values[away == k]
        fall = at - around[np.isfinite(around)]
        if 2 * fall.size < around.size or (fall.max() > _TURNED and fall.min() < -_TURNED):
            return 0.0
        if np.abs(fall).min() > _TURNED:
            return float(fall.mean())
    return 0.0


def left_out(given: Stated, missed: list[StatedPlace], j: int, votes: int) -> str:
    """What to say of places that nothing makes fit: of a line, the one that is farthest off."""
    p = max(missed, key=lambda p: p.miss(j))
    would = abs(p.field + j)
    if given.known.is_line and given.fits(j):
        row, col, order = p.point
        return (
            f"{given.known.key} = {order:g}: {len(missed)} of its {len(given.places)} places "
            f"contradict the others, the one at row {row:g}, column {col:g} by "
            f"{p.miss(j):.2f}: it would be {would:.2f}; left out, check the line"
        )
    if abs(p.point[2] - _levels(p)[0]) < p.within:
        return (
            f"{given}: contradicted by {votes} other{'s' * (votes > 1)}, with which it would be "
            f"{would:.2f}; it is left out, check it"
        )
    return fits_nothing(given, p)


def _levels(p: StatedPlace) -> list[float]:
    """The orders that the light at a point may have, the nearest to the known one first."""
    base = abs(p.field - round(p.field))
    levels = [v for k in range(int(p.point[2]) + 2) for v in (k + base, k + 1.0 - base)]
    return sorted(levels, key=lambda v: abs(v - p.point[2]))


def fits_nothing(given: Stated, p: StatedPlace) -> str:
    """What to say of a place at which the light says another order."""
    row, col, order = p.point
    if p.extremum and any(abs(v - order) < p.within for v in _levels(p)):
        return f"{given}: the order is no {p.extremum} there; correct its extremum, or leave it out"
    near = sorted(_levels(p)[:2])
    return (
        f"{given.known.key} = {order:g} at row {row:g}, column {col:g}: fits no fringe there, "
        f"where the light says {near[0]:.2f} or {near[1]:.2f}, "
        f"{min(abs(order - v) for v in near):.2f} away; check it"
    )
