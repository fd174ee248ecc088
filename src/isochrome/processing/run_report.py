"""What the report of processed frames says, from the folder of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import IsochromeError
from isochrome.figures import centred_limit
from isochrome.fitting import SceneRenderer, frame_scene, scene_at, sliding_scene
from isochrome.output import counted, numbers, with_uncertainty
from isochrome.processing.figure import Shown, is_of_all, shown_item
from isochrome.processing.in_common import fitted_keys
from isochrome.processing.kinds.kind import NORMALISED, ORDER
from isochrome.processing.processed import Processed
from isochrome.processing.result import CAUSES, EXPLAINED, PICTURE, REFINED, cell_values, own_values
from isochrome.reporting import (
    FRINGES,
    SIGNAL,
    Pane,
    ReportContent,
    ReportFrame,
    ReportTable,
    choose_frames,
    curves_of,
    paper_rows,
)
from isochrome.scene import Scene, dump_scene
from isochrome.simulation import make_picture, picture_signal
from isochrome.stress import pixel_grid

if TYPE_CHECKING:
    from isochrome.processing.figure import Kept

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
    table, scene = result.columns, result.scene
    as_stated = (record.get("options") or {}).get("as_stated", False)
    fitted = scene.has_model and bool(fitted_keys(table))
    looked = result.asks_causes and not as_stated
    verdict = replace(result, as_stated=as_stated).summary_text
    frames, choice = _frames(dataset, result)
    return ReportContent(
        command="process", title=result.title,
        verdict=f"{verdict[:1].upper()}{verdict[1:]}. {_goodness(table)}", frames=frames,
        choice=choice, curves=curves_of(result.over_frames),
        no_budget=(_NO_BUDGET if result.asks_causes else _OF_KNOWN_LOADS) if fitted else _NONE,
        causes=result.causes if looked and fitted else None, refined=result.refined,
        tables=_causes(table), taken_as_exact=result.taken_as_exact, warnings=result.warnings,
        scene=dump_scene(scene), paper=paper_rows(scene, record),
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
    shown = [shown_item(table, dataset, int(having[one.number])) for one in chosen]
    text = f"{len(chosen)} of {counted(len(table['frame']), 'frame')} are shown"
    if len(chosen) < len(having):
        what = "key " * (not of_all) + "frames"
        text += f", chosen among {len(having)} {what} for the reason that stands beside each"
    return _report_frames(result, shown, [one.why for one in chosen]), f"{text}."


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
