"""Optics: the stress-optic law, the Jones polariscope, its light, and the camera."""

from isochrome.optics.camera import expose
from isochrome.optics.light import Light, make_light
from isochrome.optics.polariscope import Chain, make_chain, polariscope_signal
from isochrome.optics.response import Response, camera_response
from isochrome.optics.spectral import highest_visible, spectral_signal
from isochrome.optics.stress_optic import fringe_order
from isochrome.optics.visibility import pixel_visibility, slope_visibility

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
    "pixel_visibility",
    "polariscope_signal",
    "slope_visibility",
    "spectral_signal",
]
