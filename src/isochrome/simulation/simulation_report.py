"""What the report of a simulation says, from the files that it left."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.output import counted, numbers, read_csv
from isochrome.reporting import (
    FRINGES,
    GREY_LEVELS,
    Curve,
    Pane,
    ReportContent,
    ReportFrame,
    ReportTable,
    choose_frames,
    make_curve,
    paper_rows,
)
from isochrome.scene import Scene, dump_scene
from isochrome.simulation.state_chunk import FRAMES, ORDER
from isochrome.simulation.state_rows import HISTORY, PICTURE
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
    few = ", chosen for the reason that stands beside each" if len(frames) < count else ""
    return ReportContent(
        command="simulate",
        title=f"Simulation of {scene.name}: {counted(count, 'state')}",
        verdict=_verdict(history),
        frames=frames,
        choice=f"{len(frames)} of {counted(count, 'rendered state')} are shown{few}.",
        curves=list(_curves(history)),
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


def _curves(history: Mapping[str, list[Any]]) -> Iterator[Curve]:
    """The quantities over the distance, or over the states where nothing slides."""
    distance, across = numbers(history["distance_m"]), "sliding distance (m)"
    if not np.isfinite(distance).all() or np.ptp(distance) == 0.0:
        distance, across = np.arange(len(distance), dtype=float), "state"
    for name, unit, values in _known(history):
        if np.isfinite(values).sum() > 1:
            yield make_curve(f"{name} ({unit})", across, distance, values)


def _frames(folder: Path, scene: Scene, history: Mapping[str, Sequence[Any]]) -> list[ReportFrame]:
    """The states that are shown: all of a few, else those that stand out and some between."""
    pixels, steps = pixel_grid(scene), max(1, len(scene.polariscope.step))
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
    found = []
    for one, image in zip(chosen, images, strict=True):
        order = np.array(orders[one.number])
        found.append(
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
    return found


def _stack(path: Path, shape: tuple[int, ...]) -> Array:
    """A stack on disk, of which only what is asked for is read. Raises OSError, ValueError."""
    import tifffile

    with tifffile.TiffFile(path) as file:  # mapped, or through a temporary file where it cannot be
        return np.asarray(file.series[0].asarray(out="memmap")).reshape(shape)
