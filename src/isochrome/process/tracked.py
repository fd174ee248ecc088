"""A contact's video: key frames are processed wholly, the frames between them are followed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from isochrome.errors import InputError
from isochrome.fit.frame_fit import placed
from isochrome.fit.tracker import Tracker
from isochrome.fit.unknowns import free_keys
from isochrome.process.course import Course, sliding
from isochrome.process.followed import FollowedFrame
from isochrome.process.recipe import OpenSet
from isochrome.process.result import ProcessedFrame
from isochrome.scene import Scene
from isochrome.simulate.model import surface_field_grid

EVERY = 200
"""Frames from one key frame to the next: a key frame costs as much as some 200 that are followed,
and what is done between two is lost when a run is killed."""


def check_tracked(scene: Scene, shape: tuple[int, int], every: int) -> None:
    """Refuse a scene whose frames cannot be followed. Raises InputError.

    Parameters: `scene`; `shape` (rows, cols) of a frame; `every`, frames to the next key frame.
    """
    if every < 2:
        raise InputError(
            f"--every {every}: give 2 or more; without --track every frame is processed wholly"
        )
    if scene.model != "contact":
        what = f"a {scene.model}" if scene.model else "a scene without a model"
        raise InputError(
            f"{scene.name}: {what} cannot be tracked, only a contact can; leave --track out"
        )
    if scene.polariscope.step or scene.polariscope.several_wavelengths:
        raise InputError(
            f"{scene.name}: phase steps and colours tell each state by itself, and are not "
            "tracked; leave --track out"
        )
    Tracker(placed(sliding(scene), shape), free_keys(scene), bit_depth=None)


def tracked_states(
    source: OpenSet, start: int, stop: int
) -> Iterator[ProcessedFrame | FollowedFrame]:
    """What is found in the frames [start, stop) of a video.

    Key frames, each `recipe.every`-th from 0, are processed as if there were no others; each of
    the other frames is followed from the key frame before it, whose own chunk thus suffices.
    Parameters: `source`; `start`, a key frame; `stop`. Raises InputError, PhysicsError.
    """
    every = source.recipe.every
    assert every is not None and start % every == 0
    course = Course(source)
    for index, frames in source.captured(start, stop):
        frame = replace(frames[0], index=index)
        if index % every == 0:
            key = source.processed(index, frames)
            surface_field_grid.cache_clear()  # of its own place, as large as ten pictures
            course = Course(source)
            course.begin(frame, key)
            yield key
        else:
            yield course.follow(frame)
