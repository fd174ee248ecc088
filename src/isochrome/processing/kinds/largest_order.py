"""The largest fringe order of a frame: as it was read, or where its pixels are missing, by a model.
The largest of many noisy ones lies above the truth by less than an uncertainty, as neighbours share
their noise."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.estimation import POOR_CHI
from isochrome.fitting import FrameFit, ModelFrame, SceneRenderer, propagated
from isochrome.fringes import BRANCH, OrderReading
from isochrome.messages import message
from isochrome.scene import Scene
from isochrome.simulation import make_picture, state_difference
from isochrome.specimens import specimen_model
from isochrome.stress import PixelGrid

Array = NDArray[Any]

ORDER_SPREAD = "order_uncertainty"
"""Column of the typical standard uncertainty of an order, of frames without a model."""

ORDER_FROM = "n_max_from"
FRAME, MODEL, AT_LEAST = "frame", "model", "at least"
"""Where the largest order is from, and its column: the last, where a larger one may be unread."""

LARGEST = ("n_max", "n_max_row_px", "n_max_col_px", "n_max_uncertainty", ORDER_FROM, ORDER_SPREAD)
LARGEST_BY_MODEL = ("n_max", "n_max_x_mm", "n_max_z_mm", "n_max_uncertainty", ORDER_FROM)
PRESSURE = ("p_max_mpa", "p_max_uncertainty_mpa")


def order_columns(order: Array, uncertainty: Array) -> dict[str, Any]:
    """Columns of the orders that are known: the largest, its pixel, and the median of their u."""
    known = uncertainty[np.isfinite(order) & np.isfinite(uncertainty)]
    typical = float(np.median(known)) if known.size else float("nan")
    result = dict.fromkeys(LARGEST) | {"n_max": float("nan"), ORDER_SPREAD: typical}
    if not np.isfinite(order).any():
        return result
    row, col = largest_pixel(order)
    result |= {"n_max": float(order[row, col]), "n_max_row_px": row, "n_max_col_px": col}
    result |= {"n_max_uncertainty": float(uncertainty[row, col])}
    return result | {ORDER_FROM: AT_LEAST if _beside_unread(order, row, col) else FRAME}


def largest_pixel(order: Array) -> tuple[int, int]:
    """Row and column of the largest order (rows, cols) that is known."""
    row, col = np.unravel_index(int(np.nanargmax(order)), order.shape)
    return int(row), int(col)


def _beside_unread(order: Array, row: int, col: int) -> bool:
    """Whether a pixel touches one that, as most about it, is not known: one alone hides no peak."""
    top, left = max(row - 2, 0), max(col - 2, 0)
    unread = np.pad(~np.isfinite(order[top : row + 3, left : col + 3]), 1)
    nine = np.lib.stride_tricks.sliding_window_view(unread, (3, 3))
    hidden = unread[1:-1, 1:-1] & (2 * nine.sum(axis=(2, 3)) > 9)
    down, right = row - top, col - left
    return bool(hidden[max(down - 1, 0) : down + 2, max(right - 1, 0) : right + 2].any())


def largest_with_model(
    reading: OrderReading, frame: ModelFrame, scene: Scene, fit: FrameFit | None = None
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Columns of the largest order and its place, and what is said of it: the model's, where it
    exceeds all that was read by more than u; not at a point load or an edge, of which it knows
    nothing. What the pixels within half a fringe of its peak say of it is in its uncertainty; where
    they contradict it, or none is read, it says nothing: a load that varies through the thickness
    has its peak left out as if dust were there."""
    order, nothing = reading.order, float("nan")
    result: dict[str, Any] = dict.fromkeys(LARGEST_BY_MODEL, nothing) | {ORDER_FROM: None}
    if not np.isfinite(order).any():
        return result, ()
    trusted = frame.picture.material & specimen_model(scene).trusted(scene, frame.pixels, 0.0)
    model = np.where(frame.picture.material, frame.picture.order, -np.inf)
    read = np.isfinite(order) & trusted
    peak, pixel = largest_pixel(model), largest_pixel(order)
    value, spread, top = order[pixel], reading.uncertainty[pixel], model[peak]
    near = read & (model > top - 2.0 * BRANCH)
    off, each = order[near] - model[near], reading.uncertainty[near]
    excess = max(np.mean(off**2 - each**2), 0.0) ** 0.5 if off.size else np.inf
    beyond = bool(trusted[peak] and top - np.max(model, where=read, initial=-np.inf) > spread)
    source, notes = AT_LEAST if _beside_unread(order, *pixel) else FRAME, tuple[str, ...]()
    if beyond and off.size and np.mean((off / each) ** 2) <= POOR_CHI**2:
        source, notes = MODEL, (message("pixels_largest_order_could"),)
    elif beyond:
        source, notes = AT_LEAST, (message("pixels_largest_order_could_not"),)
    values, spreads = np.full((2, 2), nothing)
    if fit is not None and (source == MODEL or scene.indenter is not None):
        values, spreads = _of_scene(fit, frame.pixels, peak)
    if source == MODEL:
        value, pixel, spread = top, peak, np.hypot(spreads[0], excess)
    if source != AT_LEAST:
        spread = np.hypot(spread, _between(frame.picture.order, *pixel))
    x, z = frame.pixels.place(*pixel)
    result |= {"n_max": float(value), "n_max_x_mm": x, "n_max_z_mm": z}
    result |= {"n_max_uncertainty": float(spread), ORDER_FROM: source}
    if len(values) > 1:
        also = np.hypot(spreads[1], values[1] * excess / top)
        result |= dict(zip(PRESSURE, (float(values[1]), float(also)), strict=True))
    return result, notes


def _between(order: Array, row: int, col: int) -> float:
    """How far an order (rows, cols) may rise beside its largest pixel's middle, fringes:
    -gᵀ H⁻¹ g/2 with the slopes g and curvatures H of the parabola through the pixel and its eight
    neighbours; beside an edge, half of how far it falls from there."""
    a = np.pad(order, 1, constant_values=np.nan)[row : row + 3, col : col + 3].astype(float)
    slope = 0.5 * np.array([a[2, 1] - a[0, 1], a[1, 2] - a[1, 0]])
    across = 0.25 * (a[2, 2] - a[2, 0] - a[0, 2] + a[0, 0])
    bend = np.array([
        [a[2, 1] - 2.0 * a[1, 1] + a[0, 1], across], [across, a[1, 2] - 2.0 * a[1, 1] + a[1, 0]],
    ])  # fmt: skip
    if np.isfinite(a).all() and np.linalg.det(bend) > 0.0:
        return float(-0.5 * slope @ np.linalg.solve(bend, slope))
    return 0.5 * float(a[1, 1] - np.nanmin(a[[0, 1, 1, 2], [1, 0, 2, 1]]))


def _of_scene(fit: FrameFit, pixels: PixelGrid, peak: tuple[int, int]) -> tuple[Array, Array]:
    """The model's order at its peak's pixel, of a contact its largest pressure; and their u."""
    solved = SceneRenderer(fit.scene, (pixels.rows, pixels.cols))
    x, z = pixels.place(*peak)
    left, top, pixel = pixels.left_mm, pixels.top_mm, pixels.pixel_mm

    def numbers(scene: Scene) -> Array:
        state, camera = solved.state(scene), scene.camera
        assert camera is not None and camera.pixel_mm is not None
        # the same pixel of a picture that stands elsewhere, or has another scale
        size = camera.pixel_mm
        at_x, at_z = (x - left) * size / pixel, (z - top) * size / pixel
        at_x += left if camera.left_mm is None else camera.left_mm
        at_z += top if camera.top_mm is None else camera.top_mm
        # of the side for which the surface is spaced: a point has no scale
        one = PixelGrid(1, 1, at_x - 0.5 * pixel, at_z - 0.5 * pixel, pixel)
        picture = make_picture(scene, state_difference(scene, state, one), one)
        more = [] if state.surface is None else [state.surface.p_max_mpa]
        return np.array([picture.order[0, 0], *more], dtype=float)

    return propagated(fit, numbers)
