"""What a user knows of the order, as the patches of one part see it.

A point, the places of a fringe line, or a free corner. Between two free sides of an outward
corner no stress is left: N rises from it as r^p. For stress
functions r^(p+2) the sides are free where sin(2 lambda a) = -lambda sin(2 a), lambda = p + 1, of
the interior angle 2 a, so that p = 1.74 at 90 degrees, 1.27 at 110, and 1 at 126.
Source: Williams (1952), J. Appl. Mech. 19, 526.

The nearest patch that is followed lies some pixels away. On the way to it N starts at nought and
changes by less than a quarter as long as the light c = cos 2 pi N stays dark, c > 0: so the corner
says the patch's whole number where all of the way is seen to be dark. Within the few pixels that a
blurred or masked edge hides, N is less than their distance times its slope beyond them, as p > 1.

Regions of the field that are mirrored about a crest, or that might as well be.

On a crest of the light, n = k/2, the light is the same whether the order goes on through it or
turns back: a region beyond it could be k - n in place of n. Only the smoothness of the patches
along the whole of the crest tells. For each crest the regions away from it are taken as they are,
and the seam along which one of them would be turned over at the least cost is a minimum cut through
the patches near the crest; an edge's cost is by how much worse its two patches would agree.
A seam of negative cost is a region turned over by mistake: it is turned back. A seam along which
some edges speak for turning and others against is one that the light does not settle, such as a
flat valley of the order along a crest under noise: what lies beyond it is not known.
Source: Boykov, Veksler & Zabih (2001), IEEE TPAMI 23, 1222, for cuts as moves that lower a cost.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_flow
from skimage.measure import label
from skimage.segmentation import expand_labels

from isochrome.fringes.on_branch import BRANCH, SURE
from isochrome.fringes.single_frame.patches import (
    HALF,
    SMALLEST,
    SURE_ENOUGH,
    WORST_EDGE,
    Labels,
    Patches,
    basis,
    neighbours,
    scale_of,
)
from isochrome.fringes.windows import Array, Indices, Mask, gaussian
from isochrome.messages import message
from isochrome.scene import FreeCorner

_SETTLED = 0.5
"""Share of what all edges of a seam say that they must be worth together: edges that agree give
1, contradicting ones 0. In rendered frames settled seams gave 0.59 at least, open ones 0."""
_SETTLED_ZERO = 0.95
"""The same where turning over takes a line of N = 0 away, which a loaded body hardly has: every
edge must then speak against it."""
_BANDS = (0.1, 0.03)
"""Half-widths, in fringes, of what counts as near a crest. The wide one leaves a seam its way round
patches that noise has thrown off; the narrow one sees corners that lie just beyond the crest."""
NOUGHT, FEWEST_PATCHES = 0.1, 6
"""Fringes beyond nought, and patches, on either side of a line of N = 0."""
_NEAR = 3
"""Patches about a known point in which it says such a line."""
_ALIKE = 0.015
"""Distance from a crest, in fringes, at which a patch and its mirror image are as good as one."""
_PASSES = 20
_PER_UNIT = 100.0

ZeroPlace = tuple[tuple[int, int], ...]
"""A patch (row, col) on a line of N = 0, or two on its two sides."""
AnchorPatch = tuple[tuple[int, int], int | None]
"""A patch (row, col) where the order is known, and the crest (half fringes) that it lies on, if
any: of that one it does not say the side."""


@dataclass(frozen=True)
class _Seam:
    """Least costly seam of a region `beyond` (m, n) that could be mirrored about n = crest/2.

    `worse`, the sum over its edges of what mirroring would cost; `size`, that of their sizes.
    """

    crest: int
    beyond: Mask
    worse: float
    size: float

    def is_open(self, settled: float = _SETTLED) -> bool:
        """Whether the light does not settle on which side the field lies beyond it."""
        return self.worse <= settled * self.size


def mend_mirrored(patches: Patches, labels: Labels) -> Labels:
    """Turn regions back that are mirrored about a crest against what the patches there say.

    Parameters: `patches` and their `labels`. Returns Labels of no more contradictions.
    """
    sign, shift = labels.sign.copy(), labels.shift.copy()
    for part in range(int(labels.part.max()) + 1):
        inside = labels.part == part
        for _ in range(_PASSES):
            signed = np.where(inside[..., None], sign[..., None] * patches.terms, np.nan)
            signed[..., 0] += shift
            worst = min(_seams(patches, signed), key=lambda seam: seam.worse, default=None)
            if worst is None or worst.worse >= 0.0:
                break
            sign[worst.beyond] *= -1
            shift[worst.beyond] = worst.crest - shift[worst.beyond]
    return Labels(sign, shift, labels.part)


def zero_lines(order: Array, known: Sequence[ZeroPlace] = ()) -> int:
    """The number of lines of N = 0 of which nothing known says that they are.

    Each parts a region of positive signed `order` (m, n) from one of negative; `known`: a patch on
    such a line, or two on its two sides.
    """
    labels = np.zeros(order.shape, dtype=int)
    for side in (order > NOUGHT, order < -NOUGHT):
        regions_of = label(side, connectivity=1)
        large = np.bincount(regions_of.ravel()) >= FEWEST_PATCHES
        labels = np.where(side & large[regions_of], regions_of + labels.max(), labels)
    regions = np.where(np.isfinite(order), expand_labels(labels, distance=max(order.shape)), 0)
    positive = np.zeros(int(regions.max()) + 1, dtype=bool)
    positive[labels[order > NOUGHT]] = True
    positive[0] = False
    lines = set()
    for a, b in ((regions[1:], regions[:-1]), (regions[:, 1:], regions[:, :-1])):
        two = (a > 0) & (b > 0) & (positive[a] != positive[b])
        lines |= {frozenset(pair) for pair in zip(a[two].tolist(), b[two].tolist(), strict=True)}
    return sum(not any(_says(place, regions, line) for place in known) for line in lines)


def _says(place: ZeroPlace, regions: Indices, line: frozenset[int]) -> bool:
    """Whether a place says the line of N = 0 between two regions."""
    if len(place) == 2:
        return {int(regions[patch]) for patch in place} == line
    near = tuple(slice(max(0, i - _NEAR), i + _NEAR + 1) for i in place[0])
    return line <= set(np.unique(regions[near]).tolist())


def open_seams(
    patches: Patches, terms: Array, points: Sequence[AnchorPatch], known: Sequence[ZeroPlace]
) -> list[tuple[int, Mask]]:
    """Patches whose branch the light does not settle from where the order is known.

    Parameters: `patches`; `terms` (m, n, 6) of the signed order, NaN = not known; `points`,
    where it is known; `known`, where lines of N = 0 are. Returns for each seam its crest (in half
    fringes) and the patches beyond it (m, n), each patch once.
    Mirroring about n = 0 changes no order and is left out.
    """
    order = terms[..., 0]
    unsure = np.zeros(terms.shape[:2], dtype=bool)
    result = []
    seams = _not_settled(patches, terms, points, known)
    for seam in sorted(seams, key=lambda s: -int(s.beyond.sum())):
        beyond = seam.beyond & (np.abs(order - 0.5 * seam.crest) > _ALIKE) & ~unsure
        if beyond.any():
            unsure |= beyond
            result.append((seam.crest, beyond))
    return result


def _not_settled(
    patches: Patches, terms: Array, points: Sequence[AnchorPatch], known: Sequence[ZeroPlace]
) -> list[_Seam]:
    """The seams that the light leaves open, as in `open_seams`."""
    order = terms[..., 0]
    seams = [s for s in _seams(patches, terms, points) if s.crest and s.is_open(_SETTLED_ZERO)]
    lines = 0 if all(seam.is_open() for seam in seams) else zero_lines(order, known)
    turned = (np.where(seam.beyond, seam.crest - order, order) for seam in seams)
    return [
        seam
        for seam, after in zip(seams, turned, strict=True)
        if seam.is_open() or (lines and zero_lines(after, known) < lines)
    ]


def _seams(
    patches: Patches, terms: Array, points: Sequence[AnchorPatch] | None = None
) -> Iterator[_Seam]:
    """The least costly seam of each region beyond each crest, seen from the points.

    Without points that say a side of the crest, from the largest region.
    """
    shape, order = terms.shape[:2], terms[..., 0].ravel()
    known = np.isfinite(order)
    if not known.any():
        return
    pairs = neighbours(patches, terms)
    both_known = known[pairs[0]] & known[pairs[1]]
    a, b, *half_way = (part[both_known] for part in pairs)
    x, y, variance = half_way
    cost = _cost(x, y, variance)
    low, high = np.percentile(order[known], [0.1, 99.9])
    crests = range(int(np.floor(2.0 * low)), int(np.ceil(2.0 * high)) + 1)
    for crest, band in product(crests, _BANDS):  # seams keep to the patches in a band about it
        from_crest = order - 0.5 * crest
        far = known & (np.abs(from_crest) >= band)
        if not 0 < np.count_nonzero(far) < np.count_nonzero(known):
            continue
        same = far[a] & far[b]
        if points is not None:  # where doubt is enough; what is turned back must be a whole region
            same &= cost < WORST_EDGE
        same &= (from_crest[a] > 0.0) == (from_crest[b] > 0.0)
        edges = np.ones(np.count_nonzero(same)), (a[same], b[same])
        graph = coo_matrix(edges, shape=(known.size, known.size)).tocsr()
        region = connected_components(graph, directed=False)[1]
        sizes = np.bincount(region[far], minlength=region.max() + 1)
        sides = [patch for patch, on_crest in points or () if on_crest != crest]
        here = np.unique([region[np.ravel_multi_index(p, shape)] for p in sides])
        if not sides:
            here = np.array([sizes.argmax()])
        others = np.setdiff1d(np.flatnonzero(sizes >= SMALLEST), here)
        ends = region[a[~same]], region[b[~same]]
        mirrored = -y[~same]
        mirrored[:, 0] += crest
        worse = _cost(x[~same], mirrored, variance[~same]) - cost[~same]
        for cut in _cuts(ends, worse, here, others, len(sizes)):
            across = cut[ends[0]] != cut[ends[1]]
            if across.any():
                beyond = (cut[region] & known).reshape(shape)
                size = float(np.abs(worse[across]).sum())
                yield _Seam(crest, beyond, float(worse[across].sum()), size)


def _cost(x: Array, y: Array, variance: Array) -> Array:
    """How badly two patches agree, chi², up to where nothing more is learnt from it."""
    square = (((x - y) / scale_of(x, y, variance)) ** 2).sum(axis=-1)
    return np.asarray(np.minimum(square, SURE_ENOUGH))


def _cuts(
    ends: tuple[Indices, Indices], worse: Array, here: Indices, others: Indices, count: int
) -> Iterator[Mask]:
    """The minimum cut (count,), True beyond it, between the regions `here` and each one there."""
    numbers, at = np.unique(np.concatenate([*ends, here, others]), return_inverse=True)
    a, b, sources, sinks = np.split(at, np.cumsum([len(ends[0]), len(ends[1]), len(here)]))
    root = len(numbers)  # one node more, from which all sources are fed
    room = np.rint(_PER_UNIT * np.maximum(worse, 0.0)).astype(np.int32)
    begin = np.concatenate([a, b, np.full(len(sources), root)])
    end = np.concatenate([b, a, sources])
    endless = np.full(len(sources), np.iinfo(np.int32).max // 2, dtype=np.int32)
    room = np.concatenate([room, room, endless])
    graph = coo_matrix((room, (begin, end)), shape=(root + 1, root + 1)).tocsr()
    for sink in sinks:
        capacity = graph - maximum_flow(graph, root, int(sink)).flow
        capacity.eliminate_zeros()
        reached, _ = breadth_first_order(capacity, root, directed=True)
        beyond = np.zeros(count, dtype=bool)
        beyond[numbers[np.setdiff1d(np.arange(root), reached)]] = True
        yield beyond


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
    """An order that is known at places (row, col), pixels: at one, or along a fringe line.

    `key`, what messages call it; `says_zero_line`: an order of 0 may be that of a line, where a
    free corner's is the corner's alone; `extremum`: 'maximum' or 'minimum' of its surroundings.
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
    """What is known of a frame's orders: points, fringe lines, and corners free of load."""

    places: tuple[KnownPlaces, ...] = ()
    corners: tuple[FreeCorner, ...] = ()


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
        crest = round(2.0 * float(p.basis @ terms[p.patch])) if self.on_line else None
        return p.patch, crest

    def __str__(self) -> str:
        row, col, order = self.places[0].point
        return f"{self.known.key} = {order:g} at row {row:g}, column {col:g}"


def turned_to(
    patches: Patches,
    terms: Array,
    used: Sequence[tuple[Stated, StatedPlace]],
    known: Sequence[ZeroPlace],
    given: Stated,
    p: StatedPlace,
) -> Array | None:
    """The terms (m, n, 6) with an open seam closed as a place beyond it says.

    As they are where the place fits, since another place of its line has closed it, or roughly, and
    better beyond no seam; None where it fits neither way. `used`, what they are known by, `known`
    as in `open_seams`.
    """
    now, order = float(p.basis @ terms[p.patch]), given.known.order
    miss = abs(abs(now) - order)
    if (miss / p.sigma) ** 2 < CLEAR:
        return terms
    within = min(p.within, miss)  # nearer than it is
    points = [g.source(q, terms) for g, q in used]
    seams = [
        seam
        for seam in _not_settled(patches, terms, points, known)
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
    """What the patch about a place says of it, by the parts' `terms` (m, n, 6).

    About a single point that may be one on a flat crest, which is not followed: then one beside it
    on the same body.
    """
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
        slope = float(np.hypot(*terms[patch][1:3]))
        sigma = float(np.hypot(sigma, _BESIDE_LINE_PX * slope))
        within = min(within, _FAR_BESIDE * sigma)
    in_patch = basis(*off)
    order, around = float(in_patch @ terms[patch]), 0.0
    if not known.is_line:
        part = np.where(labels.part == labels.part[patch], terms[..., 0], np.nan)
        around = _above(part, patch, order)
    return StatedPlace(
        point=(row, col, known.order), patch=patch, basis=in_patch, field=order, sigma=sigma,
        within=within, around=around, extremum=known.extremum,
    )  # fmt: skip


def _above(values: Array, patch: tuple[int, int], at: float) -> float:
    """How far a field lies above the nearest square about a patch that is all above or below it.

    Parameters: `values` (m, n), NaN outside the part; `patch`; `at`, the field there. Returns
    nought where some of the square about it lies above and some below, or half is not known.
    """
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
        plural = "s" * (votes > 1)
        return message(
            "contradicted_other_which_would", given=given, votes=votes, value=plural, would=would
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
_BESIDE_DEG, _FEWEST = 20.0, 3
"""Angle beyond the corner's sides, and patches there, that are no specimen's."""


def corner_orders(
    corners: Sequence[FreeCorner], patches: Patches, labels: Labels, wave: Array, valid: Mask
) -> tuple[list[KnownPlaces], list[str]]:
    """Known orders of patches beside free corners, and what to say where there is none.

    Parameters: `corners`; `patches` and their `labels`; `wave`, the light c (rows, cols); `valid`,
    True = trusted (rows, cols).
    """
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
    if np.count_nonzero(near & (beside > _BESIDE_DEG)) >= _FEWEST:
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
    steepest = float(np.hypot(*patches.terms[inside][:, 1:3].T).max())
    if not np.isfinite(carried[first:]).all() or hidden > _HIDDEN_PX:
        return message("pixels_between_next_fringes")
    if hidden * steepest > _HIDDEN_RISE:
        return message("fringes_beside_too_dense")
    if carried[first:].min() < _DARK:
        return message("light_beside_not_order")
    return int(i), int(j)
