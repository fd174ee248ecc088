"""What `process` shows of a set: figure, figure for a paper, preview and report."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome import figures, reporting
from isochrome.errors import InputError, IsochromeError
from isochrome.fitting import SceneRenderer, frame_scene, scene_at, sliding_scene
from isochrome.fringes import Skeleton, order_contours, skeletons
from isochrome.output import counted, evenly_spaced, numbers, replacing, with_uncertainty
from isochrome.processing.kinds.kind import ISOCLINIC, NORMALISED, ORDER
from isochrome.processing.kinds.largest_order import AT_LEAST, ORDER_FROM
from isochrome.processing.result import (
    CAUSES,
    EXPLAINED,
    LOOKS_LIKE,
    PICTURE,
    REFINED,
    Processed,
    ProcessedFrame,
    cell_values,
    fitted_keys,
    frame_values,
    own_values,
    pages_of,
)
from isochrome.reporting import Pane
from isochrome.runs import column_values
from isochrome.scene import Scene
from isochrome.simulation import make_picture, picture_signal
from isochrome.stress import pixel_grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

    from isochrome.runs import RunDataset, StoredArray

    Kept = RunDataset | dict[str, StoredArray]
    """What maps are drawn from: a run's dataset, or results that are being finished."""

Array = NDArray[Any]

_MOST_LINES = 12
"""Half orders beyond which only every whole one is drawn, and beyond twice as many every fifth."""

ORDER_LABEL = "fringe order N (fringes)"

_SHOWN, KEY_FRAMES = 6, 3
"""Frames of a set that are drawn, and key frames of a tracked one."""

_LIGHT = (0.0, 1.0)
"""What is black and white: darkness, and the brightest field."""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A processed frame as it is drawn: maps (rows, cols), NaN = not known, None where none is kept
    or read. `kept`, the share of pixels whose order is known; `lines`, whether fringe lines were
    found without an order."""

    number: int
    label: str
    chi: float
    kept: float
    normalised: Array | None
    order: Array | None
    isoclinic: Array | None
    lines: bool
    place: figures.Place


def set_figure(scene: Scene, table: Mapping[str, list[Any]], items: list[Shown]) -> Figure:
    """Frames with their fringes and orders; of a tracked set its values too. A phase-stepped state
    has its dark field in the place of the frame, and its isoclinic angles."""
    turned = any(item.isoclinic is not None for item in items)
    what = "phase-stepped set as dark field" if turned else "captured frames, normalised"
    what += ", residual stress taken out" if scene.frames.no_load_steps else ""
    if PICTURE in table:
        key_frames = int(frame_values(table).whole.sum())
        what = (
            f"{counted(len(table['frame']), 'frame')}, {counted(key_frames, 'key frame')}\n"
            f"values, band ± {figures.BAND:g} standard uncertainties "
            "(dots: key frames, circles: found by a full search)"
        )
    return figures.panels_figure(_panels(table, items), f"{figures.plain_name(scene.name)}: {what}")


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
    place = figures.place_of_image(order, pixel_mm, left_mm, top_mm)
    drawn, largest = figures.given_axes(axes), _highest_order(values)
    shown = figures.show_image(
        drawn, values, cmap=figures.VALUE_MAP, vmin=0, vmax=largest, title=title, **place
    )
    shown.set_interpolation("nearest")
    figures.add_colour_bar(shown, ORDER_LABEL)
    for line in order_contours(values, _line_orders(largest)) if lines else ():
        figures.draw_line(
            drawn, line.rows, line.cols, place, color=figures.OVERLAY_COLOUR, lw=figures.FINE_PT
        )
    return drawn


def _line_orders(largest: float) -> Array:
    """Orders to draw as lines: halves, or as many as can be told apart."""
    step = 0.5 if 2.0 * largest <= _MOST_LINES else 1.0 if largest <= _MOST_LINES else 5.0
    return np.arange(step, largest + step, step)


def _highest_order(order: Array | None) -> float:
    if order is None or not np.isfinite(order).any():
        return 1.0
    return float(np.nanpercentile(order, 99.9))


def _drawn_frames(table: Mapping[str, list[Any]], status: list[str]) -> list[int]:
    """The frames that are drawn: the first in which something was found, or some key frames."""
    if PICTURE not in table:
        return [k for k, state in enumerate(status) if state != "failed"][:_SHOWN] or [0]
    keys = [k for k, at in enumerate(table[PICTURE]) if at is not None]
    return evenly_spaced([k for k in keys if status[k] != "failed"] or keys[:1], KEY_FRAMES)


def shown_items(table: Mapping[str, list[Any]], dataset: Kept, status: list[str]) -> list[Shown]:
    """The frames that are drawn, with their maps; none where no pictures were wanted."""
    chosen = _drawn_frames(table, status) if NORMALISED.name in dataset else ()
    return [_shown(table, dataset, k) for k in chosen]


def processed_panels(result: Processed, frames: tuple[int, ...] | None) -> figures.PaperPanels:
    """Frames with their fringes and their orders; of a tracked video its values too."""
    table, dataset = result.columns, result.dataset
    status = column_values(dataset["status"])
    usual, having = _drawn_frames(table, status), list(range(len(status)))
    if PICTURE in table:
        of_all = ORDER.name in dataset and _is_of_all(dataset[ORDER.name])
        having = [
            k
            for k, at in enumerate(table[PICTURE])
            if (status[k] != "failed" if of_all else at is not None)
        ]
        if of_all and len(usual) < KEY_FRAMES:  # also others that have an order
            usual = evenly_spaced(having, KEY_FRAMES)
    chosen = figures.chosen_frames(frames, len(status), usual)
    items = [_shown(table, dataset, k) for k in chosen]
    for item in items:
        if PICTURE in table and (item.order is None or not np.isfinite(item.order).any()):
            some = f"{', '.join(map(str, having[:8]))}{' ...' * (len(having) > 8)}" or "none"
            text = f"frames = {item.number} of a figure: has no map of its order; "
            raise InputError(text + f"frames that have one: {some}")
    return _panels(table, items)


def _panels(table: Mapping[str, list[Any]], items: Sequence[Shown]) -> figures.PaperPanels:
    largest = max((_highest_order(item.order) for item in items), default=1.0)

    def draw(axes: Axes, k: int, name: str, span: tuple[float, float]) -> AxesImage:
        item = items[k]
        values = getattr(item, name)
        if values is None:  # where others have one
            image = item.normalised if item.order is None else item.order
            values = np.full(() if image is None else image.shape, np.nan)
        drawn = Pane(name, name, values, span, "").draw(axes, item.place)
        if name != "normalised":
            drawn.set_interpolation("nearest")
        else:
            _draw_fringes(axes, item, largest)
        return drawn

    first = ", ".join(f"{order:g}" for order in _line_orders(largest)[:3])
    read = any(item.order is not None for item in items)
    lines = f"N = {first} ..." if read else "dark (blue) and bright (orange) fringes"
    return figures.PaperPanels(
        kinds=[
            figures.PictureKind(name=title, draw=partial(draw, name=name, span=span), bar=bar)
            for name, title, span, bar in (
                ("normalised", "picture" if PICTURE in table else "frame", _LIGHT, ""),
                ("order", "fringe order", (0.0, largest), ORDER_LABEL),
                (
                    "isoclinic", "direction of σ₁", (-90.0, 90.0),
                    "from x, counter-clockwise (degrees)",
                ),
            )
            if any(getattr(item, name) is not None for item in items)
        ],
        labels=[figures.plain_name(item.label, 30) for item in items],
        plots=figures.values_plots(frame_values(table)) if PICTURE in table else (),
        notes=[*map(_numbers, items), *[f"Lines: {lines}"] * bool(items)],
    )  # fmt: skip


def _draw_fringes(axes: Axes, item: Shown, largest: float) -> None:
    """Draw the fringes of a frame as lines: whole or dark ones blue, the others orange."""
    if item.normalised is None:
        middle: dict[str, Any] = {"ha": "center", "va": "center", "transform": axes.transAxes}
        ground = {"facecolor": "white", "edgecolor": "none", "pad": 2.0}
        axes.text(0.5, 0.5, "its picture\nis not kept", bbox=ground, **middle)
        return
    lines = list[Skeleton]()
    if item.order is not None:
        lines = order_contours(item.order, _line_orders(largest))
    elif item.lines:
        lines = skeletons(np.clip(item.normalised, 0.0, 1.0))
    look: dict[str, Any] = {"lw": figures.LINE_PT, "scalex": False, "scaley": False}
    for line in lines:
        is_dark = line.kind == "dark" if line.order is None else float(line.order).is_integer()
        colour = figures.LINE_COLOURS[0 if is_dark else 1]
        figures.draw_line(axes, line.rows, line.cols, item.place, color=colour, **look)


def _is_of_all(values: Any) -> bool:
    """Whether an array of the dataset has a map of every frame, or those of key frames alone."""
    return bool(values.dims[0] == "frame")


def _shown(table: Mapping[str, list[Any]], dataset: Kept, k: int) -> Shown:
    share, lines = (table.get(name, [None] * (k + 1))[k] for name in ("kept_share", "fringe_lines"))
    picture = table[PICTURE][k] if PICTURE in table else k
    maps: dict[str, Array] = {}
    for name in (NORMALISED.name, ORDER.name, ISOCLINIC.name):
        at = None if name not in dataset else k if _is_of_all(dataset[name]) else picture
        if at is not None and (share is not None or name == NORMALISED.name):
            maps[name] = np.asarray(dataset[name][int(at)])
    chi, pixel, label = table["chi"][k], table["pixel_mm"][k], str(table["label"][k])
    left, top = np.nan_to_num([float(dataset[name][k]) for name in ("left_mm", "top_mm")])
    order = maps.get(ORDER.name)
    return Shown(
        number=k, label=f"frame {k}, {label}" if PICTURE in table else label,
        chi=float(numbers([chi])[0]), kept=float(numbers([share])[0]),
        normalised=maps.get(NORMALISED.name), order=order,
        isoclinic=maps.get(ISOCLINIC.name) if order is not None else None,
        lines=bool(lines) and order is None,
        place={
            "pixel_mm": None if pixel is None or pixel != pixel else float(pixel),
            "left_mm": float(left), "top_mm": float(top),
        },
    )  # fmt: skip


def _numbers(item: Shown) -> str:
    parts = []
    if np.isfinite(item.chi):
        parts.append(f"χ = {item.chi:.2f}")
    if item.order is not None and np.isfinite(item.kept):
        parts.append(f"order known in {100 * item.kept:.1f} %")
    label = figures.plain_name(item.label, 30)
    return f"{label}: {', '.join(parts) or 'no order was read'}."


PREVIEW = "preview.png"
"""Its name, in the run's working folder."""

EVERY_S = 3.0
"""Seconds between two pictures: one takes some 20 ms."""

_STRIP_PX = 22
"""Height of the line of words."""


def write_preview(place: Path, item: ProcessedFrame) -> None:
    """Write a frame's orders in colours, unless a picture was written just now; grey: not known. It
    is put in its place whole, so that a viewer never sees half of it."""
    if item.reading is None:
        return
    with suppress(FileNotFoundError):  # of the first
        if time.time() - place.stat().st_mtime < EVERY_S:
            return
    from matplotlib import colormaps
    from PIL import Image, ImageDraw

    row, order = item.row(), item.reading.order
    parts = [f"frame {item.index}", item.label]
    most = "least" if row.get(ORDER_FROM) == AT_LEAST else "most"
    for key, unit in (("load.normal_n", " N"), ("n_max", f" fringes at {most}")):
        value = row.get(key)
        if value is not None and np.isfinite(value):
            parts.append(f"{value:.4g}{unit}")
    known = order[np.isfinite(order)]
    largest = max(float(known.max()) if known.size else 0.0, 1e-9)
    shades = colormaps[figures.VALUE_MAP].with_extremes(bad=figures.GREY)
    picture = Image.new("RGB", (order.shape[1], _STRIP_PX + order.shape[0]), "white")
    words = ", ".join(parts).encode("ascii", "replace").decode()
    ImageDraw.Draw(picture).text((4, 5), words, "black")
    picture.paste(Image.fromarray(shades(order / largest, bytes=True)[..., :3]), (0, _STRIP_PX))
    with replacing(place) as beside:
        picture.save(beside, "PNG")


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


def process_report(
    dataset: Kept, result: Processed, record: Mapping[str, Any]
) -> reporting.ReportContent:
    """What the report says; `record`, provenance.json. Maps are read of the frames it shows."""
    table = result.columns
    result = replace(result, as_stated=(record.get("options") or {}).get("as_stated", False))
    fitted = result.scene.has_model and bool(fitted_keys(table))
    tables = []  # what each frame asked for, with its value
    for name, caption in _CAPTIONS.items():
        cells = {
            frame: cell_values(text)
            for frame, text in zip(table["frame"], table.get(name, ()), strict=False)
            if text
        }
        texts = [
            "; ".join(f"{key} = {with_uncertainty(*pair)}" for key, pair in values.items())
            for values in cells.values()
        ]
        columns = {"frame": list(cells), name: texts}
        tables += [reporting.ReportTable(f"{caption} (frames.csv)", columns)] if cells else []
    frames, choice = _frames(dataset, result)
    return reporting.fitted_report(
        result, record, result.summary_text, _goodness(table), command="process", frames=frames,
        choice=choice, causes=result.causes if fitted else None, refined=result.refined,
        tables=tables,
        no_budget=(_NO_BUDGET if result.asks_causes else _OF_KNOWN_LOADS) if fitted else _NONE,
    )  # fmt: skip


def _goodness(table: Mapping[str, list[Any]]) -> str:
    """Chi in a sentence: about 1 where the model describes the frames."""
    share, chi = (numbers(table.get(name, ())) for name in (EXPLAINED, "chi"))
    share, known = 100.0 * share[np.isfinite(share)], chi[np.isfinite(chi)]
    if share.size:
        return (
            f"The frames of known loads explain {share.min():.0f} to {share.max():.0f} % of a "
            "frame's light; what they do not is in the ±."
        )
    if not known.size:
        return "How well a model describes the frames is not known."
    span = f"{np.median(known):.2f} in the median, {known.max():.2f} at most"
    return f"Residual over noise: {span} (about 1 where the frames are described to their noise)."


def _frames(dataset: Kept, result: Processed) -> tuple[list[reporting.ReportFrame], str]:
    """The frames that are shown with their pictures, and which of how many they are."""
    table = result.columns
    of_all = any(_is_of_all(dataset[n]) for n in (NORMALISED.name, ORDER.name) if n in dataset)
    with_maps = np.isfinite(numbers(table["noise"]))  # of a frame that is left out nobody knows it
    if not of_all:
        with_maps &= np.isfinite(numbers(table[PICTURE]))
    having = np.flatnonzero(with_maps)
    unknown = [None] * len(table["frame"])
    chi, largest = (numbers(table.get(name, unknown))[having] for name in ("chi", "n_max"))
    chosen = reporting.choose_frames(chi, largest)
    shown = [_shown(table, dataset, int(having[k])) for k in chosen]
    text = f"{len(chosen)} of {counted(len(table['frame']), 'frame')} are shown"
    if len(chosen) < len(having):
        what = "key " * (not of_all) + "frames"
        text += f", chosen among {len(having)} {what} for the reason that stands beside each"
    return _report_frames(result, shown, list(chosen.values())), f"{text}."


def _report_frames(
    result: Processed, shown: Sequence[Shown], reasons: Sequence[str]
) -> list[reporting.ReportFrame]:
    """One range of orders and of differences for all of the frames."""
    models = [_model(result, one) for one in shown]
    orders = [one.order[np.isfinite(one.order)] for one in shown if one.order is not None]
    largest = max((float(known.max()) for known in orders if known.size), default=1.0)
    gaps = [
        None if one.order is None or order is None else one.order - order
        for one, (_, order, _) in zip(shown, models, strict=True)
    ]
    limit = figures.centred_limit(*(gap for gap in gaps if gap is not None))
    pages = result.columns.get(LOOKS_LIKE) or [""] * len(result.columns["frame"])
    frames = []
    for one, why, (signal, order, note), gap in zip(shown, reasons, models, gaps, strict=True):
        given: list[tuple[str, str, Any, tuple[float, float], str]] = [
            ("experiment", "experiment", one.normalised, _LIGHT, reporting.SIGNAL),
            ("simulation", "simulation", signal, _LIGHT, reporting.SIGNAL),
            ("difference", "experiment − simulation, order N", gap, (-limit, limit),
             reporting.FRINGES),
            ("order", "fringe order N", one.order, (0.0, largest), reporting.FRINGES),
        ]  # fmt: skip
        notes = [note]
        if one.normalised is None:  # its order stands in the first place
            given.insert(0, given.pop())
            notes.insert(0, "its picture is not kept: only those of key frames are")
        frames.append(
            reporting.ReportFrame(
                number=one.number, label=str(result.columns["label"][one.number]), why=why,
                panes=tuple(Pane(*pane) for pane in given if pane[2] is not None),
                order=one.order, model_order=order, notes=tuple(filter(None, notes)),
                pages=pages_of(pages[one.number]), **one.place,
            )
        )  # fmt: skip
    return frames


def _model(result: Processed, shown: Shown) -> tuple[Array | None, Array | None, str]:
    """Signal and order of a frame's own simulation; else why there is none."""
    keys, table, scene = fitted_keys(result.columns), result.columns, result.scene
    if not scene.has_model or not keys:
        return None, None, ""
    if scene.frames.has_known_loads:
        return None, None, "the stress that the disc holds without load is in no simulation"
    own = own_values(table, keys, shown.number)  # NaN for what its state does not have
    values = {key: value for key, value in own.items() if np.isfinite(value)}
    if not values:
        return None, None, "nothing was fitted to it, so there is no simulation"
    image = shown.order if shown.normalised is None else shown.normalised
    camera: dict[str, Any] = {
        "camera.height_px": 0 if image is None else image.shape[0],
        "camera.width_px": 0 if image is None else image.shape[1],
        **{f"camera.{name}": value for name, value in shown.place.items()},
        "camera.colour": False,  # the frames are of one channel
        "camera.response": None,
    }
    try:
        if scene.frames.sliding_speed_mm_per_s is None:
            state = frame_scene(sliding_scene(scene), shown.number)
        else:
            state = scene_at(sliding_scene(scene), float(table["distance_m"][shown.number]))
        fitted = state.with_values(camera | values)
        pixels = pixel_grid(fitted)
        renderer = SceneRenderer(fitted, (pixels.rows, pixels.cols))
        picture = make_picture(fitted, renderer.difference(fitted, renderer.state(fitted)), pixels)
        signal = picture_signal(fitted, picture)
    except IsochromeError as error:
        return None, None, f"its simulation was refused: {error}"
    signal, order = (np.where(picture.material, v, np.nan) for v in (signal, picture.order))
    return signal, order, ""
