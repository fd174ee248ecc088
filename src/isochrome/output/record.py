"""Figures, and the record of what a result came from."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from isochrome.errors import InputError
from isochrome.output.files import replacing
from isochrome.output.result import FIGURE_DPI

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_figure(path: str | Path, figure: Figure, *, dpi: float = FIGURE_DPI) -> None:
    """Write a matplotlib Figure as PNG by the Agg back-end, without pyplot and its state.

    Letters of a file's name that the font does not have are drawn as boxes.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with replacing(path) as beside, warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph .* missing from font")
        FigureCanvasAgg(figure).print_figure(beside, format="png", dpi=dpi)


class Digested(Protocol):
    """What is read in place of a file, and knows the hash of its content."""

    def digest(self) -> str:
        """Its SHA-256 as hexadecimal text."""


InputContent = str | Path | Digested
"""A file, a folder, or what is read in place of one."""


def provenance(
    scene_toml: str | None, inputs: Iterable[InputContent] = (), seed: int | None = None
) -> dict[str, Any]:
    """Record what a result came from: version, resolved scene, hashes of the inputs, seed.

    A folder among the inputs stands for the files in it.
    """
    from importlib.metadata import PackageNotFoundError, version

    try:
        number = version("isochrome")
    except PackageNotFoundError:  # run from a source tree
        number = "unknown"
    hashes: dict[str, str] = {}
    for place in inputs:
        if not isinstance(place, str | Path):
            hashes[f"{place} ({len(hashes) + 1})"] = place.digest()
            continue
        path = Path(place)
        files = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]
        hashes |= {str(file): sha256(file) for file in files}
    return {"isochrome": number, "scene": scene_toml, "inputs_sha256": hashes, "seed": seed}


def sha256(path: str | Path) -> str:
    """The SHA-256 of a file as hexadecimal text."""
    try:
        if Path(path).exists() and not Path(path).is_file():  # a pipe would never end
            raise InputError("not_file_name_file", path=path)
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError("cannot_read_check_name_2", path=path, error=error.strerror) from error
