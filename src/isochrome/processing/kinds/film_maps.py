"""Maps of every frame of a followed video: whether they are written, and in which steps."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from isochrome.errors import InputError
from isochrome.fitting import placed, scene_at, sliding_scene
from isochrome.output import counted
from isochrome.processing.frame_task import FrameTask
from isochrome.scene import Scene
from isochrome.simulation import make_picture, scene_states, state_difference
from isochrome.stress import pixel_grid

MAPS = ("all", "key", "none")
"""What may be asked for."""

MOST_ON_DISK, MOST_KEPT = 20e9, 8e9
"""Bytes up to which maps of all frames are written, or kept in memory, without being asked for."""

MOST_PAGED = 1e9
"""Bytes of a TIFF stack up to which it has a page for every frame, uncompressed."""

_BYTES, _TYPICAL = 3, 1.2
"""Bytes a pixel of order and confidence before they are compressed, and after: measured with a
noise of 3 grey levels, see `runs.Compact`."""

FINEST_STEP = 1e-4
"""Fringes; the least order's uncertainty is ten times as much."""

_MARGIN = 2.0
"""Largest order that steps of 16 bits reach, over the scene's own: four times its load."""

_LARGEST_STEPS = 65534
_THIN = 4


def with_maps(
    task: FrameTask, maps: str | None, count: int, *, on_disk: bool
) -> tuple[FrameTask, str]:
    """Choose the maps of a followed video, and say what they take.

    Parameters: `task`; `maps`, as they were asked for, None where nobody has; `count` of frames;
    `on_disk`, whether they are written. Returns the recipe, and a sentence.
    """
    pixels = math.prod(task.reader.shape)
    most, each = (MOST_ON_DISK, _BYTES) if on_disk else (MOST_KEPT, 8)
    chosen = maps or ("all" if each * pixels * count <= most else "key")
    if chosen != "all":
        why = f"those of all {count} might take {each * pixels * count / 1e9:.3g} GB"
        said = {"key": "maps of the key frames", "none": "no maps"}[chosen]
        said += f"; {why}: --maps all writes them" if maps is None else ""
        return replace(task, maps=chosen), said
    step = order_step(task.scene, task.reader.shape)
    pages = on_disk and 4 * pixels * count <= MOST_PAGED
    task = replace(task, maps=chosen, order_step=step, pages=pages)
    space = (_TYPICAL if on_disk else each) * pixels
    said = (
        f"maps of {counted(count, 'frame')}: about {1e-6 * space:.2g} MB a frame, "
        f"{1e-9 * space * count:.3g} GB in all, orders in steps of {step:g} fringe"
    )
    if on_disk and not pages:
        said += "; the TIFF stacks hold the key frames: isochrome export --to tiff makes all pages"
    return task, said


def order_step(scene: Scene, shape: tuple[int, int]) -> float:
    """Steps (fringes) of 16 bits that reach twice the largest order that a contact's scene shows.

    Parameters: `scene`; `shape` (rows, cols) of a frame.
    """
    one = scene_at(placed(sliding_scene(scene), shape), 0.0)
    grid = pixel_grid(one, shape).every(_THIN)
    order = make_picture(one, state_difference(one, scene_states(one)[-1], grid), grid).order
    wanted = _MARGIN * float(np.nanmax(order)) / _LARGEST_STEPS
    return FINEST_STEP * max(1, math.ceil(wanted / FINEST_STEP))


def check_options(
    track: bool, each: bool, maps: str | None, preview: bool, out: str | Path | None
) -> None:
    """Refuse options that say two things, or nothing. Raises InputError."""
    if track and each:
        raise InputError("--track and --each: a set is followed, or each frame is alone; give one")
    if maps not in (None, *MAPS):
        raise InputError(f"--maps {maps}: give {', '.join(MAPS)}")
    if preview and out is None:
        raise InputError("preview: is written beside the results; give a folder for them (out)")


def refuse_unfollowed(every: int | None, maps: str | None) -> None:
    """Refuse what is said of key frames where each frame is alone. Raises InputError."""
    for name, value in (("every", every), ("maps", maps)):
        if value is not None:
            raise InputError(
                f"--{name} {value}: is for a video that is followed; add --track, or leave it out"
            )
