"""The sample images that ship with Isochrome: all rendered, as README.md among them says."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
