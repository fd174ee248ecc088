"""Captured frames: reading them from any file, and turning grey levels into fringe signal.

Pixel coordinates are (row, col), colour is RGB; what OpenCV thinks of both stays inside.
"""

from isochrome.frames.check import Check, check_frames
from isochrome.frames.findings import Finding
from isochrome.frames.inputs import absolute, input_files
from isochrome.frames.linear import Linear, find_outliers, to_linear
from isochrome.frames.mask import load_mask
from isochrome.frames.no_load import load_no_load, open_no_load_steps
from isochrome.frames.noise import NoiseModel, estimate_noise, full_scale
from isochrome.frames.normalise import Normalised, normalise
from isochrome.frames.opening import (
    channel_for,
    check_scale,
    open_frames,
    open_scene_frames,
    with_file_scale,
)
from isochrome.frames.reader import CHANNELS, Channel, Frame, FrameReader, FramesPath
from isochrome.frames.recordings import one_recording, recordings_of

__all__ = [
    "CHANNELS",
    "Channel",
    "Check",
    "Finding",
    "Frame",
    "FrameReader",
    "FramesPath",
    "Linear",
    "NoiseModel",
    "Normalised",
    "absolute",
    "channel_for",
    "check_frames",
    "check_scale",
    "estimate_noise",
    "find_outliers",
    "full_scale",
    "input_files",
    "load_mask",
    "load_no_load",
    "normalise",
    "one_recording",
    "open_frames",
    "open_no_load_steps",
    "open_scene_frames",
    "recordings_of",
    "to_linear",
    "with_file_scale",
]
