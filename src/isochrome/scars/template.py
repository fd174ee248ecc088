r"""Where a scar is: its edges, by a smooth shape on a smooth form in coloured roughness.

The shape is that of a depth D (1 - |u|^m)^1.2 between its edges, u = (x - c)/a: it runs out as worn
contacts do that grew, and m goes from 2, near the arc of a late scar, to 3.5 of an early one. The
form is a polynomial. It only says where the scar is, and how well that is known; the worn area is
taken from the heights themselves (see `scars.levelling`).
Source: least squares with the
roughness's covariance: Aitken (1936), Proc. Roy. Soc. Edinburgh 55, 42.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.estimation import Bounds, Damping, minimise

Array = NDArray[Any]

FORM_DEGREES = (2, 3, 4)
"""Degrees of the form: a tilt and a curvature are always asked for."""

FORM_RADIUS_MM, _HIGHER = 500.0, 0.25
"""A flat specimen's form beforehand, one standard deviation: the curvature of this radius, and what
has a higher degree over what that makes. Without it a short trace's form would take up its scar."""

_NARROWEST, _WIDEST = 3.0, 0.45
"""Half-widths that are looked for: in bins, and over the trace's length."""

_HALF_WIDTHS, _PLACES = 14, 60
"""Half-widths and places of the first search."""

_RUN_OUT = 1.2
"""Power of the depth over the distance from an edge: with it, and m free, the edges are
within 0.6 % of the half-width of those of an elastic block under a worn cylinder, from 31 to 233 m
of the paper's wear test (measured)."""

_EDGE_MODEL = 0.01
"""Standard uncertainty of an edge by its shape, over the half-width."""

_BOUNDS, _USUAL, _SPREAD = (1.3, 6.0), 2.5, 0.7
"""Exponents m: bounds, mean and standard deviation of the prior."""

_STEPS, _SETTLED = 25, 1e-4
"""Most steps, and the promised gain in variances that ends them: a hundredth of an uncertainty."""
_DAMPING, _REACH = 1e-3, 0.3
"""The first damping, and the longest step over the half-width."""
_PARTS = 5
"""Points of a bin over which the shape is averaged."""


def legendre(x_mm: Array, degree: int) -> Array:
    """Legendre polynomials up to a degree over a trace (n, degree + 1)."""
    middle, half = 0.5 * (x_mm[0] + x_mm[-1]), 0.5 * (x_mm[-1] - x_mm[0])
    return np.polynomial.legendre.legvander((x_mm - middle) / half, degree)


def form_spread(x_mm: Array, degree: int) -> Array:
    """Prior standard deviations of the form's coefficients (degree + 1,), µm; tilt has none (inf).

    A radius R makes the second one L²/(12 R) over a length L.
    """
    curved = 1e3 * float(x_mm[-1] - x_mm[0]) ** 2 / (12.0 * FORM_RADIUS_MM)
    spread = np.full(degree + 1, _HIGHER * curved)
    spread[:2], spread[2] = np.inf, curved
    return spread


def shape(x_mm: Array, centre_mm: float, half_mm: float, exponent: float) -> Array:
    """(1 - |u|^m)^1.2 within the edges and 0 beyond, as means over bins (n,)."""
    step = x_mm[1] - x_mm[0]
    inside = (np.arange(_PARTS) - 0.5 * (_PARTS - 1)) * step / _PARTS
    u = (x_mm[:, None] + inside - centre_mm) / half_mm
    return np.asarray(np.mean(np.maximum(1.0 - np.abs(u) ** exponent, 0.0) ** _RUN_OUT, axis=1))


@dataclass(frozen=True)
class ScarShape:
    """A scar's place: `centre_mm` c, `half_mm` a, `exponent` m and `depth_um` D (ridge: below 0).

    `covariance` (3, 3) of c, a and m; `clear`, D over its standard uncertainty.
    """

    centre_mm: float
    half_mm: float
    exponent: float
    depth_um: float = 0.0
    covariance: Array | None = None
    clear: float = 0.0

    @cached_property
    def edge_uncertainty_mm(self) -> tuple[float, float]:
        """Standard uncertainties of the left and the right edge, c - a and c + a, mm."""
        assert self.covariance is not None
        cov = self.covariance[:2, :2]
        signs = (np.array([1.0, -1.0]), np.array([1.0, 1.0]))
        left, right = (
            float(np.hypot(np.sqrt(max(s @ cov @ s, 0.0)), _EDGE_MODEL * self.half_mm))
            for s in signs
        )
        return left, right

    def values(self, x_mm: Array) -> Array:
        """Its depth on bins (n,), µm."""
        return self.depth_um * shape(x_mm, self.centre_mm, self.half_mm, self.exponent)


def whitening(x_mm: Array, covariance: Array) -> Array:
    """Heights to what is white, with the form taken off (n, n).

    The root of the inverse covariance of roughness and form, and from that the tilt projected out.
    """
    form, spread = legendre(x_mm, FORM_DEGREES[-1]), form_spread(x_mm, FORM_DEGREES[-1])
    curved = form[:, 2:] * spread[2:]
    root = np.linalg.inv(np.linalg.cholesky(covariance + curved @ curved.T))
    q = np.linalg.qr(root @ form[:, :2])[0]
    return np.asarray(root - q @ (q.T @ root))


def white_covariance_of(z_um: Array) -> Array:
    """A first covariance (n, n): what second differences show, as if it were white."""
    size = 1.4826 * float(np.median(np.abs(np.diff(z_um, 2)))) / np.sqrt(6.0)
    return np.asarray(max(size, 1e-6) ** 2 * np.eye(len(z_um)))


def first_place(x_mm: Array, z_um: Array, white: Array) -> ScarShape:
    """The place of an arc that with the form leaves least of the heights.

    Parameters: bins (n,) and heights (n,); `white` (n, n), see `whitening`.
    """
    step, length = x_mm[1] - x_mm[0], x_mm[-1] - x_mm[0]
    z = white @ z_um
    best, place = -1.0, ScarShape(0.0, 1.0, _USUAL)
    for half in np.geomspace(_NARROWEST * step, _WIDEST * length, _HALF_WIDTHS):
        centres = np.linspace(x_mm[0] + half, x_mm[-1] - half, _PLACES)
        columns = np.maximum(1.0 - ((x_mm[:, None] - centres) / half) ** 2, 0.0)
        columns = white @ columns
        gain = (columns.T @ z) ** 2 / np.maximum((columns**2).sum(axis=0), 1e-12)
        k = int(np.argmax(gain))
        if gain[k] > best:
            best, place = float(gain[k]), ScarShape(float(centres[k]), float(half), _USUAL)
    return place


def refine_place(x_mm: Array, z_um: Array, start: ScarShape, white: Array) -> ScarShape:
    """The least-squares place from a start, with the roughness's covariance.

    Damped steps in c, ln a and m; depth and form are solved for at every one.
    """
    heights = _WhiteHeights(x_mm, white, white @ z_um)
    length, step_mm = float(x_mm[-1] - x_mm[0]), float(x_mm[1] - x_mm[0])
    bounds = Bounds(
        np.array([x_mm[0], np.log(_NARROWEST * step_mm), _BOUNDS[0]]),
        np.array([x_mm[-1], np.log(_WIDEST * length), _BOUNDS[1]]),
    )

    def cut(values: Array, step: Array) -> Array:
        reach = _REACH * np.exp(values[1])
        return bounds.cut(values, np.clip(step, -reach, reach))

    values = np.array([start.centre_mm, np.log(start.half_mm), start.exponent])
    values = values + bounds.cut(values, np.zeros(3))
    found = minimise(
        heights.at,
        values,
        heights.at(values),
        enough=lambda _: _SETTLED,
        damping=Damping(_DAMPING),
        iterations=_STEPS,
        bounds=bounds,
        cut=cut,
    )
    (centre, _, exponent), half = found.values.tolist(), float(np.exp(found.values[1]))
    scale = np.array([1.0, half, 1.0])
    return ScarShape(
        centre_mm=centre,
        half_mm=half,
        exponent=exponent,
        depth_um=-found.point.depth,
        covariance=np.linalg.inv(found.point.normal) * np.outer(scale, scale),
        clear=abs(found.point.depth) * found.point.size,
    )


@dataclass(frozen=True)
class _PlacePoint:
    """Least squares at one place: what `minimise` asks, `depth` -D, and `size` of the column."""

    cost: float
    normal: Array
    gradient: Array
    depth: float
    size: float


@dataclass(frozen=True)
class _WhiteHeights:
    """Whitened heights `z` (n,) over `x_mm` (n,), and what whitens (n, n)."""

    x_mm: Array
    white: Array
    z: Array

    def column(self, values: Array) -> Array:
        """The whitened shape (n,) of c, ln a and m."""
        centre, half, exponent = values[0], float(np.exp(values[1])), values[2]
        return np.asarray(self.white @ shape(self.x_mm, centre, half, exponent))

    def at(self, values: Array) -> _PlacePoint:
        """Cost and normal equations in c, ln a and m, with the depth eliminated."""
        c = self.column(values)
        square = max(float(c @ c), 1e-300)
        depth = float(c @ self.z) / square
        residual = self.z - depth * c
        steps = np.diag([0.01 * np.exp(values[1]), 0.01, 0.02])
        slopes = [depth * (self.column(values + e) - c) / e.sum() for e in steps]
        rows = np.array([slope - c * float(c @ slope) / square for slope in slopes])
        away = (values[2] - _USUAL) / _SPREAD
        normal, gradient = rows @ rows.T, rows @ residual
        normal[2, 2] += 1.0 / _SPREAD**2
        gradient[2] -= away / _SPREAD
        cost = float(residual @ residual) + float(away**2)
        return _PlacePoint(cost, normal, gradient, depth, float(np.sqrt(square)))
