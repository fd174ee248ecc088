"""Values of many frames with their uncertainties, whoever found them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameValues:
    """Fitted values of n frames.

    Parameters
    ----------
    keys : tuple of str
        The scene's keys that were fitted.
    values : ndarray, shape (n, keys)
        Their values, each in the unit of its key; NaN = not known.
    standard_uncertainty : ndarray, shape (n, keys)
        Their standard uncertainties, NaN = not known.
    chi : ndarray, shape (n,)
        Residual over noise of each frame.
    distance_m : ndarray, shape (n,)
        Distance slid, m; NaN where nothing slides.
    searched : ndarray of bool, shape (n,)
        Frames of a tracked video that a full search had to find.
    whole : ndarray of bool, shape (n,)
        Key frames of a tracked video.
    """

    keys: tuple[str, ...]
    values: NDArray[np.float64]
    standard_uncertainty: NDArray[np.float64]
    chi: NDArray[np.float64]
    distance_m: NDArray[np.float64]
    searched: NDArray[np.bool_]
    whole: NDArray[np.bool_]

    def summary(self) -> dict[str, list[Any]]:
        """For each key its mean, least and most value, and the median standard uncertainty.

        Column name to values, None where none is known.
        """
        columns = [c[np.isfinite(c)] for c in self.values.T]
        known = [u[np.isfinite(u)] for u in self.standard_uncertainty.T]
        return {
            "key": list(self.keys),
            "mean": [float(c.mean()) if c.size else None for c in columns],
            "least": [float(c.min()) if c.size else None for c in columns],
            "most": [float(c.max()) if c.size else None for c in columns],
            "standard_uncertainty": [float(np.median(u)) if u.size else None for u in known],
        }
