"""What `process` finds in a whole set."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.fit.refuse import CORRECT
from isochrome.fit.run import fitted_scene
from isochrome.fit.sequence import FRICTION, over_distance
from isochrome.fit.track_result import summarise
from isochrome.fringes.residual import Residual
from isochrome.output import Floats, numbers, read_csv
from isochrome.process.followed import NOTHING
from isochrome.process.result import SPREAD, ProcessedFrame
from isochrome.runs import open_run
from isochrome.runs.store import values_of
from isochrome.scene import Scene
from isochrome.simulate import no_model_sentence

PICTURE = "picture"
"""Column of frames.csv of a tracked video: where a key frame lies in the stacks of pictures."""

_NOTABLE = 0.02
_SPANS = 8


@dataclass(frozen=True)
class Processed:
    """Processed frames: `table`, the columns of frames.csv; `frames`, None where streamed, of a
    tracked video its key frames.

    `scene`, as given; `fitted`, with the frames' fitted values (means; friction over distance);
    `warnings` of the whole set; `model`, the scene's. Both are None where there is no model.
    `residual`, the residual stress that was taken out, None where nobody gave a no-load set;
    `already`, whether an earlier run had left it all; `failed`, how many frames were left out.
    """

    scene: Scene
    model: str | None
    table: dict[str, list[Any]]
    frames: list[ProcessedFrame] | None
    fitted: Scene | None
    warnings: tuple[str, ...]
    residual: Residual | None = None
    already: bool = False
    failed: int = 0

    @property
    def tracked(self) -> bool:
        """Whether most frames were followed from key frames."""
        return PICTURE in self.table

    def summary(self) -> dict[str, list[Any]]:
        """What the frames come to, see `isochrome.fit.track_result.summarise`."""
        keys = [name for name in self.table if f"{name} {SPREAD}" in self.table]
        columns, spreads = (
            [numbers(self.table[f"{key}{ending}"]) for key in keys] for ending in ("", f" {SPREAD}")
        )
        return summarise(keys, columns, spreads)


def tabulate(rows: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Rows as columns, in order of first appearance, the warnings last; None where a row has none.

    Parameters: `rows`, of frames.csv, one a frame. Returns column name to values.
    """
    table: dict[str, Any] = {}
    for number, row in enumerate(rows):
        add_row(table, number, row)
    return warnings_last(table)


def add_row(table: dict[str, Any], number: int, row: Mapping[str, Any]) -> None:
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
    residual: Residual | None = None,
) -> Processed:
    """Put the frames' findings together.

    Parameters: `scene`; `table`, the columns of frames.csv; `status` of each frame; `frames`, None
    where they were streamed; `shape` (rows, cols) of the frames; `residual`, what was taken out of
    them. Returns Processed.
    """
    alone = bool(scene.polariscope.step) or scene.polariscope.several_wavelengths
    warnings = [] if orders_are_read(scene) else [no_model_sentence(scene)]
    warnings += _of_residual(scene, residual) if residual is not None else []
    warnings += _of_frames(table)
    fitted = _fitted(scene, table, shape) if scene.model and not alone else None
    failed = status.count("failed")
    return Processed(
        scene, scene.model, table, frames, fitted, tuple(warnings), residual, failed=failed
    )


def refuse_unread(
    scene: Scene, name: str, table: Mapping[str, list[Any]], kept: Iterable[float | None]
) -> None:
    """Refuse a set whose orders can be read, and in none of whose frames one was.

    Parameters: `scene`; `name` of the set; `table`, the columns of frames.csv; `kept`, share of the
    specimen's pixels that were read in each frame, None where nobody read it. Raises PhysicsError.
    """
    followed = any(found != NOTHING for found in table.get("found_by", ()))
    if followed or any(kept) or not orders_are_read(scene):
        return
    raise PhysicsError(
        f"{name}: nothing could be read in any of its {len(table['frame'])} frames (of the first: "
        f"{table['warnings'][0]}); {CORRECT}"
    )


def orders_are_read(scene: Scene) -> bool:
    """Whether fringe orders are read of a scene's frames: else they are normalised alone."""
    alone = bool(scene.polariscope.step) or scene.polariscope.several_wavelengths
    return bool(scene.model or alone or scene.frames.known_order)


def _of_frames(table: dict[str, list[Any]]) -> list[str]:
    """What is said of frames, each sentence once, with the frames that it is said of."""
    said: dict[str, list[int]] = {}
    for index, text in zip(table["frame"], table["warnings"], strict=True):
        if text:
            said.setdefault(text, []).append(index)
    return [f"{_frames(indices)}: {text}" for text, indices in said.items()]


def _frames(indices: list[int]) -> str:
    """Frames as 'frame 3' or 'frames 0-4, 7', after eight spans how many more."""
    if len(indices) == 1:
        return f"frame {indices[0]}"
    runs = np.split(np.array(indices), np.flatnonzero(np.diff(indices) > 1) + 1)
    spans = [f"{run[0]}" if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs]
    more = f" and {len(spans) - _SPANS} more" if len(spans) > _SPANS else ""
    return f"frames {', '.join(spans[:_SPANS])}{more}"


def restore(
    scene: Scene, out: Path, shape: tuple[int, int], residual: Residual | None
) -> Processed:
    """What an earlier run found, from the folder that it left complete.

    Parameters: `scene`; `out`, the folder; `shape` (rows, cols) of the frames; `residual`, what was
    taken out of them. Returns Processed. Raises InputError.
    """
    names = read_csv(out / "frames.csv")
    with open_run(out) as dataset:
        table = {name: values_of(dataset[name]) for name in names}
        status = values_of(dataset["status"])
    table["warnings"] = ["" if said is None else said for said in table["warnings"]]
    return replace(collect(scene, table, status, None, shape, residual), already=True)


def _of_residual(scene: Scene, residual: Residual) -> list[str]:
    """What to say of the residual stress once, for all frames."""
    said = list(residual.warnings)
    if residual.largest > _NOTABLE:
        said.append(
            f"residual stress of up to {residual.largest:.2f} fringe ({scene.frames.no_load_steps})"
            " was taken out as a tensor: all maps are the load's alone"
        )
    return said


def _fitted(scene: Scene, table: dict[str, list[Any]], shape: tuple[int, int]) -> Scene | None:
    """The scene with the means of the frames' fitted values; None where no frame has any."""
    pixels = [pixel for pixel in table["pixel_mm"] if pixel is not None]
    if not pixels:
        return None
    keys = [name for name in table if f"{name} {SPREAD}" in table]
    # of a tracked video the key frames count, whose every pixel was fitted
    whole = [at is not None for at in table.get(PICTURE, table["frame"])]
    own = [
        {key: {"value": table[key][k]} for key in keys if whole[k] and table[key][k] is not None}
        for k in range(len(whole))
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
    return found.with_values({FRICTION: over_distance(points)}) if len(points) > 1 else found
