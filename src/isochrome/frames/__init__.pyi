from .checks import Check, Finding, Level, look_through, misfits
from .containers import begins_anew, length_bytes
from .linear import (
    Linear,
    Normalised,
    find_outliers,
    is_unloaded,
    likely_no_load,
    load_no_load,
    normalise,
    open_no_load_steps,
    to_linear,
)
from .mask import load_mask
from .noise import NoiseModel, estimate_noise, full_scale, noise_between_pixels
from .opening import (
    absolute,
    channel_for,
    check_scale,
    input_files,
    named_files,
    one_recording,
    open_frames,
    open_scene_frames,
    recordings_of,
    with_file_scale,
)
from .readers.tiff import open_tiff
from .reading import CHANNELS, Channel, Frame, FrameReader, FramesPath, SequentialFrames
from .saturation import saturation_level
from .source import as_captured, as_turned

__all__ = [
    "CHANNELS",
    "Channel",
    "Check",
    "Finding",
    "Frame",
    "FrameReader",
    "FramesPath",
    "Level",
    "Linear",
    "NoiseModel",
    "Normalised",
    "SequentialFrames",
    "absolute",
    "as_captured",
    "as_turned",
    "begins_anew",
    "channel_for",
    "check_scale",
    "estimate_noise",
    "find_outliers",
    "full_scale",
    "input_files",
    "is_unloaded",
    "length_bytes",
    "likely_no_load",
    "load_mask",
    "load_no_load",
    "look_through",
    "misfits",
    "named_files",
    "noise_between_pixels",
    "normalise",
    "one_recording",
    "open_frames",
    "open_no_load_steps",
    "open_scene_frames",
    "open_tiff",
    "recordings_of",
    "saturation_level",
    "to_linear",
    "with_file_scale",
]
