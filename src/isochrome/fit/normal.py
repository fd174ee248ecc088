"""The normal equations of many frames, added up frame by frame: memory holds one of them.

The linear parts of different frames have nothing in common, so that each frame's are eliminated
on their own, and what is left, J^T J and J^T r, adds up. A frame of a run shows load, friction and
worn area; it is rendered once more for each of these, and the chain rule through `local_values`
carries them to whatever unknowns the course is made of.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.frame_data import FrameData
from isochrome.fit.history import SharedRun, local_values
from isochrome.fit.intensity import STEP
from isochrome.fit.local import ENOUGH, project
from isochrome.fit.polish import block_correlation
from isochrome.fit.renderer import SceneRenderer, safe_signal
from isochrome.fit.sequence import COURSE, WEAR, Sequence
from isochrome.fit.tone import clear_of_ends, gamma_slope, solve_toned, trusted_pixels
from isochrome.fit.unknowns import scales
from isochrome.scene import DistanceTable, Scene

Array = NDArray[Any]


@dataclass(frozen=True)
class Normal:
    """Sums over frames at one set of values: `matrix` J^T J (p, p) and `gradient` J^T r (p,).

    `middle` (p, p), the sum of r² j j^T over the pixels, widened by the residuals' correlation;
    `squares` (p,), of the rows before the linear parts were eliminated; `cost`, sum of squared
    residuals over noise; `freedom`, pixels less linear unknowns; `positive` (frames,), False where
    a frame's illumination came out negative; `chi` (frames,), of each frame.
    """

    matrix: Array
    middle: Array
    gradient: Array
    squares: Array
    cost: float
    freedom: int
    positive: tuple[bool, ...]
    chi: tuple[float, ...]


@dataclass(frozen=True)
class Linearised:
    """One frame along its directions: sums as in `Normal`, in units of the directions' steps."""

    matrix: Array
    middle: Array
    gradient: Array
    squares: Array
    cost: float
    freedom: int
    positive: bool


def add_up(
    frames: Iterable[FrameData],
    sequence: Sequence,
    values: Array,
    *,
    renderer: SceneRenderer,
    regions: Callable[[int], Array],
    told: Callable[[int], None],
) -> Normal | None:
    """The normal equations of all frames at `values` (p,); None where they cannot be solved.

    Parameters: `frames`, as thin as the renderer; `sequence`; `renderer`, with the stride and the
    shared run; `regions`, the pixels to use of a frame; `told`, called with each frame done.
    """
    whole = sequence.whole(values)
    maps = DirectionMaps(sequence, values)
    size = len(sequence.unknowns)
    matrix, middle = np.zeros((size, size)), np.zeros((size, size))
    gradient, squares = np.zeros(size), np.zeros(size)
    cost, freedom, positive, chi = 0.0, 0, [], []
    for i, data in enumerate(frames):
        here = sequence.frame(whole, values, i)
        moved = [maps.scene(key, i, whole) for key in maps.keys(i)]
        part = linearise(data, here, moved, renderer=renderer, region=regions(i))
        if part is None:
            return None
        columns = maps.columns(i)
        matrix += columns.T @ part.matrix @ columns
        middle += columns.T @ part.middle @ columns
        gradient += columns.T @ part.gradient
        squares += np.einsum("ij,ik,kj->j", columns, part.squares, columns)
        cost, freedom = cost + part.cost, freedom + part.freedom
        positive.append(part.positive)
        chi.append(float(np.sqrt(part.cost / max(1, part.freedom))))
        told(i)
    return Normal(matrix, middle, gradient, squares, cost, freedom, tuple(positive), tuple(chi))


def linearise(
    data: FrameData, here: Scene, moved: list[Scene], *, renderer: SceneRenderer, region: Array
) -> Linearised | None:
    """One frame's residual and its normal equations along `moved` scenes less the one `here`.

    Returns None where a scene cannot be solved. Source: see `isochrome.fit.intensity`.
    """
    gamma = here.frames.stated_gamma
    free = [scene.frames.stated_gamma - gamma for scene in moved]
    pixels = trusted_pixels(data.toned(gamma) if any(free) else data, region)
    signal = safe_signal(renderer, here)[pixels.keep].astype(np.float32)
    toned = solve_toned(pixels, signal, gamma)
    if toned is None:
        return None
    rows = np.empty((len(moved), pixels.size), np.float32)
    for row, scene, change in zip(rows, moved, free, strict=True):
        if change:
            row[:] = gamma_slope(toned, gamma) * np.float32(change)
        else:
            np.subtract(safe_signal(renderer, scene)[pixels.keep], signal, out=row)
            row *= toned.part.amplitude
    if not np.isfinite(rows.sum()):
        return None
    squares = rows @ rows.T
    project(rows, toned.problem, toned.part)
    weighted = rows * toned.residual
    wider = max(1.0, block_correlation(pixels.keep, toned.residual))
    return Linearised(
        (rows @ rows.T).astype(float),
        wider * (weighted @ weighted.T).astype(float),
        (rows @ toned.residual).astype(float),
        squares.astype(float),
        toned.cost,
        pixels.size - len(toned.part.coefficients),
        toned.part.positive,
    )


def clear_region(data: FrameData, here: Scene, *, renderer: SceneRenderer, region: Array) -> Array:
    """A frame's region without the pixels whose model is near black or white, where noise is cut.

    Parameters: `data`; `here`, its scene; `renderer`; `region` (rows, cols). Returns (rows, cols).
    """
    gamma = here.frames.stated_gamma
    pixels = trusted_pixels(data, region)
    toned = solve_toned(pixels, safe_signal(renderer, here)[pixels.keep], gamma)
    if toned is None:
        return region
    clear = clear_of_ends(pixels, toned.model, gamma)
    if np.count_nonzero(clear) <= ENOUGH * clear.size:
        return region
    found = region.copy()
    found[pixels.keep] = clear
    return found


class DirectionMaps:
    """Directions in which each frame is rendered once more, and what they say of the unknowns.

    A direction is a key moved by one step, over all distances where it is part of the course.
    """

    def __init__(self, sequence: Sequence, values: Array) -> None:
        self.sequence, self.values = sequence, values
        self.whole = sequence.whole(values)
        self.course = [
            key
            for key in COURSE
            if sequence.in_course(key) and key in {u.key for u in sequence.unknowns}
        ]
        self._steps = {u.key: self._step(u.key) for u in sequence.unknowns}
        if self.course:
            self._steps.setdefault(WEAR, self._step(WEAR))
            self._local = local_values(self.whole, sequence.distances_m)
            self._moved = {
                key: moved(self.whole, key, self._steps[key])
                for key in dict.fromkeys((*self.course, WEAR))
            }
            self._along = {
                key: local_values(there, sequence.distances_m) - self._local
                for key, there in self._moved.items()
            }
            self._by_unknown = self._differences()

    def keys(self, index: int) -> list[str]:
        """The directions of a frame."""
        plain = [k for k in self.sequence.acting(index) if k not in self.course]
        if not self.course:
            return plain
        _, friction, worn = (self._local[index] != 0.0).tolist()
        sliding = self.sequence.distances_m[index] is not None
        shown = {COURSE[0]: True, COURSE[1]: sliding or friction, COURSE[2]: worn}
        return plain + [k for k in COURSE if shown[k] and (k in self.course or k == WEAR)]

    def scene(self, key: str, index: int, whole: Scene) -> Scene:
        """A frame's scene moved by one step along a key."""
        if key in self.course or (self.course and key == WEAR):
            return self.sequence.frame(self._moved[key], self.values, index)
        here = self.sequence.frame(whole, self.values, index)
        return moved(here, key, self._steps[key])

    def columns(self, index: int) -> Array:
        """Steps along each direction that one unit of each unknown makes, (directions, p)."""
        keys = self.keys(index)
        found = np.zeros((len(keys), len(self.sequence.unknowns)))
        for column, unknown in enumerate(self.sequence.unknowns):
            if index in unknown.frames and unknown.key in keys and unknown.key not in self.course:
                found[keys.index(unknown.key), column] = 1.0 / self._steps[unknown.key]
        inside = [k for k in keys if self.course and k in COURSE]
        if inside:
            which = [COURSE.index(k) for k in inside]
            square = np.array([self._along[k][index, which] for k in inside]).T
            rows = [keys.index(k) for k in inside]
            found[rows] += np.linalg.solve(square, self._by_unknown[:, index, which].T)
        return found

    def _step(self, key: str) -> float:
        """A difference step, of the scale of the key's (first) value."""
        value = self.whole.get(key)
        number = value.value[0] if isinstance(value, DistanceTable) else value
        return STEP * float(scales(self.whole.with_values({key: number}), (key,))[0])

    def _differences(self) -> Array:
        """Change of the local values by one unit of each unknown, (p, frames, 3)."""
        found = np.zeros((len(self.sequence.unknowns), *self._local.shape))
        for row, unknown in zip(range(len(found)), self.sequence.unknowns, strict=True):
            if unknown.key in self.course:
                ahead = self.values.copy()
                ahead[row] += self._steps[unknown.key]
                there = local_values(self.sequence.whole(ahead), self.sequence.distances_m)
                found[row] = (there - self._local) / self._steps[unknown.key]
        return found


def moved(scene: Scene, key: str, step: float) -> Scene:
    """A scene with a key moved by a step, over all distances where it is a table."""
    value = scene.get(key)
    if isinstance(value, DistanceTable):
        return scene.with_values(
            {key: {"distance_m": value.distance_m, "value": [v + step for v in value.value]}}
        )
    return scene.with_values({key: value + step})


def make_renderer(sequence: Sequence, whole: Scene, shape: tuple[int, int], stride: int) -> Any:
    """A renderer of all frames of a sequence, which solves a run once for all of them."""
    return SceneRenderer(whole, shape, stride=stride, solve=SharedRun(sequence.distances_m))
