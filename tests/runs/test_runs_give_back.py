"""Memory that is free again goes back to the system."""

import ctypes
import sys
from pathlib import Path

import numpy as np
import pytest

from isochrome.runs import trim_heap

BLOCK = 1 << 16
GNU = sys.platform == "linux" and hasattr(ctypes.CDLL(None), "malloc_trim")


def resident():
    """Bytes of this process that are in memory."""
    lines = Path("/proc/self/status").read_text().splitlines()
    (line,) = (text for text in lines if text.startswith("VmRSS"))
    return 1024 * int(line.split()[1])


@pytest.mark.skipif(not GNU, reason="needs GNU's C library")
def test_what_lies_free_between_pieces_in_use_is_given_back():
    """Every 64th of some hundred blocks stays: what is free between them is not the heap's end."""
    trim_heap()
    blocks = [np.ones(BLOCK, np.uint8) for _ in range(1600)]
    full = resident()
    kept = blocks[::64]
    del blocks
    trim_heap()
    assert sum(map(len, kept)) == 25 * BLOCK
    # all of it but the pages that a block shares with its neighbours, two of some sixteen
    assert full - resident() > 0.8 * 1575 * BLOCK
