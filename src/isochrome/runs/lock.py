"""One run at a time on one output: a lock that the system opens when its process dies."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from isochrome.errors import InputError

if TYPE_CHECKING:
    from filelock import FileLock

LOCK, OWNER = "lock", "owner.txt"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder for this process alone; it is made if need be, and removed when left empty.

    Parameters
    ----------
    folder : Path
        The folder.

    Yields
    ------
    None
        Nothing: the folder is held inside the block.

    Raises
    ------
    InputError
        Where another process holds it, or where it cannot be made or locked.
    """
    from filelock import FileLock, Timeout

    lock, made = None, not os.path.lexists(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if folder.is_symlink():
            raise InputError(f"{folder}: is a symbolic link; remove it, or name another --out")
        lock = FileLock(folder / LOCK, timeout=0, thread_local=False)
        lock.acquire()
        (folder / OWNER).write_text(f"process {os.getpid()} on {socket.gethostname()}", "utf-8")
    except Timeout:
        raise InputError(
            f"{folder}: another run is at work there ({_owner(folder)}); wait for it, stop it, or "
            "name another --out folder"
        ) from None
    except (OSError, NotImplementedError) as error:
        if lock is not None and lock.is_locked:
            _release(folder, lock)
        elif made:
            with suppress(OSError):
                folder.rmdir()
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"{folder}: results cannot be written there ({reason}); name another --out folder"
        ) from error
    try:
        yield
    finally:
        _release(folder, lock)


def _release(folder: Path, lock: FileLock) -> None:
    """Open the lock, and remove the folder where nothing else is in it."""
    alone = False
    with suppress(OSError):  # the drive may be gone
        (folder / OWNER).unlink(missing_ok=True)
        alone = {entry.name for entry in folder.iterdir()} <= {LOCK}
        if alone and os.name != "nt":  # while it is held, so that nobody else waits for it
            (folder / LOCK).unlink()
    with suppress(OSError):
        lock.release()
    if alone:
        with suppress(OSError):
            (folder / LOCK).unlink(missing_ok=True)
            folder.rmdir()


def _owner(folder: Path) -> str:
    try:
        return (folder / OWNER).read_text("utf-8") or "unknown process"
    except OSError:
        return "unknown process"
