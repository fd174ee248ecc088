"""The model of a frame's light, how uneven it is, and what more unknowns of it would gain.

I = A s + C with the polariscope's signal s, A = sum_k a_k B_k and C = sum_k c_k C_k: what no-load
frames show times a slow change, or polynomials of the place.

Score tests: at a fit the weighted residual r is normal to the fitted unknowns' derivatives A.
Others with derivatives D would lower r·r, to first order, by S = gᵀ M⁻¹ g, g = D⊥ᵀ r, M = D⊥ᵀ D⊥,
D⊥ the part of D that A cannot take up, and would come out at M⁻¹ g. Without them S/σ² is χ² of as
many degrees of freedom as D has columns. Source: Rao (1948), Proc. Camb. Phil. Soc. 44, 50-57.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import combinations_with_replacement, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from isochrome.estimation.covariance import Array, Mask

Degrees = tuple[Array, Array]

Terms = tuple[tuple[int, int], ...]
"""Products P_i(y) P_j(x) of Legendre's polynomials, each as (i, j)."""

FIRST_DEGREES = 6, 4
"""Degrees of illumination and background that every light is asked for."""

RICHEST = 24, 8
"""Degrees of illumination and background of an uneven light: its prior says how much of each."""

_LIGHT_SIZE, LIGHT_FALLS = 0.05, (0.5, 0.7, 0.9)
"""Standard deviation of the light's first degree, of its brightness, and what each degree more
leaves of it: a lamp's, one that is near, one with an edge."""


_AT_ONCE = 262_144
"""Pixels of images that are made at once: a megabyte stays in the processor's cache."""


class Unevenness(NamedTuple):
    """How uneven a light is by its prior, a Gaussian process with less and less of each degree:
    the `brightness` that `light_sizes` are shares of, what each degree more leaves, its `fall`, and
    the `degrees` of illumination and background that it goes to.
    """

    brightness: float
    fall: float
    degrees: tuple[int, int] = RICHEST


@dataclass(frozen=True)
class LightModel:
    """What a frame's light is a sum of: with `terms` of both, products of Legendre's P, A = a(y, x)
    sum_k a_k P_i(y) P_j(x), C = c_0 d(y, x) + sum_k c_k P_i(y) P_j(x). The `first` ones may have
    any size; where it is `uneven`, others follow with a prior. `down` (2 n + 1, rows) and `across`
    (2 n + 1, cols) are P_0 to P_2n, for the highest degree n; `dark` and `bright` (rows, cols)
    no-load frames: d is the dark one, a the bright one less that.
    """

    first: tuple[Terms, Terms]
    down: Array
    across: Array
    dark: Array | None = None
    bright: Array | None = None
    uneven: Unevenness | None = None

    @cached_property
    def terms(self) -> tuple[Terms, Terms]:
        """All products of illumination and background."""
        return _all_terms(self.first, self.uneven)

    @cached_property
    def weights(self) -> Array:
        """1/u^2 (k,) of the coefficients, nought of those that may have any size."""
        if self.uneven is None:
            return np.zeros(self.unknowns)
        split, (light, dark) = len(self.terms[0]), map(len, self.first)
        sizes = self.uneven.brightness * np.array(light_sizes(self.terms, self.uneven.fall))
        if self.shade is not None:
            sizes[:split] /= self.shade.mean()
        weights = sizes**-2.0
        weights[:light] = weights[split : split + dark] = 0.0
        return weights if self.dark is None else np.insert(weights, split, 0.0)

    @property
    def unknowns(self) -> int:
        """Number of coefficients."""
        return sum(map(len, self.terms)) + (self.dark is not None)

    @property
    def degree(self) -> int:
        """The highest degree n of a row's or a column's polynomial."""
        return len(self.down) // 2

    def plain(self) -> LightModel:
        """One amplitude for all the illumination: for a search, or a model that is poor."""
        return replace(self, first=(self.first[0][:1], self.first[1]), uneven=None)

    def of(self, uneven: Unevenness | None) -> LightModel:
        """The light of a whole frame, as uneven, or as even, as given."""
        shape = self.down.shape[1], self.across.shape[1]
        return frame_light(shape, self.dark, self.bright, terms=self.first, uneven=uneven)

    def every(self, stride: int) -> LightModel:
        """The light of every `stride`-th pixel."""
        return self.on(slice(None, None, stride), slice(None, None, stride))

    def on(self, rows: slice | Array, cols: slice | Array) -> LightModel:
        """The light of some rows and columns."""
        dark, bright = (
            image if image is None else image[rows][:, cols] for image in (self.dark, self.bright)
        )
        down, across = self.down[:, rows], self.across[:, cols]
        return LightModel(self.first, down, across, dark, bright, self.uneven)

    @cached_property
    def shade(self) -> Array | None:
        """What no-load frames show of the illumination (rows, cols), float32."""
        if self.bright is None:
            return None
        return np.asarray(self.bright if self.dark is None else self.bright - self.dark, np.float32)

    def illumination(self, coefficients: Array, dtype: DTypeLike = np.float32) -> Array:
        """A (..., rows, cols) of coefficients (..., k)."""
        image = self._sum(self.terms[0], coefficients, dtype)
        return image if self.shade is None else image * self.shade

    def background(self, coefficients: Array, dtype: DTypeLike = np.float32) -> Array:
        """C (..., rows, cols) of coefficients (..., k)."""
        if self.dark is None:
            return self._sum(self.terms[1], coefficients, dtype)
        dark = np.multiply(coefficients[..., :1, None], self.dark, dtype=dtype)
        return dark + self._sum(self.terms[1], coefficients[..., 1:], dtype)

    def _sum(self, terms: Terms, coefficients: Array, dtype: DTypeLike) -> Array:
        """The sum of some products (..., rows, cols), row by row and then across."""
        count = self.degree + 1
        table = np.zeros((*coefficients.shape[:-1], count, count))
        table[(..., *_degrees(terms))] = coefficients
        along = (table @ self.across[:count]).astype(dtype)
        return np.asarray(self.down[:count].T.astype(dtype) @ along)

    def columns(self, keep: Mask) -> tuple[Array, Array]:
        """The images that A and C are sums of, (k, n) each, at a few pixels that are kept."""
        row, col = np.nonzero(keep)
        (i, j), (l, m) = map(_degrees, self.terms)
        light = self.down[i][:, row] * self.across[j][:, col]
        below = self.down[l][:, row] * self.across[m][:, col]
        if self.shade is not None:
            light = light * self.shade[keep]
        return light, below if self.dark is None else np.concatenate((self.dark[None, keep], below))


@dataclass(frozen=True)
class PixelLight:
    """The light of a frame at the pixels (n,) that are kept (rows, cols), by its moments: as P_i
    P_j = sum_l c_ijl P_l, sums over pixels of v times two products of P follow from those of v
    P_a(y) P_b(x), and a hundred products cost little more than six.
    """

    model: LightModel
    keep: Mask

    @property
    def split(self) -> int:
        """How many coefficients are the illumination's, which come first."""
        return len(self.model.terms[0])

    @cached_property
    def _used(self) -> tuple[LightModel, Mask]:
        """The light of the rows and columns that hold pixels, and where in these the pixels are."""
        rows, cols = np.asarray(self.keep.any(axis=1)), np.asarray(self.keep.any(axis=0))
        return self.model.on(rows, cols), self.keep[rows][:, cols]

    def _images(self, values: Array) -> Array:
        """Values (k, n) at their places (k, rows, cols), nought elsewhere."""
        _, keep = self._used
        images = np.zeros((len(values), *keep.shape), values.dtype)
        for image, row in zip(images, values, strict=True):
            image[keep] = row
        return images

    def _moments(self, images: Array, *, twice: bool = False) -> Array:
        """Sums of images (..., rows, cols) times P_a(y) P_b(x), up to degree n, or twice that."""
        light, _ = self._used
        count = None if twice else light.degree + 1
        down = light.down[:count].astype(images.dtype)
        return np.asarray((down @ images).astype(float) @ light.across[:count].T)

    def _parts(self, lit: Array, weight: Array) -> list[tuple[Array, Terms]]:
        """What products stand behind (rows, cols), and these: of A, and of C."""
        light, _ = self._used
        parts = [(lit if light.shade is None else lit * light.shade, light.terms[0])]
        if light.dark is not None:
            parts.append((weight * light.dark.astype(weight.dtype, copy=False), ((0, 0),)))
        return [*parts, (weight, light.terms[1])]

    def _with(self, parts: list[tuple[Array, Terms]], images: Array) -> Array:
        """Products (j, k) of images (j, rows, cols) with the columns."""
        sums = [self._moments(images * part)[(..., *_degrees(terms))] for part, terms in parts]
        return np.concatenate(sums, axis=-1)

    def equations(self, lit: Array, weight: Array, data: Array) -> tuple[Array, Array]:
        """The normal equations of weighted `data` (n,): products (k, k) of the columns, of A times
        `lit` (n,) and of C times `weight` (n,), and (k,) of these with the data.
        """
        *both, image = self._images(np.array([lit, weight, data]))
        parts, degree = self._parts(*both), self._used[0].degree
        table, normal = _products(degree), np.empty((self.model.unknowns,) * 2)
        ends = np.cumsum([0, *(len(terms) for _, terms in parts)]).tolist()
        places = [slice(*pair) for pair in pairwise(ends)]
        for p, q in combinations_with_replacement(range(len(parts)), 2):
            (one, terms), (other, others) = parts[p], parts[q]
            sums = table @ self._moments(one * other, twice=True) @ table.T
            block = sums[_pairs(terms, others)]
            normal[places[p], places[q]], normal[places[q], places[p]] = block, block.T
        return normal, self._with(parts, image[None])[0]

    def products(self, rows: Array, lit: Array, weight: Array) -> Array:
        """Products (j, k) of rows (j, n) with the columns: A times `lit`, C times `weight` (n,)."""
        return self._with(self._parts(*self._images(np.array([lit, weight]))), self._images(rows))

    def of(self, coefficients: Array, dtype: DTypeLike = np.float32) -> tuple[Array, Array]:
        """A and C (n,) of coefficients (k,)."""
        light, keep = self._used
        a, c = np.split(coefficients, [self.split])
        return light.illumination(a, dtype)[keep], light.background(c, dtype)[keep]

    def take_off(self, rows: Array, lit: Array, weight: Array, inverse: Array) -> None:
        """Take off what the columns explain of rows (j, n), with their `inverse` equations."""
        light, keep = self._used
        lit, weight = self._images(np.array([lit, weight]))
        parts = self._parts(lit, weight)
        at_once = max(1, _AT_ONCE // keep.size)
        for some in (rows[k : k + at_once] for k in range(0, len(rows), at_once)):
            a, c = np.split(self._with(parts, self._images(some)) @ inverse, [self.split], axis=-1)
            explained = light.illumination(a) * lit
            explained += light.background(c) * weight
            for row, image in zip(some, explained, strict=True):
                row -= image[keep]


@lru_cache(maxsize=64)
def _degrees(terms: Terms) -> Degrees:
    """The i, and the j, of some products."""
    i, j = np.array(terms, int).reshape(-1, 2).T
    return i, j


@lru_cache(maxsize=64)
def _pairs(terms: Terms, others: Terms) -> Degrees:
    """Where the products (k, l) of each two stand in the table of `_products`, down and across."""
    pairs = []
    for one, other in zip(_degrees(terms), _degrees(others), strict=True):
        high, low = np.maximum(one[:, None], other), np.minimum(one[:, None], other)
        pairs.append(high * (high + 1) // 2 + low)
    return pairs[0], pairs[1]


@lru_cache(maxsize=4)
def _products(degree: int) -> Array:
    """c (k, 2 n + 1) of P_i P_j = sum_l c_ijl P_l, for j <= i up to a degree n, by their integrals
    with P_l, which Gauss's 2 n + 1 nodes give exactly.
    """
    nodes, weights = np.polynomial.legendre.leggauss(2 * degree + 1)
    every = np.polynomial.legendre.legvander(nodes, 2 * degree)
    high, low = np.tril_indices(degree + 1)
    both = every[:, high] * every[:, low]
    return np.asarray((both.T * weights) @ every * (np.arange(2 * degree + 1) + 0.5))


def frame_light(
    shape: tuple[int, int],
    dark: Array | None = None,
    bright: Array | None = None,
    *,
    terms: tuple[Terms, Terms] | None = None,
    uneven: Unevenness | None = None,
) -> LightModel:
    """The light of a frame that is fitted with a scene: of no-load frames the difference times a
    plane, and the dark one plus a constant; polynomials of `terms`, by default of the lowest
    degrees, stand for what is missing.
    """
    if terms is None:
        # lamps fall off to the corners, and what a room adds is the same all over
        lamp, room = 2 if bright is None else 1, 1 if bright is not None and dark is None else 0
        terms = total_degree(lamp), total_degree(room)
    degree = max(degree for part in _all_terms(terms, uneven) for pair in part for degree in pair)
    ends = (np.linspace(-1.0, 1.0, n) if n > 1 else np.zeros(1) for n in shape)
    down, across = (np.polynomial.legendre.legvander(end, 2 * degree).T for end in ends)
    return LightModel(terms, down, across, dark, bright, uneven)


def _all_terms(first: tuple[Terms, Terms], uneven: Unevenness | None) -> tuple[Terms, Terms]:
    """Some products, and behind them all others of an uneven light."""
    if uneven is None:
        return first
    light, dark = (
        (*terms, *(term for term in total_degree(degree) if term not in terms))
        for terms, degree in zip(first, uneven.degrees, strict=True)
    )
    return light, dark


def total_degree(degree: int) -> Terms:
    """The products P_i(y) P_j(x), as (i, j), with i + j up to a degree, the constant first."""
    return tuple((t - j, j) for t in range(degree + 1) for j in range(t + 1))


def light_sizes(terms: tuple[Terms, Terms], fall: float) -> list[float]:
    """Standard deviations of some light's products, of its brightness."""
    return [_LIGHT_SIZE * fall ** (i + j - 1) for part in terms for i, j in part]


@lru_cache(maxsize=8)
def light_basis(shape: tuple[int, int], terms: Terms) -> Array:
    """Legendre products (k, rows, cols) of a frame's light, float32, kept and read-only."""
    basis = frame_light(shape, terms=(terms, terms)).illumination(np.eye(len(terms)))
    basis.flags.writeable = False
    return basis


def channel_light(rows: int, cols: int) -> Array:
    """A colour channel's light (6, rows, cols): 1, y, x, y², x², xy, from -1 to 1."""
    y = (2.0 * np.arange(rows) + 1.0)[:, None] / rows - 1.0
    x = (2.0 * np.arange(cols) + 1.0)[None, :] / cols - 1.0
    y, x = np.broadcast_arrays(y, x)
    return np.stack([np.ones(y.shape), y, x, y * y, x * x, x * y])


TAKEN = 1e-6
"""Part of a column's square that must be left by what is fitted."""


class ScoreProducts:
    """Products of columns with each other and the residual, what is fitted taken off. Of parts
    (local, fitted, columns, residual) of the data, all over the noise: derivatives (q, n) by what
    is fitted to this part alone, such as a frame's light, (p, n) by what is fitted to all, (k, n)
    by what is not, and the residual (n,). p and k are the same in all parts.
    """

    def __init__(self, parts: Iterable[tuple[Array, Array, Array, Array]]) -> None:
        gram, size, count, fitted, shared = np.zeros((1, 1)), np.zeros(1), 0, 0, 0
        for local, rows, columns, residual in parts:
            every = local, rows, columns, residual[None]
            stacked = np.concatenate(every, dtype=np.float32, casting="same_kind")
            products = (stacked @ stacked.T).astype(float)
            shared = len(rows)
            size = size + np.diag(products)[len(local) + shared : -1]
            gram = gram + _taken_off(products, len(local))
            count, fitted = count + stacked.shape[1], fitted + len(local)
        self.size = size
        self.taken_up = _explained(gram, shared)[:, :-1]
        reduced = _taken_off(gram, shared)
        self.count = count
        self.matrix, self.right, square = reduced[:-1, :-1], reduced[:-1, -1], reduced[-1, -1]
        self.noise = max(1.0, float(square) / max(1, count - fitted - shared))


def _taken_off(gram: Array, fitted: int) -> Array:
    """Products (k, k) of columns, less what the `fitted` first ones of (fitted + k) explain."""
    return np.asarray(gram[fitted:, fitted:] - gram[:fitted, fitted:].T @ _explained(gram, fitted))


def _explained(gram: Array, fitted: int) -> Array:
    """What the `fitted` first columns of (fitted + k) come out at for each of the others."""
    taken, cross = gram[:fitted, :fitted], gram[:fitted, fitted:]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(taken), 1e-300))
    inverse = np.linalg.pinv(taken * np.outer(scale, scale), 1e-10, hermitian=True)
    return np.asarray((inverse * np.outer(scale, scale)) @ cross)
