"""A result as a sentence, the same on the terminal and in a report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from statistics import fmean, median
from typing import Any

from isochrome.output.result import with_uncertainty
from isochrome.output.tables import numbers

WORDS = {
    "load.normal_n": ("load", " N"),
    "friction.coefficient": ("friction", ""),
    "wear.coefficient_mm2_per_n": ("wear coefficient", " mm²/N"),
    "camera.left_mm": ("left edge", " mm"),
    "camera.top_mm": ("upper edge", " mm"),
    "specimen.fringe_value_n_per_mm": ("fringe value", " N/mm"),
}
"""What a sentence calls a value, and its unit; others go by their keys, which hold theirs."""


def sentence_of(
    rows: Iterable[Sequence[Any]], frames: int, causes: Sequence[str], looked: bool = True
) -> str:
    """Say a result as a sentence: load 62.00 ± 0.28 N, friction 0.180 ± 0.001; causes found: none.

    Of several frames it is the mean, the least and the most, and the ± of one of them.

    Parameters
    ----------
    rows : iterable of sequences
        Key, mean, least, most and standard uncertainty of each value.
    frames : int
        How many there are.
    causes : sequence of str
        What the frames asked for.
    looked : bool, default True
        Whether anybody asked them.

    Returns
    -------
    str
        The sentence, without a full stop.
    """
    parts = [_spoken(*row) for row in rows]
    head = f"mean of {frames} frames, ± of each: " if frames > 1 and parts else ""
    found = f"; causes found: {', '.join(causes) or 'none'}" if looked else ""
    return f"{head}{', '.join(parts) or 'nothing fitted'}{found}"


def sentence_of_values(
    table: Mapping[str, Sequence[Any]], asked: Sequence[str] | None
) -> tuple[str, list[str]]:
    """Say the table of a fit as a sentence.

    Parameters
    ----------
    table : mapping of str to sequence
        The columns of fit.csv.
    asked : sequence of str or None
        The keys that were to be fitted: others are causes, which the frames asked for. None for
        all, where nobody asked the frames.

    Returns
    -------
    str
        The sentence, without a full stop.
    list of str
        The causes, each with its value.
    """
    by_key: dict[str, list[tuple[float, float]]] = {}
    columns = (table[n] for n in ("key", "value", "standard_uncertainty"))
    for key, *found in zip(*columns, strict=True):
        by_key.setdefault(key, []).append((found[0], found[1]))
    rows = {
        key: (key, fmean(values), min(values), max(values), median(spreads))
        for key, found in by_key.items()
        for values, spreads in [tuple(zip(*found, strict=True))]
    }
    wanted = [row for key, row in rows.items() if asked is None or key in asked]
    causes = [_spoken(*row) for row in rows.values() if row not in wanted]
    frames = len({frame for frame in table["frame"] if frame != "all"})
    return sentence_of(wanted, frames, causes, looked=asked is not None), causes


def sentence_of_orders(table: Mapping[str, Sequence[Any]]) -> str:
    """Say what was read without a model: share of the pixels, highest order, typical ±.

    Of several frames the share is the mean, and the ± the median.

    Parameters
    ----------
    table : mapping of str to sequence
        The columns of frames.csv.

    Returns
    -------
    str
        The sentence, without a full stop.
    """
    count = len(table["frame"])
    head = f"in {count} frames: " if count > 1 else ""
    if not {"kept_share", "fringe_lines"} & set(table):
        return f"{head}no order could be read"
    if "kept_share" not in table:
        lines = sum(int(n or 0) for n in table["fringe_lines"])
        return (
            f"{head}{lines} fringe lines, and no order: no point of known order is given "
            "(`isochrome guide without-model`)"
        )
    shares, highest, spreads = (
        [value for value in numbers(table[name]).tolist() if value == value]
        for name in ("kept_share", "n_max", "order_uncertainty")
    )
    if not highest:
        return f"{head}no order could be read"
    largest = max(highest)
    sources = zip(table["n_max"], table.get("n_max_from", ()), strict=False)  # older runs say none
    least = (largest, "at least") in sources
    most = f"up to {'at least ' * least}{largest:.2f} fringes"
    typical = f", ± {median(spreads):.2g} typically" if spreads else ""
    return f"{head}order read in {100 * fmean(shares):.0f} % of the pixels, {most}{typical}"


def _spoken(key: str, mean: Any, least: Any, most: Any, spread: Any) -> str:
    """A value with its name and unit."""
    word, unit = WORDS.get(key, (key, ""))
    if mean is None or mean != mean:
        return f"{word} not known"
    text = with_uncertainty(mean, float("nan") if spread is None else spread)
    span = f" ({least:.5g} to {most:.5g})" if least != most else ""
    return f"{word} {text}{unit}{span}"
