"""What the OME notes of a TIFF tell: how many frames, when they were taken, their pixels' size."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from isochrome.errors import InputError

MM = {"m": 1e3, "cm": 10.0, "mm": 1.0, "µm": 1e-3, "μm": 1e-3, "um": 1e-3, "nm": 1e-6,
      "in": 25.4}  # fmt: skip
"""Millimetres of the schema's units of length that a camera's picture can have."""

SECONDS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "μs": 1e-6, "us": 1e-6, "ns": 1e-9, "min": 60.0,
           "h": 3600.0, "d": 86400.0}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class FileNotes:
    """What a TIFF's notes tell of its frames: times in s, the side of a pixel in mm.

    `times_s`, of each frame from the first (None: unknown), or `interval_s`, or neither.
    """

    pixel_mm: float | None = None
    interval_s: float | None = None
    times_s: tuple[float | None, ...] | None = None
    start_s: float | None = None
    significant_bits: int | None = None


@dataclass(frozen=True, kw_only=True)
class Ome(FileNotes):
    """Frames by `slices`, separate `channels` and `times`."""

    slices: int
    channels: int
    times: int

    @property
    def count(self) -> int:
        """Number of pages that the notes tell of."""
        return self.slices * self.channels * self.times


def read_ome(text: str, path: Path) -> Ome:
    """Read the OME notes of one image in one file.

    Parameters: `text`, the XML; `path`, for messages. Returns Ome. Raises InputError where they
    are no XML, tell of several images or files, or of pixels that are not square.
    Source: OME schema 2016-06, elements Image, Pixels, Channel, TiffData, Plane.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:  # entities can grow without bounds
        raise InputError(f"{path}: its OME notes define entities; save it again, without notes")
    try:
        root = ElementTree.fromstring(text.encode("utf-8"))
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"{path}: its OME notes are no XML ({error}); save it again") from error
    images = root.findall("{*}Image")
    if len(images) != 1:
        raise InputError(f"{path}: holds {len(images)} image series; save the one wanted by itself")
    own = root.get("UUID")
    if any(note.text != own for note in images[0].iterfind("{*}Pixels/{*}TiffData/{*}UUID")):
        raise InputError(
            f"{path}: is one of several files of one OME-TIFF; save them as one file (Fiji: "
            "Bio-Formats Exporter)"
        )
    pixels = images[0].find("{*}Pixels")
    if pixels is None:
        raise InputError(f"{path}: its OME notes describe no pixels; save it again")
    samples = [_count(c, "SamplesPerPixel", path) for c in pixels.iterfind("{*}Channel")]
    size = {axis: _count(pixels, f"Size{axis}", path) for axis in "ZCT"}
    planes = size["Z"] * size["T"]
    times = _times(pixels, planes)
    increment = _number(pixels, "TimeIncrement", SECONDS, "TimeIncrementUnit", "s")
    if times is not None:
        increment = None
    bits = pixels.get("SignificantBits")
    return Ome(
        slices=size["Z"],
        channels=max(size["C"] // max(samples, default=1), 1),
        times=size["T"],
        pixel_mm=_pixel_mm(pixels, path),
        interval_s=increment,
        times_s=None if times is None else _from_first(times),
        start_s=times[0] if times else (None if increment is None else 0.0),
        significant_bits=int(bits) if bits and bits.isdecimal() and 1 <= int(bits) <= 16 else None,
    )


def _count(element: ElementTree.Element, name: str, path: Path) -> int:
    text = element.get(name, "1")
    if not (text.isascii() and text.isdecimal() and 0 < int(text[:12]) < 10**9):
        raise InputError(f"{path}: its OME notes say {name} = {text[:20]!r}; save it again")
    return int(text)


def _number(
    element: ElementTree.Element, name: str, units: dict[str, float], unit: str, default: str
) -> float | None:
    """A positive number of the notes, in our unit, or None."""
    factor = units.get(element.get(unit, default))
    try:
        value = float(element.get(name, "nan"))
    except ValueError:
        return None
    return value * factor if factor and math.isfinite(value) and value > 0 else None


def _pixel_mm(pixels: ElementTree.Element, path: Path) -> float | None:
    across, down = (
        _number(pixels, f"PhysicalSize{axis}", MM, f"PhysicalSize{axis}Unit", "µm") for axis in "XY"
    )
    if across is None or down is None:
        return None
    if abs(across / down - 1) > 1e-3:
        raise InputError(
            f"{path}: says that a pixel is {across:g} mm wide and {down:g} mm high; frames must "
            "have square pixels: correct its scale, or resample it"
        )
    return across


def _times(pixels: ElementTree.Element, planes: int) -> list[float] | None:
    """The planes' own times (s), in the order of the frames, where each plane has one."""
    found: dict[int, float] = {}
    for plane in pixels.iterfind("{*}Plane"):
        factor = SECONDS.get(plane.get("DeltaTUnit", "s"))
        try:
            index = int(plane.get("TheT", "0")) + int(plane.get("TheZ", "0"))
            value = float(plane.get("DeltaT", "nan"))
        except ValueError:
            return None
        if factor is None or not math.isfinite(value):
            return None
        found[index] = value * factor
    if len(found) != planes or set(found) != set(range(planes)):
        return None
    return [found[i] for i in range(planes)]


def _from_first(times: list[float]) -> tuple[float | None, ...]:
    """Times from the first, None for those that do not come after all before."""
    out: list[float | None] = []
    latest = -math.inf
    for time in times:
        out.append(time - times[0] if time > latest else None)
        latest = max(latest, time)
    return tuple(out)
