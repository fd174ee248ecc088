"""A film without a model whose key frames are read from nothing: the others are followed."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.frames import Frame
from isochrome.fringes import (
    LARGEST_CHANGE,
    BackgroundModulation,
    FilmLight,
    FilmPath,
    FilmState,
    joined_reading,
)
from isochrome.messages import message
from isochrome.processing.kinds.followed_film import (
    Array,
    Film,
    FilmData,
    FollowedFilm,
    Frames,
    Mask,
    film_time,
)
from isochrome.processing.kinds.image_only import ImageOnly, read_alone
from isochrome.processing.kinds.kind import FrameKind
from isochrome.processing.result import SEPARATOR, Capture, ProcessedFrame
from isochrome.scene import Scene

KEY_EVERY = 200
"""Frames from one key frame to the next: one is read in as long as some fifty are followed."""
KEY_LIGHT = "light_first_key_frame"
_ALONE = "each_frame_read_itself"
_OR_ALONE = "leave_track_out_each"
_MOST_BREAKS = 0.5
"""Share of the steps from frame to frame beyond which a set is no film."""
_TRIED = 16
"""Frames at most that a film may begin with: unloaded ones have no fringes."""


@dataclass(frozen=True, kw_only=True)
class KeyedFilm(Film):
    """A film each `key_every`-th frame of which is read from nothing.

    `by_default`, whether nobody asked to follow it: frames that are no film are then read one by
    one, and the first says so.
    """

    key_every: int = KEY_EVERY
    by_default: bool = False

    def followed(
        self, captured: Callable[[], Frames], scene: Scene, capture: Capture, chunk: int, count: int
    ) -> FrameKind:
        """Followed from its key frames; read one by one where that fails by default."""
        every = self.key_every
        try:
            film = prepare_keyed(captured, scene, capture, chunk=chunk, count=count, every=every)
        except PhysicsError as error:
            if not self.by_default:
                raise PhysicsError(_OR_ALONE, error=error) from error
            return ImageOnly(note=message(_ALONE, error=error))
        return replace(self, film=film)

    @property
    def identity(self) -> dict[str, Any]:
        """Its key frames."""
        return {"key_every": self.key_every}


def prepare_keyed(
    captured: Callable[[], Frames], scene: Scene, capture: Capture, *, chunk: int, count: int,
    every: int = KEY_EVERY,
) -> FollowedFilm:  # fmt: skip
    """Pass over a film: its key frames, and the states of its chunks, one each `chunk` frames.

    `captured` gives the film's frames anew, each with its number. PhysicsError where no frame to
    begin with can be read, or the frames are no film.
    """
    begin, first, key_frame, ends = _first_key(captured(), scene, capture, count)
    assert key_frame.reading is not None
    data = FilmData(first, scene, capture)
    data.take_noise(first)
    light = _light_of(ends, data.sign)
    guide = light.joined(data.by)
    start = joined_reading(key_frame.reading, data.by, film_time(first, begin))
    last: list[tuple[int, Frame]] = []

    def key() -> FilmState | None:
        index, frame = last[0]
        result: ProcessedFrame = read_alone(frame, scene, capture)[0]
        if result.reading is None or not _is_read(result):
            return None
        return joined_reading(result.reading, data.by, film_time(frame, index))

    path = FilmPath(
        start, guide, noise=data.wave_noise(float(np.median(guide.illumination[data.material]))),
        chunk=chunk, key=key, every=every, begin=begin,
    )  # fmt: skip

    def frames() -> Iterator[tuple[Array, Mask, float]]:
        for index, (frame, *_) in captured():
            last[:] = [(index, frame)]
            yield (*data.joined(frame), film_time(frame, index))

    path.follow(frames())
    breaks = len(path.lost) - (begin > 0)
    if breaks > _MOST_BREAKS * (count - 1 - begin):
        raise PhysicsError(
            "cannot_followed_in_time",
            name=scene.name,
            change=LARGEST_CHANGE,
            breaks=breaks,
            steps=count - 1 - begin,
        )
    notes = (*key_frame.warnings, message(KEY_LIGHT, begin=begin))
    return data.film(path, light, count, notes)


def _first_key(
    frames: Frames, scene: Scene, capture: Capture, count: int
) -> tuple[int, Frame, ProcessedFrame, BackgroundModulation]:
    """The first frame of some, from the film's first on, that can be read from nothing."""
    why = None
    for index, (frame, *_) in frames:
        if index % max(1, count // _TRIED):
            continue
        key_frame, ends = read_alone(frame, scene, capture)
        if ends is not None and _is_read(key_frame):
            return index, frame, key_frame, ends
        why = why or SEPARATOR.join(key_frame.warnings)
    raise PhysicsError("no_order_in_first_frames", name=scene.name, why=why)


def _is_read(frame: ProcessedFrame) -> bool:
    """Whether any order of a frame is known."""
    return frame.reading is not None and bool(np.isfinite(frame.reading.order).any())


def _light_of(ends: BackgroundModulation, sign: float) -> FilmLight:
    """The ends of a frame's light as a film's; order 0 is at the bright one for a `sign` of -1."""
    zero, other = (ends.dark, ends.bright)[:: int(sign)]
    illumination = np.maximum(sign * (other - zero), 1e-3).astype(np.float32)
    zero = zero.astype(np.float32)
    return FilmLight(
        zero=zero,
        illumination=illumination,
        error=ends.signal_uncertainty(other).astype(np.float32),
        zero_error=ends.signal_uncertainty(zero).astype(np.float32),
        sign=sign,
    )
