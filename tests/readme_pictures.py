"""Make the README's pictures from the sample images: `python tests/readme_pictures.py`."""

from __future__ import annotations

import tempfile
from pathlib import Path

import tifffile
from PIL import Image

import isochrome
from isochrome.comparison import load_frame_set, side_by_side
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
        compared = isochrome.compare(folder / "experiment", folder / "simulation")
        sets = (load_frame_set(folder / name) for name in ("experiment", "simulation"))
        figure = side_by_side(*sets, compared.metrics, max_rows=STATES)
        write_figure(folder / "side-by-side.png", figure)
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
            "side-by-side": folder / "side-by-side.png",
            "process": folder / "process.png",
            "simulation": folder / "simulation" / "simulation.png",
            "calibration": folder / "calibration.png",
        }.items():
            _shrink(source, PICTURES / f"{name}.png")


def _shrink(source: Path, target: Path) -> None:
    """A picture of WIDTH_PX and 256 colours, rare ones too: a repository keeps every version."""
    with Image.open(source) as picture:
        height = round(picture.height * WIDTH_PX / picture.width)
        small = picture.convert("RGB").resize((WIDTH_PX, height), Image.Resampling.LANCZOS)
    few = small.quantize(256, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    few.save(target, optimize=True)


if __name__ == "__main__":
    main()
