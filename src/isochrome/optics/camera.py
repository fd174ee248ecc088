"""The camera: what the sensor makes of the light, and its response over wavelength."""

from dataclasses import dataclass
from functools import lru_cache
from math import comb
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.output import read_given_table
from isochrome.scene import Camera
from isochrome.stress import ROWS_AT_ONCE

Array = NDArray[np.floating]

COLOURS = ("red", "green", "blue")
GREY = ("grey",)

GENERIC_PEAK_NM = (600.0, 540.0, 460.0)
GENERIC_WIDTH_NM = (35.0, 33.0, 30.0)
"""Peaks and standard deviations of three Gaussians: of the kind of a colour sensor behind an
infrared filter, and of no sensor in particular. Who wants colours to compare measures theirs."""


@dataclass(frozen=True)
class Response:
    """Response of each channel of a camera over wavelength: linear in its table, zero beyond.
    Without a table: generic Gaussians for three channels, and an equal response for one."""

    names: tuple[str, ...]
    wavelength_nm: Array | None = None  # (m,), rising
    value: Array | None = None  # (channels, m)

    def at(self, wavelength_nm: Array) -> Array:
        """Response (channels, n) at wavelengths (n,), nm."""
        if self.wavelength_nm is not None and self.value is not None:
            known = self.wavelength_nm
            table = [np.interp(wavelength_nm, known, v, left=0, right=0) for v in self.value]
            return np.array(table)
        if len(self.names) == 1:
            return np.ones((1, len(wavelength_nm)))
        peak, width = np.array(GENERIC_PEAK_NM), np.array(GENERIC_WIDTH_NM)
        return np.asarray(np.exp(-0.5 * ((wavelength_nm - peak[:, None]) / width[:, None]) ** 2))


def camera_response(camera: Camera, path: Path | None = None) -> Response:
    """Response of a camera's three channels, or one, by its CSV file; None: the generic one. The
    file has wavelength_nm and a column for each channel; InputError names it and the fix."""
    names = COLOURS if camera.colour else GREY
    if path is None:
        return Response(names)
    given = read_given_table(path, "the camera's response")
    columns = ("wavelength_nm", *names)
    if not set(columns) <= set(given.names):
        listed, header = ", ".join(columns), given.header
        raise InputError("camera_response_needs_columns", path=path, columns=listed, header=header)
    table = np.stack([given.column(name) for name in columns], axis=1)
    if len(table) < 2 or (np.diff(table[:, 0]) <= 0.0).any():
        raise InputError("camera_response_needs_two", path=path)
    if (table[:, 1:] < 0.0).any() or not (table[:, 1:] > 0.0).any(axis=0).all():
        raise InputError("response_must_not_negative", path=path)
    return Response(names, table[:, 0], table[:, 1:].T.copy())


def expose(
    signal: Array, camera: Camera, *, rng: np.random.Generator | None = None
) -> NDArray[np.generic]:
    """The grey levels that the camera stores of a signal (rows, cols[, channels]), 1 = full light.
    Equation: L = background + brightness (1 - vignette r²) signal, with r the distance from the
    middle over half the diagonal; blurred; with shot noise of L full_well electrons; stored as
    L^(1/gamma) full scale plus read noise, rounded and clipped to the bit depth (float32 without
    one). Noise is independent in every pixel and channel, seeded with camera.seed without `rng`."""
    rng = np.random.default_rng(camera.seed) if rng is None else rng
    light = signal
    if camera.vignette != 0.0:
        rows, cols = (np.linspace(-1.0, 1.0, n) for n in signal.shape[:2])
        fall_off = 1.0 - camera.vignette * 0.5 * (rows[:, None] ** 2 + cols[None, :] ** 2)
        # alike in all channels
        fall_off = fall_off.reshape(signal.shape[:2] + (1,) * (signal.ndim - 2))
        light = camera.brightness * fall_off * light
    elif camera.brightness != 1.0:
        light = camera.brightness * light
    if camera.background != 0.0:
        light = camera.background + light
    light = blurred(light, camera.blur_px)
    if camera.full_well_electrons is not None:
        electrons = np.maximum(light, 0.0) * camera.full_well_electrons
        light = rng.poisson(electrons) / camera.full_well_electrons
    stored = np.maximum(light, 0.0) ** (1.0 / camera.gamma) if camera.gamma != 1.0 else light
    if camera.bit_depth is None:
        noise = rng.normal(0.0, camera.noise_grey, stored.shape) if camera.noise_grey else 0.0
        return (stored + noise).astype(np.float32)
    full = 2.0**camera.bit_depth - 1.0
    frame = np.empty(stored.shape, stored_type(camera.bit_depth))
    for start in range(0, len(stored), ROWS_AT_ONCE):
        grey = stored[start : start + ROWS_AT_ONCE] * full
        if camera.noise_grey > 0.0:
            grey = grey + rng.normal(0.0, camera.noise_grey, grey.shape)
        np.rint(grey, out=grey)
        frame[start : start + ROWS_AT_ONCE] = np.clip(grey, 0.0, full, out=grey)
    return frame


def stored_type(bit_depth: int | None) -> np.dtype[Any]:
    """Type of a sensor's grey levels: uint8 up to 8 bits, uint16 beyond, else float32."""
    if bit_depth is None:
        return np.dtype(np.float32)
    return np.dtype(np.uint8 if bit_depth <= 8 else np.uint16)


_TERMS = 6
"""Of a kernel's series: with them a wave of four pixels keeps what it should to 0.13 % at a blur of
a pixel, and to 0.02 % at 0.4."""
_LEAST_WEIGHT = 1e-6
"""Where a kernel ends: below what single precision holds of the light."""


def blurred(image: Array, sigma_px: float) -> Array:
    """An image (rows, cols) or (rows, cols, channels) through a Gaussian blur; its rim goes on.
    What a wave of w radians a pixel keeps is exp(-s² w²/2), as of a Gaussian of standard deviation
    s before the pixels take their samples: the Gaussian's own values at the pixels are that of a
    narrower blur below a pixel, and of none at all below a fifth."""
    if sigma_px == 0.0:
        return image
    import cv2

    kernel = _blur_kernel(float(sigma_px))
    light = np.ascontiguousarray(image)
    return np.asarray(cv2.sepFilter2D(light, -1, kernel, kernel, borderType=cv2.BORDER_REPLICATE))


@lru_cache(maxsize=8)
def _blur_kernel(sigma_px: float) -> Array:
    """Weights (2 r + 1,) at whole pixels, whose sum is 1 and whose variance is s². From what each
    wave keeps, with w² = 2 Σ (2 c)^n / (n² C(2 n, n)) in c = 1 - cos w, whose first terms make a
    short kernel. Source: Gradshteyn & Ryzhik (2007), Table of Integrals, Series, and Products,
    1.645.2."""
    size = 1 << int(np.ceil(np.log2(16.0 * sigma_px + 64.0)))
    bend = 1.0 - np.cos(2.0 * np.pi * np.arange(size // 2 + 1) / size)
    square = sum(2.0 * (2.0 * bend) ** n / (n**2 * comb(2 * n, n)) for n in range(1, _TERMS + 1))
    kernel = np.fft.fftshift(np.fft.irfft(np.exp(-0.5 * sigma_px**2 * square)))
    middle = size // 2
    reach = int(np.abs(np.flatnonzero(np.abs(kernel) > _LEAST_WEIGHT) - middle).max())
    weights = kernel[middle - reach : middle + reach + 1]
    return np.asarray(weights / weights.sum())
