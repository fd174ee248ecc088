"""Several frames fitted together: unknowns that they share, the apparatus' among them, and own.

The frames' own fits: all that can be known where nothing ties them, else where a fit starts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import (
    CUTOFF,
    NOISE,
    Bounds,
    BudgetInput,
    Damping,
    FrameData,
    Prior,
    budget_of,
    budgets_of,
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
from isochrome.fitting.frame.frame_fit import FrameFit, hidden_px, placed, turned_over
from isochrome.fitting.frame.frame_model import NEAR
from isochrome.fitting.frame.renderer import SceneRenderer
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
from isochrome.fitting.frame_set import PreparedFrames as FrameSet
from isochrome.fitting.frame_set import refuse_alike
from isochrome.fitting.joint.frame_sequence import COURSE, Sequence, Unknown, local_values
from isochrome.fitting.joint.normal_equations import (
    DirectionMaps,
    NormalEquations,
    add_up,
    clear_region,
    make_renderer,
    scar_equations,
    scar_rows,
    solved_along,
    with_number,
)
from isochrome.scene import DistanceTable, Scene


@dataclass(frozen=True)
class JointSolution(Askable):
    """The fit of several frames together: their `data`, with the light and pixels that were taken.

    `problem`, that was solved; `progress`, called with each frame of each pass.
    """

    data: FrameSet
    problem: JointProblem
    joint: JointFit
    progress: Callable[[], None]

    @property
    def fit(self) -> JointFit:
        """The fit."""
        return self.joint

    @property
    def frames(self) -> FrameSet:
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
            assert fit.information is not None
            refuse_alike(self.unknown_keys, fit.information, fit.known)
        except PhysicsError:
            return False
        return super().is_sound

    def blocks(self) -> Iterator[FrameBlocks]:
        """Each of the frames in blocks."""
        return map(FrameBlocks, self.problem.solved_frames(self.fit.values))

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
        data, sequence = self.data.seen(change.uneven, outside), self.fit.sequence
        remaining = [k for k, u in enumerate(sequence.unknowns) if u.key not in change.held]
        added = added_unknowns(sequence, tuple(change.added))
        unknowns = (*(sequence.unknowns[k] for k in remaining), *added)
        scene = sequence.scene.with_values(change.added | change.held)
        begun = [change.begun.get(sequence.unknowns[k].key, self.fit.values[k]) for k in remaining]
        start = np.array([*begun, *(change.added[unknown.key] for unknown in added)], float)
        return data, replace(sequence, scene=scene, unknowns=unknowns), start


def solve_jointly(
    data: FrameSet, sequence: Sequence, start: Array, progress: Callable[[], None]
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


def added_unknowns(sequence: Sequence, keys: tuple[str, ...]) -> tuple[Unknown, ...]:
    """The unknowns that some keys become: one for all frames, but for a smooth stress.

    Its change along the surface follows the friction, and each frame has its own; where each has
    its own load, each has its own of all three.
    """
    every = tuple(range(sequence.count))
    own_load = any(u.key == LOAD and not u.shared for u in sequence.unknowns)
    added: list[Unknown] = []
    for key in keys:
        per_frame = key in SMOOTH_KEYS and (own_load or key == SMOOTH_KEYS[1])
        if per_frame and sequence.count > 1:
            added += [Unknown(key, (i,), False) for i in every]
        else:
            added.append(Unknown(key, every, True))
    return tuple(added)


_ITERATIONS = 20
_EDGE_PX = 2.0
"""Depth above which no pixel is fitted. The contrast that a pixel's area leaves is told from its
neighbours; above 1.5 pixels one of them leaves the material as the place moves, and chi jumps."""
_ALIKE = 1e-6
"""Relative difference of two costs that is none, they are sums in single precision; and share of a
misfit beyond the noise that approximate derivatives do not resolve."""


@dataclass(frozen=True, kw_only=True)
class JointFit:
    """Fitted unknowns (p,) of a `sequence`.

    `noise_uncertainty`, by the frames' noise alone; `information`, J^T J over the noise variance;
    `chi`, residual over noise, `frame_chi` of each; `cost`, the sum of squares; `lost`, frames
    whose light came out negative; `budget` of each unknown, empty without stated inputs, whose keys
    are `known`. The matrices (p, p) are None where nothing ties the frames together.
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
    noise_uncertainty: Array
    budget: tuple[tuple[BudgetInput, ...], ...] = ()
    known: tuple[str, ...] = ()

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The unknowns, in the order of the values."""
        return self.sequence.unknowns

    def less_sure(self, more: Array) -> JointFit:
        """The same with a covariance that is larger by `more` (p, p), as if by noise."""
        assert self.covariance is not None
        variance = np.diag(more)
        noise = np.sqrt(self.noise_uncertainty**2 + variance)
        budgets = []
        for noise_of, budget in zip(noise.tolist(), self.budget, strict=False):
            inputs = [item for item in budget if item.input != NOISE]
            rows = tuple((i.input, i.value or 0.0, i.standard_uncertainty) for i in inputs)
            weights = np.array([item.sensitivity for item in inputs])
            budgets.append(budget_of(noise_of, rows, weights) if budget else ())
        return replace(
            self,
            covariance=self.covariance + more,
            standard_uncertainty=np.sqrt(self.standard_uncertainty**2 + variance),
            noise_uncertainty=noise,
            budget=tuple(budgets),
        )


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
        self.bounds = Bounds(
            np.concatenate([end.low for end in ends]), np.concatenate([end.high for end in ends])
        )

    def fitted(self, start: Array) -> JointFit:
        """Least squares over the intensities of all frames, first thinned, then on every pixel.

        PhysicsError where the start cannot be solved or a key changes nothing.
        """
        values, _, _ = self.solve(start, self.coarse_stride, TOLERANCE)
        self.keep_clear(values)
        values, normal, converged = self.solve(values, 1, NEAR)
        return self.result(values, normal, converged)

    def solve(
        self, values: Array, stride: int, tolerance: float
    ) -> tuple[Array, NormalEquations, bool]:
        """Damped steps inside the bounds; the last, which is small, is taken unseen."""
        renderer = make_renderer(self.sequence, self.first[0], self.shape, stride)

        def at(where: Array) -> NormalEquations | None:
            sums = self._sums(self.sequence, where, renderer, stride)
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

    def _sums(
        self, sequence: Sequence, values: Array, renderer: SceneRenderer, stride: int
    ) -> NormalEquations | None:
        """The normal equations of frames and measured scars at some values."""
        sums = add_up(
            (data.every(stride) for data in self.frames), sequence, values,
            renderer=renderer, progress=self.progress, exact=self.prior.any,
            regions=lambda i: self._region(i, stride),
        )  # fmt: skip
        return sums and (sums + scar_equations(sequence, values) if sequence.areas else sums)

    def keep_clear(self, values: Array) -> None:
        """Leave out the pixels whose model at some values is near black or white, see `gamma`."""
        renderer = make_renderer(self.sequence, self.first[0], self.shape, 1)
        common, scenes = self.sequence.whole(values), []
        for i, data in enumerate(self.frames):
            here, region = self.sequence.frame(common, values, i), self._region(i, 1)
            scenes.append(np.packbits(clear_region(data, here, renderer=renderer, region=region)))
            self.progress()
        self._clear = scenes

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
        noise = sandwich(inverse, normal.middle)
        inputs, sensitivity = self._sensitivity(values, inverse)
        covariance = noise + (sensitivity * inputs.spread**2) @ sensitivity.T
        noise_spread = standard_uncertainty(noise, determined)
        freedom = max(1, normal.freedom - values.size)
        cost = normal.cost - normal.prior_cost
        return JointFit(
            sequence=self.given, values=values,
            standard_uncertainty=standard_uncertainty(covariance, determined),
            cramer_rao_bound=bound, covariance=covariance, information=information,
            chi=float(np.sqrt(cost / freedom)), frame_chi=normal.chi, cost=cost, freedom=freedom,
            scene=self.given.whole(values), scenes=self._scenes(self.given, values),
            converged=converged and bool(np.all(determined)),
            lost=tuple(i for i, good in enumerate(normal.positive) if not good),
            noise_uncertainty=noise_spread,
            budget=budgets_of(noise_spread, inputs.rows, sensitivity), known=inputs.keys,
        )  # fmt: skip

    def _sensitivity(self, values: Array, inverse: Array) -> tuple[StatedInputs, Array]:
        """What is known beforehand (m,), and the values' change with it (p, m).

        A key that each frame has of its own has one statement for all of them. Raises PhysicsError
        where the scene cannot be solved beside an input that is held.
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
            wider = self._with_held()
            renderer = make_renderer(self.sequence, self.first[0], self.shape, 1)
            sums = self._sums(wider, np.r_[values, held.values], renderer, 1)
            if sums is None:
                raise PhysicsError("scene_cannot_solved_beside_these", keys=", ".join(held.keys))
            columns += list(-(inverse @ sums.normal[: len(keys), len(keys) :]).T)
        rows = inputs_of_rows([*stated.rows, *held.rows])
        return rows, np.array(columns).reshape(-1, len(keys)).T

    def _with_held(self) -> Sequence:
        """The sequence with what is stated and held as unknowns of all frames, behind its own."""
        every = tuple(range(self.sequence.count))
        added = tuple(Unknown(key, every, True) for key in self.held.keys)
        return replace(self.sequence, unknowns=(*self.sequence.unknowns, *added))

    def solved_frames(self, values: Array) -> Iterator[SolvedFrame]:
        """Each frame where a fit ended: its residual, and its derivatives by all that is in it.

        Raises PhysicsError where a scene beside its own cannot be solved.
        """
        sequence = self._with_held()
        values = np.r_[values, self.held.values]
        maps = DirectionMaps(sequence, values)
        renderer = make_renderer(self.sequence, self.first[0], self.shape, 1)
        for i, data in enumerate(self.frames):
            here = placed(sequence.frame(maps.whole, values, i), self.shape)
            moved = maps.beside(i, both=self.prior.any)
            region = self._region(i, 1)
            solved = solved_along(data, here, moved, renderer=renderer, region=region)
            if solved is None:
                raise PhysicsError("scene_cannot_solved_beside_values", name=data.name)
            pixels, gamma_fit, rows = solved
            yield SolvedFrame(
                data=data,
                scene=here,
                pixels=pixels,
                gamma_fit=gamma_fit,
                renderer=renderer,
                rows=rows,
                along=maps.columns(i),
                unknowns=len(self.sequence.unknowns),
            )
            self.progress()

    def _scenes(self, sequence: Sequence, values: Array) -> tuple[Scene, ...]:
        """The scene of each frame at some values (p,)."""
        common = sequence.whole(values)
        frames = range(sequence.count)
        return tuple(placed(sequence.frame(common, values, i), self.shape) for i in frames)


_LEAST = 1e-2
"""Least share of the scene's own wear that a fit starts with."""
_STEPS = 4
"""Steps to what a frame and scars say together: W is all but linear over their uncertainties."""


def is_each(sequence: Sequence) -> bool:
    """Whether each frame's own fit is all that can be known of it: nothing is shared, no history.

    Not where a frame shows a state that other distances led to, nor where scars were measured of a
    run of several.
    """
    if sequence.areas and sequence.count > 1:
        return False
    scene = sequence.scene
    given = [key for key in COURSE if getattr(scene, key.partition(".")[0]) is not None]
    if any(isinstance(scene.get(key), DistanceTable) for key in given):
        return False
    shared = any(unknown.shared for unknown in sequence.unknowns)
    return sequence.count == 1 or not (sequence.run or shared)


def fit_of_each(sequence: Sequence, single_fits: list[FrameFit]) -> JointFit:
    """The fits of frames that nothing ties together as one of all of them, without matrices."""
    wider = _with_own_keys(sequence, single_fits)
    first = [(single_fits[unknown.frames[0]], unknown.key) for unknown in wider.unknowns]
    values, spread, noise, bound = (
        np.array([getattr(fit, name)[fit.keys.index(key)] for fit, key in first])
        for name in ("values", "standard_uncertainty", "noise_uncertainty", "cramer_rao_bound")
    )
    known = tuple(dict.fromkeys(key for fit in single_fits for key in fit.inputs.keys))
    cost = sum(fit.chi**2 * fit.freedom for fit in single_fits)
    freedom = sum(fit.freedom for fit in single_fits)
    return JointFit(
        sequence=wider, values=values, standard_uncertainty=spread, cramer_rao_bound=bound,
        covariance=None, information=None, chi=float(np.sqrt(cost / freedom)),
        frame_chi=tuple(fit.chi for fit in single_fits), cost=cost, freedom=freedom,
        scene=wider.whole(values), scenes=tuple(fit.scene for fit in single_fits),
        converged=all(fit.converged for fit in single_fits),
        lost=tuple(i for i, fit in enumerate(single_fits) if not fit.positive),
        noise_uncertainty=noise,
        budget=tuple(fit.budget_of_key(key) if known else () for fit, key in first), known=known,
    )  # fmt: skip


def _with_own_keys(sequence: Sequence, single_fits: list[FrameFit]) -> Sequence:
    """A sequence with what its frames' own fits have more, of a smooth stress, as unknowns."""
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
    return replace(sequence, unknowns=(*sequence.unknowns, *added))


def with_scars(joint: JointFit, single_fit: FrameFit) -> JointFit:
    """The fit of a single frame, by `fit_of_each`, with the worn areas measured beside it.

    The frame says v0 with covariance C of all but what is held; an area A of uncertainty u says
    W(v), H = dW/dv / u: v = v0 + K ((A - W(v))/u + H (v - v0)), K = C H^T (H C H^T + 1)^-1, of
    covariance (1 - K H) C. Source: Rodgers (2000), Inverse methods for atmospheric sounding, 5.3.
    """
    keys, known, sensitivity = single_fit.keys, single_fit.inputs, single_fit.sensitivity
    held = known.some(keys, free=False)
    added = tuple(Unknown(key, (0,), True) for key in held.keys)
    wider = replace(joint.sequence, unknowns=(*joint.sequence.unknowns, *added))
    size, free = single_fit.values.size, sensitivity.shape[1] - len(held.keys)
    by_held = sensitivity[:, free:]
    prior = single_fit.covariance - (by_held * held.spread**2) @ by_held.T
    values = single_fit.values
    for _ in range(_STEPS):
        rows, residual = scar_rows(wider, np.r_[values, held.values])
        slope = rows[:size].T
        spread = slope @ prior @ slope.T + np.eye(residual.size)
        gain = np.linalg.solve(spread, slope @ prior).T
        values = single_fit.values + gain @ (residual + slope @ (values - single_fit.values))
    _, residual = scar_rows(wider, np.r_[values, held.values])
    complement = np.eye(size) - gain @ slope
    noise = single_fit.covariance - (sensitivity * known.spread**2) @ sensitivity.T
    noise = complement @ noise @ complement.T + gain @ gain.T
    sensitivity = complement @ sensitivity
    sensitivity[:, free:] -= gain @ rows[size:].T  # what is held moves the areas too
    covariance = noise + (sensitivity * known.spread**2) @ sensitivity.T
    information = single_fit.information + slope.T @ slope
    inverse = scaled_inverse(information + known.prior(keys).normal, CUTOFF)
    every = np.ones(size, dtype=bool)
    moved = values - single_fit.values
    cost = joint.cost + float(moved @ single_fit.information @ moved + residual @ residual)
    noise_spread = standard_uncertainty(noise, every)
    freedom = joint.freedom + residual.size
    return replace(
        joint, values=values, standard_uncertainty=standard_uncertainty(covariance, every),
        cramer_rao_bound=standard_uncertainty(inverse, every), covariance=covariance,
        information=information, chi=float(np.sqrt(cost / freedom)), cost=cost, freedom=freedom,
        scene=joint.sequence.whole(values),
        scenes=(single_fit.scene.with_values(dict(zip(keys, values.tolist(), strict=True))),),
        noise_uncertainty=noise_spread, budget=budgets_of(noise_spread, known.rows, sensitivity),
    )  # fmt: skip


def starting_values(sequence: Sequence, single_fits: list[FrameFit]) -> Array:
    """Where the joint fit starts: own values, means weighted by uncertainty, wear by worn areas.

    PhysicsError for an unknown that no frame tells, nor a measured scar.
    """
    for unknown in sequence.unknowns:
        if sequence.areas and unknown.key in COURSE:
            continue  # a scar may tell it; what nothing tells is refused where the fit ends
        refuse_undetermined(unknown.key, [single_fits[i] for i in unknown.frames])
    values = np.empty(len(sequence.unknowns))
    for k, unknown in enumerate(sequence.unknowns):
        fits = [single_fits[i] for i in unknown.frames]
        weights = [1.0 / max(_spread(fit, unknown.key), 1e-300) ** 2 for fit in fits]
        each = [fit.values[fit.keys.index(unknown.key)] for fit in fits]
        values[k] = np.average(each, weights=weights if any(weights) else None)
    worn = [k for k, u in enumerate(sequence.unknowns) if u.key == WEAR]
    if worn:
        coefficient = sequence.scene.get(WEAR)
        values[worn] = (
            np.mean(coefficient.value) if isinstance(coefficient, DistanceTable) else coefficient
        )
        values[worn] *= _wear_factors(sequence, values, single_fits, worn)
    return values


def refuse_undetermined(key: str, fits: Iterable[FrameFit]) -> None:
    """Raise PhysicsError where none of some frames' own fits tells a key."""
    if not any(np.isfinite(_spread(fit, key)) for fit in fits):
        raise PhysicsError("does_not_change_fringes", key=key)


def _wear_factors(
    sequence: Sequence, values: Array, single_fits: list[FrameFit], worn: list[int]
) -> Array:
    """Worn area between frames, over what the scene's own wear coefficient gives there."""
    common, fitted, given, weights = sequence.whole(values), [], [], []
    for k in worn:
        for i in sequence.unknowns[k].frames:
            fit, distance = single_fits[i], sequence.distances_m[i]
            assert distance is not None
            fitted.append(local_values(fit.scene, (distance,))[0, 2])
            given.append(local_values(sequence.frame(common, values, i), (distance,))[0, 2])
            known = fit.values[fit.keys.index(WEAR)] / _spread(fit, WEAR)
            weights.append(max(1.0, known) ** 2)
    # a start of next to no wear, and not of none: a step is a share of it
    average = max(_LEAST, float(np.average(np.divide(fitted, given), weights=weights)))
    even = np.full(len(worn), average)
    if len(worn) == 1 or not sequence.run:
        return even
    order = np.argsort([sequence.distances_m[sequence.unknowns[k].frames[0]] or 0.0 for k in worn])
    last = [sum(len(sequence.unknowns[k].frames) for k in worn[: j + 1]) - 1 for j in order]
    worn_since, expected = (np.diff(np.array(v)[last], prepend=0.0) for v in (fitted, given))
    factors = np.empty(len(worn))
    factors[order] = worn_since / expected
    return factors if np.all(factors > 0.1 * even) else even


def _spread(fit: FrameFit, key: str) -> float:
    """A key's standard uncertainty from one frame alone, infinite where it says nothing."""
    return float(fit.standard_uncertainty[fit.keys.index(key)]) if key in fit.keys else np.inf
