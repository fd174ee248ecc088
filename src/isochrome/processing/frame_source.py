"""The captured frames of a set, handed out from any frame on, read while others are computed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar

T = TypeVar("T")


class Ahead(Generic[T]):
    """The items of an iterator, the next one read by a thread of its own while this one is used."""

    def __init__(self, items: Iterator[T]) -> None:
        self._items = items
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="reading")
        self._next: Future[list[T]] = self._thread.submit(self._read)

    def _read(self) -> list[T]:
        """One item, or none at the end: a StopIteration cannot pass through a Future."""
        for item in self._items:
            return [item]
        return []

    def __iter__(self) -> Iterator[T]:
        return self

    def __next__(self) -> T:
        found = self._next.result()
        if not found:
            raise StopIteration
        self._next = self._thread.submit(self._read)
        return found[0]

    def close(self) -> None:
        """End the reading, and with it the file that it holds open."""
        self._thread.shutdown(wait=True, cancel_futures=True)
        end = getattr(self._items, "close", None)
        if end is not None:
            end()


class Cursor(Generic[T]):
    """A source that is read in order, from any item on: forward by passing over, back anew."""

    def __init__(self, begin: Callable[[int], Iterator[T]], anew: Callable[[int], int]) -> None:
        """Prepare to read; `begin(start)` opens the source and gives its items from `start` on.

        `anew(start)`, as how many items this takes. To go on over more than so many, it is opened
        anew, as it is to go back.
        """
        self._begin = begin
        self._anew = anew
        self._items: Ahead[T] | None = None
        self._at = 0

    def take(self, start: int, stop: int) -> Iterator[T]:
        """Items [start, stop), fewer where the source ends before. Raises what reading raises."""
        on = self._items is not None and self._at <= start
        if not on or start > self._at + self._anew(start):
            self.close()
            self._items, self._at = Ahead(self._begin(start)), start
        assert self._items is not None
        for item in self._items:
            self._at += 1
            if self._at > start:
                yield item
            if self._at >= stop:
                return

    def close(self) -> None:
        """Close the source."""
        if self._items is not None:
            self._items.close()
        self._items = None
