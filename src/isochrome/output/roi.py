"""ImageJ regions of interest: fringe lines out as polylines, areas in as masks.

ImageJ's habits stay here: (x, y), areas counted from the corners of pixels, lines and points from
their centres. The library that knows the file format is an extra of its own.
"""

import math
import zipfile
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError

Mask = NDArray[np.bool_]
SUFFIXES = (".roi", ".zip")
MOST_AREAS = 1000
"""In one file: each is filled on the whole frame."""

MAX_BYTES = 20_000_000
"""An area needs less; a file that claims more is damaged or hostile."""

ON_SIDE = 1e-9
"""A centre that lies on a side counts as inside, rounding (px) or not."""

AREAS = ("POLYGON", "RECT", "OVAL", "FREEHAND", "TRACED")


class Polyline(Protocol):
    """A line with its points (n,) in pixels, centres at whole numbers, kind, and order if known."""

    @property
    def kind(self) -> str:
        """What a dark field shows there: 'dark' or 'bright'."""

    @property
    def rows(self) -> NDArray[np.float64]:
        """Rows, (n,), px."""

    @property
    def cols(self) -> NDArray[np.float64]:
        """Columns, (n,), px."""

    @property
    def order(self) -> float | None:
        """The line's fringe order."""


def roi_entries(lines: Iterable[Polyline], frame: int) -> list[tuple[str, bytes]]:
    """ImageJ polylines of a frame's fringe lines, the files in a .zip for its ROI manager.

    A line is named 'frame 3: N = 1.5 bright' by its order and kind, with '#2' on for the next of
    that name, or 'frame 3: line 7 dark' by its number, from 0, where the order is not known. ImageJ
    shows them on the slice of a stack that the frame's number, from 0, is.
    """
    roifile = load_roifile()
    entries, counts = [], Counter[str]()
    for number, line in enumerate(lines):
        if len(line.rows) < 2:
            continue  # ImageJ has no polyline of one point
        what = f"line {number}" if line.order is None else f"N = {line.order:g}"
        name = f"frame {frame}: {what} {line.kind}"
        counts[name] += 1
        name += f" #{counts[name]}" if counts[name] > 1 else ""
        points = np.stack([line.cols, line.rows], axis=1).astype(np.float32)
        roi = roifile.ImagejRoi.frompoints(points, name=name, position=frame)
        roi.roitype = roifile.ROI_TYPE.POLYLINE
        # a colon is not allowed in a file's name on Windows, where a user may unpack the .zip
        entries.append((f"{name.replace(':', '')}.roi", roi.tobytes()))
    return entries


def add_rois(archive: zipfile.ZipFile, contents: Iterable[tuple[str, bytes]]) -> None:
    """Add ROIs to a .zip, all of the first date that it knows: the same ROIs are the same bytes."""
    for name, data in contents:
        archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data)


def read_roi_mask(path: Path, shape: tuple[int, int]) -> Mask:
    """The pixels whose centres lie in any of the areas of an ImageJ .roi or .zip file.

    Parts of composite areas that lie in each other are holes.
    """
    roifile = load_roifile()
    _check_size(path)
    try:
        content = roifile.roiread(path, maxsize=MAX_BYTES)
        rois = content if isinstance(content, list) else [content]
        inside = np.zeros(shape, dtype=bool)
        for roi in rois:
            if roi.roitype.name not in AREAS or roi.subtype.name in ("TEXT", "ARROW", "IMAGE"):
                raise InputError(
                    "roi_type_which_encloses", path=path, name=roi.name,
                    name_2=roi.roitype.name.lower(),
                )  # fmt: skip
            inside |= _inside(roi, shape)
    except InputError:
        raise
    except Exception as error:  # a damaged file raises nearly everything
        reason = (str(error).splitlines() or [""])[0][:160] or type(error).__name__
        raise InputError("not_readable_imagej_roi", path=path, reason=reason) from error
    if not rois:
        raise InputError("holds_no_roi_add", path=path)
    return inside


def _check_size(path: Path) -> None:
    """Refuse a file that is none, or that would swell beyond what areas need."""
    if not path.is_file():
        raise InputError("no_such_file_check", path=path)
    count = 1
    try:
        size = path.stat().st_size
        if path.suffix.lower() == ".zip":
            with zipfile.ZipFile(path) as archive:
                entries = archive.infolist()
                size = max(size, sum(entry.file_size for entry in entries))
                count = len(entries)
    except (OSError, ValueError, NotImplementedError, zipfile.BadZipFile) as error:
        raise InputError("not_readable_imagej_roi_save", path=path, error=error) from error
    if size > MAX_BYTES:
        raise InputError("holds_bytes_rois_need", path=path, size=size, max_bytes=MAX_BYTES)
    if count > MOST_AREAS:
        raise InputError("holds_rois_allowed_join", path=path, count=count, most_areas=MOST_AREAS)


def load_roifile() -> ModuleType:
    """Import the library for ImageJ's ROI files."""
    try:
        import roifile
    except ImportError as error:
        raise InputError("imagej_roi_files_need") from error
    return roifile


def _inside(roi: Any, shape: tuple[int, int]) -> Mask:
    """One area as a mask, by the pixels' centres."""
    top, left_px, bottom, right = (float(v) for v in (roi.top, roi.left, roi.bottom, roi.right))
    if roi.subpixelrect:
        left_px, top, right, bottom = roi.xd, roi.yd, roi.xd + roi.widthd, roi.yd + roi.heightd
    # an area is counted from the corners of pixels: half a pixel less from their centres
    row, col = np.ogrid[0.5 : shape[0], 0.5 : shape[1]]
    if roi.roitype.name == "OVAL":
        across, down = max(right - left_px, 1e-9), max(bottom - top, 1e-9)
        x, y = (2 * col - left_px - right) / across, (2 * row - top - bottom) / down
        return np.asarray(x**2 + y**2 <= 1)
    if roi.roitype.name == "RECT" and not roi.composite:
        return np.asarray((row > top) & (row < bottom) & (col > left_px) & (col < right))
    inside = np.zeros(shape, dtype=bool)
    for outline in roi.coordinates(multi=True):
        if len(outline) >= 3:
            inside ^= _filled(np.asarray(outline, dtype=np.float64) - 0.5, shape)
    return inside


def _filled(outline: NDArray[np.float64], shape: tuple[int, int]) -> Mask:
    """Pixels whose centres lie in a closed polygon of (x, y), by the even-odd rule.

    Along a row the inside changes at each side that crosses it. Source: Foley, van Dam, Feiner and
    Hughes (1990), Computer Graphics, section 3.6.
    """
    ends = np.roll(outline, -1, axis=0)
    low, high = (f(outline[:, 1], ends[:, 1]) for f in (np.minimum, np.maximum))
    order = np.argsort(low, kind="stable")
    inside = np.zeros(shape, dtype=bool)
    for row in range(max(0, math.ceil(low.min())), min(shape[0], math.floor(high.max()) + 1)):
        reached = order[: np.searchsorted(low[order], row, side="right")]
        sides = reached[high[reached] > row]
        (x0, y0), (x1, y1) = outline[sides].T, ends[sides].T
        across = np.sort(x0 + (row - y0) / (y1 - y0) * (x1 - x0))
        enter = np.ceil(across[0::2] - ON_SIDE).clip(0, shape[1]).astype(int)
        leave = np.floor(across[1::2] + ON_SIDE + 1).clip(0, shape[1]).astype(int)
        entered, exited = (np.bincount(k, minlength=shape[1] + 1) for k in (enter, leave))
        inside[row] = np.cumsum(entered - exited)[: shape[1]] > 0
    return inside
