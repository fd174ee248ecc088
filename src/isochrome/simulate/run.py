"""`simulate`: wear and frames at a scene's distances, in memory or streamed to a folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.progress import Progress, counted
from isochrome.scene import Scene, load_scene
from isochrome.simulate.folder import write_states
from isochrome.simulate.model import SceneState, iter_scene_states, state_count
from isochrome.simulate.render import render
from isochrome.simulate.tables import add_row, history_row
from isochrome.stress import PixelGrid, pixel_grid


@dataclass(frozen=True)
class Simulation:
    """A simulated scene.

    `scene`; `pixels`; `history`, the columns of history.csv; `states`; `frames` (frame, row, col),
    for a colour camera (frame, row, col, 3); and `orders` (state, row, col). Where the states were
    streamed to a folder, `states` is empty, `frames` and `orders` are None.
    """

    scene: Scene
    pixels: PixelGrid
    history: dict[str, list[Any]]
    states: list[SceneState]
    frames: NDArray[np.generic] | None
    orders: NDArray[np.float32] | None


def simulate(
    scene: str | Path | Scene, out: str | Path | None = None, *, progress: Progress | None = None
) -> Simulation:
    """Simulate a scene: contact, wear, stress and fringes at its distances.

    Parameters: `scene`, a file, a name or a Scene; `out`, a folder for history.csv, frames.tif,
    fringe_order.tif, pressure.csv, scene.toml, provenance.json and simulation.png, to which each
    state goes as soon as it is known, so that memory does not grow with their number; `progress`,
    called with (done, all).
    Returns a Simulation, with states, frames and orders in memory only without `out`. Raises
    InputError, PhysicsError; then nothing is left in `out`.
    """
    scene = load_scene(scene)
    states = iter_scene_states(scene)
    pixels, count = pixel_grid(scene), state_count(scene)
    items = counted(render(scene, states, pixels), count, progress)
    if out is not None:
        history = write_states(scene, pixels, items, count, Path(out))
        return Simulation(scene, pixels, history, [], None, None)
    history, seen, frames, orders = {}, [], [], []
    for index, item in enumerate(items):
        add_row(history, history_row(index, item, pixels))
        seen.append(item.state)
        frames.append(item.frames)
        orders.append(item.picture.order.astype(np.float32))
    return Simulation(scene, pixels, history, seen, np.concatenate(frames), np.stack(orders))
