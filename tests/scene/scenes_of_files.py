"""The paper's scene with its friction and load from elsewhere."""

from pathlib import Path
from typing import Any

import numpy as np

from isochrome.scene import Scene, dump_scene, load_scene, parse_scene

PAPER = dump_scene(load_scene("line-contact-wear"))


def file_scene(
    folder: Path,
    *,
    friction: str = "coefficient = 0.25",
    load: str = "normal_n = 44.0",
    more: str = "",
) -> Scene:
    """The paper's scene with other lines for friction and load, its files in a folder."""
    text = PAPER.replace("coefficient = 0.25", friction).replace("normal_n = 44.0", load)
    return parse_scene(text + more, folder=folder)


def write_table(path: Path, **columns: Any) -> None:
    """A plain CSV file of these columns."""
    np.savetxt(
        path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns),
        comments="", fmt="%.9g",
    )  # fmt: skip
