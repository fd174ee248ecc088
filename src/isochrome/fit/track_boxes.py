"""The fields of a tracked contact by its mechanics, and the polynomials made of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.one_state import with_own_numerics
from isochrome.fit.renderer import SceneRenderer
from isochrome.fit.track_course import WORN, TrackCourse
from isochrome.fit.track_field import FieldBox, make_field_box
from isochrome.fit.track_pixels import Thinned

Array = NDArray[Any]

HIDDEN_PX, _ROOM_PX = 8.0, 4.0
_SHARE = 1.04
"""A load over the mean, by which it is told what swinging loads do to a scar."""


@dataclass
class Kept:
    """A polynomial, along which the scar grows by one load, and what another one does to it.

    `exact` (axes,), the values at which it was last held to the scar, and `mark`, the area A and
    ∫P' dA there; `load` P'_0 (N/mm); `lean` (n,), the field that ∫(P' - P'_0) dA adds per unit.
    """

    box: FieldBox
    exact: Array
    mark: tuple[float, float]
    load: float = 0.0
    lean: Array | None = None


class FieldMaker:
    """Fields at thinned pixels as the axes of a course move, on the scars that it has worn."""

    def __init__(self, course: TrackCourse, shape: tuple[int, int], thinned: Thinned) -> None:
        """`course`; `shape` (rows, cols) of a frame; `thinned`, its pixels."""
        self.course, self.shape, self.thinned = course, shape, thinned
        self._renderer: SceneRenderer | None = None

    def make(self, values: Array, low: Array, high: Array, degrees: tuple[int, ...]) -> Kept:
        """A polynomial from `low` to `high` (axes,) for a frame of some values, see `Kept`.

        Raises PhysicsError where a contact in it cannot be solved.
        """
        self._widen(high)
        self.course.wear(values, low, high)
        self._anew()
        box = make_field_box(self.render, low, high, degrees, self.course.places)
        exact = values.copy()
        if WORN in self.course.axes:
            # beyond the lower end the contact wears on by a mean, not as it did
            at = self.course.axes.index(WORN)
            exact[at] = low[at]
        return Kept(box, exact, self.course.mark(values))

    def exact(self, values: Array) -> Array:
        """The field (n,) of some values on the scar that they and those before have worn."""
        self.course.wear(values, values, values)
        self._anew()
        return self.render(values, False)[0]

    def lean(self, kept: Kept) -> None:
        """What a larger load does to the scar, see `Kept`."""
        if WORN not in self.course.axes:
            return
        fields, middle = [], kept.box.middle
        for share in (1.0, _SHARE):
            kept.load, step = self.course.lean(share, middle)
            self._anew()
            fields.append(self.render(middle, False)[0])
        kept.lean = (fields[1] - fields[0]) / np.float32((_SHARE - 1.0) * kept.load * step)

    def render(self, values: Array, seen: bool) -> tuple[Array, Array | None]:
        """Values to the field and the visibility at the pixels, by the mechanics."""
        assert self._renderer is not None
        scene = self.course.field_scene(values).model_copy(
            update={"numerics": self.course.numerics}
        )
        keep = self.thinned.keep
        if not seen:
            return self._renderer.field_alone(scene)[keep], None
        field, visibility = self._renderer.order_field(scene)
        return field[keep], np.broadcast_to(visibility, field.shape)[keep]

    def _widen(self, high: Array) -> None:
        """Make the grid, and what renders on it, hold the widest contact so far."""
        scene = self.course.field_scene(high)
        needed = with_own_numerics(scene, room=1.0).numerics.window_mm or np.inf
        before = self.course.numerics
        wide_enough = before is not None and (before.window_mm or 0.0) >= needed
        if wide_enough and self._renderer is not None:
            return
        wide = with_own_numerics(scene)
        if before is not None:  # scars lie on its nodes
            fixed = {"spacing_mm": before.spacing_mm}
            fixed |= {"window_mm": before.window_mm} if wide_enough else {}
            wide = wide.model_copy(update={"numerics": wide.numerics.model_copy(update=fixed)})
        self.course.use(wide)
        self._renderer = SceneRenderer(
            wide,
            self.shape,
            stride=self.thinned.stride,
            solve=self.course.solve,
            hidden_px=HIDDEN_PX - _ROOM_PX,
        )

    def _anew(self) -> None:
        """Have the renderer solve on the scars that there are now."""
        assert self._renderer is not None
        self._renderer.forget()
