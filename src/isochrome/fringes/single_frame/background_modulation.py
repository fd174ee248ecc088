r"""The dark and the bright end of a frame without no-load frames, from its fringes alone.

The light is I^g = D (1 - s) + B s, s = sin² pi N, with D and B slowly varying over the frame:
polynomials of the place; and g, where wanted, the exponent that the light's linearisation lacks.
Each of many patches has an N of its own, so that the ends and the exponent are what all patches
together leave open (see `end_problem`, `end_search`). Where a patch spans no
crest its order follows any change of the ends, and it says nothing of them: the ends come with
their covariance, and the order is as uncertain as they make it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

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
from isochrome.fringes.single_frame.end_problem import EndProblem, eliminated, ends_at
from isochrome.fringes.single_frame.end_search import (
    NOT_TOLD,
    TONES,
    Found,
    fresh_patches,
    overlap,
    possible,
    search_all,
    search_on,
)
from isochrome.fringes.single_frame.patches import binned
from isochrome.fringes.windows import Array, Mask

_BINNINGS = (32, 16, 8, 4, 2, 1)
"""The ends vary slowly: binned pixels tell as much, far faster, and their patches span crests."""
_LEAST_PIXELS = 100
"""Binned pixels that the shorter side of a frame needs: eight patches or so."""
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

    The light is I^g = D (1 - s) + B s, s = sin² pi N; D and B are sums of given shapes.

    Parameters
    ----------
    dark : ndarray (rows, cols)
        Light of the dark end, D.
    bright : ndarray (rows, cols)
        Light of the bright end, B.
    settled : bool
        Whether the search came to rest.
    tone : float
        The exponent g that makes the light linear; 1 where it was not asked for.
    tone_uncertainty : float
        Standard uncertainty of the exponent.
    given : tuple of two bools
        Which of the ends no-load frames gave.
    variance : ndarray (3, 3, rows, cols)
        Covariance of the dark end, the bright end and the exponent.
    others : tuple of BackgroundModulation
        Ends that explain the frame about as well, under which its orders may be others.
    """

    dark: Array = field(repr=False)
    bright: Array = field(repr=False)
    settled: bool
    tone: float
    tone_uncertainty: float
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
        square = np.zeros(light.shape)
        for i, one in enumerate(parts):
            for j, other in enumerate(parts):
                square += one * other * self.variance[i, j]
        return np.asarray(np.sqrt(np.maximum(square, 0.0)) / contrast)


def exact_ends(dark: Array, bright: Array) -> BackgroundModulation:
    """Take no-load frames for the ends of a frame, and for exact.

    Parameters
    ----------
    dark : ndarray (rows, cols)
        Light of the dark end.
    bright : ndarray (rows, cols)
        Light of the bright end.

    Returns
    -------
    BackgroundModulation
        Those, without an uncertainty of their own.
    """
    return BackgroundModulation(
        dark=dark,
        bright=bright,
        settled=True,
        tone=1.0,
        tone_uncertainty=0.0,
        given=(True, True),
        variance=np.broadcast_to(0.0, (3, 3, *dark.shape)),
    )


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

    Parameters
    ----------
    light : ndarray (rows, cols)
        Light I, linear, but for an exponent where `tone` asks for it.
    sigma : ndarray (rows, cols)
        Noise of the light.
    valid : bool ndarray (rows, cols)
        Whether a pixel is trusted.
    dark : ndarray (rows, cols), optional
        The dark end that a no-load frame gives, of the same linearity.
    bright : ndarray (rows, cols), optional
        The bright end that a no-load frame gives, of the same linearity.
    tone : bool, default False
        Whether the exponent that makes the light linear is wanted.

    Returns
    -------
    BackgroundModulation
        The ends, the exponent, and how well they are known.

    Raises
    ------
    InputError
        Where the frame has no contrast, or no fringe that can be followed, where its fringes leave
        the ends or the exponent open, or where nothing is unknown.
    """
    if dark is not None and bright is not None and not tone:
        raise InputError("both_ends_light_given")
    problem, starts = _problem(light, sigma, valid, (dark, bright), tone)
    results = _searched(problem, starts)
    if not tone:
        best, *others = (_ends(light.shape, dark, bright, result) for result in results)
        return replace(best, others=tuple(others))
    result = as_doubtful(results)
    # a bin's mean is that of the light only where the light is linear: once more, nearly so
    first = _told_tone(float(result.unknowns[-1]))
    linear = np.maximum(light, _BLACK) ** first
    noise = first * np.maximum(light, sigma) ** (first - 1.0) * sigma
    low, high = (None if end is None else end**first for end in (dark, bright))
    problem, _ = _problem(linear, noise, valid, (low, high), True)
    again = as_doubtful(_searched(problem, [np.append(result.unknowns[:-1], 1.0)]))
    done = _ends(light.shape, low, high, again)
    per_tone = np.array([1.0, 1.0, first])[:, None, None]
    return replace(
        done,
        tone=_told_tone(first * done.tone),
        tone_uncertainty=first * done.tone_uncertainty,
        variance=done.variance * per_tone[:, None] * per_tone[None],
    )


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


def _among(found: Found, kept: Mask) -> Found:
    """A result of some of the unknowns as one of all, the others being nought."""
    unknowns, covariance = np.zeros(kept.size), np.zeros((kept.size, kept.size))
    unknowns[kept] = found.unknowns
    covariance[np.ix_(kept, kept)] = found.covariance
    return replace(found, unknowns=unknowns, covariance=covariance)


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
    """Find how far the tone exponent is from 1, by the fringes' shape.

    By one linear step from 1: enough to tell that the light is not linear, not how far.

    Parameters
    ----------
    light : ndarray (rows, cols)
        Light I, linear as far as is known.
    sigma : ndarray (rows, cols)
        Noise of the light.
    valid : bool ndarray (rows, cols)
        Whether a pixel is trusted.
    ends : tuple of two ndarrays (rows, cols)
        The dark and the bright end, found or given.

    Returns
    -------
    change : float
        The difference g - 1.
    uncertainty : float
        Its standard uncertainty.

    Raises
    ------
    InputError
        Where no fringe can be followed, or the fringes leave the exponent open.
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


def _problem(
    light: Array, sigma: Array, valid: Mask, ends: tuple[Array | None, Array | None], tone: bool
) -> tuple[EndProblem, list[Array]]:
    """The problem on binned pixels, and where to start."""
    by = next((b for b in _BINNINGS if min(light.shape) // b >= _LEAST_PIXELS), 1)
    small, noise, whole = binned(light, sigma, valid, by)
    if not whole.any():
        raise InputError("no_part_frame_trusted")
    low, high = np.percentile(small[whole], [_LOW, _HIGH])
    if not high - low > _LEAST_CONTRAST * np.median(noise[whole]):
        raise InputError("frame_has_no_contrast_light")
    dark, bright = (
        own if end is None else binned(end, np.ones_like(end), valid, by)[0]
        for end, own in zip(ends, shapes_of_ends(light.shape, by), strict=True)
    )
    problem = EndProblem(
        light=small,
        sigma=noise,
        valid=whole,
        shapes=(dark, bright),
        tone=tone,
        scale=float(high - low),
        by=by,
    )
    flat = [
        np.eye(len(spread))[0] * (1.0 if known else level)
        for known, level, spread in zip(problem.given, (low, high), problem.spreads, strict=True)
    ]
    if not isinstance(bright, SmoothImages):
        return problem, [np.concatenate([*flat, [1.0]])]
    brights = _brights(problem, bright, low, high)
    return problem, [np.concatenate([flat[0], terms, [1.0]]) for terms in brights]


def _brights(problem: EndProblem, lamp: SmoothImages, low: float, high: float) -> list[Array]:
    """Bright ends to start from: a smooth one above the light, and one that all crests lie on."""
    images = lamp.images
    above = np.zeros(lamp.spread.size)  # spots begin at nought
    above[:QUADRATICS] = surface_above(
        problem.light, problem.valid, images[..., :QUADRATICS], (low, high)
    )
    lines = bright_lines(problem.light, problem.sigma, problem.valid)
    lines[~(lines > low + _CREST * (lamp.sum(above) - low))] = np.nan
    if not np.isfinite(lines).any():
        return [above]
    return [above, surface_through(lines, images, problem.scale * lamp.spread, problem.scale)]


def _ends(
    shape: tuple[int, ...], dark: Array | None, bright: Array | None, found: Found
) -> BackgroundModulation:
    """The ends on all pixels."""
    full = shapes_of_ends(shape, 1)
    given = dark is not None, bright is not None
    g = float(found.unknowns[-1])
    cut = 1 if given[0] else full[0].spread.size
    return BackgroundModulation(
        dark=full[0].sum(found.unknowns[:cut]) if dark is None else dark**g,
        bright=full[1].sum(found.unknowns[cut:-1]) if bright is None else bright**g,
        settled=found.rests,
        tone=g,
        tone_uncertainty=float(np.sqrt(found.covariance[-1, -1])),
        given=given,
        variance=variance_of_ends(shape, given, cut, found.covariance),
    )
