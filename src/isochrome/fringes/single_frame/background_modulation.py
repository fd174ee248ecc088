"""The dark and the bright end of a frame without no-load frames, from its fringes alone.

The light is I^g = D (1 - s) + B s, s = sin² pi N, with D and B slowly varying over the frame, sums
of smooth images; and g, where wanted, the exponent that the light's linearisation lacks. Each of
many patches has an N of its own, so that the ends and the exponent are what all patches together
leave open (see `end_search`). Where a patch spans no crest its order follows any change of the
ends, and it says nothing of them: the ends come with their covariance, and the order is as
uncertain as they make it.

How long a frame was exposed against its no-load frames, from its fringes' crests and troughs.

The frame's ends are its no-load frames' times a factor each, D' = d D and B' = b B: another
exposure, gain or lamp, without which a sensor's offset may stay. All along a crest, N = 1/2,
3/2, ..., the light is b B, whatever the background: I/B has one value there, and none above it. So
has I/D along a trough. A line of greatest order is no crest, and its light changes along it; but
where it hardly does, the light alone cannot tell a crest of N = 1/2 under less light from a ridge
of the order below 1/2, unless a trough is in the frame too: an order that is 0 along a line is not
generic.
The lines are where the gradient vanishes across the direction of the largest curvature.
Source: Steger (1998), IEEE TPAMI 20, 113, for the lines.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from scipy import ndimage

from isochrome.errors import InputError
from isochrome.estimation import total_degree
from isochrome.fringes.single_frame.end_search import (
    DEGREE,
    NOT_TOLD,
    QUADRATICS,
    REST,
    TONES,
    EndProblem,
    Found,
    PatchEnds,
    SmoothImages,
    eliminated,
    fresh_patches,
    possible,
    search_all,
    search_on,
)
from isochrome.fringes.single_frame.patches import binned
from isochrome.fringes.skeleton import line_points, noise_gain
from isochrome.fringes.windows import LIGHT_ERROR, Array, Mask, gaussian

_SPOT_SIZE = 0.4
"""Correlation length of spots and bars, in half the frame's side."""
_BEYOND = 1.3
"""Ends of the cosines, in half the frame's side: they are level there, and the light is not."""
_FAINTEST = 0.02
"""Share of the largest deviation below which a cosine is left out."""


def binned_light(
    shape: tuple[int, ...], by: int, *, uneven: float = 0.1, spots: float = 0.0
) -> SmoothImages:
    """What the light of a frame that is read without a model is a sum of, at its binned pixels.
    Powers of the place, -1 to 1 over the frame, of the prior deviation `uneven` over the contrast;
    with `spots` cosines of a Gaussian process of covariance exp(-d²/2l²) by its spectral density
    (Solin & Sarkka (2020), Stat. Comput. 30, 419)."""
    y, x = (2.0 * (by * np.arange(n // by) + 0.5 * (by - 1)) / max(n - 1, 1) - 1.0 for n in shape)
    pairs = [*total_degree(DEGREE)]
    spread = [np.inf, *[uneven] * (len(pairs) - 1)]
    unit = 0.5 * np.pi / _BEYOND
    waves = []  # half-waves down and across, and the root of the density at each
    for i, j in np.ndindex(32, 32) if spots else ():
        size = float(np.exp(-0.25 * unit**2 * (i * i + j * j) * _SPOT_SIZE**2))
        if size > _FAINTEST and i + j:
            waves.append((i, j, size))
    total = np.sqrt(sum(size**2 for _, _, size in waves))
    for i, j, size in waves:  # the cosines stand behind the powers, the first of which is 1
        pairs.append((DEGREE + i if i else 0, DEGREE + j if j else 0))
        spread.append(spots * size / total)
    most = max((max(i, j) for i, j, _ in waves), default=0)
    down, across = (
        np.stack(
            [v**i for i in range(DEGREE + 1)]
            + [np.sqrt(2.0) * np.cos(i * (unit * v + 0.5 * np.pi)) for i in range(1, most + 1)],
            axis=-1,
        )
        for v in (y, x)
    )
    return SmoothImages(down, across, np.array(pairs), np.array(spread))


_ABOVE, _ENOUGH, _ROUNDS = 0.01, 400.0, 12
"""Of the first surface: weight of light below it over light above, and how many pixels' worth the
light counts; rounds of either."""
_LINE_PX, _CLEAR = 3.0, 0.5
"""Width of a bright line that is looked for, and its least curvature over that of noise."""
_STRAY = 0.02
"""Prior deviation of the dark end's quadratics, over the contrast."""
_SPOTS = 0.1
"""Prior deviation of spots and bars, over the contrast, where the frame asks for them."""
_EVERY_PX = 8
"""Over which the ends' uncertainty is taken as linear."""
_NEAR, _LENGTH_PX = 0.02, 6.0
"""A surface is asked to pass the crests within a share of the contrast, which is told anew after
some pixels of a line."""


def shapes_of_ends(shape: tuple[int, ...], by: int) -> tuple[SmoothImages, SmoothImages]:
    """What the dark and the bright end are sums of: stray light is nearly even, a lamp is not."""
    return binned_light(shape, by, uneven=_STRAY), binned_light(shape, by, spots=_SPOTS)


def bright_lines(light: Array, sigma: Array, valid: Mask) -> Array:
    """The light (rows, cols) on lines that are brighter than either side; NaN elsewhere."""
    strength, _, _, level = line_points(np.where(valid, light, np.nan), _LINE_PX)
    return np.where(-strength > _CLEAR * noise_gain(_LINE_PX) * sigma, level, np.nan)


def surface_through(crests: Array, shapes: Array, spread: Array, contrast: float) -> Array:
    """Terms of the bright end that lies on bright lines, as if each of them were a crest.
    Iteratively reweighted: what lies far below the surface is no crest (Cauchy's weights). `crests`
    (rows, cols), NaN elsewhere; `shapes` (rows, cols, terms), `spread`, their prior deviations."""
    on_line = np.isfinite(crests)
    near = _NEAR * contrast

    def weights(away: Array) -> Array:
        below = np.maximum(-away, 0.0) / near
        return np.asarray(1.0 / (1.0 + (0.5 * below) ** 2) / (_LENGTH_PX * near**2))

    return _reweighted(shapes[on_line], crests[on_line], spread, weights)


def _reweighted(
    rows: Array, values: Array, spread: Array, weights: Callable[[Array], Array]
) -> Array:
    """Terms of a sum of `rows` (n, terms), by `weights` of what they leave of some values (n,)."""
    weight = weights(np.zeros(len(values)))
    for _ in range(_ROUNDS):
        weighted = rows * weight[:, None]
        terms = np.linalg.solve(weighted.T @ rows + np.diag(spread**-2.0), weighted.T @ values)
        weight = weights(values - rows @ terms)
    return np.asarray(terms)


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
    """Light of the dark and the bright end (rows, cols), and how well they are known. D `dark`, B
    `bright` and the exponent g `tone` of the module. `settled`: the search came to rest; `given`:
    which ends no-load frames gave; `variance` (3, 3, rows, cols) of D, B and g; `others` explain
    the frame about as well, under which its orders may be others."""

    dark: Array = field(repr=False)
    bright: Array = field(repr=False)
    settled: bool = True
    tone: float = 1.0
    tone_uncertainty: float = 0.0
    given: tuple[bool, bool]
    variance: Array = field(repr=False)
    others: tuple[BackgroundModulation, ...] = field(default=(), repr=False)

    def signal_uncertainty(self, light: Array) -> Array:
        """Standard uncertainty of s = (I^g - D)/(B - D) by that of D, B and g (rows, cols)."""
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
    light: Array, sigma: Array, valid: Mask,
    *, dark: Array | None = None, bright: Array | None = None, tone: bool = False,
) -> BackgroundModulation:  # fmt: skip
    """Find the dark and bright ends of a frame in which both occur. `light`, linear but for an
    exponent where `tone` asks for it; `dark`, `bright`: ends that no-load frames give, of the same
    linearity. InputError where the frame has no contrast, or no fringe that can be followed, or
    where its fringes leave ends or exponent open."""
    problem, starts = _problem(light, sigma, valid, (dark, bright), tone)
    results = _searched(problem, starts)
    if not tone:
        best, *others = (_as_images(light.shape, dark, bright, result) for result in results)
        return replace(best, others=tuple(others))
    result = as_doubtful(results)
    # a bin's mean is that of the light only where the light is linear: once more, nearly so
    first = _told_tone(float(result.unknowns[-1]))
    noise = first * np.maximum(light, sigma) ** (first - 1.0) * sigma
    low, high = (None if end is None else end**first for end in (dark, bright))
    problem, _ = _problem(np.maximum(light, _BLACK) ** first, noise, valid, (low, high), True)
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
    on the wrong sides of crests. An even lamp is searched from there, as uncertain as slight
    spots."""
    spotted = search_all(problem, starts)
    dark, lamp = problem.shapes
    if not isinstance(lamp, SmoothImages):
        return possible(spotted)
    cut, count = (len(spread) for spread in problem.spreads)
    selected = np.ones(cut + count + 1, dtype=bool)
    selected[cut + QUADRATICS : -1] = False
    slight = replace(lamp, spread=lamp.spread * np.where(selected[cut:-1], 1.0, _EVEN))
    pairs = lamp.pairs[:QUADRATICS]
    a, b = pairs.max(axis=0) + 1
    quadratics = SmoothImages(lamp.down[:, :a], lamp.across[:, :b], pairs, lamp.spread[:QUADRATICS])
    smooth = quadratics.images.reshape(-1, QUADRATICS)
    begin = []
    for result in possible(spotted):
        bright = problem.ends(result.unknowns)[1].ravel()
        quadratic = np.linalg.lstsq(smooth, bright, rcond=None)[0]
        begin.append(np.concatenate([result.unknowns[:cut], quadratic, result.unknowns[-1:]]))
    plain = []
    for result in search_all(replace(problem, shapes=(dark, quadratics)), begin):
        # of some of the unknowns as one of all, the others being nought
        unknowns, covariance = np.zeros(selected.size), np.zeros((selected.size, selected.size))
        unknowns[selected] = result.unknowns
        covariance[np.ix_(selected, selected)] = result.covariance
        among = replace(result, unknowns=unknowns, covariance=covariance)
        plain.append(search_on(among, replace(problem, shapes=(dark, slight))))
    return possible(plain, spotted)


def as_doubtful(results: list[Found]) -> Found:
    """The first of some results, as uncertain as the others make it."""
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
    """Find g - 1 of the tone exponent by the fringes' shape, and its uncertainty. By one linear
    step from 1: enough to tell that the light is not linear, not how far. InputError where no
    fringe can be followed, or the fringes leave the exponent open."""
    problem, starts = _problem(light, sigma, valid, ends, True)
    data, orders, _ = fresh_patches(problem, starts[0])
    try:
        normal = eliminated(PatchEnds(data, starts[0]), orders)
        covariance = np.linalg.inv(normal.matrix)
    except np.linalg.LinAlgError as error:
        raise InputError(NOT_TOLD) from error
    uncertainty = float(np.sqrt(data.overlap * covariance[-1, -1]))
    return float((covariance @ normal.slope)[-1]), uncertainty


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
    brights = [flat[1]]
    if isinstance(bright, SmoothImages):  # above the light, and one that all crests lie on
        images, spread = bright.images, problem.scale * bright.spread
        gain = _ENOUGH / (np.count_nonzero(trusted) * (0.05 * problem.scale) ** 2)
        smooth = np.s_[:QUADRATICS]
        above = np.zeros(spread.size)  # spots begin at nought
        above[smooth] = _reweighted(  # asymmetric least squares: it rests on the light
            images[trusted][:, smooth], small[trusted], spread[smooth],
            lambda away: gain * np.where(away > 0.0, 1.0, _ABOVE),
        )  # fmt: skip
        lines = bright_lines(small, noise, trusted)
        lines[~(lines > low + _CREST * (bright.sum(above) - low))] = np.nan
        brights = [above]
        if np.isfinite(lines).any():
            brights.append(surface_through(lines, images, spread, problem.scale))
    return problem, [np.concatenate([flat[0], terms, [1.0]]) for terms in brights]


def _as_images(
    shape: tuple[int, ...], dark: Array | None, bright: Array | None, result: Found
) -> BackgroundModulation:
    """The ends on all pixels, and the covariance of both and the exponent there: it is smooth."""
    full = shapes_of_ends(shape, 1)
    given = dark is not None, bright is not None
    g = float(result.unknowns[-1])
    cut = 1 if given[0] else full[0].spread.size
    by = max(1, min(_EVERY_PX, *(n // 4 for n in shape)))
    spread, turn = np.linalg.eigh(result.covariance)
    root = (turn * np.sqrt(np.maximum(spread, 0.0)))[:, spread > 0.0]
    images = [smooth.images for smooth in shapes_of_ends(shape, by)]
    errors = [
        np.zeros((*image.shape[:2], root.shape[1])) if known else image @ part
        for image, part, known in zip(images, (root[:cut], root[cut:-1]), given, strict=True)
    ]
    errors.append(np.broadcast_to(root[-1], errors[0].shape))
    coarse, size = np.einsum("iyxk,jyxk->ijyx", errors, errors), shape[::-1]
    variance = [
        [cv2.resize(each, size, interpolation=cv2.INTER_LINEAR) for each in row] for row in coarse
    ]
    return BackgroundModulation(
        dark=full[0].sum(result.unknowns[:cut]) if dark is None else dark**g,
        bright=full[1].sum(result.unknowns[cut:-1]) if bright is None else bright**g,
        settled=result.change < REST, given=given, variance=np.array(variance),
        tone=g, tone_uncertainty=float(np.sqrt(result.covariance[-1, -1])),
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
    that told b must be a crest, since a trough is in the frame, or b is 1."""

    dark: float = 1.0
    bright: float = 1.0
    told: bool = False
    ends: BackgroundModulation | None = None
    dark_told: bool = True
    crest_sure: bool = True


def find_no_load_exposure(
    light: Array, sigma: Array, valid: Mask, *, dark: Array, bright: Array
) -> NoLoadExposure:
    """Find a frame's exposure over that of each of its no-load frames, of the same linearity."""
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
    crests = b * high
    trough = None if black else _level(light, sigma, low, lit & (low > 0.0), crests)
    d, by_trough = trough or (b, by_crest if black else _UNSEEN * b)
    moved = max(abs(b - 1.0) - _SURE * by_crest, share * (abs(d - 1.0) - _SURE * by_trough))
    if moved < _ALIKE:
        return NoLoadExposure(told=True)
    variance = np.zeros((3, 3, *dark.shape))
    for i, (end, factor, spread) in enumerate(((dark, d, by_trough), (bright, b, by_crest))):
        noise = factor * 1.4826 * float(np.median(np.abs(end - _smooth(end))))
        variance[i, i] = (spread * end) ** 2 + noise**2
    ends = BackgroundModulation(
        dark=d * dark, bright=b * bright, given=(False, False), variance=variance
    )
    crest_sure, lifted = trough is not None, None
    if not crest_sure:
        lifted = _level(light + _LIFT * crests, sigma, crests, lit, crests)
    if lifted is not None:  # whether a line is as dark as the dark end, a share of the bright one
        level, uncertainty = lifted[0] - _LIFT, 3.0 * lifted[1] + _BLACKEST
        crest_sure = -uncertainty < level < share / _UNSEEN + uncertainty
    return NoLoadExposure(d, b, True, ends, black or trough is not None, crest_sure)


def _smooth(end: Array) -> Array:
    """A no-load frame without its noise, 2 G - G * G: a lamp's bright spot keeps its height."""
    once = ndimage.gaussian_filter(end, _SMOOTH_PX, mode="nearest")
    return np.asarray(2.0 * once - ndimage.gaussian_filter(once, _SMOOTH_PX, mode="nearest"))


def _level(
    light: Array, sigma: Array, end: Array, lit: Mask, bright: Array | None = None
) -> tuple[float, float] | None:
    """Factor of a smooth `end` by the lines on which the light is its, and its uncertainty. `lit`,
    where it can be divided by; `bright`, the light on crests where troughs are looked for. None
    where there is no such line."""
    sign = 1.0 if bright is None else -1.0
    safe = np.where(lit, end, 1.0)
    ratio = sign * np.where(lit, light / safe, 0.0)
    ratio = np.where(lit, ratio, np.median(ratio[lit]))
    noise = float(np.median(sigma[lit] / safe[lit]))
    fringe = np.maximum(np.abs(ratio) if bright is None else bright / safe, noise)
    widths = [max(_NARROWEST_PX, min(light.shape) / many) for many in _WIDTHS]
    # wide smoothing takes narrow fringes away, which may be brighter than the line
    finest = gaussian(ratio, widths[-1])[_inner(lit, widths[-1])]
    brightest = float(np.percentile(finest, 99.5)) - 2.0 * noise / widths[-1]
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
    `fringe` (rows, cols), the ratio's change from a trough to a crest. Of A sin²(k x/2) a Gaussian
    of standard deviation w takes A (1 - e^-u)/2 off its ends, u = k² w²/2, and leaves a curvature
    of A k² e^-u/2 there, so that w² times this over A is q = u e^-u, and what is taken off w²/2
    times it times (e^u - 1)/u. u = q + q² up to q³."""
    smooth, gy, gx, hyy, hyx, hxx = (
        gaussian(ratio, width, order) for order in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    )
    # the distance to a line's middle, the curvature across it and along
    angle = 0.5 * np.arctan2(2.0 * hyx, hxx - hyy)
    size, mean = np.hypot(0.5 * (hxx - hyy), hyx), 0.5 * (hxx + hyy)
    bend, along = mean - size, mean + size
    across = -(gx * -np.sin(angle) + gy * np.cos(angle)) / np.minimum(bend, -1e-12)
    sharp = _SHARP * noise * np.sqrt(3.0 / (16.0 * np.pi)) / width**3
    inner = _inner(lit, width)
    if not inner.any():
        return None
    fringe = gaussian(fringe, width)
    lost = -0.5 * width**2 * bend
    q = np.clip(2.0 * lost / fringe, 0.0, 2.0 * _NARROW)
    lost = lost * (1.0 + 0.5 * (q + q**2) + q**2 / 6.0)
    top = smooth + lost
    line = inner & (np.abs(across) < _OFF) & (bend < -sharp)
    line &= lost < _NARROW * fringe
    # pieces of a line that are less apart than its smoothing are one
    near = ndimage.binary_dilation(line, np.ones((3, 3)), iterations=max(1, int(width / 2.0)))
    pieces, count = ndimage.label(near)
    pieces = np.where(line, pieces, 0)
    even = []
    for piece in range(1, count + 1):
        at = pieces == piece
        middle, scatter = _middle(top[at])
        bent, straight = (float(np.median(part[at])) for part in (bend, along))
        even_light = scatter < _SCATTER * abs(middle) + noise / width
        if even_light and abs(straight) < _STRAIGHT * abs(bent):
            even.append((middle, piece))
    for greatest, _ in sorted(even, reverse=True):  # all crests are alike: theirs count as one
        within = _SCATTER * abs(greatest) + noise / width
        at = np.isin(pieces, [p for middle, p in even if 0.0 <= greatest - middle < within])
        if np.count_nonzero(at) > _LENGTH * min(top.shape):
            middle, scatter = _middle(top[at])
            spread = max(scatter, noise / width)
            spread /= np.sqrt(max(np.count_nonzero(at) / width, 1.0))
            return middle, float(np.hypot(spread, LIGHT_ERROR * middle))
    return None


def _middle(values: Array) -> tuple[float, float]:
    """Median of some values, and their scatter."""
    middle = float(np.median(values))
    return middle, 1.4826 * float(np.median(np.abs(values - middle)))
