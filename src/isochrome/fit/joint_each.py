"""Frames that nothing ties together: their own fits are the fit of all of them."""

from __future__ import annotations

from collections.abc import Sequence as Several
from dataclasses import replace

import numpy as np

from isochrome.fit.frame_fit import FrameFit
from isochrome.fit.joint import JointFit
from isochrome.fit.sequence import COURSE, Sequence, Unknown
from isochrome.scene import DistanceTable


def is_each(sequence: Sequence) -> bool:
    """Whether each frame's own fit is all that can be known of it.

    So it is where frames share neither unknowns nor a history, and for a single frame, but where a
    frame shows a state that other distances led to, which its own fit does not follow.
    """
    scene = sequence.scene
    parts = (scene.load, scene.friction, scene.wear)
    course = [
        getattr(part, key.split(".")[1])
        for part, key in zip(parts, COURSE, strict=True)
        if part is not None
    ]
    if any(isinstance(value, DistanceTable) for value in course):
        return False
    shared = any(unknown.shared for unknown in sequence.unknowns)
    return sequence.count == 1 or not (sequence.run or shared)


def fit_of_each(sequence: Sequence, alone: Several[FrameFit]) -> JointFit:
    """The fits of frames that nothing ties together as one of all of them.

    Memory grows with the frames, not with the square of their number. A frame's own fit may have
    more keys than the sequence, of a smooth stress: they become unknowns too.
    Parameters: `sequence`; `alone`, each frame's fit. Returns a JointFit, without matrices.
    """
    own_load = any(u.key == COURSE[0] and not u.shared for u in sequence.unknowns)
    shared = sequence.count == 1 and not own_load
    more = {
        key: [i for i, fit in enumerate(alone) if key in fit.keys]
        for key in dict.fromkeys(
            key for i, fit in enumerate(alone) for key in fit.keys[len(sequence.acting(i)) :]
        )
    }
    added = tuple(Unknown(key, (i,), shared) for key, frames in more.items() for i in frames)
    wider = replace(sequence, unknowns=(*sequence.unknowns, *added))
    places = [
        (alone[unknown.frames[0]], alone[unknown.frames[0]].keys.index(unknown.key))
        for unknown in wider.unknowns
    ]
    values = np.array([fit.values[k] for fit, k in places])
    cost = sum(fit.chi**2 * fit.freedom for fit in alone)
    freedom = sum(fit.freedom for fit in alone)
    return JointFit(
        wider,
        values,
        np.array([fit.standard_uncertainty[k] for fit, k in places]),
        np.array([fit.cramer_rao_bound[k] for fit, k in places]),
        None,
        None,
        float(np.sqrt(cost / freedom)),
        tuple(fit.chi for fit in alone),
        cost,
        freedom,
        wider.whole(values),
        tuple(fit.scene for fit in alone),
        all(fit.converged for fit in alone),
        tuple(i for i, fit in enumerate(alone) if not fit.positive),
    )
