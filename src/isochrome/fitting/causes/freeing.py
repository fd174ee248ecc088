"""A frame's fit with what the frame itself asks for: nothing is freed where nothing is asked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import (
    FEW_TERMS,
    HALF,
    LITTLE,
    MOST_TERMS,
    POOR_CHI,
    FrameData,
    Terms,
    evidence_gain,
    stays_poor,
)
from isochrome.fitting.arrays import Array
from isochrome.fitting.causes.blocks import BLOCK
from isochrome.fitting.causes.cause import GEOMETRY, LOOK, Cause
from isochrome.fitting.causes.score import Asked, ask, richer_light
from isochrome.fitting.causes.trials import Trial, explaining_slip, is_unexplained
from isochrome.fitting.frame.frame_estimate import FrameFit
from isochrome.fitting.frame.frame_fit import (
    Fitted,
    fit_with_model,
    hidden_px,
)
from isochrome.fitting.frame.frame_model import FrameModel, refine_fit
from isochrome.fitting.frame.inputs import StatedInputs
from isochrome.fitting.frame.single_state import with_numerics
from isochrome.fitting.frame.unknowns import GAMMA, LENS, fit_region, values_of
from isochrome.scene import Scene
from isochrome.stress import pixel_grid

_ROUNDS, _PRUNINGS = 6, 3
_LARGE = 1.03
"""Residual over noise from which a cause is no small step: each is then tried by its own fit."""
_TRIED = 5
_CLEAR = 3.5
"""Standard uncertainties from what is stated below which a cause is not kept free."""
_SAME_CHI = 1.01
"""Ratio of chi within which a fit without a needless cause must stay."""
_PASSES = 12
_RIM_PX = 2.0
_LIGHTS = 4
"""How often light is made richer in a row: what is asked for changes a little with the fit."""


@dataclass(frozen=True, kw_only=True)
class Freed:
    """A fit with what its frame asked for.

    Parameters
    ----------
    data : FrameData
        The frame, with the light and the pixels that were taken.
    fitted : Fitted
        Its fit.
    given : FrameData
        The frame as the scene states it.
    stated : Fitted
        Its fit then.
    causes : tuple of Cause, optional
        Those that were freed, in order.
    light : bool, default False
        Whether the light was made richer.
    outside : float, default 0.0
        Share of the pixels that was left out.
    asked : tuple of Asked, optional
        What the frame still asks for and is not freed.
    undecided : ndarray, (p, p), optional
        What the covariance lacks for causes and light that the frame neither asks for nor excludes.
    slip : Trial, optional
        The slip in the scene that explains the frame where the scene does not. The fit's light is
        none then: `positive` is False.
    """

    data: FrameData
    fitted: Fitted
    given: FrameData
    stated: Fitted
    causes: tuple[Cause, ...] = ()
    light: bool = False
    outside: float = 0.0
    asked: tuple[Asked, ...] = ()
    undecided: Array | None = None
    slip: Trial | None = None

    @property
    def fit(self) -> FrameFit:
        """The fit."""
        fit = self.fitted.fit
        return fit if self.undecided is None else fit.less_sure(self.undecided)

    @cached_property
    def richer(self) -> tuple[Terms, Terms]:
        """The light that the frame asks for most, which is both tried and taken first."""
        return richer_light(self.data, self.fitted, FEW_TERMS)

    def undone(self) -> Freed:
        """The fit as the scene states it."""
        return Freed(data=self.given, fitted=self.stated, given=self.given, stated=self.stated)


def free_causes(data: FrameData, fitted: Fitted) -> Freed:
    """Free what a frame asks for, one cause after the other, until it asks for nothing.

    Parameters: `data`, a frame; `fitted`, its fit. Returns Freed, with the fit that was given where
    the frame asks for nothing, or its light came out negative.
    """
    freed = Freed(data=data, fitted=fitted, given=data, stated=fitted)
    if not fitted.fit.positive or fitted.fit.plain:
        return freed
    for _ in range(_PRUNINGS):
        freed = _freed(freed)
        fewer = _pruned(freed)
        if fewer is freed:
            break
        freed = fewer  # without what was needless, something else may be asked for
    more = any(asked.can_be_freed for asked in freed.asked)
    # a frame that nothing explains has no causes, only another contact or another scene
    return freed.undone() if more and freed.fit.chi > POOR_CHI else freed


def _freed(freed: Freed) -> Freed:
    """What is asked for freed, one after the other, the one with the most evidence first."""
    for _ in range(_ROUNDS):
        asked, undecided = ask(freed.data, freed.fitted)
        freed = replace(freed, asked=asked, undecided=undecided)
        wider = _widest(freed, asked)
        if wider is None or stays_poor(freed.fit.chi, wider.fit.chi, LITTLE):
            break
        freed = wider
    return freed


def _widest(freed: Freed, asked: tuple[Asked, ...]) -> Freed | None:
    """The fit with the best of what is asked for, None where none of it can be freed."""
    open_ = tuple(a for a in asked if a.can_be_freed)
    if not open_ or not asked[0].can_be_freed:
        return None
    order = open_ if freed.fit.chi < _LARGE else _tried(freed, open_)
    for item in order[:2]:
        wider = _with(freed, item)
        if wider is not None:
            return wider
    return None


def _with(freed: Freed, asked: Asked) -> Freed | None:
    """The fit with one more cause, None where that is no better."""
    data, keys, scene = _wider(freed, asked)
    try:
        fitted = fit_with_model(data, scene, keys, cold=False, stated=freed.stated.stated)
    except PhysicsError:
        return None
    fit = fitted.fit
    clear = bool(np.isfinite(fit.standard_uncertainty).all())
    if not (fit.positive and not fit.plain and clear and fit.chi < freed.fit.chi):
        return None
    if asked.terms is not None and not stays_poor(freed.fit.chi, fit.chi, HALF):
        data, fitted = _with_all_light(data, fitted)
    fit = fitted.fit
    parts = () if asked.cause is None else GEOMETRY if asked.cause is LOOK else (asked.cause,)
    if parts and not any(_is_felt(fit, cause, freed.stated.fit.scene) for cause in parts):
        return None
    outside = freed.outside
    if asked.outside is not None:
        outside = 1.0 - data.valid.sum() / max(1, freed.data.valid.sum()) * (1.0 - outside)
    return replace(
        freed,
        data=data,
        fitted=replace(fitted, fit=replace(fit, others=freed.fit.others)),
        causes=(*freed.causes, *(c for c in parts if c not in freed.causes)),
        light=freed.light or asked.terms is not None,
        outside=float(outside),
        asked=(),
        undecided=None,
    )


def _with_all_light(data: FrameData, fitted: Fitted) -> tuple[FrameData, Fitted]:
    """A frame whose light is made as rich as it asks for, and its fit."""
    for _ in range(_LIGHTS):
        terms = richer_light(data, fitted, MOST_TERMS)
        if terms == data.lamp.terms:
            break
        more = replace(data, lamp=data.lamp.of(terms))
        fit = fitted.fit
        again = fit_with_model(more, fit.scene, fit.keys, cold=False, stated=fitted.stated)
        if not again.fit.positive or again.fit.chi > fit.chi:
            break
        data, fitted = more, again
    return data, fitted


def _wider(freed: Freed, asked: Asked) -> tuple[FrameData, tuple[str, ...], Scene]:
    """Data, unknowns and scene to begin with, for what is asked."""
    data, fit = freed.data, freed.fit
    if asked.outside is not None:
        rows, cols = data.valid.shape
        # each block lies about its pixel
        out = np.repeat(np.repeat(asked.outside, BLOCK, 0), BLOCK, 1)
        out = np.pad(out, ((0, BLOCK), (0, BLOCK)), mode="edge")[1 : rows + 1, 1 : cols + 1]
        return replace(data, valid=data.valid & ~out), fit.keys, fit.scene
    if asked.cause is None:
        return replace(data, lamp=data.lamp.of(freed.richer)), fit.keys, fit.scene
    pairs = zip(asked.cause.keys, asked.cause.starts, strict=True)
    start = {key: fit.scene.get(key) or value for key, value in pairs if key not in fit.keys}
    return data, (*fit.keys, *start), fit.scene.with_values(start)


def _tried(freed: Freed, asked: tuple[Asked, ...]) -> tuple[Asked, ...]:
    """What is asked for by the evidence of its own fit to some pixels, the best first.

    Blocks that no noise explains may be dust, or where a cause is felt most: all are compared
    without them, and they are left out only where nothing else explains the others.
    """
    out = [a for a in asked if a.outside is not None]
    lens = [a for a in asked if a.cause is not None and a.cause.keys[0] in LENS]
    lights = [a for a in asked if a.terms is not None]
    tried = [a for a in asked if a.cause is not None and a not in lens][:_TRIED]
    tried += lights[:1] + [replace(a, cause=LOOK) for a in lens[:1]]
    valid = _wider(freed, out[0])[0].valid if out else freed.data.valid
    stated = freed.stated.stated
    base = _thin_fit(replace(freed.data, valid=valid), freed.fit.keys, freed.fit.scene, stated)
    if base is None:
        return ()
    scored, before = [], float(np.sqrt(base[0]))
    for item in tried:
        data, keys, scene = _wider(freed, item)
        found = _thin_fit(replace(data, valid=valid), keys, scene, stated)
        # what leaves few pixels unexplained leaves all of them so, at a hundred times the cost
        if found is not None and not stays_poor(before, float(np.sqrt(found[0])), LITTLE):
            scored.append((evidence_gain(base[:2], found[:2], pixels=base[2]), item))
    scored.sort(key=lambda pair: -pair[0])
    return (*(item for gain, item in scored if gain > 0.0), *out)


def _thin_fit(
    data: FrameData, keys: tuple[str, ...], scene: Scene, stated: StatedInputs
) -> tuple[float, int, int] | None:
    """Mean squared residual, unknowns and pixels of a fit to every third pixel."""
    # a lens hides some rows more: all are compared without them
    hidden = hidden_px(scene) + (_RIM_PX if pixel_grid(scene, data.shape).lens is None else 0.0)
    region = fit_region(scene, data.shape, BLOCK, hidden)
    try:
        prior = stated.prior(keys)
        model = FrameModel(data, with_numerics(scene), keys, region, stride=BLOCK, prior=prior)
        found = refine_fit(model, values_of(scene, keys), tolerance=0.5, iterations=_PASSES)
    except PhysicsError:
        return None
    if found is None or not found.toned.part.positive:
        return None
    size = model.pixels.size
    return found.cost / size, len(keys) + len(found.toned.part.coefficients), size


def _is_felt(fit: FrameFit, cause: Cause, stated: Scene) -> bool:
    """Whether a cause came out at more than nothing, and more than is worth an unknown."""
    if cause.weight:
        return True  # what is known of it stands beside it: it may be nothing, and costs nothing
    for key in cause.keys:
        k = fit.keys.index(key)
        away = abs(fit.values[k] - (stated.frames.first_gamma if key == GAMMA else 0.0))
        if away > max(_CLEAR * fit.standard_uncertainty[k], cause.least):
            return True
    return False


def _pruned(freed: Freed) -> Freed:
    """Without the causes that came out at nothing beside the others."""
    fit, stated = freed.fitted.fit, freed.stated.fit.scene
    needless = tuple(c for c in freed.causes if not _is_felt(fit, c, stated))
    if not needless:
        return freed
    gone = {key for cause in needless for key in cause.keys}
    keys = tuple(key for key in fit.keys if key not in gone)
    scene = fit.scene.with_values({key: stated.get(key) for key in gone})
    again = fit_with_model(freed.data, scene, keys, cold=False, stated=freed.stated.stated)
    if not again.fit.positive or again.fit.chi > _SAME_CHI * fit.chi:
        return freed
    again = replace(again, fit=replace(again.fit, others=fit.others))
    causes = tuple(cause for cause in freed.causes if cause not in needless)
    # without some, others may come out at nothing too
    return _pruned(replace(freed, fitted=again, causes=causes, undecided=None))


def fit_with_causes(
    data: FrameData,
    scene: Scene,
    keys: tuple[str, ...] | None = None,
    *,
    cold: bool = True,
    stated: StatedInputs | None = None,
) -> Freed:
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
    stated : StatedInputs, optional
        What is known beforehand, by default what the scene states.

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
        slip = explaining_slip(data, scene, keys, np.inf)
        if slip is None:
            raise
        raise PhysicsError(slip.sentence()) from error
    given = data = data.with_noise(fitted.fit.noise_ratio / data.noise_ratio)
    if fitted.fit.scene.frames.stated_gamma != data.gamma:
        data = data.toned(fitted.fit.scene.frames.stated_gamma)
    if is_unexplained(fitted):
        slip = explaining_slip(given, scene, keys, fitted.fit.chi)
        if slip is not None:
            lost = replace(fitted, fit=replace(fitted.fit, positive=False))
            return Freed(data=data, fitted=lost, given=data, stated=lost, slip=slip)
    return free_causes(data, fitted)
