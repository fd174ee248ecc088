"""`fit --track`: a video's frames one after the other, each followed from the one before."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.fit.frame_fit import placed
from isochrome.fit.one_state import frame_distance
from isochrome.fit.refuse import refuse_keys
from isochrome.fit.track_figure import track_figure
from isochrome.fit.tracker import Tracked, Tracker
from isochrome.frames import Frame, FrameReader, FramesPath, load_no_load, open_scene_frames
from isochrome.output import TableWriter, provenance, staged, write_figure, write_json, write_text
from isochrome.progress import Progress
from isochrome.scene import Scene, dump_scene, load_scene
from isochrome.simulate import state_count

Array = NDArray[Any]

POOR_CHI = 1.3
"""Residual over noise beyond which the model does not describe a frame within its noise."""

_ROWS = 200
_TOLD = 12
"""Frames whose numbers a sentence names."""


@dataclass(frozen=True)
class Track:
    """Tracked values of n frames.

    `keys`; `values`, `standard_uncertainty`, `cramer_rao_bound` (n, keys), NaN where a frame does
    not show the scene's fringes; `chi` (n,), residual over noise; `distance_m` (n,), NaN where
    nothing wears; `searched`, frames that a full search had to find; `scene`, with the values'
    means; `warnings` in plain words.
    """

    keys: tuple[str, ...]
    values: Array
    standard_uncertainty: Array
    cramer_rao_bound: Array
    chi: Array
    distance_m: Array
    searched: tuple[int, ...]
    scene: Scene
    warnings: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """The result as `--json` prints it: a list of values for each key, and of chi."""
        found = {
            key: {
                "value": _plain(self.values[:, j]),
                "standard_uncertainty": _plain(self.standard_uncertainty[:, j]),
                "cramer_rao_bound": _plain(self.cramer_rao_bound[:, j]),
            }
            for j, key in enumerate(self.keys)
        }
        return found | {
            "chi": _plain(self.chi),
            "distance_m": _plain(self.distance_m),
            "searched": list(self.searched),
            "warnings": list(self.warnings),
        }

    def summary(self) -> dict[str, list[Any]]:
        """For each key its mean, least and most value, and the median standard uncertainty."""
        columns = [c[np.isfinite(c)] for c in self.values.T]
        spread = [u[np.isfinite(u)] for u in self.standard_uncertainty.T]
        return {
            "key": list(self.keys),
            "mean": [float(c.mean()) if c.size else None for c in columns],
            "least": [float(c.min()) if c.size else None for c in columns],
            "most": [float(c.max()) if c.size else None for c in columns],
            "standard_uncertainty": [float(np.median(u)) if u.size else None for u in spread],
        }


def refuse_shared(keys: tuple[str, ...]) -> None:
    """Refuse keys that all frames share: a frame is tracked before the others are seen.

    Raises InputError that names the key and what to do.
    """
    if keys:
        raise InputError(
            f"--free {keys[0]} together with --track: a tracked frame's values are its own; name "
            f"it with --per-frame, or fit it on a few frames first and put it into the scene"
        )


def track(
    frames: FramesPath,
    scene: str | Path | Scene,
    keys: list[str] | tuple[str, ...],
    *,
    out: str | Path | None = None,
    progress: Progress | None = None,
) -> Track:
    """Follow keys of a contact scene through a video, each frame from the one before.

    One frame is in memory. Of a worn contact, the worn area at a frame is what the tracked loads
    and frictions have worn until then by the scene's law; its distance comes from the frames' times
    and frames.sliding_speed_mm_per_s, or from wear.distances_m, one a frame.
    Parameters: `frames`; `scene`, where the first frame's search starts; `keys`, see
    `isochrome.fit.track_course.TRACKED`; `out`, a folder for fit.csv, scene.toml (the means),
    fit.json, provenance.json, fit.png; `progress`, called with (done, all). Returns a Track. Raises
    InputError for keys and scenes that cannot be tracked, and for frames that are bad.
    """
    scene = load_scene(scene)
    refuse_keys(scene, (), tuple(keys))
    reader = open_scene_frames(frames, scene)
    speed = scene.frames.sliding_speed_mm_per_s
    if speed is not None and scene.friction is not None:
        scene = scene.with_values({"friction.static_state_first": False})
    rows = _Rows(tuple(keys))
    tracker = Tracker(
        placed(scene, reader.shape),
        tuple(keys),
        bit_depth=reader.bit_depth,
        no_load=load_no_load(scene, full_shape=reader.full_shape),
    )
    counted = _counted(reader, scene)
    found = _tracked(reader, scene, tracker, rows, counted, progress)
    if out is None:
        for _ in found:
            pass
        return rows.result(scene, frames)
    with staged(out) as folder:
        with TableWriter(folder / "fit.csv") as table:
            while chunk := list(islice(found, _ROWS)):
                table.append(_columns(tuple(keys), chunk))
        result = rows.result(scene, frames)
        write_text(folder / "scene.toml", dump_scene(result.scene))
        write_json(folder / "fit.json", result.to_json())
        write_json(folder / "provenance.json", provenance(dump_scene(scene), reader.files))
        write_figure(folder / "fit.png", track_figure(scene.name, result))
    return result


Row = tuple[int, float | None, Tracked]


def _tracked(
    reader: FrameReader,
    scene: Scene,
    tracker: Tracker,
    rows: _Rows,
    count: int,
    progress: Progress | None,
) -> Iterator[Row]:
    """Each frame's number, distance and values."""
    for frame in reader:
        distance = _distance(frame, scene)
        row = tracker.track(frame, distance)
        rows.add(distance, row)
        yield frame.index, distance, row
        if progress is not None:
            progress(frame.index + 1, max(count, frame.index + 1))


def _distance(frame: Frame, scene: Scene) -> float | None:
    """The distance (m) slid until a frame; None where nothing wears."""
    if scene.wear is None:
        return None
    speed = scene.frames.sliding_speed_mm_per_s
    if speed is None:
        return frame_distance(scene, frame.index)
    if frame.time_s is None:
        raise InputError(
            f"frame {frame.index} ({frame.name}) has no time, which "
            "frames.sliding_speed_mm_per_s needs; remove that key, or give a video"
        )
    return 1e-3 * speed * frame.time_s


def _counted(reader: FrameReader, scene: Scene) -> int:
    """How many frames there are, as far as it can be known without decoding a video for it.

    Raises InputError where the scene has other states.
    """
    states = state_count(scene)
    if scene.frames.sliding_speed_mm_per_s is not None or states == 1:
        return (reader.claimed_count or 0) if reader.kind == "video" else reader.count()
    count = reader.count()
    if count != states:
        raise InputError(
            f"{reader.path}: {count} frames, and the scene has {states} states; give one frame a "
            "state, correct wear.distances_m, or set frames.sliding_speed_mm_per_s for a video"
        )
    return count


class _Rows:
    """Results so far, as bare numbers: hours of video are some megabytes."""

    def __init__(self, keys: tuple[str, ...]) -> None:
        self.keys = keys
        self.values, self.spread, self.bound = array("d"), array("d"), array("d")
        self.chi, self.distance = array("d"), array("d")
        self.searched, self.empty = array("l"), array("l")

    def add(self, distance: float | None, row: Tracked) -> None:
        """One frame more."""
        if row.searched:
            self.searched.append(len(self.chi))
        if not row.positive:
            self.empty.append(len(self.chi))
        self.values.extend(row.values)
        self.spread.extend(row.standard_uncertainty)
        self.bound.extend(row.cramer_rao_bound)
        self.chi.append(row.chi)
        self.distance.append(np.nan if distance is None else distance)

    def result(self, scene: Scene, frames: FramesPath) -> Track:
        """All frames. Raises InputError where there were none."""
        if not self.chi:
            raise InputError(f"{frames}: holds no frame; check the file")
        shape = (len(self.chi), len(self.keys))
        values, spread, bound = (
            np.array(part).reshape(shape) for part in (self.values, self.spread, self.bound)
        )
        told = np.isfinite(values) & np.isfinite(spread)
        means = {
            key: float(values[told[:, j], j].mean())
            for j, key in enumerate(self.keys)
            if told[:, j].any()
        }
        return Track(
            self.keys,
            values,
            spread,
            bound,
            np.array(self.chi),
            np.array(self.distance),
            tuple(self.searched),
            scene.with_values(means),
            tuple(self._warnings()),
        )

    def _warnings(self) -> Iterator[str]:
        again = [i for i in self.searched if i > 0 and i not in set(self.empty)]
        if again:
            yield f"{_named(again)}: the track was lost, and found again by a full search"
        if self.empty:
            yield f"{_named(list(self.empty))}: the scene's fringes are not in it"
        poor = [i for i, chi in enumerate(self.chi) if chi > POOR_CHI]
        if poor:
            yield (
                f"{_named(poor)}: chi up to {np.nanmax(self.chi):.2f}: the model does not describe "
                "this within its noise; a bias may remain"
            )


def _named(frames: list[int]) -> str:
    more = f" and {len(frames) - _TOLD} more" if len(frames) > _TOLD else ""
    return f"frame{'s' * (len(frames) > 1)} {', '.join(map(str, frames[:_TOLD]))}{more}"


def _columns(keys: tuple[str, ...], rows: list[Row]) -> dict[str, list[Any]]:
    """The columns of fit.csv: one row for each key of each frame."""
    each = [(row, j) for row in rows for j in range(len(keys))]
    return {
        "frame": [str(row[0]) for row, _ in each],
        "distance_m": [row[1] for row, _ in each],
        "key": [keys[j] for _, j in each],
        "value": [float(row[2].values[j]) for row, j in each],
        "standard_uncertainty": [float(row[2].standard_uncertainty[j]) for row, j in each],
        "cramer_rao_bound": [float(row[2].cramer_rao_bound[j]) for row, j in each],
        "chi": [row[2].chi for row, _ in each],
        "searched": [int(row[2].searched) for row, _ in each],
    }


def _plain(values: Array) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in values.tolist()]
