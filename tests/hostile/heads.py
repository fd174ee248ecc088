"""Heads that lie: files that say of themselves what they do not hold."""

import struct
from pathlib import Path

import tifffile
from PIL import Image

from hostile.attack import Case, hostile
from hostile.given import (
    changed,
    grey_tags,
    image,
    picture,
    pictures,
    png,
    process,
    tiff,
    video,
)

HEADS: list[Case] = []
FLAT = picture().tobytes()


def one_page(place: Path, *other: tuple, after: int = 0, size: int = len(FLAT)) -> list[str]:
    """A page of 48 x 64 with some tags replaced."""
    tags = grey_tags(48, 64, size=size) | {tag[0]: tag for tag in other}
    tiff(place / "f.tif", tags.values(), FLAT, after)
    return process("f.tif")


@hostile(HEADS, "f.tif", "frame 0 ends at byte 4000003072", "copy it again")
def tiff_strip_beyond_the_file(place: Path) -> list[str]:
    return one_page(place, (273, 4, 1, 4_000_000_000))


@hostile(HEADS, "f.tif", "ends at byte 4294967303", "copy it again")
def tiff_strip_larger_than_the_file(place: Path) -> list[str]:
    return one_page(place, size=2**32 - 1)


@hostile(HEADS, "f.tif", "frame", "save it again")
def tiff_strip_shorter_than_its_page(place: Path) -> list[str]:
    return one_page(place, size=100)


@hostile(HEADS, "f.tif", "save it again")
def tiff_strip_of_a_negative_number_of_bytes(place: Path) -> list[str]:
    return one_page(place, (279, 9, 1, 2**32 - 3072))


@hostile(HEADS, "f.tif", "save it again")
def tiff_strip_of_no_bytes(place: Path) -> list[str]:
    return one_page(place, (279, 4, 1, 0))


@hostile(HEADS, "f.tif", "corrupted", "save it again")
def tiff_that_ends_inside_its_directory(place: Path) -> list[str]:
    one_page(place)
    data = (place / "f.tif").read_bytes()
    (place / "f.tif").write_bytes(data[:-40])
    return process("f.tif")


@hostile(HEADS, "f.tif", "holds no page", "copy it again")
def tiff_whose_directory_is_beyond_the_file(place: Path) -> list[str]:
    (place / "f.tif").write_bytes(b"II*\0" + struct.pack("<I", 2**31) + FLAT)
    return process("f.tif")


@hostile(HEADS, "f.tif", "breaks off", "copy it again")
def tiff_whose_directories_run_in_a_circle(place: Path) -> list[str]:
    return one_page(place, after=8 + len(FLAT))


@hostile(HEADS, "f.tif", "breaks off", "copy it again")
def tiff_whose_next_page_is_beyond_the_file(place: Path) -> list[str]:
    return one_page(place, after=2**32 - 2)


@hostile(HEADS, "f.tif", "save it again")
def bigtiff_with_two_to_the_sixty_tags(place: Path) -> list[str]:
    (place / "f.tif").write_bytes(struct.pack("<2sHHHQQ", b"II", 43, 8, 0, 16, 2**60) + bytes(200))
    return process("f.tif")


@hostile(HEADS, "f.tif", "save it again")
def bigtiff_with_a_tag_of_two_to_the_sixty_values(place: Path) -> list[str]:
    tags = [
        (*tag[:2], tag[2], tag[3]) for tag in grey_tags(48, 64, size=len(FLAT), place=16).values()
    ]
    page = struct.pack("<Q", len(tags))
    for number, kind, count, value in tags:
        page += struct.pack("<HHQQ", number, kind, 2**60 if number in (273, 279) else count, value)
    head = struct.pack("<2sHHHQ", b"II", 43, 8, 0, 16 + len(FLAT))
    (place / "f.tif").write_bytes(head + FLAT + page + bytes(8))
    return process("f.tif")


@hostile(HEADS, "f.tif", "breaks off after 4 frames", "copy it again")
def imagej_notes_of_more_images_than_there_are(place: Path) -> list[str]:
    tifffile.imwrite(place / "f.tif", pictures(), imagej=True, metadata={"axes": "TYX"})
    data = (place / "f.tif").read_bytes()
    assert data.count(b"images=4\nframes=4") == 1
    (place / "f.tif").write_bytes(data.replace(b"images=4\nframes=4", b"images=9\nframes=9"))
    return process("f.tif")


@hostile(HEADS, "f.tif", "save it")
def tiff_of_pixels_of_a_thousand_bits(place: Path) -> list[str]:
    return one_page(place, (258, 3, 1, 1000))


@hostile(HEADS, "f.tif", "save it")
def tiff_that_says_sixteen_bits_and_holds_eight(place: Path) -> list[str]:
    return one_page(place, (258, 3, 1, 16))


@hostile(HEADS, "f.tif", "0 x 64", "save it again")
def tiff_of_no_rows(place: Path) -> list[str]:
    return one_page(place, (257, 4, 1, 0))


@hostile(HEADS, "f.tif", "save it again")
def tiff_of_sixty_thousand_colours(place: Path) -> list[str]:
    return one_page(place, (277, 3, 1, 60_000))


@hostile(HEADS, "f.tif", "save it again")
def tiff_of_tiles_of_no_width(place: Path) -> list[str]:
    return one_page(place, (322, 4, 1, 0), (323, 4, 1, 16), (324, 4, 1, 8), (325, 4, 1, 3072))


@hostile(HEADS, "f.tif", "square pixels", "correct its scale")
def tiff_whose_scale_is_another_across_than_down(place: Path) -> list[str]:
    tifffile.imwrite(place / "f.tif", picture(), resolution=(100, 1e-3))
    return process("f.tif")


@hostile(HEADS, "f.png", "is not an image", "check the file")
def png_of_no_rows(place: Path) -> list[str]:
    png(place / "f.png", 0, 64, b"")
    return process("f.png")


@hostile(HEADS, "f.png", "save it again")
def png_that_ends_in_its_pixels(place: Path) -> list[str]:
    image(place / "f.png")
    data = (place / "f.png").read_bytes()
    (place / "f.png").write_bytes(data[: len(data) // 2])
    return process("f.png")


@hostile(HEADS, "f.jpg", "save it again")
def jpeg_that_ends_in_its_pixels(place: Path) -> list[str]:
    image(place / "f.jpg")
    data = (place / "f.jpg").read_bytes()
    (place / "f.jpg").write_bytes(data[: len(data) // 2])
    return process("f.jpg")


@hostile(HEADS, "f.pgm", "is not an image", "check the file")
def pgm_of_a_negative_size(place: Path) -> list[str]:
    (place / "f.pgm").write_bytes(b"P5 -64 48 255\n" + FLAT)
    return process("f.pgm")


@hostile(HEADS, "f.bmp", "save it again")
def bmp_of_two_thousand_million_rows(place: Path) -> list[str]:
    image(place / "f.bmp")
    changed(place / "f.bmp", b"BM", 22, "<i", 2**31 - 1)
    return process("f.bmp")


@hostile(HEADS, "f.bmp", "truncated", "save it again")
def bmp_whose_head_claims_more_rows_than_follow(place: Path) -> list[str]:
    image(place / "f.bmp")
    changed(place / "f.bmp", b"BM", 22, "<i", 4800)
    return process("f.bmp")


@hostile(HEADS, "f.mp4", "breaks off", "copy it again")
def mp4_cut_in_its_index(place: Path) -> list[str]:
    path = video(place / "f.mp4", "mpeg4", "yuv420p")
    data = path.read_bytes()
    path.write_bytes(data[: data.find(b"moov") + 60])
    return process("f.mp4")


@hostile(HEADS, "f.mp4", "index is missing", "copy it again")
def mp4_without_its_index(place: Path) -> list[str]:
    path = video(place / "f.mp4", "mpeg4", "yuv420p")
    data = path.read_bytes()
    path.write_bytes(data[: data.find(b"moov") - 4])
    return process("f.mp4")


@hostile(HEADS, "f.mp4", "save it again")
def mp4_whose_index_points_beyond_the_file(place: Path) -> list[str]:
    path = video(place / "f.mp4", "mpeg4", "yuv420p")
    changed(path, b"stco", 12, ">I", 2**31)
    return process("f.mp4")


@hostile(HEADS, "f.mp4", "not a readable video", "save it again")
def mp4_whose_index_claims_four_thousand_million_frames(place: Path) -> list[str]:
    path = video(place / "f.mp4", "mpeg4", "yuv420p")
    changed(path, b"stsz", 12, ">I", 2**32 - 1)
    return process("f.mp4")


@hostile(HEADS, "f.mkv", "breaks off", "copy it again")
def mkv_cut_in_a_cluster(place: Path) -> list[str]:
    path = video(place / "f.mkv")
    data = path.read_bytes()
    path.write_bytes(data[: data.find(b"\x1f\x43\xb6\x75") + 2000])
    return process("f.mkv")


@hostile(HEADS, "f.mkv", "is damaged at byte", "copy it again")
def mkv_whose_first_cluster_is_lost(place: Path) -> list[str]:
    path = video(place / "f.mkv")
    changed(path, b"\x1f\x43\xb6\x75", 0, "<I", 0)
    return process("f.mkv")


@hostile(HEADS, "f.mkv", "breaks off", "copy it again")
def mkv_whose_element_has_two_to_the_fifty_six_bytes(place: Path) -> list[str]:
    path = video(place / "f.mkv")
    changed(path, b"\x1f\x43\xb6\x75", 4, ">Q", (1 << 56) | (1 << 55))
    return process("f.mkv")


@hostile(HEADS, "f.mkv", "a ZIP archive", "save it as one")
def archive_named_as_a_video(place: Path) -> list[str]:
    (place / "f.mkv").write_bytes(b"PK\x03\x04" + FLAT)
    return process("f.mkv")


@hostile(HEADS, "f.tif", "a PDF document", "check the file")
def document_named_as_a_stack(place: Path) -> list[str]:
    (place / "f.tif").write_bytes(b"%PDF-1.7\n" + FLAT)
    return process("f.tif")


@hostile(HEADS, "f.png", "a text that begins 'frame,load_n'", "check the file")
def table_named_as_a_picture(place: Path) -> list[str]:
    (place / "f.png").write_text("frame,load_n\n0,44.0\n" * 40, "utf-8")
    return process("f.png")


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
