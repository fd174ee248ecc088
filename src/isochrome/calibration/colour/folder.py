"""A colour calibration on disk: the table, the no-load frames as found, numbers and figure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.colour.api import ColourCalibration
from isochrome.figures import new_figure
from isochrome.frames import CHANNELS
from isochrome.output import write_csv, write_tiff

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = ("#c4312a", "#2a8f3c", "#2f5fc4")


def write_colours(calibration: ColourCalibration, folder: Path) -> None:
    """Write colour_table.csv and, where they were found, background.tif and illumination.tif."""
    write_csv(folder / "colour_table.csv", calibration.columns)
    if calibration.background is not None and calibration.illumination is not None:
        ends = {
            "background": calibration.background,
            "illumination": calibration.background + calibration.illumination,
        }
        for name, light in ends.items():
            levels = _levels(light, calibration)
            write_tiff(folder / f"{name}.tif", levels[None], photometric="rgb")


def _levels(light: NDArray[Any], calibration: ColourCalibration) -> NDArray[Any]:
    """Light as grey levels of the images' kind, below the level that counts as saturated."""
    raw = np.maximum(light, 0.0) ** (1.0 / calibration.gamma)
    depth = calibration.bit_depth
    if depth is None:
        share: NDArray[Any] = np.minimum(raw, 0.999).astype(np.float32)
        return share
    full = 2**depth - 1
    levels: NDArray[Any] = np.minimum(np.rint(full * raw), full - 1).astype(
        np.uint8 if depth <= 8 else np.uint16
    )
    return levels


def colour_figure(calibration: ColourCalibration) -> Figure:
    """Draw a table: the channels' signals over the order with their scatter, and the colours.

    Parameters: `calibration`. Returns a Matplotlib Figure; save it with `output.write_figure`.
    """
    figure = new_figure(10.0, 5.2)
    panels: Any = figure.subplots(2, 1, sharex=True, height_ratios=[5, 1])
    curves, strip = panels
    table = calibration.colour_table
    for c, (name, colour) in enumerate(zip(CHANNELS, COLOURS, strict=True)):
        signal, spread = table.signal[:, c], table.spread[c]
        curves.plot(table.order, signal, color=colour, lw=1.6, label=name)
        curves.fill_between(
            table.order, signal - spread, signal + spread, color=colour, alpha=0.2, lw=0
        )
    curves.axvline(calibration.highest, color="0.4", ls="--", lw=1.0, label="seen in the images")
    curves.set_ylabel("signal (1 = full light)")
    curves.legend(loc="upper right", fontsize=9)
    shown = np.clip(table.signal / table.signal.max(), 0.0, 1.0) ** (1.0 / 2.2)
    strip.imshow(shown[None], aspect="auto", extent=(0.0, table.highest, 0.0, 1.0))
    strip.set_yticks([])
    strip.set_xlabel(f"fringe order N at {calibration.wavelength_nm:g} nm (fringes)")
    figure.suptitle(
        f"colour table from {calibration.way}: gamma = {calibration.gamma:.3g}, "
        f"residual {calibration.residual:.3f} of full light"
    )
    return figure
