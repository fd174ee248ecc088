"""What the report of two compared sets of frames says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from isochrome.comparison.figure import grey_range, pair_images, place_of_pair
from isochrome.comparison.frame_sets import ComparedFrames, FrameMetrics, frame_pairs
from isochrome.figures import centred_limit
from isochrome.output import counted, over_items
from isochrome.reporting import (
    FRINGES,
    SIGNAL,
    Pane,
    ReportContent,
    ReportFrame,
    ReportTable,
    choose_frames,
    paper_rows,
)
from isochrome.scene import Scene, dump_scene

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
