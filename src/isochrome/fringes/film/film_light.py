r"""The light of a film that begins without load: what its own frames show of it.

A frame's light is I = Z + A sin² pi N, or Z - A sin² pi N in the bright field. The unloaded first
frame is Z. A, the illumination, shows at crests: what a pixel reaches at most as fringes pass over
it lies on one smooth surface, and below it where none passed (`BrightestLight`). Orders that are
followed with that first surface say where crests are to a few thousandths of a fringe, and those
crests together the polynomial that is used in the end (`CrestLight`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from isochrome.errors import InputError
from isochrome.estimation import light_basis, total_degree
from isochrome.fringes.windows import Array, Mask, block_means, valid_means

_DEGREES = (2, 4)
"""Of the illumination: a lamp falls off to the corners; the second where the crests ask for it."""
_ASKED_FOR = 0.8
"""Variance of the crests about the second surface over that about the first, from which it is."""
_STRIDE = 2
_BELOW, _ABOVE = 0.03, 0.05
"""How far a crest lies from the surface, over the light: noise, and a crest between two frames."""
_ROUNDS, _FIRST, _MOSTLY = 30, 60.0, 97.0
_NEAR = 0.08
"""Fringes from a crest up to which a pixel tells the illumination: its order need not be exact."""
_FEWEST = 500
_POOLED = 40.0
"""Pixels whose orders are found together, so that their errors are one."""
_SQUARE, _EVEN = 8, 1.5
"""Pixels a side of the blocks by which unloaded light is judged, and how much their means may
scatter over what noise alone makes them."""
_SYSTEMATIC = 0.002
"""Least standard uncertainty of the illumination, over it: bins, frames between crests."""
NO_CREST = (
    "no crest passes over enough of the specimen to tell the illumination: give "
    "frames.no_load_bright, or a film whose orders pass 1/2"
)


@dataclass(frozen=True, kw_only=True)
class FilmLight:
    """The light (rows, cols) of a film."""

    zero: Array = field(repr=False)  # of the unloaded specimen, Z
    illumination: Array = field(repr=False)  # A
    error: Array = field(repr=False)  # standard uncertainty of A, over A
    zero_error: Array = field(repr=False)  # standard uncertainty of Z, over A
    sign: float = 1.0  # 1 in the dark field, -1 in the bright one

    def rise(self, light: Array) -> Array:
        """What fringes add to or take off the unloaded light, A sin² pi N (rows, cols)."""
        return np.asarray(np.float32(self.sign) * (light - self.zero))

    def signal_error(self, light: Array) -> Array:
        """Standard uncertainty of the signal by that of the light's ends (rows, cols)."""
        signal = np.clip(self.rise(light) / self.illumination, 0.0, 1.0)
        return np.asarray(np.hypot(signal * self.error, (1.0 - signal) * self.zero_error))


def smooth_zero(light: Array, valid: Mask) -> tuple[Array, bool]:
    """The unloaded light, float32, without noise where it is as smooth as a polynomial.

    The second is whether it is the frame itself, with its noise.
    """
    basis = light_basis(light.shape, total_degree(_DEGREES[1]))
    thin = slice(None, None, _STRIDE)
    terms = basis[:, thin, thin][:, valid[thin, thin]].astype(float)
    coefficients = np.linalg.lstsq(terms.T, light[thin, thin][valid[thin, thin]], rcond=None)[0]
    smooth = np.tensordot(coefficients.astype(np.float32), basis, 1)
    residual = np.where(valid, light - smooth, 0.0)
    noise = float(np.sqrt(np.mean(np.square(residual[valid]))))
    blocks = valid_means(residual, valid, _SQUARE)[block_means(valid.astype(float), _SQUARE) > 0.99]
    even = blocks.size > 0 and np.sqrt(np.mean(blocks**2)) < _EVEN * noise / _SQUARE
    return (smooth, False) if even else (light.astype(np.float32), True)


class BrightestLight:
    """The highest light that each pixel of a film goes over, gathered frame by frame."""

    def __init__(self) -> None:
        self._before: list[Array] = []
        self._top: Array | None = None
        self._lowest: Array | None = None
        self._highest: Array | None = None

    @property
    def lowest(self) -> Array:
        """The lowest rise of each pixel (rows, cols)."""
        assert self._lowest is not None
        return self._lowest

    def contrast(self, valid: Mask) -> float:
        """The range of the light over most of the valid pixels (rows, cols)."""
        assert self._highest is not None
        reach = (self._highest - self.lowest)[valid]
        return float(np.percentile(reach, _MOSTLY)) if reach.size else 0.0

    def add(self, rise: Array) -> None:
        """Take a frame's rise over the unloaded light (rows, cols)."""
        import cv2

        smooth = cv2.GaussianBlur(rise, (0, 0), 1.0)
        if self._top is None or self._lowest is None:
            self._top, self._lowest = np.zeros_like(smooth), smooth
        self._lowest = np.minimum(self._lowest, smooth)
        self._highest = smooth if self._highest is None else np.maximum(self._highest, smooth)
        if len(self._before) == 2:
            earlier, middle = self._before
            passed = (middle >= earlier) & (middle >= smooth)
            self._top = np.maximum(self._top, np.where(passed, middle, 0.0))
        self._before = [*self._before[-1:], smooth]

    def surface(self, valid: Mask) -> Array:
        """The illumination that the crests lie on (rows, cols). Raises InputError without any."""
        if self._top is None:
            raise InputError(NO_CREST)
        basis = light_basis(self._top.shape, total_degree(_DEGREES[0]))
        thin = slice(None, None, _STRIDE)
        use = valid[thin, thin]
        brightest, terms = self._top[thin, thin][use], basis[:, thin, thin][:, use]
        if brightest.size < 100 or not brightest.max() > 0.0:
            raise InputError(NO_CREST)
        weight = (brightest >= np.percentile(brightest, _FIRST)).astype(np.float32)
        coefficients = np.zeros(len(terms))
        for _ in range(_ROUNDS):
            matrix = (terms * weight) @ terms.T + 1e-6 * weight.sum() * np.eye(len(terms))
            coefficients = np.linalg.solve(matrix.astype(float), (terms * weight) @ brightest)
            level = coefficients.astype(np.float32) @ terms
            away = (brightest - level) / np.median(level)
            weight = np.exp(-((np.minimum(away, 0.0) / _BELOW) ** 2))
            weight = np.where(away > _ABOVE, 0.3, weight).astype(np.float32)
        surface = np.tensordot(coefficients.astype(np.float32), basis, 1)
        if not surface[valid].min() > 0.2 * np.median(surface[valid]):
            raise InputError(NO_CREST)
        return np.asarray(surface)


class CrestLight:
    """The illumination by the followed orders of a film, gathered frame by frame."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._basis = light_basis(shape, total_degree(_DEGREES[1]))
        count = len(self._basis)
        self._matrix, self._right = np.zeros((count, count)), np.zeros(count)
        self._square, self._count = 0.0, 0

    def add(self, rise: Array, order: Array, contrast: Array, known: Mask) -> None:
        """Take the crests of a frame.

        Parameters: `rise` over the unloaded light; `order`, followed; `contrast` that a pixel's
        size leaves; `known`, where to look; all (rows, cols).
        """
        thin = slice(None, None, _STRIDE)
        near = np.abs(np.mod(order[thin, thin], 1.0) - 0.5) < _NEAR
        use = near & known[thin, thin]
        orders = order[thin, thin][use]
        signal = 0.5 - 0.5 * contrast[thin, thin][use] * np.cos(np.float32(2.0 * np.pi) * orders)
        risen = rise[thin, thin][use]
        terms = self._basis[:, thin, thin][:, use] * signal
        self._matrix += terms @ terms.T
        self._right += terms @ risen
        self._square += float(np.sum(risen.astype(float) ** 2))
        self._count += risen.size

    @property
    def told(self) -> bool:
        """Whether enough crests were passed."""
        return self._count >= _FEWEST

    def illumination(self, shape: tuple[int, int]) -> tuple[Array, Array]:
        """The illumination, and its standard uncertainty over it, on pixels of any size.

        Parameters: `shape` (rows, cols). Raises InputError where too few crests were passed.
        """
        if not self.told:
            raise InputError(NO_CREST)
        fits = [self._fit(degree) for degree in _DEGREES]
        chosen = int(fits[1][2] < _ASKED_FOR * fits[0][2])
        coefficients, inverse, variance = fits[chosen]
        basis = light_basis(shape, total_degree(_DEGREES[chosen]))
        level = np.tensordot(coefficients.astype(np.float32), basis, 1)
        root = np.linalg.cholesky(inverse * variance * _POOLED / _STRIDE**2)
        spread = np.sqrt(
            sum(np.tensordot(part.astype(np.float32), basis, 1) ** 2 for part in root.T)
        )
        level = np.maximum(level, 1e-3)
        return level, np.asarray(np.hypot(spread / level, _SYSTEMATIC))

    def _fit(self, degree: int) -> tuple[Array, Array, float]:
        """Coefficients of a degree, the inverse of their matrix, and the variance about it."""
        terms = total_degree(_DEGREES[1])
        columns = [terms.index(term) for term in total_degree(degree)]
        matrix = self._matrix[np.ix_(columns, columns)]
        inverse = np.linalg.inv(
            matrix + 1e-6 * np.trace(matrix) / len(columns) * np.eye(len(columns))
        )
        coefficients = inverse @ self._right[columns]
        residual = (
            self._square
            - 2.0 * coefficients @ self._right[columns]
            + coefficients @ matrix @ coefficients
        )
        return coefficients, inverse, max(float(residual) / self._count, 1e-12)
