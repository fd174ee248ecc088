"""A finished chunk on disk: its files, each whole, and a record of their checksums."""

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.output import write_frames
from isochrome.runs.integrity import (
    SUM_BYTES,
    FileSum,
    checksum_of,
    crc32c,
    is_as_left,
    is_record,
    sum_bytes,
)
from isochrome.runs.job import Layer, Results, RunLayout

STORE = "run.zarr"
MANIFEST, RECORDS = "manifest.json", "records"
"""In a working folder what the run is a result of; the folder of the chunks' records."""

_NO_MAP = 2**64 - 1
"""Place and length of a map that is not there, by zarr's sharding codec."""


@dataclass(frozen=True)
class RunFolder:
    """Where a run's chunks are put down: picklable, so that workers may do it.

    `results`, the folder that becomes the output, in the run's working folder; `layout`, what the
    run leaves; `digest`, of what the run is a result of, see `identity_digest`; the chunks' records
    hold it.
    """

    results: Path
    layout: RunLayout
    digest: str

    @property
    def root(self) -> Path:
        """The working folder."""
        return self.results.parent

    @property
    def records(self) -> Path:
        """The folder of the chunks' records: beside a store, of which damage can be mended by them.

        What has no store is made of its chunks' parts, as large as the results, and they go.
        """
        return (self.results if self.layout.store else self.root) / RECORDS

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
    sums: dict[str, dict[str, FileSum]] = {"layers": {}, "parts": {}}
    for layer in run.layout.layers:
        if layer.compact is not None:
            pieces = _shard(results.packed[layer.name], run.layout.chunk)
        else:
            values = np.ascontiguousarray(results.arrays[layer.name], dtype="<f4")
            assert values.shape == (end - first, *run.layout.shape.values()), layer.name
            padding = int(np.prod(run.layout.chunk_shape)) - values.size
            pieces = [values.data.cast("B"), np.full(padding, np.nan, dtype="<f4").tobytes()]
            pieces.append(sum_bytes(crc32c(*pieces)))
        write_through(run.chunk_file(layer.name, index), *pieces)
        size = sum(memoryview(piece).nbytes for piece in pieces)
        sums["layers"][layer.name] = size, checksum_of(*pieces)
    for name, part in results.parts.items():
        write_through(run.part_file(name, index), part)
        sums["parts"][name] = len(part), checksum_of(part)
    states = [more["status"] for more in results.more]
    record = ChunkRecord(stop - start, sum(s != "ok" for s in states), states.count("failed"))
    body = {
        "of": run.digest,
        **sums,
        "flagged": record.flagged,
        "failed": record.failed,
        "rows": [_plain(row) for row in results.rows],
        "more": [_plain(more) for more in results.more],
        "left": results.left,
    }
    write_checked(run.record_file(index), body)
    return record


def _shard(maps: list[bytes | None], count: int) -> list[bytes | memoryview]:
    """The pieces of a shard's file: its items' maps, then where each lies and how long it is.

    Behind each, and behind the places, stands its checksum.
    Parameters: `maps`, None where an item has none; `count` of items in a shard. Source: the zarr
    format's specification of its sharding and crc32c codecs, the index at the end.
    """
    index = np.full((count, 2), _NO_MAP, dtype="<u8")
    pieces, at = list[bytes | memoryview](), 0
    for number, data in enumerate(maps):
        if data is not None:
            index[number] = at, len(data) + SUM_BYTES
            pieces += [data, sum_bytes(crc32c(data))]
            at += len(data) + SUM_BYTES
    places = index.tobytes()
    return [*pieces, places, sum_bytes(crc32c(places))]


def _of_shard(file: Path, place: int, count: int) -> bytes | None:
    """A map of a shard's file, packed; None where it has none there. Raises OSError."""
    with open(file, "rb") as shard:
        shard.seek(-SUM_BYTES - 16 * count, os.SEEK_END)
        at, length = np.frombuffer(shard.read(16 * count), "<u8").reshape(count, 2)[place].tolist()
        if length == _NO_MAP:
            return None
        shard.seek(at)
        return shard.read(length - SUM_BYTES)


def read_record_of(run: RunFolder, index: int) -> dict[str, Any] | None:
    """A chunk's record; None where none of this run is there, whole. Raises OSError."""
    file = run.record_file(index)
    record: dict[str, Any] | None = read_checked(file) if is_record(file) else None
    return record if record is not None and record.get("of") == run.digest else None


def check_chunk(run: RunFolder, index: int) -> ChunkRecord | None:
    """What a chunk holds, after its files were read and compared with their checksums; else None.

    Parameters: `run`; `index`. Raises OSError.
    """
    record = read_record_of(run, index)
    if record is None:
        return None
    start, stop = run.layout.span(index)
    try:
        for name, expected in record["layers"].items():
            if not is_as_left(run.chunk_file(name, index), expected):
                return None
        for name, expected in record["parts"].items():
            if not is_as_left(run.part_file(name, index), expected):
                return None
    except FileNotFoundError:
        return None
    return ChunkRecord(stop - start, record["flagged"], record["failed"])


def rows(run: RunFolder) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Give each item's row and what else is known of it, in order, from the chunks' records."""
    for index in range(run.layout.chunks):
        record = read_record_of(run, index)
        assert record is not None
        yield from zip(record["rows"], record["more"], strict=True)


def parts(run: RunFolder, name: str) -> Iterator[bytes]:
    """Give the chunks' parts of a file, in order; chunks without one are passed over."""
    for index in range(run.layout.chunks):
        file = run.part_file(name, index)
        if file.is_file():
            yield file.read_bytes()


def picture(run: RunFolder, layer: str, item: int) -> np.ndarray:
    """Read a layer's picture of one item that has one, from the store's chunk.

    Returns (rows, cols), NaN = not known.
    """
    index, inside = divmod(item, run.layout.chunk)
    file, size = run.chunk_file(layer, index), tuple(run.layout.shape.values())
    compact = run.layout.layer(layer).compact
    if compact is not None:
        packed = _of_shard(file, inside, run.layout.chunk)
        return np.full(size, np.nan, "<f4") if packed is None else compact.unpack(packed, size)
    each, remainder = divmod(inside, run.layout.every)
    assert remainder == 0, f"item {item} has no picture"
    stored = np.memmap(
        file, dtype="<f4", mode="r", shape=(run.layout.chunk // run.layout.every, *size)
    )
    return np.array(stored[each])


def write_stack(
    run: RunFolder, layer: Layer, view: Mapping[str, Any], *, pixel_mm: float | None
) -> None:
    """Write a layer's TIFF stack, of its pictures as the store has them.

    Parameters: `run`, all of whose chunks are there; `layer`; `view`, what ImageJ is to know of it,
    see `imagej_view`; `pixel_mm`, None = not known. Raises OSError, InputError.
    """
    items = run.layout.paged_items(layer)
    pictures = (picture(run, layer.name, item) for item in items)
    write_frames(
        run.results / f"{layer.name}.tif", pictures,
        (len(items), *list(run.layout.shape.values())[-2:]), np.dtype("<f4"),
        pixel_mm=pixel_mm, metadata=view,
    )  # fmt: skip


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
    write_through(path, b"%08x\n" % crc32c(text), text)


def read_checked(path: Path) -> Any:
    """What `write_checked` wrote; None where it is not there, or not whole. Raises OSError."""
    try:
        head, _, body = path.read_bytes().partition(b"\n")
    except FileNotFoundError:
        return None
    return json.loads(body) if head == b"%08x" % crc32c(body) else None


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
