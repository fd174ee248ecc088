"""Pictures of calibration targets, no code of the package: a pixel is the mean of samples at the
places that it looks at."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.ndimage import gaussian_filter

from benchmarks.outside_camera import seen_places

SAMPLES = 3
"""Samples along a pixel's side; an edge is a ramp of one sample's width, not a staircase."""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A target and the camera that sees it.

    `shape` (rows, cols), px; `pixel_mm`; `roll_deg`, counter-clockwise; `distortion`, `keystone_x`,
    `keystone_z`, displacement over distance in the corners and at the middles of the right and
    lower edges; `shorten`, by how much the target is seen shorter across; `x_mm`, `z_mm`, the
    target's middle; `columns`, `rows` of corners or dots `spacing_mm` apart; `blur_px`, `noise` in
    grey levels of 255.
    """

    shape: tuple[int, int] = (300, 400)
    pixel_mm: float = 0.02
    roll_deg: float = 0.0
    distortion: float = 0.0
    keystone_x: float = 0.0
    keystone_z: float = 0.0
    shorten: float = 0.0
    x_mm: float = 0.0
    z_mm: float = 0.0
    columns: int = 11
    rows: int = 8
    spacing_mm: float = 0.62
    blur_px: float = 0.7
    noise: float = 2.0


def picture(paint, shown, seed=0):
    """Grey levels (rows, cols) of `paint`, light 0..1 at places (mm) from the target's middle."""
    rows, cols = shown.shape
    step = [(np.arange(n * SAMPLES) + 0.5) / SAMPLES - 0.5 * n for n in shown.shape]
    v, u = np.meshgrid(*step, indexing="ij")
    x, z = u.copy(), v.copy()
    off = 1.0
    while off > 1e-7:  # px; the way from target to picture, inverted by plain fixed points
        a, b = seen_places(x, z, (0.5 * cols, 0.5 * rows), shown)
        du, dv = u - a, v - b
        x, z, off = x + du, z + dv, max(np.abs(du).max(), np.abs(dv).max())
    x, z = shown.pixel_mm * x - shown.x_mm, shown.pixel_mm * z - shown.z_mm
    light = paint(x / (1.0 - shown.shorten), z)
    light = light.reshape(rows, SAMPLES, cols, SAMPLES).mean(axis=(1, 3))
    light = gaussian_filter(light, shown.blur_px, mode="nearest")
    noise = shown.noise * np.random.default_rng(seed).normal(size=light.shape)
    grey = np.clip(np.rint(30.0 + 190.0 * light + noise), 0, 255).astype(np.uint8)
    grey.flags.writeable = False  # a picture is painted once for all that ask for it
    return grey


def ramp(off_mm, shown):
    """From -1 to 1 over a sample's width about an edge that is `off_mm` away."""
    return np.clip(2.0 * SAMPLES * off_mm / shown.pixel_mm, -1.0, 1.0)


@cache
def chessboard(shown, seed=0):
    """A board of `columns` x `rows` inner corners with a white margin."""

    def paint(x, z):
        sides, on = [], True
        for place, count in ((x, shown.columns + 1), (z, shown.rows + 1)):
            i = place / shown.spacing_mm + 0.5 * count
            off = shown.spacing_mm * np.abs(i - np.rint(i))
            sides.append(np.where(np.floor(i) % 2, 1.0, -1.0) * ramp(off, shown))
            on = on & (i > 0) & (i < count)
        return np.where(on, 0.5 - 0.5 * sides[0] * sides[1], 1.0)

    return picture(paint, shown, seed)


@cache
def dots(shown, seed=0, *, bright=False):
    """A grid of `columns` x `rows` round dots of half the spacing, black on white or reversed."""

    def paint(x, z):
        i = x / shown.spacing_mm + 0.5 * (shown.columns - 1)
        j = z / shown.spacing_mm + 0.5 * (shown.rows - 1)
        near_i = np.clip(np.rint(i), 0, shown.columns - 1)
        near_j = np.clip(np.rint(j), 0, shown.rows - 1)
        beyond = shown.spacing_mm * (np.hypot(i - near_i, j - near_j) - 0.25)
        light = 0.5 + 0.5 * ramp(beyond, shown)
        return 1.0 - light if bright else light

    return picture(paint, shown, seed)


def bar(shown, width_mm, angle_deg=0.0, seed=0):
    """A dark bar of parallel edges, upright at an angle of zero."""
    turn = np.radians(angle_deg)

    def paint(x, z):
        beyond = np.abs(np.cos(turn) * x + np.sin(turn) * z) - 0.5 * width_mm
        return 0.5 + 0.5 * ramp(beyond, shown)

    return picture(paint, shown, seed)


def drawn(seed, **fixed):
    """A camera and place by chance: distortion and keystone to 2 %, roll to 5 degrees."""
    rng = np.random.default_rng(seed)
    free = {
        "roll_deg": rng.uniform(-5.0, 5.0), "distortion": rng.uniform(-0.02, 0.02),
        "keystone_x": rng.uniform(-0.02, 0.02), "keystone_z": rng.uniform(-0.02, 0.02),
        "x_mm": rng.uniform(-0.1, 0.1), "z_mm": rng.uniform(-0.1, 0.1),
    }  # fmt: skip
    return replace(Shown(), **{**free, **fixed})
