"""Prepared frames with the load of each, from a calibration set's files.

And a value for each channel of colour images.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, uniform_filter

from isochrome.calibration.result import Calibration
from isochrome.calibration.settings import CalibrationSet, LoadedImage
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import POOR_CHI, Observation, observe
from isochrome.frames import (
    CHANNELS,
    FrameReader,
    channel_for,
    check_scale,
    full_scale,
    load_mask,
    load_no_load,
    open_frames,
    saturation_level,
)
from isochrome.messages import message
from isochrome.scene import ArrayFrames, Camera, Frames, Scene, Specimen, check_width

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Shot(Observation):
    """A prepared frame and the load that it was taken under."""

    load_n: float
    bright: bool = False  # the polariscope's field is
    no_load_light: Array | None = None  # bright less dark frame of no load, where there are both


def unused(idle: Sequence[Shot], why: str) -> tuple[str, ...]:
    """A sentence on the shots without a load, where there are some."""
    return (f"{', '.join(s.name for s in idle)}: no load, not used{why}",) if idle else ()


def below_saturation(image: Array, sigma: Array, level: float) -> NDArray[np.bool_]:
    """Pixels (rows, cols) whose neighbours' mean, too, lies three sigmas below saturation's
    `level`: else the darker half of those beside saturated ones would stay.
    """
    if float(np.max(image)) < level:
        return np.ones(image.shape, dtype=bool)
    return np.asarray((image < level) & (uniform_filter(image, 3) + 3.0 * sigma < level))


PIXELS = 40_000
"""Pixels of an image, or of the square about a disc, that are fitted."""

RIM = 0.03
"""Part of a beam's height at each edge, and of a disc's radius at its rim, that is left out: there
are chamfers and blur."""

LARGEST_TILT = 8.0
"""Degrees by which a specimen may lie aslant; one that does by more is asked to be turned."""

FINEST = 0.25
"""Fringes a pixel at the most that a camera resolves."""

FEWEST_FRINGES = 0.5
"""Fringes in view, or order at a disc's centre, at the least."""

EXPLAINED = 0.6
"""Share of an image's variation that a model must explain at the least."""

MOST_SATURATED = 0.3
"""Share of invalid (saturated) pixels beyond which an image is refused."""

SMOOTHING_PX = 3.0
"""Blur of the no-load frames, whose own noise must not enter every pixel's model."""


def read_shots(given: CalibrationSet) -> tuple[Shot, ...]:
    """A set's images, less the no-load dark frame where there are both. InputError names the file
    that is unusable, or a pixel_mm in which the specimen cannot be seen.
    """
    scene = Scene(
        specimen=Specimen(),
        camera=given.camera,
        polariscope=given.polariscope,
        frames=given.frames.model_copy(update={"gamma": given.gamma}),
        folder=given.folder,
    )
    ends = [
        gaussian_filter(np.nan_to_num(end.image).astype(float), SMOOTHING_PX)
        for end in load_no_load(scene)
        if end is not None
    ]
    dark, light = (ends[0], ends[1] - ends[0]) if len(ends) == 2 else (None, None)
    shots = tuple(_shot(given, item, dark, light) for item in given.image)
    shapes = {s.light.shape for s in shots} | ({light.shape} if light is not None else set())
    if len(shapes) > 1:
        raise InputError(
            "images_different_sizes_rows_columns", name=given.name, shapes=sorted(shapes)
        )
    body = given.beam.height_mm if given.beam else given.disc.diameter_mm if given.disc else None
    if given.camera.pixel_mm is not None and body is not None:
        what = "the beam" if given.beam else "the disc"
        check_width(given.name, given.camera.pixel_mm, shots[0].light.shape, body, what)
    return shots


def _shot(
    given: CalibrationSet, item: LoadedImage, dark: Array | None, no_load_light: Array | None
) -> Shot:
    path, frames = given.path(item.file), given.frames
    raw, reader = read_one_frame(
        path, frames, given.camera, channel=frames.channel,
        wavelength_nm=given.polariscope.wavelength_nm,
    )  # fmt: skip
    depth, inside = reader.bit_depth, load_mask(given, reader.shape, reader.full_shape)
    observed = observe(raw, name=str(path), bit_depth=depth, gamma=given.gamma, mask=inside)
    unusable = np.mean(~observed.valid[inside])
    if unusable > MOST_SATURATED:
        raise InputError("pixels_saturated_defective_lower", path=path, unusable=unusable)
    # no model of the light cuts a calibration's pixels near white, as it does a frame's
    full = full_scale(depth)
    level = np.inf if depth is None else saturation_level(raw, full=full) / full
    valid = observed.valid & below_saturation(observed.raw, observed.raw_sigma, level)
    linear = observed.light.astype(float)
    return Shot(
        **(vars(observed) | {"name": str(item.file), "valid": valid}
           | {"light": linear if dark is None else linear - dark}),
        load_n=item.load_n, bright=given.polariscope.field == "bright",
        no_load_light=no_load_light,
    )  # fmt: skip


def read_one_frame(
    path: Path | ArrayFrames, frames: Frames, camera: Camera, in_colour: bool = False, **light: Any
) -> tuple[Array, FrameReader]:
    """The one image of a file as stored, and its reader, closed; `light` as for `open_frames`."""
    light |= {"rotate_deg": frames.rotate_deg, "flip": frames.flip, "roi": frames.roi}
    with open_frames(path, bit_depth=camera.bit_depth, **light) as reader:
        if in_colour and reader.channel is None:
            raise InputError("grey_give_colour_images", path=path)
        check_scale(reader, camera)
        images = [frame.image for _, frame in zip(range(2), reader, strict=False)]
        if len(images) != 1:
            raise InputError("holds_more_one_frame", path=path)
        return images[0], reader


SUMMARY = ("fringe_value_n_per_mm", "standard_uncertainty", "chi", "order_at_zero_load")
"""What the result tells of each channel."""


def calibrate_channels(
    given: CalibrationSet, run: Callable[[tuple[Shot, ...], CalibrationSet], Calibration]
) -> Calibration:
    """Run a calibration, of colour images once a channel: the value is that of the one that sees
    polariscope.wavelength_nm best (green where that is not given), whose refusal counts.
    """
    scope = given.polariscope
    if given.frames.channel is not None or (scope.wavelength_nm and scope.lines is None):
        return run(read_shots(given), given)
    if not _in_colour(given):
        if scope.lines is not None:
            raise InputError(
                "polariscope_lines_several_wavelengths", name=given.name, file=given.image[0].file
            )
        return run(read_shots(given), given)
    main, table, results = channel_for(scope.wavelength_nm), dict[str, Any](), {}
    poor: list[str] = []
    for channel in CHANNELS:
        frames = given.frames.model_copy(update={"channel": channel})
        try:
            result = run(read_shots(given.model_copy(update={"frames": frames})), given)
        except PhysicsError as error:
            if channel == main:
                raise
            table[channel] = {"refused": str(error)}
            poor.append(channel)
            continue
        if result.chi > POOR_CHI:
            poor.append(channel)
        results[channel], values = result, {name: getattr(result, name) for name in SUMMARY}
        every = getattr(scope.lines, "wavelength_nm", ())
        lines = [w for w in every if channel_for(w) == channel]
        table[channel] = values | {"wavelength_nm": lines[0] if len(lines) == 1 else None}
    messages = [message("colour_images_value_channel", main=main)]
    if poor:
        messages.append(message("one_wavelength_does_not", poor=", ".join(poor)))
    result = results[main]
    return replace(result, channels=table, warnings=(*messages, *result.warnings))


def _in_colour(given: CalibrationSet) -> bool:
    """Whether the first image has three channels that are not copies of one."""
    path, views = given.path(given.image[0].file), []
    for channel in ("red", "blue"):
        with open_frames(path, channel=channel, bit_depth=given.camera.bit_depth) as reader:
            if reader.channel is None:
                return False
            views.append(next(iter(reader)).image)
    return not np.array_equal(views[0], views[1])
