"""One reader for TIFF stacks, images, folders of images and videos."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.frames.source import Kind, RawFrame, Source
from isochrome.messages import message
from isochrome.scene import FramesLike, Roi

Mask = NDArray[np.bool_]
Channel = Literal["red", "green", "blue", "mean"]
CHANNELS = ("red", "green", "blue")
FramesPath = str | Path | Sequence[str | Path]
"""The files of a recording."""
_DARKEST = 0.25
"""How far below zero, in full scales, noise and a subtracted background may take a float frame."""

_FAR = 300
"""Frames that are sooner passed over than left out by opening their file anew."""


@dataclass(frozen=True)
class Frame:
    """One captured frame.

    Parameters
    ----------
    index : int
        Its number, from 0.
    image : ndarray of shape (row, col)
        The region of interest, in raw grey levels.
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


class FrameReader:
    """Streams the frames of one source; every iteration starts at the first frame.

    It holds no open file between iterations, so that it may be handed to other processes, with
    what `count` has learnt of the places of a video's frames.

    Parameters
    ----------
    source : Source
        What the file's head tells, and how to read it.
    path : str, Path, sequence of them or ArrayFrames
        Where the frames are.
    channel : {'red', 'green', 'blue', 'mean'} or None
        Channel to take of a colour source.
    roi : Roi or None
        The part of each frame to yield; None: all of it.
    bit_depth : int or None
        Bits of the sensor; None for float frames, which are fractions of full scale.

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
        roi: Roi | None,
        bit_depth: int | None,
    ) -> None:
        self.path = path
        self.kind: Kind = source.kind
        form = source.form
        self.full_shape = form.shape
        self.channel = channel if form.channels == 3 else None
        self.roi = roi
        self.shape = form.shape if roi is None else (roi.height_px, roi.width_px)
        self.dtype = np.dtype(np.float32) if self.channel == "mean" else form.dtype
        self.bit_depth = bit_depth
        self.pixel_mm = source.pixel_mm
        self.files = source.files
        self.names = source.names
        self.claimed_count = source.claimed
        self.lossy = source.lossy
        self.mask: Mask | None = None
        self._source = source
        self._running: weakref.WeakSet[Generator[Frame]] = weakref.WeakSet()

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
            raise InputError(message("frames_cannot_read_give", start=start, stop=stop))
        running = self._read(start, stop)
        self._running.add(running)
        return running

    def _read(self, start: int, stop: int | None) -> Generator[Frame]:
        if start == stop:
            return
        with closing(self._source.frames(start)) as frames:  # and with them the file
            for index, raw in enumerate(frames, start):
                yield Frame(index, self._prepare(raw, index), raw.time_s, raw.name, self.mask)
                if index + 1 == stop:
                    return
        if stop is not None:
            raise InputError(message("ends_before_frame_changed", path=self.path, stop=stop - 1))

    def _prepare(self, raw: RawFrame, index: int) -> np.ndarray:
        image = raw.image
        if self.roi is not None:
            top, left_px = self.roi.top_px, self.roi.left_px
            image = image[top : top + self.shape[0], left_px : left_px + self.shape[1]]
        if image.ndim == 3:
            if self.channel == "mean":
                image = image.mean(axis=2, dtype=np.float32)
            else:
                image = image[..., CHANNELS.index(self.channel or "green")]
        _check_range(image, self.bit_depth, f"frame {index} ({raw.name})")
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
        return self._source.first_decoded(start)

    def __enter__(self) -> FrameReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the iterations under way, and with them the files they hold open."""
        for running in list(self._running):
            running.close()

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k != "_running"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _running=weakref.WeakSet())


class SequentialFrames:
    """The frames of a reader, asked for by their numbers.

    The file stays open as long as they come in order. It may be handed to other processes and
    shared by threads.
    """

    def __init__(self, reader: FrameReader) -> None:
        self.reader = reader
        self._open = threading.local()

    def __getstate__(self) -> dict[str, Any]:
        return {"reader": self.reader}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["reader"])  # type: ignore[misc]

    def frame(self, index: int) -> Frame:
        """The frame of a number from 0. Raises InputError where it is bad or no longer there."""
        frames: Iterator[Frame] | None = getattr(self._open, "frames", None)
        at: int = getattr(self._open, "at", 0)
        if frames is None or not at <= index <= at + _FAR:
            frames, at = self.reader.iterate(index), index
        for frame in frames:
            at += 1
            if frame.index == index:
                self._open.frames, self._open.at = frames, at
                return frame
        raise InputError(message("breaks_off_after_frames_had", path=self.reader.path, at=at))

    def close(self) -> None:
        """Close the file."""
        self.reader.close()
        self._open = threading.local()


def _check_range(image: np.ndarray, bit_depth: int | None, label: str) -> None:
    """Refuse values that a sensor of this bit depth cannot give."""
    integral = image.dtype.kind == "u"
    values = image if integral else image[np.isfinite(image)]
    full = 1.0 if bit_depth is None else 2.0**bit_depth - 1.0
    if not integral and values.min(initial=0.0) < -_DARKEST * full:
        raise InputError(message("holds_value_light_more", label=label, min=values.min()))
    if bit_depth is None or (integral and bit_depth >= 8 * image.dtype.itemsize):
        return
    top = values.max(initial=0)
    if top > 2**bit_depth - 1:
        raise InputError(
            message(
                "holds_value_bits_end",
                label=label,
                top=top,
                bit_depth=bit_depth,
                bit_depth_2=2**bit_depth - 1,
            )
        )
