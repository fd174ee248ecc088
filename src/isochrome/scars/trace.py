"""A profilometer's trace: read and checked, levelled on its unworn shoulders, its scar's worn area.

The trace is a form (tilt and curvature), less the worn depth, plus roughness. The form is a
polynomial fitted to the shoulders by least squares with the roughness's own covariance C,

    β = (Fᵀ C⁻¹ F)⁻¹ Fᵀ C⁻¹ z   on the shoulders,    A = Δx Σ_window (F β - z).

The window is the scar with a guard on each side, so that an edge that is a little off adds noise
but no bias; nothing is cut off at zero. A is linear in the heights, A = wᵀz, and its variance
wᵀ C w: it holds the roughness that was worn off, the levelling and what both share. Degrees of the
form are averaged by their evidence exp(-BIC/2), and what they disagree adds to the variance.
Where the scar is says a smooth shape D (1 - |u|^m)^1.2, u = (x - c)/a: it runs out as worn contacts
do that grew, and m goes from 2, near the arc of a late scar, to 3.5 of an early one.

The heights beside a scar, less a smooth form, are a sum of waves of random phase, whose power S(f)
is constant in each of some octaves: the powers of the largest restricted likelihood (which counts
the form), with the prior that ln S walks from octave to octave. Of a value w^T z the variance is

    u² = w^T C w = Σ_j S_j ∫_band |W(f)|² df,   W the transform of w.

Sources: Aitken (1936), Proc. Roy. Soc. Edinburgh 55, 42; Schwarz (1978), Ann. Stat. 6, 461;
Hoeting et al. (1999), Statistical Science 14, 382, for the average; Patterson & Thompson (1971),
Biometrika 58, 545, for the restricted likelihood; Rasmussen & Williams (2006), Gaussian Processes
for Machine Learning, section 2.2, for the covariance. Files: ISO 25178-71:2017 (SDF), from
Stout et al. (1993), EUR 15178 EN; one profile as NIST's surface metrology pages describe it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from isochrome.errors import InputError, PhysicsError
from isochrome.messages import message
from isochrome.output import MM_PER_UNIT, numbered_lines, read_given_text

Array = NDArray[Any]
Mask = NDArray[np.bool_]

MM = {unit: MM_PER_UNIT[unit] for unit in ("m", "mm", "um", "µm", "μm", "nm")}
"""Units of lengths that a column may have, in mm."""

_PLACE_NAMES = ("x", "position", "distance", "lateral", "length")
_HEIGHT_NAMES = ("z", "height", "profile")

_FORM = "trace_has_line_names"

_LEAD = 60
"""Lines before the numbers in which the names may stand."""

_SDF = re.compile(r"\s*a(BCR?|ISO)-\d\.\d", re.I)
"""The first line of an ASCII file of ISO 25178-71, or of its origin."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf(inity)?)", re.I)


def _are_numbers(row: Sequence[str]) -> bool:
    filled = [cell.strip() for cell in row if cell.strip()]
    return len(filled) > 1 and all(map(_NUMBER.fullmatch, filled))


def _table(text: str, path: Path) -> tuple[Array, Array]:
    """The two columns of a table of numbers: places (n,), mm, and heights (n,), µm."""
    rows = numbered_lines(text)
    if not rows:
        raise InputError("empty", path=path, form=message(_FORM))
    cells = _cells([line for _, line in rows])
    head = cells[: _LEAD + 1]
    first = next((k for k, row in enumerate(head) if _are_numbers(row)), None)
    if first is None:
        raise InputError(
            "no_line_numbers_first", path=path, cells_count=len(head), form=message(_FORM)
        )
    x_column, z_column, x_unit, z_unit = _columns(head[:first], path)
    values = []
    for (number, _), row in zip(rows[first:], cells[first:], strict=True):
        pair = [row[k] if k < len(row) else "" for k in (x_column, z_column)]
        for cell in pair:
            if not (_NUMBER.fullmatch(cell) and np.isfinite(float(cell))):
                raise InputError("line_has_where_finite", path=path, number=number, cell=cell[:30])
        values.append([float(cell) for cell in pair])
    x, z = np.array(values).T
    return x_unit * x, 1e3 * z_unit * z


def _cells(lines: Sequence[str]) -> list[list[str]]:
    """Cells with decimal points, cut as the last lines tell: tab or semicolon, comma, or blanks."""
    some, separator = lines[-5:], cast("str | None", ",")
    if all(re.search(r"[\d.]\s+[+-]?[\d.,]", line) for line in some):
        separator = None
    for mark in ("\t", ";"):
        if all(mark in line for line in some):
            separator = mark
    if separator != "," and any("," in line for line in some):
        lines = [line.replace(",", ".") for line in lines]
    return [[cell.strip().strip('"') for cell in line.split(separator)] for line in lines]


def _columns(head: Sequence[Sequence[str]], path: Path) -> tuple[int, int, float, float]:
    """Columns of places and heights, and units in mm, by the last line that names both."""
    for k in range(len(head) - 1, -1, -1):
        places = [i for i, cell in enumerate(head[k]) if _name(cell) in _PLACE_NAMES]
        heights = [i for i, cell in enumerate(head[k]) if _name(cell) in _HEIGHT_NAMES]
        if not (places and heights):
            continue
        if len(places) > 1 or len(heights) > 1:
            raise InputError("line_names_several_columns", path=path, head=", ".join(head[k]))
        x, z = places[0], heights[0]
        return x, z, _unit_mm(head[k:], x, "x_mm", path), _unit_mm(head[k:], z, "z_um", path)
    raise InputError("no_line_names_columns", path=path, form=message(_FORM))


def _unit_mm(lines: Sequence[Sequence[str]], column: int, example: str, path: Path) -> float:
    """A column's unit in mm, by its name's last word or the line below."""
    for row in lines[:2]:
        words = _words(row[column]) if column < len(row) else []
        if words and words[-1] in MM:
            return MM[words[-1]]
    raise InputError(
        "column_has_no_unit", path=path, lines=lines[0][column], example=example,
        metres=", ".join(u for u in MM if u.isascii()),
    )  # fmt: skip


def _words(cell: str) -> list[str]:
    return [word for word in re.split(r"[\s_\[\]()/,:]+", cell.strip().lower()) if word]


def _name(cell: str) -> str:
    return next(iter(_words(cell)), "")


def _surface_data(text: str, path: Path) -> tuple[Array, Array]:
    """One profile in the ASCII form of ISO 25178-71."""
    head, star, body = text.partition("*")
    pairs = (line.partition("=") for line in head.splitlines()[1:])
    keys = {re.sub(r"[\s_-]", "", key).lower(): value.strip() for key, sign, value in pairs if sign}
    missing = [k for k in ("numpoints", "numprofiles", "xscale", "zscale") if k not in keys]
    if missing or not star:
        raise InputError(
            "sdf_file_without_export", path=path, words=missing[0] if missing else "its heights"
        )
    try:
        points, profiles = int(keys["numpoints"]), int(keys["numprofiles"])
        x_scale, z_scale = float(keys["xscale"]), float(keys["zscale"])
    except ValueError as error:
        raise InputError("scale_count_head_no", path=path, error=error) from error
    if profiles != 1:
        raise InputError("holds_profiles_export_one", path=path, profiles=profiles)
    cells = body.partition("*")[0].split()
    if len(cells) != points:
        raise InputError("has_heights_where_head", path=path, cells_count=len(cells), points=points)
    bad = next((cell for cell in cells if not _NUMBER.fullmatch(cell)), None)
    if bad is not None:
        raise InputError("has_among_heights_all", path=path, bad=bad[:30])
    heights = np.array(cells, dtype=np.float64)
    return 1e3 * x_scale * np.arange(float(points)), 1e6 * z_scale * heights


FEWEST = 50
"""Points of a trace: below, there is no telling of roughness from form."""

_SHORTEST_MM, _LONGEST_MM = 0.05, 200.0
"""Lengths of a trace across a scar: others are in another unit."""

_STEEPEST = 0.3
"""Heights over the length: a tilt of 17 degrees, at which no stylus goes."""

_WIDEST_GAP = 0.05
"""Largest step between two points, over the trace's length."""


@dataclass(frozen=True, eq=False)
class Trace:
    """Heights along a line, places in rising order. InputError for what is none: too few points, a
    gap, a length or heights that must be in another unit.
    """

    x_mm: Array
    z_um: Array  # up out of the specimen
    name: str = "trace"

    def __post_init__(self) -> None:
        x, z = (np.asarray(v, dtype=np.float64).ravel() for v in (self.x_mm, self.z_um))
        if len(x) > 1 and x[-1] < x[0]:
            x, z = x[::-1], z[::-1]
        name = self.name
        if len(x) != len(z):
            raise InputError("places_heights_give_many", name=name, x_count=len(x), z_count=len(z))
        if len(x) < FEWEST:
            raise InputError("has_points_trace_needs", name=name, x_count=len(x), fewest=FEWEST)
        if not (np.isfinite(x).all() and np.isfinite(z).all()):
            bad = int(np.argmin(np.isfinite(x) & np.isfinite(z)))
            raise InputError("point_all_must_finite", name=name, bad=bad + 1, x=x[bad], z=z[bad])
        steps = np.diff(x)
        if not (steps > 0.0).all():
            bad = int(np.argmin(steps > 0.0))
            raise InputError("goes_from_mm_point", name=name, x=x[bad], x_2=x[bad + 1], bad=bad + 2)
        length = float(x[-1] - x[0])
        least, most = _SHORTEST_MM, _LONGEST_MM
        if not least <= length <= most:
            raise InputError(
                "mm_long_where_mm", name=name, length=length, shortest_mm=least, longest_mm=most
            )
        if float(np.ptp(z)) > 1e3 * _STEEPEST * length:
            raise InputError("heights_span_over_mm", name=name, ptp=np.ptp(z), length=length)
        if float(steps.max()) > _WIDEST_GAP * length:
            bad, gap = int(np.argmax(steps)), 100 * _WIDEST_GAP
            raise InputError(
                "nothing_measured_from_mm", name=name, x=x[bad], x_2=x[bad + 1], widest_gap=gap
            )
        object.__setattr__(self, "x_mm", x)
        object.__setattr__(self, "z_um", z)


def read_trace(path: str | Path) -> Trace:
    """Read a trace from a text file: a line of names with units, then cells between commas,
    semicolons, tabs or blanks; or the ASCII form of ISO 25178-71 (SDF). InputError names the line.
    """
    text = read_given_text(Path(path), "the trace", fallback="latin-1")  # µ of an older program
    x_mm, z_um = (_surface_data if _SDF.match(text) else _table)(text, Path(path))
    return Trace(x_mm=x_mm, z_um=z_um, name=str(path))


WALK = 0.6
"""Standard deviation of the prior's step of ln S from one octave to the next: between a plateau and
f^-0.9, so that f^-2, two of them, and tool marks come out of the data. Measured on 150 traces: the
pull of the worn area is 1.14 with it, and 1.25 with 1, which leaves each band to itself."""

_LONGER = 1.3
"""Period of the waves over the trace, so that its two ends are not neighbours."""

_STEPS, _AT_REST, _LONGEST_STEP = 30, 0.03, 2.0
"""Most steps of a fit, the change of ln S that ends it, and the largest change in one of them."""


@dataclass(frozen=True)
class Bands:
    """Waves (n, q) of a uniform grid, cosines and sines; `band` (q,), the octave of each."""

    waves: Array
    band: NDArray[np.intp]
    edges_per_mm: Array

    @property
    def members(self) -> Array:
        """Waves of each octave (m,), a cosine and a sine together."""
        return np.bincount(self.band, minlength=len(self.edges_per_mm) - 1) / 2.0


@lru_cache(maxsize=32)
def make_bands(points: int, spacing_mm: float) -> Bands:
    """Waves from one period over twice the trace to two points a period."""
    period = 2 * round(0.5 * _LONGER * points)
    number = np.arange(1, period // 2 + 1)
    phase = 2.0 * np.pi * np.outer(np.arange(points), number) / period
    frequency = number / (period * spacing_mm)
    lowest = 2.0 / (period * spacing_mm)
    octaves = max(2, int(np.floor(np.log2(frequency[-1] / lowest))))
    edges = np.r_[frequency[0], lowest * 2.0 ** np.arange(octaves), frequency[-1]]
    band = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, octaves)
    return Bands(np.concatenate([np.cos(phase), np.sin(phase)], axis=1), np.r_[band, band], edges)


@dataclass(frozen=True)
class Roughness:
    """The spectrum of a trace's roughness in m bands, as its unworn parts show it."""

    spacing_mm: float  # of the grid on which it was found
    edges_per_mm: Array  # (m+1,)
    power_um2: Array  # (m,): mean square of the heights that lie in a band
    log_covariance: Array  # (m, m), of the logarithms of the powers

    @property
    def rq_um(self) -> float:
        """Root mean square height over all its bands, µm."""
        return float(np.sqrt(self.power_um2.sum()))

    def covariance(self, points: int) -> Array:
        """Covariance of the heights on a uniform grid of so many points (n, n), µm², definite."""
        bands = make_bands(points, self.spacing_mm)
        return definite((bands.waves * self._per_wave(bands)) @ bands.waves.T)

    def variance(self, weights: Array) -> tuple[float, float]:
        """Variance Σ S_j v_j of w^T z for weights w (n,), and its degrees of freedom 2/r², by the
        powers' relative uncertainty r (JCGM 100:2008, G.4.2).
        """
        bands = make_bands(len(weights), self.spacing_mm)
        parts = self._per_wave(bands) * (weights @ bands.waves) ** 2
        each = np.bincount(bands.band, parts, minlength=len(self.power_um2))
        total = float(each.sum())
        if not total > 0.0:
            return 0.0, np.inf
        share = each / total
        return total, float(2.0 / (share @ self.log_covariance @ share))

    def _per_wave(self, bands: Bands) -> Array:
        """Variance of each wave's amplitude (q,): half of the waves are cosines, half sines."""
        return np.asarray((self.power_um2 / bands.members)[bands.band])


def definite(covariance: Array) -> Array:
    """A covariance that is definite beyond rounding."""
    return np.asarray(covariance + 1e-8 * np.diag(np.diag(covariance)))


def fit_roughness(heights_um: Array, unworn: Mask, form: Array, spacing_mm: float) -> Roughness:
    """The spectrum of the largest restricted likelihood of the unworn heights (n,). With C = Σ θ_j
    C_j and P = C⁻¹ - C⁻¹F(FᵀC⁻¹F)⁻¹FᵀC⁻¹ of a form F (n, p), the steps are those of Fisher's
    scoring in ln θ: gradient (θ_j/2)(zᵀP C_j P z - tr P C_j), information (θ_j θ_k/2) tr(P C_j P
    C_k), and the prior's of a walk.
    """
    bands = make_bands(len(heights_um), spacing_mm)
    order = np.argsort(bands.band, kind="stable")
    waves, band, members = bands.waves[unworn][:, order], bands.band[order], bands.members
    z, basis = heights_um[unworn], form[unworn]
    residual = z - basis @ np.linalg.lstsq(basis, z, rcond=None)[0]
    size = max(float(residual @ residual) / len(z), 1e-12)
    starts = np.searchsorted(band, np.arange(len(members)))
    walk = np.diff(np.eye(len(members)), axis=0) / WALK
    precision = walk.T @ walk
    # a band of n times the width has n times the power where the spectrum is flat
    width = np.log(np.diff(bands.edges_per_mm))
    log_power = np.log(size) + width - np.log(np.exp(width).sum())
    for _ in range(_STEPS):
        scaled = waves * np.exp(0.5 * (log_power - np.log(members)))[band]
        inverse = np.linalg.inv(definite(scaled @ scaled.T))
        carried = inverse @ basis
        weighted = scaled.T @ (inverse - carried @ np.linalg.solve(basis.T @ carried, carried.T))
        products = weighted @ scaled
        sizes = (weighted @ z) ** 2 - np.diag(products)
        squares = np.add.reduceat(np.add.reduceat(products**2, starts, axis=0), starts, axis=1)
        gradient = 0.5 * np.add.reduceat(sizes, starts) - precision @ (log_power - width)
        information = 0.5 * squares + precision
        step = np.linalg.solve(information, gradient)
        log_power = log_power + np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
        if float(np.abs(step).max()) < _AT_REST:
            break
    return Roughness(spacing_mm, bands.edges_per_mm, np.exp(log_power), np.linalg.inv(information))


STANDS_OUT = 5.0
"""Depth over its uncertainty from which a scar stands out, and a ridge's area over its own: chance
finds 3.5 to 4 when it may choose place and width. As many robust standard deviations are no
roughness but a spike, dust or a scratch."""

MOST_BINS = 240
"""Bins of a trace: a scar of a tenth of it has 24, and their covariance is a small matrix."""

_HALF_WINDOW = 7
"""Points on each side of the running median that a spike is told from."""


@dataclass(frozen=True)
class BinnedTrace:
    """Means over n equal bins; `filled` (n,): those without a point, taken from neighbours."""

    name: str
    x_mm: Array
    z_um: Array
    filled: Mask
    spikes: int

    @property
    def spacing_mm(self) -> float:
        """Width of a bin, mm."""
        return float(self.x_mm[1] - self.x_mm[0])


def bin_trace(trace: Trace) -> BinnedTrace:
    """Means over bins without spikes; points at unequal x carry no tilt into them."""
    x, z = trace.x_mm, trace.z_um
    slope = (z[-1] - z[0]) / (x[-1] - x[0])
    heights = z - slope * (x - x[0])
    # spikes lie off the running median of their neighbours
    half = min(_HALF_WINDOW, (len(z) - 1) // 4)
    padded = np.pad(heights, half, mode="reflect", reflect_type="odd")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
    away = np.abs(heights - np.median(windows, axis=1))
    size, largest = 1.4826 * float(np.median(away)), float(np.abs(heights).max())
    good = away <= max(STANDS_OUT * size, 1e-9 * largest)
    count = min(MOST_BINS, len(x) // 2)
    step = (x[-1] - x[0]) / count
    place = np.minimum(((x - x[0]) / step).astype(int), count - 1)
    members = np.bincount(place[good], minlength=count)
    filled = members == 0
    middle = x[0] + step * (np.arange(count) + 0.5)
    mean = np.bincount(place[good], heights[good], minlength=count) / np.maximum(members, 1)
    mean[filled] = np.interp(middle[filled], middle[~filled], mean[~filled])
    z_um = mean + slope * (middle - x[0])
    return BinnedTrace(trace.name, middle, z_um, filled, int((~good).sum()))


@dataclass(frozen=True, kw_only=True)
class LevelledTrace:
    """A trace whose unworn surface is level, at 0; depth is positive into the specimen. Arrays are
    (n,), in equal bins; every `..._uncertainty` is a standard uncertainty.
    """

    name: str
    x_mm: Array  # middles of the bins, in the trace's own coordinate
    depth_um: Array  # with roughness: negative where it stands above its level
    level_um: Array  # the form that was taken off
    unworn: Mask  # the shoulders that it was fitted to
    edges_mm: tuple[float, float]  # left and right edge of the scar
    edge_uncertainty_mm: tuple[float, float]
    window_mm: tuple[float, float]  # what the area is taken over: the edges with a guard
    worn_area_mm2: float  # below zero where little is worn
    # by roughness and levelling, with what is not known of the roughness's spectrum itself
    # (`student_factor`)
    worn_area_uncertainty_mm2: float
    degrees_of_freedom: float  # those of the spectrum's part in it
    levelling_uncertainty_mm2: float  # the part of it that is the level's, by the shoulders alone
    depth_covariance_um2: Array = field(repr=False)  # (n, n), by roughness and levelling
    roughness: Roughness  # from the shoulders
    deepest_um: float  # of the smooth shape that its place was found with
    clear: float  # depth over its ±: below `STANDS_OUT` no scar stands out
    ridges_mm2: tuple[float, float] = (0.0, 0.0)  # area that stands up beside either edge
    ridge_uncertainty_mm2: float = 0.0  # of either
    spikes: int = 0  # points that were left out
    messages: tuple[str, ...] = ()  # what the user should know

    @property
    def student_factor(self) -> float:
        """What its variances are more by than the spectrum's own: ν/(ν-2), that of Student's t."""
        return student_factor_of(self.degrees_of_freedom)

    @property
    def width_mm(self) -> float:
        """Distance of the edges, mm."""
        return self.edges_mm[1] - self.edges_mm[0]

    @property
    def centre_mm(self) -> float:
        """Middle between the edges, mm."""
        return 0.5 * (self.edges_mm[0] + self.edges_mm[1])


def student_factor_of(degrees_of_freedom: float) -> float:
    """Variance of Student's t over the normal one's, ν/(ν - 2), of ν = 3 at least; 1 at infinity.
    It is also the mean of the true variance over one that is estimated with ν degrees of freedom.
    Source: JCGM 101:2008, 6.4.9.3.
    """
    freedom = max(degrees_of_freedom, 3.0)
    return freedom / (freedom - 2.0) if np.isfinite(freedom) else 1.0


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

_USUAL, _SPREAD = 2.5, 0.28
"""Exponents m: the prior's middle, and its standard deviation of ln m."""

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
    inside = (np.arange(_PARTS) - 0.5 * (_PARTS - 1)) * (x_mm[1] - x_mm[0]) / _PARTS
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
    covariance: Array
    depth_um: float = 0.0
    clear: float = 0.0

    @property
    def edges_mm(self) -> tuple[float, float]:
        """The left and the right edge, mm."""
        return self.centre_mm - self.half_mm, self.centre_mm + self.half_mm

    @property
    def edge_uncertainty_mm(self) -> tuple[float, float]:
        """Standard uncertainties of the left and the right edge, c - a and c + a, mm."""
        (centre, shared), (_, half) = self.covariance[:2, :2]
        variance = centre + half + 2.0 * shared * np.array([-1.0, 1.0])
        left_mm, right_mm = np.sqrt(variance + (_EDGE_MODEL * self.half_mm) ** 2).tolist()
        return left_mm, right_mm


def whitening(x_mm: Array, covariance: Array) -> Array:
    """Heights to what is white (n, n): roughness and form taken off, and the tilt projected out."""
    form, spread = legendre(x_mm, FORM_DEGREES[-1]), form_spread(x_mm, FORM_DEGREES[-1])
    curved = form[:, 2:] * spread[2:]
    root = np.linalg.inv(np.linalg.cholesky(covariance + curved @ curved.T))
    q = np.linalg.qr(root @ form[:, :2])[0]
    return np.asarray(root - q @ (q.T @ root))


def first_place(x_mm: Array, z_um: Array, white: Array) -> ScarShape:
    """The place of an arc that with the form leaves least of the heights (n,) on bins (n,)."""
    step, length = x_mm[1] - x_mm[0], x_mm[-1] - x_mm[0]
    z = white @ z_um
    best, at = -1.0, (0.0, 1.0)
    for half in np.geomspace(_NARROWEST * step, _WIDEST * length, _HALF_WIDTHS):
        centres = np.linspace(x_mm[0] + half, x_mm[-1] - half, _PLACES)
        columns = white @ np.maximum(1.0 - ((x_mm[:, None] - centres) / half) ** 2, 0.0)
        gain = (columns.T @ z) ** 2 / np.maximum((columns**2).sum(axis=0), 1e-12)
        k = int(np.argmax(gain))
        if gain[k] > best:
            best, at = float(gain[k]), (float(centres[k]), float(half))
    # the search is as coarse as a tenth of the half-width
    return ScarShape(*at, _USUAL, np.diag([0.0, 0.1 * at[1], 0.0]) ** 2)


def refine_place(x_mm: Array, z_um: Array, start: ScarShape, white: Array) -> ScarShape:
    """The least-squares place, by steps in c, ln a and ln m with depth and form solved for."""
    z = white @ z_um
    length, step_mm = float(x_mm[-1] - x_mm[0]), float(x_mm[1] - x_mm[0])
    low = [x_mm[0], np.log(_NARROWEST * step_mm), -np.inf]
    high = [x_mm[-1], np.log(_WIDEST * length), np.inf]

    def column(values: Array) -> tuple[Array, float, float]:
        """The whitened shape (n,) of c, ln a and ln m, its square, and its depth below zero."""
        c = white @ shape(x_mm, values[0], *np.exp(values[1:]))
        square = max(float(c @ c), 1e-300)
        return c, square, float(c @ z) / square

    def residual(values: Array) -> Array:
        """What the best depth leaves (n,), and how far the exponent is from what is usual."""
        c, _, depth = column(values)
        return np.append(z - depth * c, (values[2] - np.log(_USUAL)) / _SPREAD)

    first = np.array([start.centre_mm, np.log(start.half_mm), np.log(start.exponent)])
    scale = [start.half_mm, 1.0, 1.0]
    best = least_squares(residual, np.clip(first, low, high), bounds=(low, high), x_scale=scale)
    _, square, depth = column(best.x)
    half, exponent = np.exp(best.x[1:]).tolist()
    scale = [1.0, half, exponent]
    return ScarShape(
        centre_mm=float(best.x[0]), half_mm=half, exponent=exponent, depth_um=-depth,
        covariance=np.linalg.inv(best.jac.T @ best.jac) * np.outer(scale, scale),
        clear=abs(depth) * float(np.sqrt(square)),
    )  # fmt: skip


_GUARD = 2.0
"""Guard beside an edge, over its standard uncertainty; a bin at the least."""

_FLANK = 0.3
"""Width beside an edge in which ridges are looked for, over the half-width."""

_SHOULDERS, _SHOULDER = 0.5, 0.1
"""Least unworn length over the window's, of both sides together, and of each."""

_FEWEST_BINS = 20
"""Bins from which a spectrum and a form can be told."""

_SHALLOWEST = 2e-5
"""Depth over width of a scar, of which less is a slip of units: 20 nm over a millimetre."""


class UnclearScarError(PhysicsError):
    """No scar stands out from a trace's roughness."""


def levelled(trace: Trace) -> LevelledTrace:
    """Level a trace and take its scar's edges and area; one whose scar stands up is turned over.
    UnclearScarError where none stands out; InputError for too little unworn, or another unit.
    """
    bins = bin_trace(trace)
    place, roughness, unworn = _find(bins)
    messages: tuple[str, ...] = ()
    if place.depth_um < 0.0:
        messages += (message("scar_stands_up_so", name=trace.name),)
        bins = replace(bins, z_um=-bins.z_um)
        place = replace(place, depth_um=-place.depth_um)
    if place.clear < STANDS_OUT:
        raise UnclearScarError(
            "no_scar_stands_out_roughness", name=trace.name, depth_um=place.depth_um,
            clear=place.clear, stands_out=STANDS_OUT,
        )  # fmt: skip
    _check_shoulders(bins, place)
    if place.depth_um < _SHALLOWEST * 2e3 * place.half_mm:
        raise InputError(
            "scar_deep_over_mm", name=trace.name, depth_um=place.depth_um, half_mm=2 * place.half_mm
        )
    result = _level(bins, place, roughness, unworn)
    if max(result.ridges_mm2) < STANDS_OUT * result.ridge_uncertainty_mm2:
        return replace(result, messages=messages)
    unworn = unworn & (np.abs(bins.x_mm - place.centre_mm) > (1.0 + _FLANK) * place.half_mm)
    result = _level(bins, place, roughness, unworn, ridged=True)
    left_um, right_um = (1e3 * ridge for ridge in result.ridges_mm2)
    name, worn = trace.name, 1e3 * result.worn_area_mm2
    text = message(
        "ridges_mm_stand_beside", name=name, left_um=left_um, right_um=right_um, worn_area_mm2=worn
    )
    return replace(result, messages=(*messages, text))


def _find(bins: BinnedTrace) -> tuple[ScarShape, Roughness, Mask]:
    """The scar's place, the roughness beside it and the shoulders, each by the others in turn."""
    x, z, n = bins.x_mm, bins.z_um, len(bins.x_mm)
    form = legendre(x, FORM_DEGREES[-1])

    # at first what second differences show, as if it were white
    size = 1.4826 * float(np.median(np.abs(np.diff(z, 2)))) / np.sqrt(6.0)
    white = whitening(x, max(size, 1e-6) ** 2 * np.eye(n))
    place = first_place(x, z, white)
    for _ in range(2):
        roughness = fit_roughness(z, _shoulders(bins, place), form, bins.spacing_mm)
        white = whitening(x, roughness.covariance(n))
        place = refine_place(x, z, first_place(x, z, white), white)
    return place, roughness, _shoulders(bins, place)


def _window(place: ScarShape, spacing_mm: float) -> tuple[float, float]:
    """Ends of a scar with a guard beside each edge, mm."""
    most = 0.5 * place.half_mm
    left_mm, right_mm = (min(max(_GUARD * u, spacing_mm), most) for u in place.edge_uncertainty_mm)
    return place.edges_mm[0] - left_mm, place.edges_mm[1] + right_mm


def _beside(bins: BinnedTrace, place: ScarShape) -> tuple[Mask, Mask]:
    """Bins left and right of the window."""
    low, high = _window(place, bins.spacing_mm)
    half = 0.5 * bins.spacing_mm
    return bins.x_mm < low - half, bins.x_mm > high + half


def _check_shoulders(bins: BinnedTrace, place: ScarShape) -> None:
    """Refuse a trace whose unworn parts are too short to level it."""
    low, high = _window(place, bins.spacing_mm)
    lengths = bins.spacing_mm * np.array([side.sum() for side in _beside(bins, place)])
    width = high - low
    if lengths.sum() < _SHOULDERS * width or lengths.min() < _SHOULDER * width:
        name, (before, after) = bins.name, lengths
        raise InputError(
            "beside_scar_from_mm", name=name, low=low, high=high, lengths=before, lengths_2=after
        )


def _shoulders(bins: BinnedTrace, place: ScarShape) -> Mask:
    """Bins outside the window that show the unworn surface."""
    before, after = _beside(bins, place)
    unworn = (before | after) & ~bins.filled
    if unworn.sum() < _FEWEST_BINS:
        _check_shoulders(bins, place)
        raise InputError("too_few_points_beside", name=bins.name)
    for _ in range(2):  # dust and scratches
        form = legendre(bins.x_mm, FORM_DEGREES[-1])
        beta = np.linalg.lstsq(form[unworn], bins.z_um[unworn], rcond=None)[0]
        away = np.abs(bins.z_um - form @ beta)
        unworn = unworn & (away <= STANDS_OUT * 1.4826 * float(np.median(away[unworn])) + 1e-12)
    return np.asarray(unworn)


def _level(
    bins: BinnedTrace, place: ScarShape, roughness: Roughness, unworn: Mask, *, ridged: bool = False
) -> LevelledTrace:
    """The levelled trace of a scar; where there are ridges, the window ends at its edges."""
    x, z, step = bins.x_mm, bins.z_um, bins.spacing_mm
    edges = place.edges_mm
    low, high = edges if ridged else _window(place, step)
    covariance = roughness.covariance(len(x))
    levels, weights, drawn = _levels(x, z, unworn, covariance)
    level = np.tensordot(weights, levels, axes=1)
    to_area = 1e-3 * step * _parts(x, step, low, high)  # µm to mm
    rows = to_area @ level - to_area  # of A = rows @ z
    variance, freedom = roughness.variance(rows)
    wider = student_factor_of(freedom)
    areas = np.array([(to_area @ one - to_area) @ z for one in levels])
    shared = float(to_area @ drawn @ to_area + weights @ (areas - weights @ areas) ** 2)
    of_level = to_area @ level
    by_level = of_level @ covariance @ of_level
    # areas above the level, left and right beside the scar
    flank = _FLANK * place.half_mm
    sides = (edges[0] - flank, edges[0]), (edges[1], edges[1] + flank)
    beside = np.array([_parts(x, step, *side) for side in sides])
    of_ridges = 1e-3 * step * (beside - beside @ level)
    left_mm2, right_mm2 = (of_ridges @ z).tolist()
    to_depth = level - np.eye(len(x))
    return LevelledTrace(
        name=bins.name, x_mm=x, depth_um=to_depth @ z, level_um=level @ z, unworn=unworn,
        edges_mm=edges, edge_uncertainty_mm=place.edge_uncertainty_mm, window_mm=(low, high),
        worn_area_mm2=float(rows @ z),
        worn_area_uncertainty_mm2=float(np.sqrt(wider * (variance + shared))),
        degrees_of_freedom=freedom,
        levelling_uncertainty_mm2=float(np.sqrt(wider * (by_level + shared))),
        depth_covariance_um2=wider * (to_depth @ covariance @ to_depth.T + drawn),
        roughness=roughness, deepest_um=place.depth_um, clear=place.clear,
        ridges_mm2=(left_mm2, right_mm2), spikes=bins.spikes,
        ridge_uncertainty_mm2=float(np.sqrt(max(roughness.variance(r)[0] for r in of_ridges))),
    )  # fmt: skip


def _parts(x: Array, step: float, low: float, high: float) -> Array:
    """The part of each bin that lies between two places (n,), 0 to 1."""
    overlap = np.minimum(x + 0.5 * step, high) - np.maximum(x - 0.5 * step, low)
    return np.clip(overlap / step, 0.0, 1.0)


def _levels(x: Array, z: Array, unworn: Mask, covariance: Array) -> tuple[Array, Array, Array]:
    """The level of each degree as a matrix on the heights (d, n, n), its weight (d,), and the
    covariance of their mean, which the forms' prior draws towards none (n, n), µm².
    """
    inverse = np.linalg.inv(covariance[np.ix_(unworn, unworn)])
    heights, count = z[unworn], int(unworn.sum())
    matrices, scores, missed = [], [], []
    for degree in FORM_DEGREES:
        form, spread = legendre(x, degree), form_spread(x, degree)
        unworn_form = form[unworn]
        carried = inverse @ unworn_form
        prior = 1.0 / spread**2
        solved = np.linalg.solve(unworn_form.T @ carried + np.diag(prior), carried.T)
        matrix = np.zeros((len(x), len(x)))
        matrix[:, unworn] = form @ solved
        residual = heights - unworn_form @ (solved @ heights)
        away = float(residual @ inverse @ residual + prior @ (solved @ heights) ** 2)
        scores.append(away + degree * np.log(count))
        matrices.append(matrix)
        curved = form[:, 2:] * spread[2:]
        missed.append(matrix @ curved - curved)
    weight = np.exp(-0.5 * (np.array(scores) - min(scores)))
    weight = weight / weight.sum()
    drawn = sum(share * (part @ part.T) for share, part in zip(weight, missed, strict=True))
    return np.array(matrices), weight, np.asarray(drawn)
