"""All images of a disc in the model of a whole set: see `calibration.whole_set`."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.disc.disc_field import (
    RIM_ZONE,
    DiscPixels,
    disc_image,
    disc_mask,
    disc_order,
    disc_view,
    thin_grid,
)
from isochrome.calibration.disc.disc_residual import (
    DEGREE,
    SIZES,
    by_residual,
    load_field,
    residual_at_centre,
    residual_basis,
    simple_residual,
    total_order,
)
from isochrome.calibration.disc.disc_rim import Circle
from isochrome.calibration.result import ImageFit
from isochrome.calibration.settings import Disc, Uncertainty
from isochrome.calibration.shot import Shot
from isochrome.calibration.whole_set.set_fit import fit_set
from isochrome.calibration.whole_set.set_model import BLUR, Kind, SetFit, SetModel
from isochrome.calibration.whole_set.set_result import image_chi, image_maps
from isochrome.errors import InputError
from isochrome.output import with_uncertainty

Array = NDArray[np.float64]

PIXELS = 40_000
"""Pixels of the square about the disc that are fitted with the whole set."""

ROUGH_PIXELS = 3_000
RADII = (0.92, 0.95, 0.98, 1.01)
ORDERS = (-0.6, -0.3, 0.0, 0.3, 0.6)
REFINED = 4
"""Starts with a residual: pixels of the square about the disc, radii over the least one found,
sizes in fringes, and how many are refined."""

BARELY = 1.05
"""Chi up to which the closed form is taken to describe the images without another start."""

_CLEAR_OF_RIM = 3.0
"""Blurs by which pixels stay off the rim: a Gaussian is nothing there."""

RESIDUAL = "residual stress"

FEWEST_LOADS = 3
"""Different loads, zero among them, below which a residual field is not looked for."""

OWN = 5
"""Unknowns of each image: centre order, row, column, radius, angle of the loads."""

STEPS = np.array([1e-4, 2e-3, 2e-3, 2e-3, 1e-5])
"""Steps of the differences in an image's own unknowns (fringes, px, rad)."""

LARGEST = np.array([0.3, 0.03, 0.03, 0.03, 0.05])
"""Largest move of an image's own unknowns in one step (fringes, radii, rad)."""

RIM_PX = 0.5
"""What a rim itself is uncertain by: a bevel, and how a point load's field fits to the disc's."""

CONTRADICTED, SLIGHT = 3.0, 0.01
"""Standard uncertainties by which the rim contradicts a diameter, and the least relative one."""


def fit_disc_set(
    shots: Sequence[Shot], idle: Sequence[Shot], own: Array, held: dict[str, float]
) -> SetFit:
    """The whole set with what it shows, from a start with residual stress where it asks for one.

    Parameters: `shots` (m,), loaded, `idle` (j,), unloaded; `own` (m, 5), where the loaded ones'
    unknowns start; `held`, what the set states of the camera, by its keys.
    """
    images = [*shots, *idle]
    fit = _fitted(disc_model(images, own, held), own, np.zeros(0))
    if not len(fit.model.kind.sizes) or (fit.explained and fit.chi < BARELY):
        return fit
    start = stressed_start(images, own)
    if start is None:
        return fit
    places, residual = start
    model = replace(disc_model(images, places, held), besides=True)
    stressed = _fitted(model, places, residual)
    return stressed if stressed.chi < fit.chi else fit


def _fitted(model: SetModel, own: Array, residual: Array) -> SetFit:
    """The whole set from where its unknowns start, kept off the rim by the blur that it shows."""
    contrast = np.array([np.std(image.light) for image in model.images[: len(own)]])
    exposures = np.zeros(model.exposures)
    exposures[: len(own) - 1] = np.log(contrast[1:] / contrast[0])
    fit = fit_set(model, np.concatenate([own.ravel(), exposures, residual]))
    blur_px = np.sqrt(fit.shared.get(BLUR, (0.0, 0.0))[0] / 2.0) / np.pi
    if _CLEAR_OF_RIM * blur_px <= RIM_ZONE * own[:, 3].min():
        return fit
    # what a blur carries over the rim is in no model
    inner = disc_model(model.shots, fit.own, model.held, blur_px=blur_px)
    wider = replace(inner, besides=fit.model.besides)
    return fit_set(wider, fit.model.carried(fit.values, wider))


def disc_model(
    images: Sequence[Shot],
    own: Array,
    held: dict[str, float],
    *,
    blur_px: float = 0.0,
    pixels: int = PIXELS,
) -> SetModel:
    """The model of images of a disc where their unknowns (m, 5) put it, the loaded ones first.

    Parameters: `blur_px`, which keeps off the rim; `pixels` of the square about the disc.
    """
    middle, radius = own[:, 1:3].mean(axis=0), float(own[:, 3].max())
    reach = radius + float(np.abs(own[:, 1:3] - middle).max())
    circle = Circle(float(middle[0]), float(middle[1]), reach, 0.0)
    grid = thin_grid(images[0].light.shape, circle, pixels)
    within = 1.0 - max(RIM_ZONE, _CLEAR_OF_RIM * blur_px / radius)
    places = [*own, *([own[0]] * (len(images) - len(own)))]
    masks = np.stack(
        [
            shot.valid[grid.pick] & disc_mask(grid, place, within=within)
            for shot, place in zip(images, places, strict=True)
        ]
    )
    several = len({shot.load_n for shot in images}) >= FEWEST_LOADS
    return SetModel(
        kind=disc_kind(radius, several), shots=images, rows=grid.rows[:, 0].astype(np.intp),
        cols=grid.cols[0].astype(np.intp), masks=masks, held=held,
    )  # fmt: skip


def stressed_start(images: Sequence[Shot], own: Array) -> tuple[Array, Array] | None:
    """Where images with residual stress start: their unknowns (m, 5) and its amplitudes (k,); None
    where no start has the fringes' contrast.

    Axisymmetric residuals and even ones, over radii and sizes, with orders in proportion to the
    loads: a residual may have moved all single fits by a part of a fringe, but hardly their slope.
    The best few are fitted on a few pixels, each image with its own light.
    """
    loads = np.array([shot.load_n for shot in images[: len(own)]])
    begun, scored = own.copy(), []
    if np.unique(loads).size > 1:
        begun[:, 0] = np.polynomial.polynomial.polyfit(loads, own[:, 0], 1)[1] * loads
    for factor in RADII:
        begun[:, 3] = factor * own[:, 3].min()
        model = replace(
            disc_model(images, begun, {}, pixels=ROUGH_PIXELS), apart=True, besides=True
        )
        for even, round_ in product(ORDERS, ORDERS):
            values = np.concatenate([begun.ravel(), simple_residual(even, round_)])
            point = model.at(values)
            if point is not None and point.positive:
                scored.append((point.cost / point.pixels, values, model))
    scored.sort(key=lambda item: item[0])
    fits = [model.fit(values) for _, values, model in scored[:REFINED]]
    if not fits:
        return None
    best = min(fits, key=lambda fit: fit.chi)
    return best.own, best.model.split(best.values)[1]


def disc_kind(radius: float, several_loads: bool) -> Kind:
    """A disc's order by centre order, row, column, radius and angle, see `disc_order`.

    Besides, its residual stress, which one load, or two, cannot tell from the loads'.
    """

    def order(own: Array, besides: Array, rows: Array, cols: Array) -> Array:
        if besides.any():
            return np.abs(total_order(own, besides, rows, cols))
        return disc_order(DiscPixels(rows, cols, 1.0), own)

    return Kind(
        besides=RESIDUAL,
        order=order,
        by_besides=by_residual,
        sizes=SIZES if several_loads else SIZES[:0],
        steps=STEPS,
        largest=LARGEST * np.array([1.0, radius, radius, radius, 1.0]),
        idle=lambda first, _: np.concatenate([[0.0], first[1:]]),
        idle_steps=np.zeros(0),
    )


def disc_images(
    fit: SetFit, rims: Sequence[float], diameter_mm: float
) -> tuple[list[ImageFit], Array]:
    """The loaded images' results from a whole set's fit, and their orders' covariance (m, m).

    The order at the centre is along the loads' directions, with the residual's part. Parameters:
    `rims` (m,), their radii as found, px; `diameter_mm`.
    """
    model, own = fit.model, fit.own
    _, amplitudes, _ = model.split(fit.values)
    linear = np.zeros((len(own), model.size))
    linear[np.arange(len(own)), OWN * np.arange(len(own))] = 1.0
    orders = own[:, 0].copy()
    if model.besides:
        seen = np.array([residual_at_centre(values) for values in own])
        linear[:, model.besides_places] = seen
        orders += seen @ amplitudes
    covariance = linear @ fit.covariance @ linear.T
    grid = DiscPixels(
        model.rows[:, None].astype(float), model.cols[None, :].astype(float),
        float(model.rows[1] - model.rows[0]),
    )  # fmt: skip
    images = []
    for i, (values, rim) in enumerate(zip(own, rims, strict=True)):
        maps = image_maps(fit, i)
        maps.pop("image")
        images.append(
            disc_image(
                model.shots[i], [orders[i], *values[1:]], rim,
                spread=float(np.sqrt(covariance[i, i])), chi=image_chi(fit, i),
                view=disc_view(model.shots[i], grid, values, diameter_mm, **maps),
            )
        )  # fmt: skip
    return images, covariance


def residual_of(fit: SetFit, diameter_mm: float) -> dict[str, Any] | None:
    """A fit's residual stress, for a disc of `diameter_mm`, for `calibration.json`; None for none.

    The order at the centre with no load, the largest in the part of the disc that is fitted and
    where (mm from the centre), fringes.
    """
    model = fit.model
    if not model.besides:
        return None
    image, own = model.images[0], fit.own[0]
    _, row, col, radius, _ = own
    x, z = (np.append(v, 0.0) for v in ((image.cols - col) / radius, (image.rows - row) / radius))
    _, turn = load_field(np.append(image.rows, row), np.append(image.cols, col), own[1:])
    size = np.abs(model.split(fit.values)[1] @ residual_basis(x, z, turn))
    at = int(np.argmax(size[:-1]))
    return {
        "form": f"tensor, and along the loads, degree {DEGREE}",
        "centre_order": float(size[-1]),
        "largest_order": float(size[at]),
        "largest_x_mm": float(0.5 * diameter_mm * x[at]),
        "largest_z_mm": float(0.5 * diameter_mm * z[at]),
    }


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
