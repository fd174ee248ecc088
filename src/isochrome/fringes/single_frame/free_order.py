"""Fringe order of one monochrome frame without a model of the specimen.

Patches of the frame are fitted by quadratics of the order, their signs and whole numbers settled
between neighbours, and what is left, one sign and one whole number for each connected part, is
taken from where the user knows the order (`[[frames.known_order]]`, `[[frames.known_line]]`,
corners of a `[[frames.free_boundary]]`). A part without any is left unknown, and bodies that masked
pixels keep apart are parts apart. Pixels are then the mean of the patches about them; where those
disagree, as beside an isotropic point or where fringes are finer than a patch can follow, the pixel
is masked.

A lens or a pixel that blurs by s (standard deviation, pixels) leaves exp(-2 pi² s² |∇N|²) of a
fringe, and a band of wavelengths of relative width b leaves exp(-2 pi² b² N²) of one of order N.
Read as if nothing were lost, a crest that the light does not reach looks like one that the order
turns back at. Patches that span crest and flank alike say what contrast they have besides their
order; s² and b² are what they say together, and the light is divided by it.

Between two free sides of an outward corner no stress is left: N rises from it as r^p. For stress
functions r^(p+2) the sides are free where sin(2 lambda a) = -lambda sin(2 a), lambda = p + 1, of
the interior angle 2 a, so that p = 1.74 at 90 degrees, 1.27 at 110, and 1 at 126. On the way to
the nearest patch that is followed N starts at nought and changes by less than a quarter as long as
the light c = cos 2 pi N stays dark, c > 0: so the corner says the patch's whole number. Within the
pixels that a blurred or masked edge hides, N is less than their distance times its slope beyond
them, as p > 1.

A part's patches say N = |f + j| with one whole number j that no light can tell. A point of known
order o says j = round(o - f) or round(-o - f). Off the fringe lines only one of the two fits the
light; on a line, 2 o a whole number, both do: such a point says the line, and not on which side of
it the order is higher, and so do all places of a known fringe line together. The j of a part is
therefore chosen jointly: it costs the sum of min(((|f + j| - o)/sigma)², C) over the part's points
and lines, a line having one voice, so that among many a wrong one is outvoted. Where two j are
nearly as good the part is not known. A line of N = 0 through the part is not generic in a loaded
body (isotropic places are points), though a beam has one: where what is known lies on lines alone,
it must be said. A point that the rest contradicts may lie beyond a seam that the light leaves open
(`open_seams`): then that seam is closed as the point says.
Sources: Born & Wolf (1999), Principles of Optics, section 7.5.8, for the contrast; Williams (1952),
J. Appl. Mech. 19, 526, for corners.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from scipy.ndimage import label, map_coordinates

from isochrome.fringes.on_branch import (
    BRANCH,
    LARGEST_UNCERTAINTY,
    SURE,
    OrderReading,
    less_sure,
    make_reading,
    stray_variance,
)
from isochrome.fringes.single_frame.patches import (
    DX,
    DY,
    FADED,
    FEWEST_PATCHES,
    HALF,
    LEAST_FILLED,
    NOUGHT,
    STRIDE,
    WINDOW,
    AnchorPatch,
    Labels,
    Patches,
    ZeroPlace,
    basis,
    coarse_to_fine,
    contrast_of,
    not_settled,
    open_seams,
    zero_lines,
)
from isochrome.fringes.windows import DIMMEST, TURN, Array, Mask, gaussian, innermost, nearest_known
from isochrome.messages import message
from isochrome.scene import FreeCorner

_SOME = 0.05
"""Share of the patches that have lost as much."""
_FEWEST = 30
_ROUNDS = 6
_OUTLIER = 2.0
"""Robust deviations from which a patch counts for less."""


def fit_contrast(patches: Patches, terms: Array, shape: tuple[int, ...]) -> Array:
    """What fringes have left of their contrast at each pixel, by patches whose order is known.
    Least squares of both variances, neither negative, patches off the law counting for less; 1
    where too few tell. `terms` (m, n, 6) of the signed order, NaN: the nearest's."""
    from scipy.optimize import nnls

    variances = np.zeros(2)
    use = np.isfinite(terms[..., 0]) & (patches.contrast > DIMMEST)
    if np.count_nonzero(use) >= _FEWEST:
        known = terms[use]
        lost = -2.0 * np.log(patches.contrast[use]) / TURN**2
        causes = np.stack([known[:, 1] ** 2 + known[:, 2] ** 2, known[:, 0] ** 2], axis=-1)
        weight = np.ones(len(lost))
        for _ in range(_ROUNDS):
            variances, _ = nnls(causes * weight[:, None], lost * weight)
            away = np.abs(lost - causes @ variances)
            scale = max(1.4826 * float(np.median(away)), 1e-6)
            weight = np.sqrt(np.minimum(1.0, _OUTLIER * scale / np.maximum(away, 1e-9)))
    near = nearest_known(terms, np.isfinite(terms[..., 0]))
    down, across = (
        np.stack([np.interp(np.arange(n), at, unit) for unit in np.eye(len(at))], axis=-1)
        for at, n in zip((patches.rows, patches.cols), shape, strict=True)
    )
    return np.asarray(down @ contrast_of(near, *variances) @ across.T)


KnownPoint = tuple[float, float, float]
"""Row and column of a pixel, and the fringe order there."""
STATED_SPREAD = 0.035
"""Standard deviation, in fringes, of an order that a user counts and estimates between lines."""
MOST_COST = 16.0
"""Most that a point costs, chi²: many outvote one that is off."""
_BESIDE_LINE_PX = 1.5
"""Standard deviation of a place that a user marks across a fringe line, and how many of them it"""
_FAR_BESIDE = 3.0
"""may lie beside it."""
CLEAR = 8.0
"""By how much a whole number must be better than another, chi²: odds of 50 to 1."""


@dataclass(frozen=True)
class KnownPlaces:
    """An order that is known at places (row, col), pixels: at one, or along a fringe line. `key`,
    what messages call it; `says_zero_line`: an order of 0 may be that of a line, where a free
    corner's is the corner's alone; `extremum`: 'maximum' or 'minimum' of its surroundings."""

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
    """What is known of a frame's orders: points, fringe lines, and corners free of load."""

    places: tuple[KnownPlaces, ...] = ()
    corners: tuple[FreeCorner, ...] = ()


@dataclass(frozen=True, kw_only=True)
class StatedPlace:
    """A place of known order: its quadratic's `basis` (6,) in the `patch` about it, its part's f.
    `part`, -1 where there is none near; `sigma`, standard deviation of the order; `within`, by how
    much it may miss at all (fringes); `around`, how far f lies above that all around, below it
    where negative, nought where it turns neither way; `extremum`, which one it is said to be."""

    part: int
    point: KnownPoint
    patch: tuple[int, int]
    basis: Array = field(repr=False)
    field: float
    sigma: float
    within: float
    around: float
    extremum: str | None

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

    def cost(self, j: int) -> float:
        """What it costs with j, chi²: a line has one voice."""
        return sum(p.cost(j) for p in self.places) / len(self.places)

    def fits(self, j: int) -> bool:
        """Whether the order is that of j: in most of a line's places."""
        return 2 * sum(p.fits(j) for p in self.places) > len(self.places)

    @property
    def on_line(self) -> bool:
        """Whether the light beside it says the order, and not on which side it is higher."""
        twice = 2.0 * self.places[0].field
        near = (twice - round(twice)) ** 2 < CLEAR * STATED_SPREAD**2
        return self.known.is_line or (self.known.says_zero_line and bool(near))

    def source(self, p: StatedPlace, terms: Array) -> AnchorPatch:
        """One of its places to look at seams from, by the order's terms (m, n, 6)."""
        return p.patch, round(2.0 * float(p.basis @ terms[p.patch])) if self.on_line else None

    def __str__(self) -> str:
        row, col, order = self.places[0].point
        return f"{self.known.key} = {order:g} at row {row:g}, column {col:g}"


def turned_to(
    patches: Patches, terms: Array, used: Sequence[tuple[Stated, StatedPlace]],
    known: Sequence[ZeroPlace], given: Stated, p: StatedPlace,
) -> Array | None:  # fmt: skip
    """The terms (m, n, 6) with an open seam closed as a place beyond it says. As they are where the
    place fits, since another place of its line has closed it, or roughly, and better beyond no
    seam; None where it fits neither way. `used`, what they are known by."""
    now, order = float(p.basis @ terms[p.patch]), given.known.order
    miss = abs(abs(now) - order)
    if (miss / p.sigma) ** 2 < CLEAR:
        return terms
    within = min(p.within, miss)  # nearer than it is
    points = [g.source(q, terms) for g, q in used]
    seams = [
        seam
        for seam in not_settled(patches, terms, points, known)
        if seam.beyond[p.patch] and abs(abs(seam.crest - now) - order) < within
    ]
    if not seams:
        return terms if miss < p.within else None
    seam = min(seams, key=lambda s: s.worse)
    turned = terms.copy()
    turned[seam.beyond] *= -1.0
    turned[seam.beyond, 0] += seam.crest
    return turned


def stated_place(
    patches: Patches, labels: Labels, terms: Array, known: KnownPlaces, place: tuple[float, float]
) -> StatedPlace:
    """What the patch about a place says of it, by the parts' `terms` (m, n, 6). A single point's
    may lie on a flat crest, which is not followed: then one beside it on the body."""
    row, col = place
    away = np.hypot(patches.rows[:, None] - row, patches.cols[None, :] - col)
    nearest = np.unravel_index(away.argmin(), away.shape)
    if labels.part[nearest] < 0 and not known.is_line:
        beside = (labels.part >= 0) & (patches.body == patches.body[nearest])
        nearest = np.unravel_index(np.where(beside, away, np.inf).argmin(), away.shape)
    patch = int(nearest[0]), int(nearest[1])
    off = np.array(row - patches.rows[patch[0]]), np.array(col - patches.cols[patch[1]])
    sigma, within = STATED_SPREAD, BRANCH  # estimates may be rough
    if known.is_line:
        sigma = float(np.hypot(sigma, _BESIDE_LINE_PX * float(np.hypot(*terms[patch][1:3]))))
        within = min(within, _FAR_BESIDE * sigma)
    in_patch = basis(*off)
    order, around = float(in_patch @ terms[patch]), 0.0
    if not known.is_line:
        part = np.where(labels.part == labels.part[patch], terms[..., 0], np.nan)
        around = _above(part, patch, order)
    near = np.abs(off).max() <= HALF + STRIDE
    return StatedPlace(
        part=int(labels.part[patch]) if near else -1, point=(row, col, known.order), patch=patch,
        basis=in_patch, field=order, sigma=sigma, within=within, around=around,
        extremum=known.extremum,
    )  # fmt: skip


def _above(values: Array, patch: tuple[int, int], at: float) -> float:
    """How far a field, `at` a patch, lies above the nearest square about it all above or below it.
    `values` (m, n), NaN outside the part. Nought where some of the square about it lies above and
    some below, or half is not known."""
    away = np.abs(np.indices(values.shape) - np.reshape(patch, (2, 1, 1))).max(axis=0)
    for k in range(1, int(away.max()) + 1):
        around = values[away == k]
        fall = at - around[np.isfinite(around)]
        if 2 * fall.size < around.size or (fall.max() > SURE and fall.min() < -SURE):
            return 0.0
        if np.abs(fall).min() > SURE:
            return float(fall.mean())
    return 0.0


def left_out(given: Stated, missed: list[StatedPlace], j: int, votes: int) -> str:
    """What to say of places that nothing makes fit: of a line, the one that is farthest off."""
    p = max(missed, key=lambda p: p.miss(j))
    would = abs(p.field + j)
    if given.known.is_line and given.fits(j):
        row, col, order = p.point
        return message(
            "places_contradict_others_one", key=given.known.key, order=order,
            missed_count=len(missed), places_count=len(given.places), row=row, col=col,
            miss=p.miss(j), would=would,
        )  # fmt: skip
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
        "row_column_fits_no", key=given.known.key, order=order, row=row, col=col, near=near[0],
        near_2=near[1], near_3=min(abs(order - v) for v in near),
    )  # fmt: skip


_REACH_PX = 30.0
"""How far from a corner a patch is looked for."""
_HIDDEN_PX = float(HALF)
"""What an edge may hide of the way."""
_HIDDEN_RISE = 0.5
"""Fringes by which the order may at most have risen there: less than the next dark."""
_DARK = 0.3
"""The light c above which the order is within 0.2 of a whole number."""
_POOLED_PX = 1.5
_BESIDE_DEG, _FEWEST_BESIDE = 20.0, 3
"""Angle beyond the corner's sides, and patches there, that are no specimen's."""


def corner_orders(
    corners: Sequence[FreeCorner], patches: Patches, labels: Labels, wave: Array, valid: Mask
) -> tuple[list[KnownPlaces], list[str]]:
    """Known orders of patches beside free corners, and what to say where there is none."""
    known, notes = [], []
    trusted = gaussian(valid.astype(float), _POOLED_PX)
    pooled = gaussian(np.where(valid, wave, 0.0), _POOLED_PX) / np.maximum(trusted, 1e-9)
    light = np.where(valid, pooled, np.nan)
    for corner in corners:
        result = _carried(corner, patches, labels, light)
        name = message("frames_free_boundary_corner_row", row=corner.row, col=corner.col)
        if isinstance(result, str):
            notes.append(f"{name}: {result}; it is not used")
            continue
        order = abs(patches.terms[result][0] - round(patches.terms[result][0]))
        place = float(patches.rows[result[0]]), float(patches.cols[result[1]])
        known.append(KnownPlaces((place,), round(float(order), 2), name, says_zero_line=False))
    return known, notes


def _carried(
    corner: FreeCorner, patches: Patches, labels: Labels, light: Array
) -> tuple[int, int] | str:
    """The followed patch to which the light carries a corner's order, or why there is none."""
    down, right = patches.rows[:, None] - corner.row, patches.cols[None, :] - corner.col
    away = np.maximum(np.hypot(down, right), 1e-9)
    cosine = np.clip((down * corner.inward[0] + right * corner.inward[1]) / away, -1.0, 1.0)
    beside = np.degrees(np.arccos(cosine)) - 0.5 * corner.angle_deg
    near = (labels.part >= 0) & (away < _REACH_PX)
    if np.count_nonzero(near & (beside > _BESIDE_DEG)) >= _FEWEST_BESIDE:
        return message("fringes_followed_outside_mask")
    inside = near & (beside < 0.0)
    if not inside.any():
        return message("no_fringe_could_followed_within", reach_px=_REACH_PX)
    i, j = np.unravel_index(np.where(inside, away, np.inf).argmin(), away.shape)
    steps = np.arange(0.0, float(away[i, j]) + 0.5, 0.5) / float(away[i, j])
    way = [corner.row + steps * down[i, 0], corner.col + steps * right[0, j]]
    carried = map_coordinates(light, way, order=0, mode="constant", cval=np.nan)
    first = int(np.isfinite(carried).argmax())
    hidden = 0.5 * first
    if not np.isfinite(carried[first:]).all() or hidden > _HIDDEN_PX:
        return message("pixels_between_next_fringes")
    if hidden * float(np.hypot(*patches.terms[inside][:, 1:3].T).max()) > _HIDDEN_RISE:
        return message("fringes_beside_too_dense")
    if carried[first:].min() < _DARK:
        return message("light_beside_not_order")
    return int(i), int(j)


_ALONE = 0.1
"""Share of what could be followed, without a point, from which it is said."""
_TELLABLE = 0.2
"""Fringes between two answers that a known order tells apart: closer to a line than half of that it
says the line, and not the side."""
_SHARP = 0.1
"""Share of the difference of two answers that the light may move them by where a point is asked."""
_DOUBTFUL = 0.003
"""Uncertainty of the signal by the ends of the light from which a line of N = 0 must be known."""
APART = 0.5
"""Fringes between two orders from which any known order contradicts one: it may be off by .24."""


@dataclass(frozen=True)
class Anchored:
    """Signed orders' `terms` (m, n, 6) of the patches by known points, NaN = not known. `misses`,
    points that were not used; `said`, what is open, and what point would settle it."""

    terms: Array = field(repr=False)
    misses: tuple[KnownPoint, ...]
    said: tuple[str, ...]


def _unknown(part: Array, given: list[Stated], *said: str) -> Anchored:
    """A part of which nothing is known, and why."""
    points = tuple(p.point for g in given for p in g.places)
    return Anchored(np.full_like(part, np.nan), points, said)


def _candidates(given: list[Stated]) -> set[int]:
    """Each j that a place says and that fits one: the part's own orders may have either sign."""
    orders = [(s * g.known.order, p.field) for g in given for p in g.places for s in (1.0, -1.0)]
    return {j for j in {round(n - f) for n, f in orders} if any(g.fits(j) for g in given)}


def _one_part(patches: Patches, part: Array, given: list[Stated], error: Array) -> Anchored:
    """A part's order by what is known in it."""
    candidates = _candidates(given)
    if not candidates:
        return _unknown(part, given, *(fits_nothing(g, g.places[0]) for g in given))
    lines = {j: zero_lines(part[..., 0] + j, _zero_said(j, given)) for j in candidates}
    cost = {j: sum(g.cost(j) for g in given) for j in candidates}
    # a line of N = 0 is unlikely, and no proof: it says what is tried first, and settles nothing
    best, *others = sorted(candidates, key=lambda j: (round(cost[j], 6), lines[j], j))
    rivals = [j for j in others if cost[j] < cost[best] + CLEAR]
    if rivals:
        return _of_rivals(patches, part, given, (best, *rivals), error)
    sure = [g for g in given if g.fits(best)]
    doubtful = float(np.median(error[np.isfinite(part[..., 0])])) > _DOUBTFUL
    if lines[best] and (doubtful or all(g.on_line for g in sure)):
        return _unknown(part, sure, f"{sure[0]}: " + message("order_would_along_line"))
    return _with_seams(patches, part, given, best, error)


def _of_rivals(
    patches: Patches, part: Array, given: list[Stated], rivals: Sequence[int], error: Array
) -> Anchored:
    """The first of some equally likely shifts that seams make fit all; else nothing, and why."""
    for j in rivals:
        if not all(p.fits(j) for g in given for p in g.places):
            result = _with_seams(patches, part, given, j, error)
            if not result.misses:
                return result
    best, rival = rivals[:2]
    listed = "; ".join(map(str, given))
    if all(any(not g.fits(j) for g in given) for j in (best, rival)):
        note = message("contradict_each_other_no", listed=listed)
    else:
        orders = [np.abs(part[..., 0] + j) for j in (best, rival)]
        row, col, at = _place(patches, clearly_apart(np.abs(orders[0] - orders[1])))
        first, second = sorted(o[at] for o in orders)
        note = message(
            "fringe_line_light_cannot", listed=listed, row=row, col=col, first=first, second=second
        )
        turning = next((g for g in given if not g.known.is_line and g.places[0].around), None)
        if turning is not None:
            note += message("extremum_maximum_minimum", turning=turning)
    return _unknown(part, given, note)


def _with_seams(
    patches: Patches, part: Array, given: list[Stated], j: int, error: Array
) -> Anchored:
    """Open seams closed as points beyond them say, and what still lies beyond one left out."""
    terms = part.copy()
    terms[..., 0] += j
    notes: list[str] = []
    misses: list[KnownPoint] = []
    used = [(g, p) for g in given for p in g.places if p.cost(j) < CLEAR]
    zero_said = _zero_said(j, given)
    for g in given:
        missed = []
        for p in (p for p in g.places if p.cost(j) >= CLEAR):
            turned = turned_to(patches, terms, used, zero_said, g, p)
            if turned is None:
                missed.append(p)
            else:
                terms = turned
                used.append((g, p))
        if missed:
            misses += [p.point for p in missed]
            notes.append(left_out(g, missed, j, sum(other.fits(j) for other in given)))
    sources = [g.source(p, terms) for g, p in used]
    for crest, beyond in open_seams(patches, terms, sources, zero_said):
        if beyond.sum() >= FEWEST_PATCHES:
            notes.append(_beyond_seam(patches, terms, beyond, crest, error))
        terms[beyond] = np.nan
    return Anchored(terms, tuple(misses), tuple(notes))


def _zero_said(j: int, given: list[Stated]) -> list[ZeroPlace]:
    """Where it is known that N = 0 along a line: a place on it, or two on its two sides."""
    on_zero = [(g, p) for g in given if g.known.says_zero_line for p in g.places if p.fits(j)]
    on: list[ZeroPlace] = [(p.patch,) for g, p in on_zero if g.known.order < NOUGHT]
    off = [p for g, p in on_zero if g.known.order > NOUGHT and not g.on_line]
    above, below = ([p for p in off if sign * (p.field + j) > 0.0] for sign in (1.0, -1.0))
    return on + [(p.patch, q.patch) for p in above for q in below]


def _beyond_seam(patches: Patches, terms: Array, beyond: Mask, crest: int, error: Array) -> str:
    """What to say of patches whose branch the light does not settle. A point is asked for where the
    light is known well enough for its answer to be the order."""
    order = terms[..., 0]
    mirrored = np.abs(crest - order)
    share = 100.0 * beyond.sum() / max(1, np.isfinite(order).sum())
    note = message("light_cannot_decide_whether", crest=abs(0.5 * crest), share=share)
    apart = np.where(beyond, np.abs(mirrored - np.abs(order)), np.nan)
    most = float(np.nanmax(apart))
    if most < _TELLABLE:
        return message("lies_within_line_order", said=note, most=0.5 * most)
    # how far an error e of the signal moves an order: min(e/(pi |sin 2 pi N|), sqrt(e)/pi)
    slope = np.pi * np.abs(np.sin(TURN * np.where(beyond, order, 0.0)))
    moved = np.minimum(error / np.maximum(slope, 1e-9), np.sqrt(error) / np.pi)
    lit = (apart >= _TELLABLE) & (moved < np.minimum(LARGEST_UNCERTAINTY, _SHARP * apart))
    if not lit.any():
        return message("nor_light_there_give", said=note)
    row, col, at = _place(patches, clearly_apart(np.where(lit, apart, np.nan)))
    first, second = sorted([float(mirrored[at]), abs(float(order[at]))])
    return message(
        "known_order_row_column_settles", said=note, row=row, col=col, first=first, second=second
    )


def clearly_apart(difference: Array) -> Mask:
    """Where two orders differ enough for a known one to tell them apart, else where most. Equation:
    d > min(1/2, max(d)/2), d the `difference` (rows, cols), NaN where nothing is asked."""
    return np.asarray(difference > min(APART, 0.5 * float(np.nanmax(difference))))


def _place(patches: Patches, where: Mask) -> tuple[int, int, tuple[int, int]]:
    """The middle-most place of some patches: row and column of its pixel, and its patch."""
    i, j = innermost(where)
    return int(patches.rows[i]), int(patches.cols[j]), (i, j)


def _unfollowed(known: KnownPlaces, valid: Mask) -> str:
    row, col = known.places[0]
    i, j = round(row), round(col)
    inside = 0 <= i < valid.shape[0] and 0 <= j < valid.shape[1] and bool(valid[i, j])
    why = message("no_fringe_could_followed") if inside else message("lies_outside_specimen_where")
    others = message("other_places") if known.is_line else ""
    return f"{known.key} = {known.order:g} at row {row:g}, column {col:g}{others}: {why}"


_LEAST_COVER = 0.15
_CONTRAST_ROUNDS, _MOSTLY = 4, 98.0
"""Readings at most with a contrast found from the last; per cent of the frame that must rest."""
_GROUND = 1e-3
"""Standard deviation of what a quadratic cannot follow, added to a patch's own, fringes."""
_WORTH_SAYING = 0.01
"""Share of what is read that another light must take away before it is said."""


@dataclass(frozen=True)
class FreeReading:
    """What a frame says without a model: the order, and how well it is known. `contrast`, what the
    fringes have left; `misses`: known points that were not used; `said`: why, what the frame leaves
    open, and what point would settle it."""

    reading: OrderReading
    contrast: Array = field(repr=False)
    misses: tuple[KnownPoint, ...]
    said: tuple[str, ...] = ()


def read_free(
    wave: Array, sigma: Array, valid: Mask, known: KnownOrders, *, error: Array
) -> FreeReading:
    """Read the fringe order of a normalised frame `wave`, cos 2 pi N, without a model. Each part
    that is wanted needs a point, a line or a corner that is `known`. `error`: uncertainty of the
    signal (1 - cos 2 pi N)/2 by the ends of the light: from 0.003 on in the median a line of N = 0,
    which stands for N = 1 in a wrong light, must be known. InputError: a frame too small."""
    followed, fade = follow_fringes(wave, sigma, valid, known, error=error)
    result = followed.anchored(known)
    reading = _dense(followed.patches, result.terms, valid)
    # as uncertain as light leaves it that is not the fringes'
    read = np.isfinite(reading.order)
    turns = TURN * np.where(read, reading.order, 0.0)
    weight = np.where(read, 1.0 / (sigma / fade), 0.0)
    residual = np.where(read, followed.wave - np.cos(turns), 0.0) * weight
    stray = stray_variance(residual, -TURN * np.sin(turns) * weight, -2.0 * weight)
    reading = less_sure(reading, np.sqrt(stray), LARGEST_UNCERTAINTY)
    return FreeReading(reading, fade, result.misses, result.said)


@dataclass(frozen=True)
class FollowedFringes:
    """What a frame's fringes say before an order is known. `faded`: they have lost contrast, so
    that what can be followed depends on what was known; `wave`, the light c = cos 2 pi N; `unlit`
    (m, n), the signal's uncertainty by the ends of the light at the patches."""

    faded: bool
    patches: Patches = field(repr=False)
    labels: Labels = field(repr=False)
    wave: Array = field(repr=False)
    valid: Mask = field(repr=False)
    unlit: Array = field(repr=False)

    def anchored(self, known: KnownOrders) -> Anchored:
        """The patches' whole numbers and the sides of open seams by what is `known`."""
        patches, labels = self.patches, self.labels
        at_corners, notes = corner_orders(known.corners, patches, labels, self.wave, self.valid)
        terms = np.full_like(patches.terms, np.nan)
        field_terms = labels.sign[..., None] * patches.terms
        field_terms[..., 0] += labels.shift
        misses: list[KnownPoint] = []
        by_part: dict[int, list[Stated]] = {}
        for each in (*known.places, *at_corners):
            places = [stated_place(patches, labels, field_terms, each, p) for p in each.places]
            misses += [p.point for p in places if p.part < 0]
            parts = sorted({p.part for p in places if p.part >= 0})
            if not parts:
                notes.append(_unfollowed(each, self.valid))
            for part in parts:
                within = tuple(p for p in places if p.part == part)
                by_part.setdefault(part, []).append(Stated(each, within))
        for part, given in sorted(by_part.items()):
            inside = labels.part == part
            own_terms = np.where(inside[..., None], field_terms, np.nan)
            result = _one_part(patches, own_terms, given, self.unlit)
            misses += result.misses
            notes += result.said
            terms[inside] = result.terms[inside]
        unanchored = (labels.part >= 0) & ~np.isin(labels.part, list(by_part))
        share = float(unanchored.sum() / max(1, int((labels.part >= 0).sum())))
        if share > _ALONE:
            numbers, counts = np.unique(labels.part[unanchored], return_counts=True)
            row, col, _ = _place(patches, labels.part == numbers[counts.argmax()])
            percent = 100.0 * share
            notes.append(message("what_could_followed_hangs", share=percent, row=row, col=col))
        return Anchored(terms, tuple(misses), tuple(notes))

    def part_at(self, row: float, col: float, *, on_line: bool = False) -> Mask:
        """The patches (m, n) for which an order at a place speaks; none where it has none."""
        patches, labels, place = self.patches, self.labels, (row, col)
        kind = KnownPlaces((place,) * (2 if on_line else 1), 0.0)
        number = stated_place(patches, labels, patches.terms, kind, place).part
        return np.asarray((labels.part == number) & (number >= 0))


def follow_fringes(
    wave: Array, sigma: Array, valid: Mask, known: KnownOrders, *, error: Array
) -> tuple[FollowedFringes, Array]:
    """Follow the fringes of a normalised frame as far as they can be; what they have of contrast.
    Low orders of wide fringes lose next to nothing of their contrast and tell what the others lose:
    where contrast is lost, and there alone, what is followed grows from them by what is `known`."""
    fade = np.ones(wave.shape)
    patches, labels = coarse_to_fine(wave, sigma, valid)
    contrast = patches.contrast[(patches.filled > LEAST_FILLED) & np.isfinite(patches.contrast)]
    # so much is lost that it must be reckoned with
    faded = bool(len(contrast) >= _FEWEST and np.mean(contrast < 1.0 - FADED) > _SOME)

    def followed(patches: Patches, labels: Labels, wave: Array) -> FollowedFringes:
        return FollowedFringes(faded, patches, labels, wave, valid, patches.at_middles(error))

    if faded:
        patches, labels = coarse_to_fine(wave, sigma, valid, faded=True)
        for _ in range(_CONTRAST_ROUNDS):
            result = followed(patches, labels, wave / fade).anchored(known)
            if not np.isfinite(result.terms).any():
                break
            unfaded = replace(patches, contrast=patches.contrast * patches.at_middles(fade))
            before, fade = fade, fit_contrast(unfaded, result.terms, wave.shape)
            patches, labels = coarse_to_fine(wave / fade, sigma / fade, valid, faded=True)
            if np.percentile(np.abs(fade - before)[valid], _MOSTLY) < FADED:
                break
    return followed(patches, labels, wave / fade), fade


def _dense(patches: Patches, terms: Array, valid: Mask) -> OrderReading:
    """The mean of the patches' orders at each pixel, and how far they agree. u² = max(mean of the
    patches' u², variance of their orders), since noise alone makes patches differ; a patch's u is
    that of the stated noise, times its chi where that is below 1, and not below that of half the
    patches: the stated noise has a floor, many frames have less."""
    use = np.isfinite(terms[..., 0])
    terms = np.where(use[..., None], terms, 0.0)
    usual = np.median(patches.chi[use]) if use.any() else 1.0
    of_patch = patches.spread[..., 0] * np.clip(patches.chi, min(usual, 1.0), 1.0)
    trust = np.where(use, 1.0 / (of_patch**2 + _GROUND**2), 0.0)
    orders = np.abs(terms.reshape(-1, 6) @ basis(DY.astype(float), DX.astype(float)).T)
    sums = np.zeros((4, *valid.shape))
    bodies, count = label(valid)
    for k, (y, x, w) in enumerate(zip(DY, DX, WINDOW, strict=True)):
        order = orders[:, k].reshape(trust.shape)
        at = np.ix_(patches.rows + y, patches.cols + x)
        share = w * (use if count == 1 else use & (bodies[at] == patches.body))
        first = share * trust * order
        for total, value in zip(sums, (share * trust, first, first * order, share), strict=True):
            total[at] += value
    weight, first, second, cover = sums
    covered = valid & (cover > _LEAST_COVER * max(float(cover.max()), 1e-9))
    safe = np.where(covered, weight, 1.0)
    mean = first / safe
    spread = np.sqrt(np.maximum(second / safe - mean**2, 0.0))
    uncertainty = np.maximum(np.sqrt(np.where(covered, cover, 1.0) / safe), spread)
    covered &= uncertainty < LARGEST_UNCERTAINTY
    return make_reading(mean, uncertainty, covered, of=valid)


def common_reading(readings: Sequence[FreeReading]) -> FreeReading:
    """The reading that misses the fewest known points, as uncertain as its equals leave it. Several
    smooth lights may explain a frame alike, and under each other regions are turned over about a
    crest: u' = (u² + sum d²)^(1/2), d the difference of another reading's order; a pixel of more
    than 0.03 fringe, or that another does not know, is not known. `readings`: the best first."""
    best, *others = _fewest_missed(readings)
    orders = [result.reading.order for result in others]
    if not orders:
        return best
    before = best.reading
    reading = less_sure(before, _disagreement(before.order, orders), LARGEST_UNCERTAINTY)
    read = np.isfinite(before.order)
    lost = read & ~np.isfinite(reading.order)
    share = float(lost.sum() / max(1, int(read.sum())))
    if share < _WORTH_SAYING:
        return replace(best, reading=reading)
    note = message("another_smooth_light_explains", share=100.0 * share)
    for order in orders:
        away = np.where(lost, np.abs(order - before.order), np.nan)
        if (away > APART).any():  # else no known order rules either light out
            at = innermost(clearly_apart(away))
            first, second = sorted((float(before.order[at]), float(order[at])))
            note += message(
                "known_order_row_column", at=at[0], at_2=at[1], first=first, second=second
            )
            break
    return replace(best, reading=reading, said=(*best.said, note))


def common_orders(
    followed: Sequence[FollowedFringes], known: KnownOrders
) -> tuple[Array, tuple[str, ...]]:
    """The patches' orders (m, n) by what is known, as `common_reading` has pixels', and words."""
    best, *others = _fewest_missed([one.anchored(known) for one in followed])
    order, *orders = (np.abs(one.terms[..., 0]) for one in (best, *others))
    if orders:
        order = np.where(_disagreement(order, orders) < LARGEST_UNCERTAINTY, order, np.nan)
    return order, best.said


_Result = TypeVar("_Result", FreeReading, Anchored)


def _fewest_missed(results: Sequence[_Result]) -> list[_Result]:
    """The results that miss the fewest known points."""
    fewest = min(len(result.misses) for result in results)
    return [result for result in results if len(result.misses) == fewest]


def _disagreement(order: Array, orders: Sequence[Array]) -> Array:
    """How far others are from an order, root sum of squares; inf where one is not known."""
    square = np.sum([(order - other) ** 2 for other in orders], axis=0)
    return np.sqrt(np.where(np.isnan(square), np.inf, square))
