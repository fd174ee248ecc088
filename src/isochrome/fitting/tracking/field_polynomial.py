"""A stress difference as a polynomial of a scene's values: rendered a few times, then only added.

Between a few places of its values a contact's field is smooth: at a fixed pixel it is interpolated
by the terms t_i^m, t_i^m t_j^n (m, n <= 2) and t_i t_j t_k of the values in units of a box,
-1 <= t <= 1, through fields rendered at Chebyshev's places along each value and at the corners of
each pair and triple: a sparse grid (Smolyak 1963, Dokl. Akad. Nauk SSSR 148, 1042). Triples have
more corners than terms: least squares there.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any

import numpy as np

from isochrome.fitting.arrays import Array

Render = Callable[[Array, bool], tuple[Array, Array | None]]
"""Values (p,), and whether the visibility is wanted, to field and visibility (n,)."""

CORNER = round(0.5**0.5, 12)
"""Where the corners of a pair of values lie, in half-widths of the box: as one of the places along
each of them, so that what costs most, the mechanics, is solved once for both."""
CHECKED = 0.85
"""Where a polynomial is checked, in half-widths: beyond all corners that were rendered."""


@dataclass(frozen=True)
class FieldBox:
    """Field and visibility over a box of values: `middle` (p,) and `half` (p,) its half-widths.

    `powers` (terms, p), exponents; `field` (terms, n) complex64, their coefficients at the pixels;
    `visibility` (1 + p, n), its value in the middle and its slopes.
    """

    middle: Array
    half: Array
    powers: Array
    field: Array
    visibility: Array

    def place(self, values: Array) -> Array:
        """Values (p,) in units of the box, -1..1 inside."""
        return np.asarray((values - self.middle) / self.half)

    def at(self, values: Array) -> tuple[Array, Array]:
        """Stress difference (n,), MPa, complex64, and visibility (n,) at some values (p,)."""
        t = self.place(values)
        return _sum(_terms(t, self.powers), self.field), _sum([1.0, *t], self.visibility)

    def shift(self, field: Array) -> None:
        """Add a field (n,), MPa, everywhere."""
        self.field[np.flatnonzero(~self.powers.any(axis=1))[0]] += field

    def slope(self, values: Array, axis: int) -> tuple[Array, Array]:
        """Derivatives of both by one value, per its own unit."""
        t = self.place(values)
        lower = self.powers.copy()
        lower[:, axis] = np.maximum(lower[:, axis] - 1, 0)
        weights = self.powers[:, axis] * _terms(t, lower) / self.half[axis]
        used, half = np.flatnonzero(weights), np.float32(self.half[axis])
        return _sum(weights[used], self.field[used]), self.visibility[1 + axis] / half


def make_field_box(
    render: Render, low: Array, high: Array, degrees: tuple[int, ...], cheap: tuple[int, ...] = ()
) -> FieldBox:
    """Interpolate a field over a box of values.

    Parameters: `render`, values (p,) to stress difference and visibility (n,); `low`, `high` (p,),
    the box; `degrees`, the highest power of each value, even; `cheap`, the values that move no
    mechanics: terms of three values are only those with one of these. Where no power is above the
    second, there are none, and of two values their product alone. Returns a FieldBox. Raises what
    `render` raises.
    """
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    places, powers = _places(degrees, cheap)
    # the visibility's slopes need the middle and the ends only
    ends = [np.abs(t).sum() == np.abs(t).max() in (0.0, 1.0) for t in places]
    made = [render(middle + half * t, end) for t, end in zip(places, ends, strict=True)]
    weights = np.linalg.pinv(np.array([_terms(t, powers) for t in places]))
    fields = np.stack([field.astype(np.complex64, copy=False) for field, _ in made])
    sampled = [v for (_, v), end in zip(made, ends, strict=True) if end and v is not None]
    seen = np.stack([np.broadcast_to(v, fields.shape[1:]).astype(np.float32) for v in sampled])
    slopes = np.linalg.pinv(np.column_stack((np.ones(len(sampled)), places[ends])))
    return FieldBox(
        middle, half, powers, _product(weights, fields), slopes.astype(np.float32) @ seen
    )


def _places(degrees: tuple[int, ...], cheap: tuple[int, ...]) -> tuple[Array, Array]:
    """Where to render, (terms, p) in units of the box, and the exponents that this allows."""
    size = len(degrees)
    places, powers = [np.zeros(size)], [np.zeros(size, int)]
    unit = np.eye(size)
    for axis, degree in enumerate(degrees):
        ends = np.cos(np.pi * np.arange(degree + 1) / degree)
        places += [round(t, 12) * unit[axis] for t in ends if abs(t) > 1e-9]
        powers += [m * unit[axis].astype(int) for m in range(1, degree + 1)]
    triples = [some for some in combinations(range(size), 3) if set(some) & set(cheap)]
    for some in [*combinations(range(size), 2), *triples]:
        axes = unit[list(some)]
        if max(degrees[axis] for axis in some) > 2:
            corners: Any = product((-CORNER, CORNER), repeat=len(some))
            high = (1, 2) if len(some) == 2 else (1,)
        elif len(some) == 2:  # the product alone, from the two corners where odd terms cancel
            corners, high = ((-1.0, -1.0), (1.0, 1.0)), (1,)
        else:
            continue
        places += [np.array(t) @ axes for t in corners]
        powers += [(np.array(m) @ axes).astype(int) for m in product(high, repeat=len(some))]
    # those that differ only in cheap values follow each other: they share the mechanics
    ranks = sorted(range(size), key=lambda j: (j not in cheap, degrees[j]))
    order = np.lexsort([np.array(places)[:, j] for j in ranks])
    return np.array(places)[order], np.array(powers)


def _terms(t: Array, powers: Array) -> Array:
    return np.asarray(np.prod(t**powers, axis=1))


def _sum(weights: Any, rows: Array) -> Array:
    return np.asarray(_product(np.asarray(weights)[None, :], rows)[0])


def _product(weights: Array, rows: Array) -> Array:
    """A real matrix times rows, real or complex, in single precision."""
    real = rows.view(np.float32)
    return np.asarray((weights.astype(np.float32) @ real).view(rows.dtype))
