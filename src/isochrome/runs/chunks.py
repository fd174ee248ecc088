"""A finished chunk on disk: its files, each whole, and a record of their checksums."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.output.canvas import TiffCanvas
from isochrome.runs.job import Layout, Results, Work
from isochrome.runs.store import STORE


@dataclass(frozen=True)
class Bench:
    """Where a run's chunks are put down: picklable, so that workers may do it.

    `results`, the folder that becomes the output; `records`, that of the chunks' records;
    `layout`; `stacks`, the TIFF stacks by the name of their layer.
    """

    results: Path
    records: Path
    layout: Layout
    stacks: dict[str, TiffCanvas]

    def chunk_file(self, layer: str, index: int) -> Path:
        """The file of a layer's chunk in the store."""
        return self.results / STORE / layer / self.layout.key(index)

    def part_file(self, name: str, index: int) -> Path:
        """The file of a chunk's part of the file `name`."""
        return self.records / f"{index:08d}-{name}"

    def record_file(self, index: int) -> Path:
        """The file whose being there, whole, says that the chunk is finished."""
        return self.records / f"{index:08d}.json"


@dataclass(frozen=True)
class Kept:
    """A chunk's record: how many items it has, how many of them are `flagged` and `failed`."""

    items: int
    flagged: int
    failed: int


def work_and_keep(work: Work, bench: Bench, index: int) -> Kept:
    """Compute a chunk and put it down, as a worker on this machine does. Raises OSError."""
    return keep(bench, index, work(*bench.layout.span(index)))


def keep(bench: Bench, index: int, results: Results) -> Kept:
    """Put a chunk down: pictures, parts, and last its record, each file whole or not at all.

    Parameters: `bench`; `index` of the chunk; `results`, of all its items. Returns what it holds.
    Raises OSError; then the chunk is not finished.
    """
    start, stop = bench.layout.span(index)
    first, end = bench.layout.pictures(start, stop)
    sums: dict[str, list[int]] = {}
    for layer in bench.layout.layers:
        values = np.ascontiguousarray(results.arrays[layer.name], dtype="<f4")
        assert values.shape == (end - first, *bench.layout.shape.values()), layer.name
        data = values.data.cast("B")
        rest = int(np.prod(bench.layout.chunk_shape)) - values.size
        padding = np.full(rest, np.nan, dtype="<f4").tobytes()
        write_through(bench.chunk_file(layer.name, index), data, padding)
        if layer.name in bench.stacks:
            bench.stacks[layer.name].write(first, data)
        sums[layer.name] = [zlib.crc32(data)]
        sums[layer.name].append(zlib.crc32(padding, sums[layer.name][0]))
    for name, part in results.parts.items():
        write_through(bench.part_file(name, index), part)
    states = [more["status"] for more in results.more]
    kept = Kept(stop - start, sum(s != "ok" for s in states), states.count("failed"))
    body = {
        "layers": sums,
        "parts": {name: zlib.crc32(part) for name, part in results.parts.items()},
        "flagged": kept.flagged,
        "failed": kept.failed,
        "rows": [_plain(row) for row in results.rows],
        "more": [_plain(more) for more in results.more],
        "left": results.left,
    }
    text = json.dumps(body).encode()
    write_through(bench.record_file(index), b"%08x\n" % zlib.crc32(text), text)
    return kept


def read_record(bench: Bench, index: int) -> dict[str, Any] | None:
    """A chunk's record; None where it is not there or not whole. Raises OSError."""
    try:
        text = bench.record_file(index).read_bytes()
    except FileNotFoundError:
        return None
    head, _, body = text.partition(b"\n")
    if head != b"%08x" % zlib.crc32(body):
        return None
    found: dict[str, Any] = json.loads(body)
    return found


def check_chunk(bench: Bench, index: int) -> Kept | None:
    """What a chunk holds, after its files were read and compared with their checksums; else None.

    Parameters: `bench`; `index`. Raises OSError.
    """
    record = read_record(bench, index)
    if record is None:
        return None
    start, stop = bench.layout.span(index)
    first, end = bench.layout.pictures(start, stop)
    try:
        for name, (short, long) in record["layers"].items():
            if zlib.crc32(bench.chunk_file(name, index).read_bytes()) != long:
                return None
            stack = bench.stacks.get(name)
            if stack is not None and zlib.crc32(stack.read(first, end - first)) != short:
                return None
        for name, checksum in record["parts"].items():
            if zlib.crc32(bench.part_file(name, index).read_bytes()) != checksum:
                return None
    except FileNotFoundError:
        return None
    return Kept(stop - start, record["flagged"], record["failed"])


def rows(bench: Bench) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Each item's row and what else is known of it, in order, from the chunks' records."""
    for index in range(bench.layout.chunks):
        record = read_record(bench, index)
        assert record is not None
        yield from zip(record["rows"], record["more"], strict=True)


def parts(bench: Bench, name: str) -> Iterator[bytes]:
    """The chunks' parts of the file `name`, in order; chunks without one are passed over."""
    for index in range(bench.layout.chunks):
        file = bench.part_file(name, index)
        if file.is_file():
            yield file.read_bytes()


def picture(bench: Bench, layer: str, item: int) -> np.ndarray:
    """A layer's picture of one item that has one, from the store's chunk."""
    index, inside = divmod(item, bench.layout.chunk)
    each, rest = divmod(inside, bench.layout.every)
    assert rest == 0, f"item {item} has no picture"
    flat = np.memmap(bench.chunk_file(layer, index), dtype="<f4", mode="r")
    shape = (bench.layout.chunk // bench.layout.every, *bench.layout.shape.values())
    return np.array(flat.reshape(shape)[each])


def write_through(path: Path, *data: bytes | memoryview) -> None:
    """Write a file beside its place, through to the disk, and give it its name. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    with open(beside, "wb") as file:
        for piece in data:
            file.write(piece)
        file.flush()
        os.fsync(file.fileno())
    os.replace(beside, path)
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Make a folder's names survive a power cut, where the system knows such a thing."""
    if not hasattr(os, "O_DIRECTORY"):
        return
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _plain(row: dict[str, Any]) -> dict[str, Any]:
    """A row with numpy's numbers as plain ones; NaN stays NaN, every float keeps all its bits."""
    return {k: v.item() if isinstance(v, np.generic) else v for k, v in row.items()}
