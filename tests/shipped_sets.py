"""The calibration sets that come with the package, with some of their images only."""

import shutil
from pathlib import Path

from isochrome.samples import samples_path


def some_of_a_shipped_set(folder: Path, specimen: str, keep: tuple[int, ...]) -> Path:
    """Copy a specimen's set to a folder, with the images of some numbers; its file there."""
    shutil.copytree(samples_path() / specimen, folder / specimen)
    path = folder / specimen / "set.toml"
    head, *images = path.read_text("utf-8").split("[[image]]")
    tail = images[-1][images[-1].index("[uncertainty]") :]
    images[-1] = images[-1].replace(tail, "")
    path.write_text(head + "".join(f"[[image]]{images[k]}" for k in keep) + tail, "utf-8")
    return path
