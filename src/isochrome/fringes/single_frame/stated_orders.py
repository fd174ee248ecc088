r"""What a user knows of the order, as the patches of one part see it.

A point, the places of a fringe line, or a free corner. Between two free sides of an outward
corner no stress is left: N rises from it as r^p. For stress
functions r^(p+2) the sides are free where sin(2 lambda a) = -lambda sin(2 a), lambda = p + 1, of
the interior angle 2 a, so that p = 1.74 at 90 degrees, 1.27 at 110, and 1 at 126.
Source: Williams (1952), J. Appl. Mech. 19, 526.

The nearest patch that is followed lies some pixels away. On the way to it N starts at nought and
changes by less than a quarter as long as the light c = cos 2 pi N stays dark, c > 0: so the corner
says the patch's whole number where all of the way is seen to be dark. Within the few pixels that a
blurred or masked edge hides, N is less than their distance times its slope beyond them, as p > 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from isochrome.fringes.single_frame.patch_labels import Labels
from isochrome.fringes.single_frame.patches import HALF, Patches, basis
from isochrome.fringes.single_frame.sign_ambiguity import AnchorPatch
from isochrome.fringes.windows import Array, Mask
from isochrome.messages import message
from isochrome.scene import FreeCorner

KnownPoint = tuple[float, float, float]
"""Row and column of a pixel, and the fringe order there."""

STATED_SPREAD = 0.035
"""Standard deviation, in fringes, of an order that a user counts and estimates between lines."""
MOST_COST = 16.0
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
class KnownOrders:
    """What is known of a frame's orders.

    Parameters
    ----------
    places : tuple of KnownPlaces
        Points and fringe lines alike.
    corners : tuple of FreeCorner
        Corners of the outline that are free of load.
    """

    places: tuple[KnownPlaces, ...] = ()
    corners: tuple[FreeCorner, ...] = ()


def known_orders(
    known: Sequence[KnownPoint | tuple[float, float, float, str]],
    lines: Sequence[KnownPlaces] = (),
    corners: Sequence[FreeCorner] = (),
) -> KnownOrders:
    """Gather what is known of a frame's orders.

    Parameters
    ----------
    known, lines, corners : sequence
        As for `read_free`.

    Returns
    -------
    KnownOrders
        All of it.
    """
    points = [
        KnownPlaces(((row, col),), order, extremum=turn[0] if turn else None)
        for row, col, order, *turn in known
    ]
    return KnownOrders((*points, *lines), tuple(corners))


@dataclass(frozen=True, kw_only=True)
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
        return min((self.miss(j) / self.sigma) ** 2, MOST_COST) if self.turns(j) else MOST_COST

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
        near = from_line**2 < CLEAR * STATED_SPREAD**2
        return self.known.is_line or (self.known.says_zero_line and bool(near))

    def source(self, p: StatedPlace, terms: Array) -> AnchorPatch:
        """One of its places to look at seams from, by the order's terms (m, n, 6)."""
        crest = round(2.0 * float(p.basis @ terms[p.patch])) if self.on_line else None
        return AnchorPatch(p.patch, p.basis, crest)

    def __str__(self) -> str:
        row, col, order = self.first.point
        return f"{self.known.key} = {order:g} at row {row:g}, column {col:g}"


def stated_place(
    patches: Patches, labels: Labels, terms: Array, known: KnownPlaces, place: tuple[float, float]
) -> StatedPlace:
    """What the patch about a place says of it, by the parts' `terms` (m, n, 6).

    About a single point that may be one on a flat crest, which is not followed: then one beside it
    on the same body.
    """
    row, col = place
    away = np.hypot(patches.rows[:, None] - row, patches.cols[None, :] - col)
    own = np.unravel_index(away.argmin(), away.shape)
    if labels.part[own] < 0 and not known.is_line:
        beside = (labels.part >= 0) & (patches.body == patches.body[own])
        own = np.unravel_index(np.where(beside, away, np.inf).argmin(), away.shape)
    patch = int(own[0]), int(own[1])
    off = np.array(row - patches.rows[patch[0]]), np.array(col - patches.cols[patch[1]])
    sigma, within = STATED_SPREAD, _WITHIN
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
        point=(row, col, known.order),
        patch=patch,
        basis=in_patch,
        field=order,
        sigma=sigma,
        within=within,
        around=around,
        extremum=known.extremum,
    )


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
        return message(
            "places_contradict_others_one",
            key=given.known.key,
            order=order,
            missed_count=len(missed),
            places_count=len(given.places),
            row=row,
            col=col,
            miss=p.miss(j),
            would=would,
        )
    if abs(p.point[2] - _levels(p)[0]) < p.within:
        return message(
            "contradicted_other_which_would",
            given=given,
            votes=votes,
            value="s" * (votes > 1),
            would=would,
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
        return message("order_no_there_correct", given=given, extremum=p.extremum)
    near = sorted(_levels(p)[:2])
    return message(
        "row_column_fits_no",
        key=given.known.key,
        order=order,
        row=row,
        col=col,
        near=near[0],
        near_2=near[1],
        near_3=min(abs(order - v) for v in near),
    )


_REACH_PX = 30.0
"""How far from a corner a patch is looked for."""
_HIDDEN_PX = float(HALF)
"""What an edge may hide of the way."""
_HIDDEN_RISE = 0.5
"""Fringes by which the order may at most have risen there: less than the next dark."""
_DARK = 0.3
"""The light c above which the order is within 0.2 of a whole number."""
_POOLED_PX = 1.5
_BESIDE_DEG, _FEWEST = 20.0, 3
"""Angle beyond the corner's sides, and patches there, that are no specimen's."""


def corner_orders(
    corners: Sequence[FreeCorner], patches: Patches, labels: Labels, wave: Array, valid: Mask
) -> tuple[list[KnownPlaces], list[str]]:
    """Known orders of patches beside free corners, and what to say where there is none.

    Parameters: `corners`; `patches` and their `labels`; `wave`, the light c (rows, cols); `valid`,
    True = trusted (rows, cols).
    """
    known, said = [], []
    trusted = gaussian_filter(valid.astype(float), _POOLED_PX)
    pooled = gaussian_filter(np.where(valid, wave, 0.0), _POOLED_PX) / np.maximum(trusted, 1e-9)
    light = np.where(valid, pooled, np.nan)
    for corner in corners:
        result = _carried(corner, patches, labels, light)
        name = message("frames_free_boundary_corner_row", row=corner.row, col=corner.col)
        if isinstance(result, str):
            said.append(f"{name}: {result}; it is not used")
            continue
        order = abs(patches.terms[result][0] - round(patches.terms[result][0]))
        place = float(patches.rows[result[0]]), float(patches.cols[result[1]])
        known.append(KnownPlaces((place,), round(float(order), 2), name, says_zero_line=False))
    return known, said


def _carried(
    corner: FreeCorner, patches: Patches, labels: Labels, light: Array
) -> tuple[int, int] | str:
    """The followed patch to which the light carries a corner's order, or why there is none."""
    down, right = patches.rows[:, None] - corner.row, patches.cols[None, :] - corner.col
    away = np.maximum(np.hypot(down, right), 1e-9)
    cosine = np.clip((down * corner.inward[0] + right * corner.inward[1]) / away, -1.0, 1.0)
    beside = np.degrees(np.arccos(cosine)) - 0.5 * corner.angle_deg
    near = (labels.part >= 0) & (away < _REACH_PX)
    if np.count_nonzero(near & (beside > _BESIDE_DEG)) >= _FEWEST:
        return message("fringes_followed_outside_mask")
    inside = near & (beside < 0.0)
    if not inside.any():
        return message("no_fringe_could_followed_within", reach_px=_REACH_PX)
    i, j = np.unravel_index(np.where(inside, away, np.inf).argmin(), away.shape)
    steps = np.arange(0.0, float(away[i, j]) + 0.5, 0.5) / float(away[i, j])
    way = [corner.row + steps * down[i, 0], corner.col + steps * right[0, j]]
    seen = map_coordinates(light, way, order=0, mode="constant", cval=np.nan)
    first = int(np.isfinite(seen).argmax())
    hidden = 0.5 * first
    steepest = float(np.hypot(*patches.terms[inside][:, 1:3].T).max())
    if not np.isfinite(seen[first:]).all() or hidden > _HIDDEN_PX:
        return message("pixels_between_next_fringes")
    if hidden * steepest > _HIDDEN_RISE:
        return message("fringes_beside_too_dense")
    if seen[first:].min() < _DARK:
        return message("light_beside_not_order")
    return int(i), int(j)
