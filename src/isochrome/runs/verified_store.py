"""A store of results as zarr reads it: the files that were left, each as it was left.

A file that is read as a whole is held against the record of its results while its bytes are at
hand. Of a part of a file zarr compares the chunks' own checksums.
"""

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

from zarr.abc.store import ByteRequest
from zarr.core.buffer import Buffer, BufferPrototype, cpu
from zarr.storage import LocalStore

from isochrome.runs.integrity import MISSING, ResultsRecord


class VerifiedStore(LocalStore):
    """A store that is read alone, and holds what is read against the record of its results."""

    def __init__(self, root: Path, record: ResultsRecord) -> None:
        super().__init__(root, read_only=True)
        self._record = record
        self._known = {
            name.removeprefix(f"{root.name}/")
            for name in record.sizes
            if name.startswith(f"{root.name}/")
        }

    async def get(
        self,
        key: str,
        prototype: BufferPrototype | None = None,
        byte_range: ByteRequest | None = None,
    ) -> Buffer | None:
        """What a key holds, or a part of it; None where it is no file of the results."""
        if byte_range is None:
            return await asyncio.to_thread(self._file, key)
        known = self._may_be_read(key)
        return self._there(key, await super().get(key, prototype, byte_range)) if known else None

    def get_sync(
        self,
        key: str,
        *,
        prototype: BufferPrototype | None = None,
        byte_range: ByteRequest | None = None,
    ) -> Buffer | None:
        """The same in a thread of its own, as later versions of zarr read."""
        if byte_range is None:
            return self._file(key)
        if not self._may_be_read(key):
            return None
        return self._there(key, super().get_sync(key, prototype=prototype, byte_range=byte_range))

    def _file(self, key: str) -> Buffer | None:
        if key not in self._known:
            return None
        return cpu.Buffer(self._record.read(self._name(key)))

    def _name(self, key: str) -> str:
        return f"{self.root.name}/{key}"

    def _may_be_read(self, key: str) -> bool:
        """Whether a key is a file of the results. Raises InputError where it is not as left."""
        if key in self._known and (fault := self._record.size_fault(self._name(key))):
            raise self._record.refusal(self._name(key), fault)
        return key in self._known

    def _there(self, key: str, part: Buffer | None) -> Buffer:
        if part is None:
            raise self._record.refusal(self._name(key), MISSING)
        return part

    async def list_dir(self, prefix: str) -> AsyncIterator[str]:
        """The names below a prefix that are of the results."""
        start = f"{prefix.strip('/')}/" if prefix.strip("/") else ""
        below = (key.removeprefix(start) for key in self._known if key.startswith(start))
        for name in sorted({key.partition("/")[0] for key in below}):
            yield name
