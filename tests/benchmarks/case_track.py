"""Frames a second of `process` on videos, and what reading and writing take of a contact's.

Frames of 659 x 494, of the film at rest that is processed wholly 180 x 120; 8 bits, noise of 3 grey
levels, a vignette; the load swings by 5 %; friction and place drift, or the block wears along the
paper's 200 m, 0.1 m a frame. Shares are of processor time within
one run of one worker: the reading thread, the count and the hash of the file; chunks, tables and
dataset put down. The figure is counted as work.
"""

import concurrent.futures as futures
import importlib
import multiprocessing
import os
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from isochrome.benchmarks import benchmarks_folder
from isochrome.figures import LINE_COLOURS

from . import case_films
from .report import lines_of, machine
from .rows import TrackRow

SHAPE, COUNT, LONG, LOOP, FEW = (494, 659), 800, 2000, 120, 40
SMALL = (120, 180)
LOAD = "load.normal_n"


@dataclass(frozen=True)
class Film:
    """A kind of file: `suffix`; `codec`, its `pixels` and `options`; none of a TIFF stack.

    `track`, whether it is tracked, or every frame processed wholly; `maps`, of which frames of a
    tracked one maps are written; `count` of its frames; `workers`, with how many it is processed;
    `worn`, whether the block wears.
    """

    suffix: str
    codec: str = ""
    pixels: str = ""
    options: dict[str, str] = field(default_factory=dict)
    track: bool = True
    maps: str = "key"
    count: int = COUNT
    workers: tuple[int, ...] = (1,)
    worn: bool = False


BOTH = (1, 2)
WHOLE, MAPS = "TIFF, frames wholly", "TIFF, maps of all"
WORN, WORN_WHOLE = "TIFF, worn, maps of all", "TIFF, worn, frames wholly"
FILMS = {
    "uncompressed AVI": Film("avi", "rawvideo", "gray", count=LONG, workers=BOTH),
    "TIFF stack": Film("tif"),
    "MJPEG in AVI": Film("avi", "mjpeg", "yuvj420p", {"qmin": "2", "qmax": "2"}),
    "FFV1 in MKV": Film("mkv", "ffv1", "gray"),
    "H.264 in MP4": Film("mp4", "libx264", "yuv420p", {"crf": "16"}),
    MAPS: Film("tif", maps="all", count=LONG, workers=BOTH),
    WHOLE: Film("tif", track=False, count=FEW, workers=BOTH),
    WORN: Film("tif", maps="all", count=LONG, workers=(2,), worn=True),
    WORN_WHOLE: Film("tif", track=False, count=FEW, workers=(2,), worn=True),
}


def cases():
    """A case for each kind of film, and for each without a model."""
    return {name: partial(run_case, name) for name in FILMS} | case_films.cases()


@lru_cache(maxsize=1)
def films():
    """The tests' own module that makes films."""
    folder = str(benchmarks_folder().parent / "processing")
    sys.path.insert(0, folder)
    try:
        return importlib.import_module("tracked_films")
    finally:
        sys.path.remove(folder)


@lru_cache(maxsize=1)
def loop(shape, count):
    """Frames (count, rows, cols) of a drifting contact, the scene, and the loads (count,)."""
    make, k = films(), np.arange(count)
    scene = make.contact(shape, sliding=True)
    values = {
        LOAD: 44.0 * (1.0 + 0.05 * np.sin(2 * np.pi * k / 120)),
        "friction.coefficient": 0.2 + 0.02 * np.sin(2 * np.pi * k / 200),
        "camera.left_mm": -1.9 + 0.003 * np.sin(2 * np.pi * k / 50),
    }
    return make.film(scene, values, 1), scene, values[LOAD]


def wearing(shape, count):
    """The same of a block that wears: its frames one after the other, the scene, the loads."""
    from isochrome.optics import expose
    from isochrome.simulation import scene_states

    make, k = films(), np.arange(count)
    slid = (0.1 * k).tolist()
    loads = 44.0 * (1.0 + 0.05 * np.sin(k / 12.0))
    scene = make.contact(shape, wearing=True).with_values({"wear.distances_m": slid})
    truth = scene.with_values({LOAD: {"distance_m": slid, "value": loads.tolist()}})
    rng = np.random.default_rng(1)
    frames = (
        expose(make.light_of(truth, state), truth.camera, rng=rng) for state in scene_states(truth)
    )
    return frames, scene, loads


def there_and_back(length, count):
    """Numbers (count,) of frames of a loop that runs to its end, and back, and so on."""
    once = np.r_[np.arange(length), np.arange(length)[::-1]]
    return once[np.arange(count) % len(once)]


def run_case(name, *, quick):
    from isochrome.processing import process

    kind = FILMS[name]
    count = 9 if quick else kind.count
    every = 4 if quick and kind.track else None
    shape = SMALL if quick or not (kind.track or kind.worn) else SHAPE
    if kind.worn:
        frames, scene, loads = wearing(shape, count)
    else:
        some, scene, loads = loop(shape, 5 if quick else LOOP)
        order = there_and_back(len(some), count)
        frames, loads = (some[k] for k in order), loads[order]
    rows = []
    with TemporaryDirectory() as place:
        film = Path(place) / f"film.{kind.suffix}"
        if kind.codec:
            films().write_video(film, frames, kind.codec, kind.pixels, kind.options)
        else:
            case_films.write_stack(film, frames)
        if kind.pixels.startswith("yuv"):  # an even number of columns
            width = shape[1] // 2 * 2
            scene = scene.with_values({"camera.width_px": width})
        for workers in kind.workers if not quick else (1,):
            with watched() as spent:
                before, start = os.times(), time.perf_counter()
                found = process(
                    film, scene, Path(place) / "out", track=kind.track, every=every,
                    maps=kind.maps if kind.track else None, workers=workers, restart=True,
                )  # fmt: skip
                wall, after = time.perf_counter() - start, os.times()
            cpu = sum(after[:4]) - sum(before[:4])
            rows.append(_row(name, workers, found, loads, wall, cpu, spent))
        if len(rows) == 2:
            rows[1] = replace(rows[1], apart_per_s=2 * count / _apart(film, scene, kind))
    return rows


def _apart(film, scene, kind):
    """Time (s) of two runs of one worker each at once: what the machine's cores allow for."""
    from isochrome.processing import process

    options = {"track": kind.track, "maps": kind.maps if kind.track else None, "workers": 1}
    with futures.ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        start = time.perf_counter()
        started = [
            pool.submit(process, film, scene, film.with_name(f"apart-{k}"), **options)
            for k in range(2)
        ]
        for run in started:
            run.result()
        return time.perf_counter() - start


def _row(name, workers, found, loads, wall, cpu, spent):
    count = len(loads)
    value, spread = (
        np.array(found.columns[key], dtype=float) for key in (LOAD, f"{LOAD} standard_uncertainty")
    )
    alone = workers == 1
    return TrackRow(
        name, workers, count, count / wall, 1e3 * cpu / count,
        spent["read"] / cpu if alone else float("nan"),
        spent["write"] / cpu if alone else float("nan"),
        float(np.sqrt(np.mean((value / loads - 1.0) ** 2))),
        float(np.sqrt(np.mean(((value - loads) / spread) ** 2))),
    )  # fmt: skip


PLACES = {
    "read": (
        ("isochrome.frames.reading", "_next"),
        ("isochrome.frames.reading", "FrameReader.count"),
        ("isochrome.processing.api", "identity_of"),
    ),
    "write": (
        ("isochrome.runs.workers", "keep"),
        ("isochrome.output", "write_csv"),
        ("isochrome.runs", "add_columns"),
    ),
}
"""What reads and writes: functions that no other of them calls."""


@contextmanager
def watched():
    """The processor time (s) that this process spends in reading and in writing."""
    spent = dict.fromkeys(PLACES, 0.0)
    undo = []
    for kind, places in PLACES.items():
        for module, name in places:
            holder, _, last = name.rpartition(".")
            owner = importlib.import_module(module)
            owner = getattr(owner, holder) if holder else owner
            undo.append((owner, last, getattr(owner, last)))
            setattr(owner, last, _timed(getattr(owner, last), kind, spent))
    try:
        yield spent
    finally:
        for owner, last, own in undo:
            setattr(owner, last, own)


def _timed(function, kind, spent):
    def timed(*arguments, **more):
        start = time.thread_time()
        try:
            return function(*arguments, **more)
        finally:
            spent[kind] += time.thread_time() - start

    return timed


RUN_HEAD = ("film", "workers", "frames", "frames/s", "CPU a frame")
HEAD = (*RUN_HEAD, "reading", "writing", "load error", "pull")
FREE_HEAD = (*RUN_HEAD, "order RMS", "kept", "wrong")
FREE_RATE = 8.0
"""Frames a second of two workers at least without a model."""
RATE, MAPS_RATE, SHARE = 60.0, 25.0, 0.15
"""Frames a second of two workers at least, without and with maps of all frames, and the share of
reading and writing at most."""


def table(rows: list[TrackRow]) -> str:
    """The rows as a table in plain text, with what they mean."""
    free = [(*_run_cells(row), *_order_cells(row)) for row in rows if row.rms == row.rms]
    own = [(*_run_cells(row), *_value_cells(row)) for row in rows if row.rms != row.rms]
    tables = [
        line
        for head, cells in ((HEAD, own), (FREE_HEAD, free))
        if cells
        for line in (*lines_of(head, cells, texts=1), "")
    ]
    return "\n".join([*tables, *_speed_up(rows), *_beside_whole(rows), _FOOT, machine()])


_FOOT = f"""\
frames/s: by the clock, with all that the machine did besides; CPU a frame: processor time of all
processes, start and figure included: two free cores do 2 / (CPU a frame). Reading (counting, hash,
decoding) and writing: shares of the processor time. Load error: relative, root mean square; pull:
error over standard uncertainty. Order RMS and kept: medians over the frames of films without a
model; wrong: share of what is known that is off by over 1/4 fringe, in the worst frame. To be seen:
where frames are tracked, {RATE:g} frames/s on two cores, {MAPS_RATE:g} with all maps; reading and
writing under {100 * SHARE:.0f} % together, a codec's own decoding included; without a model,
{FREE_RATE:g} frames/s."""


def _run_cells(row: TrackRow) -> tuple[str, ...]:
    return (
        row.film, str(row.workers), str(row.frames), f"{row.frames_per_s:.1f}",
        f"{row.cpu_ms:.1f} ms",
    )  # fmt: skip


def _value_cells(row: TrackRow) -> tuple[str, ...]:
    return (
        _share(row.reading), _share(row.writing), f"{100 * row.load_error:.4f} %",
        f"{row.pull:.2f}",
    )  # fmt: skip


def _order_cells(row: TrackRow) -> tuple[str, ...]:
    return f"{row.rms:.4f}", f"{100 * row.kept:.1f} %", f"{100 * row.wrong:.4f} %"


def _share(value: float) -> str:
    return f"{100 * value:.1f} %" if value == value else "-"


def _speed_up(rows: list[TrackRow]) -> list[str]:
    """What the second worker brings, where both were run."""
    by = {(row.film, row.workers): row for row in rows}
    return [
        f"{film}: two workers do {by[film, 2].frames_per_s / row.frames_per_s:.2f} times the frames"
        f" a second of one;\ntwo separate runs at once, all that this machine's cores allow for, "
        f"{by[film, 2].apart_per_s / row.frames_per_s:.2f} times"
        for (film, workers), row in by.items()
        if workers == 1 and (film, 2) in by and row.load_error == row.load_error
    ]


def _beside_whole(rows: list[TrackRow]) -> list[str]:
    """How much faster frames are followed than processed each by itself."""
    rate = {row.film: row.frames_per_s for row in rows}
    if not {WORN, WORN_WHOLE} <= set(rate):
        return []
    return [f"{WORN}: {rate[WORN] / rate[WORN_WHOLE]:.0f} times the frames a second of each wholly"]


def figure(rows: list[TrackRow]):
    """Processor time of a frame by its parts, a bar for each film that one worker tracked."""
    from isochrome.figures import new_figure, style_axes

    alone = [
        row
        for row in rows
        if row.workers == 1 and row.film not in (WHOLE, WORN_WHOLE) and row.reading == row.reading
    ]
    picture = new_figure(9.0, 0.55 * len(alone) + 1.6)
    axes = picture.subplots()
    ends = [0.0] * len(alone)
    parts = (
        ("reading", [row.cpu_ms * row.reading for row in alone]),
        ("writing", [row.cpu_ms * row.writing for row in alone]),
        ("work", [row.cpu_ms * (1.0 - row.reading - row.writing) for row in alone]),
    )
    for (name, widths), colour in zip(parts, LINE_COLOURS[1:], strict=False):
        axes.barh(range(len(alone)), widths, left=ends, color=colour, label=name)
        ends = [end + width for end, width in zip(ends, widths, strict=True)]
    limit = 2e3 / RATE
    axes.axvline(limit, color="black", lw=1.0, ls="--", label=f"{RATE:g} frames/s on two cores")
    axes.set_yticks(range(len(alone)), [row.film for row in alone])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.1 * max(limit, *ends))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    style_axes(axes, x_label="processor time of a frame (ms)", title="process --track")
    return picture
