"""A local page on which a scene is set up on its frames: places, values, fits, checks."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
