"""Captured frames in, fringe orders out: readers, fits and readings composed."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
