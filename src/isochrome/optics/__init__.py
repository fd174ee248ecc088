"""Optics: the stress-optic law, the Jones polariscope, and the camera."""

from isochrome.optics.camera import expose
from isochrome.optics.polariscope import Chain, make_chain, polariscope_signal
from isochrome.optics.stress_optic import fringe_order

__all__ = ["Chain", "expose", "fringe_order", "make_chain", "polariscope_signal"]
