"""`compare`: metrics, figure and report of two sets of frames, or scars."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome import figures, output, reporting
from isochrome.comparison.frame_sets import (
    ComparedFrames,
    FrameMetrics,
    SetToCompare,
    compare_frames,
    compare_pair,
    frame_pairs,
    load_frame_set,
)
from isochrome.comparison.scar_comparison import ScarComparison, compare_scars
from isochrome.errors import InputError
from isochrome.fringes import order_contours, skeletons
from isochrome.runs import REPORT, seal
from isochrome.scene import ArrayFrames, Scene, dump_scene, load_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage


def side_by_side(
    experiment: ComparedFrames, simulation: ComparedFrames, metrics: Sequence[FrameMetrics]
) -> Figure:
    """As the paper's Fig. 11, of evenly spaced frames, simulated dark fringes over the
    experiment."""
    rows = tuple(output.evenly_spaced(range(len(metrics)), reporting.MOST_FRAMES))
    panels = side_by_side_panels(experiment, simulation, metrics, rows)
    *notes, foot = panels.notes
    foot = f"One scale, grey range and difference range for all rows; hatched: not known. {foot}"
    if len(rows) < len(metrics):
        foot += f" {len(rows)} of {len(metrics)} frames shown, evenly spaced."
    if experiment.pixel_mm is None and simulation.pixel_mm is None:
        foot += " No pixel scale is known."
    return figures.panels_figure(replace(panels, notes=[*notes, foot]), "")


def side_by_side_panels(
    experiment: ComparedFrames,
    simulation: ComparedFrames,
    metrics: Sequence[FrameMetrics] | Mapping[int, FrameMetrics],
    frames: Sequence[int],
    *,
    lines: bool = True,
) -> figures.PaperPanels:
    """The same for a paper: one scale, one grey range and one difference range for all frames."""
    chosen = [metrics[k] for k in frames]
    panes, place = _panes_of(experiment, simulation, chosen)

    def draw(axes: Axes, k: int, column: int) -> AxesImage:
        drawn = panes[k][column].draw(axes, place)
        if column or not lines:
            return drawn
        _, j = frame_pairs(experiment, simulation)[chosen[k].frame]
        for line in (
            skeletons(simulation.signal[j])
            if simulation.order is None
            else order_contours(simulation.order[j])
        ):
            if line.kind == "dark":  # thin enough to see what is below
                figures.draw_line(
                    axes, line.rows, line.cols, place, color=figures.OVERLAY_COLOUR,
                    linewidth=figures.LINE_PT, scalex=False, scaley=False,
                )  # fmt: skip
        return drawn

    labels = [figures.plain_name(numbers.label, figures.SHORT_NAME) for numbers in chosen]
    notes = [f"{label}: {_caption(row)}" for label, row in zip(labels, chosen, strict=True)]
    bars = {
        reporting.FRINGES: "difference of fringe order (fringes)",
        reporting.SIGNAL: "difference of signal (0 to 1)",
    }
    return figures.PaperPanels(
        kinds=[
            figures.PictureKind(
                name=pane.key,
                draw=partial(draw, column=column),
                bar=bars[pane.unit] if pane.key == "difference" else "",
            )
            for column, pane in enumerate(panes[0])
        ],
        labels=labels,
        notes=[*notes, "Orange: dark-fringe centre lines of the simulation."],
    )


def plot_side_by_side(
    experiment: SetToCompare,
    simulation: SetToCompare,
    axes: Sequence[Axes] | None = None,
    *,
    frame: int = 0,
    lines: bool = True,
) -> tuple[Axes, Axes, Axes]:
    """Draw one frame of an experiment, its simulation and their difference beside each other.

    As a row of the figure that `compare` makes: the difference is that of the fringe order where
    both have one, else that of the signal.

    Parameters
    ----------
    experiment : str, Path, Processed, array or sequence of arrays
        What was captured, as for `compare`.
    simulation : str, Path, Simulation, array or sequence of arrays
        What was simulated, on the same pixel grid.
    axes : sequence of matplotlib.axes.Axes, optional
        Three of them; by default those of a new figure of matplotlib.pyplot.
    frame : int, default 0
        Number of the pair of frames.
    lines : bool, default True
        Whether the simulation's dark-fringe centre lines are drawn over the experiment.

    Returns
    -------
    tuple of three matplotlib.axes.Axes
        What was drawn on: experiment, simulation, difference.

    Raises
    ------
    InputError
        Where the sets do not fit together, or there is no such frame.

    Examples
    --------
    >>> import isochrome
    >>> simulated = isochrome.simulate("ring")
    >>> found = isochrome.process(simulated.frames, "ring")
    >>> axes = isochrome.plot_side_by_side(found, simulated)
    >>> [one.get_title(loc="left") for one in axes][1:]
    ['simulation', 'experiment − simulation']
    """
    here, there = load_frame_set(experiment), load_frame_set(simulation)
    pairs = frame_pairs(here, there)
    if not 0 <= frame < len(pairs):
        raise InputError("frame_there_counted_from", frame=frame, pairs_count=len(pairs))
    if axes is not None and len(axes) != 3:
        raise InputError("axes_side_side_row", axes_count=len(axes))
    numbers = compare_pair(here, there, frame, pairs[frame])
    made = side_by_side_panels(here, there, {frame: numbers}, [frame], lines=lines)
    panels: Any = axes
    if axes is None:
        from matplotlib import pyplot

        many: Any = {"figsize": (12.0, 4.0), "sharex": True, "sharey": True}
        panels = pyplot.subplots(1, 3, layout="constrained", **many)[1]
    label = figures.plain_name(here.label(pairs[frame][0]), figures.SHORT_NAME)
    titles = (f"experiment: {label}", "simulation", "experiment − simulation")
    for one, kind, title in zip(panels, made.kinds, titles, strict=True):
        drawn = kind.draw(one, 0)
        one.set_title(title, loc="left")
    figures.add_colour_bar(drawn, made.kinds[2].bar)
    return panels[0], panels[1], panels[2]


def _panes_of(
    experiment: ComparedFrames, simulation: ComparedFrames, rows: Sequence[FrameMetrics]
) -> tuple[list[tuple[reporting.Pane, ...]], figures.Place]:
    """Experiment, simulation and difference of some pairs, each on one range, that of grey which
    99 % of the pixels fill; where they lie. Differences are in fringes where any pair has metrics
    of orders."""
    of_order = any(numbers.order_rms_fringe is not None for numbers in rows)
    pairs, shown = frame_pairs(experiment, simulation), []
    for numbers in rows:
        i, j = pairs[numbers.frame]
        measured, model = experiment.signal[i], simulation.signal[j]
        if of_order and experiment.order is not None and simulation.order is not None:
            gap = experiment.order[i] - simulation.order[j]
        else:
            gap = measured - (numbers.gain * model + numbers.offset)
        shown.append((measured, model, gap))
    bounds = [np.nanpercentile(image, (0.5, 99.5)) for *pair, _ in shown for image in pair]
    low, high = float(np.min(bounds)), float(np.max(bounds))
    grey = (low, high) if high > low else (low - 0.5, high + 0.5)
    unit = reporting.FRINGES if of_order else reporting.SIGNAL
    limit = figures.centred_limit(*(gap for *_, gap in shown))
    name = f"experiment − simulation, {'order N' if of_order else 'light'}"
    panes: list[tuple[reporting.Pane, ...]] = [
        (
            reporting.Pane("experiment", "experiment", measured, grey, reporting.SIGNAL),
            reporting.Pane("simulation", "simulation", model, grey, reporting.SIGNAL),
            reporting.Pane("difference", name, gap, (-limit, limit), unit),
        )
        for measured, model, gap in shown
    ]
    known = simulation if simulation.pixel_mm is not None else experiment
    return panes, {"pixel_mm": known.pixel_mm, "left_mm": known.left_mm, "top_mm": known.top_mm}


def _caption(numbers: FrameMetrics) -> str:
    parts = []
    if numbers.order_rms_fringe is not None:
        rms, p95 = numbers.order_rms_fringe, numbers.order_p95_fringe
        parts.append(f"fringe order RMS {rms:.2g} (95 % below {p95:.2g})")
        parts.append(f"wrong branch {100 * (numbers.wrong_branch_share or 0.0):.2g} %")
    parts.append(f"NCC {numbers.ncc:.4f}")
    px, mm = numbers.skeleton_distance_px, numbers.skeleton_distance_mm
    if px is not None and np.isfinite(px):
        distance = f"lines {px:.2g} px"
        distance += f" ({1000 * mm:.2g} µm)" if mm is not None and np.isfinite(mm) else ""
        share = numbers.skeleton_matched_share or 0.0
        parts.append(f"{distance} apart, {100 * share:.0f} % matched")
    if np.isfinite(numbers.rmse_over_noise):
        parts.append(f"χ {numbers.rmse_over_noise:.3g}")
    return "  ·  ".join(parts)


def comparison_report(
    experiment: ComparedFrames,
    simulation: ComparedFrames,
    result: Comparison,
    record: Mapping[str, Any],
    scene: Scene | None,
) -> reporting.ReportContent:
    """What the report says; `record`, what provenance.json holds; `scene`: None of bare frames."""
    metrics, columns = result.metrics, result.columns
    chosen = reporting.choose_frames(columns["rmse"], columns["rmse"])
    pairs = frame_pairs(experiment, simulation)
    panes, place = _panes_of(experiment, simulation, [metrics[k] for k in chosen])
    frames = [
        reporting.ReportFrame(
            number=k,
            label=metrics[k].label,
            why=why.replace("chi", "difference"),
            panes=pictures,
            order=None if experiment.order is None else experiment.order[pairs[k][0]],
            model_order=None if simulation.order is None else simulation.order[pairs[k][1]],
            **place,
        )
        for (k, why), pictures in zip(chosen.items(), panes, strict=True)
    ]
    few = ", for the reason that stands beside each" if len(chosen) < len(metrics) else ""
    text = f"correlation of the light (NCC) {output.over_items(columns['ncc'])}."
    if any(value is not None for value in columns["order_rms_fringe"]):
        orders, share = (
            output.over_items(columns[n]) for n in ("order_rms_fringe", "wrong_branch_share")
        )
        text = f"orders differ by {orders} fringe (RMS); share on a wrong branch {share}; {text}"
    return reporting.ReportContent(
        command="compare",
        title=result.title,
        verdict=f"{text[:1].upper()}{text[1:]}",
        frames=frames,
        choice=f"{len(chosen)} of {output.counted(len(metrics), 'frame')} are shown{few}.",
        no_budget="A comparison has none; those of its two sets stand in their own reports.",
        tables=[reporting.ReportTable("The metrics (metrics.csv)", columns)],
        causes_text="A comparison asks nothing of the frames: the reports of its two sets say what "
        "was found.",
        scene="" if scene is None else dump_scene(scene),
        scene_title="Scene of the experiment",
        paper=reporting.paper_rows(scene, record),
    )


_SETS = "compared_sets"
"""Key of provenance.json: the two sets, where both are on disk."""


@dataclass(frozen=True, repr=False)
class Comparison(output.Result):
    """Every number for each pair of frames.

    Parameters
    ----------
    metrics : list of FrameMetrics
        The numbers, one entry a pair of frames.
    load : callable
        Reads both sets of frames again: a result holds numbers, not films.
    """

    metrics: list[FrameMetrics]
    load: Callable[[], tuple[ComparedFrames, ComparedFrames]] = field(compare=False)

    @property
    def columns(self) -> dict[str, list[Any]]:
        """The columns of metrics.csv; None where a number cannot be had."""
        names = [one.name for one in fields(FrameMetrics) if one.name not in ("gain", "offset")]
        return {name: [getattr(one, name) for one in self.metrics] for name in names}

    @property
    def main_columns(self) -> tuple[str, ...]:
        """Columns that the command prints."""
        return "label", *MAIN_METRICS

    @property
    def warnings(self) -> tuple[str, ...]:
        """None: what cannot be compared is refused."""
        return ()

    @property
    def title(self) -> str:
        """How many pairs of frames were compared."""
        return f"Comparison of {output.counted(len(self.metrics), 'frame')}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """The metrics that the command prints, over the frames."""
        for name in MAIN_METRICS:
            yield name, output.over_items(self.columns[name])

    def to_json(self) -> dict[str, Any]:
        """The metrics of all frames."""
        return {"metrics": self.columns}

    def figure(self) -> Figure:
        """The pairs beside each other, with their difference, see `side_by_side`."""
        return side_by_side(*self.load(), self.metrics)

    def panels(self, frames: tuple[int, ...] | None = None) -> figures.PaperPanels:
        """Give experiment, simulation and difference for a paper; see `paper_figure`.

        `frames`: numbers of the pairs that are shown. Raises InputError where one is not there.
        """
        few = output.evenly_spaced(range(len(self.metrics)), 3)
        shown = figures.chosen_frames(frames, len(self.metrics), few)
        return side_by_side_panels(*self.load(), self.metrics, shown)


MAIN_METRICS = (
    "order_rms_fringe", "order_p95_fringe", "wrong_branch_share", "skeleton_distance_px", "ncc",
    "rmse_over_noise", "ssim",
)  # fmt: skip
"""Columns that are shown where all of them are too many."""


def compare(
    experiment: SetToCompare | Scene,
    simulation: SetToCompare | Scene,
    out: str | Path | None = None,
) -> Comparison | ScarComparison:
    """Compare two sets of frames, or measured scars with the simulated ones.

    Each pair of frames gives the root mean square and the 95th percentile of the difference of
    their orders, the share of pixels on a wrong branch, the distance of their fringe lines, and
    what their grey levels have in common: the correlation NCC and the structural similarity SSIM.
    Where the experiment is a scene with [[scar]], or a set of `calibrate_wear`, its traces are
    compared with the scars that the simulation's scene makes, see `compare_scars`.

    Parameters
    ----------
    experiment : str, Path, Scene, Processed, array or sequence of arrays
        What `process` left in a folder or gave in memory, or frames as for `open_frames`; or a
        scene with [[scar]], or the TOML file of a wear set.
    simulation : str, Path, Scene, Simulation, array or sequence of arrays
        What `simulate` left in a folder or gave in memory, or frames, on the same pixel grid; for
        scars that folder or a scene.
    out : str or Path, optional
        Folder for metrics.csv, provenance.json, comparison.png and report.html, or scars.csv and
        scars.png.

    Returns
    -------
    Comparison or ScarComparison
        The metrics, a row a frame or trace; orders are in fringes, distances in pixels.

    Raises
    ------
    InputError
        Where a set cannot be read, or the sets do not fit together.

    Notes
    -----
    NCC = <(a - mean a)(b - mean b)>/(s_a s_b). SSIM: Wang, Bovik, Sheikh & Simoncelli (2004), IEEE
    Trans. Image Process. 13, 600.

    Examples
    --------
    >>> import isochrome
    >>> one = isochrome.simulate("ring", "one")
    >>> other = isochrome.load_scene("ring").with_values({"load.normal_n": 201.0})
    >>> two = isochrome.simulate(other, "two")
    >>> found = isochrome.compare("one", "two")
    >>> print(f"{found.table['order_rms_fringe'][0]:.3f}")
    0.009
    """
    tabled = isinstance(experiment, str | Path) and Path(experiment).suffix == ".toml"
    if isinstance(experiment, Scene) or tabled:
        assert isinstance(experiment, str | Path | Scene)
        if not isinstance(simulation, str | Path | Scene):
            raise InputError("scars_compared_simulation_folder")
        return compare_scars(experiment, simulation, out)
    if isinstance(simulation, Scene):
        raise InputError("frames_compared_frames_simulate")
    here, there = load_frame_set(experiment), load_frame_set(simulation)
    result = Comparison(
        compare_frames(here, there),
        lambda: (load_frame_set(experiment), load_frame_set(simulation)),
    )
    if out is not None:
        with output.staged(out) as folder:
            output.write_csv(folder / "metrics.csv", result.columns)
            sets = ((experiment, here, "experiment"), (simulation, there, "simulation"))
            inputs = [
                given if isinstance(given, str | Path) else ArrayFrames(captured.signal, name)
                for given, captured, name in sets
            ]
            record = output.provenance(None, inputs)
            on_disk = all(isinstance(given, str | Path) for given in (experiment, simulation))
            record[_SETS] = [str(experiment), str(simulation)] if on_disk else None
            output.write_figure(
                folder / "comparison.png", side_by_side(here, there, result.metrics)
            )
            report = comparison_report(here, there, result, record, _scene_of(experiment))
            reporting.write_report(folder / REPORT, report)
            seal(folder, record)
    return result


def compared_again(record: Mapping[str, Any], name: str) -> reporting.ReportContent:
    """The report of two sets that were compared before, as they are on disk; `name`, the folder."""
    sets = record.get(_SETS)
    if not sets:
        raise InputError("compared_what_memory_does", name=name)
    now = (
        output.provenance(None, sets)["inputs_sha256"]
        if all(Path(s).exists() for s in sets)
        else {}
    )
    if now != record.get("inputs_sha256"):
        raise InputError("another_now_not_there", name=name, sets=sets[0], sets_2=sets[1])
    here, there = (load_frame_set(one) for one in sets)
    result = Comparison(compare_frames(here, there), lambda: (here, there))
    return comparison_report(here, there, result, record, _scene_of(sets[0]))


def _scene_of(given: SetToCompare) -> Scene | None:
    """The scene of a set: that in its folder or of what was in memory; None of bare frames."""
    if isinstance(given, str | Path):
        file = Path(given) / "scene.toml"
        return load_scene(file) if file.is_file() else None
    scene = getattr(given, "scene", None)
    return scene if isinstance(scene, Scene) else None
