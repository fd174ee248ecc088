r"""One whole number for each part of a frame, from points whose order the user knows.

A part's patches say N = |f + j| with one whole number j that no light can tell. A point of known
order o says j = round(o - f) or round(-o - f). Off the fringe lines only one of the two fits the
light; on a line, 2 o a whole number, both do: such a point says the line, and not on which side of
it the order is higher. The j of a part is therefore chosen jointly: it costs
sum min(((|f + j| - o)/sigma)², C) over the part's points, so that among many a wrong point is
outvoted, and a line of N = 0 through the part, which is not generic in a loaded body (isotropic
places are points), costs as well, unless a point says it. Where two j are nearly as good the part
is not known. A point that the rest contradicts may lie beyond a seam that the light leaves open
(`sign_ambiguity`): then that seam is closed as the point says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from isochrome.fringes.single_frame.patch_labels import Labels
from isochrome.fringes.single_frame.patches import HALF, STRIDE, Patches, basis
from isochrome.fringes.single_frame.sign_ambiguity import has_zero_line, open_seams, turned_to
from isochrome.fringes.windows import Array, Mask

KnownPoint = tuple[float, float, float] | tuple[float, float, float, str]
"""Row and column of a pixel, the fringe order there, and "maximum" or "minimum" where it is one."""

_STATED = 0.035
"""Standard deviation, in fringes, of an order that a user counts and estimates between lines."""
_MOST = 16.0
"""Most that a point costs, chi²: many outvote one that is off."""
_WITHIN = 0.24
"""Fringes within which an order fits the light: estimates may be rough."""
_ZERO_LINE = 9.0
_CLEAR = 8.0
"""By how much a whole number must be better than another, chi²: odds of 50 to 1."""
_BELOW = 0.1
"""Order below which a known point says a line of N = 0, fringes."""
_FEWEST = 6
"""Patches beyond an open seam from which it is said."""
_NEAR_ZERO = 3
"""Patches about a point in which it says such a line."""
_ALONE = 0.1
"""Share of what could be followed, without a point, from which it is said."""
_TURNED = 0.05
"""Fringes by which all around a point must lie below it for a maximum, or above for a minimum."""
_APART = 0.2
"""Fringes between two orders that are worth asking for."""


@dataclass(frozen=True)
class Anchored:
    """What the known points make of the patches.

    `terms` (m, n, 6) of the signed order, NaN where it is not known; `misses`, points that were not
    used; `said`, what is open, and what point would settle it.
    """

    terms: Array = field(repr=False)
    misses: tuple[KnownPoint, ...]
    said: tuple[str, ...]


@dataclass(frozen=True)
class _At:
    """A known point: the patch (row, col) about it, and the part's field f there.

    `around`, how far f lies above that all around, below it where negative; nought where it turns
    neither way.
    """

    point: KnownPoint
    patch: tuple[int, int]
    field: float
    around: float = 0.0

    @property
    def order(self) -> float:
        """The known order."""
        return self.point[2]

    def miss(self, j: int) -> float:
        """How far the order is from |f + j|, fringes."""
        return abs(abs(self.field + j) - self.order)

    def cost(self, j: int) -> float:
        """What the point costs with j, chi²."""
        return min((self.miss(j) / _STATED) ** 2, _MOST) if self.turns(j) else _MOST

    def fits(self, j: int) -> bool:
        """Whether the order is that of j, roughly estimated."""
        return self.miss(j) < _WITHIN and self.turns(j)

    def turns(self, j: int) -> bool:
        """Whether |f + j| is the extremum that the point is said to be, if it is."""
        if len(self.point) < 4:
            return True
        above = self.around * np.sign(self.field + j)
        return bool(above > 0.0 if self.point[3] == "maximum" else above < 0.0)

    @property
    def on_line(self) -> bool:
        """Whether the light beside it says the order, and not on which side it is higher."""
        from_line = abs(2.0 * self.field - round(2.0 * self.field))
        return bool(from_line**2 < _CLEAR * _STATED**2)

    def __str__(self) -> str:
        row, col, order = self.point[:3]
        return f"{order:g} at row {row:g}, column {col:g}"


def anchor_parts(
    patches: Patches, labels: Labels, known: Sequence[KnownPoint], valid: Mask
) -> Anchored:
    """Choose the whole number of each part that has a known point, and the side of open seams.

    Parameters: `patches`; their `labels`; `known` points; `valid`, True = trusted pixel (rows,
    cols). Returns an Anchored.
    """
    terms = np.full_like(patches.terms, np.nan)
    field_terms = labels.sign[..., None] * patches.terms
    field_terms[..., 0] += labels.shift
    said: list[str] = []
    misses: list[KnownPoint] = []
    by_part: dict[int, list[_At]] = {}
    for point in known:
        patch = _nearest(patches, labels, point)
        part = _part_at(patches, labels, point, patch)
        if part < 0:
            misses.append(point)
            said.append(_unfollowed(point, valid))
            continue
        place = basis(
            np.array(point[0] - patches.rows[patch[0]]), np.array(point[1] - patches.cols[patch[1]])
        )
        at = float(place @ field_terms[patch])
        inside = np.where(labels.part == part, field_terms[..., 0], np.nan)
        by_part.setdefault(part, []).append(_At(point, patch, at, _above(inside, patch, at)))
    for part, points in sorted(by_part.items()):
        inside = labels.part == part
        own = np.where(inside[..., None], field_terms, np.nan)
        found = _one_part(patches, own, points)
        misses += found.misses
        said += found.said
        terms[inside] = found.terms[inside]
    alone = (labels.part >= 0) & ~np.isin(labels.part, list(by_part))
    share = float(alone.sum() / max(1, int((labels.part >= 0).sum())))
    if share > _ALONE:
        said.append(_left_alone(patches, labels, alone, share))
    return Anchored(terms, tuple(misses), tuple(said))


def _above(values: Array, patch: tuple[int, int], at: float) -> float:
    """How far a field lies above the nearest square about a patch that is all above or below it.

    Parameters: `values` (m, n), NaN outside the part; `patch`; `at`, the field there. Returns
    nought where some of the square about it lies above and some below, or half is not known.
    """
    away = np.abs(np.indices(values.shape) - np.reshape(patch, (2, 1, 1))).max(axis=0)
    for k in range(1, int(away.max()) + 1):
        around = values[away == k]
        fall = at - around[np.isfinite(around)]
        if 2 * fall.size < around.size or (fall.max() > _TURNED and fall.min() < -_TURNED):
            return 0.0
        if np.abs(fall).min() > _TURNED:
            return float(fall.mean())
    return 0.0


def _unknown(own: Array, points: list[_At], *said: str) -> Anchored:
    """A part of which nothing is known, and why."""
    return Anchored(np.full_like(own, np.nan), tuple(p.point for p in points), said)


def _one_part(patches: Patches, own: Array, points: list[_At]) -> Anchored:
    """A part's order by its points."""
    candidates = sorted({round(s * p.order - p.field) for p in points for s in (1, -1)})
    candidates = [j for j in candidates if any(p.fits(j) for p in points)]
    if not candidates:
        return _unknown(own, points, *map(_fits_nothing, points))
    lines = {j: _zero_line(own, j, points) for j in candidates}
    cost = {j: sum(p.cost(j) for p in points) + _ZERO_LINE * lines[j] for j in candidates}
    best = min(candidates, key=cost.__getitem__)
    rivals = [j for j in candidates if j != best and cost[j] < cost[best] + _CLEAR]
    if rivals:
        for j in (best, *rivals):
            if not all(p.fits(j) for p in points):
                found = _with_seams(patches, own, points, j)
                if not found.misses:
                    return found
        return _open(patches, own, points, best, rivals[0])
    sure = [p for p in points if p.fits(best)]
    if lines[best] and all(p.on_line for p in sure):
        return _unknown(
            own,
            sure,
            f"frames.known_order = {sure[0]}: the order would be 0 along a line inside the "
            "specimen, which a loaded body hardly has: no order is reported there; give a known "
            "order between two fringe lines, or one on that line if it is so",
        )
    return _with_seams(patches, own, points, best)


def _with_seams(patches: Patches, own: Array, points: list[_At], j: int) -> Anchored:
    """Open seams closed as points beyond them say, and what still lies beyond one left out."""
    terms = own.copy()
    terms[..., 0] += j
    sure, others = ([p for p in points if p.fits(j) == fit] for fit in (True, False))
    said: list[str] = []
    misses: list[KnownPoint] = []
    sources = [p.patch for p in sure]
    for p in others:
        before = abs(p.field + j)
        turned = turned_to(patches, terms, sources, p.patch, p.order, _WITHIN)
        if turned is None:
            misses.append(p.point)
            votes = f"{len(sure)} other{'s' * (len(sure) > 1)}"
            said.append(
                f"frames.known_order = {p}: contradicted by {votes}, with which it would be "
                f"{before:.2f}; it is left out, check it"
                if abs(p.order - _levels(p)[0]) < _WITHIN
                else _fits_nothing(p)
            )
            continue
        terms = turned
        sources.append(p.patch)
    zero_said = _zero_said(own[..., 0] + j, j, points)
    for crest, beyond in open_seams(patches, terms, sources, zero_said):
        if beyond.sum() >= _FEWEST:
            said.append(_beyond_seam(patches, terms, beyond, crest))
        terms[beyond] = np.nan
    return Anchored(terms, tuple(misses), tuple(said))


def _zero_line(own: Array, j: int, points: list[_At]) -> bool:
    """Whether N = |f + j| is 0 along a line through the part, and no point says so."""
    order = own[..., 0] + j
    return has_zero_line(order) and not _zero_said(order, j, points)


def _zero_said(order: Array, j: int, points: list[_At]) -> bool:
    """Whether points say that N = 0 along a line: one on it, or two on either side of it."""
    there = [p for p in points if p.fits(j)]
    sides = {np.sign(p.field + j) for p in there if p.order > _BELOW and not p.on_line}
    if len(sides) == 2:
        return True
    for p in there:
        near = tuple(slice(max(0, i - _NEAR_ZERO), i + _NEAR_ZERO + 1) for i in p.patch)
        if p.order < _BELOW and (order[near] > 0.0).any() and (order[near] < 0.0).any():
            return True
    return False


def _open(patches: Patches, own: Array, points: list[_At], best: int, rival: int) -> Anchored:
    """A part for which two whole numbers are as good: nothing is known, and why."""
    listed = "; ".join(map(str, points))
    if all(any(not p.fits(j) for p in points) for j in (best, rival)):
        said = (
            f"frames.known_order: {listed} contradict each other, and no more speaks for one than "
            "for the other: no order is reported there; check them, or add another"
        )
    else:
        orders = [np.abs(own[..., 0] + j) for j in (best, rival)]
        row, col, at = _place(patches, np.abs(orders[0] - orders[1]) > _APART)
        first, second = sorted(o[at] for o in orders)
        turning = next((p for p in points if p.around), None)
        said = (
            f"frames.known_order = {listed}: on a fringe line, and the light cannot decide on which"
            " side of it the order is higher: no order is reported there; add a known order between"
            f" two lines, such as at row {row}, column {col}: {first:.2f} or {second:.2f}"
        )
        if turning is not None:
            said += f', or extremum = "maximum" or "minimum" to that of {turning}'
    return _unknown(own, points, said)


def _beyond_seam(patches: Patches, terms: Array, beyond: Mask, crest: int) -> str:
    """What to say of patches whose branch the light does not settle."""
    mirrored = np.abs(crest - terms[..., 0])
    differ = np.abs(mirrored - np.abs(terms[..., 0])) > _APART
    row, col, at = _place(patches, beyond & (differ if (beyond & differ).any() else beyond))
    share = 100.0 * beyond.sum() / max(1, np.isfinite(terms[..., 0]).sum())
    first, second = sorted([float(mirrored[at]), abs(float(terms[at][0]))])
    return (
        f"the light cannot decide whether the order goes on or turns back at the line of order "
        f"{abs(0.5 * crest):g}: {share:.0f} % of what was followed is not known; a known order at "
        f"row {row}, column {col} settles it: {first:.2f} or {second:.2f}"
    )


def _left_alone(patches: Patches, labels: Labels, alone: Mask, share: float) -> str:
    numbers, counts = np.unique(labels.part[alone], return_counts=True)
    row, col, _ = _place(patches, labels.part == numbers[counts.argmax()])
    return (
        f"{100.0 * share:.0f} % of what could be followed hangs together with no known point; "
        f"add [[frames.known_order]] there, such as at row {row}, column {col}"
    )


def _place(patches: Patches, where: Mask) -> tuple[int, int, tuple[int, int]]:
    """The middle-most place of some patches: row and column of its pixel, and its patch."""
    from scipy.ndimage import distance_transform_edt

    depth = distance_transform_edt(np.pad(where, 1))[1:-1, 1:-1]
    i, j = (int(v) for v in np.unravel_index(depth.argmax(), depth.shape))
    return int(patches.rows[i]), int(patches.cols[j]), (i, j)


def _levels(p: _At) -> list[float]:
    """The orders that the light at a point may have, the nearest to the known one first."""
    base = abs(p.field - round(p.field))
    levels = [v for k in range(int(p.order) + 2) for v in (k + base, k + 1.0 - base)]
    return sorted(levels, key=lambda v: abs(v - p.order))


def _fits_nothing(p: _At) -> str:
    if any(abs(v - p.order) < _WITHIN for v in _levels(p)) and len(p.point) > 3:
        return (
            f"frames.known_order = {p}: the order is no {p.point[3]} there; correct its extremum, "
            "or leave that out"
        )
    near = sorted(_levels(p)[:2])
    return (
        f"frames.known_order = {p}: fits no fringe there, where the light says {near[0]:.2f} or "
        f"{near[1]:.2f}; check it"
    )


def _unfollowed(point: KnownPoint, valid: Mask) -> str:
    row, col, order = point[:3]
    i, j = round(row), round(col)
    inside = 0 <= i < valid.shape[0] and 0 <= j < valid.shape[1] and bool(valid[i, j])
    why = (
        "no fringe could be followed there; move it to a place of clear fringes"
        if inside
        else "lies outside the specimen, or where the frame is not trusted; move it inside"
    )
    return f"frames.known_order = {order:g} at row {row:g}, column {col:g}: {why}"


def _nearest(patches: Patches, labels: Labels, point: KnownPoint) -> tuple[int, int]:
    """The nearest patch that is followed: one on a flat crest may not be, and others reach it."""
    down, right = np.abs(patches.rows - point[0]), np.abs(patches.cols - point[1])
    far = np.hypot(down[:, None], right[None, :])
    at = np.where(labels.part >= 0, far, np.inf).argmin()
    row, col = np.unravel_index(at, far.shape)
    return int(row), int(col)


def _part_at(patches: Patches, labels: Labels, point: KnownPoint, patch: tuple[int, int]) -> int:
    """The part of the patch about a point, -1 where there is none near."""
    far = max(abs(point[0] - patches.rows[patch[0]]), abs(point[1] - patches.cols[patch[1]]))
    return -1 if far > HALF + STRIDE else int(labels.part[patch])
