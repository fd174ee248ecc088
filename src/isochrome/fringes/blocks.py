"""Means over square blocks of pixels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def block_means(values: Array, by: int) -> Array:
    """Means over blocks of by x by pixels; a rim narrower than a block is left out.

    Parameters: `values` (rows, cols, ...); `by`, pixels a side. Returns (rows // by, cols // by,
    ...).
    """
    rows, cols = (n // by for n in values.shape[:2])
    cut = values[: rows * by, : cols * by]
    return np.asarray(cut.reshape(rows, by, cols, by, *values.shape[2:]).mean(axis=(1, 3)))
