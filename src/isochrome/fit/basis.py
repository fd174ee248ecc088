"""Smooth maps over a frame, as stacks of basis images for the linear part of a fit."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import InputError

Array = NDArray[np.float64]


def polynomial_basis(
    shape: tuple[int, int],
    degree: int,
    *,
    times: ArrayLike | None = None,
    dtype: type[np.floating] = np.float64,
) -> Array:
    """Legendre products P_i(y) P_j(x), i + j <= degree, with x and y in -1..1 over the frame.

    Parameters: `shape`, the frame's (rows, cols); `degree`, the total degree, 0 for a constant;
    `times`, an optional image (rows, cols) that multiplies every member, such as the no-load
    bright frame minus the no-load dark one; `dtype` of the result without that.
    Returns the stack (k, rows, cols), k = (degree + 1)(degree + 2)/2, the constant first.
    Raises InputError for a negative degree or an image of another shape.
    """
    if degree < 0:
        raise InputError(f"degree = {degree} is not allowed: a polynomial's is 0 or more; raise it")
    rows, cols = (np.polynomial.legendre.legvander(_unit(n), degree).T.astype(dtype) for n in shape)
    pairs = [(t - j, j) for t in range(degree + 1) for j in range(t + 1)]
    stack = np.empty((len(pairs), *shape), dtype)
    for member, (i, j) in zip(stack, pairs, strict=True):
        np.multiply(rows[i][:, None], cols[j][None, :], out=member)
    if times is None:
        return stack
    image = np.asarray(times, dtype=float)
    if image.shape != tuple(shape):
        raise InputError(
            f"times has the shape {image.shape} and the frame {tuple(shape)}; give one pixel grid"
        )
    return stack * image


def stride_mask(mask: NDArray[np.bool_], pixels: int) -> NDArray[np.bool_]:
    """Thin a mask to about `pixels` pixels by one stride along rows and columns.

    Parameters: `mask` (rows, cols), True = valid; `pixels`, how many to keep at least.
    Returns a mask of the same shape; the same one where it holds no more pixels than that.
    """
    step = max(1, int(np.sqrt(np.count_nonzero(mask) / max(1, pixels))))
    if step == 1:
        return mask
    thin = np.zeros_like(mask)
    thin[step // 2 :: step, step // 2 :: step] = mask[step // 2 :: step, step // 2 :: step]
    return thin


def _unit(count: int) -> Array:
    return np.linspace(-1.0, 1.0, count) if count > 1 else np.zeros(1)
