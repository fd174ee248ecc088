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

from isochrome.estimation import Bounds, FrameData, Prior, cosine_sum
from isochrome.fitting.arrays import Array
from isochrome.fitting.causes.blocks import COSINES
from isochrome.fitting.causes.cause import TINY
from isochrome.fitting.causes.modes import TractionModes
from isochrome.fitting.frame.far_model import FarModel, student_cost
from isochrome.fitting.frame.frame_fit import turned_over
from isochrome.fitting.frame.frame_model import RefinedFit
from isochrome.fitting.frame.renderer import with_waves
from isochrome.fitting.frame.unknowns import LENS
from isochrome.scene import Scene
from isochrome.stress import pixel_grid

_COARSE = 0.05
"""Error of a mean over a block, over the light and what fringes lose of their contrast in it."""


def through_a_lens(scene: Scene) -> Scene:
    """The scene seen through a lens, be it idle: one hides some rows, and trials are compared."""
    bent = scene.camera is not None and any(scene.get(key) for key in LENS)
    return scene if bent else scene.with_values({LENS[0]: TINY})


@dataclass(frozen=True, kw_only=True)
class Expected:
    """What is known beforehand of what a trial fits besides the unknowns. `keys` to a middle and a
    standard deviation; `root` L (k, r) of the covariance of the tractions of `modes`; `order` L
    (3k, r) of that of what no cause explains.
    """

    keys: dict[str, tuple[float, float]]
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
    """A fit to a frame's blocks, and where it came to rest. `cost` and `normal` (p, p), of the
    pixels alone; `prior` cost, `weight` (p,) and `extra` (p,), those that not every set has;
    `light`, the normal equations (k, k) of its products, and their `light_weight` (k,); `excess`,
    the variance of what is left over the noise's; `values` of the keys, `tractions` (k,) of the
    modes and `waves` (3, k) of what no cause explains, None where it has none; `usual_chi`, what a
    typical block has left over the noise, be others odd, or its light over what lamps have, 0 where
    it is not kept.
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
    waves: Array | None = None
    usual_chi: float = 0.0

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


class TrialModel(FarModel):
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
        """`around`, the scene by which all trials weigh their pixels; with what is `expected`."""
        # it stands on what the pixels tell apart, and needs its derivatives by one side only
        rows, cols = (-(-n // side) for n in data.shape)
        region = np.ones((rows, cols), dtype=bool)
        super().__init__(data, scene, keys, region, stride=side, in_blocks=True)
        _, shown = self.renderer.order_field(around)
        lost = 1.0 - np.broadcast_to(shown, region.shape)[self.pixels.keep]
        off = np.float32(_COARSE) * self.pixels.raw.max() * lost
        self.pixels = replace(self.pixels, weight=1.0 / np.hypot(1.0 / self.pixels.weight, off))
        if expected.root is not None:
            assert expected.modes is not None
            hats = expected.modes.fields(pixel_grid(scene, data.shape).every(side))
            self.fields = np.tensordot(expected.root.T.astype(np.float32), hats, 1)
        if expected.order is not None:
            field = np.nan_to_num(self.renderer.order_field(scene)[0])
            waves = cosine_sum((rows, cols), expected.order.T.reshape(-1, 3, COSINES**2))
            orders = [with_waves(scene, field, one) - field for one in waves]
            self.fields, self.slight = np.concatenate((self.fields, orders)), len(orders)
        count, ends = len(self.fields), self.limits
        self.prior = Prior(
            np.r_[prior.values, np.zeros(count)], np.r_[prior.weight, np.ones(count)]
        )
        self.limits = Bounds(
            np.r_[ends.low, np.full(count, -np.inf)], np.r_[ends.high, np.full(count, np.inf)]
        )

    def rested(self, values: Array) -> tuple[RefinedFit, Array] | None:
        """Where it comes to rest from `values` (p,), plates turned to the likelier side, and what
        is left over the noise (n,); None where it makes no scene, or no light.
        """
        first = self.settled(values)
        found = [(first, self.residual(first))] if first else []
        other = turned_over(self.keys, first.values) if first else None
        turned = None if other is None else self.settled(other)
        found += [(turned, self.residual(turned))] if turned else []
        bright = [pair for pair in found if pair[0].gamma_fit.positive]
        return min(bright, key=lambda pair: student_cost(pair[1]), default=None)
