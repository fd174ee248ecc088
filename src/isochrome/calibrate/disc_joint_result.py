"""From all images of a disc fitted together to their results, and a residual stress in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibrate.disc_joint import OWN, JointDisc
from isochrome.calibrate.result import ImageFit, View
from isochrome.fit.linear import scaled_inverse

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Residual:
    """A residual stress as found: the form's name, the order at the centre with no load, the
    largest in the part of the disc that is fitted and where (mm from the centre), fringes.
    """

    form: str
    centre_order: float
    largest_order: float
    largest_x_mm: float
    largest_z_mm: float

    def to_json(self) -> dict[str, Any]:
        """The fields by their names."""
        return dict(vars(self))


def residual_of(fit: JointDisc, diameter_mm: float) -> Residual:
    """Describe a fit's residual stress for a disc of `diameter_mm`."""
    picture, own = fit.pictures[0], fit.own[0]
    size = np.abs(fit.coefficients @ picture.basis)
    at = int(np.argmax(size))
    scale = 0.5 * diameter_mm / own[3]
    return Residual(
        fit.form.name,
        float(abs(_centre(fit)[0])),
        float(size[at]),
        float((picture.cols[at] - own[2]) * scale),
        float((picture.rows[at] - own[1]) * scale),
    )


def joint_images(
    fit: JointDisc, rim_radii: Sequence[float], diameter_mm: float
) -> tuple[tuple[ImageFit, ...], Array]:
    """The loaded images' results from a joint fit, and the covariance (m, m) of their orders.

    Parameters: `fit`; `rim_radii` (m,), the loaded images' rims as found, px; `diameter_mm`.
    """
    orders, covariance = centre_orders(fit)
    images: list[ImageFit] = []
    for i, picture in enumerate(fit.pictures):
        if not picture.loaded:
            continue
        place = len(images)
        _, row, col, radius, angle = (float(v) for v in fit.own[i])
        geometry = {
            "centre_row_px": row,
            "centre_col_px": col,
            "radius_px": radius,
            "rim_radius_px": float(rim_radii[place]),
            "load_angle_deg": float(np.degrees(angle)),
        }
        images.append(
            ImageFit(
                picture.shot.file, picture.shot.load_n, float(orders[place]),
                float(np.sqrt(covariance[place, place])), float(fit.chi[i]), None, geometry,
                _view(fit, i, 0.5 * diameter_mm / radius),
            )
        )  # fmt: skip
    return tuple(images), covariance


def centre_orders(fit: JointDisc) -> tuple[Array, Array]:
    """Order at the centre of each loaded image along the loads' directions, with its covariance.

    Parameters: `fit`. Returns the orders (m,), the residual's part included, and their covariance
    (m, m), chi above 1 included.
    """
    count, loaded = len(fit.own), np.array([p.loaded for p in fit.pictures])
    orders = fit.own[:, 0] + _centre(fit).real
    origin = fit.form.basis(np.zeros(1), np.zeros(1))[:, 0]
    linear = np.zeros((count, len(fit.normal)))
    linear[np.arange(count), OWN * np.arange(count)] = 1.0
    linear[:, OWN * count :] = (origin * _turn(fit)[:, None]).real
    covariance = scaled_inverse(fit.normal, 1e-14) * max(1.0, fit.cost / fit.pixels)
    linear = linear[loaded]
    return orders[loaded], linear @ covariance @ linear.T


def _turn(fit: JointDisc) -> NDArray[np.complex128]:
    """How the loads' directions at the centre see the residual in each image (n,)."""
    return np.ones(len(fit.own), dtype=complex) if fit.form.along else np.exp(2j * fit.own[:, 4])


def _centre(fit: JointDisc) -> NDArray[np.complex128]:
    """The residual at the centre as the loads' directions see it, each image (n,)."""
    return fit.form.at_centre(fit.coefficients) * _turn(fit)


def _view(fit: JointDisc, index: int, pixel_mm: float) -> View:
    picture, part = fit.pictures[index], fit.parts[index]
    keep, grid = picture.problem.keep, picture.grid
    rows, cols = grid.rows[:, 0].astype(int), grid.cols[0].astype(int)
    pick = np.ix_(rows, cols)
    image, residual = picture.shot.image[pick], np.full(keep.shape, np.nan)
    residual[keep] = part.residual * picture.shot.sigma[pick][keep]
    order = np.full(keep.shape, np.nan)
    order[keep] = fit.order(index)
    middle = int(np.argmin(np.abs(rows - fit.own[index, 1])))
    inside = keep[middle]
    spacing = pixel_mm * grid.step
    return View(
        image, image - residual, residual, float(np.median(picture.shot.sigma)),
        (spacing, spacing), (cols[inside] - fit.own[index, 2]) * pixel_mm, order[middle, inside],
        image[middle, inside], (image - residual)[middle, inside],
    )  # fmt: skip
