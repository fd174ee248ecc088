"""Frames among those to be processed that show the unloaded specimen.

Two signs are looked at, on means over blocks of pixels: a frame is nearly the scene's no-load
picture, or its light hardly swings where that of the frames beside it swings from fringe to fringe.
A load that begins or ends at nought goes through few fringes, and is no such frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.frames.linear import Linear
from isochrome.frames.no_load import load_no_load
from isochrome.frames.reading import Frame, FrameReader
from isochrome.scene import Scene

Array = NDArray[np.floating]

_BLOCKS = 64
"""Blocks along the shorter side of a frame."""

_SWINGS = (0.02, 0.05, 0.1, 0.2, 0.4)
"""Of full scale: how far light must go back for a swing. Which of them is asked is known when all
frames are: the largest up to a share of what their light spans,"""
_OF_SPAN = 0.3

_NONE, _MANY = 2, 6
"""Swings of a lamp's own slope, at most, and of three fringes."""

_USUAL, _FARTHEST = 95.0, 99.9
"""Per cent of the lines that have so many swings, and of the blocks that lie so near a picture: a
small contact at a low load lights few blocks."""

_ALIKE = 0.04
"""Of the light's span, by which a frame may differ from a no-load picture and be one."""

_GAINS = (0.8, 1.25)
"""Between which a lamp may have drifted from that picture."""

_LARGEST_RUN = 0.5
"""Share of a set beyond which frames without fringes are no mistake among others."""

UNLOADED = (
    "looks like the unloaded specimen: {}; take it out of the frames{} (of a film that begins "
    "without load set frames.starts_unloaded = true)"
)


@dataclass(kw_only=True)
class LoadSigns:
    """What of each frame says whether its specimen is loaded.

    `pictures`, the no-load frames by key as block means of their light; `span`, of that light, 0
    where it is not known; for each frame `unlike`, how far it is from each picture, and `swings`,
    the most and the usual number of swings along its lines, for each of the heights that are asked.
    """

    pictures: dict[str, Array] = field(default_factory=dict)
    span: float = 0.0
    unlike: list[dict[str, float]] = field(default_factory=list)
    swings: list[tuple[NDArray[np.int_], NDArray[np.int_]]] = field(default_factory=list)

    def add(self, frame: Frame, full: float, gamma: float) -> None:
        """Look at one frame. Parameters: `frame`; `full` scale, grey levels; the `gamma`."""
        blocks = _blocks(frame.image, frame.mask) / full
        light = np.sign(blocks) * np.abs(blocks) ** gamma
        self.unlike.append({key: _unlike(light, own) for key, own in self.pictures.items()})
        lines = [_swings(blocks), _swings(blocks.T)]
        most = np.max([one.max(axis=0, initial=0) for one in lines], axis=0)
        usual = [np.percentile(one, _USUAL, axis=0) for one in lines if len(one)]
        self.swings.append((most, np.max(usual, axis=0).astype(int) if usual else most))


def load_signs(reader: FrameReader, scene: Scene) -> LoadSigns | None:
    """Begin to look for unloaded frames.

    Parameters: `reader`; `scene`. Returns None where the scene says that the load changes, or that
    some frames have none, and for phase steps and colours.
    """
    frames, load = scene.frames, scene.load
    changes = load is not None and not isinstance(load.normal_n, int | float)
    light = scene.polariscope
    if frames.starts_unloaded or changes or frames.known_loads_n:
        return None
    if light.step or light.several_wavelengths:
        return None
    try:
        dark, bright = load_no_load(scene, full_shape=reader.full_shape)
    except InputError:  # has a finding of its own
        dark = bright = None
    found = LoadSigns()
    for key, one in (("no_load_dark", dark), ("no_load_bright", bright)):
        if one is not None:
            found.pictures[f"frames.{key}"] = _of_light(one, frames.first_gamma)
    if bright is not None:
        found.span = float(np.percentile(bright.image[bright.valid], 98.0))
    return found


def unloaded_frames(
    signs: LoadSigns, low: Sequence[float], high: Sequence[float], full: float, gamma: float
) -> tuple[dict[str, list[int]], list[int]]:
    """Tell which frames look unloaded.

    Parameters: `signs` of all frames; their `low` and `high` levels, NaN where blank; `full` scale;
    the scene's `gamma`. Returns the frames' numbers by the no-load picture that they are like, and
    those without fringes among others with many.
    """
    span = np.array(high) - np.array(low)
    if not np.isfinite(span).any():
        return {}, []
    light = signs.span or float((max(np.nanmax(high), 0.0) / full) ** gamma)
    like: dict[str, list[int]] = {}
    for index, far in enumerate(signs.unlike):
        near = [key for key, value in far.items() if value < _ALIKE * light]
        if near:
            like.setdefault(min(near, key=lambda key: far[key]), []).append(index)
    heights = np.array(_SWINGS) * full
    asked = np.flatnonzero(heights <= _OF_SPAN * np.nanmax(span))
    if not asked.size:
        return like, []
    most, usual = (np.array([pair[k][asked[-1]] for pair in signs.swings]) for k in (0, 1))
    named = {index for found in like.values() for index in found}
    alone = _among_many(most <= _NONE, usual >= _MANY)
    return like, [index for index in alone if index not in named]


def _among_many(none: NDArray[np.bool_], many: NDArray[np.bool_]) -> list[int]:
    """Runs of frames without fringes that have frames of many on both sides; at an end of the set,
    two of them on the other."""
    found: list[int] = []
    ends = np.flatnonzero(np.diff(np.concatenate([[False], none, [False]]).astype(int)))
    for start, stop in ends.reshape(-1, 2).tolist():
        before, after = many[:start][-2:], many[stop:][:2]
        sides = [before[-1:], after[:1]] if start and stop < len(none) else [before, after]
        beside = np.concatenate(sides)
        if beside.size == 2 and beside.all() and stop - start <= _LARGEST_RUN * len(none):
            found += range(start, stop)
    return found


def _blocks(image: NDArray[Any], mask: NDArray[np.bool_] | None) -> Array:
    """Means over blocks of pixels, NaN where a block is not the specimen's or holds no number."""
    by = max(1, min(image.shape) // _BLOCKS)
    values = image.astype(np.float32)
    if mask is not None:
        values = np.where(mask, values, np.nan)
    rows, cols = (n // by for n in values.shape)
    cut = values[: rows * by, : cols * by]
    return np.asarray(cut.reshape(rows, by, cols, by).mean(axis=(1, 3)))


def _of_light(picture: Linear, gamma: float) -> Array:
    """A no-load frame's light as that of frames: by the means of its levels, edges included."""
    levels = _blocks(np.maximum(picture.image, 0.0) ** (1.0 / gamma), picture.valid)
    return np.asarray(levels**gamma)


def _unlike(light: Array, picture: Array) -> float:
    """How far a frame's light is from a picture whose lamp may have drifted; inf where unknown."""
    known = np.isfinite(light) & np.isfinite(picture)
    if light.shape != picture.shape or not known.any():
        return float("inf")
    here, there = light[known], picture[known]
    gain = float(np.clip(np.median(here) / max(float(np.median(there)), 1e-9), *_GAINS))
    return float(np.percentile(np.abs(here - gain * there), _FARTHEST))


def _swings(lines: Array) -> NDArray[np.int_]:
    """How often the light of each line turns by more than each height (lines, heights)."""
    height = np.array(_SWINGS)[None, :]
    shape = len(lines), len(_SWINGS)
    high, low = np.full(shape, -np.inf), np.full(shape, np.inf)
    way, count = np.zeros(shape, dtype=int), np.zeros(shape, dtype=int)
    for values in lines.T:
        here = values[:, None]
        seen = np.isfinite(here)
        high, low = np.fmax(high, here), np.fmin(low, here)
        falls = seen & (way >= 0) & (high - here > height)
        rises = seen & (way <= 0) & (here - low > height) & ~falls
        count += falls | rises
        way = np.where(falls, -1, np.where(rises, 1, way))
        low, high = np.where(falls, here, low), np.where(rises, here, high)
    return count
