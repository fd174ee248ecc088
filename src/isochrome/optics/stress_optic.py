"""The stress-optic law: principal stress difference to fringe order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from isochrome.stress import StressDifference


def fringe_order(
    difference_mpa: StressDifference, *, thickness_mm: float, fringe_value_n_per_mm: float
) -> NDArray[np.floating]:
    """Fringe order N (rows, cols) of the stress difference (sigma_x - sigma_z) + 2i tau_xz, MPa.

    N = (sigma_1 - sigma_2) d / f_sigma, f_sigma in N/mm per fringe; the retardation is 2 pi N.
    Source: Dally & Riley (1991), Experimental Stress Analysis, section 12.2.
    """
    order = np.asarray(np.abs(difference_mpa))
    order *= thickness_mm / fringe_value_n_per_mm
    return order
