"""Colour images: a value for each channel, since the fringe value goes with the wavelength."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from isochrome.calibration.loading import read_shots
from isochrome.calibration.result import Calibration
from isochrome.calibration.settings import CalibrationSet
from isochrome.calibration.shot import Shot
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import POOR_CHI
from isochrome.frames import CHANNELS, channel_for, open_frames

SUMMARY = ("fringe_value_n_per_mm", "standard_uncertainty", "chi", "order_at_zero_load")
"""What the result tells of each channel."""


def calibrate_channels(
    given: CalibrationSet, run: Callable[[tuple[Shot, ...]], Calibration]
) -> Calibration:
    """Run a calibration, once a channel where the images are in colour and none is named.

    The value is that of the channel that sees polariscope.wavelength_nm best (green where that is
    not given), with all three in `channels`. A set of grey images, one that names frames.channel,
    and one in light of one wavelength has the one value. Raises what `run` raises for that channel.
    """
    scope = given.polariscope
    one_light = scope.wavelength_nm and scope.lines is None
    if given.frames.channel is not None or one_light or not _in_colour(given):
        if given.frames.channel is None and scope.lines is not None:
            raise InputError(
                f"{given.name}: polariscope.lines are several wavelengths and "
                f"{given.image[0].file} is grey; use one wavelength, or a colour camera"
            )
        return run(read_shots(given))
    main = channel_for(scope.wavelength_nm)
    found = run(_of_channel(given, main))
    table: dict[str, Any] = {}
    for channel in CHANNELS:
        try:
            one = found if channel == main else run(_of_channel(given, channel))
        except PhysicsError as error:
            table[channel] = {"refused": str(error)}
            continue
        values = {name: getattr(one, name) for name in SUMMARY}
        table[channel] = values | {"wavelength_nm": _line_of(given, channel)}
    return replace(found, channels=table, warnings=(*_messages(table, main), *found.warnings))


def _of_channel(given: CalibrationSet, channel: str) -> tuple[Shot, ...]:
    frames = given.frames.model_copy(update={"channel": channel})
    return read_shots(given.model_copy(update={"frames": frames}))


def _in_colour(given: CalibrationSet) -> bool:
    """Whether the first image has three channels that are not copies of one."""
    path, views = given.path(given.image[0].file), []
    for channel in ("red", "blue"):
        with open_frames(path, channel=channel, bit_depth=given.camera.bit_depth) as reader:
            if reader.channel is None:
                return False
            views.append(next(iter(reader)).image)
    return not np.array_equal(views[0], views[1])


def _line_of(given: CalibrationSet, channel: str) -> float | None:
    """The one line of the light (nm) that a channel sees; None where it is not known."""
    if given.polariscope.lines is None:
        return None
    seen = [w for w in given.polariscope.lines.wavelength_nm if channel_for(w) == channel]
    return seen[0] if len(seen) == 1 else None


def _messages(table: dict[str, Any], main: str) -> tuple[str, ...]:
    messages = [
        f"colour images: the value is the {main} channel's, and each channel's is in the result; "
        "frames.channel names another"
    ]
    poor = [c for c, v in table.items() if "refused" in v or v["chi"] > POOR_CHI]
    if poor:
        messages.append(
            f"{', '.join(poor)}: one wavelength does not describe it; white light washes the "
            "fringes out with their order, and a channel may mix two lines: put a narrow filter "
            "in front of the camera"
        )
    return tuple(messages)
