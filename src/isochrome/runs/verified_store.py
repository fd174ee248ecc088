"""A store of results as zarr reads it: the files that were left, each as it was left."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from zarr.abc.store import ByteRequest
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import LocalStore

from isochrome.runs.integrity import MISSING, ResultsRecord


class VerifiedStore(LocalStore):
    """A store that is read alone, and holds what is read against the record of its results.

    What the record does not have is not there. `root`, the store; `record` of its folder. Reading
    raises InputError where a file is not what was left.
    """

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
        if not self._may_be_read(key):
            return None
        return self._checked(key, await super().get(key, prototype, byte_range), byte_range)

    def get_sync(self, key: str, **options: Any) -> Buffer | None:
        """The same in a thread of its own."""
        if not self._may_be_read(key):
            return None
        return self._checked(key, super().get_sync(key, **options), options.get("byte_range"))

    async def list_dir(self, prefix: str) -> AsyncIterator[str]:
        """The names below a prefix that are of the results."""
        start = f"{prefix.strip('/')}/" if prefix.strip("/") else ""
        below = (key.removeprefix(start) for key in self._known if key.startswith(start))
        for name in sorted({key.partition("/")[0] for key in below}):
            yield name

    def _may_be_read(self, key: str) -> bool:
        """Whether a key is a file of the results. Raises InputError where it is not as left."""
        name = f"{self.root.name}/{key}"
        if key in self._known and (fault := self._record.size_fault(name)):
            raise self._record.refusal(name, fault)
        return key in self._known

    def _checked(self, key: str, buffer: Buffer | None, byte_range: Any) -> Buffer | None:
        """What was read, held against the record; zarr looks at the checksum of each chunk."""
        name = f"{self.root.name}/{key}"
        if buffer is None:
            raise self._record.refusal(name, MISSING)
        if byte_range is None:
            self._record.check_read(name, buffer.as_numpy_array())
        return buffer
