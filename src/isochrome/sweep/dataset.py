"""A sweep's findings: one table of all points and states, and the columns of its dataset."""

from __future__ import annotations

from typing import Any

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.output import numbers, write_csv, write_text
from isochrome.runs import STORE, Bench, Job
from isochrome.runs.chunks import rows
from isochrome.runs.store import Column, add_columns, attributes, named_units, texts
from isochrome.scene import dump_scene
from isochrome.stress import pixel_grid
from isochrome.sweep.grid import Grid

TABLE = "sweep.csv"


def finish_sweep(bench: Bench, job: Job, grid: Grid) -> None:
    """Make the files that need all points, from what is kept of them.

    Parameters: `bench`, where they lie; `job`; `grid`. Raises PhysicsError where every point was
    refused, OSError.
    """
    table = _table(bench, grid)
    if set(table["status"]) == {"failed"}:
        raise PhysicsError(f"all {bench.layout.count} points were refused: {table['reason'][0]}")
    write_csv(bench.results / TABLE, table)
    write_text(bench.results / "scene.toml", dump_scene(grid.scene))
    _add(bench, job, grid, table)


def _table(bench: Bench, grid: Grid) -> dict[str, list[Any]]:
    """A row for each state of each point: the varied keys, and the columns of history.csv."""
    names: dict[str, None] = {}
    for row, _ in rows(bench):
        names |= dict.fromkeys(name for name in row["history"] if name != "state")
    keys = (*grid.values, "state", "status", *names, "reason")
    table: dict[str, list[Any]] = {key: [] for key in keys}
    for index, (row, more) in enumerate(rows(bench)):
        own = grid.point(index) | {"status": more["status"], "reason": row["reason"]}
        for state in range(bench.layout.shape["state"]):
            for key, value in (own | {"state": state}).items():
                table[key].append(value)
            for name in names:
                values = row["history"].get(name)
                table[name].append(None if values is None else values[state])
    return table


def _add(bench: Bench, job: Job, grid: Grid, table: dict[str, list[Any]]) -> None:
    """The table's columns over the varied keys and state, and the axes' coordinates."""
    shape = (*grid.counts.values(), bench.layout.shape["state"])
    columns: dict[str, Column] = {}
    for name, values in table.items():
        if name in (*grid.values, "state"):
            continue
        text = any(isinstance(value, str) for value in values)
        data = (texts(values) if text else numbers(values)).reshape(shape)
        axes: tuple[str, ...] = (*grid.values, "state")
        if name in ("status", "reason"):  # of the point, whatever its states
            data, axes = data[..., 0], axes[:-1]
        columns[name] = Column(axes, data, named_units(name))
    places = {name: ((name,), np.array(own)) for name, own in grid.values.items()}
    places["state"] = (("state",), np.arange(shape[-1]))
    if not any(key.startswith("camera.") for key in grid.values):
        pixels = pixel_grid(grid.scene_at(0))
        places |= {"z_mm": (("row",), pixels.z_mm), "x_mm": (("col",), pixels.x_mm)}
    coordinates = {name: Column(*place, named_units(name)) for name, place in places.items()}
    add_columns(bench.results / STORE, columns, coordinates, attributes(job.identity))
