from .edits import (
    apply_tool,
    find_in_frames,
    page_words,
    pixel_scale,
    placed_at,
    seen_at,
    session_state,
    surface_roll,
    without_model,
)
from .server import ClickPreview, SetupServer, fit_answer, open_session, order_map_of_points, setup
from .session import LiveModel, SetupSession, calibration_answer

__all__ = [
    "ClickPreview",
    "LiveModel",
    "SetupServer",
    "SetupSession",
    "apply_tool",
    "calibration_answer",
    "find_in_frames",
    "fit_answer",
    "open_session",
    "order_map_of_points",
    "page_words",
    "pixel_scale",
    "placed_at",
    "seen_at",
    "session_state",
    "setup",
    "surface_roll",
    "without_model",
]
