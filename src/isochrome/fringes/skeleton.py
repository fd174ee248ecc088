"""Fringe skeletons: the centre lines of dark and bright fringes, to a fraction of a pixel.

Two roads: from an image signal alone, without a model (`skeletons`), and from a known map of
the fringe order (`order_contours`). Positions are (row, col) of pixel centres, dark field.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import InputError
from isochrome.fringes import _ridges

Floats = NDArray[np.float64]
Kind = Literal["dark", "bright"]

_PASSES = ((1.0, 10.0), (3.0, 6.0))  # smoothing in sigma_px, least strength in noise deviations
_FLOOR = 4e-4  # least strength of all: rounding of a noise-free image


@dataclass(frozen=True, eq=False)
class Skeleton:
    """One centre line of a fringe: its points in order, as (row, col) of pixel centres.

    `kind` is "dark" or "bright" as a dark field shows it, `rows` and `cols` (n,) in px, `order`
    the fringe order on the line, None when it is not known.
    """

    kind: Kind
    rows: Floats
    cols: Floats
    order: float | None = None


def skeletons(
    signal: ArrayLike,
    *,
    sigma_px: float = 2.0,
    threshold: float | None = None,
    min_length_px: int = 12,
) -> list[Skeleton]:
    """Find the centre lines of dark and bright fringes in an image, without a model.

    The signal f is smoothed with a Gaussian G, sharpened against the shift that smoothing gives
    to curved and unevenly spaced fringes, g = G * (f - sigma²/2 ∇²f). With n the eigenvector of
    the Hessian H of g for the larger |eigenvalue|, the line passes the pixel at the offset
    t n,  t = -(n·∇g) / (nᵀ H n),  and is kept where it falls inside the pixel. A second pass with
    three times the sigma adds the wide fringes, away from the lines of the first.

    `signal` (row, col): normalised dark field, about 0..1, NaN = not known. `sigma_px`: width of
    G; fringes closer than about 4 sigma_px are lost. `threshold`: least sigma² |nᵀHn| (in signal
    units; a fringe of spacing s has 2 pi² sigma²/s²) that a line must reach somewhere; it is
    followed down to half of that. Default: 10 deviations of the image's own noise,
    6 in the second pass.
    `min_length_px`: shorter lines are dropped. Dark lines lie below, bright ones above the middle
    of the signal's range. Where the order turns back between n and n + 1/2 the image has a crest
    that is no order line; it is returned too, as no image alone can tell.

    Returns the lines, longest first. Raises InputError for an image that is not 2-D or too small.
    Source: Steger (1998), An unbiased detector of curvilinear structures, IEEE TPAMI 20(2).
    """
    image = np.asarray(signal, dtype=np.float64)
    _check_signal(image, sigma_px)
    if np.isfinite(image).sum() < min_length_px:
        return []
    noise = _ridges.estimate_noise(image)
    middle = 0.5 * float(np.sum(np.nanpercentile(image, (2.0, 98.0))))
    found: list[Skeleton] = []
    for factor, deviations in _PASSES:
        scale = factor * sigma_px
        if min(image.shape) < 4 * scale:
            break
        limit = threshold
        if limit is None:
            limit = max(deviations * noise * _ridges.noise_gain(scale), _FLOOR)
        taken = _ridges.beside(image.shape, [(f.rows, f.cols) for f in found], 2 * scale)
        found += _one_pass(image, scale, limit, max(min_length_px, 3 * scale), middle, taken)
    return sorted(found, key=lambda each: -each.rows.size)


def order_contours(
    order: ArrayLike, levels: Iterable[float] | None = None, *, min_length_px: float = 0.0
) -> list[Skeleton]:
    """Find the lines of a known fringe-order map at whole (dark) and half (bright) orders.

    `order` (row, col): fringe order N in fringes, NaN = not known. `levels`: multiples of 1/2;
    default: all from 1/2 up to the largest order (N = 0 is touched, not crossed, so it has no
    line). `min_length_px`: shorter lines, such as noise makes where N is level, are dropped. N is
    taken as linear between pixel centres, which puts a line within N''/(8 N') px of its place (N',
    N'' along the row or column that it crosses); a line ends where N is not known.

    Returns the lines by level, with their order; `skeleton_table` numbers them. Raises InputError
    for a map that is not 2-D or a level that is no multiple of 1/2.
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
) -> dict[str, NDArray]:
    """Lay lines out as columns for a CSV: line, kind, order, row_px, col_px, x_mm, z_mm.

    x = left + (col + 1/2) pixel,  z = top + (row + 1/2) pixel

    `pixel_mm`: edge of a pixel; `left_mm`, `top_mm`: outer edges of the first column and row.
    Returns equally long columns, one row a point; NaN where order or scale is not known.
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
    image: Floats,
    scale: float,
    limit: float,
    min_length: float,
    middle: float,
    taken: NDArray[np.bool_],
) -> list[Skeleton]:
    """Find the lines at one smoothing, away from the pixels `taken` by an earlier pass."""
    strength, rows, cols, level = _ridges.line_points(image, scale)
    strength[taken] = 0.0
    kinds: tuple[tuple[Kind, Floats], ...] = (
        ("dark", np.where(level < middle, strength, 0.0)),
        ("bright", np.where(level > middle, -strength, 0.0)),
    )
    return [
        Skeleton(kind, rows[line], cols[line])
        for kind, weight in kinds
        for line in _ridges.linked(weight, limit, min_length)
    ]


def _check_signal(image: Floats, sigma_px: float) -> None:
    """Refuse what no line can be found in."""
    if not sigma_px >= 0.7:
        raise InputError(f"sigma_px = {sigma_px} for skeletons: give 0.7 or more")
    if image.ndim != 2 or min(image.shape) < 4 * sigma_px:
        raise InputError(
            f"a signal of shape {image.shape} for skeletons: give one 2-D image of at least "
            f"{int(np.ceil(4 * sigma_px))} pixels a side, or a smaller sigma_px"
        )
