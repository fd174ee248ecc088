"""A TIFF stack of known size whose frames may be written in any order."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from isochrome.output.tiff_stack import blank_stack

_TYPE = np.dtype("<f4")


@dataclass(frozen=True)
class TiffCanvas:
    """A float32 stack on disk: its frames lie behind each other from byte `offset` on.

    It holds no open file, so that other processes may write to it at the same time; a frame that
    nobody wrote reads as zeros.

    Parameters
    ----------
    path : Path
        The file.
    shape : tuple of int
        Frames, rows, cols.
    offset : int
        First byte of the first frame.
    """

    path: Path
    shape: tuple[int, int, int]
    offset: int

    def write(self, start: int, frames: Iterable[bytes | memoryview]) -> None:
        """Write whole frames, little-endian float32, from frame `start` on, through to the disk.

        Each piece is one frame or some. Raises OSError.
        """
        with open(self.path, "r+b") as file:
            file.seek(self.offset + start * self._frame_bytes)
            for piece in frames:
                file.write(piece)
            file.flush()
            os.fsync(file.fileno())

    def read(self, start: int, count: int) -> bytes:
        """The bytes of `count` frames from frame `start` on. Raises OSError."""
        with open(self.path, "rb") as file:
            file.seek(self.offset + start * self._frame_bytes)
            return file.read(count * self._frame_bytes)

    def checksum(self, start: int, count: int) -> int:
        """The CRC-32 of `count` frames from frame `start` on, read one by one. Raises OSError."""
        found = 0
        with open(self.path, "rb") as file:
            file.seek(self.offset + start * self._frame_bytes)
            for _ in range(count):
                found = zlib.crc32(file.read(self._frame_bytes), found)
        return found

    @property
    def _frame_bytes(self) -> int:
        return self.shape[1] * self.shape[2] * _TYPE.itemsize


def make_canvas(path: Path, shape: tuple[int, int, int], pixel_mm: float | None) -> TiffCanvas:
    """Lay out a stack: its head, and room for all frames behind it, which takes no disk yet.

    Parameters
    ----------
    path : Path
        The file to make.
    shape : tuple of int
        Frames, rows, cols.
    pixel_mm : float or None
        The pixel's side, mm; None where it is not known.

    Returns
    -------
    TiffCanvas
        The stack, to be written to.

    Raises
    ------
    OSError
        Where the file cannot be written.
    """
    blank_stack(path, shape, pixel_mm)
    return open_canvas(path, shape)


def open_canvas(path: Path, shape: tuple[int, int, int]) -> TiffCanvas:
    """Open a stack that `make_canvas` laid out.

    Parameters
    ----------
    path : Path
        The file.
    shape : tuple of int
        Frames, rows, cols.

    Returns
    -------
    TiffCanvas
        The stack, to be read and written.

    Raises
    ------
    OSError
        Where the file cannot be read.
    """
    import tifffile

    with tifffile.TiffFile(path) as tif:
        page = tif.pages[0]
        return TiffCanvas(path, shape, int(page.dataoffsets[0]))
