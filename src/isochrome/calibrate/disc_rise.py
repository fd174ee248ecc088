"""A disc that already holds stress: its centre order in each image from the rise with load.

Where the closed form plus smooth light does not describe the single images, their common rise
still gives the slope: the orders N_i at the centre are free, one an image, and so is the residual
order at every pixel (see `rise`). N_i are known up to a common constant, which the phase at the
centre gives up to a whole order.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from isochrome.calibrate.result import ImageFit, View
from isochrome.calibrate.rim import Circle
from isochrome.calibrate.rise import Overlay, Rise, pixel_waves
from isochrome.calibrate.shot import Shot

Array = NDArray[np.float64]

MEMORY_PX = 4.0
"""Pixels of a frame over which the overlaid images' noise and misfit are correlated, at least."""


def fit_rise(
    shots: Sequence[Shot],
    circles: Sequence[Circle],
    images: Overlay,
    rise: Rise,
    diameter_mm: float,
    *,
    bright: bool = False,
) -> tuple[ImageFit, ...]:
    """Fit every image's centre order with the residual order free at every pixel.

    Parameters: `shots`, their `circles` and `images`, laid over each other; `rise`, the start;
    `diameter_mm`; `bright`, for a bright field. Returns the ImageFits; the constant that they
    share is known up to a whole order, and chosen within half an order at zero load.
    """
    from scipy.optimize import least_squares

    used = images.used
    data = images.stack[:, used]
    first, count = rise.slope * images.loads, len(shots)

    def left(free: Array) -> Array:
        orders = np.concatenate([first[:1], free[: count - 1]])
        return pixel_waves(data, orders, images.field(*free[count - 1 :])[used])[0].ravel()

    start = np.concatenate([first[1:], [rise.angle, 1.0, 0.0, 0.0]])
    size = np.concatenate([np.full(count - 1, 0.1), [0.05, 0.01, 0.01, 0.01]])
    room = np.concatenate([np.full(count - 1, 1.0), [0.2, 0.06, 0.06, 0.06]])
    found = least_squares(left, start, x_scale=size, bounds=(start - room, start + room))
    orders = np.concatenate([first[:1], found.x[: count - 1]])
    angle, scale, z, x = found.x[count - 1 :]
    field = images.field(angle, scale, z, x)
    residual, waves = pixel_waves(data, orders, field[used])
    spread = np.sqrt(np.mean(residual**2, axis=1) * len(orders) / (len(orders) - 3))
    variance = np.diag(np.linalg.pinv(found.jac.T @ found.jac))[: count - 1]
    errors = MEMORY_PX * np.sqrt(np.concatenate([[variance.mean()], variance])) * spread.mean()
    offset = _centre_order(images, used, waves, bright)
    rest = np.polynomial.polynomial.polyfit(images.loads, orders + offset, 1)[0]
    orders = orders + offset - np.round(rest)
    fits = []
    for i, (shot, circle) in enumerate(zip(shots, circles, strict=True)):
        geometry = {
            "centre_row_px": circle.row + float(z) * circle.radius,
            "centre_col_px": circle.col + float(x) * circle.radius,
            "radius_px": float(scale) * circle.radius,
            "rim_radius_px": circle.radius,
            "load_angle_deg": float(np.degrees(angle)),
        }
        chi = float(spread[i] / np.median(shot.sigma))
        view = _view(shot, images, i, residual[i], field, used, float(orders[i]), diameter_mm)
        fits.append(
            ImageFit(
                shot.file, shot.load_n, float(orders[i]), float(errors[i]), chi, None, geometry,
                view,
            )
        )  # fmt: skip
    return tuple(fits)


def _centre_order(images: Overlay, used: NDArray[np.bool_], waves: Array, bright: bool) -> float:
    """Order at the centre beside N_i, from the phase: I ~ -cos 2 pi (h N_i + n) in a dark field."""
    near = np.hypot(images.x, images.z)[used] < 0.1
    a, b = waves[:, near].sum(axis=1) * (-1.0 if bright else 1.0)
    return float(np.arctan2(b, -a) / (2.0 * np.pi))


def _view(
    shot: Shot,
    images: Overlay,
    index: int,
    residual: Array,
    field: Array,
    used: NDArray[np.bool_],
    order: float,
    diameter_mm: float,
) -> View:
    left = np.full(field.shape, np.nan)
    left[used] = residual
    image, middle = images.stack[index], field.shape[0] // 2
    inside = used[middle]
    spacing = 0.5 * diameter_mm * float(images.x[0, 1] - images.x[0, 0])
    return View(
        image, image - left, left, float(np.median(shot.sigma)), (spacing, spacing),
        0.5 * diameter_mm * images.x[middle, inside], order * field[middle, inside],
        image[middle, inside], (image - left)[middle, inside],
    )  # fmt: skip
