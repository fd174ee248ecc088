"""Make the README's pictures from the sample images: `python tests/readme_pictures.py`."""

import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import tifffile
from PIL import Image

import isochrome
from isochrome.output import write_figure

ROOT = Path(__file__).parents[1]
PICTURES = ROOT / ".readme"
SAMPLES = ROOT / "sample_images"
WIDTH_PX = 900
STATES = 3
"""Of six, in the pictures of experiment and order."""


def main() -> None:
    """Process, simulate, compare and calibrate the sample images, as the README says."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        contact = SAMPLES / "line-contact-wear"
        isochrome.process(contact / "captured.tif", contact / "scene.toml", folder / "experiment")
        isochrome.simulate(folder / "experiment" / "fitted_scene.toml", folder / "simulation")
        subprocess.run(_command_of_the_top_picture(), cwd=folder, check=True)
        shutil.copyfile(folder / "comparison" / "figure_174mm.png", PICTURES / "side-by-side.png")
        bending = isochrome.calibrate_bending(SAMPLES / "bending" / "set.toml")
        write_figure(folder / "calibration.png", bending.figure())
        first = folder / "first.tif"
        stack = tifffile.imread(contact / "captured.tif")
        tifffile.imwrite(first, stack[:STATES], photometric="minisblack")
        scene = isochrome.load_scene(contact / "scene.toml")
        distances = scene.get("wear.distances_m")[: STATES - 1]
        few = isochrome.process(first, scene.with_values({"wear.distances_m": distances}))
        write_figure(folder / "process.png", few.figure())
        for name, source in {
            "process": folder / "process.png",
            "simulation": folder / "simulation" / "simulation.png",
            "calibration": folder / "calibration.png",
        }.items():
            _shrink(source, PICTURES / f"{name}.png")


def _command_of_the_top_picture() -> list[str]:
    """The one command that makes it, as the README says it."""
    text = (ROOT / "README.md").read_text("utf-8")
    found = re.search(r"^isochrome (compare .*--width.*)$", text, re.M)
    assert found is not None
    return [sys.executable, "-m", "isochrome", *shlex.split(found.group(1))]


def _shrink(source: Path, target: Path) -> None:
    """A picture of WIDTH_PX and 256 colours, rare ones too: a repository keeps every version."""
    with Image.open(source) as picture:
        height = round(picture.height * WIDTH_PX / picture.width)
        small = picture.convert("RGB").resize((WIDTH_PX, height), Image.Resampling.LANCZOS)
    few = small.quantize(256, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    few.save(target, optimize=True)


if __name__ == "__main__":
    main()
