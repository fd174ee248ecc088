r"""Score tests: what a fit would gain by unknowns that it has not, without a new fit.

At the fit the weighted residual r is normal to all fitted unknowns' derivatives A. Others with
derivatives D would lower r·r, to first order, by

    S = gᵀ M⁻¹ g,    g = D⊥ᵀ r,    M = D⊥ᵀ D⊥,

D⊥ the part of D that A cannot take up, and would come out at M⁻¹ g. Without them S/σ² is χ² of
as many degrees of freedom as D has columns. All of it follows from one matrix of products.
Source: Rao (1948), Proc. Camb. Phil. Soc. 44, 50-57.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

ASKED = 2.5
"""What a cause must gain over ln n for each of its unknowns (Schwarz's criterion): of twelve causes
one is found by chance in 200 frames. More would leave what moves the load by many of its standard
uncertainties, where the two are alike."""

FIRST_DEGREES = 6, 4
"""Degrees of illumination and background that every light is asked for."""

RICHEST = 24, 8
"""Degrees of illumination and background up to which light is made richer, product by product."""

FEW_TERMS, MOST_TERMS = 12, 120
"""Products by which light is made richer: beside other causes, since a hundred take up what a roll
does, and once some have explained much."""

_TAKEN = 1e-6
"""Part of a column's square that must be left by what is fitted."""


class ScoreProducts:
    """Products of columns with each other and the residual, what is fitted taken off.

    Of parts (own, fitted, columns, residual) of the data, all over the noise: derivatives (q, n) by
    what is fitted to this part alone, such as a frame's light, (p, n) by what is fitted to all, (k,
    n) by what is not, and the residual (n,). p and k are the same in all parts.
    """

    def __init__(self, parts: Iterable[tuple[Array, Array, Array, Array]]) -> None:
        gram, size, count, fitted, shared = np.zeros((1, 1)), np.zeros(1), 0, 0, 0
        for own, rows, columns, residual in parts:
            stacked = np.concatenate((own, rows, columns, residual[None])).astype(np.float32)
            products = (stacked @ stacked.T).astype(float)
            shared = len(rows)
            size = size + np.diag(products)[len(own) + shared : -1]
            gram = gram + _taken_off(products, len(own))
            count, fitted = count + stacked.shape[1], fitted + len(own)
        self.size = size
        self._taken_up = _explained(gram, shared)[:, :-1]
        rest = _taken_off(gram, shared)
        self.count = count
        self.matrix, self.right, left = rest[:-1, :-1], rest[:-1, -1], rest[-1, -1]
        self.noise = max(1.0, float(left) / max(1, count - fitted - shared))

    def score(self, chosen: slice | list[int]) -> tuple[float, int, Array]:
        """What some columns gain together: S over the noise, the number of them not taken up by
        what is fitted, and the values (k,) that they would come out at, to first order.
        """
        right, matrix = self.right[chosen], self.matrix[chosen][:, chosen]
        own = np.diag(matrix) > _TAKEN * self.size[chosen]
        if not own.any():
            return 0.0, len(right), np.zeros(len(right))
        scale = np.where(own, 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300)), 0.0)
        inverse = np.linalg.pinv(matrix * np.outer(scale, scale), 1e-8, hermitian=True)
        values = scale * (inverse @ (scale * right))
        return float(values @ right) / self.noise, int(own.sum()), values

    def shift(self, chosen: slice | list[int], values: Array) -> Array:
        """How far (p,) what is fitted to all parts would move, to first order, if columns had such
        values.
        """
        return np.asarray(-self._taken_up[:, chosen] @ values)

    def score_with_prior(self, chosen: slice, weight: Array) -> tuple[float, float, Array]:
        """What columns gain whose values are known beforehand, over the noise, its price, values.

        With U² the prior's variances, 1/`weight`, the gain is gᵀ (M + U⁻²)⁻¹ g, and what Bayes's
        factor takes off for the values that might have been, ln det(1 + U M U). Values (k,) are to
        first order.
        """
        right, matrix = self.right[chosen] / self.noise, self.matrix[chosen][:, chosen] / self.noise
        scale = weight**-0.5
        full = np.eye(len(right)) + scale[:, None] * matrix * scale
        values = scale * np.linalg.solve(full, scale * right)
        return float(values @ right), float(np.linalg.slogdet(full)[1]), values

    def one_by_one(self, most: int) -> list[int]:
        """The columns that are asked for, each the one with the most evidence beside those before.

        They are taken as fitted from then on.
        """
        least = np.log(self.count) + ASKED
        chosen: list[int] = []
        while len(chosen) < most:
            size = np.diag(self.matrix)
            free = size > _TAKEN * self.size
            gains = np.where(free, self.right**2 / np.where(free, size, 1.0), 0.0) / self.noise
            best = int(gains.argmax())
            if gains[best] < least:
                break
            self.take(best)
            chosen.append(best)
        return chosen

    def take(self, index: int) -> None:
        """Fit one column more."""
        row, value = self.matrix[index].copy(), self.right[index]
        size = row[index]
        self.matrix -= np.outer(row, row) / size
        self.right -= row * (value / size)


def _taken_off(gram: Array, fitted: int) -> Array:
    """Products (k, k) of columns, less what the `fitted` first ones of (fitted + k) explain."""
    cross = gram[:fitted, fitted:]
    return np.asarray(gram[fitted:, fitted:] - cross.T @ _explained(gram, fitted))


def _explained(gram: Array, fitted: int) -> Array:
    """What the `fitted` first columns of (fitted + k) come out at for each of the others."""
    taken, cross = gram[:fitted, :fitted], gram[:fitted, fitted:]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(taken), 1e-300))
    inverse = np.linalg.pinv(taken * np.outer(scale, scale), 1e-10, hermitian=True)
    return np.asarray((inverse * np.outer(scale, scale)) @ cross)
