"""Surface tractions from a frame's fringes: pressure and shear where no contact model fits.

Nothing is assumed of the bodies in contact but that the specimen is a half-plane whose surface is
pressed and rubbed, p >= 0 and |q| <= m p, and that what its far sides add is smooth. Tractions are
linear between nodes: hats, whose stress is known in closed form. Inside Coulomb's cone the two of a
node are sums of two that cannot be negative, and both are a Gaussian process,

    p = a + b,  q = m (a - b),  a >= 0,  b >= 0,    -2 ln prior = s ∫ p''² dx + t ∫ q''² dx,

whose s is the most probable one, s = (r - s tr(C K)) / c'Kc with the covariance C of the unknowns c
and the rank r of the integral c'Kc, and so is t. The stress is linear in all of it, and the fit is
a frame's (`FarModel`) with the signs kept: each of its steps is a least-squares problem under them.

It begins with deep pixels and wide hats, where the field depends on the resultants more than on
their shape, and takes in shallower ones with narrower hats: what is new is within the branch then.
Sources: Lawson & Hanson (1974), Solving Least Squares Problems, chapter 23, for the signs; MacKay
(1992), Neural Computation 4, 415, for the evidence.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import product
from math import sqrt
from typing import Any

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import Bounds, FrameData, PixelLight, Prior, damped, linear_costs
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.frame.far_model import FAR, FarModel
from isochrome.fitting.frame.frame_model import (
    GammaFit,
    LocalModel,
    Pixels,
    RefinedFit,
    local_model,
    refine_fit,
)
from isochrome.fitting.frame.renderer import scene_optics
from isochrome.fitting.frame_set import refuse_bent
from isochrome.messages import message, warnings_json
from isochrome.optics import slope_visibility
from isochrome.output import with_uncertainty
from isochrome.scene import Scene
from isochrome.simulation import scene_states
from isochrome.specimens import specimen_model
from isochrome.stress import (
    FieldGrid,
    PixelGrid,
    RegularStress,
    StressComponents,
    cauchy_of_hat,
    components_on_grid,
    make_field_grid,
    pixel_grid,
    regular_modes,
    stress_difference,
)

FRICTION_LIMIT = 1.0
"""Largest |q|/p that is thought of: dry contacts of solids stay well below."""
_DEGREE = 2
"""Degree of the regular stress: uniform, its slopes, and the next terms of far sides."""
_HALF_WIDTH = 30.0
"""Finest hats in half of the contact's width: narrower ones than a pixel are none."""
_SPACINGS = (16, 8, 4, 2, 1, 1)
"""Hats of the stages, in finest ones; the shallowest pixels lie twice as deep as these are wide."""
_DEEPEST = 0.5
"""The same at most, of the depth in view."""
_EDGE_PX = 2.0
"""Rows nearer to the surface than this are not used: the camera's edge, and what a rim reflects."""
_SIDES, _DEEP, _FLAT = (3, 9), 8.0, 0.1
"""Sides of blocks of pixels that stand for theirs, the depth over their side from which they may,
and the largest slope of the order, fringes a block."""
_LARGEST_SHIFT = 0.02
"""Largest shift of the order that is believed, fringes: at N = 0 its Laplacian has a pole."""
_WEAK = 1e-7
"""Smoothness that changes nothing, of the data's own weight."""
_RIDGE = 1e-10
"""Added to a unit diagonal: rounding of fields in single precision."""
_SMALL = 1e-3
"""Fringes by which an order is changed."""
_TOP_PRIOR_PX, _STILL_PX, _MOVES = 2.0, 0.02, 4
"""How far the surface's place is let go in a stage, and what it moves when it is at rest."""
_SEEN = 4.0
"""Load of a patch over its standard uncertainty below which noise alone explains it."""
GOOD_CHI = 1.03
"""Residual over noise up to which a field describes a frame: the noise is known to 1 or 2 %."""
_STEADY, _UPDATES = 0.2, 6
"""Change of the smoothness's logarithm that changes nothing more, and how often it is found."""
_LOADS, _HOP, _HOPS = (0.8, 1.0, 1.25), 0.5, 3
"""Loads over a start's that are scanned, and smooth stresses about it, fringes at the rim."""
_SCAN_PIXELS, _OTHERS = 500, 2
"""Pixels of that scan, and how many of its best places are begun from besides the start."""
_MOSTLY = 0.95
"""Share of the pixels in which a field's fringes are brighter than the noise."""


@dataclass(frozen=True)
class State:
    """What is known so far: the picture's place, tractions on its `lattice_px` (n,), modes.

    `finest`, the width of the finest hats in pixels.
    """

    pixels: PixelGrid
    finest: int
    pressure: Array
    shear: Array
    modes: Array

    def with_tractions_of(self, other: State) -> State:
        """The place of this one, and what the other has in the same pixels."""
        here, there = (lattice_px(s.pixels, s.finest) for s in (self, other))
        pressure, shear = (
            np.interp(here, there, t, 0.0, 0.0) for t in (other.pressure, other.shear)
        )
        return State(self.pixels, self.finest, pressure, shear, other.modes)


def state_of(scene: Scene, shape: tuple[int, int]) -> State:
    """The tractions of a scene's model, and the regular stress that the scene gives."""
    pixels, surface = pixel_grid(scene, shape), scene_states(scene)[-1].surface
    assert surface is not None
    left, right = surface.edges_mm
    finest = max(1, round(0.5 * (right - left) / pixels.pixel_mm / _HALF_WIDTH))
    places = pixels.left_mm + pixels.pixel_mm * lattice_px(pixels, finest)
    pressure, shear = (
        np.interp(places, surface.grid.x_mm, traction, left=0.0, right=0.0)
        for traction in (surface.pressure_mpa, surface.shear_mpa)
    )
    series = specimen_model(scene).added_stress(scene, surface, pixels).series
    modes = []
    for mode in scaled_modes(pixels):
        unit = mode.series[-1]
        given = series[len(mode.series) - 1] if len(mode.series) <= len(series) else 0j
        modes.append((given * unit.conjugate()).real / abs(unit) ** 2)
    return State(pixels, finest, pressure, shear, np.array(modes))


def scaled_modes(pixels: PixelGrid) -> tuple[RegularStress, ...]:
    """Regular stresses, each about 1 MPa at the picture's rim."""
    length = 0.5 * pixels.pixel_mm * max(pixels.rows, pixels.cols)
    modes = regular_modes(_DEGREE)
    return tuple(mode.times(length ** -(len(mode.series) - 1.0)) for mode in modes)


def lattice_px(pixels: PixelGrid, finest: int) -> Array:
    """Nodes a pixel apart, in pixels from the picture's left edge, beyond the widest hats' ends."""
    widest = _SPACINGS[0] * finest
    return np.arange(-widest, (-(-pixels.cols // widest) + 1) * widest + 1)


@lru_cache(maxsize=2)
def field_grid(pixels: PixelGrid, finest: int) -> FieldGrid:
    """Kernels from the lattice of `lattice_px` to the pixels; the last two are kept."""
    places = lattice_px(pixels, finest)
    left = pixels.left_mm + float(places[0]) * pixels.pixel_mm
    return make_field_grid(pixels, left_mm=left, spacing_mm=pixels.pixel_mm, nodes=len(places))


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


@dataclass(frozen=True)
class _Seen:
    """What pixels see of some `values`: the `field`, the `shift` of its order and what is `shown`
    of its fringes (n,), and how it changes a pixel `lower`, where that is asked."""

    values: Array
    field: Array
    shift: Array
    shown: Array
    lower: Array | None


class TractionModel(FarModel):
    """A frame whose unknowns are hats' halves (a, b), regular modes, and, if `free_top`, by how
    many pixels the surface lies higher.

    `nodes_px` (n,), multiples of `spacing_px`, from the picture's left edge.
    """

    def __init__(
        self,
        data: FrameData,
        scene: Scene,
        state: State,
        nodes_px: Array,
        spacing_px: int,
        *,
        depth_px: float,
        free_top: bool,
    ) -> None:
        """On the pixels below some depth; deep ones stand for blocks as large as a state allows."""
        self.optics, self.place, self.finest = scene_optics(scene), state.pixels, state.finest
        self.nodes_px, self.spacing_px, self.free_top = nodes_px, spacing_px, free_top
        self.modes, self.lattice = scaled_modes(state.pixels), lattice_px(state.pixels, self.finest)
        depth = state.pixels.z_mm / state.pixels.pixel_mm
        smooth = (np.broadcast_to(m.difference(*self.place.places), data.shape) for m in self.modes)
        self._smooth = np.array(list(smooth), np.complex64)
        below = depth >= depth_px + 2.0 * self.optics.blur_px
        data = replace(data, valid=data.valid & below[:, None])
        super().__init__(data, scene, (), np.ones(data.shape, bool))
        slopes = np.gradient(self.optics.order(self._field(state)))
        self.pixels, self.side = thinned(data, depth, np.max(np.abs(slopes), axis=0))
        self._root = np.ones(self.pixels.size, np.float32)
        self.columns = self._columns()
        self.curvatures, count = self._curvatures(), len(self.columns) + free_top
        self.limits = Bounds(
            np.where(np.arange(count) < self.signed, 0.0, -np.inf), np.full(count, np.inf)
        )
        self._seen: _Seen | None = None
        self.smooth((0.0, 0.0))

    @property
    def signed(self) -> int:
        """How many unknowns, the first ones, cannot be negative."""
        return 2 * len(self.nodes_px)

    def smooth(self, strengths: tuple[float, float]) -> None:
        """Give the pressure and the shear a smoothness s each."""
        self.strengths = strengths
        matrix = np.tensordot(strengths, self.curvatures, 1)
        if self.free_top:
            matrix[-1, -1] = _TOP_PRIOR_PX**-2.0
        self.prior = Smoothness(np.zeros(len(matrix)), np.zeros(len(matrix)), matrix)

    def tractions(self, values: Array) -> tuple[Array, Array]:
        """Pressure and shear (n,) of the unknowns, MPa."""
        a, b = values[: self.signed].reshape(2, -1)
        return a + b, FRICTION_LIMIT * (a - b)

    def begun(self, state: State) -> Array:
        """The unknowns nearest to a state."""
        at = self.nodes_px - self.lattice[0]
        pressure, shear = state.pressure[at], state.shear[at] / FRICTION_LIMIT
        halves = np.maximum(0.0, np.r_[0.5 * (pressure + shear), 0.5 * (pressure - shear)])
        return np.asarray(np.r_[halves, state.modes, np.zeros(int(self.free_top))])

    def state(self, values: Array) -> State:
        """What some values say."""
        moved = float(values[-1]) if self.free_top else 0.0
        place = replace(self.place, top_mm=self.place.top_mm + moved * self.place.pixel_mm)
        wide = self.lattice[:: self.spacing_px]
        at = (self.nodes_px - wide[0]) // self.spacing_px
        hats = np.zeros((2, len(wide)))
        hats[:, at] = self.tractions(values)
        pressure, shear = (np.interp(self.lattice, wide, part) for part in hats)
        modes = values[self.signed :][: len(self.modes)]
        return State(place, self.finest, pressure, shear, modes)

    def regular(self, modes: Array) -> RegularStress:
        """The regular stress of the modes' amplitudes."""
        total = RegularStress()
        for mode, amplitude in zip(self.modes, modes, strict=True):
            total = total + mode.times(float(amplitude))
        return total

    def _field(self, state: State) -> Array:
        """The stress difference (rows, cols), MPa."""
        made = stress_difference(field_grid(self.place, self.finest), state.pressure, state.shear)
        return made + np.tensordot(state.modes.astype(np.float32), self._smooth, 1)

    def signal(
        self, values: Array, *, visibility: Array | None = None, keys: tuple[str, ...] | None = None
    ) -> Array | None:
        """The signal at the pixels (n,).

        The mean of cos 2 pi N over a square of side b and a Gaussian of width w, in which N has
        slopes g and the Laplacian L, is that of N + (b²/24 + w²/2) L, times sinc(b g_x) sinc(b g_z)
        exp(-2 (pi w)² (g_x² + g_z²)).
        """
        keep, side, blur = self.pixels.keep, self.side, self.optics.blur_px
        field, lower = self._field(self.state(values)), None
        if self.free_top:
            change = np.gradient(field, axis=0)
            field, lower = field + np.float32(values[-1]) * change, change[keep]
        order = self.optics.order(field).astype(np.float32)
        slopes: list[Array] = list(np.gradient(order))
        bends: list[Array] = [np.gradient(slope, axis=k) for k, slope in enumerate(slopes)]
        bent = sum(bend[keep] for bend in bends)
        down, across = (slope[keep] for slope in slopes)
        shown = slope_visibility(side * across, side * down)
        shown *= np.exp(np.float32(-2.0 * (np.pi * blur) ** 2) * (across**2 + down**2))
        shift = (side**2 / np.float32(24.0) + np.float32(0.5 * blur**2)) * bent
        shift = np.clip(shift, -_LARGEST_SHIFT, _LARGEST_SHIFT)
        self._seen = _Seen(values, field[keep], shift, shown, lower)
        return self._of(self._seen, 0.0)

    def _of(self, seen: _Seen, added: complex) -> Array:
        """The signal (n,) of a field that is larger by some MPa."""
        field = seen.field + np.complex64(added)
        order = self.optics.order(field) + seen.shift
        return np.asarray(self.optics.signal(field, order=order, visibility=seen.shown), np.float32)

    def linearise(self, values: Array, gamma_fit: GammaFit) -> LocalModel:
        """Derivatives at some values, where the linear solution is known."""
        if self._seen is None or not np.array_equal(self._seen.values, values):
            self.signal(values)
        seen, step = self._seen, _SMALL / self.optics.order_per_mpa
        assert seen is not None
        gain = gamma_fit.part.amplitude / np.float32(2.0 * step)
        along, turned = (
            gain * (self._of(seen, unit * step) - self._of(seen, -unit * step)) for unit in (1, 1j)
        )
        columns = self.columns if seen.lower is None else (*self.columns, seen.lower)
        rows = np.empty((len(columns), self.pixels.size), np.float32)
        for row, column in zip(rows, columns, strict=True):
            row[:] = along * column.real + turned * column.imag
        return local_model(tuple(map(str, range(len(rows)))), values, gamma_fit, rows, self.prior)

    def step(self, local: LocalModel, values: Array, pull: Array, damping: float) -> Array:
        """The damped step that keeps the signs."""
        matrix = damped(local.normal, damping)
        return with_signs(matrix, matrix @ values + pull, self.signed) - values

    def _columns(self) -> Array:
        """Stress difference (m, pixels) of unit unknowns, complex64.

        It depends on the depth and on the distance along the surface alone, and these take few
        values: a table of them is looked up.
        """
        row, col = np.nonzero(self.pixels.keep)
        pixel, n = self.place.pixel_mm, len(self.nodes_px)
        used, at = np.unique(row, return_inverse=True)
        steps = (col - self.nodes_px[:, None]).astype(np.int32)
        first = int(steps.min())
        x = pixel * (np.arange(first, int(steps.max()) + 1) + 0.5)
        z = self.place.z_mm[used][:, None]
        one, two = cauchy_of_hat(x[None, :], z, self.spacing_px * pixel)
        press = (-2.0 / np.pi * z * two).astype(np.complex64)
        shear = FRICTION_LIMIT * (1j * press - (2.0 / np.pi * one).astype(np.complex64))
        where = at.astype(np.int32) * len(x) + (steps - first)
        columns = np.empty((2 * n + len(self.modes), len(row)), np.complex64)
        for part, table in ((columns[:n], press + shear), (columns[n : 2 * n], press - shear)):
            np.take(table.ravel(), where, out=part)
        columns[2 * n :] = self._smooth[:, self.pixels.keep]
        return columns

    def _curvatures(self) -> Array:
        """K of c'Kc = ∫ p''² dx, and ∫ q''² dx, over runs of nodes (2, m, m), (MPa/mm²)² mm.

        Nothing is asked at the ends of a run: the pressure of a contact leaves its edge steeply.
        """
        h, n = self.spacing_px * self.place.pixel_mm, len(self.nodes_px)
        joined = np.diff(self.nodes_px) == self.spacing_px
        middle = np.flatnonzero(joined[1:] & joined[:-1]) + 1
        second = (np.eye(n, k=-1) - 2.0 * np.eye(n) + np.eye(n, k=1))[middle]
        square = second.T @ second / h**3
        more = len(self.columns) + self.free_top - 2 * n
        signs = np.ones((2, 2)), FRICTION_LIMIT**2 * np.array([[1.0, -1.0], [-1.0, 1.0]])
        return np.array([np.pad(np.kron(sign, square), (0, more)) for sign in signs])


def thinned(data: FrameData, depth_px: Array, slope: Array) -> tuple[Pixels, Array]:
    """A frame's valid pixels, deep ones as the means of blocks, and the sides of these (n,).

    A block stands in its middle. `depth_px` (rows,), of the pixels' middles below the surface;
    `slope` (rows, cols), fringes a pixel.
    """
    from scipy.ndimage import minimum_filter

    side = np.ones(data.shape, int)
    for b in _SIDES:
        may = (slope * b < _FLAT) & (depth_px >= _DEEP * b)[:, None] & data.valid
        middles = minimum_filter(may, b, mode="constant")[::b, ::b]
        row, col = ((np.arange(n) + b // 2) // b for n in data.shape)
        full = np.pad(middles, ((0, 1), (0, 1)))[np.ix_(row, col)]
        side[full] = b
    keep = data.valid & (side == 1)
    images = [data.raw.astype(np.float32), data.raw_sigma.astype(np.float32)]
    for b in _SIDES:
        blocks = data.in_blocks(b)
        middles = (side == b)[::b, ::b]
        keep[::b, ::b] |= middles
        for image, part in zip(images, (blocks.raw, blocks.raw_sigma), strict=True):
            image[::b, ::b][middles] = part[middles]
    raw, sigma = (image[keep] for image in images)
    pixels = Pixels(raw, 1.0 / sigma, PixelLight(data.lamp, keep), data.gamma)
    return pixels, side[keep].astype(np.float32)


def with_signs(matrix: Array, right: Array, signed: int) -> Array:
    """The c that minimises c^T M c / 2 - c^T b with its first `signed` members >= 0.

    M (m, m) is positive definite, b (m,). Source: see the module.
    """
    from scipy.linalg import cholesky, solve_triangular
    from scipy.optimize import nnls

    free = slice(signed, None)
    back = np.linalg.solve(matrix[free, free], np.c_[matrix[free, :signed], right[free]])
    reduced = matrix[:signed, :signed] - matrix[:signed, free] @ back[:, :-1]
    target = right[:signed] - matrix[:signed, free] @ back[:, -1]
    scale = 1.0 / np.sqrt(np.diag(reduced))
    scaled = reduced * np.outer(scale, scale) + _RIDGE * np.eye(signed)
    root = cholesky(scaled)
    outcome, _ = nnls(root, solve_triangular(root, scale * target, trans="T"), maxiter=30 * signed)
    bound = scale * outcome
    return np.asarray(np.r_[bound, back[:, -1] - back[:, :-1] @ bound])


@dataclass(frozen=True)
class Stage:
    """Where a model came to rest."""

    model: TractionModel
    fit: RefinedFit

    @property
    def chi(self) -> float:
        """Residual over noise."""
        return self.fit.chi

    @property
    def moved_px(self) -> float:
        """How far the picture has moved down along the specimen, pixels."""
        return float(self.fit.values[-1]) if self.model.free_top else 0.0

    @property
    def state(self) -> State:
        """What it has found."""
        return self.model.state(self.fit.values)

    def covariance(self, *, bound: bool = True) -> Array:
        """Covariance (m, m) of the unknowns, widened by chi.

        `bound`: zero for unknowns at their bound, or (False) as if nothing were.
        """
        free = (self.fit.values > self.model.limits.low) | (not bound)
        here = np.ix_(free, free)
        cover = np.zeros(free.shape * 2)
        cover[here] = np.linalg.inv(self.fit.local.normal[here])
        return cover * self.chi**2

    def supported(self) -> Array:
        """The lattice's nodes where there is pressure that noise alone does not explain, and beside
        them. PhysicsError where there are none.
        """
        model, n = self.model, len(self.model.nodes_px)
        cover, step = self.covariance(), model.spacing_px
        result = np.zeros(len(model.lattice), bool)
        pressed = model.tractions(self.fit.values)[0] > 0.0
        for i, j in node_runs(pressed, np.diff(model.nodes_px) == step):
            weight = np.zeros(len(cover))
            weight[i:j] = weight[n + i : n + j] = 1.0
            if weight @ self.fit.values > _SEEN * np.sqrt(weight @ cover @ weight):
                ends = model.nodes_px[[i, j - 1]] + 2 * step * np.array([-1, 1])
                result |= (model.lattice >= ends[0]) & (model.lattice <= ends[1])
        if not result.any():
            raise PhysicsError("frame_shows_no_fringes_pressure")
        return model.lattice[result]

    def probable(self) -> Stage:
        """The same with the tractions as smooth as is most probable."""
        stage = self
        for _ in range(_UPDATES):
            model, fit = stage.model, stage.fit
            free = fit.values > model.limits.low
            here = np.ix_(free, free)
            known = np.linalg.inv(fit.local.normal[here])
            new = []
            for before, curvature in zip(model.strengths, model.curvatures, strict=True):
                directions = np.linalg.matrix_rank(curvature[here], hermitian=True)
                counted = directions - before * float(np.sum(known * curvature[here]))
                bent = float(fit.values @ curvature @ fit.values)
                new.append(fit.gamma_fit.noise * counted / bent if bent > 0.0 else before)
            change = np.abs(np.log(np.array(new) / model.strengths)).max()
            model.smooth((new[0], new[1]))
            again = refine_fit(model, fit.values)
            assert again is not None
            stage = Stage(model, again)
            if change < _STEADY:
                break
        return stage


def stage_model(
    data: FrameData,
    scene: Scene,
    state: State,
    spacing: int,
    *,
    support: Array | None = None,
    free_top: bool = False,
) -> TractionModel:
    """Hats as wide as so many of the finest, on the lattice's `support` if given, and the pixels
    that are deep enough for them."""
    wide = spacing * state.finest
    nodes = lattice_px(state.pixels, state.finest)[::wide]
    if support is not None:
        nodes = nodes[np.isin(nodes, support)]
    deepest = state.pixels.z_mm[-1] / state.pixels.pixel_mm
    depth = min(2.0 * wide, _DEEPEST * deepest) if spacing > 1 else _EDGE_PX
    return TractionModel(data, scene, state, nodes, wide, depth_px=depth, free_top=free_top)


def settle_stage(model: TractionModel, state: State) -> Stage:
    """Where a model comes to rest from a state, its tractions hardly smoothed."""
    start = model.begun(state)
    here = model.at(start)
    assert here is not None
    weight = _WEAK * float(np.sum(model.linearise(start, here).squares))
    least = weight / max(float(np.trace(model.curvatures.sum(axis=0))), 1e-300)
    model.smooth((least, least))
    fit = model.settled(start, robust=False)
    assert fit is not None
    return Stage(model, fit)


def beginnings(data: FrameData, scene: Scene, start: State) -> list[Stage]:
    """First stages from a start and from the likeliest other resultants, by rising chi.

    Deep below the surface a load and a smooth stress, a handful of numbers, are nearly all there
    is: many of them are held against a few pixels.
    """
    model = stage_model(data, scene, start, _SPACINGS[0])
    values, split = model.begun(start), model.signed
    some = slice(None, None, max(1, model.pixels.size // _SCAN_PIXELS))
    pressed, smooth = values[:split] @ model.columns[:split, some], model.columns[split:, some]
    hops = np.arange(-_HOPS, _HOPS + 1) * _HOP / model.optics.order_per_mpa
    places = np.array(list(product(_LOADS, *[hops] * 3)))
    modes = np.tile(start.modes, (len(places), 1))
    modes[:, :3] += places[:, 1:]
    signals = model.optics.signal((places[:, :1] * pressed + modes @ smooth).astype(np.complex64))
    problem = model.pixels.as_stored
    lit, dark = problem.columns
    costs, light = linear_costs(
        lit[:, some], dark[:, some], problem.data[None, some], signals.astype(np.float32)
    )
    chosen: list[int] = []
    for k in np.argsort(np.where(light > 0.0, costs, np.inf)[:, 0], kind="stable").tolist():
        apart = np.abs(places[chosen, 1:] - places[k, 1:]).max(axis=1, initial=0.0)
        if len(chosen) < _OTHERS and np.all(apart > 1.5 * (hops[1] - hops[0])):
            chosen.append(k)
    others = [
        replace(start, pressure=load * start.pressure, shear=load * start.shear, modes=modes[k])
        for k, load in zip(chosen, places[chosen, 0], strict=True)
    ]
    stages = [settle_stage(model, start)]
    stages += [settle_stage(stage_model(data, scene, one, _SPACINGS[0]), one) for one in others]
    return sorted(stages, key=lambda stage: stage.chi)


def course(data: FrameData, scene: Scene, stage: Stage, *, free_top: bool) -> Stage:
    """The last stage, all others before it; PhysicsError where no light follows the fringes.

    Where the surface's place is free each stage is gone again from where that has moved to.
    """
    support: Array | None = None
    for spacing in _SPACINGS[1:]:
        near = free_top and spacing < _SPACINGS[1]  # from afar it is told from bending by little
        for _ in range(_MOVES):
            state = stage.state
            model = stage_model(data, scene, state, spacing, support=support, free_top=near)
            stage = settle_stage(model, state)
            if abs(stage.moved_px) < (_STILL_PX if spacing == 1 else 10.0 * _STILL_PX):
                break
        support = stage.supported()
    bright = stage.fit.gamma_fit.part.amplitude > stage.model.side
    if float(np.mean(bright)) < _MOSTLY:
        raise PhysicsError("frame_shows_no_fringes")
    return stage


def invert(
    data: FrameData, scene: Scene, starts: Iterable[State], *, free_top: bool
) -> tuple[Stage, list[Stage]]:
    """Tractions of a frame: the best last Stage, and the first ones from its start by rising chi.

    Where a start explains no deep fringes another is tried, and so where its end is not the noise.
    """
    begun: list[list[Stage]] = []
    for start in starts:
        begun.append(beginnings(data, scene, start))
        if begun[-1][0].chi ** 2 < FAR:
            break
    ends: list[tuple[Stage, list[Stage]]] = []
    for first in sorted(begun, key=lambda stages: stages[0].chi):
        ends.append((course(data, scene, first[0], free_top=free_top), first))
        if ends[-1][0].chi < GOOD_CHI:
            break
    stage, first = min(ends, key=lambda end: end[0].chi)
    return stage.probable(), first


def node_runs(on: Mask, joined: Mask) -> list[tuple[int, int]]:
    """First and one past the last index of runs of True whose members are joined."""
    linked = on[1:] & on[:-1] & joined
    firsts = np.flatnonzero(on & ~np.r_[False, linked])
    lasts = np.flatnonzero(on & ~np.r_[linked, False])
    return list(zip(firsts.tolist(), (lasts + 1).tolist(), strict=True))


_BLOCK_PX, _FEW = 32, 60
"""Side of a block, and its pixels below which its chi is too uncertain."""
_LOCAL_CHI = 1.5
"""Chi of a block of 60 pixels has a standard deviation of 0.09: this one is no noise."""
_NEARLY, _SAME_LOAD = 1.1, 0.005
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
    `regularisation`, the weight of ∫ p''² dx, mm³/MPa²; `warnings` in plain words;
    `lattice_mpa`, pressure and shear at nodes a pixel apart, see `field_grid`, with `finest`.
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
    finest: int

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
        grid = field_grid(self.pixels, self.finest)
        return components_on_grid(grid, *self.lattice_mpa, regular=self.regular)


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
    start = state_of(scene, data.shape)
    starts = (start, *(start.with_tractions_of(state_of(one, data.shape)) for one in others))
    stage, first = invert(data, scene, starts, free_top=free_top)
    return _result(stage, first)


def refuse_without_contact(scene: Scene) -> None:
    """Raise InputError where a scene has no contact on whose surface tractions could act."""
    if scene.indenter is None:
        raise InputError("tractions_act_surface_contact", name=scene.name)
    refuse_bent(scene, message("inverted_tractions_leave_out"))


def _result(stage: Stage, first: list[Stage]) -> Tractions:
    model, values, state = stage.model, stage.fit.values, stage.state
    pixels, n = state.pixels, len(model.nodes_px)
    pressure, shear = model.tractions(values)
    m = FRICTION_LIMIT
    to = np.kron([[1.0, 1.0], [m, -m]], np.eye(n))
    spread = np.sqrt(np.diag(to @ stage.covariance(bound=False)[: 2 * n, : 2 * n] @ to.T))
    cover = to @ stage.covariance()[: 2 * n, : 2 * n] @ to.T
    width = model.spacing_px * pixels.pixel_mm * model.optics.thickness_mm
    load, tangential = (
        Measured(width * float(traction.sum()), width * sqrt(cover[part, part].sum()))
        for traction, part in ((pressure, slice(n)), (shear, slice(n, None)))
    )
    return Tractions(
        x_mm=pixels.left_mm + pixels.pixel_mm * model.nodes_px, pressure_mpa=pressure,
        pressure_standard_uncertainty_mpa=spread[:n], shear_mpa=shear,
        shear_standard_uncertainty_mpa=spread[n:], load_n=load, tangential_n=tangential,
        regular=model.regular(state.modes), pixels=pixels, chi=stage.chi,
        regularisation=model.strengths[0], warnings=what_to_say(stage, first, load),
        lattice_mpa=(state.pressure, state.shear), finest=state.finest,
    )  # fmt: skip


def what_to_say(stage: Stage, first: list[Stage], load: Measured) -> tuple[str, ...]:
    """Warnings about an inversion, from its last stage and its first ones by rising chi."""
    result = []
    worst, unsure = local_chi(stage), load.standard_uncertainty / load.value
    if stage.chi > GOOD_CHI:
        result.append(message("chi_no_tractions_half", chi=stage.chi))
    elif worst > _LOCAL_CHI:
        result.append(message("chi_one_place_near", worst=worst))
    if not stage.fit.converged:
        result.append(message("inversion_did_not_converge"))
    near = [one for one in first if one.chi < _NEARLY * first[0].chi]
    loads = [float(one.model.tractions(one.fit.values)[0].sum()) for one in near]
    if any(abs(other - loads[0]) > _SAME_LOAD * max(other, loads[0]) for other in loads):
        result.append(message("other_resultants_explain_deep"))
    if unsure > _UNCERTAIN:
        result.append(message("load_determined_only_more", load=100 * unsure))
    return (*result, *_of_the_surface(stage))


def _of_the_surface(stage: Stage) -> list[str]:
    """What to say where the tractions touch their limits."""
    model, values = stage.model, stage.fit.values
    pressure, shear = model.tractions(values)
    result = []
    touching = np.abs(shear) > (1.0 - 1e-9) * FRICTION_LIMIT * pressure
    share = pressure[touching & (pressure > 0.0)].sum() / max(pressure.sum(), 1e-300)
    if share > _LIMITED:
        result.append(
            message("largest_friction_allowed_over", limit=FRICTION_LIMIT, share=100 * share)
        )
    reach = 2 * model.spacing_px
    pressed = model.nodes_px[pressure > 0.0]
    if len(pressed) and (pressed[0] < reach or pressed[-1] > model.place.cols - reach):
        result.append(message("pressure_reaches_picture_side"))
    return result


def local_chi(stage: Stage) -> float:
    """The largest chi of a block of pixels; 0 where no block has enough of them."""
    keep = stage.model.pixels.keep
    row, col = (at // _BLOCK_PX for at in np.nonzero(keep))
    block = row * (keep.shape[1] // _BLOCK_PX + 1) + col
    count = np.bincount(block)
    square = np.bincount(block, weights=np.square(stage.fit.gamma_fit.residual))
    enough = count >= _FEW
    return float(np.sqrt((square[enough] / count[enough]).max())) if enough.any() else 0.0
