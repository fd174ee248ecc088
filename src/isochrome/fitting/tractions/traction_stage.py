"""One stage of an inversion: some pixels, some nodes, and what they say of the tractions."""

from dataclasses import dataclass, replace

import numpy as np

from isochrome.estimation import FrameData
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.renderer import FringeOptics
from isochrome.fitting.tractions.binned_pixels import Bins, make_bins
from isochrome.fitting.tractions.traction_basis import (
    DEGREE,
    FRICTION_LIMIT,
    Basis,
    lattice_px,
    make_basis,
    scaled_modes,
)
from isochrome.fitting.tractions.traction_solver import (
    Solution,
    TractionProblem,
    pixel_field,
    smoothness,
    solve_tractions,
)
from isochrome.stress import PixelGrid

EDGE_PX = 2.0
"""Rows nearer to the surface than this are not used: the camera's edge, and what a rim reflects."""

_MOSTLY = 0.95
"""Share of the bins in which a field's fringes are brighter than the noise of a pixel."""

_TOP_STEP_PX = 0.25
_TOP_PRIOR_PX = 2.0
"""How far the surface's place is let go in one stage."""


@dataclass(frozen=True)
class Setup:
    """What an inversion is asked: a frame, its optics, and what is free.

    `data`; `optics`; `free_top`, whether the surface's place in the picture is an unknown.
    """

    data: FrameData
    optics: FringeOptics
    free_top: bool


@dataclass(frozen=True)
class State:
    """What is known so far: the picture's place, tractions on `lattice_px` (n,), modes."""

    pixels: PixelGrid
    pressure: Array
    shear: Array
    modes: Array

    @property
    def top_px(self) -> float:
        """Depth of the picture's upper edge below the surface, pixels."""
        return self.pixels.top_mm / self.pixels.pixel_mm


@dataclass(frozen=True)
class Stage:
    """An inversion at one stage; `moving`, whether its last unknown is the surface's place.

    `strength` of the regularisation, 0 where it is only enough to hold the numbers together.
    """

    problem: TractionProblem
    basis: Basis
    solution: Solution
    moving: bool = False
    strength: float = 0.0

    @property
    def moved_px(self) -> float:
        """How far the stage has moved the picture down along the specimen, pixels."""
        return _TOP_STEP_PX * float(self.solution.unknowns[-1]) if self.moving else 0.0

    def state(self) -> State:
        """What it has found."""
        c, basis, pixels = self.solution.unknowns, self.basis, self.problem.pixels
        first = basis.signed
        pressure, shear = basis.on_lattice(c, pixels)
        place = replace(pixels, top_mm=pixels.top_mm + self.moved_px * pixels.pixel_mm)
        return State(place, pressure, shear, c[first : first + len(basis.modes)])

    def shows_fringes(self) -> bool:
        """Whether the light that follows the tractions is positive, and more than the noise."""
        bins = self.problem.bins
        seen = bins.illuminated(self.solution.light) > bins.sigma * bins.side
        return float(np.mean(seen)) > _MOSTLY

    def covariance(self, *, smooth: bool = True, bound: bool = True) -> Array:
        """Covariance (m, m) of the unknowns, widened by chi.

        Parameters: `smooth`, the posterior's, or (False) that of least squares alone, which is
        never smaller; `bound`, zero for unknowns at their bound, or (False) as if nothing were.
        """
        c, signed = self.solution.unknowns, self.basis.signed
        free = np.r_[(c[:signed] > 0.0) | (not bound), np.ones(len(c) - signed, bool)]
        here = np.ix_(free, free)
        weight = self.solution.smooth * (1.0 if smooth else 1e-3)
        cover = np.zeros((len(c), len(c)))
        cover[here] = np.linalg.inv((self.solution.gram + weight)[here])
        return cover * self.solution.chi**2


def solve_stage(
    setup: Setup,
    state: State,
    nodes_px: Array,
    *,
    depth_px: float,
    spacing_px: int,
    bins: Bins | None = None,
    free_top: bool = False,
    strength: float | None = None,
) -> Stage:
    """Tractions at some nodes from the pixels below some depth.

    Parameters: `setup`; `state`, where the solution starts; `nodes_px`, multiples of `spacing_px`;
    `depth_px` of the shallowest pixels; `bins`, made from the state where not given; `free_top`,
    whether the surface may move; `strength` of the regularisation, None for hardly any.
    Returns a Stage.
    """
    pixels = state.pixels
    bins = state_bins(setup, state) if bins is None else bins
    some = bins.where(state.top_px + bins.row + 0.5 >= depth_px)
    basis = make_basis(some, pixels, nodes_px, spacing_px)
    at = nodes_px - lattice_px(pixels)[0]
    c = basis.unknowns(state.pressure[at], state.shear[at], state.modes)
    smooth = smoothness(basis, pixels.pixel_mm) * (strength or 1.0)
    if free_top:
        lower = replace(pixels, top_mm=pixels.top_mm + _TOP_STEP_PX * pixels.pixel_mm)
        basis = basis.with_top(make_basis(some, lower, nodes_px, spacing_px), c)
        c, smooth = np.r_[c, 0.0], np.pad(smooth, (0, 1))
    problem = TractionProblem(some, pixels, setup.optics)
    solution = solve_tractions(
        problem,
        basis,
        smooth,
        c,
        hold=(_TOP_STEP_PX / _TOP_PRIOR_PX) ** 2 if free_top else 0.0,
        steps=10,
        weak=strength is None,
        precise=depth_px <= EDGE_PX,
    )
    return Stage(problem, basis, solution, free_top, strength or 0.0)


def state_bins(setup: Setup, state: State) -> Bins:
    """The frame averaged where a state's fringes allow for it."""
    places, modes = lattice_px(state.pixels), scaled_modes(state.pixels, DEGREE)
    basis = Basis(np.zeros((0, 0)), places, 1, FRICTION_LIMIT, modes)
    c = basis.unknowns(state.pressure, state.shear, state.modes)
    order = np.abs(pixel_field(state.pixels, basis, c)) * setup.optics.order_per_mpa
    slope = np.max(np.abs(np.gradient(order)), axis=0)
    depth = state.pixels.z_mm / state.pixels.pixel_mm
    from_px = EDGE_PX + 2.0 * setup.optics.blur_px
    return make_bins(setup.data, depth, slope, from_px=from_px)
