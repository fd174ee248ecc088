"""Frames from a TIFF stack, page by page."""

from __future__ import annotations

import logging
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.errors import InputError
from isochrome.frames.source import (
    RawFrame,
    Source,
    check_dtype,
    check_same,
    check_size,
    refusing,
)
from isochrome.output import pixel_mm_of

if TYPE_CHECKING:
    import tifffile

SUFFIXES = (".tif", ".tiff", ".btf", ".tf8")
MINISWHITE, PALETTE, SEPARATED = 0, 3, 5


def open_tiff(path: Path) -> Source:
    """Read the head of a TIFF stack. Returns its Source. Raises InputError."""
    with refusing(path, "not a readable TIFF"), _opened(path) as tif:
        page = _page(tif, 0, path)
        image = _decode(tif, page, 0, path)
        count = _count(tif, path)
        bits = page.bitspersample if image.dtype.kind == "u" else None
        return Source(
            kind="tiff",
            shape=(image.shape[0], image.shape[1]),
            channels=1 if image.ndim == 2 else 3,
            dtype=image.dtype,
            sensor_bits=bits if isinstance(bits, int) else None,
            frames=partial(_frames, path),
            pixel_mm=pixel_mm_of(tif),
            count=count,
        )


def read_single(path: Path, *, inverted_too: bool = False) -> np.ndarray:
    """The one page of a TIFF, such as a folder of images holds.

    Parameters: `path`; `inverted_too`, to take ImageJ's images that are shown inverted, as its
    masks are, by their stored values. Raises InputError where it holds more pages or is not read.
    """
    with refusing(path, "not a readable TIFF"), _opened(path) as tif:
        count = _count(tif, path)
        if count != 1:
            raise InputError(
                f"{path}: holds {count} pages, and a folder of images one a file; give the stack "
                "by itself"
            )
        page: Any = _page(tif, 0, path)
        if inverted_too and tif.is_imagej and page.photometric == MINISWHITE:
            return np.asarray(page.asarray())
        return _decode(tif, page, 0, path)


@contextmanager
def _opened(path: Path) -> Iterator[tifffile.TiffFile]:
    import tifffile

    logging.getLogger("tifffile").addHandler(logging.NullHandler())  # refusals say it instead
    with tifffile.TiffFile(path) as tif:
        tif.pages.cache = False
        yield tif


def _frames(path: Path) -> Iterator[RawFrame]:
    with refusing(path, "not a readable TIFF"):
        opened = _opened(path)
        tif = opened.__enter__()
    try:
        with refusing(path, "not a readable TIFF"):
            count, pages = _count(tif, path), _indices(tif)
            interval = _interval(tif)
        shape: tuple[int, int] | None = None
        for index in range(count):
            with refusing(path, f"frame {index} cannot be read"):
                if len(pages) == count:
                    image = _decode(tif, _page(tif, pages[index], path), pages[index], path)
                else:
                    image = _hidden(tif, index)
                shape = shape or (image.shape[0], image.shape[1])
                check_same(path, image, shape, f"frame {index}")
            time = None if interval is None else index * interval
            yield RawFrame(image, time, f"{path.name}[{index}]")
    finally:
        opened.__exit__(None, None, None)


def _page(tif: tifffile.TiffFile, index: int, path: Path) -> tifffile.TiffPage:
    page: Any = tif.pages[index]
    check_size(path, page.imagelength, page.imagewidth)
    parts = zip(page.dataoffsets, page.databytecounts, strict=False)
    end = max((offset + size for offset, size in parts), default=0)
    if end > tif.filehandle.size:
        raise InputError(
            f"{path}: frame {index} ends at byte {end} and the file at {tif.filehandle.size}: it "
            "is truncated; copy it again from its source"
        )
    return page


def _indices(tif: tifffile.TiffFile) -> list[int]:
    """Pages that are frames: not the thumbnails and reduced copies that some programs add."""
    pages: Any = tif.pages
    return [i for i in range(len(pages)) if i == 0 or not pages[i].is_reduced]


def _count(tif: tifffile.TiffFile, path: Path) -> int:
    """Number of frames, after a look whether the file breaks off."""
    found, meta = _indices(tif), tif.imagej_metadata or {}
    claimed = int(meta.get("images", len(found))) if tif.is_imagej else len(found)
    page: Any = tif.pages[0]
    plain = page.axes == "YX" and page.is_contiguous and page.compression == 1
    one_head = len(found) == 1 < claimed and plain
    if one_head and page.dataoffsets[0] + claimed * page.nbytes <= tif.filehandle.size:
        return claimed  # ImageJ's layout for large stacks: one head, all frames behind it
    if claimed > len(found) or _chain_breaks(tif):
        raise InputError(
            f"{path}: breaks off after {len(found)} frames: it is truncated; copy it again from "
            "its source"
        )
    if int(meta.get("channels", 1)) > 1:
        raise InputError(
            f"{path}: holds {meta['channels']} colour channels as separate pages; in ImageJ "
            "choose Image > Color > Split Channels, and save the one wanted"
        )
    return len(found)


def _chain_breaks(tif: tifffile.TiffFile) -> bool:
    """Whether the last page names a next one that is not there."""
    file, form = tif.filehandle, tif.tiff
    last: Any = tif.pages[len(tif.pages) - 1]
    file.seek(last.offset)
    tags = struct.unpack(form.tagnoformat, file.read(form.tagnosize))[0]
    file.seek(last.offset + form.tagnosize + tags * form.tagsize)
    return struct.unpack(form.offsetformat, file.read(form.offsetsize))[0] != 0


def _interval(tif: tifffile.TiffFile) -> float | None:
    meta = tif.imagej_metadata or {}
    step = meta.get("finterval", 0)
    seconds = str(meta.get("tunit", "s")).lower() in ("s", "sec", "second", "seconds")
    return float(step) if seconds and isinstance(step, int | float) and step > 0 else None


def _hidden(tif: tifffile.TiffFile, index: int) -> np.ndarray:
    page: Any = tif.pages[0]
    tif.filehandle.seek(page.dataoffsets[0] + index * page.nbytes)
    data = tif.filehandle.read(page.nbytes)
    raw = np.frombuffer(data, page.dtype.newbyteorder(tif.byteorder)).reshape(page.shape)
    return raw.astype(page.dtype.newbyteorder("="))


def _decode(tif: tifffile.TiffFile, page: Any, index: int, path: Path) -> np.ndarray:
    if page.photometric in (MINISWHITE, SEPARATED):
        raise InputError(
            f"{path}: frame {index} is stored as {page.photometric.name}, not as black-is-zero "
            "grey or RGB; convert it and save it again"
        )
    try:
        raw = page.asarray()
    except ValueError as error:
        if "imagecodecs" not in str(error):
            raise
        raw = _by_pillow(page, index, path)
    if page.photometric == PALETTE and not tif.is_imagej and page.colormap is not None:
        raw = (page.colormap >> 8).astype(np.uint8)[:, raw].transpose(1, 2, 0)
    elif page.axes == "SYX":
        raw = np.moveaxis(raw, 0, -1)
    elif page.axes not in ("YX", "YXS"):
        raise InputError(f"{path}: frame {index} has axes {page.axes}; save it as a plain stack")
    if raw.ndim == 3:
        raw = raw[..., 0] if raw.shape[2] < 3 else raw[..., :3]
    return np.ascontiguousarray(raw, dtype=check_dtype(path, raw.dtype))


def _by_pillow(page: Any, index: int, path: Path) -> np.ndarray:
    """Decode a compression (LZW, JPEG) that tifffile leaves to an optional package."""
    from PIL import Image

    with Image.open(os.fspath(path)) as file:
        file.seek(index)
        raw = np.asarray(file)
    if raw.dtype.itemsize != page.dtype.itemsize or raw.shape != page.shape:
        raise InputError(
            f"{path}: frame {index} is compressed by {page.compression.name}, which is not read "
            f"for {page.dtype} pixels; save it without compression"
        )
    return raw
