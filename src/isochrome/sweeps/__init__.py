"""Grids of simulations: a scene with some of its values varied, into one labelled dataset."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
