"""Progress of a long run, told to whoever wants to show it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

Progress = Callable[[int, int], None]
"""Called with (done, all) after each item."""

T = TypeVar("T")


def counted(items: Iterator[T], count: int, progress: Progress | None) -> Iterator[T]:
    """The same items; after each has been dealt with, `progress` is told.

    Parameters: `items`; `count`, how many there are; `progress`, None to tell nobody.
    """
    for done, item in enumerate(items, start=1):
        yield item
        if progress is not None:
            progress(done, count)


@dataclass(frozen=True)
class Tally:
    """How far a long run is: items `done` of `count`, those of them that were there when it began.

    `flagged`, those that have warnings or failed.
    """

    done: int
    count: int
    before: int
    flagged: int


RunProgress = Callable[[Tally], None]
"""Called with a Tally when a run begins or goes on, and after each chunk."""
