"""Truth for blocks of finite size by finite elements, fine under the closed forms' pressure;
nothing here knows of half-planes."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementQuad2, ElementVector, FacetBasis, LinearForm, MeshQuad
from skfem.helpers import ddot, eye, sym_grad, trace

from isochrome import reference

PAIR = (2100.0, 0.4, 210e3, 0.3)
LINE_LOAD, RADIUS, THICKNESS, FRINGE_VALUE = 11.0, 24.61, 4.0, 14.6
FRINGES_PER_MPA = THICKNESS / FRINGE_VALUE


class Solid(NamedTuple):
    """A block in the paper's size, or another; `friction`; `support`; `spacing_mm` of the mesh."""

    friction: float = 0.0
    support: str = "fixed"
    spacing_mm: float = 0.02
    width_mm: float = 60.0
    height_mm: float = 40.0
    left_mm: float = -30.0


def pressure(x, friction):
    """The closed form's pressure (MPa) of the paper's contact."""
    modulus = reference.contact_modulus(*PAIR)
    if friction == 0.0:
        size = reference.hertz_half_width(LINE_LOAD, RADIUS, modulus)
        peak = reference.hertz_peak_pressure(LINE_LOAD, RADIUS, modulus)
        return reference.hertz_pressure(x, half_width_mm=size, peak_pressure_mpa=peak)
    beta = reference.dundurs_beta(*PAIR)
    return reference.coupled_pressure(
        x, reference.coupled_contact(LINE_LOAD, RADIUS, modulus, friction=friction, beta=beta)
    )


def lines(end, spacing):
    """From 0 to `end`: even under the contact, three times wider in the picture, then growing."""
    found, step = list(np.arange(0.0, 0.8, spacing)), spacing
    while found[-1] < 3.3:
        step = min(1.15 * step, 3 * spacing)
        found.append(found[-1] + step)
    rest = np.cumsum(step * 1.35 ** np.arange(1, 60))
    last = int(np.searchsorted(rest, end - found[-1]))
    return np.r_[found, found[-1] + rest[: last + 1] * (end - found[-1]) / rest[last]]


@lru_cache(maxsize=4)
def solved(solid):
    """Stress at all Gauss points: x (n,), z (m,), three components (m, n). Plane stress,
    biquadratic; the load is the tractions' to 1e-3, and made exact."""
    right = lines(solid.width_mm + solid.left_mm, solid.spacing_mm)
    left = -lines(-solid.left_mm, solid.spacing_mm)[:0:-1]
    mesh = MeshQuad.init_tensor(np.r_[left, right], lines(solid.height_mm, solid.spacing_mm))
    element = ElementVector(ElementQuad2())
    basis = Basis(mesh, element, intorder=4)
    poisson = PAIR[1]

    def hooke(strain):
        return (strain + poisson / (1 - poisson) * eye(trace(strain), 2)) / (1 + poisson)

    stiffness = BilinearForm(lambda u, v, _: ddot(hooke(sym_grad(u)), sym_grad(v))).assemble(basis)
    upper = mesh.facets_satisfying(lambda x: np.isclose(x[1], 0.0))

    def work(v, w):
        p = pressure(w.x[0], solid.friction)
        return solid.friction * p * v[0] + p * v[1]

    load = LinearForm(work).assemble(FacetBasis(mesh, element, facets=upper, intorder=12))
    carried = load[basis.get_dofs(upper).all("u^2")].sum()
    assert abs(carried / LINE_LOAD - 1.0) < 1e-3  # the root at the contact's edges
    load *= LINE_LOAD / carried
    lower = basis.get_dofs(lambda x: np.isclose(x[1], solid.height_mm))
    across = lower.nodal["u^1"]
    held = lower.all() if solid.support == "fixed" else np.r_[lower.all("u^2"), across[:1]]
    free = np.setdiff1d(np.arange(basis.N), held)
    u = np.zeros(basis.N)
    u[free] = splu(stiffness[free][:, free].tocsc(), permc_spec="MMD_AT_PLUS_A").solve(load[free])
    return gauss_stress(mesh, element, u, hooke)


def gauss_stress(mesh, element, u, hooke):
    """Stress at the 2 x 2 Gauss points, where it is most exact, as images on their lattice."""
    at = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3)
    points = np.stack([g.ravel() for g in np.meshgrid(at, at)])
    basis = Basis(mesh, element, quadrature=(points, np.full(4, 0.25)))
    stress = hooke(sym_grad(basis.interpolate(u)))
    places = np.asarray(basis.global_coordinates()).reshape(2, -1).round(9)
    (x, col), (z, row) = (np.unique(c, return_inverse=True) for c in places)
    parts = []
    for i, j in ((0, 0), (1, 1), (0, 1)):
        parts.append(np.empty((len(z), len(x))))
        parts[-1][row, col] = np.asarray(stress[i, j]).ravel()
    return x, z, parts


def block_difference(solid, x_mm, z_mm):
    """(sigma_x - sigma_z) + 2i tau_xz of a block on a lattice of places (rows, cols), MPa."""
    x, z, parts = solved(solid)
    near = np.ix_(z < z_mm.max() + 1.0, (x > x_mm.min() - 1.0) & (x < x_mm.max() + 1.0))
    sx, sz, txz = (
        RectBivariateSpline(z[near[0].ravel()], x[near[1].ravel()], part[near])(z_mm, x_mm)
        for part in parts
    )
    return (sx - sz) + 2j * txz
