"""The specimens, one a module: what the rest of the program asks of each, by one interface.

A new one is a module of its shape's name with a `MODEL` here, and its `Body` in `scene.parts`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
