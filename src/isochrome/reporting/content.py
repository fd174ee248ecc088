"""What a report says, whatever run it is of.

What a paper states of a measurement: camera, light, specimen, software, input.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any, Protocol

from isochrome.guide import explain_message
from isochrome.output import to_last_digit, with_uncertainty
from isochrome.reporting.charts import Curve
from isochrome.reporting.pictures import ReportFrame
from isochrome.scene import Camera, Frames, Polariscope, Scene

_MOST_ROWS = 60
"""Rows of a table in a report: the run's own file has all of them."""

_SPREAD = "standard_uncertainty"

_MOST_MESSAGES = 30
"""Of a group of warnings: each frame of a long run may have one of its own."""


@dataclass(frozen=True)
class ReportTable:
    """A table of a report; its columns' names have the unit."""

    caption: str  # what it holds, and in which file all of it is
    columns: Mapping[str, Sequence[Any]]

    @property
    def rows(self) -> list[tuple[tuple[str, bool], ...]]:
        """The first rows: each value as text, and whether it is a number, which is not broken."""
        cells = (
            [(text, isinstance(v, int | float)) for text, v in zip(texts, values, strict=False)]
            for name, values in self.columns.items()
            for texts in [self._texts(name)]
        )
        return list(zip(*cells, strict=True))

    def _texts(self, name: str) -> list[str]:
        """The first cells of a column: a ± with two digits, a value to the last of its own."""
        values = self.columns[name][:_MOST_ROWS]
        own = _SPREAD if name == "value" else f"{name} {_SPREAD}"
        spreads = self.columns.get(own, [None] * len(values))
        digits = 2 if name.endswith(("uncertainty", "bound")) else 5
        return [_text(*pair, digits) for pair in zip(values, spreads, strict=False)]

    @property
    def left_out(self) -> int:
        """How many rows are left to the run's own file."""
        return max(0, max(map(len, self.columns.values()), default=0) - _MOST_ROWS)


@dataclass(frozen=True, kw_only=True)
class ReportContent:
    """All that a report says of a run."""

    command: str  # what made the run, such as 'process'
    title: str  # what the run is of
    verdict: str  # what was found, in a sentence
    frames: Sequence[ReportFrame] = ()
    choice: str = ""  # which frames of how many, and why
    curves: Sequence[Curve] = ()
    budget: ReportTable | None = None  # shares of the uncertainty; None: the run has none
    no_budget: str = ""  # why there is none, and what to do
    tables: Sequence[ReportTable] = ()
    # what the frames asked for besides the scene; None: nobody asked
    causes: Sequence[str] | None = None
    causes_text: str = ""  # what to say where there is no such list
    refined: Sequence[str] = ()  # what the frames know better than the scene states it
    # keys of measured numbers whose uncertainty is not in the ±
    taken_as_exact: Sequence[str] = ()
    warnings: Sequence[str] = ()
    scene: str = ""  # resolved, TOML, or a calibration's settings
    scene_title: str = "Scene"
    paper: Sequence[tuple[str, str]] = ()  # names and values of what a paper states
    picture: bytes | None = None  # the run's own figure, PNG


def warnings_with_remedies(warnings: Iterable[str]) -> list[dict[str, Any]]:
    """Group warnings by what they are about, each group with its meaning, cause and remedy.

    Dicts of 'title', 'meaning', 'cause' and 'remedy', empty for what the guide does not explain;
    'messages', the first ones in their order; and 'left_out', how many more there are.
    """
    groups: dict[str, dict[str, Any]] = {}
    for text in warnings:
        entry = explain_message(text)
        title = entry.title if entry else "Other"
        words = {
            name: getattr(entry, name) if entry else "" for name in ("meaning", "cause", "remedy")
        }
        group = groups.setdefault(title, {"title": title, **words, "messages": [], "left_out": 0})
        if len(group["messages"]) < _MOST_MESSAGES:
            group["messages"].append(text)
        else:
            group["left_out"] += 1
    return list(groups.values())


def _text(value: Any, spread: Any, digits: int) -> str:
    if value is None or value != value:
        return "not known"
    if not isinstance(value, float):
        return str(value)
    return to_last_digit(value, spread) if spread else f"{value:.{digits}g}"


_MEASURED = (
    ("pixel", "camera.pixel_mm", "mm"),
    ("fringe value f_sigma", "specimen.fringe_value_n_per_mm", "N/mm per fringe"),
    ("thickness", "specimen.thickness_mm", "mm"),
    ("Young's modulus", "specimen.young_gpa", "GPa"),
    ("Poisson's ratio", "specimen.poisson", ""),
    ("diameter", "specimen.diameter_mm", "mm"),
    ("indenter's radius", "indenter.radius_mm", "mm"),
)
"""Names, keys and units of the measured numbers that a paper states."""

_MOST_FILES = 16
"""Of the input, with their hashes: a run may be of thousands of single pictures."""

NO_DATE = (
    "not stated in the scene, where calibrate --into writes it; else it stands in the report of "
    "the calibration"
)


class WithCamera(Protocol):
    """A scene, or a calibration's set: what stood in front of the camera."""

    @property
    def camera(self) -> Camera | None:
        """The camera."""

    @property
    def polariscope(self) -> Polariscope:
        """The light."""

    @property
    def frames(self) -> Frames:
        """How its frames are read."""


def camera_rows(found: WithCamera) -> list[tuple[str, str]]:
    """Names and values, with units, of what a paper states of the camera and the light."""
    return [*_camera(found), *_light(found)]


def paper_rows(scene: Scene | None, record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Names and values, with units, of what a paper states of a run.

    `record` is provenance.json: versions and hashes; the scene is None where the run has none.
    """
    own = [] if scene is None else [*camera_rows(scene), *_numbers(scene)]
    return [*own, *_software(record), *_input(record)]


def _camera(scene: WithCamera) -> Iterator[tuple[str, str]]:
    camera = scene.camera
    if camera is None:
        return
    parts = []
    if camera.width_px and camera.height_px:
        parts.append(f"{camera.width_px} x {camera.height_px} pixels")
    if camera.bit_depth:
        parts.append(f"{camera.bit_depth} bit")
    parts += ["colour"] if camera.colour else []
    parts.append(f"gamma {scene.frames.gamma}")
    yield "camera", ", ".join(parts)


def _light(scene: WithCamera) -> Iterator[tuple[str, str]]:
    light = scene.polariscope
    field = f"{len(light.step)} phase steps" if light.step else f"{light.field} field"
    if light.several_wavelengths:
        yield "light", f"several wavelengths, {field}"
    elif light.wavelength_nm is None:
        yield "light", f"wavelength not stated, {field}"
    else:
        band = f", band {light.bandwidth_nm:g} nm" if light.bandwidth_nm else ""
        yield "light", f"{light.wavelength_nm:g} nm{band}, {field}"


def _numbers(scene: Scene) -> Iterator[tuple[str, str]]:
    stated = dict(scene.stated_uncertainty)
    for name, key, unit in _MEASURED:
        part = getattr(scene, key.partition(".")[0])
        value = None if part is None else getattr(part, key.partition(".")[2], None)
        if value is None:
            continue
        spread = stated.get(key)
        text = f"{value:g}" if spread is None else with_uncertainty(value, spread)
        own = "no uncertainty stated" if spread is None else "standard uncertainty"
        yield name, f"{text} {unit}".strip() + f" ({own})"
        if name.startswith("fringe value"):
            yield "date of f_sigma", scene.fringe_value_date or NO_DATE


def _software(record: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    libraries = record.get("libraries") or {}
    versions = ", ".join(f"{name} {number}" for name, number in libraries.items())
    code = record.get("code_sha256")
    yield "software", f"isochrome {record.get('isochrome', 'not known')}"
    if versions:
        yield "with", versions
    if code:
        yield "SHA-256 of the code", str(code)


def _input(record: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    files = list((record.get("inputs_sha256") or {}).items())
    for name, digest in files[:_MOST_FILES]:
        yield f"SHA-256 of {PurePath(*PurePath(name).parts[-2:])}", str(digest)
    if len(files) > _MOST_FILES:
        yield f"SHA-256 of {len(files) - _MOST_FILES} files more", "in provenance.json"
