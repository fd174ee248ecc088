"""Frames from a video by PyAV, and where each of them is, once all have been decoded."""

from collections.abc import Generator, Iterator
from contextlib import suppress
from itertools import chain
from pathlib import Path

import numpy as np

from isochrome.errors import InputError
from isochrome.frames import reading
from isochrome.frames.containers import (
    Container,
    Decoded,
    Places,
    by_packets,
    check_whole,
    checksum,
    decoded,
    open_container,
    to_image,
)

SUFFIXES = (
    ".avi", ".mp4", ".mkv", ".mov", ".m4v", ".wmv", ".mpg", ".mpeg", ".webm", ".ts", ".mts",
)  # fmt: skip


class Video:
    """One video file; decoded from its start, or from a key frame once its frames are known."""

    def __init__(self, path: Path, stamp: reading.Stamp, container: Container) -> None:
        """`stamp`, the file's when it was opened."""
        self.path, self.stamp, self.container = path, stamp, container
        self.places: Places | None = None
        # of the first frame, which is decoded before any is asked for
        self.form: reading.StoredForm

    def extent(self) -> reading.Extent:
        """Decode all frames once, remember their places, and count them."""
        if self.places is None:
            self.places = self._survey()
        return reading.Extent(len(self.places.times_s), self.places.end_s)

    def listed(self) -> reading.Extent:
        """The same by the packets, without decoding, where each of them is a frame by itself."""
        if self.places is None:
            self.places = by_packets(self.path, self.container)
            self.stamp.check(self.path)
        return self.extent()

    def begins(self, start: int) -> int:
        """The frame that decoding begins with to come to frame `start`."""
        if self.places is None:
            return 0
        keys = self.places.keys[:, 0]
        return int(keys[keys <= start].max(initial=0))

    def frames(self, start: int) -> Generator[reading.RawFrame]:
        """The frames from number `start` on; those before are decoded, but not converted."""
        first, running = self._from_key(start) or (0, self.decoded())
        if self.places is not None and self.places.sums is None:
            running = self._as_listed(self.places.stamps, first, running)
        for index, item in enumerate(running, first):
            if index < start:
                continue
            with reading.refusing(self.path, f"frame {index} cannot be decoded"):
                image = to_image(item.frame, self.path)[0]
                self.form.check(self.path, image, f"frame {index}")
            time = item.time_s
            if self.places is not None:
                times = self.places.times_s
                known = index < len(times) and np.isfinite(times[index])
                time = float(times[index]) if known else None
            yield reading.RawFrame(image, time, f"{self.path.name}[{index}]")
        self.stamp.check(self.path)

    def decoded(self, key: tuple[int, int] | None = None) -> Generator[Decoded]:
        """Every frame in the order of display, from the first or from a key frame's tick on."""
        self.stamp.check(self.path)
        return decoded(self.path, self.container, key)

    def _survey(self) -> Places:
        times, ticks, sums, keys = [], [], [], []
        running: Iterator[Decoded] = self.decoded()
        listed = by_packets(self.path, self.container)
        if listed is not None:  # FFmpeg passes over damaged frames of H.264 in silence
            running = self._as_listed(listed.stamps, 0, running)
        for index, item in enumerate(running):
            if item.frame.key_frame and item.tick is not None:
                keys.append((index, item.tick))
            times.append(np.nan if item.time_s is None else item.time_s)
            ticks.append(-1 if item.tick is None else item.tick)
            sums.append(checksum(item.frame))
            last = item.frame
        if not times:
            raise InputError("no_frame_video_can", path=self.path)
        self.stamp.check(self.path)
        long, base = getattr(last, "duration", None), last.time_base  # how long a frame stands
        end = float(long * base) if long and base else None
        end = reading.next_time(*times[-2:]) if len(times) > 1 else end
        end = None if end is None or np.isnan(end) else end
        return Places(
            np.array(times), np.array(ticks, np.int64), np.array(sums, np.uint32),
            np.array(keys, np.int64).reshape(-1, 2), end,
        )  # fmt: skip

    def _as_listed(
        self, stamps: np.ndarray, first: int, running: Iterator[Decoded]
    ) -> Iterator[Decoded]:
        """The frames from `first` on, each of which has to be the one that its packet said."""
        index = first - 1
        for index, item in enumerate(running, first):
            if index >= len(stamps) or item.tick != stamps[index]:
                raise InputError("frame_not_one_packet", path=self.path, index=index)
            yield item
        count = index + 1
        if count != len(stamps):
            raise InputError(
                "gives_frames_packets_copy", path=self.path, index=count, stamps_count=len(stamps)
            )

    def _from_key(self, start: int) -> tuple[int, Iterator[Decoded]] | None:
        """Frames from the last key frame before `start`; None where they are not the known ones.

        A key frame that is none, or a time stamp that two frames share, shows in the checksums.
        """
        if self.places is None or start >= len(self.places.times_s):
            return None
        keys = self.places.keys[self.places.keys[:, 0] <= start]
        first, tick = map(int, keys[-1]) if len(keys) else (0, 0)
        if first == 0 or np.count_nonzero(self.places.stamps == tick) != 1:
            return None
        running = self.decoded((first, tick))
        try:
            item = next((d for d in running if d.tick is not None and d.tick >= tick), None)
        except InputError:
            return None
        if item is None or item.tick != tick:
            return None
        if self.places.sums is None:
            return first, chain((item,), running)
        if checksum(item.frame) != self.places.sums[first]:
            return None
        return first, self._checked(first, item, running)

    def _checked(
        self, first: int, item: Decoded, following: Iterator[Decoded]
    ) -> Iterator[Decoded]:
        """The frames from a key frame on, each held against what it was when it was counted.

        Where one is not, as after a key frame that is none, all are decoded from the first.
        """
        assert self.places is not None and self.places.sums is not None
        index, sums = first, self.places.sums
        yield item
        with suppress(InputError):
            for each in following:
                if index + 1 >= len(sums) or checksum(each.frame) != sums[index + 1]:
                    break
                index += 1
                yield each
        if index + 1 == len(sums):
            return
        for number, each in enumerate(self.decoded()):
            if number >= len(sums) or checksum(each.frame) != sums[number]:
                raise InputError("frame_not_what_when", path=self.path, number=number)
            if number > index:
                yield each


def open_video(path: Path) -> reading.Source:
    """Decode the first frame of a video."""
    video = Video(path, reading.Stamp.of(path), check_whole(path))
    running = video.decoded()
    try:
        item = next(running, None)
        if item is None:
            raise InputError("no_frame_video_can", path=path)
        with reading.refusing(path, "frame 0 cannot be decoded"):
            image, bits = to_image(item.frame, path)
            base = item.frame.time_base
    finally:
        running.close()
    with open_container(path) as (_, stream):
        claimed, lossy = stream.frames, bool(stream.codec_context.codec.lossy)
    video.form = reading.StoredForm.of(image)
    return reading.Source(
        kind="video",
        form=video.form,
        sensor_bits=bits,
        frames=video.frames,
        extent=video.extent,
        listed=video.listed,
        begins=video.begins,
        files=(path,),
        claimed=claimed or None,
        lossy=lossy,
        start_s=None if item.tick is None else float(item.tick * base),
    )
