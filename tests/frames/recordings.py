"""Recordings of every kind, each frame with its number as a bar code."""

import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

COUNT, ROWS, BITS, BAR = 40, 96, 6, 32
COLS = BITS * BAR
RATE = 20
EVEN = tuple(i / RATE for i in range(COUNT))
UNEVEN = tuple((50 * i + i * i % 37) / 1000 for i in range(COUNT))
"""Times of a camera that is triggered by hand, more or less; in whole milliseconds."""


def coded(number: int, full: float = 255) -> np.ndarray:
    """The frame of a number, (row, col), 0.2 or 0.75 of `full`."""
    bars = [0.75 * full if number >> bit & 1 else 0.2 * full for bit in range(BITS)]
    frame = np.repeat(np.repeat(np.array(bars)[None], ROWS, 0), BAR, 1)
    frame[: ROWS // 4] *= 0.5
    return np.rint(frame) if full > 1 else frame


def decoded(image: np.ndarray, full: float = 255) -> int:
    """The number of a frame, by the middles of its bars."""
    bars = image[ROWS // 2 :].astype(float).mean(axis=0).reshape(BITS, BAR)[:, 8:-8].mean(axis=1)
    return sum(int(b > 0.475 * full) << bit for bit, b in enumerate(bars))


def stack(dtype: Any = np.uint8, full: float = 255, numbers: Iterable[int] = range(COUNT)):
    """Frames (frame, row, col) of some numbers."""
    return np.stack([coded(i, full) for i in numbers]).astype(dtype)


@dataclass(frozen=True)
class Recording:
    """How to write one, and what must be read: `bits` (None: float), exact values, times (s)."""

    write: Callable[[Path], Any]
    kind: str
    bits: int | None = 8
    exact: bool = True
    times: tuple[float, ...] | None = None
    pixel_mm: float | None = None


def video(
    path: Path,
    codec: str,
    pixels: str,
    *,
    times: tuple[float, ...] = EVEN,
    options: dict[str, str] | None = None,
    bits: int = 8,
    numbers: Iterable[int] = range(COUNT),
    image: Callable[[int], np.ndarray] | None = None,
) -> Path:
    """Write a video by PyAV, with a key frame every eight; skips where it cannot be written."""
    import av

    even = times == EVEN
    base = Fraction(1, RATE) if even else Fraction(1, 1000)
    with av.open(str(path), "w") as container:
        try:
            stream = container.add_stream(codec, rate=RATE, options={"g": "8"} | (options or {}))
        except (ValueError, av.FFmpegError) as error:
            pytest.skip(f"cannot write {codec} here: {error}")
        stream.width, stream.height, stream.pix_fmt = COLS, ROWS, pixels
        stream.codec_context.time_base = base
        for i, number in enumerate(numbers):
            frame = _frame(av, coded(number, 2**bits - 1) if image is None else image(number),
                           pixels, bits)  # fmt: skip
            frame.pts, frame.time_base = (i if even else round(1000 * times[i])), base
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def _frame(av: Any, grey: np.ndarray, pixels: str, bits: int) -> Any:
    """Grey levels as a frame of a pixel format, by hand where FFmpeg's own way is not exact."""
    dtype = np.uint8 if bits <= 8 else np.uint16
    if pixels.startswith(("gray", "gbrp", "yuv")):
        frame = av.VideoFrame(grey.shape[1], grey.shape[0], pixels)
        for number, plane in enumerate(frame.planes):
            full = pixels.startswith(("gray", "gbrp", "yuvj"))
            if (number and not full) or (number and pixels.startswith("yuvj")):
                values = np.full((plane.height, plane.width), 1 << (bits - 1))
            elif full:
                values = grey
            else:
                values = np.rint(grey * (219 << (bits - 8)) / (2**bits - 1)) + (16 << (bits - 8))
            rows = np.zeros((plane.height, plane.line_size), np.uint8)
            data = np.ascontiguousarray(values.astype(dtype)).view(np.uint8)
            rows[:, : data.shape[1]] = data
            plane.update(rows.tobytes())
        return frame
    frame = av.VideoFrame.from_ndarray(np.dstack([grey.astype(np.uint8)] * 3), format="rgb24")
    return frame.reformat(format=pixels)


def written(name: str, codec: str, pixels: str, **how: Any) -> Callable[[Path], Path]:
    """A function that writes a video of this name into a folder."""
    return lambda folder: video(folder / name, codec, pixels, **how)


def tiff(**how: Any) -> Callable[[Path], Path]:
    """A function that writes a stack by tifffile."""
    dtype, full = how.pop("dtype", np.uint8), how.pop("full", 255)
    data = lambda: stack(dtype, full)  # noqa: E731

    def write(folder: Path) -> Path:
        tifffile.imwrite(folder / "s.tif", data(), **({"photometric": "minisblack"} | how))
        return folder / "s.tif"

    return write


def tiff_by_pillow(compression: str, dtype: Any = np.uint8, full: int = 255):
    def write(folder: Path) -> Path:
        pages = [Image.fromarray(frame) for frame in stack(dtype, full)]
        pages[0].save(
            folder / "s.tif", save_all=True, append_images=pages[1:], compression=compression
        )
        return folder / "s.tif"

    return write


def ome(**notes: Any) -> Callable[[Path], Path]:
    return tiff(ome=True, metadata={"axes": "TYX", **notes})


def ome_in_disorder(folder: Path) -> Path:
    """Pages written backwards, with notes that say which is which."""
    path, n = folder / "s.ome.tif", COUNT
    places = "".join(f'<TiffData FirstT="{i}" IFD="{n - 1 - i}" PlaneCount="1"/>' for i in range(n))
    notes = (
        '<?xml version="1.0" encoding="UTF-8"?><OME xmlns="http://www.openmicroscopy.org/Schemas/'
        'OME/2016-06"><Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYZCT" '
        f'Type="uint8" SizeX="{COLS}" SizeY="{ROWS}" SizeC="1" SizeZ="1" SizeT="{n}">'
        f'<Channel ID="Channel:0:0" SamplesPerPixel="1"/>{places}</Pixels></Image></OME>'
    )
    with tifffile.TiffWriter(path) as tif:
        for k, frame in enumerate(stack()[::-1]):
            tif.write(frame, description=notes if k == 0 else None, metadata=None)
    return path


def packed_tiff(bits: int, fill: int = 1) -> Callable[[Path], Path]:
    """Pixels of 10 or 12 bits one behind the other, as some cameras write them.
    `fill`, what the head says of the order of bits in a byte: 1, the highest first; 2, the lowest.
    """

    def write(folder: Path) -> Path:
        body, heads, place = bytearray(b"II*\0\0\0\0\0"), [], 0
        for frame in stack(np.uint16, 2**bits - 1):
            single = (frame[..., None] >> np.arange(bits - 1, -1, -1)) & 1
            data = np.packbits(single.reshape(ROWS, -1).astype(np.uint8), axis=1).tobytes()
            heads.append((len(body), len(data)))
            body += data
        place = 4
        for start, size in heads:
            body[place : place + 4] = struct.pack("<I", len(body))
            tags = [(256, COLS), (257, ROWS), (258, bits), (259, 1), (262, 1), (266, fill),
                    (273, start), (277, 1), (278, ROWS), (279, size)]  # fmt: skip
            body += struct.pack("<H", len(tags))
            for tag, value in tags:
                body += struct.pack("<HHII", tag, 4, 1, value)
            place = len(body)
            body += bytes(4)
        (folder / "s.tif").write_bytes(body)
        return folder / "s.tif"

    return write


def images(suffix: str, dtype: Any = np.uint8, full: int = 255, colour: bool = False):
    def write(folder: Path) -> Path:
        for i, frame in enumerate(stack(dtype, full)):
            name = folder / f"frame{i}{suffix}"
            if suffix == ".tif":
                tifffile.imwrite(name, frame)
            else:
                assert cv2.imwrite(str(name), np.dstack([frame] * 3) if colour else frame)
        return folder

    return write


def image_list(folder: Path) -> list[Path]:
    images(".bmp")(folder)
    return [folder / f"frame{i}.bmp" for i in range(COUNT)]


def glob_of_images(folder: Path) -> str:
    images(".png")(folder)
    return str(folder / "frame*.png")


def opencv_mjpg(folder: Path) -> Path:
    writer = cv2.VideoWriter(
        str(folder / "v.avi"), cv2.VideoWriter_fourcc(*"MJPG"), float(RATE), (COLS, ROWS)
    )
    for frame in stack():
        writer.write(np.dstack([frame] * 3))
    writer.release()
    return folder / "v.avi"


CUTS = ((0, 3), (3, 17), (17, COUNT))
"""Frames [start, stop) of the files of one recording, part-2, part-9 and part-10."""


def video_parts(suffix: str, codec: str, pixels: str, as_glob: bool, bits: int = 8):
    def write(folder: Path) -> Any:
        for number, (a, b) in zip((2, 9, 10), CUTS, strict=True):
            video(folder / f"part-{number}{suffix}", codec, pixels, numbers=range(a, b), bits=bits)
        return str(folder / f"part-*{suffix}") if as_glob else folder

    return write


def tiff_parts(folder: Path) -> Path:
    for number, (a, b) in zip((2, 9, 10), CUTS, strict=True):
        tifffile.imwrite(
            folder / f"part-{number}.tif", stack(numbers=range(a, b)), imagej=True,
            metadata={"axes": "TYX", "finterval": 0.05},
        )  # fmt: skip
    return folder


_IMAGEJ = {"axes": "TYX", "finterval": 0.05, "unit": "um"}
_12 = {"dtype": np.uint16, "full": 4095}
_16 = {"dtype": np.uint16, "full": 65535}
_QUIET = {"x265-params": "log-level=none"}

STILL = {
    "ImageJ": Recording(
        tiff(imagej=True, metadata=_IMAGEJ, resolution=(1 / 6.07, 1 / 6.07)), "tiff",
        times=EVEN, pixel_mm=0.00607,
    ),
    "ImageJ 16 bit in milliseconds": Recording(
        tiff(imagej=True, metadata={"axes": "TYX", "finterval": 50, "tunit": "ms"}, **_16), "tiff",
        bits=16, times=EVEN,
    ),
    "ImageJ, one head": Recording(tiff(imagej=True, truncate=True), "tiff"),
    "tifffile, one head": Recording(tiff(truncate=True), "tiff"),
    "plain pages": Recording(tiff(metadata=None), "tiff"),
    "16 bit, big-endian": Recording(tiff(byteorder=">", **_16), "tiff", bits=16),
    "float": Recording(tiff(dtype=np.float32, full=1), "tiff", bits=None),
    "BigTIFF": Recording(tiff(bigtiff=True, **_16), "tiff", bits=16),
    "tiled": Recording(tiff(tile=(32, 48)), "tiff"),
    "tiled deflate": Recording(tiff(tile=(32, 48), compression="zlib", **_16), "tiff", bits=16),
    "deflate": Recording(tiff(compression="zlib"), "tiff"),
    "deflate, predictor": Recording(tiff(compression="zlib", predictor=True, **_16), "tiff", 16),
    "LZW": Recording(tiff_by_pillow("tiff_lzw"), "tiff"),
    "LZW 16 bit": Recording(tiff_by_pillow("tiff_lzw", np.uint16, 65535), "tiff", bits=16),
    "PackBits": Recording(tiff_by_pillow("packbits"), "tiff"),
    "10 bit packed": Recording(packed_tiff(10), "tiff", bits=10),
    "12 bit packed": Recording(packed_tiff(12), "tiff", bits=12),
    "OME": Recording(
        ome(TimeIncrement=50, TimeIncrementUnit="ms", PhysicalSizeX=6.07, PhysicalSizeY=6.07),
        "tiff", times=EVEN, pixel_mm=0.00607,
    ),
    "OME with each frame's time": Recording(
        ome(Plane={"DeltaT": [3 + t for t in UNEVEN]}, PhysicalSizeX=6.07e-3,
            PhysicalSizeXUnit="mm", PhysicalSizeY=6.07e-3, PhysicalSizeYUnit="mm"),
        "tiff", times=UNEVEN, pixel_mm=0.00607,
    ),
    "OME 12 in 16 bit": Recording(
        tiff(ome=True, metadata={"axes": "TYX", "SignificantBits": 12}, **_12), "tiff", bits=12
    ),
    "OME slices": Recording(tiff(ome=True, metadata={"axes": "ZYX"}), "tiff"),
    "OME in disorder": Recording(ome_in_disorder, "tiff"),
    "folder of PNG": Recording(images(".png"), "folder"),
    "folder of 16-bit RGB PNG": Recording(images(".png", np.uint16, 65535, True), "folder", 16),
    "folder of JPEG": Recording(images(".jpg"), "folder", exact=False),
    "folder of TIFF": Recording(images(".tif", np.uint16, 65535), "folder", 16),
    "list of BMP": Recording(image_list, "list"),
    "glob of PNG": Recording(glob_of_images, "list"),
    "folder of TIFF stacks": Recording(tiff_parts, "tiff", times=EVEN),
}  # fmt: skip


def movie(file: str, codec: str, pixels: str, exact: bool = True, **how: Any) -> Recording:
    """A video of a file's name; `how`, of `video`."""
    times = how.get("times", EVEN)
    made = written(file, codec, pixels, **how)
    return Recording(made, "video", how.get("bits", 8), exact, times)


def movies(suffix: str, codec: str, pixels: str, as_glob: bool, exact: bool = False, bits: int = 8):
    made = video_parts(suffix, codec, pixels, as_glob, bits)
    return Recording(made, "video", bits, exact, EVEN)


YUV, B_FRAMES = "yuv420p", {"bf": "2"}
MOVING = {
    "OpenCV's MJPG in AVI": Recording(opencv_mjpg, "video", exact=False, times=EVEN),
    "MJPG in AVI": movie("v.avi", "mjpeg", "yuvj420p", False),
    "uncompressed grey in AVI": movie("v.avi", "rawvideo", "gray"),
    "uncompressed BGR in AVI": movie("v.avi", "rawvideo", "bgr24"),
    "FFV1 grey": movie("v.mkv", "ffv1", "gray"),
    "FFV1 grey, uneven": movie("v.mkv", "ffv1", "gray", times=UNEVEN),
    "FFV1 10 bit": movie("v.mkv", "ffv1", "gray10le", bits=10),
    "FFV1 12 bit": movie("v.mkv", "ffv1", "gray12le", bits=12),
    "FFV1 16 bit": movie("v.mkv", "ffv1", "gray16le", bits=16),
    "FFV1 16 bit in AVI": movie("v.avi", "ffv1", "gray16le", bits=16),
    "FFV1 RGB": movie("v.mkv", "ffv1", "bgr0"),
    "FFV1 10 bit RGB": movie("v.mkv", "ffv1", "gbrp10le", bits=10),
    "FFV1 YUV": movie("v.mkv", "ffv1", YUV, False),
    "HuffYUV in AVI": movie("v.avi", "huffyuv", "rgb24"),
    "FFVHuff grey in AVI": movie("v.avi", "ffvhuff", "gray"),
    "Ut Video in AVI": movie("v.avi", "utvideo", "gbrp"),
    "PNG in MOV": movie("v.mov", "png", "rgb24"),
    "MPEG-4 in AVI": movie("v.avi", "mpeg4", YUV, False),
    "MPEG-4 with B-frames in AVI": movie("v.avi", "mpeg4", YUV, False, options=B_FRAMES),
    "MPEG-4 with B-frames in MP4": movie("v.mp4", "mpeg4", YUV, False, options=B_FRAMES),
    "MPEG-2 with B-frames": movie("v.mpg", "mpeg2video", YUV, False, options=B_FRAMES),
    "H.264 in MP4": movie("v.mp4", "libx264", YUV, False),
    "H.264 in MP4, uneven": movie("v.mp4", "libx264", YUV, False, times=UNEVEN),
    "H.264 in MKV, uneven": movie("v.mkv", "libx264", YUV, False, times=UNEVEN),
    "H.264 with open groups": movie(
        "v.mkv", "libx264", YUV, False, options={"x264-params": "open-gop=1:bframes=3"}
    ),
    "H.264 with refresh in place of key frames": movie(
        "v.mkv", "libx264", YUV, False, options={"x264-params": "intra-refresh=1"}
    ),
    "H.264 in AVI": movie("v.avi", "libx264", YUV, False),
    "H.264 in a transport stream": movie("v.ts", "libx264", YUV, False),
    "H.264 lossless RGB": movie("v.mkv", "libx264rgb", "rgb24", options={"qp": "0"}),
    "H.264 10 bit": movie("v.mp4", "libx264", "yuv420p10le", False, bits=10),
    "H.265 in MP4": movie("v.mp4", "libx265", YUV, False, options=_QUIET),
    "H.265 12 bit grey": movie("v.mkv", "libx265", "gray12le", False, bits=12, options=_QUIET),
    "VP8": movie("v.webm", "libvpx", YUV, False),
    "VP9, uneven": movie("v.webm", "libvpx-vp9", YUV, False, times=UNEVEN),
    "ProRes": movie("v.mov", "prores_ks", "yuv422p10le", False, bits=10),
    "WMV": movie("v.wmv", "wmv2", YUV, False),
    "glob of MJPG in AVI": movies(".avi", "mjpeg", "yuvj420p", True),
    "glob of H.264 with B-frames in AVI": movies(".avi", "libx264", YUV, True),
    "folder of H.264 in MP4": movies(".mp4", "libx264", YUV, False),
    "folder of FFV1 16 bit": movies(".mkv", "ffv1", "gray16le", False, True, 16),
}
