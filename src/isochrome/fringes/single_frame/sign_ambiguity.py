r"""Regions of the field that are mirrored about a crest, or that might as well be.

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
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_flow
from skimage.measure import label
from skimage.segmentation import expand_labels

from isochrome.fringes.single_frame.patch_labels import SURE_ENOUGH, Labels
from isochrome.fringes.single_frame.patches import Patches, neighbours, scale_of
from isochrome.fringes.windows import Array, Indices, Mask

_BANDS = (0.1, 0.03)
"""Half-widths, in fringes, of what counts as near a crest. The wide one leaves a seam its way round
patches that noise has thrown off; the narrow one sees corners that lie just beyond the crest."""
_SMALLEST = 12
"""Patches of the smallest region that is looked at."""
_SETTLED = 0.5
"""Share of what all edges of a seam say that they must be worth together: edges that agree give
1, contradicting ones 0. In rendered frames settled seams gave 0.59 at least, open ones 0."""
_SETTLED_ZERO = 0.95
"""The same where turning over takes a line of N = 0 away, which a loaded body hardly has: every
edge must then speak against it."""
_BELOW, _FEWEST = 0.1, 6
"""Fringes beyond nought, and patches, on either side of a line of N = 0."""
_NEAR = 3
"""Patches about a known point in which it says such a line."""
_ALIKE = 0.015
"""Distance from a crest, in fringes, at which a patch and its mirror image are as good as one."""
_AGREE = 12.0
"""Cost of an edge, chi², from which its two patches need not lie on one side of a seam."""
_PASSES = 20
_PER_UNIT, _ENDLESS = 100.0, 2**30

ZeroPlace = tuple[tuple[int, int], ...]
"""A patch (row, col) on a line of N = 0, or two on its two sides."""


@dataclass(frozen=True)
class AnchorPatch:
    """Where the order is known: the `patch` (row, col), and the quadratic's `basis` (6,) there.

    `crest`, the crest (half fringes) that it lies on: of that one it does not say the side.
    """

    patch: tuple[int, int]
    basis: Array = field(repr=False)
    crest: int | None = None


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

    def takes_zero_line(self, order: Array, said: Sequence[ZeroPlace], lines: int) -> bool:
        """Whether turning over takes one of the signed order's `lines` of N = 0, not `said`."""
        turned = np.where(self.beyond, self.crest - order, order)
        return zero_lines(turned, said) < lines


@dataclass(frozen=True)
class _Joints:
    """Neighbouring patches a, b: their terms half-way, those's variance, and their cost as is."""

    a: Indices
    b: Indices
    x: Array
    y: Array
    variance: Array
    cost: Array

    def mirrored(self, which: Mask, crest: int) -> Array:
        """By how much worse some of them would agree with b mirrored."""
        y = -self.y[which]
        y[:, 0] += crest
        return _cost(self.x[which], y, self.variance[which]) - self.cost[which]


def mend_mirrored(patches: Patches, labels: Labels) -> Labels:
    """Turn regions back that are mirrored about a crest against what the patches there say.

    Parameters: `patches` and their `labels`. Returns Labels of no more contradictions.
    """
    sign, shift = labels.sign.copy(), labels.shift.copy()
    for part in range(int(labels.part.max()) + 1):
        inside = labels.part == part
        for _ in range(_PASSES):
            own = np.where(inside[..., None], sign[..., None] * patches.terms, np.nan)
            own[..., 0] += shift
            worst = min(_seams(patches, own), key=lambda seam: seam.worse, default=None)
            if worst is None or worst.worse >= 0.0:
                break
            sign[worst.beyond] *= -1
            shift[worst.beyond] = worst.crest - shift[worst.beyond]
    return Labels(sign, shift, labels.part)


def zero_lines(order: Array, said: Sequence[ZeroPlace] = ()) -> int:
    """The number of lines of N = 0 of which nothing known says that they are.

    Each line parts a region of positive signed order from one of negative.

    Parameters
    ----------
    order : ndarray (m, n)
        Signed order of the patches, NaN = not known.
    said : sequence of ZeroPlace, optional
        Where such a line is known: a patch on it, or two patches on its two sides.
    """
    labels = np.zeros(order.shape, dtype=int)
    for side in (order > _BELOW, order < -_BELOW):
        own = label(side, connectivity=1)
        large = np.bincount(own.ravel()) >= _FEWEST
        labels = np.where(side & large[own], own + labels.max(), labels)
    regions = np.where(np.isfinite(order), expand_labels(labels, distance=max(order.shape)), 0)
    positive = np.zeros(int(regions.max()) + 1, dtype=bool)
    positive[labels[order > _BELOW]] = True
    positive[0] = False
    lines = set()
    for a, b in ((regions[1:], regions[:-1]), (regions[:, 1:], regions[:, :-1])):
        two = (a > 0) & (b > 0) & (positive[a] != positive[b])
        lines |= {frozenset(pair) for pair in zip(a[two].tolist(), b[two].tolist(), strict=True)}
    return sum(not any(_says(place, regions, line) for place in said) for line in lines)


def _says(place: ZeroPlace, regions: Indices, line: frozenset[int]) -> bool:
    """Whether a place says the line of N = 0 between two regions."""
    if len(place) == 2:
        return {int(regions[patch]) for patch in place} == line
    near = tuple(slice(max(0, i - _NEAR), i + _NEAR + 1) for i in place[0])
    return line <= set(np.unique(regions[near]).tolist())


def open_seams(
    patches: Patches, terms: Array, points: Sequence[AnchorPatch], said: Sequence[ZeroPlace]
) -> list[tuple[int, Mask]]:
    """Patches whose branch the light does not settle from where the order is known.

    Parameters: `patches`; `terms` (m, n, 6) of the signed order, NaN = not known; `points`,
    where it is known; `said`, where lines of N = 0 are. Returns for each seam its crest (in half
    fringes) and the patches beyond it (m, n), each patch once.
    Mirroring about n = 0 changes no order and is left out.
    """
    order = terms[..., 0]
    unsure = np.zeros(terms.shape[:2], dtype=bool)
    result = []
    seams = _not_settled(patches, terms, points, said)
    for seam in sorted(seams, key=lambda s: -int(s.beyond.sum())):
        beyond = seam.beyond & (np.abs(order - 0.5 * seam.crest) > _ALIKE) & ~unsure
        if beyond.any():
            unsure |= beyond
            result.append((seam.crest, beyond))
    return result


def _not_settled(
    patches: Patches, terms: Array, points: Sequence[AnchorPatch], said: Sequence[ZeroPlace]
) -> list[_Seam]:
    """The seams that the light leaves open, as in `open_seams`."""
    order = terms[..., 0]
    seams = [s for s in _seams(patches, terms, points) if s.crest and s.is_open(_SETTLED_ZERO)]
    lines = 0 if all(seam.is_open() for seam in seams) else zero_lines(order, said)
    return [
        seam
        for seam in seams
        if seam.is_open() or (lines and seam.takes_zero_line(order, said, lines))
    ]


def turned_to(
    patches: Patches,
    terms: Array,
    points: Sequence[AnchorPatch],
    said: Sequence[ZeroPlace],
    there: AnchorPatch,
    order: float,
    within: float,
) -> Array | None:
    """The terms with what lies beyond an open seam turned over so that a place has a known order.

    Parameters as in `open_seams`; `there`, the place; `order`, what is known of it, to `within`.
    Returns terms (m, n, 6), None where no open seam makes it so.
    """
    now = float(there.basis @ terms[there.patch])
    within = min(within, abs(abs(now) - order))  # nearer than it is
    seams = [
        seam
        for seam in _not_settled(patches, terms, points, said)
        if seam.beyond[there.patch] and abs(abs(seam.crest - now) - order) < within
    ]
    if not seams:
        return None
    seam = min(seams, key=lambda s: s.worse)
    turned = terms.copy()
    turned[seam.beyond] *= -1.0
    turned[seam.beyond, 0] += seam.crest
    return turned


def _seams(
    patches: Patches, terms: Array, points: Sequence[AnchorPatch] | None = None
) -> Iterator[_Seam]:
    """The least costly seam of each region beyond each crest, seen from the points.

    Without points that say a side of the crest, from the largest region.
    """
    order = terms[..., 0].ravel()
    known = np.isfinite(order)
    if not known.any():
        return
    joints = _joints(patches, terms)
    low, high = np.percentile(order[known], [0.1, 99.9])
    for crest in range(int(np.floor(2.0 * low)), int(np.ceil(2.0 * high)) + 1):
        for band in _BANDS:
            yield from _about(joints, terms, crest, band, points)


def _about(
    joints: _Joints, terms: Array, crest: int, band: float, points: Sequence[AnchorPatch] | None
) -> Iterator[_Seam]:
    """The seams about one crest, which keep to the patches in a band of orders about it."""
    shape = terms.shape[:2]
    known = np.isfinite(terms[..., 0]).ravel()
    from_crest = terms[..., 0].ravel() - 0.5 * crest
    far = known & (np.abs(from_crest) >= band)
    if not 0 < np.count_nonzero(far) < np.count_nonzero(known):
        return
    same = far[joints.a] & far[joints.b]
    if points is not None:  # where doubt is enough; what is turned back must be one whole region
        same &= joints.cost < _AGREE
    same &= (from_crest[joints.a] > 0.0) == (from_crest[joints.b] > 0.0)
    whole = _graph(joints.a[same], joints.b[same], np.ones(np.count_nonzero(same)), known.size)
    region = connected_components(whole, directed=False)[1]
    sizes = np.bincount(region[far], minlength=region.max() + 1)
    sides = [p.patch for p in points or () if p.crest != crest]
    here = np.unique([region[np.ravel_multi_index(p, shape)] for p in sides])
    if not sides:
        here = np.array([sizes.argmax()])
    there = np.setdiff1d(np.flatnonzero(sizes >= _SMALLEST), here)
    ends = region[joints.a[~same]], region[joints.b[~same]]
    worse = joints.mirrored(~same, crest)
    for cut in _cuts(ends, worse, here, there, len(sizes)):
        across = cut[ends[0]] != cut[ends[1]]
        if across.any():
            beyond = (cut[region] & known).reshape(shape)
            size = float(np.abs(worse[across]).sum())
            yield _Seam(crest, beyond, float(worse[across].sum()), size)


def _joints(patches: Patches, terms: Array) -> _Joints:
    """The pairs of neighbours of which both are known."""
    known = np.isfinite(terms[..., 0]).ravel()
    parts = []
    for a, b, x, y, variance in neighbours(patches, terms):
        use = known[a] & known[b]
        own = x[use], y[use], variance[use]
        parts.append((a[use], b[use], *own, _cost(*own)))
    return _Joints(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _cost(x: Array, y: Array, variance: Array) -> Array:
    """How badly two patches agree, chi², up to where nothing more is learnt from it."""
    square = (((x - y) / scale_of(x, y, variance)) ** 2).sum(axis=-1)
    return np.asarray(np.minimum(square, SURE_ENOUGH))


def _cuts(
    ends: tuple[Indices, Indices], worse: Array, here: Indices, there: Indices, count: int
) -> Iterator[Mask]:
    """The minimum cut (count,), True beyond it, between the regions `here` and each one there."""
    numbers, at = np.unique(np.concatenate([*ends, here, there]), return_inverse=True)
    a, b, sources, sinks = np.split(at, np.cumsum([len(ends[0]), len(ends[1]), len(here)]))
    root = len(numbers)  # one node more, from which all sources are fed
    room = np.rint(_PER_UNIT * np.maximum(worse, 0.0)).astype(np.int32)
    graph = _graph(
        np.concatenate([a, b, np.full(len(sources), root)]),
        np.concatenate([b, a, sources]),
        np.concatenate([room, room, np.full(len(sources), _ENDLESS, dtype=np.int32)]),
        root + 1,
    )
    for sink in sinks:
        left = graph - maximum_flow(graph, root, int(sink)).flow
        left.eliminate_zeros()
        reached, _ = breadth_first_order(left, root, directed=True)
        beyond = np.zeros(count, dtype=bool)
        beyond[numbers[np.setdiff1d(np.arange(root), reached)]] = True
        yield beyond


def _graph(a: Indices, b: Indices, weight: Array, count: int) -> Any:
    """A square sparse matrix of the edges' weights, those of one pair added up."""
    return coo_matrix((weight, (a, b)), shape=(count, count)).tocsr()
