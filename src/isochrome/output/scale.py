"""The scale that a TIFF names: the side of a pixel in millimetres."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from isochrome.errors import InputError

if TYPE_CHECKING:
    import tifffile

MM_PER_UNIT = {
    "mm": 1.0,
    "cm": 10.0,
    "m": 1000.0,
    "um": 1e-3,
    "µm": 1e-3,
    "μm": 1e-3,
    "\\u00b5m": 1e-3,
    "micron": 1e-3,
    "microns": 1e-3,
    "nm": 1e-6,
}


def read_pixel_mm(path: str | Path) -> float | None:
    """The pixel's side, mm, that a TIFF names; None where it names none.

    ImageJ's unit and pixels per centimetre count as a scale; dots per inch are a print size, not
    the object's, and do not.
    """
    import tifffile

    try:
        with tifffile.TiffFile(path) as tif:
            return pixel_mm_of(tif)
    except (OSError, ValueError, tifffile.TiffFileError) as error:
        raise InputError("not_readable_tiff_check", path=path, error=error) from error


def pixel_mm_of(tif: tifffile.TiffFile) -> float | None:
    """The pixel's side that an open TIFF names, see `read_pixel_mm`."""
    tags: Any = getattr(tif.pages[0], "tags", {})
    if "XResolution" not in tags or "YResolution" not in tags:
        return None
    num, den = tags["XResolution"].value
    if num == 0 or den == 0 or tags["YResolution"].value != (num, den):
        return None
    meta = tif.imagej_metadata or {}
    unit = str(meta.get("unit", "")).strip().lower()
    if tif.is_imagej:
        mm = MM_PER_UNIT.get(unit)
    else:
        mm = 10.0 if "ResolutionUnit" in tags and int(tags["ResolutionUnit"].value) == 3 else None
    return None if mm is None else mm * den / num
