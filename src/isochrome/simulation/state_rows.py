"""The rows that a rendered state adds to `simulate`'s tables."""

from __future__ import annotations

from typing import Any

import numpy as np

from isochrome.contact import SurfaceState
from isochrome.simulation.rendering import Rendered
from isochrome.stress import PixelGrid, ShearPeak

HISTORY, PICTURE = "history.csv", "simulation.png"
"""The table of these rows, and the run's figure."""

PROFILE = ("state", "x_mm", "pressure_mpa", "shear_mpa", "wear_depth_um")
"""Columns of pressure.csv."""


def history_row(index: int, item: Rendered, pixels: PixelGrid) -> dict[str, Any]:
    """One row of history.csv: contact, wear, and the largest fringe order and shear in view.

    The largest shear (sigma_1 - sigma_2)/2 is that of the pixel with the largest order; with the
    item's components, the largest anywhere in the material in view.
    Parameters: `index` of the state; `item`; `pixels`. Returns column name to value.
    """
    order = np.where(item.picture.material, item.picture.order, -1.0)
    row, col = np.unravel_index(int(order.argmax()), order.shape)
    place = pixels.place(int(row), int(col))
    shear = 0.5 * float(np.abs(item.picture.difference[row, col]))
    peak = item.components.peak if item.components else ShearPeak(shear, *place)
    surface = item.state.surface
    nothing = float("nan")
    found: dict[str, Any] = {
        "state": index,
        "label": item.state.label,
        "distance_m": item.state.distance_m,
        "friction": surface.friction if surface else nothing,
        "p_max_mpa": surface.p_max_mpa if surface else nothing,
        "contact_width_mm": surface.contact_width_mm if surface else nothing,
        "contact_centre_mm": sum(surface.edges_mm) / 2 if surface else nothing,
        "wear_depth_um": 1e3 * float(surface.wear_depth_mm.max()) if surface else nothing,
        "worn_area_mm2": surface.worn_area_mm2 if surface else nothing,
        "n_max": float(order[row, col]),
        "n_max_x_mm": place[0],
        "n_max_z_mm": place[1],
        "shear_max_mpa": peak.shear_mpa,
        "shear_max_x_mm": peak.x_mm,
        "shear_max_z_mm": peak.z_mm,
        "residual": surface.residual if surface else nothing,
    }
    if item.block_order is not None:  # how far a half-plane would be off
        found["block_order_max"] = item.block_order
    return found


def profile_rows(index: int, surface: SurfaceState) -> dict[str, Any]:
    """The rows of pressure.csv for one state: the nodes that are loaded or worn.

    They run from the last node before the first of them to the first after the last, so that
    the zeros at both ends are there; beyond, all columns but x are zero and are left out.
    Parameters: `index` of the state; `surface`. Returns column name to values, of one length.
    """
    touched = (surface.pressure_mpa != 0.0) | (surface.shear_mpa != 0.0)
    places = np.flatnonzero(touched | (surface.wear_depth_mm != 0.0))
    span = slice(max(int(places[0]) - 1, 0), int(places[-1]) + 2)
    x = surface.grid.x_mm[span]
    values = (
        [index] * len(x),
        x,
        surface.pressure_mpa[span],
        surface.shear_mpa[span],
        1e3 * surface.wear_depth_mm[span],
    )
    return dict(zip(PROFILE, values, strict=True))


def add_state_row(columns: dict[str, list[Any]], row: dict[str, Any]) -> None:
    """Add a row to a table's columns."""
    for name, value in row.items():
        columns.setdefault(name, []).append(value)
