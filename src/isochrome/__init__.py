"""Isochrome: photoelastic image analysis with a simulation back-end.

What a command does, a function here does too: `isochrome calibrate disc` is `calibrate_disc`, and
`process` of several recordings `process_campaign`. What `__init__.pyi` lists is imported when it
is first used, so that `import isochrome` costs nothing.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]
