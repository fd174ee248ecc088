from .camera import GENERIC_PEAK_NM, Response, blurred, camera_response, expose, stored_type
from .polariscope import (
    Chain,
    Light,
    fringe_order,
    highest_visible,
    make_chain,
    make_light,
    mean_order,
    pixel_visibility,
    polariscope_signal,
    slope_visibility,
    spectral_signal,
)

__all__ = [
    "GENERIC_PEAK_NM",
    "Chain",
    "Light",
    "Response",
    "blurred",
    "camera_response",
    "expose",
    "fringe_order",
    "highest_visible",
    "make_chain",
    "make_light",
    "mean_order",
    "pixel_visibility",
    "polariscope_signal",
    "slope_visibility",
    "spectral_signal",
    "stored_type",
]
