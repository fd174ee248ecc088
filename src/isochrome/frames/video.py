"""Frames from a video by PyAV, and where each of them is, once all have been decoded."""

from collections.abc import Generator, Iterator
from contextlib import nullcontext, suppress
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
        return self._key(self.places, start)[0]

    def frames(self, start: int) -> Generator[reading.Frame]:
        """The frames from number `start` on; those before are decoded, but not converted."""
        places = self.places
        known = None if places is None else self._known(places, start)
        for index, item in known or enumerate(self.decoded()):
            if index < start:
                continue
            with reading.refusing(self.path, f"frame {index} cannot be decoded"):
                image = to_image(item.frame, self.path)[0]
                self.form.check(self.path, image, f"frame {index}")
            time = item.time_s
            if places is not None:
                time = float(places.times_s[index])
                time = time if np.isfinite(time) else None
            yield reading.Frame(index, image, time, f"{self.path.name}[{index}]")
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
            running = (item for _, item in self._known(listed, 0))
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

    def _known(self, places: Places, start: int) -> Iterator[tuple[int, Decoded]]:
        """The frames from number `start` on, each held against what is known of it.

        From the last key frame before; where a later one is not as it was, as after a key frame
        that is none, from the first.
        """
        key, tick = self._key(places, start)
        while True:
            index = key
            with suppress(InputError) if key else nullcontext():
                for item in self.decoded((key, tick) if key else None):
                    if index == key > 0 and (item.tick is None or item.tick < tick):
                        continue  # before the key frame in time
                    if index >= len(places.times_s) or not places.is_frame(index, item):
                        ended = False
                        break
                    if index >= start:
                        yield index, item
                        start = index + 1
                    index += 1
                else:
                    ended = True
                    if index == len(places.times_s):
                        return
            if key == 0:
                break
            key = 0
        if places.sums is not None:
            raise InputError("frame_not_what_when", path=self.path, number=index)
        if not ended:
            raise InputError("frame_not_one_packet", path=self.path, index=index)
        count = len(places.stamps)
        raise InputError(
            "gives_frames_packets_copy", path=self.path, index=index, stamps_count=count
        )

    def _key(self, places: Places, start: int) -> tuple[int, int]:
        """Number and tick of the last key frame before `start`; (0, 0) where none can be sought."""
        keys = places.keys[places.keys[:, 0] <= start]
        number, tick = map(int, keys[-1]) if len(keys) else (0, 0)
        return (number, tick) if np.count_nonzero(places.stamps == tick) == 1 else (0, 0)


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
