"""Processed frames for a paper, drawn from their dataset: that in memory, or that of a folder."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.errors import InputError
from isochrome.figures import (
    FRAME_MAP,
    KEY_LABELS,
    PAPER_DIRECTION_MAP,
    VALUE_MAP,
    PaperPanels,
    PictureKind,
    Plot,
    chosen_frames,
    draw_chi,
    draw_values,
    plain_name,
    show_image,
)
from isochrome.fringes import skeletons
from isochrome.processing.chunk import ISOCLINIC, NORMALISED, ORDER
from isochrome.processing.pictures.figure import (
    KEY_FRAMES,
    ORDER_LABEL,
    Shown,
    draw_fringes,
    highest_order,
    say_lines,
    shown_frames,
    shown_label,
)
from isochrome.processing.processed import Processed
from isochrome.processing.result import PICTURE
from isochrome.runs import RunDataset, column_values

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

_TURNED_LABEL = "from x, counter-clockwise (degrees)"


def processed_panels(result: Processed, frames: tuple[int, ...] | None) -> PaperPanels:
    """Frames with their fringes and their orders; of a tracked video its values too.

    Parameters: `result`; `frames`, numbers of the frames that are shown. Returns PaperPanels.
    Raises InputError where there is no such frame, or it has no map of its order.
    """
    items = _items(result, frames)
    largest = max(map(highest_order, items), default=1.0)
    read = any(item.order is not None for item in items)
    plots = []
    if result.tracked:
        found = result.over_frames
        for key in found.keys:
            own = partial(draw_values, found=found, key=key)
            plots.append(Plot(title=KEY_LABELS.get(key, key), draw=own, height_mm=30.0))
        plots.append(Plot(title="chi", draw=partial(draw_chi, found=found), height_mm=30.0))
    return PaperPanels(
        kinds=_kinds(items, largest, what="picture" if result.tracked else "frame"),
        labels=[plain_name(item.label, 30) for item in items],
        plots=plots,
        notes=[*(_numbers(item) for item in items), f"L{say_lines(largest, read)[1:]}"],
    )


def _items(result: Processed, frames: tuple[int, ...] | None) -> list[Shown]:
    """The frames that are shown, read from the dataset."""
    table, dataset = result.columns, result.dataset
    usual = _usual_frames(table, dataset)
    return [_item(table, dataset, k) for k in chosen_frames(frames, len(table["frame"]), usual)]


def _usual_frames(table: dict[str, list[Any]], dataset: RunDataset) -> list[int]:
    """Those where nobody asks: of a video with few key frames also others that have an order."""
    status = column_values(dataset["status"])
    usual = shown_frames(table, status)
    followed = PICTURE in table and ORDER.name in dataset and _over_frames(dataset[ORDER.name])
    if not followed or len(usual) == KEY_FRAMES:
        return usual
    good = [k for k, state in enumerate(status) if state != "failed"]
    places = np.linspace(0, len(good) - 1, min(KEY_FRAMES, len(good)))
    return [good[round(place)] for place in places]


def _over_frames(values: Any) -> bool:
    """Whether an array of the dataset has a map of every frame, or those of key frames alone."""
    return bool(values.dims[0] == "frame")


def _item(table: dict[str, list[Any]], dataset: RunDataset, k: int) -> Shown:
    """Frame k with its maps. Raises InputError where it has none."""
    maps = _maps(dataset, k, table[PICTURE][k] if PICTURE in table else k)
    order = maps.get(ORDER.name)
    known = order is not None and bool(np.isfinite(order).any())
    signal = maps.get(NORMALISED.name)
    if signal is None:
        if order is None or not known:
            raise InputError(_without_a_map(table, dataset, k))
        signal = np.full(order.shape, np.nan)  # a followed frame: its picture is not kept
    left, top = (float(dataset[name][k]) for name in ("left_mm", "top_mm"))
    pixel = table["pixel_mm"][k]
    return Shown(
        label=shown_label(table, k),
        chi=float(np.nan if table["chi"][k] is None else table["chi"][k]),
        kept=_share(table, k),
        normalised=signal,
        order=order if known else None,
        isoclinic=maps.get(ISOCLINIC.name) if known else None,
        lines=[] if known else skeletons(np.clip(signal, 0.0, 1.0)),
        place={
            "pixel_mm": None if pixel is None or pixel != pixel else float(pixel),
            "left_mm": left if np.isfinite(left) else 0.0,
            "top_mm": top if np.isfinite(top) else 0.0,
        },
    )


def _maps(dataset: RunDataset, k: int, picture: int | None) -> dict[str, np.ndarray]:
    """Frame k's maps: those over all frames, and those of key frames where it is one."""
    found = {}
    for name in (NORMALISED.name, ORDER.name, ISOCLINIC.name):
        place = k if name in dataset and _over_frames(dataset[name]) else picture
        if name in dataset and place is not None:
            found[name] = np.asarray(dataset[name][int(place)])
    return found


def _without_a_map(table: dict[str, list[Any]], dataset: RunDataset, k: int) -> str:
    """Why frame k of a followed video cannot be drawn, and which can."""
    having = [j for j, at in enumerate(table[PICTURE]) if at is not None]
    if ORDER.name in dataset and _over_frames(dataset[ORDER.name]):
        status = column_values(dataset["status"])
        having = [j for j, state in enumerate(status) if state != "failed"]
    some = f"{', '.join(map(str, having[:8]))}{' ...' * (len(having) > 8)}" or "none"
    return f"frames = {k} of a figure: has no map of its order; frames that have one: {some}"


def _share(table: dict[str, list[Any]], k: int) -> float:
    share = table.get("kept_share", [None] * (k + 1))[k]
    return float("nan") if share is None else float(share)


def _kinds(items: Sequence[Shown], largest: float, *, what: str) -> list[PictureKind]:
    """The frames, called `what`; orders and isoclinics, which may be empty in some."""

    def frame(axes: Axes, k: int) -> AxesImage:
        item = items[k]
        look: dict[str, Any] = {"cmap": FRAME_MAP, "vmin": 0, "vmax": 1}
        drawn = show_image(axes, item.normalised, **look, **item.place)
        if not _has_picture(item):
            middle: dict[str, Any] = {"ha": "center", "va": "center", "transform": axes.transAxes}
            ground = {"facecolor": "white", "edgecolor": "none", "pad": 2.0}
            axes.text(0.5, 0.5, "its picture\nis not kept", bbox=ground, **middle)
            return drawn
        limits = axes.get_xlim(), axes.get_ylim()
        draw_fringes(axes, item, largest)
        axes.set(xlim=limits[0], ylim=limits[1])
        return drawn

    def a_map(axes: Axes, k: int, name: str, look: dict[str, Any]) -> AxesImage:
        item = items[k]
        values = getattr(item, name)
        if values is None:
            values = np.full(item.normalised.shape, np.nan)
        drawn = show_image(axes, values, **look, **item.place)
        drawn.set_interpolation("nearest")
        return drawn

    kinds = [PictureKind(name=what, draw=frame)] if any(map(_has_picture, items)) else []
    order: dict[str, Any] = {"cmap": VALUE_MAP, "vmin": 0, "vmax": largest}
    turned: dict[str, Any] = {"cmap": PAPER_DIRECTION_MAP, "vmin": -90.0, "vmax": 90.0}
    for name, title, look, bar in (
        ("order", "fringe order", order, ORDER_LABEL),
        ("isoclinic", "direction of σ₁", turned, _TURNED_LABEL),
    ):
        if any(getattr(item, name) is not None for item in items):
            kinds.append(
                PictureKind(name=title, draw=partial(a_map, name=name, look=look), bar=bar)
            )
    return kinds


def _has_picture(item: Shown) -> bool:
    """Whether the frame itself is kept: of a followed video that of key frames alone is."""
    return item.order is None or bool(np.isfinite(item.normalised).any())


def _numbers(item: Shown) -> str:
    """What was read of a frame, in a line."""
    parts = []
    if np.isfinite(item.chi):
        parts.append(f"χ = {item.chi:.2f}")
    if item.order is not None and np.isfinite(item.kept):
        parts.append(f"order known in {100 * item.kept:.1f} %")
    return f"{item.label}: {', '.join(parts) or 'no order was read'}."
