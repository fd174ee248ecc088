"""A fitted frame in blocks: its residual, and how the model changes with what was held.

Residuals are summed over blocks of pixels, which loses nothing of what is smooth; derivatives are
taken at the blocks' centres, from the field that the fit ended with. Nothing is rendered again.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import PhysicsError
from isochrome.estimation import (
    STEP,
    FrameData,
    LightModel,
    LinearPart,
    Pixels,
    block_correlation,
    cosines,
    line_noise,
)
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.causes.cause import (
    BAND,
    FRINGE_VALUE,
    MODULUS,
    PAST,
    ROUGH,
    SOFT,
    YOUNG,
    Cause,
)
from isochrome.fitting.causes.modes import TractionModes, traction_modes
from isochrome.fitting.frame.far_model import by_field
from isochrome.fitting.frame.frame_model import gamma_slope, trust_of_slopes
from isochrome.fitting.frame.renderer import SceneRenderer, scene_optics
from isochrome.fitting.frame.unknowns import (
    BETWEEN,
    BLUR,
    EDGE,
    FOCUS,
    GAMMA,
    LENS,
    PIXEL,
    ROUGHNESS,
    SMOOTH_KEYS,
    SWING,
    TILT,
    thinning,
)
from isochrome.scene import Scene
from isochrome.stress import PixelGrid, pixel_grid, regular_modes

BLOCK = 3
"""Pixels of the side of what is left out as an outlier, and of the least block: a fringe is seldom
finer than three of these."""
_BLOCKS = 4_000
"""Blocks of a frame, about."""

_FILLED = 0.5
"""Least share of a block's pixels that were fitted."""

_REGIONS = 4
"""Parts along each side of the picture that are left out one after another."""
SHADOW_BLOCKS = 5
"""Depth in blocks that a shadow on the surface may reach: it fades, and its end is not seen."""

_SOLVED = {key: cause.sizes[0] for cause in (PAST, MODULUS, SOFT, ROUGH) for key in cause.keys}
_MECHANICAL = TILT, SWING
"""Keys of a contact's load that enter by their square."""
_PART = 0.01
"""Part of a cause's size by which it is changed for its column: above what a contact's own
tolerance moves."""
_OUTLIER = 6.0
"""Residual of a block, in standard deviations of a block's, beyond which it is no accident."""
_BESIDE = 2.5
"""The same beside such a block: a speck has a rim."""
MAD = 1.4826
"""Standard deviation over the median of the sizes, of a normal distribution."""
COSINES = 8
"""Cosines of the picture's height, and of its width, that an unknown order is made of."""


@dataclass(frozen=True, kw_only=True)
class SolvedFrame:
    """A frame where a fit ended, be it of this frame or of several. `data`, as it was fitted; its
    `scene`, one state with the fitted values; `pixels` that were fitted, their solution
    `gamma_fit`, and the `renderer` of them; `rows` (d, pixels), weighted derivatives along the
    directions that the frame was moved in, and `along` (d, p + m), what one unit of each of the p
    `unknowns`, and then of the m inputs that are held, makes of them.
    """

    data: FrameData
    scene: Scene
    pixels: Pixels
    gamma_fit: LinearPart
    renderer: SceneRenderer
    rows: Array
    along: Array
    unknowns: int


class FrameBlocks:
    """Blocks of a frame (n,): `residual` over its noise, `rows` of the unknowns (p, n).
    `light_rows` (l, n), of its own light, and `light_values` (l,); `outliers` (rows/3, cols/3),
    those that no noise explains; `beside` (rows/3, cols/3), those beside a contact's surface;
    `excess`, the variance of what is left over the noise's.
    """

    def __init__(self, solved: SolvedFrame) -> None:
        self.data, self.scene = solved.data, solved.scene
        pixels, gamma_fit = solved.pixels, solved.gamma_fit
        keep = pixels.keep
        place = np.full(keep.shape, -1)
        place[keep] = np.arange(pixels.size)
        self._side = side = block_side(keep.shape)
        chosen, count = _filled(keep, side)
        at = place[::side, ::side][chosen]
        self._chosen = chosen
        root = np.sqrt(count[chosen])
        image = np.zeros(keep.shape, np.float32)
        image[keep] = gamma_fit.residual
        self.residual = block_sums(image, side)[chosen] / root
        self.outliers = outliers(image, chosen if side == BLOCK else _filled(keep, BLOCK)[0])
        image[keep] = gamma_fit.signal
        self._signal_image = image
        self.signal = gamma_fit.signal[at]
        self._model = gamma_fit.model[at]
        trust = trust_of_slopes(gamma_fit)
        self._trust = trust[at]
        self._light = gamma_fit.problem.weight[at] * root
        bases = self.light_images(pixels.light.model)
        self.light_rows = self.light_columns(*bases)
        self.light_values = gamma_fit.coefficients
        amplitude = (self.light_values[: len(bases[0])] @ bases[0]).astype(np.float32)
        self.brightness = float(np.mean(amplitude))
        self._gain = amplitude * self._light
        self._gamma_slope = gamma_slope(gamma_fit, self.scene.frames.stated_gamma)[at] * root
        every = solved.along.T.astype(np.float32) @ (solved.rows[:, at] * root)
        self.rows, self._held = np.split(every, [solved.unknowns])
        lines = (line_noise(keep, gamma_fit.residual, axis) for axis in (0, 1))
        self._own = [1.0 - max(1.0, variance) ** -0.5 for variance in lines]
        # what is smooth is no noise of single pixels: neither where the model is wrong, nor where a
        # picture was compressed; lines' own noise is taken off first
        values = trust[None] * gamma_fit.residual
        for axis, share in enumerate(self._own):
            values = less_means(values, np.nonzero(keep)[1 - axis], share)
        size = float(np.mean(np.square(values), dtype=float))
        self.excess = max(1.0, size * block_correlation(keep, values[0]))
        self._depth = np.arange(len(keep))[:, None] - np.argmax(keep, axis=0)
        beside = self._depth[::BLOCK, ::BLOCK] < SHADOW_BLOCKS * side
        self.beside = beside if self.scene.is_contact else None
        self._renderer = solved.renderer
        self._fields = self._seen(self.scene)  # as the fit last had them

    @property
    def region(self) -> NDArray[np.intp]:
        """Which of _REGIONS x _REGIONS parts of the picture, each as full, a block lies in (n,)."""
        down, across = (
            np.argsort(np.argsort(place, kind="stable")) * _REGIONS // len(place)
            for place in np.nonzero(self._chosen)
        )
        return np.asarray(_REGIONS * down + across)

    def part(self, columns: Array) -> tuple[Array, Array, Array, Array]:
        """`light_rows`, `rows`, some `columns` (k, n) that are not fitted, and the residual (n,).
        Of each row and column a part of the mean is taken off all of them, the larger the more
        noise it has of its own: what is left is as if of independent pixels.
        """
        light, rows, columns, residual = (
            values * self._trust
            for values in (self.light_rows, self.rows, columns, self.residual[None])
        )
        for axis, share in enumerate(self._own):
            lines = np.nonzero(self._chosen)[1 - axis]
            light, rows, columns, residual = (
                less_means(values, lines, share) for values in (light, rows, columns, residual)
            )
        return light, rows, columns, residual[0]

    def thin(self, image: Array) -> Array:
        """An image (rows, cols) at the blocks (n,)."""
        return self.pick(image[:: self._side, :: self._side])

    def pick(self, thinned: Array) -> Array:
        """Images of the blocks' middles (..., rows/side, cols/side) at those used (..., n)."""
        return np.asarray(thinned[..., self._chosen])

    def light_images(self, lamp: LightModel) -> tuple[Array, Array]:
        """What a light's illumination and background are sums of, (k, n) each."""
        light, dark = lamp.every(self._side).columns(self._chosen)
        return light.astype(np.float32), dark.astype(np.float32)

    def light_columns(self, illumination: Array, background: Array) -> Array:
        """Weighted columns (k, n) of light that is not in the model, given at the blocks."""
        return np.concatenate(
            (illumination * (self.signal * self._light), background * self._light)
        )

    def columns(self, cause: Cause) -> Array:
        """Weighted derivatives of the model by a cause's keys (k, n). An even one's is its effect
        over the square of its size; of plates that are turned alike, and behind it the slope by the
        first alone, which has one. Nought where no contact can be solved with it: then nothing
        tells it.
        """
        try:
            return self._columns(cause)
        except PhysicsError:
            return np.zeros((1 if cause.even else len(cause.keys), len(self.residual)), np.float32)

    def _columns(self, cause: Cause) -> Array:
        if cause.stated:
            return self._held
        if cause.keys[0] == BLUR:
            return np.asarray(self._curved * cause.sizes[0] ** 2)[None]
        if cause.even:
            changed = dict(zip(cause.keys, cause.starts, strict=True))
            step = self._signal(self.scene.with_values(changed)) - self._here
            if cause.keys[0] in (BAND, *_MECHANICAL):
                return np.asarray(step * self._gain)[None]
            first, size = cause.keys[0], changed[cause.keys[0]]
            ahead, behind = (
                self._signal(self.scene.with_values({first: sign * size})) for sign in (1.0, -1.0)
            )
            slope = (ahead - behind) * np.float32(0.5 / size)
            return np.asarray(np.array([step, slope]) * self._gain)
        return np.array([self._column(key) for key in cause.keys])

    def effect(self, cause: Cause) -> Array:
        """What an even cause that is there does to the picture, weighted (1, n)."""
        if cause.keys[0] == BLUR:
            return np.asarray(float(self.scene.get(BLUR)) ** 2 * self._curved)[None]
        without = self._signal(self.scene.with_values(dict.fromkeys(cause.keys, 0.0)))
        return np.asarray((self._here - without) * self._gain)[None]

    @cached_property
    def _here(self) -> Array:
        """The signal at the blocks, as it was fitted."""
        return self._signal(self.scene)

    @property
    def _curved(self) -> Array:
        """What a blur of a pixel adds, half the signal's curvature, weighted."""
        from scipy.ndimage import laplace

        return np.asarray(self.thin(0.5 * laplace(self._signal_image)) * self._gain)

    @cached_property
    def _slopes(self) -> tuple[Array, Array]:
        """The signal's slopes at the blocks, down and across, over a pixel."""
        down, across = np.gradient(self._signal_image)
        return self.thin(down), self.thin(across)

    def _column(self, key: str) -> Array:
        if key == GAMMA:
            return np.asarray(self._gamma_slope)
        if key in SMOOTH_KEYS:
            x, z = self._places(self.scene)
            mode = regular_modes(1)[SMOOTH_KEYS.index(key)]
            return self._turned(mode.difference(x, np.maximum(z, 0.0)).astype(np.complex64))
        value = float(self.scene.get(key) or 0.0)
        if key in EDGE:
            stress, depth = map(self.scene.get, EDGE)
            _, z = self._places(self.scene)
            change = np.exp(-np.maximum(z, 0.0) / depth)
            if key != EDGE[0]:
                change *= stress * z / depth**2
            return self._turned(change.astype(np.complex64))
        if key == FOCUS:
            per_mm = self.scene.with_values({FOCUS: 1.0}).bend_mm2_per_mpa
            gradient = self.thin(self._renderer.gradient(self.scene))
            down, across = self._slopes
            change = across * gradient.real + down * gradient.imag
            return np.asarray(change * self._gain * (-per_mm / self.scene.get(PIXEL)))
        if key == FRINGE_VALUE:
            return self._turned(self._fields[0] / np.float32(-value))
        if key in _SOLVED:
            return self._solved(key, value)
        # by the picture's slope, and where the pixels look then: lens, scale and place
        step = STEP * (value if key == PIXEL else 60.0 if key == LENS[0] else 1.0)
        before, after = (
            self._places(self.scene.with_values({key: at})) for at in (value, value + step)
        )
        down, across = self._slopes
        change = across * (after[0] - before[0]) + down * (after[1] - before[1])
        return np.asarray(change * self._gain / (self.scene.get(PIXEL) * step))

    def _solved(self, key: str, value: float) -> Array:
        """What the contact would be with another modulus, or the scar under another friction."""
        # a logarithm has no slope at nought
        part = 1.0 if key == ROUGHNESS and not value else _PART
        wider: dict[str, Any] = {"numerics.window_mm": None} if key == ROUGHNESS else {}
        if key in BETWEEN and self.scene.wear is not None:  # which costs most, and few digits
            part, tolerance = max(part, 10.0 * _PART), self.scene.numerics.tolerance
            wider["numerics.tolerance"] = min(10.0 * tolerance, _PART)
        step = part * _SOLVED[key] * (value if key == YOUNG else 1.0)
        there = self.scene.with_values({key: value + step, **wider})
        field = self._renderer.whole(there, self._renderer.field_alone(there))
        return self._turned((np.nan_to_num(self.thin(field)) - self._fields[0]) / step)

    @cached_property
    def _by_field(self) -> tuple[Array, Array]:
        """Weighted derivatives by both parts of the stress difference (n,), 1/MPa."""
        return by_field(scene_optics(self.scene), *self._fields, self._here, self._gain)

    def _turned(self, change: Array) -> Array:
        """By a change of the stress difference (n,), MPa."""
        along, across = self._by_field
        return np.asarray(along * change.real + across * change.imag, np.float32)

    @cached_property
    def modes(self) -> TractionModes:
        """The tractions that a contact may have of its own."""
        surface = self._renderer.state(self.scene).surface
        assert surface is not None
        return traction_modes(self.scene, surface, self._grid.pixel_mm)

    def traction_columns(self) -> Array:
        """By the hats of `modes` (k, n)."""
        return np.array([self._turned(self.pick(image)) for image in self.modes.fields(self._grid)])

    @cached_property
    def order_waves(self) -> Array:
        """Orders that no cause may explain, fringes (k, n), see `with_waves`."""
        field = self._fields[0]
        turn = field / np.maximum(np.abs(field), np.float32(1e-6))
        ways = scene_optics(self.scene).order(field), turn.real, turn.imag
        return np.concatenate([self._waves * way for way in ways])

    @cached_property
    def _waves(self) -> Array:
        return self.pick(cosines(self._chosen.shape, COSINES))

    def wave_columns(self, part: slice) -> Array:
        """By what no cause explains, some of three parts of `order_waves` (k, n)."""
        fringe = np.float32(1.0 / scene_optics(self.scene).order_per_mpa)
        along, across = self._by_field
        ways = self._turned(self._fields[0]), along * fringe, across * fringe
        return np.concatenate([self._waves * way for way in ways[part]])

    def shadow_columns(self) -> Array:
        """By the light that is missing at each depth of blocks beside the surface (k, n)."""
        depth = self.thin(self._depth) // self._side
        lit = self._model * self._light
        return np.array([np.where(depth == d, lit, 0.0) for d in range(SHADOW_BLOCKS)], np.float32)

    @property
    def _grid(self) -> PixelGrid:
        # the middle pixel's own centre, in which derivatives are taken
        return pixel_grid(self.scene, self.data.shape).every(self._side)

    def _places(self, scene: Scene) -> tuple[Array, Array]:
        grid = pixel_grid(scene, self.data.shape).every(self._side)
        x, z = (np.broadcast_to(v, self._chosen.shape)[self._chosen] for v in grid.places)
        return x, z

    def _signal(self, scene: Scene) -> Array:
        """The signal at the blocks for a scene's own optics, and tilt and swing of its load."""
        field, shown = self._fields
        if any(scene.get(key) != self.scene.get(key) for key in _MECHANICAL):
            field, shown = self._seen(scene)
        return scene_optics(scene).signal(field, visibility=shown)

    def _seen(self, scene: Scene) -> tuple[Array, Array]:
        """A scene's field and the fringes' contrast in it, at the blocks."""
        field, shown = self._renderer.order_field(scene)
        field = np.nan_to_num(self.thin(self._renderer.whole(scene, field)))
        return field, self.thin(np.broadcast_to(shown, self.data.shape))


def less_means(values: Array, lines: Array, share: float) -> Array:
    """Values (k, n) less a share of their means over each line (n,) of the picture."""
    from scipy.sparse import csr_array

    if not share:
        return values
    count = np.bincount(lines)
    there = csr_array((np.ones(len(lines)), (np.arange(len(lines)), lines)))
    part = (share / np.maximum(count, 1) * (values @ there)).astype(values.dtype)
    return np.asarray(values - part.take(lines, axis=1))


def outliers(image: Array, chosen: Mask) -> Mask:
    """The `chosen` blocks (rows/3, cols/3) of a residual (rows, cols) that no noise explains."""
    from scipy.ndimage import binary_dilation, binary_propagation, maximum_filter

    count = block_sums((image != 0.0).astype(np.float32), BLOCK)
    sums = np.abs(block_sums(image, BLOCK))
    blocks = np.where(chosen, sums / np.sqrt(np.maximum(count, 1.0)), 0.0)
    noise = max(1.0, MAD * float(np.median(blocks[chosen])))
    size = blocks / noise
    near = np.ones((3, 3), dtype=bool)
    largest = maximum_filter(np.abs(image), BLOCK)[::BLOCK, ::BLOCK]
    seeds = np.maximum(size, largest / noise) > _OUTLIER
    outside = binary_propagation(seeds, near, mask=seeds | (size > _BESIDE))
    return np.asarray(binary_dilation(outside, near) & bool(seeds.any()))


def _filled(keep: Mask, side: int) -> tuple[Mask, Array]:
    """The blocks of which enough was fitted, their middles' neighbours too; pixels of each."""
    count = block_sums(keep.astype(np.float32), side)
    centre = np.zeros_like(keep)
    near = keep[:-2, 1:-1] & keep[2:, 1:-1] & keep[1:-1, :-2] & keep[1:-1, 2:]
    centre[1:-1, 1:-1] = near & keep[1:-1, 1:-1]
    return centre[::side, ::side] & (count > _FILLED * side**2), count


def block_side(shape: tuple[int, ...]) -> int:
    """Side in pixels of a frame's blocks, an odd number of those of outliers."""
    wide = thinning(shape[0] * shape[1], _BLOCKS) / BLOCK
    return BLOCK * (2 * round(0.5 * (wide - 1.0)) + 1) if wide > 1.0 else BLOCK


def block_sums(image: Array, side: int) -> Array:
    """Sums over `side` x `side` pixels, an odd number, about every `side`-th one."""
    from scipy.ndimage import uniform_filter

    return np.asarray(uniform_filter(image, side, mode="constant")[::side, ::side] * side**2)
