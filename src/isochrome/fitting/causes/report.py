"""What is said of the causes that frames asked for: what was freed, and what is suspected."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from isochrome.fitting.causes.cause import OF_PRESSURE, Cause
from isochrome.fitting.causes.freeing import Freed
from isochrome.fitting.causes.score import TRACTIONS, WAVES
from isochrome.fitting.causes.slips import lying_otherwise
from isochrome.fitting.causes.solution import Askable
from isochrome.fitting.frame.frame_fit import FrameFit
from isochrome.fitting.frame.unknowns import (
    FRICTION,
    LOAD,
    PIXEL,
    PLANE,
    TANGENTIAL,
    taken_as_exact,
)
from isochrome.messages import message
from isochrome.output import agree, per_cent, with_uncertainty
from isochrome.scene import Scene

NAMED, SUSPECTED = 0.9, 0.3
"""Chances from which something is there, and from which it may be."""

_FAR = 4.0
"""Standard uncertainties from what is stated that chance does not explain."""

_LEAST_SHIFT = 1e-6
"""Change of the load below which nothing is said of it."""


_SMALL = 0.1
"""Of a friction, or another plain number, what is little."""

_MOVED, _GROWN = 0.005, 1.5
"""Share of a value by which richer light must move it, or its ± be and grow by so much, where it is
said for what it changes alone."""


def cause_messages(freed: Freed[Any], *, light: bool = True) -> tuple[str, ...]:
    """What was freed in one frame, or in several together, and what is suspected and cannot be. A
    sentence for the causes, for richer `light` where it is to be told, for what was left out, and
    for suspects; one alone for a slip in the scene.
    """
    if freed.slip is not None:
        return (freed.slip.sentence(),)
    own = tuple(cause for cause in freed.causes if not cause.stated)
    messages = [_freed_sentence(freed, own, rival_causes(freed))] if own else []
    if PLANE in freed.now.keys:
        messages.append(_plane_sentence(freed))
    if freed.tractions:
        messages.append(_traction_sentence(freed))
    if freed.unknown:
        messages.append(_unknown_sentence(freed))
    messages += [text for text in map(partial(_contradicted, freed), freed.causes) if text]
    if freed.light and light:
        messages.append(message("no_load_frames_frames"))
    if freed.outside:
        messages.append(message("pixels_left_out_dust", per_cent=per_cent(freed.outside)))
    if messages:
        messages[0] += _shift(freed)
    louder = freed.now.frames[0].noise_ratio
    if louder > 1.0:
        messages.append(message("noise_times_what_neighbouring", louder=louder))
    return (*messages, *_suspicions(freed))


def rival_causes(freed: Freed[Any]) -> dict[str, tuple[str, ...]]:
    """What may be there instead of freed causes, by name, below a chance of 0.9."""
    if freed.slip is not None or freed.asked is None:
        return {}
    sets, result = freed.asked.sets, dict[str, tuple[str, ...]]()
    for cause in freed.causes:
        if cause.name in OF_PRESSURE and freed.tractions:
            result[cause.name] = (TRACTIONS,)
            continue
        left = 1.0 - freed.chances[cause.name]
        if cause.stated or left <= 1.0 - NAMED:
            continue
        instead: dict[str, float] = {}
        for index, weight in enumerate(sets.weights.tolist()):
            names = {hypothesis.name for hypothesis in sets.named(index)}
            for name in () if cause.name in names else names - freed.names:
                instead[name] = instead.get(name, 0.0) + weight
        likely = [name for name, weight in instead.items() if weight > SUSPECTED * left]
        if likely:
            result[cause.name] = tuple(sorted(likely, key=lambda name: -instead[name]))
    return result


def light_matters(freed: Freed[Any]) -> bool:
    """Whether richer light changes a value of a frame, or its uncertainty, noticeably. A value
    moves by half a per cent and more than four of its uncertainties, or its uncertainty is half a
    per cent of it and grows by half: of places by the pixel, of a friction by a tenth.
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
    """What to say where a frame shows the shear that its `given` scene states, the other way. By
    the `value` that was found of a key. A picture mirrored left to right is that of a cylinder
    which slides the other way: no frame tells one from the other. None where the shear points as
    stated, is not stated, or is not seen.
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


def _contradicted(freed: Freed[Any], cause: Cause) -> str:
    """What the frame says against stated values; '' where they agree, which refines them."""
    rows = zip(cause.keys, cause.starts, cause.sizes, strict=True) if cause.stated else ()
    far = [
        f"{_told(freed, key)}, stated as {with_uncertainty(value, spread)}"
        for key, value, spread in rows
        if not agree(_estimates(freed, key)[0], (value, spread))
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
    """A key with its value; of several frames' own the least and the most."""
    values = sorted(_estimates(freed, key))
    ends = dict.fromkeys((values[0], values[-1]))
    return f"{key} = " + " to ".join(with_uncertainty(*pair) for pair in ends)


def _estimates(freed: Freed[Any], key: str) -> list[tuple[float, float]]:
    """Values of a key with the result's uncertainty: causes that may be there count too."""
    fit = freed.fit
    if not isinstance(fit, FrameFit):  # of several frames, or of the only one of a film
        return list(freed.now.values_of_key(key))
    place = fit.keys.index(key)
    return [(float(fit.values[place]), float(fit.standard_uncertainty[place]))]


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


def _plane_sentence(freed: Freed[Any]) -> str:
    """Which plane a plate is in, if one of the two is likelier than 0.9."""
    value, spread = _estimates(freed, PLANE)[0]
    share = with_uncertainty(value, spread)
    off = {"strain": value / spread, "stress": (1.0 - value) / spread}
    plane, other = sorted(off, key=off.__getitem__)
    if off[plane] > _FAR:
        return message("frames_lie_between_planes", who=_verb(freed.now, "show"), share=share)
    if off[other] ** 2 - off[plane] ** 2 < 2.0 * np.log(NAMED / (1.0 - NAMED)):
        who = "the frame does" if freed.now.count == 1 else "the frames do"
        return message("frames_leave_plane_open", who=who, share=share)
    return message("frames_show_plane", who=_verb(freed.now, "show"), plane=plane, share=share)


def _traction_sentence(freed: Freed[Any]) -> str:
    """How far the tractions are from the model's, of the model's largest pressure."""
    assert freed.asked is not None and freed.asked.modes is not None
    modes, scene = freed.asked.modes, freed.now.scene
    press, shear = np.abs(modes.values_of(scene.added_tractions)).reshape(2, -1).max(axis=1)
    return message(
        "tractions_not_model",
        shows=_verb(freed.now, "show"),
        pressure=per_cent(press / modes.largest_mpa),
        shear=per_cent(shear / modes.largest_mpa),
    )


def _unknown_sentence(freed: Freed[Any]) -> str:
    """How much of the order no cause explains."""
    assert freed.asked is not None
    who, size = _verb(freed.now, "hold"), freed.asked.order_size
    return message("frames_hold_unknown_order", who=who, size=size)


def _suspicions(freed: Freed[Any]) -> list[str]:
    """What may be there and was not fitted: scales, an order that nothing explains, and others."""
    asked, messages = freed.asked, []
    if asked is None:
        return []
    names = [
        name
        for name, chance in sorted(asked.chances.items(), key=lambda pair: -pair[1])
        if chance > SUSPECTED and name not in freed.names
    ]
    scales = [c for c in asked.causes if c.name in names and not c.free]
    if scales:
        messages.append(_scale_sentence(freed, scales))
    if WAVES.keys() & names and not freed.unknown:
        messages.append(_unknown_sentence(freed))
    told = {*WAVES, *(cause.name for cause in scales)}
    told = told.union(*rival_causes(freed).values())
    other = [f"{n} ({per_cent(asked.chances[n])})" for n in names if n not in told]
    if other:
        messages.append(message("frames_may_show", who=_who(freed.now), parts=" or ".join(other)))
    return messages


def _scale_sentence(freed: Freed[Any], suspects: list[Cause]) -> str:
    """The lengths and moduli that a frame contradicts, of which it cannot tell which is wrong."""
    solution, parts = freed.now, []
    scene = solution.scene
    assert freed.asked is not None
    for cause in suspects:
        (key,) = cause.keys
        value = float(freed.asked.sets.values_of(cause.name)[0])
        parts.append(f"{key} {100.0 * value / float(scene.get(key)):+.2g} %")
    open_ = [
        key
        for key in taken_as_exact(scene, solution.keys, tracked=True)
        if key.startswith((PIXEL, "specimen.", "indenter.")) and not scene.uncertainties.get(key)
    ]
    return message(
        "scale_would_mend_wrong",
        verb=_verb(solution, "contradict"),
        parts=" or ".join(parts),
        wrong=" or ".join(filter(None, (", ".join(open_[:-1]), open_[-1]))),
        who=_who(solution),
    )
