"""Peak memory of long runs beside short ones, each in a process of its own."""

import struct
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from isochrome.figures import LINE_COLOURS
from isochrome.scene import dump_scene, load_scene

from .case_track import LOOP, SHAPE, SMALL, loop, there_and_back
from .report import lines_of, machine
from .rows import MemoryRow

STATES, FRAMES = (200, 2000), (200, 20_000)
"""Of a short and a long run."""

_RUN = """
import sys, time
start = time.perf_counter()
if sys.argv[1] == "simulate":
    from isochrome.simulation import simulate
    simulate(sys.argv[2], sys.argv[4])
else:
    from isochrome.console import print_json
    from isochrome.processing import process
    print_json({"frames": process(sys.argv[3], sys.argv[2], sys.argv[4], track=True,
                                   maps=sys.argv[1]).columns})
print(time.perf_counter() - start)
"""

_WATCH = """
import resource, subprocess, sys
done = subprocess.run([sys.executable, "-c", *sys.argv[1:]], stdout=subprocess.PIPE, text=True)
if done.returncode:
    sys.exit(done.returncode)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, done.stdout.split()[-1])
"""


def cases():
    """Those that this system can measure."""
    found = {"simulate": simulated, "process --track": tracked}
    return found if find_spec("resource") is not None else {}


def simulated(quick):
    """Rows of `simulate`: histories of many states with a small camera and a coarse contact."""
    rows = []
    with TemporaryDirectory() as place:
        for count in (3,) if quick else STATES:
            scene = Path(place) / f"{count}.toml"
            scene.write_text(long_history(count), encoding="utf-8")
            peak = peak_memory("simulate", scene, "", Path(place) / "out")
            rows.append(MemoryRow("simulate", "states of 64 x 48", count, *peak))
    return rows


def tracked(quick):
    """Rows of `process --track` of frames that come again, small ones where the maps of all are
    written, so that a disk holds them."""
    rows = []
    with TemporaryDirectory() as place:
        known = Path(place) / "scene.toml"
        for maps, large in (("key", SHAPE), ("all", SMALL)):
            shape = SMALL if quick else large
            frames, scene, _ = loop(shape, 5 if quick else LOOP)
            known.write_text(dump_scene(scene), encoding="utf-8")
            for count in (7,) if quick else FRAMES:
                film = Path(place) / f"{count}.tif"
                repeated_stack(film, frames, there_and_back(len(frames), count))
                peak = peak_memory(maps, known, film, Path(place) / f"{maps}-{count}")
                name = f"frames of {shape[1]} x {shape[0]}, maps {maps}"
                rows.append(MemoryRow("process --track", name, count, *peak))
    return rows


def repeated_stack(path, frames, order):
    """Write a TIFF stack of `frames` (n, rows, cols), 8 bits, in `order`; pages of the same frame
    share their pixels."""
    rows, cols = frames.shape[1:]
    pixels, first = rows * cols, 8 + frames.size
    tags = {256: cols, 257: rows, 258: 8, 259: 1, 262: 1, 277: 1, 278: rows, 279: pixels}
    length = 2 + 12 * (len(tags) + 1) + 4
    with open(path, "wb") as file:
        file.write(struct.pack("<2sHI", b"II", 42, first))
        file.write(frames.tobytes())
        for number, k in enumerate(order, start=1):
            file.write(struct.pack("<H", len(tags) + 1))
            for tag, value in sorted({**tags, 273: 8 + int(k) * pixels}.items()):
                file.write(struct.pack("<HHII", tag, 4, 1, value))
            file.write(struct.pack("<I", first + number * length if number < len(order) else 0))


def long_history(count):
    """A scene (TOML) of `count` states over the paper's distance: small camera, coarse contact."""
    last = 233.0
    scene = load_scene("line-contact-wear").with_values(
        {
            "camera.width_px": 64, "camera.height_px": 48, "camera.pixel_mm": 0.05,
            "camera.left_mm": -1.6, "numerics.spacing_mm": 0.005, "numerics.tolerance": 1e-3,
            "friction.static_state_first": False,
            "wear.distances_m": tuple(last * k / (count - 1) for k in range(count)),
        }
    )  # fmt: skip
    return dump_scene(scene)


def peak_memory(command, scene, frames, out):
    """Peak memory (MB) and seconds of a command, started by a small process, since a peak counts
    from the fork: this one's own size would be in it."""
    done = subprocess.run(
        [sys.executable, "-c", _WATCH, _RUN, command, str(scene), str(frames), str(out)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"{command} {scene} failed: {done.stderr}")
    size, seconds = done.stdout.split()
    unit = 1.0 if sys.platform == "darwin" else 1024.0  # bytes there, KiB elsewhere
    return 1e-6 * unit * float(size), float(seconds)


HEAD = ("command", "items", "count", "peak memory", "more", "time")
MOST = 0.10
"""What a long run may take more than a short one."""

_FOOT = f"""\
Peak memory of the whole process, libraries and figure included; more: than the shortest run of the
same command; to be seen: {100 * MOST:.0f} % at most."""


def table(rows: list[MemoryRow]) -> str:
    """The rows as a table in plain text, with what they mean."""
    cells = [
        (row.command, row.items, str(row.count), f"{row.peak_mb:.1f} MB", f"{100 * more:+.1f} %",
         f"{row.seconds:.1f} s")
        for row, more in zip(rows, _more(rows), strict=True)
    ]  # fmt: skip
    return "\n".join([*lines_of(HEAD, cells, texts=2), "", _FOOT, machine()])


def _more(rows: list[MemoryRow]) -> list[float]:
    """What each takes more than the first of its command, relative."""
    first: dict[str, float] = {}
    return [row.peak_mb / first.setdefault(row.command, row.peak_mb) - 1.0 for row in rows]


def figure(rows: list[MemoryRow]):
    """Peak memory, a bar for each run."""
    from isochrome.figures import new_figure, style_axes

    picture = new_figure(8.0, 0.45 * len(rows) + 1.4)
    axes = picture.subplots()
    names = [f"{row.command}: {row.count} {row.items}" for row in rows]
    bars = axes.barh(names, [row.peak_mb for row in rows], color=LINE_COLOURS[0])
    axes.bar_label(bars, [f"{100 * more:+.1f} %" for more in _more(rows)], padding=3, fontsize=9)
    axes.invert_yaxis()
    axes.margins(x=0.15)
    style_axes(axes, x_label="peak memory (MB)", title="Long runs beside short ones")
    return picture
