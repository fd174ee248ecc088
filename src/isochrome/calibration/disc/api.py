"""Material fringe value from a disc under diametral compression, see `calibration.whole_set`.

At the centre sigma1 - sigma2 = 8 P/(pi D d), so that N = (8/(pi D f_sigma)) P + N0: the thickness
d cancels, and an order N0 that stays at zero load (residual stress) does not touch the slope.

Elsewhere stress adds as a tensor. With D = (sx - sz) + 2i txz in fringes, the loads' part is
D_P = N (1 - rho^2)/(s^2 + 1)^2, s = x - iz in radii with z along the loads (Frocht 1948; see
`reference.bodies`), and the order is |D_P + D_0| with one residual field D_0 for all loads:
a polynomial, which holds what moulding, cutting and annealing leave, D_0 = (c2 r^2 + c4 r^4)
e^(2 i phi), and an even part; and a polynomial along the directions of the loads' own field, which
holds what creeps under them.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product, zip_longest
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibration.disc.disc_field import (
    FEWEST_LOADS,
    Circle,
    Complexes,
    Scan,
    choose_centre_orders,
    disc_geometry,
    disc_mask,
    disc_order,
    fit_rise,
    load_field,
    overlay,
    rise_with_load,
    scan_disc,
    thin_pixels,
)
from isochrome.calibration.order_line import (
    Input,
    calibration_of,
    check_order,
    check_stated_size,
    set_images,
    stated_values,
)
from isochrome.calibration.result import Calibration, ImageFit
from isochrome.calibration.settings import CalibrationSet, SetLike, load_set
from isochrome.calibration.shot import (
    EXPLAINED,
    FEWEST_FRINGES,
    PIXELS,
    RIM,
    Shot,
    calibrate_channels,
    unused,
)
from isochrome.calibration.whole_set import (
    Kind,
    SetFit,
    SetModel,
    SetPoint,
    alike_fits,
    best_first,
    fit_set,
)
from isochrome.errors import PhysicsError
from isochrome.estimation import ALIKE_CHI
from isochrome.messages import message

Array = NDArray[np.float64]


def fit_disc(shot: Shot, starts: Array) -> Array:
    """One image's centre order, centre, radius and load direction (5,), from `starts` (m, 5).
    PhysicsError for too low or ambiguous an order, or a fit that did not converge.
    """
    for rim, pixels in ((0.25, ROUGH_PIXELS), (RIM, PIXELS)):  # begun roughly
        model = disc_model([shot], starts[:1], {}, rim=rim, pixels=pixels)
        fits = best_first(model.fit(start) for start in starts)
        if not fits:
            raise PhysicsError("no_start_gives_positive")
        starts = np.array([fit.values for fit in fits])
    (best, *_), alike = alike_fits(fits)
    order, spread = float(best.values[0]), float(np.sqrt(best.covariance[0, 0]))
    if any(abs(m.values[0] - order) > 0.1 for m in alike):
        raise PhysicsError("two_centre_orders_near", name=shot.name, order=order)
    if not fits[0].explained:  # richer light would make up for fringes of another field
        part = fits[0].explained_share
        raise PhysicsError(
            "loaded_disc_fringes_explain", name=shot.name, explained=part, fewest_loads=FEWEST_LOADS
        )
    if order < FEWEST_FRINGES:
        raise PhysicsError("centre_order_too_low", name=shot.name, order=order)
    if not best.converged or spread > 0.2 * order:
        raise PhysicsError("fringes_could_not_fitted", name=shot.name)
    return best.values


DEGREE = 4
_POWERS = tuple((i, t - i) for t in range(DEGREE + 1) for i in range(t + 1))

_SIZE, _FALLS = 0.2, 0.8
"""Order of an even residual on usual discs, fringes, and what each degree more leaves of it."""

SIZES = np.tile([_SIZE * _FALLS ** (i + j) for i, j in _POWERS], 3)
"""Standard deviations (k,) of the members' amplitudes: along the loads, sx - sz, 2 txz."""


def residual_basis(x: Array, z: Array, turn: Complexes) -> Complexes:
    """Members (k, n) of a residual at `x`, `z` in radii, along the loads by `turn` (n,)."""
    real = _powers(x, z)
    return np.concatenate([real, turn * real, 1j * turn * real])


def _powers(x: Array, z: Array) -> Array:
    of_x, of_z = (np.vander(v, DEGREE + 1, increasing=True).T for v in (x, z))
    return np.stack([of_x[i] * of_z[j] for i, j in _POWERS])


def simple_residual(even: float, round_: float) -> Array:
    """Amplitudes (k,) of an even residual and an axisymmetric one, c2 r^2 e^(2 i phi)."""
    real, imaginary = np.zeros((2, len(_POWERS)))
    real[_POWERS.index((0, 0))] = even
    real[_POWERS.index((2, 0))], real[_POWERS.index((0, 2))] = round_, -round_
    imaginary[_POWERS.index((1, 1))] = 2.0 * round_
    return np.concatenate([np.zeros(len(_POWERS)), real, imaginary])


def total_order(unknowns: Array, amplitudes: Array, rows: Array, cols: Array) -> Complexes:
    """The order (n,) of loads and residual as a complex number in the loads' directions."""
    h, turn = load_field(rows, cols, unknowns[1:])
    powers = _powers(*_places(unknowns[1:], rows, cols))
    along, real, imaginary = amplitudes.reshape(3, -1) @ powers
    return np.asarray(unknowns[0] * h + along + turn * (real + 1j * imaginary))


def by_residual(unknowns: Array, amplitudes: Array, rows: Array, cols: Array) -> Array:
    """Derivatives (k, n) of the order by the residual's amplitudes; arguments as `total_order`."""
    _, turn = load_field(rows, cols, unknowns[1:])
    total = total_order(unknowns, amplitudes, rows, cols)
    direction = np.conj(total) / np.maximum(np.abs(total), 1e-12)
    return np.asarray((direction * residual_basis(*_places(unknowns[1:], rows, cols), turn)).real)


def _places(geometry: ArrayLike, rows: Array, cols: Array) -> tuple[Array, Array]:
    row, col, radius, _ = np.asarray(geometry, dtype=float)
    return (cols - col) / radius, (rows - row) / radius


ROUGH_PIXELS = 3_000
RADII = np.linspace(0.92, 1.01, 4)
ORDERS = np.linspace(-0.6, 0.6, 5)
REFINED = 4
"""Starts: pixels of the square about the disc; with a residual, radii over the least one found,
sizes in fringes, and how many are refined."""

RESIDUAL = "residual stress"

RESIDUAL_LOADS = 3
"""Different loads, zero among them, below which a residual field is not looked for."""

MOST_FRINGES, MOST_RADII = 0.3, 0.03
"""Largest moves of an image's own unknowns in one step; of the angle as much in rad."""


def fit_disc_set(images: Sequence[Shot], unknowns: Array, held: dict[str, float]) -> SetFit:
    """The fit of all `images`, the loaded ones (m) first, from `unknowns` (m, 5); where it is not
    explained, from starts with residual stress, with orders in proportion to the loads: a residual
    may have moved all single fits by a part of a fringe, but hardly their slope.
    """
    fit = fit_set(disc_model(images, unknowns, held), unknowns)
    if not len(fit.model.kind.besides[RESIDUAL]) or (fit.explained and fit.chi < ALIKE_CHI):
        return fit
    loads = np.array([shot.load_n for shot in images[: len(unknowns)]])
    begun, points = unknowns.copy(), list[SetPoint]()
    if np.unique(loads).size > 1:
        begun[:, 0] = np.polynomial.polynomial.polyfit(loads, unknowns[:, 0], 1)[1] * loads
    for factor in RADII:
        begun[:, 3] = factor * unknowns[:, 3].min()
        rough = disc_model(images, begun, {}, pixels=ROUGH_PIXELS)
        rough = replace(rough, apart=True, free=(RESIDUAL,))
        for even, round_ in product(ORDERS, ORDERS):
            point = rough.at(np.concatenate([begun.ravel(), simple_residual(even, round_)]))
            if point is not None and point.positive:
                points.append(point)
    points.sort(key=lambda point: point.cost / point.pixels)
    fits = [point.model.fit(point.values) for point in points[:REFINED]]
    if not fits:
        return fit
    start = min(fits, key=lambda fit: fit.chi)
    model = replace(disc_model(images, start.own, held), free=(RESIDUAL,))
    stressed = fit_set(model, start.values)
    return stressed if stressed.chi < fit.chi else fit


def disc_model(
    images: Sequence[Shot],
    unknowns: Array,
    held: dict[str, float],
    *,
    rim: float = RIM,
    pixels: int = PIXELS,
) -> SetModel:
    """The model of a disc's images where their unknowns (m, 5), of the loaded first, put it."""
    middle, radius = unknowns[:, 1:3].mean(axis=0), float(unknowns[:, 3].max())
    reach = radius + float(np.abs(unknowns[:, 1:3] - middle).max())
    circle = Circle(float(middle[0]), float(middle[1]), reach, 0.0)
    rows, cols = thin_pixels(images[0].light.shape, circle, pixels)
    masks = [
        shot.valid[np.ix_(rows, cols)] & disc_mask(place, rows, cols, within=1.0 - rim)
        for shot, place in zip_longest(images, unknowns, fillvalue=unknowns[0])
    ]

    def order(unknowns: Array, besides: dict[str, Array], rows: Array, cols: Array) -> Array:
        if RESIDUAL in besides and besides[RESIDUAL].any():
            return np.abs(total_order(unknowns, besides[RESIDUAL], rows, cols))
        return disc_order(unknowns, rows, cols)

    def by_besides(
        name: str, unknowns: Array, besides: dict[str, Array], rows: Array, cols: Array
    ) -> Array:
        return by_residual(unknowns, besides.get(name, np.zeros(len(SIZES))), rows, cols)

    # one load, or two, cannot tell a residual stress from the loads'
    several = len({shot.load_n for shot in images}) >= RESIDUAL_LOADS
    kind = Kind(
        besides={RESIDUAL: SIZES if several else SIZES[:0]}, order=order, by_besides=by_besides,
        largest=np.array([MOST_FRINGES, *[MOST_RADII * radius] * 3, MOST_RADII]),
        idle=lambda first, _: np.concatenate([[0.0], first[1:]]), idle_largest=np.zeros(0),
    )  # fmt: skip
    return SetModel(kind=kind, shots=images, rows=rows, cols=cols, masks=np.stack(masks), held=held)


def calibrate_disc(source: SetLike) -> Calibration:
    """Calibrate the material fringe value from images of a disc under diametral compression.

    The whole field of orders is fitted to each image; at the centre N = 8 P/(pi D f_sigma) under
    the load P. f_sigma is found from the line of the images' orders over their loads, free of
    residual stress, which stays at zero load.

    Parameters
    ----------
    source : str, Path, CalibrationSet or mapping
        A calibration set with [disc]: its TOML file, a CalibrationSet, or its tables as
        dictionaries, in which an [[image]]'s file, and the no-load frames, may be arrays.

    Returns
    -------
    Calibration
        The fringe value (N/mm per fringe) with its standard uncertainty; its order at zero load is
        at the centre.

    Raises
    ------
    InputError
        Where the set or a file is wrong.
    PhysicsError
        Where the images do not determine the value.

    Notes
    -----
    D is the disc's diameter (mm). Source: Dally & Riley (1991), Experimental Stress Analysis,
    section 12.2; Timoshenko & Goodier (1970), Theory of Elasticity, art. 41.

    Examples
    --------
    Half a minute:

    >>> import isochrome
    >>> from isochrome.samples import samples_path
    >>> isochrome.calibrate_disc(samples_path() / "disc" / "set.toml")  # doctest: +SKIP
    Calibration from 3 images of a disc
      fringe_value_n_per_mm  14.599 ± 0.044
      chi                    0.991
      order_at_zero_load     -0.000086 ± 0.000055
      1 warning: see .warnings
    """
    return calibrate_channels(load_set(source, specimen="disc"), disc_from_shots)


def disc_from_shots(shots: Sequence[Shot], given: CalibrationSet) -> Calibration:
    """`calibrate_disc` on a set's prepared images, one of which at least is loaded."""
    assert given.disc is not None
    diameter_mm = given.disc.diameter_mm
    factor = 8.0 / (np.pi * diameter_mm)
    inputs = (Input("diameter", given.uncertainty.diameter_mm, "mm", 1.0 / diameter_mm),)
    idle = [shot for shot in shots if not shot.load_n]
    loaded = [shot for shot in shots if shot.load_n]
    scans = [scan_disc(shot) for shot in loaded]
    orders = choose_centre_orders(scans, [shot.load_n for shot in loaded])
    starts = [scan.starts(order) for scan, order in zip(scans, orders, strict=True)]
    refused: PhysicsError | None = None
    try:
        unknowns = [fit_disc(s, start) for s, start in zip(loaded, starts, strict=True)]
    except PhysicsError as error:  # which residual stress may explain
        unknowns, refused = [start[0] for start in starts], error
    fit = fit_disc_set([*loaded, *idle], np.array(unknowns), stated_values(given))
    if refused is not None and not (RESIDUAL in fit.model.free and fit.explained):
        images, covariance = images_by_rise(loaded, scans, diameter_mm, refused)
        messages = [
            message("closed_form_disc_does"), *unused(idle, message("order_zero_load_from"))
        ]  # fmt: skip
        return calibration_of(
            "disc", images, factor, inputs, given,
            fit=None, covariance=covariance, messages=messages,
        )  # fmt: skip
    images, covariance = disc_images(fit, scans, given)
    return calibration_of(
        "disc", images, factor, inputs, given,
        fit=fit, covariance=covariance, residual=residual_of(fit, diameter_mm),
    )  # fmt: skip


def images_by_rise(
    shots: Sequence[Shot], scans: Sequence[Scan], diameter_mm: float, refused: PhysicsError
) -> tuple[list[ImageFit], Array]:
    """The images' orders from their rise with the load, and their covariance (m, m). Where it is
    not clear, raises what refused them; before that, loads that contradict clear orders of the
    images' own scans.
    """
    circles = [scan.circle for scan in scans]
    images = overlay(shots, circles)
    rise = rise_with_load(images)
    if rise is not None and rise.clear:
        return of_whole_orders(fit_rise(shots, circles, images, rise, diameter_mm))
    if all((scan.curve.min() / scan.smooth_chi) ** 2 < 1.0 - EXPLAINED for scan in scans):
        alone = choose_centre_orders(scans, [0.0] * len(scans))
        check_order([shot.load_n for shot in shots], alone, [shot.name for shot in shots])
    if rise is not None and rise.explained > EXPLAINED:
        raise PhysicsError("two_rises_explain", slope=rise.slope, rival=rise.rival)
    raise refused


def of_whole_orders(images: Sequence[ImageFit]) -> tuple[list[ImageFit], Array]:
    """Images whose orders may all be whole orders higher or lower, and the covariance (m, m) by
    that: what stays at zero load is as likely as a residual of usual size is at the centre.
    """
    loads, orders, spread = np.array(
        [(i.load_n, i.order, i.standard_uncertainty) for i in images]
    ).T
    centre = residual_basis(np.zeros(1), np.zeros(1), np.ones(1, complex)).real[:, 0]
    at_zero, others = np.polynomial.polynomial.polyfit(loads, orders, 1)[0], np.arange(-9, 10)
    chances = np.exp(-0.5 * ((at_zero + others) / np.linalg.norm(centre * SIZES)) ** 2)
    covariance = np.diag(spread**2) + chances @ others**2 / chances.sum()
    spreads = np.sqrt(np.diag(covariance)).tolist()
    return [
        replace(i, standard_uncertainty=u) for i, u in zip(images, spreads, strict=True)
    ], covariance


def disc_images(
    fit: SetFit, scans: Sequence[Scan], given: CalibrationSet
) -> tuple[list[ImageFit], Array]:
    """The loaded images' results, and their centre orders' covariance (m, m), along the loads with
    the residual's part. InputError where the rim contradicts the diameter and a stated pixel.
    """
    assert given.disc is not None
    model, unknowns, diameter_mm = fit.model, fit.own, given.disc.diameter_mm
    linear, places = np.zeros((len(unknowns), model.size)), []
    for i, (_, row, col, radius, angle) in enumerate(unknowns):
        linear[i, model.places[i][0]] = 1.0
        if RESIDUAL in model.free:  # each member at the centre, along the image's own loads
            centre = residual_basis(np.zeros(1), np.zeros(1), np.exp([2j * angle]))
            linear[i, model.places[RESIDUAL]] = centre.real[:, 0]
        pixel_mm = 0.5 * diameter_mm / radius
        cut = {
            "cut": np.s_[int(np.argmin(np.abs(model.rows - row))), :],
            "position_mm": (model.cols - col) * pixel_mm,
            "pixel_mm": (float(pixel_mm * (model.rows[1] - model.rows[0])),) * 2,
        }
        places.append((disc_geometry([row, col, radius, angle], scans[i].circle.radius), cut))
    if given.camera.pixel_mm is not None:
        diameters = 2.0 * unknowns[:, 3]
        check_stated_size(diameters, "diameter_mm", diameter_mm, given, "disc_px_wide_disc")
    return set_images(fit, linear, places)


def residual_of(fit: SetFit, diameter_mm: float) -> dict[str, Any] | None:
    """A fit's residual stress for `calibration.json`: the order at the centre, and the largest."""
    model = fit.model
    if RESIDUAL not in model.free:
        return None
    image, (_, *geometry) = model.images[0], fit.own[0]
    rows, cols = np.append(image.rows, geometry[0]), np.append(image.cols, geometry[1])
    x, z = _places(geometry, rows, cols)
    members = residual_basis(x, z, load_field(rows, cols, geometry)[1])
    size = np.abs(fit.values[model.places[RESIDUAL]] @ members)
    at = int(np.argmax(size[:-1]))
    return {
        "form": f"tensor, and along the loads, degree {DEGREE}",
        "centre_order": float(size[-1]),
        "largest_order": float(size[at]),
        "largest_x_mm": float(0.5 * diameter_mm * x[at]),
        "largest_z_mm": float(0.5 * diameter_mm * z[at]),
    }
