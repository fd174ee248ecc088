"""The files that a simulation leaves, each state written as soon as it is known."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.output import (
    Photometric,
    TableWriter,
    TiffWriter,
    provenance,
    staged,
    write_figure,
    write_json,
    write_text,
)
from isochrome.scene import Scene, dump_scene
from isochrome.simulate.components import LAYERS
from isochrome.simulate.figure import simulation_figure
from isochrome.simulate.rendering import Rendered
from isochrome.simulate.stress_figure import stress_figure
from isochrome.simulate.tables import PROFILE, add_row, history_row, profile_rows
from isochrome.stress import PixelGrid

_SHOWN = 6
"""States kept for the figure: the paper's six, or evenly spaced ones of a long history."""

_Append = Callable[[int, Rendered, dict[str, Any]], None]


def write_states(
    scene: Scene,
    pixels: PixelGrid,
    items: Iterator[Rendered],
    count: int,
    out: Path,
    *,
    components: bool = False,
) -> dict[str, list[Any]]:
    """Write rendered states to a folder as they come, in memory that hardly grows with them.

    Parameters: `scene`; `pixels`; `items`, `count` of them; `out`, the folder; `components`,
    whether the items have theirs. Returns the columns of history.csv. Raises what the items raise;
    then nothing is left in `out`.
    """
    shown = set(np.linspace(0, count - 1, min(_SHOWN, count)).round().astype(int).tolist())
    kept: list[Rendered] = []
    history: dict[str, list[Any]] = {}
    with staged(out) as folder:
        with _state_files(scene, pixels, folder, LAYERS if components else ()) as append:
            for index, item in enumerate(items):
                row = history_row(index, item, pixels)
                add_row(history, row)
                append(index, item, row)
                if index in shown:
                    kept.append(item)
        text = dump_scene(scene)
        write_text(folder / "scene.toml", text)
        seed = scene.camera.seed if scene.camera else None
        write_json(folder / "provenance.json", provenance(text, (), seed))
        write_figure(folder / "simulation.png", simulation_figure(scene, pixels, kept))
        if components:
            write_figure(folder / "stress.png", stress_figure(scene, pixels, kept))
    return history


@contextmanager
def _state_files(
    scene: Scene, pixels: PixelGrid, folder: Path, layers: tuple[str, ...]
) -> Iterator[_Append]:
    """Open the tables and stacks of one run; yields what writes a state to them."""
    scale = pixels.pixel_mm
    colour = scene.camera is not None and scene.camera.colour
    with ExitStack() as files:
        history = files.enter_context(TableWriter(folder / "history.csv"))
        profile = files.enter_context(TableWriter(folder / "pressure.csv", PROFILE))
        photometric: Photometric = "rgb" if colour else "minisblack"
        frames = files.enter_context(
            TiffWriter(folder / "frames.tif", pixel_mm=scale, photometric=photometric)
        )
        maps = {
            name: files.enter_context(TiffWriter(folder / f"{name}.tif", pixel_mm=scale))
            for name in ("fringe_order", *layers)
        }

        def append(index: int, item: Rendered, row: dict[str, Any]) -> None:
            history.append({name: [value] for name, value in row.items()})
            if item.state.surface is not None:
                profile.append(profile_rows(index, item.state.surface))
            for frame in item.frames:
                frames.append(frame)
            maps["fringe_order"].append(item.picture.order.astype(np.float32))
            if item.components is not None:
                for name in layers:
                    maps[name].append(item.components.maps[name])

        yield append
