"""Recordings of known fringes: videos, stacks and images in a folder with an awkward name."""

import numpy as np
import pytest

from isochrome.output import write_tiff

ROWS, COLS = 40, 56
SCENE = """\
[specimen]
thickness_mm = 4.0

[camera]
bit_depth = 8
pixel_mm = 0.05

[frames]
no_load_dark = "dark.tif"
no_load_bright = "bright.tif"
"""


def true_orders(count, seed):
    """The orders (frame, row, col) of a film: 0 in the left column, rising to the right."""
    col = np.arange(COLS) + np.zeros((ROWS, 1))
    return np.stack([2.2 * (col / COLS) ** 2 * (1 + 0.2 * np.sin(seed + i)) for i in range(count)])


def film(count, seed):
    """Its frames in a dark field, 20 grey levels in darkness and 220 in the light."""
    noise = np.random.default_rng(seed).normal(0, 1, (count, ROWS, COLS))
    light = np.sin(np.pi * true_orders(count, seed)) ** 2
    return np.rint(20 + 200 * light + noise).astype(np.uint8)


def write_no_load(folder):
    """Frames of the unloaded specimen in the dark and in the bright field."""
    rng = np.random.default_rng(7)
    for name, level in (("dark", 20), ("bright", 220)):
        flat = level + rng.normal(0, 1, (1, ROWS, COLS))
        write_tiff(folder / f"{name}.tif", np.rint(flat).astype(np.uint8))


@pytest.fixture
def no_pictures(monkeypatch):
    """Recordings without process.png, which takes most of the time of short ones."""
    from isochrome.figures import new_figure

    empty = lambda *_, **__: new_figure(0.1, 0.1)  # noqa: E731
    monkeypatch.setattr("isochrome.processing.api.set_figure", empty)


@pytest.fixture
def place(tmp_path, monkeypatch):
    """The working folder, with the scene and its no-load frames."""
    folder = tmp_path / "Mess reihe ÄΩ場"
    folder.mkdir()
    write_no_load(folder)
    (folder / "scene.toml").write_text(SCENE, "utf-8")
    (folder / "runs").mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def drawn_stacks(place):
    """Four TIFF stacks of 2, 3, 4 and 5 frames, runs/run1.tif to run4.tif."""
    names = [f"runs/run{i}.tif" for i in range(1, 5)]
    for i, name in enumerate(names, 1):
        write_tiff(place / name, film(i + 1, i))
    return names


@pytest.fixture
def stacks(drawn_stacks, no_pictures):
    """The same, of which this process leaves no pictures."""
    return drawn_stacks
