"""The summary of a campaign: a table of all its recordings, with what it came from."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from isochrome.campaigns.figure import summary_figure
from isochrome.campaigns.outcome import Outcome
from isochrome.campaigns.recording_folders import SUMMARIES
from isochrome.errors import InputError
from isochrome.output import columns_of, output_folder, write_csv, write_figure
from isochrome.runs import environment, has_own_keys, seal
from isochrome.scene import Scene, dump_scene

_LAST = ("kept_share", "warnings", "error")


def tabulate_campaign(rows: Sequence[dict[str, Any]]) -> dict[str, list[Any]]:
    """The columns of summary.csv: what all recordings have, the keys of any, and what is said.

    Parameters: `rows`, one a recording. Returns column name to values, None where a row has none.
    """
    columns = columns_of(rows)
    unknown: list[Any] = [None] * len(rows)
    last = {name: columns.pop(name, unknown) for name in _LAST}
    return columns | last


def summary_of(scene: Scene, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """What summary.json holds: version, scene, and each recording's row with its files' hashes.

    Parameters: `scene`; `outcomes`, one a recording. Returns a dictionary for `write_json`.
    """
    text = dump_scene(scene)
    return {
        **environment(),
        "scene": text,
        "scene_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "recordings": [item.row | {"inputs_sha256": item.inputs} for item in outcomes],
    }


def write_summary(out: Path, scene: Scene, outcomes: Sequence[Outcome], beside: Path) -> None:
    """Leave summary.csv, summary.json and, where a key was fitted that has one, summary.png.

    Parameters: `out`, the campaign's folder; `scene`; `outcomes`; `beside`, a folder on the same
    drive, where they are made. Raises InputError where they cannot be written.
    """
    folder = output_folder(out)
    table, summary, picture = SUMMARIES
    figure = summary_figure(scene.name, outcomes)
    try:
        write_csv(beside / table, tabulate_campaign([item.row for item in outcomes]))
        if figure is not None:
            write_figure(beside / picture, figure)
        left = [name for name in (table, picture) if (beside / name).exists()]
        seal(beside, summary_of(scene, outcomes), file=summary, names=left)
        for name in (summary, table, picture):  # first what says whose they are
            if (beside / name).exists():
                os.replace(beside / name, folder / name)
            else:
                (folder / name).unlink(missing_ok=True)  # that of an earlier campaign
    except OSError as error:
        raise InputError(
            f"{folder}: the summary cannot be written ({error.strerror or error}); all recordings "
            "are finished and kept there: make room, and run the same command again to resume"
        ) from error


def check_summary(out: Path) -> set[str]:
    """Folders of recordings that a campaign has left in `out`.

    Raises InputError rather than replace files of the summary's names that no campaign has left.
    """
    path, rows = out / SUMMARIES[1], None
    there = [out / name for name in SUMMARIES if os.path.lexists(out / name)]
    try:
        rows = json.loads(path.read_text("utf-8"))["recordings"]
        left = {row["folder"] for row in rows if row["status"] != "failed"}
    except (OSError, ValueError, KeyError, TypeError):
        left = set()
    if there and rows is None and not has_own_keys(path):
        raise InputError(
            f"{there[0]}: would be replaced by the campaign's summary, and no campaign has left "
            "it; move it away, or name another --out folder"
        )
    return left
