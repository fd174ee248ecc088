"""Peak memory of `simulate`, each run in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from isochrome.bench import Row
from isochrome.scene import dump_scene, load_scene

from .common import OURS

CASE = "peak memory of simulate"
LENGTHS = (200, 2000)
"""States of the short and the long history."""

_RUN = """
import sys, time
import isochrome.simulate.figure, matplotlib.figure
from isochrome.simulate import simulate
start = time.perf_counter()
if len(sys.argv) > 1:
    simulate(sys.argv[1], sys.argv[2])
print(time.perf_counter() - start if len(sys.argv) > 1 else "nan")
"""

_WATCH = """
import resource, subprocess, sys
done = subprocess.run([sys.executable, "-c", *sys.argv[1:]], stdout=subprocess.PIPE, text=True)
if done.returncode:
    sys.exit(done.returncode)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, done.stdout)
"""


def memory(quick):
    """Rows of peak memory: nothing but the imports, the paper's case, and long histories."""
    if find_spec("resource") is None:
        return [Row(CASE, OURS, "not measured on this system")]
    lengths = (3,) if quick else LENGTHS
    with TemporaryDirectory() as place:
        folder = Path(place)
        runs = {"imports alone": ()}
        if not quick:
            runs["line-contact-wear, 6 states"] = ("line-contact-wear", str(folder / "paper"))
        for count in lengths:
            scene = folder / f"{count}.toml"
            scene.write_text(long_history(count), encoding="utf-8")
            runs[f"{count} states on 64 x 48"] = (str(scene), str(folder / str(count)))
        return [_row(name, peak_memory(*arguments)) for name, arguments in runs.items()]


def long_history(count):
    """A scene (TOML) of `count` states over the paper's distance: small camera, coarse contact."""
    last = 233.0
    scene = load_scene("line-contact-wear").with_values(
        {
            "camera.width_px": 64,
            "camera.height_px": 48,
            "camera.pixel_mm": 0.05,
            "camera.left_mm": -1.6,
            "numerics.spacing_mm": 0.005,
            "numerics.tolerance": 1e-3,
            "friction.static_state_first": False,
            "wear.distances_m": tuple(last * k / (count - 1) for k in range(count)),
        }
    )
    return dump_scene(scene)


def peak_memory(*arguments):
    """Peak memory (MB) and seconds of `simulate SCENE OUT` in a process of its own.

    A small process starts the run and asks for the peak of its children, since that of a process
    counts from its fork: this one's own size would be in it.
    """
    done = subprocess.run(
        [sys.executable, "-c", _WATCH, _RUN, *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"simulate {arguments} failed: {done.stderr}")
    size, seconds = done.stdout.split()
    unit = 1.0 if sys.platform == "darwin" else 1024.0  # bytes there, KiB elsewhere
    return 1e-6 * unit * float(size), float(seconds)


def _row(name, measured):
    size, seconds = measured
    return Row(CASE, OURS, f"{name}: {size:.0f} MB", seconds=seconds)
