r"""Orders a little beyond where they are known, and which of them their light bears out.

Beside known orders N goes on as a plane through them: min over a, b, c of
Σ w (N(p + u) - a - b u_1 - c u_2)², w a Gaussian window times where orders are known; N(p) = a.
What a key frame could not read is regained where the light, on a flank, says the same:
d = (w - C cos 2 pi N)/(dw/dN). On a crest both of its sides are as bright, and nothing is gained
there until the fringes move. Whether it is right, the frames before are to say, through which it is
followed back.
"""

from __future__ import annotations

import numpy as np

from isochrome.fringes.film.order_change import faded_fringes, is_wide
from isochrome.fringes.windows import Array, Mask

_WIDTH_PX, _HALF_PX = 1.5, 4
"""Standard deviation of the window, pixels, and how far it reaches: a plane is to bend with the
order, and an order that is needed lies beside a known one."""
_LEAST = 0.2
"""Weight of the known pixels from which there are enough of them: those of one side have 7."""
_HELD = 0.02
"""Of the window's weight: gradients that few pixels tell are held near to nought."""

_ROUNDS = 4
"""Blocks at most by which what is known grows at once."""
_BESIDE = 3
"""Known ones of a block's eight neighbours, and itself: fewer tell no plane."""
_FLANK, _NEAR = 0.5, 0.05
"""Least |sin 2 pi N| of a flank, 0.08 fringe from a crest, and how far the light may lie from the
order that is continued, fringes: less than to the crest, beyond which light is the same."""


def continued(order: Array, known: Mask) -> Array:
    """Orders that go on beyond where they are known (rows, cols), fringes.

    Parameters: `order` (rows, cols), fringes; `known`, where it is. What lies too far beyond stays
    as it is.
    """
    weight = known.astype(np.float32)
    values = order * weight
    total = _moment(weight, 0, 0)
    beyond = ~known & (total > _LEAST)
    if not beyond.any():
        return order
    powers = ((0, 0), (1, 0), (0, 1))
    sums = {(i, j): _moment(weight, i, j)[beyond] for i in range(3) for j in range(3 - i)}
    matrix = np.array(
        [[sums[a + c, b + d] for c, d in powers] for a, b in powers], dtype=float
    ).transpose(2, 0, 1)
    matrix[:, 1, 1] += _HELD * sums[0, 0]
    matrix[:, 2, 2] += _HELD * sums[0, 0]
    right = np.stack([_moment(values, i, j)[beyond] for i, j in powers], axis=1).astype(float)
    found = order.copy()
    found[beyond] = np.linalg.solve(matrix, right[..., None])[:, 0, 0]
    return np.abs(found)


def _moment(values: Array, down: int, across: int) -> Array:
    """Σ w u_1^down u_2^across times values about each pixel (rows, cols)."""
    import cv2

    away = np.arange(-_HALF_PX, _HALF_PX + 1, dtype=np.float32)
    window = np.exp(-0.5 * (away / np.float32(_WIDTH_PX)) ** 2)
    return np.asarray(
        cv2.sepFilter2D(
            values, cv2.CV_32F, window * away**across, window * away**down,
            borderType=cv2.BORDER_CONSTANT,
        )
    )  # fmt: skip


def regained(order: Array, known: Mask, wave: Array, valid: Mask) -> tuple[Array, Mask]:
    """Orders and where they are known, with what their light bears out beside those known before.

    Parameters: `order`, fringes; `known`, where it is; `wave`, cos 2 pi N of the frame, and
    `valid`, where it is trusted; all (rows, cols).
    """
    for _ in range(_ROUNDS):
        order = continued(order, known)
        new, move = _borne_out(order, known, wave, valid)
        if not new.any():
            break
        order, known = np.where(new, np.abs(order + move), order), known | new
    return order, known


def _borne_out(order: Array, known: Mask, wave: Array, valid: Mask) -> tuple[Mask, Array]:
    """Which continued orders the light bears out, and how far it moves them (rows, cols)."""
    import cv2

    near = cv2.boxFilter(known.astype(np.float32), -1, (3, 3), normalize=False) > _BESIDE - 0.5
    contrast, steep, _ = faded_fringes(order)
    angle = np.float32(2.0 * np.pi) * order
    sine = np.sin(angle)
    slope = np.float32(-2.0 * np.pi) * contrast * np.where(np.abs(sine) > _FLANK, sine, np.inf)
    move = (wave - contrast * np.cos(angle)) / slope
    told = (np.abs(sine) > _FLANK) & (np.abs(move) < _NEAR)
    return near & ~known & valid & is_wide(steep) & told, move
