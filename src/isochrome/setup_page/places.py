"""From points on the picture to values of the scene, and back.

Rows and columns are px with pixel centres at whole numbers. Those of the page are of the whole
picture; a scene's known orders and its mask are counted in its region of interest.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from isochrome.errors import InputError
from isochrome.stress import PixelGrid

Point = tuple[float, float]
"""A place as (row, col), px."""

_PASSES = 8
"""Newton's steps to the pixel that looks at a place: with |k| <= 0.1 five leave 1e-9 px."""

_NEAREST_PX = 2.0
"""Points nearer than this are one: half a pixel of each would be a quarter of the scale."""


def pixel_scale(first: Point, second: Point, length_mm: float) -> float:
    """Side of a pixel, mm, from two points (row, col) a known length apart; InputError for none."""
    apart = math.hypot(second[0] - first[0], second[1] - first[1])
    if not apart >= _NEAREST_PX:
        raise InputError("two_points_scale_px", apart=apart, nearest_px=_NEAREST_PX)
    if not 0.0 < length_mm < math.inf:
        raise InputError("length_mm_give_distance", length_mm=length_mm)
    return length_mm / apart


def place_of_point(pixels: PixelGrid, point: Point) -> tuple[float, float]:
    """The place x, z, mm, that a point (row, col) of the region looks at, also beyond its edges."""
    row, col = point
    x = pixels.left_mm + (col + 0.5) * pixels.pixel_mm
    z = pixels.top_mm + (row + 0.5) * pixels.pixel_mm
    lens = pixels.lens
    if lens is None:
        return x, z
    middle = pixels.left_mm + lens.right_mm, pixels.top_mm + lens.down_mm
    right, down = lens.looked_at(np.array([x - middle[0]]), np.array([z - middle[1]]))
    return float(right[0]) + middle[0], float(down[0]) + middle[1]


def seen_at(pixels: PixelGrid, x_mm: float, z_mm: float) -> Point:
    """The point (row, col) of the region that looks at a place."""
    unit = pixels.pixel_mm
    row, col = (z_mm - pixels.top_mm) / unit - 0.5, (x_mm - pixels.left_mm) / unit - 0.5
    for _ in range(_PASSES if pixels.lens is not None else 0):
        x, z = place_of_point(pixels, (row, col))
        right, below = (place_of_point(pixels, at) for at in ((row, col + 1.0), (row + 1.0, col)))
        slopes = np.array([[right[0] - x, below[0] - x], [right[1] - z, below[1] - z]])
        across, down = np.linalg.solve(slopes, [x_mm - x, z_mm - z])
        row, col = row + float(down), col + float(across)
    return row, col


def placed_at(pixels: PixelGrid, point: Point) -> tuple[float, float]:
    """The outer edges left_mm and top_mm for which a point (row, col) looks at x = z = 0.

    That is the middle of the contact on the surface, or the top of a disc, ring or beam. How the
    pixels look stays, only their edges move.
    """
    x, z = place_of_point(pixels, point)
    return pixels.left_mm - x, pixels.top_mm - z


def surface_roll(first: Point, second: Point) -> float:
    """The camera's roll, degrees counter-clockwise, from two points (row, col) on the surface.

    InputError where they are one above the other, or the surface is turned by over 45 degrees.
    """
    first_end, second_end = sorted((first, second), key=lambda point: point[1])
    across, down = second_end[1] - first_end[1], second_end[0] - first_end[0]
    if across < _NEAREST_PX or abs(down) > across:
        raise InputError("two_points_surface_lie")
    # a picture that is turned counter-clockwise has the right end of the surface higher
    return math.degrees(math.atan2(-down, across)) + 0.0


def on_line(first: Point, second: Point, col: float) -> float:
    """The row at a column of the straight line through two points (row, col), px."""
    share = (col - first[1]) / (second[1] - first[1])
    return first[0] + share * (second[0] - first[0])


def moved(points: Sequence[Sequence[float]], down: float, right: float) -> list[list[float]]:
    """Points (row, col) moved by px, rounded to a hundredth, such as from the picture to its
    region.
    """
    return [[round(row + down, 2), round(col + right, 2)] for row, col in points]


def cut_out(pixels: PixelGrid, rows: int, cols: int) -> PixelGrid:
    """Pixels of another size with the same left and top edge; a lens looks from the new middle."""
    if pixels.lens is None:
        return replace(pixels, rows=rows, cols=cols)
    width, height = 0.5 * cols * pixels.pixel_mm, 0.5 * rows * pixels.pixel_mm
    lens = replace(
        pixels.lens, right_mm=width, down_mm=height, half_width_mm=width, half_height_mm=height
    )
    return replace(pixels, rows=rows, cols=cols, lens=lens)


def round_by_spread(value: float, spread: float) -> float:
    """Round a value two digits beyond the first of its standard uncertainty."""
    if not (np.isfinite(spread) and spread > 0.0):
        return value
    return float(np.round(value, max(0, 2 - int(np.floor(np.log10(spread))))))
