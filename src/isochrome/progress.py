"""Progress of a long run, for whoever wants to show it."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Tally:
    """How far a long run is: items `done` of `count`, those of them that were there when it began.
    `flagged`, those that have warnings or failed; `said`, what is to be known of it beforehand;
    `stage`, what is done with the items before they are begun, of which the numbers then tell."""

    done: int
    count: int
    before: int
    flagged: int
    said: str = ""
    stage: str = ""


STAGE_EVERY_S = 2.0
"""Seconds after which, and from time to time, a stage is told of."""

RunProgress = Callable[[Tally], None]
"""Called with a Tally when a run begins or goes on, and after each chunk."""
