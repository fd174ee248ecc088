"""A frame of a tracked video that was followed, and how it is written down."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from isochrome.fit.tracker import Tracked
from isochrome.process.result import SPREAD

WHOLE, FOLLOWED, SEARCHED, NOTHING = "whole frame", "track", "search", "nothing"
"""How a frame's values were found, in frames.csv."""

NO_FRINGES = "the scene's fringes are not in this frame"
AGAIN = "there was no track to follow: found by a full search"
POOR = "chi is poor: the model does not describe this frame within its noise; a bias may remain"
FAR = "the model is too far off: no values were told"


@dataclass(frozen=True)
class FollowedFrame:
    """A frame between two key frames, of which its tracked values alone are known.

    `index`, `name`, `label`, `distance_m`, `time_s`, `pixel_mm`, `warnings` and `failed` as of a
    ProcessedFrame; `keys` and `tracked`, what was found, None in a frame that failed.
    """

    index: int
    name: str
    label: str
    distance_m: float
    time_s: float | None
    pixel_mm: float | None
    keys: tuple[str, ...]
    tracked: Tracked | None
    warnings: tuple[str, ...]
    failed: bool = False

    @property
    def status(self) -> str:
        """'ok', 'flagged' (there are warnings) or 'failed'."""
        return "failed" if self.failed else "flagged" if self.warnings else "ok"

    def row(self) -> dict[str, Any]:
        """The frame's row of frames.csv."""
        row: dict[str, Any] = {
            "frame": self.index,
            "name": self.name,
            "label": self.label,
            "picture": None,
            "found_by": NOTHING,
            "distance_m": self.distance_m,
            "pixel_mm": self.pixel_mm,
        }
        told = self.tracked
        if told is not None:
            row["chi"] = told.chi
            if np.isfinite(told.values).any():
                row["found_by"] = SEARCHED if told.searched else FOLLOWED
            pairs = zip(self.keys, told.values, told.standard_uncertainty, strict=True)
            for key, value, spread in pairs:
                row |= {key: float(value), f"{key} {SPREAD}": float(spread)}
        return row | {"warnings": "; ".join(self.warnings)}

    def more(self) -> dict[str, Any]:
        """What the dataset knows besides the row."""
        place = dict(zip(self.keys, self.tracked.values, strict=True)) if self.tracked else {}
        return {
            "status": self.status,
            "time_s": self.time_s,
            "left_mm": float(place.get("camera.left_mm", np.nan)),
            "top_mm": float(place.get("camera.top_mm", np.nan)),
            "read": False,
            "kept": None,
        }
