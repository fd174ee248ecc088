"""Several frames fitted together: unknowns that they share, and unknowns of each."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import PhysicsError
from isochrome.fit.frame_data import FrameData
from isochrome.fit.frame_fit import placed, thinning
from isochrome.fit.intensity import UNDETERMINED
from isochrome.fit.linear import scaled_inverse
from isochrome.fit.normal import Normal, add_up, clear_region, make_renderer
from isochrome.fit.one_state import with_own_numerics
from isochrome.fit.sequence import Sequence, Unknown
from isochrome.fit.unknowns import bounds, fit_region
from isochrome.scene import DistanceTable, Scene

Array = NDArray[Any]
Told = Callable[[], None]

_COARSE_PIXELS = 30_000
_ITERATIONS = 20
_EDGE_PX = 2.0
"""Depth above which no pixel is fitted. The contrast that a pixel's area leaves is told from its
neighbours; above 1.5 pixels one of them leaves the material as the place moves, and chi jumps."""
_LOOSE, _TIGHT = 0.3, 0.03
"""Last predicted step, in standard uncertainties, of the thinned frames and of the whole ones."""
_UNSOUND = 1e-6
"""Share of a misfit beyond the noise that the approximate derivatives do not resolve."""
_ALIKE = 1e-6
"""Relative difference of two costs that is none: they are sums in single precision."""


def _nobody() -> None:
    """Nobody wants to know."""


@dataclass(frozen=True)
class JointFit:
    """Fitted unknowns of a `sequence`.

    `values`, `standard_uncertainty`, `cramer_rao_bound` (p,); `covariance` (p, p); `information`
    (p, p), J^T J over the noise variance; `chi`, residual over noise over all frames, `frame_chi`
    of each; `cost`, the sum of squares, and its `freedom`; `scene`, with tables over distance;
    `scenes`, of each frame; `converged`; `lost`, frames whose illumination came out negative. The
    matrices are None where nothing ties the frames together.
    """

    sequence: Sequence
    values: Array
    standard_uncertainty: Array
    cramer_rao_bound: Array
    covariance: Array | None
    information: Array | None
    chi: float
    frame_chi: tuple[float, ...]
    cost: float
    freedom: int
    scene: Scene
    scenes: tuple[Scene, ...]
    converged: bool
    lost: tuple[int, ...]

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The unknowns, in the order of the values."""
        return self.sequence.unknowns


def fit_together(
    frames: Iterable[FrameData],
    sequence: Sequence,
    start: Array,
    *,
    shape: tuple[int, int],
    told: Told = _nobody,
) -> JointFit:
    """Least squares over the intensities of all frames, first thinned, then on every pixel.

    Parameters: `frames`, gone through once a pass; `sequence`; `start` (p,), in the right basin;
    `shape` (rows, cols) of a frame; `told`, called with each frame of each pass. Returns a
    JointFit. Raises PhysicsError where the start cannot be solved or a key changes nothing.
    """
    problem = Together(frames, sequence, start, shape, told)
    values, _, _ = problem.solve(start, problem.coarse_stride, _LOOSE)
    problem.keep_clear(values)
    values, normal, converged = problem.solve(values, 1, _TIGHT)
    return problem.result(values, normal, converged)


class Together:
    """One least-squares problem over a set of frames, at any stride."""

    def __init__(
        self,
        frames: Iterable[FrameData],
        sequence: Sequence,
        start: Array,
        shape: tuple[int, int],
        told: Told,
    ) -> None:
        fine = with_own_numerics(sequence.whole(start), room=1.3)
        self.told, self.frames = told, frames
        self.sequence = replace(
            sequence, scene=sequence.scene.model_copy(update={"numerics": fine.numerics})
        )
        self.numerics = sequence.scene.numerics
        self.shape = shape
        self.coarse_stride = thinning(self.shape[0] * self.shape[1], _COARSE_PIXELS)
        whole = self.sequence.whole(start)
        self.first = [
            placed(self.sequence.frame(whole, start, i), self.shape) for i in range(sequence.count)
        ]
        self._clear: list[Array] = []
        limits = [self._bounds(unknown) for unknown in sequence.unknowns]
        self.low, self.high = (np.array(side) for side in zip(*limits, strict=True))

    def solve(self, values: Array, stride: int, tolerance: float) -> tuple[Array, Normal, bool]:
        """Levenberg-Marquardt with Nielsen's damping; steps are cut at the bounds."""
        renderer = make_renderer(self.sequence, self.first[0], self.shape, stride)

        def at(where: Array) -> Normal | None:
            return add_up(
                (data.every(stride) for data in self.frames), self.sequence, where,
                renderer=renderer, told=lambda _: self.told(),
                regions=lambda i: self._region(i, stride),
            )  # fmt: skip

        normal = at(values)
        if normal is None:
            raise PhysicsError(
                "the scene cannot be solved where the frames' own fits end; give closer values"
            )
        damping, growth = 1e-6, 2.0
        for _ in range(_ITERATIONS):
            step = self._step(values, normal, damping)
            gain = float(step @ (2.0 * normal.gradient - normal.matrix @ step))
            beyond = max(0.0, normal.cost - normal.freedom)
            if gain < tolerance**2 * max(1.0, normal.cost / normal.freedom) + _UNSOUND * beyond:
                return values + step, normal, True
            trial = at(values + step)
            if trial is not None and trial.cost <= normal.cost * (1.0 + _ALIKE):
                ratio = (normal.cost - trial.cost) / gain
                values, normal = values + step, trial
                damping, growth = damping * max(1e-2, 1.0 - (2.0 * ratio - 1.0) ** 3), 2.0
            else:
                damping, growth = max(damping, 1e-4) * growth, growth * 2.0
        return values, normal, False

    def keep_clear(self, values: Array) -> None:
        """Leave out the pixels whose model at some values is near black or white, see `tone`."""
        renderer = make_renderer(self.sequence, self.first[0], self.shape, 1)
        whole, found = self.sequence.whole(values), []
        for i, data in enumerate(self.frames):
            here, region = self.sequence.frame(whole, values, i), self._region(i, 1)
            clear = clear_region(data, here, renderer=renderer, region=region)
            found.append(np.packbits(clear))
            self.told()
        self._clear = found

    def _region(self, index: int, stride: int) -> Array:
        """The pixels of a frame that are fitted."""
        if stride == 1 and self._clear:
            bits = np.unpackbits(self._clear[index], count=self.shape[0] * self.shape[1])
            return bits.reshape(self.shape).astype(bool)
        return fit_region(self.first[index], self.shape, stride, _EDGE_PX)

    def result(self, values: Array, normal: Normal, converged: bool) -> JointFit:
        """The fit's statistics, with the scene's own numerics back in it."""
        chi = float(np.sqrt(normal.cost / max(1, normal.freedom - values.size)))
        inverse = scaled_inverse(normal.matrix, 1e-14)
        bound = np.sqrt(np.maximum(np.diag(inverse), 0.0))
        bound[np.diag(normal.matrix) <= UNDETERMINED * normal.squares] = np.inf
        for unknown, limit in zip(self.sequence.unknowns, bound.tolist(), strict=True):
            if unknown.shared and not np.isfinite(limit):
                raise PhysicsError(
                    f"{unknown.key} does not change the fringes of these frames, so that they "
                    "cannot tell it; leave it out"
                )
        sequence = replace(
            self.sequence,
            scene=self.sequence.scene.model_copy(update={"numerics": self.numerics}),
        )
        whole = sequence.whole(values)
        scenes = tuple(
            placed(sequence.frame(whole, values, i), self.shape) for i in range(sequence.count)
        )
        covariance = inverse @ normal.middle @ inverse  # White's, as for one frame: see `polish`
        spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        return JointFit(
            sequence,
            values,
            np.where(np.isfinite(bound), spread, np.inf),
            bound,
            covariance,
            normal.matrix,
            chi,
            normal.chi,
            normal.cost,
            max(1, normal.freedom - values.size),
            whole,
            scenes,
            converged and bool(np.all(np.isfinite(bound))),
            tuple(i for i, good in enumerate(normal.positive) if not good),
        )

    def _step(self, values: Array, normal: Normal, damping: float) -> Array:
        """The damped step over the unknowns that are free to move, cut at the bounds."""
        pull = normal.gradient
        held = ((values <= self.low) & (pull < 0)) | ((values >= self.high) & (pull > 0))
        free = np.flatnonzero(~held)
        step = np.zeros_like(values)
        if free.size:
            matrix = normal.matrix[np.ix_(free, free)]
            matrix = matrix + damping * np.diag(np.diag(matrix))
            step[free] = scaled_inverse(matrix, 1e-14) @ pull[free]
        return np.clip(values + step, self.low, self.high) - values

    def _bounds(self, unknown: Unknown) -> tuple[float, float]:
        scene = self.first[unknown.frames[0]]
        value = scene.get(unknown.key)
        if isinstance(value, DistanceTable):
            scene = scene.with_values({unknown.key: value.value[0]})
        found = bounds(scene, (unknown.key,))
        return float(found["lower"][0]), float(found["upper"][0])
