from .api import MAIN_METRICS, Comparison, compare, compared_again, plot_side_by_side, side_by_side
from .frame_sets import (
    ComparedFrames,
    FrameMetrics,
    compare_frames,
    compare_orders,
    compare_signals,
    load_frame_set,
    skeleton_distance,
)
from .scar_comparison import (
    ScarComparison,
    ScarPair,
    SimulatedScar,
    compare_scars,
    pair_scar,
    simulated_scars,
)

__all__ = [
    "MAIN_METRICS",
    "ComparedFrames",
    "Comparison",
    "FrameMetrics",
    "ScarComparison",
    "ScarPair",
    "SimulatedScar",
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
