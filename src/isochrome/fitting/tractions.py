"""Surface tractions from a frame's fringes: pressure and shear where no contact model fits.

Nothing is assumed of the bodies in contact but that the specimen is a half-plane whose surface is
pressed and rubbed, p >= 0 and |q| <= m p, and that what its far sides add is smooth. Tractions are
linear between nodes: hats, whose stress is known in closed form. Inside Coulomb's cone the two of a
node are sums of two that cannot be negative, and both are a Gaussian process,

    p = a + b,  q = m (a - b),  a >= 0,  b >= 0,    -2 ln prior = s ∫ p''² + q''² dx,

whose s is the most probable one, s = (r - s tr(C K)) / c'Kc with the covariance C of the unknowns c
and the rank r of the integral c'Kc. It is the fit of a frame (`FarModel`) with the hats' amplitudes
behind its unknowns and the signs kept: each of its steps is a least-squares problem under them.

It begins with deep pixels and wide hats, where the field depends on the resultants more than on
their shape, and takes in shallower ones with narrower hats: what is new is within the branch then.
Sources: Lawson & Hanson (1974), Solving Least Squares Problems, chapter 23, for the signs; MacKay
(1992), Neural Computation 4, 415, for the evidence.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from math import sqrt
from typing import Any

import numpy as np

from isochrome.contact import ContactGrid, SurfaceState
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import ALIKE_CHI, Bounds, FrameData, LinearPart, Prior, damped
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.causes.blocks import block_sums
from isochrome.fitting.causes.modes import TractionModes
from isochrome.fitting.frame.far_model import FarModel
from isochrome.fitting.frame.frame_fit import hidden_px, is_seen, placed
from isochrome.fitting.frame.frame_model import FrameModel, LocalModel, RefinedFit, refine_fit
from isochrome.fitting.frame.renderer import scene_optics
from isochrome.fitting.frame.unknowns import (
    LENS,
    SMOOTH_KEYS,
    TOP,
    fit_region,
    free_keys,
    moved_scene,
    thinning,
    values_of,
)
from isochrome.fitting.search import Settled, search_frame
from isochrome.messages import message, warnings_json
from isochrome.output import with_uncertainty
from isochrome.scene import Scene
from isochrome.simulation import SceneState, scene_states
from isochrome.specimens import specimen_model
from isochrome.stress import PixelGrid, StressComponents, pixel_grid

FRICTION_LIMIT = 1.0
"""Largest |q|/p that is thought of: dry contacts of solids stay well below."""
_HATS, _STAGES = 4, 4
"""Hats in half of the contact's width, twice as many from stage to stage; none is narrower than a
pixel, and the shallowest pixels of all but the last stage lie twice as deep as they are wide."""
_PIXELS = 40_000
"""Pixels that are fitted, about: blocks of them in larger frames."""
_RIDGE = 1e-10
"""Added to a unit diagonal: rounding of fields in single precision."""
_SEEN = 4.0
"""Load of a patch over its standard uncertainty below which noise alone explains it."""
GOOD_CHI = 1.03
"""Residual over noise up to which a field describes a frame: the noise is known to 1 or 2 %."""
_STEADY, _UPDATES = 0.2, 6
"""Change of the smoothness's logarithm that changes nothing more, and how often it is found."""


@dataclass(frozen=True)
class Smoothness(Prior):
    """The prior of all unknowns (m,) with the weights `matrix` (m, m)."""

    matrix: Array

    @property
    def any(self) -> bool:
        """Always: what it alone tells apart is less than single precision resolves."""
        return True

    @property
    def normal(self) -> Array:
        """What is added to the normal equations, (m, m)."""
        return self.matrix

    def gradient(self, values: Array) -> Array:
        """What is added to their right side at some values, (m,)."""
        return np.asarray(-self.matrix @ values)

    def cost(self, values: Array) -> float:
        """The unknowns' part of -2 ln of the prior."""
        return float(values @ self.matrix @ values)


class TractionModel(FarModel):
    """A frame whose unknowns are `keys`, and hats' halves (a, b), at multiples of a spacing."""

    rest: RefinedFit

    def __init__(
        self,
        data: FrameData,
        scene: Scene,
        surface: SurfaceState,
        keys: tuple[str, ...],
        nodes_mm: Array,
        spacing_mm: float,
        *,
        hidden_px: float,
    ) -> None:
        """About a `scene` and its `surface`; no pixel is fitted above `hidden_px`."""
        pixels, side = pixel_grid(scene, data.shape), block_px(data)
        blocks = pixels.every(side)
        shown = data.valid & fit_region(scene, data.shape, 1, hidden_px)
        super().__init__(
            replace(data, valid=shown), scene, keys, np.ones((blocks.rows, blocks.cols), bool),
            stride=side, in_blocks=True, solve=lambda _: self._state,
        )  # fmt: skip
        first, last = (round(x / spacing_mm) for x in nodes_mm[[0, -1]])
        self.nodes_mm, self.spacing_mm = nodes_mm, spacing_mm
        self._every = spacing_mm * np.arange(first - 1, last + 2)
        self._at = np.rint(nodes_mm / spacing_mm).astype(int) - first + 1
        fine = round(spacing_mm / pixels.pixel_mm) * (len(self._every) - 1) + 1
        self._begun = replace(
            surface, grid=ContactGrid(float(self._every[0]), pixels.pixel_mm, fine),
            wear_depth_mm=np.zeros(fine), scar_edges_mm=surface.edges_mm,
        )  # fmt: skip
        hats = TractionModes(self._every, spacing_mm, 1.0, 1.0, 0.0).fields(blocks)
        press, shear = hats.reshape(2, -1, blocks.rows, blocks.cols)[:, self._at - 1]
        shear *= np.float32(FRICTION_LIMIT)
        self.fields = np.concatenate((press + shear, press - shear))
        self.slight = self.count
        pressure, across = (
            np.interp(nodes_mm, surface.grid.x_mm, part)
            for part in (surface.pressure_mpa, surface.shear_mpa / FRICTION_LIMIT)
        )
        halves = np.maximum(0.0, np.r_[0.5 * (pressure + across), 0.5 * (pressure - across)])
        self.start = np.r_[values_of(scene, keys), halves]
        self.limits = Bounds(
            np.r_[self.limits.low, np.zeros(self.count)],
            np.r_[self.limits.high, np.full(self.count, np.inf)],
        )
        # K of c'Kc = ∫ p''² + q''² dx over runs of nodes (m, m), (MPa/mm²)² mm; nothing is asked at
        # the ends of a run: the pressure of a contact leaves its edge steeply
        n, joined = len(nodes_mm), np.diff(self._at) == 1
        middle = np.flatnonzero(joined[1:] & joined[:-1]) + 1
        second = (np.eye(n, k=-1) - 2.0 * np.eye(n) + np.eye(n, k=1))[middle]
        square, m = second.T @ second / spacing_mm**3, FRICTION_LIMIT**2
        halves = np.kron([[1.0 + m, 1.0 - m], [1.0 - m, 1.0 + m]], square)
        self.curvature = np.pad(halves, (len(keys), 0))
        # at first a contact's own pressure, of ∫ p''² = 2 p_max²/half³ or so, is one deviation off
        half = 0.5 * (surface.edges_mm[1] - surface.edges_mm[0])
        self.smooth(0.5 * half**3 / surface.p_max_mpa**2)

    def smooth(self, strength: float) -> None:
        """Give the tractions a smoothness s."""
        self.strength = strength
        nothing = np.zeros(len(self.start))
        self.prior = Smoothness(nothing, nothing, strength * self.curvature)

    def tractions(self, values: Array) -> tuple[Array, Array]:
        """Pressure and shear (n,) of the unknowns, MPa."""
        a, b = values[len(self.keys) :].reshape(2, -1)
        return a + b, FRICTION_LIMIT * (a - b)

    def surface(self, values: Array) -> SurfaceState:
        """What acts on the surface, on nodes a pixel apart."""
        hats = np.zeros((2, len(self._every)))
        hats[:, self._at] = self.tractions(values)
        x = self._begun.grid.x_mm
        pressure, shear = (np.interp(x, self._every, part) for part in hats)
        return replace(self._begun, pressure_mpa=pressure, shear_mpa=shear)

    def signal(
        self, values: Array, *, visibility: Array | None = None, keys: tuple[str, ...] | None = None
    ) -> Array | None:
        """The signal at the pixels (n,) of all that acts on the surface."""
        self._put(values)
        return FrameModel.signal(self, values[: len(self.keys)], visibility=visibility)

    def linearise(self, values: Array, gamma_fit: LinearPart) -> LocalModel:
        """Derivatives at some values, where the linear solution is known."""
        self._put(values)
        self._stood = None  # the field has changed by more than the keys' values
        return super().linearise(values, gamma_fit)

    def _put(self, values: Array) -> None:
        """Make the renderer's contact that of some values."""
        self._state = SceneState("", 0.0, self.surface(values))
        self.renderer.forget()

    def step(self, local: LocalModel, values: Array, pull: Array, damping: float) -> Array:
        """The damped step that keeps the signs."""
        matrix = damped(local.normal, damping)
        return with_signs(matrix, matrix @ values + pull, len(self.keys)) - values

    @property
    def chi(self) -> float:
        """Residual over noise, where it came to rest."""
        return self.rest.chi

    @property
    def found_scene(self) -> Scene:
        """The scene with the values that were found."""
        return moved_scene(self.scene, self.keys, self.rest.values[: len(self.keys)])

    @property
    def free(self) -> Mask:
        """The unknowns (m,) that are not at their bound."""
        return np.asarray(self.rest.values > self.limits.low)

    def covariance(self, free: Mask) -> Array:
        """Covariance (m, m) of the unknowns that are `free`, widened by chi."""
        here = np.ix_(free, free)
        cover = np.zeros(free.shape * 2)
        cover[here] = np.linalg.inv(self.rest.local.normal[here])
        return cover * self.chi**2

    def patches(self) -> list[tuple[float, float]]:
        """Ends (mm) of what is pressed more than noise explains; PhysicsError: nothing is."""
        n, first, x = len(self.nodes_mm), len(self.keys), self.nodes_mm
        values, cover, beside = self.rest.values, self.covariance(self.free), 2.0 * self.spacing_mm
        result = []
        for i, j in node_runs(self.tractions(values)[0] > 0.0, x):
            weight = np.zeros(len(cover))
            weight[first:].reshape(2, n)[:, i:j] = 1.0
            if weight @ values > _SEEN * np.sqrt(weight @ cover @ weight):
                result.append((float(x[i] - beside), float(x[j - 1] + beside)))
        if not result:
            raise PhysicsError("frame_shows_no_fringes_pressure")
        return result

    def become_probable(self) -> None:
        """Come to rest with the tractions as smooth as is most probable."""
        for _ in range(_UPDATES):
            here = np.ix_(self.free, self.free)
            curvature, values = self.curvature[here], self.rest.values
            known = np.linalg.inv(self.rest.local.normal[here])
            directions = np.linalg.matrix_rank(curvature, hermitian=True)
            counted = directions - self.strength * float(np.sum(known * curvature))
            bent, before = float(values @ self.curvature @ values), self.strength
            self.smooth(self.rest.gamma_fit.noise * counted / bent if bent > 0.0 else before)
            again = refine_fit(self, values)
            assert again is not None
            self.rest = again
            if abs(np.log(self.strength / before)) < _STEADY:
                break


def block_px(data: FrameData) -> int:
    """Side of the blocks of pixels that are fitted, an odd number."""
    return thinning(data.light.size, _PIXELS) | 1


def with_signs(matrix: Array, right: Array, free: int) -> Array:
    """The c that minimises c^T M c / 2 - c^T b with all but its `free` first members >= 0."""
    from scipy.linalg import cholesky, solve_triangular
    from scipy.optimize import nnls

    back = np.linalg.solve(matrix[:free, :free], np.c_[matrix[:free, free:], right[:free]])
    reduced = matrix[free:, free:] - matrix[free:, :free] @ back[:, :-1]
    target = right[free:] - matrix[free:, :free] @ back[:, -1]
    scale = 1.0 / np.sqrt(np.diag(reduced))
    root = cholesky(reduced * np.outer(scale, scale) + _RIDGE * np.eye(len(scale)))
    outcome, _ = nnls(
        root, solve_triangular(root, scale * target, trans="T"), maxiter=30 * len(scale)
    )
    bound = scale * outcome
    return np.asarray(np.r_[back[:, -1] - back[:, :-1] @ bound, bound])


def invert(data: FrameData, scene: Scene, *, free_top: bool) -> TractionModel:
    """Tractions of a frame from a scene near it; PhysicsError: no light follows the fringes."""
    surface, pixels = scene_states(scene)[-1].surface, pixel_grid(scene, data.shape)
    assert surface is not None
    half = 0.5 * (surface.edges_mm[1] - surface.edges_mm[0])
    block, least = block_px(data) * pixels.pixel_mm, hidden_px(scene)
    patches = [(pixels.left_mm, pixels.left_mm + pixels.cols * pixels.pixel_mm)]
    for stage in range(_STAGES):
        spacing = block * max(1, round(half / (_HATS << stage) / block))
        first, last = (round(end / spacing) for end in (patches[0][0], patches[-1][1]))
        nodes = spacing * np.arange(first, last + 1)
        inside = np.any([(nodes >= i) & (nodes <= j) for i, j in patches], axis=0)
        depth = min(2.0 * spacing, 0.5 * pixels.z_mm[-1]) / pixels.pixel_mm
        # from afar the surface's place is told from bending by little
        keys = (*SMOOTH_KEYS, TOP) if free_top and stage else SMOOTH_KEYS
        model = TractionModel(
            data, scene, surface, keys, nodes[inside], spacing,
            hidden_px=least if stage == _STAGES - 1 else max(least, depth),
        )  # fmt: skip
        fit = model.settled(model.start, robust=False)
        if fit is None or not (fit.positive and is_seen(fit.gamma_fit)):
            raise PhysicsError("frame_shows_no_fringes")
        model.rest = fit
        patches, scene, surface = model.patches(), model.found_scene, model.surface(fit.values)
    model.become_probable()
    return model


def node_runs(on: Mask, x_mm: Array) -> list[tuple[int, int]]:
    """First and one past the last index of runs of True at places that are a step apart."""
    step = np.diff(x_mm)
    linked = on[1:] & on[:-1] & (step <= 1.5 * step.min(initial=np.inf))
    firsts = np.flatnonzero(on & ~np.r_[False, linked])
    lasts = np.flatnonzero(on & ~np.r_[linked, False])
    return list(zip(firsts.tolist(), (lasts + 1).tolist(), strict=True))


_LOCAL_PX, _FEW = 31, 60
"""Side of a square of blocks, and how many of these tell its chi well enough."""
_LOCAL_CHI = 1.5
"""Chi of 60 blocks has a standard deviation of 0.09: this one is no noise."""
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
    uncertainties (n,); `load_n`, `tangential_n`, the resultants; `scene`, with the smooth stress
    and the place as found, its contact that of the `surface`; `pixels`, the picture's; `chi`,
    residual over noise; `regularisation`, the weight of ∫ p''² dx, mm³/MPa²; `warnings` in plain
    words.
    """

    x_mm: Array
    pressure_mpa: Array
    pressure_standard_uncertainty_mpa: Array
    shear_mpa: Array
    shear_standard_uncertainty_mpa: Array
    load_n: Measured
    tangential_n: Measured
    scene: Scene
    surface: SurfaceState
    pixels: PixelGrid
    chi: float
    regularisation: float
    warnings: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """The resultants and how sure they are, for the command's JSON."""
        return {
            "load_n": asdict(self.load_n),
            "tangential_n": asdict(self.tangential_n),
            "chi": self.chi,
            "top_mm": self.pixels.top_mm,
            **{key.removeprefix("load."): self.scene.get(key) for key in SMOOTH_KEYS},
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

    def maps(self, stress: StressComponents) -> list[Array]:
        """sigma_1, sigma_2 (MPa) and the order at every pixel (rows, cols), NaN above the surface,
        of its `components`."""
        material = (self.pixels.z_mm >= (0.5 - 1e-6) * self.pixels.pixel_mm)[:, None]
        images = (*stress.principal, scene_optics(self.scene).order(stress.difference))
        return [np.where(material, image, np.nan).astype(np.float32) for image in images]

    def components(self) -> StressComponents:
        """All three stress components at every pixel (rows, cols), MPa; zero above the surface."""
        return specimen_model(self.scene).components(self.scene, self.surface, self.pixels)


def invert_tractions(data: FrameData, *scenes: Scene, free_top: bool = False) -> Tractions:
    """Pressure and shear on the surface of a contact from one frame, without a contact model.
    `scenes`, one state each, that may be near, the first one first: it gives optics, place and
    smooth stress; `free_top`, whether the surface's place in the picture is found too. InputError
    where a scene is no contact, PhysicsError where the frame shows no load.
    """
    searches = []
    for scene in scenes:
        refuse_without_contact(scene)
        searches.append(nearest_contacts(data, scene))
        if searches[-1][0].close:
            break
    search = min(searches, key=lambda one: one[0].chi)
    scene = search[0].scene
    data = data.as_fitted(scene)
    model = invert(data, scene, free_top=free_top)
    values, scene, n, m = model.rest.values, model.found_scene, len(model.nodes_mm), FRICTION_LIMIT
    pressure, shear = model.tractions(values)
    to = np.pad(np.kron([[1.0, 1.0], [m, -m]], np.eye(n)), ((0, 0), (len(model.keys), 0)))
    spread = np.sqrt(np.diag(to @ model.covariance(np.ones(len(values), bool)) @ to.T))
    cover = to @ model.covariance(model.free) @ to.T
    assert scene.specimen.thickness_mm is not None
    width = model.spacing_mm * scene.specimen.thickness_mm
    load, tangential = (
        Measured(width * float(traction.sum()), width * sqrt(cover[part, part].sum()))
        for traction, part in ((pressure, slice(n)), (shear, slice(n, None)))
    )
    return Tractions(
        x_mm=model.nodes_mm, pressure_mpa=pressure,
        pressure_standard_uncertainty_mpa=spread[:n], shear_mpa=shear,
        shear_standard_uncertainty_mpa=spread[n:], load_n=load, tangential_n=tangential,
        scene=scene, surface=model.surface(values), pixels=pixel_grid(scene, data.shape),
        chi=model.chi, regularisation=model.strength, warnings=what_to_say(model, search, load),
    )  # fmt: skip


def nearest_contacts(data: FrameData, scene: Scene) -> tuple[Settled, ...]:
    """What deep fringes may have come from: the scene's contact, and a smooth stress."""
    scene = placed(scene, data.shape)
    scene = scene.with_values({key: scene.get(key) or 0.0 for key in SMOOTH_KEYS})
    forces = [key for key in free_keys(scene) if key.split(".")[0] != "camera"]
    return search_frame(data, scene, (*forces, *SMOOTH_KEYS))


def refuse_without_contact(scene: Scene) -> None:
    """Raise InputError where a scene has no contact on whose surface tractions could act."""
    if scene.indenter is None:
        raise InputError("tractions_act_surface_contact", name=scene.name)
    for key in LENS:  # a camera that is not square is not in the model
        if scene.get(key):
            what = message("inverted_tractions_leave_out")
            raise InputError("such_frames_cannot", key=key, scene=scene.get(key), what=what)


def what_to_say(
    model: TractionModel, search: tuple[Settled, ...], load: Measured
) -> tuple[str, ...]:
    """Warnings about an inversion, from its last model, and from the search for its start."""
    result = []
    square = np.zeros(model.pixels.keep.shape, np.float32)
    square[model.pixels.keep] = np.square(model.rest.gamma_fit.residual)
    keep = model.pixels.keep.astype(np.float32)
    count, sums = (block_sums(part, _LOCAL_PX) for part in (keep, square))
    enough = count > _FEW - 0.5
    worst = float(np.sqrt((sums[enough] / count[enough]).max(initial=0.0)))
    if model.chi > GOOD_CHI:
        result.append(message("chi_no_tractions_half", chi=model.chi))
    elif worst > _LOCAL_CHI:
        result.append(message("chi_one_place_near", worst=worst))
    if not model.rest.converged:
        result.append(message("inversion_did_not_converge"))
    best, *others = search
    if any(one.positive and one.chi < ALIKE_CHI * best.chi for one in others):
        result.append(message("other_resultants_explain_deep"))
    unsure = load.standard_uncertainty / load.value
    if unsure > _UNCERTAIN:
        result.append(message("load_determined_only_more", load=100 * unsure))
    pressure, shear = model.tractions(model.rest.values)
    touching = np.abs(shear) > (1.0 - 1e-9) * FRICTION_LIMIT * pressure
    share = pressure[touching].sum() / pressure.sum()
    if share > _LIMITED:
        result.append(
            message("largest_friction_allowed_over", limit=FRICTION_LIMIT, share=100 * share)
        )
    pressed, reach = model.nodes_mm[pressure > 0.0], 2.0 * model.spacing_mm
    sides = pixel_grid(model.found_scene, model.renderer.shape).x_mm[[0, -1]]
    if pressed[0] < sides[0] + reach or pressed[-1] > sides[1] - reach:
        result.append(message("pressure_reaches_picture_side"))
    return tuple(result)
