"""Fringe skeletons: the centre lines of dark and bright fringes, to a fraction of a pixel.

Two roads: from an image signal alone, without a model (`skeletons`), and from a known map of the
fringe order (`order_contours`). Positions are (row, col) of pixel centres, dark field.

From an image, the signal f is smoothed with a Gaussian G, sharpened against the shift that
smoothing gives to curved and unevenly spaced fringes, g = G * (f - sigma²/2 ∇²f). With n the
eigenvector of the Hessian H of g for the larger |eigenvalue|, the line passes the pixel at the
offset t n, t = -(n·∇g) / (nᵀ H n), and is kept where it falls inside the pixel. A line must
somewhere reach a sigma² |nᵀHn| of 10 deviations of the image's own noise; it is followed down to
half of that. A second pass with three times the sigma, and 6 deviations, adds the wide fringes,
away from the lines of the first. Lines under 12 px, or three times the sigma, are dropped. Dark
lines lie below, bright ones above the middle of the signal's range. Source: Steger (1998), An
unbiased detector of curvilinear structures, IEEE TPAMI 20(2).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import InputError
from isochrome.fringes.ridges import (
    Floats,
    beside,
    line_pixels,
    line_points,
    linked,
    noise_gain,
    ridge_noise,
)
from isochrome.fringes.windows import Mask

Kind = Literal["dark", "bright"]

_PASSES = ((1.0, 10.0), (3.0, 6.0))  # smoothing in sigma_px, least strength in noise deviations
_FLOOR = 4e-4  # least strength of all: rounding of a noise-free image
_SHORTEST_PX = 12


@dataclass(frozen=True, eq=False)
class Skeleton:
    """One centre line of a fringe, its n points in order, in px counted at pixel centres."""

    kind: Kind  # what a dark field shows on the line
    rows: Floats
    cols: Floats
    order: float | None = None  # None: not known


def skeletons(signal: ArrayLike, *, sigma_px: float = 2.0) -> list[Skeleton]:
    """Centre lines of dark and bright fringes in a normalised dark field, longest first.

    For the method see the module; fringes closer than about 4 sigma_px are lost, NaN is not known.
    Where the order turns back between n and n + 1/2 the image has a crest that is no order line; it
    is returned too, as no image alone can tell. InputError where it is not 2-D or too small.
    """
    image = np.asarray(signal, dtype=np.float64)
    if not sigma_px >= 0.7:
        raise InputError(f"sigma_px = {sigma_px} for skeletons: give 0.7 or more")
    if image.ndim != 2 or min(image.shape) < 4 * sigma_px:
        raise InputError(
            f"a signal of shape {image.shape} for skeletons: give one 2-D image of at least "
            f"{int(np.ceil(4 * sigma_px))} pixels a side, or a smaller sigma_px"
        )
    if np.isfinite(image).sum() < _SHORTEST_PX:
        return []
    noise = ridge_noise(image)
    middle = 0.5 * float(np.sum(np.nanpercentile(image, (2.0, 98.0))))
    found: list[Skeleton] = []
    for factor, deviations in _PASSES:
        scale = factor * sigma_px
        if min(image.shape) < 4 * scale:
            break
        limit = max(deviations * noise * noise_gain(scale), _FLOOR)
        taken = beside(image.shape, [(f.rows, f.cols) for f in found], 2 * scale)
        found += _one_pass(image, scale, limit, max(_SHORTEST_PX, 3 * scale), middle, taken)
    return sorted(found, key=lambda each: -each.rows.size)


def order_contours(
    order: ArrayLike, levels: Iterable[float] | None = None, *, min_length_px: float = 0.0
) -> list[Skeleton]:
    """Lines of a known order map (NaN: not known) at whole (dark) and half (bright) orders.

    N is linear between pixel centres, which puts a line within N''/(8 N') px of its place (N', N''
    along the row or column that it crosses). `levels` are multiples of 1/2 (else InputError), by
    default all from 1/2: N = 0 is touched, not crossed, so it has no line. By level, with their
    order.
    """
    from skimage.measure import find_contours

    field = np.asarray(order, dtype=np.float64)
    if field.ndim != 2 or min(field.shape) < 2:
        raise InputError(f"a fringe-order map of shape {field.shape}: give 2-D, 2 x 2 or more")
    known = np.isfinite(field)
    if levels is None:
        highest = float(field[known].max()) if known.any() else 0.0
        levels = np.arange(0.5, highest + 1e-12, 0.5).tolist()
    found: list[Skeleton] = []
    for level in levels:
        twice = round(2.0 * level)
        if abs(2.0 * level - twice) > 1e-9:
            raise InputError(f"level {level} of a fringe order: give whole or half orders")
        kind: Kind = "bright" if twice % 2 else "dark"
        for line in find_contours(np.where(known, field, 0.0), float(level), mask=known):
            if np.hypot(*np.diff(line, axis=0).T).sum() >= min_length_px:
                found.append(Skeleton(kind, line[:, 0], line[:, 1], float(level)))
    return found


def skeleton_table(
    lines: Sequence[Skeleton],
    *,
    pixel_mm: float | None = None,
    left_mm: float = 0.0,
    top_mm: float = 0.0,
) -> dict[str, NDArray[Any]]:
    """Lines as the columns line, kind, order, row_px, col_px, x_mm, z_mm, one row a point.

    x = left + (col + 1/2) pixel, z = top + (row + 1/2) pixel, of the outer edges of the first
    column and row; NaN where order or scale is not known.
    """
    counts = [line.rows.size for line in lines]
    rows = np.concatenate([line.rows for line in lines] or [np.zeros(0)])
    cols = np.concatenate([line.cols for line in lines] or [np.zeros(0)])
    scale = np.nan if pixel_mm is None else pixel_mm
    orders = [np.nan if line.order is None else line.order for line in lines]
    return {
        "line": np.repeat(np.arange(len(lines)), counts),
        "kind": np.repeat(np.array([line.kind for line in lines], dtype="U6"), counts),
        "order": np.repeat(np.array(orders, dtype=float), counts),
        "row_px": rows,
        "col_px": cols,
        "x_mm": left_mm + (cols + 0.5) * scale,
        "z_mm": top_mm + (rows + 0.5) * scale,
    }


def _one_pass(
    image: Floats, scale: float, limit: float, min_length: float, middle: float, taken: Mask
) -> list[Skeleton]:
    """Find the lines at one smoothing, away from the pixels `taken` by an earlier pass."""
    strength, rows, cols, level = line_points(image, scale)
    strength[taken] = 0.0
    kinds: tuple[tuple[Kind, Floats], ...] = (
        ("dark", np.where(level < middle, strength, 0.0)),
        ("bright", np.where(level > middle, -strength, 0.0)),
    )
    return [
        Skeleton(kind, rows[line], cols[line])
        for kind, weight in kinds
        for line in linked(weight, limit, min_length)
    ]


_APART = 0.15
"""Fringes between a line and its half order: a crest that is no order line lies farther off."""

_MOST = 0.75
_KNOWN = 0.5


def number_lines(lines: Sequence[Skeleton], order: ArrayLike) -> list[Skeleton]:
    """Give fringe lines the half order that the reading (NaN: not known) has along them.

    k/2 nearest to the median of N along the line, where N is known on half of its points or more,
    and within 0.15 fringe of k/2 on three quarters of these; else the order is not known, as that
    of a crest where the order turns back.
    """
    field = np.asarray(order, dtype=np.float64)
    return [replace(line, order=_order_of(line, field)) for line in lines]


def _order_of(line: Skeleton, order: Floats) -> float | None:
    """The half order along a line, None where it is not known."""
    along = order[line_pixels(line.rows, line.cols, order.shape)]
    known = along[np.isfinite(along)]
    if known.size == 0 or known.size < _KNOWN * along.size:
        return None
    level = 0.5 * np.rint(2.0 * np.median(known))
    near = np.abs(known - level) < _APART
    return float(level) if near.mean() >= _MOST else None
