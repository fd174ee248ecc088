"""From the deep to the surface: the course by which tractions are found without a wrong branch.

Deep below the surface the field of any tractions is smooth, and depends on their resultants more
than on their shape, so that a model's fit that is wrong near the contact is right to a fraction of
a fringe there. Loads and bulk stress, a handful of numbers in which many starts cost little, are
searched first. The inversion begins with deep pixels and few, wide hats, and takes in shallower
pixels with narrower hats step by step: what is new at each step is predicted within the branch.
Then patches of pressure that noise alone explains are left out, and the rest is resolved finely.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import Minimum
from isochrome.fitting.arrays import Array
from isochrome.fitting.tractions.traction_basis import Basis, lattice_px, make_basis, picture_unit
from isochrome.fitting.tractions.traction_solver import (
    TractionProblem,
    discrepancy_strength,
    smoothness,
    solve_tractions,
)
from isochrome.fitting.tractions.traction_stage import (
    EDGE_PX,
    Setup,
    Stage,
    State,
    solve_stage,
    state_bins,
)

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

LOADS = (0.8, 1.0, 1.25)
BULK_MPA = (-4.0, -2.0, 0.0, 2.0, 4.0)
SLOPES_MPA = (-2.0, 0.0, 2.0)
_BINS = 1500
_STEPS = 12


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
            stage = _course(setup, replace(first, pixels=place.pixels))
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
        raise PhysicsError("frame_shows_no_fringes")
    return _regularised(setup, stage), begun


def _begin(setup: Setup, start: State) -> list[Stage]:
    """The first stage, from each of the likeliest resultants, by rising chi."""
    depth_px, spacing = _coarse(start)[0]
    pixels = start.pixels
    lattice = lattice_px(pixels)
    nodes = lattice[::spacing]
    bins = state_bins(setup, start)
    depth = start.top_px + bins.row + 0.5
    some = bins.where(depth >= depth_px)
    basis = make_basis(some, pixels, nodes, spacing)
    problem = TractionProblem(some, pixels, setup.optics)
    pressure, shear = (
        _hat_means(t, nodes - lattice[0], spacing) for t in (start.pressure, start.shear)
    )
    smooth = smoothness(basis, pixels.pixel_mm)
    stages = []
    for one in search_resultants(problem, basis, pressure, shear, start.modes)[:_BEGINNINGS]:
        acting = shear if shear.any() else pressure
        press, rub, *modes = one.values
        c = basis.unknowns(press * pressure, rub * acting, np.array(modes))
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
    result: Array = np.convolve(np.pad(values, spacing), hat / spacing, "same")[at + spacing]
    return result


def _supported(stage: Stage) -> Array:
    """Where on `lattice_px` there is pressure that noise alone does not explain, and beside it."""
    basis, c, n = stage.basis, stage.solution.unknowns, stage.basis.nodes
    places, cover = lattice_px(stage.problem.pixels), stage.covariance()
    result = np.zeros(len(places), bool)
    for i, j in node_runs(basis.tractions(c)[0] > 0.0, np.diff(basis.nodes_px) == basis.spacing_px):
        weight = np.zeros(len(c))
        weight[i:j] = weight[n + i : n + j] = 1.0
        if weight @ c > _SEEN * np.sqrt(weight @ cover @ weight):
            ends = basis.nodes_px[[i, j - 1]] + 2 * basis.spacing_px * np.array([-1, 1])
            result |= (places >= ends[0]) & (places <= ends[1])
    if not result.any():
        raise PhysicsError("frame_shows_no_fringes_pressure")
    return result


def node_runs(on: Array, joined: Array) -> list[tuple[int, int]]:
    """First and one past the last index of runs of True whose members are joined."""
    linked = on[1:] & on[:-1] & joined
    firsts = np.flatnonzero(on & ~np.r_[False, linked])
    lasts = np.flatnonzero(on & ~np.r_[linked, False])
    return list(zip(firsts.tolist(), (lasts + 1).tolist(), strict=True))


@dataclass(frozen=True)
class _Few(Basis):
    """A basis of one pressure, one shear, and the regular modes."""

    @property
    def signed(self) -> int:
        """The pressure's factor alone has a sign."""
        return 1


def search_resultants(
    problem: TractionProblem, basis: Basis, pressure: Array, shear: Array, modes: Array
) -> list[Minimum]:
    """Minima of a few unknowns: the model's pressure and shear by a factor each, and bulk stress.

    Parameters: `problem`, deep bins; `basis` of them; `pressure`, `shear` (n,), the model's at the
    basis' nodes (MPa); `modes`, where they start. Returns distinct minima by rising chi: factors of
    the pressure and of the shear, and mode amplitudes.
    """
    thin = np.zeros(len(problem.bins.light), bool)
    thin[:: max(1, len(thin) // _BINS)] = True
    small = replace(problem, bins=problem.bins.where(thin))
    columns, n = basis.columns[thin], basis.nodes
    press = 0.5 * (columns[:, :n] + columns[:, n : 2 * n])
    tangent = 0.5 / basis.limit * (columns[:, :n] - columns[:, n : 2 * n])
    fields = [press @ pressure, tangent @ (shear if shear.any() else pressure)]
    few = _Few(
        np.concatenate([np.stack(fields, 1), columns[:, 2 * n :]], 1).astype(np.complex64),
        basis.nodes_px[:0], basis.spacing_px, basis.limit, basis.modes,
    )  # fmt: skip
    first = 1.0 if shear.any() else 0.0
    result: list[Minimum] = []
    for start in _starts(modes, first):
        solution = solve_tractions(
            small, few, 1e-9 * np.eye(len(start)), start, steps=_STEPS, fine=False
        )
        result.append(Minimum(solution.unknowns, solution.chi))
    result.sort(key=lambda r: r.chi)
    return _distinct(result)


def _starts(modes: Array, first: float) -> list[Array]:
    starts = []
    for load, bulk, *slopes in product(LOADS, BULK_MPA, *([SLOPES_MPA] * 2)):
        more = np.zeros(len(modes))
        more[0] = bulk
        more[1:3] = slopes[: len(modes) - 1]
        starts.append(np.r_[load, first * load, modes + more])
    return starts


def _distinct(found: list[Minimum]) -> list[Minimum]:
    selected: list[Minimum] = []
    for one in found:
        apart = (np.abs(one.values - other.values) for other in selected)
        far = (change[0] > 0.02 or change[2:].max() > 0.3 for change in apart)
        if all(far):
            selected.append(one)
    return selected
