"""Frames a second of `process --track` on a contact's video, and what reading and writing take.

Frames of 659 x 494, 8 bits, noise of 3 grey levels, a vignette; the load swings by 5 %, friction
and place drift. Shares are of processor time within one run of one worker: the reading thread, the
count and the hash of the file; chunks, tables and dataset put down. The figure is counted as work.
"""

from __future__ import annotations

import concurrent.futures as futures
import importlib
import multiprocessing
import os
import sys
import time
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from isochrome.bench import TrackRow, benchmarks_folder

SHAPE, COUNT, LONG, LOOP = (494, 659), 800, 2000, 120
SMALL = (120, 180)
LOAD = "load.normal_n"

FILMS = {
    "uncompressed AVI": ("avi", "rawvideo", "gray", {}),
    "TIFF stack": ("tif", "", "", {}),
    "MJPEG in AVI": ("avi", "mjpeg", "yuvj420p", {"qmin": "2", "qmax": "2"}),
    "FFV1 in MKV": ("mkv", "ffv1", "gray", {}),
    "H.264 in MP4": ("mp4", "libx264", "yuv420p", {"crf": "16"}),
}


def cases():
    """A case for each kind of film; the first is run by two workers too."""
    able = {name: how for name, how in FILMS.items() if not how[1] or find_spec("av") is not None}
    return {name: _case(name, k == 0) for k, name in enumerate(able)}


def _case(name, both):
    return lambda quick: run_case(name, both=both, quick=quick)


@lru_cache(maxsize=1)
def films():
    """The tests' own module that makes films."""
    folder = str(benchmarks_folder().parent / "process")
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


def there_and_back(length, count):
    """Numbers (count,) of frames of a loop that runs to its end, and back, and so on."""
    once = np.r_[np.arange(length), np.arange(length)[::-1]]
    return once[np.arange(count) % len(once)]


def run_case(name, *, both, quick):
    """Rows of one kind of film."""
    from isochrome.process import process

    count = 9 if quick else LONG if both else COUNT
    every = 4 if quick else None
    frames, scene, loads = loop(SMALL if quick else SHAPE, 5 if quick else LOOP)
    order = there_and_back(len(frames), count)
    suffix, codec, pixels, options = FILMS[name]
    rows = []
    with TemporaryDirectory() as place:
        film = Path(place) / f"film.{suffix}"
        if codec:
            films().write_video(film, (frames[k] for k in order), codec, pixels, options)
        else:
            _write_stack(film, frames, order)
        if pixels.startswith("yuv"):  # an even number of columns
            width = frames.shape[2] // 2 * 2
            scene = scene.with_values({"camera.width_px": width})
        for workers in (1, 2) if both and not quick else (1,):
            with watched() as spent:
                before, start = os.times(), time.perf_counter()
                found = process(
                    film, scene, Path(place) / "out", track=True, every=every, workers=workers,
                    restart=True,
                )  # fmt: skip
                wall, after = time.perf_counter() - start, os.times()
            cpu = sum(after[:4]) - sum(before[:4])
            rows.append(_row(name, workers, found, loads[order], wall, cpu, spent))
        if len(rows) == 2:
            rows[1] = replace(rows[1], apart_per_s=2 * count / _apart(film, scene, 2))
    return rows


def _apart(film, scene, runs):
    """Time (s) of separate runs of one worker each at once: what the machine's cores allow for."""
    from isochrome.process import process

    with futures.ProcessPoolExecutor(runs, multiprocessing.get_context("spawn")) as pool:
        start = time.perf_counter()
        started = [
            pool.submit(process, film, scene, film.with_name(f"apart-{k}"), track=True, workers=1)
            for k in range(runs)
        ]
        for run in started:
            run.result()
        return time.perf_counter() - start


def _write_stack(path, frames, order):
    import tifffile

    with tifffile.TiffWriter(path) as tif:
        for k in order:
            tif.write(frames[k], photometric="minisblack", contiguous=True)


def _row(name, workers, found, loads, wall, cpu, spent):
    count = len(loads)
    value, spread = (
        np.array(found.table[key], dtype=float) for key in (LOAD, f"{LOAD} standard_uncertainty")
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
        ("isochrome.process.source", "Ahead._read"),
        ("isochrome.frames.reader", "FrameReader.count"),
        ("isochrome.process.run", "identity_of"),
    ),
    "write": (
        ("isochrome.runs.workers", "keep"),
        ("isochrome.process.folder", "write_csv"),
        ("isochrome.process.folder", "write_columns"),
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
