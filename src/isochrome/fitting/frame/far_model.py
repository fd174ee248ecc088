"""A frame's model that comes to rest from far: by what its slopes are right in, then as in
Student's t, with images of the field's changes that are kept while it moves.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from isochrome.estimation import STEP, LinearPart
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.frame_model import (
    FrameModel,
    LocalModel,
    RefinedFit,
    inward,
    local_model,
    refine_fit,
    trust_of_slopes,
    turned_row,
)
from isochrome.fitting.frame.renderer import FringeOptics, scene_optics
from isochrome.fitting.frame.unknowns import BLUR, SWING, moved_scene, scales

TOLERANCE = 0.5
"""Last step, in standard uncertainties."""
_NEARER_STEPS, FAR, STALLED = 3, 1.5, 0.8
"""Steps with one weight of the slopes; the residual's variance over the noise's below which none
is needed, and what must be left of it where they help."""
_PASSES = 12
"""Steps of a fit."""
_DEGREES = 5.0
"""Degrees of freedom of the noise's Student's t."""
_OPTICAL = ("polariscope.", "frames.", "specimen.fringe_value", "specimen.thickness", BLUR, SWING)
"""How keys begin that change more than the field, or something else."""
_AMPLITUDE = np.float32(0.03)
"""Change of an amplitude, in standard deviations of its prior."""
_SLIGHT = 3e-4
"""Fringes by which the field is changed for its slopes."""


def student_root(residual: Array) -> Array:
    """Root of the weights (n,) that residuals have in Student's t."""
    return np.asarray(np.sqrt((_DEGREES + 1.0) / (_DEGREES + np.square(residual))), np.float32)


def student_cost(residual: Array) -> float:
    """-2 ln of Student's t of the residuals, up to a constant."""
    return float(np.sum((_DEGREES + 1.0) * np.log1p(np.square(residual) / _DEGREES), dtype=float))


def by_field(
    optics: FringeOptics, field: Array, shown: Array, signal: Array, gain: Array
) -> tuple[Array, Array]:
    """Weighted derivatives (n,) by both parts of a stress difference, 1/MPa, about its `signal`."""
    step = np.float32(_SLIGHT / optics.order_per_mpa)
    along, across = (
        (optics.signal(field + step * turn, visibility=shown) - signal) * (gain / step)
        for turn in (np.complex64(1.0), np.complex64(1j))
    )
    return along, across


class FarModel(FrameModel):
    """A `FrameModel` on every few pixels or blocks, with amplitudes of fields behind its unknowns.
    `fields` (k, rows, cols), MPa; by default none. The `slight` last ones hardly move fringes by
    their standard deviations; of others a slope over a part of these leads farther.
    """

    fields: Array
    slight: int = 0

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.fields = np.empty((0, *self.pixels.keep.shape), np.complex64)
        self._root = np.ones(self.pixels.size, np.float32)
        self._numbers = [j for j, key in enumerate(self.keys) if not key.startswith(_OPTICAL)]
        self._stood: tuple[Array, Array, Array, Array] | None = None

    @property
    def count(self) -> int:
        """Number of amplitudes."""
        return len(self.fields)

    def signal(
        self, values: Array, *, visibility: Array | None = None, keys: tuple[str, ...] | None = None
    ) -> Array | None:
        """The signal at the pixels (n,), as of a `FrameModel`."""
        number = len(values) - self.count
        if self.count:
            amplitudes = np.asarray(values[number:], np.float32)
            self.renderer.added = np.tensordot(amplitudes, self.fields, 1)
        return super().signal(values[:number], visibility=visibility, keys=keys)

    def settled(self, values: Array, *, robust: bool = True) -> RefinedFit | None:
        """Where it comes to rest from `values` (p,), None where it makes no scene: first by what
        its slopes are right in, so that a start fringes off leads to no other minimum; then, if
        `robust`, with Student's t of what no noise explains: dust decides nothing.
        """
        every, cost = np.ones_like(self._root), np.inf
        while True:
            self._weigh(every)
            here = self.at(values)
            if here is None:
                return None
            if here.cost < FAR * every.size or here.cost > STALLED * cost:
                break
            cost, trust = here.cost, trust_of_slopes(here, self.renderer.stride)
            self._weigh(trust)
            nearer = refine_fit(self, values, tolerance=1.0, iterations=_NEARER_STEPS)
            if nearer is None:
                return None
            values = nearer.values
        if robust:
            self._weigh(student_root(here.residual))
        result = refine_fit(self, values, tolerance=TOLERANCE, iterations=_PASSES)
        if robust and result is not None:
            self._weigh(student_root(self.residual(result)))
            result = refine_fit(self, result.values, tolerance=TOLERANCE, iterations=_PASSES)
        return result

    def residual(self, result: RefinedFit) -> Array:
        """What a fit has left (n,), over the pixels' noise."""
        return np.asarray(result.gamma_fit.residual / self._root)

    def _weigh(self, root: Array) -> None:
        """Give each pixel the root of a weight (n,) besides its noise's."""
        own = self.pixels.weight / self._root
        self.pixels, self._root = replace(self.pixels, weight=own * root), root

    def linearise(self, values: Array, gamma_fit: LinearPart) -> LocalModel:
        """Derivatives at some values, where the linear solution is known."""
        number = len(self.keys)
        rows = np.empty((number + self.count, self.pixels.size), np.float32)
        here = moved_scene(self.scene, self.keys, values[:number])
        field, shown = self.renderer.order_field(here)
        field = np.nan_to_num(field)  # a lens may move a pixel off the specimen
        steps, turned = self._turned(values[:number], field)
        for j in set(range(number)) - set(self._numbers):
            rows[j] = self._slopes(self.keys, values, range(j, j + 1), gamma_fit)[0]
        optics, keep = scene_optics(here), self.pixels.keep
        field = self.renderer.whole(here, field)[keep]
        shown = np.broadcast_to(shown, keep.shape)[keep]
        last = self.count - self.slight
        turns = dict(zip(self._numbers, zip(turned, steps, strict=True), strict=True))
        turns |= enumerate(((f, _AMPLITUDE) for f in self.fields[:last]), number)
        for j, (turn, step) in turns.items():
            rows[j] = turned_row(optics, field, shown, turn[keep], step, gamma_fit)
        if self.slight:
            along, across = by_field(optics, field, shown, gamma_fit.signal, gamma_fit.amplitude)
            for row, turn in zip(rows[number + last :], self.fields[last:], strict=True):
                row[:] = along * turn.real[keep] + across * turn.imag[keep]
        names = (*self.keys, *(f"mode {k}" for k in range(self.count)))
        return local_model(names, values, gamma_fit, rows, self.prior)

    def _turned(self, values: Array, field: Array) -> tuple[Array, Array]:
        """How the field turns with each unknown that leaves the optics as they are (k, rows, cols),
        and small steps (k,) of these; what turns it changes little, and each new field tells of its
        change: Broyden (1965), Math. Comp. 19, 577.
        """
        if self._stood is None:
            steps = STEP * scales(self.scene, self.keys)[self._numbers]
            turns = np.empty((len(steps), *field.shape), np.complex64)
            for k, j in enumerate(self._numbers):
                steps[k] = inward(values[j], steps[k], self.limits.high[j])
                moved = values.copy()
                moved[j] += steps[k]
                there = self.renderer.field_alone(moved_scene(self.scene, self.keys, moved))
                turns[k] = (np.nan_to_num(there) - field) / np.float32(steps[k])
        else:
            before, field_before, steps, turns = self._stood
            moves = (values - before)[self._numbers]
            share = moves / steps**2 / max(float(np.square(moves / steps).sum()), 1e-300)
            untold = field - field_before - np.tensordot(moves.astype(np.float32), turns, 1)
            turns = turns + share.astype(np.float32)[:, None, None] * untold
        self._stood = values, field, steps, turns
        return steps.astype(np.float32), turns
