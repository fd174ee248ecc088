r"""How smooth tractions are asked to be: no smoother than the frame's noise allows for.

The regularisation is s ∫ p''² + q''² dx. Weak enough, it changes nothing, and the tractions follow
the noise; the discrepancy principle raises s until the residual has grown by what the true
tractions would leave more than the best fitting ones, one unit of chi² for each unknown.
Source: Morozov (1984), Methods for Solving Incorrectly Posed Problems, section 8.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.tractions_basis import Basis
from isochrome.fit.tractions_solve import Solution, with_signs

Array = NDArray[Any]

_HALVINGS = 24


def smoothness(basis: Basis, pixel_mm: float) -> Array:
    """K of c^T K c = ∫ p''² + q''² dx over runs of neighbouring nodes (m, m), (MPa/mm²)² mm.

    Nothing is asked at the ends of a run: the pressure of a contact leaves its edge steeply.
    Parameters: `basis`; `pixel_mm`. Returns K (m, m), zero for the regular modes.
    """
    h, n, m = basis.spacing_px * pixel_mm, basis.nodes, basis.limit
    next_to = np.diff(basis.nodes_px) == basis.spacing_px
    middle = np.flatnonzero(next_to[1:] & next_to[:-1]) + 1
    second = np.zeros((len(middle), n))
    for k, weight in ((-1, 1.0), (0, -2.0), (1, 1.0)):
        second[np.arange(len(middle)), middle + k] = weight
    square = second.T @ second / h**3
    whole = np.zeros((basis.columns.shape[1],) * 2)
    same, other = (1.0 + m**2) * square, (1.0 - m**2) * square
    whole[: 2 * n, : 2 * n] = np.block([[same, other], [other, same]])
    return whole


def discrepancy_strength(solution: Solution, smooth: Array, signed: int) -> float:
    """The strength s at which the misfit has grown by chi² for each unknown off its bound.

    The misfit is followed by its quadratic model about a solution with weak regularisation.
    Parameters: `solution`; `smooth` K for s = 1; `signed`, how many unknowns are >= 0. Returns s.
    Source: see the module.
    """
    c, gram, slope = solution.unknowns, solution.gram, solution.slope
    free = np.count_nonzero(c[:signed] > 0.0) + len(c) - signed
    allowed = free * solution.chi**2
    # what is no smoothness, such as what holds the surface's place, stays as it is
    kept = solution.smooth * (np.diag(smooth) == 0.0)

    def grown(s: float) -> float:
        new = with_signs(gram + kept + s * smooth, gram @ c + slope, signed)
        step = new - c
        return float(step @ gram @ step - 2.0 * slope @ step)

    unit = np.trace(gram) / np.trace(smooth)
    low, high = np.log(1e-9 * unit), np.log(1e6 * unit)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if grown(np.exp(middle)) < allowed else (low, middle)
    return float(np.exp(low))
