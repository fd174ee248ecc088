"""What tracking a video found: values of each frame as numbers, and the warnings about them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.figures import BAND, PaperPanels, panels_figure, plain_name, values_plots
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.unknowns import taken_as_exact
from isochrome.fitting.frame_set import CORRECT
from isochrome.fitting.result import PARTS, column_name
from isochrome.fitting.tracking.tracker import AGAIN, Tracked
from isochrome.messages import (
    frame_messages,
    message,
    read_frame_messages,
    read_warnings,
    warnings_json,
)
from isochrome.output import (
    FittedResult,
    FrameValues,
    columns_of,
    counted,
    messages_of_frames,
    numbers,
    over_items,
)
from isochrome.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure


TRACK_PARTS = {"value": "values"} | {n: n for n in PARTS[1:] if n != "noise_uncertainty"}
"""What is known of a key, as tables name it, and the attribute that holds it."""


@dataclass(frozen=True, repr=False, kw_only=True)
class Track(FittedResult):
    """Tracked values of n frames.

    `keys`; `values`, `standard_uncertainty`, `cramer_rao_bound` (n, keys), NaN where a frame does
    not show the scene's fringes; `chi` (n,), residual over noise; `distance_m` (n,), NaN where
    nothing wears; `searched`, frames that a full search had to find; `scene`, with the values'
    means; `warnings` in plain words; `already`, whether an earlier run had left it all.
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
    already: bool = False

    def to_json(self) -> dict[str, Any]:
        """The result as `--json` prints it: a list of values for each key, and of chi."""
        result = {
            key: {part: _plain(getattr(self, name)[:, j]) for part, name in TRACK_PARTS.items()}
            for j, key in enumerate(self.keys)
        }
        return result | {
            "chi": _plain(self.chi),
            "distance_m": _plain(self.distance_m),
            "searched": list(self.searched),
            **warnings_json(self.warnings),
            "taken_as_exact": list(self.taken_as_exact),
            "summary_text": self.summary_text,
        }

    @property
    def columns(self) -> dict[str, Any]:
        """Those of fit.csv: one row for each key of each frame."""
        count, keys = self.values.shape
        return {
            "frame": np.repeat(np.arange(count).astype(str), keys),
            "distance_m": np.repeat(self.distance_m, keys),
            "key": np.tile(np.array(self.keys), count),
            **{part: getattr(self, name).ravel() for part, name in TRACK_PARTS.items()},
            "chi": np.repeat(self.chi, keys),
            "searched": np.repeat(self.over_frames.searched.astype(int), keys),
        }

    @property
    def title(self) -> str:
        """The scene and how many frames were tracked."""
        return f"Track through {counted(len(self.chi), 'frame')} of {self.scene.name}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """Each key over the frames, and chi."""
        yield from super().main_values()
        yield "chi", over_items(self.chi)

    @property
    def over_frames(self) -> FrameValues:
        """The values, to be drawn and summed up as those of other commands."""
        return FrameValues(
            keys=self.keys, values=self.values, standard_uncertainty=self.standard_uncertainty,
            chi=self.chi, distance_m=self.distance_m,
            searched=np.isin(np.arange(len(self.chi)), self.searched),
            whole=np.zeros(len(self.chi), dtype=bool),
        )  # fmt: skip

    @property
    def taken_as_exact(self) -> tuple[str, ...]:
        """Keys of the measured numbers whose uncertainty is not in the ±, stated or not."""
        return taken_as_exact(self.scene, self.keys, tracked=True)

    def figure(self) -> Figure:
        """Each key with its band, and chi."""
        head = f"{plain_name(self.scene.name)}: tracked values, band ± {BAND:g} standard"
        head += " uncertainties\ncircles: found by a full search"
        return panels_figure(PaperPanels(plots=values_plots(self.over_frames)), head)


def track_row(
    index: int, distance_m: float | None, keys: tuple[str, ...], found: Tracked
) -> dict[str, Any]:
    """A frame's row as plain numbers: its number, distance (m), and what was found in it."""
    row: dict[str, Any] = {"frame": index, "distance_m": distance_m, "chi": float(found.chi)}
    for part, name in TRACK_PARTS.items():
        values = np.asarray(getattr(found, name), float).tolist()
        row |= {column_name(key, part): v for key, v in zip(keys, values, strict=True)}
    # the first frame has nothing to be followed from
    said = [text for text in found.warnings if index or text != message(AGAIN)]
    return row | {"searched": bool(found.searched), "messages": frame_messages(said)}


def untracked_inputs(scene: Scene) -> list[str]:
    """What is said where a scene states uncertainties, which tracked values leave out."""
    if not scene.uncertainties:
        return []
    return [
        message("stated_uncertainties_not_tracked", uncertainties=", ".join(scene.uncertainties))
    ]


def make_track(
    rows: Iterable[Mapping[str, Any]], keys: tuple[str, ...], scene: Scene,
    said: tuple[str, ...] = (),
) -> Track:  # fmt: skip
    """The track of frames' rows, see `track_row`; `said`, what is to be said of all frames.

    Rows are let go one by one: hours of video are some megabytes. Raises PhysicsError where none
    tells any value.
    """
    table = columns_of(rows)
    parts: dict[str, Any] = {
        name: np.stack([numbers(table[column_name(key, part)]) for key in keys], axis=1)
        for part, name in TRACK_PARTS.items()
    }
    values, spread = parts["values"], parts["standard_uncertainty"]
    known = np.isfinite(values) & np.isfinite(spread)
    if not known.any():
        count, cause = len(values), message(CORRECT)
        raise PhysicsError(
            "nothing_could_read_any", name=scene.name, single_fits_count=count, cause=cause
        )
    cells = enumerate(table["messages"])
    of_frames = [(k, text) for k, cell in cells for text in read_frame_messages(cell)]
    means = {
        key: float(values[known[:, j], j].mean()) for j, key in enumerate(keys) if known[:, j].any()
    }
    return Track(
        keys=keys, **parts, chi=numbers(table["chi"]), distance_m=numbers(table["distance_m"]),
        searched=tuple(np.flatnonzero(table["searched"]).tolist()), scene=scene.with_values(means),
        warnings=(*said, *untracked_inputs(scene), *messages_of_frames(of_frames)),
    )  # fmt: skip


def restored(found: Mapping[str, Any], keys: tuple[str, ...], scene: Scene) -> Track:
    """A Track from its JSON; `keys`, and the `scene` with the means."""
    parts: dict[str, Any] = {
        name: np.stack([numbers(found[key][part]) for key in keys], axis=1)
        for part, name in TRACK_PARTS.items()
    }
    return Track(
        keys=keys, **parts, chi=numbers(found["chi"]), distance_m=numbers(found["distance_m"]),
        searched=tuple(found["searched"]), scene=scene, warnings=read_warnings(found), already=True,
    )  # fmt: skip


def _plain(values: Array) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in values.tolist()]
