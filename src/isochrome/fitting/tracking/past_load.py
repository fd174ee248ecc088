"""The first frame of a track, and the load that wore its contact before, as that frame shows it.

A load that swings shows one of its values. The scar's ends are where the larger ones have been, and
where its own load does not reach, or reaches beyond, the frame tells which one wore it. It tells
one load: what swung before is taken for a steady one that leaves the least misfit.
"""

from collections.abc import Callable

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.frame_model import LocalModel, RefinedFit, project
from isochrome.fitting.tracking.tracked_model import TrackModel
from isochrome.fitting.tracking.wear_state import TrackCourse

_TIMES = 4
_FIRST, _FAR = 0.01, 0.3
"""First step, and the largest, over the load that it starts from."""
_RESTS = 0.2
"""Step below which the search rests, in standard uncertainties of the load before."""
_TOLD, _PASTS, _AGAIN, _ALIKE = 4.0, 3, 0.03, 3e-3
"""Misfit, over the noise squared, that another load must take off; how often one is looked for at
most, and its change, over it, after which one is again: from far off it is not found at once. Below
the last change a frame's values stay within their uncertainty."""

Follow = Callable[[TrackModel, Array], RefinedFit | None]


def begin_track(
    course: TrackCourse,
    prepared: Callable[[], TrackModel],
    follow: Follow,
    begun: Array,
    usual_load_n: float,
) -> tuple[RefinedFit | None, TrackModel]:
    """The first frame of a track, on what its own load has worn, or another one before it.

    Parameters: `course`, which has passed no frame, and has the load before it afterwards;
    `prepared`, which makes the frame's pixels anew: slopes of another scar leave the load before it
    untold; `follow`, from pixels and values (axes,) to where the steps end; `begun` (axes,), the
    values to start from; `usual_load_n`, about the load (N) that wore the contact. Returns what was
    found, None where the steps do not end, and the pixels that it was found with.
    """
    model = prepared()
    found = follow(model, begun)
    if found is None or not course.unsure:
        return found, model

    def better_than(
        found: RefinedFit, past_n: float, begin: Array
    ) -> tuple[RefinedFit, TrackModel] | None:
        """What is found if another load wore it, where that is better; else all stays."""
        selected, begin = course.past_load_n, course.with_past(begin, past_n)
        course.past_load_n = past_n
        again = prepared()
        other = follow(again, begin)
        if (
            other is not None
            and other.gamma_fit.cost < found.gamma_fit.cost - _TOLD * found.gamma_fit.noise
        ):
            return other, again
        course.past_load_n = selected
        return None

    found, model = better_than(found, usual_load_n, begun) or (found, model)
    for _ in range(_PASTS):
        start = course.load_before(found.values)
        past = _past_load(course, model, found, start)
        if abs(past - start) < _ALIKE * start:
            break
        better = better_than(found, past, found.values)
        if better is None:
            break
        found, model = better
        if abs(past - start) < _AGAIN * start:
            break
    return found, model


def _past_load(course: TrackCourse, model: TrackModel, found: RefinedFit, start_n: float) -> float:
    """The load (N) before the first frame by `fit_past_load`; the start's where none is told."""
    amplitude, still = found.gamma_fit.part.amplitude, np.zeros(course.count)
    selected = course.past_load_n

    def worn(past_n: float) -> Array:
        """The signal over the noise (n,) if that load wore the contact."""
        course.past_load_n = past_n
        return np.asarray(model.worn_signal(course.moved(found.values, still)) * amplitude)

    try:
        here = worn(start_n)
        return fit_past_load(
            lambda past_n: worn(past_n) - here, found.local, found.gamma_fit.residual, start_n
        )
    except PhysicsError:
        return start_n
    finally:
        course.past_load_n = selected


def fit_past_load(
    change: Callable[[float], Array], local: LocalModel, residual: Array, start_n: float
) -> float:
    """The load before the first frame that leaves the least residual, by secants.

    Equation: min over P and dv of |r - c(P) - J dv|², with c' by two loads.
    Parameters: `change`, from a load P (N) to what it adds to the frame over its noise (n,), none
    at `start_n`; `local`, the model about the frame's values, with its derivatives J; `residual` r
    (n,) there; `start_n`, the load (N) that has worn it. Returns P, within 30 % of that. Source:
    the elimination of dv as in `LocalModel.step`.
    """
    last, before = start_n, np.zeros_like(residual)
    past = start_n * (1.0 + _FIRST)
    for _ in range(_TIMES):
        added = change(past)
        slope = (added - before) / np.float32(past - last)
        project(slope[None], local.gamma_fit.problem, local.gamma_fit.part)
        alone = slope - local.step(slope).astype(slope.dtype) @ local.rows
        told = float(alone @ alone)
        if not told > 0.0:
            return start_n
        last, before = past, added
        step = float(alone @ (residual - added)) / told
        past = float(np.clip(past + step, (1.0 - _FAR) * start_n, (1.0 + _FAR) * start_n))
        if abs(past - last) < _RESTS / np.sqrt(told):
            break
    return past
