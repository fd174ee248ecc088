"""From light to fringe signal: background and illumination taken out.

A frame of a polariscope is I = D + (B - D) s, where D is the background (the unloaded specimen in
the dark field), B the full illumination (the same in the bright field), and s the fringe signal:
s = sin^2(pi N) in the dark field and cos^2(pi N) in the bright one, N the fringe order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from isochrome.errors import InputError
from isochrome.frames.linear import Linear, Mask

MIN_CONTRAST = 0.05
"""Pixels whose contrast B - D is below this part of the frame's median are masked."""
MIN_GUESSED = 0.3
"""The same where the contrast is guessed: a smooth guess that falls so low has left the fringes."""
TILES = 12


@dataclass(frozen=True)
class Normalised:
    """A fringe signal and what it was made with, all (row, col) float32.

    `signal`: s, nominally 0 to 1, noise may pass the ends, NaN where `valid` is False; `valid`,
    True = trusted; `background` D and `contrast` B - D as fractions of full scale, so that the
    signal's sigma is that of the light over `contrast`; `blind`, True where an end was guessed
    from the frame itself.
    """

    signal: np.ndarray
    valid: Mask
    background: np.ndarray
    contrast: np.ndarray
    blind: bool


def normalise(
    image: Linear | np.ndarray,
    dark: Linear | np.ndarray | None = None,
    bright: Linear | np.ndarray | None = None,
    *,
    field: Literal["dark", "bright"] = "dark",
) -> Normalised:
    """Take background and illumination out of a frame: s = (I - D) / (B - D).

    Parameters: `image`, the light (row, col), from `to_linear`; `dark`, `bright`, the unloaded
    specimen in the dark and the bright field, also linear. Where one is missing it is guessed
    from the frame: a quadratic surface through the darkest (brightest) places of a grid of tiles.
    The guess holds where fringes cover most of the frame: a tile needs a whole fringe to show both
    ends; a tile without fringes is black in the dark `field` and full in the bright one, and
    borrows its other end from the rest. Returns a Normalised. Raises InputError where the sizes
    differ or nothing has contrast.
    """
    light, valid = _parts(image)
    given = [None if no_load is None else _parts(no_load) for no_load in (dark, bright)]
    for name, part in zip(("no-load dark", "no-load bright"), given, strict=True):
        if part is not None and part[0].shape != light.shape:
            raise InputError(
                f"the {name} frame is {part[0].shape} pixels (rows, columns) and the frame "
                f"{light.shape}; capture both with the same camera settings and roi"
            )
        if part is not None:
            valid = valid & part[1]
    low, high = (None if part is None else part[0] for part in given)
    blind = low is None or high is None
    if low is None or high is None:
        low, high = _guess(light, valid, low, high, field)
    contrast = high - low
    usual = float(np.median(contrast[valid])) if valid.any() else 0.0
    if not usual > 0:
        raise InputError(
            "the frame has no contrast between its no-load dark and bright ends (median "
            f"{usual:.3g} of full scale); are the two no-load files swapped, or the light off?"
        )
    valid = valid & (contrast > (MIN_GUESSED if blind else MIN_CONTRAST) * usual)
    signal = np.full(light.shape, np.nan, np.float32)
    np.divide(light - low, contrast, out=signal, where=valid)
    return Normalised(signal, valid, low.astype(np.float32), contrast.astype(np.float32), blind)


def _parts(image: Linear | np.ndarray) -> tuple[np.ndarray, Mask]:
    if isinstance(image, Linear):
        return image.image, image.valid
    plain = np.asarray(image)
    return plain, np.isfinite(plain)


def _guess(
    light: np.ndarray,
    valid: Mask,
    low: np.ndarray | None,
    high: np.ndarray | None,
    field: str,
) -> tuple[np.ndarray, np.ndarray]:
    """The missing ends of the signal, as smooth surfaces through the tiles' extremes."""
    from scipy import ndimage

    centre = float(np.median(light[valid])) if valid.any() else 0.0
    smooth = ndimage.gaussian_filter(np.where(valid, light, centre), 0.8)
    below = 0.0 if low is None else low
    rows, cols, dark_end, bright_end = _tile_ends(smooth, below, valid)
    swing = bright_end - dark_end
    if not len(swing) or float(np.max(swing)) <= 0:
        raise InputError("the frame shows no fringes to normalise by; give no-load frames")
    fringed = swing > 0.6 * np.percentile(swing, 90)
    everywhere = np.ones_like(fringed)
    if low is None:
        chosen = everywhere if field == "dark" and not fringed.all() else fringed
        lowest = _surface(rows, cols, dark_end, chosen, light.shape, upper=False)
        low = np.clip(lowest, 0, None)
    if high is None:
        offset = low if np.ndim(below) else np.zeros_like(light)
        chosen = everywhere if field == "bright" and not fringed.all() else fringed
        high = _surface(rows, cols, bright_end, chosen, light.shape, upper=True) + offset
    return low, high


def _tile_ends(
    smooth: np.ndarray, below: float | np.ndarray, valid: Mask
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Tile centres (-1 to 1) and the 1st and 99th percentiles of the light in each."""
    above = smooth - below
    heights = np.array_split(np.arange(smooth.shape[0]), min(TILES, smooth.shape[0]))
    widths = np.array_split(np.arange(smooth.shape[1]), min(TILES, smooth.shape[1]))
    found = []
    for r in heights:
        for c in widths:
            place = np.s_[r[0] : r[-1] + 1, c[0] : c[-1] + 1]
            inside = valid[place]
            if 2 * np.count_nonzero(inside) >= inside.size:
                ends = np.percentile(above[place][inside], (1, 99))
                found.append(
                    (_unit(r.mean(), smooth.shape[0]), _unit(c.mean(), smooth.shape[1]), *ends)
                )
    table = np.array(found).reshape(-1, 4)
    return table[:, 0], table[:, 1], table[:, 2], table[:, 3]


def _unit(index: float, size: int) -> float:
    return 2 * (index + 0.5) / size - 1


def _surface(
    rows: np.ndarray,
    cols: np.ndarray,
    ends: np.ndarray,
    chosen: Mask,
    shape: tuple[int, ...],
    *,
    upper: bool,
) -> np.ndarray:
    """A quadratic surface that rests on the chosen tiles' outermost ends."""
    r, c, e = rows[chosen], cols[chosen], ends[chosen]
    sign = 1.0 if upper else -1.0
    if len(e) < 18:
        return np.full(shape, np.max(sign * e) * sign)
    design, weight = _terms(r, c).T, np.ones_like(e)
    for _ in range(8):  # a tile that never reaches the end says little: asymmetric least squares
        factors = np.linalg.lstsq(design * weight[:, None], e * weight, rcond=None)[0]
        weight = np.where(sign * (e - design @ factors) > 0, 1.0, 0.2)
    y = np.linspace(-1, 1, shape[0])[:, None]
    x = np.linspace(-1, 1, shape[1])[None, :]
    return np.tensordot(factors, _terms(y, x), axes=1)


def _terms(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """1, y, x, y^2, x^2, xy on broadcast coordinates."""
    y, x = np.broadcast_arrays(y, x)
    return np.stack([np.ones(y.shape), y, x, y * y, x * x, y * x])
