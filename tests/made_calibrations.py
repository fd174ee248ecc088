"""Calibrations whose pages, figures and tables are looked at in several rooms."""

from pathlib import Path
from typing import Any

import numpy as np

from calibration.target_pictures import Shown, dots
from isochrome.calibration import ColourCalibration
from isochrome.fringes import ColourTable
from isochrome.output import write_tiff


def dots_in(picture: Path) -> dict[str, Any]:
    """Write a target's picture; what a user says of the target."""
    shown = Shown()
    write_tiff(picture, dots(shown)[None])
    return {"target": "dots", "columns": shown.columns, "rows": shown.rows,
            "spacing_mm": shown.spacing_mm}  # fmt: skip


def three_colours(**more: Any) -> ColourCalibration:
    """A table of colours up to an order of 1.5, by formula."""
    order = 0.01 * np.arange(151)
    signal = np.sin(np.pi * order[:, None] * [0.9, 1.0, 1.2]) ** 2
    stated = {"way": "own colours", "gamma": 2.2, "wavelength_nm": 540.0, "residual": 0.01,
              "strange": 0.001, "highest": 1.5, "bit_depth": 8}  # fmt: skip
    return ColourCalibration(colour_table=ColourTable(signal, np.full(3, 0.01)), **stated | more)
