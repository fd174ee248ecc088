"""A contact's frames near some values: a polynomial for the field, derivatives kept, steps."""

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import STEP
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.frame_model import (
    GammaFit,
    LocalModel,
    gamma_slope,
    local_model,
    solve_with_gamma,
)
from isochrome.fitting.frame.renderer import scene_optics
from isochrome.fitting.frame.unknowns import GAMMA, scales
from isochrome.fitting.tracking.field_cache import (
    CachedFields,
    FieldMaker,
    Look,
    Thinned,
    stepped_scene,
)
from isochrome.fitting.tracking.field_polynomial import CHECKED, FieldBox
from isochrome.fitting.tracking.wear_state import WORN, TrackCourse

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
        self,
        course: TrackCourse,
        shape: tuple[int, int],
        thinned: Thinned,
        held: tuple[str, ...] = (),
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
