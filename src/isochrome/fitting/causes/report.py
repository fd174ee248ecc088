"""What is said of the causes that frames asked for: what was freed, and what is suspected."""

from __future__ import annotations

from typing import Any

from isochrome.fitting.causes.cause import Cause
from isochrome.fitting.causes.freeing import Freed
from isochrome.fitting.causes.score import Asked
from isochrome.fitting.causes.solution import Askable
from isochrome.fitting.causes.trials import lying_otherwise
from isochrome.fitting.frame.unknowns import FRICTION, LOAD, TANGENTIAL
from isochrome.output import per_cent, with_uncertainty
from isochrome.scene import Scene

_FAR = 4.0
"""Standard uncertainties from what is stated that chance does not explain."""

_LEAST_SHIFT = 1e-6
"""Change of the load below which nothing is said of it."""


def cause_messages(freed: Freed[Any]) -> tuple[str, ...]:
    """Say what was freed in one frame, or in several together, and what is suspected and cannot be.

    Parameters
    ----------
    freed : Freed
        A fit with what its frames asked for.

    Returns
    -------
    tuple of str
        A sentence for the causes, for richer light, for what was left out, and for suspects; one
        alone for a slip in the scene.
    """
    if freed.slip is not None:
        return (freed.slip.sentence(),)
    own = tuple(cause for cause in freed.causes if not cause.weight)
    messages = [_freed_sentence(freed, own)] if own else []
    messages += [_stated_sentence(freed, cause) for cause in freed.causes if cause.weight]
    if freed.light:
        messages.append(
            f"{freed.now.light_words}; no-load frames (frames.no_load_bright, no_load_dark) show "
            "it as it is"
        )
    if freed.outside:
        messages.append(
            f"{per_cent(freed.outside)} of the pixels were left out: dust, scratches, glare or "
            "a shadow that no light and no fringe explains"
        )
    if messages:
        messages[0] += _shift(freed)
    louder = freed.now.noise_ratio
    if louder > 1.0:
        messages.append(
            f"noise is {louder:.1f} times what neighbouring pixels show: the picture was "
            "compressed, resampled or made of colours, and that is counted"
        )
    suspects = [asked for asked in freed.asked if not asked.can_be_freed]
    if suspects:
        messages.append(_suspect_sentence(freed.now, suspects))
    return tuple(messages)


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
    return (
        f"{key} = {with_uncertainty(value, spread)} has the other sign than the scene's "
        f"{stated:g}: the other body slides the other way, or the picture is mirrored left to "
        f"right; if it is mirrored, give {line}, else the other sign in the scene"
    )


def _who(solution: Askable) -> str:
    return "the frame" if solution.count == 1 else "the frames"


def _verb(solution: Askable, verb: str) -> str:
    """What one frame does, or several."""
    return f"{_who(solution)} {verb}{'s' * (solution.count == 1)}"


def _said(solution: Askable, key: str) -> str:
    """A key with its value, or with the least and the most of several frames' own."""
    found = sorted(solution.values_of_key(key))
    return f"{key} = " + " to ".join(
        with_uncertainty(*pair) for pair in dict.fromkeys((found[0], found[-1]))
    )


def _stated_sentence(freed: Freed[Any], cause: Cause) -> str:
    """What the frame says of the values that are stated with their uncertainties."""
    now = freed.now
    values = ", ".join(_said(now, key) for key in cause.keys)
    text = (
        f"{_verb(now, 'tell')} more of {len(cause.keys)} stated value(s) than their uncertainties: "
        f"fitted too, with these as priors ({values})"
    )
    away = {
        key: (now.values_of_key(key)[0][0] - stated) * weight**0.5
        for key, stated, weight in zip(cause.keys, cause.starts, cause.weight, strict=True)
    }
    far = [f"{key} by {pull:+.1f}" for key, pull in away.items() if abs(pull) > _FAR]
    if far:
        text += (
            f"; {', '.join(far)} of its stated standard uncertainties off, which no measurement "
            "is: measure again, or look for what else is wrong"
        )
    return text


def _freed_sentence(freed: Freed[Any], causes: tuple[Cause, ...]) -> str:
    """What was freed, by name, key and value."""
    parts = []
    for cause in causes:
        values = ", ".join(_said(freed.now, key) for key in cause.keys)
        parts.append(f"{cause.name} ({values})")
    shows = _verb(freed.now, "show")
    return f"{shows} {' and '.join(parts)}, fitted too; state it in the scene to fix it"


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
    wrong = "camera.pixel_mm, specimen.fringe_value_n_per_mm or a size of the specimen"
    if scene.indenter is not None:
        wrong += ", the moduli or indenter.radius_mm"
    return (
        f"{_verb(solution, 'contradict')} the scale ({' or '.join(parts)} would mend it): {wrong} "
        f"is wrong, and {_who(solution)} cannot tell which; measure them again, the load depends "
        "on it"
    )
