"""Memory does not grow with the length of a run, and goes back to the system when it is free."""

import ctypes
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from isochrome.runs import trim_heap

RUN = """
import resource, sys
from pathlib import Path
sys.path.insert(0, sys.argv[3])
from isochrome.runs import run_job
from runs.counting import Count, finish, job
run_job(job(Count(Path(sys.argv[2])), count=int(sys.argv[4]), chunk=32), sys.argv[1], finish)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="no resource module there")
def test_twenty_thousand_items_take_the_memory_of_two_hundred(notes, tmp_path):
    tests, peak = str(Path(__file__).parents[1]), {}
    for count in (200, 20_000):
        out = str(tmp_path / str(count))
        command = [sys.executable, "-c", RUN, out, str(notes), tests, str(count)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        peak[count] = int(done.stdout)
    # pictures are small here, so that the table of all items is most of what may grow
    assert peak[20_000] < 1.1 * peak[200]


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
