"""`sweep`: every point of a grid simulated, kept point by point, into one labelled dataset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.output import provenance
from isochrome.progress import RunProgress
from isochrome.runs import (
    Job,
    Layer,
    Layout,
    Means,
    Results,
    environment,
    open_run,
    run_job,
)
from isochrome.scene import Scene, dump_scene, load_scene
from isochrome.simulate import simulate, state_count
from isochrome.stress import pixel_grid
from isochrome.sweep.dataset import finish_sweep
from isochrome.sweep.grid import Grid, Values, make_grid

ORDER = Layer("fringe_order", "1", "fringe order N", stack=False)
GREY = Layer("grey", "1", "grey level that the camera stores", stack=False)


@dataclass(frozen=True)
class Swept:
    """A finished sweep: `out`, its folder; `points`, how many; `failed`, how many gave nothing.

    `axes`, the values of each key that was varied; `reasons`, why points failed, each once.
    """

    out: Path
    points: int
    failed: int
    axes: Mapping[str, tuple[float, ...]]
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class _Work:
    """Simulates points of a grid; one that physics refuses is left empty, with the reason."""

    grid: Grid
    layers: tuple[Layer, ...]
    shape: tuple[int, int, int]

    def __call__(self, start: int, stop: int) -> Results:
        arrays: dict[str, list[np.ndarray]] = {layer.name: [] for layer in self.layers}
        table, more = [], []
        for index in range(start, stop):
            history: dict[str, list[Any]] = {}
            reason = ""
            try:
                found = simulate(self.grid.scene_at(index))
                assert found.orders is not None and found.frames is not None
                pictures = {ORDER.name: found.orders, GREY.name: found.frames}
                history = found.history
            except PhysicsError as error:
                reason = str(error)
                pictures = dict.fromkeys(arrays, np.full(self.shape, np.nan, np.float32))
            for name, kept in arrays.items():
                kept.append(pictures[name].astype(np.float32))
            table.append({"history": _plain(history), "reason": reason})
            more.append({"status": "failed" if reason else "ok"})
        return Results({name: np.stack(kept) for name, kept in arrays.items()}, table, more)


def sweep(
    scene: str | Path | Scene,
    vary: Sequence[str] | Mapping[str, Values],
    out: str | Path,
    *,
    workers: int | None = 1,
    cluster: str | None = None,
    restart: bool = False,
    progress: RunProgress | None = None,
) -> Swept:
    """Simulate a scene over a grid of values.

    Parameters: `scene`; `vary`, see `make_grid`; `out`, a folder for run.zarr, whose axes are the
    varied keys, state, row and col, with the fringe order, the grey levels (of a grey camera
    without phase steps) and the columns of history.csv; sweep.csv, the same columns as a table;
    scene.toml and provenance.json. `workers`, `cluster`, `restart` and what becomes of a killed run
    as in `process`; `progress`, called with a Tally. A point whose physics is refused (a contact
    wider than the picture) stays empty, and its reason stands in the table.
    Returns Swept. Raises InputError where a point is no scene, before anything is computed, and
    PhysicsError where every point is refused.
    """
    scene = load_scene(scene)
    grid = make_grid(scene, vary)
    layout = _layout(grid)
    seed = scene.camera.seed if scene.camera else None
    axes = {key: list(values) for key, values in grid.values.items()}
    files = scene.files(of_frames=False)
    identity = provenance(dump_scene(scene), files, seed) | environment() | {"options": axes}
    states, rows_, cols = layout.shape.values()
    job = Job(_Work(grid, layout.layers, (states, rows_, cols)), layout, identity)
    run_job(
        job,
        out,
        lambda bench: finish_sweep(bench, job, grid),
        means=Means(workers, cluster, restart),
        progress=progress,
    )
    with open_run(out) as dataset:
        reasons = [str(text) for text in dataset.reason.values.ravel() if text]
    return Swept(Path(out), layout.count, len(reasons), grid.values, tuple(dict.fromkeys(reasons)))


def _layout(grid: Grid) -> Layout:
    """The dataset's form, the same at all points. Raises InputError where it is not."""
    count = int(np.prod(list(grid.counts.values())))
    first = grid.scene_at(0)
    if first.model is None or first.camera is None:
        raise InputError(
            f"{first.name}: a sweep needs a model and a [camera], as simulate does; add them"
        )
    forms = set()
    for index in range(count):
        own = grid.scene_at(index)
        pixels = pixel_grid(own)
        forms.add((state_count(own), pixels.rows, pixels.cols, len(own.polariscope.step)))
    if len(forms) > 1:
        raise InputError(
            f"--vary {', '.join(grid.values)}: changes the number of states, pixels or steps, and "
            "one dataset has one of each; run these sweeps apart"
        )
    ((states, rows_, cols, steps),) = forms
    plain = not steps and not first.camera.colour
    layers = (ORDER, GREY) if plain else (ORDER,)
    return Layout(grid.counts, {"state": states, "row": rows_, "col": cols}, layers, chunk=1)


def _plain(history: Mapping[str, Sequence[Any]]) -> dict[str, list[Any]]:
    return {
        name: [v.item() if isinstance(v, np.generic) else v for v in values]
        for name, values in history.items()
    }
