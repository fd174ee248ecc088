"""What a report says, whatever run it is of: sentences, tables, curves, and what a paper states."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from isochrome.figures import (
    BAND,
    FINE_PT,
    KEY_LABELS,
    LINE_COLOURS,
    LINE_PT,
    PALE,
    frame_axis,
    new_figure,
    style_axes,
)
from isochrome.messages import entry_of
from isochrome.output import FrameValues, to_last_digit, with_uncertainty
from isochrome.reporting.pictures import ReportFrame
from isochrome.scene import Camera, Frames, Polariscope, Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
        return list(zip(*map(self._cells, self.columns), strict=True))

    def _cells(self, name: str) -> list[tuple[str, bool]]:
        """The first cells of a column: a ± with two digits, a value to the last of its own."""
        values = self.columns[name][:_MOST_ROWS]
        own = _SPREAD if name == "value" else f"{name} {_SPREAD}"
        spreads = self.columns.get(own, [None] * len(values))
        digits = 2 if name.endswith(("uncertainty", "bound")) else 5
        pairs = zip(values, spreads, strict=False)
        return [(_text(v, spread, digits), isinstance(v, int | float)) for v, spread in pairs]

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
        entry = entry_of(text)
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
    result = [] if scene is None else [*camera_rows(scene), *_numbers(scene)]
    libraries = record.get("libraries") or {}
    versions = ", ".join(f"{name} {number}" for name, number in libraries.items())
    code = record.get("code_sha256")
    result.append(("software", f"isochrome {record.get('isochrome', 'not known')}"))
    result += [("with", versions)] if versions else []
    result += [("SHA-256 of the code", str(code))] if code else []
    files = list((record.get("inputs_sha256") or {}).items())
    for name, digest in files[:_MOST_FILES]:
        result.append((f"SHA-256 of {PurePath(*PurePath(name).parts[-2:])}", str(digest)))
    if len(files) > _MOST_FILES:
        text = f"SHA-256 of {len(files) - _MOST_FILES} files more"
        result.append((text, "in provenance.json"))
    return result


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
        table, _, field = key.partition(".")
        value = getattr(getattr(scene, table), field, None)
        if value is None:
            continue
        spread = stated.get(key)
        text = f"{value:g}" if spread is None else with_uncertainty(value, spread)
        own = "no uncertainty stated" if spread is None else "standard uncertainty"
        yield name, f"{text} {unit}".strip() + f" ({own})"
        if name.startswith("fringe value"):
            yield "date of f_sigma", scene.fringe_value_date or NO_DATE


Array = NDArray[Any]

MOST_POINTS = 240
"""Points of a curve: more than a drawing has pixels to tell them apart."""

_INCHES = 4.0, 2.3
"""Of a drawing, whose letters are then those of a page where a telephone shows it."""

_SVG: Any = {"svg.fonttype": "path", "svg.hashsalt": "isochrome", "text.parse_math": False}
"""The same drawing on every machine and each time; a `$` in a name is no formula."""

_UNDATED = dict.fromkeys(("Date", "Creator", "Format", "Type"))


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A quantity over distance or frames; each point (n,) is some neighbours together where there
    are many.
    """

    label: str  # name and unit of the quantity
    across: str  # name and unit of the horizontal axis
    place: Array
    value: Array  # their mean
    least: Array  # envelope of the values
    most: Array
    low: Array  # envelope of the bands
    high: Array
    together: int  # how many values are one point, at most
    has_band: bool  # the values have uncertainties

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The points as a table: place, value, least, most, low, high."""
        columns = self.place, self.value, self.least, self.most, self.low, self.high
        return [tuple(f"{value:.6g}" for value in row) for row in zip(*columns, strict=True)]

    def draw(self, axes: Axes) -> None:
        """Draw the line between its envelope and its band; few points have dots."""
        colour = LINE_COLOURS[0]
        axes.fill_between(self.place, self.low, self.high, color=colour, alpha=0.25, lw=0)
        axes.fill_between(self.place, self.least, self.most, color=colour, alpha=0.35, lw=0)
        dot = "o" if len(self.place) <= MOST_POINTS // 6 else ""
        axes.plot(self.place, self.value, color=colour, lw=LINE_PT, marker=dot, ms=4)

    @property
    def svg(self) -> str:
        """The drawing as base64: a picture of its own, as the page's policy forbids its styles."""
        from matplotlib import rc_context

        content = io.BytesIO()
        with rc_context(_SVG):
            figure = new_figure(*_INCHES)
            axes = figure.subplots()
            self.draw(axes)
            axes.ticklabel_format(useOffset=False)
            axes.locator_params(nbins=5)  # numbers of a long run have room beside each other
            axes.grid(color=PALE, alpha=0.5, lw=FINE_PT)
            axes.set_axisbelow(True)
            style_axes(axes, x_label=self.across)
            figure.savefig(content, format="svg", metadata=_UNDATED)
        return base64.b64encode(content.getvalue()).decode()


def curves_of(found: FrameValues) -> list[Curve]:
    """The curves of fitted values, each with its band, and one of chi.

    One for each key that is known in two frames at least; a tracked video's places too.
    """
    place, across = frame_axis(found)
    place = np.where(np.isfinite(place), place, 0.0)  # what stands still has slid by nothing
    columns: list[tuple[str, Array, Array | None]] = [
        (KEY_LABELS.get(key, key), found.values[:, j], found.standard_uncertainty[:, j])
        for j, key in enumerate(found.keys)
    ]
    columns.append(("chi (residual over noise)", found.chi, None))
    return [
        make_curve(label, across, place, values, own)
        for label, values, own in columns
        if np.isfinite(values).sum() > 1
    ]


def make_curve(
    label: str, across: str, place: Array, values: Array, spread: Array | None = None
) -> Curve:
    """A quantity's curve: what is not known is left out, and many are put together.

    At least one value is known; `spread` is their standard uncertainties, None: they have none.
    """
    own = np.zeros(len(values)) if spread is None else spread
    known = np.flatnonzero(np.isfinite(values))
    known = known[np.argsort(place[known], kind="stable")]
    half = BAND * np.where(np.isfinite(own), own, 0.0)
    together = -(-len(known) // MOST_POINTS)
    starts = np.arange(0, len(known), together)
    counts = np.diff([*starts, len(known)])
    return Curve(
        label=label,
        across=across,
        place=np.add.reduceat(place[known], starts) / counts,
        value=np.add.reduceat(values[known], starts) / counts,
        least=np.minimum.reduceat(values[known], starts),
        most=np.maximum.reduceat(values[known], starts),
        low=np.minimum.reduceat((values - half)[known], starts),
        high=np.maximum.reduceat((values + half)[known], starts),
        together=together,
        has_band=spread is not None,
    )
