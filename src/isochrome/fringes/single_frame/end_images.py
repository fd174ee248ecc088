"""Smooth images that the light of a frame is a sum of, where no model says what is seen in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_DEGREE = 2
"""Of the products: lamps fall off to the corners."""
QUADRATICS = (_DEGREE + 1) * (_DEGREE + 2) // 2
"""How many products there are, which come first."""


@dataclass(frozen=True)
class SmoothImages:
    """Images f_k(row) g_k(col) over a frame, and how large each may be beforehand.

    Parameters
    ----------
    down : ndarray (rows, terms)
        The factors f_k.
    across : ndarray (cols, terms)
        The factors g_k.
    spread : ndarray (terms,)
        Prior standard deviation of each image's coefficient, over the contrast, inf for the even
        light.
    """

    down: Array
    across: Array
    spread: Array

    @property
    def images(self) -> Array:
        """All of them (rows, cols, terms)."""
        return np.asarray(self.down[:, None, :] * self.across[None, :, :])

    def sum(self, coefficients: Array) -> Array:
        """Their sum with some coefficients (terms,): (rows, cols)."""
        return np.asarray((self.down * coefficients) @ self.across.T)


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

    Equation: the products of powers of the place up to the second; with `spots` the cosines besides
    that stand for a Gaussian process of covariance exp(-d²/2l²), the variance of each by the
    process' spectral density (Solin & Sarkka (2020), Stat. Comput. 30, 419).

    Parameters
    ----------
    shape : tuple of int
        Rows and columns of the whole frame, over which the place runs from -1 to 1.
    by : int
        Pixels a bin.
    uneven : float, default 0.1
        Prior deviation of each product but the even one, over the contrast.
    spots : float, default 0
        Prior deviation of spots and bars together, over the contrast; 0 for none.

    Returns
    -------
    SmoothImages
        The products at the bins' middles.
    """
    y, x = (2.0 * (by * np.arange(n // by) + 0.5 * (by - 1)) / max(n - 1, 1) - 1.0 for n in shape)
    powers = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
    down, across = ([v ** p[k] for p in powers] for k, v in enumerate((y, x)))
    spread = [np.inf, *[uneven] * (len(powers) - 1)]
    if spots:
        waves = _waves()
        total = np.sqrt(sum(size**2 for _, _, size in waves))
        for i, j, size in waves:
            down.append(_cosine(i, y))
            across.append(_cosine(j, x))
            spread.append(spots * size / total)
    return SmoothImages(np.stack(down, axis=-1), np.stack(across, axis=-1), np.array(spread))


def _cosine(i: int, place: Array) -> Array:
    return np.asarray(
        (np.sqrt(2.0) if i else 1.0) * np.cos(0.5 * np.pi * i * (place / _BEYOND + 1.0))
    )


def _waves() -> list[tuple[int, int, float]]:
    """Half-waves down and across, and the root of the process' spectral density at each."""
    unit, most = 0.5 * np.pi / _BEYOND, 32
    found = []
    for i in range(most):
        for j in range(most):
            size = float(np.exp(-0.25 * unit**2 * (i * i + j * j) * _SPOT_SIZE**2))
            if size > _FAINTEST and i + j:
                found.append((i, j, size))
    return found
