"""What the readers of TIFF, image and video files have in common."""

from __future__ import annotations

import re
import stat
import warnings
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.scene import ArrayFrames

MAX_PIXELS = 200_000_000
"""A frame that claims more pixels is a damaged or hostile file: refused before memory is taken."""

MAX_BYTES = 400_000_000
"""The same for its bytes when decoded: decoders hold some copies of a frame at a time."""

CLOCK_S = 2.0
"""The coarsest clock of a file system (FAT)."""

Kind = Literal["tiff", "image", "folder", "list", "video", "array"]


@dataclass(frozen=True)
class RawFrame:
    """One frame as its file holds it: `image` (row, col) or (row, col, 3) in RGB, native type."""

    image: np.ndarray
    time_s: float | None
    name: str


@dataclass(frozen=True)
class StoredForm:
    """What all frames of a source share: `shape` (rows, cols), `channels` (1 or 3), pixel type."""

    shape: tuple[int, int]
    channels: int
    dtype: np.dtype

    @classmethod
    def of(cls, image: np.ndarray) -> StoredForm:
        """The form of a frame (row, col) or (row, col, 3)."""
        return cls((image.shape[0], image.shape[1]), 1 if image.ndim == 2 else 3, image.dtype)

    def check(self, path: str | Path, image: np.ndarray, what: str) -> None:
        """Refuse a frame unlike the first. Raises InputError that says `what` it is, and how."""
        other = StoredForm.of(image)
        if other.shape != self.shape:
            raise InputError(
                message(
                    "pixels_rows_columns_first",
                    path=path,
                    what=what,
                    shape=other.shape[0],
                    shape_2=other.shape[1],
                    shape_3=self.shape[0],
                    shape_4=self.shape[1],
                )
            )
        if other != self:
            raise InputError(
                message(
                    "holds_pixels_first_ones",
                    path=path,
                    what=what,
                    pixels=other.pixels,
                    pixels_2=self.pixels,
                )
            )

    @property
    def pixels(self) -> str:
        """The kind of pixels in words."""
        return f"{'grey' if self.channels == 1 else 'colour'} {self.dtype}"


@dataclass(frozen=True)
class Extent:
    """How long a source is: `count` of frames, and `end_s`, when one more frame would have come.

    `end_s` counts from the first frame's time, and is None where the file tells no times.
    """

    count: int
    end_s: float | None = None


def next_time(before_s: float | None, last_s: float | None) -> float | None:
    """When one more frame would come after the last two (s); None where a time is not known."""
    return None if before_s is None or last_s is None else last_s + (last_s - before_s)


@dataclass(frozen=True, kw_only=True)
class Source:
    """What the head of a file tells, and how to read its frames."""

    kind: Kind
    form: StoredForm  # of the full frames
    sensor_bits: int | None  # as the file names them
    # from a number to the last, in order; opens the file anew, so that no two readers share one
    frames: Callable[[int], Generator[RawFrame]]
    extent: Callable[[], Extent]  # certain: decodes where heads are not to be trusted
    files: tuple[Path | ArrayFrames, ...]  # all that are read
    names: tuple[str, ...] = ()  # of each frame where each has a file
    pixel_mm: float | None = None
    claimed: int | None = None  # what an untrustworthy head says
    lossy: bool = False  # a video's codec may lose noise
    start_s: float | None = None  # the first frame's own time stamp, from which times count
    # `extent` by packets in place of frames, which are held against it when they are read (None:
    # they cannot be)
    listed: Callable[[], Extent] | None = None
    # the frame that decoding begins with to come to one (None: a video's first, else that one
    # itself)
    begins: Callable[[int], int] | None = None

    def first_decoded(self, start: int) -> int:
        """The frame that decoding begins with to come to frame `start`."""
        if self.begins is not None:
            return self.begins(start)
        return 0 if self.kind == "video" else start


def turned(source: Source, rotate_deg: int, flip: str | None) -> Source:
    """A source whose pictures are turned, then mirrored, before anyone looks at them.

    Quarter turns, counter-clockwise as the picture is seen. Colours are decoded before, so that a
    turn leaves each pixel its own.
    """
    if rotate_deg not in (0, 90, 180, 270):
        raise InputError(message("rotate_deg_no_quarter_turn", rotate_deg=rotate_deg))
    if flip not in (None, "horizontal", "vertical"):
        raise InputError(message("flip_not_known_give", flip=flip))
    if not rotate_deg and flip is None:
        return source
    rows, cols = source.form.shape
    shape = (cols, rows) if rotate_deg in (90, 270) else (rows, cols)
    frames = partial(_turned_frames, source, int(rotate_deg), flip)
    return replace(source, form=replace(source.form, shape=shape), frames=frames)


def _turned_frames(
    source: Source, rotate_deg: int, flip: str | None, start: int
) -> Generator[RawFrame]:
    with closing(source.frames(start)) as frames:
        for raw in frames:
            yield replace(raw, image=np.ascontiguousarray(as_turned(raw.image, rotate_deg, flip)))


def _mirrored(image: np.ndarray, flip: str | None) -> np.ndarray:
    return image if flip is None else image[:, ::-1] if flip == "horizontal" else image[::-1]


def as_turned(image: np.ndarray, rotate_deg: int, flip: str | None) -> np.ndarray:
    """A view of a picture (row, col[, channel]) turned by quarter turns, counter-clockwise, then
    mirrored.
    """
    return _mirrored(np.rot90(image, rotate_deg // 90), flip)


def as_captured(image: np.ndarray, rotate_deg: int, flip: str | None) -> np.ndarray:
    """A turned, then mirrored picture as the camera saw it."""
    return np.ascontiguousarray(np.rot90(_mirrored(image, flip), -(rotate_deg // 90)))


@dataclass(frozen=True)
class Stamp:
    """Size (bytes) and time of the last change (s) of a file, to see whether it stays as it was."""

    size: int
    changed_s: float

    @classmethod
    def of(cls, path: Path) -> Stamp:
        """A file's stamp now. Raises InputError where it is missing, empty, or no plain file."""
        try:
            status = path.stat()
        except FileNotFoundError as error:
            raise InputError(message("no_such_file_check", path=path)) from error
        except (OSError, ValueError) as error:
            raise InputError(message("cannot_read_check_name_2", path=path, error=error)) from error
        if not stat.S_ISREG(status.st_mode):
            raise InputError(message("not_file_name_file", path=path))
        if status.st_size == 0:
            raise InputError(message("empty_bytes_copy_again", path=path))
        return cls(status.st_size, status.st_mtime)

    def check(self, path: Path) -> None:
        """Refuse a file that is no longer what it was, as one being recorded. Raises InputError."""
        now = Stamp.of(path)
        if now.size != self.size or abs(now.changed_s - self.changed_s) > CLOCK_S:
            raise InputError(
                message("changed_while_read_bytes", path=path, size=self.size, size_2=now.size)
            )


@contextmanager
def refusing(path: str | Path, what: str = "cannot be read") -> Iterator[None]:
    """Turn whatever a decoding library raises into one InputError that names the file and
    `what`.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except InputError:
        raise
    except Exception as error:  # decoders raise nearly everything on a damaged file
        reason = (str(error).splitlines() or [""])[0].strip()[:160] or type(error).__name__
        raise InputError(
            message("check_file_save_again", path=path, what=what, reason=reason)
        ) from error


def check_size(path: str | Path, rows: int, cols: int, pixel_bytes: int = 1) -> None:
    """Refuse a frame whose head claims no pixels, or too many, before memory is taken for it."""
    if rows <= 0 or cols <= 0 or rows * cols > MAX_PIXELS:
        raise InputError(
            message(
                "claims_frame_pixels_pixels", path=path, rows=rows, cols=cols, max_pixels=MAX_PIXELS
            )
        )
    if rows * cols * pixel_bytes > MAX_BYTES:
        raise InputError(
            message(
                "claims_frame_pixels_bytes",
                path=path,
                rows=rows,
                cols=cols,
                pixel_bytes=pixel_bytes,
                max_bytes=MAX_BYTES,
            )
        )


def check_aspect(path: str | Path, across: float, down: float) -> None:
    """Refuse a video whose pixels are `across` to `down`, not square. Raises InputError."""
    if min(across, down) > 0 and across != down:
        raise InputError(message("says_pixels_not_square", path=path, across=across, down=down))


def check_dtype(path: str | Path, dtype: np.dtype) -> np.dtype:
    """The pixel type in native byte order; InputError where it is not 8, 16 bit or float."""
    native = dtype.newbyteorder("=")
    if native.name not in ("uint8", "uint16", "float16", "float32", "float64"):
        raise InputError(message("pixels_type_not_read", path=path, name=native.name))
    return native


def natural_key(name: str | Path) -> tuple[list[str | int], str]:
    """A sorting key that puts frame2 before frame10: runs of digits count as numbers."""
    text = str(name)
    parts = re.split(r"([0-9]+)", text.lower())
    return [int(p) if i % 2 else p for i, p in enumerate(parts)], text
