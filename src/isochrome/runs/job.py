"""What a long run is made of: chunks of items, each by one pure function; and what it is of.

A finished chunk is its files, each whole, and a record of their checksums.
"""

import hashlib
import json
import math
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import isochrome
from isochrome.output import InputContent, provenance
from isochrome.runs import integrity

LIBRARIES = ("numpy", "scipy", "scikit-image", "opencv-python-headless", "tifffile", "pillow", "av")
"""Those whose version may change a result's bits."""

_LABELS = {
    "options": "the options",
    "isochrome": "Isochrome's version",
    "code_sha256": "Isochrome's own code",
    "libraries": "the version of Python or a library",
    "seed": "the seed",
}
"""What a run is a result of besides its scene and its input, in words."""


@cache
def environment() -> dict[str, Any]:
    """The code that computes: Isochrome's version and a hash of its files, Python, libraries."""
    home = Path(isochrome.__file__).parent
    digest = hashlib.sha256()
    for file in sorted(home.rglob("*.py"), key=lambda f: f.relative_to(home).as_posix()):
        digest.update(file.relative_to(home).as_posix().encode() + b"\0" + file.read_bytes())
    libraries = {"python": platform.python_version()}
    for name in LIBRARIES:
        with suppress(PackageNotFoundError):  # an optional one
            libraries[name] = version(name)
    return {
        "isochrome": isochrome.__version__,
        "code_sha256": digest.hexdigest(),
        "libraries": libraries,
    }


def run_identity(
    scene_toml: str,
    files: Iterable[InputContent],
    options: Mapping[str, Any],
    seed: int | None = None,
) -> dict[str, Any]:
    """What a run is a result of, as provenance.json keeps it: scene, files, code and options."""
    return provenance(scene_toml, files, seed) | environment() | {"options": dict(options)}


def identity_digest(identity: Mapping[str, Any]) -> str:
    """A hash of what a run is a result of, the same where `difference` finds none."""
    files = [
        [Path(name).name, checksum] for name, checksum in (identity["inputs_sha256"] or {}).items()
    ]
    parts = [identity.get(key) for key in ("scene", *_LABELS)]
    return hashlib.sha256(json.dumps([files, parts]).encode()).hexdigest()


def difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> str | None:
    """What differs between two runs' identities, in words; the same files elsewhere are the
    same."""
    if old.get("scene") != new.get("scene"):
        return f"the scene ({_first_line(old.get('scene'), new.get('scene'))})"
    before, now = (list((run.get("inputs_sha256") or {}).items()) for run in (old, new))
    names = [[Path(name).name for name, _ in files] for files in (before, now)]
    if names[0] != names[1]:
        differing = sorted(set(names[0]) ^ set(names[1]))
        return f"the input files ({', '.join(differing[:3]) or 'their order'})"
    if changed := [name for (_, a), (name, b) in zip(before, now, strict=True) if a != b]:
        return f"the content of {changed[0]}"
    for key, label in _LABELS.items():
        if old.get(key) != new.get(key):
            return f"{label} ({_pair(old.get(key), new.get(key))})"
    return None


def _first_line(old: Any, new: Any) -> str:
    lines = zip_longest(str(old).splitlines(), str(new).splitlines())
    before, now = next((pair for pair in lines if pair[0] != pair[1]), ("", ""))
    if before is None:
        return f"'{now}' is new"
    return f"'{before}' is no longer there" if now is None else f"'{before}' is now '{now}'"


def _pair(old: Any, new: Any) -> str:
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        keys = [key for key in {**old, **new} if old.get(key) != new.get(key)]
        return f"{keys[0]}: {old.get(keys[0])}, now {new.get(keys[0])}"
    return "its files" if isinstance(old, str) and len(old) == 64 else f"{old}, now {new}"


CHUNK_BYTES = 24_000_000
"""Of one layer in one chunk; a few chunks of all layers are in memory at a time."""
LARGEST_CHUNK = 32
"""Items in a chunk: what a crash may cost."""


@dataclass(frozen=True)
class Compact:
    """How maps are kept in whole steps of one or two bytes, compressed one by one.

    Blosc's Zstandard at its first level, its bytes shuffled: of an order read from noise of 3 grey
    levels it leaves 1.2 bytes a pixel in 1.4 ms a frame of 659 x 494; higher levels take 4 to 500
    ms for 3 to 13 % less, LZ4 0.6 ms for 12 % more. `step`, what a value is a multiple of; `pages`,
    whether the TIFF stack too has a page for every item.
    """

    step: float
    bits: int
    pages: bool = False

    @property
    def dtype(self) -> np.dtype[Any]:
        """The stored type, little-endian."""
        return np.dtype(f"<u{self.bits // 8}")

    @property
    def unknown(self) -> int:
        """What stands for NaN."""
        return int(2**self.bits - 1)

    @property
    def largest(self) -> float:
        """The largest value that can be kept."""
        return (self.unknown - 1) * self.step

    def shards(self, shape: tuple[int, ...]) -> Any:
        """How zarr reads a file of many maps of a shape (rows, cols), each of them by itself."""
        from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec, ShardingCodec

        size = self.dtype.itemsize
        packing = BloscCodec(typesize=size, cname="zstd", clevel=1, shuffle="shuffle")
        return ShardingCodec(
            chunk_shape=(1, *shape),
            codecs=[BytesCodec(), packing, Crc32cCodec()],
            index_codecs=[BytesCodec(), Crc32cCodec()],
        )

    def pack(self, values: NDArray[Any]) -> bytes:
        """A map (rows, cols) as it is stored; what is larger than `largest` is not known."""
        from numcodecs import blosc

        codec = blosc.Blosc(cname="zstd", clevel=1, shuffle=blosc.SHUFFLE)
        beyond = ~(values <= self.largest)  # NaN too
        scaled = values / np.float32(self.step)
        np.rint(scaled, out=scaled)
        np.copyto(scaled, np.float32(self.unknown), where=beyond)
        before, blosc.use_threads = blosc.use_threads, False  # whose order is chance
        try:
            return bytes(codec.encode(scaled.astype(self.dtype)))
        finally:
            blosc.use_threads = before


@dataclass(frozen=True)
class Layer:
    """A picture for each item, float32, NaN = not known.

    `units`, '1' for none; `stack`, whether it is left as a TIFF stack too; `compact`, how the store
    has it, then for every item, whatever the layout's `every`.
    """

    name: str
    units: str
    what: str
    stack: bool = True
    compact: Compact | None = None


@dataclass(frozen=True, kw_only=True)
class RunLayout:
    """What a run leaves, by its input alone.

    `chunk`, items that are computed and kept together, 1 where there are several axes; of `every`
    so many items only the first has pictures, on an axis of their own: one axis over the items, and
    `chunk` a multiple.
    """

    axes: Mapping[str, int]  # over the items: sizes by their names
    shape: Mapping[str, int] = field(default_factory=dict)  # the same of an item's picture
    layers: tuple[Layer, ...] = ()
    chunk: int
    store: bool = True  # whether run.zarr is left; it is where there are layers
    part_bytes: int = 0  # of the parts of files that an item gives
    every: int = 1

    @property
    def count(self) -> int:
        """Number of items."""
        return math.prod(self.axes.values())

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.count // self.chunk)

    def span(self, index: int) -> tuple[int, int]:
        """First item of a chunk, and the one after its last."""
        return index * self.chunk, min((index + 1) * self.chunk, self.count)

    @property
    def picture_axes(self) -> Mapping[str, int]:
        """The axes over the pictures: those over the items, or `key_` and the one of them."""
        if self.every == 1:
            return self.axes
        ((name, count),) = self.axes.items()
        return {f"key_{name}": -(-count // self.every)}

    def pictures(self, start: int, stop: int) -> tuple[int, int]:
        """First picture of the items [start, stop), and the one after its last."""
        return -(-start // self.every), -(-stop // self.every)

    def paged_items(self, layer: Layer) -> range:
        """The items that have a page in a layer's TIFF stack."""
        every_item = layer.compact is not None and layer.compact.pages
        return range(0, self.count, 1 if every_item else self.every)

    @property
    def chunk_shape(self) -> tuple[int, ...]:
        """Shape of a layer's chunk, the axes over the pictures first."""
        return (*(1,) * (len(self.axes) - 1), self.chunk // self.every, *self.shape.values())

    def key(self, index: int) -> str:
        """Where the zarr format (version 3) puts a chunk, below the folder of its array."""
        counts = tuple(self.axes.values())  # of several axes, each item has its chunk
        place = (index,) if len(counts) == 1 else np.unravel_index(index, counts)
        return "/".join(["c", *(str(int(k)) for k in place), *("0" for _ in self.shape)])


@dataclass(frozen=True)
class Results:
    """What a chunk's computation gives.

    `arrays`, by layer, a picture for each item but where the layout says `every`; of a compact one
    the map of every item as `Compact.pack` gives it, or None. `more`, what else is known of each
    item, among it its `status`: 'ok', 'flagged' (it has warnings) or 'failed' (nothing was found in
    it).
    """

    arrays: Mapping[str, Any]
    rows: list[dict[str, Any]]
    more: list[dict[str, Any]]
    parts: Mapping[str, bytes] = field(default_factory=dict)  # of files that all chunks make
    left: Mapping[str, Any] | None = None  # for the next chunk, where they are computed in turn


Work = Callable[[int, int], Results]
"""Compute items [start, stop): the same results wherever and whenever it is called; picklable."""

InTurn = Callable[[int, int, Any], Results]
"""The same from what the chunk before has left, None for the first."""


@dataclass(frozen=True)
class Job:
    """A long run.

    `layout`, what it leaves; `identity`, what it is a result of; `in_turn`, whether each chunk
    needs what the one before has left: then one process computes all.
    """

    work: Work | InTurn
    layout: RunLayout
    identity: Mapping[str, Any]
    in_turn: bool = False


def chunk_size(count: int, item_bytes: int) -> int:
    """A chunk's items, of `item_bytes` in a layer: memory is bounded, and a few workers have
    shares."""
    return max(1, min(LARGEST_CHUNK, CHUNK_BYTES // max(item_bytes, 1), -(-count // 8)))


STORE = "run.zarr"
MANIFEST, RECORDS = "manifest.json", "records"
"""In a working folder what the run is a result of; the folder of the chunks' records."""

_NO_MAP = np.iinfo(np.uint64).max
"""Place and length of a map that is not there, by zarr's sharding codec."""


@dataclass(frozen=True)
class RunFolder:
    """Where a run's chunks are put down: picklable, so that workers may do it.

    `results`, the folder that becomes the output, in the run's working folder; `digest`, see
    `identity_digest`, which the chunks' records hold.
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
    """Put a chunk down: pictures, parts, and last its record, each file whole or not at all."""
    start, stop = run.layout.span(index)
    first, end = run.layout.pictures(start, stop)
    sums: dict[str, dict[str, tuple[int, int]]] = {"layers": {}, "parts": {}}  # bytes, checksums
    for layer in run.layout.layers:
        if layer.compact is not None:
            pieces = _shard(results.arrays[layer.name], run.layout.chunk)
        else:
            values = np.ascontiguousarray(results.arrays[layer.name], dtype="<f4")
            assert values.shape == (end - first, *run.layout.shape.values()), layer.name
            padding = int(np.prod(run.layout.chunk_shape)) - values.size
            pieces = [values.data.cast("B"), np.full(padding, np.nan, dtype="<f4").tobytes()]
            pieces.append(integrity.sum_bytes(integrity.crc32c(*pieces)))
        integrity.write_through(run.chunk_file(layer.name, index), *pieces)
        size = sum(memoryview(piece).nbytes for piece in pieces)
        sums["layers"][layer.name] = size, integrity.checksum_of(*pieces)
    for name, part in results.parts.items():
        integrity.write_through(run.part_file(name, index), part)
        sums["parts"][name] = len(part), integrity.checksum_of(part)
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
    integrity.write_checked(run.record_file(index), body)
    return record


def _shard(maps: Sequence[Any], count: int) -> list[bytes | memoryview]:
    """The pieces of a shard's file: its items' maps, then where each lies and how long it is.

    Each with its checksum. Source: the zarr format's sharding and crc32c codecs, index at the end.
    """
    index = np.full((count, 2), _NO_MAP, dtype="<u8")
    pieces, at = list[bytes | memoryview](), 0
    for number, data in enumerate(maps):
        if data is not None:
            index[number] = at, len(data) + integrity.SUM_BYTES
            pieces += [data, integrity.sum_bytes(integrity.crc32c(data))]
            at += len(data) + integrity.SUM_BYTES
    places = index.tobytes()
    return [*pieces, places, integrity.sum_bytes(integrity.crc32c(places))]


def read_record_of(run: RunFolder, index: int) -> dict[str, Any] | None:
    """A chunk's record; None where none of this run is there, whole. Raises OSError."""
    file = run.record_file(index)
    record: dict[str, Any] | None = (
        integrity.read_checked(file) if integrity.is_record(file) else None
    )
    return record if record is not None and record.get("of") == run.digest else None


def check_chunk(run: RunFolder, index: int) -> ChunkRecord | None:
    """What a chunk holds, once its files were read and are as their checksums say; else None."""
    record = read_record_of(run, index)
    if record is None:
        return None
    start, stop = run.layout.span(index)
    files = [(run.chunk_file(name, index), expected) for name, expected in record["layers"].items()]
    files += [(run.part_file(name, index), expected) for name, expected in record["parts"].items()]
    with suppress(FileNotFoundError):
        # of another size, a file is not read
        if all(
            integrity.is_plain(file)
            and file.stat().st_size == size
            and integrity.file_sum(file) == checksum
            for file, (size, checksum) in files
        ):
            return ChunkRecord(stop - start, record["flagged"], record["failed"])
    return None


def rows(run: RunFolder) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Give each item's row and what else is known of it, in order, from the chunks' records."""
    for index in range(run.layout.chunks):
        record = read_record_of(run, index)
        assert record is not None
        yield from zip(record["rows"], record["more"], strict=True)


def parts(run: RunFolder, name: str) -> Iterator[bytes]:
    """Give the chunks' parts of a file, in order; chunks without one are passed over."""
    for index in range(run.layout.chunks):
        if (file := run.part_file(name, index)).is_file():
            yield file.read_bytes()


def _plain(row: dict[str, Any]) -> dict[str, Any]:
    """A row with numpy's numbers as plain ones; NaN stays NaN, every float keeps all its bits."""
    return {k: v.item() if isinstance(v, np.generic) else v for k, v in row.items()}
