"""Material fringe value from images of a beam in four-point bending, see `calibration.whole_set`.

Between the inner rollers M = P (Lo - Li)/4 and sigma_x = M eta/I with I = d h^3/12, so that
N = sigma_x d/f_sigma = 12 M eta/(f_sigma h^3): the thickness d cancels. The order at the edge,
eta = h/2, rises with the load by k = 3 (Lo - Li)/(2 h^2 f_sigma) fringes per N.

Where the beam lies in a frame, and a first guess of its fringes, is told from a profile over its
height: N rises linearly across it, so that the intensity along it is a sinusoid with one frequency,
the slope |dN/dy|; outside the beam there is none. A spectral scan with a window of the beam's known
height finds both together. The fringes alone cannot tell a wrong pixel scale: the slope of the
order over pixels stays as it is. Where both edges are in view, their distance can.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibration.order_line import (
    EDGE_PX,
    Input,
    ResidualOrder,
    calibration_of,
    check_stated_size,
    set_images,
    stated_values,
)
from isochrome.calibration.result import CONTRADICTED, Calibration, ImageFit
from isochrome.calibration.settings import CalibrationSet, SetLike, load_set
from isochrome.calibration.shot import (
    FEWEST_FRINGES,
    FINEST,
    LARGEST_TILT,
    PIXELS,
    RIM,
    Shot,
    calibrate_channels,
    unused,
)
from isochrome.calibration.whole_set import Kind, SetFit, SetModel, alike_fits, best_first, fit_set
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import ALIKE_CHI, GOOD_CHI
from isochrome.messages import message

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]

SAMPLES = 512
"""Samples of the profile that is scanned, at most about."""

SMALLEST_PX = 16.0
LARGEST_FRAMES = 20.0
"""A beam's height in pixels, and in heights of the frame, at the least and at the most."""

EDGE_REACH = 0.1
"""How far the edges may lie from the last guess, in heights."""


@dataclass(frozen=True)
class BeamView:
    """The beam's height, `top` row at the middle column, `tilt` (rows a column), `starts` (m, 3),
    slope (fringe/px), row of N = 0, tilt; `edges_px` is None where one is not in view.
    """

    height_px: float
    top: float
    tilt: float
    starts: Array
    edges_px: float | None = None

    def refined(self, shot: Shot, slope: float, tilt: float) -> BeamView:
        """The view with the edges between which a sinusoid of some slope explains most: an edge of
        order 1 is as dark as what lies beyond it, of which a few rows would pull the fit.
        """
        rows, values, count = _profile(shot, tilt)
        reach, top = EDGE_REACH * self.height_px, self.top
        edges = np.rint([self.top, self.top + self.height_px])
        for moved in ((1.0, 1.0), (1.0, 0.0), (0.0, 1.0)):  # of a beam as high as stated, and each
            tried = edges + np.rint(np.arange(-reach, reach))[:, None] * moved
            cost, _ = _scan(rows, values, count, tried, np.array([slope]), 2)
            edges = tried[np.argmin(cost)]
            top = float(edges[0]) if all(moved) else top
        in_view = rows[0] < edges[0] and edges[1] <= rows[-1]
        edges_px = float(np.ptp(edges) / np.hypot(1.0, tilt)) if in_view else None
        return replace(self, top=top, edges_px=edges_px)


def find_beam(shot: Shot, height_px: float) -> BeamView:
    """A beam's tilt, top edge and candidate slopes. PhysicsError without fringes across it."""
    from scipy.signal import argrelmin

    lines = shot.light.shape[0]
    if not SMALLEST_PX <= height_px <= LARGEST_FRAMES * lines:
        raise InputError(
            "beam_height_mm_camera_pixel_mm", name=shot.name, height_px=height_px, seen=lines,
            smallest_px=SMALLEST_PX, seen_2=LARGEST_FRAMES * lines,
        )  # fmt: skip
    # the shear (rows a column) under which the profile over the rows has the most contrast
    tilt, half = 0.0, np.tan(np.radians(LARGEST_TILT))
    for step in np.tan(np.radians([0.25, 0.05])):
        shears, contrasts = tilt + np.arange(-half, half + 1e-9, step), []
        for shear in shears:
            _, values, count = _profile(shot, shear)
            mean = np.average(values, weights=count)
            contrasts.append(np.average((values - mean) ** 2, weights=count))
        tilt, half = float(shears[int(np.argmax(contrasts))]), step
    rows, values, count = _profile(shot, tilt)
    in_view = min(height_px, float(rows[-1] - rows[0] + 1))
    # at least 60 % of the smaller of beam and frame is in view
    ends, room = sorted((rows[0], rows[-1] + 1 - height_px)), 0.4 * in_view
    tops = np.arange(ends[0] - room, ends[1] + room, EDGE_REACH * in_view)
    slopes = np.arange(FEWEST_FRINGES / in_view, FINEST / float(rows[1] - rows[0]), 0.2 / in_view)
    cost, phase = _scan(rows, values, count, np.stack([tops, tops + height_px], axis=1), slopes)
    if cost.min() > 0.95 * _smooth_cost(rows, values, count, 2):
        raise PhysicsError("no_fringes_rise_across", name=shot.name)
    lowest, place = cost.min(axis=0), int(np.argmin(cost.min(axis=1)))
    valleys = argrelmin(np.pad(lowest, 1, constant_values=np.inf))[0] - 1
    best = valleys[np.argsort(lowest[valleys], kind="stable")][:4]
    slope = slopes[best]
    row = (phase[place, best] + (0.0 if shot.bright else np.pi)) / (2.0 * np.pi * slope)
    row += np.round((tops[place] + 0.5 * height_px - row) * slope) / slope
    starts = np.stack([slope, row, np.full(len(best), tilt)], axis=1)
    return BeamView(height_px, float(tops[place]), tilt, starts)


def _profile(shot: Shot, shear: float) -> tuple[Array, Array, Array]:
    """Mean intensity over sheared rows: row at the middle column, mean, number of pixels."""
    height, width = shot.light.shape
    stride, step = max(1, width // 160), -(-height // SAMPLES)
    cols = np.arange(stride // 2, width, stride)
    drop = shear * (cols - 0.5 * (width - 1))
    place = np.rint((np.arange(height)[:, None] - drop) / step).astype(int)
    low = int(place.min())
    keep = shot.valid[:, cols]
    index = (place - low)[keep]
    count = np.bincount(index)
    total = np.bincount(index, weights=shot.light[:, cols][keep])
    good = count >= 0.3 * step * len(cols)
    row = step * (np.flatnonzero(good) + low).astype(float)
    return row, total[good] / count[good], count[good].astype(float)


def _scan(
    rows: Array, values: Array, count: Array, edges: Array, slopes: Array, falls: int = 0
) -> tuple[Array, Array]:
    """Residual (m, slopes) of a sinusoid, its amplitude a polynomial of degree `falls`, between two
    edges (m, 2), and of a line outside of each; phase of its maximum.
    """
    cost, phase = np.empty((2, len(edges), len(slopes)))
    angle = 2.0 * np.pi * slopes[:, None] * rows
    place = (rows - rows.mean()) / max(1.0, float(np.ptp(rows)))
    smooth = np.stack([np.ones_like(place), place, place**2])
    waves = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    uneven = [waves * part for part in smooth[: falls + 1]]
    design = np.concatenate([*uneven, np.stack([smooth] * len(slopes))], axis=1)
    for i, (top, bottom) in enumerate(edges):
        inside = (rows >= top) & (rows < bottom)
        d, w, y = design[:, :, inside], count[inside], values[inside]
        gram = (d * w) @ d.transpose(0, 2, 1) + 1e-9 * w.sum() * np.eye(d.shape[1])
        result = np.linalg.solve(gram, ((d * w) @ y)[..., None])[..., 0]
        outside = sum(
            _smooth_cost(rows[where], values[where], count[where], 1)
            for where in (rows < top, rows >= bottom)
        )
        cost[i] = np.sum(w * (y - np.einsum("sk,skn->sn", result, d)) ** 2, axis=1) + outside
        phase[i] = np.arctan2(result[:, 1], result[:, 0])
    return cost, phase


def _smooth_cost(rows: Array, values: Array, count: Array, degree: int) -> float:
    """What a polynomial leaves of a profile: its squares, for each pixel."""
    if rows.size <= degree + 1:
        return 0.0
    smooth = np.polynomial.Polynomial.fit(rows, values, degree, w=np.sqrt(count))
    return float(count @ (values - smooth(rows)) ** 2)


FAINTEST = 2.0
"""Standard deviation of the fringes' intensities, in noise sigmas, at the least."""


def beam_order(params: ArrayLike, y: Array, x: Array) -> Array:
    """N = slope (y - row - tilt x), of `params` (3,), with its sign; x in px from the middle."""
    slope, row, tilt = np.asarray(params, dtype=float)
    return np.asarray(slope * (y - row - tilt * x))


def fit_beam(shot: Shot, height_px: float) -> tuple[BeamView, SetFit]:
    """One image's slope, neutral axis, tilt and light. PhysicsError where these are not told."""
    view, (lines, width) = find_beam(shot, height_px), shot.light.shape
    stride = max(1, int(np.ceil(shot.light.size / PIXELS)))
    rows, cols = np.arange(lines), np.arange(stride // 2, width, stride)
    starts, fits = [*view.starts], list[SetFit]()
    for margin in (EDGE_REACH, RIM, RIM):  # more at first, while the edges are known roughly
        if fits:
            view = view.refined(shot, float(fits[0].values[0]), float(fits[0].values[2]))
        depth = rows[:, None] - view.tilt * (cols - 0.5 * (width - 1)) - view.top
        inside = np.abs(depth - 0.5 * height_px) < 0.5 * height_px - max(4.0, margin * height_px)
        model = SetModel(
            kind=beam_kind(view, width), shots=[shot], rows=rows, cols=cols,
            masks=(shot.valid[:, cols] & inside)[None],
        )  # fmt: skip
        fits = best_first(model.fit(start) for start in starts)
        if not fits:  # every start turned the light negative
            raise PhysicsError("fringes_not_those_pure", name=shot.name)
        starts = [fit.values for fit in fits]
    (best, *_), alike = alike_fits(fits)
    slope, spread = float(best.values[0]), float(np.sqrt(best.covariance[0, 0]))
    if np.std(best.point.gain(0) * best.point.signals[0]) < FAINTEST:
        raise PhysicsError("too_few_fringes_too", name=shot.name)
    fringes = slope * min(height_px, float(lines))
    if best.explained and (fringes < FEWEST_FRINGES or spread > 0.2 * slope):
        raise PhysicsError("fringes_view_too_few", name=shot.name, seen_px=fringes)
    rivals = [m for m in alike if abs(m.values[0] / slope - 1) > 0.02]
    if _are_alike(best, rivals):
        raise PhysicsError(
            "two_fringe_slopes_explain", name=shot.name, chi=best.chi, chi_2=rivals[0].chi
        )
    if not (best.explained and best.converged):
        raise PhysicsError("fringes_not_those_pure", name=shot.name)
    return view, best


def _are_alike(best: SetFit, rivals: Sequence[SetFit]) -> bool:
    """Whether there are rivals beside what rollers add, or where this is not all that is there."""
    if not rivals:
        return False
    wider = replace(best.model, free=(ROLLERS,))
    fits = [wider.fit(fit.model.carried(fit.values, wider)) for fit in (best, *rivals)]
    least = min(fits, key=lambda fit: fit.chi)
    alike = [fit.values[0] for fit in fits if fit.chi < ALIKE_CHI * least.chi]
    return least.chi >= GOOD_CHI or bool(np.ptp(alike) > 0.02 * least.values[0])


MOMENT = "a moment that changes along the beam"
ROLLERS = "the rollers' own stress"
EDGES = "stress along the machined edges"

LOCAL = 0.1
"""Fringes at an edge by its machining, .4 MPa in 4 mm of an epoxy; and share of the bending stress
that rollers half a height away add at the picture's sides."""

BENT = 0.02
"""Change of the slope along the span, to either side, that is no pure bending."""


def beam_kind(view: BeamView, width: int, off: float = 0.0) -> Kind:
    """A beam's order, see `beam_order`; besides, the moment's factor 1 + c1 t + c2 (t^2 - 1/3)
    along the span, t = -1..1, with its shear; the ends' self-equilibrated stress; and that of the
    edges, which no load changes. An unloaded image's own unknown is its squared order at the edge.
    `off`, px, is how far below the neutral axis the middle lies.
    """
    middle, half = 0.5 * (width - 1), 0.5 * view.height_px
    depths = RIM * view.height_px * np.array([0.5, 1.0])  # what is less deep is left out

    def by_name(name: str, unknowns: Array, rows: Array, cols: Array) -> Complexes:
        """Derivatives (k, n) of sx - sz + 2i txz, in fringes along the beam."""
        x, edge = cols - middle, unknowns[0] * half
        below = (rows - unknowns[1] - off - unknowns[2] * x) / half
        if name == EDGES:
            return machined(below, depths / half)
        if name == ROLLERS:
            return np.asarray(edge * end_stresses(below, (x + middle) / half, (middle - x) / half))
        t, ones, sheared = x / (0.5 * width), np.ones_like(x), 2j * edge * half / width
        bent = beam_order(unknowns, rows, x) * np.array([t, t * t - 1.0 / 3.0])
        return np.asarray(bent + sheared * (1.0 - below**2) * np.array([ones, 2.0 * t]))

    def field(unknowns: Array, besides: dict[str, Array], rows: Array, cols: Array) -> Complexes:
        total = beam_order(unknowns, rows, cols - middle).astype(np.complex128)
        for name, values in besides.items():
            total += values @ by_name(name, unknowns, rows, cols)
        return total

    def order(unknowns: Array, besides: dict[str, Array], rows: Array, cols: Array) -> Array:
        if not besides:
            return beam_order(unknowns, rows, cols - middle)
        total = field(unknowns, besides, rows, cols)
        return np.asarray(np.copysign(np.abs(total), total.real))

    def by_besides(
        name: str, unknowns: Array, besides: dict[str, Array], rows: Array, cols: Array
    ) -> Array:
        total = field(unknowns, besides, rows, cols)
        along = total / (np.copysign(np.abs(total), total.real) + np.finfo(float).tiny)
        return np.asarray((along.conj() * by_name(name, unknowns, rows, cols)).real)

    def idle(first: Array, square: Array) -> Array:
        _, row, tilt = first
        return np.array([np.sqrt(square[0]) / (half * np.hypot(1.0, tilt)), row, tilt])

    return Kind(
        besides={
            MOMENT: np.full(2, 0.5 * BENT), ROLLERS: np.full(20, LOCAL), EDGES: np.full(4, LOCAL)
        },
        order=order, by_besides=by_besides,
        largest=np.array([0.1 / view.height_px, 0.1 * view.height_px, 0.01]),
        idle=idle, idle_largest=np.ones(1), alone=MOMENT,
    )  # fmt: skip


def machined(below: Array, depths: Array) -> Complexes:
    """Stresses (2 k, n) of the upper and the lower edge that fall by e in `depths` (k,), all over
    half the height, less the force and the moment that balance them.
    """
    gone, forms = np.exp(-2.0 / depths), list[Array]()
    forces = depths * (1.0 - gone)
    for depth, force, moment in zip(
        depths, forces, depths * (1.0 + gone) - depths * forces, strict=True
    ):
        for inwards in (-below, below):
            forms.append(np.exp((inwards - 1.0) / depth) - 0.5 * force - 1.5 * moment * inwards)
    return np.array(forms, dtype=np.complex128)


def end_stresses(below: Array, *away: Array) -> Complexes:
    """sx - sz + 2i txz (20, n) of what decays along a strip from its ends, `away` (n,), all over
    half the height: Airy's f(y) exp(-g s), whose f and f' are nought at the edges where
    sin 2g = -2g, for an even f, or 2g. Of 1 at the most. Source: Timoshenko & Goodier (1970),
    art. 26.
    """
    forms = []
    roots = 2.106 + 1.125j, 3.749 + 1.384j, 5.356 + 1.552j, 6.950 + 1.676j, 8.537 + 1.776j
    for g, even in zip(roots, (True, False, True, False, True), strict=True):
        # an odd f is an even one a quarter of a turn on
        turn = 0.0 if even else 0.5 * np.pi
        sine, cosine, s, c = (of(g * y + turn) for y in (below, 1.0) for of in (np.sin, np.cos))
        f = below * sine * c - cosine * s
        slope = (sine + g * below * cosine) * c + g * sine * s
        along = 2.0 * g * (cosine * c - g * f)
        size = np.abs(along).max()
        for distance, way in zip(away, (1.0, -1.0), strict=True):
            fall = np.exp(-g * distance) / size
            for part in (fall, 1j * fall):
                forms.append((part * along).real + 2j * way * (part * g * slope).real)
    return np.array(forms)


def check_span(fit: SetFit) -> float:
    """The largest change of the slope along the span. PhysicsError for more than on any bench."""
    if not fit.explained:
        raise PhysicsError("fringes_not_those_pure", name=fit.model.shots[0].name)
    if MOMENT not in fit.model.free:
        return 0.0
    places, ends = fit.model.places[MOMENT], np.array([[-1.0, 1.0], [1.0, 1.0]])
    change = np.abs(ends @ fit.values[places])
    spread = np.sqrt(np.diag(ends @ fit.covariance[np.ix_(places, places)] @ ends.T))
    if np.any((change > BENT) & (change > CONTRADICTED * spread)):
        raise PhysicsError("fringes_slope_changes_along_half", value=float(change.max()))
    return float(change.max())


def local_stresses(fit: SetFit, views: Sequence[BeamView]) -> Iterator[str]:
    """What is fitted of the rollers and the edges, and an axis that is not the middle."""
    model, half = fit.model, 0.5 * views[0].height_px
    at = model.images[0].rows, model.images[0].cols
    for name, code in ((ROLLERS, "rollers_near_view"), (EDGES, "edges_machined")):
        if name in model.free:
            amplitudes = fit.values[model.places[name]]
            by = model.kind.by_besides(name, fit.own[0], {}, *at)
            size = float(np.abs(amplitudes @ by).max())
            share = 100.0 / abs(float(fit.values[0]) * half) if name == ROLLERS else 1.0
            yield message(code, size=size * share)
    off = middle_off(fit.own[:, 1], views)
    if off:
        yield message("axis_off_middle", off=-100.0 * off / half)


def middle_off(axes: Array, views: Sequence[BeamView]) -> float:
    """How far below the neutral `axes` (m,) the middle between the edges lies, px: the edges are
    known to half a pixel, and an axis that is not off by more is the middle.
    """
    off = np.array(
        [
            view.top + 0.5 * view.height_px - axis
            for view, axis in zip(views, axes, strict=True)
            if view.edges_px
        ]
    )
    noise = CONTRADICTED * EDGE_PX / np.sqrt(2.0)
    return float(off.mean()) if off.size and abs(off.mean()) > noise else 0.0


def beam_images(
    fit: SetFit, views: Sequence[BeamView], pixel_mm: float
) -> tuple[list[ImageFit], Array, list[ResidualOrder]]:
    """The images' results from a whole set's fit, their orders' covariance (m, m), and what the
    unloaded images show where their light is the others'; `views`, the loaded images' own.
    """
    model = fit.model
    linear, places, unloaded = np.zeros((len(views), model.size)), [], []
    stride = float(model.cols[1] - model.cols[0]) if len(model.cols) > 1 else 1.0
    for i, (view, (slope, row, tilt)) in enumerate(zip(views, fit.own, strict=True)):
        per_px = float(np.hypot(1.0, tilt))
        linear[i, model.places[i][0]] = 0.5 * view.height_px * per_px
        geometry = {
            "tilt_deg": float(np.degrees(np.arctan(-tilt))),
            "neutral_axis_row_px": float(row),
            "top_edge_row_px": view.top,
            "fringes_per_mm": float(slope * per_px / pixel_mm),
        }
        cut = {
            "cut": np.s_[:, len(model.cols) // 2],
            "position_mm": (model.rows - row) * pixel_mm,
            "pixel_mm": (pixel_mm, pixel_mm * stride),
        }
        places.append((geometry, cut))
    if not (model.exposed or model.apart):
        for i, shot in enumerate(model.shots[len(views) :], start=len(views)):
            (place,) = model.places[i]
            spread = float(np.sqrt(fit.covariance[place, place]))
            unloaded.append(ResidualOrder(shot.name, float(fit.values[place]), spread))
    return *set_images(fit, linear, places), unloaded


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
    return calibrate_channels(load_set(source, specimen="beam"), bending_from_shots)


def bending_from_shots(shots: Sequence[Shot], given: CalibrationSet) -> Calibration:
    """`calibrate_bending` on a set's prepared images. InputError where edges contradict sizes."""
    beam, pixel_mm, known = given.beam, given.camera.pixel_mm, given.uncertainty
    assert beam is not None and pixel_mm is not None
    idle = [shot for shot in shots if not shot.load_n]
    height_px = beam.height_mm / pixel_mm
    views, fits = zip(*(fit_beam(s, height_px) for s in shots if s.load_n), strict=True)
    first, found = fits[0].model, np.array([fit.values for fit in fits])
    kind = beam_kind(views[0], shots[0].light.shape[1], middle_off(found[:, 1], views))
    thinned = np.s_[:: max(1, int(np.count_nonzero(first.masks) / PIXELS))]
    cols = first.cols[thinned]
    masks = [fit.model.masks[0][:, thinned] for fit in fits]
    common = np.logical_and.reduce(masks)
    masks += [common & shot.valid[:, cols] for shot in idle]
    model = replace(
        first, kind=kind, shots=[*(fit.model.shots[0] for fit in fits), *idle], cols=cols,
        masks=np.stack(masks), held=stated_values(given), uneven=None,
    )  # fmt: skip
    set_fit = fit_set(model, found)
    change = check_span(set_fit)
    images, covariance, unloaded = beam_images(set_fit, views, pixel_mm)
    messages = [message("moment_changes_along_beam", change=100.0 * change)] if change else []
    messages += local_stresses(set_fit, views)
    if not unloaded:
        messages += unused(idle, message("because_light_not_loaded"))
    distances = [view.edges_px for view in views if view.edges_px]
    if distances:
        check_stated_size(distances, "height_mm", beam.height_mm, given, "beam_edges_px_apart")
    arm = beam.outer_span_mm - beam.inner_span_mm
    inputs = (
        Input("height", known.height_mm, "mm", 3.0 / beam.height_mm),
        Input("spans", known.span_mm, "mm", float(np.sqrt(2.0)) / arm),
        Input("pixel scale", known.pixel_mm, "mm", 1.0 / pixel_mm),
    )
    return calibration_of(
        "beam", images, 1.5 * arm / beam.height_mm**2, inputs, given,
        fit=set_fit, covariance=covariance, unloaded=unloaded, messages=messages,
        turns=[i for i, shot in enumerate(shots) if shot.load_n],
    )  # fmt: skip
