"""One reader for TIFF stacks, images, folders of images and videos, and what these share."""

from __future__ import annotations

import re
import stat
import threading
import warnings
import weakref
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError, reason_of
from isochrome.scene import ArrayFrames, FramesLike, Roi

MAX_BYTES: int = 400_000_000
"""A frame that claims more is damaged or hostile: refused before memory is taken for copies."""

MAX_PIXELS: int = MAX_BYTES // 2
"""The same in pixels, of two bytes each at least in what is made of them."""

SAME = 1e-3
"""Part by which two sizes of a pixel, of files or of its sides, may differ and be one."""

CLOCK_S = 2.0
"""The coarsest clock of a file system (FAT)."""

Kind = Literal["tiff", "image", "folder", "list", "video", "array"]


Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Frame:
    """One captured frame.

    Parameters
    ----------
    index : int
        Its number, from 0.
    image : ndarray of shape (row, col)
        The region of interest, in raw grey levels; as its file holds it (row, col[, 3]) until then.
    time_s : float or None
        Time since the start, s, where the file knows it.
    name : str
        Name for messages.
    mask : ndarray of shape (row, col), optional
        True on the specimen; None where nobody has said where it is.
    """

    index: int
    image: np.ndarray
    time_s: float | None
    name: str
    mask: Mask | None = None


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
                "pixels_rows_columns_first", path=path, what=what, shape=other.shape[0],
                shape_2=other.shape[1], shape_3=self.shape[0], shape_4=self.shape[1],
            )  # fmt: skip
        if other != self:
            raise InputError(
                "holds_pixels_first_ones",
                path=path, what=what, pixels=other.pixels, pixels_2=self.pixels,
            )  # fmt: skip

    @property
    def pixels(self) -> str:
        """The kind of pixels in words."""
        return f"{'grey' if self.channels == 1 else 'colour'} {self.dtype}"


@dataclass(frozen=True)
class Extent:
    """How long a source is: its frames, and when one more would have come (s; None: no times)."""

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
    frames: Callable[[int], Generator[Frame]]
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
    # the frame that decoding begins with to come to one: by default that one itself
    begins: Callable[[int], int] = int


_MIRRORED: dict[str | None, Callable[[np.ndarray], np.ndarray]] = {
    None: np.asarray, "vertical": np.flipud, "horizontal": np.fliplr,
}  # fmt: skip


def as_turned(image: np.ndarray, rotate_deg: int, flip: str | None) -> np.ndarray:
    """A view of a picture (row, col[, channel]) turned counter-clockwise, then mirrored."""
    return _MIRRORED[flip](np.rot90(image, rotate_deg // 90))


def as_captured(image: np.ndarray, rotate_deg: int, flip: str | None) -> np.ndarray:
    """A turned, then mirrored picture as the camera saw it."""
    return np.ascontiguousarray(np.rot90(_MIRRORED[flip](image), -(rotate_deg // 90)))


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
            raise InputError("no_such_file_check", path=path) from error
        except (OSError, ValueError) as error:
            raise InputError("cannot_read_check_name_2", path=path, error=error) from error
        if not stat.S_ISREG(status.st_mode):
            raise InputError("not_file_name_file", path=path)
        if status.st_size == 0:
            raise InputError("empty_bytes_copy_again", path=path)
        return cls(status.st_size, status.st_mtime)

    def check(self, path: Path) -> None:
        """Refuse a file that is no longer what it was, as one being recorded. Raises InputError."""
        now = Stamp.of(path)
        if now.size != self.size or abs(now.changed_s - self.changed_s) > CLOCK_S:
            raise InputError("changed_while_read_bytes", path=path, size=self.size, size_2=now.size)


@contextmanager
def refusing(path: str | Path, what: str = "cannot be read") -> Iterator[None]:
    """Turn whatever a decoding library raises into one InputError of the file and `what`."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except InputError:
        raise
    except Exception as error:  # decoders raise nearly everything on a damaged file
        raise InputError(
            "check_file_save_again", path=path, what=what, reason=reason_of(error)
        ) from error


def check_size(path: str | Path, rows: int, cols: int, pixel_bytes: int = 1) -> None:
    """Refuse a frame whose head claims no pixels, or too many, before memory is taken for it."""
    if rows <= 0 or cols <= 0 or rows * cols * max(pixel_bytes, 2) > MAX_BYTES:
        raise InputError(
            "claims_frame_pixels_bytes", path=path, rows=rows, cols=cols, pixel_bytes=pixel_bytes,
            max_bytes=MAX_BYTES,
        )  # fmt: skip


def check_dtype(path: str | Path, dtype: np.dtype) -> np.dtype:
    """The pixel type in native byte order; InputError where it is not 8, 16 bit or float."""
    native = dtype.newbyteorder("=")
    if native.name not in ("uint8", "uint16", "float16", "float32", "float64"):
        raise InputError("pixels_type_not_read", path=path, name=native.name)
    return native


def as_grey_or_rgb(path: str | Path, raw: np.ndarray) -> np.ndarray:
    """Pixels (row, col) or (row, col, 3), without transparency, of a type that is read."""
    if raw.ndim == 3:
        raw = raw[..., 0] if raw.shape[2] < 3 else raw[..., :3]
    return np.ascontiguousarray(raw, dtype=check_dtype(path, raw.dtype))


def natural_key(name: str | Path) -> tuple[list[str | int], str]:
    """A sorting key that puts frame2 before frame10: runs of digits count as numbers."""
    text = str(name)
    parts = re.split(r"([0-9]+)", text.lower())
    return [int(p) if i % 2 else p for i, p in enumerate(parts)], text


Channel = Literal["red", "green", "blue", "mean"]
CHANNELS = ("red", "green", "blue")
FramesPath = str | Path | Sequence[str | Path]
"""The files of a recording."""
_DARKEST = 0.25
"""How far below zero, in full scales, noise and a subtracted background may take a float frame."""


class FrameReader:
    """Streams the frames of one source; every iteration starts at the first frame.

    It holds no open file between iterations, so that it may be handed to other processes, with
    what `count` has learnt of the places of a video's frames.

    Attributes
    ----------
    path : str, Path, sequence of them or ArrayFrames
        Where the frames are.
    kind : {'tiff', 'image', 'folder', 'list', 'video', 'array'}
        What they are read from.
    shape : tuple of int
        Size of what it yields, (rows, cols).
    full_shape : tuple of int
        Size before the region of interest, (rows, cols).
    dtype : dtype
        Type of the pixels.
    bit_depth : int or None
        Bits of the sensor.
    channel : {'red', 'green', 'blue', 'mean'} or None
        Channel taken of a colour source; None for grey.
    pixel_mm : float or None
        Side of a pixel that the file names, mm.
    files : tuple of Path or ArrayFrames
        All files that are read, in order.
    names : tuple of str
        Name of each frame, where each has a file.
    claimed_count : int or None
        Number of frames that a video's head claims, not to be trusted.
    lossy : bool
        Whether a video's codec may lose the camera's noise.
    mask : ndarray of shape (row, col) or None
        True on the specimen, which every frame carries; None where none was given.
    """

    def __init__(
        self,
        source: Source,
        *,
        path: FramesLike,
        channel: Channel | None,
        turn: tuple[int, str | None],
        roi: Roi | None,
        bit_depth: int | None,
    ) -> None:
        """`turn`, quarter turns (degrees) and mirroring; `roi`, the part of the turned picture."""
        form, self.kind = source.form, source.kind
        self.path, self.roi, self.bit_depth, self._turn = path, roi, bit_depth, turn
        rows, cols = form.shape
        self.full_shape = (cols, rows) if turn[0] in (90, 270) else (rows, cols)
        self.channel = channel if form.channels == 3 else None
        self.shape = self.full_shape if roi is None else (roi.height_px, roi.width_px)
        self.dtype = np.dtype(np.float32) if self.channel == "mean" else form.dtype
        self.pixel_mm, self.files, self.names = source.pixel_mm, source.files, source.names
        self.claimed_count, self.lossy = source.claimed, source.lossy
        self.mask: Mask | None = None
        self._source = source
        self.__setstate__({})

    def __iter__(self) -> Iterator[Frame]:
        """Frames from the first to the last; raises InputError that names a bad one."""
        return self.iterate()

    def iterate(self, start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        """Frames `start` to `stop` - 1 in order, the very same that a whole iteration gives.

        What it costs to come to `start`: nothing for TIFF stacks and images, one page being found
        as fast as another. In a video, all frames before it are decoded (not converted); after
        `count`, those since the last key frame only. Of several files, after `count`,
        only the one that holds `start` is opened. Memory: one frame, and what the codec keeps.

        Parameters: `start`, `stop` (None: to the end), frame numbers from 0. Returns an iterator,
        which raises InputError that names a bad frame, or where the source ends before `stop`.
        """
        if start < 0 or (stop is not None and stop < start):
            raise InputError("frames_cannot_read_give", start=start, stop=stop)
        running = self._read(start, stop)
        self._running.add(running)
        return running

    def frame(self, index: int) -> Frame:
        """The frame of a number from 0; the file stays open as long as they come in order.

        The next one is read by a thread meanwhile. Threads may share a reader. Raises InputError
        where it is bad or no longer there.
        """
        state, self._open.state = getattr(self._open, "state", None), None
        # some are passed over where no fewer had to be decoded to come to it anew
        if state and self.first_decoded(index) <= state[1] <= index:
            frames = state[0]
        else:
            del state  # its file is closed before another is opened
            frames = self._ahead(index)
            self._running.add(frames)
        frame: Frame | None = next((one for one in frames if one.index == index), None)
        if frame is None:
            raise InputError("breaks_off_after_frames_had", path=self.path, at=index)
        self._open.state = frames, index + 1
        return frame

    def _ahead(self, start: int) -> Generator[Frame]:
        """Frames from `start` on, the next read by a thread meanwhile; its end closes the file."""
        frames, thread = self._read(start, None), ThreadPoolExecutor(1)
        try:
            coming = thread.submit(_next, frames)
            while (frame := coming.result()) is not None:
                coming = thread.submit(_next, frames)
                yield frame
        finally:
            thread.shutdown(wait=True, cancel_futures=True)
            frames.close()

    def _read(self, start: int, stop: int | None) -> Generator[Frame]:
        if start == stop:
            return
        with closing(self._source.frames(start)) as frames:  # and with them the file
            for frame in frames:
                yield replace(frame, image=self._prepare(frame), mask=self.mask)
                if frame.index + 1 == stop:
                    return
        if stop is not None:
            raise InputError("ends_before_frame_changed", path=self.path, stop=stop - 1)

    def _prepare(self, frame: Frame) -> np.ndarray:
        """A frame turned, cut and of one channel; values that no such sensor gives are refused."""
        image = as_turned(frame.image, *self._turn)
        if self.roi is not None:
            top, left_px = self.roi.top_px, self.roi.left_px
            image = image[top : top + self.shape[0], left_px : left_px + self.shape[1]]
        if image.ndim == 3:
            if self.channel == "mean":
                image = image.mean(axis=2, dtype=np.float32)
            else:
                image = image[..., CHANNELS.index(self.channel or "green")]
        label, bits = f"frame {frame.index} ({frame.name})", self.bit_depth
        integral, full = image.dtype.kind == "u", 1.0 if bits is None else 2.0**bits - 1.0
        values = image if integral else image[np.isfinite(image)]
        if not integral and values.min(initial=0.0) < -_DARKEST * full:
            raise InputError("holds_value_light_more", label=label, min=values.min())
        # a type of as many bits holds no larger value, and need not be searched
        searched = bits is not None and not (integral and bits >= 8 * image.dtype.itemsize)
        if searched and (top := values.max(initial=0)) > full:
            raise InputError(
                "holds_value_bits_end", label=label, top=top, bit_depth=bits, bit_depth_2=int(full)
            )
        return np.ascontiguousarray(image)

    def count(self, *, decode: bool = True) -> int:
        """Number of frames; a video is decoded to its end for it, its head is not believed.

        `decode`, False to count a video's packets where each of them is a frame (FFV1, MJPG,
        uncompressed and the like; H.264 without fields in MP4 or Matroska): a damaged one then
        shows when it is read, and so does one that is no frame, or two. Raises InputError.
        """
        listed = None if decode else self._source.listed
        return (listed or self._source.extent)().count

    def first_decoded(self, start: int) -> int:
        """The frame that decoding begins with to come to frame `start`, as far as it is known."""
        return self._source.begins(start)

    def __enter__(self) -> FrameReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the iterations under way, and with them the files they hold open."""
        for running in list(self._running):
            running.close()
        self._open = threading.local()

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k not in ("_running", "_open")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        # iterations under way, and of each thread the one that `frame` goes on with
        self._running: weakref.WeakSet[Generator[Frame]] = weakref.WeakSet()
        self._open = threading.local()
        self.__dict__.update(state)


def _next(frames: Iterator[Frame]) -> Frame | None:
    """One frame, None at the end: a StopIteration cannot pass through a Future."""
    return next(frames, None)
