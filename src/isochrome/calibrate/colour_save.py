"""A colour calibration on disk: the table, the no-load frames as found, numbers and figure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibrate.colour import ColourCalibration
from isochrome.frames import CHANNELS
from isochrome.fringes.colour_file import table_columns
from isochrome.output import provenance, staged, write_csv, write_figure, write_json, write_tiff

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = ("#c4312a", "#2a8f3c", "#2f5fc4")


def save_colour_calibration(
    calibration: ColourCalibration, out: str | Path, *, source: str | Path | None = None
) -> None:
    """Write colour_table.csv, calibration.json, calibration.png and provenance.json, all or none.

    Where background and illumination were found: also background.tif and illumination.tif, to be
    named as a scene's no-load frames for frames of the same camera, light and place.
    Parameters: `calibration`; `out`, the folder; `source`, the set, for its hash.
    Raises InputError where the folder cannot be written.
    """
    with staged(out) as folder:
        write_csv(folder / "colour_table.csv", table_columns(calibration.table))
        write_json(folder / "calibration.json", calibration.to_json())
        inputs = [] if source is None else [Path(source)]
        write_json(folder / "provenance.json", provenance(None, inputs))
        if calibration.background is not None and calibration.illumination is not None:
            ends = {
                "background": calibration.background,
                "illumination": calibration.background + calibration.illumination,
            }
            for name, light in ends.items():
                levels = _levels(light, calibration)
                write_tiff(folder / f"{name}.tif", levels[None], photometric="rgb")
        write_figure(folder / "calibration.png", colour_figure(calibration))


def _levels(light: NDArray[Any], calibration: ColourCalibration) -> NDArray[Any]:
    """Light as grey levels of the images' kind, below the level that counts as saturated."""
    raw = np.maximum(light, 0.0) ** (1.0 / calibration.gamma)
    depth = calibration.bit_depth
    if depth is None:
        return np.minimum(raw, 0.999).astype(np.float32)
    full = 2**depth - 1
    return np.minimum(np.rint(full * raw), full - 1).astype(np.uint8 if depth <= 8 else np.uint16)


def colour_figure(calibration: ColourCalibration) -> Figure:
    """Draw a table: the channels' signals over the order with their scatter, and the colours.

    Parameters: `calibration`. Returns a Matplotlib Figure; save it with `output.write_figure`.
    """
    from isochrome.figures import new_figure

    figure = new_figure(10.0, 5.2)
    panels: Any = figure.subplots(2, 1, sharex=True, height_ratios=[5, 1])
    curves, strip = panels
    table = calibration.table
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
