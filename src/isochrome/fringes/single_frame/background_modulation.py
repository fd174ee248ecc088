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
from isochrome.estimation import binned_light
from isochrome.fringes.on_branch import OrderReading, less_sure
from isochrome.fringes.single_frame.end_problem import EndProblem
from isochrome.fringes.single_frame.end_search import TONES, Found, search_all, tone_step
from isochrome.fringes.single_frame.patches import TURN, binned
from isochrome.fringes.windows import Array, Mask, gaussian_sum

_BINNINGS = (32, 16, 8, 4, 2, 1)
"""The ends vary slowly: binned pixels tell as much, far faster, and their patches span crests."""
_LEAST_PIXELS = 100
"""Binned pixels that the shorter side of a frame needs: eight patches or so."""
_LOW, _HIGH = 1.0, 99.0
"""Percentiles of the light at which the search for the ends starts: both occur in a frame that
holds at least one whole fringe."""
_ABOVE, _STIFF, _PULLS, _ENOUGH = 0.01, 0.1, 12, 400.0
"""Of the bright end's first surface: weight of light below it over light above; prior of its shape
over the contrast; rounds; and how many pixels' worth the light counts."""
_POOLED_PX = 3.0
_LARGEST_UNCERTAINTY = 0.03
_BLACK = 1e-6
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
    shapes : tuple of two ndarrays (rows, cols, terms) or None
        What the two ends are sums of; None for a given end.
    roots : tuple of three ndarrays (terms, k), (terms, k) and (k,)
        What, times k unit normal deviates, gives the errors of the dark end's terms, the bright
        end's, and the exponent's.
    """

    dark: Array = field(repr=False)
    bright: Array = field(repr=False)
    settled: bool
    tone: float
    tone_uncertainty: float
    shapes: tuple[Array | None, Array | None] = field(repr=False)
    roots: tuple[Array, Array, Array] = field(repr=False)

    def signal_uncertainty(self, light: Array) -> Array:
        """Standard uncertainty of s = (I^g - D)/(B - D) by that of D, B and g (rows, cols).

        Parameters: `light` I (rows, cols), linear but for the exponent g.
        """
        level = np.maximum(light, _BLACK)
        linear = level**self.tone
        contrast = np.maximum(self.bright - self.dark, _BLACK)
        signal = np.clip((linear - self.dark) / contrast, 0.0, 1.0)
        tone = linear * np.log(level)  # dI^g/dg, less what a given end follows of it
        errors = np.zeros((*light.shape, len(self.roots[-1])))
        parts = zip((self.dark, self.bright), (1.0 - signal, signal), strict=True)
        for k, (end, share) in enumerate(parts):
            shape = self.shapes[k]
            if shape is None:
                tone = tone - share * end * np.log(np.maximum(end, _BLACK)) / self.tone
            else:
                errors += share[..., None] * (shape @ self.roots[k])
        if self.tone_uncertainty > 0.0:
            errors -= tone[..., None] * self.roots[-1]
        return np.asarray(np.sqrt(np.einsum("...k,...k->...", errors, errors)) / contrast)


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
        raise InputError("both ends of the light are given, and nothing is left to find")
    problem, starts = _problem(light, sigma, valid, (dark, bright), tone)
    found = search_all(problem, starts)
    if not tone:
        return _ends(light.shape, dark, bright, found)
    # a bin's mean is that of the light only where the light is linear: once more, nearly so
    first = _told_tone(float(found.unknowns[-1]))
    linear = np.maximum(light, _BLACK) ** first
    noise = first * np.maximum(light, sigma) ** (first - 1.0) * sigma
    low, high = (None if end is None else end**first for end in (dark, bright))
    problem, _ = _problem(linear, noise, valid, (low, high), True)
    again = search_all(problem, [np.append(found.unknowns[:-1], 1.0)])
    done = _ends(light.shape, low, high, again)
    return replace(
        done,
        tone=_told_tone(first * done.tone),
        tone_uncertainty=first * done.tone_uncertainty,
        roots=(*done.roots[:-1], first * done.roots[-1]),
    )


def _told_tone(tone: float) -> float:
    """A tone exponent that lies within what cameras have. Raises InputError on another one."""
    if _NEAR_END * TONES[0] < tone < TONES[1] / _NEAR_END:
        return tone
    raise InputError(
        f"gamma cannot be found from this frame: its fringes ask for {tone:.2g}, and cameras have "
        f"{TONES[0]:g} to {TONES[1]:g}; state frames.gamma, or mask what is not the specimen"
    )


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
    return tone_step(problem, starts[0])


def _problem(
    light: Array, sigma: Array, valid: Mask, ends: tuple[Array | None, Array | None], tone: bool
) -> tuple[EndProblem, list[Array]]:
    """The problem on binned pixels, and where to start."""
    by = next((b for b in _BINNINGS if min(light.shape) // b >= _LEAST_PIXELS), 1)
    small, noise, whole = binned(light, sigma, valid, by)
    if not whole.any():
        raise InputError("no part of the frame is trusted; check its mask and exposure")
    low, high = np.percentile(small[whole], [_LOW, _HIGH])
    if not high > low:
        raise InputError("the frame has no contrast; is the light on, and the specimen loaded?")
    poly = binned_light(light.shape, by)
    shapes = tuple(
        poly if end is None else binned(end, np.ones_like(end), valid, by)[0][..., None]
        for end in ends
    )
    given = ends[0] is not None, ends[1] is not None
    problem = EndProblem(
        light=small,
        sigma=noise,
        valid=whole,
        shapes=(shapes[0], shapes[1]),
        given=given,
        tone=tone,
        scale=float(high - low),
        by=by,
    )
    flat = [
        np.ones(1) if known else np.eye(poly.shape[-1])[0] * level
        for known, level in zip(given, (low, high), strict=True)
    ]
    starts = [np.concatenate([*flat, [1.0]])]
    if not given[1]:
        raised = _envelope(small, poly, whole, float(low), float(high))
        starts.append(np.concatenate([flat[0], raised, [1.0]]))
    return problem, starts


def _envelope(light: Array, shapes: Array, valid: Mask, low: float, high: float) -> Array:
    """A smooth surface that rests on the light from above: asymmetric least squares."""
    rows, values = shapes[valid], light[valid]
    terms = np.eye(rows.shape[1])[0] * high
    stiff = np.full(len(terms), (_STIFF * (high - low)) ** -2)
    stiff[0] = 0.0
    gain = _ENOUGH / (len(values) * (0.05 * (high - low)) ** 2)
    for _ in range(_PULLS):
        weight = gain * np.where(values > rows @ terms, 1.0, _ABOVE)
        weighted = rows * weight[:, None]
        terms = np.linalg.solve(weighted.T @ rows + np.diag(stiff), weighted.T @ values)
    return np.asarray(terms)


def _ends(
    shape: tuple[int, ...], dark: Array | None, bright: Array | None, found: Found
) -> BackgroundModulation:
    """The ends on all pixels."""
    full = binned_light(shape, 1)
    g = float(found.unknowns[-1])
    cut = full.shape[-1] if dark is None else 1
    spread, turn = np.linalg.eigh(found.covariance)
    root = (turn * np.sqrt(np.maximum(spread, 0.0)))[:, spread > 0.0]
    return BackgroundModulation(
        dark=full @ found.unknowns[:cut] if dark is None else dark**g,
        bright=full @ found.unknowns[cut:-1] if bright is None else bright**g,
        settled=found.rests,
        tone=g,
        tone_uncertainty=float(np.sqrt(found.covariance[-1, -1])),
        shapes=(full if dark is None else None, full if bright is None else None),
        roots=(root[:cut], root[cut:-1], root[-1]),
    )


def widened(reading: OrderReading, error: Array) -> OrderReading:
    """Widen a reading by errors of the signal that pooling does not average out.

    An error e of the signal moves the order by e/(pi sin 2 pi N); pooled over a patch as the
    reading is, by sum(w |sin| e)/(pi sum(w sin²)). On a crest, where the sine is nought, the order
    moves by no more than sqrt(e)/pi. A pixel of more than 0.03 fringe is not known.

    Parameters
    ----------
    reading : OrderReading
        The reading.
    error : ndarray (rows, cols)
        Standard uncertainty e of the signal, such as `BackgroundModulation.signal_uncertainty`.

    Returns
    -------
    OrderReading
        The reading, as uncertain as the errors leave it.
    """
    known = np.isfinite(reading.order)
    order = np.where(known, reading.order, 0.0)
    sine = np.abs(np.sin(TURN * order)) * known
    pull = gaussian_sum(sine * error, _POOLED_PX)
    slope = np.pi * gaussian_sum(sine * sine, _POOLED_PX)
    moved = np.minimum(pull / np.maximum(slope, 1e-9), np.sqrt(error) / np.pi)
    return less_sure(reading, moved, _LARGEST_UNCERTAINTY)
