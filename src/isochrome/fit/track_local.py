"""A contact's frames near some values: a polynomial for the field, derivatives kept, steps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import PhysicsError
from isochrome.fit.local import LocalModel, project
from isochrome.fit.one_state import with_own_numerics
from isochrome.fit.renderer import SceneRenderer
from isochrome.fit.tone import Toned, solve_toned
from isochrome.fit.track_course import TrackCourse
from isochrome.fit.track_field import FieldBox, Render, make_field_box
from isochrome.fit.track_pixels import Look, Thinned
from isochrome.optics import fringe_order, make_chain, polariscope_signal
from isochrome.stress import principal_direction

Array = NDArray[Any]

HIDDEN_PX, _ROOM_PX = 8.0, 4.0
_BEYOND = 1.1
"""Half-widths of its box up to which a polynomial is used."""
_KEPT = 12
"""Polynomials that are kept, some 6 MB each: a load that swings comes back to them."""
_FIELD_ERROR = 0.3
"""What a polynomial may do to a value near its box's corners, in standard uncertainties."""
_CHECKED = 0.85
"""Where that is looked at, in half-widths: beyond all corners that were rendered."""
_LARGEST, _SMALLEST, _SMALLER, _ORDER = 1.2, 0.1, 0.6, 4
"""Sizes of a box; how much smaller the next try is at least; power of the size in the error."""
_SLOPE = 1e-3
"""Difference step of the signal's derivatives, in half-widths of the box."""


class TrackModel:
    """Thinned pixels, and what they show as the axes of a course move.

    Attributes: `local`, the derivatives, None where they must be made; `look`, the pixels in use.
    """

    def __init__(self, course: TrackCourse, shape: tuple[int, int], thinned: Thinned) -> None:
        """`course`; `shape` (rows, cols) of a frame; `thinned`, its pixels."""
        self.course, self.shape, self.thinned = course, shape, thinned
        polariscope = course.scene.polariscope
        self._chain = make_chain(polariscope, 0 if polariscope.step else None)
        self._boxes: list[FieldBox] = []
        self._box: FieldBox | None = None
        self._size = _LARGEST
        self.local: LocalModel | None = None
        self.look: Look | None = None

    def see(self, thinned: Thinned) -> None:
        """Go on with the same pixels of another noise."""
        self.thinned, self.local, self.look = thinned, None, None

    def holds(self, values: Array) -> bool:
        """Whether the polynomial is good at some values (axes,)."""
        return self.reach(values) <= _BEYOND

    def reach(self, values: Array) -> float:
        """How far some values (axes,) are from the polynomial's middle, in half-widths."""
        return np.inf if self._box is None else float(np.abs(self._box.place(values)).max())

    def move(self, values: Array, levels: Array) -> bool:
        """Take a polynomial that holds some values, or make it; False where that is impossible.

        Parameters: `values` (axes,); `levels` (n,) of the frame, see `Thinned.levels`.
        """
        return self._again(values) or self._centre(values, levels)

    def signal(self, values: Array) -> Array:
        """The polariscope's signal at the pixels (n,)."""
        assert self._box is not None
        return self._signal(*self._box.at(values))

    def _again(self, values: Array) -> bool:
        """Take up a polynomial that was made before, where one holds these values."""
        for box in self._boxes:
            if np.abs(box.place(values)).max() <= 1.0:
                self._box, self.local, self.look = box, None, None
                return True
        return False

    def _centre(self, values: Array, levels: Array) -> bool:
        """Make the polynomial about some values, as wide as it errs little; False if impossible."""
        while True:
            low, high, degrees = self.course.box(values, self._size)
            try:
                render = self._renderer(values, high)
                self._box = make_field_box(render, low, high, degrees, self.course.places)
                self.local = self.look = None
                error = self._field_error(render, values, levels)
            except PhysicsError:
                error = np.inf
            smallest = self._size <= _SMALLEST
            if error <= _FIELD_ERROR or (smallest and np.isfinite(error)):
                assert self._box is not None
                self._boxes = [self._box, *self._boxes[: _KEPT - 1]]
                return True
            if smallest:
                return False
            fit = (0.5 * _FIELD_ERROR / error) ** (1.0 / _ORDER)
            self._size = max(_SMALLEST, self._size * min(_SMALLER, fit))

    def _renderer(self, values: Array, high: Array) -> Render:
        """Values to the field and the visibility at the pixels, by the mechanics."""
        thinned = self.thinned
        widest = with_own_numerics(self.course.field_scene(high))
        numerics = widest.numerics
        renderer = SceneRenderer(
            widest,
            self.shape,
            stride=thinned.stride,
            solve=self.course.solver(numerics),
            hidden_px=HIDDEN_PX - _ROOM_PX,
        )

        def render(values: Array, seen: bool) -> tuple[Array, Array | None]:
            scene = self.course.field_scene(values).model_copy(update={"numerics": numerics})
            if not seen:
                return renderer.field_alone(scene)[thinned.keep], None
            field, visibility = renderer.order_field(scene)
            return field[thinned.keep], np.broadcast_to(visibility, field.shape)[thinned.keep]

        return render

    def _field_error(self, render: Render, values: Array, levels: Array) -> float:
        """What the polynomial does to the values near two corners, in standard uncertainties."""
        assert self._box is not None
        toned = self.at(values, levels)
        if toned is None:
            return float("inf")
        toned = self.linearise(values, levels, toned)
        local, look = self.local, self.look
        assert local is not None and look is not None
        worst = 0.0
        other = np.resize([1.0, -1.0], len(values))
        for signs in (np.ones(len(values)), other):
            corner = self._box.middle + _CHECKED * signs * self._box.half
            field, seen = render(corner, True)
            assert seen is not None
            exact, near = self._signal(field, seen), self.signal(corner)
            change = (exact - near)[look.clear] * toned.part.amplitude
            step = local.step(change)
            worst = max(worst, step_size(local, step))
        return worst

    def _signal(self, field: Array, visibility: Array) -> Array:
        """The polariscope's signal at the pixels."""
        specimen = self.course.scene.specimen
        assert specimen.thickness_mm is not None and specimen.fringe_value_n_per_mm is not None
        order = fringe_order(
            field,
            thickness_mm=specimen.thickness_mm,
            fringe_value_n_per_mm=specimen.fringe_value_n_per_mm,
        )
        direction = None if self._chain.ideal else principal_direction(field)
        return np.asarray(
            polariscope_signal(order, self._chain, direction=direction, visibility=visibility),
            dtype=np.float32,
        )

    def at(self, values: Array, levels: Array) -> Toned | None:
        """Illumination and background of a frame at some values."""
        assert self._box is not None
        signal = self._signal(*self._box.at(values))
        if self.look is None:
            self.look = self.thinned.look(np.maximum(levels, 0.0) ** self.thinned.gamma)
        return self._solved(signal, levels)

    def _solved(self, signal: Array, levels: Array) -> Toned | None:
        assert self.look is not None
        return solve_toned(self.look.pixels(levels), signal[self.look.clear], self.look.gamma)

    def linearise(self, values: Array, levels: Array, toned: Toned) -> Toned:
        """Derivatives at some values, and which pixels to use there; the solution with these."""
        assert self._box is not None
        field, visibility = self._box.at(values)
        signal = self._signal(field, visibility)
        self.look = self.thinned.look(self.thinned.light_of(toned, signal))
        again = self._solved(signal, levels)
        assert again is not None
        rows = np.empty((self.course.count, again.residual.size), np.float32)
        for j in range(self.course.count):
            step = np.float32(_SLOPE * self._box.half[j])
            across, seen = self._box.slope(values, j)
            moved = self._signal(field + step * across, visibility + step * seen)
            rows[j] = (moved - signal)[self.look.clear] * (again.part.amplitude / step)
        squares = np.array([np.sum(np.square(row), dtype=float) for row in rows])
        project(rows, again.problem, again.part)
        at = values[: self.course.count].copy()
        self.local = LocalModel(self.course.axes[: self.course.count], at, again, rows, squares)
        return again


def step_size(local: LocalModel, step: Array) -> float:
    """A step in standard uncertainties."""
    return float(max(0.0, float(step @ local.normal @ step)) ** 0.5)
