"""A calibration on disk: its JSON, its figure, and where it came from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from isochrome.calibration.colour.api import ColourCalibration
from isochrome.calibration.colour.folder import write_colours
from isochrome.calibration.result import Calibration
from isochrome.calibration.scale.result import ScaleCalibration
from isochrome.calibration.wear.result import WearCalibration
from isochrome.output import provenance, staged, write_figure, write_json


def save_calibration(
    calibration: Calibration | ColourCalibration | ScaleCalibration | WearCalibration,
    out: str | Path,
    *,
    source: str | Path | Sequence[str | Path] | None = None,
) -> None:
    """Write calibration.json, calibration.png and provenance.json, all or none.

    Of a scale the first two are scale.json and scale.png.

    Of colours also colour_table.csv and, where background and illumination were found,
    background.tif and illumination.tif, to be named as a scene's no-load frames for frames of the
    same camera, light and place.

    Parameters
    ----------
    calibration : Calibration, ColourCalibration, ScaleCalibration or WearCalibration
        The calibration.
    out : str or Path
        The folder.
    source : str, Path or sequence of them, optional
        The calibration set, or a scale's images, for their hashes.

    Raises
    ------
    InputError
        Where the folder cannot be written.
    """
    name = "scale" if isinstance(calibration, ScaleCalibration) else "calibration"
    inputs = [source] if isinstance(source, str | Path) else list(source or ())
    with staged(out) as folder:
        write_json(folder / f"{name}.json", calibration.to_json())
        write_json(folder / "provenance.json", provenance(None, inputs))
        write_figure(folder / f"{name}.png", calibration.figure())
        if isinstance(calibration, ColourCalibration):
            write_colours(calibration, folder)
