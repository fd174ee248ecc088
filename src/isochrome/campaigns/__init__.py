"""Many recordings by one scene: each a run of `process` in its own folder, and a table of all."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
