"""Optics: the stress-optic law, the Jones polariscope, its light, and the camera."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
