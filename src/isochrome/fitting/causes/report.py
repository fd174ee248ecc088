"""What is said of the causes that a frame asked for: what was freed, and what is suspected."""

from __future__ import annotations

from isochrome.fitting.causes.cause import Cause
from isochrome.fitting.causes.freeing import Freed
from isochrome.fitting.causes.score import Asked
from isochrome.fitting.frame.frame_estimate import FrameFit
from isochrome.fitting.frame.unknowns import LOAD
from isochrome.output import with_uncertainty
from isochrome.scene import Scene

_FAR = 4.0
"""Standard uncertainties from what is stated that chance does not explain."""

_LEAST_SHIFT = 1e-6
"""Change of the load below which nothing is said of it."""


def cause_messages(freed: Freed) -> tuple[str, ...]:
    """Say what was freed in a frame, and what is suspected and cannot be.

    Parameters
    ----------
    freed : Freed
        A fit with what its frame asked for.

    Returns
    -------
    tuple of str
        A sentence for the causes, for richer light, for what was left out, and for suspects; one
        alone for a slip in the scene.
    """
    if freed.slip is not None:
        return (freed.slip.sentence(),)
    before = freed.stated.fit
    own = tuple(cause for cause in freed.causes if not cause.weight)
    messages = [_freed_sentence(freed, own)] if own else []
    messages += [_stated_sentence(freed, cause) for cause in freed.causes if cause.weight]
    if freed.light:
        messages.append(
            f"{freed.data.lamp.words}; no-load frames (frames.no_load_bright, no_load_dark) show "
            "it as it is"
        )
    if freed.outside:
        messages.append(
            f"{100.0 * freed.outside:.1f} % of the pixels were left out: dust, scratches, glare or "
            "a shadow that no light and no fringe explains"
        )
    if messages:
        messages[0] += _shift(before, freed)
    if freed.fit.noise_ratio > 1.0:
        messages.append(
            f"noise is {freed.fit.noise_ratio:.1f} times what neighbouring pixels show: the "
            "picture was compressed, resampled or made of colours, and that is counted"
        )
    suspects = [asked for asked in freed.asked if not asked.can_be_freed]
    if suspects:
        messages.append(_suspect_sentence(freed.fit.scene, suspects))
    return tuple(messages)


def _values(fit: FrameFit) -> dict[str, tuple[float, float]]:
    """Value and standard uncertainty by key."""
    pairs = zip(fit.values.tolist(), fit.standard_uncertainty.tolist(), strict=True)
    return dict(zip(fit.keys, pairs, strict=True))


def _stated_sentence(freed: Freed, cause: Cause) -> str:
    """What the frame says of the values that are stated with their uncertainties."""
    at = _values(freed.fit)
    values = ", ".join(f"{key} = {with_uncertainty(*at[key])}" for key in cause.keys)
    text = (
        f"the frame tells more of {len(cause.keys)} stated value(s) than their uncertainties: "
        f"fitted too, with these as priors ({values})"
    )
    away = {
        key: (at[key][0] - stated) * weight**0.5
        for key, stated, weight in zip(cause.keys, cause.starts, cause.weight, strict=True)
    }
    far = [f"{key} by {pull:+.1f}" for key, pull in away.items() if abs(pull) > _FAR]
    if far:
        text += (
            f"; {', '.join(far)} of its stated standard uncertainties off, which no measurement "
            "is: measure again, or look for what else is wrong"
        )
    return text


def _freed_sentence(freed: Freed, causes: tuple[Cause, ...]) -> str:
    """What was freed, by name, key and value."""
    at = _values(freed.fit)
    parts = []
    for cause in causes:
        values = ", ".join(f"{key} = {with_uncertainty(*at[key])}" for key in cause.keys)
        parts.append(f"{cause.name} ({values})")
    return f"the frame shows {' and '.join(parts)}, fitted too; state it in the scene to fix it"


def _shift(before: FrameFit, freed: Freed) -> str:
    """What the load would have been as the scene stood."""
    text = f"; chi = {before.chi:.2f} as stated, {freed.fit.chi:.2f} now"
    if LOAD not in before.keys or LOAD not in freed.fit.keys:
        return text
    old, new = (float(f.values[f.keys.index(LOAD)]) for f in (before, freed.fit))
    share = old / new - 1.0
    if abs(share) > _LEAST_SHIFT:
        text += f"; as stated, {LOAD} comes out {100.0 * share:+.2g} % off"
    return text


def _suspect_sentence(scene: Scene, suspects: list[Asked]) -> str:
    """The lengths and moduli that a frame contradicts, of which it cannot tell which is wrong."""
    parts = []
    for asked in suspects:
        assert asked.cause is not None
        (key,), (value,) = asked.cause.keys, asked.values
        parts.append(f"{key} {100.0 * value / float(scene.get(key)):+.2g} %")
    wrong = "camera.pixel_mm, specimen.fringe_value_n_per_mm or a size of the specimen"
    if scene.indenter is not None:
        wrong += ", the moduli or indenter.radius_mm"
    return (
        f"the frame contradicts the scale ({' or '.join(parts)} would mend it): {wrong} is wrong, "
        "and the frame cannot tell which; measure them again, the load depends on it"
    )
