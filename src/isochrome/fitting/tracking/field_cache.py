"""A video's thinned pixels, prepared once, and the fields there, kept as polynomials.

And the field of one frame on all pixels, which is made when it is wanted.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from isochrome.estimation import FrameData
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.frame.frame_model import (
    CLEAR_SIGMAS,
    ENOUGH,
    GammaFit,
    Pixels,
    some_pixels,
    stored,
    trusted_pixels,
)
from isochrome.fitting.frame.renderer import SceneRenderer
from isochrome.fitting.frame.single_state import with_numerics, with_part
from isochrome.fitting.tracking.field_polynomial import FieldBox, make_field_box
from isochrome.fitting.tracking.wear_state import WORN, TrackCourse
from isochrome.frames import NoiseModel
from isochrome.scene import Numerics, Scene

HIDDEN_PX, _ROOM_PX = 8.0, 4.0
_SHARE = 1.04
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
        for share in (1.0, _SHARE):
            kept.load, step = self.course.lean(share, middle)
            self.renderer.forget()
            fields.append(self.render(middle, False)[0])
        kept.lean = (fields[1] - fields[0]) / np.float32((_SHARE - 1.0) * kept.load * step)

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
        self._renderer = SceneRenderer(
            wide,
            self.shape,
            stride=self.thinned.stride,
            solve=self.course.solve,
            hidden_px=HIDDEN_PX - _ROOM_PX,
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
