"""What became of one recording of a campaign: its folder, its row of the summary, its curves."""

import json
import os
import re
import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError, IsochromeError, PhysicsError
from isochrome.frames import FramesPath
from isochrome.messages import message
from isochrome.output import numbers, sha256
from isochrome.processing import SPREAD, Processed, process
from isochrome.progress import RunProgress
from isochrome.runs import PROVENANCE, WORKING, NoCluster, open_run
from isochrome.scene import Scene

SUMMARIES = ("summary.csv", "summary.json", "summary.png")
"""Files of the campaign itself, in the folder that holds those of its recordings."""

_LONGEST = 200
"""Bytes of a name; file systems take 255, and the working folder's is longer."""

_DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)
"""Names that Windows keeps for its devices."""


def label_of(frames: FramesPath) -> str:
    """A recording as it was named, in text that every file can hold."""
    text = str(frames) if isinstance(frames, str | Path) else f"{frames[0]} ..."
    return text.encode("utf-8", "replace").decode("utf-8")


def folder_names(recordings: Sequence[FramesPath]) -> tuple[str, ...]:
    """A folder's name for each recording: its file's without the ending, or its folder's.

    Names that are equal, but perhaps for capitals, get the name of the folder that they are in, and
    where this does not help a number. Each is one plain name: it leads to no other folder, on
    Windows neither.
    """
    firsts = (frames if isinstance(frames, str | Path) else frames[0] for frames in recordings)
    places = [Path(os.path.abspath(first)) for first in firsts]
    own = [_plain(place.name if place.is_dir() else place.stem) for place in places]
    count = Counter(_key(name) for name in own)
    taken: set[str] = set()
    result = []
    for place, name in zip(places, own, strict=True):
        if count[_key(name)] > 1:
            name = _plain(f"{place.parent.name}-{name}")
        free, number = name, 1
        while _key(free) in taken:
            number += 1
            free = f"{name}-{number}"
        taken.add(_key(free))
        result.append(free)
    return tuple(result)


def _key(name: str) -> str:
    """The same for names that some file system takes for one."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def _plain(name: str) -> str:
    """A name that is a folder's on every system, and none of the campaign's own files'."""
    text = re.sub(r'[<>:"/\\|?*\x00-\x1f\x7f\ud800-\udfff]', "_", name)
    text = text.encode()[:_LONGEST].decode(errors="ignore").strip(" .")
    if text.casefold().endswith(WORKING):
        text = f"{text[: -len(WORKING)]}_{WORKING[1:]}"
    if _DEVICE.fullmatch(text) or text.casefold() in SUMMARIES:
        text = f"_{text}"
    return text or "recording"


Array = NDArray[np.float64]

_POINTS = 500
"""Frames of a recording that are drawn: more than its part of a figure has pixels across."""

_VALUES = ("frames", "failed_frames", "flagged_frames", "duration_s", "pixel_mm", "chi_median",
           "chi_max", "kept_share")  # fmt: skip
"""Columns of the summary whose values a recording that failed has not."""


@dataclass(frozen=True)
class Task:
    """A recording, the `folder` for its results, and that folder's `name` in the summary."""

    frames: FramesPath
    name: str
    folder: Path


@dataclass(frozen=True)
class Outcome:
    """What became of a recording.

    `row` of the summary; `inputs`, its files with their SHA-256; `exit_code`, 0, or the one that
    `process` alone would have ended with; `already`, whether an earlier campaign had left it all;
    `curves`, for the figure: `distance_m`, `frame`, and fitted keys with their uncertainties, of as
    many frames as can be seen.
    """

    row: dict[str, Any]
    inputs: dict[str, str]
    exit_code: int = 0
    already: bool = False
    curves: dict[str, Array] = field(default_factory=dict)


def outcome_of(
    task: Task, scene: Scene, options: Mapping[str, Any], progress: RunProgress | None = None
) -> Outcome:
    """Process one recording into its folder; what is wrong with it, NoCluster apart, becomes its
    row.
    """
    try:
        if task.folder.is_symlink():
            raise InputError("symbolic_link_results_put", folder=task.folder)
        result = process(task.frames, scene, task.folder, progress=progress, **options)
    except NoCluster:
        raise
    except IsochromeError as error:
        return failed(task, error)
    except MemoryError:
        reason = message("not_enough_memory_use")
        return failed(task, PhysicsError(reason))
    return _read(task, result)


def failed(task: Task, error: IsochromeError) -> Outcome:
    """A recording that could not be processed, with the reason."""
    cause = error.__cause__
    # what is kept of an unfinished run depends on when it was stopped; the reason does not
    bare = isinstance(cause, IsochromeError) and str(error).startswith(f"{cause} (")
    row = _row(task, "failed") | {"error": " ".join(str(cause if bare else error).split())}
    return Outcome(row, _hashes(task.frames), error.exit_code)


def _row(task: Task, status: str) -> dict[str, Any]:
    """A row's first columns, and the last ones, all of which every recording has."""
    names = {"recording": label_of(task.frames), "folder": task.name, "status": status}
    return names | dict.fromkeys(_VALUES) | {"warnings": "", "error": ""}


def _read(task: Task, found: Processed) -> Outcome:
    """What a run found: counts, and of each fitted key mean, scatter and uncertainty."""
    table = found.columns
    count = len(table["frame"])
    flagged = sum(bool(text) for text in table["warnings"]) - found.failed
    status = "flagged" if flagged or found.failed else "ok"
    row = _row(task, "failed" if found.failed == count else status)
    chi, selected = _known(table, "chi"), _known(table, "kept_share")
    with open_run(task.folder) as dataset:
        times = dataset.time_s.values
    row |= {
        "frames": count,
        "failed_frames": found.failed,
        "flagged_frames": flagged,
        "duration_s": float(np.nanmax(times)) if np.isfinite(times).any() else None,
        "pixel_mm": next((p for p in table["pixel_mm"] if p is not None), None),
        "chi_median": _of_known(np.median, chi),
        "chi_max": _of_known(np.max, chi),
        "kept_share": _of_known(np.median, selected),
        "warnings": "; ".join(found.warnings),
    }
    keys = [name for name in table if f"{name} {SPREAD}" in table]
    for key in keys:
        values, spread = _known(table, key), _known(table, f"{key} {SPREAD}")
        row[f"{key} mean"] = _of_known(np.mean, values)
        row[f"{key} standard_deviation"] = float(values.std(ddof=1)) if values.size > 1 else None
        row[f"{key} median_{SPREAD}"] = _of_known(np.median, spread)
    if found.failed:
        row["error"] = message("frames_could_not_processed", failed=found.failed, count=count)
    record = json.loads((task.folder / PROVENANCE).read_text("utf-8"))
    curves = {
        name: numbers(table[name])[:: -(-count // _POINTS)]
        for name in ("distance_m", "frame", *keys, *(f"{key} {SPREAD}" for key in keys))
    }
    code = InputError.exit_code if found.failed else 0
    return Outcome(row, record["inputs_sha256"], code, found.already, curves)


def _known(table: Mapping[str, Sequence[Any]], name: str) -> Array:
    values = numbers(table[name]) if name in table else np.empty(0)
    return values[np.isfinite(values)]


def _of_known(measure: Any, values: Array) -> float | None:
    return float(measure(values)) if values.size else None


def _hashes(frames: FramesPath) -> dict[str, str]:
    """The files of a recording that can be read, with their SHA-256."""
    named = [frames] if isinstance(frames, str | Path) else frames
    files = []
    for place in map(Path, named):
        with suppress(OSError):
            files += sorted(place.iterdir()) if place.is_dir() else [place]
    result = {}
    for file in files:
        with suppress(InputError, OSError):
            if file.is_file():
                result[str(file)] = sha256(file)
    return result
