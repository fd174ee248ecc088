"""A video's thinned pixels, prepared once, and the fields there, kept as polynomials.

And the field of one frame on all pixels, which is made when it is wanted.

A contact's frames near some values: a polynomial for the field, derivatives kept, steps.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import STEP, FrameData
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.frame.frame_model import (
    CLEAR_SIGMAS,
    ENOUGH,
    GammaFit,
    LocalModel,
    Pixels,
    gamma_slope,
    local_model,
    solve_with_gamma,
    some_pixels,
    stored,
    trusted_pixels,
)
from isochrome.fitting.frame.renderer import SceneRenderer, scene_optics
from isochrome.fitting.frame.single_state import with_numerics, with_part
from isochrome.fitting.frame.unknowns import GAMMA, scales
from isochrome.fitting.tracking.field_polynomial import CHECKED, FieldBox, make_field_box
from isochrome.fitting.tracking.wear_state import WORN, TrackCourse
from isochrome.frames import NoiseModel
from isochrome.scene import Numerics, Scene

HIDDEN_PX, _ROOM_PX = 8.0, 4.0
_MORE_LOAD = 1.04
"""A load over the mean, by which it is told what swinging loads do to a scar."""


@dataclass(frozen=True)
class Thinned:
    """Every `stride`-th pixel where a video can be trusted: `pixels` (n,) of one of its frames.

    `full`, the largest grey level; `noise`, of the camera.
    """

    stride: int
    pixels: Pixels
    full: float
    noise: NoiseModel

    def levels(self, image: Array) -> Array:
        """A frame's levels at the pixels (n,), fractions of full scale; NaN where it has none."""
        thin = image[:: self.stride, :: self.stride][self.pixels.keep].astype(np.float32)
        thin /= np.float32(self.full)
        return thin

    def look(self, model: Array) -> Look:
        """Which pixels to use, and with what weight, about a model (n,) of the light."""
        level = stored(model, self.pixels.gamma)
        sigma = (self.noise.sigma(level * self.full) / self.full).astype(np.float32)
        room = CLEAR_SIGMAS * sigma
        clear = (level > room) & (level < 1.0 - room)
        if np.count_nonzero(clear) <= ENOUGH * clear.size:
            clear[:] = True
        return Look(clear, some_pixels(replace(self.pixels, weight=1.0 / sigma), clear))

    def light_of(self, gamma_fit: GammaFit, signal: Array) -> Array:
        """The light (n,) of a linear solution at all the pixels, for their signal (n,)."""
        split = len(self.pixels.light)
        a, c = np.split(gamma_fit.part.coefficients.astype(np.float32), [split])
        return np.asarray((a @ self.pixels.light) * signal + c @ self.pixels.dark)


@dataclass(frozen=True)
class Look:
    """The pixels in use: `clear` (n,) of the thinned ones, `used`, with their weights and bases."""

    clear: Mask
    used: Pixels

    def pixels(self, levels: Array) -> Pixels:
        """The pixels of a frame from its thinned levels."""
        return replace(self.used, raw=levels[self.clear])


def thin_frame(
    data: FrameData, region: Mask, stride: int, *, full: float, noise: NoiseModel
) -> Thinned:
    """The pixels of a prepared frame, whose like all of a video's frames have.

    Parameters: `data`, whole; `region` (rows, cols), strided; `stride`; `full`, the largest grey
    level; `noise`. Returns a Thinned.
    """
    return Thinned(stride, trusted_pixels(data.every(stride), region), full, noise)


@dataclass
class CachedFields:
    """A polynomial, along which the scar grows by one load, and what another one does to it.

    `exact` (axes,), the values at which it was last held to the scar, and `mark`, the area A and
    ∫P' dA there; `load` P'_0 (N/mm); `lean` (n,), the field that ∫(P' - P'_0) dA adds per unit;
    `beside`, by what is held, what its step adds to field and visibility (n,).
    """

    box: FieldBox
    exact: Array
    mark: tuple[float, float]
    load: float = 0.0
    lean: Array | None = None
    beside: dict[str, tuple[Array, Array]] = field(default_factory=dict)


class FieldMaker:
    """Fields at thinned pixels as the axes of a course move, on the scars that it has worn."""

    def __init__(
        self, course: TrackCourse, shape: tuple[int, int], thinned: Thinned, steps: dict[str, float]
    ) -> None:
        """`course`; `shape` (rows, cols) of a frame; `thinned`, its pixels.

        `steps` of keys that are held, by which the fields beside are made.
        """
        self.course, self.shape, self.thinned, self._steps = course, shape, thinned, steps
        self._renderer: SceneRenderer | None = None

    def make(
        self, values: Array, low: Array, high: Array, degrees: tuple[int, ...]
    ) -> CachedFields:
        """A polynomial from `low` to `high` (axes,) for a frame of some values, see `CachedFields`.

        Raises PhysicsError where a contact in it cannot be solved.
        """
        self._widen(high)
        self.course.wear(values, low, high)
        self.renderer.forget()  # the scars are others now
        box = make_field_box(self.render, low, high, degrees, self.course.places)
        exact = values.copy()
        if WORN in self.course.axes:
            # beyond the lower end the contact wears on by a mean, not as it did
            at = self.course.axes.index(WORN)
            exact[at] = low[at]
        beside = self._beside(box.middle)
        return CachedFields(box, exact, self.course.mark(values), beside=beside)

    def exact(self, values: Array) -> Array:
        """The field (n,) of some values on the scar that they and those before have worn."""
        self.course.wear(values, values, values)
        self.renderer.forget()
        return self.render(values, False)[0]

    def lean(self, kept: CachedFields) -> None:
        """What a larger load does to the scar, see `CachedFields`."""
        if WORN not in self.course.axes:
            return
        fields, middle = [], kept.box.middle
        for share in (1.0, _MORE_LOAD):
            kept.load, step = self.course.lean(share, middle)
            self.renderer.forget()
            fields.append(self.render(middle, False)[0])
        kept.lean = (fields[1] - fields[0]) / np.float32((_MORE_LOAD - 1.0) * kept.load * step)

    def _beside(self, middle: Array) -> dict[str, tuple[Array, Array]]:
        """What the steps of what is held add to field and visibility at some values (axes,)."""
        if not self._steps:
            return {}
        here, seen = self.render(middle, True)
        result = {}
        for key, step in self._steps.items():
            there, shown = self.render(middle, True, {key: step})
            assert seen is not None and shown is not None
            result[key] = there - here, shown - seen
        return result

    def render(
        self, values: Array, seen: bool, steps: dict[str, float] | None = None
    ) -> tuple[Array, Array | None]:
        """Values to the field and the visibility at the pixels, by the mechanics.

        `steps` of keys besides the axes.
        """
        numerics = {"numerics": self.course.numerics}
        scene = stepped_scene(self.course.field_scene(values), steps or {})
        scene = scene.model_copy(update=numerics)
        keep = self.thinned.pixels.keep
        if not seen:
            return self.renderer.field_alone(scene)[keep], None
        made, visibility = self.renderer.order_field(scene)
        return made[keep], np.broadcast_to(visibility, made.shape)[keep]

    def _widen(self, high: Array) -> None:
        """Make the grid, and what renders on it, hold the widest contact so far."""
        scene = self.course.field_scene(high)
        needed = with_numerics(scene, room=1.0).numerics.window_mm or np.inf
        before = self.course.numerics
        wide_enough = before is not None and (before.window_mm or 0.0) >= needed
        if wide_enough and self._renderer is not None:
            return
        wide = with_numerics(scene)
        if before is not None:  # scars lie on its nodes
            fixed = {"spacing_mm": before.spacing_mm}
            fixed |= {"window_mm": before.window_mm} if wide_enough else {}
            wide = with_part(wide, "numerics", **fixed)
        self.course.use(wide)
        stride, hidden_px = self.thinned.stride, HIDDEN_PX - _ROOM_PX
        self._renderer = SceneRenderer(
            wide, self.shape, stride=stride, solve=self.course.solve, hidden_px=hidden_px
        )

    @property
    def renderer(self) -> SceneRenderer:
        """What renders on the widest grid so far."""
        assert self._renderer is not None
        return self._renderer


class WholeField:
    """Stress differences of a course's frames on all pixels of a picture, by the mechanics.

    A polynomial on all pixels would take gigabytes. What one frame needs are some milliseconds: the
    scar grows on from the one that the track has kept, its contact is solved from the last one's,
    and one transform a row gives the field.
    """

    def __init__(self, course: TrackCourse, shape: tuple[int, int]) -> None:
        """`course`, that has passed the frames; `shape` (rows, cols) of one."""
        self._course, self._shape = course, shape
        self._grid: Numerics | None = None
        self._renderer: SceneRenderer | None = None

    def at(self, values: Array) -> tuple[Scene, Array]:
        """The one-state scene of the last frame's values (axes,), and its field.

        Returns the scene, and the stress difference (rows, cols), MPa. Raises PhysicsError where
        the contact cannot be solved.
        """
        scene, state = self._course.whole_state(values)
        if self._renderer is None or self._grid != scene.numerics:
            self._grid = scene.numerics
            self._renderer = SceneRenderer(scene, self._shape)
        return scene, self._renderer.difference(scene, state)


def stepped_scene(scene: Scene, steps: dict[str, float]) -> Scene:
    """A scene with steps added to some of its keys."""
    changed = {key: scene.get(key) + step for key, step in steps.items()}
    return scene.with_values(changed) if changed else scene


BEYOND = 1.1
"""Half-widths of its box up to which a polynomial is used."""
_KEPT = 12
"""Polynomials that are kept, 3 to 10 MB each (21 terms of a worn contact, some 60 of another, at up
to 20,000 pixels): a load that swings comes back to them."""
_FIELD_ERROR = 0.3
"""What a polynomial may do to a value near its box's corners, in standard uncertainties."""
_LARGEST, _LARGEST_WORN, _SMALLEST, _SMALLER, _ORDER = 0.7, 0.6, 0.1, 0.8, 4
"""Sizes of a box: tried first, first of a worn contact, and last; how much smaller the next try is
at least; power of the size in the error."""
_SHARE = 0.004
"""What a worn contact's polynomial may do to a value over the way to a corner: three times as much
of a step is then wrong by its slopes."""
_AWAY, _ASIDE = 8.0, 0.01
"""Standard uncertainties, and half-widths of what is not tracked, from the exact field from which
on a worn contact's is made anew: its slopes then err by a tenth of one at most."""
_SLOPE = 1e-3
"""Difference step of the signal's derivatives, in half-widths of the box."""
_DUE, _DUE_LEAST, _DUE_MOST = 0.003, 0.001, 0.02
"""Growth of a scar after which a polynomial is held to the exact one, at first, least and most."""
_CLOSE, _OFF, _MORE = 0.2, 0.5, 1.5
"""What was then found wrong, in standard uncertainties, that puts the next time off, or near,
and by how much."""


class TrackModel:
    """Thinned pixels, and what they show as the axes of a course move.

    Attributes: `local`, the derivatives, None where they must be made, and `held_rows` (m, n),
    those by what is held; `look`, the pixels in use.
    """

    def __init__(
        self, course: TrackCourse, shape: tuple[int, int], thinned: Thinned, held: tuple[str, ...]
    ) -> None:
        """`course`; `shape` (rows, cols) of a frame; `thinned`, its pixels.

        `held`, keys of the apparatus whose values are known with an uncertainty.
        """
        self.course, self.thinned = course, thinned
        steps = (STEP * scales(course.scene, held)).tolist()
        self._steps = dict(zip(held, steps, strict=True))
        self.held_rows = np.empty((0, 0), np.float32)
        self._optics = scene_optics(course.scene)
        self._boxes: list[CachedFields] = []
        self._now: CachedFields | None = None
        shown = {key: step for key, step in self._steps.items() if key != GAMMA}
        self._fields = FieldMaker(course, shape, thinned, shown)
        self._size, self._due = _LARGEST_WORN if WORN in course.axes else _LARGEST, _DUE
        self.local: LocalModel | None = None
        self.look: Look | None = None

    def see(self, thinned: Thinned) -> None:
        """Go on with the same pixels of another noise."""
        self.thinned, self.local, self.look = thinned, None, None

    def reach(self, values: Array) -> float:
        """How far some values (axes,) are from the polynomial's middle, in half-widths."""
        return np.inf if self._now is None else float(np.abs(self._box.place(values)).max())

    def move(self, values: Array, levels: Array) -> bool:
        """Take a polynomial that holds some values, or make it; False where that is impossible.

        Parameters: `values` (axes,); `levels` (n,) of the frame, see `Thinned.levels`.
        """
        for selected in self._boxes:
            if np.abs(selected.box.place(values)).max() <= 1.0:
                self._now, self.local, self.look = selected, None, None
                return True
        return self._centre(values, levels)

    @property
    def _kept(self) -> CachedFields:
        assert self._now is not None
        return self._now

    @property
    def _box(self) -> FieldBox:
        return self._kept.box

    def _field(self, values: Array) -> tuple[Array, Array]:
        """Field and visibility at the pixels, by the polynomial and by the loads since."""
        selected = self._kept
        field, seen = selected.box.at(values)
        if selected.lean is not None:
            area, moment = self.course.mark(values)
            more = moment - selected.mark[1] - selected.load * (area - selected.mark[0])
            field = field + np.float32(more) * selected.lean
        return field, seen

    def worn_signal(self, values: Array) -> Array:
        """The signal (n,) of the pixels in use on the scar that `course` says, by the mechanics.

        Parameters: `values` (axes,). Raises PhysicsError where the contact cannot be solved.
        """
        assert self.look is not None
        _, seen = self._field(values)
        return self._signal(self._fields.exact(values), seen)[self.look.clear]

    def stale(self, values: Array) -> bool:
        """Whether the scar has grown, or another load has worn it, since it was exact."""
        selected = self._now
        if selected is None:
            return False
        off = np.abs(selected.box.place(values) - selected.box.place(selected.exact))
        grown, last = self.course.grown(values, selected.exact)
        if grown + last * off.max() > self._due:
            return True
        if WORN not in self.course.axes:
            return False
        count = self.course.count
        if self.local is None or (len(off) > count and off[count:].max() > _ASIDE):
            return bool(off.max() > 0.0)
        return self.local.size((values - selected.exact)[:count]) > _AWAY

    def refresh(self, values: Array, levels: Array) -> bool:
        """Hold the polynomial to the scar that was worn until now; False where there is none.

        The exact field less the polynomial's at some values (axes,) is added to it.
        """
        selected = self._kept
        try:
            field = self._fields.exact(values)
        except PhysicsError:
            return False
        near, seen = self._field(values)
        gamma_fit = self.at(values, levels)
        if gamma_fit is None:
            return False
        if self.local is None:
            gamma_fit = self.linearise(values, levels, gamma_fit)
        wrong = self._step_of(self._signal(field, seen) - self._signal(near, seen), gamma_fit)
        if wrong < _CLOSE:
            self._due = min(_DUE_MOST, _MORE * self._due)
        elif wrong > _OFF:
            self._due = max(_DUE_LEAST, self._due / _MORE)
        selected.box.shift(field - selected.box.at(values)[0])
        selected.exact, selected.mark = values.copy(), self.course.mark(values)
        return True

    def _centre(self, values: Array, levels: Array) -> bool:
        """Make the polynomial about some values, as wide as it errs little; False if impossible."""
        while True:
            low, high, degrees = self.course.box(values, self._size)
            try:
                self._now = self._fields.make(values, low, high, degrees)
                self.local = self.look = None
                error = self._field_error(values, levels)
            except PhysicsError:
                error = np.inf
            smallest = self._size <= _SMALLEST
            if error <= self._allowed() or (smallest and np.isfinite(error)):
                self._fields.lean(self._kept)
                self._boxes = [self._kept, *self._boxes[: _KEPT - 1]]
                return True
            if smallest:
                return False
            fit = (0.5 * self._allowed() / error) ** (1.0 / _ORDER)
            self._size = max(_SMALLEST, self._size * min(_SMALLER, fit))

    def _allowed(self) -> float:
        """The error that a polynomial may have, in standard uncertainties."""
        if WORN not in self.course.axes or self.local is None:
            return _FIELD_ERROR
        way = CHECKED * self._box.half[: self.course.count]
        return max(_FIELD_ERROR, _SHARE * self.local.size(way))

    def _field_error(self, values: Array, levels: Array) -> float:
        """What the polynomial does to the values near two corners, in standard uncertainties."""
        gamma_fit = self.at(values, levels)
        if gamma_fit is None:
            return float("inf")
        gamma_fit = self.linearise(values, levels, gamma_fit)
        worst = 0.0
        other = np.resize([1.0, -1.0], len(values))
        for signs in (np.ones(len(values)), other):
            corner = self._box.middle + CHECKED * signs * self._box.half
            field, seen = self._fields.render(corner, True)
            assert seen is not None
            exact, near = self._signal(field, seen), self._signal(*self._box.at(corner))
            worst = max(worst, self._step_of(exact - near, gamma_fit))
        return worst

    def _step_of(self, change: Array, gamma_fit: GammaFit) -> float:
        """What a change of the signal (n,) moves the values by, in standard uncertainties."""
        local, look = self.local, self.look
        assert local is not None and look is not None
        return local.size(local.step(change[look.clear] * gamma_fit.part.amplitude))

    def _signal(self, field: Array, visibility: Array) -> Array:
        """The polariscope's signal at the pixels."""
        return np.asarray(self._optics.signal(field, visibility=visibility), dtype=np.float32)

    def at(self, values: Array, levels: Array) -> GammaFit | None:
        """Illumination and background of a frame at some values."""
        signal = self._signal(*self._field(values))
        if self.look is None:
            self.look = self.thinned.look(np.maximum(levels, 0.0) ** self.thinned.pixels.gamma)
        return self._solved(signal, levels)

    def _solved(self, signal: Array, levels: Array) -> GammaFit | None:
        assert self.look is not None
        pixels = self.look.pixels(levels)
        return solve_with_gamma(pixels, signal[self.look.clear], pixels.gamma)

    def linearise(self, values: Array, levels: Array, gamma_fit: GammaFit) -> GammaFit:
        """Derivatives at some values, and which pixels to use there; the solution with these."""
        field, visibility = self._field(values)
        signal = self._signal(field, visibility)
        self.look = self.thinned.look(self.thinned.light_of(gamma_fit, signal))
        again = self._solved(signal, levels)
        assert again is not None
        rows = np.empty((self.course.count, again.residual.size), np.float32)
        for j in range(self.course.count):
            step = np.float32(_SLOPE * self._box.half[j])
            across, seen = self._box.slope(values, j)
            moved = self._signal(field + step * across, visibility + step * seen)
            rows[j] = (moved - signal)[self.look.clear] * (again.part.amplitude / step)
        tracked = slice(self.course.count)
        self.local = local_model(self.course.axes[tracked], values[tracked], again, rows)
        self.held_rows = self._by_held(field, visibility, again)
        return again

    def _by_held(self, field: Array, visibility: Array, gamma_fit: GammaFit) -> Array:
        """Derivatives by what is held (m, n), about a field and its visibility."""
        assert self.look is not None
        clear = self.look.clear
        rows = np.empty((len(self._steps), gamma_fit.residual.size), np.float32)
        here = self._signal(field, visibility)
        for row, (key, step) in zip(rows, self._steps.items(), strict=True):
            if key == GAMMA:
                row[:] = gamma_slope(gamma_fit, self.thinned.pixels.gamma)
                continue
            more, seen = self._kept.beside[key]
            optics = scene_optics(stepped_scene(self.course.scene, {key: step}))
            moved = optics.signal(field + more, visibility=visibility + seen)
            row[:] = (moved - here)[clear] * (gamma_fit.part.amplitude / np.float32(step))
        return rows
