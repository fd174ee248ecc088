"""The paper's section 2 and appendices, plainly, by conjugate gradients with an FFT (Polonsky &
Keer 1999, Wear 231, 206): the rival that `isochrome bench` times, tuned neither way."""

from dataclasses import dataclass

import numpy as np
import scipy.fft

STEP_MM = 25.0
"""The paper's sliding increment; it runs 9320 of them to 233 m."""


@dataclass(frozen=True)
class Elements:
    """Uniform elements with centres `x_mm` (n,), width `dx_mm`, and the spectrum of -K."""

    x_mm: np.ndarray
    dx_mm: float
    spectrum: np.ndarray
    length: int

    def deflection(self, pressure):
        """Displacement u_i = -Σ_j K_{i-j} p_j (6), mm, by zero-padded FFT."""
        product = self.spectrum * scipy.fft.rfft(pressure, self.length)
        return scipy.fft.irfft(product, self.length)[: len(self.x_mm)]


@dataclass(frozen=True)
class Solution:
    """A pressure, the iterations it took, and whether the change fell below the tolerance."""

    pressure: np.ndarray
    iterations: int
    converged: bool


def make_elements(n, half_mm, *, contact_modulus_mpa, coupling_per_mpa=0.0, friction=0.0):
    """Elements on -half .. half and their influence coefficients K_{i-j} (A.4), H(0) = 1/2."""
    dx = 2.0 * half_mm / (n - 1)
    lag = np.arange(-(n - 1), n)
    distance = np.abs(lag) * dx
    k = 2.0 / (np.pi * contact_modulus_mpa) * (f(distance + dx / 2) - f(distance - dx / 2))
    k += 0.5 * friction * dx * coupling_per_mpa * np.heaviside(-lag, 0.5)
    length = scipy.fft.next_fast_len(2 * n - 1, real=True)
    circular = np.zeros(length)
    circular[lag % length] = -k
    return Elements(dx * (np.arange(n) - (n - 1) / 2), dx, scipy.fft.rfft(circular), length)


def f(x):
    """f(x) = x (ln|x| - 1) of (A.4)."""
    return x * (np.log(np.abs(x)) - 1.0)


def solve(elements, gap_mm, line_load, *, tolerance=1e-6, start=None, most=2000):
    """Polonsky & Keer's conjugate gradients; stops on the change of pressure per iteration."""
    wanted = line_load / elements.dx_mm
    p = np.full(len(gap_mm), wanted / len(gap_mm)) if start is None else start
    direction = np.zeros_like(p)
    old_square, conjugate = 1.0, False
    for iteration in range(1, most + 1):
        contact = p > 0.0
        g = gap_mm + elements.deflection(p)
        inside = g[contact]
        mean = inside.mean()
        g -= mean
        square = float(((inside - mean) ** 2).sum())
        slope = square / old_square if conjugate else 0.0
        direction = np.where(contact, g + slope * direction, 0.0)
        old_square = square
        r = elements.deflection(direction)
        r -= r[contact].mean()
        step = (g * direction).sum() / (r * direction).sum()
        new = np.maximum(p - step * direction, 0.0)
        overlap = (new == 0.0) & (g < 0.0)
        conjugate = not overlap.any()
        new[overlap] -= step * g[overlap]
        new *= wanted / new.sum()
        change = np.abs(new - p).sum() / wanted
        p = new
        if change < tolerance:
            return Solution(p, iteration, True)
    return Solution(p, most, False)


def wear(elements, gap_mm, line_load, k_mm2_per_n, distances_m, *, step_mm=STEP_MM, tolerance=1e-6):
    """Explicit steps h += k p Δs (2) of at most `step_mm`; (pressure, depth) at each distance."""
    depth = np.zeros_like(gap_mm)
    p = solve(elements, gap_mm, line_load, tolerance=tolerance).pressure
    slid, states = 0.0, []
    for distance in distances_m:
        count = int(np.ceil((1e3 * distance - slid) / step_mm - 1e-9))
        for _ in range(count):
            depth = depth + k_mm2_per_n * (1e3 * distance - slid) / count * p
            p = solve(elements, gap_mm + depth, line_load, tolerance=tolerance, start=p).pressure
        slid = 1e3 * distance
        states.append((p, depth))
    return states


def explicit_limit_mm(dx_mm, k_mm2_per_n, contact_modulus_mpa):
    """Largest stable explicit step, 4 dx/(pi k E*); the paper does not give it, nor check it."""
    return 4.0 * dx_mm / (np.pi * k_mm2_per_n * contact_modulus_mpa)


def stress_by_edges(x_mm, z_mm, first_mm, dx_mm, pressure, shear):
    """(sx - sz) + 2i txz (MPa) at columns x and rows z: (7), every pair of pixel and edge, which
    carries the traction's jump."""
    a, b = _loaded(pressure, shear)
    edges = first_mm + dx_mm * (np.arange(a, b + 1) - 0.5)
    dp, dq = (np.diff(t[a:b], prepend=0.0, append=0.0) for t in (pressure, shear))
    field = np.empty((len(z_mm), len(x_mm)), complex)
    for row, z in enumerate(z_mm):
        n_difference, n_shear, t_difference, t_shear = edge_values(x_mm[:, None] - edges, z)
        field[row].real = _sum(n_difference, dp) + _sum(t_difference, dq)
        field[row].imag = 2.0 * (_sum(n_shear, dp) + _sum(t_shear, dq))
    return field


def stress_by_lags(x_mm, z_mm, first_mm, dx_mm, pressure, shear):
    """The same sum (7) by lags i - j, (B.1), where pixels lie on a lattice of elements; in extended
    precision."""
    a, b = _loaded(pressure, shear)
    p, q = pressure[a:b][::-1], shear[a:b][::-1]
    fold = round(float((x_mm[1] - x_mm[0]) / dx_mm))
    count = fold * (len(x_mm) - 1) + len(p)
    edges = x_mm[0] - (first_mm + (b - 1) * dx_mm) + dx_mm * (np.arange(count + 1) - 0.5)
    field = np.empty((len(z_mm), len(x_mm)), np.result_type(edges, 1j))
    for row, z in enumerate(z_mm):
        n_difference, n_shear, t_difference, t_shear = (
            np.lib.stride_tricks.sliding_window_view(np.diff(v), len(p))[::fold]
            for v in edge_values(edges, z)
        )
        field[row].real = _sum(n_difference, p) + _sum(t_difference, q)
        field[row].imag = 2 * (_sum(n_shear, p) + _sum(t_shear, q))
    return field


def _loaded(pressure, shear):
    loaded = np.flatnonzero((pressure != 0.0) | (shear != 0.0))
    return int(loaded[0]), int(loaded[-1]) + 1


def _sum(coefficients, traction):
    return np.einsum("ij,j->i", coefficients, traction)


def edge_values(x, z):
    """Appendix B at element edges: n^xx - n^zz, n^xz, t^xx - t^zz, t^xz."""
    square = x**2 + z**2
    a, b = x * z / square, z**2 / square
    pi = 4 * np.arctan(np.ones_like(z))  # in the precision of z
    return 2 * a / pi, b / pi, (-2 * b - np.log(square)) / pi, (a - np.arctan2(x, z)) / pi
