"""What a scene's polariscope makes of its stress, made quick for a fit.

The mechanics of the last few sets of values are kept, and so is the last field. Where a contact
stands in the picture is a phase of the tractions' waves, see `stress.half_plane_series`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from isochrome.contact import SurfaceState
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import FrameData, PixelLight, Pixels, cosine_sum, solve_linear
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.frame.unknowns import thinning
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
from isochrome.simulation import (
    Picture,
    SceneState,
    make_picture,
    scene_states,
    state_difference,
    swing_states,
    swung_order,
)
from isochrome.specimens import specimen_model
from isochrome.stress import (
    PixelGrid,
    Places,
    SeriesField,
    SeriesGrid,
    bent_places,
    make_series_grid,
    pixel_grid,
    principal_direction,
    seen_by,
    seen_nearly,
    series_difference,
)


@dataclass(frozen=True)
class FringeOptics:
    """A polariscope, a specimen's `thickness_mm` d and fringe value f_sigma."""

    chain: Chain
    thickness_mm: float
    fringe_value_n_per_mm: float

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
    return FringeOptics(chain, specimen.thickness_mm, specimen.fringe_value_n_per_mm)


Solve = Callable[[Scene], SceneState]

_AT_ONCE = 16_384
"""Pixels whose light is made at once: of more, fresh memory takes longer than the arithmetic."""
_KEPT = 8
_MECHANICS = "specimen", "indenter", "contact", "load", "friction", "wear", "numerics"
_FORCES = "normal_n", "tilt", "tangential_n", "added_tractions"
"""Parts of a scene, and of its load, that the mechanics go with."""
_SHALLOW_PX = 0.25
"""Depth of a pixel's middle above which its order says nothing of its neighbours' slopes."""

_PARTS = 2
"""Of the side of a strided pixel, by which a lens is interpolated: it is as wide as the field."""

_SLACK = 1.15
"""Reach of a series over what its first place needs: a contact may move so far in the picture."""


class SceneRenderer:
    """Signals of a one-state scene on every `stride`-th pixel of a picture (rows, cols). `solve`
    gives a scene's state, by default on its own; nobody looks above `hidden_px`; `rough`: the
    pixels' area is left out; `side`, of the blocks whose means are wanted, in pixels.
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
        self._scene = scene
        self._solved = lru_cache(_KEPT)(solve or (lambda one: scene_states(one)[-1]))
        self._lattice: tuple[float, ...] = ()
        # the last field and its visibility, with the state and where that stood
        self._last: tuple[SceneState, tuple[Any, ...], Array, Array] | None = None
        self._behind_lens: tuple[SurfaceState, PixelGrid, tuple[bool, bool], SeriesField] | None = (
            None
        )
        self._swings: tuple[SceneState, float, tuple[SceneState, ...]] | None = None
        self.added: Array | None = None  # a field (rows, cols) besides the scene's own, MPa
        self.waves: Array | None = None  # an order besides, see `with_waves`

    def order_field(self, scene: Scene) -> tuple[Array, Array]:
        """Stress difference and visibility (rows, cols) of strided pixels; or PhysicsError."""
        state, key, last = self.state(scene), self._standing(scene), self._last
        if last is None or last[0] is not state or last[1] != key:
            pixels = self._pixels(scene)
            made = self._field(scene, state, pixels, slopes=self.stride > 1 and not self._rough)
            above = self._above(scene, pixels)
            field = self._seen_by_area(scene, made.difference, above)
            visibility = self._visibility(scene, made, pixels.pixel_mm, above)
            field, contrast = self._swung(scene, field)
            visibility = visibility * contrast
            last = self._last = state, key, field, visibility
        return last[2:]

    def signal(self, scene: Scene, *, visibility: Array | None = None) -> Array:
        """Signal at the strided pixels (rows, cols); no specimen, no light. Or PhysicsError."""
        if visibility is None:
            field, visibility = self.order_field(scene)
        else:
            field = self.field_alone(scene)
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
        self._solved.cache_clear()
        self._last = None

    def state(self, scene: Scene) -> SceneState:
        """The solved mechanics: place, optics and bulk stress do not change them. Surface nodes
        divide the pixels that the fit began with, whatever they become.
        """
        parts = {name: getattr(scene, name) for name in _MECHANICS}
        if scene.load is not None and self._scene.load is not None:
            forces = {name: getattr(scene.load, name) for name in _FORCES}
            parts["load"] = self._scene.load.model_copy(update=forces)
        return self._solved(self._scene.model_copy(update=parts))

    def _blurred(self, scene: Scene) -> float:
        """Variance (px²) of a blur that the field stands for: with a stride nothing is filtered."""
        assert scene.camera is not None
        return scene.camera.blur_px**2 if self.stride > 1 else 0.0

    def _standing(self, scene: Scene) -> tuple[Any, ...]:
        """What a field depends on besides the solved contact."""
        camera = scene.camera
        assert camera is not None
        look = camera.roll_deg, camera.distortion, camera.keystone_x, camera.keystone_z
        place = camera.left_mm, camera.top_mm, camera.pixel_mm, camera.focus_mm
        return scene.load, scene.specimen, *place, look, self._blurred(scene)

    def _pixels(self, scene: Scene) -> PixelGrid:
        return pixel_grid(scene, self.shape).every(self.stride)

    def field_alone(self, scene: Scene) -> Array:
        """The field without its visibility; the last one if only the optics have changed."""
        state, last = self.state(scene), self._last
        if last is not None and last[0] is state and last[1] == self._standing(scene):
            return last[2]
        pixels = self._pixels(scene)
        made = self._field(scene, state, pixels, slopes=False)
        field = self._seen_by_area(scene, made.difference, self._above(scene, pixels))
        return self._swung(scene, field)[0]

    def _swung(self, scene: Scene, field: Array) -> tuple[Array, Array | float]:
        """A field as a load shows it that swings within the exposure, and the fringes' contrast."""
        moments = self.moments(scene)
        if not moments:
            return field, 1.0
        optics, above = scene_optics(scene), self._above(scene, self._pixels(scene))
        order = optics.order(field)
        others = [optics.order(self._seen_by_area(scene, other, above)) for other in moments]
        mean, contrast = swung_order(order, others)
        share = np.divide(mean, order, out=np.ones_like(order), where=order > 0.0)
        return np.asarray(field * share), contrast.astype(np.float32)

    def moments(self, scene: Scene) -> tuple[Array, ...]:
        """Stress differences (rows, cols), MPa, at the other moments of a swinging load."""
        swing = scene.load.swing if scene.load else 0.0
        if not swing:
            return ()
        state = self.state(scene)
        if self._swings is None or self._swings[0] is not state or self._swings[1] != swing:
            self._swings = state, swing, swing_states(scene, state)
        pixels = self._pixels(scene)
        fields = (self._field(scene, s, pixels, slopes=False) for s in self._swings[2])
        return tuple(made.difference for made in fields)

    def difference(self, scene: Scene, state: SceneState) -> Array:
        """The stress difference (rows, cols), MPa, of a solved state in the pixels' middles."""
        return self._field(scene, state, self._pixels(scene), slopes=False).difference

    def _field(
        self, scene: Scene, state: SceneState, pixels: PixelGrid, *, slopes: bool
    ) -> SeriesField:
        """The field of one state where the scene stands, and its slopes where they are wanted."""
        if state.surface is None:
            return SeriesField(state_difference(scene, state, pixels), None, None)
        made, places = self._seen(scene, state.surface, pixels, slopes)
        regular = specimen_model(scene).added_stress(scene, state.surface, pixels)
        if not regular:
            return made
        added = regular.difference(*places).astype(np.complex64)
        return replace(made, difference=np.asarray(made.difference + added))

    def _seen(
        self, scene: Scene, surface: SurfaceState, pixels: PixelGrid, slopes: bool
    ) -> tuple[SeriesField, Places]:
        """The half-plane's field at the places that the pixels look at, and these."""
        bend = scene.bend_mm2_per_mpa
        if pixels.lens is None and not bend:
            return self._waves(surface, pixels, slopes), pixels.places
        around = pixels.around(_PARTS if self.stride > 1 else 1, bent=bend != 0.0)
        asked, last = (slopes, bend != 0.0), self._behind_lens
        lacks = last is not None and any(a and not b for a, b in zip(asked, last[2], strict=True))
        if last is None or last[0] is not surface or last[1] != around or lacks:
            made = self._waves(surface, around, *asked)
            last = self._behind_lens = surface, around, asked, made
        made, places = last[3], pixels.places
        if bend:
            assert made.bending is not None
            places = bent_places(made.bending, around, pixels, bend)
        of_slopes = (
            seen_nearly(slope, around, places) if slopes and slope is not None else None
            for slope in made.slopes
        )
        return SeriesField(seen_by(made.difference, around, places), *of_slopes), places

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
        """Pixels (rows, cols) whose middle lies above a contact's surface or close to it: what is
        made of an order there must not jump as the surface moves through them.
        """
        shape = pixels.rows, pixels.cols
        if not scene.is_contact:
            return np.zeros(shape, dtype=bool)
        return np.broadcast_to(
            pixels.places[1] <= _SHALLOW_PX * pixels.pixel_mm / self.stride, shape
        )

    def _visibility(self, scene: Scene, made: SeriesField, pixel_mm: float, above: Mask) -> Array:
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
        blur = self._blurred(scene) / self._side**2
        if blur > 0.0:
            visibility *= np.exp(np.float32(-2.0 * np.pi**2 * blur) * (across**2 + down**2))
        return visibility

    def gradient(self, scene: Scene) -> Array:
        """d/dx + i d/dz of sigma_1 + sigma_2 (rows, cols), MPa/mm, by a contact's tractions."""
        surface, pixels = self.state(scene).surface, self._pixels(scene)
        assert surface is not None
        around = pixels.around()
        made = self._waves(surface, around, slopes=False, bending=True).bending
        assert made is not None
        return made if around is pixels else seen_nearly(made, around, pixels.places)

    def _waves(
        self, surface: SurfaceState, pixels: PixelGrid, slopes: bool, bending: bool = False
    ) -> SeriesField:
        """The half-plane's field; the lattice of waves is made again where it does not reach."""
        grid = surface.grid
        lattice = pixels.rows, pixels.cols, pixels.pixel_mm, grid.nodes, grid.spacing_mm
        for fresh in (False, True):
            if fresh or lattice != self._lattice:
                self._lattice, self._series = lattice, _lattice(surface, pixels)
            try:
                return series_difference(
                    self._series,
                    x_mm=float(pixels.x_mm[0]),
                    z_mm=float(pixels.z_mm[0]),
                    left_mm=grid.left_mm,
                    pressure_mpa=surface.pressure_mpa,
                    shear_mpa=surface.shear_mpa if surface.shear_mpa.any() else None,
                    slopes=slopes,
                    bending=bending,
                    least_mm=self._hidden_px * pixels.pixel_mm / self.stride,
                )
            except ValueError:
                if fresh:
                    raise
        raise AssertionError("unreachable")


_APPARENT = 9.0
"""Six times a plate's refractive index: light of its middle seems to come from a sixth of its
apparent thickness before it."""


def bent_share(scene: Scene, shape: tuple[int, int]) -> Array | None:
    """Share (rows, cols) of the light that is not sure where stresses bend it; None where the focus
    is no matter. With s = d C h grad S the light's density changes, as it is lit, by |grad s|², and
    on its bent way it meets orders that differ by grad N s grad s and s grad grad N s / 2.
    """
    bend, thickness = abs(scene.bend_mm2_per_mpa), scene.specimen.thickness_mm
    if not bend:
        return None
    assert thickness is not None
    bend += abs(scene.specimen.caustic_constant_mm2_per_n) * thickness**2 / _APPARENT
    renderer, pixel = SceneRenderer(scene, shape), pixel_grid(scene, shape).pixel_mm
    shift = np.float32(bend) * renderer.gradient(scene)
    steep, shift = np.abs(np.gradient(shift, pixel, axis=1)), np.abs(shift)
    order = scene_optics(scene).order(renderer.difference(scene, renderer.state(scene)))
    slope = np.hypot(*np.gradient(order, pixel))
    differs = shift * (slope * steep + 0.5 * np.hypot(*np.gradient(slope, pixel)) * shift)
    # all of the light is as unsure as it can be
    return np.asarray(np.minimum(np.hypot(steep**2, np.pi * differs), 1.0), np.float32)


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


def _lattice(surface: SurfaceState, pixels: PixelGrid) -> SeriesGrid:
    """Waves whose repetitions stay far enough from the picture."""
    x, z = pixels.x_mm[[0, -1]], np.abs(pixels.z_mm[[0, -1]]).max()
    reach = float(np.hypot(np.abs(x[:, None] - surface.grid.x_mm[[0, -1]][None, :]).max(), z))
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


@dataclass(frozen=True, kw_only=True)
class ModelFrame:
    """What a scene says of every pixel (rows, cols) of a frame: I = B + A S in the light's unit.
    `wave`, the ideal signal about the orders; `signal`, S at every so many of the pixels; `mask`,
    trusted pixels of the specimen whose fringes are not washed out; `chi`, residual over noise.
    """

    pixels: PixelGrid
    picture: Picture
    wave: FringeWave
    signal: Callable[[int], Array]
    illumination: Array
    background: Array
    mask: Mask
    chi: float

    def contrast_noise(self, sigma: Array) -> float:
        """Noise `sigma` over the fringes' amplitude, by the median pixel; NaN: nothing is lit."""
        # both are smooth: of every few rows and columns the median is the same
        every = thinning(self.mask.size)
        sigma, light, lit = (
            part[::every, ::every] for part in (sigma, self.illumination, self.mask)
        )
        lit = lit & (light > 0.0)
        return float(np.median(sigma[lit] / light[lit])) if lit.any() else float("nan")


def evaluate_model(data: FrameData, scene: Scene, *, difference: Array | None = None) -> ModelFrame:
    """Render a one-state scene on a frame's own pixels, its stress `difference` (MPa) perhaps
    known, and fit the linear light to it. Chi is inf for a negative illumination; InputError where
    no pixel is trusted.
    """
    data = data.as_fitted(scene)
    grid = pixel_grid(scene, data.shape)
    renderer = SceneRenderer(scene, data.shape)
    if difference is None:
        difference = renderer.difference(scene, renderer.state(scene))
    moments = renderer.moments(scene)
    if data.waves is not None:
        difference = with_waves(scene, difference, cosine_sum(data.shape, data.waves))
    picture = make_picture(scene, difference, grid, moments)
    wave = scene_optics(scene).wave(
        picture.difference, order=picture.mean_order, visibility=picture.visibility
    )

    def signal(stride: int) -> Array:
        assert scene.camera is not None
        if scene.camera.blur_px > 0.0:
            light = np.where(picture.material, wave.light, 0.0)
            return np.asarray(blurred(light, scene.camera.blur_px)[::stride, ::stride])
        return wave.every(stride).light

    mask = data.valid & picture.material & (picture.visibility > 0.5)
    # every few of a large frame's pixels know a handful of coefficients well enough
    stride = thinning(int(np.count_nonzero(mask)))
    thin, keep = data.every(stride), mask[::stride, ::stride]
    if not keep.any():
        raise InputError("no_pixel_can_trusted", name=data.name)
    weight = (1.0 / thin.sigma[keep]).astype(np.float32)
    pixels = Pixels(thin.light[keep], weight, PixelLight(thin.lamp, keep))
    part = solve_linear(pixels, signal(stride)[keep].astype(np.float32))
    a, c = np.split(part.coefficients, [pixels.light.split])
    chi = float(np.sqrt(part.cost / max(1, pixels.size - part.count)))
    return ModelFrame(
        pixels=grid, picture=picture, wave=wave, signal=signal, mask=mask,
        illumination=data.lamp.illumination(a), background=data.lamp.background(c),
        chi=chi if part.positive else float("inf"),
    )  # fmt: skip
