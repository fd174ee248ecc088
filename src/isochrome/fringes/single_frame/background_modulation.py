"""The dark and the bright end of a frame without no-load frames, from its fringes alone.

The light is I^g = D (1 - s) + B s, s = sin² pi N, with D and B slowly varying over the frame:
polynomials of the place; and g, where wanted, the exponent that the light's linearisation lacks.
Each of many patches has an N of its own, so that the ends and the exponent are what all patches
together leave open (see `end_search`). Where a patch spans no
crest its order follows any change of the ends, and it says nothing of them: the ends come with
their covariance, and the order is as uncertain as they make it.

How long a frame was exposed against its no-load frames, from its fringes' crests and troughs.

The frame's ends are its no-load frames' times a factor each, D' = d D and B' = b B: another
exposure, gain or lamp, and a sensor's offset need not go with them. All along a crest, N = 1/2,
3/2, ..., the light is b B, whatever the background: I/B has one value there, and none above it. So
has I/D along a trough. A line of greatest order is no crest, and its light changes along it; but
where it hardly does, the light alone cannot tell a crest of N = 1/2 under less light from a ridge
of the order below 1/2, unless a trough is in the frame too: an order that is 0 along a line is not
generic.
The lines are where the gradient vanishes across the direction of the largest curvature.
Source: Steger (1998), IEEE TPAMI 20, 113, for the lines.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy import ndimage

from isochrome.errors import InputError
from isochrome.fringes.single_frame.end_images import (
    QUADRATICS,
    SmoothImages,
    bright_lines,
    shapes_of_ends,
    surface_above,
    surface_through,
    variance_of_ends,
)
from isochrome.fringes.single_frame.end_search import (
    NOT_TOLD,
    TONES,
    EndProblem,
    Found,
    eliminated,
    ends_at,
    fresh_patches,
    overlap,
    possible,
    search_all,
    search_on,
)
from isochrome.fringes.single_frame.patches import binned
from isochrome.fringes.windows import LIGHT_ERROR, Array, Mask, gaussian

_LEAST_PIXELS = 100
"""Binned pixels that the shorter side of a frame keeps, eight patches or so: the ends vary slowly,
binned pixels tell as much, far faster, and their patches span crests."""
_LOW, _HIGH = 1.0, 99.0
"""Percentiles of the light at which the search for the ends starts: both occur in a frame that
holds at least one whole fringe."""
_LEAST_CONTRAST = 6.0
"""Of those, over the noise of a binned pixel: noise alone makes 4.65."""
_CREST = 0.6
"""Share of the contrast from which a bright line may be a crest."""
_BLACK = 1e-6
_EVEN = 0.1
"""Spots and bars of a lamp that shows none, over those of one that does: no lamp is a quadratic."""
_NEAR_END = 1.1
"""Times the least exponent, or a share of the largest: a search so near to its end was stopped."""


@dataclass(frozen=True, kw_only=True)
class BackgroundModulation:
    """Light of the dark and the bright end (rows, cols), and how well they are known.

    The light is I^g = D (1 - s) + B s, s = sin² pi N; D `dark`, B `bright`, sums of given shapes,
    and the exponent g `tone`, 1 where it was not asked for. `settled`: the search came to rest;
    `given`: which ends no-load frames gave; `variance` (3, 3, rows, cols) of D, B and g; `others`
    explain the frame about as well, under which its orders may be others.
    """

    dark: Array = field(repr=False)
    bright: Array = field(repr=False)
    settled: bool = True
    tone: float = 1.0
    tone_uncertainty: float = 0.0
    given: tuple[bool, bool]
    variance: Array = field(repr=False)
    others: tuple[BackgroundModulation, ...] = field(default=(), repr=False)

    def signal_uncertainty(self, light: Array) -> Array:
        """Standard uncertainty of s = (I^g - D)/(B - D) by that of D, B and g (rows, cols).

        Parameters: `light` I (rows, cols), linear but for the exponent g.
        """
        level = np.maximum(light, _BLACK)
        linear = level**self.tone
        contrast = np.maximum(self.bright - self.dark, _BLACK)
        signal = np.clip((linear - self.dark) / contrast, 0.0, 1.0)
        tone = linear * np.log(level)  # dI^g/dg, less what a given end follows of it
        parts = [1.0 - signal, signal]
        for end, share, known in zip((self.dark, self.bright), parts, self.given, strict=True):
            if known:
                tone = tone - share * end * np.log(np.maximum(end, _BLACK)) / self.tone
        parts.append(-tone)
        square = np.einsum("iyx,jyx,ijyx->yx", parts, parts, self.variance)
        return np.asarray(np.sqrt(np.maximum(square, 0.0)) / contrast)


def exact_ends(dark: Array, bright: Array) -> BackgroundModulation:
    """Take no-load frames for the ends of a frame, without an uncertainty of their own."""
    exact = np.broadcast_to(0.0, (3, 3, *dark.shape))
    return BackgroundModulation(dark=dark, bright=bright, given=(True, True), variance=exact)


def fit_background_modulation(
    light: Array,
    sigma: Array,
    valid: Mask,
    *,
    dark: Array | None = None,
    bright: Array | None = None,
    tone: bool = False,
) -> BackgroundModulation:
    """Find the dark and bright ends of a frame in which both occur.

    `light`, linear but for an exponent where `tone` asks for it; `dark`, `bright`: ends that
    no-load frames give, of the same linearity. InputError where the frame has no contrast, or no
    fringe that can be followed, or where its fringes leave ends or exponent open.
    """
    problem, starts = _problem(light, sigma, valid, (dark, bright), tone)
    results = _searched(problem, starts)
    if not tone:
        best, *others = (_as_images(light.shape, dark, bright, result) for result in results)
        return replace(best, others=tuple(others))
    result = as_doubtful(results)
    # a bin's mean is that of the light only where the light is linear: once more, nearly so
    first = _told_tone(float(result.unknowns[-1]))
    linear = np.maximum(light, _BLACK) ** first
    noise = first * np.maximum(light, sigma) ** (first - 1.0) * sigma
    low, high = (None if end is None else end**first for end in (dark, bright))
    problem, _ = _problem(linear, noise, valid, (low, high), True)
    again = as_doubtful(_searched(problem, [np.append(result.unknowns[:-1], 1.0)]))
    done = _as_images(light.shape, low, high, again)
    per_tone = np.array([1.0, 1.0, first])[:, None, None]
    return replace(
        done, tone=_told_tone(first * done.tone), tone_uncertainty=first * done.tone_uncertainty,
        variance=done.variance * per_tone[:, None] * per_tone[None],
    )  # fmt: skip


def _searched(problem: EndProblem, starts: list[Array]) -> list[Found]:
    """The results that the frame does not exclude, of a lamp of spots and bars and of an even one.

    The richer light comes first: where an even lamp's search rests in a frame of spots, patches lie
    on the wrong sides of crests. An even lamp is then searched from where the other rests, and is
    as uncertain as slight spots leave it.
    """
    spotted = search_all(problem, starts)
    dark, lamp = problem.shapes
    if not isinstance(lamp, SmoothImages):
        return possible(spotted)
    cut, count = (len(spread) for spread in problem.spreads)
    selected = np.ones(cut + count + 1, dtype=bool)
    selected[cut + QUADRATICS : -1] = False
    slight = replace(lamp, spread=lamp.spread * np.where(selected[cut:-1], 1.0, _EVEN))
    quadratics = lamp.first(QUADRATICS)
    even = replace(problem, shapes=(dark, quadratics))
    smooth = quadratics.images.reshape(-1, QUADRATICS)
    begin = []
    for result in possible(spotted):
        bright = problem.ends(result.unknowns)[1].ravel()
        quadratic = np.linalg.lstsq(smooth, bright, rcond=None)[0]
        begin.append(np.concatenate([result.unknowns[:cut], quadratic, result.unknowns[-1:]]))
    nearly = replace(problem, shapes=(dark, slight))
    plain = [search_on(_among(result, selected), nearly) for result in search_all(even, begin)]
    return possible(plain, spotted)


def _among(result: Found, selected: Mask) -> Found:
    """A result of some of the unknowns as one of all, the others being nought."""
    unknowns, covariance = np.zeros(selected.size), np.zeros((selected.size, selected.size))
    unknowns[selected] = result.unknowns
    covariance[np.ix_(selected, selected)] = result.covariance
    return replace(result, unknowns=unknowns, covariance=covariance)


def as_doubtful(results: list[Found]) -> Found:
    """The first of some results, as uncertain as the others make it.

    Parameters: the `results`, such as `possible` ones.
    """
    best, *others = results
    away = [other.unknowns - best.unknowns for other in others]
    return replace(best, covariance=best.covariance + sum(np.outer(a, a) for a in away))


def _told_tone(tone: float) -> float:
    """A tone exponent that lies within what cameras have. Raises InputError on another one."""
    if _NEAR_END * TONES[0] < tone < TONES[1] / _NEAR_END:
        return tone
    raise InputError("gamma_cannot_found_from", tone=tone, tones=TONES[0], tones_2=TONES[1])


def gamma_misfit(
    light: Array, sigma: Array, valid: Mask, ends: tuple[Array, Array]
) -> tuple[float, float]:
    """Find g - 1 of the tone exponent by the fringes' shape, and its uncertainty.

    By one linear step from 1: enough to tell that the light is not linear, not how far. `ends`,
    found or given. InputError where no fringe can be followed, or the fringes leave the exponent
    open.
    """
    problem, starts = _problem(light, sigma, valid, ends, True)
    data, orders, _ = fresh_patches(problem, starts[0])
    try:
        normal = eliminated(data, ends_at(data, starts[0]), orders)
        covariance = np.linalg.inv(normal.matrix)
    except np.linalg.LinAlgError as error:
        raise InputError(NOT_TOLD) from error
    uncertainty = np.sqrt(overlap(data) * covariance[-1, -1])
    return float((covariance @ normal.slope)[-1]), float(uncertainty)


def _binning(shape: tuple[int, ...]) -> int:
    """Pixels a side of a bin."""
    return 1 << int(np.log2(max(min(shape) // _LEAST_PIXELS, 1)))


def _problem(
    light: Array, sigma: Array, valid: Mask, ends: tuple[Array | None, Array | None], tone: bool
) -> tuple[EndProblem, list[Array]]:
    """The problem on binned pixels, and where to start."""
    by = _binning(light.shape)
    small, noise, trusted = binned(light, sigma, valid, by)
    if not trusted.any():
        raise InputError("no_part_frame_trusted")
    low, high = np.percentile(small[trusted], [_LOW, _HIGH])
    if not high - low > _LEAST_CONTRAST * np.median(noise[trusted]):
        raise InputError("frame_has_no_contrast_light")
    dark, bright = (
        smooth if end is None else binned(end, np.ones_like(end), valid, by)[0]
        for end, smooth in zip(ends, shapes_of_ends(light.shape, by), strict=True)
    )
    problem = EndProblem(
        light=small, sigma=noise, valid=trusted, shapes=(dark, bright), tone=tone,
        scale=float(high - low), by=by,
    )  # fmt: skip
    flat = [
        np.eye(len(spread))[0] * (1.0 if known else level)
        for known, level, spread in zip(problem.given, (low, high), problem.spreads, strict=True)
    ]
    if not isinstance(bright, SmoothImages):
        return problem, [np.concatenate([*flat, [1.0]])]
    brights = _brights(problem, bright, low)
    return problem, [np.concatenate([flat[0], terms, [1.0]]) for terms in brights]


def _brights(problem: EndProblem, lamp: SmoothImages, low: float) -> list[Array]:
    """Bright ends to start from: a smooth one above the light, and one that all crests lie on."""
    images, spread = lamp.images, problem.scale * lamp.spread
    above = np.zeros(spread.size)  # spots begin at nought
    smooth = np.s_[:QUADRATICS]
    above[smooth] = surface_above(
        problem.light, problem.valid, images[..., smooth], spread[smooth], problem.scale
    )
    lines = bright_lines(problem.light, problem.sigma, problem.valid)
    lines[~(lines > low + _CREST * (lamp.sum(above) - low))] = np.nan
    if not np.isfinite(lines).any():
        return [above]
    return [above, surface_through(lines, images, spread, problem.scale)]


def _as_images(
    shape: tuple[int, ...], dark: Array | None, bright: Array | None, result: Found
) -> BackgroundModulation:
    """The ends on all pixels."""
    full = shapes_of_ends(shape, 1)
    given = dark is not None, bright is not None
    g = float(result.unknowns[-1])
    cut = 1 if given[0] else full[0].spread.size
    return BackgroundModulation(
        dark=full[0].sum(result.unknowns[:cut]) if dark is None else dark**g,
        bright=full[1].sum(result.unknowns[cut:-1]) if bright is None else bright**g,
        settled=result.rests, tone=g, tone_uncertainty=float(np.sqrt(result.covariance[-1, -1])),
        given=given, variance=variance_of_ends(shape, given, cut, result.covariance),
    )  # fmt: skip


_WIDTHS, _NARROWEST_PX = (16, 32, 64), 1.5
"""Smoothings to try: standard deviations in the frame's shorter side, and pixels at least."""

_NARROW = 0.05
"""Share of the fringe's light that smoothing may take off a line."""

_LENGTH = 0.2
"""Length of a line that says something, over the frame's shorter side."""

_OFF, _SHARP = 0.6, 4.0
"""A line's distance from its pixel at most, pixels, and its curvature over that of noise."""

_SCATTER, _ALIKE = 0.007, 0.02
"""Scatter of the light along a line; share by which other light may pass it, and by which an
exposure must differ to be another."""

_STRAIGHT = 0.2
"""Curvature of the light along a line over that across: a flat extremum of the order has both."""

_BLACKEST = 0.005
"""Dark end, over the bright one, below which its factor changes nothing and is not looked for."""

_LIFT = 0.1
"""Share of the bright end by which light is lifted to look for its dark lines."""

_SMOOTH_PX = 3.0
_UNSEEN = 0.5
"""Standard uncertainty, over b, of the dark frame's factor where no trough is in the frame."""

_SURE = 3.0


@dataclass(frozen=True)
class NoLoadExposure:
    """Factors that make the no-load frames a frame's own ends, 1 where nothing speaks against it.

    `told`: a crest tells b, the factor `bright`; `dark_told`: a trough tells d, `dark`, or the dark
    end is black; `ends`, the frame's, where they are not the no-load frames; `crest_sure`: the line
    that told b must be a crest, since a trough is in the frame, or b is 1.
    """

    dark: float = 1.0
    bright: float = 1.0
    told: bool = False
    ends: BackgroundModulation | None = None
    dark_told: bool = True
    crest_sure: bool = True


def find_no_load_exposure(
    light: Array, sigma: Array, valid: Mask, *, dark: Array, bright: Array
) -> NoLoadExposure:
    """Find a frame's exposure over that of each of its no-load frames `dark` and `bright`.

    `light` is linear, `sigma` its noise; the no-load frames are of the same linearity.
    """
    by = _binning(light.shape)  # lines that say something are long, and their ends smooth
    low, high = (binned(_smooth(end), sigma, valid, by)[0] for end in (dark, bright))
    light, sigma, valid = binned(light, sigma, valid, by)
    lit = valid & (high > 0.1 * np.median(high))
    crest = _level(light, sigma, high, lit)
    if crest is None:
        return NoLoadExposure()
    b, by_crest = crest
    share = float(np.median(low[lit] / high[lit]))
    black = share < _BLACKEST
    trough = None if black else _level(light, sigma, low, lit & (low > 0.0), b * high)
    d, by_trough = trough or (b, by_crest if black else _UNSEEN * b)
    moved = max(abs(b - 1.0) - _SURE * by_crest, share * (abs(d - 1.0) - _SURE * by_trough))
    if moved < _ALIKE:
        return NoLoadExposure(told=True)
    variance = np.zeros((3, 3, *dark.shape))
    sides = (dark, d, by_trough), (bright, b, by_crest)
    for i, (end, factor, spread) in enumerate(sides):
        noise = factor * 1.4826 * float(np.median(np.abs(end - _smooth(end))))
        variance[i, i] = (spread * end) ** 2 + noise**2
    ends = BackgroundModulation(
        dark=d * dark, bright=b * bright, given=(False, False), variance=variance
    )
    crest_sure = trough is not None or _has_trough(light, sigma, b * high, lit, share)
    return NoLoadExposure(d, b, True, ends, black or trough is not None, crest_sure)


def _has_trough(light: Array, sigma: Array, bright: Array, lit: Mask, share: float) -> bool:
    """Whether there is a line as dark as the dark end, a `share` of the bright one, may be."""
    lifted = _level(light + _LIFT * bright, sigma, bright, lit, bright)
    if lifted is None:
        return False
    level, uncertainty = lifted[0] - _LIFT, 3.0 * lifted[1] + _BLACKEST
    return -uncertainty < level < share / _UNSEEN + uncertainty


def _smooth(end: Array) -> Array:
    """A no-load frame without its noise; a lamp's bright spot keeps its height.

    Equation: 2 G - G * G, which changes nothing up to the third derivative.
    """
    once = ndimage.gaussian_filter(end, _SMOOTH_PX, mode="nearest")
    return np.asarray(2.0 * once - ndimage.gaussian_filter(once, _SMOOTH_PX, mode="nearest"))


def _level(
    light: Array, sigma: Array, end: Array, lit: Mask, bright: Array | None = None
) -> tuple[float, float] | None:
    """Factor of an end by the lines on which the light is its, and its standard uncertainty.

    Parameters: `end`, smooth; `lit`, where it can be divided by; `bright`, the light on crests
    where troughs are looked for. None where there is no such line.
    """
    sign = 1.0 if bright is None else -1.0
    safe = np.where(lit, end, 1.0)
    ratio = sign * np.where(lit, light / safe, 0.0)
    ratio = np.where(lit, ratio, np.median(ratio[lit]))
    noise = float(np.median(sigma[lit] / safe[lit]))
    fringe = np.maximum(np.abs(ratio) if bright is None else bright / safe, noise)
    widths = [max(_NARROWEST_PX, min(light.shape) / many) for many in _WIDTHS]
    # wide smoothing takes narrow fringes away, which may be brighter than the line
    finest = gaussian(ratio, widths[-1])
    brightest = float(np.percentile(finest[_inner(lit, widths[-1])], 99.5))
    brightest -= 2.0 * noise / widths[-1]
    for width in widths:
        level = _level_at(ratio, fringe, noise, lit, width)
        if level is None or sign * level[0] <= 0.0:
            continue
        if brightest - level[0] < _ALIKE * abs(level[0]):
            return abs(level[0]), level[1]
    return None


def _inner(lit: Mask, width: float) -> Mask:
    """Where neither the border nor what is not seen lies within reach of a smoothing."""
    inner = lit if lit.all() else gaussian(lit.astype(float), width) > 0.98
    return np.asarray(ndimage.binary_erosion(inner, iterations=int(width)))


def _level_at(
    ratio: Array, fringe: Array, noise: float, lit: Mask, width: float
) -> tuple[float, float] | None:
    """The greatest value that a ratio has all along a line, at one width of smoothing (pixels).

    Parameters: `fringe` (rows, cols), the ratio's change from a trough to a crest. Pieces of a line
    that are less apart than its smoothing are one.
    """
    smooth, across, bend, along = _lines(ratio, width)
    sharp = _SHARP * noise * np.sqrt(3.0 / (16.0 * np.pi)) / width**3
    inner = _inner(lit, width)
    if not inner.any():
        return None
    fringe = gaussian(fringe, width)
    lost = _taken_off(bend, fringe, width)
    top = smooth + lost
    line = inner & (np.abs(across) < _OFF) & (bend < -sharp)
    line &= lost < _NARROW * fringe
    at = _greatest_even(line, top, (bend, along), noise, width)
    if at is None:
        return None
    middle, scatter = _middle(top[at])
    along = max(scatter, noise / width) / np.sqrt(max(np.count_nonzero(at) / width, 1.0))
    return middle, float(np.hypot(along, LIGHT_ERROR * middle))


def _greatest_even(
    line: Mask, top: Array, curvature: tuple[Array, Array], noise: float, width: float
) -> Mask | None:
    """The lines of the greatest value that lines have all along; None where there are none.

    Parameters: `curvature`, across and along. Several lines of one value count as one: all crests
    are alike.
    """
    near = ndimage.binary_dilation(line, np.ones((3, 3)), iterations=max(1, int(width / 2.0)))
    pieces, count = ndimage.label(near)
    pieces = np.where(line, pieces, 0)
    even = []
    for piece in range(1, count + 1):
        at = pieces == piece
        middle, scatter = _middle(top[at])
        bend, along = (float(np.median(part[at])) for part in curvature)
        if scatter < _SCATTER * abs(middle) + noise / width and abs(along) < _STRAIGHT * abs(bend):
            even.append((middle, piece))
    for greatest, _ in sorted(even, reverse=True):
        within = _SCATTER * abs(greatest) + noise / width
        at = np.isin(pieces, [p for middle, p in even if 0.0 <= greatest - middle < within])
        if np.count_nonzero(at) > _LENGTH * min(top.shape):
            return np.asarray(at)
    return None


def _middle(values: Array) -> tuple[float, float]:
    """Median of some values, and their scatter."""
    middle = float(np.median(values))
    return middle, 1.4826 * float(np.median(np.abs(values - middle)))


def _taken_off(bend: Array, fringe: Array, width: float) -> Array:
    r"""What smoothing took off a line.

    Equation: of A sin^2(k x/2) a Gaussian of standard deviation w takes A (1 - e^-u)/2 off its
    ends, u = k^2 w^2/2, and leaves a curvature of A k^2 e^-u/2 there, so that w^2 times this over A
    is q = u e^-u, and what is taken off w^2/2 times it times (e^u - 1)/u. u = q + q^2 up to q^3.
    """
    lost = -0.5 * width**2 * bend
    q = np.clip(2.0 * lost / fringe, 0.0, 2.0 * _NARROW)
    return np.asarray(lost * (1.0 + 0.5 * (q + q**2) + q**2 / 6.0))


def _lines(image: Array, width: float) -> tuple[Array, Array, Array, Array]:
    """The smooth image, the distance to a line's middle, the curvature across it and along."""
    smooth, gy, gx, hyy, hyx, hxx = (
        gaussian(image, width, order) for order in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    )
    angle = 0.5 * np.arctan2(2.0 * hyx, hxx - hyy)
    size = np.hypot(0.5 * (hxx - hyy), hyx)
    mean = 0.5 * (hxx + hyy)
    bend = mean - size
    cos, sin = -np.sin(angle), np.cos(angle)
    slope = gx * cos + gy * sin
    return smooth, -slope / np.minimum(bend, -1e-12), bend, mean + size
