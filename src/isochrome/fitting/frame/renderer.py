"""What a scene's polariscope makes of its stress, made quick for a fit.

The mechanics of the last few sets of values are kept, and so is the last field. Where a contact
stands in the picture is a phase of the tractions' waves, see `stress.half_plane_series`.
"""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from isochrome.contact import SurfaceState
from isochrome.errors import PhysicsError
from isochrome.fitting.arrays import Array, Mask
from isochrome.optics import (
    Chain,
    FringeWave,
    blurred,
    fringe_order,
    make_chain,
    mean_order,
    pixel_visibility,
    polariscope_wave,
    slope_visibility,
)
from isochrome.scene import Scene
from isochrome.simulation import SceneState, scene_states, state_difference
from isochrome.specimens import specimen_model
from isochrome.stress import (
    PixelGrid,
    SeriesField,
    SeriesGrid,
    below_surface,
    make_series_grid,
    pixel_grid,
    principal_direction,
    seen_by,
    seen_nearly,
    series_difference,
)


@dataclass(frozen=True)
class FringeOptics:
    """A polariscope, a specimen's `thickness_mm` d and fringe value f_sigma, a camera's blur."""

    chain: Chain
    thickness_mm: float
    fringe_value_n_per_mm: float
    blur_px: float

    @property
    def order_per_mpa(self) -> float:
        """Fringes of a stress difference of 1 MPa, d/f_sigma."""
        return self.thickness_mm / self.fringe_value_n_per_mm

    def order(self, difference: Array) -> Array:
        """Fringe orders N of stress differences (sigma_x - sigma_z) + 2i tau_xz, MPa."""
        return fringe_order(
            difference,
            thickness_mm=self.thickness_mm,
            fringe_value_n_per_mm=self.fringe_value_n_per_mm,
        )

    def wave(
        self, difference: Array, *, order: Array | None = None, visibility: Array | float = 1.0
    ) -> FringeWave:
        """The polariscope's signal, 0..1; `order`, where it is not that of the difference alone."""
        order = self.order(difference) if order is None else order
        direction = None
        if not self.chain.ideal:
            direction = principal_direction(difference).astype(order.dtype)
        return polariscope_wave(order, self.chain, direction=direction, visibility=visibility)

    def signal(self, difference: Array, *, visibility: Array | float = 1.0) -> Array:
        """The same at the order itself, in pieces that stay in the processor's cache."""
        if self.chain.ideal:
            return self.wave(difference, visibility=visibility).light
        visibility = np.broadcast_to(visibility, difference.shape)
        rows = max(1, _AT_ONCE * len(difference) // max(1, difference.size))
        pieces = (slice(k, k + rows) for k in range(0, max(1, len(difference)), rows))
        return np.concatenate([
            self.wave(difference[piece], visibility=visibility[piece]).light for piece in pieces
        ])  # fmt: skip


def scene_optics(scene: Scene) -> FringeOptics:
    """A scene's optics; of a phase-stepped set, those of its first step."""
    specimen, polariscope = scene.specimen, scene.polariscope
    assert specimen.thickness_mm is not None and specimen.fringe_value_n_per_mm is not None
    chain = make_chain(polariscope, polariscope.step_numbers[0])
    blur_px = scene.camera.blur_px if scene.camera else 0.0
    return FringeOptics(chain, specimen.thickness_mm, specimen.fringe_value_n_per_mm, blur_px)


Solve = Callable[[Scene], SceneState]

_AT_ONCE = 16_384
"""Pixels whose light is made at once: of more, fresh memory takes longer than the arithmetic."""
_KEPT = 8
_SHALLOW_PX = 0.25
"""Depth of a pixel's middle above which its order says nothing of its neighbours' slopes."""

_PARTS = 2
"""Of the side of a strided pixel, by which a lens is interpolated: it is as wide as the field."""

_SLACK = 1.15
"""Reach of a series over what its first place needs: a contact may move so far in the picture."""


@dataclass(frozen=True, eq=False)
class _Look:
    """What `pixels` see through a lens of a `surface`'s field, made on a grid `around` them."""

    surface: SurfaceState
    pixels: PixelGrid
    around: PixelGrid
    made: SeriesField

    @cached_property
    def seen(self) -> SeriesField:
        """The field that they see, and nearly its slopes, where these were made."""
        slopes = (
            None if slope is None else seen_nearly(slope, self.around, self.pixels)
            for slope in self.made.slopes
        )  # fmt: skip
        return SeriesField(seen_by(self.made.difference, self.around, self.pixels), *slopes)

    @cached_property
    def slopes(self) -> tuple[Array, Array]:
        """Its changes (rows, cols) as what is looked at moves down and across, MPa/mm."""
        field = below_surface(self.made.difference, self.around)
        down, across = (np.gradient(field, self.around.pixel_mm, axis=axis) for axis in (0, 1))
        return (
            seen_nearly(down, self.around, self.pixels),
            seen_nearly(across, self.around, self.pixels),
        )

    def beside(self, field: Array, pixels: PixelGrid) -> Array:
        """What is seen, to first order, of a field and by pixels that are little else."""
        seen, above = self.seen.difference, pixels.places[1] < 0.0
        if field is not self.made.difference:
            seen = seen + seen_nearly(field - self.made.difference, self.around, pixels)
        if pixels != self.pixels:
            moved = (a - b for a, b in zip(pixels.places, self.pixels.places, strict=True))
            across, down = (m.astype(np.float32) for m in moved)
            seen = seen + down * self.slopes[0] + across * self.slopes[1]
        return np.where(above, np.complex64(0.0), seen)


@dataclass(frozen=True)
class _Rendered:
    """The last field with what it was made of: `state`, and `key`, where that stood; its `look`."""

    state: SceneState
    key: tuple[Any, ...]
    field: Array
    visibility: Array
    look: _Look | None


class SceneRenderer:
    """Signals of a one-state scene on every `stride`-th pixel of a picture (rows, cols).

    `solve` gives a scene's state, by default on its own; nobody looks above `hidden_px`; `rough`:
    the pixels' area is left out; `side`, of the blocks whose means are wanted, in pixels.
    """

    def __init__(
        self,
        scene: Scene,
        shape: tuple[int, int],
        *,
        stride: int = 1,
        solve: Solve | None = None,
        hidden_px: float = 0.0,
        rough: bool = False,
        side: int = 1,
    ) -> None:
        self.shape, self.stride, self._side = shape, stride, side
        self._hidden_px, self._rough = hidden_px, rough
        self._solve = solve or (lambda one: scene_states(one)[-1])
        self._camera = scene.camera
        self._states: OrderedDict[Any, SceneState] = OrderedDict()
        self._series: SeriesGrid | None = None
        self._last: _Rendered | None = None
        self._look: _Look | None = None
        self.added: Array | None = None  # a field (rows, cols) besides the scene's own, MPa
        self.waves: Array | None = None  # an order besides, see `with_waves`

    def order_field(self, scene: Scene) -> tuple[Array, Array]:
        """Stress difference (rows, cols) and visibility of the fringes at the strided pixels.

        Both are of the pixels' area; with a stride the visibility stands for the camera's blur too.
        PhysicsError where the scene's values cannot be solved.
        """
        state = self.state(scene)
        blur = self._blurred(scene)
        key = (*_standing(scene), blur)
        last = self._last
        if last is None or last.state is not state or last.key != key:
            pixels = self._pixels(scene)
            made = self._field(scene, state, pixels, slopes=self.stride > 1 and not self._rough)
            above = self._above(scene, pixels)
            visibility_by_area = self._seen_by_area(scene, made.difference, above)
            visibility = self._visibility(scene, made, pixels.pixel_mm, above, blur)
            look = self._look if pixels.lens is not None else None
            last = self._last = _Rendered(state, key, visibility_by_area, visibility, look)
        return last.field, last.visibility

    def signal(self, scene: Scene, *, visibility: Array | None = None) -> Array:
        """Polariscope signal at the strided pixels (rows, cols); no specimen, no light.

        `visibility`, where it is known: a small step beside the last scene. PhysicsError where the
        scene's values cannot be solved.
        """
        if visibility is None:
            field, visibility = self.order_field(scene)
        else:
            field = self.field_beside(scene)
        if not scene.is_contact:
            field = np.nan_to_num(field)
        field = self.whole(scene, field)
        signal = scene_optics(scene).signal(field, visibility=visibility)
        camera = scene.camera
        assert camera is not None
        if camera.blur_px > 0.0 and self.stride == 1:
            # pixels that see more than a contact's specimen
            outside = ~specimen_model(scene).inside(self._pixels(scene))
            signal[np.broadcast_to(outside, signal.shape)] = 0.0
            signal = blurred(signal, camera.blur_px)
        return signal

    def whole(self, scene: Scene, field: Array) -> Array:
        """A field (rows, cols) of the scene with what it has besides."""
        if self.added is not None:
            field = field + self.added
        return field if self.waves is None else with_waves(scene, field, self.waves)

    def forget(self) -> None:
        """Solve every scene anew: what `solve` puts it on has changed."""
        self._states.clear()
        self._last = None

    def state(self, scene: Scene) -> SceneState:
        """The solved mechanics: place, optics and bulk stress do not change them."""
        load = scene.load
        forces = load and (load.normal_n, load.tangential_n, load.added_tractions)
        key = (
            scene.specimen, scene.indenter, scene.contact, forces, scene.friction, scene.wear,
            scene.numerics,
        )  # fmt: skip
        if key not in self._states:
            # the surface nodes divide the pixels that the fit began with, whatever they become
            self._states[key] = self._solve(scene.model_copy(update={"camera": self._camera}))
            while len(self._states) > _KEPT:
                self._states.popitem(last=False)
        self._states.move_to_end(key)
        return self._states[key]

    def _blurred(self, scene: Scene) -> float:
        """Variance (px²) of a blur that the field stands for: with a stride nothing is filtered."""
        assert scene.camera is not None
        return scene.camera.blur_px**2 if self.stride > 1 else 0.0

    def _pixels(self, scene: Scene) -> PixelGrid:
        return pixel_grid(scene, self.shape).every(self.stride)

    def field_alone(self, scene: Scene) -> Array:
        """The field without its visibility; the last one if only the optics have changed."""
        state, last = self.state(scene), self._last
        if (
            last is not None
            and last.state is state
            and last.key == (*_standing(scene), self._blurred(scene))
        ):
            return last.field
        pixels = self._pixels(scene)
        made = self._field(scene, state, pixels, slopes=False)
        return self._seen_by_area(scene, made.difference, self._above(scene, pixels))

    def field_beside(self, scene: Scene) -> Array:
        """The same a small step beside the last scene: through a lens to first order in it."""
        look = self._last.look if self._last else None
        pixels, surface = self._pixels(scene), self.state(scene).surface
        if look is None or surface is None or pixels.lens is None:
            return self.field_alone(scene)
        field = look.made.difference
        if surface is not look.surface:
            field = self._waves(surface, look.around, slopes=False).difference
        field = self._with_added(scene, surface, pixels, look.beside(field, pixels))
        return self._seen_by_area(scene, field, self._above(scene, pixels))

    def difference(self, scene: Scene, state: SceneState) -> Array:
        """The stress difference (rows, cols), MPa, of a solved state in the pixels' middles."""
        return self._field(scene, state, self._pixels(scene), slopes=False).difference

    def _field(
        self, scene: Scene, state: SceneState, pixels: PixelGrid, *, slopes: bool
    ) -> SeriesField:
        """The field of one state where the scene stands, and its slopes where they are wanted."""
        if state.surface is None:
            return SeriesField(state_difference(scene, state, pixels), None, None)
        made = self._seen(state.surface, pixels, slopes)
        added = self._with_added(scene, state.surface, pixels, made.difference)
        return replace(made, difference=added)

    def _with_added(
        self, scene: Scene, surface: SurfaceState, pixels: PixelGrid, field: Array
    ) -> Array:
        """A half-plane's field with what the specimen has besides."""
        regular = specimen_model(scene).added_stress(scene, surface, pixels)
        if not regular:
            return field
        return np.asarray(field + regular.difference(*pixels.places).astype(np.complex64))

    def _seen(self, surface: SurfaceState, pixels: PixelGrid, slopes: bool) -> SeriesField:
        """The half-plane's field at the places that the pixels look at."""
        if pixels.lens is None:
            return self._waves(surface, pixels, slopes)
        around, last = pixels.around(_PARTS if self.stride > 1 else 1), self._look
        made = last.made if last and last.surface is surface and last.around == around else None
        if made is None or slopes != (made.along is not None):
            made = self._waves(surface, around, slopes)
        look = self._look = _Look(surface, pixels, around, made)
        return look.seen

    def _seen_by_area(self, scene: Scene, field: Array, above: Mask) -> Array:
        """The field with the mean of the order over each pixel in place of that in its middle."""
        if self._rough:
            return field
        size = np.abs(field)
        size[above] = np.nan
        share = mean_order(
            size, stride=self.stride / self._side, blur_px2=self._blurred(scene) / self._side**2
        )
        np.divide(share, size, out=share, where=size > 0.0)
        return np.asarray(field * np.nan_to_num(share, copy=False, nan=1.0))

    def _above(self, scene: Scene, pixels: PixelGrid) -> Mask:
        """Pixels (rows, cols) whose middle lies above a contact's surface, or close to it.

        Those that the surface cuts have an order in their middle: what is made of it must not jump
        as the surface moves through them.
        """
        shape = pixels.rows, pixels.cols
        if not scene.is_contact:
            return np.zeros(shape, dtype=bool)
        return np.broadcast_to(
            pixels.places[1] <= _SHALLOW_PX * pixels.pixel_mm / self.stride, shape
        )

    def _visibility(
        self, scene: Scene, made: SeriesField, pixel_mm: float, above: Mask, blur: float
    ) -> Array:
        """What is left of the fringes' contrast by the pixels' area, and by a blur."""
        field = made.difference
        if self.stride == 1:
            order = scene_optics(scene).order(field)
            order[above] = np.nan
            return np.nan_to_num(pixel_visibility(order)[0], copy=False, nan=1.0)
        if made.along is None or made.down is None:
            return np.ones((), np.float32)
        size = np.maximum(np.abs(field), np.float32(1e-30))
        side_mm = pixel_mm * self._side / self.stride
        pixel = np.float32(scene_optics(scene).order_per_mpa * side_mm)
        across, down = (
            (field.real * slope.real + field.imag * slope.imag) * (pixel / size)
            for slope in (made.along, made.down)
        )
        visibility = slope_visibility(across, down)
        if blur > 0.0:
            blur /= self._side**2
            visibility *= np.exp(np.float32(-2.0 * np.pi**2 * blur) * (across**2 + down**2))
        return visibility

    def _waves(self, surface: SurfaceState, pixels: PixelGrid, slopes: bool) -> SeriesField:
        """The half-plane's field; the lattice of waves is made again where it does not reach."""
        grid = surface.grid
        own = pixels.rows, pixels.cols, pixels.pixel_mm, grid.nodes, grid.spacing_mm
        for fresh in (False, True):
            series = self._series
            if (
                series is None
                or fresh
                or own
                != (series.rows, series.cols, series.pitch_mm, series.nodes, series.spacing_mm)
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


def with_waves(scene: Scene, field: Array, waves: Array) -> Array:
    """A field with more than the scene's: `waves` (3, rows, cols) are its share that is more, as of
    a plate that is warm or uneven, and the fringes of both parts of a stress, as of a clamp or a
    window.
    """
    share, along, across = waves
    fringe = np.float32(1.0 / scene_optics(scene).order_per_mpa)
    result = field * (np.float32(1.0) + share)
    result.real += fringe * along
    result.imag += fringe * across
    return np.asarray(result)


def _standing(scene: Scene) -> tuple[Any, ...]:
    """What a field depends on besides the solved contact."""
    camera = scene.camera
    assert camera is not None
    look = camera.roll_deg, camera.distortion, camera.keystone_x, camera.keystone_z
    return scene.load, scene.specimen, camera.left_mm, camera.top_mm, camera.pixel_mm, look


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


def safe_signal(renderer: SceneRenderer, scene: Scene) -> Array:
    """A signal, or NaN everywhere where the values cannot be solved: a fit then steps back."""
    try:
        return renderer.signal(scene)
    except PhysicsError:
        rows, cols = (-(-n // renderer.stride) for n in renderer.shape)
        return np.full((rows, cols), np.nan)
