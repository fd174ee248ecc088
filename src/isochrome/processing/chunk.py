"""A chunk of a set: what is found in its frames, as pictures, rows and parts of files."""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Iterable
from itertools import groupby
from typing import Any, cast

import numpy as np

from isochrome.fringes import Skeleton, skeleton_table
from isochrome.output import add_rois, csv_text, roi_entries
from isochrome.processing.frame_task import FrameTask, open_set
from isochrome.processing.kinds.tracked import tracked_states
from isochrome.processing.processed import orders_are_read
from isochrome.processing.result import (
    NOTHING,
    SPREAD,
    WHOLE,
    FollowedFrame,
    ProcessedFrame,
    frame_columns,
    row_of_set,
)
from isochrome.runs import Layer, Results
from isochrome.scene import Scene

LINES, ROIS = "skeleton.csv", "skeleton.zip"

NORMALISED = Layer("normalised", "1", "signal, 0 in darkness and 1 in the brightest field")
ORDER = Layer("fringe_order", "1", "fringe order N")
CONFIDENCE = Layer("confidence", "1", "probability that the order is right to 1/20 fringe")
ISOCLINIC = Layer("isoclinic", "degree", "direction of sigma_1, counter-clockwise from x")


def layers_of(scene: Scene) -> tuple[Layer, ...]:
    """The maps that a scene's frames give."""
    if not orders_are_read(scene):
        return (NORMALISED,)
    return (NORMALISED, ORDER, CONFIDENCE, *([ISOCLINIC] if scene.polariscope.step else []))


def process_chunk(recipe: FrameTask, start: int, stop: int) -> Results:
    """What is found in the states [start, stop) of a set.

    Parameters: `recipe`; `start`, `stop`. Returns Results. Raises InputError, PhysicsError.
    """
    source = open_set(recipe)
    if recipe.every is not None:
        return gather(recipe, tracked_states(source, start, stop))
    return gather(recipe, source.states(start, stop))


def gather(recipe: FrameTask, states: Iterable[ProcessedFrame | FollowedFrame]) -> Results:
    """Processed frames as Results; they are let go one by one."""
    layers = layers_of(recipe.scene)
    pictures: dict[str, list[np.ndarray]] = {layer.name: [] for layer in layers}
    rows, more = [], []
    tables: list[str] = []
    rois: list[tuple[str, bytes]] = []
    for item in states:
        rows.append(frame_row(item, recipe))
        more.append(more_of(item, recipe.scene))
        if isinstance(item, FollowedFrame):
            continue
        for name, seen in pictures.items():
            seen.append(picture_of(item, name))
        # where a model was fitted, its frames can be drawn anew, and a film has thousands of them:
        # lines are for who asks
        alone = item.fit is None and not recipe.follows_fringes
        lines = item.skeleton() if recipe.rois or alone else []
        if lines:
            left, top = item.corner_mm(recipe.scene)
            points = skeleton_table(lines, pixel_mm=item.pixel_mm, left_mm=left, top_mm=top)
            number = np.full(len(points["line"]), item.index)
            tables.append(csv_text({"frame": number, **points}, header=not tables))
        if recipe.rois:
            rois += roi_entries(lines, item.index)
    arrays = {name: np.stack(seen) for name, seen in pictures.items()}
    parts = {LINES: "".join(tables).encode()} if tables else {}
    if recipe.rois:
        data = io.BytesIO()
        with zipfile.ZipFile(data, "w") as archive:
            add_rois(archive, rois)
        parts[ROIS] = data.getvalue()
    return Results(arrays, rows, more, parts)


def frame_row(item: ProcessedFrame | FollowedFrame, recipe: FrameTask) -> dict[str, Any]:
    """A frame's row of frames.csv; of a tracked video with its place in the stacks of pictures."""
    row, columns = item.row(), frame_columns(recipe.scene, tracked=recipe.every is not None)
    if recipe.every is not None and isinstance(item, ProcessedFrame):
        found_by = WHOLE if item.has_values else NOTHING
        row |= {"picture": item.index // recipe.every, "found_by": found_by}
        held = {} if recipe.apparatus is None else recipe.apparatus.values
        for key, (value, spread) in held.items():
            row |= {key: value, f"{key} {SPREAD}": spread}
    return row_of_set(row, columns)


def picture_of(item: ProcessedFrame, name: str) -> np.ndarray:
    """A layer's picture of a frame (rows, cols), blank where it has none."""
    found = item.maps().get(name)
    if found is not None:
        return found
    # no order was read: none is known, and none can be relied upon
    empty = 0.0 if name == CONFIDENCE.name else np.nan
    return np.full(item.normalised.shape, empty, dtype=np.float32)


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
    found: dict[int, list[Skeleton]] = {}
    points = csv.DictReader(io.StringIO(table.decode()))
    wanted = (row for row in points if int(row["frame"]) in frames)
    for (frame, _), line in groupby(wanted, key=lambda row: (int(row["frame"]), row["line"])):
        own = list(line)
        order, kind = own[0]["order"], cast(Any, own[0]["kind"])
        at = [np.array([float(row[name]) for row in own]) for name in ("row_px", "col_px")]
        skeleton = Skeleton(kind, at[0], at[1], float(order) if order else None)
        found.setdefault(frame, []).append(skeleton)
    return found
