"""Experiment against simulation: fringe-aware numbers and the side-by-side figure."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
