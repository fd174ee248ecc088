"""Progress of a long run, for whoever wants to show it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Tally:
    """How far a long run is: items `done` of `count`, those of them that were there when it began.

    `flagged`, those that have warnings or failed; `said`, what is to be known of it beforehand.
    """

    done: int
    count: int
    before: int
    flagged: int
    said: str = ""


RunProgress = Callable[[Tally], None]
"""Called with a Tally when a run begins or goes on, and after each chunk."""
