"""From a decoded video frame to grey levels or RGB, by the format's own bits.

FFmpeg's own conversion truncates, and takes deep colour through 8 bits; luminance and chrominance
are turned into RGB here instead, rounded once. Grey and RGB are taken as they are stored.
"""

import sys
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.errors import InputError
from isochrome.messages import message

FULL_RANGE = 2
"""FFmpeg's number for levels that use all bits; else black and white lie at 16 and 235 of 255."""

WEIGHTS = {1: (0.2126, 0.0722), 9: (0.2627, 0.0593), 10: (0.2627, 0.0593)}
"""Weights of red and blue in the luminance by FFmpeg's number of the colour space."""

WEIGHTS_601 = (0.299, 0.114)
"""The same of ITU-R BT.601, which also stands for 'not specified'."""

PLANAR = {"yuyv422": "yuv422p", "uyvy422": "yuv422p", "yvyu422": "yuv422p", "nv12": "yuv420p",
          "nv21": "yuv420p", "nv16": "yuv422p", "nv24": "yuv444p", "nv42": "yuv444p",
          "p010le": "yuv420p10le", "p010be": "yuv420p10le", "p210le": "yuv422p10le",
          "p410le": "yuv444p10le", "p016le": "yuv420p16le"}  # fmt: skip
"""Formats that differ from a planar one in the order of their values only."""

EIGHT_BIT_RGB = ("rgb24", "bgr24", "rgba", "bgra", "argb", "abgr", "rgb0", "bgr0", "0rgb", "0bgr",
                 "pal8", "rgb8", "bgr8", "rgb4_byte", "bgr4_byte", "monob", "monow", "rgb565le",
                 "rgb565be", "rgb555le", "rgb555be", "bgr565le", "bgr555le")  # fmt: skip
DEEP_RGB = ("rgb48le", "rgb48be", "bgr48le", "bgr48be", "rgba64le", "rgba64be", "bgra64le",
            "bgra64be")  # fmt: skip


def to_image(frame: Any, path: Path) -> tuple[np.ndarray, int | None]:
    """A frame's pixels (row, col), or (row, col, 3) in RGB, and the bits of a value (None:
    float).
    """
    name: str = frame.format.name
    if name.startswith("yuvj"):
        return _rgb_of_yuv(frame, full=True)
    if name in PLANAR:
        full = frame.color_range == FULL_RANGE
        return _rgb_of_yuv(frame.reformat(format=PLANAR[name]), full=full, space=frame.colorspace)
    if name.startswith("yuv") and "p" in name:
        return _rgb_of_yuv(frame, full=frame.color_range == FULL_RANGE)
    if name.startswith(("gray", "ya")):
        grey = plane_of(frame, 0)[:, :: 2 if name.startswith("ya") else 1]
        return np.array(grey, order="C"), None if "f" in name else _bits(frame)
    if name.startswith(("gbrp", "gbrap")) and "f" not in name:
        green, blue, red = (plane_of(frame, k) for k in range(3))
        return np.stack([red, green, blue], axis=-1), _bits(frame)
    if name in EIGHT_BIT_RGB:
        return frame.to_ndarray(format="rgb24"), 8
    if name in DEEP_RGB:
        return frame.to_ndarray(format="rgb48le").astype(np.uint16, copy=False), 16
    raise InputError(message("holds_pixels_format_which", path=path, name=name))


def _bits(frame: Any) -> int:
    return int(frame.format.components[0].bits)


def plane_of(frame: Any, number: int) -> np.ndarray:
    """One plane as it is stored, (row, col), in native byte order; packed pixels as bytes.

    It is looked at where the decoder has it, and goes on from: to be copied before it is given out.
    """
    plane, form = frame.planes[number], frame.format
    bits = _bits(frame)
    dtype = np.dtype(np.uint8 if bits <= 8 else np.float32 if bits == 32 else np.uint16)
    if form.name.endswith("be" if sys.byteorder == "little" else "le"):
        dtype = dtype.newbyteorder()
    width, packed = plane.width, len(form.components) > 1 and not form.is_planar
    if packed:
        width = -(-plane.width * form.padded_bits_per_pixel // (8 * dtype.itemsize))
    elif form.name.startswith("nv") and number == 1:
        width *= 2
    stored = np.frombuffer(plane, np.uint8)[: plane.line_size * plane.height]
    rows = stored.reshape(plane.height, plane.line_size)[:, : width * dtype.itemsize]
    return rows.view(dtype).astype(dtype.newbyteorder("="), copy=False)


def _rgb_of_yuv(
    frame: Any, *, full: bool, space: int | None = None
) -> tuple[np.ndarray, int | None]:
    """RGB = Y' + matrix (Cb, Cr), in the bits of the frame; without colour, without arithmetic.

    Source: ITU-R BT.601-7, BT.709-6, BT.2020-2; Rec. ITU-T H.273 for the levels.
    """
    bits = _bits(frame)
    luma, cb, cr = (plane_of(frame, k) for k in range(3))
    half = 1 << (bits - 1)
    if (cb == half).all() and (cr == half).all():  # mono, stored as colour
        grey = np.array(luma, order="C") if full else _through(_levels(bits), luma)
        return np.broadcast_to(grey[..., None], (*grey.shape, 3)), bits
    red, blue = WEIGHTS.get(int(frame.colorspace if space is None else space), WEIGHTS_601)
    top = float(2**bits - 1)
    scale = top / (2**bits - 1 if full else 224 << (bits - 8))
    black, white = (0, 2**bits - 1) if full else (16 << (bits - 8), 235 << (bits - 8))
    light = (luma.astype(np.float32) - black) * np.float32(top / (white - black))
    b, r = (_widened(c, luma.shape).astype(np.float32) - half for c in (cb, cr))
    b, r = b * np.float32(scale), r * np.float32(scale)
    green = 1 - red - blue
    out = np.empty((*luma.shape, 3), luma.dtype)
    shares = (
        2 * (1 - red) * r,
        -2 * (blue * (1 - blue) * b + red * (1 - red) * r) / green,
        2 * (1 - blue) * b,
    )
    for k, share in enumerate(shares):
        out[..., k] = np.clip(np.rint(light + share), 0, top)
    return out, bits


@lru_cache(maxsize=8)
def _levels(bits: int) -> np.ndarray:
    """The grey level of every stored luminance that leaves room beyond black and white."""
    stored, top = np.arange(1 << (8 if bits <= 8 else 16)), 2**bits - 1
    levels = np.clip(np.rint((stored - (16 << (bits - 8))) * top / (219 << (bits - 8))), 0, top)
    return np.asarray(levels.astype(np.uint8 if bits <= 8 else np.uint16))


def _through(table: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The entry of a table for every value; by OpenCV, five times as fast, where it can do it."""
    if values.dtype != np.uint8:
        return table.take(values)
    import cv2

    return cv2.LUT(values, table)


def _widened(chroma: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """A plane of fewer rows and columns on all pixels, each value on those that it was taken of."""
    down, across = -(-shape[0] // chroma.shape[0]), -(-shape[1] // chroma.shape[1])
    return np.repeat(np.repeat(chroma, down, axis=0), across, axis=1)[: shape[0], : shape[1]]
