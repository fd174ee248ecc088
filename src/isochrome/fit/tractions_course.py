"""From the deep to the surface: the course by which tractions are found without a wrong branch.

Deep below the surface the field of any tractions is smooth, and depends on their resultants more
than on their shape, so that a model's fit that is wrong near the contact is right to a fraction of
a fringe there. The inversion begins with deep pixels and few, wide hats, and takes in shallower
pixels with narrower hats step by step: what is new at each step is predicted within the branch.
Then patches of pressure that noise alone explains are left out, and the rest is resolved finely.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import PhysicsError
from isochrome.fit.tractions_basis import lattice_px, make_basis, picture_unit
from isochrome.fit.tractions_smooth import discrepancy_strength, smoothness
from isochrome.fit.tractions_solve import Problem, solve_tractions
from isochrome.fit.tractions_stage import EDGE_PX, Setup, Stage, State, solve_stage, state_bins
from isochrome.fit.tractions_start import search_resultants

Array = NDArray[Any]

_COARSE = ((128, 32), (64, 16), (32, 8), (16, 4), (8, 4))
_FINE = ((4, 4), (2, 2))
"""Depth of the shallowest pixels and spacing of the nodes, in units of `picture_unit`."""
_FINEST_PX = (2, 1)
"""The same where hats of two pixels do not describe a frame of little noise."""

_DEEP_SHARE = 0.3
"""Share of the depth in view at which the course begins at the deepest."""

_BEGINNINGS = 3
_SEEN = 4.0
"""Load of a patch over its standard uncertainty below which noise alone explains it."""

_MOVES, _MOVES_FROM = 4, 16
_STILL_PX = 0.02
_FAR_PX = 1.0
_PASSES = 3
GOOD_CHI = 1.03
"""Residual over noise up to which a field describes a frame: the noise is known to 1 or 2 %."""


def invert(setup: Setup, starts: list[State]) -> tuple[Stage, list[Stage]]:
    """Tractions of a frame, from deep pixels and wide hats to the surface and narrow ones.

    Where the surface has moved far, the course is gone again from its new place; where a start
    does not lead to chi = 1, the next one is tried.
    Parameters: `setup`; `starts`, the likeliest first. Returns the best last Stage, and the first
    stages of the same start that begin in other minima, by rising chi.
    """
    best: tuple[Stage, list[Stage]] | None = None
    for start in starts:
        begun, state = _begin(setup, start), None
        for _ in range(_PASSES):
            first = begun[0].state()
            place = start if state is None else state
            stage = _course(setup, _moved(first, place))
            if best is None or stage.solution.chi < best[0].solution.chi:
                best = stage, begun
            far = abs(stage.state().top_px - place.top_px) > _FAR_PX
            state = stage.state()
            if not far or best[0].solution.chi < GOOD_CHI:
                break
        if best is not None and best[0].solution.chi < GOOD_CHI:
            break
    assert best is not None
    stage, begun = best
    if not stage.shows_fringes():
        raise PhysicsError(
            "the frame shows no fringes of tractions on a surface: no light follows them; is it "
            "loaded, and is the field (dark or bright) the scene's?"
        )
    return _regularised(setup, stage), begun


def _moved(state: State, place: State) -> State:
    return State(place.pixels, state.pressure, state.shear, state.modes)


def _begin(setup: Setup, start: State) -> list[Stage]:
    """The first stage, from each of the likeliest resultants, by rising chi."""
    depth_px, spacing = _coarse(start)[0]
    pixels = start.pixels
    lattice = lattice_px(pixels)
    nodes = lattice[::spacing]
    bins = state_bins(setup, start)
    depth = start.top_px + bins.row + 0.5
    some = bins.where(depth >= depth_px)
    basis = make_basis(some, pixels, nodes, spacing, limit=setup.limit, degree=setup.degree)
    problem = Problem(some, pixels, setup.optics)
    pressure, shear = (
        _hat_means(t, nodes - lattice[0], spacing) for t in (start.pressure, start.shear)
    )
    smooth = smoothness(basis, pixels.pixel_mm)
    stages = []
    for one in search_resultants(problem, basis, pressure, shear, start.modes)[:_BEGINNINGS]:
        acting = shear if shear.any() else pressure
        c = basis.unknowns(one.pressure * pressure, one.shear * acting, one.modes)
        solution = solve_tractions(problem, basis, smooth, c, steps=12)
        stages.append(Stage(problem, basis, solution))
    return sorted(stages, key=lambda stage: stage.solution.chi)


def _coarse(state: State) -> list[tuple[int, int]]:
    """Depths and spacings (pixels) of the coarse stages that the depth in view allows for."""
    unit, deepest = picture_unit(state.pixels), state.top_px + state.pixels.rows
    sized = [(depth * unit, spacing * unit) for depth, spacing in _COARSE]
    return [s for s in sized if s[0] <= _DEEP_SHARE * deepest] or sized[-1:]


def _course(setup: Setup, state: State) -> Stage:
    """All stages after the first."""
    unit, lattice = picture_unit(state.pixels), lattice_px(state.pixels)
    fine = [*((depth * unit, spacing * unit) for depth, spacing in _FINE), _FINEST_PX]
    support, stage = np.ones(len(lattice), bool), None
    for depth, spacing in _coarse(state)[1:] + fine:
        if stage is not None and spacing < 0.5 * state.top_px:
            break  # hats much narrower than their distance to the first row cannot be told apart
        if stage is not None and (depth, spacing) in fine:
            support = _supported(stage)
        if stage is not None and (depth, spacing) == fine[-1] and stage.solution.chi < GOOD_CHI:
            break
        nodes = lattice[::spacing]
        nodes = nodes[support[nodes - lattice[0]]]
        for _ in range(_MOVES):
            stage = solve_stage(
                setup,
                state,
                nodes,
                depth_px=depth,
                spacing_px=spacing,
                free_top=setup.free_top and depth <= _MOVES_FROM * unit,
            )
            state = stage.state()
            if abs(stage.moved_px) < (_STILL_PX if depth <= EDGE_PX * unit else 10 * _STILL_PX):
                break
    assert stage is not None
    return stage


def _regularised(setup: Setup, stage: Stage) -> Stage:
    """The last stage again, as smooth as its noise allows for."""
    basis, problem = stage.basis, stage.problem
    smooth = smoothness(basis, problem.pixels.pixel_mm)
    if not smooth.any():
        return stage
    strength = discrepancy_strength(stage.solution, smooth, basis.signed)
    return solve_stage(
        setup, stage.state(), basis.nodes_px, depth_px=0.0, spacing_px=basis.spacing_px,
        bins=problem.bins, free_top=stage.moving, strength=strength,
    )  # fmt: skip


def _hat_means(values: Array, at: Array, spacing: int) -> Array:
    """Means of values a pixel apart, weighted by hats."""
    hat = 1.0 - np.abs(np.arange(-spacing + 1, spacing)) / spacing
    return np.convolve(np.pad(values, spacing), hat / spacing, "same")[at + spacing]


def _supported(stage: Stage) -> Array:
    """Where on `lattice_px` there is pressure that noise alone does not explain, and beside it."""
    basis, c, n = stage.basis, stage.solution.unknowns, stage.basis.nodes
    places, cover = lattice_px(stage.problem.pixels), stage.covariance()
    found = np.zeros(len(places), bool)
    for i, j in _runs(basis.tractions(c)[0] > 0.0, np.diff(basis.nodes_px) == basis.spacing_px):
        weight = np.zeros(len(c))
        weight[i:j] = weight[n + i : n + j] = 1.0
        if weight @ c > _SEEN * np.sqrt(weight @ cover @ weight):
            ends = basis.nodes_px[[i, j - 1]] + 2 * basis.spacing_px * np.array([-1, 1])
            found |= (places >= ends[0]) & (places <= ends[1])
    if not found.any():
        raise PhysicsError(
            "the frame shows no fringes of a pressure on the surface that its noise alone would "
            "not; is it loaded, and is the field (dark or bright) the scene's?"
        )
    return found


def _runs(on: Array, joined: Array) -> list[tuple[int, int]]:
    """First and one past the last index of runs of True whose members are joined."""
    linked = on[1:] & on[:-1] & joined
    firsts = np.flatnonzero(on & ~np.r_[False, linked])
    lasts = np.flatnonzero(on & ~np.r_[linked, False])
    return list(zip(firsts.tolist(), (lasts + 1).tolist(), strict=True))
