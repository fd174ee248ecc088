"""Memory that is free again goes back to the system."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from functools import cache


def give_back() -> None:
    """Give the system back what the C library has kept of freed memory, where it can be asked to.

    Between chunks: else what is left of one lies between the pieces of the next, and a long run
    takes more than a short one. GNU's malloc_trim; the memory of other systems' libraries shrinks
    by itself, or not at all.
    """
    trim = _trim()
    if trim is not None:
        trim(0)


@cache
def _trim() -> Callable[[int], int] | None:
    """GNU's malloc_trim(3), None where there is none."""
    if not sys.platform.startswith("linux"):
        return None
    found: Callable[[int], int] | None = getattr(ctypes.CDLL(None), "malloc_trim", None)
    return found
