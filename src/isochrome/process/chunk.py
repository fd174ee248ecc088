"""A chunk of a set: what is found in its frames, as pictures, rows and parts of files."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from isochrome.fringes.skeleton import Skeleton, skeleton_table
from isochrome.output import csv_text
from isochrome.output.roi import add_rois, roi_entries
from isochrome.process.course import is_told
from isochrome.process.followed import NOTHING, WHOLE, FollowedFrame
from isochrome.process.processed import orders_are_read
from isochrome.process.recipe import Recipe, opened
from isochrome.process.result import ProcessedFrame
from isochrome.process.tracked import tracked_states
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


def process_chunk(recipe: Recipe, start: int, stop: int) -> Results:
    """What is found in the states [start, stop) of a set.

    Parameters: `recipe`; `start`, `stop`. Returns Results. Raises InputError, PhysicsError.
    """
    source = opened(recipe)
    if recipe.every is not None:
        return gather(recipe, tracked_states(source, start, stop))
    return gather(recipe, source.states(start, stop))


def gather(recipe: Recipe, states: Iterable[ProcessedFrame | FollowedFrame]) -> Results:
    """Processed frames as Results; they are let go one by one."""
    layers = layers_of(recipe.scene)
    pictures: dict[str, list[np.ndarray]] = {layer.name: [] for layer in layers}
    rows, more = [], []
    tables: list[str] = []
    rois: list[tuple[str, bytes]] = []
    for item in states:
        rows.append(row_of(item, recipe))
        more.append(item.more() if isinstance(item, FollowedFrame) else _more(item, recipe.scene))
        if isinstance(item, FollowedFrame):
            continue
        maps = item.maps()
        for name, seen in pictures.items():
            # no order was read: none is known, and none can be relied upon
            empty = 0.0 if name == CONFIDENCE.name else np.nan
            blank = np.full(item.normalised.shape, empty, dtype=np.float32)
            seen.append(maps.get(name, blank))
        # where a model was fitted, its frames can be drawn anew: lines are for who asks
        lines = item.skeleton() if recipe.rois or item.fit is None else []
        if lines:
            text = csv_text(_points(item, lines, recipe.scene))
            tables.append(text if not tables else text.partition("\n")[2])
        if recipe.rois:
            rois += roi_entries(lines, frames=[item.index] * len(lines))
    arrays = {name: np.stack(seen) for name, seen in pictures.items()}
    parts = {LINES: "".join(tables).encode()} if tables else {}
    parts |= {ROIS: _zipped(rois)} if recipe.rois else {}
    return Results(arrays, rows, more, parts)


def row_of(item: ProcessedFrame | FollowedFrame, recipe: Recipe) -> dict[str, Any]:
    """A frame's row of frames.csv; of a tracked video with its place in the stacks of pictures."""
    row = item.row()
    if recipe.every is None or isinstance(item, FollowedFrame):
        return row
    found_by = WHOLE if is_told(item) else NOTHING
    own = {"picture": item.index // recipe.every, "found_by": found_by}
    return {name: row[name] for name in ("frame", "name", "label")} | own | row


def _more(item: ProcessedFrame, scene: Scene) -> dict[str, Any]:
    """What the dataset and the figure need to know besides the row."""
    left, top = item.corner_mm(scene)
    kept = item.reading.kept if item.reading is not None else None
    return {
        "status": item.status,
        "time_s": item.time_s,
        "left_mm": left,
        "top_mm": top,
        "read": item.reading is not None,
        "kept": kept,
    }


def _points(item: ProcessedFrame, lines: list[Skeleton], scene: Scene) -> dict[str, Any]:
    """A frame's part of skeleton.csv."""
    left, top = item.corner_mm(scene)
    table = skeleton_table(lines, pixel_mm=item.pixel_mm, left_mm=left, top_mm=top)
    return {"frame": np.full(len(table["line"]), item.index), **table}


def _zipped(rois: list[tuple[str, bytes]]) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        add_rois(archive, rois)
    return data.getvalue()


def joined_tables(parts: Iterable[bytes], write: Callable[[bytes], object]) -> None:
    """Chunks' tables as one: the head of the first, the rows of all; `write` takes the pieces."""
    for number, part in enumerate(parts):
        write(part if number == 0 else part.partition(b"\n")[2])


def joined_rois(parts: Iterable[bytes], archive: zipfile.ZipFile) -> None:
    """Chunks' ROIs in one open .zip."""
    for part in parts:
        with zipfile.ZipFile(io.BytesIO(part)) as own:
            add_rois(archive, ((name, own.read(name)) for name in own.namelist()))


def lines_of(table: bytes, frames: set[int]) -> dict[int, list[Skeleton]]:
    """The fringe lines of some frames, read back from a chunk's table."""
    import csv

    found: dict[int, list[Skeleton]] = {}
    points: dict[tuple[int, int], list[dict[str, str]]] = {}
    for row in csv.DictReader(io.StringIO(table.decode())):
        if int(row["frame"]) in frames:
            points.setdefault((int(row["frame"]), int(row["line"])), []).append(row)
    for (frame, _), own in points.items():
        order = own[0]["order"]
        at = [np.array([float(row[name]) for row in own]) for name in ("row_px", "col_px")]
        kind: Any = own[0]["kind"]
        line = Skeleton(kind, at[0], at[1], float(order) if order else None)
        found.setdefault(frame, []).append(line)
    return found
