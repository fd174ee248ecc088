from .api import check_scene, process
from .checking import check
from .figure import plot_order
from .placement import placed_disc
from .processed import PICTURE, Processed, restore
from .result import SPREAD, ProcessedFrame
from .run_report import process_report

__all__ = [
    "PICTURE",
    "SPREAD",
    "Processed",
    "ProcessedFrame",
    "check",
    "check_scene",
    "placed_disc",
    "plot_order",
    "process",
    "process_report",
    "restore",
]
