"""Frames that are files well made, and no recording."""

from pathlib import Path

import numpy as np
import tifffile

from hostile.attack import Case, after, case, hostile
from hostile.given import PLAIN, image, picture, pictures, process, stack, video, write_scene

PIXELS: list[Case] = []


def floats(place: Path, change: slice | tuple, value: float) -> list[str]:
    """Float frames, fractions of full scale, with some pixels replaced."""
    frames = pictures().astype(np.float32) / 255
    frames[change] = value
    stack(place / "f.tif", frames)
    return process("f.tif")


case(PIXELS, "every pixel nan", lambda p: floats(p, np.s_[:], np.nan), "f.tif[0]", "NaN", "check")
case(PIXELS, "every pixel infinite", lambda p: floats(p, np.s_[:], np.inf), "f.tif[0]", "check")
case(PIXELS, "one frame of nan", lambda p: floats(p, np.s_[1], np.nan), "f.tif[1]", "NaN", "check")
case(PIXELS, "one frame of minus infinity", lambda p: floats(p, np.s_[1], -np.inf), "f.tif[1]",
     "check")  # fmt: skip
case(PIXELS, "every pixel negative", lambda p: floats(p, np.s_[:], -0.5), "f.tif[0]", "check")
case(PIXELS, "fractions beyond every scale", lambda p: floats(p, np.s_[:, 3, 4], 1e38), "f.tif[0]",
     "bit_depth")  # fmt: skip


@hostile(PIXELS, "f.tif")
def pixels_of_complex_numbers(place: Path) -> list[str]:
    tifffile.imwrite(place / "f.tif", pictures().astype(np.complex64), photometric="minisblack")
    return process("f.tif")


case(PIXELS, "pixels with a sign",
     after(lambda p: stack(p / "f.tif", pictures().astype(np.int16) - 200), process("f.tif")),
     "f.tif", "int16", "save them as")  # fmt: skip
case(PIXELS, "constant frames",
     after(lambda p: stack(p / "f.tif", np.full((3, 48, 64), 90, np.uint8)), process("f.tif")),
     "f.tif[0]", "constant", "check")  # fmt: skip
case(PIXELS, "frame of one pixel",
     after(lambda p: stack(p / "f.tif", picture()[None, :1, :1]), process("f.tif")), "f.tif",
     "check")  # fmt: skip


def pages(place: Path, odd: np.ndarray) -> list[str]:
    """A stack of two pages, the last another one."""
    with tifffile.TiffWriter(place / "f.tif") as tif:
        for page in (picture(), odd):
            kind = "rgb" if page.ndim == 3 else "minisblack"
            tif.write(page, photometric=kind, metadata=None)
    return process("f.tif")


case(PIXELS, "pages of two sizes", lambda p: pages(p, picture(rows=20)), "frame 1", "20 x 64",
     "remove or crop the odd one")  # fmt: skip
case(PIXELS, "colour page among grey ones", lambda p: pages(p, np.dstack([picture()] * 3)),
     "frame 1", "colour", "save all frames alike")  # fmt: skip
case(PIXELS, "deep page among shallow ones",
     lambda p: pages(p, picture().astype(np.uint16) * 257), "frame 1", "uint16",
     "save all frames alike")  # fmt: skip


def folder(place: Path, odd: np.ndarray, suffix: str = ".png") -> list[str]:
    """A folder of three images, the last another one."""
    (place / "d").mkdir()
    for k, frame in enumerate((picture(0), odd)):
        image(place / "d" / f"{k}{suffix}", frame)
    return process("d")


case(PIXELS, "image of another size in a folder", lambda p: folder(p, picture(rows=20)), "1.png",
     "20 x 64", "remove or crop the odd one")  # fmt: skip
case(PIXELS, "colour image among grey ones", lambda p: folder(p, np.dstack([picture()] * 3)),
     "1.png", "colour", "save all frames alike")  # fmt: skip
case(PIXELS, "deep image among shallow ones",
     lambda p: folder(p, picture().astype(np.uint16) * 257), "1.png", "uint16",
     "save all frames alike")  # fmt: skip
case(PIXELS, "folder without an image",
     after(lambda p: ((p / "d").mkdir(), (p / "d" / "notes.txt").write_text("no image")),
     process("d")), "holds no image", "name a folder with frames")  # fmt: skip


def two_sizes(place: Path, name: str, codec: str, pixels: str) -> list[str]:
    """A video of which the last frames have another size, as by joining two without decoding."""
    import av

    big = video(place / f"big{name}", codec, pixels, count=1)
    small = video(place / f"small{name}", codec, pixels, count=2, rows=32, cols=48)
    with av.open(str(place / name), "w") as out:
        made, tick = None, 0
        for part in (big, small):
            with av.open(str(part)) as given:
                source = given.streams.video[0]
                made = made or out.add_stream_from_template(source)
                for packet in given.demux(source):
                    if packet.size:
                        packet.stream, packet.time_base = made, source.time_base
                        step = round(1 / (10 * float(source.time_base)))
                        packet.pts = packet.dts = tick * step
                        tick += 1
                        out.mux(packet)
    big.unlink()
    small.unlink()
    return process(name)


case(PIXELS, "mjpeg whose frames change size", lambda p: two_sizes(p, "v.avi", "mjpeg", "yuvj420p"),
     "v.avi", "frame 1 is 32 x 48", "remove or crop the odd one")  # fmt: skip
case(PIXELS, "mkv of two joined recordings", lambda p: two_sizes(p, "v.mkv", "mjpeg", "yuvj420p"),
     "v.mkv", "frame 1", "remove or crop")  # fmt: skip


@hostile(PIXELS, "2.mkv", "must be alike")
def recording_in_files_of_two_sizes(place: Path) -> list[str]:
    (place / "d").mkdir()
    video(place / "d" / "1.mkv", count=2)
    video(place / "d" / "2.mkv", count=2, rows=32)
    return process("d")


@hostile(PIXELS, "v.mkv", "has no time", "sliding_speed")
def time_stamps_that_go_backwards_where_distances_are_wanted(place: Path) -> list[str]:
    from hostile.given import CONTACT

    path = video(place / "v.mkv", rows=48, cols=64)
    data = bytearray(path.read_bytes())
    mark = b"\x81" + (200).to_bytes(2, "big")
    assert data.count(mark) == 1
    data[data.find(mark) + 1 : data.find(mark) + 3] = (50).to_bytes(2, "big")
    path.write_bytes(data)
    write_scene(place, CONTACT + "[frames]\nsliding_speed_mm_per_s = 257.7\n")
    return process("v.mkv", "wrong.toml", "--as-stated")


@hostile(PIXELS, "f.tif", "is a video", "name the ones wanted")
def recording_of_a_video_and_an_image(place: Path) -> list[str]:
    (place / "d").mkdir()
    video(place / "d" / "1.mkv", count=2)
    image(place / "d" / "f.tif")
    write_scene(place, PLAIN)
    return process("d")
