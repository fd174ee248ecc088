"""Films without a model whose orders are followed in time: from no load on, or from key frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from time import monotonic
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome import fringes
from isochrome.errors import InputError, PhysicsError
from isochrome.frames import (
    Frame,
    NoiseModel,
    estimate_noise,
    full_scale,
    noise_between_pixels,
    saturation_level,
    to_linear,
)
from isochrome.messages import message
from isochrome.processing.kinds.image_only import FLAWS, LEAST_ORDER, ImageOnly, read_alone
from isochrome.processing.kinds.kind import KEY_EVERY, FrameKind
from isochrome.processing.kinds.largest_order import order_columns
from isochrome.processing.result import SEPARATOR, Capture, ProcessedFrame, frame_fields
from isochrome.progress import STAGE_EVERY_S, RunProgress, Tally
from isochrome.runs import chunk_size
from isochrome.scene import Scene

if TYPE_CHECKING:
    from isochrome.processing.kinds.kind import FrameSource

Array = NDArray[Any]
Mask = NDArray[np.bool_]
Frames = Iterator[tuple[int, list[Frame]]]
Captured = Callable[[], Frames]

NOT_KNOWN = "no_order_known_from"
READ_ANEW = "orders_read_anew_frame"
DIFFERING = "specimen_left_out_frames"


class FilmData:
    """The light of a film's frames, on blocks of pixels: what all passes over it share."""

    def __init__(self, first: Frame, scene: Scene, capture: Capture) -> None:
        """The first frame says where pixels are trusted."""
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
        self.by = fringes.pixels_together((self.valid.shape[0], self.valid.shape[1]))
        self.material = fringes.joined_pixels(self.valid, self.by) > 0.99
        self.clipped = self.full
        self.noise, self.between, self._contrast = NoiseModel(0.0, 0.0, 0.0), 1.0, -1.0

    def light(self, frame: Frame) -> Array:
        """Light of a frame (rows, cols) over full scale, float32; 0 where it holds no number."""
        light = frame.image.astype(np.float32) * np.float32(1.0 / self.full)
        if frame.image.dtype.kind == "f":
            light = np.nan_to_num(light)
        return light if self.gamma == 1.0 else np.maximum(light, 0.0) ** np.float32(self.gamma)

    def unclipped(self, frame: Frame) -> Mask:
        """Blocks on the specimen in which no pixel is clipped."""
        clipped = fringes.joined_pixels(frame.image >= self.clipped, self.by)
        return np.asarray(self.material & (clipped < np.float32(0.5 / self.by**2)))

    def lights(self, frames: Frames) -> Iterator[tuple[Frame, Array, Mask, float]]:
        """Frames with their light on blocks, where it can be trusted, and their time."""
        for index, (frame, *_) in frames:
            light = fringes.joined_pixels(self.light(frame), self.by)
            yield frame, light, self.unclipped(frame), film_time(frame, index)

    def take_noise(self, frame: Frame) -> None:
        """Take the noise of a frame, if it has more contrast than those before, and its plateau."""
        self.clipped = min(self.clipped, saturation_level(frame.image, full=self.full))
        contrast = float(np.std(frame.image[self.valid]))
        if contrast > self._contrast:
            self._contrast = contrast
            self.noise = estimate_noise(frame.image, self.valid, bit_depth=self.depth)
            self.between = noise_between_pixels(frame.image, self.valid, self.noise)

    def path(
        self, start: fringes.FilmState, light: fringes.FilmLight, count: int, begin: int = 0
    ) -> fringes.FilmPath:
        """A path through `count` frames, with the noise of its wave, at half of full scale."""
        level = float(np.median(light.illumination[self.material]))
        grey = float(self.noise.sigma(0.5 * self.full)) / self.full * self.between
        noise = 2.0 * max(grey / self.by, FLAWS * level / self.by) / level
        chunk = chunk_size(count, 4 * self.valid.size)
        return fringes.FilmPath(start, light, noise=noise, chunk=chunk, begin=begin)


def film_time(frame: Frame, index: int) -> float:
    """A frame's time (s), or its number where the file knows no times."""
    return float(index) if frame.time_s is None else frame.time_s


@dataclass(frozen=True, kw_only=True)
class Film(ImageOnly):
    """A film without a model whose orders are followed in time. Its frames share `data`, light on
    blocks; the `path`; `light`, of the frames' size; `notes`, of the first frame."""

    data: FilmData | None = field(default=None, repr=False)
    path: fringes.FilmPath | None = field(default=None, repr=False)
    light: fringes.FilmLight | None = field(default=None, repr=False)
    notes: tuple[str, ...] = ()

    draws_lines = False

    def shared(
        self, source: FrameSource, count: int, progress: RunProgress | None, *, on_disk: bool
    ) -> FrameKind:
        """What one pass or two over all frames tell."""

        def captured() -> Frames:
            last = monotonic()
            for index, frames in source.captured(0, count):
                if progress is not None and monotonic() - last >= STAGE_EVERY_S:
                    last = monotonic()
                    progress(Tally(index, count, 0, 0, stage="following the fringes"))
                yield index, frames

        return self.followed(source, captured, count)

    def followed(self, source: FrameSource, captured: Captured, count: int) -> FrameKind:
        """The film as it is followed; `captured` gives its frames anew, each with its number."""
        raise NotImplementedError

    def states(self, source: FrameSource, start: int, stop: int) -> Iterator[ProcessedFrame]:
        """The frames in time, from the last kept state on."""
        data, path = self.data, self.path
        assert data is not None and path is not None
        state: fringes.FilmState | None = None
        for index, (frame, *_) in source.captured(path.begin(start), stop):
            light = data.light(frame)
            span = path.lost_at(index)
            lost = span is not None and index < span[1]
            if index in path.kept:
                state = path.kept[index].state()
            elif not lost:
                assert state is not None
                wave = path.light.wave(fringes.joined_pixels(light, data.by))
                state = fringes.follow_frame(
                    state, wave, data.unclipped(frame), film_time(frame, index), noise=path.noise
                )
            assert state is not None
            if index >= start:
                known = state.known & (not lost)
                numbered = replace(frame, index=index)
                yield self._read(replace(state, known=known), numbered, light, source.task.scene)

    def _read(
        self, state: fringes.FilmState, frame: Frame, light: Array, scene: Scene
    ) -> ProcessedFrame:
        data, ends, path = self.data, self.light, self.path
        assert data is not None and ends is not None and path is not None
        valid = data.valid & (frame.image < data.clipped)
        sigma = data.between * data.noise.linear_sigma(
            frame.image, bit_depth=data.depth, gamma=data.gamma
        )
        sigma = np.maximum(sigma, FLAWS * ends.illumination).astype(np.float32)
        reading = fringes.read_followed(light, state, ends, sigma=sigma, valid=valid, by=data.by)
        signal = ends.rise(light) / ends.illumination
        relative = sigma / ends.illumination
        known = np.isfinite(reading.order)
        residual = (signal - np.sin(np.pi * np.where(known, reading.order, 0.0)) ** 2) / relative
        chi = float(np.sqrt(np.mean(np.square(residual[known])))) if known.any() else float("nan")
        return ProcessedFrame(
            **frame_fields(frame, scene), reading=reading, chi=chi,
            normalised=np.where(valid, signal, np.nan).astype(np.float32),
            noise=float(np.median(relative[valid])) if valid.any() else float("nan"),
            warnings=tuple(self._said(frame.index, path, data, reading.kept)),
            columns={"kept_share": reading.kept}
            | order_columns(reading.order, reading.uncertainty),
        )  # fmt: skip

    def _said(
        self, index: int, path: fringes.FilmPath, data: FilmData, known_share: float
    ) -> Iterator[str]:
        yield from self.notes if index == 0 else ()
        if (span := path.lost_at(index)) is not None:
            start, stop = span
            again = message(NOT_KNOWN) if stop >= path.count else message(READ_ANEW, stop=stop)
            yield not_followed(start) + "; " + again
            return
        begin = path.begin(index)
        if doubts := path.kept[begin].doubted:
            share = 100.0 * doubts / max(1, int(np.count_nonzero(data.material)))
            yield message(DIFFERING, share=share, begin=begin, end=path.end(index))
        if known_share < 0.5 and index > 0:
            yield message("only_specimen_pixels_could", known_share=100.0 * known_share)


def not_followed(start: int) -> str:
    """What to say of a film that is lost before a frame `start`."""
    return message(
        "film_cannot_followed_from", before=start - 1, after=start, change=fringes.LARGEST_CHANGE
    )


NOT_UNLOADED = "frames_starts_unloaded_set_first"
OWN_CRESTS = "illumination_found_from_crests"
OTHER_LIGHT = "crests_times_bright_no"
FEW_ORDERS = "film_orders_reach_alone"
_TRIED = 16
"""Frames at most whose noise is looked at, and that a film may begin with: unloaded ones have no
fringes."""
_DARKER, _DARKER_SHARE = 0.05, 0.01
"""By how much of the contrast, and in which share of the specimen, light falls below the first
frame's before that was not unloaded: fringes of order 0.07 are as bright."""
_SAME_LIGHT = 0.02
"""Of the illumination: by so much lamps and exposures differ from day to day."""


@dataclass(frozen=True, kw_only=True)
class UnloadedFilm(Film):
    """A film that begins without load, from whose zero orders it is followed."""

    def check(self, scene: Scene) -> None:
        """Refuse a film that cannot begin without load."""
        name, light = f"{scene.name}: frames.starts_unloaded", scene.polariscope
        if scene.has_model:
            raise InputError("films_without_model_scene", name=name)
        if light.tells_orders:
            raise InputError("phase_steps_colours_tell", name=name)
        if scene.frames.known_order or scene.frames.known_line or scene.frames.free_boundary:
            raise InputError("orders_counted_from_zero", name=name)
        if scene.frames.gamma == "unknown":
            raise InputError("frames_gamma_unknown_single", name=name)
        super().check(scene)

    def followed(self, source: FrameSource, captured: Captured, count: int) -> FrameKind:
        """Followed from its first frame."""
        scene, capture = source.task.scene, source.capture
        first = next(iter(captured()))[1][0]
        data = FilmData(first, scene, capture)
        field_zero, other = (capture.dark, capture.bright)[:: int(data.sign)]
        zero, rough = (
            (field_zero.image, False)
            if field_zero
            else fringes.smooth_zero(data.light(first), data.valid)
        )
        top, below = fringes.BrightestLight(), fringes.joined_pixels(zero, data.by)
        for index, (frame, *_) in captured():
            top.add(
                np.float32(data.sign) * (fringes.joined_pixels(data.light(frame), data.by) - below)
            )
            if index % max(1, count // _TRIED) == 0:
                data.take_noise(frame)
        least = -_DARKER * top.contrast(data.material)
        share = float(np.mean((top.lowest < least)[data.material]))
        if share > _DARKER_SHARE:  # later ones fall below its light
            than = "brighter than later ones" if data.sign > 0 else "darker than later ones"
            raise PhysicsError(NOT_UNLOADED, name=scene.name, than=than, share=100.0 * share)
        given = None if other is None else np.maximum(data.sign * (other.image - zero), 1e-3)
        try:
            surface = (
                top.surface(data.material)
                if given is None
                else fringes.joined_pixels(given, data.by)
            )
        except InputError as error:
            raise PhysicsError(f"{scene.name}: " + error.message) from error
        guide = fringes.FilmLight(zero=below, illumination=surface, sign=data.sign)
        if rough:  # the first frame's own noise is in all differences from it
            data.between *= float(np.sqrt(2.0))
        path = data.path(fringes.unloaded_state(data.material, film_time(first, 0)), guide, count)
        path.follow(data.lights(captured()))
        light, notes = _final_light(path, data, zero, given, scene)
        path.light = light.joined(data.by)
        return replace(self, data=data, path=path, light=light, notes=notes)


def _final_light(
    path: fringes.FilmPath, data: FilmData, zero: Array, given: Array | None, scene: Scene
) -> tuple[fringes.FilmLight, tuple[str, ...]]:
    """The light of the frames' size by the crests that were followed, and what to say of it."""
    shape = (zero.shape[0], zero.shape[1])
    crests_tell = path.crests.told and path.highest > LEAST_ORDER
    if not crests_tell and given is None:
        if path.lost:
            lost = not_followed(path.lost[0][0]) + "; " + message(NOT_KNOWN)
            raise PhysicsError(f"{scene.name}: " + lost)
        raise PhysicsError(
            FEW_ORDERS, name=scene.name, highest=path.highest, least_order=LEAST_ORDER
        )
    error: Array | float = 0.0
    level, notes = given, tuple[str, ...]()
    if crests_tell:
        result, spread = path.crests.illumination(shape)
        scale = 1.0 if given is None else float(np.median((result / given)[data.valid]))
        if given is None or abs(scale - 1.0) > _SAME_LIGHT:
            level, error = result, spread
            notes = (message(OWN_CRESTS) if given is None else message(OTHER_LIGHT, scale=scale),)
    assert level is not None
    return fringes.FilmLight(zero=zero, illumination=level, error=error, sign=data.sign), notes


_MOST_BREAKS = 0.5
"""Share of the steps from frame to frame beyond which a set is no film."""


@dataclass(frozen=True, kw_only=True)
class KeyedFilm(Film):
    """A film each `key_every`-th frame of which is read from nothing. `by_default`, whether nobody
    asked to follow it: frames that are no film are then read one by one, and the first says so."""

    key_every: int = KEY_EVERY
    by_default: bool = False

    def followed(self, source: FrameSource, captured: Captured, count: int) -> FrameKind:
        """Followed from its key frames; read one by one where that fails by default."""
        try:
            return self._keyed(source, captured, count)
        except PhysicsError as error:
            if not self.by_default:
                raise PhysicsError("leave_track_out_each", error=error) from error
            return ImageOnly(note=message("each_frame_read_itself", error=error))

    @property
    def identity(self) -> dict[str, Any]:
        """Its key frames."""
        return {"key_every": self.key_every}

    def _keyed(self, source: FrameSource, captured: Captured, count: int) -> FrameKind:
        scene, capture = source.task.scene, source.capture
        why = None
        for begin, (first, *_) in captured():
            if begin % max(1, count // _TRIED):
                continue
            key_frame, ends = read_alone(first, scene, capture)
            begun = key_frame.reading
            if ends is not None and begun is not None and np.isfinite(begun.order).any():
                break
            why = why or SEPARATOR.join(key_frame.warnings)
        else:
            raise PhysicsError("no_order_in_first_frames", name=scene.name, why=why)
        data = FilmData(first, scene, capture)
        data.take_noise(first)
        # order 0 is at the bright end in the bright field
        zero, other = (ends.dark, ends.bright)[:: int(data.sign)]
        illumination = np.maximum(data.sign * (other - zero), 1e-3).astype(np.float32)
        zero = zero.astype(np.float32)
        error, at_zero = (ends.signal_uncertainty(end).astype(np.float32) for end in (other, zero))
        light = fringes.FilmLight(
            zero=zero, illumination=illumination, error=error, zero_error=at_zero, sign=data.sign
        )
        start = fringes.joined_reading(begun, data.by, film_time(first, begin))
        path = data.path(start, light.joined(data.by), count, begin)

        def key(frame: Frame, time: float) -> fringes.FilmState | None:
            reading = read_alone(frame, scene, capture)[0].reading
            if reading is None or not np.isfinite(reading.order).any():
                return None
            return fringes.joined_reading(reading, data.by, time)

        path.follow(data.lights(captured()), key, self.key_every)
        breaks, steps = len(path.lost) - (begin > 0), count - 1 - begin
        if breaks > _MOST_BREAKS * steps:
            raise PhysicsError(
                "cannot_followed_in_time", name=scene.name, change=fringes.LARGEST_CHANGE,
                breaks=breaks, steps=steps,
            )  # fmt: skip
        notes = (*key_frame.warnings, message("light_first_key_frame", begin=begin))
        return replace(self, data=data, path=path, light=light, notes=notes)
