"""What `process` finds in one frame, and how it is written down."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fitting import FrameFit, stated_pairs
from isochrome.frames import Frame, Linear
from isochrome.fringes import SHORTEST_PX, OrderReading, Skeleton, number_lines, order_contours
from isochrome.output import FrameValues, agree, numbers
from isochrome.processing.kinds.largest_order import ORDER_FROM
from isochrome.scene import Scene
from isochrome.stress import pixel_grid

if TYPE_CHECKING:
    from isochrome.calibration import Overlay
    from isochrome.fringes import ColourTable, ResidualStress

Array = NDArray[Any]

SPREAD = "standard_uncertainty"
"""What follows a key in the name of the column that holds its uncertainty."""

WHOLE, FOLLOWED, SEARCHED, NOTHING = "whole frame", "track", "search", "nothing"
FOUND_BY = "found_by"
"""How a frame's values were found, in frames.csv of a tracked video, and its column."""

PICTURE = "picture"
"""Column of frames.csv of a tracked video: where a key frame lies in the stacks of pictures."""

SEPARATOR = " | "
"""Between the warnings of a frame, in which there are semicolons."""

CAUSES = "causes"
"""Column of what frames asked for besides the scene's unknowns."""

REFINED = "refined"
"""Column of what frames know better than their scene states it, and agree with."""

EXPLAINED = "explained_share"
"""Column of the share of a frame's light that the frames of known loads explain."""


def row_of_set(row: dict[str, Any], columns: Iterable[str], scene: Scene) -> dict[str, Any]:
    """A frame's row as the set's columns have it: values of no column of theirs are its causes.

    Those that agree with what the scene states of them are refined instead.
    """
    result = {name: row.get(name) for name in columns}
    if ORDER_FROM in result:
        result[ORDER_FROM] = result[ORDER_FROM] or ""  # texts that are not known are empty
    if CAUSES not in result:
        return result
    causes = {
        key: (row[key], row[name])
        for key in row
        if key not in result and (name := f"{key} {SPREAD}") in row
    }
    stated = stated_pairs(scene) if REFINED in result else {}
    cells: dict[str, list[str]] = {CAUSES: [], REFINED: []}
    for key, (value, spread) in causes.items():
        near = key in stated and agree((value, spread), stated[key])
        cells[REFINED if near else CAUSES].append(f"{key} = {value!r} ± {spread!r}")
    return result | {name: "; ".join(texts) for name, texts in cells.items() if name in result}


def cell_values(text: str) -> dict[str, tuple[float, float]]:
    """What a cell of causes, or of refined values, holds: key to value and standard uncertainty."""
    parts = (re.split(" = | ± ", part) for part in text.split("; ") if part)
    return {key: (float(value), float(spread)) for key, value, spread in parts}


def corner_of(scene: Scene, shape: tuple[int, int]) -> tuple[float, float]:
    """Outer edges (mm) of a picture's first column and row; a model's are known without being
    stated, and without a camera they are 0.
    """
    camera = scene.camera
    if scene.has_model and camera is not None and camera.pixel_mm is not None:
        grid = pixel_grid(scene, shape)
        return grid.left_mm, grid.top_mm
    return (camera.left_mm or 0.0, camera.top_mm or 0.0) if camera else (0.0, 0.0)


@dataclass(frozen=True)
class Capture:
    """How a set was captured: the sensor's `bit_depth`, the `dark` and `bright` no-load frames.

    Where colours tell the order, these are (rows, cols, 3), and `table` has the channels' signals
    against order; `series`, the frames of known loads; `residual`, the stress to take out of steps.
    """

    bit_depth: int | None
    dark: Linear | None = None
    bright: Linear | None = None
    table: ColourTable | None = None
    series: Overlay | None = None
    residual: ResidualStress | None = None


@dataclass(frozen=True, kw_only=True)
class ProcessedFrame:
    """What was found in one frame; maps are (row, col), NaN = not known.

    `normalised`, the signal 0 to 1, None of a frame that was followed between two key frames, and
    its `noise`; the order's `reading`; with a model the `fit`, else the fringe `lines`; what else
    stands in its `columns`; `isoclinic`, the direction of sigma_1 (degrees) of phase steps; `chi`
    of the whole frame; `failed`: nothing could be found.
    """

    index: int
    name: str
    label: str
    distance_m: float = float("nan")
    time_s: float | None = None
    pixel_mm: float | None = None
    reading: OrderReading | None = None
    warnings: tuple[str, ...] = ()
    failed: bool = False
    normalised: Array | None = None
    fit: FrameFit | None = None
    lines: list[Skeleton] = field(default_factory=list)
    noise: float = float("nan")
    chi: float = float("nan")
    isoclinic: Array | None = None
    columns: dict[str, Any] = field(default_factory=dict)

    @property
    def status(self) -> str:
        """'ok', 'flagged' (there are warnings) or 'failed'."""
        return "failed" if self.failed else "flagged" if self.warnings else "ok"

    @property
    def has_values(self) -> bool:
        """Whether the frame shows the scene's model, and so has values."""
        return self.fit is not None and bool(np.isfinite(self.fit.values).all())

    def skeleton(self) -> list[Skeleton]:
        """The fringe lines, with their orders where the frame has a reading.

        Those that the frame shows; where nobody looked for them, the reading's own half orders.
        """
        if self.reading is None:
            return self.lines
        if self.lines:
            return number_lines(self.lines, self.reading.order)
        return order_contours(self.reading.order, min_length_px=SHORTEST_PX)

    def corner_mm(self, scene: Scene) -> tuple[float, float]:
        """Outer edges (mm) of the first column and row, in the scene's axes; 0 without any.

        Of a followed frame those that were tracked, else NaN.
        """
        if self.normalised is None:
            edges = (self.columns.get(f"camera.{edge}_mm", np.nan) for edge in ("left", "top"))
            return next(edges), next(edges)
        rows, cols = self.normalised.shape[:2]
        return corner_of(scene if self.fit is None else self.fit.scene, (rows, cols))

    def maps(self) -> dict[str, Array]:
        """The maps that are written to disk (rows, cols), by the name of their file."""
        maps = {"normalised": self.normalised, "isoclinic": self.isoclinic}
        if self.reading is not None:
            maps |= {"fringe_order": self.reading.order, "confidence": self.reading.confidence}
        return {name: values for name, values in maps.items() if values is not None}

    def row(self) -> dict[str, Any]:
        """The frame's row of frames.csv."""
        row: dict[str, Any] = {"frame": self.index, "name": self.name, "label": self.label}
        row |= {"distance_m": self.distance_m, "chi": self.chi, "noise": self.noise}
        row |= {"pixel_mm": self.pixel_mm} | self.columns
        if not (self.failed or self.columns):
            row["fringe_lines"] = len(self.lines)
        return row | {"warnings": SEPARATOR.join(self.warnings)}


def frame_fields(frame: Frame, scene: Scene | None = None) -> dict[str, Any]:
    """The fields that a ProcessedFrame has of its captured frame, and of a scene's scale."""
    fields = {"index": frame.index, "name": frame.name, "label": frame.name, "time_s": frame.time_s}
    return fields | {"pixel_mm": scene.camera.pixel_mm if scene and scene.camera else None}


def failed_frame(frame: Frame, why: str) -> ProcessedFrame:
    """A frame in which nothing could be found, and the sentence that says why."""
    nothing = np.full(frame.image.shape[:2], np.nan, dtype=np.float32)
    return ProcessedFrame(**frame_fields(frame), normalised=nothing, warnings=(why,), failed=True)


def value_columns(
    keys: Iterable[str], values: Iterable[float], spreads: Iterable[float]
) -> dict[str, float]:
    """Columns of values by their keys, each with its standard uncertainty beside it."""
    result: dict[str, float] = {}
    for key, value, spread in zip(keys, values, spreads, strict=True):
        result |= {key: float(value), f"{key} {SPREAD}": float(spread)}
    return result


def own_values(table: Mapping[str, list[Any]], keys: Iterable[str], k: int) -> dict[str, float]:
    """What was fitted to a frame: the values of keys, and those that it asked for."""
    values = {key: table[key][k] for key in keys if table[key][k] is not None}
    cells = (table[name][k] or "" for name in (CAUSES, REFINED) if name in table)
    return values | {key: pair[0] for cell in cells for key, pair in cell_values(cell).items()}


def whole_frames(table: Mapping[str, Sequence[Any]]) -> list[bool]:
    """Which frames of a tracked video were processed wholly: whatever maps were wanted of them."""
    result = zip(table[PICTURE], table[FOUND_BY], strict=True)
    return [at is not None or by == WHOLE for at, by in result]


def fitted_keys(table: Mapping[str, Any]) -> tuple[str, ...]:
    """The columns of frames.csv that have a standard uncertainty beside them."""
    return tuple(name for name in table if f"{name} {SPREAD}" in table)


def fitted_pairs(row: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """A row's values that have a standard uncertainty, each with it, by their keys."""
    return {key: (row[key], row[f"{key} {SPREAD}"]) for key in fitted_keys(row)}


def frame_values(table: Mapping[str, Sequence[Any]]) -> FrameValues:
    """The fitted values of frames.csv."""
    keys, count = fitted_keys(table), len(table["frame"])
    values, spreads = (
        np.array([numbers(table[f"{key}{ending}"]) for key in keys]).reshape(len(keys), count).T
        for ending in ("", f" {SPREAD}")
    )
    none = [None] * count
    return FrameValues(
        keys=keys, values=values, standard_uncertainty=spreads, chi=numbers(table["chi"]),
        distance_m=numbers(table["distance_m"]),
        searched=np.array([result == SEARCHED for result in table.get(FOUND_BY, none)]),
        whole=np.array(whole_frames(table) if PICTURE in table else none, dtype=bool),
    )  # fmt: skip
