"""Values of many frames with their uncertainties, whoever found them.

Frames as sentences name them: each cause once, with the frames that it is of.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.messages import reworded

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
