"""Isochrome: photoelastic image analysis with a simulation back-end.

Every command is one function of the same name here. They are imported when first used, so that
`import isochrome` costs nothing.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

__version__ = "0.1.0"

_HOMES = {
    "bench": "isochrome.bench",
    "calibrate_bending": "isochrome.calibrate",
    "calibrate_disc": "isochrome.calibrate",
    "check_frames": "isochrome.frames",
    "compare": "isochrome.compare.run",
    "demo": "isochrome.demo",
    "export": "isochrome.runs.export",
    "fit": "isochrome.fit.run",
    "load_scene": "isochrome.scene",
    "open_frames": "isochrome.frames",
    "open_run": "isochrome.runs",
    "process": "isochrome.process.run",
    "process_campaign": "isochrome.campaign",
    "simulate": "isochrome.simulate.run",
    "sweep": "isochrome.sweep.run",
    "write_into_scene": "isochrome.calibrate",
}

__all__ = [*_HOMES, "__version__"]


def __getattr__(name: str) -> Any:
    """Import a public function when it is first asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module 'isochrome' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)


class _Command(ModuleType):
    """A module of this package that is called as the command of its name."""

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        """Run the command."""
        name = self.__name__.rpartition(".")[2]
        return getattr(import_module(_HOMES[name]), name)(*arguments, **options)


class _Package(ModuleType):
    """This package: importing `isochrome.process` puts a module where the function was found."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name in _HOMES and isinstance(value, ModuleType):
            value.__class__ = _Command
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
