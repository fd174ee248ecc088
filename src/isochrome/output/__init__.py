"""Results on disk, whole or not at all: every file is written beside its place under a hidden name
and renamed when it is complete. Heavy libraries are imported inside the functions that need
them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
