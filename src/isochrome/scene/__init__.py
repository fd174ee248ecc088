"""The scene: what stood in front of the camera, as frozen parts that are read from TOML."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
