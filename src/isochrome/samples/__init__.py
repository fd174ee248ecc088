"""The sample images that ship with Isochrome, and the one command that renders all of them.

`python -m isochrome.samples OUT` writes the very files of the folder that `samples_path` names.
Every image is rendered, none was captured; README.md among them says so.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
