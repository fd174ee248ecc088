"""A fit of one frame, or of several (`Askable`), with what it shows besides: else nothing is freed.

All that may be there is weighed about the fit (`score.ask`), the fit moves to the likeliest set,
and all is weighed again there. Where the residual is large its slopes say little: then some sets
are told apart by their own fits to blocks of pixels (`trial`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeVar

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import (
    GOOD_CHI,
    HALF,
    POOR_CHI,
    RICHEST,
    FrameData,
    Hypothesis,
    Unevenness,
    weigh,
)
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.causes.cause import OF_PRESSURE, SMOOTH, Cause
from isochrome.fitting.causes.score import (
    LEAST_EVEN,
    LIGHT,
    SHADOW,
    TRACTIONS,
    WAVES,
    Asked,
    ask,
    middle_of,
    names_of,
    sizes_of,
    wave_root,
)
from isochrome.fitting.causes.slips import Slip, explaining_slip, is_lost
from isochrome.fitting.causes.solution import Askable, Change, FrameSolution
from isochrome.fitting.causes.trial import Expected, Trial
from isochrome.fitting.frame.far_model import FAR
from isochrome.fitting.frame.frame_fit import begun_scene, fit_with_model
from isochrome.fitting.frame.renderer import bent_share
from isochrome.fitting.frame.unknowns import StatedInputs, limits
from isochrome.scene import Scene

S = TypeVar("S", bound=Askable)

ADDED = "load.added_tractions"

Members = tuple[int, ...]
"""A set of hypotheses by their numbers."""
_Seen = tuple[frozenset[str], int, bool]
"""A set by its names, how much is left out, and whether it was held against others near the end."""

_LIKELY, _PLAIN, _TRIED, _MOST_TRIALS = 3, 2, 18, 54
"""The likeliest sets, those of causes alone, and all that are tried of these and what is beside
them; trials of all rounds: what as many do not explain is in no list, and what is bent to it takes
the values along."""
_SAME_CHI = 1.01
"""Ratio of chi within which a fit with fewer unknowns must stay."""
_MOST_ODD = 0.15
"""Largest share of the picture's blocks that all rounds may leave out as odd: with more of it out,
what is not there explains the rest."""
_KEPT = 0.25
"""How much of what its slope has promised a step of tractions must bring."""


@dataclass(frozen=True, kw_only=True)
class Freed(Generic[S]):
    """A fit with what its frames showed: `now`, and as `stated` by the scene.

    `causes` that were freed; whether `tractions` that are not the model's were fitted; `odd`
    (rows/3, cols/3), blocks of the picture that were left out; what was `asked` about the fit. Or
    the `slip` in the scene that explains the frame: then the fit's light is none. `alone`, what
    each thing by itself would explain of the residual as stated, the likeliest first.
    """

    now: S
    stated: S
    causes: tuple[Cause, ...] = ()
    tractions: bool = False
    odd: Mask | None = None
    asked: Asked | None = None
    slip: Slip | None = None
    alone: dict[str, float] = field(default_factory=dict)

    @property
    def nearest(self) -> tuple[tuple[str, float], ...]:
        """What the residual as stated looks like most: three names with the share of it that each
        by itself explains. What is named comes first; none where there is no residual to look at.
        """
        if not self.alone:
            return ()
        chances = {name: self.chances.get(name, 0.0) for name in self.alone}
        order = sorted(self.alone, key=lambda name: -chances[name] * (chances[name] >= HALF))
        return tuple((name, self.alone[name]) for name in order[:_LIKELY])

    @property
    def fit(self) -> Any:
        """The fit, a FrameFit or what else the solution is of, less sure by what was asked."""
        return self.now.fit.less_sure(self.asked.undecided) if self.asked else self.now.fit

    @property
    def light(self) -> bool:
        """Whether the light was fitted as uneven."""
        return self.now.uneven is not None

    @property
    def data(self) -> Any:
        """The frame or frames, with the light and the pixels that were taken."""
        return self.now.data

    @property
    def outside(self) -> float:
        """Share of the pixels that was left out."""
        return 0.0 if self.odd is None else 1.0 - self.now.pixels / max(1, self.stated.pixels)

    @property
    def is_plain(self) -> bool:
        """Whether nothing was freed, and nothing left out."""
        return not self.names and self.odd is None

    @property
    def chances(self) -> dict[str, float]:
        """How likely each thing is there, by its name."""
        return self.asked.chances if self.asked else {}

    @property
    def unknown(self) -> tuple[str, ...]:
        """What is fitted that no cause explains, of the names of `WAVES`."""
        waves = self.now.waves
        return () if waves is None else tuple(n for n, part in WAVES.items() if waves[part].any())

    @property
    def names(self) -> frozenset[str]:
        """All that is fitted besides the unknowns."""
        return names_of(self.causes, self.tractions, self.light, self.unknown)

    @property
    def moves(self) -> bool:
        """Whether tractions, or what is unknown, are fitted, which stay as other values move."""
        return self.tractions or bool(self.unknown)

    def weighed(self) -> Freed[S]:
        """The same with all that may be there weighed about it."""
        return replace(self, asked=ask(self.now, self.causes, self.names, self.stated))

    def undone(self) -> Freed[S]:
        """The fit as the scene states it, less sure by all that its frames show."""
        return Freed(now=self.stated, stated=self.stated).weighed()


@dataclass
class _Search:
    """The sets that were `seen` by a search, and how many `trials` it has left."""

    seen: set[_Seen] = field(default_factory=set)
    trials: int = _MOST_TRIALS


@dataclass(frozen=True, eq=False, kw_only=True)
class _Plan:
    """A set to fit: `causes`, tractions of a prior's `root`, how `uneven` the light is, what is
    `unknown` of a prior's root `order`; and `suspects`, which are tried, and never fitted.

    `log_odds` of them, its `members` by number; `starts` of even causes' keys, which have no slope
    at nought. Found by a `trial`, or with the tractions' `values` (k,) and the unknown's `waves`
    (3, k) to first order.
    """

    causes: tuple[Cause, ...] = ()
    suspects: tuple[Cause, ...] = ()
    root: Array | None = None
    unknown: tuple[str, ...] = ()
    order: Array | None = None
    uneven: Unevenness | None = None
    values: Array | None = None
    waves: Array | None = None
    starts: dict[str, float] = field(default_factory=dict)
    log_odds: float = 0.0
    members: Members = ()
    trial: Trial | None = None

    @property
    def names(self) -> frozenset[str]:
        """All that is fitted, by name."""
        lit = self.uneven is not None
        return names_of(self.causes, self.root is not None, lit, self.unknown)

    @property
    def excess(self) -> float:
        """What its trial leaves: the variance over the noise's."""
        return self.trial.excess if self.trial else np.inf

    def log_evidence(self, noise: float) -> float:
        """ln E by its trial, at a variance of the noise."""
        return self.trial.evidence(noise) + self.log_odds if self.trial else -np.inf


def free_causes(solution: S) -> Freed[S]:
    """Move to the likeliest set of what frames show, until the fit has it.

    Parameters: `solution`, their fit. Returns Freed, with the fit that was given where the frames
    show nothing else, or their light came out negative.
    """
    freed = Freed(now=solution, stated=solution)
    if not solution.is_bright:
        return freed
    freed, search = freed.weighed(), _Search()
    stated = freed.asked
    beside = freed.names  # the set beside which blocks were left out
    for _ in range(_MOST_TRIALS):
        moved = _moved(freed, search)
        if isinstance(moved, Asked):
            freed = replace(freed, asked=moved)
            break
        if moved.odd is not freed.odd and moved.names == freed.names:
            beside = moved.names
        freed = moved.weighed()
    if freed.odd is not None and freed.names != beside:
        freed = _with_all_pixels(freed)
    # a frame that nothing explains has no causes, only another scene
    if freed.now.chi > POOR_CHI and not freed.is_plain:
        freed = freed.undone()
    if stated is not None and (solution.chi > GOOD_CHI or freed.names):
        freed = replace(freed, alone=stated.alone)
    return freed


def _moved(freed: Freed[S], search: _Search) -> Freed[S] | Asked:
    """The fit with a likelier set, or without what is odd; what was asked where there is none.

    Near the end tractions come to rest first; from afar what is odd beside them goes, as their
    modes are too wide for the surface, and so does a shadow: light and lens take its fainter rows
    for their own. Other pixels are left out where no set is likelier: what is odd may be where a
    cause is felt most. Sets that were seen are not fitted again.
    """
    asked, seen = freed.asked, search.seen
    assert asked is not None
    near = freed.now.chi < GOOD_CHI
    if near and (nearer := _nearer(freed, asked)):
        return nearer
    if freed.tractions and not near and (without := _left_out(freed, asked.outside)):
        return without
    if SHADOW in asked.best and (without := _left_out(freed, asked.beside)):
        return without
    left = 0 if freed.odd is None else int(freed.odd.sum())
    here = freed.names, left, near
    before = here in seen
    seen.add(here)
    best = _of_members(asked, asked.sets.members[0])
    there = best.names, left, False
    if freed.moves and there not in seen and best.names < freed.names:
        # blocks, by which trials go, are too wide to tell what little more there is
        seen.add(there)
        if (fewer := _with(freed, best)) is not None:
            return fewer
    asked, plans = _plans(freed, asked, best, search, before=before)
    for plan in plans:
        again = plan.names == freed.names
        there = plan.names, left, False
        if there in seen and not plan.names < freed.names and not again:
            continue
        seen.add(there)
        wider = _with(freed, plan)
        if wider is not None and not (again and wider.now.chi * _SAME_CHI > freed.now.chi):
            return wider
    odd, beside = asked.outside, asked.beside
    if odd is not None and beside is not None and _is_shadow(odd, beside):
        odd = odd | beside  # its faint rows are not seen as such
    return _left_out(freed, odd) or (None if near else _nearer(freed, asked)) or asked


def _nearer(freed: Freed[S], asked: Asked) -> Freed[S] | None:
    """The fit with its tractions and order moved on: derivatives turn where these move far; None at
    rest.

    What is not at rest looks like something else.
    """
    if not freed.moves:
        return None
    own = _best_ways(asked, freed.names)
    fall = asked.evidence.fall(own, asked.now)
    # the mean over what is as likely as its noise makes it
    spread = sum(asked.evidence.hypotheses[k].root.shape[1] for k in own)
    nearer = _with(freed, _of_members(asked, own)) if fall > spread else None
    if nearer is None:
        return None
    fell = freed.now.pixels * (freed.now.chi**2 - nearer.now.chi**2)
    return nearer if fell > _KEPT * fall else None


def _left_out(freed: Freed[S], odd: Mask | None) -> Freed[S] | None:
    """The fit without some blocks more; None where there are none, too many, or it is not sound."""
    if odd is None:
        return None
    if freed.odd is not None:
        odd = odd | freed.odd
        if (odd == freed.odd).all():
            return None
    if odd.mean() > _MOST_ODD:
        return None
    try:
        now, left = _again(freed, Change(uneven=freed.now.uneven), odd)
    except PhysicsError:
        return None
    return replace(freed, now=now, odd=left) if now.is_sound else None


def _again(
    freed: Freed[S], change: Change, odd: Mask | None, *, same: bool = False, most: float = np.inf
) -> tuple[S, Mask | None]:
    """The fit with a change and without `odd` blocks, and those that are out.

    What is explained once it is made without them is taken in again, but with the `same` set: it
    explains no more than before. A fit that leaves more than `most`, its chi, is not of use.
    """
    if odd is None:
        return freed.now.again(change), None
    now = freed.now.again(replace(change, outside=odd))
    assert freed.asked is not None
    if same or now.chi > most or _is_shadow(odd, freed.asked.beside):
        return now, odd
    left = now.still_odd(freed.stated, odd)
    if left.sum() == odd.sum():
        return now, odd
    whole = replace(_as_fitted(freed.stated, now), outside=left)
    return freed.stated.again(whole), left if left.any() else None


def _is_shadow(odd: Mask, beside: Mask | None) -> bool:
    """Whether what is odd lies all along the surface."""
    return beside is not None and bool((odd & beside).any(axis=0).mean() > HALF)


def _plans(
    freed: Freed[S], asked: Asked, best: _Plan, search: _Search, *, before: bool
) -> tuple[Asked, list[_Plan]]:
    """Sets that are likelier than what is fitted, the likeliest first, and what is asked by then.

    `best`, the likeliest; `before`, whether what is fitted was held against others once: not again,
    where it is likeliest.
    Where the residual is large its slopes say little, slopes about tractions do not know how these
    would be without another thing, and what has no form follows first slopes farther than causes
    do: then sets are told apart by their trials.
    """
    same, near = best.names == freed.names, freed.now.chi < GOOD_CHI
    unknown = {*best.unknown} - {*freed.unknown}
    if near and not (freed.moves or unknown):
        return asked, [] if same or best.suspects else [best]
    own = best if same else _of_members(asked, _best_ways(asked, freed.names))
    if same and before:
        tried = [] if near or not freed.tractions else _tried(freed, asked, search, [own.members])
    elif near:
        press = {*asked.ways(TRACTIONS)}
        less = [members for members in _with_less(own.members) if press & {*members}]
        less.sort(key=lambda members: -asked.evidence.of(members))
        # what can take any form may have made up for a cause that was missing
        free = press.union(*map(asked.ways, WAVES))
        alone = tuple(k for k in own.members if k not in free)
        fewer = [*less[:1], *([alone] if 0 < len(alone) < len(own.members) else [])]
        sets = [best.members, own.members, *fewer, *(_named(asked) if unknown else [])]
        tried = _tried(freed, asked, search, sets) if fewer or not same else []
    else:
        tried = _tried_from_afar(freed, asked, search, own)
    logs = {plan.members: log for plan, log in tried}
    asked = replace(asked, judged=asked.sets.judged(logs)) if logs else asked
    plans = [plan for plan, _ in tried]
    if plans and plans[0].names == freed.names and plans[0].excess < FAR:
        return asked, []  # what is left lies where blocks do not see it
    usual = [plan.trial.usual_chi for plan in plans if plan.trial]
    if usual and min(freed.now.chi, *usual) > POOR_CHI:
        # none explains a usual block, not what takes any form: others are odd, or it is another
        # scene
        plans = []
    # beside what cannot be fitted nothing else is: it would take that for its own
    plans = plans[: next((k for k, p in enumerate(plans) if p.suspects), None)]
    last = next((k for k, p in enumerate(plans) if p.names == freed.names), len(plans))
    return asked, plans[: last + freed.moves]  # what is fitted, with tractions that are nearer


def _tried_from_afar(
    freed: Freed[S], asked: Asked, search: _Search, own: _Plan
) -> list[tuple[_Plan, float]]:
    """Trials of the likeliest set, of it with one thing less, and of a contact with any pressure;
    then of what else is likely or fitted, with one thing more, or once one explains, one less.

    What is far off looks like two things, and one thing more may be another one. What tractions
    hide is told where these are at rest.
    """
    first, *likely = asked.sets.members[:_LIKELY]
    pressed = [] if asked.modes is None or freed.tractions else _any_pressure(asked, first)
    sets = [first, *_named(asked), *pressed, *_with_less(first)]
    tried = _tried(freed, asked, search, sets)
    best = tried[0][0] if tried else own
    if best.root is not None:
        return tried
    if best.excess < FAR:
        return _tried(freed, asked, search, [*likely, *_with_less(best.members)], tried)
    wider = (_with_one_more(asked, members) for members in (best.members, own.members))
    more = [*likely, own.members, *(members for sets in wider for members in sets[:_LIKELY])]
    return _tried(freed, asked, search, more, tried)


def _named(asked: Asked) -> list[Members]:
    """The likeliest sets of causes alone: what can take any form explains much to first order, and
    hides what a named cause would explain beyond that.
    """
    return list(weigh(asked.evidence, without=(TRACTIONS, *WAVES)).members[:_PLAIN])


def _any_pressure(asked: Asked, first: Members) -> list[Members]:
    """Tractions as large as they may be with a smooth stress, near what most contacts have; and a
    set with one of OF_PRESSURE in place of tractions.
    """
    press = asked.ways(TRACTIONS)
    wider = [k for name in sorted(OF_PRESSURE) for k in asked.ways(name)[:1]]
    others = [k for k in first if k not in (*press, *wider)]
    return [(*asked.ways(SMOOTH.name), press[-2]), *((*others, k) for k in wider)]


def _with_less(members: Members) -> list[Members]:
    """A set without each one thing of it."""
    return [tuple(k for k in members if k != gone) for gone in members]


def _tried(
    freed: Freed[S],
    asked: Asked,
    search: _Search,
    sets: list[Members],
    tried: Sequence[tuple[_Plan, float]] = (),
) -> list[tuple[_Plan, float]]:
    """Some sets with their trials and ln E of these, the likeliest first, with others `tried`.

    From afar tractions are not looked at where something without them explains the frames.
    """
    plans, stated = [plan for plan, _ in tried], freed.stated.scene
    keys = {
        key: (start if cause.stated else middle_of(stated, key), size)
        for cause in asked.causes
        for key, start, size in zip(cause.keys, cause.starts, sizes_of(cause, stated), strict=True)
    }
    for plan in (_of_members(asked, members) for members in sets):
        plain = [p for p in plans if p.root is None]
        explained = freed.now.chi >= GOOD_CHI and any(p.excess < FAR for p in plain)
        seen = any((plan.names, plan.suspects) == (p.names, p.suspects) for p in plans)
        spent = min(_TRIED - len(plans), search.trials) <= 0
        if seen or spent or (explained and plan.root is not None):
            continue
        search.trials -= 1
        every = replace(plan, causes=plan.causes + plan.suspects, values=None, waves=None)
        expected = Expected(keys=keys, root=plan.root, order=plan.order, modes=asked.modes)
        trial = freed.now.trial(_change(freed, every), expected)
        if trial is not None:
            plans.append(replace(plan, trial=trial, values=trial.tractions, waves=trial.waves))
    noise = max(1.0, min((plan.excess for plan in plans), default=1.0))
    return sorted(((p, p.log_evidence(noise)) for p in plans), key=lambda pair: -pair[1])


def _of_members(asked: Asked, members: Members) -> _Plan:
    """A set of hypotheses as it can be fitted."""
    evidence = asked.evidence
    chosen = {h.name: h for h in (evidence.hypotheses[k] for k in members)}
    press = chosen.get(TRACTIONS)
    named = tuple(cause for cause in asked.causes if cause.name in chosen)
    values = evidence.values(members)
    starts: dict[str, float] = {}
    for cause in named:
        if cause.even:
            starts |= _even_starts(cause, values[chosen[cause.name].columns])
    return _Plan(
        causes=tuple(cause for cause in named if cause.free),
        suspects=tuple(cause for cause in named if not cause.free),
        starts=starts,
        root=press.root if press else None,
        uneven=_uneven(asked, members),
        values=values[press.columns] if press else None,
        members=members,
        log_odds=sum(hypothesis.log_odds for hypothesis in chosen.values()),
        **(_unknown(chosen, values) if asked.regions is not None else {}),
    )


def _uneven(asked: Asked, members: Members) -> Unevenness | None:
    """How uneven the light of a set is."""
    for k, light in zip(asked.ways(LIGHT), asked.lights, strict=True):
        if k in members:
            return light._replace(degrees=RICHEST)
    return None


def _unknown(chosen: dict[str, Hypothesis], values: Array) -> dict[str, Any]:
    """What no cause explains of a set: its names, its prior's root, and its waves."""
    names = tuple(name for name in WAVES if name in chosen)
    if not names:
        return {}
    roots = [wave_root(name, chosen[name].root) for name in names]
    waves = [wave_root(name, values[chosen[name].columns][:, None]) for name in names]
    together = np.sum(waves, axis=0).reshape(3, -1)
    return {"unknown": names, "order": np.concatenate(roots, axis=1), "waves": together}


def _even_starts(cause: Cause, values: Array) -> dict[str, float]:
    """Where an even cause's keys begin, from its square and, of plates, the slope by the first."""
    square, *slope = values.tolist()
    least = 0.0 if slope and slope[0] else LEAST_EVEN
    root = max(square, least) ** 0.5
    starts = {key: root * u for key, u in zip(cause.keys, cause.sizes, strict=True)}
    starts[cause.keys[0]] += sum(slope)
    return starts


def _with_one_more(asked: Asked, own: Members) -> list[Members]:
    """Sets with one thing more than what is fitted, the likeliest first."""
    names = [hypothesis.name for hypothesis in asked.evidence.hypotheses]
    there = {names[k] for k in own}
    larger = [_likeliest(asked, name, own) for name in dict.fromkeys(names) if name not in there]
    return sorted(larger, key=lambda members: -asked.evidence.of(members))


def _best_ways(asked: Asked, names: frozenset[str]) -> Members:
    """The likeliest way of each of some things, one after the other."""
    chosen: Members = ()
    for name in sorted(names):
        if asked.ways(name):
            chosen = _likeliest(asked, name, chosen)
    return chosen


def _likeliest(asked: Asked, name: str, beside: Members) -> Members:
    """A set with the likeliest way of a thing more."""
    return max(((*beside, k) for k in asked.ways(name)), key=asked.evidence.of)


def _change(freed: Freed[S], plan: _Plan) -> Change:
    """What makes the fit one with a set, begun where its trial came to rest."""
    now, asked, stated = freed.now, freed.asked, freed.stated.scene
    assert asked is not None
    found = plan.trial.values if plan.trial else plan.starts
    added = {
        key: found.get(key, now.scene.get(key) or start)
        for cause in plan.causes
        for key, start in zip(cause.keys, cause.starts, strict=True)
        if key not in now.keys
    }
    gone = [key for c in freed.causes if c not in plan.causes for key in c.keys]
    held: dict[str, Any] = {key: stated.get(key) for key in gone}
    if asked.modes is not None:
        held[ADDED] = None if plan.values is None else asked.modes.added(plan.values)
    rest = plan.trial.values if plan.trial else {}
    if plan.trial is None and now.chi < GOOD_CHI and len({*now.unknown_keys}) == len(now.values):
        move = asked.along @ (asked.evidence.values(plan.members) - asked.now)
        ends = limits(now.scene, now.unknown_keys)
        moved = np.clip(now.values + move, ends.low, ends.high)
        rest = dict(zip(now.unknown_keys, moved.tolist(), strict=True))
    begun = {key: rest[key] for key in now.keys if key in rest and key not in held}
    return Change(
        added=added,
        held=held,
        begun=begun,
        uneven=plan.uneven,
        waves=np.zeros((3, 1)) if plan.waves is None else plan.waves,
        far=plan.trial is None and plan.names != freed.names,
    )


def _with(freed: Freed[S], plan: _Plan) -> Freed[S] | None:
    """The fit with a set, None where it is not sound, or no better with more unknowns."""
    fewer, same = not (plan.names - freed.names), plan.names == freed.names
    most = freed.now.chi * (_SAME_CHI if fewer else 1.0)
    try:
        now, odd = _again(freed, _change(freed, plan), freed.odd, same=same, most=most)
    except PhysicsError:
        return None
    if not now.is_sound or now.chi > most:
        return None
    return replace(freed, now=now, causes=plan.causes, tractions=plan.root is not None, odd=odd)


def _as_fitted(stated: Askable, now: Askable) -> Change:
    """What makes the fit as stated one that has all that is fitted now."""
    added = {key: now.scene.get(key) for key in now.keys if key not in stated.keys}
    # what each frame has of its own begins where it was
    rows = {key: now.values_of_key(key) for key in now.keys if key in stated.keys}
    begun = {key: row[0][0] for key, row in rows.items() if len(row) == 1}
    tractions = now.scene.added_tractions
    held = {} if tractions is None else {ADDED: tractions}
    return Change(added=added, held=held, begun=begun, uneven=now.uneven, waves=now.waves)


def _with_all_pixels(freed: Freed[S]) -> Freed[S]:
    """With what was odd before its cause was known, where it is odd no more: a blur, no shadow."""
    try:
        whole = freed.stated.again(_as_fitted(freed.stated, freed.now))
    except PhysicsError:
        return freed
    if not whole.is_sound or whole.chi > _SAME_CHI * freed.now.chi:
        return freed
    again = replace(freed, now=whole, odd=None).weighed()
    assert again.asked is not None
    return freed if again.asked.outside is not None or SHADOW in again.asked.best else again


def fit_with_causes(
    data: FrameData,
    scene: Scene,
    keys: tuple[str, ...] | None = None,
    *,
    cold: bool = True,
    slips: bool = True,
    stated: StatedInputs | None = None,
    past: bool = False,
) -> Freed[FrameSolution]:
    """Fit a frame, and free what it asks for besides its `keys`, by default `free_keys`.

    As `fit_frame`, whose errors it raises; `slips`, whether a slip in the scene is looked for where
    the scene explains nothing; `past`, whether another friction before, which the block's scar
    remembers, may be freed.
    """
    data = data.less_sure(bent_share(begun_scene(scene, data.shape), data.shape))
    try:
        fitted = fit_with_model(data, scene, keys, cold=cold, stated=stated)
    except PhysicsError as error:
        slip = explaining_slip(data, scene, keys, np.inf) if slips else None
        if slip is None:
            raise
        raise PhysicsError(slip.sentence()) from error
    given = data.with_noise(fitted.fit.noise_ratio / data.noise_ratio)
    data = given.as_fitted(fitted.fit.scene)
    lost = is_lost(fitted)
    freed = None if lost else free_causes(FrameSolution(data, fitted, past=past))
    # a slip costs more to look for than all causes, and what they explain has none
    if slips and (freed is None or freed.now.chi > POOR_CHI):
        begun = (given, scene) if lost else (data, fitted.fit.scene)
        slip = explaining_slip(*begun, keys, fitted.fit.chi, lost=lost)
        if slip is not None:
            dark = replace(fitted, fit=replace(fitted.fit, positive=False))
            unlit = FrameSolution(data, dark)
            return Freed(now=unlit, stated=unlit, slip=slip)
    return freed or free_causes(FrameSolution(data, fitted, past=past))
