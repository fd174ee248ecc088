"""A contact's frames about the values that were found last: every few of their pixels.

The field is that of the contact where the mechanics were solved last, and turns with each value
from there. A contact is solved once a frame or twice, and what turns its field is kept from frame
to frame as long as it serves.
"""

from dataclasses import replace
from math import sqrt

import numpy as np

from isochrome.estimation import STEP, Bounds, FrameData, Prior, no_prior, project
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.frame_model import (
    ENOUGH,
    FrameModel,
    GammaFit,
    LocalModel,
    RefinedFit,
    clear_of_ends,
    inward,
    local_model,
    some_pixels,
    stored,
    turned_row,
)
from isochrome.fitting.frame.renderer import scene_optics
from isochrome.fitting.frame.unknowns import WEAR, fit_region, limits, scales, thinning
from isochrome.fitting.tracking.worn_course import PAST, WornCourse
from isochrome.frames import NoiseModel
from isochrome.scene import Scene

_PIXELS = 20_000
_HIDDEN_PX, _ROOM_PX = 8.0, 4.0
_SWING = 0.2
"""Standard deviation of the load before the first frame over the usual one, before it is seen."""


class TrackedModel(FrameModel):
    """Every few pixels of a course's frames, about `place` (p,), where the contact was solved.

    `bend`, by how much of a step from there its slopes err; `held`, keys of the apparatus whose
    values have an uncertainty; `full`, the largest grey level.
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
            begun = self._worn == 0.0 < self._course.worn_mm2
            grown = begun or self._course.grown(self._worn, values) > _GROWN
        if self._turns is None or grown:
            self.turn()
        elif WEAR in self.keys and self._law > 0.0:
            # a coefficient's turn is its share of what the law has worn, which has become more
            j, more = self.keys.index(WEAR), self._course.law_mm2 / self._law
            self._turns[j] *= np.float32(more)
            if self._by_held is not None:
                self._by_held[j] /= more
            self._law = self._course.law_mm2
        if not self._looked:
            gamma_fit = self.at(values)
            if gamma_fit is not None:
                illumination, background = self._every.light.of(gamma_fit.part.coefficients)
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
        self._worn, self._law = self._course.worn_mm2, self._course.law_mm2
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

    def at(self, values: Array, *, near: Array | None = None) -> GammaFit | None:
        """The linear solution at some values (p,)."""
        return self.solved(self._signal(values)[self._clear], values, near)

    def linearise(self, values: Array, gamma_fit: GammaFit) -> LocalModel:
        """Derivatives at some values, where the linear solution is known."""
        assert self._turns is not None
        rows = [self._row(turn, values, gamma_fit) for turn in self._turns]
        return local_model(self.keys, values, gamma_fit, np.stack(rows), self.prior)

    def _row(self, turn: Array, values: Array, gamma_fit: GammaFit) -> Array:
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
                project(past, gamma_fit.problem, gamma_fit.part)
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
        """Hold the loads before a first frame at the usual one, unless that tells of others.

        By the evidence for them, at even odds: what is known of those loads before the frame and
        after it, both at the usual one. Source: Dickey (1971), Ann. Math. Stat. 42, 204.
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
        signal = self._optics.signal(field, visibility=shown)
        return np.asarray(signal, np.float32)

    def look(self, light: Array) -> None:
        """Choose pixels (n,) by a model of their light, and weigh them by its noise."""
        level = stored(light, self._every.gamma)
        sigma = (self.noise.sigma(level * self._full) / self._full).astype(np.float32)
        every = replace(self._every, weight=1.0 / sigma)
        clear = clear_of_ends(every, light, every.gamma)
        if np.count_nonzero(clear) <= ENOUGH * clear.size:
            clear[:] = True
        self._clear, self.pixels = clear, some_pixels(every, clear)


_TURN = 0.03
"""Largest change of the field (MPa) that shows a derivative of the signal."""
_GROWN = 0.02
"""Growth of a scar whose wear coefficient is tracked after which the turns are made anew."""
