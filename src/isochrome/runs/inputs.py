"""The files that a run reads: apart from its results, and the same from beginning to end."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from isochrome.errors import InputError

Stamps = Mapping[Path, tuple[int, int]]
"""Size (bytes) and time of the last change (ns) of files."""


def stamps_of(identity: Mapping[str, Any]) -> Stamps:
    """The input files of a run's identity as they are now; those that are not there are left out.

    Parameters: `identity`, as in a Job.
    """
    found = {}
    for name in identity.get("inputs_sha256") or {}:
        try:
            state = os.stat(name)
        except OSError:
            continue
        found[Path(name)] = (state.st_size, state.st_mtime_ns)
    return found


def check_apart(stamps: Stamps, target: Path) -> None:
    """Refuse an output folder in which input files lie: the next run would read results as input.

    Parameters: `stamps` of the input; `target`, the resolved output folder. Raises InputError.
    """
    inside = [file for file in stamps if file.resolve().parent == target]
    if inside:
        raise InputError(
            f"{inside[0]}: lies in the folder {target}, where the results would lie beside the "
            "input; name another --out folder"
        )


def check_unchanged(stamps: Stamps) -> None:
    """Refuse results of input that was changed while it was read. Raises InputError.

    A file that is no longer there was read before, or its reader has said that it was not.
    """
    for file, stamp in stamps.items():
        try:
            state = os.stat(file)
        except OSError:
            continue
        if (state.st_size, state.st_mtime_ns) != stamp:
            raise InputError(
                f"{file}: changed while it was read ({stamp[0]} bytes before, {state.st_size} "
                "now); wait until its recording has ended, and start again with --restart"
            )
