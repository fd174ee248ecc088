"""What the frames' own file tells: size, bits, colours, scale, times; which frames to look at."""

from __future__ import annotations

from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.drafting.scene_draft import QUANTITIES, DraftValue, KnownValues, OpenKey, Origin
from isochrome.errors import InputError
from isochrome.frames import Frame, FrameReader, check_scale, likely_no_load, named_files
from isochrome.output import counted
from isochrome.scene import Camera, FramesLike, load_scene

SCENE_FILE = "scene.toml"
"""What a scene is called that nobody has named."""

_LOOKED_AT = 5
"""Frames at the most in which a specimen is looked for, from the first to the last."""

_DEPTHS = (8, 10, 12, 14, 16)


def name_of(reader: FrameReader) -> str:
    """The frames' name, for messages."""
    first = reader.files[0]
    return str(first) if isinstance(first, Path) else "the frames"


def not_among_frames(frames: FramesLike) -> tuple[Path, ...]:
    """The files of a folder that are none of its frames; of frames that are no folder, none.

    Those that the scene in it names, such as its no-load frames; without one, by their names.
    """
    if not (isinstance(frames, str | Path) and Path(frames).is_dir()):
        return ()
    folder = Path(frames)
    with suppress(InputError, OSError):
        return tuple(named_files(load_scene(folder / SCENE_FILE)))
    with suppress(OSError):  # said where the folder is opened
        named = likely_no_load(sorted(file.name for file in folder.iterdir() if file.is_file()))
        return tuple(folder / name for name in named.values())
    return ()


def open_questions(frames: FrameReader, given: KnownValues) -> tuple[str, ...]:
    """Fields of KnownValues that must be known besides; `QUANTITIES` has the words to ask."""
    names = list(given.missing)
    if given.pixel_mm is None and frames.pixel_mm is None and not given.has_own_scale:
        names.append("pixel_mm")
    if frames.channel is not None and given.channel is None and given.wavelength_nm is None:
        names.append("wavelength_nm")
    return tuple(names)


def refuse_unclear(reader: FrameReader, given: KnownValues) -> None:
    """Refuse frames whose colours or scale nobody tells. Raises InputError."""
    name = name_of(reader)
    if reader.channel is not None and given.channel is None and given.wavelength_nm is None:
        raise InputError(
            f"{name}: has red, green and blue, and only one is of the light's wavelength; give "
            f"--wavelength-nm ({QUANTITIES['wavelength_nm'].usual}) or --channel"
        )
    if given.pixel_mm is not None:
        check_scale(reader, Camera(pixel_mm=given.pixel_mm))
    elif reader.pixel_mm is None and not given.has_own_scale:
        raise InputError(
            f"{name}: does not name the size of a pixel, and no fringe tells it; give "
            f"--pixel-mm (mm, usually {QUANTITIES['pixel_mm'].usual})"
        )


def frames_to_look_at(reader: FrameReader, given: KnownValues) -> list[int]:
    """Numbers of the frames in which the specimen is looked for, in order. Raises InputError."""
    count = reader.count(decode=False)
    if given.frame is None:
        return sorted({round(k) for k in np.linspace(0, count - 1, min(count, _LOOKED_AT))})
    if given.frame >= count:
        raise InputError(
            f"{name_of(reader)}: has {counted(count, 'frame')}, and frame {given.frame} is asked "
            f"for; give 0 to {count - 1}"
        )
    return [given.frame]


def frame_of(reader: FrameReader, index: int, given: KnownValues) -> Frame:
    """One frame. Raises InputError where its levels do not fit the sensor's bits."""
    frame = next(reader.iterate(index, index + 1))
    if given.bit_depth is None and reader.dtype.kind == "u" and (reader.bit_depth or 0) > 8:
        largest = int(frame.image.max())
        likely = next(bits for bits in _DEPTHS if largest < 2**bits)
        if likely < (reader.bit_depth or 0):
            raise InputError(
                f"{frame.name}: its largest level is {largest}, as of {likely} bits, in a file of "
                f"{reader.bit_depth}; give --bit-depth {likely}, or {reader.bit_depth} if the "
                "frame is so dark"
            )
    if reader.dtype.kind == "f" and given.bit_depth is None and float(np.nanmax(frame.image)) > 1.0:
        raise InputError(
            f"{frame.name}: holds fractions up to {np.nanmax(frame.image):g}, and full scale is "
            "not known; give --bit-depth with the sensor's bits"
        )
    return frame


def file_values(reader: FrameReader, given: KnownValues, *, turned: bool) -> list[DraftValue]:
    """The camera's size and bits; `turned`, whether the scene lies a quarter turn otherwise."""
    rows, cols = reader.shape[::-1] if turned else reader.shape
    turn = "after the turn by frames.rotate_deg" if turned else ""
    values = [
        DraftValue(key="camera.width_px", value=cols, origin="file", note=turn),
        DraftValue(key="camera.height_px", value=rows, origin="file"),
    ]
    if reader.bit_depth is not None:
        origin: Origin = "file" if given.bit_depth is None else "given"
        values.append(DraftValue(key="camera.bit_depth", value=reader.bit_depth, origin=origin))
    return values


def light_values(given: KnownValues) -> list[DraftValue]:
    """What is known of the light and of the colours that are read."""
    parts: dict[str, Any] = {
        "polariscope.wavelength_nm": given.wavelength_nm,
        "frames.channel": given.channel,
        "frames.flip": given.flip,
    }
    return [
        DraftValue(key=key, value=value, origin="given")
        for key, value in parts.items()
        if value is not None
    ]


def open_of_set(reader: FrameReader, given: KnownValues) -> list[OpenKey]:
    """What of the light and of the recording is still open."""
    keys = []
    if given.wavelength_nm is None:
        quantity = QUANTITIES["wavelength_nm"]
        keys.append(OpenKey(quantity.key, quantity.question))
    for name, what in (("bright", "illumination"), ("dark", "background")):
        text = (
            f"a frame of the unloaded specimen in the {name} field, the {what}, such as "
            f'"no-load-{name}.tif"'
        )
        keys.append(OpenKey(f"frames.no_load_{name}", text))
    if frame_rate(reader) is not None:
        text = "sliding speed (mm/s), usually 1 to 500: gives the distance of each frame"
        keys.append(OpenKey("frames.sliding_speed_mm_per_s", text))
    return keys


def frame_rate(reader: FrameReader) -> float | None:
    """Frames a second by the first ones' times; None where they carry none."""
    times = [frame.time_s for frame in islice(reader, _LOOKED_AT)]
    known = [time for time in times if time is not None]
    if len(known) < 2 or len(known) < len(times) or known[-1] <= known[0]:
        return None
    return (len(known) - 1) / (known[-1] - known[0])


def described_set(reader: FrameReader) -> str:
    """What the frames are, for the scene's head."""
    rows, cols = reader.shape
    depth = "fractions of full scale" if reader.bit_depth is None else f"{reader.bit_depth} bits"
    count = counted(reader.count(decode=False), "frame")
    rate = frame_rate(reader)
    timed = "" if rate is None else f", {rate:.4g} a second by their times"
    name = name_of(reader)
    return f"{Path(name).name}: {count} of {cols} x {rows} pixels, {depth}{timed}."
