"""Where a TIFF keeps its frames, when they were taken, and how large their pixels are."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isochrome.errors import InputError
from isochrome.frames.readers.ome import FileNotes, read_ome
from isochrome.frames.source import next_time
from isochrome.output import pixel_mm_of

if TYPE_CHECKING:
    import tifffile

SQUARE = 1e-3
"""A pixel whose sides differ by more than this part is not square."""

OTHERS = ("stk", "lsm", "fluoview", "nih", "scanimage")
"""Microscope makers' dialects, whose pages are not frames one by one."""

MOST_CHANNELS = 7
"""ImageJ's colours end there; writers that know no axes put all frames down as channels."""

SECONDS = {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3,
           "millisecond": 1e-3, "milliseconds": 1e-3, "us": 1e-6, "µs": 1e-6, "usec": 1e-6,
           "microsecond": 1e-6, "microseconds": 1e-6, "min": 60.0, "minute": 60.0,
           "minutes": 60.0, "h": 3600.0, "hour": 3600.0, "hours": 3600.0}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class TiffLayout:
    """The frames of a TIFF: `pages`, each one's number in the file and the byte of its head.

    Where `hidden`, all frames lie one behind the other after the first page's, without heads.
    `notes`, times and scale.
    """

    count: int
    pages: tuple[tuple[int, int], ...]
    hidden: bool = False
    notes: FileNotes

    def time_s(self, index: int) -> float | None:
        """Time of a frame since the first (s), None where the file does not tell it."""
        times, interval = self.notes.times_s, self.notes.interval_s
        if times is not None:
            return times[index]
        return None if interval is None else index * interval

    @property
    def end_s(self) -> float | None:
        """When one more frame would have come (s)."""
        if self.notes.times_s is None:
            return self.time_s(self.count)
        return next_time(*self.notes.times_s[-2:]) if self.count > 1 else None


def tiff_layout_of(tif: tifffile.TiffFile, path: Path) -> TiffLayout:
    """Find the frames of an open TIFF, after a look whether it breaks off. Raises InputError."""
    other = [name for name in OTHERS if getattr(tif, f"is_{name}", False)]
    if other:
        raise InputError(
            f"{path}: is a microscope's own kind of TIFF ({other[0]}), whose frames are not read; "
            "open it in ImageJ and save it as a TIFF stack"
        )
    if len(tif.pages) == 0:
        raise InputError(f"{path}: not a readable TIFF (it holds no page); copy it again")
    _check_square(tif, path)
    if tif.is_ome:
        return _of_ome(tif, path)
    pages = _frame_pages(tif)
    claimed = _claimed(tif, len(pages))
    hidden = len(pages) == 1 < claimed and _fit_behind(tif, claimed)
    if not hidden and (claimed > len(pages) or _chain_breaks(tif)):
        raise InputError(
            f"{path}: breaks off after {len(pages)} frames: it is truncated; copy it again from "
            "its source"
        )
    meta = (tif.imagej_metadata or {}) if tif.is_imagej else {}
    _check_axes(path, _whole(meta, "channels"), _whole(meta, "slices"), _whole(meta, "frames"))
    interval = _interval(meta)
    return TiffLayout(
        count=claimed if hidden else len(pages),
        pages=pages,
        hidden=hidden,
        notes=FileNotes(
            interval_s=interval,
            start_s=None if interval is None else 0.0,
            pixel_mm=pixel_mm_of(tif),
        ),
    )


def _frame_pages(tif: tifffile.TiffFile) -> tuple[tuple[int, int], ...]:
    """Pages that are frames: not the thumbnails and reduced copies that some programs add."""
    pages: Any = tif.pages
    numbered = ((i, pages[i]) for i in range(len(pages)))
    return tuple((i, page.offset) for i, page in numbered if i == 0 or not page.is_reduced)


def _claimed(tif: tifffile.TiffFile, found: int) -> int:
    """Number of frames by the notes of ImageJ or tifffile, which may leave out their heads."""
    if tif.is_imagej:
        return _whole(tif.imagej_metadata or {}, "images", found)
    if tif.is_shaped and found == 1:
        page: Any = tif.pages[0]
        shape = (tif.shaped_metadata or ({},))[0].get("shape", page.shape)
        return max(math.prod(map(int, shape)) // max(int(page.size), 1), 1)
    return found


def _whole(meta: dict[str, Any], key: str, default: int = 1) -> int:
    value = meta.get(key, default)
    return value if isinstance(value, int) and value > 0 else default


def _fit_behind(tif: tifffile.TiffFile, claimed: int) -> bool:
    """Whether that many frames have room behind the only head: ImageJ's layout of large stacks."""
    page: Any = tif.pages[0]
    plain = page.axes == "YX" and page.is_contiguous and page.compression == 1
    result: bool = plain and page.dataoffsets[0] + claimed * page.nbytes <= tif.filehandle.size
    return result


def _chain_breaks(tif: tifffile.TiffFile) -> bool:
    """Whether the last page names a next one that is not there."""
    file, form = tif.filehandle, tif.tiff
    last: Any = tif.pages[len(tif.pages) - 1]
    file.seek(last.offset)
    tags = struct.unpack(form.tagnoformat, file.read(form.tagnosize))[0]
    file.seek(last.offset + form.tagnosize + tags * form.tagsize)
    result: bool = struct.unpack(form.offsetformat, file.read(form.offsetsize))[0] != 0
    return result


def _check_axes(path: Path, channels: int, slices: int, times: int) -> None:
    """Refuse stacks whose pages are not one after the other in time, or in one other direction."""
    if 1 < channels <= MOST_CHANNELS or (channels > 1 and slices * times > 1):
        raise InputError(
            f"{path}: holds {channels} colour channels as separate pages; in ImageJ choose Image "
            "> Color > Split Channels, and save the one wanted"
        )
    if slices > 1 and times > 1:
        raise InputError(
            f"{path}: holds {slices} slices at each of {times} times; in ImageJ choose Image > "
            "Hyperstacks > Make Subset, and save the one slice wanted"
        )


def _check_square(tif: tifffile.TiffFile, path: Path) -> None:
    """Refuse a file that says its pixels are not square, as all lengths would be wrong."""
    page: Any = tif.pages[0]
    if "XResolution" not in page.tags or "YResolution" not in page.tags:
        return
    (xn, xd), (yn, yd) = page.tags["XResolution"].value, page.tags["YResolution"].value
    if 0 in (xn, xd, yn, yd) or abs(xn * yd / (xd * yn) - 1) <= SQUARE:
        return
    raise InputError(
        f"{path}: says {xn / xd:g} pixels a unit across and {yn / yd:g} down; frames must have "
        "square pixels: correct its scale (ImageJ: Image > Properties), or resample it"
    )


def _interval(meta: dict[str, Any]) -> float | None:
    """Seconds between the frames of an ImageJ stack."""
    step, unit = meta.get("finterval", 0), SECONDS.get(str(meta.get("tunit", "s")).lower())
    if unit is None or not isinstance(step, int | float) or not 0 < step < float("inf"):
        return None
    return float(step) * unit


def _of_ome(tif: tifffile.TiffFile, path: Path) -> TiffLayout:
    """The frames in the order that the OME notes give them, whatever that of the pages."""
    ome = read_ome(tif.ome_metadata or "", path)
    _check_axes(path, ome.channels, ome.slices, ome.times)
    if ome.count > len(tif.pages):  # before a list of that length is made
        raise _incomplete(path, ome.count, len(tif.pages))
    if len(tif.series) != 1:
        raise InputError(
            f"{path}: holds {len(tif.series)} image series; save the one wanted by itself"
        )
    pages: list[Any] = list(tif.series[0].pages)
    if None in pages or len(pages) != ome.count:
        raise _incomplete(path, ome.count, sum(page is not None for page in pages))
    if _chain_breaks(tif):
        raise InputError(f"{path}: breaks off, it is truncated; copy it again from its source")
    return TiffLayout(
        count=len(pages),
        pages=tuple((page.index, page.offset) for page in pages),
        notes=replace(ome, pixel_mm=ome.pixel_mm or pixel_mm_of(tif)),
    )


def _incomplete(path: Path, named: int, there: int) -> InputError:
    return InputError(
        f"{path}: its OME notes name {named} frames and {there} are in it; is it one of several "
        "files, or truncated? copy it again, or save it as one file"
    )
