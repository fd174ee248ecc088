"""Files that swell: a few bytes that claim, or become, gigabytes."""

import io
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import tifffile

from hostile.attack import Case, after, case, hostile
from hostile.given import (
    changed,
    contact_with,
    grey_tags,
    pictures,
    png,
    process,
    roi,
    simulate,
    stack,
    tiff,
    video,
    write_scene,
    zeros,
)

BOMBS: list[Case] = []
HUGE = 100_000


def packed(place: Path, rows: int, cols: int, compression: int, data: bytes) -> list[str]:
    tags = grey_tags(rows, cols, size=len(data), compression=compression)
    tiff(place / "b.tif", tags.values(), data)
    return process("b.tif")


DEFLATE, LZW, ZSTD = 8, 5, 50000
ZSTD_HEAD = bytes.fromhex("28b52ffd") + bytes(500)
SAYS = {HUGE: ("b.tif", "100000 x 100000", "crop it or save it again"),
        48: ("b.tif", "not a readable TIFF", "save it again")}  # fmt: skip
case(BOMBS, "tiff page of ten gigapixels by deflate",
     lambda p: packed(p, HUGE, HUGE, DEFLATE, zeros(50)), *SAYS[HUGE])  # fmt: skip
case(BOMBS, "tiff page of ten gigapixels by lzw",
     lambda p: packed(p, HUGE, HUGE, LZW, bytes.fromhex("8000") * 500), *SAYS[HUGE])  # fmt: skip
case(BOMBS, "tiff page of ten gigapixels by zstd",
     lambda p: packed(p, HUGE, HUGE, ZSTD, ZSTD_HEAD), *SAYS[HUGE])  # fmt: skip
case(BOMBS, "tiff strip of zstd that is garbage",
     lambda p: packed(p, 48, 64, ZSTD, ZSTD_HEAD), *SAYS[48])  # fmt: skip
case(BOMBS, "tiff strip of lzw that is garbage",
     lambda p: packed(p, 48, 64, LZW, bytes.fromhex("80ffff55aa00ff13") * 50),
     *SAYS[48])  # fmt: skip
case(BOMBS, "tiff strip that swells beyond its page",
     lambda p: packed(p, 48, 64, DEFLATE, zeros(3000)), "b.tif", "swells",
     "save it again")  # fmt: skip
case(BOMBS, "png of ten gigapixels",
     after(lambda p: png(p / "b.png", HUGE, HUGE, zeros(50)), process("b.png")), "b.png",
     "10000000000 pixels", "save it again")  # fmt: skip


@hostile(BOMBS, "b.png", "check the file, or save it again")
def png_that_swells_beyond_its_head(place: Path) -> list[str]:
    data = zeros(3000)
    png(place / "b.png", 48, 64, data)
    text = b"k\0\0" + data  # a compressed note, three gigabytes of it
    part = struct.pack(">I", len(text)) + b"zTXt" + text
    part += struct.pack(">I", zlib.crc32(b"zTXt" + text))
    whole = (place / "b.png").read_bytes()
    (place / "b.png").write_bytes(whole[:33] + part + whole[33:])
    return process("b.png")


@hostile(BOMBS, "b.avi", "size", "save it again")
def avi_whose_head_says_thirty_thousand_pixels_square(place: Path) -> list[str]:
    path = video(place / "b.avi", "rawvideo", "gray")
    changed(path, b"strf", 12, "<ii", 30_000, 30_000)
    return process("b.avi")


@hostile(BOMBS, "b.mkv", "size", "save it again")
def mkv_whose_head_says_thirty_thousand_pixels_square(place: Path) -> list[str]:
    path = video(place / "b.mkv", cols=264, rows=258)
    data = path.read_bytes()
    wide, high = b"\xb0\x82\x01\x08", b"\xba\x82\x01\x02"
    assert data.count(wide) == data.count(high) == 1
    data = data.replace(wide, b"\xb0\x82" + struct.pack(">H", 30_000))
    path.write_bytes(data.replace(high, b"\xba\x82" + struct.pack(">H", 30_000)))
    return process("b.mkv")


@hostile(BOMBS, "b.zip", "ROIs need less", "save the areas again")
def zipped_roi_of_forty_megabytes(place: Path) -> list[str]:
    with zipfile.ZipFile(place / "b.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.roi", b"Iout" + bytes(40_000_000))
    return with_mask(place, "b.zip")


@hostile(BOMBS, "b.zip", "CRC", "save it again")
def zipped_roi_whose_directory_lies_about_its_size(place: Path) -> list[str]:
    with zipfile.ZipFile(place / "b.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.roi", b"Iout" + bytes(50_000_000))
    data = bytearray((place / "b.zip").read_bytes())
    for mark, skip in ((b"PK\3\4", 22), (b"PK\1\2", 24)):
        struct.pack_into("<I", data, data.find(mark) + skip, 100)
    (place / "b.zip").write_bytes(data)
    return with_mask(place, "b.zip")


@hostile(BOMBS, "b.zip", "not a readable ImageJ ROI", "save it again")
def zip_in_a_zip_in_a_zip(place: Path) -> list[str]:
    inner = bytes(10_000_000)
    for _ in range(5):
        held = io.BytesIO()
        with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
            for copy in range(10):
                archive.writestr(f"{copy}.zip", inner)
        inner = held.getvalue()
    (place / "b.zip").write_bytes(inner)
    return with_mask(place, "b.zip")


@hostile(BOMBS, "b.zip", "2000 ROIs", "are allowed")
def zip_of_two_thousand_rois(place: Path) -> list[str]:
    with zipfile.ZipFile(place / "b.zip", "w") as archive:
        for k in range(2000):
            archive.writestr(f"{k}.roi", roi())
    return with_mask(place, "b.zip")


@hostile(BOMBS, "b.tif", "entities", "save it again")
def ome_notes_with_entities_in_entities(place: Path) -> list[str]:
    tifffile.imwrite(place / "b.tif", pictures(), ome=True, metadata={"axes": "TYX"})
    entities = "".join(f'<!ENTITY e{k} "{f"&e{k - 1};" * 10}">' for k in range(1, 12))
    with tifffile.TiffFile(place / "b.tif", mode="r+b") as tif:
        notes = tif.pages[0].tags["ImageDescription"]
        bomb = f'<!DOCTYPE a [<!ENTITY e0 "x">{entities}]><OME'
        notes.overwrite(notes.value.replace("<OME", bomb, 1))
    return process("b.tif")


@hostile(BOMBS, "b.tif", "name 999999999 frames and 4 are in it", "copy it again")
def ome_notes_of_a_thousand_million_frames(place: Path) -> list[str]:
    tifffile.imwrite(place / "b.tif", pictures(), ome=True, metadata={"axes": "TYX"})
    with tifffile.TiffFile(place / "b.tif", mode="r+b") as tif:
        notes = tif.pages[0].tags["ImageDescription"]
        notes.overwrite(notes.value.replace('SizeT="4"', 'SizeT="999999999"'))
    return process("b.tif")


@hostile(BOMBS, "b.csv", "bytes", "profile")
def profile_of_a_gigabyte(place: Path) -> list[str]:
    with open(place / "b.csv", "wb") as file:
        file.truncate(1_000_000_000)  # a hole: it takes no room
    contact_with(place, "radius_mm = 24.61", "profile = 'b.csv'")
    return simulate()


@hostile(BOMBS, "b.csv", "bytes")
def colour_table_of_a_gigabyte(place: Path) -> list[str]:
    with open(place / "b.csv", "wb") as file:
        file.truncate(1_000_000_000)
    tifffile.imwrite(place / "f.tif", np.stack([pictures()] * 3, axis=-1), photometric="rgb")
    light = "[polariscope]\nlight = 'white'\nwavelength_nm = 550.0\n[camera]\ncolour = true\n"
    write_scene(place, f"[specimen]\n{light}[frames]\ncolour_table = 'b.csv'\n")
    return process("f.tif", "wrong.toml")


def with_mask(place: Path, name: str) -> list[str]:
    """Good frames, and a mask of that name."""
    stack(place / "f.tif")
    write_scene(place, f"[specimen]\n[frames]\nmask = '{name}'\n")
    return process("f.tif", "wrong.toml")
