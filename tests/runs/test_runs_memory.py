"""Memory does not grow with the length of a run."""

import subprocess
import sys
from pathlib import Path

import pytest

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
