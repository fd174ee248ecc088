"""What the readers of TIFF, image and video files have in common."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from isochrome.errors import InputError

MAX_PIXELS = 200_000_000
"""A frame that claims more pixels is a damaged or hostile file: refused before memory is taken."""

Kind = Literal["tiff", "image", "folder", "list", "video"]


@dataclass(frozen=True)
class RawFrame:
    """One frame as its file holds it: `image` (row, col) or (row, col, 3) in RGB, native type."""

    image: np.ndarray
    time_s: float | None
    name: str


@dataclass(frozen=True)
class Source:
    """What the head of a file tells, and how to read its frames from the first to the last.

    `shape` (rows, cols) of the full frame; `channels` 1 or 3; `sensor_bits` as the file names
    them; `count` where it is certain, `claimed` what an untrustworthy container says. Each call of
    `frames` opens the file anew, so that no two readers share an open one.
    """

    kind: Kind
    shape: tuple[int, int]
    channels: int
    dtype: np.dtype
    sensor_bits: int | None
    frames: Callable[[], Iterator[RawFrame]]
    names: tuple[str, ...] = ()
    pixel_mm: float | None = None
    count: int | None = None
    claimed: int | None = None


@contextmanager
def refusing(path: str | Path, what: str = "cannot be read") -> Iterator[None]:
    """Turn whatever a decoding library raises into one InputError that names the file.

    Parameters: `path`; `what`, the words after it. Warnings of the libraries are silenced.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except InputError:
        raise
    except Exception as error:  # decoders raise nearly everything on a damaged file
        reason = (str(error).splitlines() or [""])[0].strip()[:160] or type(error).__name__
        raise InputError(f"{path}: {what} ({reason}); check the file, or save it again") from error


def check_size(path: str | Path, rows: int, cols: int) -> None:
    """Refuse a frame whose head claims no pixels, or more than `MAX_PIXELS`. Raises InputError."""
    if not 0 < rows * cols <= MAX_PIXELS:
        raise InputError(
            f"{path}: claims a frame of {rows} x {cols} pixels, and 1 to {MAX_PIXELS} pixels are "
            "allowed; is the file damaged? crop it or save it again"
        )


def check_same(path: str | Path, image: np.ndarray, shape: tuple[int, int], what: str) -> None:
    """Refuse a frame whose rows and columns differ from the first one's. Raises InputError."""
    if image.shape[:2] != shape:
        raise InputError(
            f"{path}: {what} is {image.shape[0]} x {image.shape[1]} pixels (rows x columns) and "
            f"the first is {shape[0]} x {shape[1]}; all frames must have one size: remove or crop "
            "the odd one"
        )


def check_dtype(path: str | Path, dtype: np.dtype) -> np.dtype:
    """The pixel type in native byte order; InputError where it is not 8, 16 bit or float."""
    native = dtype.newbyteorder("=")
    if native.name not in ("uint8", "uint16", "float16", "float32", "float64"):
        raise InputError(
            f"{path}: pixels of type {native.name} are not read; save them as 8- or 16-bit "
            "unsigned or as 32-bit float"
        )
    return native


def natural_key(name: str | Path) -> tuple[list[str | int], str]:
    """A sorting key that puts frame2 before frame10: runs of digits count as numbers."""
    text = str(name)
    parts = re.split(r"([0-9]+)", text.lower())
    return [int(p) if i % 2 else p for i, p in enumerate(parts)], text
