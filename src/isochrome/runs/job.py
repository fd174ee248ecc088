"""What a long run is made of: chunks of items, each computed by one pure function.

What a run is a result of, and whether two runs are of the same.
"""

import hashlib
import json
import math
import platform
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import isochrome
from isochrome.output import InputContent, provenance

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
    """Say what a run is a result of, as provenance.json keeps it: scene, files, code and options.

    Parameters: `scene_toml`, text of the resolved scene; `files`, files that are read, and arrays
    in place of files; `options`, options of the command that change its result; `seed`, seed of the
    random numbers. Returns the record, for a Job. Raises InputError.
    """
    return provenance(scene_toml, files, seed) | environment() | {"options": dict(options)}


def identity_digest(identity: Mapping[str, Any]) -> str:
    """A hash of what a run is a result of, the same where `difference` finds none."""
    files = [
        [Path(name).name, checksum] for name, checksum in (identity["inputs_sha256"] or {}).items()
    ]
    parts = [identity.get(key) for key in ("scene", *_LABELS)]
    return hashlib.sha256(json.dumps([files, parts]).encode()).hexdigest()


def difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> str | None:
    """What differs between two runs' identities, in words; None where they are the same.

    The same files in another folder are the same input. Parameters: `old`, `new`, as in a Job.
    """
    if old.get("scene") != new.get("scene"):
        return f"the scene ({_first_line(old.get('scene'), new.get('scene'))})"
    before, now = (list((run.get("inputs_sha256") or {}).items()) for run in (old, new))
    names = [[Path(name).name for name, _ in files] for files in (before, now)]
    if names[0] != names[1]:
        differing = sorted(set(names[0]) ^ set(names[1]))
        return f"the input files ({', '.join(differing[:3]) or 'their order'})"
    changed = [name for (_, a), (name, b) in zip(before, now, strict=True) if a != b]
    if changed:
        return f"the content of {changed[0]}"
    for key, label in _LABELS.items():
        if old.get(key) != new.get(key):
            return f"{label} ({_pair(old.get(key), new.get(key))})"
    return None


def _first_line(old: Any, new: Any) -> str:
    """The first line that differs of two scenes."""
    before, now = str(old).splitlines(), str(new).splitlines()
    for a, b in zip(before, now, strict=False):
        if a != b:
            return f"'{a}' is now '{b}'"
    longer = before if len(before) > len(now) else now
    lines = longer[min(len(before), len(now)) :]
    what = "no longer there" if longer is before else "new"
    return f"'{' '.join(lines[:2])}' is {what}"


def _pair(old: Any, new: Any) -> str:
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        keys = [key for key in {**old, **new} if old.get(key) != new.get(key)]
        return f"{keys[0]}: {old.get(keys[0])}, now {new.get(keys[0])}"
    if isinstance(old, str) and len(old) == 64:
        return "its files"
    return f"{old}, now {new}"


CHUNK_BYTES = 24_000_000
"""Of one layer in one chunk; a few chunks of all layers are in memory at a time."""
LARGEST_CHUNK = 32
"""Items in a chunk: what a crash may cost."""


@dataclass(frozen=True)
class Compact:
    """How maps are kept in whole steps of one or two bytes, compressed one by one.

    Blosc's Zstandard at its first level, its bytes shuffled: of an order read from noise of 3 grey
    levels it leaves 1.2 bytes a pixel in 1.4 ms a frame of 659 x 494; higher levels take 4 to 500
    ms for 3 to 13 % less, LZ4 0.6 ms for 12 % more. `step`, what a value is a multiple of, from 0
    on; `pages`, whether the TIFF stack too has a page for every item.
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
        """How zarr reads a file of many maps of a shape (rows, cols), one after the other.

        Each can be read by itself: behind them stands where each is, zarr's sharding.
        """
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
        steps = scaled.astype(self.dtype)
        before, blosc.use_threads = blosc.use_threads, False  # whose order is chance
        try:
            return bytes(codec.encode(steps))
        finally:
            blosc.use_threads = before

    def unpack(self, data: bytes, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """The map (rows, cols) of what `pack` gave, NaN = not known."""
        from numcodecs import blosc

        steps = np.frombuffer(blosc.Blosc().decode(data), self.dtype).reshape(shape)
        values = steps * np.float32(self.step)
        values[steps == self.unknown] = np.nan
        return values


@dataclass(frozen=True)
class Layer:
    """A picture for each item, float32, NaN = not known.

    `units`, its unit, '1' for none; `stack`, whether it is left as a TIFF stack too; `compact`, how
    the store has it, then for every item, whatever the layout's `every`: the stack is of the
    pictures alone, or as it says.
    """

    name: str
    units: str
    what: str
    stack: bool = True
    compact: Compact | None = None


@dataclass(frozen=True, kw_only=True)
class RunLayout:
    """What a run leaves.

    It depends on the input alone, not on the machine: so do the files.

    `chunk`, items that are computed and kept together; 1 where there are several axes; `every`, of
    so many items, only the first has pictures, which then lie on an axis of their own: one axis
    over the items, and `chunk` a multiple of `every`.
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
    def names(self) -> tuple[str, ...]:
        """The names of the layers."""
        return tuple(layer.name for layer in self.layers)

    def layer(self, name: str) -> Layer:
        """The layer of a name."""
        return next(layer for layer in self.layers if layer.name == name)

    @property
    def chunk_shape(self) -> tuple[int, ...]:
        """Shape of a layer's chunk, the axes over the pictures first."""
        ahead = (1,) * (len(self.axes) - 1) + (self.chunk // self.every,)
        return (*ahead, *self.shape.values())

    def key(self, index: int) -> str:
        """Where the zarr format (version 3) puts a chunk, below the folder of its array."""
        counts = tuple(self.axes.values())  # of several axes, each item has its chunk
        place = (index,) if len(counts) == 1 else np.unravel_index(index, counts)
        return "/".join(["c", *(str(int(k)) for k in place), *("0" for _ in self.shape)])


@dataclass(frozen=True)
class Results:
    """What a chunk's computation gives.

    `arrays`, by layer that is not compact, a picture for each item but where the layout says
    `every`; `more`, what else is known of each item, among it its `status`: 'ok', 'flagged' (it has
    warnings) or 'failed' (nothing was found in it); `packed`, of each compact layer, the map of
    every item as `Compact.pack` gives it; None where an item has none.
    """

    arrays: Mapping[str, NDArray[Any]]
    rows: list[dict[str, Any]]
    more: list[dict[str, Any]]
    parts: Mapping[str, bytes] = field(default_factory=dict)  # of files that all chunks make
    left: Mapping[str, Any] | None = None  # for the next chunk, where they are computed in turn
    packed: Mapping[str, list[bytes | None]] = field(default_factory=dict)


Work = Callable[[int, int], Results]
"""Compute items [start, stop): the same results wherever and whenever it is called; picklable."""

InTurn = Callable[[int, int, Any], Results]
"""The same from what the chunk before has left, None for the first."""


@dataclass(frozen=True)
class Job:
    """A long run.

    `layout`, what the run leaves; `identity`, what the run is a result of, as in a Job; `in_turn`,
    whether each chunk needs what the one before has left: then one process computes all.
    """

    work: Work | InTurn
    layout: RunLayout
    identity: Mapping[str, Any]
    in_turn: bool = False


def chunk_size(count: int, item_bytes: int) -> int:
    """Choose a chunk's items, so that memory stays bounded and a few workers have each their share.

    Parameters: `count`, items of the run; `item_bytes`, bytes of one layer of one item. Returns
    items in a chunk, 1 at least.
    """
    return max(1, min(LARGEST_CHUNK, CHUNK_BYTES // max(item_bytes, 1), -(-count // 8)))
