"""One page of a TIFF as pixels, by its own grey levels, in memory that its head has told."""

from __future__ import annotations

import os
import threading
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.errors import InputError
from isochrome.frames.readers.tiff_layout import TiffLayout
from isochrome.frames.source import MAX_BYTES, check_dtype, check_size

if TYPE_CHECKING:
    import tifffile

MINISWHITE, PALETTE, SEPARATED = 0, 3, 5
SEPARATE = 2
"""Each colour's values by themselves, as the head says it (tag 284)."""
NONE, DEFLATE = 1, (8, 32946)
DEFLATE_RATIO = 1032
"""The most bytes that deflate makes of one (RFC 1951: 258 bytes from two bits)."""
PACKED = (10, 12, 14)
"""Bits a pixel that cameras write one behind the other, without filling up to 16."""


class PageDecoder:
    """Decodes the pages of one open TIFF, whichever is asked for."""

    def __init__(self, tif: tifffile.TiffFile, path: Path, *, inverted_too: bool = False) -> None:
        """Parameters: `tif`; `path`; `inverted_too`, to take ImageJ's inverted images as stored."""
        self._tif, self._path, self._inverted_too = tif, path, inverted_too
        self._pillow: Any = None
        self.bits: int | None = None

    def frame(self, layout: TiffLayout, index: int) -> np.ndarray:
        """Frame number `index`, (row, col) or (row, col, 3); `bits` is then what its head says."""
        page = self._page(layout, 0 if layout.hidden else index, index)
        bits = page.bitspersample
        self.bits = bits if isinstance(bits, int) else None
        if layout.hidden and index > 0:
            return self._hidden(page, index)
        return self._decode(page, layout.pages[index][0], index)

    def close(self) -> None:
        """Close what decoding has opened besides the TIFF itself."""
        if self._pillow is not None:
            self._pillow.close()
            self._pillow = None

    def _page(self, layout: TiffLayout, number: int, index: int) -> Any:
        import tifffile

        place, offset = layout.pages[number]
        self._tif.filehandle.seek(offset)
        page: Any = tifffile.TiffPage(self._tif, index=place)
        depth = max(page.samplesperpixel, 1) * max(page.imagedepth, 1)
        size = depth * (page.dtype.itemsize if page.dtype is not None else 1)
        check_size(self._path, page.imagelength, page.imagewidth, size)
        if page.is_tiled:
            check_size(self._path, page.tilelength, page.tilewidth, size)
        parts = zip(page.dataoffsets, page.databytecounts, strict=False)
        end = max((offset + size for offset, size in parts), default=0)
        if end > self._tif.filehandle.size:
            raise InputError(
                f"{self._path}: frame {index} ends at byte {end} and the file at "
                f"{self._tif.filehandle.size}: it is truncated; copy it again from its source"
            )
        self._check_parts(page, index)
        return page

    def _check_parts(self, page: Any, index: int) -> None:
        """Refuse a page whose strips or tiles are not all there: holes would be read as black."""
        rows, cols, planes = page.imagelength, page.imagewidth, 1
        if page.planarconfig == SEPARATE:
            planes = max(page.samplesperpixel, 1)
        if page.is_tiled:
            wanted = -(-rows // page.tilelength) * -(-cols // page.tilewidth) * planes
        else:
            wanted = -(-rows // max(page.rowsperstrip or rows, 1)) * planes
        held = sum(page.databytecounts)
        bits = int(np.ravel(page.bitspersample)[0]) * max(page.samplesperpixel, 1)
        needed = rows * -(-cols * bits // 8) if page.compression == NONE else wanted
        there = min(len(page.dataoffsets), sum(size > 0 for size in page.databytecounts))
        if there < wanted or held < needed:
            raise InputError(
                f"{self._path}: frame {index} has {there} of {wanted} strips or tiles, {held} "
                f"bytes in all where at least {needed} are needed; its head is wrong or the file "
                "damaged: save it again"
            )

    def _hidden(self, page: Any, index: int) -> np.ndarray:
        """A frame without a head, behind the first."""
        self._tif.filehandle.seek(page.dataoffsets[0] + index * page.nbytes)
        data = self._tif.filehandle.read(page.nbytes)
        raw = np.frombuffer(data, page.dtype.newbyteorder(self._tif.byteorder))
        return np.ascontiguousarray(
            raw.reshape(page.shape), dtype=check_dtype(self._path, page.dtype)
        )

    def _decode(self, page: Any, place: int, index: int) -> np.ndarray:
        path = self._path
        inverted = page.photometric == MINISWHITE
        as_stored = inverted and self._inverted_too and self._tif.is_imagej
        if page.photometric == SEPARATED or (inverted and not as_stored):
            raise InputError(
                f"{path}: frame {index} is stored as {page.photometric.name}, not as "
                "black-is-zero grey or RGB; convert it and save it again"
            )
        if page.dtype is None:
            raise InputError(
                f"{path}: frame {index} has {page.bitspersample} bits a pixel, which are not read; "
                "save it with 8 or 16"
            )
        check_dtype(path, page.dtype)
        raw = self._pixels(page, place, index)
        if page.photometric == PALETTE and not self._tif.is_imagej and page.colormap is not None:
            raw = (page.colormap >> 8).astype(np.uint8)[:, raw].transpose(1, 2, 0)
        elif page.axes == "SYX":
            raw = np.moveaxis(raw, 0, -1)
        elif page.axes not in ("YX", "YXS"):
            raise InputError(
                f"{path}: frame {index} has axes {page.axes}; save it as a plain stack"
            )
        if raw.ndim == 3:
            raw = raw[..., 0] if raw.shape[2] < 3 else raw[..., :3]
        return np.ascontiguousarray(raw, dtype=check_dtype(path, raw.dtype))

    def _pixels(self, page: Any, place: int, index: int) -> np.ndarray:
        """The page's values as they are stored."""
        deflate = int(page.compression) in DEFLATE
        if deflate:
            self._check_deflate(page, index)
        if page.bitspersample in PACKED:
            return self._packed(page, index)
        if deflate or page.compression == NONE:
            return np.asarray(page.asarray())
        return self._by_pillow(page, place, index)

    def _segments(self, page: Any) -> list[bytes]:
        found = []
        for offset, size in zip(page.dataoffsets, page.databytecounts, strict=True):
            self._tif.filehandle.seek(offset)
            found.append(self._tif.filehandle.read(size))
        return found

    def _check_deflate(self, page: Any, index: int) -> None:
        """Refuse strips that swell beyond what the head says, without taking memory for them."""
        expected = page.imagelength * page.imagewidth * max(page.samplesperpixel, 1)
        if page.is_tiled:
            expected = max(expected, page.tilelength * page.tilewidth * page.samplesperpixel)
        expected *= page.dtype.itemsize
        if sum(page.databytecounts) * DEFLATE_RATIO < MAX_BYTES:  # it cannot do harm
            return
        for data in self._segments(page):
            stream, size = zlib.decompressobj(), 0
            while data and size <= expected:
                size += len(stream.decompress(data, 1_000_000))
                data = stream.unconsumed_tail
            if size > expected:
                raise InputError(
                    f"{self._path}: frame {index} swells to over {expected} bytes, which is all "
                    "that its head claims; the file is damaged: save it again"
                )

    def _packed(self, page: Any, index: int) -> np.ndarray:
        """Values of 10, 12 or 14 bits one behind the other, each row from a new byte on."""
        rows, cols, bits = page.imagelength, page.imagewidth, page.bitspersample
        plain = page.axes == "YX" and not page.is_tiled and page.predictor == 1
        if not plain or int(page.compression) not in (NONE, *DEFLATE) or page.fillorder != 1:
            raise InputError(
                f"{self._path}: frame {index} packs {bits}-bit pixels in a way that is not read; "
                "save it with 16 bits a pixel"
            )
        parts = self._segments(page)
        if int(page.compression) in DEFLATE:
            parts = [zlib.decompress(part) for part in parts]
        width = -(-cols * bits // 8)
        packed = np.frombuffer(b"".join(parts), np.uint8)
        if packed.size < rows * width:
            raise InputError(
                f"{self._path}: frame {index} breaks off after {packed.size} of {rows * width} "
                "bytes; copy it again from its source"
            )
        out, places = np.empty((rows, cols), np.uint16), 2 ** np.arange(bits)[::-1]
        for row, line in enumerate(packed[: rows * width].reshape(rows, width)):
            out[row] = np.unpackbits(line, count=cols * bits).reshape(cols, bits) @ places
        return out

    def _by_pillow(self, page: Any, place: int, index: int) -> np.ndarray:
        """Decode a compression (LZW, PackBits, JPEG) that tifffile leaves to another package."""
        from PIL import Image

        if self._pillow is None:
            self._pillow = Image.open(os.fspath(self._path))
        with silence_stderr():
            self._pillow.seek(place)
            raw = np.asarray(self._pillow)
        if raw.dtype.itemsize != page.dtype.itemsize or raw.shape != page.shape:
            raise InputError(
                f"{self._path}: frame {index} is compressed by {page.compression.name}, which is "
                f"not read for {page.dtype} pixels; save it without compression"
            )
        return raw


STANDARD_ERROR = 2
_TURN = threading.Lock()


@contextmanager
def silence_stderr() -> Iterator[None]:
    """Nothing that C code writes to standard error comes out: libtiff has no other way to say it.

    What it would say, a refusal says. Python's own messages of other threads are held back too:
    the block is to be short.
    """
    with _TURN:
        try:
            kept = os.dup(STANDARD_ERROR)
        except OSError:  # no terminal at all, as under pythonw
            yield
            return
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, STANDARD_ERROR)
            yield
        finally:
            os.dup2(kept, STANDARD_ERROR)
            os.close(kept)
            os.close(nowhere)
