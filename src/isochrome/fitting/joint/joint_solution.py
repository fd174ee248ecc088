"""A joint fit that is asked for causes: what belongs to the apparatus is common to all frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.fitting.arrays import Array
from isochrome.fitting.causes.blocks import BLOCK, FrameBlocks
from isochrome.fitting.causes.score import LightTerms
from isochrome.fitting.causes.solution import (
    RIM_PX,
    TRIAL_TOLERANCE,
    Change,
    whole_picture,
)
from isochrome.fitting.frame.inputs import StatedInputs
from isochrome.fitting.frame.unknowns import LOAD, SMOOTH_KEYS
from isochrome.fitting.frame_set import FrameSet
from isochrome.fitting.joint.frame_sequence import Sequence, Unknown
from isochrome.fitting.joint.joint_fit import JointFit, JointProblem
from isochrome.fitting.refusals import refuse_alike
from isochrome.scene import Scene
from isochrome.stress import pixel_grid


@dataclass(frozen=True)
class JointSolution:
    """The fit of several frames together: their `data`, with the light and pixels that were taken.

    `problem`, that was solved; `progress`, called with each frame of each pass.
    """

    data: FrameSet
    problem: JointProblem
    fit: JointFit
    progress: Callable[[], None]

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self.data)

    @property
    def light_words(self) -> str:
        """What is said of the light."""
        return self.data[0].lamp.words

    @property
    def chi(self) -> float:
        """Residual over noise."""
        return self.fit.chi

    @property
    def past(self) -> bool:
        """Whether nothing else says what friction there was before: the frames' course does."""
        return False

    @property
    def noise_ratio(self) -> float:
        """The noise over what the first frame's finest part shows."""
        return self.data[0].noise_ratio

    @property
    def scene(self) -> Scene:
        """The scene with the fitted values."""
        return self.fit.scene

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys that were fitted."""
        return tuple(dict.fromkeys(unknown.key for unknown in self.fit.unknowns))

    @property
    def held(self) -> StatedInputs:
        """What is stated with an uncertainty, and held."""
        return self.problem.held

    @property
    def stated_misfit(self) -> tuple[Array, Array]:
        """1/u (p,) of what is stated of the unknowns, and stated less fitted values, over u."""
        return self.problem.prior.misfit(self.fit.values)

    @property
    def terms(self) -> LightTerms:
        """The polynomial products of the light."""
        return self.data[0].lamp.terms

    @property
    def pixels(self) -> int:
        """Pixels of all frames that may be used."""
        return sum(int(frame.valid.sum()) for frame in self.data)

    @property
    def is_bright(self) -> bool:
        """Whether each frame's light is light, and more than one amplitude."""
        return not self.fit.lost and not self.data.plain

    @property
    def is_sound(self) -> bool:
        """The same, and whether each value is determined, and told from the others."""
        fit = self.fit
        try:
            assert fit.information is not None
            refuse_alike(tuple(u.key for u in fit.unknowns), fit.information, fit.known)
        except PhysicsError:
            return False
        return self.is_bright and bool(np.isfinite(fit.standard_uncertainty).all())

    def values_of_key(self, key: str) -> list[tuple[float, float]]:
        """Value and standard uncertainty of a key, once or for each frame."""
        columns = self.fit.unknowns, self.fit.values, self.fit.standard_uncertainty
        return [(float(v), float(u)) for own, v, u in zip(*columns, strict=True) if own.key == key]

    def blocks(self) -> Iterator[FrameBlocks]:
        """Each of the frames in blocks."""
        return map(FrameBlocks, self.problem.solved_frames(self.fit.values))

    def again(self, change: Change) -> JointSolution:
        """The fit with a change. Raises PhysicsError where it cannot be made."""
        data, sequence, start = self._changed(change)
        try:
            found = solve_jointly(data, sequence, start, self.progress)
        except InputError as error:  # a step beyond what a key may be
            raise PhysicsError(str(error)) from error
        values, ends = found.fit.values, found.problem.bounds
        for k, unknown in enumerate(found.fit.unknowns):
            if unknown.key in change.added and not ends.low[k] < values[k] < ends.high[k]:
                raise PhysicsError(f"{unknown.key} = {values[k]:g}: at the end of where it may be")
        return found

    def trial(self, change: Change) -> tuple[float, int, int] | None:
        """Mean squared residual, unknowns and pixels of a fit to every third pixel."""
        data, sequence, start = self._changed(change)
        scene = sequence.whole(start)
        bent = pixel_grid(scene, data.shape).lens is not None
        margin = 0.0 if bent else RIM_PX
        try:
            problem = JointProblem(
                data, sequence, start, data.shape, self.progress, margin_px=margin
            )
            _, sums, _ = problem.solve(start, BLOCK, TRIAL_TOLERANCE)
        except (InputError, PhysicsError):
            return None
        if not all(sums.positive):
            return None
        linear = len(data) * sum(map(len, data[0].lamp.terms))
        size = sums.freedom + linear
        return sums.cost / size, len(start) + linear, size

    def joined(self, other: JointSolution) -> JointSolution:
        """The fit with the light, the pixels and the keys that another one of its frames has more.

        Raises PhysicsError where it cannot be made.
        """
        sequence, wider = self.fit.sequence, other.fit.sequence
        new = [k for k, u in enumerate(wider.unknowns) if u.key not in self.keys]
        added = tuple(wider.unknowns[k] for k in new)
        scene = sequence.scene.with_values({u.key: wider.scene.get(u.key) for u in added})
        unknowns = (*sequence.unknowns, *added)
        start = np.r_[self.fit.values, other.fit.values[new]]
        sequence = replace(sequence, scene=scene, unknowns=unknowns)
        return solve_jointly(other.data, sequence, start, self.progress)

    def _changed(self, change: Change) -> tuple[FrameSet, Sequence, Array]:
        """Frames, unknowns and values to begin with."""
        outside = change.outside
        if outside is not None:
            outside = whole_picture(outside, self.data.shape)
        data, sequence = self.data.seen(change.terms, outside), self.fit.sequence
        kept = [k for k, u in enumerate(sequence.unknowns) if u.key not in change.held]
        added = added_unknowns(sequence, tuple(change.added))
        unknowns = (*(sequence.unknowns[k] for k in kept), *added)
        scene = sequence.scene.with_values(change.added | change.held)
        start = np.r_[self.fit.values[kept], [change.added[unknown.key] for unknown in added]]
        return data, replace(sequence, scene=scene, unknowns=unknowns), start


def solve_jointly(
    data: FrameSet, sequence: Sequence, start: Array, progress: Callable[[], None]
) -> JointSolution:
    """Fit frames together, and keep what can be asked.

    Parameters: as of `fit_jointly`. Raises PhysicsError where the start cannot be solved or a key
    changes nothing.
    """
    problem = JointProblem(data, sequence, start, data.shape, progress)
    fit = problem.fitted(start)
    plates = [k for k, u in enumerate(fit.unknowns) if u.key.endswith("plate_error_deg")]
    if plates:  # turned to the other side, they nearly mirror the picture
        turned = fit.values.copy()
        turned[plates] *= -1.0
        other = JointProblem(data, sequence, turned, data.shape, progress)
        again = other.fitted(turned)
        if again.cost < fit.cost:
            problem, fit = other, again
    return JointSolution(data, problem, fit, progress)


def added_unknowns(sequence: Sequence, keys: tuple[str, ...]) -> tuple[Unknown, ...]:
    """The unknowns that some keys become: one for all frames, but for a smooth stress.

    Its change along the surface follows the friction, and each frame has its own; where each has
    its own load, each has its own of all three.
    """
    every = tuple(range(sequence.count))
    own_load = any(u.key == LOAD and not u.shared for u in sequence.unknowns)
    added: list[Unknown] = []
    for key in keys:
        own = key in SMOOTH_KEYS and (own_load or key == SMOOTH_KEYS[1])
        if own and sequence.count > 1:
            added += [Unknown(key, (i,), False) for i in every]
        else:
            added.append(Unknown(key, every, True))
    return tuple(added)
