"""Frames of a bench that is not ours: the stress is the package's, on thirds of pixels; all between
it and the stored grey levels is written here once more, supersampled."""

import io
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from isochrome.scene import Scene
from isochrome.simulation import scene_states, state_difference
from isochrome.stress import pixel_grid

FINE, SAMPLES, MARGIN = 3, 3, 40
"""Grid points a pixel, samples a pixel's side, pixels of field around the picture."""


@dataclass(frozen=True, kw_only=True)
class Defects:
    """What is wrong with a bench; as it stands, nothing.

    Geometry: `roll_deg`, counter-clockwise; `distortion`, `keystone_x`, `keystone_z`, displacement
    over distance in the corners and at the middles of the right and the lower edge. Light:
    `fall_off` in the corners; `spot`, `bar`, heights of a spot of light and of a bright bar over
    the rest; `background`, `background_slope`, `background_fall_off`, of full light. Optics:
    `band_nm`, width of a Gaussian band at half height; `plate_error_deg`, both plates'. Sensor:
    `gamma`, `blur_px`, `noise`, `row_noise`, `flicker` (share of the light, in bands of rows),
    `jpeg` quality, `bits` stored in `container`. Things: `dust` specks, `shadow_px` rows below the
    surface.
    """

    roll_deg: float = 0.0
    distortion: float = 0.0
    keystone_x: float = 0.0
    keystone_z: float = 0.0
    fall_off: float = 0.3
    spot: float = 0.0
    bar: float = 0.0
    background: float = 0.05
    background_slope: float = 0.0
    background_fall_off: float = 0.0
    band_nm: float = 0.0
    plate_error_deg: float = 0.0
    gamma: float = 1.0
    blur_px: float = 0.0
    noise: float = 3.0
    row_noise: float = 0.0
    flicker: float = 0.0
    jpeg: int | None = None
    bits: int = 8
    container: int = 8
    dust: int = 0
    shadow_px: int = 0


NONE = Defects()


def frame(scene: Scene, defects: Defects = NONE, seed: int = 0, state: int = -1):
    """The stored grey levels (rows, cols) of a state of a scene whose [camera] gives the grid."""
    rng = np.random.default_rng(seed)
    order, turn = _sampled(scene, defects, state)
    signal = _band(order, turn, defects)
    return _stored(_things(lit(signal, defects), defects, rng, scene), defects, rng)


def lit(signal, defects, samples=SAMPLES):
    """The pixels' light (rows, cols): lamp and stray light on a signal at their samples.

    An objective blurs the light itself, before pixels take the mean of it over their area.
    """
    light = _lamp(signal.shape, defects) * signal + _stray(signal.shape, defects)
    if defects.blur_px:
        light = gaussian_filter(light, defects.blur_px * samples, mode="nearest")
    return light.reshape(light.shape[0] // samples, samples, -1, samples).mean(axis=(1, 3))


def _places(rows, cols, defects):
    """Places (px from the picture's middle) on the specimen that the samples look at."""
    step = (np.arange(rows * SAMPLES) + 0.5) / SAMPLES - 0.5 * rows
    v, u = np.meshgrid(
        step, (np.arange(cols * SAMPLES) + 0.5) / SAMPLES - 0.5 * cols, indexing="ij"
    )
    half = 0.5 * cols, 0.5 * rows
    x, z = u.copy(), v.copy()
    for _ in range(30):  # the way from specimen to picture, inverted by plain fixed points
        a, b = seen_places(x, z, half, defects)
        x, z = x + (u - a), z + (v - b)
    return x, z


def seen_places(x, z, half, defects):
    """Where the picture shows places of the specimen: roll, then keystone, then distortion."""
    phi = np.radians(defects.roll_deg)
    # z is down: counter-clockwise takes what lies to the right upwards
    x, z = np.cos(phi) * x + np.sin(phi) * z, -np.sin(phi) * x + np.cos(phi) * z
    w = 1.0 - defects.keystone_x * x / half[0] - defects.keystone_z * z / half[1]
    x, z = x / w, z / w
    stretch = 1.0 + defects.distortion * (x**2 + z**2) / (half[0] ** 2 + half[1] ** 2)
    return x * stretch, z * stretch


@lru_cache(maxsize=4)
def _field(scene: Scene, state: int):
    """The stress field on thirds of pixels around the picture, and the picture's own grid."""
    grid = pixel_grid(scene)
    camera = {
        "camera.pixel_mm": grid.pixel_mm / FINE,
        "camera.width_px": FINE * (grid.cols + 2 * MARGIN),
        "camera.height_px": FINE * (grid.rows + 2 * MARGIN),
        "camera.left_mm": grid.left_mm - MARGIN * grid.pixel_mm,
        "camera.top_mm": grid.top_mm - MARGIN * grid.pixel_mm,
    }
    wide = scene.with_values(camera)
    field = state_difference(wide, scene_states(wide)[state], pixel_grid(wide))
    return np.asarray(field, complex), grid


def _sampled(scene, defects, state):
    """Fringe order and direction of sigma_1 at the samples; NaN where there is no specimen."""
    field, grid = _field(scene, state)
    x, z = _places(grid.rows, grid.cols, defects)
    at = [FINE * (v + 0.5 * n + MARGIN) - 0.5 for v, n in ((z, grid.rows), (x, grid.cols))]
    body = grid.top_mm + grid.pixel_mm * (z + 0.5 * grid.rows) > 0.0
    found = map_coordinates(np.nan_to_num(field), at, order=3, mode="nearest")
    found = np.where(body, found, np.nan)
    specimen = scene.specimen
    scale = specimen.thickness_mm / specimen.fringe_value_n_per_mm
    return scale * np.abs(found), -0.5 * np.angle(found)


def _band(order, turn, defects):
    """The dark field's signal, averaged over a Gaussian band of wavelengths about 587 nm."""
    if not defects.band_nm:
        return np.nan_to_num(_dark_field(order, turn, defects))
    sigma = defects.band_nm / 2.3548
    points, weights = np.polynomial.hermite_e.hermegauss(15)
    total = 0.0
    for point, weight in zip(points, weights / weights.sum(), strict=True):
        total = total + weight * _dark_field(order * 587.0 / (587.0 + sigma * point), turn, defects)
    return np.nan_to_num(total)


def _dark_field(order, turn, defects):
    """Jones: polariser along y, plate at 45°, specimen, plate at -45°, analyser along x."""
    if not defects.plate_error_deg:
        return np.sin(np.pi * order) ** 2
    plates = [np.radians(a + defects.plate_error_deg) for a in (45.0, -45.0)]
    first = _retarder(np.pi / 2.0, plates[0]) @ np.array([0.0, 1.0])
    delta, c, s = 2.0 * np.pi * order, np.cos(turn), np.sin(turn)
    fast, slow = np.exp(0.5j * delta), np.exp(-0.5j * delta)
    along, across = c * first[0] + s * first[1], -s * first[0] + c * first[1]
    along, across = fast * along, slow * across
    behind = np.stack([c * along - s * across, s * along + c * across])
    last = np.array([1.0, 0.0]) @ _retarder(np.pi / 2.0, plates[1])
    return np.abs(np.tensordot(last, behind, 1)) ** 2


def _retarder(delta, angle):
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return turn @ np.diag([np.exp(0.5j * delta), np.exp(-0.5j * delta)]) @ turn.T


def _unit(shape):
    return np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in shape), indexing="ij")


def _lamp(shape, defects):
    """The light's intensity, about .8 of full scale at its brightest."""
    z, x = _unit(shape)
    lamp = 1.0 - 0.5 * defects.fall_off * (x**2 + z**2)
    lamp = lamp + defects.spot * np.exp(-(((x - 0.3) / 0.5) ** 2) - ((z + 0.2) / 0.6) ** 2)
    lamp = lamp + defects.bar * np.exp(-(((x + 0.4) / 0.25) ** 2))
    return 0.8 * lamp / lamp.max()


def _stray(shape, defects):
    z, x = _unit(shape)
    slope = 1.0 + defects.background_slope * (0.7 * x + 0.3 * z)
    return defects.background * slope * (1.0 - 0.5 * defects.background_fall_off * (x**2 + z**2))


def _things(light, defects, rng, scene):
    """Specks of dust on the glass, and rows below the surface that the indenter shadows."""
    rows, cols = np.indices(light.shape)
    light = light.copy()
    for _ in range(defects.dust):
        row, col, radius = (
            rng.uniform(0, len(light)), rng.uniform(0, light.shape[1]), rng.uniform(1, 4),
        )  # fmt: skip
        light[np.hypot(rows - row, cols - col) < radius] *= rng.uniform(0.0, 0.6)
    if defects.shadow_px:
        first = max(0, round(-pixel_grid(scene).top_mm / pixel_grid(scene).pixel_mm))
        depth = np.clip((rows - first) / defects.shadow_px, 0.0, 1.0)
        light *= 0.4 + 0.6 * depth
    return light


def _stored(light, defects, rng):
    """Tone, noise, flicker, quantisation and compression."""
    if defects.flicker:
        beat = np.sin(2.0 * np.pi * np.arange(len(light)) / 37.0 + rng.uniform(0.0, 6.28))
        light = light * (1.0 + defects.flicker * beat)[:, None]
    full = 2.0**defects.bits - 1.0
    grey = full * np.maximum(light, 0.0) ** (1.0 / defects.gamma)
    scale = full / 255.0
    grey = grey + scale * defects.noise * rng.normal(size=grey.shape)
    grey = grey + scale * defects.row_noise * rng.normal(size=(len(grey), 1))
    grey = np.clip(np.rint(grey), 0.0, full)
    if defects.container > 8:
        return (grey * 2.0 ** (defects.container - defects.bits)).astype(np.uint16)
    grey = grey.astype(np.uint8)
    return grey if defects.jpeg is None else _compressed(grey, defects.jpeg)


def _compressed(grey, quality):
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(grey).save(buffer, "jpeg", quality=quality)
    return np.asarray(Image.open(buffer).convert("L"))
