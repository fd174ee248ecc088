"""The files that a simulation leaves, each state written as soon as it is known."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.output import (
    TableWriter,
    TiffWriter,
    provenance,
    staged,
    write_figure,
    write_json,
    write_text,
)
from isochrome.scene import Scene, dump_scene
from isochrome.simulate.figure import simulation_figure
from isochrome.simulate.render import Rendered
from isochrome.simulate.tables import PROFILE, add_row, history_row, profile_rows
from isochrome.stress import PixelGrid

_SHOWN = 6
"""States kept for the figure: the paper's six, or evenly spaced ones of a long history."""


def write_states(
    scene: Scene, pixels: PixelGrid, items: Iterator[Rendered], count: int, out: Path
) -> dict[str, list[Any]]:
    """Write rendered states to a folder as they come, in memory that hardly grows with them.

    Parameters: `scene`; `pixels`; `items`, `count` of them; `out`, the folder. Returns the columns
    of history.csv. Raises what the items raise; then nothing is left in `out`.
    """
    shown = set(np.linspace(0, count - 1, min(_SHOWN, count)).round().astype(int).tolist())
    kept: list[Rendered] = []
    history: dict[str, list[Any]] = {}
    with staged(out) as folder:
        with _state_files(folder, pixels) as append:
            for index, item in enumerate(items):
                row = history_row(index, item, pixels)
                add_row(history, row)
                append(index, item, row)
                if index in shown:
                    kept.append(item)
        _write_record(scene, folder)
        write_figure(folder / "simulation.png", simulation_figure(scene, pixels, kept))
    return history


@contextmanager
def _state_files(
    folder: Path, pixels: PixelGrid
) -> Iterator[Callable[[int, Rendered, dict[str, Any]], None]]:
    """Open the tables and stacks of one run; yields what writes a state to them."""
    scale = pixels.pixel_mm
    with (
        TableWriter(folder / "history.csv") as history,
        TableWriter(folder / "pressure.csv", PROFILE) as profile,
        TiffWriter(folder / "frames.tif", pixel_mm=scale) as frames,
        TiffWriter(folder / "fringe_order.tif", pixel_mm=scale) as orders,
    ):

        def append(index: int, item: Rendered, row: dict[str, Any]) -> None:
            history.append({name: [value] for name, value in row.items()})
            if item.state.surface is not None:
                profile.append(profile_rows(index, item.state.surface))
            for frame in item.frames:
                frames.append(frame)
            orders.append(item.picture.order.astype(np.float32))

        yield append


def _write_record(scene: Scene, folder: Path) -> None:
    text = dump_scene(scene)
    write_text(folder / "scene.toml", text)
    seed = scene.camera.seed if scene.camera else None
    write_json(folder / "provenance.json", provenance(text, (), seed))
