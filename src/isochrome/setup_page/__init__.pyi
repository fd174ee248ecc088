from .api import open_session, setup
from .edits import apply_tool, find_in_frames, page_words, session_state, without_model
from .server import MOST_BYTES, ClickPreview, SetupServer, fit_answer, order_map_of_points
from .session import (
    LiveModel,
    SetupSession,
    calibration_answer,
    on_line,
    pixel_scale,
    place_of_point,
    placed_at,
    seen_at,
    surface_roll,
)

__all__ = [
    "MOST_BYTES",
    "ClickPreview",
    "LiveModel",
    "SetupServer",
    "SetupSession",
    "apply_tool",
    "calibration_answer",
    "find_in_frames",
    "fit_answer",
    "on_line",
    "open_session",
    "order_map_of_points",
    "page_words",
    "pixel_scale",
    "place_of_point",
    "placed_at",
    "seen_at",
    "session_state",
    "setup",
    "surface_roll",
    "without_model",
]
