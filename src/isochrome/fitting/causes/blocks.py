"""A fitted frame in blocks: its residual, and how the model changes with what was held.

Residuals are summed over blocks of pixels, which loses nothing of what is smooth; derivatives are
taken at the blocks' centres, from the field that the fit ended with. Nothing is rendered again.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from isochrome.estimation import FrameData, line_noise
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.causes.cause import BAND, FRINGE_VALUE, PLATES, Cause
from isochrome.fitting.frame.frame_model import GammaFit, Pixels, gamma_slope
from isochrome.fitting.frame.renderer import SceneRenderer, scene_optics
from isochrome.fitting.frame.unknowns import BLUR, EARLIER, GAMMA, LENS, PIXEL, SMOOTH_KEYS
from isochrome.scene import Scene
from isochrome.stress import pixel_grid, regular_modes

BLOCK = 3
"""Pixels of a block's side: a fringe is seldom finer than three blocks."""

_FILLED = 0.5
"""Least share of a block's pixels that were fitted."""

_OWN_NOISE = 1.5
"""Variance of rows' sums, over that of independent pixels, from which rows have their own noise."""

_SHADOW_PX = 15
"""Depth that a shadow on the surface may reach: it grows fainter, and its end is not seen."""
_OF_THE_EXCESS = 0.5
"""Share of what noise does not explain from which it lies beside the surface."""
_FELT, _CLEAR = 0.1, 6.0
"""What noise does not explain there, in its variances, and in standard deviations of their sum."""

_STEP = 1e-4
_STRESS_MPA = 0.01
_FRICTION = 0.01
"""A change of the scar that stands above what its own tolerance moves."""
EVEN = {PLATES[0]: 3.0, PLATES[1]: 3.0, BAND: 10.0}
"""Steps of what has no slope at nought: degrees, nm."""


@dataclass(frozen=True, kw_only=True)
class SolvedFrame:
    """A frame where a fit ended, be it of this frame or of several.

    `data`, as it was fitted; its `scene`, one state with the fitted values; `pixels` that were
    fitted, their solution `gamma_fit`, and the `renderer` of them; `rows` (d, pixels), weighted
    derivatives along the directions that the frame was moved in, and `along` (d, p + m), what one
    unit of each of the p `unknowns`, and then of the m inputs that are held, makes of them.
    """

    data: FrameData
    scene: Scene
    pixels: Pixels
    gamma_fit: GammaFit
    renderer: SceneRenderer
    rows: Array
    along: Array
    unknowns: int


class FrameBlocks:
    """Blocks of a frame (n,): `residual` over its noise, `rows` of the unknowns (p, n).

    `light_rows` (l, n), of its own light; `worst` (rows/3, cols/3), the largest residual of a pixel
    in each block of the picture; `shadow` (rows/3, cols/3), the blocks beside a contact's surface,
    None where they are no worse than others.
    """

    def __init__(self, solved: SolvedFrame) -> None:
        self.data, self.scene = solved.data, solved.scene
        pixels, gamma_fit = solved.pixels, solved.gamma_fit
        keep = pixels.keep
        place = np.full(keep.shape, -1)
        place[keep] = np.arange(pixels.size)
        count = block_sums(keep.astype(np.float32))
        centre = np.zeros_like(keep)
        centre[1:-1, 1:-1] = _inner(keep)
        chosen = centre[::BLOCK, ::BLOCK] & (count > _FILLED * BLOCK**2)
        at = place[::BLOCK, ::BLOCK][chosen]
        self._chosen = chosen
        root = np.sqrt(count[chosen])
        image = np.zeros(keep.shape, np.float32)
        image[keep] = gamma_fit.residual
        self.residual = block_sums(image)[chosen] / root
        self.worst = _largest_near(image)
        self.shadow = None if self.scene.indenter is None else _shadow(image, keep)
        image[keep] = gamma_fit.part.signal
        self._signal_image = image
        self.signal = gamma_fit.part.signal[at]
        self._light = gamma_fit.weight[at] * root
        bases = pixels.light[:, at], pixels.dark[:, at]
        self.light_rows = self.light_columns(*bases)
        amplitude = gamma_fit.part.coefficients[: len(bases[0])].astype(np.float32) @ bases[0]
        self.brightness = float(np.mean(amplitude))
        self._gain = amplitude * self._light
        self._gamma_slope = gamma_slope(gamma_fit, self.scene.frames.stated_gamma)[at] * root
        every = solved.along.T.astype(np.float32) @ (solved.rows[:, at] * root)
        self.rows, self._held = np.split(every, [solved.unknowns])
        self._noisy = [
            axis for axis in (0, 1) if line_noise(keep, gamma_fit.residual, axis) > _OWN_NOISE
        ]
        self._renderer = solved.renderer
        self._fields = self._thin_fields(solved.renderer)

    def part(self, columns: Array) -> tuple[Array, Array, Array, Array]:
        """`light_rows`, `rows`, some `columns` (k, n) that are not fitted, and the residual (n,).

        Where rows or columns of the picture have a noise of their own, each one's mean is taken off
        all of them: it tells nothing.
        """
        light, rows, residual = self.light_rows, self.rows, self.residual[None]
        for axis in self._noisy:
            lines = np.nonzero(self._chosen)[1 - axis]
            light, rows, columns, residual = (
                _without_means(values, lines) for values in (light, rows, columns, residual)
            )
        return light, rows, columns, residual[0]

    def _thin_fields(self, renderer: SceneRenderer) -> tuple[Array, Array]:
        """Stress difference and visibility at the blocks, as the fit last had them."""
        field, visibility = renderer.order_field(self.scene)
        shown = np.broadcast_to(visibility, field.shape)
        return np.nan_to_num(self.thin(field)), self.thin(shown)

    def thin(self, image: Array) -> Array:
        """An image (rows, cols) at the blocks (n,)."""
        return self.pick(image[::BLOCK, ::BLOCK])

    def pick(self, thinned: Array) -> Array:
        """Images of every third pixel (..., rows/3, cols/3) at the blocks (..., n)."""
        return np.asarray(thinned[..., self._chosen])

    def image_of(self, values: Array) -> Array:
        """Values of the blocks (n,) as an image of every third pixel, 0 elsewhere."""
        image = np.zeros(self._chosen.shape, dtype=values.dtype)
        image[self._chosen] = values
        return image

    def light_columns(self, illumination: Array, background: Array) -> Array:
        """Weighted columns (k, n) of light that is not in the model, given at the blocks."""
        return np.concatenate(
            (illumination * (self.signal * self._light), background * self._light)
        )

    def columns(self, cause: Cause) -> Array:
        """Weighted derivatives of the model by a cause's keys (k, n); an even one's whole step."""
        if cause.weight:
            return self._held
        if cause.keys[0] in EVEN:
            changed = dict.fromkeys(cause.keys, EVEN[cause.keys[0]])
            step = self._signal(self.scene.with_values(changed)) - self._here
            return np.asarray(step * self._gain)[None]
        return np.array([self._column(key) for key in cause.keys])

    @cached_property
    def _here(self) -> Array:
        """The signal at the blocks, as it was fitted."""
        return self._signal(self.scene)

    @cached_property
    def _slopes(self) -> tuple[Array, Array]:
        """The signal's slopes at the blocks, down and across, over a pixel."""
        down, across = np.gradient(self._signal_image)
        return self.thin(down), self.thin(across)

    def _column(self, key: str) -> Array:
        if key == GAMMA:
            return np.asarray(self._gamma_slope)
        if key == BLUR:
            return np.asarray(self.thin(_curvature(self._signal_image)) * self._gain)
        if key in SMOOTH_KEYS:
            added = self._smooth(key)
            moved = self._signal(self.scene, self._fields[0] + np.complex64(_STRESS_MPA) * added)
            return np.asarray((moved - self._here) * (self._gain / _STRESS_MPA))
        if key == FRINGE_VALUE:
            moved = self._signal(self.scene, self._fields[0] * np.float32(1.0 - _STEP))
            return np.asarray((moved - self._here) * (self._gain / (_STEP * self.scene.get(key))))
        if key == EARLIER:
            return self._past_column(float(self.scene.get(key)))
        return self._moved_column(key)

    def _past_column(self, change: float) -> Array:
        """By what the scar would be, had it been worn under another friction."""
        field, _ = self._renderer.order_field(self.scene.with_values({EARLIER: change + _FRICTION}))
        moved = self._signal(self.scene, np.nan_to_num(self.thin(field)))
        return np.asarray((moved - self._here) * (self._gain / _FRICTION))

    def _smooth(self, key: str) -> Array:
        """The stress of one of the smooth ones at 1 MPa, or MPa/mm, at the blocks."""
        x, z = self._places(self.scene)
        mode = regular_modes(1)[SMOOTH_KEYS.index(key)]
        return mode.difference(x, np.maximum(z, 0.0)).astype(np.complex64)

    def _places(self, scene: Scene) -> tuple[Array, Array]:
        # every third pixel's own centre, not that of the three
        grid = pixel_grid(scene, self.data.shape).every(BLOCK)
        x, z = (np.broadcast_to(v, self._chosen.shape)[self._chosen] for v in grid.places)
        return x, z

    def _moved_column(self, key: str) -> Array:
        """By the picture's slope, and where the pixels look then: lens, scale and place."""
        start = float(self.scene.get(key) or 0.0)
        step = _STEP * (start if key == PIXEL else 60.0 if key == LENS[0] else 1.0)
        before, after = (
            self._places(self.scene.with_values({key: value})) for value in (start, start + step)
        )
        down, across = self._slopes
        change = across * (after[0] - before[0]) + down * (after[1] - before[1])
        return np.asarray(change * self._gain / (self.scene.get(PIXEL) * step))

    def _signal(self, scene: Scene, field: Array | None = None) -> Array:
        """The signal at the blocks for a scene's own optics, and a field (n,)."""
        field = self._fields[0] if field is None else field
        return scene_optics(scene).signal(field, visibility=self._fields[1])


def _without_means(values: Array, lines: Array) -> Array:
    """Values (k, n) less their means over each line (n,) of the picture."""
    from scipy.sparse import csr_array

    count = np.bincount(lines)
    there = csr_array((np.ones(len(lines)), (np.arange(len(lines)), lines)))
    means = (values @ there) / np.maximum(count, 1)
    return np.asarray(values - means[:, lines], values.dtype)


def _inner(keep: Mask) -> Mask:
    """Pixels with four neighbours that were fitted, without the frame's rim."""
    near = keep[:-2, 1:-1] & keep[2:, 1:-1] & keep[1:-1, :-2] & keep[1:-1, 2:]
    return near & keep[1:-1, 1:-1]


def _curvature(image: Array) -> Array:
    """What a blur of a pixel adds to an image: half its curvature."""
    from scipy.ndimage import laplace

    return np.asarray(0.5 * laplace(image))


def _shadow(image: Array, keep: Mask) -> Mask | None:
    """Blocks (rows/3, cols/3) that a shadow on the surface may reach, None where there is none.

    It is one where most of what noise does not explain of a residual `image` lies there, and that
    is no accident.
    """
    beside = np.arange(len(keep))[:, None] < np.argmax(keep, axis=0) + _SHADOW_PX
    excess = np.where(keep, image**2 - 1.0, 0.0)
    there, count = float(excess[beside].sum()), int(keep[beside].sum())
    chance = max(_FELT * count, _CLEAR * (2.0 * count) ** 0.5)
    if there < max(chance, _OF_THE_EXCESS * float(excess.sum())):
        return None
    return np.asarray(beside[::BLOCK, ::BLOCK])


def _largest_near(image: Array) -> Array:
    """The largest size within each block (rows/3, cols/3)."""
    from scipy.ndimage import maximum_filter

    return np.asarray(maximum_filter(np.abs(image), BLOCK)[::BLOCK, ::BLOCK])


def block_sums(image: Array) -> Array:
    """Sums over 3 x 3 pixels about every third one."""
    from scipy.ndimage import uniform_filter

    mean = uniform_filter(image, BLOCK, mode="constant")
    return np.asarray(mean[::BLOCK, ::BLOCK] * BLOCK**2)
