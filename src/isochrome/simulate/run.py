"""`simulate`: wear and frames at a scene's distances, in memory or streamed to a folder."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import SurfaceState
from isochrome.errors import PhysicsError
from isochrome.optics import expose
from isochrome.output import (
    TiffWriter,
    provenance,
    staged,
    write_csv,
    write_figure,
    write_json,
    write_text,
)
from isochrome.progress import Progress, counted
from isochrome.scene import Scene, dump_scene, load_scene
from isochrome.simulate.figure import simulation_figure
from isochrome.simulate.model import (
    Picture,
    SceneState,
    make_picture,
    picture_signal,
    refuse_too_fine,
    scene_states,
    state_difference,
)
from isochrome.stress import PixelGrid, pixel_grid

_SHOWN = 6
"""States kept for the figure: the paper's six, or evenly spaced ones of a long history."""


@dataclass(frozen=True)
class Rendered:
    """A state with its picture and the camera's frames of it (steps, rows, cols)."""

    state: SceneState
    picture: Picture
    frames: NDArray[np.generic]


@dataclass(frozen=True)
class Simulation:
    """A simulated scene.

    `scene`; `pixels`; `history`, the columns of history.csv; `states`; `frames` (frame, row, col)
    and `orders` (state, row, col), None where they were streamed to a folder.
    """

    scene: Scene
    pixels: PixelGrid
    history: dict[str, list[Any]]
    states: list[SceneState]
    frames: NDArray[np.generic] | None
    orders: NDArray[np.float32] | None


def render(scene: Scene, states: list[SceneState], pixels: PixelGrid) -> Iterator[Rendered]:
    """Render state after state; one is in memory at a time.

    Noise of state i comes from the generator seeded with (camera.seed, i), so that a frame does
    not depend on those before it. Raises PhysicsError where fringes are too fine for the pixels.
    """
    assert scene.camera is not None
    steps: list[int | None] = list(range(len(scene.polariscope.step)))
    for index, state in enumerate(states):
        picture = make_picture(scene, state_difference(scene, state, pixels), pixels)
        refuse_too_fine(scene, picture)
        rng = np.random.default_rng([scene.camera.seed, index])
        frames = [
            expose(picture_signal(scene, picture, step), scene.camera, rng=rng)
            for step in steps or [None]
        ]
        yield Rendered(state, picture, np.stack(frames))


def simulate(
    scene: str | Path | Scene, out: str | Path | None = None, *, progress: Progress | None = None
) -> Simulation:
    """Simulate a scene: contact, wear, stress and fringes at its distances.

    Parameters: `scene`, a file, a name or a Scene; `out`, a folder for history.csv, frames.tif,
    fringe_order.tif, pressure.csv, scene.toml, provenance.json and simulation.png; `progress`,
    called with (done, all).
    Returns a Simulation, with frames and orders in memory only without `out`. Raises InputError,
    PhysicsError; then nothing is left in `out`.
    """
    scene = load_scene(scene)
    states = scene_states(scene)
    pixels = pixel_grid(scene)
    for state in states:
        if state.surface is not None:
            _refuse_too_wide(scene, state.surface, pixels)
    rows: list[dict[str, Any]] = []
    if out is None:
        frames, orders = [], []
        for item in counted(render(scene, states, pixels), len(states), progress):
            rows.append(history_row(len(rows), item, pixels))
            frames.append(item.frames)
            orders.append(item.picture.order.astype(np.float32))
        return Simulation(
            scene, pixels, _columns(rows), states, np.concatenate(frames), np.stack(orders)
        )
    with staged(out) as folder, contextlib.ExitStack() as stack:
        tiff = stack.enter_context(TiffWriter(folder / "frames.tif", pixel_mm=pixels.pixel_mm))
        order_tiff = stack.enter_context(
            TiffWriter(folder / "fringe_order.tif", pixel_mm=pixels.pixel_mm)
        )
        shown = set(np.linspace(0, len(states) - 1, min(_SHOWN, len(states))).round().astype(int))
        kept: list[Rendered] = []
        for item in counted(render(scene, states, pixels), len(states), progress):
            index = len(rows)
            rows.append(history_row(index, item, pixels))
            for frame in item.frames:
                tiff.append(frame)
            order_tiff.append(item.picture.order.astype(np.float32))
            if index in shown:
                kept.append(item)
        simulation = Simulation(scene, pixels, _columns(rows), states, None, None)
        _write_tables(simulation, folder)
        write_figure(folder / "simulation.png", simulation_figure(scene, pixels, kept))
    return simulation


def history_row(index: int, item: Rendered, pixels: PixelGrid) -> dict[str, Any]:
    """One row of history.csv: contact, wear, and the largest fringe order and shear in view."""
    order = np.where(item.picture.material, item.picture.order, -1.0)
    row, col = np.unravel_index(int(order.argmax()), order.shape)
    surface = item.state.surface
    nothing = float("nan")
    return {
        "state": index,
        "label": item.state.label,
        "distance_m": item.state.distance_m,
        "friction": surface.friction if surface else nothing,
        "p_max_mpa": surface.p_max_mpa if surface else nothing,
        "contact_width_mm": surface.contact_width_mm if surface else nothing,
        "contact_centre_mm": sum(surface.edges_mm) / 2 if surface else nothing,
        "wear_depth_um": 1e3 * float(surface.wear_depth_mm.max()) if surface else nothing,
        "worn_area_mm2": surface.worn_area_mm2 if surface else nothing,
        "n_max": float(order[row, col]),
        "n_max_x_mm": float(pixels.x_mm[col]),
        "n_max_z_mm": float(pixels.z_mm[row]),
        "shear_max_mpa": 0.5 * float(np.abs(item.picture.difference[row, col])),
        "residual": surface.residual if surface else nothing,
    }


def _refuse_too_wide(scene: Scene, surface: SurfaceState, pixels: PixelGrid) -> None:
    width = pixels.cols * pixels.pixel_mm
    if surface.contact_width_mm > width:
        raise PhysicsError(
            f"{scene.name}: the contact is {surface.contact_width_mm:.3g} mm wide, wider than the "
            f"picture ({width:.3g} mm); lower load.normal_n or the wear, or widen the camera"
        )


def _write_tables(simulation: Simulation, folder: Path) -> None:
    scene = simulation.scene
    write_csv(folder / "history.csv", simulation.history)
    profile: dict[str, list[Any]] = {
        name: [] for name in ("state", "x_mm", "pressure_mpa", "shear_mpa", "wear_depth_um")
    }
    for index, state in enumerate(simulation.states):
        if state.surface is not None:
            surface = state.surface
            profile["state"] += [index] * surface.grid.nodes
            profile["x_mm"] += surface.grid.x_mm.tolist()
            profile["pressure_mpa"] += surface.pressure_mpa.tolist()
            profile["shear_mpa"] += surface.shear_mpa.tolist()
            profile["wear_depth_um"] += (1e3 * surface.wear_depth_mm).tolist()
    write_csv(folder / "pressure.csv", profile)
    text = dump_scene(scene)
    write_text(folder / "scene.toml", text)
    seed = scene.camera.seed if scene.camera else None
    write_json(folder / "provenance.json", provenance(text, (), seed))


def _columns(rows: list[dict[str, Any]]) -> dict[str, list[Any]]:
    return {name: [row[name] for row in rows] for name in rows[0]}
