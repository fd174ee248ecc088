"""`simulate`: wear and frames at a scene's distances, in memory or streamed to a folder."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.progress import Progress, counted
from isochrome.scene import Scene, load_scene
from isochrome.simulate.folder import write_states
from isochrome.simulate.model import SceneState, iter_scene_states, state_count
from isochrome.simulate.rendering import render
from isochrome.simulate.tables import add_row, history_row
from isochrome.stress import PixelGrid, pixel_grid


@dataclass(frozen=True)
class Simulation:
    """A simulated scene.

    `scene`; `pixels`; `history`, the columns of history.csv; `states`; `frames` (frame, row, col),
    for a colour camera (frame, row, col, 3); and `orders` (state, row, col). Where the states were
    streamed to a folder, `states` is empty, `frames` and `orders` are None. `maps`,
    where components were asked for and not streamed: (state, row, col) by the name of their file.
    """

    scene: Scene
    pixels: PixelGrid
    history: dict[str, list[Any]]
    states: list[SceneState]
    frames: NDArray[np.generic] | None
    orders: NDArray[np.float32] | None
    maps: dict[str, NDArray[np.float32]] = field(default_factory=dict)


def simulate(
    scene: str | Path | Scene,
    out: str | Path | None = None,
    *,
    components: bool = False,
    progress: Progress | None = None,
) -> Simulation:
    """Simulate a scene: contact, wear, stress and fringes at its distances.

    Parameters: `scene`, a file, a name or a Scene; `out`, a folder for history.csv, frames.tif,
    fringe_order.tif, pressure.csv, scene.toml, provenance.json and simulation.png, to which each
    state goes as soon as it is known, so that memory does not grow with their number; `components`
    also leaves sigma_1.tif, sigma_2.tif, sigma_x.tif, sigma_z.tif, tau_xz.tif (MPa),
    sigma_1_direction.tif (degrees) and stress.png, and the history's largest shear is then that of
    all the material in view, not of the pixels' centres; `progress`, called with (done, all).
    Returns a Simulation, with states, frames and orders in memory only without `out`. Raises
    InputError, PhysicsError; then nothing is left in `out`.
    """
    scene = load_scene(scene)
    states = iter_scene_states(scene)
    pixels, count = pixel_grid(scene), state_count(scene)
    rendered = render(scene, states, pixels, components=components)
    items = counted(rendered, count, progress)
    if out is not None:
        history = write_states(scene, pixels, items, count, Path(out), components=components)
        return Simulation(scene, pixels, history, [], None, None)
    history, seen, frames, orders = {}, [], [], []
    maps: dict[str, list[NDArray[np.float32]]] = {}
    for index, item in enumerate(items):
        add_row(history, history_row(index, item, pixels))
        add_row(maps, item.components.maps if item.components else {})
        seen.append(item.state)
        frames.append(item.frames)
        orders.append(item.picture.order.astype(np.float32))
    layers = {name: np.stack(images) for name, images in maps.items()}
    return Simulation(
        scene, pixels, history, seen, np.concatenate(frames), np.stack(orders), layers
    )
