"""The sample images that ship with Isochrome, and the one command that renders all of them.

`python -m isochrome.samples OUT` writes the very files of the folder that `samples_path` names.
Every image is rendered, none was captured; README.md among them says so.
"""

from __future__ import annotations

from pathlib import Path

from isochrome.errors import InputError
from isochrome.samples.render import SEED, render_samples

__all__ = ["SEED", "render_samples", "samples_path"]

_NAME = "sample_images"


def samples_path() -> Path:
    """The folder of the shipped sample images.

    In an installed wheel they lie inside the package; of an editable install they are the
    repository's. Returns the folder. Raises InputError where neither is there.
    """
    here = Path(__file__).resolve()
    for folder in (here.parents[1] / _NAME, here.parents[3] / _NAME):
        if (folder / "README.md").is_file():
            return folder
    raise InputError(
        f"{here.parents[1] / _NAME}: the sample images are not there; install Isochrome again, or "
        "render them with 'python -m isochrome.samples OUT' and name that folder"
    )
