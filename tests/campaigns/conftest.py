"""Recordings of known fringes: videos, stacks and images in a folder with an awkward name."""

from fractions import Fraction

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


def film(count, seed):
    """Frames (frame, row, col) of a dark field whose orders rise to the right, to about 2."""
    rng = np.random.default_rng(seed)
    col = np.arange(COLS) + np.zeros((ROWS, 1))
    orders = [2.2 * (col / COLS) ** 2 * (1 + 0.2 * np.sin(seed + i)) for i in range(count)]
    frames = (
        20 + 200 * np.sin(np.pi * np.array(orders)) ** 2 + rng.normal(0, 1, (count, ROWS, COLS))
    )
    return np.rint(frames).astype(np.uint8)


def write_video(path, frames):
    """Frames without loss, ten a second."""
    import av

    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=10)
        stream.height, stream.width = frames.shape[1:]
        stream.pix_fmt, stream.codec_context.time_base = "gray", Fraction(1, 10)
        for i, image in enumerate(frames):
            frame = av.VideoFrame(image.shape[1], image.shape[0], "gray")
            rows = np.zeros((image.shape[0], frame.planes[0].line_size), np.uint8)
            rows[:, : image.shape[1]] = image
            frame.planes[0].update(rows.tobytes())
            frame.pts, frame.time_base = i, Fraction(1, 10)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


@pytest.fixture
def no_pictures(monkeypatch):
    """Recordings without process.png, which takes most of the time of short ones."""
    from isochrome.figures import new_figure

    empty = lambda *_, **__: new_figure(0.1, 0.1)  # noqa: E731
    monkeypatch.setattr("isochrome.processing.pictures.figure.process_figure", empty)


@pytest.fixture
def place(tmp_path, monkeypatch):
    """The working folder, with the scene and its no-load frames."""
    folder = tmp_path / "Mess reihe ÄΩ場"
    folder.mkdir()
    rng = np.random.default_rng(7)
    for name, level in (("dark", 20), ("bright", 220)):
        flat = level + rng.normal(0, 1, (1, ROWS, COLS))
        write_tiff(folder / f"{name}.tif", np.rint(flat).astype(np.uint8))
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
