"""One pass over the frames, and findings on their light.

Depth, exposure, noise, and the no-load frames; and whether the set can be its scene's.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import Literal

import numpy as np

from isochrome.errors import InputError
from isochrome.frames.checks.unloaded import (
    UNLOADED,
    LoadSigns,
    load_signs,
    unloaded_frames,
)
from isochrome.frames.linear import Linear
from isochrome.frames.no_load import load_no_load, open_no_load_steps
from isochrome.frames.noise import estimate_noise, full_scale
from isochrome.frames.reading import FrameReader, Mask
from isochrome.frames.saturation import saturation_level
from isochrome.output import counted, named_frames
from isochrome.scene import Scene

Level = Literal["error", "warning", "note"]
SATURATED, LOW_CONTRAST, JUMP = 0.01, 0.1, 0.2
"""Share of pixels, part of full scale, and change between frames, that are reported."""
UNSTEADY = "at most); fix exposure, gain and lamp (only an unloaded dark-field frame may be darker)"


@dataclass(frozen=True)
class Finding:
    """One thing to know of a set of frames.

    Parameters
    ----------
    level : {'error', 'warning', 'note'}
        How grave it is.
    text : str
        A sentence.
    frame : int, optional
        The frame that it is of; None: of the set.
    """

    level: Level
    text: str
    frame: int | None = None


@dataclass(kw_only=True)
class Survey:
    """Raw figures of each frame, in raw grey levels, and of all together.

    Of the specimen's pixels, where the frames carry its mask.
    """

    count: int = 0
    low: list[float] = field(default_factory=list)  # 2nd percentile
    high: list[float] = field(default_factory=list)  # 98th percentile
    saturated: list[float] = field(default_factory=list)  # share on the plateau, where clipped
    smallest: list[float] = field(default_factory=list)  # of the finite pixels; NaN: there are none
    largest: list[float] = field(default_factory=list)  # the same
    not_finite: list[float] = field(default_factory=list)  # share
    noise: list[float] = field(default_factory=list)  # sigma at mid level of frames 0, 1, 3, 7, ...
    twins: list[tuple[int, int]] = field(default_factory=list)  # (frame, earlier equal one)
    untimed: int = 0
    bits: int = 0  # all values or-ed together
    failure: str | None = None  # why reading ended before the end
    load: LoadSigns | None = None  # what says whether each is loaded; None: not asked


def survey(reader: FrameReader, scene: Scene) -> Survey:
    """Read all frames once, in memory that does not grow with their pixels.

    Parameters: `reader`; `scene`. Returns a Survey; an InputError on the way ends it and is kept in
    `failure`.
    """
    found, seen = Survey(load=load_signs(reader, scene)), dict[bytes, int]()
    full = full_scale(reader.bit_depth)
    try:
        for frame in reader:
            level = saturation_level(frame.image, full=full)
            _add(found, frame.image, level, frame.mask)
            if found.load is not None:
                found.load.add(frame, full, scene.frames.first_gamma)
            key = hashlib.sha1(frame.image.data, usedforsecurity=False).digest()
            first = seen.setdefault(key, frame.index)
            if first != frame.index:
                found.twins.append((frame.index, first))
            if frame.time_s is None:
                found.untimed += 1
            if frame.index & (frame.index + 1) == 0:
                _add_noise(found, frame.image, reader.bit_depth)
            found.count += 1
    except InputError as error:
        found.failure = str(error)
    return found


def _add(found: Survey, image: np.ndarray, clipped: float, mask: Mask | None) -> None:
    image = image.ravel() if mask is None else image[mask]  # light off the specimen says nothing
    values = image[np.isfinite(image)]
    found.not_finite.append(1 - values.size / image.size)
    if values.size == 0:
        for figures in (found.low, found.high, found.smallest, found.largest):
            figures.append(float("nan"))
        found.saturated.append(0.0)
        return
    low, high = np.percentile(values[:: max(1, values.size // 50_000)], (2, 98))
    found.low.append(float(low))
    found.high.append(float(high))
    found.saturated.append(float(np.mean(values >= clipped)))
    found.smallest.append(float(values.min()))
    found.largest.append(float(values.max()))
    if image.dtype.kind == "u":
        found.bits |= int(np.bitwise_or.reduce(values, axis=None))


def _add_noise(found: Survey, image: np.ndarray, bit_depth: int | None) -> None:
    try:
        model = estimate_noise(image, bit_depth=bit_depth)
    except InputError:  # too small: said by the size's own finding
        return
    found.noise.append(float(model.sigma(np.median(image[np.isfinite(image)]))))


def refusals(*looks: Callable[[], object]) -> Iterator[Finding]:
    """A finding for each look at something that is refused."""
    for look in looks:
        try:
            look()
        except InputError as error:
            yield Finding("error", str(error))


def misfits(reader: FrameReader, scene: Scene, count: int | None) -> Iterator[tuple[str, str]]:
    """What of a set cannot be its scene's (size, number of frames, known points): whose, and a
    sentence.
    """
    rows, cols = reader.shape
    camera, wear, steps = scene.camera, scene.wear, max(1, len(scene.polariscope.step))
    each = count is not None and count % steps == 0
    if count is not None and not each:
        text = f"{count} frames are not a multiple of the polariscope's {steps} steps; give one "
        yield str(reader.path), f"{text}frame for each [[polariscope.step]]"
    loads = len(scene.frames.known_loads_n)
    if loads and count is not None and loads != count:
        text = f"frames.known_loads_n has {counted(loads, 'number')}, and the set "
        text += f"{counted(count, 'frame')}; give one for each, in their order, 0 where it is not "
        yield scene.name, f"{text}known"
    for i, known in enumerate(scene.frames.known_order, start=1):
        if known.row_px >= rows or known.col_px >= cols:
            text = f"frames.known_order[{i}] at row {known.row_px}, column {known.col_px} lies "
            yield scene.name, f"{text}outside {rows} x {cols} pixels; move it"
    yield from _paths_beyond(scene, rows, cols)
    wanted = (camera.height_px or rows, camera.width_px or cols) if camera else (rows, cols)
    if wanted != (rows, cols):
        after = "after the roi" if reader.roi else "(no frames.roi is set)"
        text = f"frames are {rows} rows x {cols} columns {after} and the scene's camera is "
        text += f"{wanted[0]} x {wanted[1]}; correct camera.height_px and width_px, or frames.roi"
        if wanted == (cols, rows):
            text += ", or turn pictures that lie on their side by frames.rotate_deg = 90 or 270"
        yield str(reader.path), text
    if wear is None or scene.frames.sliding_speed_mm_per_s is not None:
        return
    first = scene.friction is not None and scene.friction.static_state_first
    states = len(wear.distances_m) + int(first)
    if count is not None and each and count != states * steps:
        what = "wear.distances_m" + " and the static state first" * first
        step = f" for each of its {steps} steps" if steps > 1 else ""
        text = f"{counted(count, 'frame')}, and the scene has {counted(states, 'state')} ({what}); "
        text += f"give one frame a state{step}, correct the list, or set "
        yield str(reader.path), f"{text}frames.sliding_speed_mm_per_s for a video"


def _paths_beyond(scene: Scene, rows: int, cols: int) -> Iterator[tuple[str, str]]:
    """Tell of known lines and free boundaries that leave the picture, by their first such point."""
    own = scene.frames
    # an outline may run along the picture's edge, half a pixel beyond its last centre
    for name, paths, slack in (
        ("known_line", own.known_line, 0.0),
        ("free_boundary", own.free_boundary, 1.0),
    ):
        for i, path in enumerate(paths, start=1):
            beyond = (
                (k, row, col)
                for k, (row, col) in enumerate(path.places, start=1)
                if row > rows - 1 + slack or col > cols - 1 + slack
            )
            for k, row, col in islice(beyond, 1):
                text = f"frames.{name}[{i}], point {k} at row {row:g}, column {col:g} lies outside "
                yield scene.name, f"{text}{rows} x {cols} pixels; move it"


def of_depth(reader: FrameReader, seen: Survey) -> Iterator[Finding]:
    """Findings on bit depth: 12 bits in a 16-bit file, floats without a full scale."""
    depth, largest = reader.bit_depth, max(seen.largest, default=0.0)
    if reader.dtype.kind == "f" and depth is None and largest > 1:
        text = f"float frames reach {largest:g}; set camera.bit_depth to say what full scale is"
        yield Finding("error", text)
    if reader.dtype.kind == "f" and depth is not None and 0 < largest <= 1:
        text = f"float frames end at {largest:g}, but camera.bit_depth = {depth} says grey levels"
        yield Finding("warning", text + "; remove camera.bit_depth if they are fractions")
    if depth is None or depth <= 8 or reader.dtype.kind != "u" or not seen.bits:
        return
    likely = next(b for b in (8, 10, 12, 14, 16) if largest < 2**b)
    if likely < depth:
        yield Finding(
            "warning",
            f"{depth}-bit frames whose largest value is {largest:g}: probably {likely} bits; set "
            f"camera.bit_depth = {likely} (or the exposure is very short)",
        )
    shift = (seen.bits & -seen.bits).bit_length() - 1
    if shift:
        text = f"all values are multiples of {2**shift}: a {depth - shift}-bit sensor, shifted up"
        yield Finding("note", text + f"; full scale is then {2**depth - 2**shift}")


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
    if not jumps.any():
        yield from _of_set(high, clear & ~weak & (share <= SATURATED))
    twins = np.zeros(seen.count, bool)
    twins[[i for i, _ in seen.twins if i < seen.count]] = True
    text = "the same, pixel by pixel, as an earlier one; did the camera stall?"
    yield from _frames("warning", twins & clear, text)
    if seen.noise:
        unit = "of full scale" if reader.bit_depth is None else "grey levels"
        text = f"camera noise about {np.median(seen.noise):.3g} {unit}, rounding included"
        yield Finding("note", text)


def _of_set(high: np.ndarray, usable: np.ndarray) -> Iterator[Finding]:
    """Frames whose brightest places are dimmer than another's, by steps too small for a jump."""
    if not usable.any():
        return
    top = float(high[usable].max())
    dim = usable & (high < (1.0 - JUMP) * top)
    if dim.any():
        least = float(high[dim].min())
        text = f"the brightest places are down to 1 : {top / least:.2g} of those of other frames: "
        text += "fix exposure, gain and lamp (only frames below half a fringe may be so dark)"
        yield from _frames("warning", dim, text)


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
    yield Finding(level, f"{named_frames(index.tolist())}: {text}", int(index[0]))


def of_unloaded(reader: FrameReader, seen: Survey, scene: Scene) -> Iterator[Finding]:
    """Findings on frames that show the unloaded specimen among those to be processed."""
    if seen.load is None or not seen.count:
        return
    full, gamma = full_scale(reader.bit_depth), scene.frames.first_gamma
    like, alone = unloaded_frames(seen.load, seen.low, seen.high, full, gamma)
    for key, numbers in like.items():
        why = UNLOADED.format(f"nearly the same picture as {key}", "")
        yield Finding("warning", f"{named_frames(numbers)}: {why}", numbers[0])
    if alone:
        name = ", or name it as frames.no_load_dark or no_load_bright"
        why = UNLOADED.format("no fringes, where the frames beside show many", name)
        yield Finding("warning", f"{named_frames(alone)}: {why}", alone[0])


def of_no_load(reader: FrameReader, seen: Survey, scene: Scene) -> Iterator[Finding]:
    """Findings on the no-load frames: missing, unreadable, of another size or exposure.

    A phase-stepped set tells its own background and illumination, and needs none of them.
    """
    frames = scene.frames
    if scene.polariscope.step:
        if frames.no_load_steps is not None:
            yield from refusals(lambda: open_no_load_steps(scene, reader.full_shape).close())
        return
    missing = [n for n in ("no_load_dark", "no_load_bright") if getattr(frames, n) is None]
    if missing:
        text = f"{' and '.join('frames.' + n for n in missing)} not given: the unloaded specimen's "
        yield Finding("warning", text + "frames are worth more than any algorithm; add them")
    try:
        dark, bright = load_no_load(scene, full_shape=reader.full_shape)
    except InputError as error:
        yield Finding("error", str(error))
        return
    if not seen.count or np.isnan(seen.low).all():
        return
    yield from _of_exposure(reader, seen, scene, dark, bright)


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
            yield Finding("warning", text + ": capture both with one exposure")
    if dark is not None:
        bottom = float(np.percentile(dark.image, 2))
        if bottom > low + 0.05:
            text = f"no_load_dark begins at {bottom:.3g} of full scale and the frames at {low:.3g}"
            yield Finding("warning", text + ": capture both with one exposure, loaded last")
