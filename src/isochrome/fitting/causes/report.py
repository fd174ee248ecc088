"""What is said of the causes that frames asked for: what was freed, and what is suspected."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from isochrome.fitting.causes.cause import Cause
from isochrome.fitting.causes.freeing import Freed
from isochrome.fitting.causes.score import Asked
from isochrome.fitting.causes.solution import Askable
from isochrome.fitting.causes.trials import lying_otherwise
from isochrome.fitting.frame.frame_fit import FrameFit
from isochrome.fitting.frame.unknowns import FRICTION, LOAD, PIXEL, TANGENTIAL, taken_as_exact
from isochrome.messages import message
from isochrome.output import agree, per_cent, with_uncertainty
from isochrome.scene import Scene

_FAR = 4.0
"""Standard uncertainties from what is stated that chance does not explain."""

_LEAST_SHIFT = 1e-6
"""Change of the load below which nothing is said of it."""


_SMALL = 0.1
"""Of a friction, or another plain number, what is little."""

_MOVED, _GROWN = 0.005, 1.5
"""Share of a value by which richer light must move it, or its ± be and grow by so much, where it is
said for what it changes alone."""


def cause_messages(
    freed: Freed[Any], *, rivals: Mapping[str, tuple[str, ...]] | None = None, light: bool = True
) -> tuple[str, ...]:
    """Say what was freed in one frame, or in several together, and what is suspected and cannot be.

    Parameters
    ----------
    freed : Freed
        A fit with what its frames asked for.
    rivals : mapping of str to tuple of str, optional
        Causes that the frame cannot tell from those that were freed, see `rival_causes`.
    light : bool, default True
        Whether richer light is said where it was taken.

    Returns
    -------
    tuple of str
        A sentence for the causes, for richer light, for what was left out, and for suspects; one
        alone for a slip in the scene.
    """
    if freed.slip is not None:
        return (freed.slip.sentence(),)
    own = tuple(cause for cause in freed.causes if not cause.weight)
    messages = [_freed_sentence(freed, own, rivals or {})] if own else []
    messages += [text for text in map(partial(_contradicted, freed), freed.causes) if text]
    if freed.light and light:
        messages.append(message("no_load_frames_frames", light_words=freed.now.light_words))
    if freed.outside:
        messages.append(message("pixels_left_out_dust", per_cent=per_cent(freed.outside)))
    if messages:
        messages[0] += _shift(freed)
    louder = freed.now.noise_ratio
    if louder > 1.0:
        messages.append(message("noise_times_what_neighbouring", louder=louder))
    suspects = [asked for asked in freed.asked if not asked.can_be_freed]
    if suspects:
        messages.append(_suspect_sentence(freed.now, suspects))
    return tuple(messages)


def light_matters(freed: Freed[Any]) -> bool:
    """Tell whether richer light changes a value of a frame, or its uncertainty, noticeably.

    Parameters
    ----------
    freed : Freed
        One frame's fit with what it asked for.

    Returns
    -------
    bool
        Whether a value moves by half a per cent and more than four of its uncertainties, or its
        uncertainty is half a per cent of it and grows by half. Places are judged by the pixel, and
        a friction by a tenth at least.
    """
    before, now = freed.stated.fit, freed.fit
    pixel = now.scene.camera.pixel_mm if now.scene.camera else None
    for key in set(before.keys) & set(now.keys):
        (first, spread), (last, wider) = (
            (float(fit.values[k]), float(fit.standard_uncertainty[k]))
            for fit in (before, now)
            for k in (fit.keys.index(key),)
        )
        size = 100.0 * (pixel or 0.0) if key.endswith("_mm") else max(abs(last), _SMALL)
        moved = abs(last - first) > max(_MOVED * size, _FAR * wider)
        if moved or (wider > _MOVED * size and wider > _GROWN * spread):
            return True
    return False


def opposite_shear(given: Scene, key: str, value: float, spread: float) -> str | None:
    """What to say where a frame shows the shear that its scene states, the other way.

    A picture mirrored left to right is that of a cylinder which slides the other way: no frame
    tells one from the other.

    Parameters
    ----------
    given : Scene
        The scene of the frame as it was given.
    key : str
        An unknown.
    value, spread : float
        What was found of it, and its standard uncertainty.

    Returns
    -------
    str or None
        A sentence; None where the shear points as stated, is not stated, or is not seen.
    """
    stated = given.get(key) if key in (FRICTION, TANGENTIAL) else None
    if not stated or stated * value >= 0.0 or not abs(value) > _FAR * spread:
        return None
    line, _ = lying_otherwise(given, 0, "horizontal")
    return message(
        "has_other_sign_scene",
        key=key,
        with_uncertainty=with_uncertainty(value, spread),
        stated=stated,
        line=line,
    )


def _who(solution: Askable) -> str:
    return "the frame" if solution.count == 1 else "the frames"


def _verb(solution: Askable, verb: str) -> str:
    """What one frame does, or several."""
    return f"{_who(solution)} {verb}{'s' * (solution.count == 1)}"


def _said(solution: Askable, key: str) -> str:
    """A key with its value, or with the least and the most of several frames' own."""
    result = sorted(solution.values_of_key(key))
    return f"{key} = " + " to ".join(
        with_uncertainty(*pair) for pair in dict.fromkeys((result[0], result[-1]))
    )


def _contradicted(freed: Freed[Any], cause: Cause) -> str:
    """What the frame says against values that are stated with their uncertainties; '' if nothing.

    Those that agree with it are refined, which is no cause.
    """
    far = [
        f"{_told(freed, key)}, stated as {with_uncertainty(value, weight**-0.5)}"
        for key, value, weight in zip(cause.keys, cause.starts, cause.weight, strict=False)
        if not agree(_pair(freed, key), (value, weight**-0.5))
    ]
    return message(
        "what_stated_value_more",
        verb=_verb(freed.now, "contradict"),
        far_count=len(far),
        far="; ".join(far),
    ) * bool(far)


def _freed_sentence(
    freed: Freed[Any], causes: tuple[Cause, ...], rivals: Mapping[str, tuple[str, ...]]
) -> str:
    """What was freed, by name, key and value, and what it may be instead."""
    parts = []
    for cause in causes:
        values = ", ".join(_told(freed, key) for key in cause.keys)
        others = " or ".join(rivals.get(cause.name, ()))
        name = message("cannot_tell_which_fitted", name=cause.name, others=others)
        parts.append(f"{name if others else cause.name} ({values})")
    if any(cause.name in rivals for cause in causes):
        asks = _verb(freed.now, "ask")
        return message("look_bench_before_you", asks=asks, parts=" and for ".join(parts))
    shows = _verb(freed.now, "show")
    return message("fitted_too_state_scene", shows=shows, parts=" and ".join(parts))


def _told(freed: Freed[Any], key: str) -> str:
    """A key with its value and the uncertainty that the results have, which is not the fit's alone:
    causes that the frame neither asks for nor excludes are counted.
    """
    if not isinstance(freed.fit, FrameFit):  # of several frames, or of the only one of a film
        return _said(freed.now, key)
    return f"{key} = {with_uncertainty(*_pair(freed, key))}"


def _pair(freed: Freed[Any], key: str) -> tuple[float, float]:
    """Value and standard uncertainty of a key; the first of several frames' own."""
    fit, now = freed.fit, freed.now
    if not isinstance(fit, FrameFit):
        first: tuple[float, float] = now.values_of_key(key)[0]
        return first
    place = fit.keys.index(key)
    return float(fit.values[place]), float(fit.standard_uncertainty[place])


def _shift(freed: Freed[Any]) -> str:
    """What the load would have been as the scene stood."""
    before, now = freed.stated, freed.now
    text = f"; chi = {before.chi:.2f} as stated, {now.chi:.2f} now"
    if LOAD not in before.keys or LOAD not in now.keys:
        return text
    pairs = zip(before.values_of_key(LOAD), now.values_of_key(LOAD), strict=True)
    shares = [old / new - 1.0 for (old, _), (new, _) in pairs]
    most = max(shares, key=abs)
    if abs(most) > _LEAST_SHIFT:
        out = "comes out" if len(shares) == 1 else "comes out up to"
        text += f"; as stated, {LOAD} {out} {100.0 * most:+.2g} % off"
    return text


def _suspect_sentence(solution: Askable, suspects: list[Asked]) -> str:
    """The lengths and moduli that a frame contradicts, of which it cannot tell which is wrong."""
    scene, parts = solution.scene, []
    for asked in suspects:
        assert asked.cause is not None
        (key,), (value,) = asked.cause.keys, asked.values
        parts.append(f"{key} {100.0 * value / float(scene.get(key)):+.2g} %")
    open_ = [
        key
        for key in taken_as_exact(scene, solution.keys, tracked=True)
        if key.startswith((PIXEL, "specimen.", "indenter.")) and not scene.uncertainties.get(key)
    ]
    wrong = " or ".join(filter(None, (", ".join(open_[:-1]), open_[-1])))
    return message(
        "scale_would_mend_wrong",
        verb=_verb(solution, "contradict"),
        parts=" or ".join(parts),
        wrong=wrong,
        who=_who(solution),
    )
