"""Sets of frames to compare, in memory or on disk, and the metrics of simulated fringe patterns.

Residuals are experiment minus simulation. NaN is "not known" on either side and never counts.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from isochrome.errors import InputError
from isochrome.frames import CHANNELS, SAME, channel_for, open_frames, open_tiff
from isochrome.fringes import Skeleton, order_contours, skeletons
from isochrome.output import numbers, read_csv
from isochrome.processing import PICTURE, Processed, corner_of
from isochrome.runs import opened_record
from isochrome.scene import Camera, FramesLike, Scene, load_scene
from isochrome.simulation import Simulation

Floats = NDArray[np.float64]
Metrics = dict[str, float]
"""Some of a pair's metrics, by their names in FrameMetrics."""

_REACH_PX, _REACH_KNOWN_PX = 20.0, 100.0
_STEP_PX = 0.2  # lines are filled up to this spacing before distances are taken


def skeleton_distance(
    experiment: Sequence[Skeleton],
    simulation: Sequence[Skeleton],
    *,
    pixel_mm: float | None = None,
    reach_px: float | None = None,
) -> Metrics:
    """Mean distance to the nearest fringe line of the same kind (and order, where both know it), of
    both directions', so that neither side's longer lines rule. A point without a partner within
    reach (half the distance of like fringes, or more with orders) only lowers `matched_share`."""
    if not (len(experiment) or len(simulation)):
        raise InputError("no_fringe_line_either")
    by_order = all(line.order is not None for line in (*experiment, *simulation))
    if reach_px is None:
        reach_px = _REACH_KNOWN_PX if by_order else _REACH_PX
    both = [(experiment, simulation), (simulation, experiment)]
    distances = [_nearest(source, target, by_order) for source, target in both]
    sides = [each[(each <= reach_px) & np.isfinite(each)] for each in distances]
    averages = [side.mean() for side in sides if side.size]
    mean_px = float(np.mean(averages)) if averages else np.nan
    return {
        "skeleton_distance_px": mean_px,
        "skeleton_distance_mm": np.nan if pixel_mm is None else mean_px * pixel_mm,
        "skeleton_matched_share": sum(s.size for s in sides) / sum(d.size for d in distances),
    }


def _nearest(source: Sequence[Skeleton], target: Sequence[Skeleton], by_order: bool) -> Floats:
    """Distances (px) of all source points to the nearest like target line; inf if none."""
    clouds = defaultdict[tuple[str, float | None], list[Floats]](list)
    for line in target:  # filled up, so that the nearest point is as near as the line itself
        run = np.r_[0.0, np.cumsum(np.hypot(np.diff(line.rows), np.diff(line.cols)))]
        at = np.union1d(np.arange(0.0, run[-1], _STEP_PX), run)
        points = np.column_stack([np.interp(at, run, each) for each in (line.rows, line.cols)])
        clouds[line.kind, line.order if by_order else None].append(points)
    trees = {like: cKDTree(np.vstack(parts)) for like, parts in clouds.items()}
    distances = [np.zeros(0)]
    for line in source:
        points = np.column_stack([line.rows, line.cols])
        tree = trees.get((line.kind, line.order if by_order else None))
        distances.append(np.full(len(points), np.inf) if tree is None else tree.query(points)[0])
    return np.concatenate(distances)


WRONG_BRANCH_FRINGES = 0.25
"""Beyond this difference in fringe order a pixel counts as standing on a wrong branch."""

_SSIM_WINDOW = 7


def compare_orders(experiment: ArrayLike, simulation: ArrayLike) -> Metrics:
    """Of maps (row, col) of the order N, NaN = not known: d = N_experiment - N_simulation; wrong
    branch: |d| > 0.25, half of a branch of the dark field, sin²(pi N): a lower bound, as a pixel
    mirrored beside a branch's edge is not counted."""
    measured, model, known = _paired(experiment, simulation, "fringe-order maps", "fringe order")
    difference = measured[known] - model[known]
    size = np.abs(difference)
    return {
        "order_rms_fringe": _rms(difference),
        "order_p95_fringe": float(np.percentile(size, 95.0)),
        "order_bias_fringe": float(difference.mean()),
        "wrong_branch_share": float(np.mean(size > WRONG_BRANCH_FRINGES)),
        "compared_share": float(known.sum() / known.size),
    }


def compare_signals(
    experiment: ArrayLike, simulation: ArrayLike, *, noise: ArrayLike | None = None
) -> Metrics:
    """Of images of the same fringes: NCC = <(E - Ē)(S - S̄)>/(sd E sd S); RMSE = rms r, r = E -
    (gain S + offset) by least squares; over noise (a standard deviation) rms (r/noise). SSIM (7 x
    7, E and gain S + offset, windows wholly known, of a span of 1) is given as others report it: a
    perfect model scores .893 on one noisy frame, one 1 % off in load .890."""
    measured, model, known = _paired(experiment, simulation, "images", "signal")
    a, b = (image[known] - image[known].mean() for image in (measured, model))
    # the least-squares line of the grey levels; of a model without contrast their mean
    flat = b @ b <= (1e-9 * (1.0 + float(np.abs(model[known]).max()))) ** 2 * b.size
    gain = 0.0 if flat else float(a @ b) / float(b @ b)
    offset = float(measured[known].mean() - gain * model[known].mean())
    fitted = gain * model + offset
    residual, over_noise = (measured - fitted)[known], np.nan
    if noise is not None:
        deviation = np.broadcast_to(np.asarray(noise, dtype=float), measured.shape)[known]
        if not np.all(deviation > 0.0):
            raise InputError("noise_image_comparison_holds")
        over_noise = _rms(residual / deviation)
    scale = float(np.sqrt((a @ a) * (b @ b)))
    largest = np.abs(measured[known]).max() * np.abs(model[known]).max()
    constant = scale <= 1e-18 * a.size * (1.0 + float(largest))
    return {
        "ncc": float("nan") if constant else float(np.clip(a @ b / scale, -1.0, 1.0)),
        "rmse": _rms(residual),
        "rmse_over_noise": over_noise,
        "ssim": _ssim(measured, fitted, known),
        "gain": gain,
        "offset": offset,
    }


def _paired(
    experiment: ArrayLike, simulation: ArrayLike, what: str, quantity: str
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Both sides, and the pixels that both know."""
    measured = np.asarray(experiment, dtype=np.float64)
    model = np.asarray(simulation, dtype=np.float64)
    if measured.shape != model.shape or measured.ndim != 2:
        raise InputError(
            "shape_experiment_simulation_give", what=what, shape=measured.shape, shape_2=model.shape
        )
    known = np.isfinite(measured) & np.isfinite(model)
    if not known.any():
        raise InputError("no_pixel_has_known", quantity=quantity)
    return measured, model, known


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _ssim(measured: Floats, model: Floats, known: NDArray[np.bool_]) -> float:
    from scipy.ndimage import binary_erosion
    from skimage.metrics import structural_similarity

    inner = binary_erosion(known, np.ones((_SSIM_WINDOW, _SSIM_WINDOW)))
    if not inner.any():
        return float("nan")
    level = float(measured[known].mean())
    both = (np.where(known, image, level) for image in (measured, model))
    _, local = structural_similarity(*both, win_size=_SSIM_WINDOW, data_range=1.0, full=True)
    return float(local[inner].mean())


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
    noise : ndarray of shape (frame,), optional
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
    noise: NDArray[np.floating] | None = None

    def __post_init__(self) -> None:
        if self.signal.ndim != 3 or not len(self.signal):
            raise InputError("frame_set_shape_give", shape=self.signal.shape)
        if self.order is not None and self.order.shape != self.signal.shape:
            raise InputError(
                "fringe_orders_shape_signals", shape=self.order.shape, shape_2=self.signal.shape
            )
        if self.labels and len(self.labels) != len(self.signal):
            raise InputError(
                "labels_frames_give_one", labels_count=len(self.labels), self_count=len(self)
            )
        if self.pixel_mm is not None and not self.pixel_mm > 0:
            raise InputError("pixel_mm_frame_set_give", pixel_mm=self.pixel_mm)
        if self.noise is not None and len(self.noise) != len(self):
            raise InputError("noise_values_frames", size=len(self.noise), self_count=len(self))

    def __len__(self) -> int:
        return len(self.signal)

    def label(self, index: int) -> str:
        """Name frame `index`: its label, or "frame 0", "frame 1" ... without labels."""
        return self.labels[index] if self.labels else f"frame {index}"

    def noise_of(self, index: int) -> float | None:
        """Noise of frame `index` in signal units; None when not known."""
        if self.noise is None:
            return None
        value = float(self.noise[index])
        return value if np.isfinite(value) and value > 0 else None


@dataclass(frozen=True, kw_only=True)
class FrameMetrics:
    """Every number for one pair of frames; None where one side lacks what it takes.

    Parameters
    ----------
    frame : int
        Number of the pair, from 0.
    label : str
        Label of the frame.
    order_rms_fringe : float, optional
        Root mean square of the difference of the orders over all compared pixels, fringes.
    order_p95_fringe : float, optional
        The 95th percentile of |difference|, fringes.
    order_bias_fringe : float, optional
        Mean of experiment - simulation, fringes.
    wrong_branch_share : float, optional
        Share of the compared pixels that stand on a wrong branch, 0 to 1.
    compared_share : float, optional
        Compared pixels over all, 0 to 1.
    skeleton_distance_px : float, optional
        Mean distance of the fringe lines, pixels; NaN where none has a partner.
    skeleton_distance_mm : float, optional
        The same, mm; NaN where the scale is not known.
    skeleton_matched_share : float, optional
        Length of line, on both sides, that found a partner within reach, as a share of all.
    ncc : float
        Normalised cross-correlation of the signals.
    rmse : float
        Root mean square of experiment - (gain simulation + offset), in units of the signal.
    rmse_over_noise : float
        The same over the noise; NaN where that is not known.
    ssim : float
        Structural similarity of the signals.
    gain : float
        Slope of the line experiment = gain simulation + offset.
    offset : float
        Offset of the line, in units of the signal.
    """

    frame: int
    label: str
    order_rms_fringe: float | None = None
    order_p95_fringe: float | None = None
    order_bias_fringe: float | None = None
    wrong_branch_share: float | None = None
    compared_share: float | None = None
    skeleton_distance_px: float | None = None
    skeleton_distance_mm: float | None = None
    skeleton_matched_share: float | None = None
    ncc: float
    rmse: float
    rmse_over_noise: float
    ssim: float
    gain: float
    offset: float


def compare_frames(experiment: ComparedFrames, simulation: ComparedFrames) -> list[FrameMetrics]:
    """Compare two sets frame by frame, an entry a pair, see `frame_pairs`."""
    pairs = frame_pairs(experiment, simulation)
    return [compare_pair(experiment, simulation, k, pair) for k, pair in enumerate(pairs)]


def compare_pair(
    experiment: ComparedFrames, simulation: ComparedFrames, index: int, pair: tuple[int, int]
) -> FrameMetrics:
    """The fringe lines are the order maps', or the signals', where both are known."""
    i, j = pair
    label = (experiment if len(experiment) >= len(simulation) else simulation).label(index)
    measured, model = experiment.signal[i], simulation.signal[j]
    try:
        metrics = compare_signals(measured, model, noise=experiment.noise_of(i))
    except InputError as error:
        raise InputError(f"frame {index} ({label}): " + error.message) from error
    maps, of_orders = (measured, model), False
    if experiment.order is not None and simulation.order is not None:
        orders = experiment.order[i], simulation.order[j]
        if np.isfinite(orders[0] - orders[1]).any():
            metrics |= compare_orders(*orders)
            maps, of_orders = orders, True
    known = np.isfinite(maps[0]) & np.isfinite(maps[1])
    both = (np.where(known, each, np.nan) for each in maps)
    lines = [order_contours(one) if of_orders else skeletons(one) for one in both]
    if any(lines):
        scale = experiment.pixel_mm or simulation.pixel_mm
        metrics |= skeleton_distance(*lines, pixel_mm=scale)
    return FrameMetrics(frame=index, label=label, **metrics)


def frame_pairs(experiment: ComparedFrames, simulation: ComparedFrames) -> list[tuple[int, int]]:
    """Indices (experiment, simulation) of each pair: one to one, or a single frame with all."""
    if experiment.signal.shape[1:] != simulation.signal.shape[1:]:
        raise InputError(
            "frames_shape_experiment_simulation", shape=experiment.signal.shape[1:],
            shape_2=simulation.signal.shape[1:],
        )  # fmt: skip
    scales = experiment.pixel_mm, simulation.pixel_mm
    if None not in scales and abs(scales[0] / scales[1] - 1.0) > SAME:  # type: ignore[operator]
        raise InputError(
            "pixel_mm_experiment_simulation_frames", scales=scales[0], scales_2=scales[1]
        )
    here, there = len(experiment), len(simulation)
    if here != there and 1 not in (here, there):
        raise InputError("frames_experiment_simulation_give", here=here, there=there)
    return [(min(index, here - 1), min(index, there - 1)) for index in range(max(here, there))]


_SIGNALS = (("normalised.tif", "frames.csv"), ("frames.tif", "history.csv"))
_ORDER = "fringe_order.tif"

SetToCompare = FramesLike | Processed | Simulation | ComparedFrames
"""A frame set as a caller may give it: a result's folder, a result in memory, or frames."""


def load_frame_set(given: SetToCompare) -> ComparedFrames:
    """Load frames (frame, row, col) to compare, as a signal of 0 to 1: those of a result, in memory
    or a folder, else bare ones, as by `open_frames`."""
    if isinstance(given, ComparedFrames):
        return given
    if isinstance(given, Processed | Simulation):
        return _of_result(given)
    if isinstance(given, str | Path):
        place = Path(given)
        if not place.exists():
            raise InputError("no_such_file_folder", place=place)
        for signal_name, table_name in _SIGNALS:
            if place.is_dir() and (place / signal_name).exists():
                return _load_result(place, signal_name, table_name)
    with open_frames(given) as reader:
        images = [scaled(frame.image, reader.bit_depth) for frame in reader]
        scale = reader.pixel_mm
    if not images:
        raise InputError("no_frame_give_tiff", path=reader.path)
    return ComparedFrames(signal=np.stack(images), pixel_mm=scale)


def _of_result(result: Processed | Simulation) -> ComparedFrames:
    """The frames of a result whose maps are in memory, at the place that was found."""
    name, scene, table = result.title, result.scene, result.columns
    if result.frames is None:
        raise InputError("maps_folder_written_name", title=name)
    if isinstance(result, Simulation):
        return _compared(result.frames, result.orders, scene, table, name=name, simulated=True)
    stack, order = np.stack([frame.maps()["normalised"] for frame in result.frames]), None
    readings = [frame.reading for frame in result.frames]
    if any(readings):
        blank = np.full(stack.shape[1:], np.nan, np.float32)
        order = np.stack([reading.order if reading else blank for reading in readings])
    return _compared(stack, order, result.fitted or scene, table, name=name)


def _load_result(folder: Path, signal_name: str, table_name: str) -> ComparedFrames:
    opened_record(folder, (signal_name, _ORDER, table_name, "scene.toml"))
    # (frame, row, col[, 3]) in their own type
    source, order = open_tiff(folder / signal_name), None
    stack = np.stack([raw.image for raw in source.frames(0)])
    if (folder / _ORDER).exists():
        pages = [raw.image for raw in open_tiff(folder / _ORDER).frames(0)]
        order = np.stack(pages).astype(np.float32, copy=False)
    table = read_csv(folder / table_name) if (folder / table_name).exists() else {}
    fitted = folder / "fitted_scene.toml"  # with the place that was found
    resolved = fitted if fitted.is_file() else folder / "scene.toml"
    scene = load_scene(resolved if resolved.exists() else {"specimen": {}})
    return _compared(
        stack, order, scene, table, name=str(folder / signal_name),
        simulated=signal_name == "frames.tif", pixel_mm=source.pixel_mm,
    )  # fmt: skip


def _compared(
    stack: NDArray[Any],
    order: NDArray[Any] | None,
    scene: Scene,
    table: Mapping[str, Sequence[Any]],
    *,
    name: str,
    simulated: bool = False,
    pixel_mm: float | None = None,
) -> ComparedFrames:
    """Frames (frame, row, col[, channel]) as a signal of 0 to 1; `table`, of frames.csv."""
    table, order = _of_pictures(table, order)
    camera, steps = scene.camera or Camera(), scene.polariscope.frames_a_state
    signal = _one_channel(scaled(stack, camera.bit_depth), scene)
    if order is not None and steps > 1 and len(signal) == steps * len(order):
        raise InputError("phase_stepped_set_frames", name=name, steps=steps, order_count=len(order))
    if order is not None and order.shape != signal.shape:
        raise InputError(
            "has_shape_beside_folder", name=name, shape=signal.shape, order=_ORDER,
            shape_2=order.shape,
        )  # fmt: skip
    length = len(next(iter(table.values()), signal))
    if length != len(signal):
        raise InputError(
            "table_has_rows_frames", name=name, length=length, signal_count=len(signal)
        )
    if order is not None and simulated:
        signal = np.where(np.isfinite(order), signal, np.float32(np.nan))  # no specimen there
    left_mm, top_mm = corner_of(scene, (signal.shape[1], signal.shape[2]))
    noise = table.get("noise", [])  # of each frame, where the table has it as numbers
    known = len(noise) and all(isinstance(value, float) for value in noise)
    return ComparedFrames(
        signal=signal, order=order, pixel_mm=pixel_mm or camera.pixel_mm, left_mm=left_mm,
        top_mm=top_mm, labels=tuple(map(str, table.get("label", ()))),
        noise=np.array(noise) if known else None,
    )  # fmt: skip


def _of_pictures(
    table: Mapping[str, Sequence[Any]], order: NDArray[Any] | None
) -> tuple[Mapping[str, Sequence[Any]], NDArray[Any] | None]:
    """Rows and orders of a tracked video's key frames, which alone have pictures."""
    if PICTURE not in table:
        return table, order
    shown = np.isfinite(numbers(table[PICTURE]))
    if order is not None and len(order) == len(shown):  # a page for every frame
        order = order[shown]
    return {name: list(compress(values, shown)) for name, values in table.items()}, order


def _one_channel(signal: NDArray[Any], scene: Scene) -> NDArray[Any]:
    """Reduce colour to the channel that the scene names, else the nearest to its wavelength."""
    if signal.ndim == 3:
        return signal
    channel = scene.frames.channel or channel_for(scene.polariscope.wavelength_nm)
    if channel == "mean":
        return np.asarray(signal.mean(axis=3, dtype=np.float32))
    return signal[..., CHANNELS.index(channel)]


def scaled(image: NDArray[Any], bit_depth: int | None = None) -> NDArray[np.floating]:
    """Whole-number pixels over 2^bits - 1, as float32, and none beyond it; floats as they are."""
    if not np.issubdtype(image.dtype, np.integer):
        return image.astype(np.float32, copy=False)
    full = 2 ** (bit_depth or 8 * image.dtype.itemsize) - 1
    if image.size and int(image.max()) > full:
        raise InputError(
            "pixel_counts_frames_bits", max=int(image.max()), bit_depth=bit_depth, full=full
        )
    return image.astype(np.float32) / np.float32(full)
