"""`process_frame`: one frame of a set, as `process` reads it, without the others."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from isochrome.errors import InputError
from isochrome.frames import Frame, open_scene_frames, with_file_scale
from isochrome.processing.api import check_scene
from isochrome.processing.chunk import frame_row
from isochrome.processing.frame_task import FrameSource, FrameTask, own_scene
from isochrome.processing.kinds.anchor_preview import AnchorPreview
from isochrome.processing.result import CAUSES, ProcessedFrame, causes_of
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
        if fit is None or not self.frame.has_values:
            return ()
        asked = causes_of(self.row.get(CAUSES) or "")
        return tuple(
            FrameValue(key, float(value), float(spread), key in asked)
            for key, value, spread in zip(
                fit.keys, fit.values, fit.standard_uncertainty, strict=True
            )
        )


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
    with _captured(frames, scene, index) as (source, number, states):
        found = source.processed(number, states)
    return FrameResult(found, frame_row(found, source.recipe))


def anchor_preview(frames: FramesLike, scene: Scene, index: int) -> AnchorPreview:
    """Follow the fringes of one frame, to say what known orders would make of it.

    Parameters
    ----------
    frames : str, Path, sequence of them, array or sequence of arrays
        The set, as for `process`.
    scene : Scene
        What stood in front of the camera, without a model.
    index : int
        Number of the frame from 0.

    Returns
    -------
    AnchorPreview
        What is asked.

    Raises
    ------
    InputError
        Where the frame or the scene is wrong, or the scene's frames tell their orders themselves.
    """
    if scene.polariscope.several_wavelengths or scene.polariscope.step:
        raise InputError(
            f"{scene.name}: colours and phase steps are read otherwise; press Show what the points "
            "say after setting a point"
        )
    with _captured(frames, scene, index) as (source, _, states):
        return AnchorPreview(states[0], scene, source.capture)


@contextmanager
def _captured(
    frames: FramesLike, scene: Scene, index: int
) -> Iterator[tuple[FrameSource, int, list[Frame]]]:
    """A set that is opened for one of its states, the state's number, and its frames."""
    check_scene(scene)
    with single_threaded(), open_scene_frames(frames, scene) as reader:
        scene = with_file_scale(scene, reader)
        check_pixel(scene, reader.shape)
        recipe = FrameTask(frames=frames, scene=scene, reader=reader, key="one frame")
        source = FrameSource(recipe)
        try:
            ((number, states),) = source.captured(index, index + 1)
            yield source, number, states
        finally:
            source.close()


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
