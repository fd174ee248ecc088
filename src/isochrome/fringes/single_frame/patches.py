"""Local models of the fringe order: a quadratic in each of many overlapping patches.

In a patch the order is N = n + g·x + x·H·x/2, and the dark field's signal s says
c = 1 - 2 s = cos 2 pi N. Fitted by least squares, all patches at once, from a start that the
gradient gives: with c = cos ω·x the means of ∇c ∇cᵀ and of 1 - c² are as ω ωᵀ. A patch knows its
quadratic only up to a sign and a whole number, (n, g, H) ~ ±(n, g, H) + k, which no light can tell.
Pooling over the patch is what reaches below a pixel's noise, and the quadratic what carries over
the fringes' crests, where a pixel knows nothing.

Half-way between two neighbours both predict the order, its gradient and its curvature; the sign and
whole number under which they agree best is their relation, and how much worse the other sign would
be says how far to trust it. A crest where the order turns, or one of no slope, leaves the sign open
along one edge and not along another: the tree of the most trusted edges reaches every patch without
using an open one. The result is one signed field. It passes smoothly through zero, where the order
itself has a crease, so that the order is its absolute value.

On a crest of the light, n = k/2, the light is the same whether the order goes on through it or
turns back: a region beyond it could be k - n in place of n. Only the smoothness of the patches
along the whole of the crest tells. For each crest the regions away from it are taken as they are,
and the seam along which one of them would be turned over at the least cost is a minimum cut through
the patches near the crest; an edge's cost is by how much worse its two patches would agree.
A seam of negative cost is a region turned over by mistake: it is turned back. A seam along which
some edges speak for turning and others against is one that the light does not settle, such as a
flat valley of the order along a crest under noise: what lies beyond it is not known.
Sources: the windowed least squares of Servín, Marroquín & Cuevas (1997), Appl. Opt. 36, 4540; the
steps are `isochrome.estimation.least_squares`; Ghiglia & Pritt (1998), Two-Dimensional Phase
Unwrapping, for trees in place of rows; Boykov, Veksler & Zabih (2001), IEEE TPAMI 23, 1222, for
cuts as moves that lower a cost.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label
from scipy.sparse import block_array, coo_matrix, csr_array
from scipy.sparse.csgraph import (
    breadth_first_order,
    connected_components,
    maximum_flow,
    minimum_spanning_tree,
)
from skimage.segmentation import expand_labels

from isochrome.errors import InputError
from isochrome.estimation import State, minimise_all, sandwich, solve_all, total_degree
from isochrome.fringes.on_branch import SURE
from isochrome.fringes.windows import (
    LARGEST_CHANGE,
    TURN,
    Array,
    Indices,
    Mask,
    block_means,
    gaussian,
    nearest_known,
)

HALF, STRIDE = 6, 5
"""Half-width of a patch and distance of their middles, pixels."""
SIDE = 2 * HALF + 1
_WINDOW = 3.0
_FREQUENCY_WINDOW = 2.5
_GRADIENT, _CURVATURE = 0.7, 0.02
"""Prior standard deviations, fringes/px and fringes/px²; what bends more is no quadratic."""
_FINE, _CLEAR = 1.0, 8.0
"""Radians a pixel from which fringes are fine, and how far they must stand above noise."""
_ROUNDS = 8
WORST_CHI = 1.6
"""Residual over noise from which a quadratic does not describe its patch."""
_FLOOR = 1e-3
_ROUNDING = float(np.finfo(np.float32).eps) * SIDE
"""Of a patch's sums in single precision: what they are not known to, and must not make singular."""
_BALANCE = 0.3
"""Share of a patch's light on crests, and on flanks, from which it tells contrast from order."""
_LIKE = 0.8
"""Share of a patch's light, squared, that must be its cosine."""
FADED, _OWN_CONTRAST = 0.05, (0.15, 1.3)
"""Contrast that is lost from which it moves the order by more than its uncertainty, and what a
patch's own may be."""
BEND = np.array([0.004, 0.001, 4e-4])[[i + j for i, j in total_degree(2)]]
"""What two quadratics differ by half-way without noise: fringes, fringes/px, fringes/px²; and"""
_STEEP_BEND = 0.03
"""the share of their own size."""


@dataclass(frozen=True, kw_only=True)
class Patches:
    """Quadratics of the order about the patches' middles `rows` (m,), `cols` (n,), pixels. `terms`
    (m, n, 6): n, g_x, g_y, H_xx, H_xy, H_yy with x along the columns, and their uncertainties
    `spread`; `chi` (m, n), residual over noise; `filled`, share of valid pixels; `contrast`, what
    the patch says of its fringes', NaN where it spans too little; `body`, the number of that it
    lies on."""

    rows: Indices
    cols: Indices
    terms: Array = field(repr=False)
    spread: Array = field(repr=False)
    chi: Array = field(repr=False)
    filled: Array = field(repr=False)
    contrast: Array = field(repr=False)
    body: Indices = field(repr=False)

    def at_middles(self, image: Array) -> Array:
        """An image (rows, cols) at the patches' middles (m, n)."""
        return image[np.ix_(self.rows, self.cols)]


DY, DX = (v.ravel() for v in np.mgrid[-HALF : HALF + 1, -HALF : HALF + 1])
WINDOW: Array = np.exp(-(DX**2 + DY**2) / (2.0 * _WINDOW**2))
"""Weights (k,) of a patch's pixels, in rows `DY` and columns `DX` about its middle (k,)."""


def basis(dy: Array, dx: Array) -> Array:
    """The quadratic's terms at places about the middle: (..., 6)."""
    return np.stack([np.ones_like(dx), dx, dy, 0.5 * dx * dx, dx * dy, 0.5 * dy * dy], axis=-1)


def binned(wave: Array, sigma: Array, valid: Mask, by: int) -> tuple[Array, Array, Mask]:
    """Means over blocks of by x by pixels; a block is valid where all of it is."""
    if by == 1:
        return wave, sigma, valid
    complete = np.asarray(block_means(valid.astype(float), by) == 1.0)
    mean = block_means(np.where(valid, wave, 0.0), by)
    return mean, np.sqrt(block_means(sigma**2, by)) / by, complete


@dataclass(frozen=True, kw_only=True)
class PatchLight:
    """The light of every patch: `light`, `weight` (p, k), `noise`, `body` (p,), and where they are.
    `gradient` (p, 2), about the order's along x and y, up to its sign, fringes a pixel."""

    rows: Indices
    cols: Indices
    light: Array = field(repr=False)
    weight: Array = field(repr=False)
    noise: Array = field(repr=False)
    gradient: Array = field(repr=False)
    body: Indices = field(repr=False)

    @property
    def filled(self) -> Array:
        """Share of each patch's pixels that are valid (p,)."""
        return np.asarray(np.mean(self.weight > 0.0, axis=1))

    def only(self, which: Indices) -> PatchLight:
        """Some of the patches, in one row."""
        names = "light", "weight", "noise", "gradient", "body"
        parts = {name: getattr(self, name)[which] for name in names}
        return replace(self, rows=self.rows[:1], cols=np.arange(len(which)), **parts)

    def over(self, contrast: Array) -> PatchLight:
        """The patches' light and noise over their contrast (p,)."""
        return replace(self, light=self.light / contrast[:, None], noise=self.noise / contrast)


def gather_patches(wave: Array, sigma: Array, valid: Mask) -> PatchLight:
    """Cut a normalised frame `wave`, cos 2 pi N, into patches; InputError where it is smaller."""
    if min(wave.shape) < SIDE:
        rows, cols = wave.shape
        raise InputError("frame_pixels_smaller_patch", shape=rows, shape_2=cols, half=SIDE)
    rows, cols = middles(wave.shape[0]), middles(wave.shape[1])
    at = tuple(v.ravel()[:, None] for v in np.meshgrid(rows, cols, indexing="ij"))
    pick = at[0] + DY, at[1] + DX
    trusted = np.asarray(valid[pick])
    bodies, count = label(valid)  # what masked pixels keep apart, corner to corner too
    body = np.ones(len(trusted), dtype=int)
    if count > 1:  # a patch is that of the body nearest to its middle
        nearest = np.where(trusted, DX**2 + DY**2, np.inf).argmin(axis=1)
        chosen = bodies[pick]
        body = chosen[np.arange(len(chosen)), nearest]
        trusted &= chosen == body[:, None]
    gradient = [g[at][:, 0] for g in _start_gradient(np.where(valid, wave, 0.0), sigma, valid)]
    return PatchLight(
        rows=rows, cols=cols, light=np.where(trusted, wave[pick], 0.0).astype(np.float32),
        weight=(WINDOW * trusted).astype(np.float32),
        noise=np.maximum(sigma[at][:, 0], _FLOOR).astype(np.float32),
        gradient=np.stack(gradient, axis=-1).astype(np.float32), body=body,
    )  # fmt: skip


def fit_patches(
    patches: PatchLight, expected: tuple[Array, Array] | None = None, contrast: Array | None = None,
    *, deviation: bool = False,
) -> Patches:  # fmt: skip
    """Fit a quadratic of the order to each patch of a frame. `expected`, terms that are known
    beforehand (m, n, 6), NaN where none are, and their standard deviations; `contrast`, the
    fringes' (m, n), 1 if not given. A patch that fits its expectation badly is fitted again
    without; with `deviation` one that tells another contrast is with that."""
    if contrast is None:
        contrast = np.ones((len(patches.rows), len(patches.cols)))
    scale = contrast.ravel().astype(np.float32)
    full = patches.over(scale)
    start = _start(full)
    mean, prior = np.zeros_like(start), np.tile(patch_prior(), (len(start), 1))
    known = np.zeros(len(start), dtype=bool)
    if expected is not None:
        terms, spread = (v.reshape(-1, 6).astype(np.float32) for v in expected)
        known = np.asarray(np.isfinite(terms).all(axis=1))
        mean[known], prior[known] = terms[known], spread[known] ** -2
    fitted = _refine(full, np.where(known[:, None], mean, start), mean, prior)
    _fit_again(fitted, full, known & (fitted.chi.ravel() > WORST_CHI), start, np.ones_like(scale))
    fitted = replace(fitted, contrast=fitted.contrast * contrast)
    measured = fitted.contrast.ravel()
    least, most = _OWN_CONTRAST
    off = (np.abs(measured - scale) > FADED * scale) & (measured > least) & (measured < most)
    if deviation:
        start = fitted.terms.reshape(-1, 6).astype(np.float32)
        _fit_again(fitted, patches, off, start, measured.astype(np.float32))
    return fitted


def _fit_again(
    fitted: Patches, patches: PatchLight, where: Mask, start: Array, contrast: Array
) -> None:
    """Put patches (p,) fitted anew from a `start`, by a contrast alone, in place of worse ones."""
    which = np.flatnonzero(where)
    if not len(which):
        return
    begin, scale = start[which], contrast[which]
    prior = np.tile(patch_prior(), (len(which), 1))
    again = _refine(patches.only(which).over(scale), begin, np.zeros_like(begin), prior)
    again = replace(again, contrast=again.contrast * scale)
    better = again.chi.ravel() < fitted.chi.ravel()[which]
    at = np.unravel_index(which[better], fitted.chi.shape)
    for name in ("terms", "spread", "chi", "contrast"):
        getattr(fitted, name)[at] = getattr(again, name)[0, better]


def middles(length: int) -> Indices:
    """Middles that cover a length from border to border, about a stride apart."""
    count = max(2, -(-(length - SIDE) // STRIDE) + 1)
    return np.unique(np.linspace(HALF, max(length - HALF - 1, HALF), count).round().astype(int))


def _start_gradient(wave: Array, sigma: Array, valid: Mask) -> tuple[Array, Array]:
    """The order's gradient (x, y), up to its sign, fringes a pixel."""
    dx, dy, xx, yy = (gaussian(wave, 1.0, order) for order in ((0, 1), (1, 0), (0, 2), (2, 0)))
    bend = xx + yy

    def pooled(values: Array) -> Array:
        return np.asarray(gaussian(np.where(valid, values, 0.0), _FREQUENCY_WINDOW))

    speed = np.maximum(pooled(1.0 - np.clip(gaussian(wave, 0.7), -1.0, 1.0) ** 2), 0.05)
    noise = pooled(sigma**2) / (8.0 * np.pi)  # what noise adds to a derivative's square
    xx, yy = (pooled(dx * dx) - noise) / speed, (pooled(dy * dy) - noise) / speed
    xy = pooled(dx * dy) / speed
    largest = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
    size = np.minimum(np.sqrt(np.maximum(largest, 0.0)) / TURN, LARGEST_CHANGE)
    # fine fringes fade in the derivative itself, but alike in the second one
    first = np.maximum((xx + yy) * speed, 1e-9)
    frequency = np.sqrt(np.maximum(pooled(bend * bend) - 4.0 * noise, 0.0) / first)
    fine = (frequency > _FINE) & (first > _CLEAR * noise)
    size = np.where(fine, np.minimum(frequency / TURN, LARGEST_CHANGE), size)
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    return size * np.cos(angle), size * np.sin(angle)


_BASIS = basis(DY.astype(np.float32), DX.astype(np.float32))
"""The quadratic's terms at a patch's pixels (k, 6)."""


def patch_prior() -> Array:
    """Inverse variances of a quadratic's terms before anything is known (6,)."""
    return np.array([0.0, *[_GRADIENT**-2] * 2, *[_CURVATURE**-2] * 3], dtype=np.float32)


def _start(patches: PatchLight) -> Array:
    """Phase at the middle for a known gradient: c = A cos ω·x - B sin ω·x, linear in A and B."""
    light, weight, gradient = patches.light, patches.weight, patches.gradient
    angle = TURN * (gradient @ _BASIS[:, 1:3].T)
    cos, sin = np.cos(angle), np.sin(angle)
    cc, cs = (weight * cos * cos).sum(axis=1), (weight * cos * sin).sum(axis=1)
    ss = (weight * sin * sin).sum(axis=1) + 1e-3 * weight.sum(axis=1) + 1e-9
    lc, ls = (weight * light * cos).sum(axis=1), (weight * light * sin).sum(axis=1)
    terms = np.zeros((len(light), 6), dtype=np.float32)
    terms[:, 0] = np.arctan2(lc * cs - ls * cc, lc * ss - ls * cs) / TURN
    terms[:, 1:3] = gradient
    return terms


def _refine(patches: PatchLight, terms: Array, mean: Array, prior: Array) -> Patches:
    """Damped steps of all patches at once, with a normal prior on their terms."""
    light, weight, terms_of = patches.light, patches.weight, _BASIS
    pairs = (terms_of[:, :, None] * terms_of[:, None, :]).reshape(len(terms_of), 36)
    gain = (1.0 / patches.noise**2)[:, None]
    damping = np.full(len(terms), 1e-2, dtype=np.float32)
    diagonal = np.arange(6)

    def at(terms: Array) -> tuple[Array, Array, Array]:
        angle = TURN * (terms @ terms_of.T)
        residual = light - np.cos(angle)
        cost = gain[:, 0] * np.einsum("pk,pk,pk->p", weight, residual, residual)
        return cost + ((terms - mean) ** 2 * prior).sum(axis=1), np.sin(angle), residual

    def equations(terms: Array, now: State) -> tuple[Array, Array]:
        _, sine, residual = now
        slope = -TURN * gain * ((weight * residual * sine) @ terms_of) - (terms - mean) * prior
        return information_of(sine), slope

    def information_of(sine: Array) -> Array:
        matrix = ((weight * sine * sine) @ pairs).reshape(-1, 6, 6) * (TURN**2 * gain)[..., None]
        # a patch that says much of little: in single precision the prior would be lost in it
        matrix = matrix.astype(float)
        matrix[:, diagonal, diagonal] *= 1.0 + _ROUNDING
        matrix[:, diagonal, diagonal] += prior + 1e-3
        return np.asarray(matrix)

    terms, (_, sine, residual), _ = minimise_all(at, equations, terms, damping, steps=_ROUNDS)
    # the window's weights are no variances: those of a weighted sum are the weights' squares
    inverse = solve_all(information_of(sine), np.broadcast_to(np.eye(6), (len(terms), 6, 6)))
    squared = ((weight * sine) ** 2 @ pairs).reshape(-1, 6, 6) * (TURN**2 * gain)[..., None]
    squared[:, diagonal, diagonal] += prior
    covariance = sandwich(inverse, squared.astype(float))
    total = np.maximum(weight.sum(axis=1), 1e-9)
    chi = np.sqrt(np.einsum("pk,pk,pk->p", weight, residual, residual) / total) / patches.noise
    regular = np.asarray(np.isfinite(covariance).all(axis=(1, 2)))  # a singular patch is left out
    spread = np.sqrt(np.abs(np.einsum("pii->pi", covariance)))
    shape = len(patches.rows), len(patches.cols)
    return Patches(
        rows=patches.rows, cols=patches.cols, terms=terms.reshape(*shape, 6).astype(float),
        spread=np.where(regular[:, None], spread, np.inf).reshape(*shape, 6),
        chi=np.where(regular & (patches.filled > 0.0), chi, np.inf).reshape(shape),
        filled=patches.filled.reshape(shape), body=patches.body.reshape(shape),
        contrast=_contrast(weight, light, light - residual).reshape(shape),
    )  # fmt: skip


def _contrast(weight: Array, light: Array, cosine: Array) -> Array:
    """What a patch's light has of its cosine (p,), NaN where it has not both crests and flanks."""
    on_crests = np.maximum((weight * cosine * cosine).sum(axis=1), 1e-9)
    along = (weight * light * cosine).sum(axis=1)
    like = along**2 > _LIKE * on_crests * (weight * light * light).sum(axis=1)
    tells = like & (np.abs(on_crests / np.maximum(weight.sum(axis=1), 1e-9) - 0.5) < 0.5 - _BALANCE)
    return np.where(tells, along / on_crests, np.nan).astype(float)


def neighbours(patches: Patches, terms: Array) -> list[Array]:
    """Patches' numbers (k,), their neighbours' a step on, what both say half-way, and its variance.
    By their own or their labelled `terms` (m, n, 6): both's terms half-way (k, 6), and the variance
    of the difference of these."""
    pairs = []
    m, n = patches.chi.shape
    number = np.arange(m * n).reshape(m, n)
    rows, cols = np.meshgrid(patches.rows, patches.cols, indexing="ij")
    # to the neighbours on the right, below, and on the two diagonals below
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = np.s_[: m - down, max(0, -right) : n - max(right, 0)]
        beside = np.s_[down:, max(0, right) : n + min(right, 0)]
        dy, dx = 0.5 * (rows[beside] - rows[here]), 0.5 * (cols[beside] - cols[here])
        a, b = moved_patch(terms[here], dy, dx), moved_patch(terms[beside], -dy, -dx)
        variance = patches.spread[here] ** 2 + patches.spread[beside] ** 2
        numbers = number[here].ravel(), number[beside].ravel()
        pairs.append((*numbers, *(v.reshape(-1, 6) for v in (a, b, variance))))
    return [np.concatenate(part) for part in zip(*pairs, strict=True)]


def moved_patch(terms: Array, dy: Array, dx: Array) -> Array:
    """A quadratic's terms (..., 6) about a place that is (dy, dx) from its middle."""
    n, gx, gy, hxx, hxy, hyy = np.moveaxis(terms, -1, 0)
    order = n + gx * dx + gy * dy + 0.5 * hxx * dx * dx + hxy * dx * dy + 0.5 * hyy * dy * dy
    slopes = gx + hxx * dx + hxy * dy, gy + hxy * dx + hyy * dy
    return np.stack([order, *slopes, hxx, hxy, hyy], axis=-1)


def scale_of(a: Array, b: Array, variance: Array) -> Array:
    """How far two quadratics of one smooth field may differ, a standard deviation (..., 6)."""
    size = np.hypot(a, b)
    size[..., 0] = size[..., 1:3].max(axis=-1)
    return np.asarray(np.sqrt(variance + BEND**2 + (_STEEP_BEND * size) ** 2))


LEAST_FILLED = 0.6
_GUIDE = 3.0
"""Width of what a binned frame lets the finer one do, in its own uncertainties."""
WORST_EDGE = 12.0
"""Cost of an edge, chi², from which its two patches need not be of one smooth field."""
SMALLEST = 12
"""Patches of the smallest part that is followed, and of the smallest region to be mirrored."""
SURE_ENOUGH = 50.0
"""chi² of an edge beyond which nothing more is learnt from it."""


@dataclass(frozen=True)
class Labels:
    """For each patch (m, n): the field is sign n + shift; `part`, its connected part, -1 for none.
    Within a part all is known but one sign and one whole number for the part."""

    sign: NDArray[np.int8]
    shift: Array
    part: Indices


def label_patches(patches: Patches) -> Labels:
    """Settle signs and whole numbers over a frame; parts are numbered from the largest, 0."""
    shape, count = patches.chi.shape, patches.chi.size
    good = (patches.filled > LEAST_FILLED) & (patches.spread[..., 0] < SURE)
    good = (good & (patches.chi < WORST_CHI)).ravel()
    a, b, here, beside, variance = neighbours(patches, patches.terms)
    scale = scale_of(here, beside, variance)
    costs, numbers = [], []
    for one in (1, -1):  # n_a = sign n_b + shift
        difference = here - one * beside
        nearest = np.round(difference[..., 0])
        difference[..., 0] -= nearest
        costs.append(((difference / scale) ** 2).sum(axis=-1))
        numbers.append(nearest)
    same = costs[0] <= costs[1]
    signs, shifts = np.where(same, 1, -1), np.where(same, *numbers)
    cost, other = np.minimum(*costs), np.maximum(*costs)
    use = good[a] & good[b] & (cost < WORST_EDGE)
    body = patches.body.ravel()
    use &= body[a] == body[b]
    length = 5.0 * cost / (1e-3 + np.minimum(other - cost, SURE_ENOUGH)) + 0.1 * cost + 1e-3
    graph = coo_matrix((length[use], (a[use], b[use])), shape=(count, count))
    tree = minimum_spanning_tree(graph.tocsr())
    tree = tree + tree.T
    _, raw = connected_components(tree, directed=False)
    sizes = np.bincount(raw)
    rank = np.argsort(np.argsort(-sizes, kind="stable"))
    part = np.where(good & (sizes[raw] >= SMALLEST), rank[raw], -1)
    sign, shift = _carried(tree, part, a.astype(np.int64) * count + b, signs, shifts)
    return Labels(sign.reshape(shape), shift.reshape(shape), part.reshape(shape))


def expected_terms(
    patches: Patches, labels: Labels, rows: Array, cols: Array, finer: int
) -> tuple[Array, Array]:
    """What a binned frame's patches say of the quadratics of a finer one, and their deviations.
    `rows` (m,), `cols` (n,), places in the binned frame, pixels, one of which is `finer` of the
    finer frame's. The terms (m, n, 6) have the signs of the nearest patch's part, NaN: no good."""
    near = nearest_patches(patches, rows, cols)
    i, j = near[0].ravel(), near[1].ravel()
    terms = labels.sign[near][..., None] * patches.terms[near]
    terms[..., 0] += labels.shift[near]
    dy, dx = rows - patches.rows[i], cols - patches.cols[j]
    moved = moved_patch(terms, dy[:, None] + 0 * dx, dx[None, :] + 0 * dy[:, None])
    per_pixel = np.array([1, finer, finer, *[finer**2] * 3], dtype=float)
    scale = _GUIDE * np.sqrt(patches.spread[near] ** 2 + BEND**2)
    good = (labels.part[near] >= 0)[..., None]
    return np.where(good, moved, np.nan) / per_pixel, scale / per_pixel


def nearest_patches(patches: Patches, rows: Array, cols: Array) -> tuple[Indices, ...]:
    """Numbers of the patches nearest to places in their pixels, `rows` (m,) by `cols` (n,)."""
    i = np.abs(patches.rows[:, None] - rows).argmin(axis=0)
    j = np.abs(patches.cols[:, None] - cols).argmin(axis=0)
    return np.ix_(i, j)


def _carried(
    tree: Any, part: Indices, key: Indices, signs: Indices, shifts: Array
) -> tuple[NDArray[np.int8], Array]:
    """Carry sign and shift from one patch of each part along the tree, by `key` a count + b."""
    count = len(part)
    numbers, roots = np.unique(part, return_index=True)
    roots = roots[numbers >= 0]
    # one patch more, joined to a patch of each part: one walk then reaches all
    joint = csr_array((np.ones(len(roots)), (np.zeros_like(roots), roots)), shape=(1, count))
    system = block_array([[tree, None], [joint, csr_array((1, 1))]], format="csr")
    _, walk = breadth_first_order(system, count, directed=True)
    # the patch before each on the way from its part's root; itself at a root
    before = np.where((walk[:count] < 0) | (walk[:count] == count), np.arange(count), walk[:count])
    by_key = np.argsort(key)
    inner = np.flatnonzero(before != np.arange(count))
    first, last = np.minimum(before[inner], inner), np.maximum(before[inner], inner)
    place = by_key[np.searchsorted(key[by_key], first * np.int64(count) + last)]
    # n_before = s n + k, or n = s n_before + k: what is carried is field = sign n + shift
    sign, shift = np.ones(count, dtype=np.int8), np.zeros(count)
    sign[inner] = signs[place]
    shift[inner] = np.where(before[inner] < inner, 1, -signs[place]) * shifts[place]
    # each patch leaps to where its leap led before, until all stand at their part's root
    while (before != before[before]).any():
        shift = shift[before] + sign[before] * shift
        sign = sign[before] * sign
        before = before[before]
    return sign, shift


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
    `worse`, the sum over its edges of what mirroring would cost; `size`, that of their sizes."""

    crest: int
    beyond: Mask
    worse: float
    size: float

    def is_open(self, settled: float = _SETTLED) -> bool:
        """Whether the light does not settle on which side the field lies beyond it."""
        return self.worse <= settled * self.size


def mend_mirrored(patches: Patches, labels: Labels) -> Labels:
    """Turn regions back that are mirrored about a crest against what the patches there say."""
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
    """The number of lines of N = 0 of which nothing known says that they are. Each parts a region
    of positive signed `order` (m, n) from one of negative."""
    labels = np.zeros(order.shape, dtype=int)
    for side in (order > NOUGHT, order < -NOUGHT):
        regions_of, _ = label(side)
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
    """Patches whose branch the light does not settle from where the order is known. `terms` (m, n,
    6) of the signed order, NaN = not known; `points`, where it is known; `known`, where lines of N
    = 0 are. For each seam its crest (in half fringes) and the patches beyond it (m, n), each patch
    once. Mirroring about n = 0 changes no order and is left out."""
    order = terms[..., 0]
    unsure = np.zeros(terms.shape[:2], dtype=bool)
    result = []
    seams = not_settled(patches, terms, points, known)
    for seam in sorted(seams, key=lambda s: -int(s.beyond.sum())):
        beyond = seam.beyond & (np.abs(order - 0.5 * seam.crest) > _ALIKE) & ~unsure
        if beyond.any():
            unsure |= beyond
            result.append((seam.crest, beyond))
    return result


def not_settled(
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
    """The least costly seam of each region beyond each crest, seen from the points. Without points
    that say a side of the crest, from the largest region."""
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


_COARSEST = 4
"""Pixels a side of the first bins, which are halved."""
_LEAST_PIXELS = 7 * SIDE // 2
"""Pixels, after binning, of the shorter side of a frame: three patches and a half without overlap.
"""
_FINEST = 0.2
"""Fringes a bin beyond which a bin says nothing of the light's contrast."""


def contrast_of(terms: Array, blur: float, band: float = 0.0) -> Array:
    """Contrast left of fringes of `terms` (..., 6): exp(-2 pi² (blur |∇N|² + band N²)). `blur`, its
    variance, pixels²; `band`, variance of the wavenumber over its mean squared."""
    lost = blur * np.hypot(terms[..., 1], terms[..., 2]) ** 2 + band * terms[..., 0] ** 2
    return np.asarray(np.exp(-0.5 * TURN**2 * lost))


def coarse_to_fine(
    wave: Array, sigma: Array, valid: Mask, *, faded: bool = False
) -> tuple[Patches, Labels]:
    """Patches and labels, each binning guiding the next finer one. A small patch on a crest of wide
    fringes cannot tell on which side of it it lies; one four times as wide can. Where fringes are
    too fine for it, binned patches fit badly and guide nothing."""
    expected: tuple[Array, Array] | None = None
    told: Array | None = None
    halved = (_COARSEST >> k for k in range(_COARSEST.bit_length()))
    binnings = [b for b in halved if b == 1 or min(wave.shape) // b >= _LEAST_PIXELS]
    for k, binning in enumerate(binnings):
        frame = binned(wave, sigma, valid, binning)
        contrast = None
        if told is not None and faded and (tells := np.isfinite(told)).any():
            contrast = nearest_known(told, tells)
        patches = fit_patches(gather_patches(*frame), expected, contrast, deviation=faded)
        measured = patches.contrast
        if binning > 1:  # a bin's own blur is taken out
            slope = np.hypot(patches.terms[..., 1], patches.terms[..., 2])
            blurred = contrast_of(patches.terms, (1.0 - binning**-2.0) / 12.0)
            measured = np.where(slope < _FINEST, measured / blurred, np.nan)
        patches = replace(
            patches, contrast=measured if told is None else np.where(measured > 0.0, measured, told)
        )  # where a patch tells none, that of wider ones
        labels = mend_mirrored(patches, label_patches(patches))
        if k + 1 < len(binnings):
            ratio = binning // binnings[k + 1]
            finer = [n // binnings[k + 1] for n in wave.shape]
            rows, cols = ((middles(n) - 0.5 * (ratio - 1)) / ratio for n in finer)
            expected = expected_terms(patches, labels, rows, cols, ratio)
            told = patches.contrast[nearest_patches(patches, rows, cols)]
    return patches, labels
