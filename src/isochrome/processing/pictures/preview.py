"""The last frame of a long run that was read, as a picture that can be watched while it goes on."""

import time
from pathlib import Path

import numpy as np

from isochrome.figures import VALUE_MAP
from isochrome.output import replacing
from isochrome.processing.kinds.largest_order import AT_LEAST, ORDER_FROM
from isochrome.processing.result import FollowedFrame, ProcessedFrame

PREVIEW = "preview.png"
"""Its name, in the run's working folder."""

EVERY_S = 3.0
"""Seconds between two pictures: one takes some 20 ms."""

_NOT_KNOWN = (128, 128, 128)
_STRIP_PX, _LETTER = 22, 0.45
"""Height of the line of words, and the size of its letters."""


def write_preview(place: Path, item: ProcessedFrame | FollowedFrame) -> None:
    """Write a frame's orders as a picture, unless one was written just now or it has none.

    It is put in its place whole, so that a viewer never sees half of it.
    """
    reading = item.reading
    if reading is None:
        return
    try:
        if time.time() - place.stat().st_mtime < EVERY_S:
            return
    except FileNotFoundError:
        pass  # the first
    import cv2

    with replacing(place) as beside:
        done, data = cv2.imencode(".png", preview_picture(reading.order, _words(item)))
        assert done
        beside.write_bytes(data.tobytes())


def preview_picture(order: np.ndarray, words: str) -> np.ndarray:
    """Orders in colours from 0 to the largest, grey where not known, under some words in ASCII.

    Blue, green and red (rows + 22, cols, 3), 8 bits.
    """
    import cv2
    from matplotlib import colormaps

    known = np.isfinite(order)
    largest = max(float(order[known].max()) if known.any() else 0.0, 1e-9)
    table = (255.0 * colormaps[VALUE_MAP](np.linspace(0.0, 1.0, 256))[:, 2::-1]).astype(np.uint8)
    level = np.where(known, 255.0 * order / largest, 0.0).astype(np.uint8)
    picture = np.ascontiguousarray(table[level])
    picture[~known] = _NOT_KNOWN
    strip = np.full((_STRIP_PX, order.shape[1], 3), 255, np.uint8)
    at = (4, _STRIP_PX - 7)
    cv2.putText(strip, words, at, cv2.FONT_HERSHEY_SIMPLEX, _LETTER, (0, 0, 0), 1, cv2.LINE_AA)
    return np.concatenate((strip, picture))


def _words(item: ProcessedFrame | FollowedFrame) -> str:
    """The frame's number and label, its load and largest order where they are known."""
    row = item.row()
    parts = [f"frame {item.index}", item.label]
    most = "least" if row.get(ORDER_FROM) == AT_LEAST else "most"
    for key, unit in (("load.normal_n", " N"), ("n_max", f" fringes at {most}")):
        value = row.get(key)
        if value is not None and np.isfinite(value):
            parts.append(f"{value:.4g}{unit}")
    return ", ".join(parts).encode("ascii", "replace").decode()
