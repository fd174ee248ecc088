"""Local models of the fringe order: a quadratic in each of many overlapping patches.

In a patch the order is N = n + g·x + x·H·x/2, and the dark field's signal s says
c = 1 - 2 s = cos 2 pi N. Fitted by least squares, all patches at once, from a start that the
gradient gives: with c = cos ω·x the means of ∇c ∇cᵀ and of 1 - c² are as ω ωᵀ. A patch knows its
quadratic only up to a sign and a whole number, (n, g, H) ~ ±(n, g, H) + k, which no light can tell;
`label_patches` settles that between neighbours. Pooling over the patch is what reaches below a
pixel's noise, and the quadratic what carries over the fringes' crests, where a pixel knows nothing.
Sources: the windowed least squares of Servín, Marroquín & Cuevas (1997), Appl. Opt. 36, 4540; the
steps are `isochrome.estimation.least_squares`.

Signs and whole numbers of the patches' orders, settled between neighbours.

Each patch's quadratic stands for ±(n, g, H) + k. Half-way between two neighbours both predict the
order, its gradient and its curvature; the sign and whole number under which they agree best is
their relation, and how much worse the other sign would be says how far to trust it. A crest where
the order turns, or one of no slope, leaves the sign open along one edge and not along another: the
tree of the most trusted edges reaches every patch without using an open one (Ghiglia & Pritt 1998,
Two-Dimensional Phase Unwrapping, for trees in place of rows).

The result is one signed field. It passes smoothly through zero, where the order itself has a
crease, so that the order is its absolute value.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label
from scipy.sparse import block_array, coo_matrix, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

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
    """Quadratics of the order about the patches' middles `rows` (m,), `cols` (n,), pixels.

    `terms` (m, n, 6): n, g_x, g_y, H_xx, H_xy, H_yy with x along the columns, and their
    uncertainties `spread`; `chi` (m, n), residual over noise; `filled`, share of valid pixels;
    `contrast`, what the patch says of its fringes', NaN where it spans too little; `body`, the
    number of that it lies on.
    """

    rows: Indices
    cols: Indices
    terms: Array = field(repr=False)
    spread: Array = field(repr=False)
    chi: Array = field(repr=False)
    filled: Array = field(repr=False)
    contrast: Array = field(repr=False)
    body: Indices = field(repr=False)


def offsets() -> tuple[Indices, Indices, Array]:
    """Rows and columns of a patch's pixels about its middle (k,), and their weights (k,)."""
    dy, dx = (v.ravel() for v in np.mgrid[-HALF : HALF + 1, -HALF : HALF + 1])
    return dy, dx, np.exp(-(dx**2 + dy**2) / (2.0 * _WINDOW**2))


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

    `gradient` (p, 2), about the order's along x and y, up to its sign, fringes a pixel.
    """

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
    """Cut a normalised frame into patches.

    Parameters: `wave` c = cos 2 pi N (rows, cols); `sigma`, its noise (rows, cols); `valid`, True =
    trusted. Returns a PatchLight that covers the frame from border to border. Raises InputError
    where the frame is smaller than a patch.
    """
    if min(wave.shape) < SIDE:
        rows, cols = wave.shape
        raise InputError("frame_pixels_smaller_patch", shape=rows, shape_2=cols, half=SIDE)
    dy, dx, window = offsets()
    rows, cols = middles(wave.shape[0]), middles(wave.shape[1])
    at = tuple(v.ravel()[:, None] for v in np.meshgrid(rows, cols, indexing="ij"))
    pick = at[0] + dy, at[1] + dx
    trusted = np.asarray(valid[pick])
    bodies, count = label(valid)  # what masked pixels keep apart, corner to corner too
    body = np.ones(len(trusted), dtype=int)
    if count > 1:  # a patch is that of the body nearest to its middle
        nearest = np.where(trusted, dx**2 + dy**2, np.inf).argmin(axis=1)
        chosen = bodies[pick]
        body = chosen[np.arange(len(chosen)), nearest]
        trusted &= chosen == body[:, None]
    gradient = [g[at][:, 0] for g in _start_gradient(np.where(valid, wave, 0.0), sigma, valid)]
    return PatchLight(
        rows=rows, cols=cols, light=np.where(trusted, wave[pick], 0.0).astype(np.float32),
        weight=(window * trusted).astype(np.float32),
        noise=np.maximum(sigma[at][:, 0], _FLOOR).astype(np.float32),
        gradient=np.stack(gradient, axis=-1).astype(np.float32), body=body,
    )  # fmt: skip


def fit_patches(
    patches: PatchLight,
    expected: tuple[Array, Array] | None = None,
    contrast: Array | None = None,
    *,
    deviation: bool = False,
) -> Patches:
    """Fit a quadratic of the order to each patch of a frame.

    Parameters: `patches`; `expected`, terms that are known beforehand (m, n, 6), NaN where none
    are, and their standard deviations; `contrast`, the fringes' (m, n), 1 if not given. A patch
    that fits its expectation badly is fitted again without; with `deviation` one that tells another
    contrast is fitted with that. Returns Patches.
    """
    if contrast is None:
        contrast = np.ones((len(patches.rows), len(patches.cols)))
    scale = contrast.ravel().astype(np.float32)
    fitted = _fit_given(patches.over(scale), expected)
    fitted = replace(fitted, contrast=fitted.contrast * contrast)
    measured = fitted.contrast.ravel()
    least, most = _OWN_CONTRAST
    off = np.flatnonzero(
        (np.abs(measured - scale) > FADED * scale) & (measured > least) & (measured < most)
    )
    if deviation and len(off):
        scale = measured[off].astype(np.float32)
        start = fitted.terms.reshape(-1, 6)[off].astype(np.float32)
        prior = np.tile(patch_prior(), (len(off), 1))
        again = _refine(patches.only(off).over(scale), start, np.zeros_like(start), prior)
        again = replace(again, contrast=again.contrast * scale)
        _take(fitted, off, again, again.chi.ravel() < fitted.chi.ravel()[off])
    return fitted


def _fit_given(patches: PatchLight, expected: tuple[Array, Array] | None) -> Patches:
    """The patches as if their fringes had all their contrast."""
    start = _start(patches)
    mean, prior = np.zeros_like(start), np.tile(patch_prior(), (len(start), 1))
    if expected is None:
        return _refine(patches, start, mean, prior)
    terms, spread = (v.reshape(-1, 6).astype(np.float32) for v in expected)
    known = np.asarray(np.isfinite(terms).all(axis=1))
    mean[known], prior[known] = terms[known], spread[known] ** -2
    guided = _refine(patches, np.where(known[:, None], mean, start), mean, prior)
    bad = np.flatnonzero(known & (guided.chi.ravel() > WORST_CHI))
    if len(bad):
        alone = np.tile(patch_prior(), (len(bad), 1))
        free = _refine(patches.only(bad), start[bad], np.zeros_like(start[bad]), alone)
        _take(guided, bad, free, free.chi.ravel() < guided.chi.ravel()[bad])
    return guided


def _take(patches: Patches, which: Indices, others: Patches, better: Mask) -> None:
    """Put others (1, k) in the place of some patches (k,) where they are better."""
    at = np.unravel_index(which[better], patches.chi.shape)
    for name in ("terms", "spread", "chi", "contrast"):
        getattr(patches, name)[at] = getattr(others, name)[0, better]


def middles(length: int) -> Indices:
    """Middles that cover a length from border to border, about a stride apart."""
    count = max(2, -(-(length - SIDE) // STRIDE) + 1)
    return np.unique(np.linspace(HALF, max(length - HALF - 1, HALF), count).round().astype(int))


def _start_gradient(wave: Array, sigma: Array, valid: Mask) -> tuple[Array, Array]:
    """The order's gradient (x, y), up to its sign, fringes a pixel."""
    dx, dy, xx, yy = (gaussian(wave, 1.0, order) for order in ((0, 1), (1, 0), (0, 2), (2, 0)))
    bend = xx + yy
    smooth = np.clip(gaussian(wave, 0.7), -1.0, 1.0)

    def pooled(values: Array) -> Array:
        return np.asarray(gaussian(np.where(valid, values, 0.0), _FREQUENCY_WINDOW))

    speed = np.maximum(pooled(1.0 - smooth**2), 0.05)
    noise = pooled(sigma**2) / (8.0 * np.pi)  # what noise adds to a derivative's square
    xx, yy = (pooled(dx * dx) - noise) / speed, (pooled(dy * dy) - noise) / speed
    xy = pooled(dx * dy) / speed
    largest = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
    size = np.minimum(np.sqrt(np.maximum(largest, 0.0)) / TURN, LARGEST_CHANGE)
    # fine fringes fade in the derivative itself, but alike in the second one
    first = np.maximum((xx + yy) * speed, 1e-9)
    second = pooled(bend * bend) - 4.0 * noise
    frequency = np.sqrt(np.maximum(second, 0.0) / first)
    fine = (frequency > _FINE) & (first > _CLEAR * noise)
    size = np.where(fine, np.minimum(frequency / TURN, LARGEST_CHANGE), size)
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    return size * np.cos(angle), size * np.sin(angle)


def patch_basis() -> Array:
    """The quadratic's terms at a patch's pixels (k, 6)."""
    dy, dx, _ = offsets()
    return basis(dy.astype(np.float32), dx.astype(np.float32))


def patch_prior() -> Array:
    """Inverse variances of a quadratic's terms before anything is known (6,)."""
    return np.array([0.0, *[_GRADIENT**-2] * 2, *[_CURVATURE**-2] * 3], dtype=np.float32)


def _start(patches: PatchLight) -> Array:
    """Phase at the middle for a known gradient: c = A cos ω·x - B sin ω·x, linear in A and B."""
    light, weight, gradient = patches.light, patches.weight, patches.gradient
    angle = TURN * (gradient @ patch_basis()[:, 1:3].T)
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
    light, weight, terms_of = patches.light, patches.weight, patch_basis()
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
        matrix = information_of(sine)
        slope = -TURN * gain * ((weight * residual * sine) @ terms_of) - (terms - mean) * prior
        return matrix, slope

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
    share = on_crests / np.maximum(weight.sum(axis=1), 1e-9)
    along = (weight * light * cosine).sum(axis=1)
    like = along**2 > _LIKE * on_crests * (weight * light * light).sum(axis=1)
    tells = like & (np.abs(share - 0.5) < 0.5 - _BALANCE)
    return np.where(tells, along / on_crests, np.nan).astype(float)


def neighbours(patches: Patches, terms: Array) -> list[Array]:
    """Patches and their neighbours a step on, and what both say of the order half-way.

    Parameters: `patches`; `terms` (m, n, 6), theirs or their labelled ones. Returns of all steps
    the patches' numbers (k,), their neighbours', both's terms half-way (k, 6), and the variance of
    the difference of these (k, 6).
    """
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

    Within a part all is known but one sign and one whole number for the part.
    """

    sign: NDArray[np.int8]
    shift: Array
    part: Indices


def label_patches(patches: Patches) -> Labels:
    """Settle signs and whole numbers over a frame.

    Parameters: `patches`. Returns Labels; parts are numbered from the largest, 0.
    """
    shape, count = patches.chi.shape, patches.chi.size
    good = (patches.filled > LEAST_FILLED) & (patches.spread[..., 0] < SURE)
    good = (good & (patches.chi < WORST_CHI)).ravel()
    a, b, *half_way = neighbours(patches, patches.terms)
    signs, shifts, cost, other = _relation(*half_way)
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
    signs, shift = np.where(same, 1, -1), np.where(same, shifts[0], shifts[1])
    return signs, shift, np.minimum(*costs), np.maximum(*costs)


def _carried(
    tree: Any, part: Indices, key: Indices, signs: Indices, shifts: Array
) -> tuple[NDArray[np.int8], Array]:
    """Carry sign and shift from one patch of each part along the tree to the others.

    Those of a patch a against its neighbour b by their `key`, a times the patches' count and b.
    """
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
    forward = before[inner] < inner
    shift[inner] = np.where(forward, 1, -signs[place]) * shifts[place]
    # each patch leaps to where its leap led before, until all stand at their part's root
    while (before != before[before]).any():
        shift = shift[before] + sign[before] * shift
        sign = sign[before] * sign
        before = before[before]
    return sign, shift
