"""Stress below the surface of a half-plane under tractions, and what a block's sides add."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
