"""A contact's video: key frames are processed wholly, the frames between them are followed."""

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from isochrome import fitting
from isochrome.errors import InputError, IsochromeError, PhysicsError
from isochrome.frames import Frame
from isochrome.output import counted
from isochrome.processing.kinds.kind import (
    CONFIDENCE,
    KEY_EVERY,
    MOST_IN_MEMORY,
    ORDER,
    FrameKind,
    FrameSource,
    place_of,
)
from isochrome.processing.kinds.largest_order import largest_with_model
from isochrome.processing.kinds.with_model import WithModel, of_share, read_frame
from isochrome.processing.result import (
    FOLLOWED,
    FOUND_BY,
    NOTHING,
    PICTURE,
    SEARCHED,
    SPREAD,
    WHOLE,
    ProcessedFrame,
    frame_fields,
    row_of_set,
    value_columns,
)
from isochrome.progress import RunProgress, Tally
from isochrome.runs import Compact, Layer
from isochrome.scene import Scene
from isochrome.simulation import make_picture, scene_states, state_difference
from isochrome.specimens import surface_field_grid
from isochrome.stress import pixel_grid

MOST_ON_DISK = 20e9
"""Bytes up to which maps of all frames are written without being asked for."""

MOST_PAGED = 1e9
"""Bytes of a TIFF stack up to which it has a page for every frame, uncompressed."""

_BYTES, _TYPICAL = 3, 1.2
"""Bytes a pixel of order and confidence before they are compressed, and after: measured with a
noise of 3 grey levels, see `runs.Compact`."""

FINEST_STEP = 1e-4
"""Fringes; the least order's uncertainty is ten times as much."""

_MARGIN = 2.0
"""Largest order that steps of 16 bits reach, over the scene's own: four times its load."""

_THIN = 4


@dataclass(frozen=True, kw_only=True)
class TrackedFilm(WithModel):
    """A contact's video, of which each `every`-th frame is a key frame (None: at most each 200th,
    in stretches that are alike, for processes to share). `wanted`, the maps that were asked for;
    `maps`, of which frames they are written: 'all', 'key', or 'none'; `order_step` (fringes), in
    which those of all are kept; `pages`, whether the TIFF stacks have a page for each of them."""

    every: int | None = None
    wanted: str | None = None
    maps: str = "key"
    order_step: float = 1e-4
    pages: bool = False

    refines = False

    @property
    def key_step(self) -> int:
        """Frames to the next key frame."""
        return self.every or KEY_EVERY

    def shared(
        self, source: FrameSource, count: int, progress: RunProgress | None, *, on_disk: bool
    ) -> FrameKind:
        """With the maps that are written, and the apparatus, asked of one frame."""
        scene, shape = source.task.scene, source.reader.shape
        check_tracked(scene, shape, self.key_step)
        step = self.every or -(-count // -(-count // KEY_EVERY))
        pixels = math.prod(shape)
        most, each = (MOST_ON_DISK, _BYTES) if on_disk else (MOST_IN_MEMORY, 8)
        maps = self.wanted or ("all" if each * pixels * count <= most else "key")
        kind = replace(self, every=step, maps=maps)
        if maps != "all":
            why = f"those of all {count} might take {each * pixels * count / 1e9:.3g} GB"
            text = {"key": "maps of the key frames", "none": "no maps"}[maps]
            text += f"; {why}: --maps all writes them" if self.wanted is None else ""
        else:
            order = order_step(scene, shape)
            pages = on_disk and 4 * pixels * count <= MOST_PAGED
            kind = replace(kind, order_step=order, pages=pages)
            space = (_TYPICAL if on_disk else each) * pixels
            text = (
                f"maps of {counted(count, 'frame')}: about {1e-6 * space:.2g} MB a frame, "
                f"{1e-9 * space * count:.3g} GB in all, orders in steps of {order:g} fringe"
            )
            if on_disk and not pages:
                text += "; the TIFF stacks hold the key frames: isochrome export --to tiff makes "
                text += "all pages"
        if not self.as_stated:
            bare, capture = fitting.sliding_scene(scene), source.capture
            found = fitting.find_apparatus(
                source.reader, bare, fitting.free_keys(bare), count=count,
                no_load=(capture.dark, capture.bright),
            )  # fmt: skip
            kind = replace(kind, apparatus=found)
        if progress is not None:  # what is refused before is one line
            progress(Tally(0, count, 0, 0, text))
        return kind

    def held(self, scene: Scene) -> Scene:
        """The scene with the apparatus's own values."""
        return scene if self.apparatus is None else self.apparatus.stated

    def states(self, source: FrameSource, start: int, stop: int) -> Iterator[ProcessedFrame]:
        """From a key frame `start` on: its chunk suffices."""
        assert start % self.key_step == 0
        for index, frames in source.captured(start, stop):
            frame = replace(frames[0], index=index)
            if index % self.key_step == 0:
                key = source.processed(index, frames)
                surface_field_grid.cache_clear()  # of its own place, as large as ten pictures
                track = KeyFrames(source, self, key)
                if not key.failed:
                    track.tracker.track(frame, fitting.slid_until(track.scene, frame))
                yield key
            else:
                yield track.follow(frame)

    def columns(self, scene: Scene) -> tuple[str, ...]:
        """Where a key frame lies in the stacks too, and how values were found."""
        frame, name, label, *others = super().columns(scene)
        return (frame, name, label, PICTURE, FOUND_BY, *others)

    def row(self, item: ProcessedFrame, scene: Scene) -> dict[str, Any]:
        """With a key frame's place and the apparatus."""
        row = {PICTURE: None, FOUND_BY: NOTHING} | item.row()
        if item.normalised is not None:
            place = None if self.maps == "none" else item.index // self.key_step
            row |= {PICTURE: place, FOUND_BY: WHOLE if item.has_values else NOTHING}
            held = {} if self.apparatus is None else self.apparatus.values
            for key, (value, spread) in held.items():
                row |= {key: value, f"{key} {SPREAD}": spread}
        return row_of_set(row, self.columns(scene), scene)

    def layers(self, scene: Scene) -> tuple[Layer, ...]:
        """Of all frames in whole steps, of key frames, or none."""
        layers = super().layers(scene)
        if self.maps == "none":
            return ()
        if self.maps == "key":
            return layers
        compact = {
            ORDER.name: Compact(self.order_step, 16, self.pages),
            CONFIDENCE.name: Compact(1.0 / Compact(1.0, 8).largest, 8, self.pages),
        }
        return tuple(replace(layer, compact=compact.get(layer.name)) for layer in layers)

    @property
    def identity(self) -> dict[str, Any]:
        """Its key frames, and the maps that were asked for."""
        return {"every": self.every or "default", "maps": self.wanted or "default"}


def check_tracked(scene: Scene, shape: tuple[int, int], every: int) -> None:
    """Refuse a scene whose frames cannot be followed. Raises InputError."""
    if every < 2:
        raise InputError("every_give_more_without", every=every)
    if scene.indenter is None:
        what = f"a {scene.model}" if scene.model else "a scene without a model"
        raise InputError("cannot_tracked_only_contact", name=scene.name, what=what)
    if scene.polariscope.tells_orders:
        raise InputError("phase_steps_colours_determine", name=scene.name)
    placed = fitting.placed(fitting.sliding_scene(scene), shape)
    fitting.Tracker(placed, fitting.free_keys(scene), bit_depth=None)


def order_step(scene: Scene, shape: tuple[int, int]) -> float:
    """Steps (fringes) of 16 bits that reach twice the largest order of a contact's scene."""
    one = fitting.scene_at(fitting.placed(fitting.sliding_scene(scene), shape), 0.0)
    grid = pixel_grid(one, shape).every(_THIN)
    order = make_picture(one, state_difference(one, scene_states(one)[-1], grid), grid).order
    wanted = _MARGIN * float(np.nanmax(order)) / Compact(1.0, 16).largest
    return FINEST_STEP * max(1, math.ceil(wanted / FINEST_STEP))


class KeyFrames:
    """The frames from one key frame to the next, each followed from the one before."""

    def __init__(self, source: FrameSource, kind: TrackedFilm, key: ProcessedFrame) -> None:
        """`source`, where frames are processed wholly too, as the first, `key`, was."""
        self.source, self.kind, self._alone = source, kind, key
        capture = source.capture
        given = source.task.scene if kind.apparatus is None else kind.apparatus.scene
        self.scene = fitting.placed(fitting.sliding_scene(given), source.reader.shape)
        self.keys = fitting.free_keys(self.scene)
        self.tracker = fitting.Tracker(
            self.scene, self.keys, bit_depth=capture.bit_depth,
            no_load=(capture.dark, capture.bright), apparatus=kind.apparatus, alone=self._whole,
        )  # fmt: skip

    def follow(self, frame: Frame) -> ProcessedFrame:
        """One frame more."""
        label, distance = place_of(self.source.task.scene, frame)
        fields = frame_fields(frame, self.scene) | {"label": label, "distance_m": distance}
        try:
            tracked = self.tracker.track(frame, fitting.slid_until(self.scene, frame))
            columns: dict[str, Any] = value_columns(
                self.keys, tracked.values, tracked.standard_uncertainty
            )
            if tracked.positive:
                columns[FOUND_BY] = SEARCHED if tracked.searched else FOLLOWED
            result = ProcessedFrame(
                **fields, chi=tracked.chi, columns=columns, warnings=tracked.warnings
            )
            if self.kind.maps != "all" or not tracked.positive:
                return result
            # its orders are read on the branches of the followed model
            data, model, scene = self.tracker.model_frame(frame)
            reading, noise, lost = read_frame(frame, data, model, chi=tracked.chi, positive=True)
            if lost:
                return result
            largest, of_largest = largest_with_model(reading, model, scene)
            notes = (*tracked.warnings, *of_share(reading), *of_largest)
            columns |= {"kept_share": reading.kept} | largest
            return replace(result, reading=reading, noise=noise, columns=columns, warnings=notes)
        except IsochromeError as error:
            if not self.source.task.keep_going:
                raise
            return ProcessedFrame(**fields, warnings=(str(error),), failed=True)

    def _whole(self, frame: Frame) -> tuple[Scene, fitting.FrameFit] | None:
        """A frame processed wholly. What is not tracked, as an unknown gamma or a smooth stress,
        it alone tells."""
        if self._alone.index != frame.index:  # as if it were a key frame
            with suppress(PhysicsError):
                self._alone = self.source.processed(frame.index, [frame])
        fit = self._alone.fit
        if fit is None or self._alone.index != frame.index or not self._alone.has_values:
            return None
        values = {
            name: float(value)
            for name, value in zip(fit.keys, fit.values, strict=True)
            if name in (fitting.GAMMA, *fitting.SMOOTH_KEYS)
            or isinstance(self.scene.get(name), int | float)
        }
        return self.scene.with_values(values), fit
