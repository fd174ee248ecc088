"""What acts on the specimen's surface in one state of a contact."""

from dataclasses import dataclass

import numpy as np

from isochrome.contact.pressure import Floats
from isochrome.contact.profile import ContactGrid


@dataclass(frozen=True, kw_only=True)
class SurfaceState:
    """What acts on the specimen's surface in one state.

    Parameters
    ----------
    grid : ContactGrid
        The nodes, with `x_mm` (n,).
    pressure_mpa : ndarray, shape (n,)
        Pressure p, MPa.
    shear_mpa : ndarray, shape (n,)
        Shear traction q along +x, MPa.
    wear_depth_mm : ndarray, shape (n,)
        Worn depth h, mm.
    distance_m : float
        Distance slid, m.
    friction : float
        Friction coefficient mu.
    sliding : bool
        False in a static state.
    residual : float
        Residual of the contact's complementarity.
    scar_edges_mm : tuple of float, optional
        The edges of contact, mm, where a mesh knew them better than the grid.
    """

    grid: ContactGrid
    pressure_mpa: Floats
    shear_mpa: Floats
    wear_depth_mm: Floats
    distance_m: float
    friction: float
    sliding: bool
    residual: float
    scar_edges_mm: tuple[float, float] | None = None

    @property
    def p_max_mpa(self) -> float:
        """Largest nodal pressure (MPa)."""
        return float(self.pressure_mpa.max())

    @property
    def edges_mm(self) -> tuple[float, float]:
        """Outermost places where the pressure reaches zero (mm).

        Near an edge p² is linear in x (p ~ the root of the distance), so p² of the last two nodes
        in contact is carried on to zero, by one spacing at most: second order in the spacing.
        """
        if self.scar_edges_mm is not None:
            return self.scar_edges_mm
        p2, h = self.pressure_mpa**2, self.grid.spacing_mm
        inside = np.flatnonzero(p2 > 0.0)
        first, last = int(inside[0]), int(inside[-1])
        left_mm = self.grid.x_mm[first] - h * _carried(p2[first], p2[min(first + 1, last)])
        right = self.grid.x_mm[last] + h * _carried(p2[last], p2[max(last - 1, first)])
        return float(left_mm), float(right)

    @property
    def contact_width_mm(self) -> float:
        """Distance between the outermost edges of contact (mm)."""
        left_mm, right = self.edges_mm
        return right - left_mm

    @property
    def line_load_n_per_mm(self) -> float:
        """Normal load per thickness that the pressure carries, ∫p dx (N/mm)."""
        return float(self.pressure_mpa.sum() * self.grid.spacing_mm)

    @property
    def worn_area_mm2(self) -> float:
        """Area of the worn cross-section, ∫h dx (mm²)."""
        return float(self.wear_depth_mm.sum() * self.grid.spacing_mm)


def _carried(outer: float, inner: float) -> float:
    """Fraction of a spacing beyond the outer node at which a straight line reaches zero."""
    return min(1.0, outer / (inner - outer)) if inner > outer else 1.0
