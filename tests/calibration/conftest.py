"""Frames rendered here from the closed forms, by nothing that is under test.

Pixels have an area.
"""

import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from isochrome import calibration
from isochrome.calibration.shot import below_saturation
from isochrome.frames import estimate_noise, saturation_level
from isochrome.scene import Camera

F_SIGMA = 14.6
DIAMETER = 30.0
SMALL_DISC = {"shape": (170, 200), "radius": 75.0, "shift": (1.65, -3.1)}
"""The disc of `disc_frame` at half the resolution."""
TINY_DISC = {"shape": (100, 110), "radius": 42.0, "shift": (1.0, -2.0)}
HEIGHT, INNER, OUTER, PIXEL = 20.0, 40.0, 100.0, 0.07
BEAM = calibration.Beam(height_mm=HEIGHT, inner_span_mm=INNER, outer_span_mm=OUTER)


def _camera(signal, rng, noise, background, blur, gamma):
    rows, cols = signal.shape
    y, x = np.mgrid[:rows, :cols]
    away = ((y - rows / 2) ** 2 + (x - cols / 2) ** 2) / ((rows / 2) ** 2 + (cols / 2) ** 2)
    light = background + 210.0 * (1.0 - 0.3 * away) * signal
    if blur:
        kernel = np.exp(-0.5 * (np.arange(-9, 10) / blur) ** 2)
        kernel /= kernel.sum()
        for axis in (0, 1):
            light = np.apply_along_axis(
                lambda v: np.convolve(np.pad(v, 9, "edge"), kernel, "valid"), axis, light
            )
    light = 255.0 * (light / 255.0) ** (1.0 / gamma)
    grey = light + rng.normal(0.0, noise, light.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


@pytest.fixture(scope="session")
def beam_frame():
    """(order at the edge, rng, ...) -> grey levels: a beam across the columns, tilted."""

    def render(edge, rng, *, tilt=2.0, pixel=PIXEL, shape=(330, 440), axis_mm=0.15, bright=False,
               noise=3.0, background=12.0, blur=0.0, gamma=1.0, residual=0.0):  # fmt: skip
        y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
        turn = np.radians(tilt)
        y, x = y - shape[0] / 2 - 4.0, x - shape[1] / 2
        eta = (y * np.cos(turn) + x * np.sin(turn)) * pixel
        steep = (edge + residual) * pixel / (0.5 * HEIGHT)
        order = steep * (eta - axis_mm) / pixel
        # the mean over a pixel's area: Bracewell (2000), The Fourier transform, chapter 4
        contrast = np.sinc(steep * np.cos(turn)) * np.sinc(steep * np.sin(turn))
        wave = 0.5 - 0.5 * np.cos(2.0 * np.pi * order) * contrast
        wave = 1.0 - wave if bright else wave
        inside = np.abs(eta) < 0.5 * HEIGHT
        signal = np.where(inside, wave, 1.0 if bright else 0.0)
        return _camera(signal, rng, noise, background, blur, gamma)

    return render


@pytest.fixture(scope="session")
def disc_frame():
    """(centre order, rng, ...) -> grey levels: a disc pressed near the columns' direction."""

    def render(centre, rng, *, angle=2.0, radius=150.0, shape=(340, 400), shift=(3.3, -6.2),
               bright=False, noise=3.0, background=12.0, blur=0.0, gamma=1.0,
               residual=None):  # fmt: skip
        # the mean over a pixel's area: by three by three places of equal parts
        rows, cols = ((np.arange(3 * n) - 1.0) / 3.0 for n in shape)
        y, x = np.meshgrid(rows, cols, indexing="ij")
        z, x = (y - shape[0] / 2 - shift[0]) / radius, (x - shape[1] / 2 - shift[1]) / radius
        along = z * np.cos(np.radians(angle)) + x * np.sin(np.radians(angle))
        square = x**2 + z**2
        inside = square < 1.0
        field = (1.0 - square) / ((1.0 + square) ** 2 - 4.0 * along**2 + 1e-9)
        order = centre * np.where(inside, field, 0.0)
        if residual is not None:
            order = order + np.where(inside, residual(x, z), 0.0)
        wave = np.sin(np.pi * order) ** 2
        wave = wave.reshape(shape[0], 3, shape[1], 3).mean(axis=(1, 3))
        return _camera(1.0 - wave if bright else wave, rng, noise, background, blur, gamma)

    return render


def as_shots(images, loads, *, sigma=None, bright=False):
    """Shots of arrays of linear light, of integer types saturated on a plateau at the top.

    `sigma`: one number, or a number or map an image; by default the noise is estimated.
    """
    shots = []
    for i, (image, load) in enumerate(zip(images, loads, strict=True)):
        light, kind = np.asarray(image, dtype=float), np.asarray(image).dtype
        valid = np.isfinite(light)
        noise = sigma if sigma is None or isinstance(sigma, int | float) else sigma[i]
        if noise is None:
            filled = np.where(valid, light, np.median(light[valid]))
            noise = estimate_noise(filled, valid).sigma(uniform_filter(filled, 3))
            noise = np.maximum(noise, 1e-4 * np.ptp(filled) + 1e-12)
        noise = np.broadcast_to(np.asarray(noise, dtype=float), light.shape)
        if kind.kind in "ui":
            level = saturation_level(np.asarray(image), full=float(np.iinfo(kind).max))
            valid &= below_saturation(light, noise, level)
        shots.append(
            calibration.Shot(
                name=f"image {i + 1}", light=light, sigma=noise, valid=valid, raw=light,
                raw_sigma=noise, gamma=1.0, load_n=float(load), bright=bright,
            )
        )  # fmt: skip
    return tuple(shots)


def set_of(**tables):
    """What a set states besides its images, which are given as shots."""
    stated = {name: table for name, table in tables.items() if table is not None}
    return calibration.CalibrationSet(
        image=[calibration.LoadedImage(file="none", load_n=1.0)], **stated
    )


def bending_from_images(images, loads, beam, pixel, *, uncertainty=None, **options):
    """A beam's calibration from arrays."""
    given = set_of(beam=beam, camera=Camera(pixel_mm=pixel), uncertainty=uncertainty)
    return calibration.bending_from_shots(as_shots(images, loads, **options), given)


def disc_from_images(images, loads, disc, *, uncertainty=None, **options):
    """A disc's calibration from arrays."""
    given = set_of(disc=disc, uncertainty=uncertainty)
    return calibration.disc_from_shots(as_shots(images, loads, **options), given)


def assert_agrees(found, bar=1.0, *, times=4.0):
    """See that a fringe value is within `bar` of the truth, and so many of its uncertainties."""
    error = abs(found.fringe_value_n_per_mm - F_SIGMA)
    assert error < bar * F_SIGMA and error < times * found.standard_uncertainty


def bending_load(edge_order):
    """P of an edge order: N = 6 M/(h^2 f), M = P (Lo - Li)/4."""
    return edge_order * F_SIGMA * HEIGHT**2 * 4.0 / (6.0 * (OUTER - INNER))


def disc_load(centre_order):
    """P of a centre order: N = 8 P/(pi D f)."""
    return centre_order * np.pi * DIAMETER * F_SIGMA / 8.0
