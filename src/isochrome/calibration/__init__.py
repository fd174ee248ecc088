"""The material fringe value from a beam or a disc, colour tables, and the scale of a camera."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
