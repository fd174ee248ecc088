"""Unknowns from intensities: separable least squares, its bases and its starts."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
