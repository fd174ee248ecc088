"""What tracking a video found: values of each frame as numbers, and the warnings about them."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import POOR_CHI
from isochrome.figures import BAND, PaperPanels, panels_figure, plain_name, values_plots
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.unknowns import taken_as_exact
from isochrome.fitting.frame_set import CORRECT
from isochrome.fitting.result import PARTS
from isochrome.fitting.tracking.tracker import AGAIN, FAR, NO_FRINGES, POOR, Tracked
from isochrome.messages import message, read_warnings, warnings_json
from isochrome.output import (
    FrameValues,
    Result,
    basis_of_uncertainty,
    counted,
    counted_frames,
    numbers,
    over_items,
    sentence_of,
)
from isochrome.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure


TRACK_PARTS = {"value": "values"} | {n: n for n in PARTS[1:] if n != "noise_uncertainty"}
"""What is known of a key, as tables name it, and the attribute that holds it."""


@dataclass(frozen=True, repr=False, kw_only=True)
class Track(Result):
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
        searched = np.isin(np.arange(count), self.searched).astype(int)
        return {
            "frame": np.repeat(np.arange(count).astype(str), keys),
            "distance_m": np.repeat(self.distance_m, keys),
            "key": np.tile(np.array(self.keys), count),
            **{part: getattr(self, name).ravel() for part, name in TRACK_PARTS.items()},
            "chi": np.repeat(self.chi, keys),
            "searched": np.repeat(searched, keys),
        }

    @property
    def title(self) -> str:
        """The scene and how many frames were tracked."""
        return f"Track through {counted(len(self.chi), 'frame')} of {self.scene.name}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """Each key over the frames, and chi."""
        parts = zip(self.keys, self.values.T, self.standard_uncertainty.T, strict=True)
        yield from ((key, over_items(values, spreads)) for key, values, spreads in parts)
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

    @property
    def uncertainty_basis(self) -> str:
        """What the ± are of, and what was taken as exact."""
        return basis_of_uncertainty(self.taken_as_exact, frames=len(self.chi))

    @property
    def summary_text(self) -> str:
        """What was found as a sentence, the same on the terminal and in a report."""
        rows = zip(*self.summary().values(), strict=True)
        return sentence_of(rows, len(self.chi), None, basis=self.uncertainty_basis)

    def figure(self) -> Figure:
        """Each key with its band, and chi."""
        head = f"{plain_name(self.scene.name)}: tracked values, band ± {BAND:g} standard"
        head += " uncertainties\ncircles: found by a full search"
        return panels_figure(PaperPanels(plots=values_plots(self.over_frames)), head)

    def summary(self) -> dict[str, list[Any]]:
        """What the frames come to."""
        return self.over_frames.summary()


def track_row(index: int, distance_m: float | None, found: Tracked) -> dict[str, Any]:
    """A frame's row as plain numbers: its number, distance (m), and what was found in it."""
    row: dict[str, Any] = {"frame": index, "distance_m": distance_m, "chi": float(found.chi)}
    row |= {name: np.asarray(getattr(found, name), float).tolist() for name in TRACK_PARTS.values()}
    marks = {name: bool(getattr(found, name)) for name in ("searched", "positive", "far")}
    return row | marks


def untracked_inputs(scene: Scene) -> list[str]:
    """Say what the uncertainties of tracked values leave out.

    Parameters
    ----------
    scene : Scene
        The scene of the video.

    Returns
    -------
    list of str
        A sentence where the scene states uncertainties, else none.
    """
    if not scene.uncertainties:
        return []
    return [
        message("stated_uncertainties_not_tracked", uncertainties=", ".join(scene.uncertainties))
    ]


def is_good(row: Mapping[str, Any]) -> bool:
    """Whether nothing is to be said of a frame."""
    return bool(row["positive"] and row["chi"] <= POOR_CHI)


class TrackRows:
    """Results so far, as bare numbers: hours of video are some megabytes."""

    def __init__(self, keys: tuple[str, ...], said: tuple[str, ...] = ()) -> None:
        """`keys` that are tracked; `said`, what is to be said of all frames."""
        self.keys, self._said = keys, said
        self.parts = {name: array("d") for name in TRACK_PARTS.values()}
        self.chi, self.distance = array("d"), array("d")
        self.searched, self.empty, self.far = array("l"), array("l"), array("l")

    def add(self, row: Mapping[str, Any]) -> None:
        """One frame more, from its row, see `track_row`."""
        if row["searched"]:
            self.searched.append(len(self.chi))
        if not row["positive"]:
            (self.far if row["far"] else self.empty).append(len(self.chi))
        for name, part in self.parts.items():
            part.extend(row[name])
        self.chi.append(row["chi"])
        distance = row["distance_m"]
        self.distance.append(np.nan if distance is None else distance)

    def result(self, scene: Scene) -> Track:
        """All frames of a `scene`. Raises PhysicsError where none of them tells any value."""
        shape = (len(self.chi), len(self.keys))
        parts: dict[str, Any] = {
            name: np.array(part).reshape(shape) for name, part in self.parts.items()
        }
        values, spread = parts["values"], parts["standard_uncertainty"]
        known = np.isfinite(values) & np.isfinite(spread)
        if not known.any():
            count, cause = len(self.chi), message(CORRECT)
            raise PhysicsError(
                "nothing_could_read_any", name=scene.name, single_fits_count=count, cause=cause
            )
        means = {
            key: float(values[known[:, j], j].mean())
            for j, key in enumerate(self.keys)
            if known[:, j].any()
        }
        return Track(
            keys=self.keys, **parts, chi=np.array(self.chi), distance_m=np.array(self.distance),
            searched=tuple(self.searched), scene=scene.with_values(means),
            warnings=tuple(self._warnings(scene)),
        )  # fmt: skip

    def _warnings(self, scene: Scene) -> Iterator[str]:
        yield from self._said
        yield from untracked_inputs(scene)
        nothing = {*self.empty, *self.far}
        poor = [i for i, chi in enumerate(self.chi) if chi > POOR_CHI and i not in nothing]
        # the first frame has nothing to be followed from
        again = [i for i in self.searched if i > 0 and i not in nothing]
        warnings = (
            (again, message(AGAIN)),
            (self.empty, message(NO_FRINGES)),
            (self.far, message(FAR)),
            (poor, message(POOR)),
        )
        for frames, text in warnings:
            if len(frames):
                worst = f" (chi up to {max(self.chi[i] for i in frames):.2f})"
                yield f"{counted_frames(list(frames))}: {text}{worst * (text == message(POOR))}"


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
