"""Findings on the light in the frames: depth, exposure, noise, and the no-load frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from isochrome.errors import InputError
from isochrome.frames.linear import Linear
from isochrome.frames.no_load import load_no_load, open_no_load_steps
from isochrome.frames.noise import full_scale
from isochrome.frames.reader import FrameReader
from isochrome.frames.survey import Survey
from isochrome.scene import Scene

Level = Literal["error", "warning", "note"]
SATURATED, LOW_CONTRAST, JUMP = 0.01, 0.1, 0.2
"""Share of pixels, part of full scale, and change between frames, that are reported."""
UNSTEADY = "at most); fix exposure, gain and lamp (only an unloaded dark-field frame may be darker)"


@dataclass(frozen=True)
class Finding:
    """One thing to know: how grave, of which frame (None: of the set), and a sentence."""

    level: Level
    frame: int | None
    text: str


def of_depth(reader: FrameReader, seen: Survey) -> Iterator[Finding]:
    """Findings on bit depth: 12 bits in a 16-bit file, floats without a full scale."""
    depth, largest = reader.bit_depth, max(seen.largest, default=0.0)
    if reader.dtype.kind == "f" and depth is None and largest > 1:
        text = f"float frames reach {largest:g}; set camera.bit_depth to say what full scale is"
        yield Finding("error", None, text)
    if reader.dtype.kind == "f" and depth is not None and 0 < largest <= 1:
        text = f"float frames end at {largest:g}, but camera.bit_depth = {depth} says grey levels"
        yield Finding("warning", None, text + "; remove camera.bit_depth if they are fractions")
    if depth is None or depth <= 8 or reader.dtype.kind != "u" or not seen.bits:
        return
    likely = next(b for b in (8, 10, 12, 14, 16) if largest < 2**b)
    if likely < depth:
        yield Finding(
            "warning",
            None,
            f"{depth}-bit frames whose largest value is {largest:g}: probably {likely} bits; set "
            f"camera.bit_depth = {likely} (or the exposure is very short)",
        )
    shift = (seen.bits & -seen.bits).bit_length() - 1
    if shift:
        text = f"all values are multiples of {2**shift}: a {depth - shift}-bit sensor, shifted up"
        yield Finding("note", None, text + f"; full scale is then {2**depth - 2**shift}")


def of_light(reader: FrameReader, seen: Survey) -> Iterator[Finding]:
    """Findings on each frame's light: blank, saturated, weak, jumping, repeated, noisy."""
    if not seen.count:
        return
    full = full_scale(reader.bit_depth)
    low, high = np.array(seen.low), np.array(seen.high)
    clear = ~(np.isnan(seen.largest) | (np.array(seen.smallest) == np.array(seen.largest)))
    yield from _blank(seen, full)
    share = np.array(seen.saturated)
    worst = f"saturated in up to {100 * share.max():.1f} % of the pixels, which are masked; lower "
    yield from _frames("warning", clear & (share > SATURATED), worst + "the exposure")
    weak = clear & (high - low < LOW_CONTRAST * full) & (share <= SATURATED)
    text = "low contrast, under 10 % of full scale; raise the exposure"
    yield from _frames("warning", weak, text)
    change = np.zeros(seen.count)
    with np.errstate(divide="ignore", invalid="ignore"):
        change[1:] = np.abs(np.diff(high)) / np.maximum(high[1:], high[:-1])
    jumps = (change > JUMP) & clear
    text = f"the brightness jumps against the frame before (by {100 * change.max(initial=0):.0f} % "
    yield from _frames("warning", jumps, text + UNSTEADY)
    twins = np.zeros(seen.count, bool)
    twins[[i for i, _ in seen.twins if i < seen.count]] = True
    text = "the same, pixel by pixel, as an earlier one; did the camera stall?"
    yield from _frames("warning", twins & clear, text)
    if seen.noise:
        unit = "of full scale" if reader.bit_depth is None else "grey levels"
        text = f"camera noise about {np.median(seen.noise):.3g} {unit}, rounding included"
        yield Finding("note", None, text)


def _blank(seen: Survey, full: float) -> Iterator[Finding]:
    """Frames with nothing in them: no number, all black, all white, one value."""
    small, large = np.array(seen.smallest), np.array(seen.largest)
    empty, flat = np.isnan(large), small == large
    yield from _frames("error", empty, "no number in it (NaN only); see how it was written")
    yield from _frames("error", flat & (large <= 0), "all black; was the light on?")
    yield from _frames("error", flat & (large >= full), "all white; lower the exposure")
    yield from _frames(
        "error", flat & (large > 0) & (large < full), "constant; is it a captured frame?"
    )
    holes = (np.array(seen.not_finite) > 0) & ~empty
    yield from _frames("note", holes, "some pixels are not finite; they are masked")


def _frames(level: Level, where: np.ndarray, text: str) -> Iterator[Finding]:
    """One finding for all frames that share a fault, as 'frames 2-5, 9: ...'."""
    index = np.flatnonzero(where)
    if not index.size:
        return
    runs = np.split(index, np.flatnonzero(np.diff(index) > 1) + 1)
    spans = [f"{r[0]}" if len(r) == 1 else f"{r[0]}-{r[-1]}" for r in runs]
    more = f" and {len(spans) - 8} more" if len(spans) > 8 else ""
    what = "frame" if index.size == 1 else "frames"
    yield Finding(level, int(index[0]), f"{what} {', '.join(spans[:8])}{more}: {text}")


def of_no_load(reader: FrameReader, seen: Survey, scene: Scene) -> Iterator[Finding]:
    """Findings on the no-load frames: missing, unreadable, of another size or exposure.

    A phase-stepped set tells its own background and illumination, and needs none of them.
    """
    frames = scene.frames
    if scene.polariscope.step:
        yield from _of_no_load_steps(reader, scene)
        return
    missing = [n for n in ("no_load_dark", "no_load_bright") if getattr(frames, n) is None]
    if missing:
        text = f"{' and '.join('frames.' + n for n in missing)} not given: the unloaded specimen's "
        yield Finding("warning", None, text + "frames are worth more than any algorithm; add them")
    try:
        dark, bright = load_no_load(scene, full_shape=reader.full_shape)
    except InputError as error:
        yield Finding("error", None, str(error))
        return
    if not seen.count or np.isnan(seen.low).all():
        return
    yield from _of_exposure(reader, seen, scene, dark, bright)


def _of_no_load_steps(reader: FrameReader, scene: Scene) -> Iterator[Finding]:
    """Findings on the unloaded specimen's phase-stepped set, if one is given."""
    if scene.frames.no_load_steps is None:
        return
    try:
        open_no_load_steps(scene, reader.full_shape).close()
    except InputError as error:
        yield Finding("error", None, str(error))


def _of_exposure(
    reader: FrameReader, seen: Survey, scene: Scene, dark: Linear | None, bright: Linear | None
) -> Iterator[Finding]:
    """Findings on the no-load frames' exposure against the captured frames'."""
    frames = scene.frames
    full = full_scale(reader.bit_depth)
    low = (max(float(np.nanmin(seen.low)), 0) / full) ** frames.first_gamma
    high = (max(float(np.nanmax(seen.high)), 0) / full) ** frames.first_gamma
    if bright is not None:
        top = float(np.percentile(bright.image, 98))
        if high > 1.15 * top:
            text = f"frames reach {high:.3g} of full scale and no_load_bright only {top:.3g}"
            yield Finding("warning", None, text + ": capture both with one exposure")
    if dark is not None:
        bottom = float(np.percentile(dark.image, 2))
        if bottom > low + 0.05:
            text = f"no_load_dark begins at {bottom:.3g} of full scale and the frames at {low:.3g}"
            yield Finding("warning", None, text + ": capture both with one exposure, loaded last")
