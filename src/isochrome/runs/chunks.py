"""A finished chunk on disk: its files, each whole, and a record of their checksums."""

from __future__ import annotations

import json
import os
import shutil
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.output import TiffCanvas
from isochrome.runs.job import Layer, Results, RunLayout
from isochrome.runs.store import STORE

MANIFEST, RECORDS = "manifest.json", "chunks"
"""In a working folder: what the run is a result of, and the folder of the chunks' records."""


@dataclass(frozen=True)
class RunFolder:
    """Where a run's chunks are put down: picklable, so that workers may do it.

    Parameters
    ----------
    results : Path
        The folder that becomes the output.
    records : Path
        The folder of the chunks' records.
    layout : RunLayout
        What the run leaves.
    stacks : dict of str to TiffCanvas
        The TIFF stacks by the name of their layer.
    """

    results: Path
    records: Path
    layout: RunLayout
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
class ChunkRecord:
    """A chunk's record: how many items it has, how many of them are `flagged` and `failed`."""

    items: int
    flagged: int
    failed: int


def keep(run: RunFolder, index: int, results: Results) -> ChunkRecord:
    """Put a chunk down: pictures, parts, and last its record, each file whole or not at all.

    Parameters: `run`; `index` of the chunk; `results`, of all its items. Returns what it holds.
    Raises OSError; then the chunk is not finished.
    """
    start, stop = run.layout.span(index)
    first, end = run.layout.pictures(start, stop)
    sums: dict[str, list[int]] = {}
    for layer in run.layout.layers:
        values = np.ascontiguousarray(results.arrays[layer.name], dtype="<f4")
        assert values.shape == (end - first, *run.layout.shape.values()), layer.name
        data = values.data.cast("B")
        short = zlib.crc32(data)
        if layer.compact is not None and layer.compact.pages:
            short = _write_pages(run, layer, start, results.packed[layer.name])
        elif layer.name in run.stacks:
            run.stacks[layer.name].write(first, [data])
        if layer.compact is not None:
            pieces: list[bytes | memoryview] = _shard(results.packed[layer.name], run.layout.chunk)
        else:
            rest = int(np.prod(run.layout.chunk_shape)) - values.size
            pieces = [data, np.full(rest, np.nan, dtype="<f4").tobytes()]
        write_through(run.chunk_file(layer.name, index), *pieces)
        whole = 0
        for piece in pieces:
            whole = zlib.crc32(piece, whole)
        sums[layer.name] = [short, whole]
    for name, part in results.parts.items():
        write_through(run.part_file(name, index), part)
    states = [more["status"] for more in results.more]
    kept = ChunkRecord(stop - start, sum(s != "ok" for s in states), states.count("failed"))
    body = {
        "layers": sums,
        "parts": {name: zlib.crc32(part) for name, part in results.parts.items()},
        "flagged": kept.flagged,
        "failed": kept.failed,
        "rows": [_plain(row) for row in results.rows],
        "more": [_plain(more) for more in results.more],
        "left": results.left,
    }
    write_checked(run.record_file(index), body)
    return kept


def _write_pages(run: RunFolder, layer: Layer, start: int, maps: list[bytes | None]) -> int:
    """Write the map of every item as the store has it into the TIFF stack, one after the other.

    Parameters: `run`; `layer`, a compact one; `start`, the first item; their packed `maps`. Returns
    the checksum of all pages. Raises OSError.
    """
    compact, shape = layer.compact, tuple(run.layout.shape.values())
    assert compact is not None
    blank = np.full(shape, np.nan, dtype="<f4")
    checksum = 0

    def pages() -> Iterator[memoryview]:
        nonlocal checksum
        for data in maps:
            page = blank if data is None else compact.unpack(data, shape)
            raw = np.ascontiguousarray(page, dtype="<f4").data.cast("B")
            checksum = zlib.crc32(raw, checksum)
            yield raw

    run.stacks[layer.name].write(start, pages())
    return checksum


def _shard(maps: list[bytes | None], count: int) -> list[bytes | memoryview]:
    """The pieces of a shard's file: its items' maps, then where each lies and how long it is.

    Parameters: `maps`, None where an item has none; `count` of items in a shard. Source: the zarr
    format's specification of its sharding codec, the index at the end.
    """
    index = np.full((count, 2), 2**64 - 1, dtype="<u8")  # no map
    pieces, at = list[bytes | memoryview](), 0
    for number, data in enumerate(maps):
        if data is not None:
            index[number] = at, len(data)
            pieces.append(data)
            at += len(data)
    return [*pieces, index.tobytes()]


def read_record(run: RunFolder, index: int) -> dict[str, Any] | None:
    """A chunk's record; None where it is not there or not whole. Raises OSError."""
    record: dict[str, Any] | None = read_checked(run.record_file(index))
    return record


def check_chunk(run: RunFolder, index: int) -> ChunkRecord | None:
    """What a chunk holds, after its files were read and compared with their checksums; else None.

    Parameters: `run`; `index`. Raises OSError.
    """
    record = read_record(run, index)
    if record is None:
        return None
    start, stop = run.layout.span(index)
    try:
        for name, (short, long) in record["layers"].items():
            if zlib.crc32(run.chunk_file(name, index).read_bytes()) != long:
                return None
            stack = run.stacks.get(name)
            first, end = run.layout.pages(run.layout.layer(name), start, stop)
            if stack is not None and stack.checksum(first, end - first) != short:
                return None
        for name, checksum in record["parts"].items():
            if zlib.crc32(run.part_file(name, index).read_bytes()) != checksum:
                return None
    except FileNotFoundError:
        return None
    return ChunkRecord(stop - start, record["flagged"], record["failed"])


def rows(run: RunFolder) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Give each item's row and what else is known of it, in order, from the chunks' records.

    Parameters
    ----------
    run : RunFolder
        Where the chunks lie.

    Yields
    ------
    tuple of dict
        The row, and what else is known.
    """
    for index in range(run.layout.chunks):
        record = read_record(run, index)
        assert record is not None
        yield from zip(record["rows"], record["more"], strict=True)


def parts(run: RunFolder, name: str) -> Iterator[bytes]:
    """Give the chunks' parts of a file, in order; chunks without one are passed over.

    Parameters
    ----------
    run : RunFolder
        Where the chunks lie.
    name : str
        Name of the file.

    Yields
    ------
    bytes
        The part.
    """
    for index in range(run.layout.chunks):
        file = run.part_file(name, index)
        if file.is_file():
            yield file.read_bytes()


def picture(run: RunFolder, layer: str, item: int) -> np.ndarray:
    """Read a layer's picture of one item that has one, from the store's chunk.

    Parameters
    ----------
    run : RunFolder
        Where the chunks lie.
    layer : str
        Name of the layer.
    item : int
        Number of the item.

    Returns
    -------
    ndarray of float32, shape (rows, cols)
        The picture, NaN = not known.
    """
    index, inside = divmod(item, run.layout.chunk)
    each, rest = divmod(inside, run.layout.every)
    assert rest == 0, f"item {item} has no picture"
    kept = run.stacks.get(layer)
    if kept is not None:  # the store may have it in whole steps
        page, _ = run.layout.pages(run.layout.layer(layer), item, item + 1)
        data = kept.read(page, 1)
        return np.frombuffer(data, "<f4").reshape(kept.shape[1:]).copy()
    flat = np.memmap(run.chunk_file(layer, index), dtype="<f4", mode="r")
    shape = (run.layout.chunk // run.layout.every, *run.layout.shape.values())
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


def write_checked(path: Path, body: dict[str, Any]) -> None:
    """Write an object as JSON below a line with its checksum. Raises OSError."""
    text = json.dumps(body).encode()
    write_through(path, b"%08x\n" % zlib.crc32(text), text)


def read_checked(path: Path) -> Any:
    """What `write_checked` wrote; None where it is not there, or not whole. Raises OSError."""
    try:
        head, _, body = path.read_bytes().partition(b"\n")
    except FileNotFoundError:
        return None
    return json.loads(body) if head == b"%08x" % zlib.crc32(body) else None


def remove(entry: Path) -> None:
    """Remove a file, a link, or a folder with all that is in it. Raises OSError."""
    if entry.is_dir() and not entry.is_symlink():
        shutil.rmtree(entry)
    else:
        entry.unlink()


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
