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

from . import case_films
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
    """Rows of one kind of film."""
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
            _write_stack(film, frames)
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


def _write_stack(path, frames):
    import tifffile

    with tifffile.TiffWriter(path) as tif:
        for frame in frames:
            tif.write(frame, photometric="minisblack", contiguous=True)


def _row(name, workers, found, loads, wall, cpu, spent):
    count = len(loads)
    value, spread = (
        np.array(found.columns[key], dtype=float) for key in (LOAD, f"{LOAD} standard_uncertainty")
    )
    alone = workers == 1
    return TrackRow(
        name,
        workers,
        count,
        count / wall,
        1e3 * cpu / count,
        spent["read"] / cpu if alone else float("nan"),
        spent["write"] / cpu if alone else float("nan"),
        float(np.sqrt(np.mean((value / loads - 1.0) ** 2))),
        float(np.sqrt(np.mean(((value - loads) / spread) ** 2))),
    )


PLACES = {
    "read": (
        ("isochrome.processing.frame_task", "_read"),
        ("isochrome.frames.reading", "FrameReader.count"),
        ("isochrome.processing.api", "identity_of"),
    ),
    "write": (
        ("isochrome.runs.workers", "keep"),
        ("isochrome.processing.folder", "write_csv"),
        ("isochrome.processing.folder", "add_columns"),
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
