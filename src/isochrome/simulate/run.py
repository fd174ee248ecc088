"""`simulate`: wear and frames at a scene's distances, in memory or streamed to a folder."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.output import provenance
from isochrome.progress import RunProgress, Tally
from isochrome.runs import Job, Means, environment, run_job, single_threaded
from isochrome.scene import Scene, check_pixel, dump_scene, load_scene
from isochrome.simulate.folder import finish_folder, layout_of, read_history
from isochrome.simulate.model import (
    SceneState,
    iter_scene_states,
    no_model_sentence,
    state_count,
)
from isochrome.simulate.rendering import render
from isochrome.simulate.tables import add_row, history_row
from isochrome.simulate.work import RenderWork
from isochrome.stress import PixelGrid, pixel_grid


@dataclass(frozen=True)
class Simulation:
    """A simulated scene.

    `scene`; `pixels`; `history`, the columns of history.csv; `states`; `frames` (frame, row, col),
    for a colour camera (frame, row, col, 3); and `orders` (state, row, col). Where the states were
    streamed to a folder, `states` is empty, `frames` and `orders` are None. `maps`,
    where components were asked for and not streamed: (state, row, col) by the name of their file.
    `already`, whether an earlier run had left it all; the history has nine digits then.
    """

    scene: Scene
    pixels: PixelGrid
    history: dict[str, list[Any]]
    states: list[SceneState]
    frames: NDArray[np.generic] | None
    orders: NDArray[np.float32] | None
    maps: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    already: bool = False


def simulate(
    scene: str | Path | Scene,
    out: str | Path | None = None,
    *,
    components: bool = False,
    workers: int | None = 1,
    cluster: str | None = None,
    restart: bool = False,
    progress: RunProgress | None = None,
) -> Simulation:
    """Simulate a scene: contact, wear, stress and fringes at its distances.

    Parameters: `scene`, a file, a name or a Scene; `out`, a folder for history.csv, frames.tif,
    fringe_order.tif, pressure.csv, scene.toml, provenance.json and simulation.png, to which the
    states go as soon as they are known, so that memory does not grow with their number;
    `components` also leaves sigma_1.tif, sigma_2.tif, sigma_x.tif, sigma_z.tif, tau_xz.tif (MPa),
    sigma_1_direction.tif (degrees) and stress.png, and the history's largest shear is then that of
    all the material in view, not of the pixels' centres.
    What is finished is kept in OUT.partial until all is: the same call after a crash goes on there.
    `workers`, `cluster`, `restart` as in `process`; `progress`, called with a Tally.
    Returns a Simulation, with states, frames and orders in memory only without `out`. Raises
    InputError, PhysicsError; then nothing is left in `out`, but what of a long run can go on.
    """
    scene = load_scene(scene)
    if scene.model is None:
        raise InputError(no_model_sentence(scene))
    check_pixel(scene, None)
    pixels, count = pixel_grid(scene), state_count(scene)
    if out is not None:
        means = Means(workers, cluster, restart)
        return _to_folder(scene, pixels, count, Path(out), components, means, progress)
    if cluster is not None or workers != 1:
        raise InputError("workers and a cluster write to a folder: give out")
    states = iter_scene_states(scene)
    history: dict[str, list[Any]] = {}
    seen, frames, orders = [], [], []
    maps: dict[str, list[NDArray[np.float32]]] = {}
    for index, item in enumerate(render(scene, states, pixels, components=components)):
        add_row(history, history_row(index, item, pixels))
        add_row(maps, item.components.maps if item.components else {})
        seen.append(item.state)
        frames.append(item.frames)
        orders.append(item.picture.order.astype(np.float32))
        if progress is not None:
            progress(Tally(index + 1, count, 0, 0))
    layers = {name: np.stack(images) for name, images in maps.items()}
    return Simulation(
        scene, pixels, history, seen, np.concatenate(frames), np.stack(orders), layers
    )


def _to_folder(
    scene: Scene,
    pixels: PixelGrid,
    count: int,
    out: Path,
    components: bool,
    means: Means,
    progress: RunProgress | None,
) -> Simulation:
    """The simulation by whoever computes it, into a folder."""
    seed = scene.camera.seed if scene.camera else None
    options = {"options": {"components": components}}
    files = scene.files(of_frames=False)
    identity = provenance(dump_scene(scene), files, seed) | environment() | options
    if means.cluster is not None:  # another machine stands in another folder
        scene = scene.model_copy(update={"folder": (scene.folder or Path()).absolute()})
    with single_threaded():
        work = RenderWork(scene, pixels, count, components=components)
        job = Job(work, layout_of(work), identity)
        history = run_job(
            job, out, lambda bench: finish_folder(bench, work), means=means, progress=progress
        )
    already = history is None
    return Simulation(scene, pixels, history or read_history(out), [], None, None, already=already)
