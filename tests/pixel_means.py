"""The mean of sin²(pi N) over pixels, by Gauss points: what our pixels are held against."""

import numpy as np


def gauss_mean(order_at, x, z, pixel):
    """The mean of sin²(pi N) over each pixel (rows, cols), `pixel` wide, by 6 x 6 Gauss points, to
    1e-8; `order_at`(x, z), centres `x` (cols,) and `z` (rows,)."""
    nodes, weights = np.polynomial.legendre.leggauss(6)
    total = np.zeros((len(z), len(x)))
    for u, wu in zip(0.5 * pixel * nodes, 0.5 * weights, strict=True):
        for v, wv in zip(0.5 * pixel * nodes, 0.5 * weights, strict=True):
            total += wu * wv * np.sin(np.pi * order_at(x[None, :] + u, z[:, None] + v)) ** 2
    return total
