"""States rendered chunk by chunk, by whoever asks: their pictures as bytes, their rows as numbers.

The wear run comes first and is sequential: each process solves it once, as far as it needs it, a
tenth of what rendering costs.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from isochrome.output import csv_text
from isochrome.runs import Results
from isochrome.scene import Scene
from isochrome.simulation.components import LAYERS
from isochrome.simulation.model import SceneState, iter_scene_states
from isochrome.simulation.rendering import Rendered, render
from isochrome.simulation.state_rows import history_row, profile_rows
from isochrome.stress import PixelGrid

FRAMES, ORDER, PRESSURE = "frames.tif", "fringe_order.tif", "pressure.csv"

_SHOWN = 6
"""States kept for the figure: the paper's six, or evenly spaced ones of a long history."""


def shown_states(count: int) -> list[int]:
    """Which of a number of states the figure shows."""
    ends = np.linspace(0, count - 1, min(_SHOWN, count))
    found: list[int] = ends.round().astype(int).tolist()
    return found


class RenderWork:
    """Renders states of a scene; it may be handed to other processes.

    Attributes: `scene`; `pixels`; `count` of its states; `components`, whether the principal
    stresses are wanted apart; `shown`, the states for the figure.
    """

    def __init__(self, scene: Scene, pixels: PixelGrid, count: int, *, components: bool) -> None:
        self.scene, self.pixels, self.count, self.components = scene, pixels, count, components
        self.shown = shown_states(count)
        self._kept: dict[int, Rendered] = {}
        self._solved = threading.local()

    def __getstate__(self) -> dict[str, Any]:
        own = ("_kept", "_solved")
        return {k: v for k, v in self.__dict__.items() if k not in own}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _kept={}, _solved=threading.local())

    @property
    def stacks(self) -> tuple[str, ...]:
        """The stacks that the states make, by the names of their files."""
        layers = LAYERS if self.components else ()
        return FRAMES, ORDER, *(f"{name}.tif" for name in layers)

    def __call__(self, start: int, stop: int) -> Results:
        """States [start, stop). Raises PhysicsError where one cannot be solved or rendered."""
        parts: dict[str, bytearray] = {name: bytearray() for name in self.stacks}
        rows, tables = [], []
        for index, item in enumerate(self._rendered(start, stop), start):
            rows.append(history_row(index, item, self.pixels))
            if item.state.surface is not None:
                tables.append(csv_text(profile_rows(index, item.state.surface), header=False))
            for name, images in self._pictures(item).items():
                parts[name] += np.ascontiguousarray(images).data
            if index in self.shown:
                self._kept[index] = item
        found = {name: bytes(part) for name, part in parts.items()}
        found[PRESSURE] = "".join(tables).encode()
        return Results({}, rows, [{"status": "ok"}] * len(rows), found)

    def figure_items(self) -> list[Rendered]:
        """The states for the figure, rendered again where another process has done it."""
        return self.rendered_states(self.shown)

    def rendered_states(self, numbers: Iterable[int]) -> list[Rendered]:
        """Some states, rendered again where they are not kept; `numbers` in any order."""
        wanted = list(numbers)
        found = dict(self._kept)
        for index in sorted(set(wanted) - set(found)):
            (found[index],) = self._rendered(index, index + 1)
        self._kept |= {index: found[index] for index in wanted if index in self.shown}
        return [found[index] for index in wanted]

    def _pictures(self, item: Rendered) -> dict[str, np.ndarray]:
        """A state's pictures by the names of their files, little-endian."""
        found = {FRAMES: item.frames, ORDER: item.picture.order.astype("<f4")}
        if item.components is not None:
            found |= {f"{name}.tif": item.components.maps[name] for name in LAYERS}
        return {k: v.astype(v.dtype.newbyteorder("<"), copy=False) for k, v in found.items()}

    def _rendered(self, start: int, stop: int) -> Iterator[Rendered]:
        states = self._states(start, stop)
        return render(self.scene, states, self.pixels, components=self.components, first=start)

    def _states(self, start: int, stop: int) -> Iterator[SceneState]:
        """States [start, stop), of the run as far as it is solved if that is before them."""
        states: Iterator[SceneState] | None = getattr(self._solved, "states", None)
        at: int = getattr(self._solved, "at", 0)
        if states is None or at > start:
            states, at = iter_scene_states(self.scene), 0
        while at < stop:
            state = next(states)
            at += 1
            self._solved.states, self._solved.at = states, at
            if at > start:
                yield state
