r"""Signs and whole numbers of the patches' orders, settled between neighbours.

Each patch's quadratic stands for ±(n, g, H) + k. Half-way between two neighbours both predict the
order, its gradient and its curvature; the sign and whole number under which they agree best is
their relation, and how much worse the other sign would be says how far to trust it. A crest where
the order turns, or one of no slope, leaves the sign open along one edge and not along another: the
tree of the most trusted edges reaches every patch without using an open one (Ghiglia & Pritt 1998,
Two-Dimensional Phase Unwrapping, for trees in place of rows).

The result is one signed field. It passes smoothly through zero, where the order itself has a
crease, so that the order is its absolute value.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_array, coo_matrix, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from isochrome.fringes.single_frame.patches import (
    BEND,
    WORST_CHI,
    Patches,
    moved_patch,
    neighbours,
    scale_of,
)
from isochrome.fringes.windows import Array, Indices

_LEAST_FILLED, _LEAST_SURE = 0.6, 0.05
_GUIDE = 3.0
"""Width of what a binned frame lets the finer one do, in its own uncertainties."""
_WORST_EDGE = 12.0
_SMALLEST = 12
"""Patches of the smallest part that is followed."""
SURE_ENOUGH = 50.0
"""chi² of an edge beyond which nothing more is learnt from it."""


@dataclass(frozen=True)
class Labels:
    """For each patch (m, n): the field is sign n + shift; `part`, its connected part, -1 for none.

    Within a part all is known but one sign and one whole number for the part.
    """

    sign: NDArray[np.int8]
    shift: Array
    part: Indices


@dataclass(frozen=True)
class _Edges:
    """Pairs of patches: n_a = sign n_b + shift; `cost` of that, `other` of the other sign."""

    a: Indices
    b: Indices
    sign: Indices
    shift: Array
    cost: Array
    other: Array


def label_patches(patches: Patches) -> Labels:
    """Settle signs and whole numbers over a frame.

    Parameters: `patches`. Returns Labels; parts are numbered from the largest, 0.
    """
    shape = patches.chi.shape
    count = patches.chi.size
    good = (
        (patches.chi < WORST_CHI)
        & (patches.filled > _LEAST_FILLED)
        & (patches.spread[..., 0] < _LEAST_SURE)
    ).ravel()
    edges = _edges(patches)
    use = good[edges.a] & good[edges.b] & (edges.cost < _WORST_EDGE)
    body = patches.body.ravel()
    use &= body[edges.a] == body[edges.b]
    sure = np.minimum(edges.other - edges.cost, SURE_ENOUGH)
    length = 5.0 * edges.cost / (1e-3 + sure) + 0.1 * edges.cost + 1e-3
    graph = coo_matrix((length[use], (edges.a[use], edges.b[use])), shape=(count, count))
    tree = minimum_spanning_tree(graph.tocsr())
    tree = tree + tree.T
    _, raw = connected_components(tree, directed=False)
    sizes = np.bincount(raw)
    rank = np.argsort(np.argsort(-sizes, kind="stable"))
    part = np.where(good & (sizes[raw] >= _SMALLEST), rank[raw], -1)
    sign, shift = _carried(tree, part, edges)
    return Labels(sign.reshape(shape), shift.reshape(shape), part.reshape(shape))


def _edges(patches: Patches) -> _Edges:
    """The relations of each patch with its neighbours to the right, below, and on the diagonals."""
    parts = [
        (a, b, *_relation(x, y, variance))
        for a, b, x, y, variance in neighbours(patches, patches.terms)
    ]
    return _Edges(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def expected_terms(
    patches: Patches, labels: Labels, rows: Array, cols: Array, finer: int
) -> tuple[Array, Array]:
    """What a binned frame's patches say of the quadratics of a finer one.

    Parameters: `patches`, `labels` of the binned frame; `rows` (m,), `cols` (n,), places in it
    where terms are wanted, pixels; `finer`, how many pixels of the finer frame make one of its.
    Returns the terms in the finer frame's pixels (m, n, 6), in the signs of the nearest patch's
    part, NaN where that is no good, and their standard deviations.
    """
    near = nearest_patches(patches, rows, cols)
    i, j = near[0].ravel(), near[1].ravel()
    terms = labels.sign[near][..., None] * patches.terms[near]
    terms[..., 0] += labels.shift[near]
    dy, dx = rows - patches.rows[i], cols - patches.cols[j]
    there = moved_patch(terms, dy[:, None] + 0 * dx, dx[None, :] + 0 * dy[:, None])
    per_pixel = np.array([1, finer, finer, *[finer**2] * 3], dtype=float)
    scale = _GUIDE * np.sqrt(patches.spread[near] ** 2 + BEND**2)
    good = (labels.part[near] >= 0)[..., None]
    return np.where(good, there, np.nan) / per_pixel, scale / per_pixel


def nearest_patches(patches: Patches, rows: Array, cols: Array) -> tuple[Indices, ...]:
    """Numbers of the patches nearest to places in their pixels, `rows` (m,) by `cols` (n,)."""
    i = np.abs(patches.rows[:, None] - rows).argmin(axis=0)
    j = np.abs(patches.cols[:, None] - cols).argmin(axis=0)
    return np.ix_(i, j)


def _relation(a: Array, b: Array, variance: Array) -> tuple[Indices, Array, Array, Array]:
    """Sign and shift of n_a = sign n_b + shift, their cost, and the cost of the other sign."""
    scale = scale_of(a, b, variance)
    costs, shifts = [], []
    for sign in (1, -1):
        difference = a - sign * b
        shift = np.round(difference[..., 0])
        difference[..., 0] -= shift
        costs.append(((difference / scale) ** 2).sum(axis=-1))
        shifts.append(shift)
    same = costs[0] <= costs[1]
    return (
        np.where(same, 1, -1),
        np.where(same, shifts[0], shifts[1]),
        np.minimum(*costs),
        np.maximum(*costs),
    )


def _carried(tree: Any, part: Indices, edges: _Edges) -> tuple[NDArray[np.int8], Array]:
    """Carry sign and shift from one patch of each part along the tree to the others."""
    before = _before(tree, part)
    count = len(part)
    key = edges.a.astype(np.int64) * count + edges.b
    by_key = np.argsort(key)
    inner = np.flatnonzero(before != np.arange(count))
    first, last = np.minimum(before[inner], inner), np.maximum(before[inner], inner)
    place = by_key[np.searchsorted(key[by_key], first * np.int64(count) + last)]
    # n_before = s n + k, or n = s n_before + k: what is carried is field = sign n + shift
    sign, shift = np.ones(count, dtype=np.int8), np.zeros(count)
    sign[inner] = edges.sign[place]
    forward = before[inner] < inner
    shift[inner] = np.where(forward, 1, -edges.sign[place]) * edges.shift[place]
    # each patch leaps to where its leap led before, until all stand at their part's root
    while (before != before[before]).any():
        shift = shift[before] + sign[before] * shift
        sign = sign[before] * sign
        before = before[before]
    return sign, shift


def _before(tree: Any, part: Indices) -> Indices:
    """The patch before each on the way from its part's root along the tree; itself at a root."""
    count = len(part)
    numbers, roots = np.unique(part, return_index=True)
    roots = roots[numbers >= 0]
    # one patch more, joined to a patch of each part: one walk then reaches all
    joint = csr_array((np.ones(len(roots)), (np.zeros_like(roots), roots)), shape=(1, count))
    whole = block_array([[tree, None], [joint, csr_array((1, 1))]], format="csr")
    _, result = breadth_first_order(whole, count, directed=True)
    own = np.arange(count)
    return np.where((result[:count] < 0) | (result[:count] == count), own, result[:count])
