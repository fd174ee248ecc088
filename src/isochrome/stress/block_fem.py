"""Finite elements for what a block's sides and support add to a half-plane's stress: a
correction that takes the half-plane's tractions off the sides and its displacement out of the
support. Both are smooth at the contact, so that a coarse mesh is enough: biquadratic elements in
plane stress, on lines that crowd towards the contact and the corners. Strains at the 2 x 2 Gauss
points, where they are of one order more (Barlow 1976, International Journal for Numerical Methods
in Engineering 10). Library: scikit-fem, Gustafsson & McBain (2020), JOSS 5."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from isochrome.errors import InputError
from isochrome.stress.field import StressComponents
from isochrome.stress.half_plane import (
    Floats,
    PointForce,
    point_force_displacement,
    point_force_stress,
)

_GROWTH = 0.15
"""Growth of the lines' distance with that from the contact or a corner: with it and the distances
below, the correction is some 1e-4 of its largest stress off that of more lines."""
_CORNER, _NEAR = 0.0125, 0.08
"""Distance of the lines at a corner over the block's size, five times that at the widest; over
its clearance at the contact."""


class Sides(NamedTuple):
    """A block by its sides from the contact's place, mm, and how it is held."""

    left: float  # negative
    right: float
    height: float  # depth of the support
    poisson: float
    sliding: bool  # the support carries no shear

    @property
    def clearance(self) -> float:
        """Distance of the contact from the nearest side or the support (mm)."""
        return min(-self.left, self.right, self.height)


class Sampled(NamedTuple):
    """A correction at the n Gauss points of a mesh."""

    x: Floats  # mm from the contact
    z: Floats
    area: Floats  # that a point stands for, mm²
    stress: StressComponents  # MPa


def corrections(
    sides: Sides, forces: Iterable[PointForce], *, within_mm: float, refine: float = 1.0
) -> list[Sampled]:
    """What a block adds to the half-plane's stress under each force, near the contact's place. That
    is within a radius `within_mm`; `refine` multiplies the number of the mesh's lines. InputError
    where scikit-fem is not installed."""
    try:
        import skfem as fem
    except ImportError as error:
        raise InputError("specimen_shape_block_needs") from error
    from scipy.sparse.linalg import splu
    from skfem.helpers import ddot, sym_grad

    width, at_contact = sides.right - sides.left, _NEAR * sides.clearance
    along = {sides.left: _CORNER * width, 0.0: at_contact, sides.right: _CORNER * width}
    down = {0.0: at_contact, sides.height: _CORNER * sides.height}
    mesh = fem.MeshQuad.init_tensor(_graded(along, refine), _graded(down, refine))
    basis = fem.Basis(mesh, fem.ElementVector(fem.ElementQuad2()), intorder=4)
    energy = fem.BilinearForm(
        lambda u, v, _: ddot(_stress(sym_grad(u), sides.poisson), sym_grad(v))
    )
    stiffness = energy.assemble(basis).tocsc()
    # of a sliding support one place is held along x too, against drifting
    support = basis.get_dofs(lambda x: np.isclose(x[1], sides.height))
    across, down_there = support.nodal["u^1"], support.all("u^2")
    held = np.r_[down_there, across[len(across) // 2]] if sides.sliding else support.all()
    free, is_down = np.setdiff1d(np.arange(basis.N), held), np.isin(held, down_there)
    x_held, z_held = basis.doflocs[:, held]
    solver = splu(stiffness[free][:, free], permc_spec="MMD_AT_PLUS_A")
    x, z = mesh.p[:, mesh.facets].mean(axis=1)
    loaded = np.isclose(x, sides.left) | np.isclose(x, sides.right)
    if sides.sliding:
        loaded |= np.isclose(z, sides.height)  # what acts down there meets a held place
    on_sides = fem.FacetBasis(mesh, basis.elem, facets=np.flatnonzero(loaded), intorder=12)
    # the Gauss points of the elements near the contact
    at = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3)
    rule = np.stack([g.ravel() for g in np.meshgrid(at, at)]), np.full(4, 0.25)
    elements = np.flatnonzero(np.hypot(*mesh.p[:, mesh.t].mean(axis=1)) < within_mm)
    near = fem.Basis(mesh, basis.elem, elements=elements, quadrature=rule)
    x, z = (np.asarray(c).ravel() for c in near.global_coordinates())
    places = []
    for force in forces:
        u = np.zeros(basis.N)
        u_x, u_z = point_force_displacement(x_held, z_held, force, sides.poisson)
        u[held] = -np.where(is_down, u_z, u_x)
        tractions = fem.LinearForm(lambda v, w, force=force: _minus_traction(force, v, w))
        load = tractions.assemble(on_sides) - stiffness @ u
        u[free] = solver.solve(load[free])
        stress = _stress(sym_grad(near.interpolate(u)), sides.poisson)
        parts = (np.asarray(stress[i, j]).ravel() for i, j in ((0, 0), (1, 1), (0, 1)))
        places.append(Sampled(x, z, np.asarray(near.dx).ravel(), StressComponents(*parts)))
    return places


def _minus_traction(force: PointForce, v: Any, w: Any) -> Any:
    """Minus the work of the half-plane's tractions on the sides, and along a sliding support."""
    stress = point_force_stress(w.x[0], w.x[1], force)
    along = stress.sigma_x * w.n[0] + stress.tau_xz * w.n[1]
    down = stress.tau_xz * w.n[0] + stress.sigma_z * w.n[1]
    return -(along * v[0] + down * v[1])


def _graded(smallest: dict[float, float], refine: float) -> Floats:
    """Lines whose distance is `smallest` at some places and grows from there."""
    places = np.array(list(smallest))
    fine = np.unique(np.r_[np.linspace(places.min(), places.max(), 4001), places])
    distance = np.min([s + _GROWTH * np.abs(fine - p) for p, s in smallest.items()], axis=0)
    density = refine / np.minimum(distance, 5.0 * _CORNER * np.ptp(places))
    count = np.r_[0.0, np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(fine))]
    steps = np.linspace(0.0, count[-1], max(4, int(np.ceil(count[-1]))) + 1)
    return np.asarray(np.interp(steps, count, fine))


def _stress(strain: Any, poisson: float) -> Any:
    """Hooke's law in plane stress, Young's modulus 1."""
    from skfem.helpers import eye, trace

    return (strain + poisson / (1 - poisson) * eye(trace(strain), 2)) / (1 + poisson)
