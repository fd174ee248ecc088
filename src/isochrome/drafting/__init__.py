"""Scenes from frames: what the picture and the user tell, written down with what stays open."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
