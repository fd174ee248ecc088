"""A colour calibration on disk: the table, the no-load frames as found, numbers and figure."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.colour.api import ColourCalibration
from isochrome.errors import InputError
from isochrome.figures import (
    BOLD_PT,
    CHANNEL_COLOURS,
    GREY,
    LINE_PT,
    LINE_STYLES,
    PaperPanels,
    Plot,
    add_legend,
    new_figure,
    style_axes,
    write_head,
)
from isochrome.frames import CHANNELS
from isochrome.output import imagej_view, write_csv, write_tiff

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_SEEN = "seen in the images"


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
            view = imagej_view(name, (0.0, 1.0), labels=[name])
            write_tiff(folder / f"{name}.tif", levels[None], photometric="rgb", metadata=view)


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
    _draw_channels(curves, calibration)
    add_legend(curves, loc="upper right")
    _draw_strip(strip, calibration)
    write_head(figure, _values(calibration))
    return figure


def colour_panels(calibration: ColourCalibration, frames: tuple[int, ...] | None) -> PaperPanels:
    """The same for a paper; the channels have lines of their own kinds, for colour-blind readers.

    Parameters: `calibration`; `frames`, None. Returns PaperPanels. Raises InputError where frames
    are named.
    """
    if frames is not None:
        raise InputError("frames of a figure: a colour table has none; leave them out")

    def channels(axes: Axes) -> None:
        _draw_channels(axes, calibration, LINE_STYLES)
        axes.set_xlabel(_order_label(calibration))

    strip = partial(_draw_strip, calibration=calibration)
    return PaperPanels(
        plots=[
            Plot(title="channels", draw=channels, height_mm=45.0),
            Plot(title="colours", draw=strip, height_mm=10.0),
        ],
        plots_across=1,
        legend=(*CHANNELS, _SEEN),
        notes=[f"{_values(calibration)}."],
    )


def _values(calibration: ColourCalibration) -> str:
    """What was found, in words."""
    return (
        f"colour table from {calibration.way}: gamma = {calibration.gamma:.3g}, "
        f"residual {calibration.residual:.3f} of full light"
    )


def _order_label(calibration: ColourCalibration) -> str:
    return f"fringe order N at {calibration.wavelength_nm:g} nm (fringes)"


def _draw_channels(
    curves: Axes, calibration: ColourCalibration, styles: Sequence[str] = ("-", "-", "-")
) -> None:
    """The channels' signals over the order with their scatter."""
    table = calibration.colour_table
    for c, (name, colour) in enumerate(zip(CHANNELS, CHANNEL_COLOURS, strict=True)):
        signal, spread = table.signal[:, c], table.spread[c]
        curves.plot(table.order, signal, color=colour, lw=BOLD_PT, ls=styles[c], label=name)
        curves.fill_between(
            table.order, signal - spread, signal + spread, color=colour, alpha=0.2, lw=0
        )
    curves.axvline(calibration.highest, color=GREY, ls="--", lw=LINE_PT, label=_SEEN)
    style_axes(curves, z_label="signal (1 = full light)")


def _draw_strip(strip: Axes, calibration: ColourCalibration) -> None:
    """The colours over the order."""
    table = calibration.colour_table
    shown = np.clip(table.signal / table.signal.max(), 0.0, 1.0) ** (1.0 / 2.2)
    strip.imshow(shown[None], aspect="auto", extent=(0.0, table.highest, 0.0, 1.0))
    strip.set_yticks([])
    style_axes(strip, x_label=_order_label(calibration))
