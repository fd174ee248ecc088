"""Several files as one recording: videos or TIFF stacks, one after the other."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path

from isochrome.errors import InputError
from isochrome.frames.source import Extent, RawFrame, Source, next_time

SCALE = 1e-3
"""Files of one recording name one pixel size; a larger difference than this part is another."""


class Parts:
    """The frames of several files in their order, with times that go on from file to file.

    A file's first frame follows the last of the file before by that one's frame interval, or by its
    own time stamp where this goes on from there, as recorders write that cut one clock into files.
    """

    def __init__(
        self, files: tuple[Path, ...], opener: Callable[[Path], Source], first: Source
    ) -> None:
        """Parameters: `files`, in order; `opener` of one; `first`, the first file's source."""
        self.files, self._opener = files, opener
        self._sources: dict[int, Source] = {0: first}
        self._first = first

    def source(self, number: int) -> Source:
        """The source of a part, opened once; InputError where it is unlike the first."""
        if number not in self._sources:
            path, first = self.files[number], self._first
            found = self._opener(path)
            if found.form != first.form:
                rows, cols = found.form.shape
                raise InputError(
                    f"{path}: holds {rows} x {cols} {found.form.pixels} pixels and "
                    f"{self.files[0].name} {first.form.shape[0]} x {first.form.shape[1]} "
                    f"{first.form.pixels} ones; the files of one recording must be alike"
                )
            if found.sensor_bits != first.sensor_bits:
                raise InputError(
                    f"{path}: holds {found.sensor_bits} bits a pixel and {self.files[0].name} "
                    f"{first.sensor_bits}; the files of one recording must be alike"
                )
            scales = (found.pixel_mm, first.pixel_mm)
            if scales[0] and scales[1] and abs(scales[0] / scales[1] - 1) > SCALE:
                raise InputError(
                    f"{path}: names {scales[0]:.6g} mm a pixel and {self.files[0].name} "
                    f"{scales[1]:.6g}; the files of one recording must have one scale"
                )
            self._sources[number] = found
        return self._sources[number]

    def listed(self) -> Extent:
        """All parts' frames, by their packets where that can be done."""
        for number in range(len(self.files)):
            listed = self.source(number).listed
            if listed is not None:
                listed()
        return self.extent()

    def begins(self, start: int) -> int:
        """The frame that decoding begins with to come to frame `start`, once all are counted."""
        before = 0
        for number in range(len(self.files)):
            source = self.source(number)
            count = source.extent().count
            if start < before + count:
                return before + source.first_decoded(start - before)
            before += count
        return start

    def extent(self) -> Extent:
        """All parts' frames, counted as surely as each of them is."""
        done = Extent(0, 0.0)
        for number in range(len(self.files)):
            begin = self._begin(number, done.end_s)
            done = _after(done, begin, self.source(number).extent())
        return done

    def _begin(self, number: int, end_s: float | None) -> float | None:
        """When a part begins, counted from the first part's first frame, after an end."""
        if number == 0 or end_s is None:
            return end_s
        own, first = self.source(number).start_s, self._first.start_s
        if own is None or first is None:
            return None
        return max(end_s, own - first)

    def frames(self, start: int) -> Generator[RawFrame]:
        """The frames from number `start` on."""
        done = Extent(0, 0.0)
        for number in range(len(self.files)):
            source, before = self.source(number), done.count
            begin = self._begin(number, done.end_s)
            # a video that begins after `start` need not be counted before it is read
            own = source.extent() if start > before or source.kind != "video" else None
            times: deque[float | None] = deque(maxlen=2)
            if own is None or before + own.count > start:
                count = 0
                for raw in source.frames(max(start - before, 0)):
                    count += 1
                    time = None if raw.time_s is None or begin is None else begin + raw.time_s
                    times.append(raw.time_s)
                    yield replace(raw, time_s=time)
                if own is None:
                    own = source.extent() if count == 1 else Extent(count, next_time(*times))
            assert own is not None
            done = _after(done, begin, own)


def _after(done: Extent, begin: float | None, own: Extent) -> Extent:
    """The extent of the parts up to one that begins at a time (s)."""
    end = None if begin is None or own.end_s is None else begin + own.end_s
    return Extent(done.count + own.count, end)


def open_parts(files: tuple[Path, ...], opener: Callable[[Path], Source]) -> Source:
    """Several videos, or several TIFF stacks, as one recording. Returns its Source.

    Parameters: `files` in order; `opener` of one of them. Raises InputError, here for the first
    file, and for a later one when it is come to.
    """
    first = opener(files[0])
    if len(files) == 1:
        return first
    parts = Parts(files, opener, first)
    return replace(
        first,
        frames=parts.frames,
        extent=parts.extent,
        files=files,
        claimed=None,
        names=(),
        listed=parts.listed,
        begins=parts.begins,
    )
