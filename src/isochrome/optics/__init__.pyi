from .camera import expose, stored_type
from .polariscope import Chain, make_chain, polariscope_signal
from .response import Response, camera_response
from .spectral import highest_visible, spectral_signal
from .stress_optic import fringe_order
from .visibility import mean_order, pixel_visibility, slope_visibility
from .wavelengths import Light, make_light

__all__ = [
    "Chain",
    "Light",
    "Response",
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
