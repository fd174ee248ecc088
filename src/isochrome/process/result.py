"""What `process` finds in one frame, and how it is written down."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.frame_fit import FrameFit
from isochrome.frames import Frame, Linear
from isochrome.fringes.branch import OrderReading
from isochrome.fringes.line_orders import number_lines
from isochrome.fringes.skeleton import Skeleton, order_contours
from isochrome.scene import Scene
from isochrome.stress import pixel_grid

Array = NDArray[Any]

SPREAD = "standard_uncertainty"
"""What follows a key in the name of the column that holds its uncertainty."""


_SHORTEST_PX = 12.0
"""Of a fringe line: where the order is level, noise makes small loops of it."""


@dataclass(frozen=True)
class Capture:
    """How a set was captured: the sensor's `bit_depth`, the `dark` and `bright` no-load frames."""

    bit_depth: int | None
    dark: Linear | None = None
    bright: Linear | None = None


def largest_pixel(order: Array) -> dict[str, Any]:
    """Columns of the largest fringe order that is known and its pixel; NaN and None where none is.

    Parameters: `order` (rows, cols), fringes, NaN = not known. Returns column name to value.
    """
    if not np.isfinite(order).any():
        return {"n_max": float("nan"), "n_max_row_px": None, "n_max_col_px": None}
    row, col = np.unravel_index(int(np.nanargmax(order)), order.shape)
    return {"n_max": float(order[row, col]), "n_max_row_px": int(row), "n_max_col_px": int(col)}


def failed_frame(frame: Frame, why: str) -> ProcessedFrame:
    """A frame in which nothing could be found, and the sentence that says why."""
    nothing = np.full(frame.image.shape[:2], np.nan, dtype=np.float32)
    none = float("nan")
    return ProcessedFrame(
        frame.index, frame.name, frame.name, none, nothing, None, None, [], none, none, None,
        (why,), failed=True,
    )  # fmt: skip


@dataclass(frozen=True)
class ProcessedFrame:
    """What was found in one frame; maps are (rows, cols), NaN = not known.

    `normalised`, the signal 0..1 with background and illumination out; `reading`, the fringe order
    (None without a model); `fit` and the fitted `scene` (None without one); `lines`, the fringe
    skeleton (without a model); `noise` of the signal; `chi`, residual over noise of the whole
    frame; `warnings` in plain words; `isoclinic`, direction of sigma_1 in degrees (phase-stepped
    sets alone), and `columns`, what such a set has in frames.csv besides; `time_s` since the
    recording began, where the file knows it; `failed`, whether nothing could be found in it.
    """

    index: int
    name: str
    label: str
    distance_m: float
    normalised: Array
    reading: OrderReading | None
    fit: FrameFit | None
    lines: list[Skeleton]
    noise: float
    chi: float
    pixel_mm: float | None
    warnings: tuple[str, ...]
    isoclinic: Array | None = None
    columns: dict[str, Any] = field(default_factory=dict)
    time_s: float | None = None
    failed: bool = False

    @property
    def status(self) -> str:
        """'ok', 'flagged' (there are warnings) or 'failed'."""
        return "failed" if self.failed else "flagged" if self.warnings else "ok"

    def skeleton(self) -> list[Skeleton]:
        """The fringe lines, with their orders where the frame has a reading.

        Those that the frame shows; where nobody looked for them, the reading's own half orders.
        """
        if self.reading is None:
            return self.lines
        if self.lines:
            return number_lines(self.lines, self.reading.order)
        return order_contours(self.reading.order, min_length_px=_SHORTEST_PX)

    def corner_mm(self, scene: Scene) -> tuple[float, float]:
        """Outer edges (mm) of the first column and row, in the scene's axes; 0 where none has any.

        Parameters: `scene`, the set's. Returns left and top.
        """
        own = scene if self.fit is None else self.fit.scene
        if own.model is not None and own.camera is not None and own.camera.pixel_mm is not None:
            grid = pixel_grid(own, (self.normalised.shape[0], self.normalised.shape[1]))
            return grid.left_mm, grid.top_mm
        return (own.camera.left_mm or 0.0, own.camera.top_mm or 0.0) if own.camera else (0.0, 0.0)

    def maps(self) -> dict[str, Array]:
        """The maps that are written to disk, by the name of their file."""
        if self.reading is None:
            return {"normalised": self.normalised}
        maps = {
            "normalised": self.normalised,
            "fringe_order": self.reading.order,
            "confidence": self.reading.confidence,
        }
        return maps if self.isoclinic is None else maps | {"isoclinic": self.isoclinic}

    def _largest(self, order: Array) -> dict[str, float]:
        """The largest fringe order that is known, and its place (mm)."""
        assert self.fit is not None
        there = largest_pixel(order)
        if there["n_max_row_px"] is None:
            return dict.fromkeys(("n_max", "n_max_x_mm", "n_max_z_mm"), float("nan"))
        grid = pixel_grid(self.fit.scene, (order.shape[0], order.shape[1]))
        return {
            "n_max": there["n_max"],
            "n_max_x_mm": float(grid.x_mm[there["n_max_col_px"]]),
            "n_max_z_mm": float(grid.z_mm[there["n_max_row_px"]]),
        }

    def row(self) -> dict[str, Any]:
        """The frame's row of frames.csv."""
        row: dict[str, Any] = {
            "frame": self.index,
            "name": self.name,
            "label": self.label,
            "distance_m": self.distance_m,
            "chi": self.chi,
            "noise": self.noise,
            "pixel_mm": self.pixel_mm,
        }
        if self.failed:
            return row | {"warnings": "; ".join(self.warnings)}
        if self.columns:
            return row | self.columns | {"warnings": "; ".join(self.warnings)}
        if self.fit is None or self.reading is None:
            return row | {"fringe_lines": len(self.lines), "warnings": "; ".join(self.warnings)}
        row |= {"kept_share": self.reading.kept, **self._largest(self.reading.order)}
        for key, value, spread in zip(
            self.fit.keys, self.fit.values, self.fit.standard_uncertainty, strict=True
        ):
            row |= {key: float(value), f"{key} {SPREAD}": float(spread)}
        return row | {"warnings": "; ".join(self.warnings)}
