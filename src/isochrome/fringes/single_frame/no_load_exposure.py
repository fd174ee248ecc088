r"""How long a frame was exposed against its no-load frames, from its fringes' crests and troughs.

The frame's ends are its no-load frames' times a factor each, D' = d D and B' = b B: another
exposure, gain or lamp, and a sensor's offset need not go with them. All along a crest, N = 1/2,
3/2, ..., the light is b B, whatever the background: I/B has one value there, and none above it. So
has I/D along a trough. A line of greatest order is no crest, and its light changes along it; but
where it hardly does, the light alone cannot tell a crest of N = 1/2 under less light from a ridge
of the order below 1/2, unless a trough is in the frame too: an order that is 0 along a line is not
generic.
The lines are where the gradient vanishes across the direction of the largest curvature.
Source: Steger (1998), IEEE TPAMI 20, 113, for the lines.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from isochrome.fringes.single_frame.background_modulation import BackgroundModulation
from isochrome.fringes.windows import Array, Mask

_WIDTHS, _NARROWEST_PX = (1.0 / 16.0, 1.0 / 32.0, 1.0 / 64.0), 1.5
"""Smoothings to try, standard deviation over the frame's shorter side, and pixels at least."""

_FLATTENED, _NARROW = 0.3, 0.05
"""Share of a line's light, and of the fringe's, that smoothing may take off."""
_CORRECTED = 0.1
"""Standard uncertainty of that, over itself: the fringes' rate changes."""

_LENGTH = 0.2
"""Length of a line that says something, over the frame's shorter side."""

_OFF, _SHARP = 0.6, 4.0
"""A line's distance from its pixel at most, pixels, and its curvature over that of noise."""

_EVEN, _NOTHING_BEYOND = 0.007, 0.02
"""Scatter of the light along a line, and share by which other light may pass it."""

_STRAIGHT = 0.2
"""Curvature of the light along a line over that across: a flat extremum of the order has both."""

_BLACKEST = 0.005
"""Dark end, over the bright one, below which its factor changes nothing and is not looked for."""

_LIFT = 0.1
"""Share of the bright end by which light is lifted to look for its dark lines."""

_SMOOTH_PX = 3.0
_SYSTEMATIC = 0.003
_UNSEEN = 0.5
"""Standard uncertainty, over b, of the dark frame's factor where no trough is in the frame."""

_SURE, _LEAST = 3.0, 0.02


@dataclass(frozen=True)
class NoLoadExposure:
    """Factors of the no-load frames that make them a frame's own ends.

    Parameters
    ----------
    dark, bright : float
        The factors d and b; both 1 where the frame does not speak against that.
    told : bool
        Whether the fringes tell b: whether a crest is in the frame.
    ends : BackgroundModulation, optional
        The frame's ends, where they are not the no-load frames.
    dark_told : bool
        Whether the fringes tell d: whether a trough is in the frame, or the dark end is black.
    crest_sure : bool
        Whether the line that told b must be a crest: whether a trough is in the frame, or b is 1.
    """

    dark: float = 1.0
    bright: float = 1.0
    told: bool = False
    ends: BackgroundModulation | None = None
    dark_told: bool = True
    crest_sure: bool = True


def find_no_load_exposure(
    light: Array, sigma: Array, valid: Mask, *, dark: Array, bright: Array
) -> NoLoadExposure:
    """Find a frame's exposure over that of each of its no-load frames.

    Parameters
    ----------
    light : ndarray (rows, cols)
        Light of the frame, linear.
    sigma : ndarray (rows, cols)
        Noise of the light.
    valid : bool ndarray (rows, cols)
        Whether a pixel is trusted.
    dark, bright : ndarray (rows, cols)
        The no-load frames, of the same linearity.

    Returns
    -------
    NoLoadExposure
        The factors, and whether the fringes tell them.
    """
    low, high = _smooth(dark), _smooth(bright)
    seen = valid & (high > 0.1 * np.median(high))
    crest = _level(light, sigma, high, seen)
    if crest is None:
        return NoLoadExposure()
    b, by_crest = crest
    share = float(np.median(low[seen] / high[seen]))
    black = share < _BLACKEST
    trough = None if black else _level(light, sigma, low, seen & (low > 0.0), b * high)
    d, by_trough = trough or (b, by_crest if black else _UNSEEN * b)
    moved = max(abs(b - 1.0) - _SURE * by_crest, share * (abs(d - 1.0) - _SURE * by_trough))
    if moved < _LEAST:
        return NoLoadExposure(told=True)
    ends = _ends(dark, bright, (d, b), (by_trough, by_crest))
    crest_sure = trough is not None or _has_trough(light, sigma, b * high, seen, share)
    return NoLoadExposure(d, b, True, ends, black or trough is not None, crest_sure)


def _has_trough(light: Array, sigma: Array, bright: Array, seen: Mask, share: float) -> bool:
    """Whether there is a line as dark as the dark end, a `share` of the bright one, may be."""
    lifted = _level(light + _LIFT * bright, sigma, bright, seen, bright)
    if lifted is None:
        return False
    level, uncertainty = lifted[0] - _LIFT, 3.0 * lifted[1] + _BLACKEST
    return -uncertainty < level < share / _UNSEEN + uncertainty


def _smooth(end: Array) -> Array:
    """A no-load frame without its noise; a lamp's bright spot keeps its height.

    Equation: 2 G - G * G, which changes nothing up to the third derivative.
    """
    once = ndimage.gaussian_filter(end, _SMOOTH_PX, mode="nearest")
    return np.asarray(2.0 * once - ndimage.gaussian_filter(once, _SMOOTH_PX, mode="nearest"))


def _level(
    light: Array, sigma: Array, end: Array, seen: Mask, bright: Array | None = None
) -> tuple[float, float] | None:
    """Factor of an end by the lines on which the light is its, and its standard uncertainty.

    Parameters: `end`, smooth; `seen`, where it can be divided by; `bright`, the light on crests
    where troughs are looked for. None where there is no such line.
    """
    sign = 1.0 if bright is None else -1.0
    safe = np.where(seen, end, 1.0)
    ratio = sign * np.where(seen, light / safe, 0.0)
    ratio = np.where(seen, ratio, np.median(ratio[seen]))
    noise = float(np.median(sigma[seen] / safe[seen]))
    fringe = np.maximum(np.abs(ratio) if bright is None else bright / safe, noise)
    widths = [max(_NARROWEST_PX, share * min(light.shape)) for share in _WIDTHS]
    # wide smoothing takes narrow fringes away, which may be brighter than the line
    finest = ndimage.gaussian_filter(ratio, widths[-1], mode="nearest")
    brightest = float(np.percentile(finest[_inner(seen, widths[-1])], 99.5))
    brightest -= 2.0 * noise / widths[-1]
    for width in widths:
        level = _level_at(ratio, fringe, noise, seen, width)
        if level is None or sign * level[0] <= 0.0:
            continue
        if brightest - level[0] < _NOTHING_BEYOND * abs(level[0]):
            return abs(level[0]), level[1]
    return None


def _inner(seen: Mask, width: float) -> Mask:
    """Where neither the border nor what is not seen lies within reach of a smoothing."""
    inner = ndimage.gaussian_filter(seen.astype(float), width) > 0.98
    return np.asarray(ndimage.binary_erosion(inner, iterations=int(width)))


def _level_at(
    ratio: Array, fringe: Array, noise: float, seen: Mask, width: float
) -> tuple[float, float] | None:
    """The greatest value that a ratio has all along a line, at one width of smoothing (pixels).

    Parameters: `fringe` (rows, cols), the ratio's change from a trough to a crest. Pieces of a line
    that are less apart than its smoothing are one.
    """
    smooth, across, bend, along = _lines(ratio, width)
    sharp = _SHARP * noise * np.sqrt(3.0 / (16.0 * np.pi)) / width**3
    inner = _inner(seen, width)
    if not inner.any():
        return None
    fringe = ndimage.gaussian_filter(fringe, width, mode="nearest")
    lost = _taken_off(bend, fringe, width)
    top = smooth + lost
    line = inner & (np.abs(across) < _OFF) & (bend < -sharp)
    line &= lost < np.minimum(_FLATTENED * np.abs(top), _NARROW * fringe)
    at = _greatest_even(line, top, (bend, along), noise, width)
    if at is None:
        return None
    middle, scatter = _middle(top[at])
    along = max(scatter, noise / width) / np.sqrt(max(np.count_nonzero(at) / width, 1.0))
    corrected = _CORRECTED * float(np.median(lost[at]))
    return middle, float(np.sqrt(along**2 + corrected**2 + (_SYSTEMATIC * middle) ** 2))


def _greatest_even(
    line: Mask, top: Array, curvature: tuple[Array, Array], noise: float, width: float
) -> Mask | None:
    """The lines of the greatest value that lines have all along; None where there are none.

    Parameters: `curvature`, across and along. Several lines of one value count as one: all crests
    are alike.
    """
    near = ndimage.binary_dilation(line, np.ones((3, 3)), iterations=max(1, int(width / 2.0)))
    pieces, count = ndimage.label(near)
    pieces = np.where(line, pieces, 0)
    even = []
    for piece in range(1, count + 1):
        at = pieces == piece
        middle, scatter = _middle(top[at])
        bend, along = (float(np.median(part[at])) for part in curvature)
        if scatter < _EVEN * abs(middle) + noise / width and abs(along) < _STRAIGHT * abs(bend):
            even.append((middle, piece))
    for greatest, _ in sorted(even, reverse=True):
        within = _EVEN * abs(greatest) + noise / width
        at = np.isin(pieces, [p for middle, p in even if 0.0 <= greatest - middle < within])
        if np.count_nonzero(at) > _LENGTH * min(top.shape):
            return np.asarray(at)
    return None


def _middle(values: Array) -> tuple[float, float]:
    """Median of some values, and their scatter."""
    middle = float(np.median(values))
    return middle, 1.4826 * float(np.median(np.abs(values - middle)))


def _taken_off(bend: Array, fringe: Array, width: float) -> Array:
    r"""What smoothing took off a line.

    Equation: of A sin^2(k x/2) a Gaussian of standard deviation w takes A (1 - e^-u)/2 off its
    ends, u = k^2 w^2/2, and leaves a curvature of A k^2 e^-u/2 there, so that w^2 times this over A
    is q = u e^-u, and what is taken off w^2/2 times it times (e^u - 1)/u. u = q + q^2 up to q^3.
    """
    lost = -0.5 * width**2 * bend
    q = np.clip(2.0 * lost / fringe, 0.0, 2.0 * _NARROW)
    return np.asarray(lost * (1.0 + 0.5 * (q + q**2) + q**2 / 6.0))


def _lines(image: Array, width: float) -> tuple[Array, Array, Array, Array]:
    """The smooth image, the distance to a line's middle, the curvature across it and along."""
    smooth = ndimage.gaussian_filter(image, width, mode="nearest")
    gy, gx = np.gradient(smooth)
    hyy, hyx = np.gradient(gy)
    hxx = np.gradient(gx, axis=1)
    angle = 0.5 * np.arctan2(2.0 * hyx, hxx - hyy)
    size = np.hypot(0.5 * (hxx - hyy), hyx)
    mean = 0.5 * (hxx + hyy)
    bend = mean - size
    cos, sin = -np.sin(angle), np.cos(angle)
    slope = gx * cos + gy * sin
    return smooth, -slope / np.minimum(bend, -1e-12), bend, mean + size


def _ends(
    dark: Array, bright: Array, factors: tuple[float, float], spread: tuple[float, float]
) -> BackgroundModulation:
    """The frame's own ends, and how well they are known."""
    variance = np.zeros((3, 3, *dark.shape))
    for i, (end, factor, each) in enumerate(zip((dark, bright), factors, spread, strict=True)):
        noise = factor * 1.4826 * float(np.median(np.abs(end - _smooth(end))))
        variance[i, i] = (each * end) ** 2 + noise**2
    return BackgroundModulation(
        dark=factors[0] * dark,
        bright=factors[1] * bright,
        settled=True,
        tone=1.0,
        tone_uncertainty=0.0,
        given=(False, False),
        variance=variance,
    )
