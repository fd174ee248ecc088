"""What does not change from frame to frame of a video, asked of a few of them before the track.

The first frame of a track, and the load that wore its contact before, as that frame shows it.

A load that swings shows one of its values. The scar's ends are where the larger ones have been, and
where its own load does not reach, or reaches beyond, the frame tells which one wore it. It tells
one load: what swung before is taken for a steady one that leaves the least misfit.

A full search that found nothing is not made again in frames that show the same.

Follow a contact through a video: each frame from the last one's values, in milliseconds.

The stress difference is a polynomial of the values about where they are (`field_polynomial`), so
that a residual costs no mechanics; the derivatives are kept from frame to frame as long as they
serve. A frame that this does not bring down to its noise is lost, and is searched for as if it were
alone.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from math import sqrt
from typing import Any

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import POOR_CHI, FrameData, prepare_frame, standard_uncertainty
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.causes.cause import BAND, PLATES, SMOOTH
from isochrome.fitting.causes.freeing import Freed, free_causes
from isochrome.fitting.causes.report import cause_messages
from isochrome.fitting.causes.score import LightTerms
from isochrome.fitting.causes.slips import is_lost
from isochrome.fitting.frame.frame_fit import FrameFit, fit_frame, fit_with_model, placed
from isochrome.fitting.frame.frame_model import GammaFit, LocalModel, RefinedFit, project
from isochrome.fitting.frame.model_frame import ModelFrame, evaluate_model
from isochrome.fitting.frame.single_state import scene_at, slid_until
from isochrome.fitting.frame.unknowns import (
    BLUR,
    GAMMA,
    LENS,
    WEAR,
    fit_region,
    inputs_of_rows,
    thinning,
)
from isochrome.fitting.frame_set import FrameSet
from isochrome.fitting.joint.frame_sequence import make_sequence
from isochrome.fitting.joint.joint_fit import JointSolution, solve_jointly, starting_values
from isochrome.fitting.result import TOO_FAR
from isochrome.fitting.tracking.tracked_model import (
    BEYOND,
    HIDDEN_PX,
    TrackModel,
    WholeField,
    thin_frame,
)
from isochrome.fitting.tracking.wear_state import WORN, TrackCourse
from isochrome.frames import (
    Frame,
    FrameReader,
    Linear,
    NoiseModel,
    SequentialFrames,
    estimate_noise,
    full_scale,
)
from isochrome.messages import message
from isochrome.output import named_frames
from isochrome.scene import Scene

APPARATUS = (*LENS, GAMMA, BLUR, *PLATES, BAND)
"""Keys of the camera, the light and the polariscope that frames may ask for."""

NoLoad = tuple[Linear | None, Linear | None]


@dataclass(frozen=True, kw_only=True)
class Apparatus:
    """What a video's frames have in common besides what their scene says.

    Parameters
    ----------
    scene : Scene
        The scene, with what was found.
    keys : tuple of str, (m,), optional
        The keys that were found.
    covariance : ndarray, (m, m), optional
        Of their values.
    terms : tuple of tuple, (2,), optional
        Polynomial products of illumination and background, where they are richer.
    outside : ndarray of bool, (rows, cols), optional
        Pixels that are left out.
    warnings : tuple of str, optional
        What is said of it.
    """

    scene: Scene
    keys: tuple[str, ...] = ()
    covariance: Array | None = None
    terms: LightTerms | None = None
    outside: Mask | None = None
    warnings: tuple[str, ...] = ()

    @property
    def stated(self) -> Scene:
        """The scene, that states the uncertainties of what was found too."""
        return self.scene.with_values(
            {key: {"value": v, "standard_uncertainty": u} for key, (v, u) in self.values.items()}
        )

    @property
    def values(self) -> dict[str, tuple[float, float]]:
        """Value and standard uncertainty of what was found, by key."""
        if self.covariance is None:
            return {}
        spread = np.sqrt(np.diag(self.covariance)).tolist()
        return {key: (self.scene.get(key), u) for key, u in zip(self.keys, spread, strict=True)}

    def seen(self, data: FrameData) -> FrameData:
        """A frame with the light and the pixels that are taken."""
        if self.terms is not None:
            data = replace(data, lamp=data.lamp.of(self.terms))
        if self.outside is not None:
            data = replace(data, valid=data.valid & ~self.outside)
        return data


def find_apparatus(
    reader: FrameReader, scene: Scene, keys: tuple[str, ...], *, count: int, no_load: NoLoad
) -> Apparatus:
    """Ask the first, the middle and the last frame of a video for what belongs to the apparatus.

    Of a contact that wears only the first is asked: what has worn the others is not known yet.

    Parameters
    ----------
    reader : FrameReader
        The video.
    scene : Scene
        A contact, where its first frame's search starts.
    keys : tuple of str
        The keys that are tracked.
    count : int
        Number of the video's frames.
    no_load : tuple of Linear or None, (2,), optional
        The dark and the bright frame without load.

    Returns
    -------
    Apparatus
        What was found; the scene as it is where the frames ask for nothing, or show nothing.
    """
    scene = placed(scene, reader.shape)
    if isinstance(scene.frames.gamma, str):
        return Apparatus(scene=scene)  # each whole frame finds its own
    bare = scene.model_copy(update={"stated_uncertainty": ()})  # a track has no priors
    places = (0,) if scene.wear is not None else tuple(sorted({0, count // 2, count - 1}))
    frames, in_order = list[Frame](), SequentialFrames(reader)
    for place in places:
        with suppress(InputError):
            frames.append(in_order.frame(place))
    if not frames:
        return Apparatus(scene=scene)
    one = scene_at(bare, slid_until(bare, frames[0]) or 0.0)
    own = tuple(key for key in keys if one.wear is not None or not key.startswith("wear."))
    asked: dict[int, tuple[FrameData, FrameFit]] = {}
    for frame in frames:
        try:
            data = prepare_frame(frame, one, bit_depth=reader.bit_depth, no_load=no_load)
        except InputError:
            continue  # a blank frame is refused in its turn, or left out
        fit = _alone(data, one, own)
        if fit is not None:
            asked[frame.index] = data, fit
    try:
        freed = _asked(reader.shape, list(asked.values()), one, own)
    except PhysicsError:
        return Apparatus(scene=scene)
    return _held(freed, scene, list(asked))


def _alone(data: FrameData, scene: Scene, keys: tuple[str, ...]) -> FrameFit | None:
    """A frame's own fit, None where the scene's fringes are not in it."""
    try:
        fitted = fit_with_model(data, scene, keys, stated=inputs_of_rows(()))
    except PhysicsError:
        return None
    return None if is_lost(fitted) or fitted.fit.plain else fitted.fit


def _asked(
    shape: tuple[int, int],
    asked: list[tuple[FrameData, FrameFit]],
    scene: Scene,
    keys: tuple[str, ...],
) -> Freed[JointSolution]:
    """Frames with their own values, asked together. Raises PhysicsError where they show nothing."""
    if not asked:
        raise PhysicsError("frames_do_not_show", name=scene.name)
    data = FrameSet(shape, [frame for frame, _ in asked])
    sequence = make_sequence(scene, len(asked), (), keys)
    start = starting_values(sequence, [fit for _, fit in asked])
    return free_causes(solve_jointly(data, sequence, start, lambda: None))


def _held(freed: Freed[JointSolution], scene: Scene, places: list[int]) -> Apparatus:
    """What was found in some frames of a video, to be held in all of them."""
    said = cause_messages(freed)
    if not said:
        return Apparatus(scene=scene)
    fit = freed.now.fit
    at = [k for k, unknown in enumerate(fit.unknowns) if unknown.key in APPARATUS]
    keys = tuple(fit.unknowns[k].key for k in at)
    assert fit.covariance is not None
    asked = named_frames(places)
    held = "" if freed.is_plain else message("held_all_frames")
    if SMOOTH in freed.causes:
        held += message("but_smooth_stress_which")
    return Apparatus(
        scene=scene.with_values(dict(zip(keys, fit.values[at].tolist(), strict=True))),
        keys=keys,
        covariance=fit.covariance[np.ix_(at, at)],
        terms=freed.now.terms if freed.light else None,
        outside=freed.now.data.outside,
        warnings=tuple(f"asked of {asked}{held}: " + text for text in said),
    )


_TIMES = 4
_FIRST, _FARTHEST = 0.01, 0.3
"""First step, and the largest, over the load that it starts from."""
_RESTS = 0.2
"""Step below which the search rests, in standard uncertainties of the load before."""
_TOLD, _PASTS, _AGAIN, _ALIKE = 4.0, 3, 0.03, 3e-3
"""Misfit, over the noise squared, that another load must take off; how often one is looked for at
most, and its change, over it, after which one is again: from far off it is not found at once. Below
the last change a frame's values stay within their uncertainty."""

Follow = Callable[[TrackModel, Array], RefinedFit | None]


def begin_track(
    course: TrackCourse,
    prepared: Callable[[], TrackModel],
    follow: Follow,
    begun: Array,
    usual_load_n: float,
) -> tuple[RefinedFit | None, TrackModel]:
    """The first frame of a track, on what its own load has worn, or another one before it.

    Parameters: `course`, which has passed no frame, and has the load before it afterwards;
    `prepared`, which makes the frame's pixels anew: slopes of another scar leave the load before it
    untold; `follow`, from pixels and values (axes,) to where the steps end; `begun` (axes,), the
    values to start from; `usual_load_n`, about the load (N) that wore the contact. Returns what was
    found, None where the steps do not end, and the pixels that it was found with.
    """
    model = prepared()
    found = follow(model, begun)
    if found is None or not course.unsure:
        return found, model

    def better_than(
        found: RefinedFit, past_n: float, begin: Array
    ) -> tuple[RefinedFit, TrackModel] | None:
        """What is found if another load wore it, where that is better; else all stays."""
        selected, begin = course.past_load_n, course.with_past(begin, past_n)
        course.past_load_n = past_n
        again = prepared()
        other = follow(again, begin)
        if (
            other is not None
            and other.gamma_fit.cost < found.gamma_fit.cost - _TOLD * found.gamma_fit.noise
        ):
            return other, again
        course.past_load_n = selected
        return None

    found, model = better_than(found, usual_load_n, begun) or (found, model)
    for _ in range(_PASTS):
        start = course.load_before(found.values)
        past = _past_load(course, model, found, start)
        if abs(past - start) < _ALIKE * start:
            break
        better = better_than(found, past, found.values)
        if better is None:
            break
        found, model = better
        if abs(past - start) < _AGAIN * start:
            break
    return found, model


def _past_load(course: TrackCourse, model: TrackModel, found: RefinedFit, start_n: float) -> float:
    """The load (N) before the first frame by `fit_past_load`; the start's where none is told."""
    amplitude, still = found.gamma_fit.part.amplitude, np.zeros(course.count)
    selected = course.past_load_n

    def worn(past_n: float) -> Array:
        """The signal over the noise (n,) if that load wore the contact."""
        course.past_load_n = past_n
        return np.asarray(model.worn_signal(course.moved(found.values, still)) * amplitude)

    try:
        here = worn(start_n)
        return fit_past_load(
            lambda past_n: worn(past_n) - here, found.local, found.gamma_fit.residual, start_n
        )
    except PhysicsError:
        return start_n
    finally:
        course.past_load_n = selected


def fit_past_load(
    change: Callable[[float], Array], local: LocalModel, residual: Array, start_n: float
) -> float:
    """The load before the first frame that leaves the least residual, by secants.

    Equation: min over P and dv of |r - c(P) - J dv|², with c' by two loads.
    Parameters: `change`, from a load P (N) to what it adds to the frame over its noise (n,), none
    at `start_n`; `local`, the model about the frame's values, with its derivatives J; `residual` r
    (n,) there; `start_n`, the load (N) that has worn it. Returns P, within 30 % of that. Source:
    the elimination of dv as in `LocalModel.step`.
    """
    last, before = start_n, np.zeros_like(residual)
    past = start_n * (1.0 + _FIRST)
    for _ in range(_TIMES):
        added = change(past)
        slope = (added - before) / np.float32(past - last)
        project(slope[None], local.gamma_fit.problem, local.gamma_fit.part)
        alone = slope - local.step(slope).astype(slope.dtype) @ local.rows
        told = float(alone @ alone)
        if not told > 0.0:
            return start_n
        last, before = past, added
        step = float(alone @ (residual - added)) / told
        past = float(np.clip(past + step, (1.0 - _FARTHEST) * start_n, (1.0 + _FARTHEST) * start_n))
        if abs(past - last) < _RESTS / np.sqrt(told):
            break
    return past


_SAME = 1.05
"""Difference of two pictures over what their noise makes of it, up to which they show the same."""
_STRIDE = 4


class VainSearch:
    """The last frame in which a full search found nothing, if any.

    Frames that show the same are not searched anew.

    Parameters
    ----------
    bit_depth : int or None
        Bit depth of the sensor, None where levels are fractions of full scale.
    """

    def __init__(self, bit_depth: int | None) -> None:
        self._bit_depth = bit_depth
        self._last: tuple[Array, float] | None = None

    def remember(self, frame: Frame) -> None:
        """Keep a frame that was searched in vain."""
        thin = _thin(frame)
        model = estimate_noise(frame.image, frame.mask, bit_depth=self._bit_depth)
        self._last = thin, float(np.sqrt(np.nanmean(np.square(model.sigma(thin)))))

    def forget(self) -> None:
        """A frame was found: another search may be worth its time."""
        self._last = None

    def is_repeated(self, frame: Frame) -> bool:
        """Whether a frame shows the same as the one that was searched in vain."""
        if self._last is None:
            return False
        picture, noise = self._last
        change = float(np.sqrt(np.nanmean(np.square(_thin(frame) - picture))))
        return bool(change <= _SAME * np.sqrt(2.0) * noise)


def _thin(frame: Frame) -> Array:
    """Some of a frame's pixels."""
    return frame.image[::_STRIDE, ::_STRIDE].astype(np.float32)


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
        values=nan, standard_uncertainty=nan, cramer_rao_bound=nan, chi=chi, searched=False,
        positive=False, far=bool(np.isfinite(chi)),
    )  # fmt: skip


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
            values=values, standard_uncertainty=spread * factors,
            cramer_rao_bound=local.bound * factors, chi=found.chi, searched=searched, positive=True,
        )  # fmt: skip

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
        prepared, follow = partial(self._prepare, frame, data), partial(self._follow, frame)
        result, self._model = begin_track(self.course, prepared, follow, begun, self._usual_load_n)
        return result

    def _data(self, frame: Frame, noise: NoiseModel | None = None) -> FrameData:
        depth, no_load = self._bit_depth, self._no_load
        return self._apparatus.seen(
            prepare_frame(frame, self.scene, bit_depth=depth, no_load=no_load, noise=noise)
        )

    def _prepare(self, frame: Frame, data: FrameData) -> TrackModel:
        """What all frames have in common, from one that is whole."""
        stride = max(2, thinning(data.light.size, _PIXELS))
        region = fit_region(self.scene, data.shape, stride, HIDDEN_PX)
        noise = estimate_noise(frame.image, data.valid, bit_depth=self._bit_depth)
        thinned = thin_frame(data, region, stride, full=full_scale(self._bit_depth), noise=noise)
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
