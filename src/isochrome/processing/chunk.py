"""A chunk of a set: what is found in its frames, as pictures, rows and parts of files."""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import groupby
from time import monotonic
from typing import Any, cast

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.fitting import Apparatus, find_apparatus, free_keys, sliding_scene
from isochrome.frames import Frame
from isochrome.fringes import Skeleton, skeleton_table
from isochrome.output import add_rois, csv_text, roi_entries
from isochrome.processing.frame_task import FrameSource, FrameTask, open_set
from isochrome.processing.kinds.film_keys import prepare_keyed
from isochrome.processing.kinds.film_unloaded import prepare_unloaded
from isochrome.processing.kinds.tracked import tracked_states
from isochrome.processing.pictures.preview import write_preview
from isochrome.processing.result import (
    FOUND_BY,
    NOTHING,
    PICTURE,
    SPREAD,
    WHOLE,
    FollowedFrame,
    ProcessedFrame,
    frame_columns,
    row_of_set,
)
from isochrome.progress import STAGE_EVERY_S, RunProgress, Tally
from isochrome.runs import Compact, Layer, Results, RunLayout, chunk_size
from isochrome.scene import Scene

LINES, ROIS = "skeleton.csv", "skeleton.zip"

NORMALISED = Layer("normalised", "1", "signal, 0 in darkness and 1 in the brightest field")
ORDER = Layer("fringe_order", "1", "fringe order N")
CONFIDENCE = Layer("confidence", "1", "probability that the order is right to 1/20 fringe")
ISOCLINIC = Layer("isoclinic", "degree", "direction of sigma_1, counter-clockwise from x")


_CONFIDENCE_STEP = 1.0 / 254.0
"""Of one byte, whose last value stands for what is not known."""

FOLLOWING = "following the fringes"
"""What is done with a film's frames before they are read."""

ALONE = "each frame is read by itself: {}"
OR_ALONE = "{}, or leave --track out: each frame is then read by itself"

FILM = (ORDER.name, CONFIDENCE.name)
"""Maps of every frame of a video that is followed."""


def task_layers(task: FrameTask) -> tuple[Layer, ...]:
    """The maps that a set's run leaves."""
    layers = layers_of(task.scene)
    if task.every is None or task.maps == "key":
        return layers
    if task.maps == "none":
        return ()
    selected = {
        ORDER.name: Compact(task.order_step, 16, task.pages),
        CONFIDENCE.name: Compact(_CONFIDENCE_STEP, 8, task.pages),
    }
    return tuple(replace(layer, compact=selected.get(layer.name)) for layer in layers)


def layers_of(scene: Scene) -> tuple[Layer, ...]:
    """The maps that a scene's frames give."""
    if not scene.orders_are_read:
        return (NORMALISED,)
    return (NORMALISED, ORDER, CONFIDENCE, *([ISOCLINIC] if scene.polariscope.step else []))


def set_layout(source: FrameSource, count: int) -> RunLayout:
    """What a set's run leaves: its maps over frame, row and column."""
    rows, cols = source.reader.shape
    every = source.recipe.every
    return RunLayout(
        axes={"frame": count},
        shape={"row": rows, "col": cols},
        layers=task_layers(source.recipe),
        chunk=every or chunk_size(count, 4 * rows * cols),
        every=every or 1,
    )


def apparatus_of(source: FrameSource, count: int) -> Apparatus:
    """What the frames of a video have in common, asked of a few of its frames.

    Parameters: `source`; `count` of the frames. Returns an Apparatus.
    """
    scene, capture = sliding_scene(source.recipe.scene), source.capture
    no_load = capture.dark, capture.bright
    return find_apparatus(source.reader, scene, free_keys(scene), count=count, no_load=no_load)


def with_film(source: FrameSource, count: int, progress: RunProgress | None) -> FrameTask:
    """The recipe of a film without a model, as it is followed through its `count` frames.

    A video that is followed by default, and is no film, has its frames read one by one, and says
    so. Parameters: `source`; `count`; `progress`, called in each pass. Returns a FrameTask. Raises
    PhysicsError where it was to be followed and cannot be.
    """
    task = source.recipe
    again = partial(_told_of, partial(source.captured, 0, count), count, progress)
    more: dict[str, Any] = {"chunk": set_layout(source, count).chunk, "count": count}
    if task.key_every is None:
        film = prepare_unloaded(again, task.scene, source.capture, **more)
        return replace(task, film=film)
    try:
        film = prepare_keyed(again, task.scene, source.capture, every=task.key_every, **more)
    except PhysicsError as error:
        if not task.if_film:
            raise PhysicsError(OR_ALONE.format(error)) from error
        return replace(task, key_every=None, note=ALONE.format(error))
    return replace(task, film=film)


def _told_of(
    captured: Callable[[], Iterator[tuple[int, list[Frame]]]],
    count: int,
    progress: RunProgress | None,
) -> Iterator[tuple[int, list[Frame]]]:
    """Frames of a pass over a film, which is told of where it takes some seconds."""
    told = monotonic()
    for index, frames in captured():
        if progress is not None and monotonic() - told >= STAGE_EVERY_S:
            told = monotonic()
            progress(Tally(index, count, 0, 0, stage=FOLLOWING))
        yield index, frames


def process_chunk(task: FrameTask, start: int, stop: int) -> Results:
    """What is found in the states [start, stop) of a set.

    Parameters: `task`; `start`, `stop`. Returns Results. Raises InputError, PhysicsError.
    """
    source = open_set(task)
    if task.every is not None:
        return gather(task, tracked_states(source, start, stop))
    return gather(task, source.states(start, stop))


def gather(task: FrameTask, states: Iterable[ProcessedFrame | FollowedFrame]) -> Results:
    """Processed frames as Results; they are let go one by one."""
    layers = task_layers(task)
    compact = {layer.name: layer.compact for layer in layers if layer.compact is not None}
    pictures: dict[str, list[np.ndarray]] = {
        layer.name: [] for layer in layers if layer.name not in compact
    }
    packed: dict[str, list[bytes | None]] = {name: [] for name in compact}
    rows, more = [], []
    tables: list[str] = []
    rois: list[tuple[str, bytes]] = []
    for item in states:
        item = _within(item, compact.get(ORDER.name))
        if task.preview is not None:
            write_preview(task.preview, item)
        rows.append(frame_row(item, task))
        more.append(more_of(item, task.scene))
        for name, kind in compact.items():
            made = film_map(item, name)
            packed[name].append(None if made is None else kind.pack(made))
        if isinstance(item, FollowedFrame):
            continue
        for name, seen in pictures.items():
            seen.append(picture_of(item, name))
        # where a model was fitted, its frames can be drawn anew, and a film has thousands of them:
        # lines are for who asks
        alone = item.fit is None and not task.follows_fringes
        lines = item.skeleton() if task.rois or alone else []
        if lines:
            left, top = item.corner_mm(task.scene)
            points = skeleton_table(lines, pixel_mm=item.pixel_mm, left_mm=left, top_mm=top)
            number = np.full(len(points["line"]), item.index)
            tables.append(csv_text({"frame": number, **points}, header=not tables))
        if task.rois:
            rois += roi_entries(lines, item.index)
    arrays = {name: np.stack(seen) for name, seen in pictures.items()}
    parts = {LINES: "".join(tables).encode()} if tables else {}
    if task.rois:
        data = io.BytesIO()
        with zipfile.ZipFile(data, "w") as archive:
            add_rois(archive, rois)
        parts[ROIS] = data.getvalue()
    return Results(arrays, rows, more, parts, packed=packed)


def _within(
    item: ProcessedFrame | FollowedFrame, kind: Compact | None
) -> ProcessedFrame | FollowedFrame:
    """A frame, that says where its orders go beyond what the store's steps reach."""
    if kind is None or item.reading is None:
        return item
    above = int(np.count_nonzero(item.reading.order > kind.largest))
    if not above:
        return item
    text = (
        f"{above} pixels have orders above {kind.largest:.4g} fringes, which run.zarr cannot hold, "
        "and are not known there; state the load nearer"
    )
    return replace(item, warnings=(*item.warnings, text))


def frame_row(item: ProcessedFrame | FollowedFrame, task: FrameTask) -> dict[str, Any]:
    """A frame's row of frames.csv; of a tracked video with its place in the stacks of pictures."""
    row, columns = item.row(), frame_columns(task.scene, tracked=task.every is not None)
    if task.every is not None and isinstance(item, ProcessedFrame):
        found_by = WHOLE if item.has_values else NOTHING
        place = None if task.maps == "none" else item.index // task.every
        row |= {PICTURE: place, FOUND_BY: found_by}
        held = {} if task.apparatus is None else task.apparatus.values
        for key, (value, spread) in held.items():
            row |= {key: value, f"{key} {SPREAD}": spread}
    return row_of_set(row, columns, task.scene)


def picture_of(item: ProcessedFrame, name: str) -> np.ndarray:
    """A layer's picture of a frame (rows, cols), blank where it has none."""
    result = item.maps().get(name)
    if result is not None:
        return result
    return blank_map(name, item.normalised.shape)


def blank_map(name: str, shape: tuple[int, ...]) -> np.ndarray:
    """A map of a frame of which nothing was read: no order is known, and none can be relied upon.

    Parameters: `name` of the map; `shape` (rows, cols).
    """
    empty = 0.0 if name == CONFIDENCE.name else np.nan
    return np.full(shape, empty, dtype=np.float32)


def film_map(item: ProcessedFrame | FollowedFrame, name: str) -> np.ndarray | None:
    """The order or confidence of any frame of a video (rows, cols); None where none was read."""
    if item.reading is None:
        return None
    return item.reading.order if name == ORDER.name else item.reading.confidence


def more_of(item: ProcessedFrame | FollowedFrame, scene: Scene) -> dict[str, Any]:
    """What the dataset and the figure need to know besides the row."""
    left, top = item.corner_mm(scene)
    return {
        "status": item.status,
        "time_s": item.time_s,
        "left_mm": left,
        "top_mm": top,
        "read": item.reading is not None,
        "kept": item.reading.kept if item.reading is not None else None,
    }


def lines_of(table: bytes, frames: set[int]) -> dict[int, list[Skeleton]]:
    """The fringe lines of some frames, read back from a chunk's table."""
    result: dict[int, list[Skeleton]] = {}
    points = csv.DictReader(io.StringIO(table.decode()))
    wanted = (row for row in points if int(row["frame"]) in frames)
    for (frame, _), line in groupby(wanted, key=lambda row: (int(row["frame"]), row["line"])):
        own = list(line)
        order, kind = own[0]["order"], cast(Any, own[0]["kind"])
        at = [np.array([float(row[name]) for row in own]) for name in ("row_px", "col_px")]
        skeleton = Skeleton(kind, at[0], at[1], float(order) if order else None)
        result.setdefault(frame, []).append(skeleton)
    return result
