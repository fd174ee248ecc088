"""A film without a model whose orders are followed in time: what its frames share; each read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from time import monotonic
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.frames import (
    Frame,
    NoiseModel,
    estimate_noise,
    full_scale,
    noise_between_pixels,
    saturation_level,
    to_linear,
)
from isochrome.fringes import (
    LARGEST_CHANGE,
    FilmLight,
    FilmPath,
    FilmState,
    KeptState,
    follow_frame,
    fringe_response,
    joined_pixels,
    light_wave,
    pixels_together,
    read_followed,
)
from isochrome.messages import message
from isochrome.processing.kinds.image_only import FLAWS, ImageOnly
from isochrome.processing.kinds.kind import FrameKind
from isochrome.processing.kinds.largest_order import order_columns
from isochrome.processing.result import Capture, ProcessedFrame, frame_fields
from isochrome.progress import STAGE_EVERY_S, RunProgress, Tally
from isochrome.runs import chunk_size
from isochrome.scene import Scene

if TYPE_CHECKING:
    from isochrome.processing.frame_task import FrameSource

Array = NDArray[Any]
Mask = NDArray[np.bool_]
Frames = Iterator[tuple[int, list[Frame]]]

FOLLOWING = "following the fringes"
"""What is done with a film's frames before they are read."""

NOT_KNOWN = "no_order_known_from"
READ_ANEW = "orders_read_anew_frame"
DIFFERING = "specimen_left_out_frames"
FEW_FOLLOWED = "only_specimen_pixels_could"


@dataclass(frozen=True, kw_only=True)
class FollowedFilm:
    """What the frames of a film have in common, and where each chunk of them begins.

    `light` of the frames' size, `guide` on blocks of `by` pixels a side; `noise` with the factor
    `between` pixels; `clipped`, the grey level from which pixels are; `kept`, states by the number
    of their frame; `lost`, from which frame to which, not included, nothing is known.
    """

    light: FilmLight = field(repr=False)
    guide: FilmLight = field(repr=False)
    by: int
    valid: Mask = field(repr=False)
    material: Mask = field(repr=False)
    noise: NoiseModel
    between: float
    wave_noise: float
    clipped: float
    kept: dict[int, KeptState] = field(repr=False)
    lost: tuple[tuple[int, int], ...]
    count: int
    notes: tuple[str, ...]

    def begin(self, index: int) -> int:
        """The number of the last frame up to this one whose state is kept."""
        return max(place for place in self.kept if place <= index)

    def end(self, index: int) -> int:
        """The number of the frame before the next one whose state is kept."""
        return min((place - 1 for place in self.kept if place > index), default=self.count - 1)

    def lost_since(self, index: int) -> tuple[int, int] | None:
        """From which frame to which nothing is known, for a frame of those."""
        return next((span for span in self.lost if span[0] <= index < span[1]), None)


class FilmData:
    """The light of a film's frames, on blocks of pixels: what all passes over it share."""

    def __init__(self, first: Frame, scene: Scene, capture: Capture) -> None:
        """Take the first frame, which says where pixels are trusted. Raises InputError."""
        self.depth = capture.bit_depth
        self.full = full_scale(capture.bit_depth)
        self.gamma = scene.frames.stated_gamma
        self.sign = -1.0 if scene.polariscope.field == "bright" else 1.0
        linear = to_linear(first, bit_depth=self.depth, gamma=self.gamma, allow_blank=True)
        self.valid = linear.valid
        for part in (capture.dark, capture.bright):
            self.valid = self.valid & part.valid if part else self.valid
        if not self.valid.any():
            raise InputError("no_part_frame_trusted_check", name=first.name)
        self.by = pixels_together((self.valid.shape[0], self.valid.shape[1]))
        self.material = joined_pixels(self.valid, self.by) > 0.99
        self.clipped = self.full
        self.noise, self.between, self._contrast = NoiseModel(0.0, 0.0, 0.0), 1.0, -1.0

    def light(self, frame: Frame) -> Array:
        """Light of a frame (rows, cols), over full scale."""
        return plain_light(frame, self.full, self.gamma)

    def joined(self, frame: Frame) -> tuple[Array, Mask]:
        """Light on blocks, and where none of a block's pixels is clipped or beside the specimen."""
        light = joined_pixels(self.light(frame), self.by)
        return light, self.material & unclipped(frame, self.clipped, self.by)

    def take_noise(self, frame: Frame) -> None:
        """Take the noise of a frame, if it has more contrast than those before, and its plateau."""
        self.clipped = min(self.clipped, saturation_level(frame.image, full=self.full))
        contrast = float(np.std(frame.image[self.valid]))
        if contrast > self._contrast:
            self._contrast = contrast
            self.noise = estimate_noise(frame.image, self.valid, bit_depth=self.depth)
            self.between = noise_between_pixels(frame.image, self.valid, self.noise)

    def wave_noise(self, level: float) -> float:
        """Noise of the wave on blocks, at half of full scale and an illumination."""
        grey = float(self.noise.sigma(0.5 * self.full)) / self.full * self.between
        return 2.0 * max(grey / self.by, FLAWS * level / self.by) / level

    def film(
        self, path: FilmPath, light: FilmLight, count: int, notes: tuple[str, ...]
    ) -> FollowedFilm:
        """The film as it was followed."""
        spans = tuple((span[0], span[1] if len(span) > 1 else count) for span in path.lost)
        return FollowedFilm(
            light=light, guide=light.joined(self.by), by=self.by, valid=self.valid,
            material=self.material, noise=self.noise, between=self.between,
            wave_noise=path.noise, clipped=self.clipped, kept=path.kept, lost=spans,
            count=count, notes=notes,
        )  # fmt: skip


def plain_light(frame: Frame, full: float, gamma: float) -> Array:
    """Light of a frame (rows, cols) over full scale, float32; 0 where it holds no number."""
    light = frame.image.astype(np.float32) * np.float32(1.0 / full)
    if frame.image.dtype.kind == "f":
        light = np.nan_to_num(light)
    return light if gamma == 1.0 else np.maximum(light, 0.0) ** np.float32(gamma)


def unclipped(frame: Frame, clipped: float, by: int) -> Mask:
    """Blocks of a frame in which no pixel has reached a grey level."""
    return np.asarray(joined_pixels(frame.image >= clipped, by) < np.float32(0.5 / by**2))


def film_time(frame: Frame, index: int) -> float:
    """A frame's time (s), or its number where the file knows no times."""
    return float(index) if frame.time_s is None else frame.time_s


@dataclass(frozen=True, kw_only=True)
class Film(ImageOnly):
    """A film without a model whose orders are followed in time; `film`, what its frames share."""

    film: FollowedFilm | None = None

    draws_lines = False

    def shared(self, source: FrameSource, count: int, progress: RunProgress | None) -> FrameKind:
        """What one pass or two over all frames tell."""
        rows, cols = source.reader.shape
        again = partial(_reported, partial(source.captured, 0, count), count, progress)
        chunk = chunk_size(count, 4 * rows * cols)
        return self.followed(again, source.task.scene, source.capture, chunk, count)

    def followed(
        self, captured: Callable[[], Frames], scene: Scene, capture: Capture, chunk: int, count: int
    ) -> FrameKind:
        """The film as it is followed through its `count` frames, in chunks.

        `captured` gives its frames anew, each with its number. Raises InputError, PhysicsError.
        """
        raise NotImplementedError

    def states(self, source: FrameSource, start: int, stop: int) -> Iterator[ProcessedFrame]:
        """The frames in time, from the last kept state on."""
        film, scene, capture = self.film, source.task.scene, source.capture
        assert film is not None
        full, gamma = full_scale(capture.bit_depth), scene.frames.stated_gamma
        state: FilmState | None = None
        for index, (frame, *_) in source.captured(film.begin(start), stop):
            light, lost = plain_light(frame, full, gamma), film.lost_since(index)
            if index in film.kept:
                state = film.kept[index].state()
            elif lost is None:
                assert state is not None
                rise = film.guide.rise(joined_pixels(light, film.by))
                wave = light_wave(rise, film.guide.illumination)
                trusted = film.material & unclipped(frame, film.clipped, film.by)
                time = film_time(frame, index)
                state = follow_frame(state, wave, trusted, time, noise=film.wave_noise)
            assert state is not None
            if index >= start:
                known = state.known & ~film.kept[film.begin(index)].doubt() & (lost is None)
                own = replace(frame, index=index)
                yield _read(film, replace(state, known=known), own, light, scene, capture)


def _reported(
    captured: Callable[[], Iterator[tuple[int, list[Frame]]]],
    count: int,
    progress: RunProgress | None,
) -> Iterator[tuple[int, list[Frame]]]:
    """Frames of a pass over a film, which is told of where it takes some seconds."""
    last = monotonic()
    for index, frames in captured():
        if progress is not None and monotonic() - last >= STAGE_EVERY_S:
            last = monotonic()
            progress(Tally(index, count, 0, 0, stage=FOLLOWING))
        yield index, frames


def _read(
    film: FollowedFilm, state: FilmState, frame: Frame, light: Array, scene: Scene,
    capture: Capture,
) -> ProcessedFrame:  # fmt: skip
    """One frame, read where it was followed."""
    valid = film.valid & (frame.image < film.clipped)
    sigma = film.between * film.noise.linear_sigma(
        frame.image, bit_depth=capture.bit_depth, gamma=scene.frames.stated_gamma
    )
    sigma = np.maximum(sigma, FLAWS * film.light.illumination).astype(np.float32)
    reading = read_followed(light, state, film.light, sigma=sigma, valid=valid, by=film.by)
    signal = film.light.rise(light) / film.light.illumination
    relative = sigma / film.light.illumination
    known = np.isfinite(reading.order)
    residual = (signal - fringe_response(np.where(known, reading.order, 0.0))) / relative
    chi = float(np.sqrt(np.mean(np.square(residual[known])))) if known.any() else float("nan")
    return ProcessedFrame(
        **frame_fields(frame, scene),
        normalised=np.where(valid, signal, np.nan).astype(np.float32),
        reading=reading,
        noise=float(np.median(relative[valid])) if valid.any() else float("nan"),
        chi=chi,
        warnings=_warnings(film, frame.index, reading.kept),
        columns={"kept_share": reading.kept, **order_columns(reading.order, reading.uncertainty)},
    )


def not_followed(start: int) -> str:
    """What to say of a film that is lost before a frame `start`."""
    return message(
        "film_cannot_followed_from", before=start - 1, after=start, change=LARGEST_CHANGE
    )


def _warnings(film: FollowedFilm, index: int, known_share: float) -> tuple[str, ...]:
    """What to say of a frame."""
    notes = list(film.notes) if index == 0 else []
    for start, stop in film.lost:
        if start <= index < max(stop, start + 1):
            again = message(NOT_KNOWN) if stop >= film.count else message(READ_ANEW, stop=stop)
            return (*notes, not_followed(start) + "; " + again)
    begin = film.begin(index)
    if film.kept[begin].doubts:
        share = 100.0 * film.kept[begin].doubts / max(1, int(np.count_nonzero(film.material)))
        notes.append(message(DIFFERING, share=share, begin=begin, end=film.end(index)))
    if known_share < 0.5 and index > 0:
        notes.append(message(FEW_FOLLOWED, known_share=100.0 * known_share))
    return tuple(notes)
