"""The report as one HTML page: nothing is fetched, and nothing of a run is ever code in it."""

from __future__ import annotations

import base64
import hashlib
import io
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from itertools import chain
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome import figures
from isochrome.errors import InputError
from isochrome.guide import atlas_picture
from isochrome.messages import entry_of
from isochrome.output import FittedResult, to_last_digit, with_uncertainty, write_text
from isochrome.scene import Camera, Frames, Polariscope, Scene, dump_scene

if TYPE_CHECKING:
    from jinja2 import Template
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

MOST_FRAMES = 8
"""Frames in a report or figure: of a usual picture so many are shown pixel by pixel in 10 MB."""


def choose_frames(chi: ArrayLike, order: ArrayLike) -> dict[int, str]:
    """The frames that a report shows, and why, by chi and largest order, which may be NaN."""
    worst, largest = np.asarray(chi, float), np.asarray(order, float)
    count = len(worst)
    if count <= MOST_FRAMES:
        return dict.fromkeys(range(count), "")
    why = {0: "the first", count - 1: "the last"}
    for values, reason in ((worst, "the largest chi"), (largest, "the largest order")):
        if np.isfinite(values).any():
            why.setdefault(int(np.nanargmax(values)), reason)
    between = np.linspace(0, count - 1, MOST_FRAMES - len(why) + 2)[1:-1]
    for place in between:  # one that is taken gives way to the next
        number = next((k for k in range(round(place), count) if k not in why), None)
        if number is not None:
            why[number] = "evenly spaced"
    return dict(sorted(why.items()))


Array = NDArray[Any]

FINE_STEP, STEP = 0.001, 0.01
"""Fringes: orders in a report are rounded to the first, or the second where that lacks room."""

ROOM_BYTES = 8_000_000
"""Text for the run's own figure and all frames, of the 10 MB that a report has at most."""

_LARGEST = np.iinfo(np.uint16).max
"""Steps that 16 bits hold; orders hundreds of fringes above the smallest are given as not known."""

_LEAST_BYTES = 0.4
"""Bytes a pixel of a frame, of which no camera's frame takes less: nothing finer is tried."""

_LEVELS = 64
"""Of a picture: more are not told apart on paper."""

FRINGES, SIGNAL, GREY_LEVELS = "fringes", "of the full light", "grey levels"
"""Units of what a pane shows."""


@dataclass(frozen=True)
class Pane:
    """One picture (row, col) of a frame; NaN = not known."""

    key: str  # 'experiment', 'simulation', 'rendered', 'order', 'isoclinic' or 'difference'
    label: str  # what the page calls it
    values: Array
    span: tuple[float, float]  # what is shown black and white, or in the end colours
    unit: str  # FRINGES, SIGNAL or GREY_LEVELS

    @property
    def colours(self) -> str:
        """Its colour map."""
        maps = {
            "difference": figures.DIFFERENCE_MAP,
            "order": figures.VALUE_MAP,
            "isoclinic": figures.PAPER_DIRECTION_MAP,
        }
        return maps.get(self.key, figures.FRAME_MAP)

    def draw(self, axes: Axes, place: figures.Place, title: str = "") -> AxesImage:
        """Draw it at its place."""
        low, high = self.span
        look: dict[str, Any] = {"cmap": self.colours, "title": title}
        return figures.show_image(axes, self.values, vmin=low, vmax=high, **look, **place)


@dataclass(frozen=True, kw_only=True)
class ReportFrame:
    """A frame as a report shows it."""

    number: int  # in the run
    label: str  # what figures call it
    why: str  # it is shown
    panes: tuple[Pane, ...]  # the first, the experiment where there is one, lies over the others
    order: Array | None = None  # read, fringes, NaN = not known; None: none is read
    model_order: Array | None = None  # of the simulation
    pixel_mm: float | None = None  # None: no scale is known
    left_mm: float = 0.0  # outer edges of the first column and row
    top_mm: float = 0.0
    notes: tuple[str, ...] = ()  # what to say of it, such as why it has no simulation
    # of the atlas that its residual looks like most: names, and the share that each explains
    pages: tuple[tuple[str, str], ...] = ()


_AS_IT_IS = ("number", "label", "why", "notes", "pixel_mm", "left_mm", "top_mm", "pages")
"""Of a frame what the page takes unchanged."""


def encode_frames(frames: Sequence[ReportFrame], *, room: int = ROOM_BYTES) -> list[dict[str, Any]]:
    """Frames as the page takes them, in `room` bytes: of each n-th pixel of each n-th row where all
    would take too much."""
    result: list[dict[str, Any]] = []
    for done, frame in enumerate(frames):
        share = (room - sum(map(_size, result))) // (len(frames) - done)
        shape = frame.panes[0].values.shape
        stride = max(1, int(np.sqrt(_LEAST_BYTES * np.prod(shape) / share)))
        # within what whole numbers of the fine step hold
        maps = (order for order in (frame.order, frame.model_order) if order is not None)
        known = (order[np.isfinite(order)] for order in maps)
        holds = all(np.ptp(one) < FINE_STEP * (_LARGEST - 1) for one in known if one.size)
        coarser = ((n, STEP) for n in range(stride, 1 + max(stride, min(shape))))
        for tried in chain([(stride, FINE_STEP)] if holds else (), coarser):
            encoded = _encoded(frame, *tried)
            if _size(encoded) <= share:
                break
        result.append(encoded)
    return result


def _size(encoded: dict[str, Any]) -> int:
    maps = (encoded[name] for name in ("order", "model_order") if encoded[name])
    return sum(len(p["png"]) for p in encoded["panes"]) + sum(len(m["data"]) for m in maps)


def _encoded(frame: ReportFrame, stride: int, step: float) -> dict[str, Any]:
    """A frame as the page takes it: means over `stride` pixels, and orders in their middle."""
    rows, cols = (size // stride for size in frame.panes[0].values.shape)
    squares, first = (rows, stride, cols, stride), stride // 2
    part = tuple(slice(first, first + stride * size, stride) for size in (rows, cols))
    panes = []
    for pane in frame.panes:
        mean = pane.values[: rows * stride, : cols * stride].reshape(squares).mean(axis=(1, 3))
        panes.append({
            "key": pane.key, "label": pane.label, "span": pane.span, "unit": pane.unit,
            "png": _png(pane, mean),
            "bar": _png(pane, np.linspace(*pane.span, _LEVELS)[None]),  # from end to end
        })  # fmt: skip
    return {name: getattr(frame, name) for name in _AS_IT_IS} | {
        "rows": rows, "cols": cols, "stride": stride, "first": first, "panes": panes,
        **{
            name: None if order is None else order_map(order[part], step)
            for name, order in (("order", frame.order), ("model_order", frame.model_order))
        },
    }  # fmt: skip


def order_map(order: Array, step: float = STEP) -> dict[str, Any]:
    """Fringe orders (row, col) as text, each within half a step: base64 of zlib of N/step - first +
    1 in 16 bits, 0 = not known, each less the one to its left, first all low bytes and then all
    high ones."""
    known = np.isfinite(order)
    steps = np.rint(np.where(known, order, 0.0).astype(float) / step).astype(np.int64)
    first = int(steps[known].min()) if known.any() else 0
    level = np.where(known & (steps - first < _LARGEST), steps - first + 1, 0)
    moved = np.diff(level, axis=1, prepend=0) % 65536
    low, high = (moved % 256).astype(np.uint8), (moved // 256).astype(np.uint8)
    data = zlib.compress(low.tobytes() + high.tobytes(), 6)
    return {"data": base64.b64encode(data).decode(), "first": first, "step": step}


def _png(pane: Pane, values: Array) -> str:
    """A picture as base64 of a PNG with a palette; what is not known is transparent."""
    from matplotlib import colormaps
    from PIL import Image

    low, high = pane.span
    level = np.rint(np.nan_to_num((values - low) / ((high - low) or 1.0), nan=0.0) * (_LEVELS - 1))
    level = np.where(np.isfinite(values), np.clip(level, 0, _LEVELS - 1), _LEVELS).astype(np.uint8)
    picture = Image.fromarray(level, "P")
    colours = colormaps[pane.colours](np.linspace(0.0, 1.0, _LEVELS))[:, :3]
    palette = np.rint(255 * np.vstack([colours, [1.0, 1.0, 1.0]])).astype(np.uint8)
    picture.putpalette(bytes(palette))
    file = io.BytesIO()
    picture.save(file, "PNG", transparency=_LEVELS, compress_level=5)
    return base64.b64encode(file.getvalue()).decode()


_MOST = 60
"""Rows of a table, warnings of a group, hashes of files: the run's own files have all of them."""

_SPREAD = "standard_uncertainty"


@dataclass(frozen=True)
class ReportTable:
    """A table of a report; its columns' names have the unit."""

    caption: str  # what it holds, and in which file all of it is
    columns: Mapping[str, Sequence[Any]]

    @property
    def rows(self) -> list[tuple[tuple[str, bool], ...]]:
        """The first rows: each value to its ±'s last digit, and whether it is a number."""
        columns = []
        for name, values in self.columns.items():
            column = _SPREAD if name == "value" else f"{name} {_SPREAD}"
            spreads = self.columns.get(column, [None] * len(values))
            digits = 2 if name.endswith(("uncertainty", "bound")) else 5
            pairs = zip(values[:_MOST], spreads, strict=False)
            columns.append([(_text(v, u, digits), isinstance(v, int | float)) for v, u in pairs])
        return list(zip(*columns, strict=True))

    @property
    def left_out(self) -> int:
        """How many rows are left to the run's own file."""
        return max(0, max(map(len, self.columns.values()), default=0) - _MOST)


@dataclass(frozen=True, kw_only=True)
class ReportContent:
    """All that a report says of a run."""

    command: str  # what made the run, such as 'process'
    title: str  # what the run is of
    verdict: str  # what was found, in a sentence
    frames: Sequence[ReportFrame] = ()
    choice: str = ""  # which frames of how many, and why
    curves: Sequence[figures.Plot] = ()  # of values over distance or frames
    budget: ReportTable | None = None  # shares of the uncertainty; None: the run has none
    no_budget: str = ""  # why there is none, and what to do
    tables: Sequence[ReportTable] = ()
    # what the frames asked for besides the scene; None: nobody asked
    causes: Sequence[str] | None = None
    causes_text: str = ""  # what to say where there is no such list
    pages: Sequence[str] = ()  # of the atlas, by the names of the causes
    refined: Sequence[str] = ()  # what the frames know better than the scene states it
    # keys of measured numbers whose uncertainty is not in the ±
    taken_as_exact: Sequence[str] = ()
    warnings: Sequence[str] = ()
    scene: str = ""  # resolved, TOML, or a calibration's settings
    scene_title: str = "Scene"
    paper: Sequence[tuple[str, str]] = ()  # names and values of what a paper states
    picture: bytes | None = None  # the run's own figure, PNG


def fitted_report(
    result: FittedResult, record: Mapping[str, Any], verdict: str, goodness: str, **parts: Any
) -> ReportContent:
    """The report of fitted frames; `record`, provenance.json; `verdict`, `goodness`: sentences."""
    return ReportContent(
        title=result.title, verdict=f"{verdict[:1].upper()}{verdict[1:]}. {goodness}",
        curves=figures.values_plots(result.over_frames), taken_as_exact=result.taken_as_exact,
        warnings=result.warnings, scene=dump_scene(result.scene),
        paper=paper_rows(result.scene, record), **parts,
    )  # fmt: skip


def warnings_with_remedies(warnings: Iterable[str]) -> list[dict[str, Any]]:
    """Warnings by what they are about, and how many are left out."""
    groups: dict[str, dict[str, Any]] = {}
    for text in warnings:
        entry = entry_of(text)
        title = entry.title if entry else "Other"
        words = {name: getattr(entry, name, "") for name in ("meaning", "cause", "remedy")}
        group = groups.setdefault(title, {"title": title, **words, "messages": [], "left_out": 0})
        if len(group["messages"]) < _MOST:
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

NO_DATE = (
    "not stated in the scene, where calibrate --into writes it; else it stands in the report of "
    "the calibration"
)


def camera_rows(camera: Camera | None, light: Polariscope, frames: Frames) -> list[tuple[str, str]]:
    """Names and values, with units, of what a paper states of the camera and the light."""
    rows = list[tuple[str, str]]()
    if camera is not None:
        parts = []
        if camera.width_px and camera.height_px:
            parts.append(f"{camera.width_px} x {camera.height_px} pixels")
        if camera.bit_depth:
            parts.append(f"{camera.bit_depth} bit")
        parts += ["colour"] if camera.colour else []
        rows.append(("camera", ", ".join([*parts, f"gamma {frames.gamma}"])))
    what = "several wavelengths"
    if not light.several_wavelengths:
        band = f", band {light.bandwidth_nm:g} nm" if light.bandwidth_nm else ""
        nm = light.wavelength_nm
        what = "wavelength not stated" if nm is None else f"{nm:g} nm{band}"
    field = f"{len(light.step)} phase steps" if light.step else f"{light.field} field"
    return [*rows, ("light", f"{what}, {field}")]


def paper_rows(scene: Scene | None, record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Names and values, with units, of what a paper states of a run; `record`, provenance.json."""
    result = list[tuple[str, str]]()
    if scene is not None:
        result += camera_rows(scene.camera, scene.polariscope, scene.frames)
        stated = dict(scene.stated_uncertainty)
        for name, key, unit in _MEASURED:
            table, _, field = key.partition(".")
            if (value := getattr(getattr(scene, table), field, None)) is not None:
                result.append((name, stated_text(value, stated.get(key), unit)))
            if value is not None and field == "fringe_value_n_per_mm":
                result.append(("date of f_sigma", scene.fringe_value_date or NO_DATE))
    libraries = record.get("libraries") or {}
    versions = ", ".join(f"{name} {number}" for name, number in libraries.items())
    code = record.get("code_sha256")
    result.append(("software", f"isochrome {record.get('isochrome', 'not known')}"))
    result += [("with", versions)] if versions else []
    result += [("SHA-256 of the code", str(code))] if code else []
    files = list((record.get("inputs_sha256") or {}).items())
    for name, digest in files[:_MOST]:
        result.append((f"SHA-256 of {PurePath(*PurePath(name).parts[-2:])}", str(digest)))
    if len(files) > _MOST:
        result.append((f"SHA-256 of {len(files) - _MOST} files more", "in provenance.json"))
    return result


def stated_text(value: float, spread: float | None, unit: str) -> str:
    """A measured number as a scene or set states it, with its unit and what its ± is."""
    text = f"{value:g}" if spread is None else with_uncertainty(value, spread)
    basis = "no uncertainty stated" if spread is None else "standard uncertainty"
    return f"{text} {unit}".strip() + f" ({basis})"


_INCHES = 4.0, 2.3
"""Of a drawing, whose letters are then those of a page where a telephone shows it."""

_SVG: Any = {"svg.fonttype": "path", "svg.hashsalt": "isochrome", "text.parse_math": False}
"""The same drawing on every machine and each time; a `$` in a name is no formula."""


def drawn_chart(plot: figures.Plot) -> dict[str, Any] | None:
    """A plot as the page takes it, None without two points: numbers, and a drawing as base64 of a
    picture of its own, as the page's policy forbids its styles."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG  # `savefig` lays out twice

    content = io.BytesIO()
    with rc_context(_SVG):
        figure = figures.new_figure(*_INCHES)
        axes = figure.subplots()
        plot.draw(axes)
        columns = figures.curve_columns(axes)
        across, *names = columns or ("", "")
        if not columns or np.isfinite(columns[names[0]]).sum() < 2:
            return None
        axes.ticklabel_format(useOffset=False)
        axes.locator_params(nbins=5)  # numbers of a long run have room beside each other
        axes.grid(color=figures.PALE, alpha=0.5, lw=figures.FINE_PT)
        axes.set_axisbelow(True)
        axes.set(ylabel="", title="")
        axes.set_title("", loc="left")
        canvas: Any = FigureCanvasSVG(figure)
        canvas.print_svg(content, metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return {
        "label": plot.title, "across": across, "names": list(columns),
        "rows": [["" if v != v else f"{v:.6g}" for v in row] for row in rows],
        "svg": base64.b64encode(content.getvalue()).decode(),
    }  # fmt: skip


def assemble_page(
    room: str, name: str, *, scripts: Sequence[str], policy: str, values: dict[str, Any]
) -> str:
    """A page of a room's NAME.html.jinja, NAME.css and scripts, in which every value is escaped."""
    from markupsafe import Markup

    template, style, script = _page_parts(room, name, tuple(scripts))
    # hashes are of the plain letters of base64
    rules = Markup(content_policy(room, name, scripts=scripts, policy=policy))
    return template.render(policy=rules, style=Markup(style), script=Markup(script), **values)


def content_policy(room: str, name: str, *, scripts: Sequence[str], policy: str) -> str:
    """A page's one style and script by their hashes, and what else a `policy` allows, such as
    "img-src data:". Source: W3C (2024), Content Security Policy Level 3, section 2.3.1."""
    _, *texts = _page_parts(room, name, tuple(scripts))
    digests = (hashlib.sha256(text.encode()).digest() for text in texts)
    style, script = (f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
    return (
        f"default-src 'none'; {policy}; style-src {style}; script-src {script}; "
        "base-uri 'none'; form-action 'none'"
    )


@cache
def _page_parts(room: str, name: str, scripts: tuple[str, ...]) -> tuple[Template, str, str]:
    from jinja2 import Environment, StrictUndefined

    files = (f"{name}.html.jinja", f"{name}.css", *scripts)
    text, style, *parts = ((resources.files(room) / file).read_text("utf-8") for file in files)
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(text), style, "\n".join(parts)


MOST_BYTES = 10_000_000
"""Of a report, whatever the run's length."""

_LONGEST_SCENE = 300_000
"""Letters: a scene may hold a measured course of a hundred thousand rows."""


def write_report(path: str | Path, content: ReportContent) -> Path:
    """Write a report, whole or not at all; InputError where it cannot be, or is over 10 MB."""
    text = report_html(content)
    size = len(text.encode())
    if size > MOST_BYTES:
        raise InputError(
            "report_would_take_mb", path=path, size=size / 1e6, most_bytes=MOST_BYTES / 1e6
        )
    write_text(path, text)
    return Path(path)


def atlas_pictures(content: ReportContent) -> dict[str, str]:
    """Pictures of the atlas that a report shows, base64 of PNG, by the names of their pages."""
    names = {*content.pages, *(name for frame in content.frames for name, _ in frame.pages)}
    pictures = {name: atlas_picture(name) for name in sorted(names)}
    return {name: base64.b64encode(png).decode() for name, png in pictures.items() if png}


def report_html(content: ReportContent) -> str:
    """The page of a report, which asks no address."""
    picture = _picture(content.picture, ROOM_BYTES // 2)
    frames = encode_frames(content.frames, room=ROOM_BYTES - len(picture))
    maps = (one[name] for one in frames for name in ("order", "model_order") if one[name])
    for_script = [  # its pictures stand in the page
        one | {"panes": [{"key": p["key"], "label": p["label"]} for p in one["panes"]]}
        for one in frames
    ]
    return assemble_page(
        "isochrome.reporting",
        "report",
        scripts=("report.js",),
        policy="img-src data:",
        values={
            "content": content,
            "frames": frames,
            "data": {"frames": for_script},
            "strides": sorted({one["stride"] for one in frames}),
            "steps": sorted({one["step"] for one in maps}),  # that orders are rounded to
            "atlas": atlas_pictures(content),
            "charts": [chart for plot in content.curves if (chart := drawn_chart(plot))],
            "groups": warnings_with_remedies(content.warnings),
            "picture": picture,
            "scene": content.scene[:_LONGEST_SCENE],
            "scene_is_cut": len(content.scene) > _LONGEST_SCENE,
        },
    )


def _picture(png: bytes | None, room: int) -> str:
    """A PNG as base64; packed tighter, and only then made smaller, where it takes too much room."""
    if png is None:
        return ""
    packed, part = png, 1
    while len(packed) * 4 // 3 > room:
        from PIL import Image

        file = io.BytesIO()
        picture: Any = Image.open(io.BytesIO(png))
        if part > 1:
            size = picture.width // part, picture.height // part
            picture = picture.convert("RGB").resize(size).quantize(128)
        picture.save(file, "PNG")  # a run's own is written in a third of this time
        packed, part = file.getvalue(), 2 * part
    return base64.b64encode(packed).decode()
