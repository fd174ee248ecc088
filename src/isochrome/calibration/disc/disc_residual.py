"""Residual stress in a disc: the forms it is looked for in, and the order it makes with the load.

Stress adds as a tensor. With D = (sx - sz) + 2i txz in fringes, the loads' part is
D_P = N (1 - rho^2)/(s^2 + 1)^2, s = x - iz in radii with z along the loads (Frocht 1948; see
`reference.brazilian_disc`), and the order is |D_P + D_0| with one residual field D_0 for all loads.
An axisymmetric residual has D_0 = s(r) e^(2 i phi), s = sigma_r - sigma_theta, which vanishes at
the centre: s = c2 r^2 + c4 r^4. Moulding, cutting and annealing leave this one, and a uniform part.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True)
class ResidualForm:
    """A form of the residual: its `name`, whether it lies `along` the loads' own principal
    directions (a real field) or is a tensor of its own, its polynomial `degree`, and whether it
    is `round` (axisymmetric, with a uniform part).
    """

    name: str
    along: bool
    degree: int
    round: bool = False

    def basis(self, x: Array, z: Array) -> Complexes:
        """The members (k, ...) at places `x`, `z` in radii from the centre, the uniform first."""
        if self.degree < 0:
            return np.zeros((0, *x.shape), dtype=complex)
        if self.round:
            turned = (x + 1j * z) ** 2
            one = np.ones_like(turned)
            return np.stack([one, 1j * one, turned, turned * (x**2 + z**2)])
        powers = [(i, t - i) for t in range(self.degree + 1) for i in range(t + 1)]
        real = np.stack([x**i * z**j for i, j in powers]).astype(complex)
        return real if self.along else np.concatenate([real, 1j * real])

    @property
    def size(self) -> int:
        """How many members there are."""
        return len(self.basis(np.zeros(1), np.zeros(1)))

    def at_centre(self, coefficients: ArrayLike) -> complex:
        """The residual at the centre for the members' `coefficients` (k,), 0 without any."""
        values = np.asarray(coefficients, dtype=float)
        origin = np.zeros(1)
        return complex(values @ self.basis(origin, origin)[:, 0]) if values.size else 0j


NONE = ResidualForm("none", along=True, degree=-1)
FORMS = (
    ResidualForm("axisymmetric and uniform", along=False, degree=4, round=True),
    ResidualForm("along the loads' principal directions, degree 2", along=True, degree=2),
    ResidualForm("tensor, degree 2", along=False, degree=2),
    ResidualForm("along the loads' principal directions, degree 4", along=True, degree=4),
    ResidualForm("tensor, degree 4", along=False, degree=4),
)
"""What is tried, fewest unknowns first."""


def load_field(rows: Array, cols: Array, geometry: ArrayLike) -> tuple[Array, Complexes]:
    """The loads' field over its centre value: its size h and its direction, seen by the residual.

    Parameters: `rows`, `cols` (n,), px; `geometry`, row, column, radius (px) and angle (rad) as in
    `disc_field.disc_order`. Returns h (n,) and v (n,) such that the order is
    |N h + v D_0| for a residual D_0 in the image's axes.
    """
    row, col, radius, angle = np.asarray(geometry, dtype=float)
    x, z = (cols - col) / radius, (rows - row) / radius
    s = (x - 1j * z) * np.exp(-1j * angle)
    below = s**2 + 1.0
    size = np.square(np.abs(below)) + 1e-12
    h = (1.0 - x**2 - z**2) / size
    return h, below**2 / size * np.exp(2j * angle)
