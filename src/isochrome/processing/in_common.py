"""The table of a set, and what its frames say together of each one's uncertainties.

Where frames stand: the axes of a set's maps, and each frame's shift from them.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.special import chdtri

from isochrome.fitting import EARLIER, FRICTION, LOAD, WEAR
from isochrome.messages import frame_messages, message, read_frame_messages
from isochrome.output import FrameValues, columns_of, numbers
from isochrome.processing.result import (
    CAUSES,
    FOLLOWED,
    FOUND_BY,
    PICTURE,
    SEARCHED,
    SEPARATOR,
    SPREAD,
    cell_values,
    whole_frames,
)
from isochrome.scene import Scene
from isochrome.stress import PixelGrid, pixel_grid

_AXES = (("x", "left"), ("z", "top"))


def set_grid(
    scene: Scene, fitted: Scene | None, table: Mapping[str, Sequence[Any]], shape: tuple[int, int]
) -> PixelGrid | None:
    """The grid of a set's maps: that of what was found, so that its simulation has the same.

    `fitted` has the frames' mean place. None where no scale is known.
    """
    pixels, place, camera = numbers(table["pixel_mm"]), fitted or scene, scene.camera
    if not np.isfinite(pixels).any():
        return None
    if place.has_model and place.camera is not None and place.camera.pixel_mm is not None:
        return pixel_grid(place, shape)
    left, top = ((camera.left_mm or 0.0), (camera.top_mm or 0.0)) if camera else (0.0, 0.0)
    return PixelGrid(*shape, left, top, float(pixels[np.isfinite(pixels)][0]))


def shift_of(edge: str, grid: PixelGrid, table: Mapping[str, Sequence[Any]]) -> np.ndarray:
    """How far (mm) each frame's own left or top edge was found from the grid's; NaN = not known."""
    if (result := table.get(f"camera.{edge}_mm")) is None:
        return np.zeros(len(table["frame"]))  # nobody looked for it: all are where the scene says
    return np.asarray(numbers(result) - getattr(grid, f"{edge}_mm"))


def shift_messages(grid: PixelGrid | None, table: Mapping[str, Sequence[Any]]) -> list[str]:
    """What to say where frames lie over half a pixel from the axes that all maps have."""
    far = {name: np.abs(shift_of(edge, grid, table)) for name, edge in _AXES} if grid else {}
    beyond = [
        f"{np.nanmax(shift):.3g} mm along {name}"
        for name, shift in far.items()
        if grid and (shift > 0.5 * grid.pixel_mm).any()
    ]
    return [message("frames_own_places_lie", reach=" and ".join(beyond))] if beyond else []


_GAMMA = "gamma"
"""Column of frames.csv of what each frame's own fringes say, without a model."""

_CHANCE = 0.01
"""Probability with which gammas of one camera may scatter so far by their uncertainties alone."""

_OF_THE_PAST = 0.015
"""Shift of a frame's friction for each unit by which the friction was another before it. Of the
paper's contact it is -0.002 to 0.012 at 31 to 233 m, at three times its wear 0.014."""

_OF_PAST_LOADS = 0.3
"""Shift of a wear coefficient, over it, for each unit by which the loads before scattered, over
their mean, where one steady load stands for them. Of the paper's contact it is 0.05 to 0.28 at 10
to 180 m, with loads that swing by 5 and 10 %."""


def fitted_keys(table: Mapping[str, Any]) -> tuple[str, ...]:
    """The columns of frames.csv that have a standard uncertainty beside them."""
    return tuple(name for name in table if f"{name} {SPREAD}" in table)


def fitted_pairs(row: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """A row's values that have a standard uncertainty, each with it, by their keys."""
    return {key: (row[key], row[f"{key} {SPREAD}"]) for key in fitted_keys(row)}


def frame_values(table: Mapping[str, Sequence[Any]]) -> FrameValues:
    """The fitted values of frames.csv."""
    keys, count = fitted_keys(table), len(table["frame"])
    values, spreads = (
        np.array([numbers(table[f"{key}{ending}"]) for key in keys]).reshape(len(keys), count).T
        for ending in ("", f" {SPREAD}")
    )
    none = [None] * count
    return FrameValues(
        keys=keys, values=values, standard_uncertainty=spreads, chi=numbers(table["chi"]),
        distance_m=numbers(table["distance_m"]),
        searched=np.array([result == SEARCHED for result in table.get(FOUND_BY, none)]),
        whole=np.array(whole_frames(table) if PICTURE in table else none, dtype=bool),
    )  # fmt: skip


def tabulate_set(rows: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Rows as columns, in order of first appearance, the one of the longest texts last."""
    return dict(sorted(columns_of(rows).items(), key=lambda item: item[0] == "warnings"))


def with_scatter_of_gamma(table: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """Widen the uncertainty of gammas that scatter by more: one camera has one gamma.

    Where chi² = sum ((g - mean)/u)² of n frames is what a chance of 1 % exceeds, of n - 1 degrees
    of freedom, u becomes the scatter, if that is larger; the frames' `messages` say so. Source:
    Birge (1932), Phys. Rev. 40, 207, for the test of consistency.
    """
    name = f"{_GAMMA} {SPREAD}"
    if _GAMMA not in table:
        return table
    value, spread = numbers(table[_GAMMA]), numbers(table[name])
    known = np.flatnonzero(np.isfinite(value) & (spread > 0.0))
    if len(known) < 2:
        return table
    value_known, weight = value[known], spread[known] ** -2.0
    mean = float(np.average(value_known, weights=weight))
    if np.sum(weight * (value_known - mean) ** 2) <= chdtri(len(known) - 1, _CHANCE):
        return table
    scatter = float(np.std(value_known, ddof=1))
    least, largest = (int(known[k]) for k in (np.argmin(value_known), np.argmax(value_known)))
    text = message(
        "gamma_scatters_between_frames", value=value[least], frame=table["frame"][least],
        value_2=value[largest], frame_2=table["frame"][largest], scatter=scatter,
    )  # fmt: skip
    wider, messages = list(table[name]), list(table["messages"])
    for k in known:
        wider[k] = max(wider[k], scatter)
        messages[k] = frame_messages((*read_frame_messages(messages[k]), text))
    texts = [SEPARATOR.join(read_frame_messages(cell)) for cell in messages]
    return table | {name: wider, "warnings": texts, "messages": messages}


def with_past_friction(table: dict[str, list[Any]], scene: Scene) -> dict[str, list[Any]]:
    """Widen the uncertainty of frictions that were others before, while the block wore.

    Friction shifts the pressure, so the scar remembers the mean of the others over the distance
    slid: where a frame differs from it, u becomes the shift, if larger. A frame that shows its past
    friction has it among its causes, and stays as it is. The same object where nothing is wider.
    """
    name = f"{FRICTION} {SPREAD}"
    if scene.wear is None or name not in table:
        return table
    order, slid, friction = _over_distance(table, FRICTION)
    if not len(order):
        return table
    away = slid - slid[0]
    past = np.divide(_integral(slid, friction), away, out=friction.copy(), where=away > 0.0)
    causes = table.get(CAUSES) or [""] * len(table[name])
    shown = [EARLIER in cell_values(causes[k] or "") for k in order]
    return _widened(
        table, name, order, np.where(shown, 0.0, _OF_THE_PAST * np.abs(friction - past))
    )


def with_past_loads(table: dict[str, list[Any]], scene: Scene) -> dict[str, list[Any]]:
    """Widen the uncertainty of wear coefficients whose block other loads have worn.

    Of a frame by itself k is off by P'/P - 1, with P' the mean load over the distance slid, before
    the first frame taken for that of the others; a followed frame knows the loads since its track
    began. Their scatter does `_OF_PAST_LOADS` of it besides. The same object where nothing is
    wider.
    """
    name = f"{WEAR} {SPREAD}"
    if scene.wear is None or name not in table or f"{LOAD} {SPREAD}" not in table:
        return table
    order, slid, load = _over_distance(table, LOAD)
    if not len(order) or not slid[-1] > 0.0:
        return table
    first, span = slid[0], slid[-1] - slid[0]
    averages = []
    for values in (load, load * load):
        since = _integral(slid, values)
        before = first * (since[-1] / span if span > 0.0 else values.mean())
        averages.append(np.divide(before + since, slid, out=values.copy(), where=slid > 0.0))
    past, scatter = averages[0], np.sqrt(np.maximum(averages[1] - averages[0] ** 2, 0.0))
    found_by = table.get(FOUND_BY)
    by_itself = np.array([found_by is None or found_by[k] != FOLLOWED for k in order])
    begun = np.maximum.accumulate(np.where(by_itself, np.arange(len(order)), 0))
    scattered = _OF_PAST_LOADS * (slid * scatter / past)[begun]
    remembered = np.divide(scattered, slid, out=np.zeros(len(slid)), where=slid > 0.0)
    shift = np.where(by_itself, np.hypot(remembered, past / load - 1.0), remembered)
    return _widened(table, name, order, np.abs(numbers(table[WEAR]))[order] * shift)


def _widened(
    table: dict[str, list[Any]], name: str, order: Any, least: Any
) -> dict[str, list[Any]]:
    """A table whose uncertainties `name` are `least` (n,) at the least in some frames `order`."""
    wider = list(table[name])
    for k, shift in zip(order, least.tolist(), strict=True):
        if wider[k] is not None:
            wider[k] = max(wider[k], shift)  # that of a value that is not known, NaN, changes none
    return table if wider == table[name] else table | {name: wider}


def _over_distance(table: dict[str, list[Any]], key: str) -> tuple[Any, Any, Any]:
    """The frames that tell a key, in the order of their distances; these (m), and its values."""
    distance = numbers(table["distance_m"])
    value, spread = numbers(table[key]), numbers(table[f"{key} {SPREAD}"])
    known = np.flatnonzero(np.isfinite(distance) & np.isfinite(value) & np.isfinite(spread))
    order = known[np.argsort(distance[known], kind="stable")]
    return order, distance[order], value[order]


def _integral(slid: Any, values: Any) -> Any:
    """Integral of values over the distance (m) from the first frame to each."""
    from scipy.integrate import cumulative_trapezoid

    return cumulative_trapezoid(values, slid, initial=0.0)
