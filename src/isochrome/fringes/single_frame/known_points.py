r"""One whole number for each part of a frame, from points and lines whose order the user knows.

A part's patches say N = |f + j| with one whole number j that no light can tell. A point of known
order o says j = round(o - f) or round(-o - f). Off the fringe lines only one of the two fits the
light; on a line, 2 o a whole number, both do: such a point says the line, and not on which side of
it the order is higher, and so do all places of a known fringe line together. The j of a part is
therefore chosen jointly: it costs the sum of min(((|f + j| - o)/sigma)², C) over the part's points
and lines, a line having one voice, so that among many a wrong one is outvoted. Where two j are
nearly as good the part is not known. A line of N = 0 through the part is not generic in a loaded
body (isotropic places are points), though a beam has one: where what is known lies on lines alone,
it must be said. A point that the rest contradicts may lie beyond a seam that the light leaves open
(`sign_ambiguity`): then that seam is closed as the point says.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from isochrome.fringes.on_branch import LARGEST_UNCERTAINTY, moved_by_light
from isochrome.fringes.single_frame.patch_labels import Labels
from isochrome.fringes.single_frame.patches import HALF, STRIDE, Patches
from isochrome.fringes.single_frame.sign_ambiguity import (
    ZeroPlace,
    open_seams,
    turned_to,
    zero_lines,
)
from isochrome.fringes.single_frame.stated_orders import (
    CLEAR,
    KnownPlaces,
    KnownPoint,
    Stated,
    StatedPlace,
    fits_nothing,
    left_out,
    stated_place,
)
from isochrome.fringes.windows import Array, Mask, innermost
from isochrome.messages import message

_BELOW = 0.1
"""Order below which a known point says a line of N = 0, fringes."""
_FEWEST = 6
"""Patches beyond an open seam from which it is said."""
_ALONE = 0.1
"""Share of what could be followed, without a point, from which it is said."""
_TELLABLE = 0.2
"""Fringes between two answers that a known order tells apart: closer to a line than half of that it
says the line, and not the side."""
_SHARP = 0.1
"""Share of the difference of two answers that the light may move them by where a point is asked."""
_DOUBTFUL = 0.003
"""Uncertainty of the signal by the ends of the light from which a line of N = 0 must be known."""
_OF_ZERO_LINE = "order_would_along_line"
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


def anchor_parts(
    patches: Patches, labels: Labels, known: Sequence[KnownPlaces], valid: Mask, error: Array
) -> Anchored:
    """Choose the whole number of each part where an order is known, and the side of open seams.

    Parameters: `patches`; their `labels`; what is `known`; `valid`, True = trusted pixel (rows,
    cols); `error` (m, n), the signal's uncertainty by the ends of the light. Returns an Anchored.
    """
    terms = np.full_like(patches.terms, np.nan)
    field_terms = labels.sign[..., None] * patches.terms
    field_terms[..., 0] += labels.shift
    said: list[str] = []
    misses: list[KnownPoint] = []
    by_part: dict[int, list[Stated]] = {}
    for each in known:
        places = [stated_place(patches, labels, field_terms, each, p) for p in each.places]
        parts = [_part_at(patches, labels, p) for p in places]
        misses += [p.point for p, part in zip(places, parts, strict=True) if part < 0]
        if max(parts) < 0:
            said.append(_unfollowed(each, valid))
        for part in sorted({part for part in parts if part >= 0}):
            own = tuple(p for p, at in zip(places, parts, strict=True) if at == part)
            by_part.setdefault(part, []).append(Stated(each, own))
    for part, given in sorted(by_part.items()):
        inside = labels.part == part
        result = _one_part(patches, np.where(inside[..., None], field_terms, np.nan), given, error)
        misses += result.misses
        said += result.said
        terms[inside] = result.terms[inside]
    alone = (labels.part >= 0) & ~np.isin(labels.part, list(by_part))
    share = float(alone.sum() / max(1, int((labels.part >= 0).sum())))
    if share > _ALONE:
        said.append(_left_alone(patches, labels, alone, share))
    return Anchored(terms, tuple(misses), tuple(said))


def _unknown(own: Array, given: list[Stated], *said: str) -> Anchored:
    """A part of which nothing is known, and why."""
    points = tuple(p.point for g in given for p in g.places)
    return Anchored(np.full_like(own, np.nan), points, said)


def _one_part(patches: Patches, own: Array, given: list[Stated], error: Array) -> Anchored:
    """A part's order by what is known in it."""
    candidates = {
        round(s * g.order - p.field) for g in given for p in g.places for s in (1.0, -1.0)
    }
    candidates = {j for j in candidates if any(g.fits(j) for g in given)}
    if not candidates:
        return _unknown(own, given, *(fits_nothing(g, g.first) for g in given))
    lines = {j: zero_lines(own[..., 0] + j, _zero_said(j, given)) for j in candidates}
    cost = {j: sum(g.cost(j) for g in given) for j in candidates}
    # a line of N = 0 is unlikely, and no proof: it says what is tried first, and settles nothing
    best, *others = sorted(candidates, key=lambda j: (round(cost[j], 6), lines[j], j))
    rivals = [j for j in others if cost[j] < cost[best] + CLEAR]
    if rivals:
        for j in (best, *rivals):
            if not all(p.fits(j) for g in given for p in g.places):
                result = _with_seams(patches, own, given, j, error)
                if not result.misses:
                    return result
        return _open(patches, own, given, best, rivals[0])
    sure = [g for g in given if g.fits(best)]
    doubtful = float(np.median(error[np.isfinite(own[..., 0])])) > _DOUBTFUL
    if lines[best] and (doubtful or all(g.on_line for g in sure)):
        return _unknown(own, sure, f"{sure[0]}: " + message(_OF_ZERO_LINE))
    return _with_seams(patches, own, given, best, error)


def _with_seams(
    patches: Patches, own: Array, given: list[Stated], j: int, error: Array
) -> Anchored:
    """Open seams closed as points beyond them say, and what still lies beyond one left out."""
    terms = own.copy()
    terms[..., 0] += j
    said: list[str] = []
    misses: list[KnownPoint] = []
    used = [(g, p) for g in given for p in g.places if p.cost(j) < CLEAR]
    zero_said = _zero_said(j, given)
    for g in given:
        missed = []
        for p in (p for p in g.places if p.cost(j) >= CLEAR):
            turned = _turned(patches, terms, used, zero_said, g, p)
            if turned is None:
                missed.append(p)
            else:
                terms = turned
                used.append((g, p))
        if missed:
            misses += [p.point for p in missed]
            said.append(left_out(g, missed, j, sum(other.fits(j) for other in given)))
    sources = [g.source(p, terms) for g, p in used]
    for crest, beyond in open_seams(patches, terms, sources, zero_said):
        if beyond.sum() >= _FEWEST:
            said.append(_beyond_seam(patches, terms, beyond, crest, error))
        terms[beyond] = np.nan
    return Anchored(terms, tuple(misses), tuple(said))


def _turned(
    patches: Patches,
    terms: Array,
    used: list[tuple[Stated, StatedPlace]],
    zero_said: list[ZeroPlace],
    given: Stated,
    p: StatedPlace,
) -> Array | None:
    """The terms (m, n, 6) with an open seam closed as a place beyond it says.

    As they are where the place fits, since another place of its line has closed it, or roughly, and
    better beyond no seam; None where it fits neither way.
    """
    there = given.source(p, terms)
    miss = abs(abs(float(there.basis @ terms[p.patch])) - given.order)
    if (miss / p.sigma) ** 2 < CLEAR:
        return terms
    sources = [g.source(q, terms) for g, q in used]
    turned = turned_to(patches, terms, sources, zero_said, there, given.order, p.within)
    return terms if turned is None and miss < p.within else turned


def _zero_said(j: int, given: list[Stated]) -> list[ZeroPlace]:
    """Where it is known that N = 0 along a line: a place on it, or two on its two sides."""
    there = [(g, p) for g in given if g.known.says_zero_line for p in g.places if p.fits(j)]
    on: list[ZeroPlace] = [(p.patch,) for g, p in there if g.order < _BELOW]
    off = [p for g, p in there if g.order > _BELOW and not g.on_line]
    above, below = ([p for p in off if sign * (p.field + j) > 0.0] for sign in (1.0, -1.0))
    return on + [(p.patch, q.patch) for p in above for q in below]


def _open(patches: Patches, own: Array, given: list[Stated], best: int, rival: int) -> Anchored:
    """A part for which two whole numbers are as good: nothing is known, and why."""
    listed = "; ".join(map(str, given))
    if all(any(not g.fits(j) for g in given) for j in (best, rival)):
        said = message("contradict_each_other_no", listed=listed)
    else:
        orders = [np.abs(own[..., 0] + j) for j in (best, rival)]
        row, col, at = _place(patches, clearly_apart(np.abs(orders[0] - orders[1])))
        first, second = sorted(o[at] for o in orders)
        said = message(
            "fringe_line_light_cannot", listed=listed, row=row, col=col, first=first, second=second
        )
        turning = next((g for g in given if not g.known.is_line and g.first.around), None)
        if turning is not None:
            said += message("extremum_maximum_minimum", turning=turning)
    return _unknown(own, given, said)


def _beyond_seam(patches: Patches, terms: Array, beyond: Mask, crest: int, error: Array) -> str:
    """What to say of patches whose branch the light does not settle.

    A point is asked for where the light is known well enough for its answer to be the order.
    """
    order = terms[..., 0]
    mirrored = np.abs(crest - order)
    share = 100.0 * beyond.sum() / max(1, np.isfinite(order).sum())
    said = message("light_cannot_decide_whether", crest=abs(0.5 * crest), share=share)
    apart = np.where(beyond, np.abs(mirrored - np.abs(order)), np.nan)
    most = float(np.nanmax(apart))
    if most < _TELLABLE:
        return message("lies_within_line_order", said=said, most=0.5 * most)
    moved = moved_by_light(np.where(beyond, order, 0.0), error)
    lit = (apart >= _TELLABLE) & (moved < np.minimum(LARGEST_UNCERTAINTY, _SHARP * apart))
    if not lit.any():
        return message("nor_light_there_give", said=said)
    differ = np.where(lit, apart, np.nan)
    row, col, at = _place(patches, clearly_apart(differ))
    first, second = sorted([float(mirrored[at]), abs(float(order[at]))])
    return message(
        "known_order_row_column_settles", said=said, row=row, col=col, first=first, second=second
    )


def _left_alone(patches: Patches, labels: Labels, alone: Mask, share: float) -> str:
    numbers, counts = np.unique(labels.part[alone], return_counts=True)
    row, col, _ = _place(patches, labels.part == numbers[counts.argmax()])
    return message("what_could_followed_hangs", share=100.0 * share, row=row, col=col)


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


def part_near(
    patches: Patches, labels: Labels, place: tuple[float, float], *, on_line: bool = False
) -> int:
    """The part for which an order at a place speaks, -1 where there is none near.

    Parameters: `patches`, their `labels`; `place` (row, col), px; `on_line`, whether a line's.
    """
    kind = KnownPlaces((place,) * (2 if on_line else 1), 0.0)
    return _part_at(patches, labels, stated_place(patches, labels, patches.terms, kind, place))


def _part_at(patches: Patches, labels: Labels, p: StatedPlace) -> int:
    """The part of the patch about a place, -1 where there is none near."""
    far = max(
        abs(p.point[0] - patches.rows[p.patch[0]]), abs(p.point[1] - patches.cols[p.patch[1]])
    )
    return -1 if far > HALF + STRIDE else int(labels.part[p.patch])
