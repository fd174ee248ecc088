"""Frames from image files: one, a list, or a folder in natural order."""

from __future__ import annotations

import io
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from isochrome.errors import InputError
from isochrome.frames import tiff
from isochrome.frames.source import (
    Kind,
    RawFrame,
    Source,
    check_dtype,
    check_same,
    check_size,
    natural_key,
    refusing,
)

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".dib", ".pgm", ".ppm", ".pnm", ".webp")
PNG_END = b"IEND\xaeB`\x82"


def open_images(paths: tuple[Path, ...], kind: Kind) -> Source:
    """Read the first of some image files of one size. Returns their Source. Raises InputError."""
    first = read_image(paths[0])
    return Source(
        kind=kind,
        shape=(first.shape[0], first.shape[1]),
        channels=1 if first.ndim == 2 else 3,
        dtype=first.dtype,
        sensor_bits=None,
        frames=partial(_frames, paths),
        names=tuple(p.name for p in paths),
        pixel_mm=None,
        count=len(paths),
    )


def images_in(folder: Path) -> tuple[Path, ...]:
    """The image files of a folder in natural order, hidden ones left out. Raises InputError."""
    with refusing(folder, "the folder cannot be read"):
        found = [p for p in folder.iterdir() if p.is_file() and not p.name.startswith(".")]
    wanted = [p for p in found if p.suffix.lower() in SUFFIXES + tiff.SUFFIXES]
    if not wanted:
        raise InputError(
            f"{folder}: the folder holds no image; images end in "
            f"{', '.join(SUFFIXES + tiff.SUFFIXES)}; name a folder with frames"
        )
    return tuple(sorted(wanted, key=lambda p: natural_key(p.name)))


def _frames(paths: tuple[Path, ...]) -> Iterator[RawFrame]:
    first: np.ndarray | None = None
    for path in paths:
        image = read_image(path)
        first = image if first is None else first
        check_same(path, image, (first.shape[0], first.shape[1]), "the image")
        if image.dtype != first.dtype:
            raise InputError(
                f"{path}: holds {image.dtype} pixels and {paths[0].name} {first.dtype}; save all "
                "frames alike"
            )
        yield RawFrame(image, None, path.name)


def read_image(path: Path) -> np.ndarray:
    """Decode one image file.

    Parameters: `path`. Returns (row, col), or (row, col, 3) in RGB, uint8, uint16 or float;
    transparency is dropped, a palette becomes RGB, and a camera's orientation mark is ignored:
    the pixels stay where the sensor had them. Raises InputError.
    """
    if path.suffix.lower() in tiff.SUFFIXES:
        return tiff.read_single(path)
    with refusing(path, "not a readable image"):
        data = path.read_bytes()
        if not data:
            raise InputError(f"{path}: is empty (0 bytes); copy it again from its source")
        from PIL import Image, UnidentifiedImageError

        try:
            with Image.open(io.BytesIO(data)) as file:
                check_size(path, file.height, file.width)
                # Pillow makes 16-bit colour 8 bits and stretches PGM values: OpenCV does neither.
                deep = file.format == "PNG" and data[24:25] == b"\x10"
                if deep:
                    file.verify()  # checksums to the end: OpenCV would decode a part in silence
                if deep or file.format == "PPM":
                    raw = _by_opencv(path, data)
                else:
                    raw = _by_pillow(path, file)
        except UnidentifiedImageError as error:
            raise InputError(
                f"{path}: is not an image, whatever its name says; check the file"
            ) from error
    return np.ascontiguousarray(raw, dtype=check_dtype(path, raw.dtype))


def _by_pillow(path: Path, file: object) -> np.ndarray:
    from PIL import Image

    assert isinstance(file, Image.Image)
    mode = file.mode
    if mode in ("1", "P", "PA"):
        file = file.convert("L" if mode == "1" else "RGB")
    elif mode not in ("L", "LA", "RGB", "RGBA", "RGBX", "F") and not mode.startswith("I;16"):
        raise InputError(f"{path}: colours of mode {mode} are not read; save it as grey or RGB")
    raw = np.asarray(file)
    if raw.ndim == 3:
        raw = raw[..., 0] if raw.shape[2] < 3 else raw[..., :3]
    return raw


def _by_opencv(path: Path, data: bytes) -> np.ndarray:
    from isochrome.frames.video import quiet_cv2

    if data.startswith(b"\x89PNG") and PNG_END not in data:
        raise InputError(f"{path}: the image breaks off; copy it again from its source")
    cv2 = quiet_cv2()
    raw = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if raw is None:
        raise InputError(f"{path}: the image breaks off or is damaged; copy it again")
    if raw.ndim == 3:
        raw = raw[..., 0] if raw.shape[2] < 3 else raw[..., 2::-1]
    return raw
