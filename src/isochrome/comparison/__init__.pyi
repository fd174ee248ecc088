from .api import MAIN_METRICS, Comparison, compare, compared_again
from .figure import plot_side_by_side, side_by_side
from .frame_folders import load_frame_set
from .frame_sets import (
    ComparedFrames,
    FrameMetrics,
    OrderMetrics,
    SignalMetrics,
    SkeletonDistance,
    compare_frames,
    compare_orders,
    compare_signals,
    skeleton_distance,
)
from .scar_comparison import ScarComparison, compare_scars
from .scars import ScarPair, SimulatedScar, pair_scar, simulated_scars

__all__ = [
    "MAIN_METRICS",
    "ComparedFrames",
    "Comparison",
    "FrameMetrics",
    "OrderMetrics",
    "ScarComparison",
    "ScarPair",
    "SignalMetrics",
    "SimulatedScar",
    "SkeletonDistance",
    "compare",
    "compare_frames",
    "compare_orders",
    "compare_scars",
    "compare_signals",
    "compared_again",
    "load_frame_set",
    "pair_scar",
    "plot_side_by_side",
    "side_by_side",
    "simulated_scars",
    "skeleton_distance",
]
