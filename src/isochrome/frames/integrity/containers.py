"""Whether a video file is whole, by its container's own structure.

FFmpeg reads over gaps: it looks for the next thing that it knows and goes on, so that a file that
breaks off, or whose middle is lost, gives fewer frames and no word. The sizes in the containers
tell. Sources: AVI RIFF file reference (Microsoft) with the OpenDML extensions; RFC 9559, Matroska;
ISO/IEC 14496-12, base media file format.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, Literal

from isochrome.errors import InputError

Container = Literal["avi", "matroska", "mp4", "asf", "mpeg"]

EBML, SEGMENT, CLUSTER = 0x1A45DFA3, 0x18538067, 0x1F43B675
BLOCK_GROUP = 0xA0
IN_SEGMENT = (
    0x114D9B74, 0x1549A966, CLUSTER, 0x1654AE6B, 0x1C53BB6B, 0x1941A469, 0x1043A770, 0x1254C367,
    0xEC, 0xBF,
)  # fmt: skip
IN_CLUSTER = (0xE7, 0x5854, 0xA7, 0xAB, 0xA3, BLOCK_GROUP, 0xAF, 0xEC, 0xBF)
UNKNOWN_SIZE = -1
BOXES = (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"uuid", b"moof", b"mfra", b"sidx",
         b"meta", b"styp", b"pnot", b"udta", b"PICT", b"ssix", b"prft", b"emsg")  # fmt: skip


def check_whole(path: Path) -> Container:
    """Walk through a video's structure, without decoding. Cost: a few bytes a frame.

    Parameters: `path`. Returns its container. Raises InputError where it is of another kind,
    breaks off, or is damaged between its frames. A recording that was never closed (sizes left at
    zero or 'unknown') passes when all that it holds is whole.
    """
    try:
        with open(path, "rb") as file:
            container, end = container_of(file), file.seek(0, 2)
            walk = _WALKS.get(container)
            if walk is not None:
                walk(file, end, path)
            if container is not None:
                return container
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); check its name and rights"
        ) from error
    raise InputError(
        f"{path}: is no AVI, MP4, MOV, Matroska, WebM, WMV or MPEG file, whatever its name says; "
        "save it as one, or as a TIFF stack"
    )


def container_of(file: BinaryIO) -> Container | None:
    """A video's container by its first bytes; None where it is none that is known."""
    file.seek(0)
    head = file.read(16)
    if head[:4] == b"RIFF" and head[8:12] == b"AVI ":
        return "avi"
    if head[:4] == b"\x1a\x45\xdf\xa3":
        return "matroska"
    if head[4:8] in BOXES:
        return "mp4"
    if head == bytes.fromhex("3026b2758e66cf11a6d900aa0062ce6c"):
        return "asf"
    starts = head[:4] in (b"\x00\x00\x01\xba", b"\x00\x00\x01\xb3")
    return "mpeg" if starts or _is_stream(head, file) else None


def _broken(path: Path, place: int, end: int) -> InputError:
    return InputError(
        f"{path}: breaks off: a part that begins at byte {place} goes beyond the file's end at "
        f"{end}; it is truncated: copy it again from its source (what is left of it: 'ffmpeg -i "
        "FILE -c copy NEW')"
    )


def _damaged(path: Path, place: int) -> InputError:
    return InputError(
        f"{path}: is damaged at byte {place}, and frames after it may be lost; copy it again from "
        "its source (what is left of it: 'ffmpeg -i FILE -c copy NEW')"
    )


def _is_stream(head: bytes, file: BinaryIO) -> bool:
    """Whether it is an MPEG transport stream: packets of 188 bytes, each begun by 0x47."""
    file.seek(188)
    return head[:1] == b"\x47" == file.read(1)


def _avi(file: BinaryIO, end: int, path: Path) -> None:
    """RIFF lists: AVI, and AVIX for what follows after a gigabyte; in them, chunks of frames."""
    place = 0
    while place + 12 <= end:
        file.seek(place)
        name, size, kind = struct.unpack("<4sI4s", file.read(12))
        if name != b"RIFF" or kind not in (b"AVI ", b"AVIX"):
            return  # something else behind the recording, such as a signature
        stop = place + 8 + size
        if stop > end + 1:  # some writers leave out the last byte that fills up to an even number
            raise _broken(path, place, end)
        stop = end if size == 0 else min(stop, end)  # 0: never closed
        _chunks(file, place + 12, stop, path)
        place = stop + stop % 2


def _chunks(file: BinaryIO, place: int, stop: int, path: Path, depth: int = 0) -> None:
    while place + 8 <= stop:
        file.seek(place)
        name, size = struct.unpack("<4sI", file.read(8))
        if not name.isascii() or not name.decode().isprintable():
            raise _damaged(path, place)
        unclosed = name == b"LIST" and size == 0
        after = stop if unclosed else place + 8 + size
        if after > stop:
            raise _broken(path, place, stop)
        if name == b"LIST" and file.read(4) in (b"movi", b"rec ") and depth < 3:
            _chunks(file, place + 12, after, path, depth + 1)
        place = after + after % 2


def _mp4(file: BinaryIO, end: int, path: Path) -> None:
    """Boxes one behind the other; each says how long it is."""
    place, seen = 0, set()
    while place < end:
        file.seek(place)
        head = file.read(16)
        if len(head) < 8:
            raise _broken(path, place, end)
        size, name = struct.unpack(">I4s", head[:8])
        if size == 1 and len(head) == 16:
            size = int.from_bytes(head[8:], "big")
        if name not in BOXES:
            if b"moov" in seen and b"mdat" in seen:
                return  # something else behind the recording
            raise _damaged(path, place)
        seen.add(name)
        if size == 0:
            size = end - place
        if size < 8:
            raise _damaged(path, place)
        if place + size > end:
            raise _broken(path, place, end)
        place += size
    if b"moov" not in seen:
        raise InputError(
            f"{path}: its index is missing: the recording was never closed, or it breaks off; save "
            "it again, or copy it again from its source"
        )


def _matroska(file: BinaryIO, end: int, path: Path) -> None:
    """Elements one behind the other; each says what it is and how long."""
    place = 0
    while place < end:
        name, size, body = _element(file, place, path)
        if name == SEGMENT:
            stop = end if size == UNKNOWN_SIZE else body + size
            if stop > end:
                raise _broken(path, place, end)
            _segment(file, body, stop, path)
        elif name not in (EBML, 0xEC, 0xBF):
            raise _damaged(path, place)
        else:
            stop = body + size
        place = stop


def _segment(file: BinaryIO, place: int, stop: int, path: Path) -> None:
    inside_open = False  # a cluster of unknown size ends where the next element of a segment is
    while place < stop:
        name, size, body = _element(file, place, path)
        known = name in IN_SEGMENT or (inside_open and name in IN_CLUSTER)
        if not known:
            raise _damaged(path, place)
        if size == UNKNOWN_SIZE:
            if name != CLUSTER:
                raise _damaged(path, place)
            inside_open, place = True, body
            continue
        if body + size > stop:
            raise _broken(path, place, stop)
        if name == CLUSTER:
            _cluster(file, body, body + size, path)
        inside_open &= name in IN_CLUSTER
        place = body + size


def _cluster(file: BinaryIO, place: int, stop: int, path: Path) -> None:
    while place < stop:
        name, size, body = _element(file, place, path)
        if name not in IN_CLUSTER or size == UNKNOWN_SIZE or body + size > stop:
            raise _damaged(path, place)
        place = body + size


def _element(file: BinaryIO, place: int, path: Path) -> tuple[int, int, int]:
    """Name, size and the place of the body of the EBML element at a place (RFC 8794)."""
    file.seek(place)
    head = file.read(12)
    if len(head) < 2 or head[0] < 0x10:
        raise _damaged(path, place)
    width = 9 - head[0].bit_length()
    rest = head[width:]
    if not rest or rest[0] == 0:
        raise _damaged(path, place)
    length = 9 - rest[0].bit_length()
    if len(rest) < length:
        raise _broken(path, place, place + len(head))
    size = int.from_bytes(rest[:length], "big") & ((1 << 7 * length) - 1)
    if size == (1 << 7 * length) - 1:
        size = UNKNOWN_SIZE
    return int.from_bytes(head[:width], "big"), size, place + width + length


_WALKS: dict[Container | None, Callable[[BinaryIO, int, Path], None]] = {
    "avi": _avi,
    "matroska": _matroska,
    "mp4": _mp4,
}
