"""What ImageJ reads and writes: TIFF stacks with their scale, regions of interest. ImageJ's habits
stay here: (x, y), areas from the corners of pixels, lines from their centres."""

from __future__ import annotations

import math
import zipfile
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from isochrome.errors import InputError, reason_of
from isochrome.output.files import replacing

DTYPES = ("uint8", "uint16", "float32")
IMAGEJ_LIMIT = 4_000_000_000
"""ImageJ's TIFF ends at 4 GB; beyond, a BigTIFF is written, which Fiji opens by Bio-Formats."""

_SIGNED, _ORDER, _TURNED = "RdBu_r", "viridis", "hsv"
_MAPS = {
    "sigma_1_direction": _TURNED, "isoclinic": _TURNED, "fringe_order": _ORDER,
    "sigma": _SIGNED, "tau": _SIGNED,
}  # fmt: skip
"""Colours of a stack in ImageJ by how its name begins, those of the figures."""

_COLOUR_MAP, _SHORT = 320, 3
"""The tag of a table of colours, whose values are of 16 bits (TIFF 6.0, section 5)."""

_OF_COLOURS = ("Labels", "xorigin", "yorigin")
"""What ImageJ is told of a stack in colour."""

Photometric = Literal["minisblack", "rgb"]


def write_tiff(
    path: str | Path,
    stack: npt.ArrayLike,
    *,
    pixel_mm: float | None = None,
    photometric: Photometric = "minisblack",
    metadata: Mapping[str, Any] | None = None,
) -> None:
    """Write a stack (frame, row, col[, 3 of 'rgb']), whole or not at all, so that ImageJ shows its
    scale."""
    data = np.asarray(stack)
    if data.ndim < 3 or data.shape[0] == 0:
        raise InputError("stack_frame_row_col", path=path, shape=data.shape)
    shape, colours = data.shape[1:], (3,) if photometric == "rgb" else ()
    if len(shape) != 2 + len(colours) or 0 in shape or shape[2:] != colours:
        wanted = "(row, col, 3)" if colours else "(row, col)"
        raise InputError("frame_not_reshape", path=path, wanted=wanted, shape=shape)
    if data.dtype.name not in DTYPES:
        dtypes = " or ".join(DTYPES)
        raise InputError("frames_type_cannot_written", path=path, dtype=data.dtype, dtypes=dtypes)
    write_frames(
        path, data, data.shape, data.dtype, pixel_mm=pixel_mm, photometric=photometric,
        metadata=metadata,
    )  # fmt: skip


def write_frames(
    path: str | Path,
    frames: Iterable[np.ndarray],
    shape: tuple[int, ...],
    dtype: np.dtype,
    *,
    pixel_mm: float | None = None,
    photometric: Photometric = "minisblack",
    metadata: Mapping[str, Any] | None = None,
) -> None:
    """Write a stack as `write_tiff` does, from frames that come one at a time; `shape`, of all.
    Beyond 4 GB, and in colour of more than 8 bits, a TIFF whose scale is in pixels per
    centimetre."""
    import tifffile

    order = dtype.newbyteorder("<")  # tifffile takes an iterator's frames as they are
    swapped = (frame.astype(order, copy=False) for frame in frames)
    size = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    imagej = size < IMAGEJ_LIMIT
    imagej &= min(shape[1:3]) > 1  # tifffile turns single columns over
    imagej &= photometric != "rgb" or dtype == np.uint8
    keys: dict[str, Any] = {"photometric": photometric, "metadata": None}
    if imagej:
        view = dict(metadata or {})
        if photometric == "rgb":  # its colours are its own
            view = {key: view[key] for key in _OF_COLOURS if key in view}
        unit = {} if pixel_mm is None else {"unit": "mm"}
        keys["metadata"] = {"axes": "TYXS"[: len(shape)], **view, **unit}
        if "LUTs" in view and dtype.itemsize > 1:
            # ImageJ takes its own LUTs for composites alone, and one channel's from the first page
            colours = (257 * view["LUTs"][0].astype(np.uint16)).ravel().tolist()
            keys["extratags"] = [(_COLOUR_MAP, _SHORT, len(colours), tuple(colours), True)]
    if pixel_mm is not None:
        per_unit, more = 10 / pixel_mm, {"resolutionunit": "CENTIMETER"}
        if imagej:
            per_unit, more = 1 / pixel_mm, {}
        keys |= {"resolution": (per_unit, per_unit), **more}
    large = size >= IMAGEJ_LIMIT
    with (
        replacing(path) as beside,
        tifffile.TiffWriter(beside, imagej=imagej, bigtiff=large, byteorder="<") as tif,
    ):
        if imagej:
            tif.write(swapped, shape=shape, dtype=order, **keys)
        else:
            for frame in swapped:
                tif.write(frame, **keys)


def imagej_view(
    name: str,
    span: tuple[float, float],
    *,
    labels: Sequence[str] = (),
    pixel_mm: float | None = None,
    left_mm: float | None = None,
    top_mm: float | None = None,
    times_s: npt.ArrayLike | None = None,
) -> dict[str, Any]:
    """What ImageJ is to know of a stack besides its scale, by its own names for it. An order's
    colours go from nought, a stress's to the same value on either side; others have their own
    `span`. `labels` stand above the slices, `left_mm` and `top_mm` are outer edges."""
    from matplotlib import colormaps

    colours = next((colours for start, colours in _MAPS.items() if name.startswith(start)), "gray")
    # of a cyclic map's colours both ends meet
    low, high = map(float, {_TURNED: (-90.0, 90.0)}.get(colours, span))
    if name in ("normalised", "confidence"):
        low, high = 0.0, 1.0
    elif colours == _SIGNED:
        high = max(abs(low), abs(high))
        low = -high
    elif colours == _ORDER:
        low = min(0.0, low)
    high = high if high > low else low + 1.0
    table = np.rint(255.0 * colormaps[colours](np.arange(256))[:, :3]).T
    view: dict[str, Any] = {"min": low, "max": high, "Ranges": (low, high)}
    view["LUTs"] = [np.ascontiguousarray(table, dtype=np.uint8)]
    if labels:
        view["Labels"] = list(labels)
    for key, edge in (("xorigin", left_mm), ("yorigin", top_mm)):
        if pixel_mm is not None and edge is not None:
            view[key] = round(-edge / pixel_mm, 6) + 0.0
    steps = np.diff(np.asarray([] if times_s is None else times_s, dtype=float))
    if steps.size and np.isfinite(steps).all() and np.ptp(steps) <= 1e-3 * abs(steps.mean()):
        view |= {"finterval": float(steps.mean()), "tunit": "s"}
    return view


_MICRONS = ("um", "µm", "μm", "\\u00b5m", "micron", "microns")
MM_PER_UNIT = {
    "mm": 1.0, "cm": 10.0, "m": 1e3, **dict.fromkeys(_MICRONS, 1e-3), "nm": 1e-6, "in": 25.4,
}  # fmt: skip
"""Units of length by the words that ImageJ, OME and instruments have for them."""

Mask = NDArray[np.bool_]
SUFFIXES = (".roi", ".zip")
MOST_AREAS = 1000
"""In one file: each is filled on the whole frame."""

MAX_BYTES = 20_000_000
"""An area needs less; a file that claims more is damaged or hostile."""

ON_SIDE = 1e-9
"""A centre that lies on a side counts as inside, rounding (px) or not."""

AREAS = ("POLYGON", "RECT", "OVAL", "FREEHAND", "TRACED")


def roi_entries(lines: Iterable[Any], frame: int) -> list[tuple[str, bytes]]:
    """ImageJ polylines of a frame's fringe lines, the files in a .zip for its ROI manager. Named
    'frame 3: N = 1.5 bright', '#2' on for the next, or 'frame 3: line 7 dark'."""
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
    """The pixels whose centres lie in any area of an ImageJ .roi or .zip; inner parts are holes."""
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
        raise InputError("not_readable_imagej_roi", path=path, reason=reason_of(error)) from error
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
    """Pixels whose centres lie in a closed polygon of (x, y), by the even-odd rule. Source: Foley,
    van Dam, Feiner and Hughes (1990), Computer Graphics, section 3.6."""
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
