"""What frames show besides their unknowns: sets of nuisances, weighed by one linearisation.

About a fit the columns of all that may be there are taken at the frame's blocks, without a new fit;
`isochrome.estimation.evidence` weighs the sets. What is freed already is one of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from isochrome.estimation import (
    FIRST_DEGREES,
    LIGHT_FALLS,
    Nuisance,
    Regions,
    ScoreProducts,
    Unevenness,
    Weighed,
    cosine_spread,
    weighed,
)
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.causes.blocks import COSINES, SHADOW_BLOCKS, FrameBlocks
from isochrome.fitting.causes.cause import (
    OF_PRESSURE,
    OF_SIZE,
    RARE,
    SCALE,
    STATED,
    STIFF,
    Cause,
    candidates,
)
from isochrome.fitting.causes.modes import LENGTHS, SIZES, TractionModes
from isochrome.fitting.frame.unknowns import GAMMA
from isochrome.scene import Scene

if TYPE_CHECKING:
    from isochrome.fitting.causes.solution import Askable

LIGHT, TRACTIONS = "more uneven light", "tractions that are not the model's"
ORDER, SHADOW = "an order that no cause explains", "a shadow on the surface"
STRESS = "a stress that no cause explains"
WAVES = {ORDER: slice(1), STRESS: slice(1, None)}
"""What no list has, by name, and which waves it is of: see `with_waves`."""

_NOT_COUNTED = (STATED, SCALE.name, STIFF.name)
"""What no ± holds as something that may be there: what is stated counts by the sensitivity to it,
and what is taken as exact is said to be."""
_SHADOW_SIZE, _SHADOW_LENGTH = 0.2, 2.0
"""Standard deviation of the light that a shadow takes, and over how many blocks it is alike."""
WIDTHS = LENGTHS[:-1]
"""Lengths of what no cause explains, of the picture's size: the largest is the light's."""
LEAST_EVEN = 0.1
"""Least square, of its size's, at which an even cause begins, and is taken to stand where it is
fitted: it has no slope at nought."""


def names_of(
    causes: tuple[Cause, ...], tractions: bool, light: bool, unknown: tuple[str, ...]
) -> frozenset[str]:
    """What is fitted besides the unknowns, by name; `unknown`, of the names of `WAVES`."""
    others = [TRACTIONS] * tractions + [LIGHT] * light
    return frozenset((*(cause.name for cause in causes), *others, *unknown))


@dataclass(frozen=True, kw_only=True)
class Asked(Weighed):
    """What frames show besides what is fitted. `causes` that may be there; `outside`, the blocks
    (rows, cols) that no noise explains, and `beside`, those at the surface; `modes` of a contact's
    tractions; `order_power` (k, k), the mean products of an unknown order's waves; `excess`, the
    residual's squares over those of noise; the `lights` that may be there; the `regions` of one
    frame, which may have waves of its own. Its sets are `judged` where trials tell them apart.
    """

    causes: tuple[Cause, ...]
    order_power: Array
    excess: float = np.inf
    lights: tuple[Unevenness, ...] = ()
    outside: Mask | None = None
    beside: Mask | None = None
    modes: TractionModes | None = None
    regions: Regions | None = None

    @cached_property
    def undecided(self) -> Array:
        """The same, and where the form of what is fitted is not known, for what that assumes."""
        total, regions = super().undecided, self.regions
        if regions is None or not WAVES.keys() & self.best:
            return total
        more, at = np.zeros(len(total)), regions.unknowns
        more[at] = np.maximum(0.0, regions.variance(self) - np.diag(total)[at])
        return np.asarray(total + np.diag(more))

    @property
    def best(self) -> frozenset[str]:
        """What is there in the likeliest set."""
        return frozenset(hypothesis.name for hypothesis in self.sets.best)

    @property
    def chances(self) -> dict[str, float]:
        """How likely each is there. A pressure that is wider or narrower as a whole is the
        tractions' where these are there: no frame tells whether it is a modulus's, a layer's, or of
        a body that was worn.
        """
        result = dict(self.sets.chances)
        for index, weight in enumerate(self.sets.weights.tolist()):
            names = {hypothesis.name for hypothesis in self.sets.named(index)}
            for name in OF_PRESSURE & names if TRACTIONS in names else ():
                result[name] -= weight
        return result

    def ways(self, name: str) -> list[int]:
        """Numbers of the hypotheses that something is there."""
        return [k for k, way in enumerate(self.evidence.hypotheses) if way.name == name]

    @cached_property
    def alone(self) -> dict[str, float]:
        """The share of the excess that each thing by itself explains, about a fit that has none of
        them, to first order: the likeliest thing first.
        """
        evidence, best = self.evidence, dict[str, tuple[float, float]]()
        for k, hypothesis in enumerate(evidence.hypotheses):
            log = evidence.of((k,))
            if log > best.get(hypothesis.name, (-np.inf, 0.0))[0]:
                share = self.noise * evidence.explained((k,)) / self.excess
                best[hypothesis.name] = log, min(1.0, max(0.0, share))
        order = sorted(best, key=lambda name: -best[name][0])
        return {name: best[name][1] for name in order}

    @property
    def order_size(self) -> float:
        """Root mean square of the order that no cause explains, fringes, in its likeliest sets."""
        ways = self.evidence.hypotheses
        columns = {k: way.columns for k, way in enumerate(ways) if way.name in WAVES}
        members = next(m for m in self.sets.members if columns.keys() & set(m))
        first, *_, last = columns.values()
        values = self.evidence.values(members)[first.start : last.stop]
        return float(np.sqrt(values @ self.order_power @ values))


def ask(
    solution: Askable, freed: tuple[Cause, ...], fitted: frozenset[str], stated: Askable
) -> Asked:
    """What the frames show, `freed` and `fitted` or not, besides what is `stated`."""
    causes = candidates(stated.scene, stated.keys, stated.held, past=stated.past)
    nuisances: list[Nuisance] = []
    modes: TractionModes | None = None
    lights: tuple[Unevenness, ...] = ()
    power = np.empty((0, 0))
    odd: list[tuple[Mask, Mask | None]] = []
    excess: list[float] = []
    regions: Regions | None = None
    unknowns = solution.unknown_keys
    added = {key for cause in freed for key in cause.keys}
    shared = np.array([key not in added for key in unknowns], dtype=bool)
    wanted = np.flatnonzero(shared)
    weight, misfit = solution.prior.misfit(solution.values)

    def parts() -> Iterator[tuple[Array, Array, Array, Array]]:
        nonlocal modes, power, regions, lights
        for blocks in solution.blocks():
            if not nuisances:
                modes = blocks.modes if _has_own_tractions(solution, stated.scene) else None
                lit = solution.uneven or Unevenness(blocks.brightness, 0.0, FIRST_DEGREES)
                # as one of them it is fitted
                lights = tuple(lit._replace(fall=fall) for fall in LIGHT_FALLS)
                nuisances.extend(_nuisances(solution, blocks, lights, causes, freed, stated))
                power = blocks.order_waves @ blocks.order_waves.T / len(blocks.residual)
            odd.append((blocks.outliers, blocks.beside))
            excess.append(blocks.excess)
            columns = np.concatenate([n.columns(blocks) for n in nuisances])
            light, rows, every, residual = blocks.part(columns)
            light = light[blocks.data.lamp.weights == 0.0]
            if solution.count == 1:
                regions = Regions(
                    region=blocks.region,
                    fitted=np.concatenate((light, rows[shared])),
                    unknowns=wanted,
                    columns=every,
                    residual=residual,
                )
            yield light, rows[shared], every, residual
        size = sum(len(n.now) for n in nuisances)
        fixed = np.diag(weight)[:, shared].T
        yield np.empty((0, len(weight))), fixed, np.zeros((size, len(weight))), misfit

    products = ScoreProducts(parts())
    found = weighed(
        nuisances,
        products,
        noise=max(products.noise, float(np.mean(excess))),
        fitted=fitted,
        chance=RARE,
        unknowns=wanted,
        size=len(shared),
    )
    outside = np.logical_or.reduce([mask for mask, _ in odd])  # dust lies on the glass
    return Asked(
        **vars(found),
        causes=causes,
        order_power=power,
        excess=products.count * max(products.noise - 1.0, np.finfo(float).tiny),
        lights=lights,
        regions=regions,
        outside=outside if outside.any() else None,
        beside=odd[0][1],
        modes=modes,
    )


def _nuisances(
    solution: Askable,
    blocks: FrameBlocks,
    lights: tuple[Unevenness, ...],
    causes: tuple[Cause, ...],
    freed: tuple[Cause, ...],
    stated: Askable,
) -> Iterator[Nuisance]:
    """All that may be there in frames like `blocks`."""
    for cause in causes:
        if cause in freed:
            yield _fitted_cause(solution, cause, stated.scene)
        else:
            yield _open_cause(blocks, cause)
    yield _light(blocks, lights)
    waves = np.zeros((3, COSINES**2)) if solution.waves is None else solution.waves
    spreads = [cosine_spread(COSINES, width) for width in WIDTHS]
    for name, part in WAVES.items():
        now = waves[part]
        yield Nuisance(
            name=name,
            columns=partial(FrameBlocks.wave_columns, part=part),
            now=now.ravel(),
            roots=tuple(np.diag(np.tile(spread, len(now))) for spread in spreads),
            sizes=SIZES[:-1],
        )
    if blocks.beside is not None:
        depth = np.arange(SHADOW_BLOCKS)
        apart = (depth[:, None] - depth[None, :]) / _SHADOW_LENGTH
        root = np.linalg.cholesky(np.exp(-0.5 * apart**2) + 1e-9 * np.eye(len(depth)))
        yield Nuisance(
            name=SHADOW,
            columns=FrameBlocks.shadow_columns,
            now=np.zeros(len(depth)),
            roots=(_SHADOW_SIZE * root,),
        )
    if _has_own_tractions(solution, stated.scene):
        modes = blocks.modes
        yield Nuisance(
            name=TRACTIONS,
            columns=FrameBlocks.traction_columns,
            now=modes.values_of(solution.scene.added_tractions),
            roots=tuple(map(modes.root, LENGTHS)),
            sizes=SIZES,
        )


def _has_own_tractions(solution: Askable, stated: Scene) -> bool:
    """Whether they may be there: each frame has its own, and what is stated is known."""
    return stated.is_contact and solution.count == 1 and stated.added_tractions is None


def _open_cause(blocks: FrameBlocks, cause: Cause) -> Nuisance:
    """A cause that is not fitted: at nought."""
    roots: tuple[Array, ...] = (
        np.eye(1) if cause.even else np.diag(sizes_of(cause, blocks.scene)),
    )
    if cause.even and len(cause.keys) > 1:  # plates turned alike, or one of them
        roots = np.array([[1.0], [0.0]]), np.array([[0.0], [cause.sizes[0]]])
    return Nuisance(
        name=cause.name,
        columns=lambda blocks: blocks.columns(cause),
        now=np.zeros(len(roots[0])),
        roots=roots,
        positive=cause.positive,
        exact=cause.name in _NOT_COUNTED,
    )


def _fitted_cause(solution: Askable, cause: Cause, stated: Scene) -> Nuisance:
    """A cause that is fitted, by the rows of its unknowns; an even one's effect is of second order,
    half of its slope times its value.
    """
    sizes = dict(zip(cause.keys, sizes_of(cause, stated), strict=True))
    middles = dict(zip(cause.keys, cause.starts, strict=True)) if cause.stated else {}
    keys = solution.unknown_keys
    rows = [row for row, key in enumerate(keys) if key in sizes]
    middle = [middles.get(keys[row], middle_of(stated, keys[row])) for row in rows]
    off, spread = solution.values[rows] - middle, np.array([sizes[keys[row]] for row in rows])
    exact = cause.name in _NOT_COUNTED
    if not cause.even:
        return Nuisance(
            name=cause.name,
            columns=lambda blocks: blocks.rows[rows],
            now=off,
            roots=(np.diag(spread),),
            positive=cause.positive,
            unknowns=tuple(rows),
            weights=np.zeros(0 if exact else len(rows)),
            exact=exact,
        )
    off = np.copysign(np.maximum(np.abs(off), LEAST_EVEN**0.5 * spread), off)
    size = float(np.mean((off / spread) ** 2))
    return Nuisance(
        name=cause.name,
        columns=lambda blocks: blocks.effect(cause) / np.float32(size),
        now=np.array([size]),
        roots=(np.eye(1),),
        positive=True,
        unknowns=tuple(rows),
        of_each=(0.5 * off)[None, :] / size,
        weights=np.zeros(1),
    )


def _light(blocks: FrameBlocks, lights: tuple[Unevenness, ...]) -> Nuisance:
    """The light's products besides the first ones: all where it is fitted so, else some."""
    lamp = blocks.data.lamp
    fitted = lamp.uneven is not None
    lamp = lamp if fitted else lamp.of(lights[0])
    more = lamp.weights > 0.0

    def columns(blocks: FrameBlocks) -> Array:
        if fitted:
            return np.asarray(blocks.light_rows[more])
        return np.asarray(blocks.light_columns(*blocks.light_images(lamp))[more])

    return Nuisance(
        name=LIGHT,
        columns=columns,
        now=blocks.light_values[more] if fitted else np.zeros(np.count_nonzero(more)),
        roots=tuple(np.diag(replace(lamp, uneven=light).weights[more] ** -0.5) for light in lights),
        weights=lamp.weights[more] if fitted else np.zeros(0),
    )


def sizes_of(cause: Cause, scene: Scene) -> list[float]:
    """Standard deviations of a cause's keys, in their units."""
    return [
        size * float(scene.get(key)) if key in OF_SIZE and not cause.stated else size
        for key, size in zip(cause.keys, cause.sizes, strict=True)
    ]


def middle_of(scene: Scene, key: str) -> float:
    """What a scene says of a key that is not stated with an uncertainty."""
    return scene.frames.first_gamma if key == GAMMA else float(scene.get(key) or 0.0)


def wave_root(name: str, root: Array) -> Array:
    """L (3k, r) of all waves for a prior's root of some of them."""
    every = np.zeros((3, COSINES**2, root.shape[1]))
    every[WAVES[name]] = root.reshape(-1, *every.shape[1:])
    return every.reshape(-1, root.shape[1])
