from .api import check_scene, process
from .checking import check
from .one_frame import FrameResult, FrameValue, one_state, process_frame
from .pictures.figure import plot_order
from .placement import placed_disc
from .processed import Processed, restore
from .result import PICTURE, SPREAD, ProcessedFrame
from .run_report import process_report

__all__ = [
    "PICTURE",
    "SPREAD",
    "FrameResult",
    "FrameValue",
    "Processed",
    "ProcessedFrame",
    "check",
    "check_scene",
    "one_state",
    "placed_disc",
    "plot_order",
    "process",
    "process_frame",
    "process_report",
    "restore",
]
