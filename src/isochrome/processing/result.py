"""What `process` finds in a frame and in a whole set, and how it is written down."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.special import chdtri

from isochrome import fitting, output
from isochrome.errors import InputError, PhysicsError
from isochrome.frames import Frame, Linear
from isochrome.fringes import SHORTEST_PX, OrderReading, Skeleton, number_lines, order_contours
from isochrome.messages import frame_messages, message, read_frame_messages, warnings_json
from isochrome.processing.kinds.largest_order import AT_LEAST, MODEL, ORDER_FROM, ORDER_SPREAD
from isochrome.runs import column_values, identifier, open_run
from isochrome.scene import Scene
from isochrome.simulation import no_model_sentence
from isochrome.stress import PixelGrid, pixel_grid

if TYPE_CHECKING:
    from isochrome.calibration import Overlay
    from isochrome.figures import PaperPanels
    from isochrome.fringes import ColourTable, ResidualStress
    from isochrome.runs import RunDataset

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
"""Column of what frames know better than their scene states it, and output.agree with."""

LOOKS_LIKE = "looks_like"
"""Column of what a frame's residual looks like: pages of the atlas, with the share of it that each
alone explains."""

EXPLAINED = "explained_share"
"""Column of the share of a frame's light that the frames of known loads explain."""


def row_of_set(row: dict[str, Any], columns: Iterable[str], scene: Scene) -> dict[str, Any]:
    """A frame's row as the set's columns have it: values of no column of theirs are its causes, or
    refined where they agree with what the scene states of them."""
    result = {name: row.get(name) for name in columns}
    for name in {ORDER_FROM, LOOKS_LIKE} & set(result):
        result[name] = result[name] or ""  # texts that are not known are empty
    if CAUSES not in result:
        return result
    causes = {
        key: (row[key], row[name])
        for key in row
        if key not in result and (name := f"{key} {SPREAD}") in row
    }
    stated = fitting.stated_pairs(scene) if REFINED in result else {}
    cells: dict[str, list[str]] = {CAUSES: [], REFINED: []}
    for key, (value, spread) in causes.items():
        near = key in stated and output.agree((value, spread), stated[key])
        cells[REFINED if near else CAUSES].append(f"{key} = {value!r} ± {spread!r}")
    return result | {name: "; ".join(texts) for name, texts in cells.items() if name in result}


def cell_values(text: str) -> dict[str, tuple[float, float]]:
    """What a cell of causes, or of refined values, holds: key to value and standard uncertainty."""
    parts = (re.split(" = | ± ", part) for part in text.split("; ") if part)
    return {key: (float(value), float(spread)) for key, value, spread in parts}


def pages_text(nearest: Sequence[tuple[str, float]]) -> str:
    """A cell of the atlas's pages: names with shares."""
    return "; ".join(f"{name} ({100.0 * share:.0f} %)" for name, share in nearest)


def pages_of(cell: str | None) -> tuple[tuple[str, str], ...]:
    """Names of a cell's pages, each with its share as a text."""
    return tuple(re.findall(r"(?:^|; )(.+?) \(([^()]*)\)(?=; |$)", cell or ""))


def corner_of(scene: Scene, shape: tuple[int, int]) -> tuple[float, float]:
    """Outer edges (mm) of a picture's first column and row; without a camera 0."""
    camera = scene.camera
    if scene.has_model and camera is not None and camera.pixel_mm is not None:
        grid = pixel_grid(scene, shape)
        return grid.left_mm, grid.top_mm
    return (camera.left_mm or 0.0, camera.top_mm or 0.0) if camera else (0.0, 0.0)


@dataclass(frozen=True)
class Capture:
    """How a set was captured: the sensor's `bit_depth`, the no-load frames, (rows, cols, 3) where
    colours tell the order, and then `table`, the channels' signals against order; `series`, the
    frames of known loads; `residual`, the stress to take out of steps."""

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
    fit: fitting.FrameFit | None = None
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
        """The fringe lines, with their orders where the frame has a reading. Those that the frame
        shows; where nobody looked for them, the reading's own half orders."""
        if self.reading is None:
            return self.lines
        if self.lines:
            return number_lines(self.lines, self.reading.order)
        return order_contours(self.reading.order, min_length_px=SHORTEST_PX)

    def corner_mm(self, scene: Scene) -> tuple[float, float]:
        """Outer edges (mm) of the first column and row, in the scene's axes; 0 without any. Of a
        followed frame those that were tracked, else NaN."""
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


@dataclass(frozen=True)
class FrameValue:
    """A value that was fitted to a frame, by its key of the scene. `asked`, whether the frame asked
    for it, besides the scene's unknowns; `refined`, whether the scene states it, the frame knows
    more of it, and both agree."""

    key: str
    value: float
    standard_uncertainty: float
    asked: bool
    refined: bool = False


@dataclass(frozen=True)
class FrameResult:
    """What `process` finds in a frame of a set, its row of frames.csv, and what that says."""

    frame: ProcessedFrame
    row: dict[str, Any]
    summary_text: str

    @property
    def values(self) -> tuple[FrameValue, ...]:
        """The fitted values; none where the frame does not show the scene's model."""
        causes, refined = (cell_values(self.row.get(name) or "") for name in (CAUSES, REFINED))
        keys = fitted_keys(self.row)
        pairs = {key: (self.row[key], self.row[f"{key} {SPREAD}"]) for key in keys}
        return tuple(
            FrameValue(key, float(value), float(spread), key in causes, key in refined)
            for key, (value, spread) in (pairs | causes | refined).items()
            if np.isfinite(output.numbers([value]))[0]
        )


def frame_fields(frame: Frame, scene: Scene | None = None) -> dict[str, Any]:
    """The fields that a ProcessedFrame has of its captured frame, and of a scene's scale."""
    fields = {"index": frame.index, "name": frame.name, "label": frame.name, "time_s": frame.time_s}
    return fields | {"pixel_mm": scene.camera.pixel_mm if scene and scene.camera else None}


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
    """Which frames were processed wholly: of a tracked video whatever maps were wanted of them."""
    if PICTURE not in table:
        return [True] * len(table["frame"])
    result = zip(table[PICTURE], table[FOUND_BY], strict=True)
    return [at is not None or by == WHOLE for at, by in result]


def fitted_keys(table: Mapping[str, Any]) -> tuple[str, ...]:
    """The columns of frames.csv that have a standard uncertainty beside them."""
    return tuple(name for name in table if f"{name} {SPREAD}" in table)


def frame_values(table: Mapping[str, Sequence[Any]]) -> output.FrameValues:
    """The fitted values of frames.csv."""
    keys, count = fitted_keys(table), len(table["frame"])
    values, spreads = (
        np.array([output.numbers(table[f"{key}{ending}"]) for key in keys])
        .reshape(len(keys), count)
        .T
        for ending in ("", f" {SPREAD}")
    )
    return output.FrameValues(
        keys=keys, values=values, standard_uncertainty=spreads, chi=output.numbers(table["chi"]),
        distance_m=output.numbers(table["distance_m"]),
        searched=np.array([by == SEARCHED for by in table.get(FOUND_BY, [None] * count)]),
        whole=np.array(whole_frames(table)) & (PICTURE in table),
    )  # fmt: skip


def set_grid(
    scene: Scene, fitted: Scene | None, table: Mapping[str, Sequence[Any]], shape: tuple[int, int]
) -> PixelGrid | None:
    """The grid of a set's maps: that of what was found, so that its simulation has the same.
    `fitted` has the frames' mean place. None where no scale is known."""
    pixels, place = output.numbers(table["pixel_mm"]), fitted or scene
    if not np.isfinite(pixels).any():
        return None
    if place.has_model and place.camera is not None and place.camera.pixel_mm is not None:
        return pixel_grid(place, shape)
    return PixelGrid(*shape, *corner_of(scene, shape), float(pixels[np.isfinite(pixels)][0]))


def shift_of(edge: str, grid: PixelGrid, table: Mapping[str, Sequence[Any]]) -> np.ndarray:
    """How far (mm) each frame's own left or top edge was found from the grid's; NaN = not known."""
    if (result := table.get(f"camera.{edge}_mm")) is None:
        return np.zeros(len(table["frame"]))  # nobody looked for it: all are where the scene says
    return np.asarray(output.numbers(result) - getattr(grid, f"{edge}_mm"))


_GAMMA = "gamma"
"""Column of frames.csv of what each frame's own fringes say, without a model."""

_CHANCE = 0.01
"""Probability with which gammas of one camera may scatter so far by their uncertainties alone."""

_OF_THE_PAST = 0.015
"""Shift of a frame's friction for each unit by which the friction was another before it. Of the
paper's contact it is -0.002 to 0.012 at 31 to 233 m, at three times its wear 0.014."""

_OF_PAST_LOADS = 0.3
"""Shift of a wear coefficient, over it, for each unit by which the loads before scattered, over
their mean, where one steady load stands for them. Of the paper's contact it is 0.05 to 0.28 at 10
to 180 m, with loads that swing by 5 and 10 %."""


def tabulate_set(rows: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Rows as columns, in order of first appearance, the one of the longest texts last."""
    return dict(sorted(output.columns_of(rows).items(), key=lambda item: item[0] == "warnings"))


def with_scatter_of_gamma(table: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """Widen the uncertainty of gammas that scatter by more: one camera has one gamma. Where chi² =
    sum ((g - mean)/u)² of n frames is what a chance of 1 % exceeds, of n - 1 degrees of freedom, u
    becomes the scatter, if larger, which is said. Source: Birge (1932), Phys. Rev. 40, 207."""
    name = f"{_GAMMA} {SPREAD}"
    if _GAMMA not in table:
        return table
    value, spread = output.numbers(table[_GAMMA]), output.numbers(table[name])
    known = np.flatnonzero(np.isfinite(value) & (spread > 0.0))
    if len(known) < 2:
        return table
    value_known, weight = value[known], spread[known] ** -2.0
    mean = float(np.average(value_known, weights=weight))
    if np.sum(weight * (value_known - mean) ** 2) <= chdtri(len(known) - 1, _CHANCE):
        return table
    scatter = float(np.std(value_known, ddof=1))
    least, largest = (int(known[k]) for k in (np.argmin(value_known), np.argmax(value_known)))
    text = message(
        "gamma_scatters_between_frames", value=value[least], frame=table["frame"][least],
        value_2=value[largest], frame_2=table["frame"][largest], scatter=scatter,
    )  # fmt: skip
    messages = list(table["messages"])
    for k in known:
        messages[k] = frame_messages((*read_frame_messages(messages[k]), text))
    texts = [SEPARATOR.join(read_frame_messages(cell)) for cell in messages]
    wider = _widened(table, name, known, np.full(len(known), scatter))
    return wider | {"warnings": texts, "messages": messages}


def with_past_friction(table: dict[str, list[Any]], scene: Scene) -> dict[str, list[Any]]:
    """Widen the uncertainty of frictions that were others before, while the block wore: friction
    shifts the pressure, so the scar remembers their mean over the distance slid. Where a frame
    differs from it, u becomes the shift, if larger; one that shows its past friction has it among
    its causes, and stays. The same object where nothing is wider."""
    name = f"{fitting.FRICTION} {SPREAD}"
    if scene.wear is None or name not in table:
        return table
    order, slid, friction = _over_distance(table, fitting.FRICTION)
    if not len(order):
        return table
    away = slid - slid[0]
    since = cumulative_trapezoid(friction, slid, initial=0.0)
    past = np.divide(since, away, out=friction.copy(), where=away > 0.0)
    causes = table.get(CAUSES) or [""] * len(table[name])
    shown = [fitting.EARLIER in cell_values(causes[k] or "") for k in order]
    shift = np.where(shown, 0.0, _OF_THE_PAST * np.abs(friction - past))
    return _widened(table, name, order, shift)


def with_past_loads(table: dict[str, list[Any]], scene: Scene) -> dict[str, list[Any]]:
    """Widen the uncertainty of wear coefficients whose block other loads have worn: of a frame by
    itself k is off by P'/P - 1, with P' the mean load over the distance slid, before the first
    frame taken for that of the others; a followed frame knows the loads since its track began.
    Their scatter does `_OF_PAST_LOADS` of it besides. The same object where nothing is wider."""
    name = f"{fitting.WEAR} {SPREAD}"
    if scene.wear is None or name not in table or f"{fitting.LOAD} {SPREAD}" not in table:
        return table
    order, slid, load = _over_distance(table, fitting.LOAD)
    if not len(order) or not slid[-1] > 0.0:
        return table
    first, span = slid[0], slid[-1] - slid[0]
    averages = []
    for values in (load, load * load):
        since = cumulative_trapezoid(values, slid, initial=0.0)
        before = first * (since[-1] / span if span > 0.0 else values.mean())
        averages.append(np.divide(before + since, slid, out=values.copy(), where=slid > 0.0))
    past, scatter = averages[0], np.sqrt(np.maximum(averages[1] - averages[0] ** 2, 0.0))
    found_by = table.get(FOUND_BY)
    by_itself = np.array([found_by is None or found_by[k] != FOLLOWED for k in order])
    begun = np.maximum.accumulate(np.where(by_itself, np.arange(len(order)), 0))
    scattered = _OF_PAST_LOADS * (slid * scatter / past)[begun]
    remembered = np.divide(scattered, slid, out=np.zeros(len(slid)), where=slid > 0.0)
    shift = np.where(by_itself, np.hypot(remembered, past / load - 1.0), remembered)
    return _widened(table, name, order, np.abs(output.numbers(table[fitting.WEAR]))[order] * shift)


def _widened(
    table: dict[str, list[Any]], name: str, order: Any, least: Any
) -> dict[str, list[Any]]:
    """A table whose uncertainties `name` are `least` (n,) at the least in some frames `order`."""
    wider = list(table[name])
    for k, shift in zip(order, least.tolist(), strict=True):
        if wider[k] is not None:
            wider[k] = max(wider[k], shift)  # that of a value that is not known, NaN, changes none
    return table if wider == table[name] else table | {name: wider}


def _over_distance(table: dict[str, list[Any]], key: str) -> tuple[Any, Any, Any]:
    """The frames that tell a key, in the order of their distances; these (m), and its values."""
    distance = output.numbers(table["distance_m"])
    value, spread = output.numbers(table[key]), output.numbers(table[f"{key} {SPREAD}"])
    known = np.flatnonzero(np.isfinite(distance) & np.isfinite(value) & np.isfinite(spread))
    order = known[np.argsort(distance[known], kind="stable")]
    return order, distance[order], value[order]


FIGURE = "process.png"

_NOTABLE = 0.02


@dataclass(frozen=True, repr=False, kw_only=True)
class Processed(output.FittedResult):
    """A set of processed frames.

    Parameters
    ----------
    draw : callable, optional
        Makes the figure.
    scene : Scene
        The scene as given.
    model : str or None
        The scene's model; None where there is none.
    columns : dict of str to list
        The columns of frames.csv.
    frames : list of ProcessedFrame or None
        The frames, of a tracked video its key frames; None where they were streamed.
    fitted : Scene or None
        The scene with the frames' fitted values (means; friction over distance); None where there
        is no model.
    warnings : tuple of str
        Those of the whole set.
    residual : ResidualStress, optional
        The residual stress that was taken out; None where nobody gave a no-load set.
    already : bool, default False
        Whether an earlier run had left it all.
    failed : int, default 0
        How many frames were left out.
    as_stated : bool, default False
        Whether the frames were asked for nothing but the scene's unknowns.
    messages : list of str
        The warnings of each frame as JSON: code, values and text; empty where there are none.
    load : callable, optional
        Makes the dataset.
    arrange : callable, optional
        Makes the panels of a figure for a paper.
    """

    scene: Scene
    model: str | None
    columns: dict[str, list[Any]]
    frames: list[ProcessedFrame] | None
    fitted: Scene | None
    warnings: tuple[str, ...]
    residual: ResidualStress | None = None
    already: bool = False
    failed: int = 0
    as_stated: bool = False
    messages: list[str] = field(default_factory=list)
    load: Callable[[], RunDataset] | None = field(default=None, compare=False)
    arrange: Callable[[Processed, tuple[int, ...] | None], PaperPanels] | None = field(
        default=None, compare=False
    )

    @property
    def dataset(self) -> RunDataset:
        """The maps and columns as an xarray.Dataset, the same in memory and of a folder.

        Maps are over (frame, z_mm, x_mm), or (frame, row, col) where no scale is known; see
        `open_run`, which reads those of a folder as they are used. Raises InputError.
        """
        if self.load is None:
            raise InputError("maps_not_kept_process", title=self.title)
        return self.load()

    @property
    def tracked(self) -> bool:
        """Whether most frames were followed from key frames."""
        return PICTURE in self.columns

    @property
    def over_frames(self) -> output.FrameValues:
        """The fitted values, to be drawn and summed up as those of other commands."""
        return frame_values(self.columns)

    @property
    def title(self) -> str:
        """The scene and how many frames there are."""
        count = len(self.columns["frame"])
        failed = f", {self.failed} of them failed" if self.failed else ""
        return f"Processed {output.counted(count, 'frame')} of {self.scene.name}{failed}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """What was fitted, how well, and how much was read."""
        yield from super().main_values()
        for name in ("n_max", ORDER_SPREAD, "chi", "kept_share", "fringe_lines"):
            if any(value is not None for value in self.columns.get(name, ())):
                digits = 2 if name == ORDER_SPREAD else 5
                text = output.over_items(self.columns[name], digits=digits)
                if name == "n_max":  # how many are from elsewhere than their frames
                    counts = Counter(self.columns.get(ORDER_FROM, ()))
                    words = {MODEL: "of the model", AT_LEAST: AT_LEAST}
                    text += "".join(f"; {counts[k]} {v}" for k, v in words.items() if counts[k])
                yield name, text

    @property
    def asks_causes(self) -> bool:
        """Whether frames may ask for more than the scene: not where no model is fitted."""
        return not self.scene.frames.has_known_loads

    @property
    def causes(self) -> list[str] | None:
        """What frames asked for besides the scene: keys, and how many frames did."""
        if self.as_stated or not self.asks_causes:
            return None
        cells = [cell_values(cell or "") for cell in self.columns.get(CAUSES, ())]
        counts = Counter(key for cell in cells for key in cell)
        return [
            f"{key} ({n} of {output.counted(len(cells), 'frame')})" for key, n in counts.items()
        ]

    @property
    def refined(self) -> list[str]:
        """What frames know better than the scene states it, and agree with."""
        cells = (cell_values(cell or "") for cell in self.columns.get(REFINED, ()))
        result = [(key, *pair) for cell in cells for key, pair in cell.items()]
        names = ("key", "value", SPREAD)
        rows = output.rows_by_key(
            {name: [row[k] for row in result] for k, name in enumerate(names)}
        )
        return output.refined_texts(rows.values(), fitting.stated_pairs(self.scene))

    @property
    def taken_as_exact(self) -> tuple[str, ...]:
        """Keys of the measured numbers whose uncertainty is in no ±."""
        keys = fitted_keys(self.columns)
        by_model = keys and self.scene.has_model and self.asks_causes
        return fitting.taken_as_exact(self.scene, keys, tracked=self.tracked) if by_model else ()

    @property
    def besides(self) -> list[str]:
        """What else than the pictures the ± are of."""
        known = not self.tracked and bool(fitting.stated_pairs(self.scene))
        return ["the stated uncertainties"] * known

    @property
    def summary_text(self) -> str:
        """What was found as a sentence, the same on the terminal and in a report."""
        return super().summary_text if self.rows else output.sentence_of_orders(self.columns)

    def to_json(self) -> dict[str, Any]:
        """The table of all frames, of a tracked video with what they come to."""
        result: dict[str, Any] = {"model": self.model, "frames": self.columns}
        result |= {"summary": self.summary()} if self.tracked else {}
        result |= {"summary_text": self.summary_text, "taken_as_exact": list(self.taken_as_exact)}
        return result | warnings_json(self.warnings)

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give the frames and their orders for a paper; see `paper_figure`.

        `frames`: numbers of those that are shown. Raises InputError where one is not there.
        """
        assert self.arrange is not None
        return self.arrange(self, frames)


def collect(
    scene: Scene,
    table: dict[str, list[Any]],
    more: Mapping[str, list[Any]],
    frames: list[ProcessedFrame] | None,
    shape: tuple[int, int],
    residual: ResidualStress | None = None,
    *,
    name: str = "",
) -> Processed:
    """Put the frames' findings together; `frames` is None where they were streamed. `more`, what
    stands beside the table: each frame's status and messages; `name`, what was read just now."""
    if name and not _has_read(scene, table):
        count, code = output.counted(len(table["frame"]), "frame"), fitting.CORRECT
        words = message(code if scene.orders_are_read else "isochrome_check_looks_frames")
        raise PhysicsError(
            "nothing_could_read_any_first", name=name, count=count, warnings=table["warnings"][0],
            words=words,
        )  # fmt: skip
    given = table | {"messages": more["messages"]}
    wider = with_past_loads(with_past_friction(with_scatter_of_gamma(given), scene), scene)
    messages = wider["messages"]
    if frames is not None and wider is not given:
        frames = [
            replace(
                one,
                columns={n: wider[n][k] if n in wider else v for n, v in one.columns.items()},
                warnings=read_frame_messages(messages[k]),
            )
            for k, one in enumerate(frames)
        ]
    table = {name: values for name, values in wider.items() if name != "messages"}
    by_model = scene.model and not scene.polariscope.tells_orders
    fitted = _fitted(scene, table, shape) if by_model else None
    return Processed(
        scene=scene, model=scene.model, columns=table, frames=frames, fitted=fitted,
        warnings=(
            *_of_set(scene, table, residual),
            *output.messages_of_frames(
                (number, text)
                for number, cell in zip(table["frame"], messages, strict=True)
                for text in read_frame_messages(cell)
            ),
            *_of_places(set_grid(scene, fitted, table, shape), table),
        ),
        residual=residual, failed=more["status"].count("failed"), messages=messages,
    )  # fmt: skip


def _has_read(scene: Scene, table: Mapping[str, list[Any]]) -> bool:
    """Whether any frame was read, followed, or where no order can be, normalised."""
    if any(by != NOTHING for by in table.get(FOUND_BY, ())) or any(table.get("kept_share", ())):
        return True
    light = fitting.LOAD if scene.frames.has_known_loads else "noise"
    return not scene.orders_are_read and bool(np.isfinite(output.numbers(table[light])).any())


def _of_set(
    scene: Scene, table: Mapping[str, Any], residual: ResidualStress | None
) -> Iterator[str]:
    """What is said once: why no orders are read, which stress was taken out, what is exact."""
    if not scene.orders_are_read:
        known_loads = scene.frames.has_known_loads
        yield message("no_model_names_fringes") if known_loads else no_model_sentence(scene)
    if residual is not None:
        yield from residual.warnings
        if residual.largest > _NOTABLE:
            largest, steps = residual.largest, scene.frames.no_load_steps
            yield message("residual_stress_up_fringe_taken", largest=largest, no_load_steps=steps)
    if PICTURE in table:
        yield from fitting.untracked_inputs(scene)


def _of_places(grid: PixelGrid | None, table: Mapping[str, Sequence[Any]]) -> Iterator[str]:
    """What to say where frames lie over half a pixel from the axes that all maps have."""
    if grid is None:
        return
    far = {
        name: np.abs(shift_of(edge, grid, table)) for name, edge in (("x", "left"), ("z", "top"))
    }
    beyond = [
        f"{np.nanmax(shift):.3g} mm along {name}"
        for name, shift in far.items()
        if (shift > 0.5 * grid.pixel_mm).any()
    ]
    if beyond:
        yield message("frames_own_places_lie", reach=" and ".join(beyond))


def restore(
    scene: Scene, out: Path, shape: tuple[int, int], residual: ResidualStress | None
) -> Processed:
    """Read what an earlier run found, from the folder that it left complete."""
    names = output.read_csv(out / "frames.csv")
    with open_run(out) as dataset:
        table = {name: column_values(dataset[identifier(name)]) for name in names}
        more = {"status": column_values(dataset["status"])}
        if "messages" in dataset:
            more["messages"] = column_values(dataset["messages"])
    for name in {"warnings", CAUSES, REFINED, LOOKS_LIKE} & set(table):
        table[name] = ["" if text is None else text for text in table[name]]
    if "messages" not in more:  # an older run has their texts alone
        more["messages"] = [frame_messages([text] if text else ()) for text in table["warnings"]]
    draw = partial(output.saved_picture, out.absolute() / FIGURE)
    result = collect(scene, table, more, None, shape, residual)
    return replace(result, already=True, draw=draw, load=partial(open_run, out.absolute()))


def _fitted(scene: Scene, table: dict[str, list[Any]], shape: tuple[int, int]) -> Scene | None:
    """The scene with the means of the frames' fitted values; None where no frame has any."""
    pixels = output.numbers(table["pixel_mm"])
    if not np.isfinite(pixels).any():
        return None
    keys = fitted_keys(table)
    # of a tracked video the key frames count, whose every pixel was fitted
    fitted = [
        {key: {"value": value} for key, value in own_values(table, keys, k).items()} if at else {}
        for k, at in enumerate(whole_frames(table))
    ]
    grid = {
        # a disc's may come from its rim
        "camera.pixel_mm": float(pixels[np.isfinite(pixels)][0]),
        "camera.height_px": shape[0],
        "camera.width_px": shape[1],
    }
    result = fitting.fitted_scene(scene.with_values(grid), {}, fitted)
    if (
        scene.frames.sliding_speed_mm_per_s is None
        or not scene.wear
        or fitting.FRICTION not in keys
    ):
        return result
    points = {
        float(s): float(values[fitting.FRICTION]["value"])
        for s, values in zip(table["distance_m"], fitted, strict=True)
        if fitting.FRICTION in values and np.isfinite(values[fitting.FRICTION]["value"])
    }
    if len(points) > 1:
        result = result.with_values(
            {fitting.EARLIER: 0.0, fitting.FRICTION: fitting.over_distance(points)}
        )
    return result
