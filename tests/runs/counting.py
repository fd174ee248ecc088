"""A job whose results are known beforehand, and files that tell who computed what of it."""

import json
import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from isochrome.runs import Job, Layer, Results, RunLayout, parts, rows, write_stack

ROWS, COLS = 5, 7
IDENTITY = {
    "isochrome": "1", "scene": "a = 1\nb = 2\n",
    "inputs_sha256": {"film.avi": "00", "dark.tif": "11"}, "options": {"rois": False}, "seed": 1,
    "code_sha256": 64 * "0", "libraries": {"python": "3", "numpy": "2"},
}  # fmt: skip


def truth(item):
    """The picture of an item: item + row / 8 + col / 64, exact in float32."""
    row, col = np.mgrid[:ROWS, :COLS]
    return (item + row / 8 + col / 64).astype(np.float32)


@dataclass(frozen=True)
class Count:
    """Work: it notes each call in a folder; it fails at an item, or waits, where it is told to.

    `seconds` of each item; `fail_at`, an item at which `failure` is raised while `switch` is there;
    `every`, of how many items the first has a picture; `failed`, an item in which it finds nothing.
    """

    notes: Path
    seconds: float = 0.0
    fail_at: int | None = None
    failure: type[BaseException] = KeyboardInterrupt
    switch: Path | None = None
    every: int = 1
    failed: int | None = None

    def __call__(self, start, stop):
        with open(self.notes / f"{os.getpid()}.txt", "a", encoding="utf-8") as file:
            file.write(f"{start}\n")
        for item in range(start, stop):
            time.sleep(self.seconds)
            if item == self.fail_at and self.switch is not None and self.switch.exists():
                if self.failure is SystemExit:
                    os._exit(9)
                raise self.failure(f"item {item} is bad")
        items = range(start, stop)
        return Results(
            {"order": np.stack([truth(i) for i in items if i % self.every == 0])},
            [{"frame": i, "third": i / 3, "even": None if i % 2 else i} for i in items],
            [{"status": self.status(i)} for i in items],
            {"lines.txt": "".join(f"{i}\n" for i in items if i % 2).encode()},
        )

    def status(self, item):
        if item == self.failed:
            return "failed"
        return "flagged" if item % 10 == 3 else "ok"


def job(work, count=10, chunk=3, identity=IDENTITY):
    layers = (Layer("order", "1", "fringe order"),)
    shape = {"row": ROWS, "col": COLS}
    layout = RunLayout(
        axes={"frame": count}, shape=shape, layers=layers, chunk=chunk,
        every=work.every,
    )  # fmt: skip
    return Job(work, layout, identity)


def finish(bench):
    """Write the rows, the joined parts and the stack; return the rows."""
    found = [row for row, _ in rows(bench)]
    (bench.results / "rows.json").write_text(json.dumps(found), "utf-8")
    (bench.results / "lines.txt").write_bytes(b"".join(parts(bench, "lines.txt")))
    (order,) = bench.layout.layers
    write_stack(bench, order, {}, pixel_mm=0.01)
    return found


def calls(notes):
    """Starts of all chunks that were computed, sorted."""
    return sorted(int(line) for f in notes.glob("*.txt") for line in f.read_text("utf-8").split())


def computed_again(notes, chunks):
    """How many chunks were computed more than once, of so many in all."""
    return len(calls(notes)) - chunks


def contents(folder):
    """All files below a folder with their bytes, and all folders."""
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() if p.is_file() else None
        for p in folder.rglob("*")
    }


def put(folder, files):
    """Make a folder of such contents."""
    for name, data in sorted(files.items()):
        if data is None:
            (folder / name).mkdir(parents=True, exist_ok=True)
        else:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(data)
