r"""A mesh that moves with the contact's edges: integrals and derivatives in closed form.

Nodes ξ = cos θ on the contact, θ equally spaced, its edges included. The pressure is carried as
p sin θ = Σ c_k cos kθ, for which the two singular integrals of the surface displacement are known
term by term,

    ∫ p ln|ξ-t| dt = const - π Σ_{k>=1} (c_k/k) cos kθ,
    ∫_ξ^1 p dt     = c_0 θ + Σ_{k>=1} (c_k/k) sin kθ,

so that both are matrices that no grid spacing or contact width changes. p sin θ = 0 at both ends is
the condition of a smooth edge. Nodes crowd as θ² at the edges, where p is steepest.
Source: the series are those of Mason & Handscomb (2003), Chebyshev Polynomials, section 9.5.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from isochrome.contact.surface import Floats

_REACH = 2
"""Neighbours on each side in the derivative along θ: fourth order, and no wave from an edge."""


@dataclass(frozen=True)
class Mesh:
    """Matrices of a mesh of n intervals on -1..1, for values at its n-1 inner nodes.

    `theta`, `xi` (n+1,): all nodes, from the right edge to the left; `logarithm` (n+1, n-1):
    Σ (c_k/k) cos kθ; `ahead` (n+1, n-1): ∫_ξ^1 p dt; `total` (n-1,): ∫ p dt; `slope` (n-1, n-1):
    derivative along ξ of what vanishes at both ends.
    """

    theta: Floats
    xi: Floats
    logarithm: Floats = field(repr=False)
    ahead: Floats = field(repr=False)
    total: Floats = field(repr=False)
    slope: Floats = field(repr=False)


@lru_cache(maxsize=4)
def make_mesh(intervals: int) -> Mesh:
    """The matrices of a mesh, which depend on the count of its intervals alone.

    Parameters: `intervals`, n >= 8. Returns the Mesh.
    """
    n = intervals
    theta = np.pi * np.arange(n + 1) / n
    k = np.arange(1, n + 1)
    inner = theta[1:-1]
    weight = np.r_[np.full(n - 1, 2.0 / n), 1.0 / n]
    mean = np.sin(inner) / n  # c_0 of p sin θ
    terms = (weight / k)[:, None] * np.cos(np.outer(k, inner)) * np.sin(inner)  # c_k/k
    return Mesh(
        theta=theta,
        xi=np.cos(theta),
        logarithm=np.cos(np.outer(theta, k)) @ terms,
        ahead=np.outer(theta, mean) + np.sin(np.outer(theta, k)) @ terms,
        total=np.pi * mean,
        slope=_slope(n) / -np.sin(inner)[:, None],
    )


def _slope(n: int) -> Floats:
    """Central differences along θ for a function that is even about both ends and zero there.

    Low order and local on purpose: the depth grows as a broken power of the distance from an edge,
    and a derivative by the whole series would send the error of that all over the contact.
    """
    offsets = np.arange(-_REACH, _REACH + 1)
    powers = offsets[None, :].astype(float) ** np.arange(2 * _REACH + 1)[:, None]
    stencil = np.linalg.solve(powers, np.eye(2 * _REACH + 1)[1]) * n / np.pi
    matrix = np.zeros((n + 1, n + 1))
    rows = np.arange(1, n)
    for offset, value in zip(offsets, stencil, strict=True):
        at = np.abs(rows + offset)
        np.add.at(matrix, (rows, np.where(at > n, 2 * n - at, at)), value)
    return matrix[1:-1, 1:-1]
