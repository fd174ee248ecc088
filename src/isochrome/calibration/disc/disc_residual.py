"""Residual stress in a disc, and the order it makes with the load.

Stress adds as a tensor. With D = (sx - sz) + 2i txz in fringes, the loads' part is
D_P = N (1 - rho^2)/(s^2 + 1)^2, s = x - iz in radii with z along the loads (Frocht 1948; see
`reference.brazilian_disc`), and the order is |D_P + D_0| with one residual field D_0 for all loads:
a polynomial, which holds what moulding, cutting and annealing leave, D_0 = (c2 r^2 + c4 r^4)
e^(2 i phi), and an even part; and a polynomial along the directions of the loads' own field, which
holds what creeps under them.
"""

import numpy as np
from numpy.polynomial.polynomial import polyval2d
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]

DEGREE = 4
_POWERS = tuple((i, t - i) for t in range(DEGREE + 1) for i in range(t + 1))

_SIZE, _FALLS = 0.2, 0.8
"""Order of an even residual on usual discs, fringes, and what each degree more leaves of it."""

SIZES = np.tile([_SIZE * _FALLS ** (i + j) for i, j in _POWERS], 3)
"""Standard deviations (k,) of the members' amplitudes: along the loads, sx - sz, 2 txz."""


def residual_basis(x: Array, z: Array, turn: Complexes) -> Complexes:
    """Members (k, n) of a residual at places `x`, `z` in radii from the centre.

    As the loads' directions see it: `turn` (n,), see `load_field`.
    """
    real = _powers(x, z)
    return np.concatenate([real, turn * real, 1j * turn * real])


def _powers(x: Array, z: Array) -> Array:
    of_x, of_z = (np.vander(v, DEGREE + 1, increasing=True).T for v in (x, z))
    return np.stack([of_x[i] * of_z[j] for i, j in _POWERS])


def simple_residual(even: float, round_: float) -> Array:
    """Amplitudes (k,) of an even residual and an axisymmetric one, c2 r^2 e^(2 i phi)."""
    real, imaginary = np.zeros((2, len(_POWERS)))
    real[_POWERS.index((0, 0))] = even
    real[_POWERS.index((2, 0))], real[_POWERS.index((0, 2))] = round_, -round_
    imaginary[_POWERS.index((1, 1))] = 2.0 * round_
    return np.concatenate([np.zeros(len(_POWERS)), real, imaginary])


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


def total_order(own: Array, amplitudes: Array, rows: Array, cols: Array) -> Complexes:
    """The order of loads and residual as a complex number in the loads' directions (n,).

    Parameters: `own` (5,), see `disc_order`; `amplitudes` (k,) of the residual; `rows`, `cols`.
    """
    h, turn = load_field(rows, cols, own[1:])
    along, real, imaginary = np.split(amplitudes, 3)
    powers = np.zeros((2, DEGREE + 1, DEGREE + 1), complex)
    powers[(slice(None), *np.transpose(_POWERS))] = along, real + 1j * imaginary
    x, z = _places(own, rows, cols)
    of_loads, free = (polyval2d(x, z, p) for p in powers)
    return np.asarray(own[0] * h + of_loads + turn * free)


def by_residual(own: Array, amplitudes: Array, rows: Array, cols: Array) -> Array:
    """Derivatives (k, n) of the order by the residual's amplitudes; arguments as `total_order`."""
    _, turn = load_field(rows, cols, own[1:])
    total = total_order(own, amplitudes, rows, cols)
    direction = np.conj(total) / np.maximum(np.abs(total), 1e-12)
    seen, real = turn * direction, _powers(*_places(own, rows, cols))
    return np.concatenate([direction.real * real, seen.real * real, -seen.imag * real])


def _places(own: Array, rows: Array, cols: Array) -> tuple[Array, Array]:
    _, row, col, radius, _ = own
    return (cols - col) / radius, (rows - row) / radius


def residual_at_centre(own: Array) -> Array:
    """How each member of the residual counts at the centre along the loads of an image (k,)."""
    centre = np.zeros(1)
    return np.asarray(residual_basis(centre, centre, np.exp([2j * own[4]]))[:, 0].real)
