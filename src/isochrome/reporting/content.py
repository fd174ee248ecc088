"""What a report says, whatever run it is of."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from isochrome.guide import explain_message
from isochrome.output import to_last_digit
from isochrome.reporting.charts import Curve
from isochrome.reporting.pictures import ReportFrame

_MOST_ROWS = 60
"""Rows of a table in a report: the run's own file has all of them."""

_SPREAD = "standard_uncertainty"

_MOST_MESSAGES = 30
"""Of a group of warnings: each frame of a long run may have one of its own."""


@dataclass(frozen=True)
class ReportTable:
    """A table of a report; its columns' names have the unit."""

    caption: str  # what it holds, and in which file all of it is
    columns: Mapping[str, Sequence[Any]]

    @property
    def rows(self) -> list[tuple[tuple[str, bool], ...]]:
        """The first rows: each value as text, and whether it is a number, which is not broken."""
        cells = (
            [(text, isinstance(v, int | float)) for text, v in zip(texts, values, strict=False)]
            for name, values in self.columns.items()
            for texts in [self._texts(name)]
        )
        return list(zip(*cells, strict=True))

    def _texts(self, name: str) -> list[str]:
        """The first cells of a column: a ± with two digits, a value to the last of its own."""
        values = self.columns[name][:_MOST_ROWS]
        own = _SPREAD if name == "value" else f"{name} {_SPREAD}"
        spreads = self.columns.get(own, [None] * len(values))
        digits = 2 if name.endswith(("uncertainty", "bound")) else 5
        return [_text(*pair, digits) for pair in zip(values, spreads, strict=False)]

    @property
    def left_out(self) -> int:
        """How many rows are left to the run's own file."""
        return max(0, max(map(len, self.columns.values()), default=0) - _MOST_ROWS)


@dataclass(frozen=True, kw_only=True)
class ReportContent:
    """All that a report says of a run."""

    command: str  # what made the run, such as 'process'
    title: str  # what the run is of
    verdict: str  # what was found, in a sentence
    frames: Sequence[ReportFrame] = ()
    choice: str = ""  # which frames of how many, and why
    curves: Sequence[Curve] = ()
    budget: ReportTable | None = None  # shares of the uncertainty; None: the run has none
    no_budget: str = ""  # why there is none, and what to do
    tables: Sequence[ReportTable] = ()
    # what the frames asked for besides the scene; None: nobody asked
    causes: Sequence[str] | None = None
    causes_text: str = ""  # what to say where there is no such list
    refined: Sequence[str] = ()  # what the frames know better than the scene states it
    # keys of measured numbers whose uncertainty is not in the ±
    taken_as_exact: Sequence[str] = ()
    warnings: Sequence[str] = ()
    scene: str = ""  # resolved, TOML, or a calibration's settings
    scene_title: str = "Scene"
    paper: Sequence[tuple[str, str]] = ()  # names and values of what a paper states
    picture: bytes | None = None  # the run's own figure, PNG


def warnings_with_remedies(warnings: Iterable[str]) -> list[dict[str, Any]]:
    """Group warnings by what they are about, each group with its meaning, cause and remedy.

    Dicts of 'title', 'meaning', 'cause' and 'remedy', empty for what the guide does not explain;
    'messages', the first ones in their order; and 'left_out', how many more there are.
    """
    groups: dict[str, dict[str, Any]] = {}
    for text in warnings:
        entry = explain_message(text)
        title = entry.title if entry else "Other"
        words = {
            name: getattr(entry, name) if entry else "" for name in ("meaning", "cause", "remedy")
        }
        group = groups.setdefault(title, {"title": title, **words, "messages": [], "left_out": 0})
        if len(group["messages"]) < _MOST_MESSAGES:
            group["messages"].append(text)
        else:
            group["left_out"] += 1
    return list(groups.values())


def _text(value: Any, spread: Any, digits: int) -> str:
    if value is None or value != value:
        return "not known"
    if not isinstance(value, float):
        return str(value)
    return to_last_digit(value, spread) if spread else f"{value:.{digits}g}"
