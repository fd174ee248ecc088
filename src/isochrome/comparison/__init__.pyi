from .api import MAIN_METRICS, Comparison, compare, compared_again
from .figure import plot_side_by_side, side_by_side
from .frame_folders import load_frame_set
from .frame_sets import ComparedFrames, FrameMetrics, compare_frames
from .line_distance import SkeletonDistance, skeleton_distance
from .metrics import OrderMetrics, SignalMetrics, compare_orders, compare_signals
from .scar_comparison import ScarComparison, compare_scars
from .scar_metrics import ScarPair, pair_scar
from .simulated_scars import SimulatedScar, simulated_scars

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
