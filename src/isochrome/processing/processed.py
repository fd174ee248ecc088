"""What `process` finds in a whole set."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.figures import PaperPanels
from isochrome.fitting import (
    CORRECT,
    EARLIER,
    FRICTION,
    LOAD,
    fitted_scene,
    over_distance,
    untracked_inputs,
)
from isochrome.fringes import ResidualStress
from isochrome.output import (
    Floats,
    FrameValues,
    Result,
    counted,
    messages_of_frames,
    numbers,
    over_items,
    read_csv,
    saved_picture,
)
from isochrome.processing.in_common import (
    with_past_friction,
    with_past_loads,
    with_scatter_of_gamma,
)
from isochrome.processing.kinds.largest_order import ORDER_SPREAD, largest_from
from isochrome.processing.result import (
    CAUSES,
    FOUND_BY,
    NOTHING,
    PICTURE,
    SEARCHED,
    SEPARATOR,
    SPREAD,
    ProcessedFrame,
    causes_of,
    own_values,
    whole_frames,
)
from isochrome.runs import RunDataset, column_values, identifier, open_run
from isochrome.scene import Scene
from isochrome.simulation import no_model_sentence

FIGURE = "process.png"
_AGAINST_OTHERS = (
    "no model names the fringes of a disc that holds stress without load: its load is read against "
    "the frames of known loads, and its orders only where [[frames.known_order]] names a point"
)
_LOOK = "`isochrome check` looks at the frames and their light"

_NOTABLE = 0.02


@dataclass(frozen=True, repr=False, kw_only=True)
class Processed(Result):
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
    load : callable, optional
        Makes the dataset.
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
    load: Callable[[], RunDataset] | None = field(default=None, compare=False)

    @property
    def dataset(self) -> RunDataset:
        """The maps and columns as an xarray.Dataset, the same in memory and of a folder.

        Maps are over (frame, z_mm, x_mm), or (frame, row, col) where no scale is known; see
        `open_run`, which reads those of a folder as they are used. Raises InputError.
        """
        if self.load is None:
            raise InputError(f"{self.title}: its maps were not kept; process the frames again")
        return self.load()

    @property
    def tracked(self) -> bool:
        """Whether most frames were followed from key frames."""
        return PICTURE in self.columns

    def summary(self) -> dict[str, list[Any]]:
        """What the frames come to."""
        return self.over_frames.summary()

    @property
    def over_frames(self) -> FrameValues:
        """The fitted values, to be drawn and summed up as those of other commands."""
        return frame_values(self.columns)

    @property
    def title(self) -> str:
        """The scene and how many frames there are."""
        count = len(self.columns["frame"])
        failed = f", {self.failed} of them failed" if self.failed else ""
        return f"Processed {counted(count, 'frame')} of {self.scene.name}{failed}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """What was fitted, how well, and how much was read."""
        for key in fitted_keys(self.columns):
            yield key, over_items(self.columns[key], self.columns[f"{key} {SPREAD}"])
        for name in ("n_max", ORDER_SPREAD, "chi", "kept_share", "fringe_lines"):
            if any(value is not None for value in self.columns.get(name, ())):
                source = largest_from(self.columns) if name == "n_max" else ""
                yield name, over_items(self.columns[name]) + source

    @property
    def asks_causes(self) -> bool:
        """Whether frames may ask for more than the scene: not where no model is fitted."""
        return not self.scene.frames.known_loads_n

    @property
    def causes(self) -> list[str]:
        """What frames asked for besides the scene: keys, and how many frames did."""
        cells = [causes_of(cell or "") for cell in self.columns.get(CAUSES, ())]
        asked = Counter(key for cell in cells for key in cell)
        return [f"{key} ({n} of {counted(len(cells), 'frame')})" for key, n in asked.items()]

    def to_json(self) -> dict[str, Any]:
        """The table of all frames, of a tracked video with what they come to."""
        found: dict[str, Any] = {"model": self.model, "frames": self.columns}
        found |= {"summary": self.summary()} if self.tracked else {}
        return found | {"warnings": list(self.warnings)}

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give the frames and their orders for a paper; see `paper_figure`.

        `frames`: numbers of those that are shown. Raises InputError where one is not there.
        """
        from isochrome.processing.pictures.paper_panels import processed_panels

        return processed_panels(self, frames)


def fitted_keys(table: Mapping[str, Any]) -> tuple[str, ...]:
    """The columns of frames.csv that have a standard uncertainty beside them."""
    return tuple(name for name in table if f"{name} {SPREAD}" in table)


def frame_values(table: Mapping[str, Sequence[Any]]) -> FrameValues:
    """The fitted values of frames.csv.

    Parameters: `table`, its columns. Returns FrameValues.
    """
    keys, count = fitted_keys(table), len(table["frame"])
    values, spreads = (
        np.array([numbers(table[f"{key}{ending}"]) for key in keys]).reshape(len(keys), count).T
        for ending in ("", f" {SPREAD}")
    )
    none = [None] * count
    return FrameValues(
        keys=keys,
        values=values,
        standard_uncertainty=spreads,
        chi=numbers(table["chi"]),
        distance_m=numbers(table["distance_m"]),
        searched=np.array([found == SEARCHED for found in table.get(FOUND_BY, none)]),
        whole=np.array(whole_frames(table) if PICTURE in table else none, dtype=bool),
    )


def tabulate_set(rows: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Rows as columns, in order of first appearance, the warnings last; None where a row has none.

    Parameters: `rows`, of frames.csv, one a frame. Returns column name to values.
    """
    table: dict[str, Any] = {}
    for number, row in enumerate(rows):
        add_frame_row(table, number, row)
    return warnings_last(table)


def add_frame_row(table: dict[str, Any], number: int, row: Mapping[str, Any]) -> None:
    """Add a row to columns, None where it has no value of one.

    An hour of video has a hundred thousand rows: columns of numbers are Floats, and a text that is
    the one before it takes no room of its own.
    Parameters: `table`, column name to values, which grow; `number` of rows in it; `row`.
    """
    for name, value in row.items():
        if name not in table:
            table[name] = Floats("d") if not number and type(value) is float else [None] * number
    for name, values in table.items():
        value = row.get(name)
        if isinstance(values, Floats) and type(value) is not float:
            values = table[name] = values.tolist()
        again = number and isinstance(value, str) and values[-1] == value
        values.append(values[-1] if again else value)


def warnings_last(table: Mapping[str, Any]) -> dict[str, Any]:
    """Columns in their order, the one of the longest texts last."""
    return dict(sorted(table.items(), key=lambda item: item[0] == "warnings"))


def collect(
    scene: Scene,
    table: dict[str, list[Any]],
    status: list[str],
    frames: list[ProcessedFrame] | None,
    shape: tuple[int, int],
    residual: ResidualStress | None = None,
) -> Processed:
    """Put the frames' findings together.

    Parameters: `scene`; `table`, the columns of frames.csv; `status` of each frame; `frames`, None
    where they were streamed; `shape` (rows, cols) of the frames; `residual`, what was taken out of
    them. Returns Processed.
    """
    alone = bool(scene.polariscope.step) or scene.polariscope.several_wavelengths
    wider = with_past_loads(with_past_friction(with_scatter_of_gamma(table), scene), scene)
    if frames is not None and wider is not table:
        frames = [_of_row(frame, wider, k) for k, frame in enumerate(frames)]
    table = wider
    warnings = [] if orders_are_read(scene) else [_not_read(scene)]
    warnings += _of_residual(scene, residual) if residual is not None else []
    warnings += untracked_inputs(scene) if PICTURE in table else []
    of_frames = zip(table["frame"], table["warnings"], strict=True)
    warnings += messages_of_frames(
        (number, text) for number, all_ in of_frames for text in all_.split(SEPARATOR) if text
    )
    fitted = _fitted(scene, table, shape) if scene.model and not alone else None
    return Processed(
        scene=scene, model=scene.model, columns=table, frames=frames, fitted=fitted,
        warnings=tuple(warnings), residual=residual, failed=status.count("failed"),
    )  # fmt: skip


def _of_row(frame: ProcessedFrame, table: Mapping[str, list[Any]], k: int) -> ProcessedFrame:
    """A frame with the columns and warnings of its row `k`."""
    columns = {name: table[name][k] for name in frame.columns}
    said = tuple(text for text in table["warnings"][k].split(SEPARATOR) if text)
    return replace(frame, columns=columns, warnings=said)


def refuse_unread(
    scene: Scene, name: str, table: Mapping[str, list[Any]], kept: Iterable[float | None]
) -> None:
    """Refuse a set in none of whose frames an order was read; where none can be, none normalised.

    Parameters: `scene`; `name` of the set; `table`, the columns of frames.csv; `kept`, share of the
    specimen's pixels that were read in each frame, None where nobody read it. Raises PhysicsError.
    """
    followed = any(found != NOTHING for found in table.get(FOUND_BY, ()))
    asked = orders_are_read(scene)
    normalised = np.isfinite(numbers(table["noise"])).any()
    loads = numbers(table[LOAD]) if scene.frames.known_loads_n else None
    found = normalised if loads is None else np.isfinite(loads).any()
    if followed or any(kept) or (found and not asked):
        return
    count = counted(len(table["frame"]), "frame")
    raise PhysicsError(
        f"{name}: nothing could be read in any of its {count} (of the first: "
        f"{table['warnings'][0]}); {CORRECT if asked else _LOOK}"
    )


def _not_read(scene: Scene) -> str:
    """Why the orders of a scene's frames are not read."""
    return _AGAINST_OTHERS if scene.frames.known_loads_n else no_model_sentence(scene)


def orders_are_read(scene: Scene) -> bool:
    """Whether fringe orders are read of a scene's frames: else they are normalised alone."""
    alone = bool(scene.polariscope.step) or scene.polariscope.several_wavelengths
    fitted = scene.model and not scene.frames.known_loads_n
    return bool(fitted or alone or scene.frames.orders_known)


def restore(
    scene: Scene, out: Path, shape: tuple[int, int], residual: ResidualStress | None
) -> Processed:
    """Read what an earlier run found, from the folder that it left complete.

    Parameters
    ----------
    scene : Scene
        The scene as given.
    out : Path
        The folder.
    shape : tuple of two ints
        Rows and columns of the frames.
    residual : ResidualStress or None
        The residual stress that was taken out of them.

    Returns
    -------
    Processed
        What was found.

    Raises
    ------
    InputError
        Where it cannot be read.
    """
    names = read_csv(out / "frames.csv")
    with open_run(out) as dataset:
        table = {name: column_values(dataset[identifier(name)]) for name in names}
        status = column_values(dataset["status"])
    for name in ("warnings", CAUSES):
        if name in table:
            table[name] = ["" if text is None else text for text in table[name]]
    draw = partial(saved_picture, out.absolute() / FIGURE)
    found = collect(scene, table, status, None, shape, residual)
    load = partial(open_run, out.absolute())
    return replace(found, already=True, draw=draw, load=load)


def _of_residual(scene: Scene, residual: ResidualStress) -> list[str]:
    """What to say of the residual stress once, for all frames."""
    messages = list(residual.warnings)
    if residual.largest > _NOTABLE:
        messages.append(
            f"residual stress of up to {residual.largest:.2f} fringe ({scene.frames.no_load_steps})"
            " was taken out as a tensor: all maps are the load's alone"
        )
    return messages


def _fitted(scene: Scene, table: dict[str, list[Any]], shape: tuple[int, int]) -> Scene | None:
    """The scene with the means of the frames' fitted values; None where no frame has any."""
    pixels = [pixel for pixel in table["pixel_mm"] if pixel is not None]
    if not pixels:
        return None
    keys = fitted_keys(table)
    # of a tracked video the key frames count, whose every pixel was fitted
    whole = whole_frames(table) if PICTURE in table else [True] * len(table["frame"])
    own = [
        {key: {"value": value} for key, value in own_values(table, keys, k).items()} if at else {}
        for k, at in enumerate(whole)
    ]
    grid = {
        "camera.pixel_mm": pixels[0],  # a disc's may come from its rim
        "camera.height_px": shape[0],
        "camera.width_px": shape[1],
    }
    found = fitted_scene(scene.with_values(grid), {}, own)
    if scene.frames.sliding_speed_mm_per_s is None or not scene.wear or FRICTION not in keys:
        return found
    points = {
        float(s): float(values[FRICTION]["value"])
        for s, values in zip(table["distance_m"], own, strict=True)
        if FRICTION in values and np.isfinite(values[FRICTION]["value"])
    }
    return (
        found.with_values({EARLIER: 0.0, FRICTION: over_distance(points)})
        if len(points) > 1
        else found
    )
