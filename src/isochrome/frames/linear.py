"""From raw grey levels to light and the fringe signal; a camera's noise; where a frame is clipped.

A frame of a polariscope is I = D + (B - D) s: D, the background (the unloaded specimen in the dark
field), B, the full illumination (the same in the bright field), and s, the fringe signal,
sin^2(pi N) in the dark field and cos^2(pi N) in the bright one, N the fringe order.

Noise, from one frame: a product of fourth differences along rows and columns leaves nothing of a
smooth picture. A fringe of g fringes per pixel passes with the factor (2 - 2 cos 2 pi g_x)^2 (2 -
2 cos 2 pi g_y)^2 / 70 of its amplitude, 2e-5 for 0.1 fringe per pixel along a diagonal, while white
noise keeps its standard deviation.

A sensor that clips gives one level to all the light beyond it: more pixels share the top level than
the histogram just below goes on to; or patches without a hole, which no camera's noise leaves. The
brightest pixels of a frame that ends at its top level by chance are few, apart, and no more than
those one level below; a crest that just reaches it has some more, for light I = I_max - a x² falls
into equal levels as the differences of a square root: 1, 0.41, 0.32, 0.27 of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.special import ndtri

from isochrome.errors import InputError
from isochrome.frames.opening import open_scene_frames
from isochrome.frames.reading import Frame, FrameReader, Mask
from isochrome.messages import message
from isochrome.scene import ArrayFrames, Scene

FOURTH = np.poly(np.ones(4))
"""Weights of a fourth difference: 1, -4, 6, -4, 1."""
QUANTISATION = 1 / 12
"""Variance of rounding to whole grey levels."""
LEVELS = 16
CLIP = 4.0
"""Residuals beyond this many standard deviations are defects or edges, not noise."""
_SQUARE, _DEGREE = 13, 4
"""Side of a square, pixels, and degree of its polynomial."""
_FEWEST_SQUARES = 14


@dataclass(frozen=True)
class NoiseModel:
    """Noise of a camera against grey level: variance = offset + slope level, floor at least, in raw
    grey levels (of float frames fractions of full scale) squared, with the rounding's."""

    offset: float  # at black
    slope: float
    floor: float

    def sigma(self, values: npt.ArrayLike) -> np.ndarray:
        """Standard deviation (raw grey levels) at raw levels, single precision where they are."""
        levels = np.asarray(values)
        if levels.dtype != np.float32:
            levels = levels.astype(float)
        variance = np.asarray(float(self.slope) * levels)
        variance += float(self.offset)
        return np.asarray(np.sqrt(np.maximum(variance, float(self.floor), out=variance)))

    def linear_sigma(
        self, values: npt.ArrayLike, *, bit_depth: int | None, gamma: float = 1.0
    ) -> np.ndarray:
        """gamma (raw / full)^(gamma - 1) sigma(raw) / full, of the linear image; near black the raw
        level is taken as one sigma at least, where the first order ends."""
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
    """A camera's noise from one raw frame, before any gamma, insensitive to its fringes; that which
    is correlated between pixels is underestimated, see `noise_between_pixels`. By the bit depth
    levels near black and white, where clipping hides noise, are left out."""
    image = np.asarray(image)
    if image.ndim != 2 or min(image.shape) < 8:
        raise InputError("noise_needs_frame_least", shape=image.shape)
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
        raise InputError("noise_cannot_estimated_fewer")
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
    members = [index == i for i in np.unique(index)]  # edges may differ by a rounding alone
    x = np.array([level[one].mean() for one in members])
    y, n = np.array([_clipped_variance(residual[one]) for one in members]).T
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
    1.28 (2 (n - 15))^(-1/2), white noise's; 1 where too little of the frame is whole."""
    if min(image.shape) < _SQUARE:
        return 1.0
    # orthonormal polynomials of two places in a square: (pixels, terms)
    powers = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, _SQUARE), _DEGREE)
    degrees = product(range(_DEGREE + 1), repeat=2)
    terms = [np.outer(powers[:, i], powers[:, j]).ravel() for i, j in degrees if i + j <= _DEGREE]
    fits = np.asarray(np.linalg.qr(np.stack(terms, axis=1))[0])
    squares, windows = (
        np.lib.stride_tricks.sliding_window_view(each, (_SQUARE, _SQUARE))[::_SQUARE, ::_SQUARE]
        for each in (image, valid)
    )
    light = squares[windows.all(axis=(2, 3))].reshape(-1, _SQUARE**2).astype(float)
    if len(light) < _FEWEST_SQUARES:
        return 1.0
    level = light.mean(axis=1)
    light -= level[:, None]
    residual = np.maximum((light**2).sum(axis=1) - ((light @ fits) ** 2).sum(axis=1), 0.0)
    freedom = fits.shape[0] - fits.shape[1]
    share = np.sqrt(residual / freedom) / model.sigma(level)
    white = 1.0 + float(ndtri(0.1)) * (2.0 * freedom) ** -0.5
    return max(1.0, float(np.quantile(share, 0.1) / white))


_FEWEST_LEVELS = 8
"""Levels that occur, for a plateau below full scale: the noise of half a level of an unloaded frame
in the dark field piles up on its upper two or three as on a plateau."""
_ABOVE = 0.05
"""Over the plateau's own pixels: so many may be brighter, as hot ones and glare are."""
_SOLID = 0.2
"""Share of a plateau's pixels that have none but their level about them: an even light of half a
grey level's noise leaves a tenth."""
_CREST = 2.5
"""What a crest's last level has over the one below at most."""
_GAP = 2.2
"""Typical distances of levels: what is farther below is not just below."""
_NOISE, _FINE = 0.5, 1e-4
"""Grey levels, and of full scale: a computed frame has less noise, and even light of its own."""


def saturation_level(raw: np.ndarray, *, full: float) -> float:
    """From which level a frame is clipped: its plateau's, at full scale or below, or infinite."""
    import cv2

    image = np.asarray(raw)
    usable = np.isfinite(image)
    values = image.ravel() if usable.all() else image[usable]
    if not values.size:
        return np.inf
    lowest, highest = float(values.min()), float(values.max())
    if lowest == highest:
        return highest if highest >= full else np.inf
    if values.dtype.kind in "ui":
        pixels = np.bincount(values.ravel())
        levels = np.flatnonzero(pixels)
        counts = pixels[levels].astype(float)
    else:
        levels, counts = np.unique(values, return_counts=True)
    # levels above the middle of the range with hardly any pixel above them, lowest first
    above = counts.sum() - np.cumsum(counts)
    last = (levels > 0.5 * (lowest + highest)) & (above <= _ABOVE * counts)
    last &= (levels >= full) | (len(levels) >= _FEWEST_LEVELS)
    for i in np.flatnonzero(last).tolist():
        level = float(levels[i])
        if level >= full:
            expected = _CREST * counts[max(i - 2, 0) : i].max(initial=0.0)
            # more pixels than those just below go on to, or none lie just below
            if counts[i] >= expected + CLIP * np.sqrt(expected) or (
                levels[i] - levels[i - 1] > _GAP * np.median(np.diff(levels[: i + 1]))
            ):
                return level
        plateau = (usable & (image == level)).view(np.uint8)
        # all nine pixels about a place
        solid = cv2.erode(plateau, np.ones((3, 3)), borderType=cv2.BORDER_REFLECT)
        if np.count_nonzero(solid) > _SOLID * counts[i] and _is_noisy(
            image, usable & (image < level), full
        ):
            return level
    return np.inf


def _is_noisy(image: np.ndarray, below: npt.NDArray[np.bool_], full: float) -> bool:
    """Whether the pixels below a plateau have a camera's noise, so that the plateau is none."""
    if min(image.shape) < 8:
        return False
    try:
        noise = estimate_noise(image, below)
    except InputError:  # next to nothing lies below
        return True
    sigma = float(noise.sigma(np.median(image[below])))
    return sigma > (_NOISE if image.dtype.kind in "ui" else _FINE * full)


def load_no_load(
    scene: Scene, *, full_shape: tuple[int, int] | None = None
) -> tuple[Linear | None, Linear | None]:
    """The scene's dark and bright no-load frame as light, stacks averaged; None where it names
    none. `full_shape`, the captured frames' before the roi. InputError: saturated, or of another
    size."""
    dark, bright = (_average(scene, key, full_shape) for key in ("no_load_dark", "no_load_bright"))
    if dark is not None and bright is not None and dark.image.shape != bright.image.shape:
        raise InputError(
            "frames_no_load_dark_pixels_rows", shape=dark.image.shape, shape_2=bright.image.shape
        )
    return dark, bright


def open_no_load_steps(scene: Scene, full_shape: tuple[int, int]) -> FrameReader:
    """Open the unloaded specimen's phase-stepped set; `full_shape`, the frames' before the roi."""
    name, steps = scene.frames.no_load_steps, len(scene.polariscope.step)
    assert name is not None
    path = scene.path(name)
    reader = open_scene_frames(path, scene)
    count = reader.count()
    if count != steps:
        raise InputError("frames_no_load_steps_holds_frames", path=path, count=count, steps=steps)
    _check_shape(path, "no_load_steps", reader, full_shape)
    return reader


def _check_shape(
    path: Path | ArrayFrames, key: str, reader: FrameReader, full_shape: tuple[int, int] | None
) -> None:
    if full_shape is not None and reader.full_shape != full_shape:
        raise InputError(
            "frames_pixels_rows_columns", path=path, key=key, full_shape=reader.full_shape,
            full_shape_2=full_shape,
        )  # fmt: skip


def _average(scene: Scene, key: str, full_shape: tuple[int, int] | None) -> Linear | None:
    name: str | ArrayFrames | None = getattr(scene.frames, key)
    if name is None:
        return None
    path = scene.path(name)
    with open_scene_frames(path, scene, masked=False) as reader:
        _check_shape(path, key, reader, full_shape)
        total, valid, count = np.zeros(reader.shape), np.ones(reader.shape, bool), 0
        for frame in reader:
            gamma = scene.frames.first_gamma
            linear = to_linear(frame, bit_depth=reader.bit_depth, gamma=gamma, allow_blank=True)
            total += linear.image
            valid &= linear.valid
            count += 1
    if not valid.any():
        raise InputError("frames_saturated_all_over", path=path, key=key)
    return Linear((total / count).astype(np.float32), valid)


def likely_no_load(names: Sequence[str]) -> dict[str, str]:
    """The no-load frames by the names of files: the scene's key to a name that is alone."""
    unloaded = [name for name in names if is_unloaded(name) and not name.endswith(".csv")]
    called = {field: [n for n in unloaded if field in n.lower()] for field in ("dark", "bright")}
    return {f"frames.no_load_{field}": n[0] for field, n in called.items() if len(n) == 1}


def is_unloaded(name: str) -> bool:
    """Whether a file's name says that it is a frame without load."""
    plain = name.lower().replace("_", "-").replace(" ", "-")
    return any(word in plain for word in ("no-load", "noload", "unloaded"))


OUTLIER_SIGMAS = 8.0
MIN_CONTRAST = 0.05
"""Pixels whose contrast B - D is below this part of the frame's median are masked."""


@dataclass(frozen=True)
class Linear:
    """Light (row, col) as a fraction of full scale."""

    image: np.ndarray  # float32, also where it is not valid
    valid: Mask  # not saturated, dead, hot or non-finite, and on the specimen


def to_linear(
    image: Frame | np.ndarray,
    *,
    bit_depth: int | None,
    gamma: float = 1.0,
    name: str | None = None,
    allow_blank: bool = False,
    mask: Mask | None = None,
) -> Linear:
    """Light as a fraction of full scale: (raw / (2^bit_depth - 1))^gamma, gamma 1 of a linear
    camera, about 2.2 of the usual (sRGB-like) tone curve. `bit_depth` None: fractions already;
    `allow_blank`: a constant frame is right, as an ideal no-load one is."""
    if isinstance(image, Frame):
        name, mask, image = name or image.name, image.mask, image.image
    raw, name = np.asarray(image), name or "the frame"
    if raw.ndim != 2 or raw.size == 0:
        raise InputError("frame_row_col_not", name=name, shape=raw.shape)
    if mask is not None and mask.shape != raw.shape:
        raise InputError(
            "pixels_rows_columns_specimen", name=name, shape=raw.shape, shape_2=mask.shape
        )
    full = full_scale(bit_depth)
    finite = np.isfinite(raw)
    complete = bool(finite.all())
    _check_levels(raw if complete else raw[finite], bit_depth, allow_blank, name)
    light = raw.astype(np.float32)
    if not complete:
        light[~finite] = 0.0
    light /= np.float32(full)
    valid = finite & ~find_outliers(raw, finite) & (raw < saturation_level(raw, full=full))
    if gamma != 1:
        valid &= light >= 0  # a background was subtracted: what gamma made of it is not known
        light = np.maximum(light, 0) ** np.float32(gamma)
    if not complete:
        light[~finite] = np.nan
    if mask is not None:
        valid &= mask
    return Linear(image=light, valid=valid)


def _check_levels(numbers: np.ndarray, bit_depth: int | None, allow_blank: bool, name: str) -> None:
    """Refuse a frame without a number, beyond its bit depth, or of one value."""
    if not numbers.size:
        raise InputError("holds_no_number_nan", name=name)
    full, low, high = full_scale(bit_depth), float(numbers.min()), float(numbers.max())
    if high > full:
        given = f"{bit_depth} bits end" if bit_depth else message("float_frames_without_bit")
        raise InputError("holds_set_camera_bit_depth", name=name, high=high, given=given, full=full)
    if low == high and not allow_blank:
        what = "all black" if high <= 0 else "all white" if high >= full else "constant"
        raise InputError("every_pixel_check_light", name=name, what=what, high=high)


def find_outliers(image: np.ndarray, finite: Mask | None = None) -> Mask:
    """Dead and hot pixels, alone or two together and not outermost: beyond the second largest (or
    smallest) of the eight neighbours by 8 noise sigmas and by their whole spread. A fringe, however
    fine, has neighbours as bright as itself along its length."""
    import cv2

    outliers = np.zeros(image.shape, bool)
    if image.shape[0] < 3 or image.shape[1] < 5:
        return outliers
    # whole levels of one or two bytes are compared as they are: that takes a tenth of the time
    values: np.ndarray = image if image.dtype in (np.uint8, np.uint16) else image.astype(np.float32)
    if finite is not None and not finite.all():
        values = np.where(finite, values, np.median(values[finite]).astype(values.dtype))
    integral = values.dtype.kind == "u"
    least = 0.0 if integral else -np.inf
    most = float(2 ** (8 * values.dtype.itemsize) - 1) if integral else np.inf
    rows, cols = values.shape[0] - 2, values.shape[1] - 2
    centre = values[1:-1, 1:-1]
    first_max, high = (np.full(centre.shape, least, values.dtype) for _ in range(2))
    first_min, low = (np.full(centre.shape, most, values.dtype) for _ in range(2))
    between = np.empty_like(high)
    for dr, dc in product(range(3), range(3)):
        if (dr, dc) != (1, 1):
            near = values[dr : dr + rows, dc : dc + cols]
            cv2.max(high, cv2.min(first_max, near, between), high)
            cv2.min(low, cv2.max(first_min, near, between), low)
            cv2.max(first_max, near, first_max)
            cv2.min(first_min, near, first_min)
    # of whole levels a difference below nought is nought, which is no excess either
    spread = cv2.subtract(high, low)
    excess = cv2.max(cv2.subtract(centre, high), cv2.subtract(low, centre))
    # from the median fourth difference along rows, blind to fringes; whole levels of a byte
    # give whole differences, whose median takes half the time
    v = values[::4].astype(np.int16 if values.dtype == np.uint8 else np.float32)
    middle = float(np.median(np.abs(np.diff(v, 4, axis=1))))
    sigma = 1.4826 * middle / float(np.linalg.norm(FOURTH))
    quantum = 1.0 if image.dtype.kind in "ui" else 0.0
    step = max(OUTLIER_SIGMAS * sigma, 2 * quantum)
    limit = values.dtype.type(min(math.floor(step), most) if integral else step)
    outliers[1:-1, 1:-1] = (excess > spread) & (excess > limit)
    return outliers


@dataclass(frozen=True)
class Normalised:
    """A fringe signal and what it was made with, all (row, col) float32."""

    signal: np.ndarray  # nominally 0 to 1, noise may pass the ends; NaN where not valid
    valid: Mask
    background: np.ndarray  # D, a fraction of full scale
    # B - D, a fraction of full scale: the signal's sigma is the light's over it
    contrast: np.ndarray


def normalise(image: Linear, dark: Linear, bright: Linear) -> Normalised:
    """Take background and illumination out of a frame: s = (I - D) / (B - D), all linear light."""
    valid = image.valid & dark.valid & bright.valid
    low, contrast = dark.image, bright.image - dark.image
    usual = float(np.median(contrast[valid])) if valid.any() else 0.0
    if not usual > 0:
        raise InputError("frame_has_no_contrast", usual=usual)
    valid = valid & (contrast > MIN_CONTRAST * usual)
    signal = np.full(low.shape, np.nan, np.float32)
    np.divide(image.image - low, contrast, out=signal, where=valid)
    return Normalised(signal, valid, low.astype(np.float32), contrast.astype(np.float32))
