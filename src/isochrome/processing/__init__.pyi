from .api import check_scene, process
from .figure import Shown, plot_order, process_report, set_figure
from .frame_task import own_scene
from .kinds.image_only import says_a_half
from .kinds.kind import kind_of
from .kinds.tracked import FINEST_STEP, TrackedFilm, order_step
from .kinds.with_model import placed_disc
from .one_frame import (
    AnchorPreview,
    FrameResult,
    FrameValue,
    PatchOrders,
    anchor_preview,
    check,
    part_change,
    process_frame,
)
from .processed import (
    Processed,
    collect,
    restore,
    tabulate_set,
    with_past_friction,
    with_past_loads,
    with_scatter_of_gamma,
)
from .result import FOUND_BY, PICTURE, SPREAD, ProcessedFrame, cell_values, corner_of, row_of_set

__all__ = [
    "FINEST_STEP",
    "FOUND_BY",
    "PICTURE",
    "SPREAD",
    "AnchorPreview",
    "FrameResult",
    "FrameValue",
    "PatchOrders",
    "Processed",
    "ProcessedFrame",
    "Shown",
    "TrackedFilm",
    "anchor_preview",
    "cell_values",
    "check",
    "check_scene",
    "collect",
    "corner_of",
    "kind_of",
    "order_step",
    "own_scene",
    "part_change",
    "placed_disc",
    "plot_order",
    "process",
    "process_frame",
    "process_report",
    "restore",
    "row_of_set",
    "says_a_half",
    "set_figure",
    "tabulate_set",
    "with_past_friction",
    "with_past_loads",
    "with_scatter_of_gamma",
]
