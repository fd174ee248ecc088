"""The picture that `process` leaves: each frame with its fringes numbered, and its order.

Of a tracked video: each value over the frames with its band, and some key frames.

Processed frames for a paper, drawn from their dataset: that in memory, or that of a folder.

The last frame of a long run that was read, as a picture that can be watched while it goes on.

What the report of processed frames says, from the folder of a run.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import InputError, IsochromeError
from isochrome.figures import (
    BAND,
    FINE_PT,
    GREY,
    LINE_COLOURS,
    LINE_PT,
    OVERLAY_COLOUR,
    VALUE_MAP,
    PaperPanels,
    PictureKind,
    Place,
    add_colour_bar,
    centred_limit,
    chosen_frames,
    draw_line,
    given_axes,
    panels_figure,
    place_of_image,
    plain_name,
    show_image,
    values_plots,
)
from isochrome.fitting import SceneRenderer, frame_scene, scene_at, sliding_scene
from isochrome.fringes import Skeleton, order_contours, skeletons
from isochrome.output import counted, evenly_spaced, numbers, replacing, with_uncertainty
from isochrome.processing.kinds.kind import ISOCLINIC, NORMALISED, ORDER
from isochrome.processing.kinds.largest_order import AT_LEAST, ORDER_FROM
from isochrome.processing.result import (
    CAUSES,
    EXPLAINED,
    PICTURE,
    REFINED,
    ProcessedFrame,
    cell_values,
    fitted_keys,
    frame_values,
    own_values,
)
from isochrome.reporting import (
    FRINGES,
    SIGNAL,
    Pane,
    ReportContent,
    ReportFrame,
    ReportTable,
    choose_frames,
    fitted_report,
)
from isochrome.runs import column_values
from isochrome.scene import Scene
from isochrome.simulation import make_picture, picture_signal
from isochrome.stress import pixel_grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage
    from PIL import Image

    from isochrome.processing.processed import Processed
    from isochrome.runs import RunDataset, StoredArray

    Kept = RunDataset | dict[str, StoredArray]
    """What maps are drawn from: a run's dataset, or results that are being finished."""

_MOST_LINES = 12
"""Half orders beyond which only every whole one is drawn, and beyond twice as many every fifth."""


ORDER_LABEL = "fringe order N (fringes)"

_SHOWN, KEY_FRAMES = 6, 3
"""Frames of a set that are drawn, and key frames of a tracked one."""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A processed frame as it is drawn: maps (rows, cols), NaN = not known.

    `kept`, the share of pixels whose order is known; `normalised`, None where a followed frame's
    picture is not kept; `order` and `isoclinic`, None where none is read; `lines`, whether fringe
    lines were found without an order.
    """

    number: int
    label: str
    chi: float
    kept: float
    normalised: np.ndarray | None
    order: np.ndarray | None
    isoclinic: np.ndarray | None
    lines: bool
    place: Place

    @property
    def shape(self) -> tuple[int, ...]:
        """Rows and columns; none where no map of it is kept."""
        image = self.order if self.normalised is None else self.normalised
        return () if image is None else image.shape


def set_figure(scene: Scene, table: Mapping[str, list[Any]], items: list[Shown]) -> Figure:
    """The picture of a set: frames with their fringes and orders; of a tracked one its values too.

    A phase-stepped state has its dark field in the place of the frame, and its isoclinic angles.
    """
    turned = any(item.isoclinic is not None for item in items)
    what = "phase-stepped set as dark field" if turned else "captured frames, normalised"
    what += ", residual stress taken out" if scene.frames.no_load_steps else ""
    if PICTURE in table:
        result = frame_values(table)
        what = (
            f"{counted(len(result.chi), 'frame')}, {counted(int(result.whole.sum()), 'key frame')}"
        )
        what += f"\nvalues, band ± {BAND:g} standard uncertainties"
        what += " (dots: key frames, circles: found by a full search)"
    return panels_figure(_panels(table, items), f"{plain_name(scene.name)}: {what}")


def draw_fringes(axes: Axes, item: Shown, largest: float) -> None:
    """Draw the fringes of a frame as lines: whole or dark ones blue, the others orange."""
    lines = list[Skeleton]()
    if item.order is not None:
        lines = order_contours(item.order, _line_orders(largest))
    elif item.lines and item.normalised is not None:
        lines = skeletons(np.clip(item.normalised, 0.0, 1.0))
    for line in lines:
        is_dark = line.kind == "dark" if line.order is None else float(line.order).is_integer()
        colour = LINE_COLOURS[0 if is_dark else 1]
        draw_line(axes, line.rows, line.cols, item.place, color=colour, lw=LINE_PT)


def plot_order(
    order: ArrayLike,
    axes: Axes | None = None,
    *,
    lines: bool = True,
    pixel_mm: float | None = None,
    left_mm: float = 0.0,
    top_mm: float = 0.0,
    title: str = "",
) -> Axes:
    """Draw a map of the fringe order with its colour bar, hatched where it is not known.

    In mm where its coordinates z_mm and x_mm, or `pixel_mm`, tell the scale; else in pixels.

    Parameters
    ----------
    order : array_like, shape (rows, cols)
        Fringe order, fringes; NaN = not known.
    axes : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure of matplotlib.pyplot.
    lines : bool, default True
        Whether the lines of whole and half orders are drawn; of many, fewer.
    pixel_mm : float, optional
        Side of a pixel, mm.
    left_mm : float, default 0.0
        Outer edge of the first column, mm.
    top_mm : float, default 0.0
        Outer edge of the first row, mm.
    title : str, default ''
        Title.

    Returns
    -------
    matplotlib.axes.Axes
        What was drawn on.

    Raises
    ------
    InputError
        Where the map has another shape.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("ring").with_values({
    ...     "load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
    ...     "camera.pixel_mm": 0.36})
    >>> simulated = isochrome.simulate(scene).dataset
    >>> isochrome.plot_order(simulated.fringe_order[0]).get_ylabel()
    'z (mm)'
    """
    values = np.asarray(order, dtype=float)
    if values.ndim != 2:
        raise InputError("order_map_shape_draw", shape=values.shape)
    place = place_of_image(order, pixel_mm, left_mm, top_mm)
    drawn, largest = given_axes(axes), _highest_order(values)
    shown = show_image(drawn, values, cmap=VALUE_MAP, vmin=0, vmax=largest, title=title, **place)
    shown.set_interpolation("nearest")
    add_colour_bar(shown, ORDER_LABEL)
    for line in order_contours(values, _line_orders(largest)) if lines else ():
        draw_line(drawn, line.rows, line.cols, place, color=OVERLAY_COLOUR, lw=FINE_PT)
    return drawn


def _line_orders(largest: float) -> np.ndarray:
    """Orders to draw as lines: halves, or as many as can be told apart."""
    step = 0.5 if 2.0 * largest <= _MOST_LINES else 1.0 if largest <= _MOST_LINES else 5.0
    return np.arange(step, largest + step, step)


def _highest_order(order: np.ndarray | None) -> float:
    """The order up to which a frame's colours go; 1 where none is known."""
    if order is None or not np.isfinite(order).any():
        return 1.0
    return float(np.nanpercentile(order, 99.9))


def shown_frames(table: Mapping[str, list[Any]], status: list[str]) -> list[int]:
    """The frames that are drawn: the first in which something was found, or some key frames."""
    if PICTURE not in table:
        return [k for k, state in enumerate(status) if state != "failed"][:_SHOWN] or [0]
    keys = [k for k, at in enumerate(table[PICTURE]) if at is not None]
    return evenly_spaced([k for k in keys if status[k] != "failed"] or keys[:1], KEY_FRAMES)


def run_figure(result: Processed) -> Figure:
    """`set_figure` of a set whose dataset is there, of a tracked video its key frames."""
    dataset = result.dataset
    items = shown_items(result.columns, dataset, column_values(dataset["status"]))
    return set_figure(result.scene, result.columns, items)


def shown_items(table: Mapping[str, list[Any]], dataset: Kept, status: list[str]) -> list[Shown]:
    """The frames that are drawn, with their maps; none where no pictures were wanted."""
    chosen = shown_frames(table, status) if NORMALISED.name in dataset else ()
    return [shown_item(table, dataset, k) for k in chosen]


def processed_panels(result: Processed, frames: tuple[int, ...] | None) -> PaperPanels:
    """Frames with their fringes and their orders; of a tracked video its values too.

    InputError where there is no such frame, or it has no map of its order.
    """
    table, dataset = result.columns, result.dataset
    status = column_values(dataset["status"])
    usual = shown_frames(table, status)
    having = list(range(len(status)))
    if PICTURE in table:
        of_all = ORDER.name in dataset and is_of_all(dataset[ORDER.name])
        having = [
            k
            for k, at in enumerate(table[PICTURE])
            if (status[k] != "failed" if of_all else at is not None)
        ]
        if of_all and len(usual) < KEY_FRAMES:  # also others that have an order
            usual = evenly_spaced(having, KEY_FRAMES)
    chosen = chosen_frames(frames, len(table["frame"]), usual)
    items = [shown_item(table, dataset, k) for k in chosen]
    for item in items:
        if item.normalised is None and (item.order is None or not np.isfinite(item.order).any()):
            some = f"{', '.join(map(str, having[:8]))}{' ...' * (len(having) > 8)}" or "none"
            text = f"frames = {item.number} of a figure: has no map of its order; "
            raise InputError(text + f"frames that have one: {some}")
    return _panels(table, items)


def _panels(table: Mapping[str, list[Any]], items: Sequence[Shown]) -> PaperPanels:
    """The panels of some frames, and the plots of a tracked video's values."""
    largest = max((_highest_order(item.order) for item in items), default=1.0)
    read = any(item.order is not None for item in items)
    tracked = PICTURE in table
    first = ", ".join(f"{order:g}" for order in _line_orders(largest)[:3])
    lines = f"N = {first} ..." if read else "dark (blue) and bright (orange) fringes"
    return PaperPanels(
        kinds=_kinds(items, largest, what="picture" if tracked else "frame"),
        labels=[plain_name(item.label, 30) for item in items],
        plots=values_plots(frame_values(table)) if tracked else (),
        notes=[*(_numbers(item) for item in items), *([f"Lines: {lines}"] if items else [])],
    )


def is_of_all(values: Any) -> bool:
    """Whether an array of the dataset has a map of every frame, or those of key frames alone."""
    return bool(values.dims[0] == "frame")


def maps_of(table: Mapping[str, list[Any]], dataset: Kept, k: int) -> dict[str, Any]:
    """The maps (rows, cols) of frame k that are kept, by their names."""
    picture = table[PICTURE][k] if PICTURE in table else k
    places = {
        name: k if is_of_all(dataset[name]) else picture
        for name in (NORMALISED.name, ORDER.name, ISOCLINIC.name)
        if name in dataset
    }
    return {n: np.asarray(dataset[n][int(p)]) for n, p in places.items() if p is not None}


def shown_item(table: Mapping[str, list[Any]], dataset: Kept, k: int) -> Shown:
    """Frame k with its maps."""
    share, lines = (table.get(name, [None] * (k + 1))[k] for name in ("kept_share", "fringe_lines"))
    maps = maps_of(table, dataset, k)
    order = maps.get(ORDER.name) if share is not None else None
    chi, pixel, label = table["chi"][k], table["pixel_mm"][k], str(table["label"][k])
    left, top = (float(dataset[name][k]) for name in ("left_mm", "top_mm"))
    return Shown(
        number=k, label=f"frame {k}, {label}" if PICTURE in table else label,
        chi=float("nan") if chi is None else float(chi),
        kept=float("nan") if share is None else float(share),
        normalised=maps.get(NORMALISED.name), order=order,
        isoclinic=maps.get(ISOCLINIC.name) if order is not None else None,
        lines=bool(lines) and order is None,
        place={
            "pixel_mm": None if pixel is None or pixel != pixel else float(pixel),
            "left_mm": left if np.isfinite(left) else 0.0,
            "top_mm": top if np.isfinite(top) else 0.0,
        },
    )  # fmt: skip


def _kinds(items: Sequence[Shown], largest: float, *, what: str) -> list[PictureKind]:
    """The frames, called `what`; orders and isoclinics, which may be empty in some."""

    def draw(axes: Axes, k: int, name: str, span: tuple[float, float]) -> AxesImage:
        item = items[k]
        values = getattr(item, name)
        known = values is not None
        pane = Pane(name, name, values if known else np.full(item.shape, np.nan), span, "")
        drawn = pane.draw(axes, item.place)
        if name != "normalised":
            drawn.set_interpolation("nearest")
        elif known:
            limits = axes.get_xlim(), axes.get_ylim()
            draw_fringes(axes, item, largest)
            axes.set(xlim=limits[0], ylim=limits[1])
        else:
            middle: dict[str, Any] = {"ha": "center", "va": "center", "transform": axes.transAxes}
            ground = {"facecolor": "white", "edgecolor": "none", "pad": 2.0}
            axes.text(0.5, 0.5, "its picture\nis not kept", bbox=ground, **middle)
        return drawn

    return [
        PictureKind(name=title, draw=partial(draw, name=name, span=span), bar=bar)
        for name, title, span, bar in (
            ("normalised", what, _LIGHT, ""),
            ("order", "fringe order", (0.0, largest), ORDER_LABEL),
            ("isoclinic", "direction of σ₁", (-90.0, 90.0), "from x, counter-clockwise (degrees)"),
        )
        if any(getattr(item, name) is not None for item in items)
    ]


def _numbers(item: Shown) -> str:
    """What was read of a frame, in a line."""
    parts = []
    if np.isfinite(item.chi):
        parts.append(f"χ = {item.chi:.2f}")
    if item.order is not None and np.isfinite(item.kept):
        parts.append(f"order known in {100 * item.kept:.1f} %")
    return f"{plain_name(item.label, 30)}: {', '.join(parts) or 'no order was read'}."


PREVIEW = "preview.png"
"""Its name, in the run's working folder."""

EVERY_S = 3.0
"""Seconds between two pictures: one takes some 20 ms."""

_STRIP_PX = 22
"""Height of the line of words."""


def write_preview(place: Path, item: ProcessedFrame) -> None:
    """Write a frame's orders as a picture, unless one was written just now or it has none.

    It is put in its place whole, so that a viewer never sees half of it.
    """
    reading = item.reading
    if reading is None:
        return
    try:
        if time.time() - place.stat().st_mtime < EVERY_S:
            return
    except FileNotFoundError:
        pass  # the first
    with replacing(place) as beside:
        preview_picture(reading.order, _words(item)).save(beside, "PNG")


def preview_picture(order: np.ndarray, words: str) -> Image.Image:
    """Orders in colours from 0 to the largest, grey where not known, under a line of words."""
    from matplotlib import colormaps
    from PIL import Image, ImageDraw

    known = order[np.isfinite(order)]
    largest = max(float(known.max()) if known.size else 0.0, 1e-9)
    colours = colormaps[VALUE_MAP].with_extremes(bad=GREY)(order / largest, bytes=True)
    picture = Image.new("RGB", (order.shape[1], _STRIP_PX + order.shape[0]), "white")
    ImageDraw.Draw(picture).text((4, 5), words, "black")
    picture.paste(Image.fromarray(colours[..., :3]), (0, _STRIP_PX))
    return picture


def _words(item: ProcessedFrame) -> str:
    """The frame's number and label, its load and largest order where they are known."""
    row = item.row()
    parts = [f"frame {item.index}", item.label]
    most = "least" if row.get(ORDER_FROM) == AT_LEAST else "most"
    for key, unit in (("load.normal_n", " N"), ("n_max", f" fringes at {most}")):
        value = row.get(key)
        if value is not None and np.isfinite(value):
            parts.append(f"{value:.4g}{unit}")
    return ", ".join(parts).encode("ascii", "replace").decode()


Array = NDArray[Any]
_Model = tuple[Array, Array]
"""What a frame's own values make: its signal, 0 in darkness, and its order (fringes)."""

_NONE = "There is none: nothing was fitted to these frames."
_NO_BUDGET = (
    "Processing states each ± without the shares of what it is of; isochrome fit with the same "
    "frames gives them."
)

_CAPTIONS = {
    CAUSES: "What the frames asked for besides the scene",
    REFINED: "What the frames know better than the scene states it",
}

_OF_KNOWN_LOADS = (
    "The ± of a load holds what the frames leave open, and how well the known loads agree among "
    "themselves; an error that all known loads have in common is not in it."
)


def process_report(dataset: Kept, result: Processed, record: Mapping[str, Any]) -> ReportContent:
    """Collect what the report of processed frames says; maps are read of the few that it shows.

    `dataset`, the set's own; `record`, what provenance.json holds.
    """
    table = result.columns
    as_stated = (record.get("options") or {}).get("as_stated", False)
    result = replace(result, as_stated=as_stated)
    fitted = result.scene.has_model and bool(fitted_keys(table))
    frames, choice = _frames(dataset, result)
    return fitted_report(
        result, record, result.summary_text, _goodness(table), command="process", frames=frames,
        choice=choice, causes=result.causes if fitted else None, refined=result.refined,
        no_budget=(_NO_BUDGET if result.asks_causes else _OF_KNOWN_LOADS) if fitted else _NONE,
        tables=_causes(table),
    )  # fmt: skip


def _goodness(table: Mapping[str, list[Any]]) -> str:
    """Chi in a sentence: about 1 where the model describes the frames."""
    share = numbers(table[EXPLAINED]) if EXPLAINED in table else np.zeros(0)
    share = 100.0 * share[np.isfinite(share)]
    if share.size:
        return (
            f"The frames of known loads explain {share.min():.0f} to {share.max():.0f} % of a "
            "frame's light; what they do not is in the ±."
        )
    chi = numbers(table["chi"])
    known = chi[np.isfinite(chi)]
    if not known.size:
        return "How well a model describes the frames is not known."
    span = f"{np.median(known):.2f} in the median, {known.max():.2f} at most"
    return f"Residual over noise: {span} (about 1 where the frames are described to their noise)."


def _causes(table: Mapping[str, list[Any]]) -> list[ReportTable]:
    """What each frame asked for, with its value."""
    result = []
    for name, caption in _CAPTIONS.items():
        cells = [cell_values(text or "") for text in table.get(name, [])]
        asking = [k for k, values in enumerate(cells) if values]
        texts = [
            "; ".join(f"{key} = {with_uncertainty(*pair)}" for key, pair in cells[k].items())
            for k in asking
        ]
        columns = {"frame": [table["frame"][k] for k in asking], name: texts}
        result += [ReportTable(f"{caption} (frames.csv)", columns)] if asking else []
    return result


def _frames(dataset: Kept, result: Processed) -> tuple[list[ReportFrame], str]:
    """The frames that are shown, and which of how many they are."""
    table = result.columns
    of_all = any(is_of_all(dataset[n]) for n in (NORMALISED.name, ORDER.name) if n in dataset)
    with_maps = np.isfinite(numbers(table["noise"]))  # of a frame that is left out nobody knows it
    if not of_all:
        with_maps &= np.isfinite(numbers(table[PICTURE]))
    having = np.flatnonzero(with_maps)
    unknown = [None] * len(table["frame"])
    chi, largest = (numbers(table.get(name, unknown))[having] for name in ("chi", "n_max"))
    chosen = choose_frames(chi, largest)
    shown = [shown_item(table, dataset, int(having[k])) for k in chosen]
    text = f"{len(chosen)} of {counted(len(table['frame']), 'frame')} are shown"
    if len(chosen) < len(having):
        what = "key " * (not of_all) + "frames"
        text += f", chosen among {len(having)} {what} for the reason that stands beside each"
    return _report_frames(result, shown, list(chosen.values())), f"{text}."


_LIGHT = (0.0, 1.0)
"""What is black and white: darkness, and the brightest field."""

_DIFFERENCE = "experiment − simulation, order N"

_NOT_KEPT = "its picture is not kept: only those of key frames are"


def _report_frames(
    result: Processed, shown: Sequence[Shown], reasons: Sequence[str]
) -> list[ReportFrame]:
    """Frames with their pictures: one range of orders and of differences for all of them."""
    models = [_model(result, one) for one in shown]
    orders = [one.order[np.isfinite(one.order)] for one in shown if one.order is not None]
    largest = max((float(known.max()) for known in orders if known.size), default=1.0)
    gaps = [
        None if one.order is None or model is None else one.order - model[1]
        for one, (model, _) in zip(shown, models, strict=True)
    ]
    limit = centred_limit(*(gap for gap in gaps if gap is not None))
    return [
        ReportFrame(
            number=one.number,
            label=str(result.columns["label"][one.number]),
            why=why,
            panes=_panes(one, model, gap, largest, limit),
            order=one.order,
            model_order=None if model is None else model[1],
            notes=tuple(filter(None, (_NOT_KEPT if one.normalised is None else "", note))),
            **one.place,
        )
        for one, why, (model, note), gap in zip(shown, reasons, models, gaps, strict=True)
    ]


def _panes(
    shown: Shown, model: _Model | None, gap: Array | None, largest: float, limit: float
) -> tuple[Pane, ...]:
    """The pictures of a frame; where its own is not kept, its order stands in the first place."""
    order: list[Any] = ["order", "fringe order N", shown.order, (0.0, largest), FRINGES]
    others: list[list[Any]] = [
        ["experiment", "experiment", shown.normalised, _LIGHT, SIGNAL],
        ["simulation", "simulation", None if model is None else model[0], _LIGHT, SIGNAL],
        ["difference", _DIFFERENCE, gap, (-limit, limit), FRINGES],
    ]
    panes = [order, *others] if shown.normalised is None else [*others, order]
    return tuple(Pane(*pane) for pane in panes if pane[2] is not None)


def _model(result: Processed, shown: Shown) -> tuple[_Model | None, str]:
    """The simulation of a frame with what was fitted to it; else None, and the reason."""
    keys = fitted_keys(result.columns)
    if not result.scene.has_model or not keys:
        return None, ""
    if result.scene.frames.has_known_loads:
        return None, "the stress that the disc holds without load is in no simulation"
    own = own_values(result.columns, keys, shown.number)  # NaN for what its state does not have
    values = {key: value for key, value in own.items() if np.isfinite(value)}
    if not values:
        return None, "nothing was fitted to it, so there is no simulation"
    try:
        fitted = _own_scene(result, shown, values)
        pixels = pixel_grid(fitted)
        renderer = SceneRenderer(fitted, (pixels.rows, pixels.cols))
        picture = make_picture(fitted, renderer.difference(fitted, renderer.state(fitted)), pixels)
        signal = picture_signal(fitted, picture)
    except IsochromeError as error:
        return None, f"its simulation was refused: {error}"
    signal, order = (np.where(picture.material, v, np.nan) for v in (signal, picture.order))
    return (signal, order), ""


def _own_scene(result: Processed, shown: Shown, values: Mapping[str, float]) -> Scene:
    """The scene of a frame alone, as `own_scene` has it, with what was fitted."""
    bare, table = sliding_scene(result.scene), result.columns
    if result.scene.frames.sliding_speed_mm_per_s is None:
        bare = frame_scene(bare, shown.number)
    else:
        bare = scene_at(bare, float(table["distance_m"][shown.number]))
    camera: dict[str, Any] = {
        "camera.height_px": shown.shape[0],
        "camera.width_px": shown.shape[1],
        **{f"camera.{name}": value for name, value in shown.place.items()},
        "camera.colour": False,  # the frames are of one channel
        "camera.response": None,
    }
    return bare.with_values(camera | dict(values))
