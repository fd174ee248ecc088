"""The contact: surface operators, the pressure solver, and wear over sliding distance."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
