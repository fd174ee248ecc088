"""`process_frame`: one frame of a set, as `process` reads it, without the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from isochrome.frames import Frame, open_scene_frames, with_file_scale
from isochrome.output import numbers
from isochrome.processing.api import check_scene
from isochrome.processing.chunk import frame_row
from isochrome.processing.frame_task import FrameSource, FrameTask, own_scene
from isochrome.processing.processed import fitted_keys
from isochrome.processing.result import CAUSES, SPREAD, ProcessedFrame, causes_of
from isochrome.runs import single_threaded
from isochrome.scene import FramesLike, Scene, check_pixel


@dataclass(frozen=True)
class FrameValue:
    """A value that was fitted to a frame.

    Parameters
    ----------
    key : str
        Its key of the scene.
    value : float
        The value.
    standard_uncertainty : float
        Its standard uncertainty.
    asked : bool
        Whether the frame asked for it, besides the scene's own unknowns.
    """

    key: str
    value: float
    standard_uncertainty: float
    asked: bool


@dataclass(frozen=True)
class FrameResult:
    """What `process` finds in one frame of a set.

    Parameters
    ----------
    frame : ProcessedFrame
        Its maps and warnings.
    row : dict of str to Any
        Its row of frames.csv.
    """

    frame: ProcessedFrame
    row: dict[str, Any]

    @property
    def values(self) -> tuple[FrameValue, ...]:
        """The fitted values; none where the frame does not show the scene's model."""
        fit = self.frame.fit
        if fit is None:
            return self._read_values
        if not self.frame.has_values:
            return ()
        asked = causes_of(self.row.get(CAUSES) or "")
        return tuple(
            FrameValue(key, float(value), float(spread), key in asked)
            for key, value, spread in zip(
                fit.keys, fit.values, fit.standard_uncertainty, strict=True
            )
        )

    @property
    def _read_values(self) -> tuple[FrameValue, ...]:
        """What a frame without a fit has with an uncertainty, where it is known."""
        pairs = {key: (self.row[key], self.row[f"{key} {SPREAD}"]) for key in fitted_keys(self.row)}
        known = {key: pair for key, pair in pairs.items() if np.all(np.isfinite(numbers(pair)))}
        return tuple(FrameValue(key, *pair, asked=False) for key, pair in known.items())


def process_frame(frames: FramesLike, scene: Scene, index: int) -> FrameResult:
    """Read one frame of a set, as `process` reads it.

    Parameters
    ----------
    frames : str, Path, sequence of them, array or sequence of arrays
        The set, as for `process`.
    scene : Scene
        What stood in front of the camera, of the whole set.
    index : int
        Number of the frame from 0; of the state, where several frames make one.

    Returns
    -------
    FrameResult
        What was found.

    Raises
    ------
    InputError
        Where the frame or the scene is wrong.
    PhysicsError
        Where the scene's model cannot be solved.
    """
    check_scene(scene)
    with single_threaded(), open_scene_frames(frames, scene) as reader:
        scene = with_file_scale(scene, reader)
        check_pixel(scene, reader.shape)
        recipe = FrameTask(frames=frames, scene=scene, reader=reader, key="one frame")
        source = FrameSource(recipe)
        try:
            ((number, states),) = source.captured(index, index + 1)
            found = source.processed(number, states)
        finally:
            source.close()
    return FrameResult(found, frame_row(found, recipe))


def one_state(scene: Scene, frame: Frame) -> Scene:
    """Give the scene of one frame alone: its state, by its time or its number.

    Parameters
    ----------
    scene : Scene
        The set's scene, with a model.
    frame : Frame
        The frame.

    Returns
    -------
    Scene
        A scene of one state, whose load, friction and wear are numbers.

    Raises
    ------
    InputError
        Where the frame has no time and needs one.
    """
    return own_scene(scene, frame)
