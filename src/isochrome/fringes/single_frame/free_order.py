"""Fringe order of one monochrome frame without a model of the specimen.

Patches of the frame are fitted by quadratics of the order, their signs and whole numbers settled
between neighbours, and what is left, one sign and one whole number for each connected part, is
taken from where the user knows the order (`[[frames.known_order]]`, `[[frames.known_line]]`,
corners of a `[[frames.free_boundary]]`). A part without any is left unknown: no light can tell its
whole number. Pixels are then the mean of the patches about them; where those disagree, as beside an
isotropic point or where fringes are finer than a patch can follow, the pixel is masked. What blur
and a wide band take of the fringes' contrast is found from the frame (`contrast`), and bodies that
masked pixels keep apart are parts apart.

What a frame's fringes lose of their contrast, by blur and by the width of the light's band.

A lens or a pixel that blurs by s (standard deviation, pixels) leaves exp(-2 pi² s² |∇N|²) of a
fringe, and a band of wavelengths of relative width b leaves exp(-2 pi² b² N²) of one of order N:
the Fourier transforms of Gaussians (Born & Wolf (1999), Principles of Optics, section 7.5.8). Read
as if nothing were lost, a crest that the light does not reach looks like one that the order turns
back at. Patches that span crest and flank alike say what contrast they have besides their order;
s² and b² are what they say together, and the light is divided by it.

One whole number for each part of a frame, from points and lines whose order the user knows.

A part's patches say N = |f + j| with one whole number j that no light can tell. A point of known
order o says j = round(o - f) or round(-o - f). Off the fringe lines only one of the two fits the
light; on a line, 2 o a whole number, both do: such a point says the line, and not on which side of
it the order is higher, and so do all places of a known fringe line together. The j of a part is
therefore chosen jointly: it costs the sum of min(((|f + j| - o)/sigma)², C) over the part's points
and lines, a line having one voice, so that among many a wrong one is outvoted. Where two j are
nearly as good the part is not known. A line of N = 0 through the part is not generic in a loaded
body (isotropic places are points), though a beam has one: where what is known lies on lines alone,
it must be said. A point that the rest contradicts may lie beyond a seam that the light leaves open
(`open_seams`): then that seam is closed as the point says.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from scipy.ndimage import label

from isochrome.fringes.on_branch import (
    LARGEST_UNCERTAINTY,
    OrderReading,
    less_sure,
    make_reading,
    moved_by_light,
    stray_variance,
)
from isochrome.fringes.single_frame.patches import (
    FADED,
    HALF,
    LEAST_FILLED,
    SIDE,
    STRIDE,
    Labels,
    Patches,
    basis,
    binned,
    expected_terms,
    fit_patches,
    gather_patches,
    label_patches,
    middles,
    nearest_patches,
    offsets,
)
from isochrome.fringes.single_frame.stated_orders import (
    CLEAR,
    FEWEST_PATCHES,
    NOUGHT,
    KnownOrders,
    KnownPlaces,
    KnownPoint,
    Stated,
    StatedPlace,
    ZeroPlace,
    corner_orders,
    fits_nothing,
    left_out,
    mend_mirrored,
    open_seams,
    stated_place,
    turned_to,
    zero_lines,
)
from isochrome.fringes.windows import DIMMEST, TURN, Array, Mask, innermost, nearest_known
from isochrome.messages import message

_SOME = 0.05
"""Share of the patches that have lost as much."""
_FEWEST = 30
_FINEST = 0.2
"""Fringes a bin beyond which a bin says nothing of the light's contrast."""
_ROUNDS = 6
_OUTLIER = 2.0
"""Robust deviations from which a patch counts for less."""


@dataclass(frozen=True)
class Contrast:
    """The law a = exp(-2 pi² (blur |∇N|² + band N²)).

    `blur`, variance of the blur, pixels²; `band`, variance of the wavenumber over its mean squared.
    """

    blur: float = 0.0
    band: float = 0.0

    def left(self, order: Array, slope: Array) -> Array:
        """Contrast at `order`, fringes, whose gradient's size is `slope`, fringes a pixel."""
        lost = self.blur * slope**2 + self.band * order**2
        return np.asarray(np.exp(-0.5 * TURN**2 * lost))


def with_told(patches: Patches, by: int, wider: Array | None) -> Patches:
    """Patches with the contrast that wider ones tell where they tell none.

    Parameters: `patches` of bins of `by` pixels, whose own blur is taken out; `wider` by wider ones
    (m, n), NaN where nothing is, None for none. Returns Patches.
    """
    contrast = patches.contrast
    if by > 1:
        slope = np.hypot(patches.terms[..., 1], patches.terms[..., 2])
        lost = Contrast(blur=(1.0 - by**-2.0) / 12.0).left(np.zeros_like(slope), slope)
        contrast = np.where(slope < _FINEST, contrast / lost, np.nan)
    return replace(
        patches, contrast=contrast if wider is None else np.where(contrast > 0.0, contrast, wider)
    )


def everywhere(contrast: Array) -> Array:
    """The contrast (m, n) of the nearest patch that tells one; 1 where none does."""
    known = np.isfinite(contrast)
    return nearest_known(contrast, known) if known.any() else np.ones_like(contrast)


def fit_contrast(patches: Patches, terms: Array) -> Contrast:
    """Find what fringes lose from patches whose order is known.

    Least squares of both variances, neither negative, patches off the law counting for less.
    Parameters: `patches`; `terms` (m, n, 6) of their signed order, NaN = not known. Returns the
    Contrast, of no loss where too few patches tell.
    """
    use = np.isfinite(terms[..., 0]) & (patches.contrast > DIMMEST)
    if np.count_nonzero(use) < _FEWEST:
        return Contrast()
    from scipy.optimize import nnls

    known = terms[use]
    lost = -2.0 * np.log(patches.contrast[use]) / TURN**2
    causes = np.stack([known[:, 1] ** 2 + known[:, 2] ** 2, known[:, 0] ** 2], axis=-1)
    weight = np.ones(len(lost))
    for _ in range(_ROUNDS):
        result, _ = nnls(causes * weight[:, None], lost * weight)
        away = np.abs(lost - causes @ result)
        scale = max(1.4826 * float(np.median(away)), 1e-6)
        weight = np.sqrt(np.minimum(1.0, _OUTLIER * scale / np.maximum(away, 1e-9)))
    return Contrast(*(float(v) for v in result))


def contrast_map(patches: Patches, terms: Array, law: Contrast, shape: tuple[int, ...]) -> Array:
    """The contrast at each pixel (rows, cols); where no order is known, that of the nearest patch.

    Parameters: `patches`; `terms` (m, n, 6), NaN = not known; `law`; `shape` of the frame.
    """
    near = nearest_known(terms, np.isfinite(terms[..., 0]))
    contrast = law.left(near[..., 0], np.hypot(near[..., 1], near[..., 2]))
    down, across = (
        np.stack([np.interp(np.arange(n), at, unit) for unit in np.eye(len(at))], axis=-1)
        for at, n in zip((patches.rows, patches.cols), shape, strict=True)
    )
    return np.asarray(down @ contrast @ across.T)


_ALONE = 0.1
"""Share of what could be followed, without a point, from which it is said."""
_TELLABLE = 0.2
"""Fringes between two answers that a known order tells apart: closer to a line than half of that it
says the line, and not the side."""
_SHARP = 0.1
"""Share of the difference of two answers that the light may move them by where a point is asked."""
_DOUBTFUL = 0.003
"""Uncertainty of the signal by the ends of the light from which a line of N = 0 must be known."""
APART = 0.5
"""Fringes between two orders from which any known order contradicts one: it may be off by .24."""


@dataclass(frozen=True)
class Anchored:
    """What the known points make of the patches.

    `terms` (m, n, 6) of the signed order, NaN where it is not known; `misses`, points that were not
    used; `said`, what is open, and what point would settle it.
    """

    terms: Array = field(repr=False)
    misses: tuple[KnownPoint, ...]
    said: tuple[str, ...]


def _unknown(part: Array, given: list[Stated], *said: str) -> Anchored:
    """A part of which nothing is known, and why."""
    points = tuple(p.point for g in given for p in g.places)
    return Anchored(np.full_like(part, np.nan), points, said)


def _one_part(patches: Patches, part: Array, given: list[Stated], error: Array) -> Anchored:
    """A part's order by what is known in it."""
    signed = (1.0, -1.0)  # the part's own orders may have either sign
    shifts = {round(s * g.known.order - p.field) for g in given for p in g.places for s in signed}
    candidates = {j for j in shifts if any(g.fits(j) for g in given)}
    if not candidates:
        return _unknown(part, given, *(fits_nothing(g, g.places[0]) for g in given))
    lines = {j: zero_lines(part[..., 0] + j, _zero_said(j, given)) for j in candidates}
    cost = {j: sum(g.cost(j) for g in given) for j in candidates}
    # a line of N = 0 is unlikely, and no proof: it says what is tried first, and settles nothing
    best, *others = sorted(candidates, key=lambda j: (round(cost[j], 6), lines[j], j))
    rivals = [j for j in others if cost[j] < cost[best] + CLEAR]
    if rivals:
        return _of_rivals(patches, part, given, (best, *rivals), error)
    sure = [g for g in given if g.fits(best)]
    doubtful = float(np.median(error[np.isfinite(part[..., 0])])) > _DOUBTFUL
    if lines[best] and (doubtful or all(g.on_line for g in sure)):
        return _unknown(part, sure, f"{sure[0]}: " + message("order_would_along_line"))
    return _with_seams(patches, part, given, best, error)


def _of_rivals(
    patches: Patches, part: Array, given: list[Stated], rivals: Sequence[int], error: Array
) -> Anchored:
    """The first of some equally likely shifts that seams make fit all that is known.

    Else nothing is known, and why.
    """
    for j in rivals:
        if not all(p.fits(j) for g in given for p in g.places):
            result = _with_seams(patches, part, given, j, error)
            if not result.misses:
                return result
    best, rival = rivals[:2]
    listed = "; ".join(map(str, given))
    if all(any(not g.fits(j) for g in given) for j in (best, rival)):
        note = message("contradict_each_other_no", listed=listed)
    else:
        orders = [np.abs(part[..., 0] + j) for j in (best, rival)]
        row, col, at = _place(patches, clearly_apart(np.abs(orders[0] - orders[1])))
        first, second = sorted(o[at] for o in orders)
        note = message(
            "fringe_line_light_cannot", listed=listed, row=row, col=col, first=first, second=second
        )
        turning = next((g for g in given if not g.known.is_line and g.places[0].around), None)
        if turning is not None:
            note += message("extremum_maximum_minimum", turning=turning)
    return _unknown(part, given, note)


def _with_seams(
    patches: Patches, part: Array, given: list[Stated], j: int, error: Array
) -> Anchored:
    """Open seams closed as points beyond them say, and what still lies beyond one left out."""
    terms = part.copy()
    terms[..., 0] += j
    notes: list[str] = []
    misses: list[KnownPoint] = []
    used = [(g, p) for g in given for p in g.places if p.cost(j) < CLEAR]
    zero_said = _zero_said(j, given)
    for g in given:
        missed = []
        for p in (p for p in g.places if p.cost(j) >= CLEAR):
            turned = turned_to(patches, terms, used, zero_said, g, p)
            if turned is None:
                missed.append(p)
            else:
                terms = turned
                used.append((g, p))
        if missed:
            misses += [p.point for p in missed]
            notes.append(left_out(g, missed, j, sum(other.fits(j) for other in given)))
    sources = [g.source(p, terms) for g, p in used]
    for crest, beyond in open_seams(patches, terms, sources, zero_said):
        if beyond.sum() >= FEWEST_PATCHES:
            notes.append(_beyond_seam(patches, terms, beyond, crest, error))
        terms[beyond] = np.nan
    return Anchored(terms, tuple(misses), tuple(notes))


def _zero_said(j: int, given: list[Stated]) -> list[ZeroPlace]:
    """Where it is known that N = 0 along a line: a place on it, or two on its two sides."""
    on_zero = [(g, p) for g in given if g.known.says_zero_line for p in g.places if p.fits(j)]
    on: list[ZeroPlace] = [(p.patch,) for g, p in on_zero if g.known.order < NOUGHT]
    off = [p for g, p in on_zero if g.known.order > NOUGHT and not g.on_line]
    above, below = ([p for p in off if sign * (p.field + j) > 0.0] for sign in (1.0, -1.0))
    return on + [(p.patch, q.patch) for p in above for q in below]


def _beyond_seam(patches: Patches, terms: Array, beyond: Mask, crest: int, error: Array) -> str:
    """What to say of patches whose branch the light does not settle.

    A point is asked for where the light is known well enough for its answer to be the order.
    """
    order = terms[..., 0]
    mirrored = np.abs(crest - order)
    share = 100.0 * beyond.sum() / max(1, np.isfinite(order).sum())
    note = message("light_cannot_decide_whether", crest=abs(0.5 * crest), share=share)
    apart = np.where(beyond, np.abs(mirrored - np.abs(order)), np.nan)
    most = float(np.nanmax(apart))
    if most < _TELLABLE:
        return message("lies_within_line_order", said=note, most=0.5 * most)
    moved = moved_by_light(np.where(beyond, order, 0.0), error)
    lit = (apart >= _TELLABLE) & (moved < np.minimum(LARGEST_UNCERTAINTY, _SHARP * apart))
    if not lit.any():
        return message("nor_light_there_give", said=note)
    differ = np.where(lit, apart, np.nan)
    row, col, at = _place(patches, clearly_apart(differ))
    first, second = sorted([float(mirrored[at]), abs(float(order[at]))])
    return message(
        "known_order_row_column_settles", said=note, row=row, col=col, first=first, second=second
    )


def clearly_apart(difference: Array) -> Mask:
    """Where two orders differ enough for a known one to tell them apart, else where most.

    Equation: d > min(1/2, max(d)/2), d the `difference` (rows, cols), NaN where nothing is asked.
    """
    return np.asarray(difference > min(APART, 0.5 * float(np.nanmax(difference))))


def _place(patches: Patches, where: Mask) -> tuple[int, int, tuple[int, int]]:
    """The middle-most place of some patches: row and column of its pixel, and its patch."""
    i, j = innermost(where)
    return int(patches.rows[i]), int(patches.cols[j]), (i, j)


def _unfollowed(known: KnownPlaces, valid: Mask) -> str:
    row, col = known.places[0]
    i, j = round(row), round(col)
    inside = 0 <= i < valid.shape[0] and 0 <= j < valid.shape[1] and bool(valid[i, j])
    why = message("no_fringe_could_followed") if inside else message("lies_outside_specimen_where")
    others = message("other_places") if known.is_line else ""
    return f"{known.key} = {known.order:g} at row {row:g}, column {col:g}{others}: {why}"


def _part_at(patches: Patches, labels: Labels, p: StatedPlace) -> int:
    """The part of the patch about a place, -1 where there is none near."""
    (row, col, _), (i, j) = p.point, p.patch
    far = max(abs(row - patches.rows[i]), abs(col - patches.cols[j]))
    return -1 if far > HALF + STRIDE else int(labels.part[p.patch])


_COARSEST = 4
"""Pixels a side of the first bins, which are halved."""
_LEAST_PIXELS = 7 * SIDE // 2
"""Pixels, after binning, of the shorter side of a frame: three patches and a half without overlap.
"""
_LEAST_COVER = 0.15
_CONTRAST_ROUNDS, _MOSTLY = 4, 98.0
"""Readings at most with a contrast found from the last, and per cent of the frame that must rest.
"""
_GROUND = 1e-3
"""Standard deviation of what a quadratic cannot follow, added to a patch's own, fringes."""
_WORTH_SAYING = 0.01
"""Share of what is read that another light must take away before it is said."""


@dataclass(frozen=True)
class FreeReading:
    """What a frame says without a model: the order, and how well it is known.

    `contrast`, what the fringes have left, 1 where nothing is lost to speak of; `misses`: known
    points that were not used; `said`: why, what the frame leaves open, and what point would settle
    it.
    """

    reading: OrderReading
    contrast: Array = field(repr=False)
    misses: tuple[KnownPoint, ...]
    said: tuple[str, ...] = ()


def read_free(
    wave: Array, sigma: Array, valid: Mask, known: KnownOrders, *, error: Array
) -> FreeReading:
    """Read the fringe order of a normalised frame `wave`, cos 2 pi N, without a model.

    Each part that is wanted needs a point, a line or a corner that is `known`. `error`: uncertainty
    of the signal (1 - cos 2 pi N)/2 by the ends of the light: from 0.003 on in the median a line of
    N = 0, which stands for N = 1 in a wrong light, must be known. InputError: the frame is smaller
    than a patch.
    """
    followed, fade = follow_fringes(wave, sigma, valid, known, error=error)
    result = followed.anchored(known)
    reading = _dense(followed.patches, result.terms, valid)
    # as uncertain as light leaves it that is not the fringes'
    read = np.isfinite(reading.order)
    turns = TURN * np.where(read, reading.order, 0.0)
    weight = np.where(read, 1.0 / (sigma / fade), 0.0)
    residual = np.where(read, followed.wave - np.cos(turns), 0.0) * weight
    stray = stray_variance(residual, -TURN * np.sin(turns) * weight, -2.0 * weight)
    reading = less_sure(reading, np.sqrt(stray), LARGEST_UNCERTAINTY)
    return FreeReading(reading, fade, result.misses, result.said)


@dataclass(frozen=True)
class FollowedFringes:
    """What a frame's fringes say before an order is known.

    `faded`: they have lost contrast, so that what can be followed depends on what was known;
    `wave`, the light c = cos 2 pi N; `unlit` (m, n), the signal's uncertainty by the ends of the
    light at the patches.
    """

    faded: bool
    patches: Patches = field(repr=False)
    labels: Labels = field(repr=False)
    wave: Array = field(repr=False)
    valid: Mask = field(repr=False)
    unlit: Array = field(repr=False)

    def anchored(self, known: KnownOrders) -> Anchored:
        """The signed orders of the patches by what is `known`, and what is to be said.

        The whole number of each part where an order is known is chosen, and the side of open seams.
        """
        patches, labels = self.patches, self.labels
        at_corners, notes = corner_orders(known.corners, patches, labels, self.wave, self.valid)
        terms = np.full_like(patches.terms, np.nan)
        field_terms = labels.sign[..., None] * patches.terms
        field_terms[..., 0] += labels.shift
        misses: list[KnownPoint] = []
        by_part: dict[int, list[Stated]] = {}
        for each in (*known.places, *at_corners):
            places = [stated_place(patches, labels, field_terms, each, p) for p in each.places]
            parts = [_part_at(patches, labels, p) for p in places]
            misses += [p.point for p, part in zip(places, parts, strict=True) if part < 0]
            if max(parts) < 0:
                notes.append(_unfollowed(each, self.valid))
            for part in sorted({part for part in parts if part >= 0}):
                within = tuple(p for p, at in zip(places, parts, strict=True) if at == part)
                by_part.setdefault(part, []).append(Stated(each, within))
        for part, given in sorted(by_part.items()):
            inside = labels.part == part
            own_terms = np.where(inside[..., None], field_terms, np.nan)
            result = _one_part(patches, own_terms, given, self.unlit)
            misses += result.misses
            notes += result.said
            terms[inside] = result.terms[inside]
        unanchored = (labels.part >= 0) & ~np.isin(labels.part, list(by_part))
        share = float(unanchored.sum() / max(1, int((labels.part >= 0).sum())))
        if share > _ALONE:
            numbers, counts = np.unique(labels.part[unanchored], return_counts=True)
            row, col, _ = _place(patches, labels.part == numbers[counts.argmax()])
            percent = 100.0 * share
            notes.append(message("what_could_followed_hangs", share=percent, row=row, col=col))
        return Anchored(terms, tuple(misses), tuple(notes))

    def part_at(self, row: float, col: float, *, on_line: bool = False) -> Mask:
        """The patches (m, n) for which an order at a place speaks; none where it has none."""
        patches, labels, place = self.patches, self.labels, (row, col)
        kind = KnownPlaces((place,) * (2 if on_line else 1), 0.0)
        near = stated_place(patches, labels, patches.terms, kind, place)
        number = _part_at(patches, labels, near)
        return np.asarray((self.labels.part == number) & (number >= 0))


def follow_fringes(
    wave: Array, sigma: Array, valid: Mask, known: KnownOrders, *, error: Array
) -> tuple[FollowedFringes, Array]:
    """Follow the fringes of a normalised frame as far as they can be without a known order.

    Low orders of wide fringes lose next to nothing of their contrast and tell what the others lose:
    where contrast is lost, and there alone, what is followed grows from them by what is `known`.
    Arrays as in `read_free`. Returns what could be followed, and what is left of the contrast.
    """

    fade = np.ones(wave.shape)
    patches, labels = _coarse_to_fine(wave, sigma, valid)
    contrast = patches.contrast[(patches.filled > LEAST_FILLED) & np.isfinite(patches.contrast)]
    # so much is lost that it must be reckoned with
    faded = bool(len(contrast) >= _FEWEST and np.mean(contrast < 1.0 - FADED) > _SOME)

    def followed(patches: Patches, labels: Labels, wave: Array) -> FollowedFringes:
        return FollowedFringes(faded, patches, labels, wave, valid, _at(error, patches))

    if faded:
        patches, labels = _coarse_to_fine(wave, sigma, valid, faded=True)
        for _ in range(_CONTRAST_ROUNDS):
            result = followed(patches, labels, wave / fade).anchored(known)
            if not np.isfinite(result.terms).any():
                break
            unfaded = replace(patches, contrast=patches.contrast * _at(fade, patches))
            before = fade
            law = fit_contrast(unfaded, result.terms)
            fade = contrast_map(patches, result.terms, law, wave.shape)
            patches, labels = _coarse_to_fine(wave / fade, sigma / fade, valid, faded=True)
            if np.percentile(np.abs(fade - before)[valid], _MOSTLY) < FADED:
                break
    return followed(patches, labels, wave / fade), fade


def _at(image: Array, patches: Patches) -> Array:
    """An image at the patches' middles (m, n)."""
    return image[np.ix_(patches.rows, patches.cols)]


def _coarse_to_fine(
    wave: Array, sigma: Array, valid: Mask, *, faded: bool = False
) -> tuple[Patches, Labels]:
    """Patches and labels, each binning guiding the next finer one.

    Where the order hardly changes, a small patch on a crest cannot tell on which side of it it
    lies; a patch four times as wide can. Where fringes are too fine for it, binned patches fit
    badly and guide nothing.
    """
    expected: tuple[Array, Array] | None = None
    told: Array | None = None
    halved = (_COARSEST >> k for k in range(_COARSEST.bit_length()))
    binnings = [b for b in halved if b == 1 or min(wave.shape) // b >= _LEAST_PIXELS]
    for k, binning in enumerate(binnings):
        frame = binned(wave, sigma, valid, binning)
        contrast = None if told is None or not faded else everywhere(told)
        patches = fit_patches(gather_patches(*frame), expected, contrast, deviation=faded)
        patches = with_told(patches, binning, told)
        labels = mend_mirrored(patches, label_patches(patches))
        if k + 1 < len(binnings):
            ratio = binning // binnings[k + 1]
            finer = [n // binnings[k + 1] for n in wave.shape]
            rows, cols = ((middles(n) - 0.5 * (ratio - 1)) / ratio for n in finer)
            expected = expected_terms(patches, labels, rows, cols, ratio)
            told = patches.contrast[nearest_patches(patches, rows, cols)]
    return patches, labels


def _dense(patches: Patches, terms: Array, valid: Mask) -> OrderReading:
    """The mean of the patches' orders at each pixel, and how far they agree.

    Equation: u² = max(mean of the patches' u², variance of their orders), since noise alone makes
    patches differ; a patch's u is that of the stated noise, times its chi where that is below 1,
    and not below that of half the patches: the stated noise has a floor, many frames have less.
    """
    use = np.isfinite(terms[..., 0])
    terms = np.where(use[..., None], terms, 0.0)
    usual = np.median(patches.chi[use]) if use.any() else 1.0
    of_patch = patches.spread[..., 0] * np.clip(patches.chi, min(usual, 1.0), 1.0)
    trust = np.where(use, 1.0 / (of_patch**2 + _GROUND**2), 0.0)
    dy, dx, window = offsets()
    orders = np.abs(terms.reshape(-1, 6) @ basis(dy.astype(float), dx.astype(float)).T)
    sums = np.zeros((4, *valid.shape))
    bodies, count = label(valid)
    for k, (y, x, w) in enumerate(zip(dy, dx, window, strict=True)):
        order = orders[:, k].reshape(trust.shape)
        at = np.ix_(patches.rows + y, patches.cols + x)
        share = w * (use if count == 1 else use & (bodies[at] == patches.body))
        first = share * trust * order
        for total, value in zip(sums, (share * trust, first, first * order, share), strict=True):
            total[at] += value
    weight, first, second, cover = sums
    covered = valid & (cover > _LEAST_COVER * max(float(cover.max()), 1e-9))
    safe = np.where(covered, weight, 1.0)
    mean = first / safe
    spread = np.sqrt(np.maximum(second / safe - mean**2, 0.0))
    uncertainty = np.maximum(np.sqrt(np.where(covered, cover, 1.0) / safe), spread)
    known = covered & (uncertainty < LARGEST_UNCERTAINTY)
    return make_reading(mean, uncertainty, known, of=valid)


def common_reading(readings: Sequence[FreeReading]) -> FreeReading:
    """The reading that misses the fewest known points, as uncertain as its equals leave it.

    Several smooth lights may explain a frame alike, and under each other regions are turned over
    about a crest: u' = (u² + sum d²)^(1/2), d the difference of another reading's order; a pixel of
    more than 0.03 fringe, or that another does not know, is not known. A known order that is missed
    speaks against a light. `readings`: the best first.
    """
    best, *others = _fewest_missed(readings)
    orders = [result.reading.order for result in others]
    if not orders:
        return best
    error = _disagreement(best.reading.order, orders)
    reading = less_sure(best.reading, error, LARGEST_UNCERTAINTY)
    note = _of_what_is_lost(best.reading, reading, orders)
    return replace(best, reading=reading, said=(*best.said, *note))


def common_orders(
    followed: Sequence[FollowedFringes], known: KnownOrders
) -> tuple[Array, tuple[str, ...]]:
    """The patches' orders (m, n) by what is known, as `common_reading` has pixels', and words."""
    best, *others = _fewest_missed([one.anchored(known) for one in followed])
    order, *orders = (np.abs(one.terms[..., 0]) for one in (best, *others))
    if orders:
        order = np.where(_disagreement(order, orders) < LARGEST_UNCERTAINTY, order, np.nan)
    return order, best.said


_Result = TypeVar("_Result", FreeReading, Anchored)


def _fewest_missed(results: Sequence[_Result]) -> list[_Result]:
    """The results that miss the fewest known points."""
    fewest = min(len(result.misses) for result in results)
    return [result for result in results if len(result.misses) == fewest]


def _disagreement(order: Array, orders: Sequence[Array]) -> Array:
    """How far others are from an order, root sum of squares; inf where one is not known."""
    square = np.sum([(order - other) ** 2 for other in orders], axis=0)
    return np.sqrt(np.where(np.isnan(square), np.inf, square))


def _of_what_is_lost(before: OrderReading, after: OrderReading, orders: list[Array]) -> list[str]:
    """What to say of pixels that other lights take away."""
    read = np.isfinite(before.order)
    lost = read & ~np.isfinite(after.order)
    share = float(lost.sum() / max(1, int(read.sum())))
    if share < _WORTH_SAYING:
        return []
    note = message("another_smooth_light_explains", share=100.0 * share)
    for order in orders:
        away = np.where(lost, np.abs(order - before.order), np.nan)
        if (away > APART).any():  # else no known order rules either light out
            at = innermost(clearly_apart(away))
            first, second = sorted((float(before.order[at]), float(order[at])))
            note += message(
                "known_order_row_column", at=at[0], at_2=at[1], first=first, second=second
            )
            break
    return [note]
