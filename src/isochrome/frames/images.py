"""Image files: one, a list, or a folder; what a file is by its first bytes, whatever it is called.

Sources: the formats' own specifications (TIFF 6.0 and BigTIFF, PNG, JPEG, BMP, Netpbm, WebP), and
for videos those of `frames.video`.
"""

import io
import os
from collections.abc import Generator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from isochrome.errors import InputError
from isochrome.frames import reading, tiff
from isochrome.frames.video import container_of

FileKind = Literal["tiff", "image", "video"]

_HEAD = 512
_TIFF = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
_OTHERS = {
    b"\x89PNG": "a PNG that was changed on its way, as by a transfer as text",
    b"GIF8": "a GIF",
    b"%PDF": "a PDF document",
    b"PK\x03\x04": "a ZIP archive or an office document",
    b"\x1f\x8b": "a gzip archive",
    b"7z\xbc\xaf": "a 7-Zip archive",
    b"\x89HDF": "HDF5 data",
    b"SIMPLE": "FITS data",
    b"8BPS": "a Photoshop document",
    b"\x00\x00\x00\x0cjP": "JPEG 2000",
    b"\xff\x4f\xff\x51": "JPEG 2000",
    b"\x93NUMPY": "a NumPy array",
    b"MATLAB": "MATLAB data",
    b"MZ": "a program",
    b"<": "a web page or XML",
    b"{": "JSON",
}
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
    head = tiff.open_tiff(first) if signature_of(first).kind == "tiff" else None
    return reading.Source(
        kind=kind,
        form=form,
        sensor_bits=head.sensor_bits if head else None,
        frames=partial(_frames, paths, form),
        extent=partial(reading.Extent, len(paths)),
        files=paths,
        names=tuple(p.name for p in paths),
        pixel_mm=head.pixel_mm if head else None,
    )


def _frames(
    paths: tuple[Path, ...], form: reading.StoredForm, start: int
) -> Generator[reading.Frame]:
    for index, path in enumerate(paths[start:], start):
        image = read_image(path)
        form.check(path, image, "the image")
        yield reading.Frame(index, image, None, path.name)


def read_image(path: Path) -> np.ndarray:
    """Decode an image file to (row, col) or (row, col, 3) in RGB, uint8, uint16 or float.

    Transparency is dropped, a palette becomes RGB, and a camera's orientation mark is ignored: the
    pixels stay where the sensor had them.
    """
    kind = signature_of(path).kind
    if kind == "tiff":
        return tiff.read_single(path)
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
