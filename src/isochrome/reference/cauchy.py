"""What the closed forms share: the stress field they return, argument checks, Cauchy transforms.

A traction p(t) on the surface of a half-plane acts through its Cauchy transform
F(s) = ∫ p(t)/(s - t) dt, s = x + iz. All of them are evaluated in the closed upper half of the
s-plane (the body itself), where numpy's principal branches are the right ones down to z = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import InputError

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

SLACK = 1e-9
"""Share of a body's size by which a point on its edge may lie outside: rounding."""


@dataclass(frozen=True)
class StressComponents:
    """Plane stress components at a set of points, tension positive; x to the right, z downward.

    Parameters
    ----------
    sigma_x : ndarray, in the broadcast shape of the coordinates asked for
        Stress along x, MPa.
    sigma_z : ndarray, of the same shape
        Stress along z, MPa.
    tau_xz : ndarray, of the same shape
        Shear stress, MPa.
    """

    sigma_x: NDArray[np.floating]
    sigma_z: NDArray[np.floating]
    tau_xz: NDArray[np.floating]

    @property
    def difference(self) -> NDArray[np.complexfloating]:
        """(sigma_x - sigma_z) + 2i tau_xz."""
        return np.asarray((self.sigma_x - self.sigma_z) + 2j * self.tau_xz)

    @property
    def principal(self) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Principal stresses sigma_1 >= sigma_2 in the plane (MPa)."""
        mean, radius = 0.5 * (self.sigma_x + self.sigma_z), 0.5 * np.abs(self.difference)
        return mean + radius, mean - radius

    @property
    def principal_difference(self) -> NDArray[np.floating]:
        """Principal stress difference sigma1 - sigma2 >= 0 in the plane, MPa."""
        return np.asarray(np.hypot(self.sigma_x - self.sigma_z, 2.0 * self.tau_xz))

    @classmethod
    def from_invariants(
        cls, difference: NDArray[Any], trace: NDArray[np.floating]
    ) -> StressComponents:
        """Components from (sigma_x - sigma_z) + 2i tau_xz and sigma_x + sigma_z, of one shape."""
        sigma_x, sigma_z = 0.5 * (trace + difference.real), 0.5 * (trace - difference.real)
        return cls(*map(np.asarray, (sigma_x, sigma_z, 0.5 * difference.imag)))


def check_positive(**values: float) -> None:
    """Refuse any value that is not a finite number above zero, by its argument's name."""
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0.0):
            raise InputError("but_must_finite_number", name=name, value=value)


def check_finite(**values: float) -> None:
    """Refuse any value that is not a finite number, by its argument's name."""
    for name, value in values.items():
        if not np.isfinite(value):
            raise InputError("but_must_finite_number_2", name=name, value=value)


def coordinates(name: str, values: ArrayLike) -> Floats:
    """Coordinates as a float array; refuses what is not finite."""
    array = np.asarray(values, dtype=np.float64)
    if not np.all(np.isfinite(array)):
        raise InputError("holds_nan_infinity_but", name=name)
    return array


def plane_points(x_mm: ArrayLike, z_mm: ArrayLike) -> tuple[Floats, Floats]:
    """Points x, z broadcast against each other; refuses shapes that do not fit."""
    x, z = coordinates("x_mm", x_mm), coordinates("z_mm", z_mm)
    try:
        x, z = np.broadcast_arrays(x, z)
    except ValueError:
        raise InputError("x_mm_has_shape_z_mm", shape=x.shape, shape_2=z.shape) from None
    return x, z


def half_plane_points(x_mm: ArrayLike, z_mm: ArrayLike) -> tuple[Floats, Floats]:
    """Points in the block, broadcast; refuses points above its surface."""
    x, z = plane_points(x_mm, z_mm)
    if np.any(z < 0.0):
        raise InputError("z_mm_goes_down_but", lowest=float(z.min()))
    return x, z + 0.0  # -0.0 would land on the other side of the branch cut


def complex_points(x: Floats, z: Floats) -> Complexes:
    """The points s = x + iz."""
    points = np.empty(np.shape(x), dtype=np.complex128)
    points.real, points.imag = x, z
    return points


def edge_root(points: Complexes, half_width: float) -> Complexes:
    """sqrt(s² - a²) with the cut on the contact, -a..a, behaving as s far away."""
    return np.asarray(np.sqrt(points - half_width) * np.sqrt(points + half_width))


def mcewen_terms(x: Floats, z: Floats, half_width: float) -> tuple[Complexes, Complexes, Floats]:
    """McEwen's n + i m = sqrt(s² - a²), the same less s, and 1/(m² + n²) (0 at the very edge). The
    second is -a²/(sqrt(s² - a²) + s): real part n - x and imaginary part m - z, each with all its
    digits, since root and s lie in one quadrant.
    """
    points = complex_points(x, z)
    root = edge_root(points, half_width)
    excess = -(half_width**2) / (root + points)
    size = np.square(root.real) + np.square(root.imag)
    inside = size > np.finfo(np.float64).tiny
    return root, excess, np.where(inside, 1.0 / np.where(inside, size, 1.0), 0.0)


def stress_from_transforms(
    transform: Complexes, slope_z: Complexes, friction: float = 0.0
) -> StressComponents:
    """Stress from the Cauchy transform F of a pressure p with the traction q = mu p along +x, and
    from z F', which has a limit at an edge where F' has none.
    (sx - sz) - 2i txz = -(2/π) [mu F - (1 - i mu) z F'],  sx + sz = -(2/π) [mu Re F - Im F]
    """
    conjugate = -(2.0 / np.pi) * (friction * transform - (1.0 - 1j * friction) * slope_z)
    total = -(2.0 / np.pi) * (friction * transform.real - transform.imag)
    return StressComponents.from_invariants(np.conj(conjugate), total)
