"""Films without a model: how many pixels, of how many a wrong branch, and how many frames a second.

`python tests/benchmarks/followed_films.py` follows twelve films from zero load, of 659 x 494 pixels
with noise of 3 grey levels and uneven light, without no-load frames or a known point. `--gaps`
leaves out a jump of 3 fringes of each; `--keyed` follows a disc, a beam, a ring and a plate with a
hole from key frames, whose orders are known where they are 0, and processes some frames alone
beside. `--films 3,9`, only
those; `--workers 2`. Truth is that of `tests/processing/unloaded_films.py`. `--seed 5` draws other
films: specimens, orders, courses, lamps, noise, field (`tests/processing/drawn_films.py`), of 330 x
247 pixels, and of 659 x 494 with `--whole`; with `--keyed`, of 659 x 494 and from key frames.
"""

import argparse
import os
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import numpy as np
import tifffile

sys.path.insert(0, str(Path(__file__).parent.parent))
sys.path.insert(0, str(Path(__file__).parent.parent / "processing"))

from drawn_films import MIDDLE, DrawnFilm, drawn_known_film
from unloaded_films import FILMS, KEYED, WHOLE, KnownFilm, LoadedFilm, judged

from isochrome.errors import PhysicsError
from isochrome.processing import process

GAP, AFTER = 3.0, 20
ALONE, LONG = 3, 100
"""Frames that are processed alone beside a film from key frames, and its frames."""


def main():
    """Print a line for each film."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--films", default=None)
    options.add_argument("--workers", type=int, default=1)
    options.add_argument("--gaps", action="store_true")
    options.add_argument("--keyed", action="store_true")
    options.add_argument("--seed", type=int, default=None)
    options.add_argument("--whole", action="store_true")
    given = options.parse_args()
    count = len(KEYED if given.keyed else FILMS)
    chosen = range(count) if given.films is None else map(int, given.films.split(","))
    for number in chosen:
        film = LoadedFilm(number, WHOLE)
        if given.seed is not None:
            film = DrawnFilm(number, WHOLE if given.whole else MIDDLE, seed=given.seed)
        if given.keyed:
            film = KnownFilm(number, WHOLE, count=LONG)
            if given.seed is not None:
                film = drawn_known_film(number, WHOLE, seed=given.seed)
            followed_from_keys(film, given.workers)
        elif given.gaps:
            with_a_gap(film, given.workers)
        else:
            from_zero(film, given.workers)


def from_zero(film, workers):
    """A film from zero load; a drawn one may be refused."""
    numbers = range(film.count)
    try:
        found, seconds = timed(film, numbers, film.scene(), workers)
    except PhysicsError as error:
        print(f"{film} {film.count:4d} frames  refused: {error}", flush=True)
        return
    report(film, found, numbers, seconds)


def with_a_gap(film, workers):
    """A film of which a jump of three fringes is left out."""
    before = int(np.flatnonzero(film.course > 0.3 * film.course.max())[0])
    far = np.flatnonzero(np.abs(film.course - film.course[before]) >= GAP)
    far = far[far > before]
    if not far.size:
        return
    numbers = [*range(before + 1), *range(far[0], min(film.count, far[0] + AFTER))]
    try:
        found, seconds = timed(film, numbers, film.scene(), workers)
    except PhysicsError as error:  # no crest passed before it
        print(f"{film} {len(numbers):4d} frames  refused: {error}", flush=True)
        return
    report(film, found, numbers, seconds, gap=before + 1)


def followed_from_keys(film, workers):
    """A film that begins in the middle, from key frames, and some of its frames alone."""
    scene, numbers = film.scene(**film.known()), range(film.count)
    try:
        found, seconds = timed(film, numbers, scene, workers, track=True)
    except PhysicsError as error:  # no frame by itself tells an order
        print(f"{film} {film.count:4d} frames  refused: {error}", flush=True)
        return
    report(film, found, numbers, seconds)
    some = numbers[:: -(-film.count // ALONE)]
    alone, seconds = timed(film, some, scene, workers)
    report(film, alone, some, seconds)
    less = judged(film, alone, some)[:, 0] - judged(film, found, numbers)[:: some.step, 0]
    print(
        f"   known in a frame alone, and not followed: {100 * less.max():.1f} % at most", flush=True
    )


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
    loaded = slice(5 if len(kept) > 5 else 0, gap)  # unloaded frames have little to read
    text = (
        f"{film} {len(kept):4d} frames"
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
