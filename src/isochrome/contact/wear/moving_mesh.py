r"""A mesh that moves with the contact's edges: integrals and derivatives in closed form.

Nodes ξ = (3c - c³)/2 on the contact, c = cos φ, φ equally spaced, its edges included. They crowd as
φ⁴ at the edges, where pressure and depth are broken powers of the distance: what is d^γ is φ^(4γ),
smooth enough for formulas of fourth order. With the load per φ, w = p (3/2) sin³φ = Σ c_k cos kφ,
the integrals of the surface displacement are

    ∫ p ln|ξ-t| dt = const - π Σ_{k>=1} (c_k/k) cos kφ + ∫ w(φ') ln(3 - c² - c c' - c'²) dφ',
    ∫_ξ^1 p dt     = c_0 φ + Σ_{k>=1} (c_k/k) sin kφ,

the last kernel that of (ξ-t)/(c-c'), smooth inside and left to the trapezoidal rule. Both are
matrices that no grid spacing or contact width changes. The edges themselves are nodes, where p = 0:
a pressure without bound there would not hold the equations at the nodes beside.
Sources: the series are those of Mason & Handscomb (2003), Chebyshev Polynomials, section 9.5;
crowding for weak singularities at the ends is that of Kress (1990), Numer. Math. 58, 145.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from isochrome.contact.surface import Floats

_BACK, _AHEAD = 3, 1
"""Neighbours in the derivative along φ, towards the nearer edge and away from it: fourth order, and
since the surface enters at the edges, upwind: central differences ring near them."""
_POWERS = ((2.0, 5.0), (2.0, 4.0, 6.0), (2.0, 4.0, 5.0, 6.0))
"""Powers of φ of which the derivative is exact at the first nodes: depth goes as φ² before its edge
has moved, and as φ⁴ to φ⁶ after."""


@dataclass(frozen=True)
class Mesh:
    """Matrices of a mesh of n intervals on -1..1, for values at its n-1 inner nodes.

    `xi` (n+1,): all nodes, from the right edge to the left; `logarithm` (n+1, n-1):
    -(1/π) ∫ p ln|ξ-t| dt up to a constant; `ahead` (n+1, n-1): ∫_ξ^1 p dt; `total` (n-1,): ∫ p dt;
    `slope` (n-1, n-1): derivative along ξ of what vanishes at both ends.
    """

    xi: Floats
    logarithm: Floats = field(repr=False)
    ahead: Floats = field(repr=False)
    total: Floats = field(repr=False)
    slope: Floats = field(repr=False)


def angles(intervals: int) -> Floats:
    """φ of a mesh's nodes (n+1,), from 0 to π."""
    return np.linspace(0.0, np.pi, intervals + 1)


def angle_of(xi: Floats) -> Floats:
    """φ of places ξ, those beyond the edges at them: with c = 2 sin α, ξ = sin 3α."""
    cosine = 2.0 * np.sin(np.arcsin(np.clip(xi, -1.0, 1.0)) / 3.0)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def crowding(phi: Floats) -> Floats:
    """-dξ/dφ = (3/2) sin³φ."""
    return np.asarray(1.5 * np.sin(phi) ** 3)


@lru_cache(maxsize=4)
def make_mesh(intervals: int) -> Mesh:
    """The matrices of a mesh, which depend on the count of its intervals alone.

    Parameters: `intervals`, n >= 8. Returns the Mesh.
    """
    n = intervals
    phi, k = angles(n), np.arange(1, n + 1)
    inner, c = phi[1:-1], np.cos(phi)
    weight = crowding(inner)
    mean = weight / n  # c_0 of w
    share = np.r_[np.full(n - 1, 2.0 / n), 1.0 / n] / k
    terms = share[:, None] * np.cos(np.outer(k, inner)) * weight  # c_k/k
    ratio = 3.0 - c[:, None] ** 2 - np.outer(c, c[1:-1]) - c[1:-1] ** 2
    return Mesh(
        xi=0.5 * c * (3.0 - c * c),
        logarithm=np.cos(np.outer(phi, k)) @ terms - np.log(ratio) * mean,
        ahead=np.outer(phi, mean) + np.sin(np.outer(phi, k)) @ terms,
        total=np.pi * mean,
        slope=_slope(n) / -weight[:, None],
    )


def _slope(n: int) -> Floats:
    """Differences along φ for a function that is even about both ends and zero there.

    Low order and local on purpose: the depth grows as a broken power of the distance from an edge,
    and a derivative by the whole series would send the error of that all over the contact.
    """
    offsets = np.arange(-_BACK, _AHEAD + 1.0)
    stencil = _exact_slope(offsets, np.arange(float(len(offsets))), np.eye(len(offsets))[1])
    half = np.zeros((n + 1, n + 1))
    rows = np.arange(1, n // 2 + 1)
    for offset, value in zip(offsets.astype(int), stencil, strict=True):
        np.add.at(half, (rows, np.abs(rows + offset)), value)
    for row, some in enumerate(_POWERS, start=1):
        powers, count = np.array(some), len(some)
        half[row] = 0.0
        half[row, 1 : count + 1] = _exact_slope(
            np.arange(1.0, count + 1.0), powers, powers * float(row) ** (powers - 1.0)
        )
    matrix = half - half[::-1, ::-1]
    if n % 2 == 0:
        matrix[n // 2] *= 0.5  # the middle has both neighbourhoods
    return n / np.pi * matrix[1:-1, 1:-1]


def _exact_slope(nodes: Floats, powers: Floats, slopes: Floats) -> Floats:
    """Weights of values at nodes for which each power has its slope."""
    return np.asarray(np.linalg.solve(nodes ** powers[:, None], slopes))
