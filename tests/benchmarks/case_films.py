"""Frames a second of `process` on films without a model, and how right their orders are; films and
truth are those of `tests/processing/unloaded_films.py`."""

import importlib
import os
import sys
import time
from functools import lru_cache, partial
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from isochrome.benchmarks import benchmarks_folder

from .rows import TrackRow

COUNT = 200
ZERO, KEYED = "from zero load", "from key frames"
FILMS = {
    f"beam {ZERO}": 3, f"disc {ZERO}": 0, f"disc {KEYED}": 0, f"beam {KEYED}": 1,
    f"ring {KEYED}": 2, f"hole {KEYED}": 3,
}  # fmt: skip
"""Films without a model, and their numbers."""


@lru_cache(maxsize=1)
def films():
    """The tests' own module that makes films."""
    folder = benchmarks_folder().parent
    own = [str(folder / "processing"), str(folder)]
    sys.path[:0] = own
    try:
        if find_spec("skfem") is not None:
            importlib.import_module("finite_ring")  # needed later, when the path is as it was
        return importlib.import_module("unloaded_films")
    finally:
        for name in own:
            sys.path.remove(name)


def cases():
    able = find_spec("skfem") is not None  # the ring's truth is by finite elements
    return {name: partial(run_case, name) for name in FILMS if able or "ring" not in name}


def run_case(name, *, quick):
    """Rows of one film, of one worker and of two."""
    make, number = films(), FILMS[name]
    shape = (247, 330) if quick else make.WHOLE
    if ZERO in name:
        film = make.LoadedFilm(number, shape)
        numbers, scene = range(min(film.count, 26) if quick else film.count), film.scene()
    else:
        film = make.KnownFilm(number, shape, count=COUNT)
        numbers, scene = range(6 if quick else COUNT), film.scene(**film.known())
    with TemporaryDirectory() as place:
        path = Path(place) / "film.tif"
        write_stack(path, map(film.image, numbers))
        many = (1,) if quick else (1, 2)
        return [_row(name, path, film, numbers, scene, workers) for workers in many]


def write_stack(path, frames):
    import tifffile

    with tifffile.TiffWriter(path) as tif:
        for frame in frames:
            tif.write(frame, photometric="minisblack", contiguous=True)


def _row(name, path, film, numbers, scene, workers):
    from isochrome.processing import process

    before, start = sum(os.times()[:4]), time.perf_counter()
    found = process(
        path, scene, path.with_name("out"), track=KEYED in name, workers=workers, restart=True
    )
    wall, spent = time.perf_counter() - start, sum(os.times()[:4]) - before
    kept, wrong, rms = films().judged(film, found, numbers).T
    count = len(kept)
    return TrackRow(
        name, workers, count, count / wall, 1e3 * spent / count,
        rms=float(sorted(rms[5:])[(count - 5) // 2]), wrong=float(wrong.max()),
        kept=float(sorted(kept[5:])[(count - 5) // 2]),
    )  # fmt: skip
