"""What `process` finds in a whole set."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.fitting import (
    CORRECT,
    EARLIER,
    FRICTION,
    LOAD,
    fitted_scene,
    over_distance,
    stated_pairs,
    taken_as_exact,
)
from isochrome.messages import frame_messages, message, read_frame_messages, warnings_json
from isochrome.output import (
    FrameValues,
    Result,
    basis_of_uncertainty,
    counted,
    messages_of_frames,
    numbers,
    over_items,
    read_csv,
    refined_texts,
    rows_by_key,
    saved_picture,
    sentence_of,
    sentence_of_orders,
)
from isochrome.processing.in_common import (
    fitted_keys,
    frame_values,
    set_grid,
    shift_messages,
    with_past_friction,
    with_past_loads,
    with_scatter_of_gamma,
)
from isochrome.processing.kinds.largest_order import ORDER_SPREAD, largest_from
from isochrome.processing.result import (
    CAUSES,
    FOUND_BY,
    NOTHING,
    PICTURE,
    REFINED,
    SPREAD,
    ProcessedFrame,
    cell_values,
    own_values,
    whole_frames,
)
from isochrome.runs import column_values, identifier, open_run
from isochrome.scene import Scene
from isochrome.simulation import no_model_sentence

if TYPE_CHECKING:
    from isochrome.figures import PaperPanels
    from isochrome.fringes import ResidualStress
    from isochrome.runs import RunDataset

FIGURE = "process.png"
_AGAINST_OTHERS = "no_model_names_fringes"
_LOOK = "isochrome_check_looks_frames"

_NOTABLE = 0.02


@dataclass(frozen=True, repr=False, kw_only=True)
class Processed(Result):
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

    def summary(self) -> dict[str, list[Any]]:
        """What the frames come to."""
        return self.over_frames.summary()

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
        for key in fitted_keys(self.columns):
            yield key, over_items(self.columns[key], self.columns[f"{key} {SPREAD}"])
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
    def causes(self) -> list[str]:
        """What frames asked for besides the scene: keys, and how many frames did."""
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
    def uncertainty_basis(self) -> str:
        """What the ± are of, and what was taken as exact."""
        known = not self.tracked and bool(stated_pairs(self.scene))
        besides = ["the stated uncertainties"] * known
        return basis_of_uncertainty(
            self.taken_as_exact, frames=len(self.columns["frame"]), besides=besides
        )

    @property
    def summary_text(self) -> str:
        """What was found as a sentence, the same on the terminal and in a report."""
        rows = list(zip(*self.summary().values(), strict=True))
        if not rows:
            return sentence_of_orders(self.columns)
        causes = self.causes if self.asks_causes and not self.as_stated else None
        count, basis = len(self.columns["frame"]), self.uncertainty_basis
        return sentence_of(rows, count, causes, refined=self.refined, basis=basis)

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
                columns={n: wider[n][k] for n in one.columns},
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
