"""Colour light to fringe signal: background and illumination taken out of every channel.

A channel's light is I_c = D_c + A_c s_c(N). With no-load frames D and A are theirs; what is missing
is found from the frame itself (`isochrome.fringes.colour.without_references`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isochrome.errors import InputError
from isochrome.fringes.colour.colour_table import ColourTable
from isochrome.fringes.colour.frame_exposure import FrameExposure, find_exposure
from isochrome.fringes.colour.without_references import find_ends
from isochrome.fringes.windows import Array, Mask

LEAST_CONTRAST = 0.2
"""Contrast, over that of the frame's brightest places, below which a pixel is without light."""

TABLE_ERROR = 0.002
"""Of a table at best, of full light: what a frame without noise is still weighed by."""

_ROWS = 3


@dataclass(frozen=True, kw_only=True)
class ColourSignal:
    """Signals of the channels (rows, cols, channels), 1 = full light."""

    signal: Array  # NaN = not trusted
    variance: Array
    lit: Mask  # (rows, cols): where there is light at all
    order_variance: Array  # (rows, cols), fringes², from the uncertainty of the ends
    blind: bool  # an end was found from the frame itself
    # only the frame says where light is: a black place may be no specimen at all
    unlit_unknown: bool
    exposure: FrameExposure  # over that of the no-load frames


def colour_signal(
    light: Array,
    table: ColourTable,
    *,
    sigma: Array | float,
    dark: Array | None,
    bright: Array | None,
    valid: Mask,
) -> ColourSignal:
    """Take background and illumination out of a colour frame: s = (I - D)/(B - D).

    Parameters: `light` (rows, cols, channels); `table`; `sigma`, noise of the light; `dark`,
    `bright`, the no-load frames as light, None where missing; `valid`, of the light's shape.
    The variance is that of the frame, of the no-load frames and of the table's spread.
    Returns a ColourSignal. Raises InputError where sizes differ or nothing has contrast.
    """
    for name, frame in (("dark", dark), ("bright", bright)):
        if frame is not None and frame.shape != light.shape:
            raise InputError(
                f"the no-load {name} frame is {frame.shape} (row, col, channel) and the frame "
                f"{light.shape}; capture both with the same camera settings and roi"
            )
    blind = dark is None or bright is None
    noise = np.broadcast_to(np.asarray(sigma, dtype=float), light.shape)
    exposure = FrameExposure()
    if dark is not None and bright is not None:
        exposure = find_exposure(
            light, table, sigma=noise, dark=dark, bright=bright, valid=valid & (bright > dark)
        )
        dark, bright = exposure.factor * dark, exposure.factor * bright
        low, contrast, order_variance = dark, bright - dark, np.zeros(light.shape[:2])
    else:
        low, contrast, order_variance = find_ends(
            light, table, sigma=noise, dark=dark, bright=bright, valid=valid
        )
    lit = _lit(contrast, valid)
    trusted = valid & lit[..., None]
    signal = np.full(light.shape, np.nan, np.float32)
    np.divide(light - low, contrast, out=signal, where=trusted)
    share = np.clip(np.nan_to_num(signal), 0.0, 1.0)
    variance = noise**2
    both = 1.0 - share if bright is not None else np.ones_like(share)  # of I - D and B - D
    for frame, part in ((dark, both), (bright, share)):
        if frame is not None:
            variance += part**2 * _noise(frame, trusted) ** 2
    variance /= np.where(trusted, contrast, 1.0) ** 2
    return ColourSignal(
        signal=signal,
        variance=(variance + table.spread**2 + TABLE_ERROR**2).astype(np.float32),
        lit=lit,
        order_variance=order_variance,
        blind=blind,
        unlit_unknown=bright is None,
        exposure=exposure,
    )


def _lit(contrast: Array, valid: Mask) -> Mask:
    """Where there is light; the contrast of a no-load pair is noise where there is none."""
    from scipy.ndimage import gaussian_filter

    if not valid.any():
        raise InputError("the frame has no pixel to be trusted: saturated or masked all over")
    used = np.asarray(valid.any(axis=(0, 1)))
    usual = np.array(
        [
            float(np.percentile(contrast[..., c][valid[..., c]], 95)) if used[c] else np.inf
            for c in range(len(used))
        ]
    )
    if not (usual > 0.0).all():
        raise InputError(
            "the frame has no contrast between its dark and bright ends in some channel; are the "
            "two no-load files swapped, or the light off?"
        )
    share = (contrast / usual).sum(axis=-1) / np.count_nonzero(used)
    smooth = gaussian_filter(share.astype(np.float32), 1.0, mode="nearest")
    return np.asarray((smooth > LEAST_CONTRAST) & (share > 0.5 * LEAST_CONTRAST))


def _noise(frame: Array, valid: Mask) -> Array:
    """Noise (channels,) of a no-load frame: fourth differences along every third row, by median."""
    rows, good = frame[::_ROWS].astype(np.float32), valid[::_ROWS]
    rough = sum(
        weight * rows[:, i : rows.shape[1] - 4 + i]
        for i, weight in enumerate((1.0, -4.0, 6.0, -4.0, 1.0))
    )
    inside = good[:, 2:-2]
    found = np.zeros(frame.shape[2])
    for c in range(frame.shape[2]):
        size = np.abs(np.asarray(rough)[..., c][inside[..., c]])
        if size.size:
            # rounding to whole levels makes the median itself a step; the middle half does not
            low, high = np.percentile(size, (25.0, 75.0))
            found[c] = (low + high) / (0.3186 + 1.1503) / np.sqrt(70.0)
    return found
