"""`compare`: the metrics and the side-by-side figure of any two sets of frames."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from isochrome.compare.figure import side_by_side
from isochrome.compare.frame_sets import FrameMetrics, compare_frames
from isochrome.compare.load import load_frame_set
from isochrome.output import provenance, staged, write_csv, write_figure, write_json


@dataclass(frozen=True)
class Comparison:
    """Every number for each pair of frames: `metrics`, and `table`, the columns of metrics.csv."""

    metrics: list[FrameMetrics]
    table: dict[str, list[Any]]


def compare(
    experiment: str | Path, simulation: str | Path, out: str | Path | None = None
) -> Comparison:
    """Compare two sets of frames: what `process` and `simulate` left, or bare frames.

    Parameters: `experiment`, `simulation`, result folders, TIFF stacks, image folders or videos,
    on one pixel grid; `out`, a folder for metrics.csv, provenance.json and comparison.png.
    Returns a Comparison. Raises InputError where the sets do not fit together.
    """
    here, there = load_frame_set(experiment), load_frame_set(simulation)
    metrics = compare_frames(here, there)
    result = Comparison(metrics, _table(metrics))
    if out is not None:
        with staged(out) as folder:
            write_csv(folder / "metrics.csv", result.table)
            write_json(
                folder / "provenance.json", provenance(None, [Path(experiment), Path(simulation)])
            )
            write_figure(folder / "comparison.png", side_by_side(here, there, metrics))
    return result


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
    parts = [
        {name: asdict(part) if (part := getattr(m, name)) else {} for name in
         ("orders", "skeleton", "signals")}
        for m in metrics
    ]  # fmt: skip
    for name, (part, field) in columns.items():
        table[name] = [each[part].get(field) for each in parts]
    return table
