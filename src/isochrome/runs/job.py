"""What a long run is made of: chunks of items, each by one pure function; and what it is of."""

import hashlib
import json
import math
import platform
from collections import Counter
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
    ours = {"isochrome": isochrome.__version__, "code_sha256": digest.hexdigest()}
    return ours | {"libraries": libraries}


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
    files = [[Path(name).name, checksum] for name, checksum in _inputs(identity)]
    parts = [identity.get(key) for key in ("scene", *_LABELS)]
    return hashlib.sha256(json.dumps([files, parts]).encode()).hexdigest()


def _inputs(identity: Mapping[str, Any]) -> list[tuple[str, str]]:
    return list((identity.get("inputs_sha256") or {}).items())


def difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> str | None:
    """What differs between two runs' identities, in words; the same files elsewhere are the
    same."""
    if old.get("scene") != new.get("scene"):
        return f"the scene ({_first_line(old.get('scene'), new.get('scene'))})"
    names = [[Path(name).name for name, _ in _inputs(run)] for run in (old, new)]
    if names[0] != names[1]:
        differing = sorted(set(names[0]) ^ set(names[1]))
        return f"the input files ({', '.join(differing[:3]) or 'their order'})"
    for (_, checksum), (name, other) in zip(_inputs(old), _inputs(new), strict=True):
        if checksum != other:
            return f"the content of {name}"
    for key, label in _LABELS.items():
        was, now = old.get(key), new.get(key)
        if was == now:
            continue
        words = f"{was}, now {now}"
        if isinstance(was, Mapping) and isinstance(now, Mapping):
            part = next(k for k in {**was, **now} if was.get(k) != now.get(k))
            words = f"{part}: {was.get(part)}, now {now.get(part)}"
        return f"{label} ({'its files' if key == 'code_sha256' else words})"
    return None


def _first_line(old: Any, new: Any) -> str:
    lines = zip_longest(str(old).splitlines(), str(new).splitlines())
    before, now = next((pair for pair in lines if pair[0] != pair[1]), ("", ""))
    if before is None:
        return f"'{now}' is new"
    return f"'{before}' is no longer there" if now is None else f"'{before}' is now '{now}'"


CHUNK_BYTES = 24_000_000
"""Of one layer in one chunk; a few chunks of all layers are in memory at a time."""
LARGEST_CHUNK = 32
"""Items in a chunk: what a crash may cost."""


@dataclass(frozen=True)
class Compact:
    """How maps are kept in whole `step`s of one or two bytes, compressed one by one. Zstandard's
    first level, bytes shuffled: an order in noise of 3 grey levels takes 1.2 bytes a pixel and 1.4
    ms a frame; higher levels 4 to 500 ms for 3 to 13 % less. `pages`: every item has a page."""

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
        maps: list[Any] = [BytesCodec(), packing, Crc32cCodec()]
        return ShardingCodec(chunk_shape=(1, *shape), codecs=maps, index_codecs=maps[::2])

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
    """A picture for each item, float32, NaN = not known; `units`, '1' for none. `stack`, whether it
    is left as a TIFF stack too; `compact`, how the store has it for every item."""

    name: str
    units: str
    what: str
    stack: bool = True
    compact: Compact | None = None


@dataclass(frozen=True, kw_only=True)
class RunLayout:
    """What a run leaves, by its input alone. `chunk`, items that are computed and kept together, 1
    where there are several axes; of `every` so many items only the first has pictures, on an axis
    of their own, and `chunk` is a multiple."""

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
    """What a chunk's computation gives. `arrays`, by layer, a picture for each item that has one;
    of a compact layer the map of each as `Compact.pack` gives it, or None. `more`, of each item its
    `status`: 'ok', 'flagged' or 'failed'."""

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
    """A long run: what it leaves, and by `identity` what it is a result of. `in_turn`: each chunk
    needs what the one before has left, and one process computes all."""

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
    """Where a run's chunks are put down: picklable, so that workers may do it. `results`, the
    folder that becomes the output; `digest`, see `identity_digest`."""

    results: Path
    layout: RunLayout
    digest: str

    @property
    def root(self) -> Path:
        """The working folder."""
        return self.results.parent

    @property
    def chunk_folder(self) -> Path:
        """The folder of the chunks: with a store the results', whose damage their records mend;
        else they go, for the parts of what has no store are as large as the results."""
        return self.results if self.layout.store else self.root


def record_name(index: int) -> str:
    """The file below `chunk_folder` whose being there, whole, says that a chunk is finished."""
    return f"{RECORDS}/{index:08d}.json"


def keep(run: RunFolder, index: int, results: Results) -> Counter[str]:
    """Put a chunk down: pictures, parts, and last its record, each file whole or not at all; how
    many of its items are of each status."""
    files = dict[str, tuple[int, int]]()  # bytes and checksums

    def put(name: str, pieces: Sequence[bytes | memoryview]) -> None:
        integrity.write_through(run.chunk_folder / name, *pieces)
        size = sum(memoryview(piece).nbytes for piece in pieces)
        files[name] = size, integrity.checksum_of(pieces)

    shape = run.layout.chunk_shape
    for layer in run.layout.layers:
        pictures = results.arrays[layer.name]
        if layer.compact is not None:
            pieces = _shard(pictures, run.layout.chunk)
        else:
            chunk = np.full(shape, np.nan, dtype="<f4")
            chunk.reshape(-1, *run.layout.shape.values())[: len(pictures)] = pictures
            pieces = [data := chunk.data.cast("B"), integrity.sum_bytes(integrity.crc32c(data))]
        put(f"{STORE}/{layer.name}/{run.layout.key(index)}", pieces)
    for name, part in results.parts.items():
        put(_part_name(name, index), [part])
    body: dict[str, Any] = {"of": run.digest, "files": files, "rows": results.rows}
    body |= {"more": results.more, "left": results.left}
    integrity.write_checked(run.chunk_folder / record_name(index), body)
    return _statuses(results.more)


def _part_name(name: str, index: int) -> str:
    return f"{RECORDS}/{index:08d}-{name}"


def _statuses(more: Iterable[Mapping[str, Any]]) -> Counter[str]:
    return Counter(item["status"] for item in more)


def _shard(maps: Sequence[Any], count: int) -> list[bytes | memoryview]:
    """The pieces of a shard's file: maps, where each lies, how long it is, each with its checksum.
    Source: the zarr format's sharding and crc32c codecs, index at the end."""
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
    file = run.chunk_folder / record_name(index)
    record = integrity.read_checked(file) if integrity.is_record(file) else None
    return record if record is not None and record.get("of") == run.digest else None


def check_chunk(run: RunFolder, index: int) -> Counter[str] | None:
    """The statuses of a chunk, once its files were read and are as their checksums say; or None."""
    record = read_record_of(run, index)
    if record is None:
        return None
    with suppress(FileNotFoundError):
        for name, (size, checksum) in record["files"].items():
            file = run.chunk_folder / name
            if not integrity.is_plain(file) or file.stat().st_size != size:
                return None
            if integrity.file_sum(file) != checksum:
                return None
        return _statuses(record["more"])
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
        if (file := run.chunk_folder / _part_name(name, index)).is_file():
            yield file.read_bytes()
