"""The files that a simulation leaves, put together from what is kept of its chunks.

What the report of a simulation says, from the files that it left.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.optics import stored_type
from isochrome.output import (
    counted,
    csv_text,
    imagej_view,
    numbers,
    read_csv,
    replacing,
    write_csv,
    write_figure,
    write_frames,
    write_text,
)
from isochrome.reporting import (
    FRINGES,
    GREY_LEVELS,
    Pane,
    ReportContent,
    ReportFrame,
    ReportTable,
    choose_frames,
    make_curve,
    paper_rows,
    write_report,
)
from isochrome.runs import CHUNK_BYTES, REPORT, RunFolder, RunLayout, chunk_size, parts, rows
from isochrome.scene import Scene, dump_scene
from isochrome.simulation.figure import simulation_figure, stress_figure
from isochrome.simulation.rendering import (
    FRAMES,
    HISTORY,
    ORDER,
    PICTURE,
    PRESSURE,
    PROFILE,
    RenderWork,
    add_state_row,
)
from isochrome.stress import pixel_grid

Array = NDArray[Any]

_QUANTITIES = (
    ("p_max_mpa", "largest pressure", "MPa"),
    ("contact_width_mm", "contact width", "mm"),
    ("wear_depth_um", "wear depth", "µm"),
    ("worn_area_mm2", "worn area", "mm²"),
    ("n_max", "largest fringe order", "fringes"),
    ("shear_max_mpa", "largest shear stress", "MPa"),
)
"""Columns of history.csv that are drawn and said, their names and units."""

_NO_CAUSES = "A simulation asks no frames for anything: it is what the scene below makes."
_NO_BUDGET = (
    "A simulation has none: isochrome sweep shows what another number of the scene changes."
)


def simulation_report(folder: Path, scene: Scene, record: Mapping[str, Any]) -> ReportContent:
    """What the report of a simulation in a folder says; frames are read of the few that it shows.

    `record` is provenance.json. OSError, ValueError or KeyError where a file cannot be read.
    """
    history = read_csv(folder / HISTORY)
    count = len(history["state"])
    frames = _frames(folder, scene, history)
    distance, across = numbers(history["distance_m"]), "sliding distance (m)"
    if not np.isfinite(distance).all() or np.ptp(distance) == 0.0:  # nothing slides
        distance, across = np.arange(len(distance), dtype=float), "state"
    few = ", chosen for the reason that stands beside each" if len(frames) < count else ""
    return ReportContent(
        command="simulate",
        title=f"Simulation of {scene.name}: {counted(count, 'state')}",
        verdict=_verdict(history),
        frames=frames,
        choice=f"{len(frames)} of {counted(count, 'rendered state')} are shown{few}.",
        curves=[
            make_curve(f"{name} ({unit})", across, distance, values)
            for name, unit, values in _known(history)
            if np.isfinite(values).sum() > 1
        ],
        no_budget=_NO_BUDGET,
        tables=[ReportTable(f"The states ({HISTORY})", history)],
        causes_text=_NO_CAUSES,
        scene=dump_scene(scene),
        paper=paper_rows(scene, record),
        picture=(folder / PICTURE).read_bytes(),
    )


def _known(history: Mapping[str, list[Any]]) -> Iterator[tuple[str, str, Array]]:
    """Names, units and values of the quantities that the simulation has."""
    for column, name, unit in _QUANTITIES:
        values = numbers(history[column])
        if np.isfinite(values).any():
            yield name, unit, values


def _verdict(history: Mapping[str, list[Any]]) -> str:
    """The quantities at the first and the last state, in a sentence."""
    distance = numbers(history["distance_m"])
    parts = []
    for name, unit, values in _known(history):
        known = values[np.isfinite(values)]
        span = f"{known[0]:.4g}" if known[0] == known[-1] else f"{known[0]:.4g} to {known[-1]:.4g}"
        parts.append(f"{name} {span} {unit}")
    slid = distance[np.isfinite(distance)]
    where = f"From {slid[0]:g} to {slid[-1]:g} m of sliding: " if np.ptp(slid) > 0.0 else ""
    text = f"{where}{', '.join(parts)}."
    return f"{text[:1].upper()}{text[1:]}"


def _frames(folder: Path, scene: Scene, history: Mapping[str, Sequence[Any]]) -> list[ReportFrame]:
    """The states that are shown: all of a few, else those that stand out and some between."""
    pixels, steps = pixel_grid(scene), len(scene.polariscope.step_numbers)
    largest = numbers(history["n_max"])
    chosen = choose_frames(np.full(len(largest), np.nan), largest)
    size, camera = (pixels.rows, pixels.cols), scene.camera
    colours = (3,) if camera is not None and camera.colour else ()
    stored = _stack(folder / FRAMES, (len(largest) * steps, *size, *colours))
    orders = _stack(folder / ORDER, (len(largest), *size))
    images = [np.array(stored[one.number * steps], np.float32) for one in chosen]
    if colours:
        images = [image.mean(axis=2) for image in images]
    light = (0.0, max(float(image.max()) for image in images))
    span = (0.0, float(np.nanmax(largest)))
    notes = ["the first of its phase steps is shown"] if steps > 1 else []
    notes += ["the mean of its three colours is shown"] if colours else []
    frames = []
    for one, image in zip(chosen, images, strict=True):
        order = np.array(orders[one.number])
        frames.append(
            ReportFrame(
                number=one.number,
                label=str(history["label"][one.number]),
                why=one.why,
                panes=(
                    Pane("rendered", "rendered frame", image, light, GREY_LEVELS),
                    Pane("order", "fringe order N", order, span, FRINGES),
                ),
                order=order,
                pixel_mm=pixels.pixel_mm,
                left_mm=pixels.left_mm,
                top_mm=pixels.top_mm,
                notes=tuple(notes),
            )
        )
    return frames


def _stack(path: Path, shape: tuple[int, ...]) -> Array:
    """A stack on disk, of which only what is asked for is read. Raises OSError, ValueError."""
    import tifffile

    with tifffile.TiffFile(path) as file:  # mapped, or through a temporary file where it cannot be
        return np.asarray(file.series[0].asarray(out="memmap")).reshape(shape)


_FEW = 8
"""States that make one chunk together: they are soon done again."""


def run_layout(work: RenderWork) -> RunLayout:
    """What a simulation keeps of its states: parts of files alone."""
    forms = [_form(work, name) for name in work.stacks]
    size = sum(int(np.prod(shape)) * dtype.itemsize for shape, dtype in forms)
    chunk = max(1, min(_FEW, CHUNK_BYTES // size), chunk_size(work.count, size))
    return RunLayout(axes={"state": work.count}, chunk=chunk, store=False, part_bytes=size)


def finish_simulation_folder(
    run: RunFolder, work: RenderWork, record: Mapping[str, Any]
) -> dict[str, list[Any]]:
    """Make the files from what is kept of the chunks, a chunk in memory at a time."""
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
    steps, colours = len(work.scene.polariscope.step_numbers), (3,) if camera.colour else ()
    return (steps, *size, *colours), stored_type(camera.bit_depth).newbyteorder("<")
