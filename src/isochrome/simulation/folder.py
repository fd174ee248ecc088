"""The files that a simulation leaves, put together from what is kept of its chunks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from isochrome.optics import stored_type
from isochrome.output import (
    csv_text,
    imagej_view,
    replacing,
    write_csv,
    write_figure,
    write_frames,
    write_text,
)
from isochrome.reporting import write_report
from isochrome.runs import CHUNK_BYTES, REPORT, RunFolder, RunLayout, chunk_size, parts, rows
from isochrome.scene import dump_scene
from isochrome.simulation.figure import simulation_figure
from isochrome.simulation.simulation_report import simulation_report
from isochrome.simulation.state_chunk import FRAMES, ORDER, PRESSURE, RenderWork
from isochrome.simulation.state_rows import HISTORY, PICTURE, PROFILE, add_state_row
from isochrome.simulation.stress_figure import stress_figure

_FEW = 8
"""States that make one chunk together: they are soon done again."""


def run_layout(work: RenderWork) -> RunLayout:
    """What a simulation keeps of its states: parts of files alone."""
    forms = [_form(work, name) for name in work.stacks]
    size = sum(int(np.prod(shape)) * dtype.itemsize for shape, dtype in forms)
    together = min(_FEW, CHUNK_BYTES // size)
    chunk = max(1, together, chunk_size(work.count, size))
    return RunLayout(axes={"state": work.count}, chunk=chunk, store=False, part_bytes=size)


def finish_simulation_folder(
    run: RunFolder, work: RenderWork, record: Mapping[str, Any]
) -> dict[str, list[Any]]:
    """Make the files from what is kept of the chunks, a chunk in memory at a time.

    Parameters: `run`, where they lie; `work`; `record`, what provenance.json will hold. Returns
    the columns of history.csv. Raises OSError.
    """
    folder, scene = run.results, work.scene
    history: dict[str, list[Any]] = {}
    for row, _ in rows(run):
        add_state_row(history, row)
    write_csv(folder / HISTORY, history)
    with replacing(folder / PRESSURE) as beside, open(beside, "wb") as file:
        file.write(csv_text(dict.fromkeys(PROFILE, ())).encode())
        file.writelines(parts(run, PRESSURE))
    for name in work.stacks:
        _join(run, work, name, history)
    write_text(folder / "scene.toml", dump_scene(scene))
    shown = work.figure_items()
    write_figure(folder / PICTURE, simulation_figure(scene, work.pixels, shown))
    if work.components:
        write_figure(folder / "stress.png", stress_figure(scene, work.pixels, shown))
    write_report(folder / REPORT, simulation_report(folder, scene, record))
    return history


def _join(run: RunFolder, work: RenderWork, name: str, history: dict[str, list[Any]]) -> None:
    """A stack from the chunks' parts of it."""
    (steps, *shape), dtype = _form(work, name)

    def frames() -> Iterator[np.ndarray]:
        for part in parts(run, name):
            yield from np.frombuffer(part, dtype).reshape(-1, *shape)

    write_frames(
        run.results / name,
        frames(),
        (work.count * steps, *shape),
        dtype,
        pixel_mm=work.pixels.pixel_mm,
        photometric="rgb" if len(shape) == 3 else "minisblack",
        metadata=_view(run, work, name, history),
    )


def _view(
    run: RunFolder, work: RenderWork, name: str, history: dict[str, list[Any]]
) -> dict[str, Any]:
    """What ImageJ is to know of a stack: labels, range, colours and origin."""
    (steps, *_), dtype = _form(work, name)
    pixels, camera = work.pixels, work.scene.camera
    assert camera is not None
    if name == FRAMES:
        span = (0.0, 1.0 if camera.bit_depth is None else 2.0**camera.bit_depth - 1.0)
    elif name == ORDER:
        span = (0.0, float(max(history["n_max"])))
    else:
        ends = [np.nanpercentile(np.frombuffer(p, dtype), (0.1, 99.9)) for p in parts(run, name)]
        span = (float(np.min(ends)), float(np.max(ends)))
    labels = [
        f"{label}, step {step}" if steps > 1 else str(label)
        for label in history["label"]
        for step in range(steps)
    ]
    return imagej_view(
        name, span, labels=labels, pixel_mm=pixels.pixel_mm, left_mm=pixels.left_mm,
        top_mm=pixels.top_mm,
    )  # fmt: skip


def _form(work: RenderWork, name: str) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape (steps, rows, cols[, 3]) and type of a state's part of a stack."""
    size, camera = (work.pixels.rows, work.pixels.cols), work.scene.camera
    assert camera is not None
    if name != FRAMES:
        return (1, *size), np.dtype("<f4")
    steps, colours = max(1, len(work.scene.polariscope.step)), (3,) if camera.colour else ()
    return (steps, *size, *colours), stored_type(camera.bit_depth).newbyteorder("<")
