"""`compare` for scars: measured traces beside those that a scene's wear makes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from isochrome import figures, output
from isochrome.calibration import WearSet
from isochrome.contact import SurfaceState, contact_states
from isochrome.errors import InputError
from isochrome.messages import message, warnings_json
from isochrome.reporting import MOST_FRAMES
from isochrome.runs import opened_record, seal
from isochrome.scars import LevelledTrace, UnclearScarError, definite, levelled, read_trace
from isochrome.scene import Scene, dump_scene, load_scene, parse_toml, read_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.floating]

_PARTS = ("specimen", "indenter", "load", "friction", "wear")
"""Tables whose numbers a scar follows."""


@dataclass(frozen=True, kw_only=True)
class SimulatedScar:
    """A simulated scar at one distance; what an input's standard uncertainty does is by its key."""

    distance_m: float
    x_mm: Array
    depth_um: Array  # worn depth (n,)
    edges_mm: tuple[float, float]
    worn_area_mm2: float  # ∫h dx
    moved_um: Mapping[str, Array]  # of the depth
    moved: Mapping[str, Array]  # of the worn area (mm²), the width (mm), the largest depth (µm)

    @property
    def width_mm(self) -> float:
        """Distance of the edges, mm."""
        return self.edges_mm[1] - self.edges_mm[0]

    @property
    def spreads(self) -> tuple[float, float, float]:
        """Standard uncertainties of area (mm²), width (mm) and largest depth (µm) by the inputs."""
        area, width, depth = root_sum_square(self.moved) * np.ones(3)
        return float(area), float(width), float(depth)

    def on_bins(self, x_mm: Array, values: Array) -> Array:
        """Means (m,) of a profile (n,) of this scar over equal bins about places (m,), mm."""
        area = np.cumsum(0.5 * np.diff(self.x_mm) * (values[1:] + values[:-1]))
        return self.slope(x_mm, np.concatenate([[0.0], area]))

    def slope(self, x_mm: Array, values: Array) -> Array:
        """Slope (m,), per mm, of a profile (n,) over equal bins about places (m,), mm."""
        step = x_mm[1] - x_mm[0]
        ends = np.append(x_mm - 0.5 * step, x_mm[-1] + 0.5 * step)
        return np.asarray(np.diff(np.interp(ends, self.x_mm, values)) / step)


def root_sum_square(moved: Mapping[str, Any]) -> Any:
    """Root of the sum of squares of what inputs that know nothing of each other move."""
    return np.sqrt(sum((np.square(value) for value in moved.values()), np.zeros(())))


def simulated_scars(scene: Scene, distances_m: Sequence[float]) -> list[SimulatedScar]:
    """Simulate a scene's scars, and how its stated uncertainties move them: each input to both
    sides by u, dh = (h(+u) - h(-u))/2, which is h's derivative times u to the second order."""
    if scene.wear is None:
        raise InputError("has_no_wear_which", name=scene.name)

    def states(one: Scene) -> list[SurfaceState]:
        return contact_states(one)[-len(distances_m) :]  # a static one may come first

    worn = scene.with_values({"wear.distances_m": tuple(distances_m)})
    sides = {}
    for key, spread in scene.uncertainties.items():
        if key.split(".")[0] not in _PARTS or not spread > 0.0:
            continue
        try:
            moved = [worn.with_values({key: worn.get(key) + side * spread}) for side in (1.0, -1.0)]
        except InputError as error:
            raise InputError(
                "standard_uncertainty", name=scene.name, key=key, spread=spread, error=error
            ) from error
        sides[key] = [states(one) for one in moved]
    result = []
    for i, state in enumerate(states(worn)):
        x = state.grid.x_mm
        profiles, numbers = dict[str, Array](), dict[str, Array]()
        for key, (more, less) in sides.items():
            up, down = (
                np.interp(x, one.grid.x_mm, 1e3 * one.wear_depth_mm, left=0.0, right=0.0)
                for one in (more[i], less[i])
            )
            profiles[key] = 0.5 * (up - down)
            area = more[i].worn_area_mm2 - less[i].worn_area_mm2
            width = np.diff(_edges(more[i]))[0] - np.diff(_edges(less[i]))[0]
            numbers[key] = 0.5 * np.array([area, width, up.max() - down.max()])
        depth = 1e3 * state.wear_depth_mm
        result.append(
            SimulatedScar(
                distance_m=state.distance_m, x_mm=x, depth_um=depth, edges_mm=_edges(state),
                worn_area_mm2=float(1e-3 * np.trapezoid(depth, x)), moved_um=profiles,
                moved=numbers,
            )
        )  # fmt: skip
    return result


def _edges(state: SurfaceState) -> tuple[float, float]:
    """Where the surface is worn, mm: the contact's own edges where it only grew."""
    if state.scar_edges_mm is not None:
        return state.scar_edges_mm
    faint = 0.01 * state.wear_depth_mm.max() if state.rough else 0.0  # no edge of its own
    worn = np.flatnonzero(state.wear_depth_mm > faint)
    x, half = state.grid.x_mm, 0.5 * state.grid.spacing_mm
    return float(x[worn[0]]) - half, float(x[worn[-1]]) + half


def simulated_text(value: float, spread: float) -> str:
    """A simulated value with its uncertainty, alone where no input's uncertainty is stated."""
    return output.with_uncertainty(value, spread) if spread > 0.0 else f"{value:.4g}"


@dataclass(frozen=True, kw_only=True)
class ScarPair:
    """A levelled trace, moved onto the simulated scar of its distance.

    Parameters
    ----------
    trace : LevelledTrace
        The trace.
    scar : SimulatedScar
        The scar.
    shift_mm : float
        What was taken off the trace's x, mm.
    shift_uncertainty_mm : float
        Its standard uncertainty, mm.
    x_mm : ndarray, shape (n,)
        Places of the trace's bins in the scene, mm.
    simulated_um : ndarray, shape (n,)
        The simulated depth, as means over the bins, µm.
    simulated_uncertainty_um : ndarray, shape (n,)
        Its standard uncertainty by the scene's inputs, µm.
    difference_um : ndarray, shape (n,)
        Measured less simulated depth, µm.
    difference_uncertainty_um : ndarray, shape (n,)
        Its standard uncertainty by roughness, levelling, shift and inputs, µm.
    rms_um : float
        Root mean square difference over the scar, µm.
    chi : float
        The difference over its uncertainty, over the scar: near 1 where both agree.
    """

    trace: LevelledTrace
    scar: SimulatedScar
    shift_mm: float
    shift_uncertainty_mm: float
    x_mm: Array
    simulated_um: Array
    simulated_uncertainty_um: Array
    difference_um: Array
    difference_uncertainty_um: Array
    rms_um: float
    chi: float

    @property
    def area_difference_mm2(self) -> tuple[float, float]:
        """Measured less simulated worn area, and its standard uncertainty, mm²."""
        spread = np.hypot(self.trace.worn_area_uncertainty_mm2, self.scar.spreads[0])
        return self.trace.worn_area_mm2 - self.scar.worn_area_mm2, float(spread)


def pair_scar(trace: LevelledTrace, scar: SimulatedScar) -> ScarPair:
    """Move a trace, whose x begins anywhere, onto a simulated scar, and subtract: with d =
    h_measured - h_simulated over n bins the shift is that of least dᵀ C_trace⁻¹ d, u_shift² =
    1/(h'ᵀ C_trace⁻¹ h'), C = C_trace + Σ_inputs δh δhᵀ + u_shift² h' h'ᵀ, chi² = dᵀ C⁻¹ d/n. A
    deeper or wider scar stays in the middle: h' is odd."""
    first = trace.centre_mm - 0.5 * sum(scar.edges_mm)
    fitted = _both(trace, scar, first)
    root = np.linalg.cholesky(definite(trace.depth_covariance_um2[np.ix_(fitted, fitted)]))

    def residual(shift: Array) -> Array:
        simulated = scar.on_bins(trace.x_mm - shift[0], scar.depth_um)
        return np.linalg.solve(root, (trace.depth_um - simulated)[fitted])

    best = least_squares(residual, [first], x_scale=scar.width_mm)
    shift, spread = float(best.x[0]), float(np.linalg.norm(best.jac)) ** -1.0
    x = trace.x_mm - shift
    inside, slope = _both(trace, scar, shift), scar.slope(x, scar.depth_um)
    simulated = scar.on_bins(x, scar.depth_um)
    rows = [scar.on_bins(x, moved) for moved in scar.moved_um.values()]
    inputs = np.array(rows).reshape(-1, len(x))
    covariance = trace.depth_covariance_um2 + inputs.T @ inputs
    covariance += spread**2 * np.outer(slope, slope)
    difference = trace.depth_um - simulated
    d = difference[inside]
    part = definite(covariance[np.ix_(inside, inside)])
    return ScarPair(
        trace=trace, scar=scar, shift_mm=shift, shift_uncertainty_mm=spread, x_mm=x,
        simulated_um=simulated, simulated_uncertainty_um=np.sqrt(np.sum(inputs**2, axis=0)),
        difference_um=difference, difference_uncertainty_um=np.sqrt(np.diag(covariance)),
        rms_um=float(np.sqrt(np.mean(d**2))),
        chi=float(np.sqrt(d @ np.linalg.solve(part, d) / len(d))),
    )  # fmt: skip


def _both(trace: LevelledTrace, scar: SimulatedScar, shift: float) -> NDArray[np.intp]:
    """Bins where either of both scars reaches."""
    left, right = (edge - shift for edge in trace.window_mm)
    low, high = min(left, scar.edges_mm[0]), max(right, scar.edges_mm[1])
    x = trace.x_mm - shift
    return np.flatnonzero((x >= low) & (x <= high))


_APART = 3.0
"""Standard uncertainties by which areas differ that a warning names."""


@dataclass(frozen=True, repr=False, kw_only=True)
class ScarComparison(output.Result):
    """Measured scars beside simulated ones.

    Parameters
    ----------
    scene : Scene
        The scene whose wear made the simulated scars.
    names : tuple of str
        Names of the traces.
    scars : tuple of SimulatedScar
        The simulated scar at the distance of each trace.
    pairs : tuple of ScarPair or None
        Each trace on its scar; None where it shows none.
    messages : tuple of str
        What is to be known of the traces.
    """

    scene: Scene
    names: tuple[str, ...]
    scars: tuple[SimulatedScar, ...]
    pairs: tuple[ScarPair | None, ...]
    messages: tuple[str, ...] = ()

    @property
    def traces(self) -> list[tuple[str, SimulatedScar, ScarPair | None]]:
        """Each trace's name, its simulated scar, and itself on that."""
        return list(zip(self.names, self.scars, self.pairs, strict=True))

    @property
    def columns(self) -> dict[str, list[Any]]:
        """Those of metrics.csv, a row a trace."""
        rows = []
        for name, scar, pair in self.traces:  # None where a trace shows no scar
            trace = pair.trace if pair else None
            edges = trace and trace.edge_uncertainty_mm
            area, spread = pair.area_difference_mm2 if pair else (None, None)
            area_spread, width_spread, depth_spread = scar.spreads
            rows.append(
                {
                    "trace": name,
                    "distance_m": scar.distance_m,
                    "shift_mm": pair and pair.shift_mm,
                    "shift_uncertainty_mm": pair and pair.shift_uncertainty_mm,
                    "measured_area_mm2": trace and trace.worn_area_mm2,
                    "measured_area_uncertainty_mm2": trace and trace.worn_area_uncertainty_mm2,
                    "simulated_area_mm2": scar.worn_area_mm2,
                    "simulated_area_uncertainty_mm2": area_spread,
                    "area_difference_mm2": area,
                    "area_difference_uncertainty_mm2": spread,
                    "measured_width_mm": trace and trace.width_mm,
                    "measured_width_uncertainty_mm": edges and float(np.hypot(*edges)),
                    "simulated_width_mm": scar.width_mm,
                    "simulated_width_uncertainty_mm": width_spread,
                    "simulated_depth_um": float(scar.depth_um.max()),
                    "simulated_depth_uncertainty_um": depth_spread,
                    "difference_rms_um": pair and pair.rms_um,
                    "difference_chi": pair and pair.chi,
                }
            )
        return output.columns_of(rows)

    @property
    def profiles(self) -> dict[str, Any]:
        """Columns of scars.csv: depths over x of each trace that shows a scar."""
        rows = [
            {
                "trace": [name] * len(pair.x_mm),
                "distance_m": [scar.distance_m] * len(pair.x_mm),
                "x_mm": pair.x_mm,
                "measured_um": pair.trace.depth_um,
                "measured_uncertainty_um": np.sqrt(np.diag(pair.trace.depth_covariance_um2)),
                "simulated_um": pair.simulated_um,
                "simulated_uncertainty_um": pair.simulated_uncertainty_um,
                "difference_um": pair.difference_um,
                "difference_uncertainty_um": pair.difference_uncertainty_um,
            }
            for name, scar, pair in self.traces
            if pair is not None
        ]
        return {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}

    @property
    def main_columns(self) -> tuple[str, ...]:
        """Columns that the command prints."""
        return (
            "trace", "distance_m", "measured_area_mm2", "measured_area_uncertainty_mm2",
            "simulated_area_mm2", "simulated_area_uncertainty_mm2", "measured_width_mm",
            "simulated_width_mm", "difference_rms_um", "difference_chi",
        )  # fmt: skip

    @property
    def warnings(self) -> tuple[str, ...]:
        """What traces show besides a scar, areas that differ, and inputs taken as exact."""
        result = list(self.messages)
        for name, scar, pair in self.traces:
            if pair is None:
                continue
            gap, spread = pair.area_difference_mm2
            if abs(gap) > _APART * spread:
                text = message(
                    "worn_area_mm_differs", name=name, worn_area_mm2=pair.trace.worn_area_mm2,
                    worn_area_mm2_2=scar.worn_area_mm2, spread=abs(gap) / spread,
                )  # fmt: skip
                result.append(text)
        if not self.scars[0].moved_um:
            result.append(message("states_no_uncertainty_so", name=self.scene.name))
        return tuple(result)

    @property
    def title(self) -> str:
        """How many traces were compared."""
        return f"Comparison of {output.counted(len(self.names), 'scar trace')}: {self.scene.name}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """Measured and simulated worn area of each trace."""
        for name, scar, pair in self.traces:
            model = simulated_text(scar.worn_area_mm2, scar.spreads[0])
            area = "no clear scar"
            if pair is not None:
                trace = pair.trace
                area = output.with_uncertainty(trace.worn_area_mm2, trace.worn_area_uncertainty_mm2)
            yield f"{name}, {scar.distance_m:g} m", f"{area} mm², simulated {model} mm²"

    def to_json(self) -> dict[str, Any]:
        """The metrics of all traces, and the warnings."""
        return {"metrics": self.columns, **warnings_json(self.warnings)}

    def panels(self, frames: tuple[int, ...] | None = None) -> figures.PaperPanels:
        """Give all measured and all simulated scars for a paper, and each distance's overlay.

        `frames`: numbers of the distances, see `paper_figure`. InputError where one is not there.
        """
        distances = sorted({scar.distance_m for scar in self.scars})
        few = output.evenly_spaced(range(len(distances)), _FOR_PAPER)
        shown = figures.chosen_frames(frames, len(distances), few, items="distances")
        rows: list[_Row] = []
        for k, colour in zip(shown, cycle(figures.LINE_COLOURS), strict=False):
            members = [trace for trace in self.traces if trace[1].distance_m == distances[k]]
            pairs = [(name, pair) for name, _, pair in members if pair is not None]
            rows.append((members[0][1], pairs, colour))
        half = _BESIDE * 0.5 * max(scar.width_mm for scar in self.scars)

        def plot(title: str, draw: Callable[[Axes], None], label: str = "depth (µm)") -> None:
            def within(axes: Axes) -> None:
                draw(axes)
                axes.set_xlim(-half, half)
                if label.startswith("depth"):
                    axes.invert_yaxis()
                figures.style_axes(axes, x_label="x (mm)", z_label=label)

            plots.append(figures.Plot(title=title, draw=within))

        def measured(axes: Axes) -> None:
            for scar, traces, colour in rows:
                if traces:  # their mean
                    x = traces[0][1].x_mm
                    each = [np.interp(x, pair.x_mm, pair.trace.depth_um) for _, pair in traces]
                    mean, name = np.mean(each, axis=0), f"{scar.distance_m:g} m"
                    axes.plot(x, mean, color=colour, lw=figures.LINE_PT, label=name)
            figures.add_legend(axes, loc="lower right")

        def simulated(axes: Axes) -> None:
            for row in rows:
                _draw_simulated(axes, row)

        plots: list[figures.Plot] = []
        plot("measured", measured)
        plot("simulated", simulated)
        for row in rows:
            name = f"{row[0].distance_m:g} m"
            plot(name, partial(_draw_overlay, row=row))
            gap = partial(_draw_gap, row=row)
            plot(f"{name}, measured − simulated", gap, "difference (µm)")
        notes = [*map(_note, rows), f"Bands: ± {figures.BAND:g} standard uncertainties."]
        return figures.PaperPanels(plots=plots, plots_across=2, notes=notes)

    def figure(self) -> Figure:
        """Measured scars beside simulated ones; below, each distance's overlay and difference.

        The top row is the paper's Fig. 7 beside its Fig. 9, with the band of the scene's inputs.
        """
        count = len({scar.distance_m for scar in self.scars})
        panels = self.panels(tuple(output.evenly_spaced(range(count), MOST_FRAMES)))
        name = figures.plain_name(self.scene.name)
        return figures.panels_figure(panels, f"{name}: measured scars beside simulated ones")


def compare_scars(
    measured: str | Path | Scene | WearSet | Sequence[tuple[str | Path, float]],
    simulation: str | Path | Scene,
    out: str | Path | None = None,
) -> ScarComparison:
    """Set measured scars beside the simulated ones. Traces (of a scene, a `calibrate_wear` set, or
    files with their distances, m) are levelled on their shoulders and moved onto the simulated
    scar. The band is the root sum of squares of [h(+u) - h(-u)]/2: JCGM 100:2008 (GUM), 5.1."""
    files, listed = _traces(measured)
    if not isinstance(simulation, Scene) and Path(simulation).is_dir():  # what `simulate` left
        simulation = Path(simulation) / "scene.toml"
        if not simulation.is_file():
            raise InputError("not_there_name_result", file=simulation)
        opened_record(simulation.parent, [simulation.name])
    scene = load_scene(simulation)
    distances = sorted(set(listed))
    by_distance = dict(zip(distances, simulated_scars(scene, distances), strict=True))
    scars = tuple(by_distance[distance] for distance in listed)
    pairs, messages = _paired(files, scars)
    names = tuple(file.name for file in files)
    result = ScarComparison(scene=scene, names=names, scars=scars, pairs=pairs, messages=messages)
    if out is not None:
        with output.staged(out) as folder:
            output.write_csv(folder / "metrics.csv", result.columns)
            output.write_csv(folder / "scars.csv", result.profiles)
            output.write_figure(folder / "scars.png", result.figure())
            inputs = [*files, *scene.files(of_frames=False)]
            seal(folder, output.provenance(dump_scene(scene), inputs))
    return result


def _traces(
    measured: str | Path | Scene | WearSet | Sequence[tuple[str | Path, float]],
) -> tuple[list[Path], list[float]]:
    rows: list[tuple[Path, float]]
    # sets of a wear calibration have traces, and no scenes do
    if (
        isinstance(measured, str | Path)
        and (file := Path(measured)).is_file()
        and "trace" in parse_toml(read_text(file), str(file))
    ):
        measured = WearSet.read(measured)
    if isinstance(measured, WearSet):
        rows = [(measured.path(trace.file), trace.distance_m) for trace in measured.trace]
    elif isinstance(measured, str | Path | Scene):
        scene = load_scene(measured)
        rows = [(scene.path(scar.file), scar.distance_m) for scar in scene.scar]
        if not rows:
            raise InputError("has_no_scar_file", name=scene.name)
    else:
        rows = [(Path(file), float(distance)) for file, distance in measured]
    wrong = [distance for _, distance in rows if not 0.0 < distance < np.inf]
    if wrong or not rows:
        raise InputError("distances_traces_give_traces", wrong=wrong)
    files, distances = zip(*rows, strict=True)
    return list(files), list(distances)


def _paired(
    files: Sequence[Path], scars: Sequence[SimulatedScar]
) -> tuple[tuple[ScarPair | None, ...], tuple[str, ...]]:
    """Each trace on its scar, and what is to be said."""
    pairs: list[ScarPair | None] = []
    messages: list[str] = []
    first: UnclearScarError | None = None
    for file, scar in zip(files, scars, strict=True):
        try:
            result = levelled(read_trace(file))
        except UnclearScarError as unclear:
            first = first or unclear
            pairs.append(None)
            messages.append(str(unclear))
            continue
        pairs.append(pair_scar(result, scar))
        messages += result.messages
    if first is not None and not any(pairs):
        raise first
    return tuple(pairs), tuple(messages)


_FOR_PAPER = 4
"""Distances of a figure for a paper where nobody names them."""
_BESIDE = 1.7
"""Half of what is drawn over half of the widest scar."""

_Row = tuple[SimulatedScar, list[tuple[str, ScarPair]], Any]
"""Of a distance its simulated scar, its named traces, and their colour."""


def _draw_simulated(axes: Axes, row: _Row, **look: Any) -> None:
    scar, _, colour = row
    spread = np.broadcast_to(root_sum_square(scar.moved_um), scar.depth_um.shape)
    look = {"colour": colour, "lw": figures.LINE_PT, "label": f"{scar.distance_m:g} m"} | look
    figures.draw_band(axes, scar.x_mm, scar.depth_um, spread, **look)


def _draw_overlay(axes: Axes, row: _Row) -> None:
    _draw_simulated(axes, row, colour=figures.INK, lw=figures.BOLD_PT, label="simulated")
    _draw_traces(axes, row, lambda pair: pair.trace.depth_um)
    figures.add_legend(axes, loc="lower right")


def _draw_traces(axes: Axes, row: _Row, depth: Callable[[ScarPair], Array]) -> None:
    """Paler from trace to trace."""
    _, traces, colour = row
    for number, (name, pair) in enumerate(traces):
        look = {"color": colour, "lw": figures.LINE_PT, "alpha": 1.0 - 0.6 * number / len(traces)}
        label = figures.plain_name(name, figures.SHORT_NAME)
        axes.plot(pair.x_mm, depth(pair), label=label, **look)


def _draw_gap(axes: Axes, row: _Row) -> None:
    _, traces, colour = row
    _draw_traces(axes, row, lambda pair: pair.difference_um)
    axes.axhline(0.0, color=figures.GREY, lw=figures.FINE_PT)
    if traces:
        pair = traces[0][1]
        band = figures.BAND * pair.difference_uncertainty_um
        axes.fill_between(pair.x_mm, -band, band, color=colour, alpha=0.2, lw=0)


def _note(row: _Row) -> str:
    """Worn areas, in 1e-3 mm², the mean of the traces' beside the simulated one; the difference."""
    scar, traces, _ = row
    model = simulated_text(1e3 * scar.worn_area_mm2, 1e3 * scar.spreads[0])
    head = f"{scar.distance_m:g} m: worn area (1e-3 mm²)"
    if not traces:
        nothing = message("measured_simulated_nothing_compare")
        return f"{head}: no clear scar, simulated {model}; {nothing}."
    area = [1e3 * pair.trace.worn_area_mm2 for _, pair in traces]
    spread = [1e3 * pair.trace.worn_area_uncertainty_mm2 for _, pair in traces]
    text = output.with_uncertainty(
        float(np.mean(area)), float(np.hypot.reduce(spread)) / len(spread)
    )
    rms, chi = np.mean([(pair.rms_um, pair.chi) for _, pair in traces], axis=0)
    gap = f"measured − simulated: {rms:.2g} µm rms, χ = {chi:.2f}"
    return f"{head} {text}, simulated {model}; {gap}."
