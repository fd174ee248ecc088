"""The load that wore a contact before the first frame of its track, as that frame shows it.

A load that swings shows one of its values. The scar's ends are where the larger ones have been, and
where its own load does not reach, or reaches beyond, the frame tells which one wore it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.frame_model import LocalModel, project

_TIMES = 4
_FIRST, _FAR = 0.01, 0.3
"""First step, and the largest, over the load that it starts from."""
_RESTS = 0.2
"""Step below which the search rests, in standard uncertainties of the load before."""


def fit_past_load(
    change: Callable[[float], Array], local: LocalModel, residual: Array, start_n: float
) -> float:
    """The load before the first frame that leaves the least residual, by secants.

    Equation: min over P and dv of |r - c(P) - J dv|², with c' by two loads.
    Parameters: `change`, from a load P (N) to what it adds to the frame over its noise (n,), none
    at `start_n`; `local`, the model about the frame's values, with its derivatives J; `residual` r
    (n,) there; `start_n`, the load (N) that has worn it. Returns P, within 30 % of that. Source:
    the elimination of dv as in `LocalModel.step`.
    """
    last, before = start_n, np.zeros_like(residual)
    past = start_n * (1.0 + _FIRST)
    for _ in range(_TIMES):
        added = change(past)
        slope = (added - before) / np.float32(past - last)
        project(slope[None], local.toned.problem, local.toned.part)
        alone = slope - local.step(slope).astype(slope.dtype) @ local.rows
        told = float(alone @ alone)
        if not told > 0.0:
            return start_n
        last, before = past, added
        step = float(alone @ (residual - added)) / told
        past = float(np.clip(past + step, (1.0 - _FAR) * start_n, (1.0 + _FAR) * start_n))
        if abs(past - last) < _RESTS / np.sqrt(told):
            break
    return past
