"""A colour table as a CSV file: fringe_order, red, green, blue, and the table's own scatter."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.errors import InputError
from isochrome.frames import CHANNELS
from isochrome.fringes.colour.colour_table import LARGEST_ORDER, STEP, ColourTable
from isochrome.fringes.windows import Array
from isochrome.output import check_given_table, read_csv

SPREADS = tuple(f"{name}_spread" for name in CHANNELS)

LARGEST_SIGNAL = 3.0
"""Of full light: a camera that corrects its colours passes 1 where a channel is purest, and where
full light would saturate the frames, 1 stands for less of it."""

_COARSEST = 0.05
_MOST_SPREAD = 0.3


def table_columns(table: ColourTable) -> dict[str, Any]:
    """A table as the columns of its file, the spread repeated in every row; 1 = full light."""
    columns: dict[str, Any] = {"fringe_order": table.order}
    columns |= {name: table.signal[:, c] for c, name in enumerate(CHANNELS)}
    return columns | {
        name: np.full(len(table.signal), table.spread[c]) for c, name in enumerate(SPREADS)
    }


def read_table(path: Path) -> ColourTable:
    """Read a colour table, on the steps that it is used with; straight lines lie between its rows.

    Columns fringe_order (rising from 0, fringes), red, green, blue (1 = full light), and if there
    are any red_spread, green_spread, blue_spread, the standard deviation of frames about the table.
    InputError names the file, what is wrong and the fix.
    """
    fix = "make it with 'isochrome calibrate colour'"
    if path.exists():
        check_given_table(path, "the colour table")
    found = read_csv(path)
    missing = [name for name in ("fringe_order", *CHANNELS) if name not in found]
    if missing:
        raise InputError(f"{path}: frames.colour_table lacks the columns {missing}; {fix}")
    try:
        order = np.array(found["fringe_order"], dtype=float)
        signal = np.array([found[name] for name in CHANNELS], dtype=float).T
        spread = np.array([found.get(name, [0.0])[:1] for name in SPREADS], dtype=float).ravel()
    except ValueError as error:
        raise InputError(f"{path}: frames.colour_table holds more than numbers; {fix}") from error
    for fault in _faults(order, signal, spread):
        raise InputError(f"{path}: frames.colour_table{fault}; {fix}")
    places = STEP * np.arange(int(np.floor(order[-1] / STEP + 1e-6)) + 1)
    values = [np.interp(places, order, signal[:, c]) for c in range(len(CHANNELS))]
    return ColourTable(np.stack(values, axis=1), spread)


def _faults(order: Array, signal: Array, spread: Array) -> Iterator[str]:
    """What is wrong with a table, the coarsest fault first."""
    if not (np.isfinite(order).all() and np.isfinite(signal).all() and np.isfinite(spread).all()):
        yield " has empty cells or numbers that are not finite"
    if len(order) < 2 or abs(order[0]) > 1e-6 or (np.diff(order) <= 0.0).any():
        yield ": fringe_order must rise from 0, row by row"
    coarsest = np.diff(order).max()
    if coarsest > _COARSEST:
        yield (
            f": fringe_order goes in steps of {coarsest:.3g}, and {_COARSEST} at most are allowed"
        )
    if not 0.5 <= order[-1] <= LARGEST_ORDER:
        yield f" ends at N = {order[-1]:g}, and 0.5 to {LARGEST_ORDER:g} are allowed"
    if signal.min() < -0.2 or signal.max() > LARGEST_SIGNAL:
        yield f": signals from {signal.min():.3g} to {signal.max():.3g}, and 1 is full light"
    if np.ptp(signal, axis=0).min() < 0.1:
        yield ": a channel hardly changes with the order"
    if spread.min() < 0.0 or spread.max() > _MOST_SPREAD:
        yield f": a spread must be from 0 to {_MOST_SPREAD}"
