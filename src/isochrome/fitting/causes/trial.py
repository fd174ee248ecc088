"""Fits to means over blocks that tell which of several sets explains a frame, whatever its slopes
say: what no noise explains costs them what it does in Student's t.

Their evidence, to second order about where each came to rest (Laplace's method), is

    ln E = -(cost / s + prior) / 2 - ln det (N / s + W) / 2 + sum ln w / 2,

with the cost and the normal equations N of all unknowns, the priors' cost and weights W = diag(w),
w = 1/u^2 of those that not every set has, and s the variance of what the best set leaves. Source:
Kass & Raftery (1995), J. Am. Stat. Assoc. 90, 773, section 4.1.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from isochrome.estimation import STEP, Bounds, FrameData, LinearPart, Prior, cosines
from isochrome.fitting.arrays import Array
from isochrome.fitting.causes.blocks import BLOCK, COSINES
from isochrome.fitting.causes.cause import TINY
from isochrome.fitting.causes.modes import TractionModes
from isochrome.fitting.causes.score import LightTerms, light_sizes, more_than, of_more_light
from isochrome.fitting.frame.frame_model import (
    FrameModel,
    GammaFit,
    LocalModel,
    RefinedFit,
    local_model,
    refine_fit,
    trust_of_slopes,
)
from isochrome.fitting.frame.renderer import scene_optics
from isochrome.fitting.frame.unknowns import BLUR, LENS, moved_scene, scales, thinning
from isochrome.scene import Scene
from isochrome.stress import pixel_grid

TOLERANCE = 0.5
"""Last step, in standard uncertainties."""
_MEANS = 4_000
"""Blocks of a frame, about."""
_COARSE = 0.05
"""Error of a mean over a block, over the light and what fringes lose of their contrast in it."""
_NEARER_STEPS, FAR, _STALLED = 3, 1.5, 0.8
"""Steps with one weight of the slopes; the residual's variance over the noise's below which none
is needed, and what must be left of it where they help."""
_PASSES = 12
"""Steps of a fit."""
_DEGREES = 5.0
"""Degrees of freedom of the noise's Student's t."""


def trial_side(shape: tuple[int, int]) -> int:
    """Side in pixels of the blocks whose means are fitted, an odd number of those of causes."""
    wide = thinning(shape[0] * shape[1], _MEANS) / BLOCK
    return BLOCK * (2 * round(0.5 * (wide - 1.0)) + 1) if wide > 1.0 else BLOCK


def through_a_lens(scene: Scene) -> Scene:
    """The scene seen through a lens, be it one that does nothing.

    A picture through one is interpolated and hides some rows: all trials are, to be compared.
    """
    bent = scene.camera is not None and any(scene.get(key) for key in LENS)
    return scene if bent else scene.with_values({LENS[0]: TINY})


@dataclass(frozen=True, kw_only=True)
class Expected:
    """What is known beforehand of what a trial fits besides the unknowns.

    `keys` to a middle and a standard deviation; `root` L (k, r) of the covariance of the tractions
    of `modes`; `order` L (k, r) of that of an order's cosines; `terms`, the light that all have,
    and `hidden_px`, the depth above which none is fitted: all are compared over the same pixels.
    """

    keys: dict[str, tuple[float, float]]
    terms: LightTerms
    hidden_px: float
    modes: TractionModes | None = None
    root: Array | None = None
    order: Array | None = None

    def prior(self, keys: Iterable[str], stated: Prior) -> Prior:
        """That of some unknowns (p,), with what is `stated`."""
        values, weight = stated.values.copy(), stated.weight.copy()
        for k, key in enumerate(keys):
            if key in self.keys:
                values[k], weight[k] = self.keys[key][0], self.keys[key][1] ** -2.0
        return Prior(values, weight)


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A fit to a frame's blocks, and where it came to rest.

    `cost` and `normal` (p, p), of the pixels alone; `prior` cost, `weight` (p,) and `extra` (p,),
    those that not every set has; `light`, the normal equations (k, k) of its products, and the
    `light_weight` (k,) of theirs; `excess`, the variance of what is left over the noise's; `values`
    of the keys, `tractions` (k,) of the modes, None where it has none.
    """

    cost: float
    normal: Array
    prior: float
    weight: Array
    extra: Array
    light: Array
    light_weight: Array
    excess: float
    values: dict[str, float]
    tractions: Array | None = None

    def evidence(self, noise: float) -> float:
        """ln E, at a variance of the noise."""
        log = -0.5 * (self.cost / noise + self.prior)
        parts = (
            (self.normal, self.weight, self.weight[self.extra]),
            (self.light, self.light_weight, self.light_weight[self.light_weight > 0.0]),
        )
        for normal, weight, own in parts:
            log -= 0.5 * np.linalg.slogdet(normal / noise + np.diag(weight))[1]
            log += 0.5 * np.log(own).sum()
        return float(log)


def student_root(residual: Array) -> Array:
    """Root of the weights (n,) that residuals have in Student's t."""
    return np.asarray(np.sqrt((_DEGREES + 1.0) / (_DEGREES + np.square(residual))), np.float32)


def student_cost(residual: Array) -> float:
    """-2 ln of Student's t of the residuals, up to a constant."""
    return float(np.sum((_DEGREES + 1.0) * np.log1p(np.square(residual) / _DEGREES), dtype=float))


class TrialModel(FrameModel):
    """Means over a frame's blocks, with amplitudes of the tractions' modes behind its unknowns."""

    def __init__(
        self,
        data: FrameData,
        scene: Scene,
        around: Scene,
        keys: tuple[str, ...],
        *,
        side: int,
        prior: Prior,
        expected: Expected,
    ) -> None:
        """As of a `FrameModel`, on means over blocks, with what is `expected`.

        `around`, the scene by which all trials weigh their pixels.
        """
        # it stands on what the pixels tell apart, and needs its derivatives by one side only
        rows, cols = (-(-n // side) for n in data.shape)
        region = np.ones((rows, cols), dtype=bool)
        super().__init__(data, scene, keys, region, stride=side, in_blocks=True)
        _, shown = self.renderer.order_field(around)
        lost = 1.0 - np.broadcast_to(shown, region.shape)[self.pixels.keep]
        off = np.float32(_COARSE) * self.pixels.raw.max() * lost
        weight = 1.0 / np.hypot(1.0 / self.pixels.weight, off)
        self.pixels = replace(self.pixels, weight=weight)
        self._root = np.ones(self.pixels.size, np.float32)
        self._turns: dict[int, tuple[Array, np.float32]] = {}
        self._fields = np.empty((0, *self.pixels.keep.shape), np.complex64)
        if expected.root is not None:
            assert expected.modes is not None
            hats = expected.modes.fields(pixel_grid(scene, data.shape).every(side))
            self._fields = np.tensordot(expected.root.T.astype(np.float32), hats, 1)
        if expected.order is not None:
            orders = np.tensordot(
                expected.order.T.astype(np.float32), cosines(self._shape, COSINES), 1
            )
            self._fields = np.concatenate((self._fields, orders * self._per_order(scene)))
        count, ends = len(self._fields), self.limits
        self.prior = Prior(
            np.r_[prior.values, np.zeros(count)], np.r_[prior.weight, np.ones(count)]
        )
        self.limits = Bounds(
            np.r_[ends.low, np.full(count, -np.inf)], np.r_[ends.high, np.full(count, np.inf)]
        )

    @property
    def _shape(self) -> tuple[int, int]:
        rows, cols = self.pixels.keep.shape
        return rows, cols

    def _per_order(self, scene: Scene) -> Array:
        """The stress difference (rows, cols) that adds a fringe to none, and to more the more: see
        `FrameBlocks.order_waves`."""
        field = np.nan_to_num(self.renderer.order_field(scene)[0])
        size = np.maximum(np.abs(field), np.float32(1e-6))
        return np.asarray(
            field * (1.0 + np.float32(1.0 / scene_optics(scene).order_per_mpa) / size)
        )

    @property
    def count(self) -> int:
        """Number of amplitudes."""
        return len(self._fields)

    def signal(
        self, values: Array, *, visibility: Array | None = None, keys: tuple[str, ...] | None = None
    ) -> Array | None:
        """The signal at the pixels (n,), as of a `FrameModel`."""
        number = len(values) - self.count
        if self.count:
            amplitudes = np.asarray(values[number:], np.float32)
            self.renderer.added = np.tensordot(amplitudes, self._fields, 1)
        return super().signal(values[:number], visibility=visibility, keys=keys)

    def settled(self, values: Array) -> RefinedFit | None:
        """Where it comes to rest from `values` (p,); None where it makes no scene.

        First by what its slopes are right in, the more the nearer it comes: so a start that is
        fringes off near the contact leads to no other minimum. What no noise explains then counts
        as in Student's t: dust decides nothing.
        """
        every, cost = np.ones_like(self._root), np.inf
        while True:
            self._weigh(every)
            here = self.at(values)
            if here is None:
                return None
            if here.cost < FAR * every.size or here.cost > _STALLED * cost:
                break
            cost, trust = here.cost, trust_of_slopes(here, self.renderer.stride)
            self._weigh(trust)
            nearer = refine_fit(self, values, tolerance=1.0, iterations=_NEARER_STEPS)
            if nearer is None:
                return None
            values = nearer.values
        self._weigh(student_root(here.residual))
        result = refine_fit(self, values, tolerance=TOLERANCE, iterations=_PASSES)
        if result is not None:
            self._weigh(student_root(self.residual(result)))
            result = refine_fit(self, result.values, tolerance=TOLERANCE, iterations=_PASSES)
        return result

    def residual(self, result: RefinedFit) -> Array:
        """What a fit has left (n,), over the pixels' noise."""
        return np.asarray(result.gamma_fit.residual / self._root)

    def _weigh(self, root: Array) -> None:
        """Give each pixel the root of a weight (n,) besides its noise's."""
        own = self.pixels.weight / self._root
        self.pixels, self._root = replace(self.pixels, weight=own * root), root
        self._turns.clear()

    def linearise(self, values: Array, gamma_fit: GammaFit) -> LocalModel:
        """Derivatives at some values, where the linear solution is known."""
        number = len(self.keys)
        rows = np.empty((number + self.count, self.pixels.size), np.float32)
        here = moved_scene(self.scene, self.keys, values[:number])
        field, shown = self.renderer.order_field(here)
        field = np.nan_to_num(field)  # a lens may move a pixel off the specimen
        if not self._turns:
            self._turns = self._turned(values[:number], field)
        for j in set(range(number)) - set(self._turns):
            rows[j] = self._slopes(self.keys, values, range(j, j + 1), gamma_fit)[0]
        turns = {**self._turns, **{number + k: (f, _AMPLITUDE) for k, f in enumerate(self._fields)}}
        if self.renderer.added is not None:
            field = field + self.renderer.added
        optics, signal, gain = scene_optics(here), gamma_fit.part.signal, gamma_fit.part.amplitude
        for j, (turn, step) in turns.items():
            moved = optics.signal(field + step * turn, visibility=shown)
            rows[j] = (moved[self.pixels.keep] - signal) * (gain / step)
        names = (*self.keys, *(f"mode {k}" for k in range(self.count)))
        return local_model(names, values, gamma_fit, rows, self.prior)

    def _turned(self, values: Array, field: Array) -> dict[int, tuple[Array, np.float32]]:
        """How the field (rows, cols) turns with each unknown that leaves the optics as they are, by
        its number, and a step of that.

        Fringes are soon others, and their slopes with them; what turns them changes little.
        """
        turns: dict[int, tuple[Array, np.float32]] = {}
        for j, (key, size) in enumerate(zip(self.keys, scales(self.scene, self.keys), strict=True)):
            if key.startswith(_OPTICAL):
                continue
            moved, step = values.copy(), STEP * size
            moved[j] += step if moved[j] + step <= self.limits.high[j] else -step
            turned = self.renderer.field_alone(moved_scene(self.scene, self.keys, moved))
            step = moved[j] - values[j]
            turns[j] = (np.nan_to_num(turned) - field) / np.float32(step), np.float32(step)
        return turns


_OPTICAL = ("polariscope.", "frames.", "specimen.fringe_value", "specimen.thickness", BLUR)
"""How keys begin that change more than the field, or something else."""
_AMPLITUDE = np.float32(0.03)
"""Change of an amplitude, in standard deviations of its prior."""


def light_weights(part: LinearPart, own: LightTerms, terms: LightTerms) -> Array:
    """1/u^2 (k,) of a light's coefficients: of `terms` that are not the frame's `own`; else 0."""
    more = more_than(terms, own)
    count = len(part.coefficients)
    weight = np.zeros(count)
    weight[of_more_light(count, terms, own)] = (
        np.array(light_sizes(more)) * part.coefficients[0]
    ) ** -2.0
    return weight
