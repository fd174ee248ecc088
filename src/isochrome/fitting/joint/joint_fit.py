"""Several frames fitted together: unknowns that they share, the apparatus' among them, and own.

The frames' own fits: all that can be known where nothing ties them, else where a fit starts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import (
    CUTOFF,
    Bounds,
    Damping,
    FrameData,
    Prior,
    is_determined,
    minimise,
    sandwich,
    scaled_inverse,
    standard_uncertainty,
)
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.causes.blocks import FrameBlocks, SolvedFrame, block_side
from isochrome.fitting.causes.solution import Askable, Change, whole_picture
from isochrome.fitting.causes.trial import Expected, Trial, through_a_lens
from isochrome.fitting.frame.far_model import TOLERANCE
from isochrome.fitting.frame.frame_fit import (
    Estimate,
    FrameFit,
    hidden_px,
    placed,
    turned_over,
    uncertainties,
)
from isochrome.fitting.frame.frame_model import (
    NEAR,
    clear_of_ends,
    solve_with_gamma,
    trusted_pixels,
)
from isochrome.fitting.frame.renderer import SceneRenderer, safe_signal
from isochrome.fitting.frame.single_state import with_numerics
from isochrome.fitting.frame.unknowns import (
    LOAD,
    SMOOTH_KEYS,
    WEAR,
    StatedInputs,
    fit_region,
    inputs_of_rows,
    limits,
    stated_inputs,
    thinning,
)
from isochrome.fitting.frame_set import PreparedFrames, refuse_alike
from isochrome.fitting.joint.frame_sequence import (
    COURSE,
    Sequence,
    SharedRun,
    Unknown,
    local_values,
)
from isochrome.fitting.joint.normal_equations import (
    DirectionMaps,
    NormalEquations,
    frame_equations,
    scar_equations,
    solved_along,
    with_number,
)
from isochrome.scene import DistanceTable, Scene


@dataclass(frozen=True)
class JointSolution(Askable):
    """Several frames' fit: `data` with light and pixels taken, the `problem`, `progress`."""

    data: PreparedFrames
    problem: JointProblem
    joint: JointFit
    progress: Callable[[], None]

    @property
    def fit(self) -> JointFit:
        """The fit."""
        return self.joint

    @property
    def frames(self) -> PreparedFrames:
        """The frames, with the light and the pixels that were taken."""
        return self.data

    @property
    def unknown_keys(self) -> tuple[str, ...]:
        """The key of each unknown (p,)."""
        return tuple(unknown.key for unknown in self.fit.unknowns)

    @property
    def prior(self) -> Prior:
        """What is known beforehand of the unknowns."""
        return self.problem.prior

    @property
    def held(self) -> StatedInputs:
        """What is stated with an uncertainty, and held."""
        return self.problem.held

    @property
    def is_bright(self) -> bool:
        """Whether each frame's light is light, and more than one amplitude."""
        return not self.fit.lost and not self.data.plain

    @property
    def is_sound(self) -> bool:
        """Whether it is bright, and each value determined, and told from the others."""
        fit = self.fit
        try:
            refuse_alike(self.unknown_keys, fit.information, fit.inputs.keys)
        except PhysicsError:
            return False
        return super().is_sound

    def blocks(self) -> Iterator[FrameBlocks]:
        """Each of the frames in blocks."""
        held, problem = self.held, self.problem
        sequence, values = with_held(problem.sequence, held), np.r_[self.fit.values, held.values]
        for name, solved in problem.solved_frames(sequence, values, problem.renderer()):
            if solved is None:
                raise PhysicsError("scene_cannot_solved_beside_values", name=name)
            yield FrameBlocks(solved)

    def again(self, change: Change) -> JointSolution:
        """The fit with a change. Raises PhysicsError where it cannot be made."""
        data, sequence, start = self._changed(change)
        try:
            solution = solve_jointly(data, sequence, start, self.progress)
        except InputError as error:  # a step beyond what a key may be
            raise PhysicsError(str(error)) from error
        values, ends = solution.fit.values, solution.problem.bounds
        for k, unknown in enumerate(solution.fit.unknowns):
            if unknown.key in change.added and not ends.low[k] < values[k] < ends.high[k]:
                raise PhysicsError("end_where_may", key=unknown.key, values=values[k])
        return solution

    def trial(self, change: Change, expected: Expected) -> Trial | None:
        """A fit to few pixels with what is expected of it; None where there is none."""
        data, sequence, start = self._changed(change)
        stride = block_side(data.shape)
        sequence = replace(sequence, scene=through_a_lens(sequence.scene))
        keys = tuple(unknown.key for unknown in sequence.unknowns)
        try:
            problem = JointProblem(data, sequence, start, data.shape, self.progress)
            problem.prior = expected.prior(keys, problem.prior)
            values, sums, _ = problem.solve(start, stride, TOLERANCE)
        except (InputError, PhysicsError):
            return None
        if not all(sums.positive):
            return None
        cost = sums.cost - sums.prior_cost
        return Trial(
            cost=cost,
            normal=sums.normal - problem.prior.normal,
            prior=sums.prior_cost,
            weight=problem.prior.weight,
            extra=np.array([key in expected.keys for key in keys]),
            # the light's own equations are not kept: it counts by what it leaves
            light=np.zeros((0, 0)),
            light_weight=np.zeros(0),
            excess=max(1.0, cost / sums.freedom),
            values={
                unknown.key: float(value)
                for unknown, value in zip(sequence.unknowns, values, strict=True)
                if unknown.shared
            },
        )

    def still_odd(self, whole: JointSolution, odd: Mask) -> Mask:
        """All that was left out: specks lie elsewhere in each frame, and are left out of all."""
        return odd

    def joined(self, other: JointSolution) -> JointSolution:
        """The fit with the light, pixels and keys that another one has more; or PhysicsError."""
        sequence, wider = self.fit.sequence, other.fit.sequence
        new = [k for k, u in enumerate(wider.unknowns) if u.key not in self.keys]
        added = tuple(wider.unknowns[k] for k in new)
        scene = sequence.scene.with_values({u.key: wider.scene.get(u.key) for u in added})
        unknowns = (*sequence.unknowns, *added)
        start = np.r_[self.fit.values, other.fit.values[new]]
        sequence = replace(sequence, scene=scene, unknowns=unknowns)
        return solve_jointly(other.data, sequence, start, self.progress)

    def _changed(self, change: Change) -> tuple[PreparedFrames, Sequence, Array]:
        """Frames, unknowns and values to begin with."""
        outside = change.outside
        if outside is not None:
            outside = whole_picture(outside, self.data.shape)
        data, sequence = self.data.seen(change.uneven, outside), self.fit.sequence
        remaining = [k for k, u in enumerate(sequence.unknowns) if u.key not in change.held]
        every = tuple(range(sequence.count))
        own_load = any(u.key == LOAD and not u.shared for u in sequence.unknowns)
        added: list[Unknown] = []
        for key in change.added:
            # a smooth stress is each frame's own where the load is, and its change along the
            # surface always: that follows the friction
            own = key in SMOOTH_KEYS and (own_load or key == SMOOTH_KEYS[1])
            if own and sequence.count > 1:
                added += [Unknown(key, (i,), False) for i in every]
            else:
                added.append(Unknown(key, every, True))
        unknowns = (*(sequence.unknowns[k] for k in remaining), *added)
        scene = sequence.scene.with_values(change.added | change.held)
        begun = [change.begun.get(sequence.unknowns[k].key, self.fit.values[k]) for k in remaining]
        start = np.array([*begun, *(change.added[unknown.key] for unknown in added)], float)
        return data, replace(sequence, scene=scene, unknowns=unknowns), start


def solve_jointly(
    data: PreparedFrames, sequence: Sequence, start: Array, progress: Callable[[], None]
) -> JointSolution:
    """Fit frames together, and keep what can be asked; raises as `JointProblem.fitted`."""
    problem = JointProblem(data, sequence, start, data.shape, progress)
    fit = problem.fitted(start)
    turned = turned_over(tuple(u.key for u in fit.unknowns), fit.values)
    if turned is not None:
        other = JointProblem(data, sequence, turned, data.shape, progress)
        again = other.fitted(turned)
        if again.cost < fit.cost:
            problem, fit = other, again
    return JointSolution(data, problem, fit, progress)


_ITERATIONS = 20
_EDGE_PX = 2.0
"""Depth above which no pixel is fitted. The contrast that a pixel's area leaves is told from its
neighbours; above 1.5 pixels one of them leaves the material as the place moves, and chi jumps."""
_ALIKE = 1e-6
"""Relative difference of two costs that is none, they are sums in single precision; and share of a
misfit beyond the noise that approximate derivatives do not resolve."""


@dataclass(frozen=True, kw_only=True)
class JointFit(Estimate):
    """Fitted unknowns of a `sequence`, the one-state `scenes` of its frames and their chi; `lost`,
    frames whose light came out negative. Matrices are empty where nothing ties the frames.
    """

    sequence: Sequence
    scenes: tuple[Scene, ...]
    frame_chi: tuple[float, ...]
    lost: tuple[int, ...]

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The unknowns, in the order of the values."""
        return self.sequence.unknowns

    @cached_property
    def scene(self) -> Scene:
        """The scene of all frames with the fitted values."""
        return self.sequence.whole(self.values)


class JointProblem:
    """One least-squares problem over a set of frames, at any stride."""

    def __init__(
        self,
        frames: Iterable[FrameData],
        sequence: Sequence,
        start: Array,
        shape: tuple[int, int],
        progress: Callable[[], None] = lambda: None,
    ) -> None:
        """`frames` of a `shape`, gone through once a pass; `start` (p,), in the right basin."""
        fine = with_numerics(sequence.whole(start), room=1.3).numerics
        self.progress, self.frames, self.shape = progress, frames, shape
        self.given, self.sequence = (
            replace(sequence, scene=sequence.scene.model_copy(update={"numerics": numerics}))
            for numerics in (sequence.scene.numerics, fine)
        )
        self.stated = stated_inputs(sequence.scene)
        # what was worn between two frames is not the coefficient that was measured
        names = [u.key if u.shared or u.key != WEAR else "" for u in sequence.unknowns]
        self.prior = self.stated.prior(tuple(names))
        self.held = self.stated.some(tuple(u.key for u in sequence.unknowns), free=False)
        self.coarse_stride = thinning(shape[0] * shape[1])
        self.first = self._scenes(self.sequence, start)
        self._clear: list[Array] = []
        ends = [
            limits(with_number(self.first[unknown.frames[0]], unknown.key), (unknown.key,))
            for unknown in sequence.unknowns
        ]
        low, high = ([getattr(end, name)[0] for end in ends] for name in ("low", "high"))
        self.bounds = Bounds(np.array(low), np.array(high))

    def fitted(self, start: Array) -> JointFit:
        """Least squares over all frames, first thinned, then on every pixel; or PhysicsError."""
        values, _, _ = self.solve(start, self.coarse_stride, TOLERANCE)
        self.keep_clear(values)
        values, normal, converged = self.solve(values, 1, NEAR)
        return self.result(values, normal, converged)

    def solve(
        self, values: Array, stride: int, tolerance: float
    ) -> tuple[Array, NormalEquations, bool]:
        """Damped steps inside the bounds; the last, which is small, is taken unseen."""
        renderer = self.renderer(stride)

        def at(where: Array) -> NormalEquations | None:
            sums = self.equations(self.sequence, where, renderer)
            return sums and sums.known(self.prior, where)

        normal = at(values)
        if normal is None:
            raise PhysicsError("scene_cannot_solved_where_frames")

        def enough(here: NormalEquations) -> float:
            # a gain of `tolerance` in standard uncertainties, and what derivatives do not resolve
            beyond = max(0.0, here.cost - here.freedom)
            return tolerance**2 * max(1.0, here.cost / here.freedom) + _ALIKE * beyond

        sums = minimise(
            at, values, normal, damping=Damping(1e-6, least=1e-4), iterations=_ITERATIONS,
            enough=enough,
            better=lambda new, old: new.cost <= old.cost * (1.0 + _ALIKE),
            bounds=self.bounds,
        )  # fmt: skip
        end = sums.values + sums.step if sums.converged else sums.values
        return end, sums.point, sums.converged

    def equations(
        self, sequence: Sequence, values: Array, renderer: SceneRenderer
    ) -> NormalEquations | None:
        """Normal equations of frames and scars at values (p,); None where they cannot be solved."""
        total = scar_equations(sequence, values) if sequence.areas else None
        for _, solved in self.solved_frames(sequence, values, renderer):
            if solved is None:
                return None
            part = frame_equations(solved.gamma_fit, solved.rows, exact=self.prior.any)
            part = part.along(solved.along)
            total = part if total is None else total + part
        return total

    def solved_frames(
        self, sequence: Sequence, values: Array, renderer: SceneRenderer
    ) -> Iterator[tuple[str, SolvedFrame | None]]:
        """Each frame's name, residual and derivatives, None where no scene there can be solved."""
        maps, stride = DirectionMaps(sequence, values), renderer.stride
        for i, data in enumerate(self.frames):
            here = placed(sequence.frame(maps.whole, values, i), self.shape)
            moved, region = maps.beside(i, both=self.prior.any), self._region(i, stride)
            solved = solved_along(data.every(stride), here, moved, renderer=renderer, region=region)
            if solved is None:
                yield data.name, None
                return
            pixels, gamma_fit, rows = solved
            yield data.name, SolvedFrame(
                data=data, scene=here, pixels=pixels, gamma_fit=gamma_fit, renderer=renderer,
                rows=rows, along=maps.columns(i), unknowns=len(self.sequence.unknowns),
            )  # fmt: skip
            self.progress()

    def renderer(self, stride: int = 1) -> SceneRenderer:
        """A renderer of all frames, which solves a run once for all of them."""
        solve = SharedRun(self.sequence.distances_m)
        return SceneRenderer(self.first[0], self.shape, stride=stride, solve=solve)

    def keep_clear(self, values: Array) -> None:
        """Leave out the pixels whose model at some values is near black or white, see `gamma`."""
        renderer, masks = self.renderer(), []
        for i, (data, here) in enumerate(
            zip(self.frames, self._scenes(self.sequence, values), strict=True)
        ):
            gamma, region = here.frames.stated_gamma, self._region(i, 1)
            pixels = trusted_pixels(data, region)
            gamma_fit = solve_with_gamma(pixels, safe_signal(renderer, here)[pixels.keep], gamma)
            if gamma_fit is not None:
                region = region.copy()
                region[pixels.keep] = clear_of_ends(pixels, gamma_fit.model, gamma)
            masks.append(np.packbits(region))
            self.progress()
        self._clear = masks

    def _region(self, index: int, stride: int) -> Array:
        """The pixels of a frame that are fitted."""
        if stride == 1 and self._clear:
            bits = np.unpackbits(self._clear[index], count=self.shape[0] * self.shape[1])
            return bits.reshape(self.shape).astype(bool)
        least = _EDGE_PX if self.sequence.count > 1 else 0.0  # a single frame is fitted as alone
        hidden = max(least, hidden_px(self.first[index]))
        return fit_region(self.first[index], self.shape, stride, hidden)

    def result(self, values: Array, normal: NormalEquations, converged: bool) -> JointFit:
        """The fit's statistics, with the scene's own numerics back in it."""
        inverse = scaled_inverse(normal.normal, CUTOFF)
        information = normal.normal - self.prior.normal if self.prior.any else normal.normal
        determined = is_determined(information, normal.squares) | (self.prior.weight > 0.0)
        bound = standard_uncertainty(inverse, determined)
        for unknown, limit in zip(self.sequence.unknowns, bound.tolist(), strict=True):
            if unknown.shared and not np.isfinite(limit):
                raise PhysicsError("does_not_change_fringes", key=unknown.key)
        inputs, sensitivity = self._sensitivity(values, inverse)
        freedom = max(1, normal.freedom - values.size)
        return JointFit(
            sequence=self.given, values=values, cramer_rao_bound=bound, information=information,
            **uncertainties(sandwich(inverse, normal.middle), inputs, sensitivity, determined),
            chi=float(np.sqrt((normal.cost - normal.prior_cost) / freedom)), freedom=freedom,
            scenes=self._scenes(self.given, values), frame_chi=normal.chi,
            converged=converged and bool(np.all(determined)),
            lost=tuple(i for i, good in enumerate(normal.positive) if not good),
        )  # fmt: skip

    def _sensitivity(self, values: Array, inverse: Array) -> tuple[StatedInputs, Array]:
        """What is known beforehand (m,), one statement for all frames, and the values' change with
        it (p, m); PhysicsError where the scene cannot be solved beside an input that is held.
        """
        unknowns, held = self.sequence.unknowns, self.held
        keys = [u.key for u in unknowns]
        stated = self.stated.some(tuple(keys), free=True)
        weights = self.prior.weight
        columns = [
            inverse[:, places] @ weights[places]
            for places in ([k for k, key in enumerate(keys) if key == one] for one in stated.keys)
        ]
        if held.keys:
            wider = with_held(self.sequence, held)
            sums = self.equations(wider, np.r_[values, held.values], self.renderer())
            if sums is None:
                raise PhysicsError("scene_cannot_solved_beside_these", keys=", ".join(held.keys))
            columns += list(-(inverse @ sums.normal[: len(keys), len(keys) :]).T)
        rows = inputs_of_rows([*stated.rows, *held.rows])
        return rows, np.array(columns).reshape(-1, len(keys)).T

    def _scenes(self, sequence: Sequence, values: Array) -> tuple[Scene, ...]:
        """The scene of each frame at some values (p,)."""
        common = sequence.whole(values)
        frames = range(sequence.count)
        return tuple(placed(sequence.frame(common, values, i), self.shape) for i in frames)


def with_held(sequence: Sequence, held: StatedInputs) -> Sequence:
    """A sequence with what is held as unknowns of all frames, behind its own."""
    every = tuple(range(sequence.count))
    added = tuple(Unknown(key, every, True) for key in held.keys)
    return replace(sequence, unknowns=(*sequence.unknowns, *added))


_LEAST = 1e-2
"""Least share of the scene's own wear that a fit starts with."""


def is_each(sequence: Sequence) -> bool:
    """Whether each frame's own fit is all: nothing is shared, no history, no measured scar."""
    if sequence.areas:
        return False
    scene = sequence.scene
    given = [key for key in COURSE if getattr(scene, key.partition(".")[0]) is not None]
    if any(isinstance(scene.get(key), DistanceTable) for key in given):
        return False
    shared = any(unknown.shared for unknown in sequence.unknowns)
    return sequence.count == 1 or not (sequence.run or shared)


def fit_of_each(sequence: Sequence, single_fits: list[FrameFit]) -> JointFit:
    """The fits of frames that nothing ties together as one of all of them, without matrices."""
    # what the frames' own fits have more, of a smooth stress, are unknowns too
    own_load = any(u.key == LOAD and not u.shared for u in sequence.unknowns)
    shared = sequence.count == 1 and not own_load
    more = dict.fromkeys(
        key for i, fit in enumerate(single_fits) for key in fit.keys[len(sequence.acting(i)) :]
    )
    added = [
        Unknown(key, (i,), shared)
        for key in more
        for i, fit in enumerate(single_fits)
        if key in fit.keys
    ]
    wider = replace(sequence, unknowns=(*sequence.unknowns, *added))
    own = [(single_fits[u.frames[0]], u.key) for u in wider.unknowns]
    places = [(fit, fit.keys.index(key)) for fit, key in own]
    parts: dict[str, Any] = {
        name: np.array([getattr(fit, name)[k] for fit, k in places])
        for name in ("values", "standard_uncertainty", "noise_uncertainty", "cramer_rao_bound")
    }
    rows = {row[0]: row for fit in single_fits for row in fit.inputs.rows}
    sensitivity = np.full((len(places), len(rows)), np.nan)
    for line, (fit, k) in zip(sensitivity, places, strict=True):
        line[[[*rows].index(key) for key in fit.inputs.keys]] = fit.sensitivity[k]
    freedom, chi = np.array([(fit.freedom, fit.chi) for fit in single_fits]).T
    none = np.empty((0, 0))
    return JointFit(
        sequence=wider, **parts, covariance=none, information=none, freedom=int(freedom.sum()),
        inputs=inputs_of_rows(rows.values()), sensitivity=sensitivity,
        chi=float(np.sqrt(freedom @ chi**2 / freedom.sum())), frame_chi=tuple(chi.tolist()),
        scenes=tuple(fit.scene for fit in single_fits),
        converged=all(fit.converged for fit in single_fits),
        lost=tuple(i for i, fit in enumerate(single_fits) if not fit.positive),
    )  # fmt: skip


def starting_values(sequence: Sequence, single_fits: list[FrameFit]) -> Array:
    """Where the joint fit starts: means of own values weighted by uncertainty, wear by worn areas.
    PhysicsError for an unknown that no frame tells, nor a measured scar.
    """
    values = np.empty(len(sequence.unknowns))
    for k, unknown in enumerate(sequence.unknowns):
        fits = [single_fits[i] for i in unknown.frames]
        # a scar may tell what they do not; what nothing tells is refused where the fit ends
        if not (sequence.areas and unknown.key in COURSE):
            refuse_undetermined(unknown.key, fits)
        weights = [1.0 / max(_spread(fit, unknown.key), 1e-300) ** 2 for fit in fits]
        each = [fit.values[fit.keys.index(unknown.key)] for fit in fits]
        values[k] = np.average(each, weights=weights if any(weights) else None)
    worn = [k for k, u in enumerate(sequence.unknowns) if u.key == WEAR]
    if not worn:
        return values
    # worn areas, over what the scene's own coefficient gives there
    coefficient = sequence.scene.get(WEAR)
    values[worn] = np.mean(getattr(coefficient, "value", coefficient))
    common, ratios, weights = sequence.whole(values), [], []
    for i in {i for k in worn for i in sequence.unknowns[k].frames}:
        fit, own = single_fits[i], sequence.frame(common, values, i)
        fitted, given = (
            local_values(s, sequence.distances_m[i : i + 1])[0, 2] for s in (fit.scene, own)
        )
        ratios.append(fitted / given)
        weights.append(max(1.0, fit.values[fit.keys.index(WEAR)] / _spread(fit, WEAR)) ** 2)
    # a start of next to no wear, and not of none: a step is a share of it
    values[worn] *= max(_LEAST, float(np.average(ratios, weights=weights)))
    return values


def refuse_undetermined(key: str, fits: Iterable[FrameFit]) -> None:
    """Raise PhysicsError where none of some frames' own fits tells a key."""
    if not any(np.isfinite(_spread(fit, key)) for fit in fits):
        raise PhysicsError("does_not_change_fringes", key=key)


def _spread(fit: FrameFit, key: str) -> float:
    """A key's standard uncertainty from one frame alone, infinite where it says nothing."""
    return float(fit.standard_uncertainty[fit.keys.index(key)]) if key in fit.keys else np.inf
