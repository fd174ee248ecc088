"""`sweep`: every point of a grid simulated, kept point by point, into one labelled dataset."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome import runs
from isochrome.errors import InputError, PhysicsError
from isochrome.figures import LINE_COLOURS, LINE_PT, PaperPanels, Plot, panels_figure, style_axes
from isochrome.output import Result, columns_of, counted, numbers, read_csv, write_csv, write_text
from isochrome.progress import RunProgress
from isochrome.scene import Scene, SceneLike, dump_scene, load_scene
from isochrome.simulation import picture_axes, simulate, state_count
from isochrome.stress import pixel_grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from isochrome.runs import RunDataset

MAX_POINTS = 100_000
"""More points than this are a slip of the pen."""

Values = Sequence[float]


@dataclass(frozen=True)
class SweepGrid:
    """A scene, and the values of each key that is varied; the last key varies fastest."""

    scene: Scene
    values: Mapping[str, tuple[float, ...]]

    @property
    def counts(self) -> dict[str, int]:
        """Number of values of each key."""
        return {key: len(values) for key, values in self.values.items()}

    def point(self, index: int) -> dict[str, float]:
        """The values at a point, counted from 0."""
        at = np.unravel_index(index, tuple(self.counts.values()))
        return {key: along[int(k)] for (key, along), k in zip(self.values.items(), at, strict=True)}

    def scene_at(self, index: int) -> Scene:
        """The scene at a point. Raises InputError where it is none."""
        result = self.scene.with_values(self.point(index))
        return result.model_copy(update={"folder": self.scene.folder, "name": self.scene.name})


def make_grid(scene: Scene, vary: Sequence[str] | Mapping[str, Values]) -> SweepGrid:
    """The grid of a sweep by the `vary` of `sweep`."""
    values: dict[str, tuple[float, ...]] = {}
    for text in vary:
        key, given = _parsed(text) if not isinstance(vary, Mapping) else (text, vary[text])
        if key in values:
            raise InputError("vary_given_twice_give", key=key)
        now, values[key] = scene.get(key), tuple(map(float, given))
        if isinstance(now, int) and not isinstance(now, bool):  # a seed, a number of pixels
            values[key] = tuple(int(v) if v.is_integer() else v for v in values[key])
        if len(set(values[key])) < len(values[key]) or not values[key]:
            raise InputError("vary_needs_values_each", key=key, values=list(values[key]))
    if not values:
        raise InputError("sweep_varies_something_give")
    count = math.prod(len(given) for given in values.values())
    if count > MAX_POINTS:
        raise InputError("vary_makes_points_allowed", count=count, max_points=MAX_POINTS)
    return SweepGrid(scene, values)


def _parsed(text: str) -> tuple[str, list[float]]:
    key, equals, values = text.partition("=")
    try:
        if ":" in values:
            first, last, number = values.split(":")
            if int(number) < 2:
                raise ValueError
            result: list[Any] = np.linspace(float(first), float(last), int(number)).tolist()
        else:
            result = [float(v) for v in values.split(",")]
        if not equals or not key or not np.isfinite(result).all():
            raise ValueError
    except ValueError:
        has_both = "," in values and ":" in values
        comma = "with points in its numbers, not commas, " if has_both else ""
        raise InputError("vary_give_key_first", text=text, comma=comma) from None
    return key.strip(), result


TABLE = "sweep.csv"
ORDER = runs.Layer("fringe_order", "1", "fringe order N", stack=False)
GREY = runs.Layer("grey", "1", "grey level that the camera stores", stack=False)

DRAWN = {"n_max": "largest fringe order", "p_max_mpa": "largest pressure (MPa)"}
"""Columns that are drawn, where they are known, and what stands at their axes."""


@dataclass(frozen=True, repr=False)
class Swept(Result):
    """A finished sweep.

    Parameters
    ----------
    out : Path
        Its folder.
    points : int
        How many points there are.
    failed : int
        How many points gave nothing.
    axes : mapping of str to tuple of float
        Values of each key that was varied, in the unit that the key names.
    reasons : tuple of str
        Why points failed, each reason once.
    """

    out: Path
    points: int
    failed: int
    axes: Mapping[str, tuple[float, ...]]
    reasons: tuple[str, ...]

    @property
    def columns(self) -> dict[str, list[Any]]:
        """Those of sweep.csv: a row for each state of each point."""
        return read_csv(self.out / TABLE)

    @property
    def dataset(self) -> RunDataset:
        """The maps over the varied keys, state, z_mm and x_mm, see `open_run`."""
        return runs.open_run(self.out)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Why points were refused."""
        return self.reasons

    @property
    def title(self) -> str:
        """How many points there are."""
        refused = f", {self.failed} of them refused" if self.failed else ""
        return f"Sweep of {counted(self.points, 'point')}{refused}: {self.out}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """The keys that were varied."""
        for key, values in self.axes.items():
            yield key, f"{counted(len(values), 'value')} from {min(values):g} to {max(values):g}"

    def to_json(self) -> dict[str, Any]:
        """How many points there are, the varied keys, and why points were refused."""
        return {
            "points": self.points,
            "failed": self.failed,
            "axes": {key: list(values) for key, values in self.axes.items()},
            "reasons": list(self.reasons),
        }

    def figure(self) -> Figure:
        """Largest order and pressure of the last state over the first of the varied keys, a line
        for each value of the others."""
        import pandas

        keys, table = tuple(self.axes), self.columns
        rows = pandas.DataFrame(table)
        last = rows[rows["state"] == rows["state"].max()]
        lines = list(last.groupby(list(keys[1:]))) if len(keys) > 1 else [((), last)]
        labels = [
            ", ".join(f"{key} = {v:g}" for key, v in zip(keys[1:], values, strict=True))
            for values, _ in lines
        ]

        def draw(axes: Axes, name: str) -> None:
            for k, (_, line) in enumerate(lines):
                look: Any = {"color": LINE_COLOURS[k % 6], "marker": "os^vD*"[k // 6 % 6]}
                y = numbers(line[name])
                axes.plot(line[keys[0]], y, lw=LINE_PT, ms=4, label=labels[k] or None, **look)
            style_axes(axes, x_label=keys[0], z_label=DRAWN[name])

        names = [name for name in DRAWN if np.isfinite(numbers(table[name])).any()]
        panels = PaperPanels(
            plots=[Plot(title=DRAWN[name], draw=partial(draw, name=name)) for name in names],
            legend=labels if 1 < len(lines) <= 12 else (),
        )
        count = int(rows["state"].max()) + 1
        return panels_figure(panels, f"last of {count} states" if count > 1 else "one state")


def _simulated(grid: SweepGrid, layout: runs.RunLayout, start: int, stop: int) -> runs.Results:
    """The points [start, stop) of a grid; one that physics refuses is empty, with the reason."""
    arrays: dict[str, list[np.ndarray]] = {layer.name: [] for layer in layout.layers}
    shape = tuple(layout.shape.values())
    table, more = [], []
    for index in range(start, stop):
        try:
            result = simulate(grid.scene_at(index))
            assert result.orders is not None and result.frames is not None
            pictures = {ORDER.name: result.orders, GREY.name: result.frames}
            history, reason = {name: list(each) for name, each in result.history.items()}, ""
        except PhysicsError as error:
            pictures = dict.fromkeys(arrays, np.full(shape, np.nan, np.float32))
            history, reason = {}, str(error)
        for name, selected in arrays.items():
            selected.append(pictures[name].astype(np.float32))
        table.append({"history": history, "reason": reason})
        more.append({"status": "failed" if reason else "ok"})
    return runs.Results(
        {name: np.stack(selected) for name, selected in arrays.items()}, table, more
    )


def sweep(
    scene: SceneLike,
    vary: Sequence[str] | Mapping[str, Values],
    out: str | Path,
    *,
    workers: int | None = 1,
    cluster: str | None = None,
    restart: bool = False,
    progress: RunProgress | None = None,
) -> Swept:
    """Simulate a scene over a grid of values.

    Every combination of the varied keys' values is a point, simulated with all its states. A point
    whose physics is refused (a contact wider than the picture) stays empty, and its reason stands
    in the table.

    Parameters
    ----------
    scene : str, Path, Scene or mapping
        A TOML file, the name of a scene of the package, a Scene, or its tables.
    vary : sequence of str, or mapping of str to sequence of float
        For each key 'KEY=first:last:number' (evenly from first to last, both included) or
        'KEY=value,value,...', or a mapping of keys to values.
    out : str or Path
        Folder for run.zarr, whose axes are the varied keys (load_normal_n), state, z_mm and x_mm,
        with the fringe order, the grey levels (of a grey camera without phase steps) and the
        columns of history.csv; sweep.csv, the same columns as a table; scene.toml and
        provenance.json.
    workers : int or None, default 1
        Processes on this machine; None: as many as are useful. A script that asks for more than
        one needs the usual ``if __name__ == "__main__":``.
    cluster : str, optional
        Address of a Dask scheduler, in place of `workers`, such as 'tcp://host:8786'.
    restart : bool, default False
        Whether to begin anew where an earlier run was interrupted or is complete.
    progress : callable, optional
        Called with a Tally of the points.

    Returns
    -------
    Swept
        How many points there are and were refused, the varied values, and the reasons.

    Raises
    ------
    InputError
        Where a point is no scene, before anything is computed.
    PhysicsError
        Where every point is refused.

    Notes
    -----
    What is finished is kept in ``OUT.partial`` until all is: after a crash, the same call resumes
    from there.

    Examples
    --------
    >>> import isochrome
    >>> found = isochrome.sweep("ring", ["load.normal_n=60,80"], "loads")
    >>> found.points, found.failed
    (2, 0)
    >>> with isochrome.open_run("loads") as run:
    ...     run.n_max.dims
    ('load_normal_n', 'state')
    """
    scene = load_scene(scene)
    grid = make_grid(scene, vary)
    # the dataset's form is the same at all points
    first = grid.scene_at(0)
    if not first.has_model or first.camera is None:
        raise InputError("sweep_needs_model_camera", name=first.name)
    forms = {
        (state_count(point), pixels.rows, pixels.cols, point.polariscope.step_numbers)
        for point in map(grid.scene_at, range(math.prod(grid.counts.values())))
        for pixels in [pixel_grid(point)]
    }
    if len(forms) > 1:
        raise InputError("vary_changes_number_states", values=", ".join(grid.values))
    ((states, rows_, cols, steps),) = forms
    layers = (ORDER, GREY) if steps == (None,) and not first.camera.colour else (ORDER,)
    shape = {"state": states, "row": rows_, "col": cols}
    layout = runs.RunLayout(axes=grid.counts, shape=shape, layers=layers, chunk=1)
    seed = scene.camera.seed if scene.camera else None
    axes = {key: list(values) for key, values in grid.values.items()}
    identity = runs.run_identity(dump_scene(scene), scene.files(of_frames=False), axes, seed)
    job = runs.Job(partial(_simulated, grid, layout), layout, identity)
    options = runs.RunOptions(workers, cluster, restart)
    runs.run_job(job, out, partial(_finish, job=job, grid=grid), options=options, progress=progress)
    with runs.open_run(out) as dataset:
        reasons = [str(text) for text in dataset.reason.values.ravel() if text]
    return Swept(Path(out), layout.count, len(reasons), grid.values, tuple(dict.fromkeys(reasons)))


def _finish(run_folder: runs.RunFolder, job: runs.Job, grid: SweepGrid) -> None:
    # a row for each state of each point: the varied keys, and the columns of history.csv
    table = columns_of(
        grid.point(index)
        | {"state": state, "status": more["status"], "reason": row["reason"]}
        | {name: values[state] for name, values in row["history"].items() if name != "state"}
        for index, (row, more) in enumerate(runs.rows(run_folder))
        for state in range(run_folder.layout.shape["state"])
    )
    table["reason"] = table.pop("reason")  # the last
    if set(table["status"]) == {"failed"}:
        raise PhysicsError(
            "all_points_refused", count=run_folder.layout.count, reason=table["reason"][0]
        )
    write_csv(run_folder.results / TABLE, table)
    write_text(run_folder.results / "scene.toml", dump_scene(grid.scene))
    # the columns over the varied keys and state, and the axes' coordinates
    keys, count = (*grid.values, "state"), run_folder.layout.shape["state"]
    shape = (*grid.counts.values(), count)
    columns: dict[str, runs.Column] = {}
    for name in [name for name in table if name not in keys]:
        values, axes = table[name], keys
        text = any(isinstance(value, str) for value in values)
        data = (runs.texts(values) if text else numbers(values)).reshape(shape)
        if name in ("status", "reason"):  # of the point, whatever its states
            data, axes = data[..., 0], axes[:-1]
        columns[name] = runs.Column(axes, data, runs.named_units(name))
    places = {**grid.values, "state": range(count)}
    coordinates = {
        k: runs.Column((k,), np.array(along), runs.named_units(k)) for k, along in places.items()
    }
    if not any(key.startswith("camera.") for key in grid.values):
        coordinates |= picture_axes(pixel_grid(grid.scene_at(0)))
    runs.add_columns(
        run_folder.results / runs.STORE, columns, coordinates, runs.attributes(job.identity)
    )
