"""Values of many frames with their uncertainties, whoever found them.

Frames as sentences name them: each cause once, with the frames that it is of.

A result as a sentence, the same on the terminal and in a report.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.messages import reworded
from isochrome.output.result import to_last_digit, with_uncertainty
from isochrome.output.tables import numbers

_SPANS = 8
"""Spans of frames that a sentence names; of more it says how many."""


_NUMBER = re.compile(
    r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?: ± [\d.]+(?:e[-+]?\d+)?)?(?!\w)"
)
"""A number of a sentence, with its uncertainty where it has one."""


def messages_of_frames(messages: Iterable[tuple[int, str]], *, single: bool = False) -> list[str]:
    """Say what is to be said of frames, each cause once, with the frames that it is of.

    Sentences that differ in their numbers alone have one cause, and their numbers become spans.
    Where a frame says a sentence several times, each time of something else, all stay apart. A
    `single` frame needs no number.
    """
    if single:
        return list(dict.fromkeys(text for _, text in messages))
    causes: dict[str, list[tuple[int, str]]] = {}
    for number, text in messages:
        causes.setdefault(_cause(text), []).append((number, text))
    lines = []
    for entries in causes.values():
        frames: dict[str, list[int]] = {}
        apart = len({number for number, _ in entries}) < len(entries)
        together = "" if apart else _spanned([text for _, text in entries])
        for number, text in entries:
            frames.setdefault(together or text, []).append(number)
        lines += [f"{counted_frames(numbers)}: " + text for text, numbers in frames.items()]
    return lines


def _cause(text: str) -> str:
    """A sentence without its numbers, and without the plurals that go with them."""
    return re.sub(r"(?<=\w)s\b", "", _NUMBER.sub("#", text))


def _spanned(texts: list[str]) -> str:
    """Sentences of one cause as one, with spans for the numbers in which they differ."""
    texts = list(dict.fromkeys(texts))
    numbers = [_NUMBER.findall(text) for text in texts]
    columns = zip(*numbers, strict=True)
    spans = []
    for column in columns:
        low, high = (end(column, key=_value) for end in (min, max))
        spans.append(low if _value(low) == _value(high) else f"{low} to {high}")
    place = iter(spans)
    # of many there is a plural
    most = max(range(len(texts)), key=lambda k: [_value(number) for number in numbers[k]])
    return reworded(texts[most], _NUMBER.sub(lambda _: next(place), texts[most]))


def _value(number: str) -> float:
    return float(number.partition(" ± ")[0])


def counted_frames(frames: Sequence[int]) -> str:
    """Name frames, and of several say how many they are: 'frames 0-4, 7 (6 in all)'."""
    count = len(frames)
    return named_frames(frames) + (f" ({count} in all)" if count > 1 else "")


def named_frames(frames: Sequence[int]) -> str:
    """Name frames as 'frame 3' or 'frames 0-4, 7', after eight spans how many more."""
    if len(frames) == 1:
        return f"frame {frames[0]}"
    runs = np.split(np.array(frames), np.flatnonzero(np.diff(frames) > 1) + 1)
    spans = [f"{run[0]}" if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs]
    more = f" and {len(spans) - _SPANS} more" if len(spans) > _SPANS else ""
    return f"frames {', '.join(spans[:_SPANS])}{more}"


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameValues:
    """Fitted values of n frames.

    Parameters
    ----------
    keys : tuple of str
        The scene's keys that were fitted.
    values : ndarray, shape (n, keys)
        Their values, each in the unit of its key; NaN = not known.
    standard_uncertainty : ndarray, shape (n, keys)
        Their standard uncertainties, NaN = not known.
    chi : ndarray, shape (n,)
        Residual over noise of each frame.
    distance_m : ndarray, shape (n,)
        Distance slid, m; NaN where nothing slides.
    searched : ndarray of bool, shape (n,)
        Frames of a tracked video that a full search had to find.
    whole : ndarray of bool, shape (n,)
        Key frames of a tracked video.
    """

    keys: tuple[str, ...]
    values: NDArray[np.float64]
    standard_uncertainty: NDArray[np.float64]
    chi: NDArray[np.float64]
    distance_m: NDArray[np.float64]
    searched: NDArray[np.bool_]
    whole: NDArray[np.bool_]

    def summary(self) -> dict[str, list[Any]]:
        """For each key its mean, least and most value, and the median standard uncertainty.

        Column name to values, None where none is known.
        """
        columns = [c[np.isfinite(c)] for c in self.values.T]
        known = [u[np.isfinite(u)] for u in self.standard_uncertainty.T]
        return {
            "key": list(self.keys),
            "mean": [float(c.mean()) if c.size else None for c in columns],
            "least": [float(c.min()) if c.size else None for c in columns],
            "most": [float(c.max()) if c.size else None for c in columns],
            "standard_uncertainty": [float(np.median(u)) if u.size else None for u in known],
        }


WORDS = {
    "load.normal_n": ("load", " N"),
    "friction.coefficient": ("friction", ""),
    "wear.coefficient_mm2_per_n": ("wear coefficient", " mm²/N"),
    "camera.left_mm": ("left edge", " mm"),
    "camera.top_mm": ("upper edge", " mm"),
    "specimen.fringe_value_n_per_mm": ("fringe value", " N/mm"),
}
"""What a sentence calls a value, and its unit; others go by their keys, which hold theirs."""


Row = tuple[str, float, float, float, float]
"""Key, mean, least, most and standard uncertainty of a value."""


def sentence_of(
    rows: Iterable[Sequence[Any]],
    frames: int,
    causes: Sequence[str] | None,
    *,
    refined: Sequence[str] = (),
    basis: str = "",
) -> str:
    """Say a result as a sentence: load 62.00 ± 0.28 N, friction 0.180 ± 0.001; causes found: none.

    Of several frames it is the mean, the least and the most, and the ± of one of them. `causes`,
    what the frames asked for; None where nobody asked them; `refined`, see `refined_texts`;
    `basis`, see `basis_of_uncertainty`.
    """
    rows = list(rows)
    parts = [spoken(*row) for row in rows]
    head = f"mean of {frames} frames, ± of each: " if frames > 1 and parts else ""
    clauses = [f"{head}{', '.join(parts) or 'nothing fitted'}"]
    known = any(mean is not None and mean == mean for _, mean, *_ in rows)
    clauses += [basis] if basis and known else []
    clauses += [f"refined: {_listed(refined)}"] if refined else []
    clauses += [] if causes is None else [f"causes found: {', '.join(causes) or 'none'}"]
    return "; ".join(clauses)


def spoken(key: str, mean: Any, least: Any, most: Any, spread: Any) -> str:
    """A value with its name, unit and, where it has one, span, such as 'load 62.00 ± 0.28 N'."""
    word, unit = WORDS.get(key, (key, ""))
    if mean is None or mean != mean:
        return f"{word} not known"
    text = with_uncertainty(mean, float("nan") if spread is None else spread)
    ends = dict.fromkeys(to_last_digit(end, spread) for end in (least, most))
    span = f" ({' to '.join(ends)})" if len(ends) > 1 else ""
    return f"{word} {text}{unit}{span}"


def basis_of_uncertainty(
    exact: Sequence[str], *, frames: int = 1, besides: Sequence[str] = ()
) -> str:
    """Say what a ± is of, and which inputs were taken as `exact`, those that move the answer first.

    `besides`, what else than the pictures the ± is of. Empty where nothing was taken as exact.
    """
    if not exact:
        return ""
    pictures = "the picture" if frames == 1 else "the pictures"
    source = " and ".join((pictures, *besides)) if besides else f"{pictures} alone"
    verb = "was" if len(exact) == 1 else "were"
    return f"± from {source}: {_listed(exact)} {verb} taken as exact"


def refined_texts(
    rows: Iterable[Sequence[Any]], stated: Mapping[str, tuple[float, float]]
) -> list[str]:
    """Say which values are known better than they were stated, as far as two digits of a ± tell.

    Of values that agree with what was stated: each with that, the one that became surest first.
    """
    better = []
    for key, mean, _, _, spread in rows:
        value, before = stated[key]
        if float(f"{spread:.1e}") < float(f"{before:.1e}"):
            text = f"{spoken(key, mean, mean, mean, spread)} (stated "
            better.append((spread / before, f"{text}{with_uncertainty(value, before)})"))
    return [text for _, text in sorted(better)]


def rows_by_key(table: Mapping[str, Sequence[Any]]) -> dict[str, Row]:
    """Columns of fit.csv as the rows of `sentence_of`: over the frames where each has its own."""
    by_key: dict[str, list[tuple[float, float]]] = {}
    columns = (table[n] for n in ("key", "value", "standard_uncertainty"))
    for key, value, spread in zip(*columns, strict=True):
        by_key.setdefault(key, []).append((value, spread))
    return {
        key: (key, fmean(values), min(values), max(values), median(spreads))
        for key, pairs in by_key.items()
        for values, spreads in [tuple(zip(*pairs, strict=True))]
    }


def sentence_of_orders(table: Mapping[str, Sequence[Any]]) -> str:
    """Say what was read without a model: share of the pixels, highest order, typical ±.

    Of several frames the share is the mean, and the ± the median.
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


def _listed(items: Sequence[str]) -> str:
    """Some names, of many the first three, so that a sentence can be read."""
    more = len(items) - 3
    return ", ".join(items) if more < 2 else f"{', '.join(items[:3])} and {more} more"
