"""Camera noise from a single frame, however many fringes it shows.

A product of fourth differences along rows and columns leaves nothing of a smooth picture: a
fringe of g fringes per pixel passes with the factor (2 - 2 cos 2 pi g_x)^2 (2 - 2 cos 2 pi g_y)^2
/ 70 of its amplitude, 2e-5 for 0.1 fringe per pixel along a diagonal, while white noise keeps its
standard deviation.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from isochrome.errors import InputError
from isochrome.messages import message

FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
QUANTISATION = 1 / 12
"""Variance of rounding to whole grey levels."""
LEVELS = 16
CLIP = 4.0
"""Residuals beyond this many standard deviations are defects or edges, not noise."""
_SQUARE, _DEGREE, _STEP = 13, 4, 9
"""Side of a square, pixels, degree of its polynomial, and pixels from square to square."""
_FEWEST_SQUARES = 30
_DECILE = 1.2816
"""Standard deviations below its mean of a normal distribution's lower decile."""


@dataclass(frozen=True)
class NoiseModel:
    """Noise of a camera against grey level: variance = offset + slope level, floor at least.

    In raw grey levels squared (of float frames: fractions of full scale squared), with the rounding
    to whole levels.
    """

    offset: float  # at black
    slope: float
    floor: float

    def sigma(self, values: npt.ArrayLike) -> np.ndarray:
        """Standard deviation (raw grey levels) at raw grey levels `values`, of the same shape.

        In single precision where they are.
        """
        levels = np.asarray(values)
        if levels.dtype != np.float32:
            levels = levels.astype(float)
        variance = float(self.offset) + float(self.slope) * levels
        return np.sqrt(np.maximum(variance, float(self.floor)))

    def linear_sigma(
        self, values: npt.ArrayLike, *, bit_depth: int | None, gamma: float = 1.0
    ) -> np.ndarray:
        """Standard deviation of the linear image, as a fraction of full scale.

        sigma_lin = gamma * (raw / full)^(gamma - 1) * sigma(raw) / full. Near black the raw level
        is taken as one sigma at least, where the first order ends.
        """
        full = full_scale(bit_depth)
        sigma = self.sigma(values)
        level = np.maximum(np.asarray(values, dtype=float), sigma) / full
        return np.asarray(gamma * level ** (gamma - 1) * sigma / full)


def full_scale(bit_depth: int | None) -> float:
    """The largest raw grey level, 2^bit_depth - 1; 1 for float frames without a bit depth."""
    return 1.0 if bit_depth is None else float(2**bit_depth - 1)


def estimate_noise(
    image: np.ndarray, valid: npt.NDArray[np.bool_] | None = None, *, bit_depth: int | None = None
) -> NoiseModel:
    """Estimate a camera's noise from one raw frame, before any gamma, insensitive to its fringes.

    Noise that is correlated between pixels (JPEG, lossy video, demosaicing) is underestimated; see
    `noise_between_pixels`. By the bit depth levels near black and white, where clipping hides
    noise, are left out. InputError where it is under 8 x 8 or has too few valid pixels.
    """
    from scipy import ndimage

    image = np.asarray(image)
    if image.ndim != 2 or min(image.shape) < 8:
        raise InputError(message("noise_needs_frame_least", shape=image.shape))
    integer = image.dtype.kind in "ui"
    if bit_depth is None and integer:
        bit_depth = 8 * image.dtype.itemsize
    finite = np.isfinite(image)
    usable = finite if valid is None else finite & valid
    values = np.where(finite, image, 0).astype(np.float32)
    residual = ndimage.correlate1d(ndimage.correlate1d(values, FOURTH, axis=0), FOURTH, axis=1)
    residual /= np.float32(np.sum(FOURTH**2))
    level = ndimage.uniform_filter(values, 5)
    inside = usable.copy()  # where the 5 x 5 support is valid
    inside[:2] = inside[-2:] = inside[:, :2] = inside[:, -2:] = False
    if not usable.all():
        inside &= ndimage.minimum_filter(usable, 5)
    if np.count_nonzero(inside) < 16:
        raise InputError(message("noise_cannot_estimated_fewer"))
    floor = QUANTISATION if integer else float(np.finfo(np.float32).tiny)
    res, lev = residual[inside].astype(float), level[inside].astype(float)
    rough = np.sqrt(max(_clipped_variance(res)[0], floor))
    inner = (lev > 4 * rough) & (lev < full_scale(bit_depth) - 4 * rough)
    if np.count_nonzero(inner) > max(200, 0.02 * inner.size):
        res, lev = res[inner], lev[inner]
    offset, slope = _fit_levels(res, lev)
    return NoiseModel(offset=offset, slope=slope, floor=floor)


def _clipped_variance(residual: np.ndarray) -> tuple[float, int]:
    """Variance without outliers, about zero, and the number of residuals that were kept."""
    size = np.abs(residual)
    sigma = 1.4826 * float(np.median(size))
    if sigma == 0:  # a mostly flat, rounded frame: the median tells nothing
        sigma = float(np.sqrt(np.mean(size**2)))
    variance, count = sigma**2, size.size
    for _ in range(3):
        inner = size[size <= CLIP * np.sqrt(variance)]
        if inner.size == 0:
            return 0.0, size.size
        variance, count = float(np.mean(inner**2)), inner.size
    return variance, count


def _fit_levels(residual: np.ndarray, level: np.ndarray) -> tuple[float, float]:
    """Fit variance = offset + slope * level to bins of equal population, by their uncertainty."""
    bins = min(LEVELS, residual.size // 500)
    edges = np.unique(np.quantile(level, np.linspace(0, 1, max(bins, 1) + 1)))
    if len(edges) < 3:
        return _clipped_variance(residual)[0], 0.0
    index = np.clip(np.searchsorted(edges, level, side="right") - 1, 0, len(edges) - 2)
    rows = []
    for i in range(len(edges) - 1):
        chosen = index == i
        variance, count = _clipped_variance(residual[chosen])
        rows.append((float(level[chosen].mean()), variance, count))
    x, y, n = np.array(rows).T
    if not y.any():  # a computed frame: no noise at all
        return 0.0, 0.0
    weight, slope, offset = np.sqrt(n) / y.mean(), 0.0, y.mean()
    for _ in range(5):
        slope, offset = np.polyfit(x, y, 1, w=weight)
        fitted = np.maximum(offset + slope * x, 0.05 * y.mean() + 1e-300)
        # A bin with an edge or a scratch in it stands above the line: let it count less.
        excess = np.abs(y - fitted) / fitted * np.sqrt(n / 8)
        weight = np.sqrt(n) / fitted / np.maximum(1, excess / 3)
    return float(offset), float(slope)


def noise_between_pixels(
    image: np.ndarray, valid: npt.NDArray[np.bool_], model: NoiseModel
) -> float:
    """The factor on a frame's standard deviation of noise over what neighbouring pixels show of it.

    A lossy file drops the fine part of the noise and keeps the coarse one: it is in the residual e
    of polynomials of degree 4 in squares of 13 pixels, n = 169, wherever the light is that smooth.
    max(1, q / q_white), q the lower decile of (sum e² / (n - 15))^(1/2) / sigma, and q_white = 1 -
    1.28 (2 (n - 15))^(-1/2), white noise's; 1 where too little of the frame is whole.
    """
    if min(image.shape) < _SQUARE:
        return 1.0
    fits = _polynomials(_SQUARE, _DEGREE)
    squares = np.lib.stride_tricks.sliding_window_view(image, (_SQUARE, _SQUARE))[::_STEP, ::_STEP]
    windows = np.lib.stride_tricks.sliding_window_view(valid, (_SQUARE, _SQUARE))[::_STEP, ::_STEP]
    light = squares[windows.all(axis=(2, 3))].reshape(-1, _SQUARE**2).astype(float)
    if len(light) < _FEWEST_SQUARES:
        return 1.0
    level = light.mean(axis=1)
    light -= level[:, None]
    residual = np.maximum((light**2).sum(axis=1) - ((light @ fits) ** 2).sum(axis=1), 0.0)
    freedom = fits.shape[0] - fits.shape[1]
    share = np.sqrt(residual / freedom) / model.sigma(level)
    white = 1.0 - _DECILE * (2.0 * freedom) ** -0.5
    return max(1.0, float(np.percentile(share, 10.0) / white))


def _polynomials(side: int, degree: int) -> np.ndarray:
    """Orthonormal polynomials of two places in a square: (pixels, terms)."""
    powers = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, side), degree)
    terms = [
        np.outer(powers[:, i], powers[:, j]).ravel()
        for i in range(degree + 1)
        for j in range(degree + 1 - i)
    ]
    return np.asarray(np.linalg.qr(np.stack(terms, axis=1))[0])
