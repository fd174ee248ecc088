"""Experiment against simulation: fringe-aware numbers and the side-by-side figure."""

from isochrome.compare.figure import side_by_side
from isochrome.compare.frame_sets import FrameMetrics, FrameSet, compare_frames
from isochrome.compare.lines import SkeletonDistance, skeleton_distance
from isochrome.compare.load import load_frame_set
from isochrome.compare.metrics import (
    OrderMetrics,
    SignalMetrics,
    compare_orders,
    compare_signals,
)

__all__ = [
    "FrameMetrics",
    "FrameSet",
    "OrderMetrics",
    "SignalMetrics",
    "SkeletonDistance",
    "compare_frames",
    "compare_orders",
    "compare_signals",
    "load_frame_set",
    "side_by_side",
    "skeleton_distance",
]
