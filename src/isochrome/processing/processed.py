"""What `process` finds in a whole set.

The table of a set, and what its frames say together of each one's uncertainties.

Where frames stand: the axes of a set's maps, and each frame's shift from them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import chdtri

from isochrome.errors import InputError, PhysicsError
from isochrome.fitting import (
    CORRECT,
    EARLIER,
    FRICTION,
    LOAD,
    WEAR,
    fitted_scene,
    over_distance,
    stated_pairs,
    taken_as_exact,
)
from isochrome.messages import frame_messages, message, read_frame_messages, warnings_json
from isochrome.output import (
    FittedResult,
    FrameValues,
    columns_of,
    counted,
    messages_of_frames,
    numbers,
    over_items,
    read_csv,
    refined_texts,
    rows_by_key,
    saved_picture,
    sentence_of_orders,
)
from isochrome.processing.kinds.largest_order import ORDER_SPREAD, largest_from
from isochrome.processing.result import (
    CAUSES,
    FOLLOWED,
    FOUND_BY,
    NOTHING,
    PICTURE,
    REFINED,
    SEPARATOR,
    SPREAD,
    ProcessedFrame,
    cell_values,
    corner_of,
    fitted_keys,
    frame_values,
    own_values,
    whole_frames,
)
from isochrome.runs import column_values, identifier, open_run
from isochrome.scene import Scene
from isochrome.simulation import no_model_sentence
from isochrome.stress import PixelGrid, pixel_grid

if TYPE_CHECKING:
    from isochrome.figures import PaperPanels
    from isochrome.fringes import ResidualStress
    from isochrome.runs import RunDataset

_AXES = (("x", "left"), ("z", "top"))


def set_grid(
    scene: Scene, fitted: Scene | None, table: Mapping[str, Sequence[Any]], shape: tuple[int, int]
) -> PixelGrid | None:
    """The grid of a set's maps: that of what was found, so that its simulation has the same.

    `fitted` has the frames' mean place. None where no scale is known.
    """
    pixels, place = numbers(table["pixel_mm"]), fitted or scene
    if not np.isfinite(pixels).any():
        return None
    if place.has_model and place.camera is not None and place.camera.pixel_mm is not None:
        return pixel_grid(place, shape)
    pixel_mm = float(pixels[np.isfinite(pixels)][0])
    return PixelGrid(*shape, *corner_of(scene, shape), pixel_mm)


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


FIGURE = "process.png"
_AGAINST_OTHERS = "no_model_names_fringes"
_LOOK = "isochrome_check_looks_frames"

_NOTABLE = 0.02


@dataclass(frozen=True, repr=False, kw_only=True)
class Processed(FittedResult):
    """A set of processed frames.

    Parameters
    ----------
    draw : callable, optional
        Makes the figure.
    scene : Scene
        The scene as given.
    model : str or None
        The scene's model; None where there is none.
    columns : dict of str to list
        The columns of frames.csv.
    frames : list of ProcessedFrame or None
        The frames, of a tracked video its key frames; None where they were streamed.
    fitted : Scene or None
        The scene with the frames' fitted values (means; friction over distance); None where there
        is no model.
    warnings : tuple of str
        Those of the whole set.
    residual : ResidualStress, optional
        The residual stress that was taken out; None where nobody gave a no-load set.
    already : bool, default False
        Whether an earlier run had left it all.
    failed : int, default 0
        How many frames were left out.
    as_stated : bool, default False
        Whether the frames were asked for nothing but the scene's unknowns.
    messages : list of str
        The warnings of each frame as JSON: code, values and text; empty where there are none.
    load : callable, optional
        Makes the dataset.
    """

    scene: Scene
    model: str | None
    columns: dict[str, list[Any]]
    frames: list[ProcessedFrame] | None
    fitted: Scene | None
    warnings: tuple[str, ...]
    residual: ResidualStress | None = None
    already: bool = False
    failed: int = 0
    as_stated: bool = False
    messages: list[str] = field(default_factory=list)
    load: Callable[[], RunDataset] | None = field(default=None, compare=False)

    @property
    def dataset(self) -> RunDataset:
        """The maps and columns as an xarray.Dataset, the same in memory and of a folder.

        Maps are over (frame, z_mm, x_mm), or (frame, row, col) where no scale is known; see
        `open_run`, which reads those of a folder as they are used. Raises InputError.
        """
        if self.load is None:
            raise InputError("maps_not_kept_process", title=self.title)
        return self.load()

    @property
    def tracked(self) -> bool:
        """Whether most frames were followed from key frames."""
        return PICTURE in self.columns

    @property
    def over_frames(self) -> FrameValues:
        """The fitted values, to be drawn and summed up as those of other commands."""
        return frame_values(self.columns)

    @property
    def title(self) -> str:
        """The scene and how many frames there are."""
        count = len(self.columns["frame"])
        failed = f", {self.failed} of them failed" if self.failed else ""
        return f"Processed {counted(count, 'frame')} of {self.scene.name}{failed}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """What was fitted, how well, and how much was read."""
        yield from super().main_values()
        for name in ("n_max", ORDER_SPREAD, "chi", "kept_share", "fringe_lines"):
            if any(value is not None for value in self.columns.get(name, ())):
                digits = 2 if name == ORDER_SPREAD else 5
                source = largest_from(self.columns) if name == "n_max" else ""
                yield name, over_items(self.columns[name], digits=digits) + source

    @property
    def asks_causes(self) -> bool:
        """Whether frames may ask for more than the scene: not where no model is fitted."""
        return not self.scene.frames.has_known_loads

    @property
    def causes(self) -> list[str] | None:
        """What frames asked for besides the scene: keys, and how many frames did."""
        if self.as_stated or not self.asks_causes:
            return None
        cells = [cell_values(cell or "") for cell in self.columns.get(CAUSES, ())]
        counts = Counter(key for cell in cells for key in cell)
        return [f"{key} ({n} of {counted(len(cells), 'frame')})" for key, n in counts.items()]

    @property
    def refined(self) -> list[str]:
        """What frames know better than the scene states it, and agree with."""
        cells = (cell_values(cell or "") for cell in self.columns.get(REFINED, ()))
        result = [(key, *pair) for cell in cells for key, pair in cell.items()]
        names = ("key", "value", SPREAD)
        rows = rows_by_key({name: [row[k] for row in result] for k, name in enumerate(names)})
        return refined_texts(rows.values(), stated_pairs(self.scene))

    @property
    def taken_as_exact(self) -> tuple[str, ...]:
        """Keys of the measured numbers whose uncertainty is in no ±."""
        keys = fitted_keys(self.columns)
        by_model = keys and self.scene.has_model and self.asks_causes
        return taken_as_exact(self.scene, keys, tracked=self.tracked) if by_model else ()

    @property
    def besides(self) -> list[str]:
        """What else than the pictures the ± are of."""
        known = not self.tracked and bool(stated_pairs(self.scene))
        return ["the stated uncertainties"] * known

    @property
    def summary_text(self) -> str:
        """What was found as a sentence, the same on the terminal and in a report."""
        return super().summary_text if self.rows else sentence_of_orders(self.columns)

    def to_json(self) -> dict[str, Any]:
        """The table of all frames, of a tracked video with what they come to."""
        result: dict[str, Any] = {"model": self.model, "frames": self.columns}
        result |= {"summary": self.summary()} if self.tracked else {}
        result |= {"summary_text": self.summary_text, "taken_as_exact": list(self.taken_as_exact)}
        return result | warnings_json(self.warnings)

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give the frames and their orders for a paper; see `paper_figure`.

        `frames`: numbers of those that are shown. Raises InputError where one is not there.
        """
        from isochrome.processing.figure import processed_panels

        return processed_panels(self, frames)


def collect(
    scene: Scene,
    table: dict[str, list[Any]],
    more: Mapping[str, list[Any]],
    frames: list[ProcessedFrame] | None,
    shape: tuple[int, int],
    residual: ResidualStress | None = None,
) -> Processed:
    """Put the frames' findings together; `frames` is None where they were streamed.

    `more`, what stands beside the rows of the table: each frame's status and messages.
    """
    given = table | {"messages": more["messages"]}
    wider = with_past_loads(with_past_friction(with_scatter_of_gamma(given), scene), scene)
    messages = wider["messages"]
    if frames is not None and wider is not given:
        frames = [
            replace(
                one,
                columns={n: wider[n][k] if n in wider else v for n, v in one.columns.items()},
                warnings=read_frame_messages(messages[k]),
            )
            for k, one in enumerate(frames)
        ]
    table = {name: values for name, values in wider.items() if name != "messages"}
    warnings = _of_scene(scene, residual)
    if PICTURE in table:
        from isochrome.fitting import untracked_inputs

        warnings += untracked_inputs(scene)
    of_frames = zip(table["frame"], messages, strict=True)
    warnings += messages_of_frames(
        (number, text) for number, cell in of_frames for text in read_frame_messages(cell)
    )
    by_model = scene.model and not scene.polariscope.tells_orders
    fitted = _fitted(scene, table, shape) if by_model else None
    warnings += shift_messages(set_grid(scene, fitted, table, shape), table)
    return Processed(
        scene=scene, model=scene.model, columns=table, frames=frames, fitted=fitted,
        warnings=tuple(warnings), residual=residual, failed=more["status"].count("failed"),
        messages=messages,
    )  # fmt: skip


def _of_scene(scene: Scene, residual: ResidualStress | None) -> list[str]:
    """What is said once: why no orders are read, and which stress was taken out."""
    warnings: list[str] = []
    if not scene.orders_are_read:
        known_loads = scene.frames.has_known_loads
        warnings.append(message(_AGAINST_OTHERS) if known_loads else no_model_sentence(scene))
    if residual is not None:
        warnings += residual.warnings
        if residual.largest > _NOTABLE:
            largest, steps = residual.largest, scene.frames.no_load_steps
            warnings.append(
                message("residual_stress_up_fringe_taken", largest=largest, no_load_steps=steps)
            )
    return warnings


def refuse_unread(
    scene: Scene, name: str, table: Mapping[str, list[Any]], read: Iterable[float | None]
) -> None:
    """Refuse a set in none of whose frames an order was read; where none can be, none normalised.

    `read`, share of the specimen's pixels read in each frame, None where nobody read it.
    """
    followed = any(result != NOTHING for result in table.get(FOUND_BY, ()))
    of_orders = scene.orders_are_read
    light = LOAD if scene.frames.has_known_loads else "noise"
    normalised = np.isfinite(numbers(table[light])).any()
    if followed or any(read) or (normalised and not of_orders):
        return
    count = counted(len(table["frame"]), "frame")
    first, words = table["warnings"][0], message(CORRECT if of_orders else _LOOK)
    raise PhysicsError(
        "nothing_could_read_any_first", name=name, count=count, warnings=first, words=words
    )


def restore(
    scene: Scene, out: Path, shape: tuple[int, int], residual: ResidualStress | None
) -> Processed:
    """Read what an earlier run found, from the folder that it left complete."""
    names = read_csv(out / "frames.csv")
    with open_run(out) as dataset:
        table = {name: column_values(dataset[identifier(name)]) for name in names}
        more = {"status": column_values(dataset["status"])}
        if "messages" in dataset:
            more["messages"] = column_values(dataset["messages"])
    for name in {"warnings", CAUSES, REFINED} & set(table):
        table[name] = ["" if text is None else text for text in table[name]]
    if "messages" not in more:  # an older run has their texts alone
        more["messages"] = [frame_messages([text] if text else ()) for text in table["warnings"]]
    draw = partial(saved_picture, out.absolute() / FIGURE)
    result = collect(scene, table, more, None, shape, residual)
    return replace(result, already=True, draw=draw, load=partial(open_run, out.absolute()))


def _fitted(scene: Scene, table: dict[str, list[Any]], shape: tuple[int, int]) -> Scene | None:
    """The scene with the means of the frames' fitted values; None where no frame has any."""
    pixels = numbers(table["pixel_mm"])
    if not np.isfinite(pixels).any():
        return None
    keys = fitted_keys(table)
    # of a tracked video the key frames count, whose every pixel was fitted
    complete = whole_frames(table) if PICTURE in table else [True] * len(table["frame"])
    fitted = [
        {key: {"value": value} for key, value in own_values(table, keys, k).items()} if at else {}
        for k, at in enumerate(complete)
    ]
    grid = {
        # a disc's may come from its rim
        "camera.pixel_mm": float(pixels[np.isfinite(pixels)][0]),
        "camera.height_px": shape[0],
        "camera.width_px": shape[1],
    }
    result = fitted_scene(scene.with_values(grid), {}, fitted)
    if scene.frames.sliding_speed_mm_per_s is None or not scene.wear or FRICTION not in keys:
        return result
    points = {
        float(s): float(values[FRICTION]["value"])
        for s, values in zip(table["distance_m"], fitted, strict=True)
        if FRICTION in values and np.isfinite(values[FRICTION]["value"])
    }
    if len(points) > 1:
        result = result.with_values({EARLIER: 0.0, FRICTION: over_distance(points)})
    return result
