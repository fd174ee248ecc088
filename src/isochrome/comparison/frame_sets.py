"""Sets of frames to compare, and their comparison frame by frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.comparison.line_distance import SkeletonDistance, skeleton_distance
from isochrome.comparison.metrics import (
    OrderMetrics,
    SignalMetrics,
    compare_orders,
    compare_signals,
)
from isochrome.errors import InputError
from isochrome.fringes import order_contours, skeletons

_SCALE_TOLERANCE = 1e-3  # two pixel scales that differ by more are not on one grid


@dataclass(frozen=True, eq=False, kw_only=True)
class ComparedFrames:
    """Frames of one experiment or one simulation, on one pixel grid; NaN = not known.

    Parameters
    ----------
    signal : ndarray of shape (frame, row, col)
        Dark-field signal, 0 to 1.
    order : ndarray of shape (frame, row, col), optional
        Fringe order, fringes; None where there is none.
    pixel_mm : float, optional
        Edge of a square pixel, mm; None where it is not known.
    left_mm : float, default 0.0
        Outer edge of the first column, mm.
    top_mm : float, default 0.0
        Outer edge of the first row, mm.
    labels : tuple of str, optional
        Labels, one a frame, such as "static" or "sliding, 31 m".
    noise : float or ndarray of shape (frame,), optional
        Standard deviation of the signal; None where it is not known.

    Raises
    ------
    InputError
        Where these disagree.
    """

    signal: NDArray[np.floating]
    order: NDArray[np.floating] | None = None
    pixel_mm: float | None = None
    left_mm: float = 0.0
    top_mm: float = 0.0
    labels: tuple[str, ...] = ()
    noise: float | NDArray[np.floating] | None = None

    def __post_init__(self) -> None:
        if self.signal.ndim != 3 or not len(self.signal):
            raise InputError(
                f"a frame set of shape {self.signal.shape}: give (frame, row, col), one or more"
            )
        if self.order is not None and self.order.shape != self.signal.shape:
            raise InputError(
                f"fringe orders of shape {self.order.shape} for signals of shape "
                f"{self.signal.shape}: give equal shapes"
            )
        if self.labels and len(self.labels) != len(self.signal):
            raise InputError(f"{len(self.labels)} labels for {len(self)} frames: give one a frame")
        if self.pixel_mm is not None and not self.pixel_mm > 0:
            raise InputError(f"pixel_mm = {self.pixel_mm} of a frame set: give it above zero")
        if self.noise is not None and np.size(self.noise) not in (1, len(self)):
            raise InputError(f"{np.size(self.noise)} noise values for {len(self)} frames")

    def __len__(self) -> int:
        return len(self.signal)

    def label(self, index: int) -> str:
        """Name frame `index`: its label, or "frame 0", "frame 1" ... without labels."""
        return self.labels[index] if self.labels else f"frame {index}"

    def only(self, index: int) -> ComparedFrames:
        """Frame `index` alone."""
        own = slice(index, index + 1)
        noise = self.noise_of(index)
        return replace(
            self, signal=self.signal[own], order=None if self.order is None else self.order[own],
            labels=self.labels[own], noise=noise,
        )  # fmt: skip

    def noise_of(self, index: int) -> float | None:
        """Noise of frame `index` in signal units; None when not known."""
        if self.noise is None:
            return None
        every = np.ravel(np.asarray(self.noise, dtype=float))
        value = float(every[index if every.size > 1 else 0])
        return value if np.isfinite(value) and value > 0 else None


@dataclass(frozen=True)
class FrameMetrics:
    """Every number for one pair of frames; None where one side lacks what it takes.

    Parameters
    ----------
    frame : int
        Number of the pair, from 0.
    label : str
        Label of the frame.
    orders : OrderMetrics or None
        Those of the fringe order, where it is known in both frames.
    signals : SignalMetrics
        Those of the signals.
    skeleton : SkeletonDistance or None
        Distance of the fringe lines, where either frame has one.
    """

    frame: int
    label: str
    orders: OrderMetrics | None
    signals: SignalMetrics
    skeleton: SkeletonDistance | None


def compare_frames(
    experiment: ComparedFrames, simulation: ComparedFrames, *, mask: ArrayLike | None = None
) -> list[FrameMetrics]:
    """Compare two sets frame by frame, an entry a pair; one frame is compared with every other one.

    Lines for the skeleton distance come from the order maps where both sides have them, else from
    the signals; only where both images are known. InputError where numbers, shapes or pixel scales
    do not fit together, or a pair has no pixel to compare.
    """
    found = []
    for index, (here, there) in enumerate(frame_pairs(experiment, simulation)):
        label = (experiment if len(experiment) >= len(simulation) else simulation).label(index)
        measured, model = experiment.signal[here], simulation.signal[there]
        try:
            signals = compare_signals(measured, model, mask=mask, noise=experiment.noise_of(here))
        except InputError as error:
            raise InputError(f"frame {index} ({label}): {error}") from error
        orders = None
        if experiment.order is not None and simulation.order is not None:
            maps = _known_in_both(experiment.order[here], simulation.order[there], mask)
            if np.isfinite(maps[0]).any():
                orders = compare_orders(*maps, mask=mask)
        if orders is not None:
            lines = [order_contours(each) for each in maps]
        else:
            lines = [skeletons(each) for each in _known_in_both(measured, model, mask)]
        skeleton = None
        if any(lines):
            scale = experiment.pixel_mm or simulation.pixel_mm
            skeleton = skeleton_distance(lines[0], lines[1], pixel_mm=scale)
        found.append(FrameMetrics(index, label, orders, signals, skeleton))
    return found


def frame_pairs(experiment: ComparedFrames, simulation: ComparedFrames) -> list[tuple[int, int]]:
    """Pair the frames of two sets: one to one, or the single frame of one set with all.

    Returns (experiment index, simulation index). Raises InputError when the sets do not fit.
    """
    if experiment.signal.shape[1:] != simulation.signal.shape[1:]:
        raise InputError(
            f"frames of shape {experiment.signal.shape[1:]} (experiment) and "
            f"{simulation.signal.shape[1:]} (simulation), rows x columns: simulate with the "
            "experiment's [camera] width_px, height_px and [frames] roi"
        )
    scales = experiment.pixel_mm, simulation.pixel_mm
    if None not in scales and abs(scales[0] / scales[1] - 1.0) > _SCALE_TOLERANCE:  # type: ignore[operator]
        raise InputError(
            f"pixel_mm = {scales[0]:.6g} (experiment) and {scales[1]:.6g} (simulation): the frames "
            "are not on one grid; simulate with the experiment's [camera] pixel_mm"
        )
    here, there = len(experiment), len(simulation)
    if here != there and 1 not in (here, there):
        raise InputError(
            f"{here} frames of the experiment and {there} of the simulation: give equal numbers, "
            "or one frame on either side; simulate at the distances of the captured frames"
        )
    count = max(here, there)
    return [(min(index, here - 1), min(index, there - 1)) for index in range(count)]


def _known_in_both(
    measured: NDArray[Any], model: NDArray[Any], mask: ArrayLike | None
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Blank either image where the other, or the mask, has nothing to say."""
    known = np.isfinite(measured) & np.isfinite(model)
    if mask is not None:
        known &= np.asarray(mask, dtype=bool)
    return np.where(known, measured, np.nan), np.where(known, model, np.nan)
