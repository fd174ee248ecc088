"""One stage of an inversion: some pixels, some nodes, and what they say of the tractions.

From the deep to the surface: the course by which tractions are found without a wrong branch.

Deep below the surface the field of any tractions is smooth, and depends on their resultants more
than on their shape, so that a model's fit that is wrong near the contact is right to a fraction of
a fringe there. Loads and bulk stress, a handful of numbers in which many starts cost little, are
searched first. The inversion begins with deep pixels and few, wide hats, and takes in shallower
pixels with narrower hats step by step: what is new at each step is predicted within the branch.
Then patches of pressure that noise alone explains are left out, and the rest is resolved finely.

Surface tractions from a frame's fringes: pressure and shear where no contact model fits.

Nothing is assumed of the bodies in contact but that the specimen is a half-plane whose surface is
pressed and rubbed, p(x) >= 0 and |q| <= m p, and that what its far sides add is smooth. The stress
follows from these, and so do the principal stresses apart. Warnings say where they may be wrong.
"""

from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import FrameData, Minimum
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.renderer import FringeOptics, scene_optics
from isochrome.fitting.frame_set import refuse_bent
from isochrome.fitting.tractions.traction_solver import (
    DEGREE,
    FRICTION_LIMIT,
    Basis,
    Bins,
    Solution,
    TractionProblem,
    discrepancy_strength,
    field_grid,
    lattice_px,
    make_basis,
    make_bins,
    picture_unit,
    pixel_field,
    scaled_modes,
    smoothness,
    solve_tractions,
)
from isochrome.messages import message, warnings_json
from isochrome.output import with_uncertainty
from isochrome.scene import Scene
from isochrome.simulation import scene_states
from isochrome.specimens import specimen_model
from isochrome.stress import (
    PixelGrid,
    RegularStress,
    StressComponents,
    components_on_grid,
    pixel_grid,
)

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
    hold = (_TOP_STEP_PX / _TOP_PRIOR_PX) ** 2 if free_top else 0.0
    weak, precise = strength is None, depth_px <= EDGE_PX
    solution = solve_tractions(
        problem, basis, smooth, c, hold=hold, steps=10, weak=weak, precise=precise
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
        free_top = setup.free_top and depth <= _MOVES_FROM * unit
        for _ in range(_MOVES):
            stage = solve_stage(
                setup, state, nodes, depth_px=depth, spacing_px=spacing, free_top=free_top
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
    return np.asarray(np.convolve(np.pad(values, spacing), hat / spacing, "same")[at + spacing])


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
    for load, bulk, *slopes in product(LOADS, BULK_MPA, *([SLOPES_MPA] * 2)):
        more = np.zeros(len(modes))
        more[0] = bulk
        more[1:3] = slopes[: len(modes) - 1]
        start = np.r_[load, first * load, modes + more]
        solution = solve_tractions(
            small, few, 1e-9 * np.eye(len(start)), start, steps=_STEPS, fine=False
        )
        result.append(Minimum(solution.unknowns, solution.chi))
    result.sort(key=lambda r: r.chi)
    selected: list[Minimum] = []
    for one in result:
        apart = (np.abs(one.values - other.values) for other in selected)
        far = (change[0] > 0.02 or change[2:].max() > 0.3 for change in apart)
        if all(far):
            selected.append(one)
    return selected


_BLOCK = 32
_FEW = 60
"""Bins in a block below which its chi is too uncertain."""

_LOCAL_CHI = 1.5
"""Chi of a block of 60 bins has a standard deviation of 0.09: this one is no noise."""

_NEARLY = 1.1
_SAME_LOAD = 0.005
_UNCERTAIN = 0.01
_LIMITED = 0.1


@dataclass(frozen=True)
class Measured:
    """A value with its standard uncertainty."""

    value: float
    standard_uncertainty: float


@dataclass(frozen=True, kw_only=True)
class Tractions:
    """What a frame says of its surface's tractions.

    `x_mm` (n,), nodes between which the tractions are linear, multiples of a step apart; they are
    zero a step beyond. `pressure_mpa`, `shear_mpa` (on the specimen, along +x) and their standard
    uncertainties (n,); `load_n`, `tangential_n`, the resultants; `regular`, the stress besides;
    `pixels`, the picture's place, its upper edge as found; `chi`, residual over noise;
    `regularisation`, the weight of ∫ p''² + q''² dx, mm³/MPa²; `warnings` in plain words;
    `lattice_mpa`, pressure and shear at nodes a pixel apart, see `field_grid`.
    """

    x_mm: Array
    pressure_mpa: Array
    pressure_standard_uncertainty_mpa: Array
    shear_mpa: Array
    shear_standard_uncertainty_mpa: Array
    load_n: Measured
    tangential_n: Measured
    regular: RegularStress
    pixels: PixelGrid
    chi: float
    regularisation: float
    warnings: tuple[str, ...]
    lattice_mpa: tuple[Array, Array]

    def to_json(self) -> dict[str, Any]:
        """The resultants and how sure they are, for the command's JSON."""
        return {
            "load_n": asdict(self.load_n),
            "tangential_n": asdict(self.tangential_n),
            "chi": self.chi,
            "top_mm": self.pixels.top_mm,
            "bulk_mpa": self.regular.series[0].real,
            "bulk_along_x_mpa_per_mm": self.regular.series[1].real,
            "bulk_along_z_mpa_per_mm": self.regular.series[1].imag,
            "regularisation_mm3_per_mpa2": self.regularisation,
            **warnings_json(self.warnings),
        }

    def sentence(self) -> str:
        """The resultants in one line."""
        parts = (("load_n", self.load_n), ("tangential_n", self.tangential_n))
        values = [
            f"{key} = {with_uncertainty(m.value, m.standard_uncertainty)}" for key, m in parts
        ]
        return f"{', '.join(values)}, chi = {self.chi:.3f}"

    def components(self) -> StressComponents:
        """All three stress components at every pixel (rows, cols), MPa; zero above the surface."""
        return components_on_grid(field_grid(self.pixels), *self.lattice_mpa, regular=self.regular)


def invert_tractions(
    data: FrameData, scene: Scene, *, others: tuple[Scene, ...] = (), free_top: bool = False
) -> Tractions:
    """Pressure and shear on the surface of a contact from one frame, without a contact model.

    Parameters: `data`; `scene`, one state, where the search starts, and which gives optics and
    pixels; `others`, where it starts again should it fail, such as the scene before it was fitted;
    `free_top`, whether the surface's place in the picture is found too (that along x goes into the
    tractions). Returns Tractions. Raises InputError where the scene is no contact, PhysicsError
    where the frame shows no load.
    """
    refuse_without_contact(scene)
    if scene.frames.stated_gamma != data.gamma:
        data = data.toned(scene.frames.stated_gamma)
    optics = scene_optics(scene)
    starts = [_start(one, data.shape) for one in (scene, *others)]
    stage, begun = invert(Setup(data, optics, free_top), starts)
    return _result(stage, begun, optics.thickness_mm)


def refuse_without_contact(scene: Scene) -> None:
    """Raise InputError where a scene has no contact on whose surface tractions could act."""
    if scene.indenter is None:
        raise InputError("tractions_act_surface_contact", name=scene.name)
    refuse_bent(scene, message("inverted_tractions_leave_out"))


def _start(scene: Scene, shape: tuple[int, int]) -> State:
    """The tractions of a scene's model, and the regular stress that the scene gives."""
    pixels = pixel_grid(scene, shape)
    surface = scene_states(scene)[-1].surface
    assert surface is not None
    places = pixels.left_mm + pixels.pixel_mm * lattice_px(pixels)
    pressure, shear = (
        np.interp(places, surface.grid.x_mm, traction, left=0.0, right=0.0)
        for traction in (surface.pressure_mpa, surface.shear_mpa)
    )
    series = specimen_model(scene).added_stress(scene, surface, pixels).series
    modes = []
    for mode in scaled_modes(pixels, DEGREE):
        unit = mode.series[-1]
        given = series[len(mode.series) - 1] if len(mode.series) <= len(series) else 0j
        modes.append((given * unit.conjugate()).real / abs(unit) ** 2)
    return State(pixels, pressure, shear, np.array(modes))


def _result(stage: Stage, begun: list[Stage], thickness_mm: float) -> Tractions:
    basis, solution, state = stage.basis, stage.solution, stage.state()
    pixels, n = state.pixels, basis.nodes
    pressure, shear = basis.tractions(solution.unknowns)
    to = basis.to_tractions
    spread = np.sqrt(np.diag(to @ stage.covariance(bound=False) @ to.T))
    cover = to @ stage.covariance(smooth=False) @ to.T
    width = basis.spacing_px * pixels.pixel_mm * thickness_mm
    load, tangential = (
        Measured(width * float(traction.sum()), width * float(np.sqrt(cover[part, part].sum())))
        for traction, part in ((pressure, slice(n)), (shear, slice(n, None)))
    )
    return Tractions(
        x_mm=pixels.left_mm + pixels.pixel_mm * basis.nodes_px, pressure_mpa=pressure,
        pressure_standard_uncertainty_mpa=spread[:n], shear_mpa=shear,
        shear_standard_uncertainty_mpa=spread[n:], load_n=load, tangential_n=tangential,
        regular=basis.regular(solution.unknowns), pixels=pixels, chi=solution.chi,
        regularisation=stage.strength,
        warnings=what_to_say(stage, begun, (load.value, load.standard_uncertainty)),
        lattice_mpa=(state.pressure, state.shear),
    )  # fmt: skip


def what_to_say(stage: Stage, begun: list[Stage], load: tuple[float, float]) -> tuple[str, ...]:
    """Warnings about an inversion.

    Parameters: `stage`, the last; `begun`, the first stages from all beginnings, the one that was
    followed first; `load`, the resultant and its standard uncertainty (N). Returns sentences.
    """
    result = []
    chi, worst = stage.solution.chi, local_chi(stage)
    if chi > GOOD_CHI:
        result.append(message("chi_no_tractions_half", chi=chi))
    elif worst > _LOCAL_CHI:
        result.append(message("chi_one_place_near", worst=worst))
    if not stage.solution.converged:
        result.append(message("inversion_did_not_converge"))
    rivals = [one for one in begun[1:] if one.solution.chi < _NEARLY * begun[0].solution.chi]
    if any(_differ(one, begun[0]) for one in rivals):
        result.append(message("other_resultants_explain_deep"))
    if load[1] > _UNCERTAIN * load[0]:
        result.append(message("load_determined_only_more", load=100 * load[1] / load[0]))
    return (*result, *_of_the_surface(stage))


def _of_the_surface(stage: Stage) -> list[str]:
    """What to say where the tractions touch their limits."""
    basis, c, pixels = stage.basis, stage.solution.unknowns, stage.problem.pixels
    pressure, shear = basis.tractions(c)
    result = []
    touching = np.abs(shear) > (1.0 - 1e-9) * basis.limit * pressure
    share = pressure[touching & (pressure > 0.0)].sum() / max(pressure.sum(), 1e-300)
    if share > _LIMITED:
        result.append(
            message("largest_friction_allowed_over", limit=basis.limit, share=100 * share)
        )
    reach = 2 * basis.spacing_px
    pressed = basis.nodes_px[pressure > 0.0]
    if len(pressed) and (pressed[0] < reach or pressed[-1] > pixels.cols - reach):
        result.append(message("pressure_reaches_picture_side"))
    return result


def _differ(one: Stage, other: Stage) -> bool:
    loads = [float(s.basis.tractions(s.solution.unknowns)[0].sum()) for s in (one, other)]
    return abs(loads[0] - loads[1]) > _SAME_LOAD * max(loads)


def local_chi(stage: Stage) -> float:
    """The largest chi of a block of 32 x 32 bins; 0 where no block has enough of them."""
    bins, unit = stage.problem.bins, picture_unit(stage.problem.pixels)
    size = _BLOCK * unit * bins.side
    place = np.stack([bins.side, bins.row // size, bins.col // size])
    block = np.unique(place, axis=1, return_inverse=True)[1].ravel()
    count = np.bincount(block)
    square = np.bincount(block, weights=np.square(stage.solution.residual))
    enough = count >= _FEW
    return float(np.sqrt((square[enough] / count[enough]).max())) if enough.any() else 0.0
