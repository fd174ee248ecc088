"""A calibration on disk: calibration.json, its figure, and where it came from."""

from __future__ import annotations

from pathlib import Path

from isochrome.calibrate.figure import calibration_figure
from isochrome.calibrate.result import Calibration
from isochrome.output import provenance, staged, write_figure, write_json


def save_calibration(
    calibration: Calibration, out: str | Path, *, source: str | Path | None = None
) -> None:
    """Write calibration.json, calibration.png and provenance.json, all or none.

    Parameters: `calibration`; `out`, the folder; `source`, the calibration set, for its hash.
    Raises InputError where the folder cannot be written.
    """
    with staged(out) as folder:
        write_json(folder / "calibration.json", calibration.to_json())
        inputs = [] if source is None else [Path(source)]
        write_json(folder / "provenance.json", provenance(None, inputs))
        write_figure(folder / "calibration.png", calibration_figure(calibration))
