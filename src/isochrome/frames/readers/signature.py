"""What a file is by its first bytes, whatever it is called.

Sources: the formats' own specifications (TIFF 6.0 and BigTIFF, PNG, JPEG, BMP, Netpbm, WebP), and
for videos those of `integrity.containers`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from isochrome.errors import InputError
from isochrome.frames.containers import container_of
from isochrome.frames.source import Stamp
from isochrome.messages import message

FileKind = Literal["tiff", "image", "video"]

_HEAD = 512
_TIFF = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
_IMAGES = {b"\x89PNG\r\n\x1a\n": "PNG", b"\xff\xd8\xff": "JPEG", b"BM": "BMP"}
_DIB = (12, 40, 52, 56, 64, 108, 124)
"""Lengths of the head that a bitmap without BMP's own begins with."""

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
    Stamp.of(path)
    try:
        with open(path, "rb") as file:
            head = file.read(_HEAD)
            container = container_of(file)
    except OSError as error:
        raise InputError(
            message("cannot_read_check_name", path=path, strerror=error.strerror)
        ) from error
    if head.startswith(_TIFF):
        return Signature("tiff", "TIFF")
    name = _image(head)
    if name is not None:
        return Signature("image", name)
    if container is not None and head[8:12] not in _PHOTOGRAPHS:
        return Signature("video", container)
    raise InputError(message("not_image_video_kind", path=path, seems=_seems(head)))


def _image(head: bytes) -> str | None:
    for start, name in _IMAGES.items():
        if head.startswith(start):
            return name
    if head[:4] == b"RIFF" and head[8:12] == b"WEBP":
        return "WebP"
    if head[:1] == b"P" and head[1:2] in b"123456fF" and (head[2:3].isspace() or head[2:3] == b"#"):
        return "Netpbm"
    return "DIB" if int.from_bytes(head[:4], "little") in _DIB else None


def _seems(head: bytes) -> str:
    """What begins so, in words."""
    for start, name in _OTHERS.items():
        if head.startswith(start):
            return name
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
