"""A report made up by hand: two frames of a known field, with names that would be code."""

import base64
import json
import re
import xml.etree.ElementTree as ElementTree
import zlib
from html.parser import HTMLParser
from pathlib import Path

import numpy as np

from isochrome.figures import values_plots
from isochrome.messages import message
from isochrome.output import FrameValues
from isochrome.reporting import FRINGES, SIGNAL, Pane, ReportContent, ReportFrame, ReportTable

ROWS, COLS, PIXEL, LEFT, TOP = 90, 160, 0.02, -1.5, 0.25

HOSTILE = (
    "<script>window.stolen = 1</script>",
    '"\' onerror="window.stolen = 1" \'><img src=x onerror=window.stolen=1>', "abc\u202egnp.exe",
    "</script><script>window.stolen = 1</script>", "</bdi></style><svg onload=window.stolen=1>",
    "{{ 7 * 7 }} {% raw %}", "x" * 300, "<!-- ]]> &lt;b&gt; \u2028 \u0000 end",
)  # fmt: skip
"""Names of files and labels that a stranger might give."""


def order_field(number: int = 0) -> np.ndarray:
    """Fringe order N = 3 r/r_max + frame/10 by a formula of its own; NaN in the first ten rows."""
    row, col = np.mgrid[:ROWS, :COLS]
    order = 3.0 * np.hypot(row, col) / np.hypot(ROWS, COLS) + 0.1 * number
    order[:10] = np.nan
    return order


def made_frame(number: int, label: str) -> ReportFrame:
    """A frame whose simulation is 0.05 fringe below it."""
    order = order_field(number)
    light, model = (np.sin(np.pi * values) ** 2 for values in (order, order - 0.05))
    return ReportFrame(
        number=number,
        label=label,
        why="all are shown",
        panes=(
            Pane("experiment", "experiment", light, (0.0, 1.0), SIGNAL),
            Pane("simulation", "simulation", model, (0.0, 1.0), SIGNAL),
            Pane("difference", "difference", np.full_like(order, 0.05), (-0.1, 0.1), FRINGES),
        ),
        order=order,
        model_order=order - 0.05,
        pixel_mm=PIXEL,
        left_mm=LEFT,
        top_mm=TOP,
    )


def made_values(count: int = 30) -> FrameValues:
    """Load over distance, with a band, and one frame far from the others."""
    load = 44.0 + np.sin(np.arange(count))
    load[count // 3] = 60.0
    none = np.zeros(count, dtype=bool)
    return FrameValues(
        keys=("load.normal_n",), values=load[:, None],
        standard_uncertainty=np.full((count, 1), 0.5), chi=np.ones(count),
        distance_m=np.arange(count, dtype=float), searched=none, whole=none,
    )  # fmt: skip


def made_content(names: tuple[str, ...] = ("static", "31 m")) -> ReportContent:
    """A report in which every name, label and value is one of `names`."""
    some = list(names)
    return ReportContent(
        command="process", title=" ".join(some), verdict=" ".join(some),
        frames=[made_frame(number, label) for number, label in enumerate(some[:8])],
        choice="All frames are shown.", curves=values_plots(made_values()),
        budget=ReportTable(some[0], {some[-1]: some}),
        tables=[ReportTable("by frame", dict.fromkeys(some, some))], causes=some,
        taken_as_exact=some,
        warnings=[message("no_such_file_check", path=name) for name in some] + some,
        scene="\n".join(some), paper=[(name, name) for name in some],
    )  # fmt: skip


class Page(HTMLParser):
    """Elements of a page with their attributes and text, as a browser would take them apart."""

    def __init__(self, path: Path) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self._open: list[list[str]] = []
        self.inside: dict[str, list[str]] = {"script": [], "style": []}
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag in self.inside:
            self.inside[tag].append("")

    def handle_data(self, data):
        self.texts.append(data)
        if self.cdata_elem in self.inside:
            self.inside[self.cdata_elem][-1] += data

    def of(self, tag: str) -> list[dict[str, str | None]]:
        """The attributes of each element of a name."""
        return [attributes for name, attributes in self.elements if name == tag]

    @property
    def text(self) -> str:
        """All of it as one line."""
        return re.sub(r"\s+", " ", "".join(self.texts))


def decoded(map_, rows, cols):
    """Orders from a map's text, by the words of order_map's docstring alone."""
    data = np.frombuffer(zlib.decompress(base64.b64decode(map_["data"])), np.uint8).astype(int)
    moved = (data[: rows * cols] + 256 * data[rows * cols :]).reshape(rows, cols)
    level = np.cumsum(moved, axis=1) % 65536
    return np.where(level == 0, np.nan, (level - 1 + map_["first"]) * map_["step"])


def data_of(page):
    return json.loads(page.inside["script"][0])


def charts_of(page):
    """The attributes of each chart, which is a picture of its own."""
    return [image for image in page.of("img") if (image.get("src") or "")[:14] == "data:image/svg"]


def drawing_of(source):
    """The elements of a chart, of its base64 behind a comma or alone; comments are its texts."""
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    return ElementTree.fromstring(base64.b64decode(source.rpartition(",")[2]), parser)
