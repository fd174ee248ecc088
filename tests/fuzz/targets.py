"""What is fuzzed: each target takes any bytes, and may only refuse them in one sentence."""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import tifffile
from PIL import Image

from isochrome.calibration import load_set
from isochrome.errors import InputError
from isochrome.frames import open_frames
from isochrome.output import load_roifile, read_roi_mask
from isochrome.scene import dump_scene, load_scene, parse_scene

SAMPLES = Path(__file__).resolve().parents[2] / "sample_images"
ROWS, COLS, COUNT = 32, 48, 6


@dataclass(frozen=True)
class Target:
    """`suffix` of the file that `run` is given; `seeds`, valid files to begin with."""

    suffix: str
    run: Callable[[Path], None]
    seeds: Callable[[], list[bytes]]

    def take(self, data: bytes, path: Path) -> str | None:
        """Run on some bytes at a path; returns the refusal's sentence, None where all was read.
        Anything but an InputError goes through: a finding."""
        path.write_bytes(data)
        try:
            self.run(path)
        except InputError as error:
            sentence = str(error)
            assert sentence and "\n" not in sentence, "a refusal is one line"
            return sentence
        return None


def read_scene(path: Path) -> None:
    scene = load_scene(path)
    again = parse_scene(dump_scene(scene))
    assert again == scene.model_copy(update={"folder": None, "name": again.name})


def read_set(path: Path) -> None:
    load_set(path)


def read_roi(path: Path) -> None:
    mask = read_roi_mask(path, (ROWS, COLS))
    assert mask.shape == (ROWS, COLS)


def read_frames(path: Path) -> None:
    with open_frames(path) as reader:
        frames = [frame for frame, _ in zip(reader, range(60), strict=False)]
        count = reader.count()
        assert count >= len(frames) > 0
        assert all(frame.image.shape == reader.shape for frame in frames)
        again = list(reader.iterate(len(frames) - 1, len(frames)))
        np.testing.assert_array_equal(again[0].image, frames[-1].image)


def picture(number: int, dtype: type = np.uint8) -> np.ndarray:
    row, col = np.mgrid[:ROWS, :COLS]
    full = np.iinfo(dtype).max
    return (full * (0.5 + 0.4 * np.sin(row / 5 + number) * np.cos(col / 7))).astype(dtype)


def made(name: str, write: Callable[[Path], None]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / name)
        return (Path(folder) / name).read_bytes()


def scenes() -> list[bytes]:
    found = [p.read_bytes() for p in sorted(SAMPLES.rglob("scene.toml"))]
    library = Path(__import__("isochrome").__file__).parent / "scene" / "library"
    return found + [p.read_bytes() for p in sorted(library.glob("*.toml"))]


def sets() -> list[bytes]:
    return [p.read_bytes() for p in sorted(SAMPLES.rglob("*.toml")) if b"[[image]]" in
            p.read_bytes()]  # fmt: skip


def rois(zipped: bool) -> list[bytes]:
    roifile = load_roifile()
    points = np.array([[4, 4], [40, 6], [30, 28], [8, 20]], np.float32)
    area = roifile.ImagejRoi.frompoints(points)
    area.roitype = roifile.ROI_TYPE.POLYGON
    square = roifile.ImagejRoi.frompoints(points[:2])
    square.roitype, square.left, square.top, square.right, square.bottom = (
        roifile.ROI_TYPE.OVAL, 3, 4, 30, 20,
    )  # fmt: skip
    if zipped:
        return [made("r.zip", lambda p: roifile.roiwrite(p, [area, square]))]
    return [area.tobytes(), square.tobytes()]


def tiffs() -> list[bytes]:
    stack = np.stack([picture(i) for i in range(COUNT)])
    wide = np.stack([picture(i, np.uint16) for i in range(COUNT)])
    ways = (
        (stack, {"imagej": True, "metadata": {"axes": "TYX", "finterval": 0.1, "unit": "um"}}),
        (stack, {"imagej": True, "truncate": True, "metadata": {"axes": "TYX"}}),
        (wide, {"ome": True, "metadata": {"axes": "TYX", "PhysicalSizeX": 6.0}}),
        (wide, {"compression": "zlib", "predictor": True, "photometric": "minisblack"}),
        (stack, {"tile": (16, 16), "photometric": "minisblack", "bigtiff": True}),
        (np.stack([stack[0]] * 3, axis=-1), {"photometric": "rgb", "resolution": (9, 9)}),
    )
    found = [made("s.tif", partial(tifffile.imwrite, data=data, **how)) for data, how in ways]
    page = Image.fromarray(stack[0])
    found.append(made("s.tif", lambda p: page.save(p, compression="tiff_lzw")))
    return found


def stills(suffix: str) -> list[bytes]:
    grey, wide = Image.fromarray(picture(1)), picture(1, np.uint16)
    found = [made("i" + suffix, grey.save)]
    if suffix == ".png":
        found.append(made("i.png", lambda p: cv2.imwrite(str(p), np.dstack([wide] * 3))))
        found.append(made("i.png", grey.convert("P").save))
    if suffix == ".pgm":
        found.append(b"P5 48 32 4095\n" + (wide >> 4).astype(">u2").tobytes())
    return found


def videos(suffix: str, *codecs: tuple[str, str]) -> list[bytes]:
    import av

    def write(codec: str, pixels: str, path: Path) -> None:
        with av.open(str(path), "w") as container:
            stream = container.add_stream(codec, rate=10, options={"g": "3", "bf": "1"}
                                          if codec in ("libx264", "mpeg4") else {})  # fmt: skip
            stream.width, stream.height, stream.pix_fmt = COLS, ROWS, pixels
            for i in range(COUNT):
                frame = av.VideoFrame.from_ndarray(picture(i), format="gray")
                container.mux(stream.encode(frame.reformat(format=pixels)))
            container.mux(stream.encode(None))

    return [made("v" + suffix, partial(write, *each)) for each in codecs]


TARGETS = {
    "scene": Target(".toml", read_scene, scenes),
    "set": Target(".toml", read_set, sets),
    "roi": Target(".roi", read_roi, partial(rois, False)),
    "zip": Target(".zip", read_roi, partial(rois, True)),
    "tiff": Target(".tif", read_frames, tiffs),
    "png": Target(".png", read_frames, partial(stills, ".png")),
    "jpeg": Target(".jpg", read_frames, partial(stills, ".jpg")),
    "bmp": Target(".bmp", read_frames, partial(stills, ".bmp")),
    "pgm": Target(".pgm", read_frames, partial(stills, ".pgm")),
    "webp": Target(".webp", read_frames, partial(stills, ".webp")),
    "avi": Target(
        ".avi",
        read_frames,
        partial(videos, ".avi", ("mjpeg", "yuvj420p"), ("rawvideo", "gray"), ("mpeg4", "yuv420p"),
                ("ffv1", "gray16le"), ("huffyuv", "rgb24")),
    ),
    "mp4": Target(
        ".mp4", read_frames, partial(videos, ".mp4", ("libx264", "yuv420p"), ("mpeg4", "yuv420p"))
    ),
    "mkv": Target(
        ".mkv",
        read_frames,
        partial(videos, ".mkv", ("ffv1", "gray"), ("ffv1", "gray10le"), ("libx264", "yuv420p")),
    ),
    "mpeg": Target(".mpg", read_frames, partial(videos, ".mpg", ("mpeg2video", "yuv420p"))),
    "wmv": Target(".wmv", read_frames, partial(videos, ".wmv", ("wmv2", "yuv420p"))),
}  # fmt: skip
