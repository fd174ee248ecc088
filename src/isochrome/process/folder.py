"""What `process` leaves on disk: maps and lines frame by frame, then tables and a figure."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.fringes.residual import Residual
from isochrome.fringes.skeleton import Skeleton, skeleton_table
from isochrome.output import (
    TableWriter,
    TiffWriter,
    provenance,
    staged,
    write_csv,
    write_figure,
    write_json,
    write_text,
    write_tiff,
)
from isochrome.output.roi import write_rois
from isochrome.process.figure import process_figure
from isochrome.process.processed import Processed, collect
from isochrome.process.result import ProcessedFrame
from isochrome.scene import Scene, dump_scene

_SHOWN = 6


@dataclass(frozen=True)
class _Seen:
    """What stays of the frames: `rows` of frames.csv, `shown` in the figure, `lines` by frame."""

    rows: list[dict[str, Any]]
    shown: list[ProcessedFrame]
    lines: list[tuple[int, Skeleton]]


def write_folder(
    done: Iterable[ProcessedFrame],
    scene: Scene,
    out: Path,
    inputs: str | Path,
    shape: tuple[int, int],
    *,
    residual: Residual | None = None,
    rois: bool = False,
) -> Processed:
    """Stream the maps and lines to disk; keep the numbers, and the first frames for the figure.

    Parameters: `done`, the frames as they come; `scene`; `out`, the folder; `inputs`, the captured
    files; `shape` (rows, cols); `residual`, what was taken out of the frames; `rois`, whether the
    fringe lines are wanted as ImageJ ROIs too. Returns Processed. Raises InputError where the
    folder cannot be written.
    """
    with staged(out) as folder:
        seen = _stream(done, scene, folder, rois=rois)
        result = collect(scene, seen.rows, None, shape, residual)
        write_csv(folder / "frames.csv", result.table)
        if rois:
            frames = [frame for frame, _ in seen.lines]
            write_rois(folder / "skeleton.zip", [line for _, line in seen.lines], frames=frames)
        if residual is not None:
            pixel = scene.camera.pixel_mm if scene.camera else None
            for name in ("order", "isoclinic"):
                values = getattr(residual, name)[None]
                write_tiff(folder / f"residual_{name}.tif", values, pixel_mm=pixel)
        if result.fitted is not None:
            write_text(folder / "fitted_scene.toml", dump_scene(result.fitted))
        text = dump_scene(scene)
        write_text(folder / "scene.toml", text)
        write_json(folder / "provenance.json", provenance(text, _files(scene, inputs)))
        write_figure(folder / "process.png", process_figure(scene, seen.shown))
    return result


def _stream(done: Iterable[ProcessedFrame], scene: Scene, folder: Path, *, rois: bool) -> _Seen:
    """Write each frame's maps and lines as it comes."""
    seen = _Seen([], [], [])
    with contextlib.ExitStack() as stack:
        writers: dict[str, TiffWriter] = {}
        table: TableWriter | None = None
        for item in done:
            maps = item.maps()
            if not writers:
                pixel = item.pixel_mm or (scene.camera.pixel_mm if scene.camera else None)
                writers = {
                    name: stack.enter_context(TiffWriter(folder / f"{name}.tif", pixel_mm=pixel))
                    for name in maps
                }
            for name, values in maps.items():
                writers[name].append(values)
            # where a model was fitted, its frames can be drawn anew: lines are for who asks
            lines = item.skeleton() if rois or item.fit is None else []
            if lines:
                table = table or stack.enter_context(TableWriter(folder / "skeleton.csv"))
                table.append(_columns(item, lines, scene))
                seen.lines.extend((item.index, line) for line in lines if rois)
            seen.rows.append(item.row())
            if len(seen.shown) < _SHOWN:
                seen.shown.append(item)
    return seen


def _files(scene: Scene, inputs: str | Path) -> list[Path]:
    """The captured files and the no-load frames, for their hashes."""
    frames = scene.frames
    named = (frames.no_load_dark, frames.no_load_bright, frames.no_load_steps, frames.mask)
    return [Path(inputs)] + [scene.path(name) for name in named if name is not None]


def _columns(item: ProcessedFrame, lines: list[Skeleton], scene: Scene) -> dict[str, Any]:
    """A frame's part of skeleton.csv."""
    left, top = item.corner_mm(scene)
    table = skeleton_table(lines, pixel_mm=item.pixel_mm, left_mm=left, top_mm=top)
    return {"frame": np.full(len(table["line"]), item.index), **table}
