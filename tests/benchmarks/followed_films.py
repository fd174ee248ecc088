"""Films without a model: how many pixels, of how many a wrong branch, and how many frames a second.

`python tests/benchmarks/followed_films.py` follows twelve films from zero load, of 659 x 494 pixels
with noise of 3 grey levels and uneven light, without no-load frames or a known point. `--gaps`
leaves out a jump of 3 fringes of each; `--keyed` follows the beam's and the disc's from key frames
whose orders are known where they are 0, and processes some frames alone beside. `--films 3,9`, only
those; `--workers 2`. Truth is that of `tests/processing/unloaded_films.py`.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import numpy as np
import tifffile

sys.path.insert(0, str(Path(__file__).parent.parent / "processing"))

from unloaded_films import FILMS, WHOLE, LoadedFilm, judged

from isochrome.processing import process

GAP, AFTER = 3.0, 20
KEYED = {
    4: {"known_line": [{"row_px": [246, 247], "col_px": [200, 400], "order": 0.0}]},
    5: {"known_line": [{"row_px": [246, 247], "col_px": [200, 400], "order": 0.0}]},
}
"""By film, where its order is 0 in all frames."""
ALONE = 4


def main():
    """Print a line for each film."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--films", default=None)
    options.add_argument("--workers", type=int, default=1)
    options.add_argument("--gaps", action="store_true")
    options.add_argument("--keyed", action="store_true")
    given = options.parse_args()
    chosen = range(len(FILMS)) if given.films is None else map(int, given.films.split(","))
    for number in chosen:
        film = LoadedFilm(number, WHOLE)
        if given.keyed and number in KEYED:
            followed_from_keys(film, given.workers)
        elif given.gaps:
            with_a_gap(film, given.workers)
        elif not given.keyed:
            numbers = range(film.count)
            found, seconds = timed(film, numbers, film.scene(), given.workers)
            report(film, found, numbers, seconds)


def with_a_gap(film, workers):
    """A film of which a jump of three fringes is left out."""
    before = int(np.flatnonzero(film.course > 0.3 * film.course.max())[0])
    far = np.flatnonzero(np.abs(film.course - film.course[before]) >= GAP)
    far = far[far > before]
    if not far.size:
        return
    numbers = [*range(before + 1), *range(far[0], min(film.count, far[0] + AFTER))]
    found, seconds = timed(film, numbers, film.scene(), workers)
    report(film, found, numbers, seconds, gap=before + 1)


def followed_from_keys(film, workers):
    """A film from the middle on, from key frames, and some of its frames alone."""
    numbers = [k for k in range(film.count) if k > 15]
    scene = film.scene(**KEYED[film.number])
    found, seconds = timed(film, numbers, scene, workers, track=True)
    report(film, found, numbers, seconds)
    some = numbers[:: -(-len(numbers) // ALONE)]
    found, seconds = timed(film, some, scene, workers)
    report(film, found, some, seconds)


def timed(film, numbers, scene, workers, **options):
    """What is found in some frames, and the seconds and processor's seconds that it took."""
    with TemporaryDirectory() as place:
        path = Path(place) / "film.tif"
        tifffile.imwrite(path, film.frames(numbers), photometric="minisblack")
        start, before = time.perf_counter(), sum(os.times()[:4])
        found = process(path, scene, Path(place) / "out", workers=workers, **options)
        seconds = time.perf_counter() - start, sum(os.times()[:4]) - before
        orders = found.dataset[["fringe_order"]].load()  # before its folder is gone
    return SimpleNamespace(dataset=orders), seconds


def report(film, found, numbers, seconds, gap=None):
    """One line."""
    kept, wrong, rms = judged(film, found, numbers).T
    loaded = slice(5, gap)
    name, top, rate, course = FILMS[film.number]
    text = (
        f"{film.number:2d} {name:17s} to {top:4.1f} at {rate:.2f}, {course:6s}"
        f" {len(kept):4d} frames"
        f"  kept {kept[loaded].min():.3f} (median {np.median(kept[loaded]):.3f})"
        f"  wrong {100 * wrong.max():.4f} % at most  RMS {np.median(rms[loaded]):.4f}"
        f" ({rms[loaded].max():.4f} at most)  {len(kept) / seconds[0]:.1f} frames/s,"
        f" {len(kept) / seconds[1]:.1f} a second of one core"
    )
    if gap is not None:
        text += f"  after the gap {100 * kept[gap:].max():.1f} % known"
    print(text, flush=True)


if __name__ == "__main__":
    main()
