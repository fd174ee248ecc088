from .api import check_scene, process
from .checking import check
from .frame_task import own_scene
from .kinds.with_model import placed_disc
from .one_frame import (
    AnchorPreview,
    FrameResult,
    FrameValue,
    PatchOrders,
    anchor_preview,
    part_change,
    process_frame,
)
from .pictures.figure import plot_order
from .processed import Processed, restore
from .result import PICTURE, SPREAD, ProcessedFrame
from .run_report import process_report

__all__ = [
    "PICTURE",
    "SPREAD",
    "AnchorPreview",
    "FrameResult",
    "FrameValue",
    "PatchOrders",
    "Processed",
    "ProcessedFrame",
    "anchor_preview",
    "check",
    "check_scene",
    "own_scene",
    "part_change",
    "placed_disc",
    "plot_order",
    "process",
    "process_frame",
    "process_report",
    "restore",
]
