"""All images of a disc in the model of a whole set: see `calibration.whole_set`."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.disc.disc_field import (
    DiscPixels,
    disc_image,
    disc_mask,
    disc_order,
    disc_view,
    thin_grid,
)
from isochrome.calibration.disc.disc_forms import own_unknowns
from isochrome.calibration.disc.disc_joint import LARGEST, OWN, STEPS
from isochrome.calibration.disc.disc_misfit import BLOCKS, block_of
from isochrome.calibration.disc.disc_rim import Circle
from isochrome.calibration.result import ImageFit
from isochrome.calibration.settings import Disc, Uncertainty
from isochrome.calibration.shot import Shot
from isochrome.calibration.whole_set.set_causes import free_set
from isochrome.calibration.whole_set.set_model import BLUR, Kind, SetFit, SetModel
from isochrome.calibration.whole_set.set_result import image_chi, image_maps, jackknife
from isochrome.errors import InputError
from isochrome.output import with_uncertainty

Array = NDArray[np.float64]

PIXELS = 40_000
"""Pixels of the square about the disc that are fitted with the whole set."""

_MOST_BLUR = 2.0 * np.pi**2 * 1.0**2
"""Largest blur that is described, as 2 pi² sigma² of one pixel: at two the value errs by 14 of its
uncertainties, though chi is 1.01."""

RIM_PX = 0.5
"""What a rim itself is uncertain by: a bevel, and how a point load's field fits to the disc's."""

CONTRADICTED, SLIGHT = 3.0, 0.01
"""Standard uncertainties by which the rim contradicts a diameter, and the least relative one."""


def fit_disc_set(
    shots: Sequence[Shot], images: Sequence[ImageFit], held: dict[str, float]
) -> SetFit | None:
    """The whole set with what it asks for, None where it asks for nothing.

    Parameters: `shots` (m,), loaded; `images`, their own fits; `held`, what the set states of the
    camera, by its keys.
    """
    if len({s.light.shape for s in shots}) > 1:
        return None
    own = own_unknowns(images)
    middle, radius = own[:, 1:3].mean(axis=0), float(own[:, 3].max())
    reach = radius + float(np.abs(own[:, 1:3] - middle).max())
    grid = thin_grid(
        shots[0].light.shape, Circle(float(middle[0]), float(middle[1]), reach, 0.0), PIXELS
    )
    masks = np.stack(
        [s.valid[grid.pick] & disc_mask(grid, o) for s, o in zip(shots, own, strict=True)]
    )
    model = SetModel(
        kind=disc_kind(radius), shots=shots, rows=grid.rows[:, 0].astype(np.intp),
        cols=grid.cols[0].astype(np.intp), masks=masks, held=held,
    )  # fmt: skip
    # each image's contrast, over that of its model
    levels = np.array([np.nanstd(i.view.model) if i.view else 1.0 for i in images])
    start = np.concatenate([own.ravel(), np.log(levels[1:] / levels[0])])
    whole = free_set(model, start, rival=pooled_chi(images))
    if whole is not None and whole.shared.get(BLUR, (0.0, 0.0))[0] > _MOST_BLUR:
        return None  # what it carries over the rim is in no model: light and lens would take it up
    return whole


def pooled_chi(images: Sequence[ImageFit]) -> float:
    """Residual over noise of all images."""
    return float(np.sqrt(np.mean([i.chi**2 for i in images])))


def disc_kind(radius: float) -> Kind:
    """A disc's order by centre order, row, column, radius and angle, see `disc_order`."""
    return Kind(
        lambda own, rows, cols: disc_order(DiscPixels(rows, cols, 1.0), own),
        STEPS,
        LARGEST * np.array([1.0, radius, radius, radius, 1.0]),
    )


def disc_set_images(
    fit: SetFit, rims: Sequence[float], diameter_mm: float
) -> tuple[list[ImageFit], Array]:
    """The images' results from a whole set's fit, and their orders' covariance (m, m).

    Parameters: `rims` (m,), their radii as found, px; `diameter_mm`.
    """
    model, own = fit.model, fit.own
    orders = OWN * np.arange(len(own))
    covariance = fit.covariance[np.ix_(orders, orders)]
    grid = DiscPixels(
        model.rows[:, None].astype(float), model.cols[None, :].astype(float),
        float(model.rows[1] - model.rows[0]),
    )  # fmt: skip
    images = []
    for i, (shot, values, rim) in enumerate(zip(model.shots, own, rims, strict=True)):
        maps = image_maps(fit, i)
        maps.pop("image")
        images.append(
            disc_image(
                shot, values, rim, spread=float(np.sqrt(covariance[i, i])), chi=image_chi(fit, i),
                view=disc_view(shot, grid, values, diameter_mm, **maps),
            )
        )  # fmt: skip
    return images, covariance


def set_misfit(fit: SetFit) -> float:
    """Part of the slope's relative uncertainty that noise does not explain: see `slope_misfit`."""
    loads = np.array([s.load_n for s in fit.model.shots])
    away = loads - (loads.mean() if np.unique(loads).size > 1 else 0.0)
    weights = np.zeros((1, len(fit.values)))
    weights[0, : OWN * len(loads) : OWN] = away / np.sum(away * loads)
    blocks = [
        block_of(image.rows, image.cols, values)
        for image, values in zip(fit.model.images, fit.own, strict=True)
    ]
    assert max(int(b.max()) for b in blocks) < BLOCKS
    slope = float(weights[0] @ fit.values)
    return float(np.sqrt(jackknife(fit, blocks, weights)[0]) / abs(slope))


def check_diameter(
    images: Sequence[ImageFit], disc: Disc, pixel_mm: float, uncertainty: Uncertainty | None
) -> None:
    """Refuse a diameter and a pixel size that the rim contradicts beyond their uncertainties.

    Raises InputError with both numbers.
    """
    radii = np.array([i.geometry["radius_px"] for i in images])
    seen, known = 2.0 * float(np.median(radii)), uncertainty or Uncertainty()
    own = float(np.hypot(2.0 * RIM_PX, 2.0 * np.ptp(radii)))
    stated = disc.diameter_mm / pixel_mm
    parts = (
        own / stated,
        (known.diameter_mm or 0.0) / disc.diameter_mm,
        (known.pixel_mm or 0.0) / pixel_mm,
    )
    spread, off = float(np.sqrt(np.sum(np.square(parts)))), abs(seen / stated - 1.0)
    if off > max(CONTRADICTED * spread, SLIGHT):
        raise InputError(
            "disc_px_wide_disc",
            with_uncertainty=with_uncertainty(seen, own),
            diameter_mm=disc.diameter_mm,
            pixel_mm=pixel_mm,
            stated=stated,
            off=off,
        )
