"""The same simulation, made quick for a fit: what did not change is not computed again.

The mechanics (contact, wear, stress) of the last few sets of values are kept on a reference grid a
margin wider than the picture. Where the contact stands in the picture is then a shift of that
field, by four-point (cubic) Lagrange interpolation of its two smooth components, never of the
fringe order, which has a cone at isotropic points.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import PhysicsError
from isochrome.optics import fringe_order, make_chain, polariscope_signal
from isochrome.scene import Scene
from isochrome.simulate import SceneState, scene_states, state_difference
from isochrome.stress import PixelGrid, pixel_grid, principal_direction

Array = NDArray[Any]
Solve = Callable[[Scene], SceneState]

MARGIN_PX = 28
"""How far the contact may stand from its nominal place before the reference grid moves with it."""

_KEPT = 8
_STEEPEST = 0.5


class SceneRenderer:
    """Signals of a one-state scene on every `stride`-th pixel of a picture."""

    def __init__(
        self, scene: Scene, shape: tuple[int, int], *, stride: int = 1, solve: Solve | None = None
    ) -> None:
        """`solve` gives a scene's state; None: the scene is solved on its own."""
        self.shape, self.stride = shape, stride
        self._solve = solve or _last_state
        self.pixels = pixel_grid(scene, shape)
        self._fields: OrderedDict[Any, Array] = OrderedDict()
        self._anchor = (self.pixels.left_mm, self.pixels.top_mm)

    def order_field(self, scene: Scene) -> tuple[Array, Array]:
        """Stress difference (rows, cols) and visibility of the fringes at the strided pixels.

        Raises PhysicsError where the scene's values cannot be solved.
        """
        if scene.model != "contact":
            grid = pixel_grid(scene, self.shape)
            state = scene_states(scene)[-1]
            field = state_difference(scene, state, grid.every(self.stride))
            return field, np.ones(field.shape)
        field, base, part = self._shifted(scene)
        return field, self._visibility(scene, base, part)

    def signal(self, scene: Scene) -> Array:
        """Ideal polariscope signal at the strided pixels (rows, cols); air has order zero."""
        specimen = scene.specimen
        assert specimen.thickness_mm is not None and specimen.fringe_value_n_per_mm is not None
        field, visibility = self.order_field(scene)
        field = np.nan_to_num(field)
        order = fringe_order(
            field,
            thickness_mm=specimen.thickness_mm,
            fringe_value_n_per_mm=specimen.fringe_value_n_per_mm,
        )
        chain = make_chain(scene.polariscope, 0 if scene.polariscope.step else None)
        direction = None if chain.ideal else principal_direction(field)
        return polariscope_signal(order, chain, direction=direction, visibility=visibility)

    def _reference(self, scene: Scene) -> Array:
        """The field on the margin-wide grid, for the scene's mechanics."""
        assert scene.camera is not None
        key = (
            scene.specimen, scene.indenter, scene.load, scene.friction, scene.wear,
            scene.numerics, scene.camera.pixel_mm, self._anchor,
        )  # fmt: skip
        if key not in self._fields:
            state = self._solve(scene)
            self._fields[key] = state_difference(scene, state, self._wide(scene))
            while len(self._fields) > _KEPT:
                self._fields.popitem(last=False)
        self._fields.move_to_end(key)
        return self._fields[key]

    def _wide(self, scene: Scene) -> PixelGrid:
        assert scene.camera is not None and scene.camera.pixel_mm is not None
        pixel = scene.camera.pixel_mm
        return replace(
            self.pixels,
            rows=self.shape[0] + 2 * MARGIN_PX,
            cols=self.shape[1] + 2 * MARGIN_PX,
            left_mm=self._anchor[0] - MARGIN_PX * pixel,
            top_mm=self._anchor[1] - MARGIN_PX * pixel,
            pixel_mm=pixel,
        )

    def _shifted(self, scene: Scene) -> tuple[Array, list[int], list[float]]:
        """The field where the scene stands, and whole and broken pixels of its shift."""
        here = pixel_grid(scene, self.shape)
        offset = self._offset(here)
        if max(abs(o) for o in offset) > MARGIN_PX - 3:
            self._anchor = (here.left_mm, here.top_mm)
            self._fields.clear()
            offset = self._offset(here)
        field = self._reference(scene)
        base = [MARGIN_PX + int(np.floor(o)) for o in offset]
        part = [o % 1.0 for o in offset]
        rows = _interpolated(field, base[0], part[0], self.shape[0], self.stride)
        cols = _interpolated(rows.T, base[1], part[1], self.shape[1], self.stride)
        return cols.T, base, part

    def _offset(self, here: PixelGrid) -> tuple[float, float]:
        left, top = self._anchor
        return (here.top_mm - top) / here.pixel_mm, (here.left_mm - left) / here.pixel_mm

    def _visibility(self, scene: Scene, base: list[int], part: list[float]) -> Array:
        """Contrast left by the pixel's area, linear between the reference pixels.

        Not that of the nearest pixel: a fit that starts on a whole pixel would stand on a jump.
        """
        total: Any = 0.0
        for down, across in product((0, 1), repeat=2):
            weight = abs(1 - down - part[0]) * abs(1 - across - part[1])
            if weight > 0.0:
                rows, cols = (
                    slice(b + d, b + d + n, self.stride)
                    for b, d, n in zip(base, (down, across), self.shape, strict=True)
                )
                total = total + weight * self._visibility_at(scene, rows, cols)
        return np.asarray(total)

    def _visibility_at(self, scene: Scene, rows: slice, cols: slice) -> Array:
        """Contrast left by the pixel's area at some reference pixels."""
        specimen = scene.specimen
        assert specimen.thickness_mm is not None and specimen.fringe_value_n_per_mm is not None
        scale = specimen.thickness_mm / specimen.fringe_value_n_per_mm
        field = self._reference(scene)
        down = slice(rows.start + 1, rows.stop + 1, rows.step)
        up = slice(rows.start - 1, rows.stop - 1, rows.step)
        right = slice(cols.start + 1, cols.stop + 1, cols.step)
        left = slice(cols.start - 1, cols.stop - 1, cols.step)
        along = np.abs(field[down, cols]) - np.abs(field[up, cols])
        across = np.abs(field[rows, right]) - np.abs(field[rows, left])
        square = (0.5 * scale * np.pi) ** 2 * (along**2 + across**2)
        # sinc(a) sinc(b) to fourth order, cross term apart; off by 3e-3 at half a fringe a pixel
        return 1.0 - square / 6.0 + square**2 / 120.0


def _last_state(scene: Scene) -> SceneState:
    return scene_states(scene)[-1]


def _interpolated(field: Array, base: int, part: float, count: int, stride: int) -> Array:
    """Rows base + part, base + part + stride, ... by four-point Lagrange interpolation."""
    t = part
    weights = (
        -t * (t - 1.0) * (t - 2.0) / 6.0,
        (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
        -(t + 1.0) * t * (t - 2.0) / 2.0,
        (t + 1.0) * t * (t - 1.0) / 6.0,
    )
    total: Any = 0.0
    for tap, weight in zip((-1, 0, 1, 2), weights, strict=True):
        if weight != 0.0:
            start = base + tap
            total = total + np.float32(weight) * field[start : start + count : stride]
    return np.asarray(total)


def safe_signal(renderer: SceneRenderer, scene: Scene) -> Array:
    """A signal, or NaN everywhere where the values cannot be solved: a fit then steps back."""
    try:
        return renderer.signal(scene)
    except PhysicsError:
        rows, cols = (-(-n // renderer.stride) for n in renderer.shape)
        return np.full((rows, cols), np.nan)
