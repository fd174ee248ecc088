"""Follow a contact through a video: each frame from the last one's values, in milliseconds.

The stress difference is a polynomial of the values about where they are (`track_field`), so that
a residual costs no mechanics; the derivatives are kept from frame to frame as long as they serve.
A frame that this does not bring down to its noise is lost, and is searched for as if it were alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import PhysicsError
from isochrome.fit.frame_data import FrameData, prepare_frame
from isochrome.fit.frame_fit import fit_frame, thinning
from isochrome.fit.local import LocalModel
from isochrome.fit.polish import block_correlation
from isochrome.fit.tone import Toned
from isochrome.fit.track_boxes import HIDDEN_PX
from isochrome.fit.track_course import WORN, TrackCourse
from isochrome.fit.track_local import TrackModel, step_size
from isochrome.fit.track_pixels import Look, thin_frame
from isochrome.fit.unknowns import fit_region
from isochrome.frames import Frame, Linear, estimate_noise
from isochrome.frames.noise import full_scale
from isochrome.scene import Scene

Array = NDArray[Any]

_PIXELS = 20_000
_NEAR, _FROZEN, _STEPS, _BOXES, _FAR = 0.05, 0.3, 12, 2, 1.5
"""Last step in standard uncertainties; share of the last step below which the derivatives are
kept; exact residuals, and polynomials, of one frame at most; how far beyond its polynomial, in
half-widths, a step is believed."""
_LOST = 1.1
"""Chi, over that of the last frame that was searched for, beyond which a frame is lost."""
_NOISE_EVERY = 250


@dataclass(frozen=True)
class Tracked:
    """One frame: `values`, `standard_uncertainty`, `cramer_rao_bound` (keys,), and `chi`.

    `searched`, whether it was found by a full search, not from the last frame; `positive`, False
    where the scene's fringes are not in it: its values are NaN then.
    """

    values: Array
    standard_uncertainty: Array
    cramer_rao_bound: Array
    chi: float
    searched: bool
    positive: bool


@dataclass(frozen=True)
class _Found:
    """Where the steps in one frame ended."""

    values: Array
    local: LocalModel
    toned: Toned
    look: Look

    @property
    def chi(self) -> float:
        linear = len(self.toned.part.coefficients)
        freedom = self.toned.residual.size - len(self.local.values) - linear
        return float(np.sqrt(self.toned.cost / max(1, freedom)))

    def good(self, chi: float) -> bool:
        """Whether the light is light, and the residual no more than it may be."""
        return self.toned.part.positive and self.chi <= chi


class Tracker:
    """Tracks keys of a scene through frames given one after the other."""

    def __init__(
        self,
        scene: Scene,
        keys: tuple[str, ...],
        *,
        bit_depth: int | None,
        no_load: tuple[Linear | None, Linear | None] = (None, None),
    ) -> None:
        """`scene`, placed in its picture; `keys` to track; `bit_depth` of the sensor; `no_load`.

        Raises InputError for a scene or a key that cannot be tracked.
        """
        self.scene, self.keys = scene, keys
        self.course = TrackCourse(scene, keys)
        self._bit_depth, self._no_load = bit_depth, no_load
        self._values: Array | None = None
        self._pace = np.zeros(len(keys))
        self._model: TrackModel | None = None
        self._reference, self._since_noise = 1.0, 0

    def state(self) -> dict[str, Any]:
        """What the next frame needs of those before it, as plain numbers for `resume`."""
        return {
            "values": None if self._values is None else self._values.tolist(),
            "pace": self._pace.tolist(),
            "reference": self._reference,
            "course": self.course.state(),
        }

    def resume(self, state: dict[str, Any]) -> None:
        """Go on from a `state`, with polynomials and pixels made anew from the next frame."""
        values = state["values"]
        self._values = None if values is None else np.array(values)
        self._pace, self._reference = np.array(state["pace"]), float(state["reference"])
        self.course.resume(state["course"])
        self._model = None

    def track(self, frame: Frame, distance_m: float | None) -> Tracked:
        """The tracked values of the next frame. Raises InputError on a blank frame.

        `distance_m`, slid until then, None where nothing wears.
        """
        if self._values is None:
            start = self.course.start(distance_m)
        else:
            last = self.course.moved(self._values, self._pace)
            start = self.course.carried(last, distance_m)
            if self._model is None:
                self._model = self._prepare(frame, self._data(frame))
        found = None
        if self._model is not None:
            self._check_noise(frame, self._model)
            found = self._follow(frame, self._model, start)
        lost = found is None or not found.good(_LOST * self._reference)
        if lost:
            found = self._search(frame, start)
        if found is None or not found.toned.part.positive:
            self._pace = np.zeros(len(self.keys))
            return self._nothing(found)
        if lost:
            self._reference = max(1.0, found.chi)
        self._pace = np.zeros(len(self.keys))
        if self._values is not None and not lost:
            # as it went, so it goes on: a step less for a value that swings
            self._pace = (found.values - self._values)[: len(self.keys)]
        self._values = found.values
        self.course.passed(found.values, distance_m)
        return self._told(found, searched=lost)

    def _nothing(self, found: _Found | None) -> Tracked:
        nan = np.full(len(self.keys), np.nan)
        return Tracked(nan, nan, nan, found.chi if found else np.nan, True, False)

    def _told(self, found: _Found, *, searched: bool) -> Tracked:
        """What a frame says in its keys' own units.

        The covariance is White's (1980, Econometrica 48, 817), N⁻¹ (Σ r² j jᵀ) N⁻¹ n/(n - k),
        widened by the residuals' correlation over blocks of pixels.
        """
        local, residual = found.local, found.toned.residual
        weighted = local.rows * residual
        middle = (weighted @ weighted.T).astype(float)
        linear = len(found.toned.part.coefficients)
        wider = residual.size / max(1, residual.size - len(local.keys) - linear)
        wider *= max(1.0, block_correlation(found.look.keep, residual))
        spread = np.sqrt(np.maximum(np.diag(local.inverse @ middle @ local.inverse), 0.0) * wider)
        spread[~local.determined] = np.inf
        factors = self.course.reported()
        values = found.values[: self.course.count] * factors
        return Tracked(
            values, spread * factors, local.bound * factors, found.chi, searched, positive=True
        )

    def _search(self, frame: Frame, start: Array) -> _Found | None:
        """A frame found as if it were alone; None where the scene's fringes are not in it."""
        data = self._data(frame)
        free = tuple(
            "wear.coefficient_mm2_per_n" if axis == WORN else axis
            for axis in self.course.axes[: self.course.count]
        )
        even = self.course.field_scene(start)
        keys = free if even.wear is not None else tuple(k for k in free if "wear." not in k)
        try:
            fit = fit_frame(data, even, keys)
        except PhysicsError:
            return None
        if not fit.positive:
            return None
        self._model = self._prepare(frame, data)
        begun = self.course.from_scene(fit.scene, start)
        found = self._follow(frame, self._model, begun)
        return self._other_past(frame, data, begun, found) if self.course.unsure else found

    def _other_past(
        self, frame: Frame, data: FrameData, begun: Array, found: _Found | None
    ) -> _Found | None:
        """The first frame of a worn contact on what its own load, or the scene's, has worn.

        A load that swings shows one of its values; which load wore the scar until then, the frame
        itself tells.
        """
        own, self._model = self._model, self._prepare(frame, data)
        self.course.nominal = True
        other = self._follow(frame, self._model, self.course.with_past(begun))
        if other is not None and (found is None or other.toned.cost < found.toned.cost):
            return other
        self.course.nominal, self._model = False, own
        return found

    def _data(self, frame: Frame) -> FrameData:
        return prepare_frame(frame, self.scene, bit_depth=self._bit_depth, no_load=self._no_load)

    def _prepare(self, frame: Frame, data: FrameData) -> TrackModel:
        """What all frames have in common, from one that is whole."""
        shape = (data.light.shape[0], data.light.shape[1])
        stride = max(2, thinning(data.light.size, _PIXELS))
        thinned = thin_frame(
            data,
            fit_region(self.scene, shape, stride, HIDDEN_PX),
            stride,
            full=full_scale(self._bit_depth),
            noise=estimate_noise(frame.image, data.valid, bit_depth=self._bit_depth),
        )
        self._since_noise = 0
        return TrackModel(self.course, shape, thinned)

    def _check_noise(self, frame: Frame, model: TrackModel) -> None:
        """Tell the camera's noise again now and then."""
        self._since_noise += 1
        if self._since_noise >= _NOISE_EVERY:
            noise = estimate_noise(frame.image, frame.mask, bit_depth=self._bit_depth)
            model.see(model.thinned.with_noise(noise))
            self._since_noise = 0

    def _follow(self, frame: Frame, model: TrackModel, start: Array) -> _Found | None:
        """Newton's steps from some values (axes,); None where they do not end."""
        levels = model.thinned.levels(frame.image)
        values, last, boxes = start.copy(), np.inf, 0
        for _ in range(_STEPS):
            if not model.holds(values):
                far = np.isfinite(last) and model.reach(values) > _FAR
                if far or boxes == _BOXES or not model.move(values, levels):
                    return None
                boxes, last = boxes + 1, np.inf
            if model.stale(values) and not model.refresh(values, levels):
                return None
            toned = model.at(values, levels)
            if toned is None:
                return None
            local = model.local
            if local is None or self._turned(local, toned, values, last):
                toned, last = model.linearise(values, levels, toned), np.inf
                local = model.local
            assert local is not None and model.look is not None
            moved = self.course.moved(values, local.step(toned.residual))
            step = (moved - values)[: len(self.keys)]  # less what would heal a scar
            size, values = step_size(local, step) / _noise(toned), moved
            if size < _NEAR and not model.stale(values):
                return _Found(values, local, toned, model.look)
            last = size
        return None

    def _turned(self, local: LocalModel, toned: Toned, values: Array, last: float) -> bool:
        """Whether steps with the kept derivatives do not shrink fast enough."""
        size = step_size(local, local.step(toned.residual)) / _noise(toned)
        return size > _FROZEN * last and not np.array_equal(
            local.values, values[: len(local.values)]
        )


def _noise(toned: Toned) -> float:
    """Residual over noise, 1 at least."""
    return float(max(1.0, toned.cost / max(1, toned.residual.size)) ** 0.5)
