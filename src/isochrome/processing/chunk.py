"""A chunk of a set: what is found in its frames, as pictures, rows and parts of files."""

import csv
import io
import zipfile
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace
from itertools import groupby
from typing import Any, cast

import numpy as np

from isochrome.fringes import Skeleton, skeleton_table
from isochrome.messages import frame_messages, message
from isochrome.output import add_rois, csv_text, roi_entries
from isochrome.processing.frame_task import FrameSource, FrameTask, open_set
from isochrome.processing.kinds.kind import CONFIDENCE, ORDER
from isochrome.processing.pictures.preview import write_preview
from isochrome.processing.result import FollowedFrame, ProcessedFrame
from isochrome.runs import Compact, Results, RunLayout, chunk_size
from isochrome.scene import Scene

LINES, ROIS = "skeleton.csv", "skeleton.zip"

FILM = (ORDER.name, CONFIDENCE.name)
"""Maps of every frame of a video that is followed."""


def set_layout(source: FrameSource, count: int) -> RunLayout:
    """What a set's run leaves: its maps over frame, row and column."""
    rows, cols = source.reader.shape
    kind = source.task.kind
    return RunLayout(
        axes={"frame": count},
        shape={"row": rows, "col": cols},
        layers=kind.layers(source.task.scene),
        chunk=kind.key_step or chunk_size(count, 4 * rows * cols),
        every=kind.key_step or 1,
    )


def process_chunk(task: FrameTask, start: int, stop: int) -> Results:
    """What is found in the states [start, stop) of a set. Raises InputError, PhysicsError."""
    return gather(task, task.kind.states(open_set(task), start, stop))


def gather(task: FrameTask, states: Iterable[ProcessedFrame | FollowedFrame]) -> Results:
    """Processed frames as Results; they are let go one by one."""
    layers = task.kind.layers(task.scene)
    steps = next((layer.compact for layer in layers if layer.name == ORDER.name), None)
    pictures, packed = defaultdict[str, list[Any]](list), defaultdict[str, list[Any]](list)
    rows, more = [], []
    tables: list[str] = []
    rois: list[tuple[str, bytes]] = []
    for item in states:
        item = _within(item, steps)
        if task.preview is not None:
            write_preview(task.preview, item)
        rows.append(task.kind.row(item, task.scene))
        more.append(more_of(item, task.scene))
        for layer in layers:
            if layer.compact is not None:
                made = item.maps().get(layer.name)
                packed[layer.name].append(None if made is None else layer.compact.pack(made))
            elif isinstance(item, ProcessedFrame):
                pictures[layer.name].append(picture_of(item, layer.name, item.normalised.shape))
        if isinstance(item, FollowedFrame):
            continue
        lines = _lines_to_keep(task, item)
        if lines:
            left, top = item.corner_mm(task.scene)
            points = skeleton_table(lines, pixel_mm=item.pixel_mm, left_mm=left, top_mm=top)
            number = np.full(len(points["line"]), item.index)
            tables.append(csv_text({"frame": number, **points}, header=not tables))
        if task.rois:
            rois += roi_entries(lines, item.index)
    parts = {LINES: "".join(tables).encode()} if tables else {}
    if task.rois:
        data = io.BytesIO()
        with zipfile.ZipFile(data, "w") as archive:
            add_rois(archive, rois)
        parts[ROIS] = data.getvalue()
    arrays = {name: np.stack(maps) for name, maps in pictures.items()}
    return Results(arrays, rows, more, parts, packed=dict(packed))


def _lines_to_keep(task: FrameTask, item: ProcessedFrame) -> list[Skeleton]:
    """The fringe lines of a frame; with a model, which can draw them anew, for who asks alone."""
    wanted = task.rois or (item.fit is None and task.kind.draws_lines)
    return item.skeleton() if wanted else []


def _within(
    item: ProcessedFrame | FollowedFrame, kind: Compact | None
) -> ProcessedFrame | FollowedFrame:
    """A frame, that says where its orders go beyond what the store's steps reach."""
    if kind is None or item.reading is None:
        return item
    above = int(np.count_nonzero(item.reading.order > kind.largest))
    if not above:
        return item
    text = message("pixels_have_orders_above", above=above, largest=kind.largest)
    return replace(item, warnings=(*item.warnings, text))


def picture_of(
    item: ProcessedFrame | FollowedFrame, name: str, shape: tuple[int, ...]
) -> np.ndarray:
    """A layer's picture of a frame (rows, cols).

    Where it has none, no order is known, and none can be relied on.
    """
    if (result := item.maps().get(name)) is not None:
        return result
    return np.full(shape, 0.0 if name == CONFIDENCE.name else np.nan, dtype=np.float32)


def more_of(item: ProcessedFrame | FollowedFrame, scene: Scene) -> dict[str, Any]:
    """What the dataset and the figure need to know besides the row."""
    left, top = item.corner_mm(scene)
    return {
        "status": item.status,
        "messages": frame_messages(item.warnings),
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
        points_of_line = list(line)
        order, kind = points_of_line[0]["order"], cast(Any, points_of_line[0]["kind"])
        rows, cols = (np.array([float(p[n]) for p in points_of_line]) for n in ("row_px", "col_px"))
        skeleton = Skeleton(kind, rows, cols, float(order) if order else None)
        result.setdefault(frame, []).append(skeleton)
    return result
