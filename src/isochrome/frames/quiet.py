"""Libraries in C that speak to the terminal themselves, kept quiet."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

STANDARD_ERROR = 2
_TURN = threading.Lock()


@contextmanager
def quiet() -> Iterator[None]:
    """Nothing that C code writes to standard error comes out: libtiff has no other way to say it.

    What it would say, a refusal says. Python's own messages of other threads are held back too:
    the block is to be short.
    """
    with _TURN:
        try:
            kept = os.dup(STANDARD_ERROR)
        except OSError:  # no terminal at all, as under pythonw
            yield
            return
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, STANDARD_ERROR)
            yield
        finally:
            os.dup2(kept, STANDARD_ERROR)
            os.close(kept)
            os.close(nowhere)
