"""Smooth images that the light of a frame is a sum of, where no model says what is seen in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from isochrome.estimation import total_degree
from isochrome.fringes.skeleton import line_points, noise_gain
from isochrome.fringes.windows import Array, Indices, Mask

_DEGREE = 2
"""Of the products: lamps fall off to the corners."""
QUADRATICS = len(total_degree(_DEGREE))
"""How many products there are, which come first."""


@dataclass(frozen=True)
class SmoothImages:
    """Images f_k(row) g_k(col) over a frame, and how large each may be beforehand.

    Their factors `down` (rows, a) and `across` (cols, b); `pairs` (terms, 2): which of them each
    image is the product of, no two the same; `spread` (terms,): prior deviation of its coefficient,
    over the contrast, inf for the even light.
    """

    down: Array
    across: Array
    pairs: Indices
    spread: Array

    @property
    def images(self) -> Array:
        """All of them (rows, cols, terms)."""
        row, col = self.pairs.T
        return np.asarray(self.down[:, None, row] * self.across[None, :, col])

    def first(self, count: int) -> SmoothImages:
        """The first `count` of them."""
        pairs = self.pairs[:count]
        a, b = pairs.max(axis=0) + 1
        return SmoothImages(self.down[:, :a], self.across[:, :b], pairs, self.spread[:count])

    def sum(self, coefficients: Array) -> Array:
        """Their sum with some coefficients (terms,): (rows, cols)."""
        table = np.zeros((self.down.shape[1], self.across.shape[1]))
        table[tuple(self.pairs.T)] = coefficients
        return np.asarray(self.down @ table @ self.across.T)

    def along(self, image: Array) -> Array:
        """Sum of each one times an image (rows, cols) over the frame: (terms,)."""
        return np.asarray((self.down.T @ image @ self.across)[tuple(self.pairs.T)])

    def products(self, other: SmoothImages, weight: Array) -> Array:
        """Sums of each one times each of the others, weighted, over the frame: (terms, others).

        Parameters: `other` images; `weight` (rows, cols).
        """
        down, across = (
            (one[:, :, None] * two[:, None, :]).reshape(len(one), -1)
            for one, two in ((self.down, other.down), (self.across, other.across))
        )
        sizes = (self.down.shape[1], other.down.shape[1], self.across.shape[1], -1)
        (i, j), (k, l) = self.pairs.T[..., None], other.pairs.T[:, None, :]
        return np.asarray((down.T @ weight @ across).reshape(sizes)[i, k, j, l])


_SPOT_SIZE = 0.4
"""Correlation length of spots and bars, in half the frame's side."""
_BEYOND = 1.3
"""Ends of the cosines, in half the frame's side: they are level there, and the light is not."""
_FAINTEST = 0.02
"""Share of the largest deviation below which a cosine is left out."""


def binned_light(
    shape: tuple[int, ...], by: int, *, uneven: float = 0.1, spots: float = 0.0
) -> SmoothImages:
    """What the light of a frame that is read without a model is a sum of, at its binned pixels.

    Products of powers of the place, -1 to 1 over the frame of `shape`, up to the second, `uneven`
    their prior deviation over the contrast; with `spots` the cosines besides of a Gaussian process
    of covariance exp(-d²/2l²), each's variance by its spectral density (Solin & Sarkka (2020),
    Stat. Comput. 30, 419).
    """
    y, x = (2.0 * (by * np.arange(n // by) + 0.5 * (by - 1)) / max(n - 1, 1) - 1.0 for n in shape)
    pairs = [*total_degree(_DEGREE)]
    spread = [np.inf, *[uneven] * (len(pairs) - 1)]
    waves = _waves() if spots else []
    total = np.sqrt(sum(size**2 for _, _, size in waves))
    for i, j, size in waves:  # the cosines stand behind the powers, the first of which is 1
        pairs.append((_DEGREE + i if i else 0, _DEGREE + j if j else 0))
        spread.append(spots * size / total)
    most = max((max(i, j) for i, j, _ in waves), default=0)
    unit = 0.5 * np.pi / _BEYOND
    cosines = (
        [np.sqrt(2.0) * np.cos(i * (unit * v + 0.5 * np.pi)) for i in range(1, most + 1)]
        for v in (y, x)
    )
    down, across = (
        np.stack([v**i for i in range(_DEGREE + 1)] + more, -1)
        for v, more in zip((y, x), cosines, strict=True)
    )
    return SmoothImages(down, across, np.array(pairs), np.array(spread))


def _waves() -> list[tuple[int, int, float]]:
    """Half-waves down and across, and the root of the process' spectral density at each."""
    unit, result = 0.5 * np.pi / _BEYOND, []
    for i, j in np.ndindex(32, 32):
        size = float(np.exp(-0.25 * unit**2 * (i * i + j * j) * _SPOT_SIZE**2))
        if size > _FAINTEST and i + j:
            result.append((i, j, size))
    return result


_ABOVE, _ENOUGH, _ROUNDS = 0.01, 400.0, 12
"""Of the first surface: weight of light below it over light above, and how many pixels' worth the
light counts; rounds of either."""
_LINE_PX, _CLEAR = 3.0, 0.5
"""Width of a bright line that is looked for, and its least curvature over that of noise."""
_STRAY = 0.02
"""Prior deviation of the dark end's quadratics, over the contrast."""
_SPOTS = 0.1
"""Prior deviation of spots and bars, over the contrast, where the frame asks for them."""
_SMOOTH_PX = 8
"""Over which the ends' uncertainty is taken as linear."""
_NEAR, _LENGTH_PX = 0.02, 6.0
"""A surface is asked to pass the crests within a share of the contrast, which is told anew after
some pixels of a line."""


def surface_above(
    light: Array, valid: Mask, shapes: Array, spread: Array, contrast: float
) -> Array:
    """Terms of a smooth surface that rests on the light from above: asymmetric least squares.

    Parameters: `light`, `valid` (rows, cols); as in `surface_through` the others.
    """
    gain = _ENOUGH / (np.count_nonzero(valid) * (0.05 * contrast) ** 2)
    return _reweighted(
        shapes[valid], light[valid], spread, lambda away: gain * np.where(away > 0.0, 1.0, _ABOVE)
    )


def bright_lines(light: Array, sigma: Array, valid: Mask) -> Array:
    """The light (rows, cols) on lines that are brighter than either side; NaN elsewhere.

    Parameters: `light`, its noise `sigma`, `valid` (rows, cols).
    """
    strength, _, _, level = line_points(np.where(valid, light, np.nan), _LINE_PX)
    return np.where(-strength > _CLEAR * noise_gain(_LINE_PX) * sigma, level, np.nan)


def surface_through(crests: Array, shapes: Array, spread: Array, contrast: float) -> Array:
    """Terms of the bright end that lies on bright lines, as if each of them were a crest.

    Iteratively reweighted: what lies far below the surface is no crest (Cauchy's weights).
    Parameters: `crests`, light on lines (rows, cols), NaN elsewhere; `shapes` (rows, cols, terms);
    `spread`, the terms' prior deviations (terms,), inf for none; `contrast`. Returns the terms.
    """
    on_line = np.isfinite(crests)
    near = _NEAR * contrast

    def weights(away: Array) -> Array:
        below = np.maximum(-away, 0.0) / near
        return np.asarray(1.0 / (1.0 + (0.5 * below) ** 2) / (_LENGTH_PX * near**2))

    return _reweighted(shapes[on_line], crests[on_line], spread, weights)


def _reweighted(
    rows: Array, values: Array, spread: Array, weights: Callable[[Array], Array]
) -> Array:
    """Terms of a sum of `rows` (n, terms), by `weights` of what they leave of some values (n,)."""
    weight = weights(np.zeros(len(values)))
    for _ in range(_ROUNDS):
        weighted = rows * weight[:, None]
        normal = weighted.T @ rows + np.diag(spread**-2.0)
        terms = np.linalg.solve(normal, weighted.T @ values)
        weight = weights(values - rows @ terms)
    return np.asarray(terms)


def shapes_of_ends(shape: tuple[int, ...], by: int) -> tuple[SmoothImages, SmoothImages]:
    """What the dark and the bright end are sums of: stray light is nearly even, a lamp is not.

    Parameters: `shape`, rows and columns of the whole frame; `by`, pixels a bin.
    """
    return binned_light(shape, by, uneven=_STRAY), binned_light(shape, by, spots=_SPOTS)


def variance_of_ends(
    shape: tuple[int, ...], given: tuple[bool, bool], cut: int, covariance: Array
) -> Array:
    """Covariance of the dark end, the bright end and the exponent at each pixel: it is smooth.

    Parameters: `shape`, rows and columns; which ends are `given`, by one term each; `cut`, terms of
    the dark end; the unknowns' `covariance`. Returns (3, 3, rows, cols).
    """
    import cv2

    by = max(1, min(_SMOOTH_PX, *(n // 4 for n in shape)))
    spread, turn = np.linalg.eigh(covariance)
    root = (turn * np.sqrt(np.maximum(spread, 0.0)))[:, spread > 0.0]
    images = [smooth.images for smooth in shapes_of_ends(shape, by)]
    errors = [
        np.zeros((*image.shape[:2], root.shape[1])) if known else image @ part
        for image, part, known in zip(images, (root[:cut], root[cut:-1]), given, strict=True)
    ]
    errors.append(np.broadcast_to(root[-1], errors[0].shape))
    coarse = np.einsum("iyxk,jyxk->ijyx", errors, errors)
    size = shape[::-1]
    return np.array(
        [[cv2.resize(each, size, interpolation=cv2.INTER_LINEAR) for each in row] for row in coarse]
    )


def spots_beyond_prior(covariance: Array, terms: Array, precision: Array, spots: Mask) -> float:
    """How much stronger squared the spots are that were found than they were taken for, 1 at least.

    Equation: t² = Σ (c/σ)² / γ, γ = Σ (1 - var c/σ²) the number of them that the frame tells.
    Source: MacKay (1992), Neural Computation 4, 415.
    Parameters: `covariance` (n, n) with the priors' `precision` 1/σ² (n,); the `terms` found (n,);
    which of them are `spots`.
    """
    informed = np.sum(1.0 - np.diag(covariance)[spots] * precision[spots])
    return float(max(1.0, np.sum(precision[spots] * terms[spots] ** 2) / max(informed, 1.0)))


def as_spotted(covariance: Array, precision: Array, spots: Mask, larger: float) -> Array:
    """A covariance of the light's terms, the spots as large beforehand as those that were found.

    Where no crest lies the light is as uncertain as its prior, and a lamp whose spots are three
    times as strong in view is not smoother out of view.
    Parameters: `covariance` (n, n) with the priors' `precision` 1/σ² (n,); which of them are
    `spots`; what their prior variance is `larger` by. Returns the covariance with that prior.
    """
    if not larger > 1.0:
        return covariance
    less = np.where(spots, precision * (1.0 - 1.0 / larger), 0.0)
    return np.asarray(np.linalg.inv(np.linalg.inv(covariance) - np.diag(less)))
