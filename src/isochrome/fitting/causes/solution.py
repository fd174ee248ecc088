"""A fit that is asked for causes: what it must tell, and how it is made anew with more unknowns."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol, Self, cast

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import FrameData, Prior, Unevenness, block_correlation, local_correlation
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.causes.blocks import (
    BLOCK,
    MAD,
    FrameBlocks,
    SolvedFrame,
    block_side,
    outliers,
)
from isochrome.fitting.causes.trial import Expected, Trial, TrialModel, through_a_lens
from isochrome.fitting.frame.far_model import student_cost
from isochrome.fitting.frame.frame_fit import Fitted, FrameFit, fit_with_model, hidden_px
from isochrome.fitting.frame.frame_model import FrameModel, stored
from isochrome.fitting.frame.renderer import bent_share
from isochrome.fitting.frame.single_state import with_numerics
from isochrome.fitting.frame.unknowns import GAMMA, StatedInputs, fit_region, moved_scene, values_of
from isochrome.scene import Scene


@dataclass(frozen=True, kw_only=True)
class Change:
    """What a fit is made anew with. `added`, where keys begin that become unknowns; `held`, keys
    that are unknowns no more, and their values; `begun`, where the other unknowns begin; how
    `uneven` the light is, if it is; `waves` (3, k) of what no cause explains, all nought for none;
    `outside` (rows/3, cols/3), blocks that are left out. `far`, whether it does not begin where a
    fit came to rest.
    """

    added: dict[str, float] = field(default_factory=dict)
    held: dict[str, Any] = field(default_factory=dict)
    begun: dict[str, float] = field(default_factory=dict)
    uneven: Unevenness | None
    waves: Array | None = None
    outside: Mask | None = None
    far: bool = False


class Askable(Protocol):
    """A fit to be asked and made anew; `past`: it alone says what friction was before."""

    data: Any
    past: bool = False

    @property
    def fit(self) -> Any:
        """The fit itself."""

    @property
    def frames(self) -> Any:
        """The frames, with the light and the pixels that were taken."""

    @property
    def unknown_keys(self) -> tuple[str, ...]:
        """The key of each unknown (p,)."""

    @property
    def prior(self) -> Prior:
        """What is known beforehand of the unknowns."""

    @property
    def held(self) -> StatedInputs:
        """What is stated with an uncertainty, and held."""

    @property
    def is_bright(self) -> bool:
        """Whether its light is light, and more than one amplitude."""

    def blocks(self) -> Iterator[FrameBlocks]:
        """Each of its frames in blocks."""

    def again(self, change: Change) -> Self:
        """The fit with a change. Raises PhysicsError where it cannot be made."""

    def trial(self, change: Change, expected: Expected) -> Trial | None:
        """A fit to few pixels with what is expected of it; None where there is none."""

    def still_odd(self, whole: Self, odd: Mask) -> Mask:
        """Which of the blocks that it left out of the `whole` frame it does not explain."""

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self.frames)

    @property
    def chi(self) -> float:
        """Residual over noise."""
        return float(self.fit.chi)

    @property
    def scene(self) -> Scene:
        """The scene with the fitted values."""
        return cast(Scene, self.fit.scene)

    @property
    def values(self) -> Array:
        """The fitted values (p,)."""
        return np.asarray(self.fit.values)

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys that were fitted."""
        return tuple(dict.fromkeys(self.unknown_keys))

    @property
    def uneven(self) -> Unevenness | None:
        """How uneven the light is, if it is fitted so."""
        return cast("Unevenness | None", self.frames[0].lamp.uneven)

    @property
    def waves(self) -> Array | None:
        """Of what no cause explains (3, k), where something is fitted."""
        return cast("Array | None", self.frames[0].waves)

    @property
    def pixels(self) -> int:
        """Pixels of all frames that may be used."""
        return sum(int(frame.valid.sum()) for frame in self.frames)

    @property
    def is_sound(self) -> bool:
        """Whether it is bright, and each value determined."""
        return self.is_bright and bool(np.isfinite(self.fit.standard_uncertainty).all())

    def values_of_key(self, key: str) -> list[tuple[float, float]]:
        """Value and standard uncertainty of a key, one for each time that it was fitted."""
        columns = self.unknown_keys, self.fit.values, self.fit.standard_uncertainty
        return [(float(v), float(u)) for k, v, u in zip(*columns, strict=True) if k == key]


@dataclass(frozen=True)
class FrameSolution(Askable):
    """The fit of one frame, its `data` with the light and the pixels that were taken."""

    data: FrameData
    fitted: Fitted
    past: bool = False

    @property
    def fit(self) -> FrameFit:
        """The fit."""
        return self.fitted.fit

    @property
    def frames(self) -> tuple[FrameData]:
        """The frame."""
        return (self.data,)

    @property
    def unknown_keys(self) -> tuple[str, ...]:
        """The key of each unknown (p,)."""
        return self.fit.keys

    @property
    def prior(self) -> Prior:
        """What is known beforehand of the unknowns."""
        return self.fitted.final.local.prior

    @property
    def held(self) -> StatedInputs:
        """What is stated with an uncertainty, and held."""
        return self.fitted.held

    @property
    def is_bright(self) -> bool:
        """Whether its light is light, and more than one amplitude."""
        return self.fit.positive and not self.fit.plain

    def blocks(self) -> Iterator[FrameBlocks]:
        """The frame in blocks."""
        model, final = self.fitted.model, self.fitted.final
        rows = np.concatenate((final.local.rows, self.fitted.held_rows))
        yield FrameBlocks(
            SolvedFrame(
                data=self.data,
                scene=moved_scene(model.scene, self.fit.keys, final.values),
                pixels=model.pixels,
                gamma_fit=final.gamma_fit,
                renderer=model.renderer,
                rows=rows,
                along=np.eye(len(rows)),
                unknowns=len(self.fit.keys),
            )
        )

    def again(self, change: Change) -> FrameSolution:
        """The fit with a change. Raises PhysicsError where it cannot be made."""
        data, keys, scene = self._changed(change)
        fitted = fit_with_model(
            data, scene, keys, cold=False, stated=self.fitted.stated, rested=not change.far
        )
        # other minima are those of the first search
        fitted = replace(fitted, fit=replace(fitted.fit, others=self.fit.others))
        return replace(self, data=data, fitted=fitted)

    def trial(self, change: Change, expected: Expected) -> Trial | None:
        """A fit to means over blocks with what is expected of it; None where there is none."""
        data, keys, scene = self._changed(change)
        data, side = data.with_noise(self._block_noise), block_side(data.shape)
        prior = expected.prior(keys, self.fitted.stated.prior(keys))
        try:
            here, around = (
                with_numerics(one, nodes_per_pixel=1, tolerance=1e-3)
                for one in (scene, self.fit.scene)
            )
            model = TrialModel(
                replace(data, valid=data.valid & self._below), here, around, keys,
                side=side, prior=prior, expected=expected,
            )  # fmt: skip
            rested = model.rested(np.pad(values_of(scene, keys), (0, model.count)))
        except PhysicsError:
            return None
        if rested is None:
            return None
        result, over_blocks = rested
        part = result.gamma_fit
        values, amplitudes = np.split(result.values, [len(keys)])
        parts, first = [], 0
        for root in (expected.root, expected.order):
            last = first + (0 if root is None else root.shape[1])
            parts.append(None if root is None else root @ amplitudes[first:last])
            first = last
        return Trial(
            cost=student_cost(over_blocks),
            normal=result.local.information,
            prior=model.prior.cost(result.values) + part.known,
            weight=model.prior.weight,
            extra=np.array([key in expected.keys for key in keys] + [True] * model.count),
            light=part.normal,
            light_weight=part.weights,
            excess=part.noise * block_correlation(model.pixels.keep, part.residual),
            values=dict(zip(keys, values.tolist(), strict=True)),
            tractions=parts[0],
            waves=None if parts[1] is None else parts[1].reshape(3, -1),
            usual_chi=max(MAD * float(np.median(np.abs(over_blocks))), part.chi),
        )

    @cached_property
    def _below(self) -> Mask:
        """Pixels of all trials, from half a block below the surface on: blocks that it cuts as it
        moves show where it lies, and what takes any form made up for what these were off by."""
        scene, shape = through_a_lens(self.fit.scene), self.data.shape
        return fit_region(scene, shape, 1, hidden_px(scene) + 0.5 * block_side(shape))

    @cached_property
    def _block_noise(self) -> float:
        """The noise of means over blocks over that of independent pixels: more if compressed."""
        if self.fit.noise_ratio == 1.0:
            return 1.0
        pixels, final = self.fitted.model.pixels, self.fitted.final
        return float(np.sqrt(local_correlation(pixels.keep, final.gamma_fit.residual)))

    def still_odd(self, whole: FrameSolution, odd: Mask) -> Mask:
        """Which of the blocks that it left out of the `whole` frame it does not explain."""
        model, final = self.fitted.model, self.fitted.final
        data = replace(whole.data, lamp=self.data.lamp, waves=self.data.waves)
        region = fit_region(model.scene, data.shape, 1, hidden_px(model.scene))
        every = FrameModel(data, model.scene, self.fit.keys, region)
        signal = every.signal(final.values)
        if signal is None:
            return odd
        pixels = every.pixels
        illumination, background = pixels.light.of(final.gamma_fit.coefficients)
        light = illumination * signal + background
        image = np.zeros(data.shape, np.float32)
        image[pixels.keep] = pixels.raw - stored(light, every.gamma(final.values))
        image[pixels.keep] *= pixels.weight
        seen = pixels.keep[::BLOCK, ::BLOCK]
        return np.asarray(odd & (outliers(image, seen) | ~seen))

    def _changed(self, change: Change) -> tuple[FrameData, tuple[str, ...], Scene]:
        """Data, unknowns and scene to begin with."""
        data = self.data
        keys = tuple(key for key in self.fit.keys if key not in change.held)
        scene = self.fit.scene.with_values(change.begun | change.added | change.held)
        if GAMMA in change.added or GAMMA in change.held:  # what no-load frames show is read anew
            data = data.toned(scene.frames.stated_gamma)
        if change.uneven != data.lamp.uneven:
            data = replace(data, lamp=data.lamp.of(change.uneven))
        if change.waves is not None:
            data = replace(data, waves=change.waves if change.waves.any() else None)
        if change.outside is not None:
            data = replace(data, valid=data.valid & ~whole_picture(change.outside, data.shape))
        data = data.less_sure(bent_share(scene, data.shape))
        return data, (*keys, *change.added), scene


def whole_picture(outside: Array, shape: tuple[int, int]) -> Mask:
    """Blocks (rows/3, cols/3) as pixels of a picture of a `shape` (rows, cols)."""
    rows, cols = shape
    # each block lies about its pixel
    out = np.repeat(np.repeat(outside, BLOCK, 0), BLOCK, 1)
    return np.pad(out, ((0, BLOCK), (0, BLOCK)), mode="edge")[1 : rows + 1, 1 : cols + 1]
