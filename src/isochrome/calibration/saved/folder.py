"""A calibration on disk: its JSON, its tables, its figure, and where it came from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from os.path import isfile
from pathlib import Path
from typing import Any

from isochrome.calibration.colour.api import ColourCalibration
from isochrome.calibration.colour.folder import write_colours
from isochrome.calibration.result import CUTS, Calibration
from isochrome.calibration.saved.calibration_report import calibration_report
from isochrome.calibration.saved.scene_file import calibration_day
from isochrome.calibration.scale.result import ScaleCalibration
from isochrome.calibration.wear.result import WearCalibration, trace_json
from isochrome.output import columns_of, provenance, staged, write_csv, write_figure, write_json
from isochrome.reporting import write_report
from isochrome.runs import REPORT, environment, seal
from isochrome.scene import parse_toml, read_text

AnyCalibration = Calibration | ColourCalibration | ScaleCalibration | WearCalibration


def save_calibration(
    calibration: AnyCalibration,
    out: str | Path,
    *,
    source: str | Path | Sequence[str | Path] | None = None,
) -> None:
    """Write calibration.json, calibration.png, provenance.json and report.html, all or none.

    Of a scale scale.json, scale.png. Tables: images.csv (beam, disc), scale.csv, distances.csv and
    traces.csv (wear), and budget.csv; of colours colour_table.csv and, where found, background.tif
    and illumination.tif, no-load frames for the same camera, light and place. `source`: set or
    images, for the hashes of all their files; the set's text is kept too.
    """
    name = "scale" if isinstance(calibration, ScaleCalibration) else "calibration"
    inputs = [source] if isinstance(source, str | Path) else list(source or ())
    with staged(out) as folder:
        write_json(folder / f"{name}.json", calibration.to_json())
        files = [file for given in inputs for file in (given, *_named_files(Path(given)))]
        record = provenance(None, files) | environment() | _origin(calibration, inputs)
        write_figure(folder / f"{name}.png", calibration.figure())
        if isinstance(calibration, ColourCalibration):
            write_colours(calibration, folder)
        else:
            for table, columns in _tables(calibration).items():
                write_csv(folder / table, columns)
        write_report(folder / REPORT, calibration_report(folder, name, record))
        seal(folder, record)


def _tables(
    calibration: Calibration | ScaleCalibration | WearCalibration,
) -> dict[str, dict[str, list[Any]]]:
    """A calibration's tables by the names of their files."""
    if isinstance(calibration, Calibration):
        tables = {"images.csv": calibration.columns}
    elif isinstance(calibration, ScaleCalibration):
        tables = {"scale.csv": calibration.columns}
    else:
        tables = {"distances.csv": calibration.columns}
        found = [trace_json(scar) for scar in calibration.traces]
        traces = [row | {"is_clear": int(row["is_clear"])} for row in found]
        if traces:  # a set may state worn volumes alone
            tables["traces.csv"] = columns_of(traces)
    return tables | {"budget.csv": calibration.budget_columns}


def _named_files(settings: Path) -> list[Path]:
    """The files that a set names: its images, traces and no-load frames; none of an image."""
    if settings.suffix != ".toml":
        return []
    texts = dict.fromkeys(_texts(parse_toml(read_text(settings), str(settings))))
    return [Path(file) for text in texts if isfile(file := settings.parent / text)]


def _texts(value: Any) -> Iterator[str]:
    """All texts in what a TOML file holds."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list):
        for own in value.values() if isinstance(value, Mapping) else value:
            yield from _texts(own)


def _origin(calibration: AnyCalibration, inputs: Sequence[str | Path]) -> dict[str, Any]:
    """What made a calibration, when, and of which settings."""
    if isinstance(calibration, Calibration):
        kind = CUTS[calibration.specimen].command
    else:
        kinds = {ColourCalibration: "colour", ScaleCalibration: "scale", WearCalibration: "wear"}
        kind = kinds[type(calibration)]
    texts = [read_text(Path(place)) for place in inputs if Path(place).suffix == ".toml"]
    return {
        "command": f"calibrate {kind}",
        "title": calibration.title,
        "date": calibration_day(),
        "settings": "\n".join(texts) or None,
    }
