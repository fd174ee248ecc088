"""All images of a beam in the model of a whole set: see `calibration.whole_set`."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.beam.beam_edges import BeamPicture
from isochrome.calibration.beam.beam_fit import BeamFit, beam_order
from isochrome.calibration.order_line import ResidualOrder
from isochrome.calibration.result import ImageFit, View
from isochrome.calibration.shot import Shot
from isochrome.calibration.whole_set.set_fit import fit_set, plain_terms
from isochrome.calibration.whole_set.set_image import looked_at
from isochrome.calibration.whole_set.set_model import LENS, Kind, SetFit, SetModel
from isochrome.calibration.whole_set.set_result import image_chi, image_maps
from isochrome.errors import PhysicsError
from isochrome.messages import message

Array = NDArray[np.float64]

PIXELS = 40_000
"""Pixels of an image that are fitted with the whole set."""

MOMENT = "a moment that changes along the beam"

BENT = 0.02
"""Change of the slope along the span, to either side, that is no pure bending."""

CERTAIN = 6.0
"""Standard uncertainties by which it must be there."""


def fit_beam_set(fits: Sequence[BeamFit], idle: Sequence[Shot], held: dict[str, float]) -> SetFit:
    """The whole set with what it shows.

    Parameters: `fits`, each loaded image's own; `idle`, the unloaded ones; `held`, what the set
    states of the camera, by its keys.
    """
    first = fits[0]
    step = max(1, int(np.count_nonzero(first.mask) / PIXELS))
    cols = first.pick[::step]
    masks = [f.mask[:, ::step] for f in fits]
    common = np.logical_and.reduce(masks)
    masks += [common & shot.valid[:, cols] for shot in idle]
    model = SetModel(
        kind=beam_kind(first), shots=[*(f.shot for f in fits), *idle],
        rows=np.arange(len(first.shot.light)), cols=cols, masks=np.stack(masks), held=held,
    )  # fmt: skip
    levels = np.array([np.median((f.best.illumination_map)[f.mask]) for f in fits])
    own = np.concatenate([f.best.values for f in fits])
    exposures = np.log(levels[1:] / levels[0])
    return fit_set(
        model, np.concatenate([own, np.zeros(len(idle)), exposures, np.zeros(len(idle))])
    )


def beam_kind(fit: BeamFit) -> Kind:
    """A beam's order by slope (fringe/px), row of N = 0 and tilt, see `beam_order`.

    Besides, the moment's factor 1 + c1 t + c2 (t^2 - 1/3) along the span, t = -1..1 over the frame.
    An unloaded image's own unknown is its squared order at the edge.
    """
    width = fit.shot.light.shape[1]
    middle, half = 0.5 * (width - 1), 0.5 * fit.view.height_px

    def along(cols: Array) -> Array:
        t = (cols - middle) / (0.5 * width)
        return np.stack([t, t * t - 1.0 / 3.0])

    def order(own: Array, besides: Array, rows: Array, cols: Array) -> Array:
        pure = beam_order(own, rows, cols - middle)
        return pure * (1.0 + besides @ along(cols)) if besides.any() else pure

    def idle(first: Array, square: Array) -> Array:
        _, row, tilt = first
        slope = np.sqrt(np.abs(square[0])) / (half * np.hypot(1.0, tilt))
        return np.array([slope, row, tilt])

    return Kind(
        besides=MOMENT,
        order=order,
        by_besides=lambda own, _, rows, cols: beam_order(own, rows, cols - middle) * along(cols),
        sizes=np.full(2, 0.5 * BENT),
        steps=1e-4 * fit.view.scale,
        largest=fit.view.scale,
        idle=idle,
        idle_steps=np.array([1e-4]),
    )


def moment_sentence(fit: SetFit) -> tuple[str, ...]:
    """Say that the moment changes along the beam, where that was fitted."""
    if not fit.model.besides:
        return ()
    linear, square = fit.values[fit.model.besides_places]
    change = 100.0 * max(abs(linear + square), abs(linear - square))
    return (message("moment_changes_along_beam", change=change),)


def check_span(fit: SetFit) -> None:
    """Refuse a slope that changes along the span: there is shear, and no pure bending.

    A lens explains such a change as well, so that one as large as no bench has is not believed.
    Raises PhysicsError; also where pure bending explains little of the images.
    """
    if not fit.explained:
        raise PhysicsError("fringes_not_those_pure", name=fit.model.shots[0].name)
    change, step = _change_along(fit.model, fit.values), 1e-6
    rows = [
        (_change_along(fit.model, fit.values + step * unit) - change) / step
        for unit in np.eye(fit.model.size)
    ]
    spread = np.sqrt(np.einsum("pk,pq,qk->k", rows, fit.covariance, rows))
    if np.any((np.abs(change) > BENT) & (np.abs(change) > CERTAIN * spread)):
        raise PhysicsError("fringes_slope_changes_along_half", value=float(np.abs(change).max()))


def _change_along(model: SetModel, values: Array) -> Array:
    """By how much the first image's slope at the picture's left and right is above that at its
    middle (2,), as seen through the lens.
    """
    own, _ = model.unknowns_of(0, values)
    _, besides, shared = model.split(values)
    height, width = model.shape
    cols = np.tile(np.array([0.0, 0.5, 1.0]) * (width - 1), 2)
    rows = np.repeat(np.array([0.4, 0.6]) * (height - 1), 3)
    lens = {key: shared[key] for key in LENS}
    orders = model.kind.order(own, besides, *looked_at(rows, cols, model.shape, lens))
    slopes = orders[3:] - orders[:3]
    return np.asarray(slopes[[0, 2]] / slopes[1] - 1.0)


def beam_images(
    fit: SetFit, fits: Sequence[BeamFit], pixel_mm: float
) -> tuple[list[ImageFit], Array, tuple[ResidualOrder, ...]]:
    """The images' results from a whole set's fit, their orders' covariance (m, m), and what the
    unloaded images show where their light is the others'.

    Parameters: `fits`, the images' own; `pixel_mm`.
    """
    own, count = fit.own, len(fits)
    half = 0.5 * fits[0].view.height_px
    factor = np.hypot(1.0, own[:, 2]) * half
    orders = own[:, 0] * factor
    slopes = len(fit.model.kind.steps) * np.arange(count)
    covariance = fit.covariance[np.ix_(slopes, slopes)] * np.outer(factor, factor)
    images = [
        ImageFit(
            file=f.shot.name, load_n=f.shot.load_n, order=float(orders[i]),
            standard_uncertainty=float(np.sqrt(covariance[i, i])), chi=image_chi(fit, i),
            geometry={
                "tilt_deg": float(np.degrees(np.arctan(-own[i, 2]))),
                "neutral_axis_row_px": float(own[i, 1]),
                "top_edge_row_px": f.view.top,
                "fringes_per_mm": float(orders[i] / half / pixel_mm),
            },
            view=_view(fit, i, pixel_mm),
        )
        for i, f in enumerate(fits)
    ]  # fmt: skip
    rest = []
    same = not (fit.model.exposures or fit.model.apart)
    for index in range(count, len(fit.model.shots) if same else 0):
        (place,) = fit.model.own_places(index)
        spread = float(np.sqrt(fit.covariance[place, place]))
        name = fit.model.shots[index].name
        rest.append(ResidualOrder(name, float(fit.values[place]), spread))
    return images, covariance, tuple(rest)


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
    """The loaded images with their models beyond the beam as well, for the edges.

    With light of the first products: of many the sum goes anywhere where none was fitted.
    """
    plain = replace(fit.model, terms=plain_terms(fit.model), weights=None)
    inside = plain.at(fit.values)
    model = replace(plain, masks=np.ones_like(plain.masks), levels=None)
    point = model.at(fit.values)
    assert inside is not None and point is not None
    gamma, point = point.gamma, replace(point, gamma=1.0)
    shared = model.split(fit.values)[2]
    pick, middle, result = np.ix_(model.rows, model.cols), 0.5 * (model.shape[1] - 1), []
    for i, (own, f) in enumerate(zip(fit.own, fits, strict=True)):
        rows, cols = model.places(i, shared)
        shape = model.masks[i].shape
        depth = (rows - own[2] * (cols - middle)) / np.hypot(1.0, own[2])
        light = inside.linear[0][model.coefficients_of(i)]
        seen = light @ point.columns(i) * model.images[i].sigma
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
