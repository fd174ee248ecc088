"""Memory that is free again goes back to the system, in a long run as in a short one.

Of the GNU C library, which keeps what is freed: without this, what is left of one chunk lies
between the pieces of the next, and a long run takes more than a short one. The memory of other
systems' libraries shrinks by itself, or cannot be asked to. Source: mallopt(3), malloc_trim(3).
"""

from __future__ import annotations

import ctypes
import sys
from functools import cache

LARGE = 16 << 20
"""Bytes of an array, as a stack of frames, that is given back as soon as it is freed."""

SPARE = 128 << 20
"""Bytes that may stay free at the end of the heap until `trim_heap`: what is given back with each
picture is asked for again with the next, which costs a third of the time."""

_MMAP_THRESHOLD, _TRIM_THRESHOLD = -3, -1


def keep_steady() -> None:
    """Fix from which size on arrays are given back at once, which else grows with the largest."""
    library = _gnu()
    if library is not None:
        library.mallopt(_MMAP_THRESHOLD, LARGE)
        library.mallopt(_TRIM_THRESHOLD, SPARE)


def trim_heap() -> None:
    """Give back what is free, between chunks."""
    library = _gnu()
    if library is not None:
        library.malloc_trim(0)


@cache
def _gnu() -> ctypes.CDLL | None:
    """The GNU C library, None where there is another."""
    if not sys.platform.startswith("linux"):
        return None
    library = ctypes.CDLL(None)
    known = hasattr(library, "mallopt") and hasattr(library, "malloc_trim")
    return library if known else None
