from .api import MAIN_METRICS, Comparison, compare
from .figure import plot_side_by_side, side_by_side
from .frame_folders import load_frame_set
from .frame_sets import ComparedFrames, FrameMetrics, compare_frames
from .line_distance import SkeletonDistance, skeleton_distance
from .metrics import OrderMetrics, SignalMetrics, compare_orders, compare_signals

__all__ = [
    "MAIN_METRICS",
    "ComparedFrames",
    "Comparison",
    "FrameMetrics",
    "OrderMetrics",
    "SignalMetrics",
    "SkeletonDistance",
    "compare",
    "compare_frames",
    "compare_orders",
    "compare_signals",
    "load_frame_set",
    "plot_side_by_side",
    "side_by_side",
    "skeleton_distance",
]
