"""What it costs to hold results against their checksums as they are read: with, beside without.

    python tests/benchmarks/checking_cost.py [--frames 96]

A run of 494 x 659 pixels is read from the disk, as somebody's results are when they are opened, and
once more from the page cache, where reading costs least and a checksum's share is largest: the time
that passes, and of the latter the processor's time too. Without: zarr reads its store itself, and
nobody computes a checksum.
"""

import argparse
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np
from zarr.codecs import Crc32cCodec

import isochrome
from isochrome.runs import Compact, Job, Layer, Results, RunLayout, run_job

ROWS, COLS, DIFFERENT = 494, 659, 8
REPEATS = 25
IDENTITY = {
    "isochrome": "1", "scene": "", "inputs_sha256": {}, "options": {}, "seed": 1,
    "code_sha256": "0", "libraries": {},
}  # fmt: skip


def leave_run(folder: Path, count: int) -> None:
    """Results of `count` frames: single precision, and orders in whole steps."""
    row, col = np.mgrid[:ROWS, :COLS]
    noise = np.random.default_rng(0).normal(0.0, 0.01, (DIFFERENT, ROWS, COLS))
    maps = (2.0 + np.sin(row / 40) + np.cos(col / 50) + noise).astype(np.float32)
    steps = Compact(1e-4, 16)

    def work(start: int, stop: int) -> Results:
        own = [maps[k % DIFFERENT] for k in range(start, stop)]
        rows = [{"frame": k} for k in range(start, stop)]
        packed = {"steps": [steps.pack(one) for one in own]}
        return Results(
            {"single": np.stack(own)}, rows, [{"status": "ok"}] * len(own), packed=packed
        )

    layers = Layer("single", "1", "order"), Layer("steps", "1", "order", compact=steps)
    shape = {"row": ROWS, "col": COLS}
    layout = RunLayout(axes={"frame": count}, shape=shape, layers=layers, chunk=12)
    run_job(Job(work, layout, IDENTITY), folder, lambda bench: True)


def from_disk_s(read: Callable[[], object], folder: Path) -> float:
    """The time that passes in a reading of which no page is in memory, s."""
    for path in folder.rglob("*"):
        if path.is_file():
            with open(path, "rb") as file:
                os.fsync(file.fileno())
                os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
    return from_cache_s(read, folder)


def from_cache_s(read: Callable[[], object], folder: Path) -> float:
    """The time that passes in a reading of which all pages are in memory, s."""
    start = time.perf_counter()
    read()
    return time.perf_counter() - start


def processor_s(read: Callable[[], object], folder: Path) -> float:
    """The processor's time of a reading from the page cache, s."""
    start = time.process_time()
    read()
    return time.process_time() - start


def compared(
    took: Callable[[Callable[[], object], Path], float], read: Callable[[], object], folder: Path
) -> str:
    """What a reading takes without checks, and what these add: with and without in turn, medians.

    In turn, so that what else the machine does falls on both alike.
    """
    bare, more = [], []
    for _ in range(REPEATS):
        checked = took(read, folder)
        with (
            patch.object(Crc32cCodec, "_decode_sync", unchecked),
            patch("isochrome.runs.store.checked_store", lambda store: store),
        ):
            bare.append(took(read, folder))
        more.append(checked - bare[-1])
    usual, added = np.median(bare), np.median(more)
    low, high = np.quantile(more, [0.25, 0.75])
    error = 0.93 * (high - low) / len(more) ** 0.5  # a median's standard error, by the quartiles
    return (
        f"{1e3 * usual:.1f} ms, checking {100 * added / usual:+.1f} ± {100 * error / usual:.1f} %"
    )


def unchecked(codec: Crc32cCodec, chunk_bytes, chunk_spec):
    """A chunk without its checksum, which nobody looks at."""
    inner = chunk_bytes.as_numpy_array()[:-4]
    return chunk_spec.prototype.buffer.from_array_like(inner)


def main() -> None:
    """Print a row for each way of reading."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=96)
    count = parser.parse_args().frames
    with TemporaryDirectory() as place:
        folder = Path(place) / "run"
        leave_run(folder, count)

        def load(name: str) -> None:
            with isochrome.open_run(folder) as run:
                run[name].load()

        def export(to: str) -> None:
            isochrome.export(folder, to, Path(place) / "out")
            shutil.rmtree(Path(place) / "out")

        ways = {
            "export --to tiff": lambda: export("tiff"),
            "export --to netcdf": lambda: export("netcdf"),
            "open_run, whole steps": lambda: load("steps"),
            "open_run, single precision": lambda: load("single"),
        }
        for name, read in ways.items():
            disk, cache, processor = (
                compared(took, read, folder) for took in (from_disk_s, from_cache_s, processor_s)
            )
            print(f"{name}: from the disk {disk}; from the page cache {cache}, of the processor's")
            print(f"    time {processor}", flush=True)


if __name__ == "__main__":
    main()
