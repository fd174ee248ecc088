"""Whether another cause explains a frame as well as the one that was freed.

What is asked for is found to first order, and then freed one after the other. Small things may look
alike in a frame of few fringes or much noise: plates turned by a degree as a smooth stress, a band
as blur. So each is fitted in the other's place, and what it takes of the misfit is compared.
"""

from typing import Any

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import ALIKE_CHI
from isochrome.fitting.causes.cause import BLURRED, SMOOTH, TURNED, WIDE, Cause
from isochrome.fitting.causes.freeing import Freed
from isochrome.fitting.frame.frame_fit import FrameFit, fit_frame

_LIKE = (BLURRED, TURNED, WIDE, SMOOTH)
"""Causes that may look like one another."""

_AS_WELL = 0.8
"""Share of what a cause takes of the misfit, from which another is as good in its place. In frames
of one cause that was told right others took 0.14 at the most, or left 1.06 times chi; turned plates
that were taken for a smooth stress left the same to 1e-4."""


def rival_causes(freed: Freed[Any]) -> dict[str, tuple[str, ...]]:
    """Tell which causes a frame cannot tell from those that were freed.

    Parameters
    ----------
    freed : Freed
        One frame's fit with what it asked for.

    Returns
    -------
    dict of str to tuple of str
        Names of causes by the name of the freed one that they explain as well as; nothing for one
        that the frame tells.
    """
    result = {}
    for cause in freed.causes:
        if cause not in _LIKE or freed.slip is not None:
            continue
        others = [other for other in _LIKE if other not in freed.causes and _may_be(other, freed)]
        names = _as_good(freed, cause, others)
        if names:
            result[cause.name] = names
    return result


def _may_be(cause: Cause, freed: Freed[Any]) -> bool:
    """Whether a cause can be fitted to a frame at all: a band's width needs the wavelength."""
    return cause is not WIDE or freed.fit.scene.polariscope.wavelength_nm is not None


def _as_good(freed: Freed[Any], cause: Cause, others: list[Cause]) -> tuple[str, ...]:
    """The names of the causes that take as much of the misfit as one that was freed."""
    fit = freed.fit
    keys = tuple(key for key in fit.keys if key not in cause.keys)
    given = freed.stated.scene
    bare = fit.scene.with_values({key: given.get(key) for key in cause.keys})
    without = _fitted(freed, bare, keys)
    if without is None:
        return ()
    taken = without.chi**2 - fit.chi**2
    names = []
    for other in others:
        start = bare.with_values(dict(zip(other.keys, other.starts, strict=True)))
        tried = _fitted(freed, start, (*keys, *other.keys))
        if tried is None or tried.chi > ALIKE_CHI * fit.chi:
            continue
        if without.chi**2 - tried.chi**2 > _AS_WELL * taken:
            names.append(other.name)
    return tuple(names)


def _fitted(freed: Freed[Any], scene: Any, keys: tuple[str, ...]) -> FrameFit | None:
    """The frame's fit with some unknowns; None where there is none."""
    try:
        fit = fit_frame(freed.data, scene, keys, cold=False)
    except (InputError, PhysicsError):  # it has left the picture
        return None
    return fit if fit.positive else None
