"""Frames from a TIFF stack, page by page."""

from __future__ import annotations

import logging
from collections.abc import Generator, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.errors import InputError
from isochrome.frames.readers.tiff_layout import TiffLayout, tiff_layout_of
from isochrome.frames.readers.tiff_page import PageDecoder
from isochrome.frames.source import Extent, RawFrame, Source, Stamp, StoredForm, refusing

if TYPE_CHECKING:
    import tifffile

SUFFIXES = (".tif", ".tiff", ".btf", ".tf8", ".tf2")


def open_tiff(path: Path) -> Source:
    """Read the heads of a TIFF stack's pages; InputError where it is no TIFF that can be read."""
    stamp = Stamp.of(path)
    with refusing(path, "not a readable TIFF"), _opened(path) as tif:
        layout = tiff_layout_of(tif, path)
        with closing(PageDecoder(tif, path)) as decoder:
            image = decoder.frame(layout, 0)
        bits = layout.notes.significant_bits or decoder.bits if image.dtype.kind == "u" else None
    form = StoredForm.of(image)
    return Source(
        kind="tiff",
        form=form,
        sensor_bits=bits,
        frames=partial(_frames, path, stamp, layout, form),
        extent=partial(Extent, layout.count, layout.end_s),
        files=(path,),
        pixel_mm=layout.notes.pixel_mm,
        start_s=layout.notes.start_s,
    )


def holds_several(path: Path) -> bool:
    """Whether a TIFF holds more than one frame; its pages are not counted for it.

    Parameters: `path`. Raises InputError where it does not tell.
    """
    Stamp.of(path)
    with refusing(path, "not a readable TIFF"), _opened(path) as tif:
        with suppress(IndexError):
            second: Any = tif.pages[1]
            if not second.is_reduced:  # a thumbnail
                return True
        return tiff_layout_of(tif, path).count > 1


def read_single(path: Path, *, inverted_too: bool = False) -> np.ndarray:
    """The one page of a TIFF, such as a folder of images holds.

    Parameters: `path`; `inverted_too`, to take ImageJ's images that are shown inverted, as its
    masks are, by their stored values. Raises InputError where it holds more pages or is not read.
    """
    Stamp.of(path)
    with refusing(path, "not a readable TIFF"), _opened(path) as tif:
        layout = tiff_layout_of(tif, path)
        if layout.count != 1:
            raise InputError(
                f"{path}: holds {layout.count} pages, and one a file is wanted here; give one "
                "image a file, or the stack by itself"
            )
        with closing(PageDecoder(tif, path, inverted_too=inverted_too)) as decoder:
            return decoder.frame(layout, 0)


@contextmanager
def _opened(path: Path) -> Iterator[tifffile.TiffFile]:
    import tifffile

    log = logging.getLogger("tifffile")  # what it would say, refusals say instead
    if not any(isinstance(h, logging.NullHandler) for h in log.handlers):
        log.addHandler(logging.NullHandler())
    with tifffile.TiffFile(path) as tif:
        tif.pages.cache = False
        yield tif


def _frames(
    path: Path, stamp: Stamp, layout: TiffLayout, form: StoredForm, start: int
) -> Generator[RawFrame]:
    """The frames from number `start` on; each page is found at once by its place in the file."""
    stamp.check(path)
    with ExitStack() as opened:
        with refusing(path, "not a readable TIFF"):
            tif = opened.enter_context(_opened(path))
        decoder = opened.enter_context(closing(PageDecoder(tif, path)))
        for index in range(start, layout.count):
            with refusing(path, f"frame {index} cannot be read"):
                image = decoder.frame(layout, index)
                form.check(path, image, f"frame {index}")
            yield RawFrame(image, layout.time_s(index), f"{path.name}[{index}]")
        stamp.check(path)
