"""`compare`: the metrics and the side-by-side figure of two sets of frames, or of scars.

What the report of two compared sets of frames says.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isochrome.comparison.figure import (
    grey_range,
    pair_images,
    place_of_pair,
    side_by_side,
    side_by_side_panels,
)
from isochrome.comparison.frame_folders import SetToCompare, load_frame_set
from isochrome.comparison.frame_sets import (
    ComparedFrames,
    FrameMetrics,
    compare_frames,
    frame_pairs,
)
from isochrome.comparison.scar_comparison import ScarComparison, compare_scars
from isochrome.errors import InputError
from isochrome.figures import PaperPanels, centred_limit
from isochrome.output import (
    Result,
    counted,
    over_items,
    provenance,
    staged,
    write_csv,
    write_figure,
)
from isochrome.reporting import (
    FRINGES,
    SIGNAL,
    Pane,
    ReportContent,
    ReportFrame,
    ReportTable,
    choose_frames,
    paper_rows,
    write_report,
)
from isochrome.runs import REPORT, seal
from isochrome.scene import ArrayFrames, Scene, dump_scene, load_scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TEXT = "A comparison asks nothing of the frames: the reports of its two sets say what was found."


def comparison_report(
    experiment: ComparedFrames,
    simulation: ComparedFrames,
    metrics: Sequence[FrameMetrics],
    columns: Mapping[str, Sequence[Any]],
    record: Mapping[str, Any],
    scene: Scene | None = None,
) -> ReportContent:
    """What the report says.

    Parameters: `experiment`, `simulation`, the sets; `metrics` of their pairs of frames; `columns`
    of metrics.csv; `record`, what provenance.json holds; `scene` of the experiment, None of bare
    frames. Returns ReportContent.
    """
    chosen = choose_frames([m.signals.rmse for m in metrics], [m.signals.rmse for m in metrics])
    pairs = frame_pairs(experiment, simulation)
    of_order = any(m.orders is not None for m in metrics)
    images = {
        one.number: pair_images(
            experiment, simulation, (*pairs[one.number], metrics[one.number]), of_order
        )
        for one in chosen
    }
    grey = grey_range([image for row in images.values() for image in row[:2]])
    limit = centred_limit(*(gap for *_, gap in images.values()))
    place = place_of_pair(experiment, simulation)
    frames = []
    for one in chosen:
        here, there = pairs[one.number]
        frames.append(
            ReportFrame(
                number=metrics[one.number].frame,
                label=metrics[one.number].label,
                why=one.why.replace("chi", "difference"),
                panes=_panes(images[one.number], grey, limit, of_order),
                order=None if experiment.order is None else experiment.order[here],
                model_order=None if simulation.order is None else simulation.order[there],
                **place,
            )
        )
    few = ", for the reason that stands beside each" if len(chosen) < len(metrics) else ""
    return ReportContent(
        command="compare",
        title=f"Comparison of {counted(len(metrics), 'frame')}",
        verdict=_verdict(columns),
        frames=frames,
        choice=f"{len(chosen)} of {counted(len(metrics), 'frame')} are shown{few}.",
        no_budget="A comparison has none; those of its two sets stand in their own reports.",
        tables=[ReportTable("The metrics (metrics.csv)", columns)],
        causes_text=_TEXT,
        scene="" if scene is None else dump_scene(scene),
        scene_title="Scene of the experiment",
        paper=paper_rows(scene, record),
    )


def _panes(
    images: tuple[Any, Any, Any], grey: tuple[float, float], limit: float, of_order: bool
) -> tuple[Pane, ...]:
    """The pictures of a pair: both on one range of grey, and their difference."""
    own, model, gap = images
    unit = FRINGES if of_order else SIGNAL
    of_what = "order N" if of_order else "light"
    return (
        Pane("experiment", "experiment", own, grey, SIGNAL),
        Pane("simulation", "simulation", model, grey, SIGNAL),
        Pane("difference", f"experiment − simulation, {of_what}", gap, (-limit, limit), unit),
    )


def _verdict(columns: Mapping[str, Sequence[Any]]) -> str:
    """How far the two are apart."""
    parts = []
    if any(value is not None for value in columns["order_rms_fringe"]):
        parts.append(f"orders differ by {over_items(columns['order_rms_fringe'])} fringe (RMS)")
        parts.append(f"share on a wrong branch {over_items(columns['wrong_branch_share'])}")
    parts.append(f"correlation of the light (NCC) {over_items(columns['ncc'])}")
    text = "; ".join(parts)
    return f"{text[:1].upper()}{text[1:]}."


_SETS = "compared_sets"
"""Key of provenance.json: the two sets, where both are on disk."""


@dataclass(frozen=True, repr=False)
class Comparison(Result):
    """Every number for each pair of frames.

    Parameters
    ----------
    metrics : list of FrameMetrics
        The numbers, one entry a pair of frames.
    columns : dict of str to list
        The columns of metrics.csv.
    draw : callable, optional
        Makes the figure.
    load : callable, optional
        Reads both sets of frames.
    """

    metrics: list[FrameMetrics]
    columns: dict[str, list[Any]]
    load: Callable[[], tuple[ComparedFrames, ComparedFrames]] | None = field(
        default=None, compare=False, kw_only=True
    )

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
        return f"Comparison of {counted(len(self.metrics), 'frame')}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """The metrics that the command prints, over the frames."""
        for name in MAIN_METRICS:
            yield name, over_items(self.columns[name])

    def to_json(self) -> dict[str, Any]:
        """The metrics of all frames."""
        return {"metrics": self.columns}

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give experiment, simulation and difference for a paper; see `paper_figure`.

        `frames`: numbers of the pairs that are shown. Raises InputError where one is not there.
        """
        if self.load is None:
            raise InputError(f"{self.title}: its frames were not kept; compare them again")
        return side_by_side_panels(*self.load(), self.metrics, frames)


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
    >>> scene = isochrome.load_scene("ring").with_values({
    ...     "load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
    ...     "camera.pixel_mm": 0.36, "camera.noise_grey": 1.0})
    >>> one = isochrome.simulate(scene, "one")
    >>> two = isochrome.simulate(scene.with_values({"load.normal_n": 61.0}), "two")
    >>> found = isochrome.compare("one", "two")
    >>> print(f"{found.table['order_rms_fringe'][0]:.3f}")
    0.008
    """
    tabled = isinstance(experiment, str | Path) and Path(experiment).suffix == ".toml"
    if isinstance(experiment, Scene) or tabled:
        assert isinstance(experiment, str | Path | Scene)
        if not isinstance(simulation, str | Path | Scene):
            raise InputError("scars are compared with a simulation's folder or scene; name that")
        return compare_scars(experiment, simulation, out)
    if isinstance(simulation, Scene):
        raise InputError("frames are compared with frames; simulate the scene first")
    here, there = load_frame_set(experiment), load_frame_set(simulation)
    metrics = compare_frames(here, there)
    load = partial(_both_sets, experiment, simulation)
    draw = partial(_draw, load, metrics)
    result = Comparison(metrics, _table(metrics), draw=draw, load=load)
    if out is not None:
        with staged(out) as folder:
            write_csv(folder / "metrics.csv", result.columns)
            sets = ((experiment, here, "experiment"), (simulation, there, "simulation"))
            record = provenance(None, [_hashed(*one) for one in sets])
            on_disk = all(isinstance(given, str | Path) for given in (experiment, simulation))
            record[_SETS] = [str(experiment), str(simulation)] if on_disk else None
            write_figure(folder / "comparison.png", side_by_side(here, there, metrics))
            scene = _scene_of(experiment)
            content = comparison_report(here, there, metrics, result.columns, record, scene)
            write_report(folder / REPORT, content)
            seal(folder, record)
    return result


def compared_again(record: Mapping[str, Any], name: str) -> ReportContent:
    """The report of two sets that were compared before, of the sets as they are on disk.

    `record` is the comparison's provenance.json, `name` its folder in messages. InputError where
    the sets were not files, are not there, or are others by now.
    """
    sets = record.get(_SETS)
    if not sets:
        raise InputError(
            f"{name}: compared what was in memory, or does not say what; run compare again, which "
            "writes its report"
        )
    now = provenance(None, sets)["inputs_sha256"] if all(Path(s).exists() for s in sets) else {}
    if now != record.get("inputs_sha256"):
        raise InputError(
            f"{name}: {sets[0]} or {sets[1]} is another by now, or not there; run compare again, "
            "from the same folder as then"
        )
    here, there = (load_frame_set(one) for one in sets)
    metrics = compare_frames(here, there)
    return comparison_report(here, there, metrics, _table(metrics), record, _scene_of(sets[0]))


def _scene_of(given: SetToCompare) -> Scene | None:
    """The scene of a set: that in its folder or of what was in memory; None of bare frames."""
    if isinstance(given, str | Path):
        file = Path(given) / "scene.toml"
        return load_scene(file) if file.is_file() else None
    own = getattr(given, "scene", None)
    return own if isinstance(own, Scene) else None


def _hashed(given: SetToCompare, frames: ComparedFrames, name: str) -> str | Path | ArrayFrames:
    """What provenance.json has the hash of: files, or what was in memory."""
    return given if isinstance(given, str | Path) else ArrayFrames(frames.signal, name)


def _both_sets(
    experiment: SetToCompare, simulation: SetToCompare
) -> tuple[ComparedFrames, ComparedFrames]:
    """The sets, read again: a result holds numbers, not films."""
    return load_frame_set(experiment), load_frame_set(simulation)


def _draw(
    load: Callable[[], tuple[ComparedFrames, ComparedFrames]], metrics: list[FrameMetrics]
) -> Figure:
    return side_by_side(*load(), metrics)


def _table(metrics: list[FrameMetrics]) -> dict[str, list[Any]]:
    """Columns with units in their names; empty where a number cannot be had."""
    columns = {
        "order_rms_fringe": ("orders", "rms"),
        "order_p95_fringe": ("orders", "p95"),
        "order_bias_fringe": ("orders", "bias"),
        "wrong_branch_share": ("orders", "wrong_branch_share"),
        "compared_share": ("orders", "compared_share"),
        "skeleton_distance_px": ("skeleton", "mean_px"),
        "skeleton_distance_mm": ("skeleton", "mean_mm"),
        "skeleton_matched_share": ("skeleton", "matched_share"),
        "ncc": ("signals", "ncc"),
        "rmse": ("signals", "rmse"),
        "rmse_over_noise": ("signals", "rmse_over_noise"),
        "ssim": ("signals", "ssim"),
    }
    table: dict[str, list[Any]] = {
        "frame": [m.frame for m in metrics],
        "label": [m.label for m in metrics],
    }
    for name, (part, number) in columns.items():
        table[name] = [getattr(getattr(m, part), number, None) for m in metrics]
    return table
