"""Image files and TIFF stacks; what a file is by its first bytes, whatever it is called.

Of a TIFF, page by page: where they are, when they were taken, how large a pixel is. Sources: the
formats' own specifications (TIFF 6.0 and BigTIFF, PNG, JPEG, BMP, Netpbm, WebP).
"""

from __future__ import annotations

import io
import logging
import math
import os
import struct
import threading
import zlib
from collections.abc import Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import accumulate, islice
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import numpy as np
import tifffile
from tifffile import COMPRESSION, PHOTOMETRIC

from isochrome.errors import InputError
from isochrome.frames import reading
from isochrome.frames.video import container_of
from isochrome.output import MM_PER_UNIT

SECONDS = {
    word: float(np.array(1, f"m8[{unit}]") / np.timedelta64(1, "s"))
    for unit, words in {
        "s": "s sec second seconds", "ms": "ms msec millisecond milliseconds",
        "us": "µs μs us usec microsecond microseconds", "ns": "ns", "m": "min minute minutes",
        "h": "h hour hours", "D": "d",
    }.items()
    for word in words.split()
}  # fmt: skip
"""Units of time by each of the words that OME's and ImageJ's notes have for them."""


def read_ome(text: str, path: Path) -> tuple[dict[str, Any], tuple[int, int, int]]:
    """What the OME notes of one image in one file tell, for `TiffLayout`, and its sizes in C, Z, T;
    else InputError. Source: OME schema 2016-06, elements Image, Pixels, Channel, TiffData,
    Plane."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:  # entities can grow without bounds
        raise InputError("ome_notes_define_entities", path=path)
    try:
        root = ElementTree.fromstring(text.encode("utf-8"))
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError("ome_notes_no_xml", path=path, error=error) from error
    images = root.findall("{*}Image")
    if len(images) != 1:
        raise InputError("holds_image_series_save", path=path, images_count=len(images))
    uuid = root.get("UUID")
    if any(note.text != uuid for note in images[0].iterfind("{*}Pixels/{*}TiffData/{*}UUID")):
        raise InputError("one_several_files_one", path=path)
    pixels = images[0].find("{*}Pixels")
    if pixels is None:
        raise InputError("ome_notes_describe_no", path=path)
    samples = [_count(c, "SamplesPerPixel", path) for c in pixels.iterfind("{*}Channel")]
    size = {axis: _count(pixels, f"Size{axis}", path) for axis in "ZCT"}
    start, times = _times(pixels, size["Z"] * size["T"])
    interval = None
    if times is None:
        interval = _number(pixels, "TimeIncrement", SECONDS, "TimeIncrementUnit", "s")
    bits = pixels.get("SignificantBits")
    known = bits and bits.isdecimal() and 1 <= int(bits) <= 16
    notes = {
        "pixel_mm": _pixel_mm(pixels, path), "interval_s": interval, "times_s": times,
        "first_s": start, "significant_bits": int(bits) if bits and known else None,
    }  # fmt: skip
    return notes, (max(size["C"] // max(samples, default=1), 1), size["Z"], size["T"])


def _count(element: ElementTree.Element, name: str, path: Path) -> int:
    text = element.get(name, "1")
    if not (text.isascii() and text.isdecimal() and 0 < int(text[:12]) < 10**9):
        raise InputError("ome_notes_say_save", path=path, name=name, text=text[:20])
    return int(text)


def _number(
    element: ElementTree.Element, name: str, units: dict[str, float], unit: str, default: str
) -> float | None:
    """A positive number of the notes, in our unit, or None."""
    factor = units.get(element.get(unit, default))
    try:
        value = float(element.get(name, "nan"))
    except ValueError:
        return None
    return value * factor if factor and math.isfinite(value) and value > 0 else None


def _pixel_mm(pixels: ElementTree.Element, path: Path) -> float | None:
    across, down = (
        _number(pixels, f"PhysicalSize{axis}", MM_PER_UNIT, f"PhysicalSize{axis}Unit", "µm")
        for axis in "XY"
    )
    if across and down and abs(across / down - 1) > reading.SAME:
        raise InputError("says_pixel_mm_wide", path=path, across=across, down=down)
    return across if down else None


def _times(
    pixels: ElementTree.Element, planes: int
) -> tuple[float | None, tuple[float | None, ...] | None]:
    """The first plane's own time (s), and each one's from there, in the order of the frames. Both
    None where not each plane has one; one of them, where it does not come after all before."""
    times: dict[int, float] = {}
    for plane in pixels.iterfind("{*}Plane"):
        factor = SECONDS.get(plane.get("DeltaTUnit", "s"), math.nan)
        try:
            index = int(plane.get("TheT", "0")) + int(plane.get("TheZ", "0"))
            times[index] = factor * float(plane.get("DeltaT", "nan"))
        except ValueError:
            return None, None
    complete = len(times) == planes and set(times) == set(range(planes))
    if not complete or not all(map(math.isfinite, times.values())):
        return None, None
    ordered = [times[i] for i in range(planes)]
    latest = accumulate(ordered, max, initial=-math.inf)
    return times[0], tuple(
        t - times[0] if t > last else None for t, last in zip(ordered, latest, strict=False)
    )


DEFLATE = (COMPRESSION.ADOBE_DEFLATE, COMPRESSION.DEFLATE)
DEFLATE_RATIO = 1032
"""The most bytes that deflate makes of one (RFC 1951: 258 bytes from two bits)."""


class PageDecoder:
    """Decodes the pages of one open TIFF, whichever is asked for."""

    def __init__(self, tif: tifffile.TiffFile, path: Path, *, inverted_too: bool) -> None:
        """`inverted_too`, to take ImageJ's inverted images as stored."""
        self._tif, self._path, self._inverted_too = tif, path, inverted_too
        self._pillow: Any = None
        self.bits: int | None = None

    def frame(self, layout: TiffLayout, index: int) -> np.ndarray:
        """Frame number `index`, (row, col) or (row, col, 3); `bits` is then what its head says."""
        tif, path = self._tif, self._path
        place, offset = layout.pages[0 if layout.hidden else index]
        tif.filehandle.seek(offset)
        page: Any = tifffile.TiffPage(tif, index=place)
        form, bits = page.photometric, page.bitspersample
        self.bits = bits if isinstance(bits, int) else None
        self._check_head(page, index)
        if layout.hidden and index > 0:
            # without a head, behind the first
            tif.filehandle.seek(page.dataoffsets[0] + index * page.nbytes)
            data = tif.filehandle.read(page.nbytes)
            raw = np.frombuffer(data, page.dtype.newbyteorder(tif.byteorder)).reshape(page.shape)
            return reading.as_grey_or_rgb(path, raw)
        as_stored = self._inverted_too and tif.is_imagej
        if form == PHOTOMETRIC.SEPARATED or (form == PHOTOMETRIC.MINISWHITE and not as_stored):
            raise InputError("frame_stored_not_black", path=path, index=index, name=form.name)
        if page.dtype is None:
            raise InputError("frame_has_bits_pixel", path=path, index=index, bitspersample=bits)
        reading.check_dtype(path, page.dtype)
        raw = self._pixels(page, place, index)
        if form == PHOTOMETRIC.PALETTE and not tif.is_imagej and page.colormap is not None:
            raw = (page.colormap >> 8).astype(np.uint8)[:, raw].transpose(1, 2, 0)
        elif page.axes == "SYX":
            raw = np.moveaxis(raw, 0, -1)
        elif page.axes not in ("YX", "YXS"):
            raise InputError("frame_has_axes_save", path=path, index=index, axes=page.axes)
        return reading.as_grey_or_rgb(path, raw)

    def close(self) -> None:
        """Close what decoding has opened besides the TIFF itself."""
        if self._pillow is not None:
            self._pillow.close()

    def _check_head(self, page: Any, index: int) -> None:
        """Refuse a page too large, or whose strips or tiles are not all there, to be read black."""
        path, samples, sizes = self._path, max(page.samplesperpixel, 1), page.databytecounts
        deep = samples * max(page.imagedepth, 1)
        deep *= page.dtype.itemsize if page.dtype is not None else 1
        reading.check_size(path, page.imagelength, page.imagewidth, deep)
        if page.is_tiled:
            reading.check_size(path, page.tilelength, page.tilewidth, deep)
        parts = zip(page.dataoffsets, sizes, strict=False)
        end = max((offset + size for offset, size in parts), default=0)
        if end > self._tif.filehandle.size:
            size = self._tif.filehandle.size
            raise InputError("frame_ends_byte_file", path=path, index=index, end=end, size=size)
        wanted, held = math.prod(page.chunked), sum(sizes)
        row = -(-page.imagewidth * int(np.ravel(page.bitspersample)[0]) * samples // 8)
        needed = page.imagelength * row if page.compression == COMPRESSION.NONE else wanted
        present = min(len(page.dataoffsets), sum(size > 0 for size in sizes))
        if present < wanted or held < needed:
            raise InputError(
                "frame_has_strips_tiles", path=path, index=index, present=present, wanted=wanted,
                held=held, needed=needed,
            )  # fmt: skip

    def _pixels(self, page: Any, place: int, index: int) -> np.ndarray:
        if page.compression in DEFLATE:
            self._check_deflate(page, index)
        if isinstance(page.bitspersample, int) and 8 < page.bitspersample < 16:
            return self._packed(page, index)
        if page.compression in (COMPRESSION.NONE, *DEFLATE):
            return np.asarray(page.asarray())
        return self._by_pillow(page, place, index)

    def _segments(self, page: Any) -> list[bytes]:
        segments = []
        for offset, size in zip(page.dataoffsets, page.databytecounts, strict=True):
            self._tif.filehandle.seek(offset)
            segments.append(self._tif.filehandle.read(size))
        return segments

    def _check_deflate(self, page: Any, index: int) -> None:
        """Refuse strips that swell beyond what the head says, without taking memory for them."""
        expected = page.imagelength * page.imagewidth * max(page.samplesperpixel, 1)
        if page.is_tiled:
            expected = max(expected, page.tilelength * page.tilewidth * page.samplesperpixel)
        expected *= page.dtype.itemsize
        if sum(page.databytecounts) * DEFLATE_RATIO < reading.MAX_BYTES:  # it cannot do harm
            return
        for data in self._segments(page):
            stream, size = zlib.decompressobj(), 0
            while data and size <= expected:
                size += len(stream.decompress(data, 1_000_000))
                data = stream.unconsumed_tail
            if size > expected:
                raise InputError(
                    "frame_swells_over_bytes", path=self._path, index=index, expected=expected
                )

    def _packed(self, page: Any, index: int) -> np.ndarray:
        """Values of 9 to 15 bits one behind the other, each row from a new byte on."""
        rows, cols, bits = page.imagelength, page.imagewidth, page.bitspersample
        plain = page.axes == "YX" and not page.is_tiled and page.predictor == 1
        if not plain or page.compression not in (COMPRESSION.NONE, *DEFLATE) or page.fillorder != 1:
            raise InputError("frame_packs_bit_pixels", path=self._path, index=index, bits=bits)
        parts = self._segments(page)
        if page.compression in DEFLATE:
            parts = [zlib.decompress(part) for part in parts]
        width = -(-cols * bits // 8)
        packed, needed = np.frombuffer(b"".join(parts), np.uint8), rows * width
        if packed.size < needed:
            raise InputError(
                "frame_breaks_off_after", path=self._path, index=index, size=packed.size,
                width=needed,
            )  # fmt: skip
        out, places = np.empty((rows, cols), np.uint16), 2 ** np.arange(bits)[::-1]
        for row, line in enumerate(packed[:needed].reshape(rows, width)):
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
            name = page.compression.name
            raise InputError(
                "frame_compressed_which_not", path=self._path, index=index, name=name,
                dtype=page.dtype,
            )  # fmt: skip
        return raw


STANDARD_ERROR = 2
_TURN = threading.Lock()


@contextmanager
def silence_stderr() -> Iterator[None]:
    """Nothing that C code writes to standard error comes out: libtiff says it no other way.
    Python's own messages of other threads are held back too: the block is to be short."""
    with _TURN:
        try:
            saved = os.dup(STANDARD_ERROR)
        except OSError:  # no terminal at all, as under pythonw
            yield
            return
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, STANDARD_ERROR)
            yield
        finally:
            os.dup2(saved, STANDARD_ERROR)
            os.close(saved)
            os.close(nowhere)


OTHERS = ("stk", "lsm", "fluoview", "nih", "scanimage")
"""Microscope makers' dialects, whose pages are not frames one by one."""

MOST_CHANNELS = 7
"""ImageJ's colours end there; writers that know no axes put all frames down as channels."""


@dataclass(frozen=True, kw_only=True)
class TiffLayout:
    """The frames of a TIFF: `pages`, each one's number and its head's byte; `hidden`, all lie
    behind the first, without heads; `times_s` from the first at `first_s` (None: unknown), or
    `interval_s`."""

    pages: tuple[tuple[int, int], ...]
    hidden: bool = False
    count: int
    pixel_mm: float | None = None
    interval_s: float | None = None
    times_s: tuple[float | None, ...] | None = None
    first_s: float | None = None
    significant_bits: int | None = None


def tiff_layout_of(tif: tifffile.TiffFile, path: Path) -> TiffLayout:
    """Find the frames of an open TIFF, after a look whether it breaks off. Raises InputError."""
    if other := [name for name in OTHERS if getattr(tif, f"is_{name}", False)]:
        raise InputError("microscope_own_kind_tiff", path=path, other=other[0])
    if len(tif.pages) == 0:
        raise InputError("not_readable_tiff_holds", path=path)
    pixel_mm = _pixel_mm_of(tif, path)
    if tif.is_ome:
        return _of_ome(tif, path, pixel_mm)
    pages = _frame_pages(tif)
    meta = (tif.imagej_metadata or {}) if tif.is_imagej else {}
    claimed, hidden = _claimed(tif, meta, len(pages))
    if not hidden and (claimed > len(pages) or _chain_breaks(tif)):
        raise InputError("breaks_off_after_frames", path=path, pages_count=len(pages))
    _check_axes(path, *(_whole(meta, key) for key in ("channels", "slices", "frames")))
    return TiffLayout(
        count=claimed if hidden else len(pages), pages=pages, hidden=hidden, pixel_mm=pixel_mm,
        interval_s=_interval(meta),
    )  # fmt: skip


def _frame_pages(tif: tifffile.TiffFile) -> tuple[tuple[int, int], ...]:
    """Pages that are frames: not the thumbnails and reduced copies that some programs add."""
    numbered: Any = ((i, tif.pages[i]) for i in range(len(tif.pages)))
    return tuple((i, page.offset) for i, page in numbered if i == 0 or not page.is_reduced)


def _interval(meta: dict[str, Any]) -> float | None:
    step, unit = meta.get("finterval"), SECONDS.get(str(meta.get("tunit", "s")).lower())
    interval = step * unit if unit and isinstance(step, int | float) else 0.0
    return interval if 0 < interval < math.inf else None


def _claimed(tif: tifffile.TiffFile, meta: dict[str, Any], counted: int) -> tuple[int, bool]:
    """Frames by ImageJ's or tifffile's notes; whether all lie behind the only head."""
    page: Any = tif.pages[0]
    claimed = _whole(meta, "images", counted)
    if tif.is_shaped and counted == 1 and not tif.is_imagej:
        shape = (tif.shaped_metadata or ({},))[0].get("shape", page.shape)
        claimed = max(math.prod(map(int, shape)) // max(int(page.size), 1), 1)
    plain = page.axes == "YX" and page.is_contiguous and page.compression == COMPRESSION.NONE
    hidden = counted == 1 < claimed and plain
    return claimed, hidden and page.dataoffsets[0] + claimed * page.nbytes <= tif.filehandle.size


def _whole(meta: dict[str, Any], key: str, default: int = 1) -> int:
    value = meta.get(key, default)
    return value if isinstance(value, int) and value > 0 else default


def _chain_breaks(tif: tifffile.TiffFile) -> bool:
    """Whether the last page names a next one that is not there."""
    file, form = tif.filehandle, tif.tiff
    last: Any = tif.pages[len(tif.pages) - 1]
    file.seek(last.offset)
    tags = struct.unpack(form.tagnoformat, file.read(form.tagnosize))[0]
    file.seek(last.offset + form.tagnosize + tags * form.tagsize)
    return bool(struct.unpack(form.offsetformat, file.read(form.offsetsize))[0] != 0)


def _check_axes(path: Path, channels: int, slices: int, times: int) -> None:
    """Refuse stacks whose pages are not one after the other in time, or in one other direction."""
    if 1 < channels <= MOST_CHANNELS or (channels > 1 and slices * times > 1):
        raise InputError("holds_colour_channels_separate", path=path, channels=channels)
    if slices > 1 and times > 1:
        raise InputError("holds_slices_each_times", path=path, slices=slices, times=times)


def _pixel_mm_of(tif: tifffile.TiffFile, path: Path) -> float | None:
    """The pixel's side, mm, that an open TIFF names; dots per inch are a print size, and do not.
    InputError where its pixels are not square, as all lengths would be wrong."""
    tags: Any = getattr(tif.pages[0], "tags", {})
    (xn, xd), (yn, yd) = (
        tags[name].value if name in tags else (0, 0) for name in ("XResolution", "YResolution")
    )
    if 0 not in (xn, xd, yn, yd) and abs(xn * yd / (xd * yn) - 1) > reading.SAME:
        raise InputError("says_pixels_unit_across", path=path, xd=xn / xd, yd=yn / yd)
    if tif.is_imagej:
        mm = MM_PER_UNIT.get(str((tif.imagej_metadata or {}).get("unit", "")).strip().lower())
    else:
        mm = 10.0 if "ResolutionUnit" in tags and int(tags["ResolutionUnit"].value) == 3 else None
    return None if mm is None or 0 in (xn, xd) else mm * xd / xn


def _of_ome(tif: tifffile.TiffFile, path: Path, pixel_mm: float | None) -> TiffLayout:
    """The frames in the order that the OME notes give them, whatever that of the pages."""
    notes, axes = read_ome(tif.ome_metadata or "", path)
    _check_axes(path, *axes)
    named, present = math.prod(axes), len(tif.pages)
    if named > present:  # before a list of that length is made
        raise InputError("ome_notes_name_frames", path=path, named=named, present=present)
    if len(tif.series) != 1:
        raise InputError("holds_image_series_save", path=path, images_count=len(tif.series))
    pages: list[Any] = list(tif.series[0].pages)
    if None in pages or len(pages) != named:
        present = sum(page is not None for page in pages)
        raise InputError("ome_notes_name_frames", path=path, named=named, present=present)
    if _chain_breaks(tif):
        raise InputError("breaks_off_truncated_copy", path=path)
    places = tuple((page.index, page.offset) for page in pages)
    notes["pixel_mm"] = notes["pixel_mm"] or pixel_mm
    return TiffLayout(count=len(pages), pages=places, **notes)


TIFF_SUFFIXES = (".tif", ".tiff", ".btf", ".tf8", ".tf2")


def open_tiff(path: Path) -> reading.Source:
    """Read the heads of a TIFF stack's pages; InputError where it is no TIFF that can be read."""
    stamp = reading.Stamp.of(path)
    with _opened(path) as (tif, decoder):
        layout = tiff_layout_of(tif, path)
        image = decoder.frame(layout, 0)
        bits = layout.significant_bits or decoder.bits if image.dtype.kind == "u" else None
    form, times, interval = reading.StoredForm.of(image), layout.times_s, layout.interval_s
    end = None if interval is None else layout.count * interval
    if times is not None and len(times) > 1:
        end = reading.next_time(*times[-2:])
    return reading.Source(
        kind="tiff", form=form, sensor_bits=bits,
        frames=partial(_pages, path, stamp, layout, form),
        extent=partial(reading.Extent, layout.count, end), files=(path,), pixel_mm=layout.pixel_mm,
        start_s=layout.first_s if interval is None else 0.0,
    )  # fmt: skip


def holds_several(path: Path) -> bool:
    """Whether a TIFF holds more than one frame; its pages are not counted for it."""
    reading.Stamp.of(path)
    with _opened(path) as (tif, _):
        pages: Any = islice(tif.pages, 1, 2)
        # a second one may be a thumbnail
        return any(not page.is_reduced for page in pages) or tiff_layout_of(tif, path).count > 1


def read_single(path: Path, *, inverted_too: bool = False) -> np.ndarray:
    """The one page of a TIFF; `inverted_too`: ImageJ's inverted images too, as they are stored."""
    reading.Stamp.of(path)
    with _opened(path, inverted_too=inverted_too) as (tif, decoder):
        layout = tiff_layout_of(tif, path)
        if layout.count != 1:
            raise InputError("holds_pages_one_file", path=path, count=layout.count)
        return decoder.frame(layout, 0)


@contextmanager
def _opened(
    path: Path, *, inverted_too: bool = False
) -> Iterator[tuple[tifffile.TiffFile, PageDecoder]]:
    log = logging.getLogger("tifffile")  # what it would say, refusals say instead
    if not any(isinstance(h, logging.NullHandler) for h in log.handlers):
        log.addHandler(logging.NullHandler())
    with reading.refusing(path, "not a readable TIFF"), tifffile.TiffFile(path) as tif:
        tif.pages.cache = False
        with closing(PageDecoder(tif, path, inverted_too=inverted_too)) as decoder:
            yield tif, decoder


def _pages(
    path: Path, stamp: reading.Stamp, layout: TiffLayout, form: reading.StoredForm, start: int
) -> Generator[reading.Frame]:
    """The frames from number `start` on; each page is found at once by its place in the file."""
    stamp.check(path)
    times, interval = layout.times_s, layout.interval_s
    with _opened(path) as (_, decoder):
        for index in range(start, layout.count):
            with reading.refusing(path, f"frame {index} cannot be read"):
                image = decoder.frame(layout, index)
                form.check(path, image, f"frame {index}")
            time = None if interval is None else index * interval
            yield reading.Frame(
                index, image, times[index] if times else time, f"{path.name}[{index}]"
            )
    stamp.check(path)


FileKind = Literal["tiff", "image", "video"]

_HEAD = 512
_TIFF = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
_OTHERS = {
    b"\x89PNG": "a PNG that was changed on its way, as by a transfer as text",
    b"GIF8": "a GIF", b"%PDF": "a PDF document", b"SIMPLE": "FITS data", b"\x89HDF": "HDF5 data",
    b"PK\x03\x04": "a ZIP archive or an office document", b"\x1f\x8b": "a gzip archive",
    b"7z\xbc\xaf": "a 7-Zip archive", b"8BPS": "a Photoshop document", b"MZ": "a program",
    b"\x00\x00\x00\x0cjP": "JPEG 2000", b"\xff\x4f\xff\x51": "JPEG 2000", b"{": "JSON",
    b"\x93NUMPY": "a NumPy array", b"MATLAB": "MATLAB data", b"<": "a web page or XML",
}  # fmt: skip
_PHOTOGRAPHS = (b"heic", b"heix", b"hevc", b"mif1", b"msf1", b"avif")


@dataclass(frozen=True)
class Signature:
    """A file's `kind`, which says who reads it, and the `name` of its format."""

    kind: FileKind
    name: str


def signature_of(path: Path) -> Signature:
    """Tell what a file is by its first bytes; InputError where it is nothing that is read."""
    reading.Stamp.of(path)
    try:
        with open(path, "rb") as file:
            head = file.read(_HEAD)
            container = container_of(file)
    except OSError as error:
        raise InputError("cannot_read_check_name", path=path, strerror=error.strerror) from error
    if head.startswith(_TIFF):
        return Signature("tiff", "TIFF")
    if container is not None and head[8:12] not in _PHOTOGRAPHS:
        return Signature("video", container)
    from PIL import Image

    Image.init()
    accepts: Any = {name: Image.OPEN[name][1] for name in FORMATS}
    start = head[:16].ljust(16, b"\0")  # which Pillow takes for granted
    name = next((name for name in FORMATS if accepts[name](start)), None)
    # of Netpbm Pillow takes any text that begins so
    if name is None or (name == "PPM" and not (head[2:3].isspace() or head[2:3] == b"#")):
        raise InputError("not_image_video_kind", path=path, seems=_seems(head))
    return Signature("image", {"PPM": "Netpbm", "WEBP": "WebP"}.get(name, name))


def _seems(head: bytes) -> str:
    known = next((name for start, name in _OTHERS.items() if head.startswith(start)), None)
    if known is not None:
        return known
    if head[8:12] in _PHOTOGRAPHS:
        return "a HEIF or AVIF photograph"
    if head[128:132] == b"DICM":
        return "DICOM data"
    if not any(head):
        return "nothing but zeros"
    text = head.decode("utf-8", "ignore")
    if all(c.isprintable() or c.isspace() for c in text) and len(text) > 0.9 * len(head):
        return f"a text that begins '{text.split(maxsplit=1)[0][:20] if text.split() else ''}'"
    return f"data of no known kind (first bytes {head[:8].hex(' ')})"


SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".dib", ".pgm", ".ppm", ".pnm", ".webp")
FORMATS = ("PNG", "JPEG", "BMP", "DIB", "PPM", "WEBP")
"""Pillow's names of what is read, whatever a file is called."""

PNG_END = b"IEND\xaeB`\x82"


def open_images(paths: tuple[Path, ...], kind: reading.Kind) -> reading.Source:
    """Read the first of some image files of one size."""
    first = paths[0]
    form = reading.StoredForm.of(read_image(first))
    head = open_tiff(first) if signature_of(first).kind == "tiff" else None
    bits, pixel_mm = (head.sensor_bits, head.pixel_mm) if head else (None, None)
    return reading.Source(
        kind=kind, form=form, sensor_bits=bits, frames=partial(_frames, paths, form),
        extent=partial(reading.Extent, len(paths)), files=paths,
        names=tuple(p.name for p in paths), pixel_mm=pixel_mm,
    )  # fmt: skip


def _frames(
    paths: tuple[Path, ...], form: reading.StoredForm, start: int
) -> Generator[reading.Frame]:
    for index, path in enumerate(paths[start:], start):
        image = read_image(path)
        form.check(path, image, "the image")
        yield reading.Frame(index, image, None, path.name)


def read_image(path: Path) -> np.ndarray:
    """An image file's pixels (row, col) or (row, col, 3) in RGB, uint8, uint16 or float, without
    transparency or palette, where the sensor had them: a camera's orientation mark is ignored."""
    kind = signature_of(path).kind
    if kind == "tiff":
        return read_single(path)
    if kind == "video":
        raise InputError("video_image_wanted_here", path=path)
    if reading.Stamp.of(path).size > 2 * reading.MAX_BYTES:
        raise InputError("larger_bytes_one_image", path=path, max_bytes=2 * reading.MAX_BYTES)
    with reading.refusing(path, "not a readable image"):
        data = path.read_bytes()
        from PIL import Image, UnidentifiedImageError

        try:
            with Image.open(io.BytesIO(data), formats=FORMATS) as file:
                # a telephone's JPEG with copies behind it, MPO, is read as the picture itself
                count = 1 if file.format == "MPO" else getattr(file, "n_frames", 1)
                if count != 1:
                    raise InputError("holds_pictures_one_file", path=path, count=count)
                # Pillow makes 16-bit colour 8 bits and stretches PGM values: OpenCV does neither.
                deep = file.format == "PNG" and data[24:25] == b"\x10"
                channel = 2 if deep or "16" in file.mode else 4 if file.mode in ("I", "F") else 1
                reading.check_size(path, file.height, file.width, channel * len(file.getbands()))
                if deep:
                    file.verify()  # checksums to the end: OpenCV would decode a part in silence
                if deep or file.format == "PPM":
                    raw = _by_opencv(path, data)
                else:
                    raw = _by_pillow(path, file)
        except UnidentifiedImageError as error:
            raise InputError("not_image_whatever_name", path=path) from error
    return reading.as_grey_or_rgb(path, raw)


def _by_pillow(path: Path, file: Any) -> np.ndarray:
    mode = file.mode
    if mode in ("1", "P", "PA"):
        file = file.convert("L" if mode == "1" else "RGB")
    elif mode not in ("L", "LA", "RGB", "RGBA", "RGBX", "F") and not mode.startswith("I;16"):
        raise InputError("colours_mode_not_read", path=path, mode=mode)
    return np.asarray(file)


def _by_opencv(path: Path, data: bytes) -> np.ndarray:
    if data.startswith(b"\x89PNG") and PNG_END not in data:
        raise InputError("image_breaks_off_copy", path=path)
    import cv2

    if "OPENCV_LOG_LEVEL" not in os.environ:  # else it tells standard error of damaged images
        if hasattr(cv2, "setLogLevel"):  # until version 5
            cv2.setLogLevel(0)
        else:
            cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    raw = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if raw is None:
        raise InputError("image_breaks_off_damaged", path=path)
    return np.asarray(raw[..., 2::-1] if raw.ndim == 3 and raw.shape[2] > 2 else raw)
