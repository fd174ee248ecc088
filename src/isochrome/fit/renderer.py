"""The same simulation, made quick for a fit: what did not change is not computed again.

The mechanics (contact, wear) of the last few sets of values are kept, and so is the last field.
Where the contact stands in the picture is a phase of the tractions' waves, see
`isochrome.stress.series`: the field is made where it is wanted, on every pixel or on a few.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import SurfaceState
from isochrome.errors import PhysicsError
from isochrome.optics import (
    fringe_order,
    make_chain,
    pixel_visibility,
    polariscope_signal,
    slope_visibility,
)
from isochrome.scene import Scene
from isochrome.simulate import SceneState, scene_states, state_difference
from isochrome.simulate.model import regular_stress
from isochrome.stress import PixelGrid, pixel_grid, principal_direction
from isochrome.stress.series import SeriesField, SeriesGrid, make_series_grid, series_difference

Array = NDArray[Any]
Solve = Callable[[Scene], SceneState]

_KEPT = 8
_SLACK = 1.15
"""Reach of a series over what its first place needs: a contact may move so far in the picture."""


@dataclass(frozen=True)
class _Rendered:
    """The last field with what it was made of: `state`, and `key`, where that stood."""

    state: SceneState
    key: tuple[Any, ...]
    field: Array
    visibility: Array


class SceneRenderer:
    """Signals of a one-state scene on every `stride`-th pixel of a picture."""

    def __init__(
        self,
        scene: Scene,
        shape: tuple[int, int],
        *,
        stride: int = 1,
        solve: Solve | None = None,
        hidden_px: float = 0.0,
        rough: bool = False,
    ) -> None:
        """`solve` gives a scene's state; None: the scene is solved on its own.

        `hidden_px`, depth above which nobody looks; `rough`, whether the pixels' area is left out.
        """
        self.shape, self.stride = shape, stride
        self._hidden_px, self._rough = hidden_px, rough
        self._solve = solve or _last_state
        self._camera = scene.camera
        self._states: OrderedDict[Any, SceneState] = OrderedDict()
        self._series: SeriesGrid | None = None
        self._last: _Rendered | None = None

    def order_field(self, scene: Scene) -> tuple[Array, Array]:
        """Stress difference (rows, cols) and visibility of the fringes at the strided pixels.

        The visibility is that of the pixels' area; with a stride, and so without all pixels to
        blur, it stands for the camera's blur too.
        Raises PhysicsError where the scene's values cannot be solved.
        """
        camera = scene.camera
        assert camera is not None
        state = self._state(scene)
        blur = camera.blur_px if self.stride > 1 else 0.0
        key = (*_standing(scene), blur)
        last = self._last
        if last is None or last.state is not state or last.key != key:
            made = self._field(scene, state, slopes=self.stride > 1 and not self._rough)
            last = _Rendered(state, key, made.difference, self._visibility(scene, made, blur))
            self._last = last
        return last.field, last.visibility

    def signal(self, scene: Scene, *, visibility: Array | None = None) -> Array:
        """Polariscope signal at the strided pixels (rows, cols); no specimen, no light.

        Parameters: `scene`; `visibility`, where it is known. Raises PhysicsError where the scene's
        values cannot be solved.
        """
        if visibility is None:
            field, visibility = self.order_field(scene)
        else:
            field = self.field_alone(scene)
        if scene.model != "contact":
            field = np.nan_to_num(field)
        order = _order(scene, field)
        chain = make_chain(scene.polariscope, 0 if scene.polariscope.step else None)
        direction = None if chain.ideal else principal_direction(field)
        signal = polariscope_signal(order, chain, direction=direction, visibility=visibility)
        camera = scene.camera
        assert camera is not None
        if camera.blur_px > 0.0 and self.stride == 1:
            from scipy.ndimage import gaussian_filter

            signal[: _first_row(scene, self._pixels(scene))] = 0.0
            signal = gaussian_filter(signal, camera.blur_px, mode="nearest")
        return signal

    def forget(self) -> None:
        """Solve every scene anew: what `solve` puts it on has changed."""
        self._states.clear()
        self._last = None

    def _state(self, scene: Scene) -> SceneState:
        """The solved mechanics: place, optics and bulk stress do not change them."""
        load = scene.load
        key = (
            scene.specimen, scene.indenter, load and (load.normal_n, load.tangential_n),
            scene.friction, scene.wear, scene.numerics,
        )  # fmt: skip
        if key not in self._states:
            # the surface nodes divide the pixels that the fit began with, whatever they become
            self._states[key] = self._solve(scene.model_copy(update={"camera": self._camera}))
            while len(self._states) > _KEPT:
                self._states.popitem(last=False)
        self._states.move_to_end(key)
        return self._states[key]

    def _pixels(self, scene: Scene) -> PixelGrid:
        return pixel_grid(scene, self.shape).every(self.stride)

    def field_alone(self, scene: Scene) -> Array:
        """The field without its visibility; the last one if only the optics have changed.

        Raises PhysicsError where the scene's values cannot be solved.
        """
        state, last = self._state(scene), self._last
        if last is not None and last.state is state and last.key[:-1] == _standing(scene):
            return last.field
        return self._field(scene, state, slopes=False).difference

    def _field(self, scene: Scene, state: SceneState, *, slopes: bool) -> SeriesField:
        """The field of one state where the scene stands, and its slopes where they are wanted."""
        pixels = self._pixels(scene)
        if state.surface is None:
            return SeriesField(state_difference(scene, state, pixels), None, None)
        made = self._waves(state.surface, pixels, slopes)
        regular = regular_stress(scene, state.surface, pixels)
        if not regular:
            return made
        added = regular.difference(pixels.x_mm[None, :], pixels.z_mm[:, None])
        return replace(made, difference=made.difference + added.astype(np.complex64))

    def _visibility(self, scene: Scene, made: SeriesField, blur: float) -> Array:
        """What is left of the fringes' contrast by the pixels' area, and by a blur."""
        field, pixels = made.difference, self._pixels(scene)
        if self.stride == 1:
            order = _order(scene, field)
            order[: _first_row(scene, pixels)] = np.nan
            return np.nan_to_num(pixel_visibility(order)[0], copy=False, nan=1.0)
        if made.along is None or made.down is None:
            return np.ones((), np.float32)
        size = np.maximum(np.abs(field), np.float32(1e-30))
        pixel = np.float32(_fringes_per_mpa(scene) * pixels.pixel_mm / self.stride)
        across, down = (
            (field.real * slope.real + field.imag * slope.imag) * (pixel / size)
            for slope in (made.along, made.down)
        )
        visibility = slope_visibility(across, down)
        if blur > 0.0:
            visibility *= np.exp(-2.0 * (np.pi * blur) ** 2 * (across**2 + down**2))
        return visibility

    def _waves(self, surface: SurfaceState, pixels: PixelGrid, slopes: bool) -> SeriesField:
        """The half-plane's field; the lattice of waves is made again where it does not reach."""
        grid = surface.grid
        for fresh in (False, True):
            series = self._series
            if (
                series is None
                or fresh
                or (series.nodes, series.spacing_mm) != (grid.nodes, grid.spacing_mm)
                or series.pitch_mm != pixels.pixel_mm
            ):
                series = self._series = _lattice(surface, pixels)
            try:
                return series_difference(
                    series,
                    x_mm=float(pixels.x_mm[0]),
                    z_mm=float(pixels.z_mm[0]),
                    left_mm=grid.left_mm,
                    pressure_mpa=surface.pressure_mpa,
                    shear_mpa=surface.shear_mpa if surface.shear_mpa.any() else None,
                    slopes=slopes,
                    least_mm=self._hidden_px * pixels.pixel_mm / self.stride,
                )
            except ValueError:
                if fresh:
                    raise
        raise AssertionError("unreachable")


def _standing(scene: Scene) -> tuple[Any, ...]:
    """What a field depends on besides the solved contact."""
    camera = scene.camera
    assert camera is not None
    return scene.load, scene.specimen, camera.left_mm, camera.top_mm, camera.pixel_mm


def _last_state(scene: Scene) -> SceneState:
    return scene_states(scene)[-1]


def _lattice(surface: SurfaceState, pixels: PixelGrid) -> SeriesGrid:
    """Waves whose repetitions stay far enough from the picture."""
    x, z = pixels.x_mm[[0, -1]], np.abs(pixels.z_mm[[0, -1]]).max()
    ends = surface.grid.x_mm[[0, -1]]
    reach = float(np.hypot(np.abs(x[:, None] - ends[None, :]).max(), z))
    return make_series_grid(
        pixels.rows,
        pixels.cols,
        pixels.pixel_mm,
        nodes=surface.grid.nodes,
        spacing_mm=surface.grid.spacing_mm,
        reach_mm=_SLACK * reach,
    )


def _fringes_per_mpa(scene: Scene) -> float:
    specimen = scene.specimen
    assert specimen.thickness_mm is not None and specimen.fringe_value_n_per_mm is not None
    return specimen.thickness_mm / specimen.fringe_value_n_per_mm


def _order(scene: Scene, field: Array) -> Array:
    specimen = scene.specimen
    assert specimen.thickness_mm is not None and specimen.fringe_value_n_per_mm is not None
    return fringe_order(
        field,
        thickness_mm=specimen.thickness_mm,
        fringe_value_n_per_mm=specimen.fringe_value_n_per_mm,
    )


def _first_row(scene: Scene, pixels: PixelGrid) -> int:
    """The first row that the surface does not cut; 0 in a disc or beam."""
    if scene.model != "contact":
        return 0
    assert scene.camera is not None and scene.camera.pixel_mm is not None
    return int(np.searchsorted(pixels.z_mm, (0.5 - 1e-6) * scene.camera.pixel_mm))


def safe_signal(renderer: SceneRenderer, scene: Scene) -> Array:
    """A signal, or NaN everywhere where the values cannot be solved: a fit then steps back."""
    try:
        return renderer.signal(scene)
    except PhysicsError:
        rows, cols = (-(-n // renderer.stride) for n in renderer.shape)
        return np.full((rows, cols), np.nan)
