"""Heads that lie: files that say of themselves what they do not hold."""

import struct
from collections.abc import Callable
from pathlib import Path

import tifffile
from PIL import Image

from hostile.attack import Case, after, case, hostile
from hostile.given import changed, grey_tags, image, picture, pictures, png, process, tiff, video

HEADS: list[Case] = []
FLAT = picture().tobytes()


def page(name: str, *says: str, tags: tuple = (), after: int = 0, size: int = len(FLAT)) -> None:
    """A page of 48 x 64 with some tags replaced."""
    case(HEADS, name, lambda place: one_page(place, *tags, after=after, size=size), "f.tif", *says)


def one_page(place: Path, *other: tuple, after: int = 0, size: int = len(FLAT)) -> list[str]:
    tags = grey_tags(48, 64, size=size) | {tag[0]: tag for tag in other}
    tiff(place / "f.tif", tags.values(), FLAT, after)
    return process("f.tif")


AGAIN, COPY = "save it again", "copy it again"
page("tiff strip beyond the file", "frame 0 ends at byte 4000003072", COPY,
     tags=((273, 4, 1, 4_000_000_000),))  # fmt: skip
page("tiff strip larger than the file", "ends at byte 4294967303", COPY, size=2**32 - 1)
page("tiff strip shorter than its page", "frame", AGAIN, size=100)
page("tiff strip of a negative number of bytes", AGAIN, tags=((279, 9, 1, 2**32 - 3072),))
page("tiff strip of no bytes", AGAIN, tags=((279, 4, 1, 0),))
page("tiff whose directories run in a circle", "breaks off", COPY, after=8 + len(FLAT))
page("tiff whose next page is beyond the file", "breaks off", COPY, after=2**32 - 2)
page("tiff of pixels of a thousand bits", "save it", tags=((258, 3, 1, 1000),))
page("tiff that says sixteen bits and holds eight", "save it", tags=((258, 3, 1, 16),))
page("tiff of no rows", "0 x 64", AGAIN, tags=((257, 4, 1, 0),))
page("tiff of sixty thousand colours", AGAIN, tags=((277, 3, 1, 60_000),))
page("tiff of tiles of no width", AGAIN,
     tags=((322, 4, 1, 0), (323, 4, 1, 16), (324, 4, 1, 8), (325, 4, 1, 3072)))  # fmt: skip


def edited(
    name: str, file: str, make: Callable[[Path], object], edit: Callable[[bytes], bytes], *says: str
) -> None:
    """A good file of which other bytes are left."""

    def write(place: Path) -> list[str]:
        make(place / file)
        (place / file).write_bytes(edit((place / file).read_bytes()))
        return process(file)

    case(HEADS, name, write, file, *says)


def nothing(path: Path) -> None:
    path.touch()


def grey_stack(path: Path) -> None:
    tifffile.imwrite(path, pictures(), imagej=True, metadata={"axes": "TYX"})


def film(path: Path) -> None:
    video(path, "mpeg4", "yuv420p")


def half(data: bytes) -> bytes:
    return data[: len(data) // 2]


def of_nine_images(data: bytes) -> bytes:
    assert data.count(b"images=4\nframes=4") == 1
    return data.replace(b"images=4\nframes=4", b"images=9\nframes=9")


CLUSTER = b"\x1f\x43\xb6\x75"
edited("tiff that ends inside its directory", "f.tif", lambda path: one_page(path.parent),
       lambda data: data[:-40], "corrupted", AGAIN)  # fmt: skip
edited("tiff whose directory is beyond the file", "f.tif", nothing,
       lambda _: b"II*\0" + struct.pack("<I", 2**31) + FLAT, "holds no page", COPY)  # fmt: skip
edited("bigtiff with two to the sixty tags", "f.tif", nothing,
       lambda _: struct.pack("<2sHHHQQ", b"II", 43, 8, 0, 16, 2**60) + bytes(200),
       AGAIN)  # fmt: skip
edited("imagej notes of more images than there are", "f.tif", grey_stack, of_nine_images,
       "breaks off after 4 frames", COPY)  # fmt: skip
edited("png that ends in its pixels", "f.png", image, half, AGAIN)
edited("jpeg that ends in its pixels", "f.jpg", image, half, AGAIN)
edited("pgm of a negative size", "f.pgm", nothing, lambda _: b"P5 -64 48 255\n" + FLAT,
       "is not an image", "check the file")  # fmt: skip
edited("mp4 cut in its index", "f.mp4", film, lambda data: data[: data.find(b"moov") + 60],
       "breaks off", COPY)  # fmt: skip
edited("mp4 without its index", "f.mp4", film, lambda data: data[: data.find(b"moov") - 4],
       "index is missing", COPY)  # fmt: skip
edited("mkv cut in a cluster", "f.mkv", video, lambda data: data[: data.find(CLUSTER) + 2000],
       "breaks off", COPY)  # fmt: skip
edited("archive named as a video", "f.mkv", nothing, lambda _: b"PK\x03\x04" + FLAT,
       "a ZIP archive", "save it as one")  # fmt: skip
edited("document named as a stack", "f.tif", nothing, lambda _: b"%PDF-1.7\n" + FLAT,
       "a PDF document", "check the file")  # fmt: skip
edited("table named as a picture", "f.png", nothing, lambda _: b"frame,load_n\n0,44.0\n" * 40,
       "a text that begins 'frame,load_n'", "check the file")  # fmt: skip


def overwritten(
    name: str, file: str, make: Callable[[Path], object], mark: bytes, skip: int, form: str,
    value: int, *says: str,
) -> None:  # fmt: skip
    """A good file one of whose numbers is another, behind the first place of a mark."""

    def write(place: Path) -> list[str]:
        make(place / file)
        changed(place / file, mark, skip, form, value)
        return process(file)

    case(HEADS, name, write, file, *says)


overwritten("bmp of two thousand million rows", "f.bmp", image, b"BM", 22, "<i", 2**31 - 1, AGAIN)
overwritten("bmp whose head claims more rows than follow", "f.bmp", image, b"BM", 22, "<i", 4800,
            "truncated", AGAIN)  # fmt: skip
overwritten("mp4 whose index points beyond the file", "f.mp4", film, b"stco", 12, ">I", 2**31,
            AGAIN)  # fmt: skip
overwritten("mp4 whose index claims four thousand million frames", "f.mp4", film, b"stsz", 12, ">I",
            2**32 - 1, "not a readable video", AGAIN)  # fmt: skip
overwritten("mkv whose first cluster is lost", "f.mkv", video, CLUSTER, 0, "<I", 0,
            "is damaged at byte", COPY)  # fmt: skip
overwritten("mkv whose element has two to the fifty six bytes", "f.mkv", video, CLUSTER, 4, ">Q",
            (1 << 56) | (1 << 55), "breaks off", COPY)  # fmt: skip


@hostile(HEADS, "f.tif", "save it again")
def bigtiff_with_a_tag_of_two_to_the_sixty_values(place: Path) -> list[str]:
    tags = grey_tags(48, 64, size=len(FLAT), place=16).values()
    page = struct.pack("<Q", len(tags))
    for number, kind, count, value in tags:
        page += struct.pack("<HHQQ", number, kind, 2**60 if number in (273, 279) else count, value)
    head = struct.pack("<2sHHHQ", b"II", 43, 8, 0, 16 + len(FLAT))
    (place / "f.tif").write_bytes(head + FLAT + page + bytes(8))
    return process("f.tif")


case(HEADS, "tiff whose scale is another across than down",
     after(lambda p: tifffile.imwrite(p / "f.tif", picture(), resolution=(100, 1e-3)),
     process("f.tif")), "f.tif", "square pixels", "correct its scale")  # fmt: skip
case(HEADS, "png of no rows", after(lambda p: png(p / "f.png", 0, 64, b""), process("f.png")),
     "f.png", "is not an image", "check the file")  # fmt: skip


@hostile(HEADS, "f.png", "holds 4 pictures", "save")
def animation_named_as_a_picture(place: Path) -> list[str]:
    first, *rest = (Image.fromarray(frame) for frame in pictures())
    first.save(place / "f.png", save_all=True, append_images=rest)
    return process("f.png")


@hostile(HEADS, "x.avi", "whatever its name says", "save it as one")
def playlist_named_as_a_video(place: Path) -> list[str]:
    video(place / "f.mkv")
    (place / "x.avi").write_text(f"#EXTM3U\n#EXTINF:1,\nfile://{place}/f.mkv\n" + "\n" * 50)
    return process("x.avi")
