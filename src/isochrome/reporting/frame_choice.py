"""Which frames of a run a report shows, and why these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

MOST_FRAMES = 8
"""Frames in a report: of a camera's usual picture so many are shown pixel by pixel in 10 MB."""


@dataclass(frozen=True)
class ChosenFrame:
    """A frame that a report shows."""

    number: int  # among those it was chosen from, from 0
    why: str  # empty where all are shown


def choose_frames(
    chi: ArrayLike, order: ArrayLike, *, most: int = MOST_FRAMES
) -> list[ChosenFrame]:
    """Choose the frames that a report shows by chi and largest order, which may be NaN.

    All, where they are no more than `most`, 4 at least; else the first and the last, the one that
    its model describes worst, the one with the largest order, and between them evenly spaced ones.
    """
    worst, largest = np.asarray(chi, float), np.asarray(order, float)
    count = len(worst)
    if count <= most:
        return [ChosenFrame(k, "") for k in range(count)]
    why = {0: "the first", count - 1: "the last"}
    for values, reason in ((worst, "the largest chi"), (largest, "the largest order")):
        if np.isfinite(values).any():
            why.setdefault(int(np.nanargmax(values)), reason)
    for number in _between(sorted(why), count, most - len(why)):
        why[number] = "evenly spaced"
    return [ChosenFrame(k, why[k]) for k in sorted(why)]


def _between(taken: Sequence[int], count: int, wanted: int) -> list[int]:
    """Evenly spaced numbers below `count` that are not taken; a taken one gives way to the next."""
    found: list[int] = []
    for place in np.linspace(0, count - 1, wanted + 2)[1:-1]:
        free = (k for k in range(round(place), count) if k not in taken and k not in found)
        number = next(free, None)
        if number is not None:
            found.append(number)
    return found
