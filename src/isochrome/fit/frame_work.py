"""A fit's first stage: each frame on its own, as chunks of a long run; its findings as numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.fit.frame_data import FrameData
from isochrome.fit.frame_fit import FrameFit, fit_frame, placed
from isochrome.fit.frame_set import FrameSet
from isochrome.fit.history import alone_scene
from isochrome.fit.joint_each import is_each
from isochrome.fit.refuse import refuse_alike
from isochrome.fit.result import POOR_CHI
from isochrome.fit.sequence import Sequence
from isochrome.fit.smooth import smooth_frame_fit
from isochrome.fit.starts import Minimum
from isochrome.runs import Results

_ARRAYS = ("values", "standard_uncertainty", "covariance", "cramer_rao_bound", "information")
_PLAIN = ("keys", "freedom", "chi", "converged", "plain", "positive")

Row = dict[str, Any]


@dataclass(frozen=True)
class FrameWork:
    """Fits frames of `data` for the unknowns of `sequence` that act in them, whoever calls it.

    Where nothing ties the frames together, that is the fit: a smooth stress is freed in a frame
    that asks for one, and unknowns that it does not tell apart are refused.
    """

    data: FrameSet
    sequence: Sequence

    def __call__(self, start: int, stop: int) -> Results:
        """Frames [start, stop), each from the scene. Raises InputError, PhysicsError."""
        return _results([self._row(i, data, None) for i, data in self._frames(start, stop)])

    def following(self, start: int, stop: int, left: Any) -> Results:
        """Frames [start, stop), each from where the one before ended, `left` by the last chunk."""
        last = left
        rows = []
        for i, data in self._frames(start, stop):
            rows.append(self._row(i, data, last))
            fit = rows[-1]
            last = dict(zip(fit["keys"], fit["values"], strict=True)) if fit["positive"] else None
        return replace(_results(rows), left=last)

    def restored(self, index: int, row: Row) -> FrameFit:
        """The fit of a frame, from its row."""
        parts: dict[str, Any] = {name: np.array(row[name], dtype=float) for name in _ARRAYS}
        parts |= {name: row[name] for name in _PLAIN} | {"keys": tuple(row["keys"])}
        parts["others"] = tuple(Minimum(np.array(values), chi) for values, chi in row["others"])
        start = placed(alone_scene(self.sequence.scene, index), self.data.shape)
        found = dict(zip(row["keys"], row["values"], strict=True))
        return FrameFit(scene=start.with_values(found), **parts)

    def _frames(self, start: int, stop: int) -> Any:
        return enumerate(self.data.some(start, stop), start)

    def _row(self, index: int, data: FrameData, last: Mapping[str, float] | None) -> Row:
        """A frame's fit as plain numbers; `last`, values to look for it at, and there alone."""
        scene, keys = alone_scene(self.sequence.scene, index), self.sequence.acting(index)
        if last is not None:
            scene = scene.with_values({key: last[key] for key in keys if key in last})
        said: tuple[str, ...] = ()
        fit = fit_frame(data, scene, keys, cold=last is None)
        if is_each(self.sequence):
            fit, said = self._explained(data, fit)
        row = {name: getattr(fit, name).tolist() for name in _ARRAYS}
        row |= {name: getattr(fit, name) for name in _PLAIN} | {"keys": list(fit.keys)}
        others = [[other.values.tolist(), float(other.chi)] for other in fit.others]
        return row | {"others": others, "said": list(said)}

    def _explained(self, data: FrameData, fit: FrameFit) -> tuple[FrameFit, tuple[str, ...]]:
        if fit.positive or self.sequence.count == 1:
            refuse_alike(fit.keys, fit.covariance)
        try:
            wider, said = smooth_frame_fit(data, fit)
            refuse_alike(wider.keys, wider.covariance)
        except PhysicsError:
            return fit, ()  # the frame cannot tell it from the others: chi stays and is told
        return wider, said


def _results(rows: list[Row]) -> Results:
    good = [row["positive"] and row["chi"] <= POOR_CHI for row in rows]
    return Results({}, rows, [{"status": "ok" if ok else "flagged"} for ok in good])
