"""What does not change from frame to frame of a video, asked of one of them before the track.

Follow a contact through a video: each frame is fitted from the last one's values, in milliseconds
(`TrackedModel`). A frame that this does not bring down to its noise is lost, and is searched for as
if it were alone.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import (
    POOR_CHI,
    STEP,
    Bounds,
    FrameData,
    LinearPart,
    Prior,
    Unevenness,
    no_prior,
    prepare_frame,
    standard_uncertainty,
)
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.causes.cause import BAND, PLATES, SMOOTH
from isochrome.fitting.causes.freeing import Freed, free_causes
from isochrome.fitting.causes.report import cause_messages
from isochrome.fitting.causes.slips import is_lost
from isochrome.fitting.causes.solution import FrameSolution
from isochrome.fitting.frame.frame_fit import FrameFit, fit_frame, fit_with_model, placed
from isochrome.fitting.frame.frame_model import (
    FrameModel,
    LocalModel,
    RefinedFit,
    clear_of_ends,
    inward,
    local_model,
    refine_fit,
    stored,
    turned_row,
)
from isochrome.fitting.frame.renderer import ModelFrame, SceneRenderer, evaluate_model, scene_optics
from isochrome.fitting.frame.single_state import scene_at, slid_until
from isochrome.fitting.frame.unknowns import (
    BLUR,
    GAMMA,
    LENS,
    LOAD,
    WEAR,
    fit_region,
    inputs_of_rows,
    limits,
    scales,
    thinning,
)
from isochrome.fitting.frame_set import TOO_FAR
from isochrome.fitting.tracking.worn_course import PAST, WornCourse
from isochrome.frames import Frame, FrameReader, Linear, NoiseModel, estimate_noise, full_scale
from isochrome.messages import message
from isochrome.output import named_frames
from isochrome.scene import Scene

APPARATUS = (*LENS, GAMMA, BLUR, *PLATES, BAND)
"""Keys of the camera, the light and the polariscope that frames may ask for."""

NoLoad = tuple[Linear | None, Linear | None]


@dataclass(frozen=True, kw_only=True)
class Apparatus:
    """What a video's frames have in common besides what their scene says. `scene`, with what was
    found: `keys` (m,), the `covariance` (m, m) of their values; `uneven`, where the light was
    fitted so; pixels `outside` (rows, cols) are left out; `warnings`, of it.
    """

    scene: Scene
    keys: tuple[str, ...] = ()
    covariance: Array | None = None
    uneven: Unevenness | None = None
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
        if self.uneven is not None:
            data = replace(data, lamp=data.lamp.of(self.uneven))
        if self.outside is not None:
            data = replace(data, valid=data.valid & ~self.outside)
        return data


def find_apparatus(
    reader: FrameReader, scene: Scene, keys: tuple[str, ...], *, count: int, no_load: NoLoad
) -> Apparatus:
    """Ask a video's first frame for what belongs to the apparatus; else the middle or last one.
    `count` of its frames, where `keys` are tracked. Of a contact that wears only the first is
    asked: what has worn the others is not known yet. The scene as it is where none shows anything.
    """
    scene = placed(scene, reader.shape)
    if isinstance(scene.frames.gamma, str):
        return Apparatus(scene=scene)  # each whole frame finds its own
    bare = scene.model_copy(update={"stated_uncertainty": ()})  # a track has no priors
    for place in (0,) if scene.wear is not None else sorted({0, count // 2, count - 1}):
        # a blank frame is refused in its turn, or left out
        with suppress(InputError, PhysicsError):
            frame = reader.frame(place)
            one = scene_at(bare, slid_until(bare, frame) or 0.0)
            own = tuple(key for key in keys if one.wear is not None or not key.startswith("wear."))
            data = prepare_frame(frame, one, bit_depth=reader.bit_depth, no_load=no_load)
            fitted = fit_with_model(data, one, own, stated=inputs_of_rows(()))
            if not is_lost(fitted) and not fitted.fit.plain:
                data = data.with_noise(fitted.fit.noise_ratio)
                return _held(free_causes(FrameSolution(data, fitted)), scene, place)
    return Apparatus(scene=scene)


def _held(freed: Freed[FrameSolution], scene: Scene, place: int) -> Apparatus:
    """What was found in the frame at a place of a video, to be held in all of them."""
    said = cause_messages(freed)
    if not said:
        return Apparatus(scene=scene)
    fit = freed.now.fit
    at = [k for k, key in enumerate(fit.keys) if key in APPARATUS]
    keys = tuple(fit.keys[k] for k in at)
    held = "" if freed.is_plain else message("held_all_frames")
    if SMOOTH in freed.causes or freed.tractions or freed.unknown:
        held += message("but_smooth_stress_which")
    return Apparatus(
        scene=scene.with_values(dict(zip(keys, fit.values[at].tolist(), strict=True))),
        keys=keys,
        covariance=fit.covariance[np.ix_(at, at)],
        uneven=freed.now.uneven,
        outside=freed.stated.data.valid & ~freed.now.data.valid,
        warnings=tuple(f"asked of {named_frames([place])}{held}: " + text for text in said),
    )


_SAME = 1.05
"""Difference of two pictures over what their noise makes of it, up to which they show the same."""
_STRIDE = 4


def _thin(frame: Frame) -> Array:
    """Some of a frame's pixels."""
    return frame.image[::_STRIDE, ::_STRIDE].astype(np.float32)


_PIXELS = 20_000
_HIDDEN_PX, _ROOM_PX = 8.0, 4.0
_SWING = 0.2
"""Standard deviation of the load before the first frame over the usual one, before it is seen."""


_TURN = 0.03
"""Largest change of the field (MPa) that shows a derivative of the signal."""
_GROWN = 0.02
"""Growth of a scar whose wear coefficient is tracked after which the turns are made anew."""


class TrackedModel(FrameModel):
    """Every few pixels of a course's frames, about `place` (p,), where the contact was solved. The
    field turns with each value from there. A contact is solved once a frame or twice, and what
    turns its field is kept from frame to frame as long as it serves. `bend`, by how much of a step
    its slopes err; `held`, keys of the apparatus whose values have an uncertainty; `full`, the
    largest grey level.
    """

    def __init__(
        self, course: WornCourse, data: FrameData, *, noise: NoiseModel, full: float,
        held: tuple[str, ...], usual_load_n: float,
    ) -> None:  # fmt: skip
        """`data`, of a frame, whole; `usual_load_n`, about the load that wore the contact before.
        Raises PhysicsError where no pixel is left.
        """
        stride = max(2, thinning(data.light.size, _PIXELS))
        region = fit_region(course.now, data.shape, stride, _HIDDEN_PX)
        super().__init__(
            data, course.now, (), region, stride=stride, hidden_px=_HIDDEN_PX - _ROOM_PX,
            solve=course.solve,
        )  # fmt: skip
        self._course, self._full, self._held, self.noise = course, full, held, noise
        self._every, self._clear = self.pixels, np.ones(self.pixels.size, dtype=bool)
        self._optics, self._precise = scene_optics(course.now), True
        self.keys, count = course.keys, len(course.tracked)
        low, high, weight = np.zeros(len(self.keys)), np.full(len(self.keys), np.inf), np.zeros(0)
        for j, key in enumerate(course.tracked):
            if key != WEAR:
                ends = limits(course.now, (key,))
                low[j], high[j] = ends.low[0], ends.high[0]
        self.limits, weight = Bounds(low, high), np.zeros(len(self.keys))
        weight[count:] = (_SWING * usual_load_n) ** -2.0
        self.prior, self._usual = Prior(np.full(len(weight), usual_load_n), weight), usual_load_n
        self.place, self.bend, self._law = np.zeros(0), 1.0, 0.0
        self._turns: Array | None = None
        self._by_held: Array | None = None
        self._looked = False

    def moved(self, keys: tuple[str, ...], values: Array) -> Scene:
        """The scene of the frame in hand with some values (p,) at its keys."""
        return self._course.moved(keys, values)

    def see(self, image: Array) -> None:
        """Take a frame's image (rows, cols)."""
        stride, keep = self.renderer.stride, self._every.keep
        levels = image[::stride, ::stride][keep].astype(np.float32) / np.float32(self._full)
        self._every = replace(self._every, raw=levels)
        self.pixels = replace(self.pixels, raw=levels[self._clear])

    def stand(self, values: Array) -> None:
        """Solve the contact at some values (p,). PhysicsError where it does not converge."""
        self.scene = self._course.now
        place = self._course.take(values)
        self.renderer.forget()
        scene = self.moved(self.keys, values)
        self._field, self.place = self.renderer.field_alone(scene)[self._every.keep], place
        grown = False
        if self._turns is not None and WEAR in self.keys:  # another scar than of the turns
            begun = self._worn == 0.0 < self._course.after.worn_mm2
            grown = begun or self._course.grown(self._worn, values) > _GROWN
        if self._turns is None or grown:
            self.turn()
        elif WEAR in self.keys and self._law > 0.0:
            # a coefficient's turn is its share of what the law has worn, which has become more
            j, more = self.keys.index(WEAR), self._course.after.law_mm2 / self._law
            self._turns[j] *= np.float32(more)
            if self._by_held is not None:
                self._by_held[j] /= more
            self._law = self._course.after.law_mm2
        if not self._looked:
            gamma_fit = self.at(values)
            if gamma_fit is not None:
                illumination, background = self._every.light.of(gamma_fit.coefficients)
                self.look(illumination * self._signal(values) + background)
            self._looked = True

    def turn(self) -> None:
        """Make anew how the field turns with each value."""
        turns = np.zeros((len(self.keys), self._field.size), np.complex64)
        shown = self._visibility(self.place)
        fading = np.zeros(turns.shape, np.float32)
        for j, key in enumerate(self.keys):
            if key in (WEAR, *PAST):
                turns[j] = self._turned_by_wear(key)
                continue
            step = STEP * float(scales(self.scene, (key,))[0])
            beside = self.place.copy()
            beside[j] += inward(beside[j], step, self.limits.high[j])
            move = np.float32(beside[j] - self.place[j])
            there = self.renderer.field_alone(self.moved(self.keys, beside))[self._every.keep]
            turns[j] = (there - self._field) / move
            fading[j] = (self._visibility(beside) - shown) / move
        self._turns, self._by_held = turns, None
        self._worn, self._law = self._course.after.worn_mm2, self._course.after.law_mm2
        self._shown = self.place.copy(), shown, fading
        self.bend = 1.0

    def _visibility(self, values: Array) -> Array:
        """The visibility (n,) of the fringes at some values, by the mechanics."""
        field, shown = self.renderer.order_field(self.moved(self.keys, values))
        return np.broadcast_to(shown, field.shape)[self._every.keep]

    def _turned_by_wear(self, key: str) -> Array:
        """The change of the field (n,) by what a scar was worn by."""
        with self._course.beside(key, self.place) as step:
            self.renderer.forget()
            there = self.renderer.field_alone(self.moved(self.keys, self.place))[self._every.keep]
        self.renderer.forget()
        return (there - self._field) / np.float32(step) if step else np.zeros_like(self._field)

    def at(self, values: Array, *, near: Array | None = None) -> LinearPart | None:
        """The linear solution at some values (p,)."""
        return self.solved(self._signal(values)[self._clear], values, near)

    def linearise(self, values: Array, gamma_fit: LinearPart) -> LocalModel:
        """Derivatives at some values, where the linear solution is known."""
        assert self._turns is not None
        rows = [self._row(turn, values, gamma_fit) for turn in self._turns]
        return local_model(self.keys, values, gamma_fit, np.stack(rows), self.prior)

    def _row(self, turn: Array, values: Array, gamma_fit: LinearPart) -> Array:
        """The derivative (n,) of the pixels in use by what turns the field (n,) of all."""
        turn = turn[self._clear]
        field, shown = (part[self._clear] for part in self._turned(values))
        step = np.float32(_TURN / max(float(np.abs(turn).max()), 1e-30))
        return turned_row(self._optics, field, shown, turn, step, gamma_fit)

    def distance(self, found: RefinedFit) -> float:
        """How far a fit is from where the contact was solved, in its standard uncertainties."""
        # what more or less has worn than the scar in hand stands beside it from frame to frame
        away = np.where([key == WEAR for key in self.keys], 0.0, found.values - self.place)
        return found.local.size(away) / sqrt(found.gamma_fit.noise)

    def by_held(self, found: RefinedFit) -> Array:
        """Change of the values (p, m) over that of what is held, the loads before as the last."""
        if self._by_held is None:
            gamma_fit, values = found.gamma_fit, found.values
            rows = self.input_rows(values, gamma_fit, self._held)
            if self._course.past is not None:
                turns = map(self._turned_by_wear, PAST)
                past = np.stack([self._row(turn, values, gamma_fit) for turn in turns])
                gamma_fit.project(past)
                rows = np.concatenate((rows, past))
            self._by_held = found.local.sensitivity((), rows)
        return self._by_held

    def _turned(self, values: Array) -> tuple[Array, Array]:
        """The field (n,) at some values, and its visibility."""
        assert self._turns is not None
        middle, shown, fading = self._shown
        field = self._field + (values - self.place).astype(np.float32) @ self._turns
        return field, shown + (values - middle).astype(np.float32) @ fading

    def holds_past(self, found: RefinedFit | None) -> bool:
        """Hold the loads before a first frame at the usual one, unless that tells of others. By the
        evidence for them, at even odds: what is known of those loads before the frame and after it,
        both at the usual one. Source: Dickey (1971), Ann. Math. Stat. 42, 204.
        """
        count = len(self._course.tracked)
        if found is not None:
            covariance = found.local.inverse[count:, count:] * found.gamma_fit.noise
            away = found.values[count:] - self._usual
            shares = covariance / (_SWING * self._usual) ** 2
            if away @ np.linalg.solve(covariance, away) > -np.linalg.slogdet(shares)[1]:
                return False
        weight = self.prior.weight.copy()
        weight[count:] = (STEP * self._usual) ** -2.0
        self.prior = Prior(self.prior.values, weight)
        return True

    def go_on(self) -> None:
        """Leave the first frame: what wore the contact before it is no unknown of the next."""
        count = len(self._course.keys)
        if count < len(self.keys):
            assert self._turns is not None
            middle, shown, fading = self._shown
            self.keys, self.place = self._course.keys, self.place[:count]
            self.limits = Bounds(self.limits.low[:count], self.limits.high[:count])
            self.prior, self._turns = no_prior(count), self._turns[:count]
            self._shown = middle[:count], shown, fading[:count]
            self._by_held, self.bend = None, 1.0  # what the past bends is no measure of the rest

    def _signal(self, values: Array) -> Array:
        """The signal (n,) of every pixel at some values."""
        field, shown = self._turned(values)
        return np.asarray(self._optics.signal(field, visibility=shown), np.float32)

    def look(self, light: Array) -> None:
        """Choose pixels (n,) by a model of their light, and weigh them by its noise."""
        level = stored(light, self._every.gamma)
        sigma = (self.noise.sigma(level * self._full) / self._full).astype(np.float32)
        every = replace(self._every, weight=1.0 / sigma)
        self._clear = clear_of_ends(every, light, every.gamma)
        self.pixels = every.some(self._clear)


_NEAR, _FROZEN, _STEPS, _AGED = 0.05, 0.1, 12, 1.1
"""What the slopes may err by in the end, in standard uncertainties; share of a step by which they
may before they are made anew; contacts solved for one frame at most; and by how much a frame more
lets that share grow, until it is looked at again."""
_LOST = 1.1
"""Chi, over that of the last frame that was searched for, beyond which a frame is lost."""
NO_FRINGES = "scene_fringes_not_frame"
AGAIN = "there_no_track_follow"
POOR = "chi_poor_model_does"
FAR = "model_too_far_off"


@dataclass(frozen=True, kw_only=True)
class Tracked:
    """What was found in one frame of a video: `values` (keys,) in the units that these name. NaN
    where the frame does not show the scene's fringes; then `chi` is known where the model was too
    far off alone. `standard_uncertainty` and `cramer_rao_bound` (keys,) are infinite for what the
    frame does not tell; `searched`, whether it was searched for, not followed.
    """

    values: Array
    standard_uncertainty: Array
    cramer_rao_bound: Array
    chi: float
    searched: bool

    @property
    def positive(self) -> bool:
        """Whether the scene's fringes are in the frame."""
        return bool(np.isfinite(self.values).any())

    @property
    def warnings(self) -> tuple[str, ...]:
        """The frame's warnings."""
        if not self.positive:
            return (message(NO_FRINGES if np.isnan(self.chi) else FAR),)
        again = (message(AGAIN),) if self.searched else ()
        return (*again, message(POOR)) if self.chi > POOR_CHI else again


Alone = Callable[[Frame], tuple[Scene, FrameFit] | None]
"""A frame fitted by itself: the scene that its track is to begin with, and its fit; None where the
scene's fringes are not in it."""


class Tracker:
    """Tracks keys of a contact scene, placed in its picture, through frames given in turn."""

    def __init__(
        self, scene: Scene, keys: tuple[str, ...], *, bit_depth: int | None,
        no_load: NoLoad = (None, None), apparatus: Apparatus | None = None,
        alone: Alone | None = None,
    ) -> None:  # fmt: skip
        """`alone` fits frames until there is a track; InputError for what cannot be tracked."""
        self.scene, self.keys, self._alone = scene, keys, alone
        # about the load that has worn the contact before its first frame
        self._usual_load_n = scene.load_at(0.0)
        self._apparatus = apparatus or Apparatus(scene=scene)
        self.course = WornCourse(scene, keys)
        self._bit_depth, self._no_load = bit_depth, no_load
        self._vain: tuple[Array, float] | None = None  # some pixels of a frame, and their noise
        self._values: Array | None = None
        self._pace = np.zeros(len(keys))
        self._model: TrackedModel | None = None
        self._whole: SceneRenderer | None = None
        self._reference = 1.0

    def state(self) -> dict[str, Any]:
        """What the next frame needs of those before it, as plain numbers for `resume`."""
        return {
            "values": None if self._values is None else self._values.tolist(),
            "pace": self._pace.tolist(),
            "reference": self._reference,
            "course": self.course.state(),
        }

    def resume(self, state: dict[str, Any]) -> None:
        """Go on from a `state`, with turns and pixels made anew from the next frame."""
        values = state["values"]
        self._values = None if values is None else np.array(values)
        self._pace, self._reference = np.array(state["pace"]), float(state["reference"])
        self.course.resume(state["course"])
        self._model = None

    def track(self, frame: Frame, distance_m: float | None) -> Tracked:
        """The tracked values of the next frame. Raises InputError on a blank frame.

        `distance_m`, slid until then, None where nothing wears. What shows the same as a frame that
        was searched in vain is not searched.
        """
        if self._vain is not None:
            picture, noise = self._vain
            change = float(np.sqrt(np.nanmean(np.square(_thin(frame) - picture))))
            if change <= _SAME * np.sqrt(2.0) * noise:
                return self._nothing()
        self.course.at(distance_m)
        result = None
        if self._values is not None and self.course.begun:
            if self._model is None:
                self._model = self._prepare(frame)
            result = self._follow(frame, self._model, self._values + self._pace)
        lost = result is None or not (result.positive and result.chi <= _LOST * self._reference)
        if lost:
            result = self._search(frame, distance_m)
        return self._take(result, frame, lost=lost)

    def _take(self, found: RefinedFit | None, frame: Frame, *, lost: bool) -> Tracked:
        """Go on from what was found in a frame, by a search where it was `lost`."""
        before, count = self._values, len(self.keys)
        self._pace = np.zeros(count)
        # over the contrast, by the median of the pixels: see TOO_FAR
        lit = np.median(found.gamma_fit.amplitude) if found else 0.0
        if found is None or not found.positive or found.chi > TOO_FAR * lit:
            thin = _thin(frame)
            noise = estimate_noise(frame.image, frame.mask, bit_depth=self._bit_depth).sigma(thin)
            self._vain = thin, float(np.sqrt(np.nanmean(np.square(noise))))
            return self._nothing(found.chi if found and found.positive else np.nan)
        self._vain = None  # another search may be worth its time
        if lost:
            self._reference = max(1.0, found.chi)
        self._values = found.values[:count]
        if before is not None and not lost:
            # as it went, so it goes on: a step less for a value that swings
            self._pace = self._values - before
        result = self._said(found, searched=lost)
        self.course.passed(found.values)
        assert self._model is not None
        self._model.go_on()
        return result

    def model_frame(self, frame: Frame) -> tuple[FrameData, ModelFrame, Scene]:
        """The frame that was tracked last, with every pixel, its model, and the scene of that. Its
        noise is that of the track. Raises InputError on a blank frame, PhysicsError where the
        contact cannot be solved.
        """
        assert self._values is not None and self._model is not None
        shown = self.course.moved(self.keys, self._values)
        state = self._model.renderer.state(shown)
        if self._whole is None:
            self._whole = SceneRenderer(shown, (frame.image.shape[0], frame.image.shape[1]))
        difference = self._whole.difference(shown, state)
        data, scene = self._data(frame, self._model.noise), self.course.even_scene(self._values)
        return data, evaluate_model(data, scene, difference=difference), scene

    def _said(self, found: RefinedFit, *, searched: bool) -> Tracked:
        """What a frame says of the tracked keys, and what is held leaves open of it."""
        assert self._model is not None
        local, count = found.local, len(self.keys)
        covariance = local.covariance(found.gamma_fit)
        held = self._apparatus.covariance
        spread = np.zeros((0, 0)) if held is None else held
        if self.course.past is not None:
            spread = block_diag(spread, self.course.past[1])
        if spread.size:
            by_held = self._model.by_held(found)
            covariance = covariance + by_held @ spread @ by_held.T
        sure = standard_uncertainty(covariance, local.determined)
        if len(local.keys) > count:
            self.course.past = found.values[count:], covariance[count:, count:]
        return Tracked(
            values=found.values[:count], standard_uncertainty=sure[:count],
            cramer_rao_bound=local.bound[:count], chi=found.chi, searched=searched,
        )  # fmt: skip

    def _nothing(self, chi: float = np.nan) -> Tracked:
        """A frame without values, and chi of a model that is too far off."""
        nan = np.full(len(self.keys), np.nan)
        return Tracked(
            values=nan, standard_uncertainty=nan, cramer_rao_bound=nan, chi=chi, searched=False
        )

    def _search(self, frame: Frame, distance_m: float | None) -> RefinedFit | None:
        """A frame found as if it were alone; None where the scene's fringes are not in it."""
        if self._alone is not None and self._values is None:
            if (own := self._alone(frame)) is None:
                return None
            self.scene, fit = own
            self._restart(distance_m)
            result = self._begin_at(frame, fit.scene, fit.chi, distance_m, distance_m)
            if result is not None and result.chi <= _LOST * max(1.0, fit.chi):
                return result
        data = self._data(frame)
        course = self.course
        start = course.own_values() if self._values is None else self._values
        past = course.keys[len(self.keys) :]
        start = np.append(start, [start[self.keys.index(LOAD)] for _ in past])
        even = course.even_scene(start)
        keys = self.keys if even.wear is not None else tuple(k for k in self.keys if k != WEAR)
        try:
            # a tracked value has the frame's uncertainty alone, and no prior
            fit = fit_frame(data, even, keys, stated=inputs_of_rows(()))
        except PhysicsError:
            return None
        if not fit.positive:
            return None
        # the scene of one frame has worn over one metre
        return self._begin_at(frame, fit.scene, fit.chi, 1.0, distance_m)

    def _begin_at(
        self, frame: Frame, fitted: Scene, chi: float, worn_m: float | None,
        distance_m: float | None,
    ) -> RefinedFit | None:  # fmt: skip
        """A frame from the scene `fitted` to it alone; its wear counts by `worn_m`."""
        begun = self.course.fitted(fitted, worn_m or 0.0, self._usual_load_n)
        self._model = self._prepare(frame)
        result = self._follow(frame, self._model, begun)
        if len(self._model.keys) > len(self.keys) and self._model.holds_past(result):
            result = self._follow(frame, self._model, begun if result is None else result.values)
        shown = result is not None and result.chi <= _LOST * max(1.0, chi)
        if shown or self.scene.wear is None or not self.course.begun:
            return result
        # what the frame shows alone, but not on the scar so far: that scar is not the block's
        self._restart(distance_m)
        return self._begin_at(frame, fitted, chi, worn_m, distance_m)

    def _restart(self, distance_m: float | None) -> None:
        """Let the contact be worn anew until a frame."""
        self.course = WornCourse(self.scene, self.keys)
        self.course.at(distance_m)

    def _data(self, frame: Frame, noise: NoiseModel | None = None) -> FrameData:
        depth, no_load = self._bit_depth, self._no_load
        return self._apparatus.seen(
            prepare_frame(frame, self.scene, bit_depth=depth, no_load=no_load, noise=noise)
        )

    def _prepare(self, frame: Frame) -> TrackedModel:
        """What all frames have in common, from one that is whole."""
        noise = estimate_noise(frame.image, frame.mask, bit_depth=self._bit_depth)
        return TrackedModel(
            self.course, self._data(frame, noise), noise=noise, full=full_scale(self._bit_depth),
            held=self._apparatus.keys, usual_load_n=self._usual_load_n,
        )  # fmt: skip

    def _follow(self, frame: Frame, model: TrackedModel, start: Array) -> RefinedFit | None:
        """The fit of a frame from some values (keys,); None where its steps do not end."""
        model.see(frame.image)
        values, last = start, np.inf
        best: RefinedFit | None = None  # where the contact was solved, and cost least
        for _ in range(_STEPS):
            try:
                model.stand(values)
                here = model.at(values)
                cost = np.inf if here is None else here.cost + model.prior.cost(values)
                if best is not None and cost > best.cost:
                    # a load that wore a scar's edge does not where another had worn it before
                    step = 0.5 * (values - best.values)
                    if best.local.size(step) < _NEAR:
                        return best
                    values = best.values + step
                    continue
                found = refine_fit(model, values, gamma_fit=here)
            except PhysicsError:
                return None
            if found is None or here is None or not found.converged:
                return None
            size = model.distance(found)
            if np.isfinite(last):
                model.bend = size / last
            if size * model.bend < _NEAR:
                model.bend *= _AGED
                return found
            if np.isfinite(last) and model.bend > _FROZEN:
                model.turn()
                size = np.inf
            best = replace(found, values=values, gamma_fit=here)
            values, last = found.values, size
        return None
