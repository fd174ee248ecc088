"""What hostile inputs are made from: small valid frames, videos and scenes, and the commands."""

import struct
import zlib
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import numpy as np
import tifffile
from PIL import Image

from scene_texts import BENDING_BEAM, WORN_CONTACT, camera_text

ROWS, COLS = 48, 64

PLAIN = "[specimen]\n"

CONTACT = WORN_CONTACT + camera_text(COLS, ROWS, 0.05, left_mm=-1.6, top_mm=0.0, bit_depth=8)

BENDING = BENDING_BEAM + "[camera]\npixel_mm = 0.5\nbit_depth = 8\n"
BENDING += '[[image]]\nfile = "a.png"\nload_n = 150.0\n'


def process(frames: str, scene: str = "plain.toml", *more: str) -> list[str]:
    return ["process", frames, "--scene", scene, "--out", "out", *more]


def simulate(scene: str = "wrong.toml", *more: str) -> list[str]:
    return ["simulate", scene, "--out", "out", *more]


def picture(number: int = 0, rows: int = ROWS, cols: int = COLS) -> np.ndarray:
    """A frame with fringes, 8 bit."""
    row, col = np.mgrid[:rows, :cols]
    return (128 + 90 * np.sin((col**2 + row**2) / 200 + number)).astype(np.uint8)


def pictures(count: int = 4) -> np.ndarray:
    """Frames (frame, row, col)."""
    return np.stack([picture(i) for i in range(count)])


def write_scene(place: Path, text: str, name: str = "wrong.toml") -> None:
    (place / name).write_text(text, "utf-8")


def contact_with(place: Path, old: str, new: str) -> None:
    """The contact's scene with a line changed, as wrong.toml."""
    assert CONTACT.count(old) == 1, old
    write_scene(place, CONTACT.replace(old, new))


def tiff(path: Path, tags: Iterable[tuple], body: bytes = b"", after: int = 0) -> None:
    """A TIFF of one page by hand: `tags` (tag, type, count, value); `body` begins at byte 8.
    `after`, where the next page is said to be."""
    tags = sorted(tags)
    head = b"II*\0" + struct.pack("<I", 8 + len(body))
    page = struct.pack("<H", len(tags))
    for tag in tags:
        page += struct.pack("<HHII", *tag)
    path.write_bytes(head + body + page + struct.pack("<I", after))


def grey_tags(
    rows: int, cols: int, *, size: int, compression: int = 1, bits: int = 8, place: int = 8
) -> dict[int, tuple]:
    """The tags of a grey page of one strip, by their numbers."""
    return {
        256: (256, 4, 1, cols), 257: (257, 4, 1, rows), 258: (258, 3, 1, bits),
        259: (259, 3, 1, compression), 262: (262, 3, 1, 1), 273: (273, 4, 1, place),
        277: (277, 3, 1, 1), 278: (278, 4, 1, rows), 279: (279, 4, 1, size),
    }  # fmt: skip


def png(path: Path, rows: int, cols: int, data: bytes, bits: int = 8) -> None:
    """A grey PNG by hand, its compressed pixels as they are given."""

    def part(name: bytes, body: bytes) -> bytes:
        return (
            struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        )

    head = struct.pack(">IIBBBBB", cols, rows, bits, 0, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + part(b"IHDR", head) + part(b"IDAT", data) + part(b"IEND", b"")
    )


def zeros(megabytes: int) -> bytes:
    """Zlib's form of that many million zeros; itself a thousandth of it."""
    stream = zlib.compressobj()
    first = stream.compress(bytes(1_000_000)) + stream.flush(zlib.Z_FULL_FLUSH)
    again = stream.compress(bytes(1_000_000)) + stream.flush(zlib.Z_FULL_FLUSH)
    return first + (megabytes - 1) * again  # after a full flush nothing depends on what was before


def video(
    path: Path,
    codec: str = "ffv1",
    pixels: str = "gray",
    *,
    count: int = 6,
    rows: int = ROWS,
    cols: int = COLS,
    ticks: Iterable[int] | None = None,
) -> Path:
    """A video of ten frames a second, `ticks` their time stamps in tenths of a second."""
    import av

    with av.open(str(path), "w") as out:
        stream = out.add_stream(codec, rate=10)
        stream.width, stream.height, stream.pix_fmt = cols, rows, pixels
        for i, tick in zip(range(count), ticks or range(count), strict=True):
            frame = av.VideoFrame.from_ndarray(picture(i, rows, cols), format="gray")
            frame = frame.reformat(format=pixels)
            frame.pts, frame.time_base = tick, Fraction(1, 10)
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return path


def changed(path: Path, mark: bytes, skip: int, form: str, *values: int) -> None:
    """Overwrite numbers behind the first place of a mark in a file."""
    data = bytearray(path.read_bytes())
    place = data.find(mark)
    assert place >= 0
    struct.pack_into(form, data, place + skip, *values)
    path.write_bytes(data)


def stack(path: Path, frames: np.ndarray | None = None) -> None:
    """A TIFF stack of grey frames."""
    tifffile.imwrite(path, pictures() if frames is None else frames, photometric="minisblack")


def image(path: Path, frame: np.ndarray | None = None) -> None:
    """An image file of the kind that its name says."""
    Image.fromarray(picture() if frame is None else frame).save(path)


def roi() -> bytes:
    """An area of ImageJ, a square of ten pixels."""
    import roifile

    corners = np.array([[4, 4], [14, 4], [14, 14], [4, 14]], np.float32)
    area = roifile.ImagejRoi.frompoints(corners)
    area.roitype = roifile.ROI_TYPE.POLYGON
    return bytes(area.tobytes())
