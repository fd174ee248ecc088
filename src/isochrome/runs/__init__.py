"""Long runs: chunk by chunk, kept as they go, by one process or many; results in one store. Heavy
libraries are imported inside the functions that need them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
