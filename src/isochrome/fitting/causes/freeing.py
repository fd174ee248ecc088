"""A fit of one frame, or of several (`Askable`), with what it asks for: else nothing is freed."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import (
    FEW_TERMS,
    HALF,
    LITTLE,
    MOST_TERMS,
    POOR_CHI,
    FrameData,
    evidence_gain,
    stays_poor,
)
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.causes.cause import GEOMETRY, LOOK, Cause, candidates
from isochrome.fitting.causes.score import Asked, LightTerms, ask, richer_light
from isochrome.fitting.causes.solution import Askable, Change, FrameSolution, change_for
from isochrome.fitting.causes.trials import Trial, explaining_slip, is_unexplained
from isochrome.fitting.frame.frame_fit import fit_with_model
from isochrome.fitting.frame.unknowns import GAMMA, LENS, StatedInputs
from isochrome.scene import Scene

S = TypeVar("S", bound=Askable)

_ROUNDS, _PRUNINGS = 6, 3
_LARGE, _STRONG = 1.03, 500.0
"""Residual over noise, and evidence, from which a cause is no small step: each is then tried by its
own fit, for where the surface or a fringe moves by a pixel its slope says little."""
_TRIED = 5
_CLEAR = 4.0
"""Standard uncertainties from what is stated below which a cause is not kept free."""
_SAME_CHI = 1.01
"""Ratio of chi within which a fit without a needless cause must stay."""
_RIM = 2
"""Blocks by which what may be in a shadow is wider than what is in its deepest part."""
_LIGHTS = 4
"""How often light is made richer in a row: what is asked for changes a little with the fit."""


@dataclass(frozen=True, kw_only=True)
class Freed(Generic[S]):
    """A fit with what its frames asked for.

    Parameters
    ----------
    now : Askable
        The fit, with the light and the pixels that were taken.
    stated : Askable
        The fit as the scene states it.
    causes : tuple of Cause, optional
        Those that were freed, in order.
    light : bool, default False
        Whether the light was made richer.
    odd : ndarray of bool, (rows/3, cols/3), optional
        Blocks of the picture that were left out.
    late : bool, default False
        Whether some were left out after other things had been fitted to them.
    asked : tuple of Asked, optional
        What the frames still ask for and is not freed.
    undecided : ndarray, (p, p), optional
        What the covariance lacks for causes and light that the frames neither ask for nor exclude.
    slip : Trial, optional
        The slip in the scene that explains the frame where the scene does not. The fit's light is
        none then: `positive` is False.
    """

    now: S
    stated: S
    causes: tuple[Cause, ...] = ()
    light: bool = False
    odd: Mask | None = None
    late: bool = False
    asked: tuple[Asked, ...] = ()
    undecided: Array | None = None
    slip: Trial | None = None

    @property
    def fit(self) -> Any:
        """The fit: a FrameFit, or what else the solution is of."""
        return self.now.fit if self.undecided is None else self.now.fit.less_sure(self.undecided)

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
        return not (self.causes or self.light) and self.odd is None

    @cached_property
    def richer(self) -> LightTerms:
        """The light that the frames ask for most, which is both tried and taken first."""
        return richer_light(self.now.blocks(), self.now.terms, FEW_TERMS)

    def undone(self) -> Freed[S]:
        """The fit as the scene states it, less sure by all that its frames ask for."""
        return Freed(now=self.stated, stated=self.stated, undecided=_asked(self.stated)[1])


def free_causes(solution: S) -> Freed[S]:
    """Free what frames ask for, one cause after the other, until they ask for nothing.

    Parameters: `solution`, their fit. Returns Freed, with the fit that was given where the frames
    ask for nothing, or their light came out negative.
    """
    freed = Freed(now=solution, stated=solution)
    if not solution.is_bright:
        return freed
    freed = _settled(freed)
    if freed.late:
        freed = _anew(freed)
    if freed.odd is not None and freed.causes:
        freed = _whole_again(freed)
    # a frame that nothing explains has no causes, only another scene
    more = any(asked.can_be_freed for asked in freed.asked)
    return freed.undone() if more and freed.now.chi > POOR_CHI else freed


def _settled(freed: Freed[S]) -> Freed[S]:
    """What is asked for freed, without what comes out at nothing."""
    for _ in range(_PRUNINGS):
        freed = _freed(freed)
        fewer = _pruned(freed)
        if fewer is freed:
            break
        freed = fewer  # without what was needless, something else may be asked for
    return freed


def _anew(freed: Freed[S]) -> Freed[S]:
    """All that is asked for freed once more, without what is odd from the beginning.

    Light that was made rich on a shadow, and causes that were fitted to it, hide what is beside it.
    """
    try:
        clean = freed.stated.again(Change(outside=freed.odd))
    except PhysicsError:
        return freed
    again = _settled(Freed(now=clean, stated=freed.stated, odd=freed.odd))
    return again if again.now.is_sound and again.now.chi < _SAME_CHI * freed.now.chi else freed


def _whole_again(freed: Freed[S]) -> Freed[S]:
    """With what was odd before its cause was known, where it is odd no more: a blur, no shadow."""
    new = {k: freed.now.scene.get(k) for k in freed.now.keys if k not in freed.stated.keys}
    try:
        whole = freed.stated.again(Change(added=new, terms=freed.now.terms))
    except PhysicsError:
        return freed
    if not whole.is_sound or whole.chi > _SAME_CHI * freed.now.chi:
        return freed
    asked, undecided = _asked(whole)
    if any(item.outside is not None for item in asked):
        return freed
    return replace(freed, now=whole, odd=None, asked=asked, undecided=undecided)


def _freed(freed: Freed[S]) -> Freed[S]:
    """What is asked for freed, one after the other, the one with the most evidence first."""
    for _ in range(_ROUNDS):
        asked, undecided = _asked(freed.now)
        freed = replace(freed, asked=asked, undecided=undecided)
        wider = _widest(freed, asked)
        if wider is None:
            break
        freed = wider
    return freed


def _asked(now: Askable) -> tuple[tuple[Asked, ...], Array]:
    """What a fit's frames ask for, see `ask`."""
    causes = candidates(now.scene, now.keys, now.held, past=now.past)
    return ask(now.blocks(), causes, now.scene, now.terms, now.stated_misfit)


def _widest(freed: Freed[S], asked: tuple[Asked, ...]) -> Freed[S] | None:
    """The fit with the best of what is asked for, None where none of it can be freed."""
    open_ = tuple(a for a in asked if a.can_be_freed)
    if not open_:
        return None
    suspected = not asked[0].can_be_freed
    slight = freed.now.chi < _LARGE and asked[0].evidence < _STRONG
    if suspected and slight:
        return None
    order = open_ if slight else _tried(freed, open_)
    # what is odd is left out where the best two of the others come to nothing
    for item in (*order[:2], *(a for a in order[2:] if a.outside is not None)):
        wider = _with(freed, item)
        if suspected and wider is not None:
            # a wrong scale is not how a camera looks, though that may explain some of it
            wider = wider if all(a.can_be_freed for a in _asked(wider.now)[0]) else None
        # what is odd may hide what a cause explains: a trial has told that without it
        alone = item.outside is not None
        if wider is not None and not (alone and stays_poor(freed.now.chi, wider.now.chi, LITTLE)):
            return wider
    return None


def _with(freed: Freed[S], asked: Asked) -> Freed[S] | None:
    """The fit with one more cause, None where that is no better."""
    before = freed.now
    try:
        now = before.again(_change(freed, asked))
    except PhysicsError:
        return None
    # a cause whose value is stated moves within what is stated, and odd blocks are no unknowns
    told = asked.outside is not None or bool(asked.cause is not None and asked.cause.weight)
    if not (now.is_sound and now.chi < before.chi and (told or _pays(before, now))):
        return None
    if asked.terms is not None and not stays_poor(before.chi, now.chi, HALF):
        now = _with_all_light(now)
    parts = () if asked.cause is None else GEOMETRY if asked.cause is LOOK else (asked.cause,)
    if parts and not any(_is_felt(now, cause, freed.stated.scene) for cause in parts):
        return None
    odd = freed.odd
    if asked.outside is not None:
        odd = asked.outside if odd is None else odd | asked.outside
    return replace(
        freed,
        now=now,
        causes=(*freed.causes, *(c for c in parts if c not in freed.causes)),
        light=freed.light or asked.terms is not None,
        odd=odd,
        late=freed.late or (asked.outside is not None and bool(freed.causes or freed.light)),
        asked=(),
        undecided=None,
    )


def _pays(before: Askable, now: Askable) -> bool:
    """Whether a fit with more unknowns is as much better as the residual's slope has promised.

    It is not where what is asked for only looks like it: blocks of a compressed picture, like blur.
    """
    sides = [
        (fit.chi**2, len(fit.keys) + fit.count * sum(map(len, fit.terms))) for fit in (before, now)
    ]
    return evidence_gain(*sides, pixels=now.pixels) > 0.0


def _change(freed: Freed[S], asked: Asked) -> Change:
    """What makes the fit one with what is asked for."""
    return change_for(freed.now, asked, freed.richer if asked.terms is not None else None)


def _with_all_light(solution: S) -> S:
    """A fit whose light is made as rich as its frames ask for."""
    with suppress(PhysicsError):  # what cannot be fitted is not asked for
        for _ in range(_LIGHTS):
            terms = richer_light(solution.blocks(), solution.terms, MOST_TERMS)
            again = solution if terms == solution.terms else solution.again(Change(terms=terms))
            if again is solution or not again.is_sound or again.chi > solution.chi:
                break
            solution = again
    return solution


def _tried(freed: Freed[S], asked: tuple[Asked, ...]) -> tuple[Asked, ...]:
    """What is asked for by the evidence of its own fit to some pixels, the best first.

    Blocks that no noise explains may be dust, or where a cause is felt most: all are compared
    without them, and they are left out only where nothing else explains the others.
    """
    out = [a for a in asked if a.outside is not None]
    lens = [a for a in asked if a.cause is not None and a.cause.keys[0] in LENS]
    lights = [a for a in asked if a.terms is not None]
    tried = [a for a in asked if a.cause is not None and a not in lens][:_TRIED]
    tried += lights[:1] + [replace(a, cause=LOOK) for a in lens[:1]]
    causes = [item for item in tried if item.cause is not None]
    if out and out[0].shadow is not None and not _explained(freed, causes, out[0].shadow):
        return tuple(out)
    outside = out[0].outside if out else None
    base = freed.now.trial(Change(outside=outside))
    if base is None:
        return ()
    scored, before = [], float(np.sqrt(base[0]))
    for item in tried:
        result = freed.now.trial(replace(_change(freed, item), outside=outside))
        # what leaves few pixels unexplained leaves all of them so, at a hundred times the cost
        if result is not None and not stays_poor(before, float(np.sqrt(result[0])), LITTLE):
            scored.append((evidence_gain(base[:2], result[:2], pixels=base[2]), item))
    scored.sort(key=lambda pair: -pair[0])
    return (*(item for gain, item in scored if gain > 0.0), *out)


def _explained(freed: Freed[S], asked: list[Asked], band: Mask) -> bool:
    """Whether one cause takes up most of what the noise does not explain, a shadow or none.

    Causes that are fitted to rows in a shadow take its fainter rows for their own, and light grows
    rich on them: where none explains them, they are left out before any is freed.
    """
    rim = np.zeros_like(band)
    rim[:-_RIM] = band[_RIM:]  # a blur hides the darkest rows
    base = freed.now.trial(Change(outside=rim))
    result = (freed.now.trial(replace(_change(freed, item), outside=rim)) for item in asked)
    least = np.inf if base is None else 1.0 + HALF * (base[0] - 1.0)
    return any(trial is not None and trial[0] < least for trial in result)


def _is_felt(now: Askable, cause: Cause, stated: Scene) -> bool:
    """Whether a cause came out at more than nothing, and more than is worth an unknown."""
    if cause.weight:
        return True  # what is known of it stands beside it: it may be nothing, and costs nothing
    for key in cause.keys:
        nothing = stated.frames.first_gamma if key == GAMMA else 0.0
        if any(abs(v - nothing) > max(_CLEAR * u, cause.least) for v, u in now.values_of_key(key)):
            return True
    return False


def _pruned(freed: Freed[S]) -> Freed[S]:
    """Without the causes that came out at nothing beside the others."""
    now, stated = freed.now, freed.stated.scene
    needless = tuple(c for c in freed.causes if not _is_felt(now, c, stated))
    if not needless:
        return freed
    held = {key: stated.get(key) for cause in needless for key in cause.keys}
    again = now.again(Change(held=held))
    if not again.is_bright or again.chi > _SAME_CHI * now.chi:
        return freed
    causes = tuple(cause for cause in freed.causes if cause not in needless)
    # without some, others may come out at nothing too
    return _pruned(replace(freed, now=again, causes=causes, undecided=None))


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
    """Fit a frame, and free what it asks for besides its unknowns.

    Parameters
    ----------
    data : FrameData
        The frame.
    scene : Scene
        One state (see `frame_scene`), where the fit starts.
    keys : tuple of str, (p,), optional
        The unknowns, by default `free_keys`.
    cold : bool, default True
        False to search only where the scene's own values lead to no light at all.
    slips : bool, default True
        Whether a slip in the scene is looked for where the scene explains nothing.
    stated : StatedInputs, optional
        What is known beforehand, by default what the scene states.
    past : bool, default False
        Whether another friction before, which the block's scar remembers, may be freed.

    Returns
    -------
    Freed
        The fit with what was freed, the light and the pixels that it took, and the fit as stated.

    Raises
    ------
    InputError
        For a key that cannot be free.
    PhysicsError
        Where no values give fringes of the right contrast.
    """
    try:
        fitted = fit_with_model(data, scene, keys, cold=cold, stated=stated)
    except PhysicsError as error:
        slip = explaining_slip(data, scene, keys, np.inf) if slips else None
        if slip is None:
            raise
        raise PhysicsError(slip.sentence()) from error
    given = data = data.with_noise(fitted.fit.noise_ratio / data.noise_ratio)
    if fitted.fit.scene.frames.stated_gamma != data.gamma:
        data = data.toned(fitted.fit.scene.frames.stated_gamma)
    if slips and is_unexplained(fitted):
        slip = explaining_slip(given, scene, keys, fitted.fit.chi)
        if slip is not None:
            lost = replace(fitted, fit=replace(fitted.fit, positive=False))
            unlit = FrameSolution(data, lost)
            return Freed(now=unlit, stated=unlit, slip=slip)
    return free_causes(FrameSolution(data, fitted, past=past))
