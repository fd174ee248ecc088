"""All images of a beam in the model of a whole set: see `calibration.whole_set`."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.beam.beam_edges import BeamPicture
from isochrome.calibration.beam.beam_fit import BeamFit, beam_order
from isochrome.calibration.beam.beam_misfit import BANDS, BENT, CERTAIN
from isochrome.calibration.result import ImageFit, View
from isochrome.calibration.whole_set.set_causes import free_set
from isochrome.calibration.whole_set.set_model import Kind, SetFit, SetModel
from isochrome.calibration.whole_set.set_result import image_chi, image_maps, jackknife
from isochrome.errors import PhysicsError

Array = NDArray[np.float64]

PIXELS = 30_000
"""Pixels of an image that are fitted with the whole set."""


def fit_beam_set(fits: Sequence[BeamFit], held: dict[str, float]) -> SetFit | None:
    """The whole set with what it asks for, None where it asks for nothing.

    Parameters: `fits`, each image's own or under one light; `held`, what the set states of the
    camera, by its keys.
    """
    first = fits[0]
    if any(f.shot.light.shape != first.shot.light.shape for f in fits):
        return None
    step = max(1, int(np.count_nonzero(first.mask) / PIXELS))
    masks = np.stack([f.mask[:, ::step] for f in fits])
    cols = first.pick[::step]
    model = SetModel(
        kind=beam_kind(first), shots=[f.shot for f in fits],
        rows=np.arange(len(first.shot.light)), cols=cols, masks=masks, held=held,
    )  # fmt: skip
    levels = np.array([np.median((f.best.illumination_map)[f.mask]) for f in fits])
    own = np.concatenate([f.best.values for f in fits])
    start = np.concatenate([own, np.log(levels[1:] / levels[0])])
    rival = float(np.sqrt(np.mean([f.best.chi**2 for f in fits])))
    return free_set(model, start, rival=rival)


def beam_kind(fit: BeamFit) -> Kind:
    """A beam's order by slope (fringe/px), row of N = 0 and tilt, see `beam_order`."""
    middle = 0.5 * (fit.shot.light.shape[1] - 1)
    scale = fit.view.scale
    return Kind(lambda own, rows, cols: beam_order(own, rows, cols - middle), 1e-4 * scale, scale)


def check_set_span(fit: SetFit) -> None:
    """Refuse a slope that changes along the span: see `beam_misfit.check_span`.

    A lens explains such a change as well, so that one as large as no bench has is not believed.
    Raises PhysicsError.
    """
    height, width = fit.model.shape
    along = {"camera.keystone_x": 1.0, "camera.distortion": width**2 / (width**2 + height**2)}
    for key, factor in along.items():
        value, spread = fit.shared.get(key, (0.0, 0.0))
        if factor * abs(value) > BENT and abs(value) > CERTAIN * spread:
            raise PhysicsError("fringes_slope_changes_along_half", value=factor * abs(value))


def beam_set_images(
    fit: SetFit, fits: Sequence[BeamFit], pixel_mm: float, *, doubtful: float
) -> tuple[list[ImageFit], Array]:
    """The images' results from a whole set's fit, and their orders' covariance (m, m).

    Parameters: `fits`, the images' own; `pixel_mm`; `doubtful`, the chi above which what is not
    described is looked at, as `beam_misfit` does.
    """
    own, count = fit.own, len(fits)
    half = 0.5 * fits[0].view.height_px
    orders = own[:, 0] * np.hypot(1.0, own[:, 2]) * half
    slopes = len(fit.model.kind.steps) * np.arange(count)
    covariance = fit.covariance[np.ix_(slopes, slopes)]
    covariance = covariance * np.outer(orders / own[:, 0], orders / own[:, 0])
    chi = [image_chi(fit, i) for i in range(count)]
    misfit = np.zeros(count)
    if max(chi) > doubtful:
        weights = np.zeros((count, len(fit.values)))
        weights[np.arange(count), slopes] = 1.0
        misfit = np.sqrt(jackknife(fit, _bands(fit, fits), weights)) / own[:, 0]
    images = [
        ImageFit(
            file=f.shot.name, load_n=f.shot.load_n, order=float(orders[i]),
            standard_uncertainty=float(np.sqrt(covariance[i, i])), chi=chi[i],
            geometry={
                "tilt_deg": float(np.degrees(np.arctan(-own[i, 2]))),
                "neutral_axis_row_px": float(own[i, 1]),
                "top_edge_row_px": f.view.top,
                "fringes_per_mm": float(orders[i] / half / pixel_mm),
            },
            view=_view(fit, i, pixel_mm), misfit=float(orders[i] * misfit[i]),
        )
        for i, f in enumerate(fits)
    ]  # fmt: skip
    return images, covariance


def _bands(fit: SetFit, fits: Sequence[BeamFit]) -> list[NDArray[np.intp]]:
    """The band of the height of each pixel, see `beam_misfit`."""
    result = []
    for image, own, f in zip(fit.model.images, fit.own, fits, strict=True):
        middle = 0.5 * (fit.model.shape[1] - 1)
        depth = image.rows - own[2] * (image.cols - middle) - f.view.top
        part = np.clip(depth / f.view.height_px, 0.0, 1.0 - 1e-9)
        result.append(np.floor(BANDS * part).astype(np.intp))
    return result


def _view(fit: SetFit, index: int, pixel_mm: float) -> View:
    model = fit.model
    maps = image_maps(fit, index)
    stride = float(model.cols[1] - model.cols[0]) if len(model.cols) > 1 else 1.0
    return View(
        **maps,
        sigma=float(np.median(model.shots[index].sigma)),
        cut=np.s_[:, len(model.cols) // 2],
        position_mm=(model.rows - fit.own[index, 1]) * pixel_mm,
        pixel_mm=(pixel_mm, pixel_mm * stride),
    )


def set_pictures(fit: SetFit, fits: Sequence[BeamFit]) -> list[BeamPicture]:
    """The images with their models beyond the beam as well, for the edges."""
    model = replace(fit.model, masks=np.ones_like(fit.model.masks), levels=None)
    point = model.at(fit.values)
    assert point is not None
    gamma, point = point.gamma, replace(point, gamma=1.0)
    table, _, shared = model.split(fit.values)
    pick, middle, result = np.ix_(model.rows, model.cols), 0.5 * (model.shape[1] - 1), []
    for i, (own, f) in enumerate(zip(table, fits, strict=True)):
        rows, cols = model.places(i, shared)
        shape = model.masks[i].shape
        depth = (rows - own[2] * (cols - middle)) / np.hypot(1.0, own[2])
        seen = fit.point.linear[0] @ point.columns(i) * model.images[i].sigma
        full = float(fit.model.images[i].level.max())
        seen = full * np.maximum(seen / full, 0.0) ** (1.0 / gamma)  # as the camera stored it
        result.append(
            BeamPicture(
                depth=depth.reshape(shape),
                light=f.shot.light[pick],
                model=seen.reshape(shape),
                valid=f.shot.valid[pick],
                sigma=float(np.median(f.shot.sigma)),
                middle=f.view.top / np.hypot(1.0, f.view.tilt) + 0.5 * f.view.height_px,
                height_px=f.view.height_px,
            )
        )
    return result
