"""Frames as sentences name them: each sentence once, with the frames that it is of."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

_SPANS = 8
"""Spans of frames that a sentence names; of more it says how many."""


def messages_of_frames(messages: Iterable[tuple[int, str]], *, single: bool = False) -> list[str]:
    """Say what is to be said of frames, each sentence once, with the frames that it is of.

    Parameters
    ----------
    messages : iterable of tuple
        Frames' numbers and sentences.
    single : bool, default False
        Whether there is but one frame, which needs no number.

    Returns
    -------
    list of str
        The sentences.
    """
    frames: dict[str, list[int]] = {}
    for number, text in messages:
        frames.setdefault(text, []).append(number)
    return [text if single else f"{named_frames(own)}: {text}" for text, own in frames.items()]


def named_frames(frames: Sequence[int]) -> str:
    """Name frames as 'frame 3' or 'frames 0-4, 7', after eight spans how many more.

    Parameters
    ----------
    frames : sequence of int
        Their numbers, rising.

    Returns
    -------
    str
        Their names.
    """
    if len(frames) == 1:
        return f"frame {frames[0]}"
    runs = np.split(np.array(frames), np.flatnonzero(np.diff(frames) > 1) + 1)
    spans = [f"{run[0]}" if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs]
    more = f" and {len(spans) - _SPANS} more" if len(spans) > _SPANS else ""
    return f"frames {', '.join(spans[:_SPANS])}{more}"
