"""What tracking a video found: values of each frame as numbers, and what is to be said of them."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import PhysicsError
from isochrome.fit.refuse import CORRECT
from isochrome.fit.result import POOR_CHI, named_frames
from isochrome.fit.tracker import Tracked
from isochrome.output import numbers
from isochrome.scene import Scene

Array = NDArray[Any]

_PARTS = ("values", "standard_uncertainty", "cramer_rao_bound")


@dataclass(frozen=True)
class Track:
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
        """What the frames come to, see `summarise`."""
        return summarise(self.keys, self.values.T, self.standard_uncertainty.T)


def summarise(
    keys: Iterable[str], values: Iterable[Array], spreads: Iterable[Array]
) -> dict[str, list[Any]]:
    """For each key its mean, least and most value, and the median standard uncertainty.

    Parameters: `keys`; `values` and `spreads`, of each key over the frames (n,), NaN = not known.
    Returns column name to values, None where none is known.
    """
    columns = [c[np.isfinite(c)] for c in values]
    known = [u[np.isfinite(u)] for u in spreads]
    return {
        "key": list(keys),
        "mean": [float(c.mean()) if c.size else None for c in columns],
        "least": [float(c.min()) if c.size else None for c in columns],
        "most": [float(c.max()) if c.size else None for c in columns],
        "standard_uncertainty": [float(np.median(u)) if u.size else None for u in known],
    }


def row_of(index: int, distance_m: float | None, found: Tracked) -> dict[str, Any]:
    """A frame's row as plain numbers: its number, distance (m), and what was found in it."""
    row: dict[str, Any] = {"frame": index, "distance_m": distance_m, "chi": float(found.chi)}
    row |= {name: np.asarray(getattr(found, name), float).tolist() for name in _PARTS}
    return row | {"searched": bool(found.searched), "positive": bool(found.positive)}


def is_good(row: Mapping[str, Any]) -> bool:
    """Whether nothing is to be said of a frame."""
    return bool(row["positive"] and row["chi"] <= POOR_CHI)


class TrackRows:
    """Results so far, as bare numbers: hours of video are some megabytes."""

    def __init__(self, keys: tuple[str, ...]) -> None:
        self.keys = keys
        self.values, self.spread, self.bound = array("d"), array("d"), array("d")
        self.chi, self.distance = array("d"), array("d")
        self.searched, self.empty = array("l"), array("l")

    def add(self, row: Mapping[str, Any]) -> None:
        """One frame more, from its row, see `row_of`."""
        if row["searched"]:
            self.searched.append(len(self.chi))
        if not row["positive"]:
            self.empty.append(len(self.chi))
        self.values.extend(row["values"])
        self.spread.extend(row["standard_uncertainty"])
        self.bound.extend(row["cramer_rao_bound"])
        self.chi.append(row["chi"])
        distance = row["distance_m"]
        self.distance.append(np.nan if distance is None else distance)

    def result(self, scene: Scene) -> Track:
        """All frames of a `scene`. Raises PhysicsError where none of them tells any value."""
        shape = (len(self.chi), len(self.keys))
        values, spread, bound = (
            np.array(part).reshape(shape) for part in (self.values, self.spread, self.bound)
        )
        told = np.isfinite(values) & np.isfinite(spread)
        if not told.any():
            raise PhysicsError(
                f"{scene.name}: nothing could be read in any of the {len(self.chi)} frames: the "
                f"scene's fringes are not in them; {CORRECT}"
            )
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
        empty = set(self.empty)
        again = [i for i in self.searched if i > 0 and i not in empty]
        if again:
            yield f"{named_frames(again)}: the track was lost, and found again by a full search"
        if self.empty:
            yield f"{named_frames(list(self.empty))}: the scene's fringes are not in it"
        poor = [i for i, chi in enumerate(self.chi) if chi > POOR_CHI]
        if poor:
            yield (
                f"{named_frames(poor)}: chi up to {np.nanmax(self.chi):.2f}: the model does not "
                "describe this within its noise; a bias may remain"
            )


def columns_of(keys: tuple[str, ...], rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """The columns of fit.csv: one row for each key of each frame."""
    each = [(row, j) for row in rows for j in range(len(keys))]
    return {
        "frame": [str(row["frame"]) for row, _ in each],
        "distance_m": [row["distance_m"] for row, _ in each],
        "key": [keys[j] for _, j in each],
        "value": [row["values"][j] for row, j in each],
        "standard_uncertainty": [row["standard_uncertainty"][j] for row, j in each],
        "cramer_rao_bound": [row["cramer_rao_bound"][j] for row, j in each],
        "chi": [row["chi"] for row, _ in each],
        "searched": [int(row["searched"]) for row, _ in each],
    }


def restored(found: Mapping[str, Any], keys: tuple[str, ...], scene: Scene) -> Track:
    """A Track from its JSON; `keys`, and the `scene` with the means."""
    values, spread, bound = (
        np.stack([numbers(found[key][part]) for key in keys], axis=1)
        for part in ("value", "standard_uncertainty", "cramer_rao_bound")
    )
    return Track(
        keys,
        values,
        spread,
        bound,
        numbers(found["chi"]),
        numbers(found["distance_m"]),
        tuple(found["searched"]),
        scene,
        tuple(found["warnings"]),
        already=True,
    )


def _plain(values: Array) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in values.tolist()]
