"""What a set's results depend on: its files, those that its scene names, and the scale."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from isochrome.errors import IsochromeError
from isochrome.fit.frame_data import prepare_frame
from isochrome.output import provenance
from isochrome.process.place import placed_disc
from isochrome.process.recipe import OpenSet, Recipe
from isochrome.process.result import Capture
from isochrome.runs import environment
from isochrome.scene import dump_scene


def identity_of(recipe: Recipe, files: Sequence[Path]) -> Mapping[str, Any]:
    """What a run on a set is a result of, as provenance.json keeps it.

    Parameters: `recipe`; `files`, see `frames.input_files`. Raises InputError where one is not
    readable.
    """
    scene = recipe.scene
    seed = scene.camera.seed if scene.camera else None
    record = provenance(dump_scene(scene), files, seed)
    tracked = {} if recipe.every is None else {"every": recipe.every}
    return record | environment() | {"options": {"rois": recipe.rois} | tracked}


def set_pixel(source: OpenSet) -> float | None:
    """The side of a pixel (mm) for the scale of the stacks; None where it is not known.

    A disc without camera.pixel_mm gives it by its rim, that of the first frame here.
    """
    scene, capture = source.recipe.scene, source.capture
    if scene.camera is not None and scene.camera.pixel_mm is not None:
        return scene.camera.pixel_mm
    fitted = scene.model == "disc" and not scene.polariscope.step
    if not fitted or not isinstance(capture, Capture):
        return None
    first = next(iter(source.reader))
    try:
        data = prepare_frame(
            first, scene, bit_depth=capture.bit_depth, no_load=(capture.dark, capture.bright)
        )
        placed, _ = placed_disc(scene, data)
    except IsochromeError:  # said where the frame itself is processed
        return None
    return placed.camera.pixel_mm if placed.camera else None
