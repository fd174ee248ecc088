"""One image of a beam in bending: the whole span by least squares on its intensities.

All images of a beam in the model of a whole set: see `calibration.whole_set`.

Material fringe value from four-point bending.

Between the inner rollers M = P (Lo - Li)/4 and sigma_x = M eta/I with I = d h^3/12, so that
N = sigma_x d/f_sigma = 12 M eta/(f_sigma h^3): the thickness d cancels. The order at the edge,
eta = h/2, rises with the load by k = 3 (Lo - Li)/(2 h^2 f_sigma) fringes per N.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibration.beam.beam_view import (
    FEWEST,
    BeamPicture,
    BeamView,
    check_beam_scale,
    edge_distance,
    find_beam,
)
from isochrome.calibration.order_line import (
    Input,
    ResidualOrder,
    uncertainty_budget,
    widened_to_held_out,
)
from isochrome.calibration.result import Calibration, ImageFit, View
from isochrome.calibration.settings import Beam, SetLike, Uncertainty, load_set
from isochrome.calibration.shot import Shot, by_load, calibrate_channels, unused
from isochrome.calibration.whole_set.set_fit import fit_set, plain_terms
from isochrome.calibration.whole_set.set_image import looked_at
from isochrome.calibration.whole_set.set_model import LENS, Kind, SetFit, SetModel
from isochrome.calibration.whole_set.set_result import (
    causes,
    image_chi,
    image_maps,
    sentences,
    stated_values,
)
from isochrome.errors import PhysicsError
from isochrome.estimation import ALIKE_CHI, IntensityFit, SeveralStarts, smooth_starts
from isochrome.messages import message
from isochrome.scene import Camera, Polariscope

Array = NDArray[np.float64]

START_PIXELS = 20_000
"""Pixels of an image from which the set starts."""

MARGINS = (0.1, 0.03, 0.03, 0.03)
"""Part of the height left out at each edge, where chamfers and blur are, in each round of the fit:
more at first, while the edges are known roughly."""

EDGE_REACH = 0.1
CLOSE_PX = 1.5
"""How far the edges may lie from the last guess, in heights, and how near is the same, in px."""

ODD = 400.0
"""Largest squared residual, in noise variances, that a pixel counts for in finding the edges."""

FAINTEST = 2.0
"""Standard deviation of the fringes' intensities, in noise sigmas, at the least."""


@dataclass(frozen=True)
class BeamFit:
    """A fitted image: `best.values` are slope (fringe/px), row of N = 0 and tilt (rows a column).

    `cols` (m,) are the columns that are fitted; the maps of `best` are (rows, m).
    """

    shot: Shot
    view: BeamView
    cols: Array
    best: IntensityFit

    @property
    def pick(self) -> NDArray[np.intp]:
        """The fitted columns as indices."""
        return self.cols.astype(np.intp)

    @property
    def mask(self) -> NDArray[np.bool_]:
        """The fitted pixels (rows, m)."""
        return np.isfinite(self.best.residual)

    @property
    def places(self) -> tuple[Array, Array]:
        """Rows (rows, 1), and columns from the frame's middle (1, m)."""
        rows, width = self.shot.light.shape
        return np.arange(rows, dtype=float)[:, None], (self.cols - 0.5 * (width - 1))[None, :]


def beam_order(params: ArrayLike, y: Array, x: Array) -> Array:
    """Order, with its sign, in pure bending: N = slope (y - row - tilt x).

    Parameters: `params` (3,), slope (fringe/px), row of N = 0 at x = 0, tilt (rows a column);
    `y`, `x` in pixels, x from the frame's middle.
    """
    slope, row, tilt = np.asarray(params, dtype=float)
    return np.asarray(slope * (y - row - tilt * x))


def beam_signal(order: Array, bright: bool) -> Array:
    """Ideal circular polariscope, 0..1: sin^2(pi N) in a dark field, cos^2(pi N) in a bright."""
    wave = np.cos(2.0 * np.pi * order)
    return 0.5 + 0.5 * wave if bright else 0.5 - 0.5 * wave


def fit_beam(shot: Shot, beam: Beam, pixel_mm: float) -> BeamFit:
    """Fit one image's whole span: slope across the height, neutral axis, tilt, illumination.

    Parameters: as in `bending_from_shots`. Returns the BeamFit. Raises PhysicsError for too few
    fringes, an ambiguous slope or a fit that did not converge.
    """
    view = find_beam(shot, beam.height_mm / pixel_mm)
    stride = max(1, int(np.ceil(shot.light.size / START_PIXELS)))
    cols = np.arange(stride // 2, shot.light.shape[1], stride, dtype=float)
    for margin in MARGINS:
        try:
            result = _fit(shot, view, cols, margin)
        except PhysicsError as error:  # every start turned the light negative
            raise _not_fitted(shot) from error
        fit = BeamFit(shot, view, cols, result.best)
        top = _refined_top(fit)
        if margin == MARGINS[-1] and abs(top - view.top) <= CLOSE_PX:
            break
        view = replace(view, top=top)
    _check(shot, result, min(view.height_px, float(shot.light.shape[0])))
    return fit


def _refined_top(fit: BeamFit) -> float:
    """The top edge's row for which fringes inside and an even level outside explain most.

    The first guess has the fringes' slope roughly only, and an edge of order 1 is as dark as what
    lies beyond it: a few rows of that would pull the fit.
    """
    (y, x), height_px = fit.places, fit.view.height_px
    row = np.rint(y - fit.view.tilt * x).astype(np.intp)
    low = int(row.min())
    depth = row - fit.view.top
    away = fit.shot.valid[:, fit.pick] & (
        (depth < -EDGE_REACH * height_px) | (depth > (1.0 + EDGE_REACH) * height_px)
    )
    valid = fit.shot.valid[:, fit.pick]
    image, sigma = fit.shot.light[:, fit.pick], fit.shot.sigma[:, fit.pick]
    outer = valid & ((depth < 0.0) | (depth > height_px))
    if np.count_nonzero(outer) < 0.01 * outer.size:
        return fit.view.top  # the beam fills the frame, and nothing lies beyond its edges
    level = float(np.median(image[away if away.any() else outer]))
    model = fit.best.model
    # what is neither fringes nor even counts little: a roller, a label, the bench behind
    outside, inside = (np.minimum(((image - m) / sigma) ** 2, ODD) for m in (level, model))
    gain = np.bincount((row - low)[valid], weights=(outside - inside)[valid])
    total = np.concatenate([[0.0], np.cumsum(gain)])
    near = fit.view.top + np.arange(-EDGE_REACH, EDGE_REACH, 1.0 / height_px) * height_px
    first = np.clip(np.rint(near - low).astype(np.intp), 0, gain.size)
    last = np.clip(np.rint(near - low + height_px).astype(np.intp), 0, gain.size)
    return float(near[int(np.argmax(total[last] - total[first]))])


def _fit(shot: Shot, view: BeamView, cols: Array, share: float) -> SeveralStarts:
    """Fit the fringes inside the beam, less a `share` of it at each edge, on the columns `cols`."""
    pick = cols.astype(int)
    y = np.arange(shot.light.shape[0], dtype=float)[:, None]
    x = (cols - 0.5 * (shot.light.shape[1] - 1))[None, :]
    margin = max(4.0, share * view.height_px)
    depth = y - view.tilt * x - view.top
    return smooth_starts(
        shot.light[:, pick], lambda params: beam_signal(beam_order(params, y, x), shot.bright),
        view.starts, light=shot.lamp(slice(None), pick),
        mask=shot.valid[:, pick] & (depth > margin) & (depth < view.height_px - margin),
        sigma=shot.sigma[:, pick], scale=view.scale, lower=[0.0, -np.inf, -0.3],
        upper=[0.5, np.inf, 0.3], scan_pixels=20_000,
    )  # fmt: skip


def _check(shot: Shot, found: SeveralStarts, seen_px: float) -> None:
    best = found.best
    slope = float(best.values[0])
    used = np.isfinite(best.residual)
    contrast = float(np.std((best.illumination_map * best.signal)[used]))
    if contrast < FAINTEST * float(np.median(shot.sigma)):
        raise PhysicsError("too_few_fringes_too", name=shot.name)
    if slope * seen_px < FEWEST or best.standard_uncertainty[0] > 0.2 * slope:
        raise PhysicsError("fringes_view_too_few", name=shot.name, seen_px=slope * seen_px)
    alike = [m for m in found.others if m.chi < ALIKE_CHI * best.chi]
    rivals = [m for m in alike if abs(m.values[0] / slope - 1) > 0.02]
    if rivals:
        raise PhysicsError(
            "two_fringe_slopes_explain", name=shot.name, chi=best.chi, chi_2=rivals[0].chi
        )
    if not (best.converged and best.positive):
        raise _not_fitted(shot)


def _not_fitted(shot: Shot) -> PhysicsError:
    return PhysicsError("fringes_not_those_pure", name=shot.name)


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
        besides=MOMENT, order=order,
        by_besides=lambda own, _, rows, cols: beam_order(own, rows, cols - middle) * along(cols),
        sizes=np.full(2, 0.5 * BENT), steps=1e-4 * fit.view.scale, largest=fit.view.scale,
        idle=idle, idle_steps=np.array([1e-4]),
    )  # fmt: skip


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


def calibrate_bending(source: SetLike) -> Calibration:
    """Calibrate the material fringe value from images of a beam in four-point bending.

    Between the inner loads the order grows linearly across the height, to N = 3 P (L_o - L_i)/(2 h²
    f_sigma) at the edge under the load P; f_sigma is found from the line of the images' orders over
    their loads, free of residual stress, which stays at zero load.

    Parameters
    ----------
    source : str, Path, CalibrationSet or mapping
        A calibration set with [beam]: its TOML file, a CalibrationSet, or its tables as
        dictionaries, in which an [[image]]'s file, and the no-load frames, may be arrays.

    Returns
    -------
    Calibration
        The fringe value (N/mm per fringe) with its standard uncertainty; its order at zero load is
        at the beam's edge.

    Raises
    ------
    InputError
        Where the set or a file is wrong.
    PhysicsError
        Where the images do not determine the value.

    Notes
    -----
    h is the beam's height and L_o, L_i are the outer and inner spans (mm). Source: Dally & Riley
    (1991), Experimental Stress Analysis, section 12.2; Timoshenko & Goodier (1970), Theory of
    Elasticity, art. 21.

    Examples
    --------
    Some ten seconds:

    >>> import isochrome
    >>> from isochrome.samples import samples_path
    >>> isochrome.calibrate_bending(samples_path() / "bending" / "set.toml")  # doctest: +SKIP
    Calibration from 4 images of a beam
      fringe_value_n_per_mm  14.600 ± 0.066
      chi                    0.996
      order_at_zero_load     0.04997 ± 0.00013
      1 warning: see .warnings
    """
    given = load_set(source, specimen="beam")
    beam, pixel_mm = given.beam, given.camera.pixel_mm
    assert beam is not None and pixel_mm is not None
    return calibrate_channels(
        given,
        lambda shots: bending_from_shots(
            shots, beam, pixel_mm, uncertainty=given.uncertainty, camera=given.camera,
            polariscope=given.polariscope,
        ),
    )  # fmt: skip


def bending_from_shots(
    shots: Sequence[Shot],
    beam: Beam,
    pixel_mm: float,
    *,
    uncertainty: Uncertainty | None = None,
    camera: Camera | None = None,
    polariscope: Polariscope | None = None,
) -> Calibration:
    """`calibrate_bending` on shots, see `as_shots`.

    Parameters
    ----------
    shots : sequence of Shot
        Prepared frames with their loads; one at least is loaded.
    beam : Beam
        The beam's sizes, mm.
    pixel_mm : float
        Size of a pixel, mm.
    uncertainty : Uncertainty, optional
        Standard uncertainties of the inputs.
    camera : Camera, optional
        What is known of the lens and the blur.
    polariscope : Polariscope, optional
        What is known of the light's wavelength and band.

    Returns
    -------
    Calibration
        The fringe value (N/mm per fringe) with its standard uncertainty.

    Raises
    ------
    InputError
        Where no shot has a load, or the beam's edges contradict its height and the pixel's size.
    PhysicsError
        Where the images do not determine the value.
    """
    loaded, idle = by_load(shots)
    scope = polariscope or Polariscope()
    fits = [fit_beam(shot, beam, pixel_mm) for shot in loaded]
    whole = fit_beam_set(fits, idle, stated_values(camera or Camera(), scope))
    check_span(whole)
    images, covariance, rest = beam_images(whole, fits, pixel_mm)
    outcome = causes(whole, scope.wavelength_nm)
    messages = (*sentences(whole, outcome), *moment_sentence(whole))
    if not rest:
        messages = (*messages, *unused(idle, message("because_light_not_loaded")))
    distance = edge_distance(set_pictures(whole, fits))
    if distance is not None:
        check_beam_scale(distance, beam, pixel_mm, uncertainty)
    arm = beam.outer_span_mm - beam.inner_span_mm
    factor = 1.5 * arm / beam.height_mm**2
    known = uncertainty or Uncertainty()
    inputs = (
        Input("load", known.load_percent, "%", 0.01),
        Input("height", known.height_mm, "mm", 3.0 / beam.height_mm),
        Input("spans", known.span_mm, "mm", float(np.sqrt(2.0)) / arm),
        Input("pixel scale", known.pixel_mm, "mm", 1.0 / pixel_mm),
        Input("thickness", known.thickness_mm, "mm", 0.0),
    )
    result = uncertainty_budget(
        "beam", images, factor, inputs, covariance=covariance, unloaded=rest, messages=messages
    )
    return widened_to_held_out(replace(result, causes=outcome))
