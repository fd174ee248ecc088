"""A calibration on disk: calibration.json, its figure, and where it came from."""

from __future__ import annotations

from pathlib import Path

from isochrome.calibration.colour.api import ColourCalibration
from isochrome.calibration.colour.folder import write_colours
from isochrome.calibration.result import Calibration
from isochrome.output import provenance, staged, write_figure, write_json


def save_calibration(
    calibration: Calibration | ColourCalibration,
    out: str | Path,
    *,
    source: str | Path | None = None,
) -> None:
    """Write calibration.json, calibration.png and provenance.json, all or none.

    Of colours also colour_table.csv and, where background and illumination were found,
    background.tif and illumination.tif, to be named as a scene's no-load frames for frames of the
    same camera, light and place.

    Parameters
    ----------
    calibration : Calibration or ColourCalibration
        The calibration.
    out : str or Path
        The folder.
    source : str or Path, optional
        The calibration set, for its hash.

    Raises
    ------
    InputError
        Where the folder cannot be written.
    """
    with staged(out) as folder:
        write_json(folder / "calibration.json", calibration.to_json())
        inputs = [] if source is None else [Path(source)]
        write_json(folder / "provenance.json", provenance(None, inputs))
        write_figure(folder / "calibration.png", calibration.figure())
        if isinstance(calibration, ColourCalibration):
            write_colours(calibration, folder)
