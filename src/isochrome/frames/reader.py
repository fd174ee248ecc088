"""One reader for TIFF stacks, images, folders of images and videos."""

from __future__ import annotations

import weakref
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.frames.source import Kind, RawFrame, Source
from isochrome.scene import Roi

Mask = NDArray[np.bool_]
Channel = Literal["red", "green", "blue", "mean"]
CHANNELS = ("red", "green", "blue")
FramesPath = str | Path | Sequence[str | Path]


@dataclass(frozen=True)
class Frame:
    """One captured frame: `image` (row, col) of the region of interest, in raw grey levels.

    `index` counts from 0; `time_s` since the start where the file knows it; `name` for messages;
    `mask` (row, col), True on the specimen, None where nobody has said where it is.
    """

    index: int
    image: np.ndarray
    time_s: float | None
    name: str
    mask: Mask | None = None


class FrameReader:
    """Streams the frames of one source; every iteration starts at the first frame.

    Attributes: `path`; `kind`, 'tiff', 'image', 'folder', 'list' or 'video'; `shape` (rows, cols)
    of what it yields and `full_shape` before the region of interest; `dtype`; `bit_depth` of the
    sensor (None for float frames, fractions of full scale then); `channel` taken of a colour
    source (None for grey); `pixel_mm` that the file names, or None; `names` where each frame has
    a file; `claimed_count`, what a video's head claims, not to be trusted; `mask` (rows, cols),
    True on the specimen, which every frame carries, None where none was given. It holds no open
    file between iterations, so that it may be handed to other processes.
    """

    def __init__(
        self,
        source: Source,
        *,
        path: FramesPath,
        channel: Channel | None,
        roi: Roi | None,
        bit_depth: int | None,
        mask: Mask | None = None,
    ) -> None:
        self.path = path
        self.kind: Kind = source.kind
        self.full_shape = source.shape
        self.channel = channel if source.channels == 3 else None
        self.roi = roi
        self.shape = source.shape if roi is None else (roi.height_px, roi.width_px)
        self.dtype = np.dtype(np.float32) if self.channel == "mean" else source.dtype
        self.bit_depth = bit_depth
        self.pixel_mm = source.pixel_mm
        self.names = source.names
        self.claimed_count = source.claimed
        self.mask = mask
        self._source = source
        self._running: weakref.WeakSet[Generator[Frame]] = weakref.WeakSet()

    def __iter__(self) -> Iterator[Frame]:
        """Frames from the first to the last; raises InputError that names a bad one."""
        running = self._read()
        self._running.add(running)
        return running

    def _read(self) -> Generator[Frame]:
        for index, raw in enumerate(self._source.frames()):
            yield Frame(index, self._prepare(raw, index), raw.time_s, raw.name, self.mask)

    def _prepare(self, raw: RawFrame, index: int) -> np.ndarray:
        image = raw.image
        if self.roi is not None:
            top, left = self.roi.top_px, self.roi.left_px
            image = image[top : top + self.shape[0], left : left + self.shape[1]]
        if image.ndim == 3:
            if self.channel == "mean":
                image = image.mean(axis=2, dtype=np.float32)
            else:
                image = image[..., CHANNELS.index(self.channel or "green")]
        _check_range(image, self.bit_depth, f"frame {index} ({raw.name})")
        return np.ascontiguousarray(image)

    def count(self) -> int:
        """Number of frames; a video is decoded to its end for it, its head is not believed."""
        if self._source.count is not None:
            return self._source.count
        return sum(1 for _ in self._source.frames())

    def __enter__(self) -> FrameReader:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the iterations under way, and with them the files they hold open."""
        for running in list(self._running):
            running.close()

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k != "_running"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _running=weakref.WeakSet())


def _check_range(image: np.ndarray, bit_depth: int | None, label: str) -> None:
    """Refuse values that a sensor of this bit depth cannot give."""
    if bit_depth is None or (image.dtype.kind == "u" and bit_depth >= 8 * image.dtype.itemsize):
        return
    top = np.fmax.reduce(image, axis=None)
    if top > 2**bit_depth - 1:
        raise InputError(
            f"{label}: holds the value {top:g}, and {bit_depth} bits end at {2**bit_depth - 1}; "
            "set camera.bit_depth to the sensor's"
        )
