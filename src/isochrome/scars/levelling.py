r"""A trace levelled on its unworn shoulders, its scar's edges and its worn area.

The trace is a form (tilt and curvature), less the worn depth, plus roughness. The form is a
polynomial fitted to the shoulders by least squares with the roughness's own covariance C,

    β = (Fᵀ C⁻¹ F)⁻¹ Fᵀ C⁻¹ z   on the shoulders,    A = Δx Σ_window (F β - z).

The window is the scar with a guard on each side, so that an edge that is a little off adds noise
but no bias; nothing is cut off at zero. A is linear in the heights, A = wᵀz, and its variance
wᵀ C w: it holds the roughness that was worn off, the levelling and what both share. Degrees of the
form are averaged by their evidence exp(-BIC/2), and what they disagree adds to the variance.
Sources: Aitken (1936), Proc. Roy. Soc. Edinburgh 55, 42; Schwarz (1978), Ann. Stat. 6, 461;
Hoeting et al. (1999), Statistical Science 14, 382, for the average.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError, PhysicsError
from isochrome.scars.levelled_trace import LevelledTrace, student_factor_of
from isochrome.scars.roughness import Roughness, fit_roughness
from isochrome.scars.template import (
    FORM_DEGREES,
    ScarShape,
    first_place,
    form_spread,
    legendre,
    refine_place,
    white_covariance_of,
    whitening,
)
from isochrome.scars.trace import Trace
from isochrome.scars.trace_bins import BinnedTrace, bin_trace

Array = NDArray[Any]
Mask = NDArray[np.bool_]

STANDS_OUT = 5.0
"""Depth over its uncertainty from which a scar stands out: chance finds 3.5 to 4 when it may choose
place and width."""

_GUARD, _LEAST_GUARD = 2.0, 0.04
"""Guard beside an edge: its standard uncertainties, and at least this part of the half-width."""

_FLANK, _PILED_UP = 0.3, 5.0
"""Width beside an edge in which ridges are looked for, over the half-width; and their area over its
standard uncertainty from which they are none of the roughness: the area is asked after the edge was
put where the heights begin to fall."""

_SHOULDERS, _SHOULDER = 0.5, 0.1
"""Least unworn length over the window's, of both sides together, and of each."""

_FEWEST_BINS = 20
"""Bins from which a spectrum and a form can be told."""

_SHALLOWEST = 2e-5
"""Depth over width of a scar, of which less is a slip of units: 20 nm over a millimetre."""

_LOUD = 5.0
"""Robust standard deviations beyond which a bin of a shoulder is no roughness (dust, a scratch)."""


class UnclearScarError(PhysicsError):
    """No scar stands out from a trace's roughness."""


def levelled(trace: Trace) -> LevelledTrace:
    """Level a trace on its shoulders, and take its scar's edges and worn area.

    A = Δx Σ (F β - z) over the scar, F β the form by the shoulders (see the module). A trace whose
    scar stands up is turned over, which its messages say. UnclearScarError where no scar stands
    out; InputError where too little is unworn, or heights are in another unit. Source: Aitken
    (1936), Proc. Roy. Soc. Edinburgh 55, 42.
    """
    bins = bin_trace(trace)
    place, roughness, unworn = _find(bins, trace.name)
    messages: tuple[str, ...] = ()
    if place.depth_um < 0.0:
        messages += (
            f"{trace.name}: the scar stands up, so the heights were measured downward; turned over",
        )
        turned = replace(trace, z_um=-trace.z_um)
        bins, place = bin_trace(turned), replace(place, depth_um=-place.depth_um)
    if place.clear < STANDS_OUT:
        raise UnclearScarError(
            f"{trace.name}: no scar stands out of its roughness: the clearest dip is "
            f"{place.depth_um:.2g} µm deep, {place.clear:.1f} of its standard uncertainty where "
            f"{STANDS_OUT:g} are asked; measure a longer trace, or give the volume"
        )
    _check_shoulders(bins, place, trace.name)
    if place.depth_um < _SHALLOWEST * 2e3 * place.half_mm:
        raise InputError(
            f"{trace.name}: its scar is {place.depth_um:.2g} µm deep over {2 * place.half_mm:.3g} "
            "mm, which no profilometer sees; check the unit of z (µm, mm) in its column's name"
        )
    found = _level(bins, place, roughness, unworn, messages=messages, name=trace.name)
    if max(found.ridges_mm2) < _PILED_UP * found.ridge_uncertainty_mm2:
        return found
    unworn = unworn & ~_near(bins.x_mm, place, _FLANK)
    found = _level(bins, place, roughness, unworn, messages=messages, name=trace.name, ridged=True)
    left, right = (1e3 * ridge for ridge in found.ridges_mm2)
    return replace(
        found,
        messages=(
            *messages,
            f"{trace.name}: ridges of {left:.2g} and {right:.2g} µm mm stand beside the scar of "
            f"{1e3 * found.worn_area_mm2:.3g} µm mm: material was pushed aside, which is no wear; "
            "the worn area is that below the surface, and what is lost is less",
        ),
    )


def _near(x_mm: Array, place: ScarShape, flank: float) -> Mask:
    """Which places are in the scar or beside it, within so many half-widths."""
    return np.asarray(np.abs(x_mm - place.centre_mm) <= (1.0 + flank) * place.half_mm)


def _find(bins: BinnedTrace, name: str) -> tuple[ScarShape, Roughness, Mask]:
    """The scar's place, the roughness beside it and the shoulders, each by the others in turn."""
    x, z, n = bins.x_mm, bins.z_um, len(bins.x_mm)
    form = legendre(x, FORM_DEGREES[-1])

    def roots(place: ScarShape, before: Roughness | None = None) -> tuple[Roughness, Array]:
        unworn = _shoulders(bins, place, name)
        found = fit_roughness(z, unworn, form, bins.spacing_mm, before)
        return found, whitening(x, _firm(found.covariance(n)))

    roughness, white = roots(first_place(x, z, whitening(x, white_covariance_of(z))))
    place = refine_place(x, z, first_place(x, z, white), white)
    roughness, white = roots(place, roughness)
    place = refine_place(x, z, place, white)
    return place, roughness, _shoulders(bins, place, name)


def _firm(covariance: Array) -> Array:
    """A covariance that is definite beyond rounding."""
    covariance = covariance.copy()
    covariance[np.diag_indices_from(covariance)] *= 1.0 + 1e-8
    return covariance


def _guard_of(place: ScarShape, spacing_mm: float) -> tuple[float, float]:
    """Guards beside the left and the right edge, mm."""
    least = max(_LEAST_GUARD * place.half_mm, spacing_mm)
    if place.covariance is None:
        return 0.2 * place.half_mm, 0.2 * place.half_mm
    left, right = (
        min(max(_GUARD * u, least), 0.5 * place.half_mm) for u in place.edge_uncertainty_mm
    )
    return left, right


def _window(place: ScarShape, spacing_mm: float) -> tuple[float, float]:
    left, right = _guard_of(place, spacing_mm)
    return place.centre_mm - place.half_mm - left, place.centre_mm + place.half_mm + right


def _beside(bins: BinnedTrace, place: ScarShape) -> tuple[Mask, Mask]:
    """Bins left and right of the window."""
    low, high = _window(place, bins.spacing_mm)
    half = 0.5 * bins.spacing_mm
    return bins.x_mm < low - half, bins.x_mm > high + half


def _check_shoulders(bins: BinnedTrace, place: ScarShape, name: str) -> None:
    """Refuse a trace whose unworn parts are too short to level it."""
    low, high = _window(place, bins.spacing_mm)
    lengths = bins.spacing_mm * np.array([side.sum() for side in _beside(bins, place)])
    width = high - low
    if lengths.sum() < _SHOULDERS * width or lengths.min() < _SHOULDER * width:
        raise InputError(
            f"{name}: beside its scar from {low:.3g} to {high:.3g} mm the trace has "
            f"{lengths[0]:.2g} and {lengths[1]:.2g} mm of unworn surface, too little to level it; "
            "measure farther over both edges, by half of the scar's width each"
        )


def _shoulders(bins: BinnedTrace, place: ScarShape, name: str) -> Mask:
    """Bins outside the window that show the unworn surface."""
    x = bins.x_mm
    left, right = _beside(bins, place)
    unworn = (left | right) & ~bins.filled
    if unworn.sum() < _FEWEST_BINS:
        _check_shoulders(bins, place, name)
        raise InputError(f"{name}: too few points beside its scar; measure a longer trace")
    for _ in range(2):  # dust and scratches
        form = legendre(x, FORM_DEGREES[-1])
        beta = np.linalg.lstsq(form[unworn], bins.z_um[unworn], rcond=None)[0]
        away = np.abs(bins.z_um - form @ beta)
        unworn = unworn & (away <= _LOUD * 1.4826 * float(np.median(away[unworn])) + 1e-12)
    return np.asarray(unworn)


def _level(
    bins: BinnedTrace,
    place: ScarShape,
    roughness: Roughness,
    unworn: Mask,
    *,
    name: str,
    messages: tuple[str, ...],
    ridged: bool = False,
) -> LevelledTrace:
    """The levelled trace of a scar; where there are ridges, the window ends at its edges."""
    x, z, step = bins.x_mm, bins.z_um, bins.spacing_mm
    edges = _edges(place)
    low, high = edges if ridged else _window(place, step)
    inside = _parts(x, step, low, high)
    covariance = _firm(roughness.covariance(len(x)))
    levels, weights = _levels(x, z, unworn, covariance)
    level = np.tensordot(weights, levels, axes=1)
    to_area = 1e-3 * step * inside  # µm to mm
    rows = to_area @ level - to_area  # of A = rows @ z
    variance, freedom = roughness.variance(rows)
    wider = student_factor_of(freedom)
    areas = np.array([(to_area @ one - to_area) @ z for one in levels])
    drawn = _drawn(x, levels, weights)
    shared = float(to_area @ drawn @ to_area + weights @ (areas - weights @ areas) ** 2)
    own = to_area @ level
    ridges, ridge_uncertainty = _ridges(bins, place, level, roughness)
    to_depth = level - np.eye(len(x))
    return LevelledTrace(
        name=name,
        x_mm=x,
        depth_um=to_depth @ z,
        level_um=level @ z,
        unworn=unworn,
        edges_mm=edges,
        edge_uncertainty_mm=place.edge_uncertainty_mm,
        window_mm=(low, high),
        worn_area_mm2=float(rows @ z),
        worn_area_uncertainty_mm2=float(np.sqrt(wider * (variance + shared))),
        degrees_of_freedom=freedom,
        levelling_uncertainty_mm2=float(np.sqrt(wider * (own @ covariance @ own + shared))),
        depth_covariance_um2=wider * (to_depth @ covariance @ to_depth.T + drawn),
        roughness=roughness,
        deepest_um=place.depth_um,
        clear=place.clear,
        ridges_mm2=ridges,
        ridge_uncertainty_mm2=ridge_uncertainty,
        spikes=bins.spikes,
        messages=messages,
    )


def _edges(place: ScarShape) -> tuple[float, float]:
    return place.centre_mm - place.half_mm, place.centre_mm + place.half_mm


def _ridges(
    bins: BinnedTrace, place: ScarShape, level: Array, roughness: Roughness
) -> tuple[tuple[float, float], float]:
    """Areas above the level, left and right beside the scar, and their uncertainty, mm²."""
    (left, right), flank = _edges(place), _FLANK * place.half_mm
    beside = np.array(
        [
            _parts(bins.x_mm, bins.spacing_mm, left - flank, left),
            _parts(bins.x_mm, bins.spacing_mm, right, right + flank),
        ]
    )
    rows = 1e-3 * bins.spacing_mm * (beside - beside @ level)
    variance = max(roughness.variance(row)[0] for row in rows)
    return (float(rows[0] @ bins.z_um), float(rows[1] @ bins.z_um)), float(np.sqrt(variance))


def _drawn(x: Array, levels: Array, weights: Array) -> Array:
    """Covariance of a level that the forms' prior drew towards none (n, n), µm²."""
    total = np.zeros((len(x), len(x)))
    for degree, level, weight in zip(FORM_DEGREES, levels, weights, strict=True):
        form = legendre(x, degree)[:, 2:] * form_spread(x, degree)[2:]
        missed = level @ form - form
        total += weight * (missed @ missed.T)
    return total


def _parts(x: Array, step: float, low: float, high: float) -> Array:
    """The part of each bin that lies between two places (n,), 0 to 1."""
    overlap = np.minimum(x + 0.5 * step, high) - np.maximum(x - 0.5 * step, low)
    return np.clip(overlap / step, 0.0, 1.0)


def _levels(x: Array, z: Array, unworn: Mask, covariance: Array) -> tuple[Array, Array]:
    """The level of each degree as a matrix on the heights (d, n, n), and its weight (d,)."""
    inverse = np.linalg.inv(covariance[np.ix_(unworn, unworn)])
    heights, count = z[unworn], int(unworn.sum())
    matrices, scores = [], []
    for degree in FORM_DEGREES:
        form = legendre(x, degree)
        own = form[unworn]
        carried = inverse @ own
        prior = 1.0 / form_spread(x, degree) ** 2
        solved = np.linalg.solve(own.T @ carried + np.diag(prior), carried.T)
        matrix = np.zeros((len(x), len(x)))
        matrix[:, unworn] = form @ solved
        residual = heights - own @ (solved @ heights)
        away = float(residual @ inverse @ residual + prior @ (solved @ heights) ** 2)
        scores.append(away + degree * np.log(count))
        matrices.append(matrix)
    weight = np.exp(-0.5 * (np.array(scores) - min(scores)))
    return np.array(matrices), weight / weight.sum()
