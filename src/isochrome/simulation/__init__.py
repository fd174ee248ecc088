"""The simulation: contact, wear, stress, optics and camera composed, from scene to frames."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
