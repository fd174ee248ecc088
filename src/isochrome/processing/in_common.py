"""What the frames of a set say together of each one's uncertainties: one camera, one worn block."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import chdtri

from isochrome.fitting import EARLIER, FRICTION
from isochrome.output import numbers
from isochrome.processing.result import CAUSES, SEPARATOR, SPREAD, causes_of
from isochrome.scene import Scene

_GAMMA = "gamma"
"""Column of frames.csv of what each frame's own fringes say, without a model."""

_CHANCE = 0.01
"""Probability with which gammas of one camera may scatter so far by their uncertainties alone."""

_OF_THE_PAST = 0.015
"""Shift of a frame's friction for each unit by which the friction was another before it. Of the
paper's contact it is -0.002 to 0.012 at 31 to 233 m, at three times its wear 0.014."""


def with_scatter_of_gamma(table: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """Widen the uncertainty of gammas that scatter by more: one camera has one gamma.

    Where chi² = sum ((g - mean)/u)² of n frames is what a chance of 1 % exceeds, of n - 1 degrees
    of freedom, u becomes the scatter, if that is larger; the frames' warnings say so. Once widened,
    a table stays as it is.
    Parameters: `table`, the columns of frames.csv. Returns the columns.
    Source: Birge (1932), Phys. Rev. 40, 207, for the test of consistency.
    """
    name = f"{_GAMMA} {SPREAD}"
    if _GAMMA not in table:
        return table
    value, spread = numbers(table[_GAMMA]), numbers(table[name])
    told = np.flatnonzero(np.isfinite(value) & (spread > 0.0))
    if len(told) < 2:
        return table
    own, weight = value[told], spread[told] ** -2.0
    mean = float(np.average(own, weights=weight))
    if np.sum(weight * (own - mean) ** 2) <= chdtri(len(told) - 1, _CHANCE):
        return table
    scatter = float(np.std(own, ddof=1))
    least, largest = (int(told[k]) for k in (np.argmin(own), np.argmax(own)))
    text = (
        f"gamma scatters between the frames of one camera by more than each frame's own "
        f"uncertainty: from {value[least]:.3f} (frame {table['frame'][least]}) to "
        f"{value[largest]:.3f} (frame {table['frame'][largest]}); its standard uncertainty is "
        f"widened to that scatter, {scatter:.2g}, and the orders' is not: measure gamma, and state "
        "it as frames.gamma"
    )
    wider, messages = list(table[name]), list(table["warnings"])
    for k in told:
        wider[k] = max(wider[k], scatter)
        messages[k] = SEPARATOR.join(filter(None, (messages[k], text)))
    return table | {name: wider, "warnings": messages}


def with_past_friction(table: dict[str, list[Any]], scene: Scene) -> dict[str, list[Any]]:
    """Widen the uncertainty of frictions that were others before, while the block wore.

    Each frame is explained by a block that has worn under that frame's own friction. Friction
    shifts the pressure along the surface, and so the scar remembers what it was. By the other
    frames' frictions the mean over the distance slid is known: of a frame that differs from it, u
    becomes the shift, if that is larger. A frame that shows its past friction has it among its
    causes, and stays as it is. Once widened, a table stays as it is.

    Parameters
    ----------
    table : dict of str to list
        The columns of frames.csv.
    scene : Scene
        The set's scene.

    Returns
    -------
    dict of str to list
        The columns; the same object where nothing is wider.
    """
    name = f"{FRICTION} {SPREAD}"
    if scene.wear is None or name not in table:
        return table
    distance = numbers(table["distance_m"])
    value, spread = numbers(table[FRICTION]), numbers(table[name])
    known = np.flatnonzero(np.isfinite(distance) & np.isfinite(value) & np.isfinite(spread))
    order = known[np.argsort(distance[known], kind="stable")]
    slid, own = distance[order], value[order]
    area = np.concatenate(([0.0], np.cumsum(0.5 * (own[1:] + own[:-1]) * np.diff(slid))))
    away = slid - slid[:1]
    past = np.divide(area[: len(own)], away, out=own.copy(), where=away > 0.0)
    wider = list(table[name])
    causes = table.get(CAUSES) or [""] * len(wider)
    for k, shift in zip(order, _OF_THE_PAST * np.abs(own - past), strict=True):
        if EARLIER not in causes_of(causes[k] or ""):
            wider[k] = max(wider[k], float(shift))
    return table if wider == table[name] else table | {name: wider}
