"""What images without load say of the order that stays: its square, and so its size but no sign.

Near N = 0 the intensity goes with N^2, so that a squared order q = r^2 at the edge is what such an
image measures with a normal uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isochrome.calibrate.line import Line

CERTAIN = 5.0
"""Standard uncertainties beyond which an unloaded image contradicts the loads' line."""

NOTICED = 0.05
"""Fringes at the least that such a contradiction is worth a sentence."""


@dataclass(frozen=True)
class Rest:
    """An unloaded image: squared order at the edge (fringe^2) and its standard uncertainty."""

    file: str
    square: float
    uncertainty: float


def largest_order(rest: Sequence[Rest]) -> float:
    """Root mean square of the order r that may be there at no load, in fringes.

    <r^2> under the density exp(-sum (r^2 - q_i)^2 / (2 u_i^2)) with r itself equally likely
    everywhere before, as its sign is not seen. Parameters: `rest`, the unloaded images, at least
    one.
    """
    reach = np.sqrt(max(max(i.square, 0.0) + 8.0 * i.uncertainty for i in rest))
    r = np.linspace(0.0, reach, 4001)
    log = -0.5 * np.sum([((r**2 - i.square) / i.uncertainty) ** 2 for i in rest], axis=0)
    weight = np.exp(log - log.max())
    return float(np.sqrt(np.sum(weight * r**2) / np.sum(weight)))


def sayings(rest: Sequence[Rest], line: Line, load_n: float) -> tuple[str, ...]:
    """Where an unloaded image contradicts the order that the loads' line leaves at zero load.

    Parameters: `rest`; `line`, through the loaded images; `load_n`, the largest load.
    Returns the sentences, none where all agree.
    """
    if line.intercept is None or line.intercept_uncertainty is None:
        return ()
    said = []
    r, u = line.intercept, line.intercept_uncertainty
    for item in rest:
        seen = float(np.sqrt(max(item.square, 0.0)))
        spread = np.sqrt(item.uncertainty**2 + (2.0 * r * u) ** 2 + 2.0 * u**4)
        if abs(r**2 - item.square) > CERTAIN * spread and abs(abs(r) - seen) > NOTICED:
            said.append(
                f"{item.file} shows an order of {seen:.3f} at no load and the loads' line leaves "
                f"{r:.3f}: the loads are off by {r / line.slope:.3g} N of {load_n:g} N (an offset "
                "of the load cell), or one load is wrong; check them"
            )
    return tuple(said)
