"""Independent truth for the half-plane closed forms: adaptive quadrature of the integrands."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import quad

KERNELS = {  # of w = x - t and z, for p = 1 and q = mu: sx, sz, txz
    "sigma_x": lambda w, z, mu: (z * w**2 + mu * w**3) / (w**2 + z**2) ** 2,
    "sigma_z": lambda w, z, mu: (z**3 + mu * z**2 * w) / (w**2 + z**2) ** 2,
    "tau_xz": lambda w, z, mu: (z**2 * w + mu * z * w**2) / (w**2 + z**2) ** 2,
}


@pytest.fixture(scope="session")
def assert_quadrature() -> Callable[..., None]:
    """Check a field at points x, z > 0 against `scale` times the integrals' stress under
    p = (a + t)^α (a - t)^β and q = mu p."""

    def check(field, x, z, *, half_width, powers, atol, friction=0.0, scale=1.0):
        x, z = np.broadcast_arrays(x, z)
        for name, kernel in KERNELS.items():
            truth = np.zeros(x.shape)
            for i in np.ndindex(x.shape):
                truth[i], _ = quad(
                    lambda t, k=kernel, i=i: -(2.0 / np.pi) * k(x[i] - t, z[i], friction),
                    -half_width, half_width, weight="alg", wvar=powers, limit=400, epsabs=1e-11,
                    epsrel=1e-10,
                )  # fmt: skip
            # the quadrature was asked for 1e-10 relative or 1e-11 absolute
            np.testing.assert_allclose(getattr(field, name), scale * truth, rtol=1e-9, atol=atol)

    return check


@pytest.fixture(scope="session")
def assert_equilibrium() -> Callable[..., None]:
    """Check div σ = 0 and that sx + sz is harmonic, by central differences of step h."""

    def check(field, x, z, *, step, scale):
        """`field(x, z)` -> StressComponents; `scale`, what the residuals are small against."""
        x, z = np.broadcast_arrays(x, z)
        h = step

        def slope(name, dx, dz):
            ahead, behind = field(x + dx, z + dz), field(x - dx, z - dz)
            return (getattr(ahead, name) - getattr(behind, name)) / (2.0 * h)

        # truncation is h² times a third derivative; the callers stay some tenths of the contact
        # (or disc) size away from singular points, where that is at most some thousand scale h²
        tolerance = 2e3 * scale * h**2
        along_x = slope("sigma_x", h, 0.0) + slope("tau_xz", 0.0, h)
        along_z = slope("tau_xz", h, 0.0) + slope("sigma_z", 0.0, h)
        np.testing.assert_allclose(along_x, 0.0, atol=tolerance)
        np.testing.assert_allclose(along_z, 0.0, atol=tolerance)

        def total(dx, dz):
            stress = field(x + dx, z + dz)
            return stress.sigma_x + stress.sigma_z

        around = total(h, 0.0) + total(-h, 0.0) + total(0.0, h) + total(0.0, -h)
        laplacian = (around - 4.0 * total(0.0, 0.0)) / h**2
        # one derivative more than above, and rounding of 1e-16 scale / h²
        np.testing.assert_allclose(laplacian, 0.0, atol=10.0 * tolerance + 1e-14 * scale / h**2)

    return check
