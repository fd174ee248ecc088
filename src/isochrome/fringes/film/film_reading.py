"""The order of each pixel of a film's frame, on the branch that it was followed on."""

from __future__ import annotations

import numpy as np

from isochrome.fringes.film.beside_known import continued
from isochrome.fringes.film.film_light import FilmLight
from isochrome.fringes.film.follower import FilmState
from isochrome.fringes.on_branch import OrderReading, make_reading, read_order, widened
from isochrome.fringes.windows import Array, Mask, nearest_known

_GUIDE_ROWS = 247
"""Rows, or columns if they are fewer, on which a film is followed at most, or nearly so."""


def pixels_together(shape: tuple[int, int]) -> int:
    """How many pixels of a frame, along each side, are followed as one."""
    return max(1, round(min(shape) / _GUIDE_ROWS))


def joined_pixels(values: Array, by: int) -> Array:
    """Means over blocks of pixels, float32; a rim narrower than a block is left out."""
    import cv2

    rows, cols = (n // by for n in values.shape)
    single = np.ascontiguousarray(values[: rows * by, : cols * by], dtype=np.float32)
    if by == 1:
        return single
    return np.asarray(cv2.resize(single, (cols, rows), interpolation=cv2.INTER_AREA))


def fringe_response(order: Array) -> Array:
    """The ideal signal of an order, sin² pi N."""
    half = np.float32(0.5)
    return np.asarray(half - half * np.cos(np.float32(2.0 * np.pi) * order))


def read_followed(
    light: Array, state: FilmState, film_light: FilmLight, *, sigma: Array, valid: Mask, by: int
) -> OrderReading:
    """Read the orders of a frame where they were followed to; `kept` is of the valid pixels.

    `state` is on blocks of `by` pixels a side, `film_light` of the frame's size; `sigma` is the
    noise.
    """
    import cv2

    order = _spread(state.order, by, light.shape, smooth=True)
    blocks = _spread(state.known.astype(np.float32), by, light.shape, smooth=False)
    beside = valid & (cv2.dilate(blocks, np.ones((2 * by + 1, 2 * by + 1), np.uint8)) > 0.5)
    known = blocks > 0.5
    known |= beside & ~_whole(valid, by)  # at a rim, blocks that are cut are not followed
    rise = film_light.rise(light)
    found = read_order(
        rise,
        order,
        fringe_response,
        illumination=film_light.illumination,
        background=np.zeros_like(rise),
        sigma=sigma,
        valid=beside,
    )
    found = widened(found, film_light.signal_error(light))
    known &= np.isfinite(found.order)
    return make_reading(found.order, found.uncertainty, known, of=valid)


def _whole(valid: Mask, by: int) -> Mask:
    """Pixels (rows, cols) whose block has none that is not trusted."""
    blocks = _whole_blocks(valid, by).astype(np.float32)
    return np.asarray(_spread(blocks, by, valid.shape, smooth=False) > 0.5)


def _whole_blocks(which: Mask, by: int) -> Mask:
    """Blocks of pixels all of which are among some (rows, cols)."""
    return np.asarray(joined_pixels(which, by) > 1.0 - 0.5 / by**2)


def joined_reading(reading: OrderReading, by: int, time: float) -> FilmState:
    """A frame's reading as a state that a film can be followed from, on blocks of pixels.

    Orders are of blocks of which each pixel was read; the rate is not known, and taken as 0.
    """
    read = np.isfinite(reading.order)
    known = _whole_blocks(read, by)
    order = joined_pixels(np.where(read, reading.order, 0.0), by)
    if known.any():
        order = continued(nearest_known(order, known), known)
    nothing = np.zeros_like(order)
    return FilmState(
        order=order, rate=nothing, drift=nothing, untold=nothing, known=known, time=time
    )


def _spread(values: Array, by: int, shape: tuple[int, ...], *, smooth: bool) -> Array:
    """Values of blocks on the pixels; a rim that is no whole block has its neighbours'."""
    import cv2

    rows, cols = values.shape
    how = cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST
    large = cv2.resize(values, (cols * by, rows * by), interpolation=how) if by > 1 else values
    below, beside = shape[0] - rows * by, shape[1] - cols * by
    return np.asarray(cv2.copyMakeBorder(large, 0, below, 0, beside, cv2.BORDER_REPLICATE))
