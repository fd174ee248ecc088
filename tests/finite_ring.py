"""Truth for rings by curved biquadratic elements, without series: what the hole changes of a disc,
which is smooth and so more exact than a ring under a node's force."""

from functools import lru_cache

import numpy as np
import skfem
from scipy.interpolate import RegularGridInterpolator
from scipy.sparse.linalg import splu
from skfem.helpers import ddot, eye, sym_grad, trace

from isochrome.reference import disc_stress

POISSON = 0.36  # what it is does not matter to the stress; no closed form has it
UNIT_DISC = {"load_n": 1.0, "diameter_mm": 2.0, "thickness_mm": 1.0}


def hooke(strain):
    """Stress in plane stress, Young's modulus 1."""
    return (strain + POISSON / (1 - POISSON) * eye(trace(strain), 2)) / (1 + POISSON)


@lru_cache(maxsize=4)
def hole_in_disc(ratio, count=48):
    """What a hole `ratio` as wide adds to the stress of a quarter disc (radius 1, P/d = 1, `count`
    even elements each way): angles from the load (m,), radii (n,), and sx, sz, txz (m, n)."""
    lines = np.linspace(0.0, 0.5 * np.pi, count + 1), np.geomspace(ratio, 1.0, count + 1)
    mesh, basis, across = _quarter(*lines)

    def minus_traction(v, w):
        disc = disc_stress(w.x[0], w.x[1], **UNIT_DISC)
        along = disc.sigma_x * w.n[0] + disc.tau_xz * w.n[1]
        down = disc.tau_xz * w.n[0] + disc.sigma_z * w.n[1]
        return -(along * v[0] + down * v[1])

    hole = mesh.facets_satisfying(lambda x: np.hypot(*x) < ratio * (1.0 + 1e-3), True)
    edge = skfem.FacetBasis(mesh, basis.elem, facets=hole, intorder=8)
    load = skfem.LinearForm(minus_traction).assemble(edge)
    return _solved(mesh, basis, across, load, lines)


def _quarter(angle, radius):
    """The upper right quarter (x > 0, z < 0): its mesh, its basis, which unknowns are along x."""
    polar = skfem.MeshQuad2.from_mesh(skfem.MeshQuad.init_tensor(angle, radius))
    t, r = polar.doflocs
    mesh = skfem.MeshQuad2(np.stack([r * np.sin(t), -r * np.cos(t)]), polar.t)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementQuad2()), intorder=6)
    across = np.zeros(basis.N, dtype=bool)
    for dofs in (basis.nodal_dofs, basis.facet_dofs, basis.interior_dofs):
        across[dofs[0]] = True
    return mesh, basis, across


def _solved(mesh, basis, across, load, lines):
    stiffness = skfem.BilinearForm(lambda u, v, _: ddot(hooke(sym_grad(u)), sym_grad(v))).assemble(
        basis
    )
    x, z = basis.doflocs
    free = np.flatnonzero(~((across & (np.abs(x) < 1e-9)) | (~across & (np.abs(z) < 1e-9))))
    u = np.zeros(basis.N)
    u[free] = splu(stiffness[free][:, free].tocsc(), permc_spec="MMD_AT_PLUS_A").solve(load[free])
    return _gauss_stress(mesh, basis.elem, u, lines)


def _gauss_stress(mesh, element, u, lines):
    """Stress at the 2 x 2 Gauss points, where it is most exact, as images over angle and radius."""
    at = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3)
    points = np.stack([g.ravel() for g in np.meshgrid(at, at)])
    basis = skfem.Basis(mesh, element, quadrature=(points, np.full(4, 0.25)))
    stress = hooke(sym_grad(basis.interpolate(u)))
    x, z = np.asarray(basis.global_coordinates()).reshape(2, -1)
    angle, radius = (np.r_[[line[:-1] + a * np.diff(line) for a in at]].T.ravel() for line in lines)
    # curved sides are a circle's but for 1e-6: the nearest line of Gauss points is the point's own
    col = np.abs(np.hypot(x, z)[:, None] - radius).argmin(axis=1)
    row = np.abs(np.arctan2(x, -z)[:, None] - angle).argmin(axis=1)
    parts = []
    for i, j in ((0, 0), (1, 1), (0, 1)):
        parts.append(np.full((len(angle), len(radius)), np.nan))
        parts[-1][row, col] = np.asarray(stress[i, j]).ravel()
        assert np.isfinite(parts[-1]).all()
    return angle, radius, parts


def finite_ring_difference(x_mm, z_mm, *, load_n, diameter_mm, hole_mm, thickness_mm):
    """(sigma_x - sigma_z) + 2i tau_xz of a ring (MPa) at places from its centre; NaN outside.

    The disc's closed form and, by finite elements, what the hole changes of it.
    """
    outer, ratio = 0.5 * diameter_mm, hole_mm / diameter_mm
    angle, radius, (sx, sz, txz) = hole_in_disc(ratio)
    x, z = np.broadcast_arrays(x_mm / outer, z_mm / outer)
    t, r = np.arctan2(np.abs(x), np.abs(z)), np.hypot(x, z)
    change = RegularGridInterpolator(
        (angle, radius), (sx - sz) + 2j * txz, method="cubic", bounds_error=False, fill_value=None
    )((t, r))  # on to the edges, half an element beyond the last Gauss points
    disc = disc_stress(x, z, **UNIT_DISC)
    # solved in one quarter; the shear changes its sign with x and with z
    field = disc.sigma_x - disc.sigma_z + change.real
    field = field + 1j * (2.0 * disc.tau_xz - np.sign(x * z) * change.imag)
    return np.where(r >= ratio, field * load_n / (thickness_mm * outer), np.nan)
