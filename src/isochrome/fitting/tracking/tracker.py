"""Follow a contact through a video: each frame from the last one's values, in milliseconds.

The stress difference is a polynomial of the values about where they are (`field_polynomial`), so
that a residual costs no mechanics; the derivatives are kept from frame to frame as long as they
serve. A frame that this does not bring down to its noise is lost, and is searched for as if it were
alone.
"""

from dataclasses import dataclass, replace
from math import sqrt
from typing import Any

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import POOR_CHI, FrameData, prepare_frame, standard_uncertainty
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.frame_fit import fit_frame
from isochrome.fitting.frame.frame_model import GammaFit, LocalModel, RefinedFit
from isochrome.fitting.frame.model_frame import ModelFrame, evaluate_model
from isochrome.fitting.frame.unknowns import WEAR, fit_region, inputs_of_rows, thinning
from isochrome.fitting.result import TOO_FAR
from isochrome.fitting.tracking.apparatus import Apparatus, NoLoad
from isochrome.fitting.tracking.field_cache import HIDDEN_PX, WholeField, thin_frame
from isochrome.fitting.tracking.past_load import begin_track
from isochrome.fitting.tracking.tracked_model import BEYOND, TrackModel
from isochrome.fitting.tracking.vain_search import VainSearch
from isochrome.fitting.tracking.wear_state import WORN, TrackCourse
from isochrome.frames import Frame, NoiseModel, estimate_noise, full_scale
from isochrome.messages import message
from isochrome.scene import Scene

_PIXELS = 20_000
_NEAR, _FROZEN, _STEPS, _BOXES, _FAR = 0.05, 0.3, 12, 2, 1.5
"""Last step in standard uncertainties; share of the last step below which the derivatives are
kept; exact residuals, and polynomials, of one frame at most; how far beyond its polynomial, in
half-widths, a step is believed."""
_LOST = 1.1
"""Chi, over that of the last frame that was searched for, beyond which a frame is lost."""
_NOISE_EVERY = 250
_CORRECT = "correct_scene_load_place"
NO_FRINGES = "scene_fringes_not_frame"
AGAIN = "there_no_track_follow"
POOR = "chi_poor_model_does"
FAR = "model_too_far_off"


@dataclass(frozen=True, kw_only=True)
class Tracked:
    """What was found in one frame of a video.

    Parameters
    ----------
    values : ndarray, (keys,)
        The tracked values, in the units that the keys name, NaN where nothing was found.
    standard_uncertainty : ndarray, (keys,)
        Their standard uncertainties, inf for what the frame does not tell.
    cramer_rao_bound : ndarray, (keys,)
        The least standard uncertainties that the frame's noise allows.
    chi : float
        Residual over noise, NaN where nothing was found, but where the model was too far off.
    searched : bool
        Whether the frame was found by a full search, not from the last frame.
    positive : bool
        False where the scene's fringes are not in the frame.
    far : bool, default False
        Whether the model was too far off to give values.
    """

    values: Array
    standard_uncertainty: Array
    cramer_rao_bound: Array
    chi: float
    searched: bool
    positive: bool
    far: bool = False

    @property
    def warnings(self) -> tuple[str, ...]:
        """The frame's warnings."""
        if not self.positive:
            return (message(FAR) if self.far else message(NO_FRINGES),)
        again = (message(AGAIN),) if self.searched else ()
        return (*again, message(POOR)) if self.chi > POOR_CHI else again


def nothing_found(count: int, chi: float = float("nan")) -> Tracked:
    """A frame without values.

    Parameters
    ----------
    count : int
        How many keys are tracked.
    chi : float, default nan
        Residual over noise of a model that is too far off, NaN where there is none.

    Returns
    -------
    Tracked
        NaN for each key.
    """
    nan = np.full(count, np.nan)
    return Tracked(
        values=nan,
        standard_uncertainty=nan,
        cramer_rao_bound=nan,
        chi=chi,
        searched=False,
        positive=False,
        far=bool(np.isfinite(chi)),
    )


class Tracker:
    """Tracks keys of a scene through frames given one after the other.

    Parameters
    ----------
    scene : Scene
        A contact, placed in its picture (see `placed`).
    keys : tuple of str
        The keys to track.
    bit_depth : int or None
        Bit depth of the sensor, None where levels are fractions of full scale.
    no_load : tuple of Linear or None, (2,), optional
        The dark and the bright frame without load.
    apparatus : Apparatus, optional
        What else the frames have in common, with the scene in it.
    usual_load_n : float, optional
        About the load that has worn the contact before its first frame, by default the scene's.

    Raises
    ------
    InputError
        For a scene or a key that cannot be tracked.
    """

    def __init__(
        self,
        scene: Scene,
        keys: tuple[str, ...],
        *,
        bit_depth: int | None,
        no_load: NoLoad = (None, None),
        apparatus: Apparatus | None = None,
        usual_load_n: float | None = None,
    ) -> None:
        self.scene, self.keys = scene, keys
        self._usual_load_n = usual_load_n or scene.load_at(0.0)
        self._apparatus = apparatus or Apparatus(scene=scene)
        self.course = TrackCourse(scene, keys)
        self._bit_depth, self._no_load = bit_depth, no_load
        self._vain = VainSearch(bit_depth)
        self._values: Array | None = None
        self._pace = np.zeros(len(keys))
        self._model: TrackModel | None = None
        self._whole: WholeField | None = None
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

    def begin(self, frame: Frame, fitted: Scene, chi: float, distance_m: float | None) -> None:
        """Start in a frame that was fitted by itself: `fitted`, with its `chi`.

        `distance_m`, slid until then, None where nothing wears. Raises InputError on a blank frame.
        """
        start = self.course.start(distance_m)
        begun = self.course.from_scene(fitted, start, distance_m)
        result = self._begin_at(frame, self._data(frame), begun, chi, distance_m)
        if result is None or result.chi > _LOST * max(1.0, chi):
            result = self._search(frame, start, distance_m)
        self._take(result, frame, distance_m, lost=True)

    def track(self, frame: Frame, distance_m: float | None) -> Tracked:
        """The tracked values of the next frame. Raises InputError on a blank frame.

        `distance_m`, slid until then, None where nothing wears.
        """
        if self._vain.is_repeated(frame):
            return nothing_found(len(self.keys))
        if self._values is None:
            start = self.course.start(distance_m)
        else:
            last = self.course.moved(self._values, self._pace)
            start = self.course.carried(last, distance_m)
            if self._model is None:
                self._model = self._prepare(frame, self._data(frame))
        result = None
        if self._model is not None:
            self._check_noise(frame, self._model)
            result = self._follow(frame, self._model, start)
        lost = result is None or not (result.positive and result.chi <= _LOST * self._reference)
        if lost:
            result = self._search(frame, start, distance_m)
        return self._take(result, frame, distance_m, lost=lost)

    def _take(
        self, found: RefinedFit | None, frame: Frame, distance_m: float | None, *, lost: bool
    ) -> Tracked:
        """Go on from what was found in a frame, by a search where it was `lost`."""
        self._pace = np.zeros(len(self.keys))
        if found is None or not found.positive or _off(found) > TOO_FAR:
            self._vain.remember(frame)
            return nothing_found(len(self.keys), found.chi if found and found.positive else np.nan)
        self._vain.forget()
        if lost:
            self._reference = max(1.0, found.chi)
        if self._values is not None and not lost:
            # as it went, so it goes on: a step less for a value that swings
            self._pace = (found.values - self._values)[: len(self.keys)]
        self._values = found.values
        self.course.passed(found.values, distance_m)
        return self._in_own_units(found, searched=lost)

    def model_frame(self, frame: Frame) -> tuple[FrameData, ModelFrame, Scene]:
        """The frame that was tracked last, with every pixel, its model, and the scene of that.

        Its noise is that of the track. Raises InputError on a blank frame, PhysicsError where the
        contact cannot be solved.
        """
        assert self._values is not None and self._model is not None
        if self._whole is None:
            self._whole = WholeField(self.course, (frame.image.shape[0], frame.image.shape[1]))
        scene, difference = self._whole.at(self._values)
        data = self._data(frame, self._model.thinned.noise)
        return data, evaluate_model(data, scene, difference=difference), scene

    def _in_own_units(self, found: RefinedFit, *, searched: bool) -> Tracked:
        """What a frame says in its keys' own units."""
        local = found.local
        covariance = local.covariance(found.gamma_fit)
        if self._apparatus.covariance is not None:
            assert self._model is not None
            by_held = local.sensitivity((), self._model.held_rows)
            covariance = covariance + by_held @ self._apparatus.covariance @ by_held.T
        spread = standard_uncertainty(covariance, local.determined)
        factors = self.course.reported()
        values = found.values[: self.course.count] * factors
        return Tracked(
            values=values,
            standard_uncertainty=spread * factors,
            cramer_rao_bound=local.bound * factors,
            chi=found.chi,
            searched=searched,
            positive=True,
        )

    def _search(self, frame: Frame, start: Array, distance_m: float | None) -> RefinedFit | None:
        """A frame found as if it were alone; None where the scene's fringes are not in it."""
        data = self._data(frame)
        free = tuple(
            WEAR if axis == WORN else axis for axis in self.course.axes[: self.course.count]
        )
        even = self.course.field_scene(start)
        keys = free if even.wear is not None else tuple(k for k in free if "wear." not in k)
        try:
            # a tracked value has the frame's uncertainty alone, and no prior
            fit = fit_frame(data, even, keys, stated=inputs_of_rows(()))
        except PhysicsError:
            return None
        if not fit.positive:
            return None
        # the scene of one frame's field has worn over one metre
        begun = self.course.from_scene(fit.scene, start, 1.0)
        return self._begin_at(frame, data, begun, fit.chi, distance_m)

    def _begin_at(
        self, frame: Frame, data: FrameData, begun: Array, chi: float, distance_m: float | None
    ) -> RefinedFit | None:
        """A frame from values (axes,) that were found in it alone, with their `chi`."""
        if not self.course.unsure:
            self._model = self._prepare(frame, data)
            result = self._follow(frame, self._model, begun)
            # what the frame shows alone, but not on the scar so far: that scar is not the block's
            if self.scene.wear is None or (result and result.chi <= _LOST * max(1.0, chi)):
                return result
            self.course, self._whole = TrackCourse(self.scene, self.keys), None
            self.course.start(distance_m)
        result, self._model = begin_track(
            self.course,
            lambda: self._prepare(frame, data),
            lambda model, values: self._follow(frame, model, values),
            begun,
            self._usual_load_n,
        )
        return result

    def _data(self, frame: Frame, noise: NoiseModel | None = None) -> FrameData:
        depth, no_load = self._bit_depth, self._no_load
        return self._apparatus.seen(
            prepare_frame(frame, self.scene, bit_depth=depth, no_load=no_load, noise=noise)
        )

    def _prepare(self, frame: Frame, data: FrameData) -> TrackModel:
        """What all frames have in common, from one that is whole."""
        stride = max(2, thinning(data.light.size, _PIXELS))
        thinned = thin_frame(
            data,
            fit_region(self.scene, data.shape, stride, HIDDEN_PX),
            stride,
            full=full_scale(self._bit_depth),
            noise=estimate_noise(frame.image, data.valid, bit_depth=self._bit_depth),
        )
        self._since_noise = 0
        return TrackModel(self.course, data.shape, thinned, self._apparatus.keys)

    def _check_noise(self, frame: Frame, model: TrackModel) -> None:
        """Tell the camera's noise again now and then."""
        self._since_noise += 1
        if self._since_noise >= _NOISE_EVERY:
            noise = estimate_noise(frame.image, frame.mask, bit_depth=self._bit_depth)
            model.see(replace(model.thinned, noise=noise))
            self._since_noise = 0

    def _follow(self, frame: Frame, model: TrackModel, start: Array) -> RefinedFit | None:
        """Newton's steps from some values (axes,); None where they do not end."""
        levels = model.thinned.levels(frame.image)
        values, last, boxes = start.copy(), np.inf, 0
        for _ in range(_STEPS):
            if model.reach(values) > BEYOND:
                far = np.isfinite(last) and model.reach(values) > _FAR
                if far or boxes == _BOXES or not model.move(values, levels):
                    return None
                boxes, last = boxes + 1, np.inf
            if model.stale(values) and not model.refresh(values, levels):
                return None
            gamma_fit = model.at(values, levels)
            if gamma_fit is None:
                return None
            local = model.local
            if local is None or self._turned(local, gamma_fit, values, last):
                gamma_fit, last = model.linearise(values, levels, gamma_fit), np.inf
                local = model.local
            assert local is not None
            moved = self.course.moved(values, local.step(gamma_fit.residual))
            step = (moved - values)[: len(self.keys)]  # less what would heal a scar
            size, values = local.size(step) / sqrt(gamma_fit.noise), moved
            if size < _NEAR and not model.stale(values):
                return RefinedFit(values, local, gamma_fit)
            last = size
        return None

    def _turned(self, local: LocalModel, gamma_fit: GammaFit, values: Array, last: float) -> bool:
        """Whether steps with the kept derivatives do not shrink fast enough."""
        size = local.size(local.step(gamma_fit.residual)) / sqrt(gamma_fit.noise)
        return size > _FROZEN * last and not np.array_equal(
            local.values, values[: len(local.values)]
        )


def _off(found: RefinedFit) -> float:
    """Residual over contrast, by the median contrast of the pixels: see TOO_FAR."""
    lit = np.median(found.gamma_fit.part.amplitude)  # over the noise
    return found.chi / float(lit) if lit > 0.0 else np.inf
