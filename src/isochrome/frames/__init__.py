"""Captured frames: reading them from any file, and turning grey levels into fringe signal.

Pixel coordinates are (row, col), colour is RGB; what OpenCV thinks of both stays inside.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
