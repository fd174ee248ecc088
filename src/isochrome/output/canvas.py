"""A TIFF stack of known size whose frames may be written in any order."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from isochrome.output.tiff import IMAGEJ_LIMIT

_TYPE = np.dtype("<f4")


@dataclass(frozen=True)
class TiffCanvas:
    """A float32 stack on disk: its frames lie behind each other from byte `offset` on.

    `path`; `shape` (frames, rows, cols). It holds no open file, so that other processes may write
    to it at the same time; a frame that nobody wrote reads as zeros.
    """

    path: Path
    shape: tuple[int, int, int]
    offset: int

    def write(self, start: int, frames: bytes | memoryview) -> None:
        """Write whole frames, little-endian float32, from frame `start` on, through to the disk.

        Raises OSError.
        """
        import os

        with open(self.path, "r+b") as file:
            file.seek(self.offset + start * self._frame_bytes)
            file.write(frames)
            file.flush()
            os.fsync(file.fileno())

    def read(self, start: int, count: int) -> bytes:
        """The bytes of `count` frames from frame `start` on. Raises OSError."""
        with open(self.path, "rb") as file:
            file.seek(self.offset + start * self._frame_bytes)
            return file.read(count * self._frame_bytes)

    @property
    def _frame_bytes(self) -> int:
        return self.shape[1] * self.shape[2] * _TYPE.itemsize


def make_canvas(path: Path, shape: tuple[int, int, int], pixel_mm: float | None) -> TiffCanvas:
    """Lay out a stack: its head, and room for all frames behind it, which takes no disk yet.

    Up to 4 GB in ImageJ's layout with its scale; beyond, as a BigTIFF, whose scale is in pixels
    per centimetre. Parameters: `path`; `shape` (frames, rows, cols); `pixel_mm`, the pixel's side
    (mm), None where it is not known. Returns a TiffCanvas. Raises OSError.
    """
    import tifffile

    size = int(np.prod(shape, dtype=np.int64)) * _TYPE.itemsize
    imagej = size < IMAGEJ_LIMIT and min(shape[1:]) > 1  # tifffile turns single columns over
    keys: dict[str, object] = {"photometric": "minisblack", "metadata": None}
    if imagej:
        keys["metadata"] = {"axes": "TYX"} | ({"unit": "mm"} if pixel_mm is not None else {})
    if pixel_mm is not None:
        per_unit = 1 / pixel_mm if imagej else 10 / pixel_mm
        keys["resolution"] = (per_unit, per_unit)
        keys |= {} if imagej else {"resolutionunit": "CENTIMETER"}
    with tifffile.TiffWriter(
        path, imagej=imagej, bigtiff=size >= IMAGEJ_LIMIT, byteorder="<"
    ) as tif:
        tif.write(None, shape=shape, dtype=_TYPE, **keys)  # type: ignore[arg-type]
    return open_canvas(path, shape)


def open_canvas(path: Path, shape: tuple[int, int, int]) -> TiffCanvas:
    """A stack that `make_canvas` laid out.

    Parameters: `path`; `shape` (frames, rows, cols). Returns a TiffCanvas. Raises OSError.
    """
    import tifffile

    with tifffile.TiffFile(path) as tif:
        page = tif.pages[0]
        return TiffCanvas(path, shape, int(page.dataoffsets[0]))
