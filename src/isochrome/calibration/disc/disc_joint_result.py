"""From all images of a disc fitted together to their results, and a residual stress in words."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.disc.disc_field import disc_image, disc_view
from isochrome.calibration.disc.disc_joint import OWN, JointDisc
from isochrome.calibration.result import ImageFit, View
from isochrome.estimation import scaled_inverse

Array = NDArray[np.float64]


def residual_of(fit: JointDisc, diameter_mm: float) -> dict[str, Any]:
    """A fit's residual stress, for a disc of `diameter_mm`, for `calibration.json`.

    The form's name, the order at the centre with no load, the largest in the part of the disc that
    is fitted and where (mm from the centre), fringes.
    """
    picture, own = fit.pictures[0], fit.own[0]
    size = np.abs(fit.coefficients @ picture.basis)
    at = int(np.argmax(size))
    scale = 0.5 * diameter_mm / own[3]
    return {
        "form": fit.form.name,
        "centre_order": float(abs(_centre(fit)[0])),
        "largest_order": float(size[at]),
        "largest_x_mm": float((picture.cols[at] - own[2]) * scale),
        "largest_z_mm": float((picture.rows[at] - own[1]) * scale),
    }


def joint_images(
    fit: JointDisc, rim_radii: Sequence[float], diameter_mm: float
) -> tuple[tuple[ImageFit, ...], Array]:
    """The loaded images' results from a joint fit, and the covariance (m, m) of their orders.

    Parameters: `fit`; `rim_radii` (m,), the loaded images' rims as found, px; `diameter_mm`.
    """
    orders, covariance = centre_orders(fit)
    loaded = [i for i, picture in enumerate(fit.pictures) if picture.loaded]
    images = tuple(
        disc_image(
            fit.pictures[i].shot,
            [order, *fit.own[i, 1:]],
            rim,
            spread=float(np.sqrt(variance)),
            chi=float(fit.chi[i]),
            view=_view(fit, i, diameter_mm),
        )
        for i, order, rim, variance in zip(
            loaded, orders, rim_radii, np.diag(covariance), strict=True
        )
    )
    return images, covariance


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


def _view(fit: JointDisc, index: int, diameter_mm: float) -> View:
    picture, own = fit.pictures[index], fit.own[index]
    keep, grid, shot = picture.problem.keep, picture.grid, picture.shot
    residual, order = np.full((2, *keep.shape), np.nan)
    residual[keep] = fit.parts[index].residual * shot.sigma[grid.pick][keep]
    order[keep] = np.abs(picture.field(own, fit.coefficients)[1])
    model = shot.light[grid.pick] - residual
    return disc_view(shot, grid, own, diameter_mm, model=model, residual=residual, order=order)
