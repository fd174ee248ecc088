"""The texts that a figure really draws: their sizes and places, as its renderer is told them."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.figure import Figure

DPI = 200.0
"""Dots per inch of the drawing that is looked at."""


@dataclass(frozen=True)
class Drawn:
    """A line of text: its words, size in points, and corners in dots, y downwards."""

    words: str
    size_pt: float
    corners: np.ndarray

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, top, right, bottom."""
        (left, top), (right, bottom) = self.corners.min(axis=0), self.corners.max(axis=0)
        return float(left), float(top), float(right), float(bottom)


def drawn_texts(figure: Figure) -> list[Drawn]:
    """Every line of text that a drawing of the figure shows."""
    found: list[Drawn] = []
    with _noted(found):
        FigureCanvasAgg(figure).print_figure("/dev/null", format="png", dpi=DPI)
    return found


@contextmanager
def _noted(found: list[Drawn]) -> Iterator[None]:
    """Note what the renderer is asked to write; sizes of letters without their descent."""
    own = RendererAgg.draw_text

    def draw_text(self: Any, gc: Any, x: float, y: float, s: str, prop: Any, angle: float,
                  ismath: Any = False, mtext: Any = None) -> None:  # fmt: skip
        wide, high, descent = self.get_text_width_height_descent(s, prop, ismath)
        turn = np.deg2rad(angle)
        along, up = (
            np.array([np.cos(turn), -np.sin(turn)]),
            np.array([-np.sin(turn), -np.cos(turn)]),
        )
        start = np.array([x, y])
        corners = [start + a * wide * along + b * up
                   for a in (0.0, 1.0) for b in (-descent, high - descent)]  # fmt: skip
        found.append(Drawn(s, prop.get_size_in_points(), np.array(corners)))
        own(self, gc, x, y, s, prop, angle, ismath, mtext)

    RendererAgg.draw_text = draw_text  # type: ignore[method-assign]
    try:
        yield
    finally:
        RendererAgg.draw_text = own  # type: ignore[method-assign]


def overlaps(texts: list[Drawn]) -> list[tuple[str, str]]:
    """Pairs of texts that lie over each other by more than a dot, which is antialiasing."""
    return [
        (one.words, other.words)
        for one, other in combinations(texts, 2)
        if all(
            min(a_end, b_end) - max(a, b) > 1.0
            for (a, a_end), (b, b_end) in (
                ((one.box[0], one.box[2]), (other.box[0], other.box[2])),
                ((one.box[1], one.box[3]), (other.box[1], other.box[3])),
            )
        )
    ]


def outside(texts: list[Drawn], figure: Figure) -> list[str]:
    """Texts of which a part is beyond the edge, but for a dot."""
    wide, high = figure.get_size_inches() * DPI
    return [
        text.words
        for text in texts
        if min(text.box[:2]) < -1.0 or text.box[2] > wide + 1.0 or text.box[3] > high + 1.0
    ]
