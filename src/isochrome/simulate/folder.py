"""The files that a simulation leaves, put together from what is kept of its chunks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.optics.camera import stored_type
from isochrome.output import (
    Photometric,
    csv_text,
    read_csv,
    replacing,
    write_csv,
    write_figure,
    write_text,
)
from isochrome.output.tiff import write_frames
from isochrome.runs import Bench, Layout, chunk_size
from isochrome.runs.chunks import parts, rows
from isochrome.runs.job import CHUNK_BYTES
from isochrome.scene import Scene, dump_scene
from isochrome.simulate.figure import simulation_figure
from isochrome.simulate.stress_figure import stress_figure
from isochrome.simulate.tables import PROFILE, add_row
from isochrome.simulate.work import FRAMES, PRESSURE, RenderWork

_FEW = 8
"""States that make one chunk together: they are soon done again."""


def layout_of(work: RenderWork) -> Layout:
    """What a simulation keeps of its states: parts of files alone."""
    size = sum(_bytes(work, name) for name in work.stacks)
    together = min(_FEW, CHUNK_BYTES // size)
    chunk = max(1, together, chunk_size(work.count, size))
    return Layout({"state": work.count}, {}, (), chunk, store=False, part_bytes=size)


def finish_folder(bench: Bench, work: RenderWork) -> dict[str, list[Any]]:
    """Make the files from what is kept of the chunks, a chunk in memory at a time.

    Parameters: `bench`, where they lie; `work`. Returns the columns of history.csv. Raises OSError.
    """
    folder, scene = bench.results, work.scene
    history: dict[str, list[Any]] = {}
    for row, _ in rows(bench):
        add_row(history, row)
    write_csv(folder / "history.csv", history)
    with replacing(folder / PRESSURE) as beside, open(beside, "wb") as file:
        file.write(csv_text(dict.fromkeys(PROFILE, ())).encode())
        file.writelines(parts(bench, PRESSURE))
    for name in work.stacks:
        _join(bench, work, name)
    write_text(folder / "scene.toml", dump_scene(scene))
    shown = work.figure_items()
    write_figure(folder / "simulation.png", simulation_figure(scene, work.pixels, shown))
    if work.components:
        write_figure(folder / "stress.png", stress_figure(scene, work.pixels, shown))
    return history


def read_history(out: Path) -> dict[str, list[Any]]:
    """The columns of history.csv that an earlier run left, with the table's nine digits."""
    return read_csv(out / "history.csv")


def _join(bench: Bench, work: RenderWork, name: str) -> None:
    """A stack from the chunks' parts of it."""
    shape, dtype = _form(work, name)
    size = int(np.prod(shape)) * dtype.itemsize

    def frames() -> Iterator[np.ndarray]:
        for part in parts(bench, name):
            for start in range(0, len(part), size):
                yield np.frombuffer(part[start : start + size], dtype).reshape(shape)

    photometric: Photometric = "rgb" if len(shape) == 3 else "minisblack"
    count = work.count * (_steps(work.scene) if name == FRAMES else 1)
    write_frames(
        bench.results / name,
        frames(),
        (count, *shape),
        dtype,
        pixel_mm=work.pixels.pixel_mm,
        photometric=photometric,
    )


def _form(work: RenderWork, name: str) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of one frame of a stack."""
    shape: tuple[int, ...] = (work.pixels.rows, work.pixels.cols)
    camera = work.scene.camera
    assert camera is not None
    if name != FRAMES:
        return shape, np.dtype("<f4")
    return (*shape, 3) if camera.colour else shape, stored_type(camera.bit_depth).newbyteorder("<")


def _bytes(work: RenderWork, name: str) -> int:
    """Bytes of a state's part of a stack."""
    shape, dtype = _form(work, name)
    frames = _steps(work.scene) if name == FRAMES else 1
    return frames * int(np.prod(shape)) * dtype.itemsize


def _steps(scene: Scene) -> int:
    return max(1, len(scene.polariscope.step))
