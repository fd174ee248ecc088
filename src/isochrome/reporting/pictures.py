"""Pictures and orders of some frames as text in a page, in bounded room.

Which frames of a run a report shows, and why these.
"""

import base64
import io
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.figures import DIFFERENCE_MAP, FRAME_MAP, VALUE_MAP

MOST_FRAMES = 8
"""Frames in a report: of a camera's usual picture so many are shown pixel by pixel in 10 MB."""


@dataclass(frozen=True)
class ChosenFrame:
    """A frame that a report shows."""

    number: int  # among those it was chosen from, from 0
    why: str  # empty where all are shown


def choose_frames(
    chi: ArrayLike, order: ArrayLike, *, most: int = MOST_FRAMES
) -> list[ChosenFrame]:
    """Choose the frames that a report shows by chi and largest order, which may be NaN.

    All, where they are no more than `most`, 4 at least; else the first and the last, the one that
    its model describes worst, the one with the largest order, and between them evenly spaced ones.
    """
    worst, largest = np.asarray(chi, float), np.asarray(order, float)
    count = len(worst)
    if count <= most:
        return [ChosenFrame(k, "") for k in range(count)]
    why = {0: "the first", count - 1: "the last"}
    for values, reason in ((worst, "the largest chi"), (largest, "the largest order")):
        if np.isfinite(values).any():
            why.setdefault(int(np.nanargmax(values)), reason)
    between = np.linspace(0, count - 1, most - len(why) + 2)[1:-1]
    for place in between:  # one that is taken gives way to the next
        number = next((k for k in range(round(place), count) if k not in why), None)
        if number is not None:
            why[number] = "evenly spaced"
    return [ChosenFrame(k, why[k]) for k in sorted(why)]


Array = NDArray[Any]

FINE_STEP, STEP = 0.001, 0.01
"""Fringes: orders in a report are rounded to the first, or the second where that lacks room."""

ROOM_BYTES = 8_000_000
"""Text for all frames of a report, of the 10 MB that one has at most."""

_LARGEST = 65_000
"""Steps that 16 bits hold; orders hundreds of fringes above the smallest are given as not known."""

_LEAST_BYTES = 0.4
"""Bytes a pixel of a frame, of which no camera's frame takes less: nothing finer is tried."""

_GREYS, _COLOURS = 64, 15
"""Levels of a grey picture and of a difference: more are not told apart on paper."""


FRINGES, SIGNAL, GREY_LEVELS = "fringes", "of the full light", "grey levels"
"""Units of what a pane shows."""


@dataclass(frozen=True)
class Pane:
    """One picture (row, col) of a frame; NaN = not known."""

    key: str  # 'experiment', 'simulation', 'rendered', 'order' or 'difference'
    label: str  # what the page calls it
    values: Array
    span: tuple[float, float]  # what is shown black and white, or in the end colours
    unit: str  # FRINGES, SIGNAL or GREY_LEVELS


@dataclass(frozen=True)
class OrderMap:
    """Fringe orders as text, rounded to a step.

    `data`: base64 of zlib: N/step - first + 1 as 16-bit whole numbers, 0 = not known; each less the
    one to its left (modulo 2^16), first all low bytes and then all high ones, row by row.
    """

    data: str
    first: int  # the smallest N/step
    step: float  # fringes


@dataclass(frozen=True, kw_only=True)
class ReportFrame:
    """A frame as a report shows it."""

    number: int  # in the run
    label: str  # what figures call it
    why: str  # it is shown
    panes: tuple[Pane, ...]  # the first, the experiment where there is one, lies over the others
    order: Array | None = None  # read, fringes, NaN = not known; None: none is read
    model_order: Array | None = None  # of the simulation
    pixel_mm: float | None = None  # None: no scale is known
    left_mm: float = 0.0  # outer edges of the first column and row
    top_mm: float = 0.0
    notes: tuple[str, ...] = ()  # what to say of it, such as why it has no simulation


def encode_frames(frames: Sequence[ReportFrame], *, room: int = ROOM_BYTES) -> list[dict[str, Any]]:
    """For each frame its pictures as PNG and its orders, as the page takes them, in `room` bytes.

    Of each n-th pixel of each n-th row where all would take too much.
    """
    result: list[tuple[dict[str, Any], int]] = []
    for done, frame in enumerate(frames):
        own = (room - sum(size for _, size in result)) // (len(frames) - done)
        shape = frame.panes[0].values.shape
        stride = max(1, int(np.sqrt(_LEAST_BYTES * np.prod(shape) / own)))
        encoded = _encoded(frame, stride)
        while _size(encoded) > own and min(shape) > stride:
            stride = max(stride + 1, int(stride * np.sqrt(_size(encoded) / own)))
            encoded = _encoded(frame, stride)
        finer = encoded | _orders(frame, stride, FINE_STEP)
        encoded = finer if _size(finer) <= own and _holds(frame) else encoded
        result.append((encoded, _size(encoded)))
    return [encoded for encoded, _ in result]


def _size(encoded: dict[str, Any]) -> int:
    maps = (encoded[name] for name in ("order", "model_order") if encoded[name])
    return sum(len(p["png"]) for p in encoded["panes"]) + sum(len(m["data"]) for m in maps)


def _encoded(frame: ReportFrame, stride: int) -> dict[str, Any]:
    """A frame as the page takes it: means over `stride` pixels, and orders in their middle."""
    rows, cols = (size // stride for size in frame.panes[0].values.shape)
    own = ("number", "label", "why", "notes")
    return {name: getattr(frame, name) for name in own} | {
        "rows": rows,
        "cols": cols,
        "stride": stride,
        "first": stride // 2,
        "pixel_mm": frame.pixel_mm,
        "left_mm": frame.left_mm,
        "top_mm": frame.top_mm,
        "panes": [
            {"key": p.key, "label": p.label, "span": p.span, "unit": p.unit,
             "png": _png(p, _means(p.values, stride)),
             "bar": _png(p, np.linspace(*p.span, _GREYS)[None])}  # from end to end of its span
            for p in frame.panes
        ],
    } | _orders(frame, stride, STEP)  # fmt: skip


def _orders(frame: ReportFrame, stride: int, step: float) -> dict[str, Any]:
    """A frame's orders as the page takes them, those in the middle of each square."""
    first = stride // 2
    rows, cols = (size // stride for size in frame.panes[0].values.shape)
    part = tuple(slice(first, first + stride * size, stride) for size in (rows, cols))
    own = {"order": frame.order, "model_order": frame.model_order}
    return {
        name: None if order is None else vars(order_map(order[part], step))
        for name, order in own.items()
    }


def _holds(frame: ReportFrame) -> bool:
    """Whether a frame's orders are within what whole numbers of the fine step hold."""
    maps = [order for order in (frame.order, frame.model_order) if order is not None]
    known = [order[np.isfinite(order)] for order in maps]
    return all(np.ptp(own) < FINE_STEP * (_LARGEST - 1) for own in known if own.size)


def _means(values: Array, stride: int) -> Array:
    """Means over squares of `stride` pixels; NaN where one of them is not known."""
    if stride == 1:
        return values
    rows, cols = (size // stride for size in values.shape)
    squares = values[: rows * stride, : cols * stride]
    return np.asarray(squares.reshape(rows, stride, cols, stride).mean(axis=(1, 3)))


def order_map(order: Array, step: float = STEP) -> OrderMap:
    """Fringe orders (row, col), NaN = not known, as text, each within half a step of its own."""
    known = np.isfinite(order)
    steps = np.rint(np.where(known, order, 0.0).astype(float) / step).astype(np.int64)
    first = int(steps[known].min()) if known.any() else 0
    level = np.where(known & (steps - first < _LARGEST), steps - first + 1, 0)
    moved = np.diff(level, axis=1, prepend=0) % 65536
    low, high = (moved % 256).astype(np.uint8), (moved // 256).astype(np.uint8)
    data = zlib.compress(low.tobytes() + high.tobytes(), 6)
    return OrderMap(base64.b64encode(data).decode(), first, step)


def _png(pane: Pane, values: Array) -> str:
    """A picture as base64 of a PNG with a palette; what is not known is transparent."""
    from matplotlib import colormaps
    from PIL import Image

    name, count = {"difference": (DIFFERENCE_MAP, _COLOURS), "order": (VALUE_MAP, _GREYS)}.get(
        pane.key, (FRAME_MAP, _GREYS)
    )
    low, high = pane.span
    share = (values - low) / ((high - low) or 1.0)
    level = np.rint(np.nan_to_num(share, nan=0.0) * (count - 1))
    level = np.where(np.isfinite(values), np.clip(level, 0, count - 1), count).astype(np.uint8)
    picture = Image.fromarray(level, "P")
    colours = colormaps[name](np.linspace(0.0, 1.0, count))[:, :3]
    palette = np.rint(255 * np.vstack([colours, [1.0, 1.0, 1.0]])).astype(np.uint8)
    picture.putpalette(bytes(palette))
    file = io.BytesIO()
    bits = 4 if count < 16 else 8
    picture.save(file, "PNG", transparency=count, bits=bits, compress_level=5)
    return base64.b64encode(file.getvalue()).decode()
