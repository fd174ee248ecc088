"""The files that `process` makes when all frames are done: tables, figure, dataset, scene."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.fringes.residual import Residual
from isochrome.output import replacing, write_csv, write_figure, write_text, write_tiff
from isochrome.process.chunk import (
    ISOCLINIC,
    LINES,
    NORMALISED,
    ORDER,
    ROIS,
    joined_rois,
    joined_tables,
    lines_of,
)
from isochrome.process.dataset import write_columns
from isochrome.process.figure import Shown, process_figure
from isochrome.process.processed import (
    PICTURE,
    Processed,
    add_row,
    collect,
    refuse_unread,
    warnings_last,
)
from isochrome.process.recipe import Recipe
from isochrome.process.track_figure import tracked_figure
from isochrome.runs import STORE, Bench, Job
from isochrome.runs.chunks import parts, picture, rows
from isochrome.scene import dump_scene

_SHOWN, _KEY_FRAMES = 6, 3
_TRACKED_DPI = 110.0
"""Of a picture as wide as a screen."""


def finish_folder(
    bench: Bench,
    job: Job,
    recipe: Recipe,
    shape: tuple[int, int],
    residual: Residual | None = None,
) -> Processed:
    """Make the files that need all frames, from what is kept of their chunks.

    Parameters: `bench`, where the run's chunks lie; `job`; `recipe`; `shape` (rows, cols);
    `residual`, what was taken out of the frames. Returns Processed. Raises InputError, OSError, and
    PhysicsError where nothing could be read in any frame.
    """
    folder, scene = bench.results, recipe.scene
    found: dict[str, Any] = {}
    more: dict[str, Any] = {}
    for number, (row, rest) in enumerate(rows(bench)):
        add_row(found, number, row)
        add_row(more, number, rest)
    table = warnings_last(found)
    refuse_unread(scene, str(recipe.reader.path), table, more["kept"])
    result = collect(scene, table, more["status"], None, shape, residual)
    write_csv(folder / "frames.csv", table)
    _join_lines(bench, recipe)
    if residual is not None:
        pixel = scene.camera.pixel_mm if scene.camera else None
        for name in ("order", "isoclinic"):
            values = getattr(residual, name)[None]
            write_tiff(folder / f"residual_{name}.tif", values, pixel_mm=pixel)
    if result.fitted is not None:
        write_text(folder / "fitted_scene.toml", dump_scene(result.fitted))
    write_text(folder / "scene.toml", dump_scene(scene))
    write_columns(folder / STORE, scene, table, more, shape, job.identity)
    if recipe.every is None:
        figure = process_figure(scene, _shown(bench, table, more))
        write_figure(folder / "process.png", figure)
    else:
        figure = tracked_figure(scene, table, _shown(bench, table, more))
        write_figure(folder / "process.png", figure, dpi=_TRACKED_DPI)
    return result


def _join_lines(bench: Bench, recipe: Recipe) -> None:
    """skeleton.csv where a line was found, and skeleton.zip where it was asked for."""
    if next(parts(bench, LINES), None) is not None:
        with replacing(bench.results / LINES) as beside, open(beside, "wb") as file:
            joined_tables(parts(bench, LINES), file.write)
    if recipe.rois:
        with (
            replacing(bench.results / ROIS) as beside,
            zipfile.ZipFile(beside, "w") as archive,
        ):
            joined_rois(parts(bench, ROIS), archive)


def _shown(bench: Bench, table: dict[str, list[Any]], more: dict[str, list[Any]]) -> list[Shown]:
    """The first frames in which something was found, or some key frames, as they are drawn."""
    status = more["status"]
    good = [k for k, state in enumerate(status) if state != "failed"][:_SHOWN] or [0]
    if PICTURE in table:
        good = _spread([k for k, at in enumerate(table[PICTURE]) if at is not None], status)
    tables = (
        Path(file).read_bytes()
        for index in sorted({k // bench.layout.chunk for k in good})
        if (file := bench.part_file(LINES, index)).is_file()
    )
    lines = {k: own for text in tables for k, own in lines_of(text, set(good)).items()}
    names = {layer.name for layer in bench.layout.layers}

    def read(layer: str, item: int) -> np.ndarray | None:
        there = layer in names and more["read"][item]
        return picture(bench, layer, item) if there else None

    return [
        Shown(
            label=f"frame {k}, {table['label'][k]}" if PICTURE in table else str(table["label"][k]),
            chi=float(table["chi"][k]),
            kept=more["kept"][k] if more["kept"][k] is not None else float("nan"),
            normalised=picture(bench, NORMALISED.name, k),
            order=read(ORDER.name, k),
            isoclinic=read(ISOCLINIC.name, k),
            lines=lines.get(k, []),
            pixel_mm=table["pixel_mm"][k],
            left_mm=more["left_mm"][k],
            top_mm=more["top_mm"][k],
        )
        for k in good
    ]


def _spread(whole: list[int], status: list[str]) -> list[int]:
    """A few of the key frames, from the first to the last."""
    good = [k for k in whole if status[k] != "failed"] or whole[:1]
    places = np.linspace(0, len(good) - 1, min(_KEY_FRAMES, len(good)))
    return [good[round(place)] for place in places]
