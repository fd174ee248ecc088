r"""How long a frame was exposed against its no-load frames, from its fringes' crests and troughs.

The frame's ends are its no-load frames' times a factor each, D' = d D and B' = b B: another
exposure, gain or lamp, and a sensor's offset need not go with them. All along a crest, N = 1/2,
3/2, ..., the light is b B, whatever the background: I/B has one value there, and none above it. So
has I/D along a trough. A line of greatest order is no crest, and its light changes along it.
The lines are where the gradient vanishes across the direction of the largest curvature.
Source: Steger (1998), IEEE TPAMI 20, 113, for the lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from isochrome.fringes.single_frame.background_modulation import BackgroundModulation
from isochrome.fringes.windows import Array, Mask

_WIDTHS, _NARROWEST_PX = (1.0 / 16.0, 1.0 / 32.0, 1.0 / 64.0), 1.5
"""Smoothings to try, standard deviation over the frame's shorter side, and pixels at least."""

_FLATTENED = 0.05
"""Share of a line's light that smoothing may take off: beyond it, it is not known to a tenth."""

_LENGTH = 1.0 / 3.0
"""Length of a line that says something, over the frame's shorter side."""

_OFF, _SHARP = 0.6, 4.0
"""A line's distance from its pixel at most, pixels, and its curvature over that of noise."""

_EVEN, _NOTHING_BEYOND = 0.007, 0.02
"""Scatter of the light along a line, and share by which other light may pass it."""

_BLACKEST = 0.005
"""Dark end, over the bright one, below which its factor changes nothing and is not looked for."""

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
    """

    dark: float = 1.0
    bright: float = 1.0
    told: bool = False
    ends: BackgroundModulation | None = None


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
    low, high = (ndimage.gaussian_filter(end, _SMOOTH_PX, mode="nearest") for end in (dark, bright))
    seen = valid & (high > 0.1 * np.median(high))
    crest = _level(light, sigma, high, seen, 1.0)
    if crest is None:
        return NoLoadExposure()
    b, by_crest = crest
    black = np.median(low[seen] / high[seen]) < _BLACKEST
    trough = None if black else _level(light, sigma, low, seen & (low > 0.0), -1.0)
    d, by_trough = trough or (b, by_crest if black else _UNSEEN * b)
    share = float(np.median(low[seen] / high[seen]))
    moved = max(abs(b - 1.0) - _SURE * by_crest, share * (abs(d - 1.0) - _SURE * by_trough))
    if moved < _LEAST:
        return NoLoadExposure(told=True)
    return NoLoadExposure(d, b, True, _ends(dark, bright, (d, b), (by_trough, by_crest)))


def _level(
    light: Array, sigma: Array, end: Array, seen: Mask, sign: float
) -> tuple[float, float] | None:
    """Factor of an end by the lines on which the light is its, and its standard uncertainty.

    Parameters: `end`, smooth; `seen`, where it can be divided by; `sign`, 1 for crests and -1 for
    troughs. None where there is no such line.
    """
    safe = np.where(seen, end, 1.0)
    ratio = sign * np.where(seen, light / safe, 0.0)
    ratio = np.where(seen, ratio, np.median(ratio[seen]))
    noise = float(np.median(sigma[seen] / safe[seen]))
    for share in _WIDTHS:
        level = _level_at(ratio, noise, seen, max(_NARROWEST_PX, share * min(light.shape)))
        if level is not None and sign * level[0] > 0.0:
            return abs(level[0]), level[1]
    return None


def _level_at(ratio: Array, noise: float, seen: Mask, width: float) -> tuple[float, float] | None:
    """The greatest value that a ratio has all along a line, at one width of smoothing (pixels)."""
    smooth, across, bend = _lines(ratio, width)
    sharp = _SHARP * noise * np.sqrt(3.0 / (16.0 * np.pi)) / width**3
    inner = ndimage.gaussian_filter(seen.astype(float), width) > 0.98
    inner = ndimage.binary_erosion(inner, iterations=int(width))
    if not inner.any():
        return None
    lost = -0.5 * width**2 * bend  # what smoothing took off
    top = smooth + lost
    line = inner & (np.abs(across) < _OFF) & (bend < -sharp)
    line &= lost < np.maximum(_FLATTENED * np.abs(top), 3.0 * noise / width)
    pieces, count = ndimage.label(line, np.ones((3, 3)))
    found = []
    for piece in range(1, count + 1):
        values = top[pieces == piece]
        middle = float(np.median(values))
        scatter = 1.4826 * float(np.median(np.abs(values - middle)))
        even = scatter < _EVEN * abs(middle) + noise / width
        if len(values) > _LENGTH * min(ratio.shape) and even:
            found.append((middle, scatter, len(values)))
    if not found:
        return None
    middle, scatter, length = max(found)
    beyond = float(np.percentile(smooth[inner], 99.5)) - middle
    if beyond > _NOTHING_BEYOND * abs(middle) + 2.0 * noise / width:
        return None
    uncertainty = np.hypot(scatter / np.sqrt(max(length / width, 1.0)), _SYSTEMATIC * abs(middle))
    return middle, float(uncertainty)


def _lines(image: Array, width: float) -> tuple[Array, Array, Array]:
    """The smooth image, the distance to a line's middle, and the curvature across (rows, cols)."""
    smooth = ndimage.gaussian_filter(image, width, mode="nearest")
    gy, gx = np.gradient(smooth)
    hyy, hyx = np.gradient(gy)
    hxx = np.gradient(gx, axis=1)
    angle = 0.5 * np.arctan2(2.0 * hyx, hxx - hyy)
    size = np.hypot(0.5 * (hxx - hyy), hyx)
    bend = 0.5 * (hxx + hyy) - size  # the smaller of both curvatures
    cos, sin = -np.sin(angle), np.cos(angle)
    slope = gx * cos + gy * sin
    return smooth, -slope / np.minimum(bend, -1e-12), bend


def _ends(
    dark: Array, bright: Array, factors: tuple[float, float], spread: tuple[float, float]
) -> BackgroundModulation:
    """The frame's own ends, and how well they are known."""
    variance = np.zeros((3, 3, *dark.shape))
    for i, (end, factor, each) in enumerate(zip((dark, bright), factors, spread, strict=True)):
        rough = end - ndimage.gaussian_filter(end, _SMOOTH_PX, mode="nearest")
        noise = factor * 1.4826 * float(np.median(np.abs(rough)))
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
