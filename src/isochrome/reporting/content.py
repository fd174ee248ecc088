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
    """A table of a report.

    Parameters
    ----------
    caption : str
        What it holds, and in which file all of it is.
    columns : mapping of str to sequence
        Name, with the unit, to values.
    """

    caption: str
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
    """All that a report says of a run.

    Parameters
    ----------
    command : str
        What made the run, such as 'process'.
    title : str
        What the run is of.
    verdict : str
        What was found, in a sentence.
    frames : sequence of ReportFrame, optional
        The frames that are shown.
    choice : str, default ''
        Which frames these are of how many, and why.
    curves : sequence of Curve, optional
        Values over distance or frames.
    budget : ReportTable, optional
        The shares of the uncertainty; None where the run has none.
    no_budget : str, default ''
        Why there is none, and what to do.
    tables : sequence of ReportTable, optional
        What else is shown as a table.
    causes : sequence of str, optional
        What the frames asked for besides the scene; None where nobody asked them.
    causes_text : str, default ''
        What is to be said where there is no such list.
    refined : sequence of str, optional
        What the frames know better than the scene states it, and agree with.
    taken_as_exact : sequence of str, optional
        Keys of measured numbers whose uncertainty is not in the ±.
    warnings : sequence of str, optional
        The run's warnings.
    scene : str, default ''
        The resolved scene, TOML, or a calibration's settings.
    scene_title : str, default 'Scene'
        What that is called.
    paper : sequence of tuple, optional
        Names and values of what a paper states.
    picture : bytes, optional
        The run's own figure, PNG.
    """

    command: str
    title: str
    verdict: str
    frames: Sequence[ReportFrame] = ()
    choice: str = ""
    curves: Sequence[Curve] = ()
    budget: ReportTable | None = None
    no_budget: str = ""
    tables: Sequence[ReportTable] = ()
    causes: Sequence[str] | None = None
    causes_text: str = ""
    refined: Sequence[str] = ()
    taken_as_exact: Sequence[str] = ()
    warnings: Sequence[str] = ()
    scene: str = ""
    scene_title: str = "Scene"
    paper: Sequence[tuple[str, str]] = ()
    picture: bytes | None = None


def warnings_with_remedies(warnings: Iterable[str]) -> list[dict[str, Any]]:
    """Group warnings by what they are about, each group with its meaning, cause and remedy.

    Parameters
    ----------
    warnings : iterable of str
        The sentences.

    Returns
    -------
    list of dict
        'title', 'meaning', 'cause' and 'remedy', empty for what the guide does not explain;
        'messages', the first ones in their order; and 'left_out', how many more there are.

    Examples
    --------
    >>> from isochrome.reporting import warnings_with_remedies
    >>> found = warnings_with_remedies(["a.tif: cannot be read (x); check its name", "b"])
    >>> [(group["title"], len(group["messages"])) for group in found]
    [('A file or folder is not there, or may not be read', 1), ('Other', 1)]
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
