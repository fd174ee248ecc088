"""A contact's video: key frames are processed wholly, the frames between them are followed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError, IsochromeError
from isochrome.fit.frame_fit import placed
from isochrome.fit.local import GAMMA
from isochrome.fit.smooth import SMOOTH_KEYS
from isochrome.fit.tracker import Tracked, Tracker
from isochrome.fit.unknowns import free_keys
from isochrome.frames import Frame, estimate_noise
from isochrome.process.recipe import OpenSet, Recipe, place_of
from isochrome.process.result import SPREAD, Capture, ProcessedFrame
from isochrome.process.with_model import LOST, POOR_CHI
from isochrome.scene import Scene

Array = NDArray[Any]

EVERY = 200
"""Frames from one key frame to the next: a key frame costs as much as some 200 that are followed,
and what is done between two is lost when a run is killed."""

WHOLE, FOLLOWED, SEARCHED, NOTHING = "whole frame", "track", "search", "nothing"
"""How a frame's values were found, in frames.csv."""

NO_FRINGES = "the scene's fringes are not in this frame"
_AGAIN = "the track was lost, and found again by a full search"
_POOR = "chi is poor: the model does not describe this frame within its noise; a bias may remain"
_FAR = "the model is too far off: no values were told"

_SAME = 1.05
"""Difference of two pictures over what their noise makes of it, up to which they show the same."""
_STRIDE = 4


@dataclass(frozen=True)
class FollowedFrame:
    """A frame between two key frames, of which its tracked values alone are known.

    `index`, `name`, `label`, `distance_m`, `time_s`, `pixel_mm`, `warnings` and `failed` as of a
    ProcessedFrame; `keys` and `tracked`, what was found, None in a frame that failed.
    """

    index: int
    name: str
    label: str
    distance_m: float
    time_s: float | None
    pixel_mm: float | None
    keys: tuple[str, ...]
    tracked: Tracked | None
    warnings: tuple[str, ...]
    failed: bool = False

    @property
    def status(self) -> str:
        """'ok', 'flagged' (there are warnings) or 'failed'."""
        return "failed" if self.failed else "flagged" if self.warnings else "ok"

    def row(self) -> dict[str, Any]:
        """The frame's row of frames.csv."""
        row: dict[str, Any] = {
            "frame": self.index,
            "name": self.name,
            "label": self.label,
            "picture": None,
            "found_by": NOTHING,
            "distance_m": self.distance_m,
            "pixel_mm": self.pixel_mm,
        }
        told = self.tracked
        if told is not None:
            row["chi"] = told.chi
            if np.isfinite(told.values).any():
                row["found_by"] = SEARCHED if told.searched else FOLLOWED
            pairs = zip(self.keys, told.values, told.standard_uncertainty, strict=True)
            for key, value, spread in pairs:
                row |= {key: float(value), f"{key} {SPREAD}": float(spread)}
        return row | {"warnings": "; ".join(self.warnings)}

    def more(self) -> dict[str, Any]:
        """What the dataset knows besides the row."""
        place = dict(zip(self.keys, self.tracked.values, strict=True)) if self.tracked else {}
        return {
            "status": self.status,
            "time_s": self.time_s,
            "left_mm": float(place.get("camera.left_mm", np.nan)),
            "top_mm": float(place.get("camera.top_mm", np.nan)),
            "read": False,
            "kept": None,
        }


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
    Tracker(placed(_sliding(scene), shape), free_keys(scene), bit_depth=None)


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
    course: _Course | None = None
    for index, frames in source.captured(start, stop):
        frame = replace(frames[0], index=index)
        if index % every == 0:
            key = source.processed(index, frames)
            course = _Course(source, key)
            if not key.failed:
                course.begin(frame, key)
            yield key
        else:
            assert course is not None
            yield course.follow(frame)


class _Course:
    """The frames from one key frame to the next."""

    def __init__(self, source: OpenSet, key: ProcessedFrame) -> None:
        """`source`; `key`, the processed key frame, from whose values the track starts."""
        capture = source.capture
        assert isinstance(capture, Capture)
        self.recipe: Recipe = source.recipe
        self.capture, self.noise = capture, key.noise
        scene = _sliding(self.recipe.scene)
        self.scene = _begun(placed(scene, source.reader.shape), key)
        self.keys = free_keys(scene)
        self.tracker = Tracker(
            self.scene,
            self.keys,
            bit_depth=capture.bit_depth,
            no_load=(capture.dark, capture.bright),
        )
        self._empty: tuple[Array, float, Tracked] | None = None

    def begin(self, frame: Frame, key: ProcessedFrame) -> None:
        """Start the track in the key frame itself: where its fit ended, if it told anything.

        A worn contact is searched for there once more, as the track begins with the scar.
        """
        _, distance = place_of(self.recipe.scene, frame)
        fit = key.fit
        if fit is not None and np.isfinite(fit.values).all() and self.scene.wear is None:
            course = self.tracker.course
            values = course.from_scene(fit.scene, course.start(None))
            self.tracker.resume(
                {
                    "values": values.tolist(),
                    "pace": [0.0] * len(self.keys),
                    "reference": max(1.0, fit.chi),
                    "course": course.state(),
                }
            )
        self._track(frame, distance)

    def _slid(self, distance_m: float) -> float | None:
        """The distance as the tracker takes it: none where nothing wears."""
        return distance_m if self.scene.wear else None

    def follow(self, frame: Frame) -> FollowedFrame:
        """One frame more. Raises InputError."""
        label, distance = place_of(self.recipe.scene, frame)
        camera = self.scene.camera
        found = FollowedFrame(
            frame.index,
            frame.name,
            label,
            distance,
            frame.time_s,
            camera.pixel_mm if camera else None,
            self.keys,
            None,
            (),
        )
        try:
            tracked = self._track(frame, distance)
        except IsochromeError as error:
            if not self.recipe.keep_going:
                raise
            return replace(found, warnings=(str(error),), failed=True)
        tracked, warnings = self._judged(tracked)
        return replace(found, tracked=tracked, warnings=warnings)

    def _track(self, frame: Frame, distance_m: float) -> Tracked:
        """The tracked values; of a frame like one without fringes no search is made again."""
        thin = frame.image[::_STRIDE, ::_STRIDE].astype(np.float32)
        if self._empty is not None:
            picture, noise, nothing = self._empty
            change = float(np.sqrt(np.nanmean(np.square(thin - picture))))
            if change <= _SAME * np.sqrt(2.0) * noise:
                return nothing
        found = self.tracker.track(frame, self._slid(distance_m))
        self._empty = None
        if not found.positive:
            model = estimate_noise(frame.image, frame.mask, bit_depth=self.capture.bit_depth)
            noise = float(np.sqrt(np.nanmean(np.square(model.sigma(thin)))))
            self._empty = (thin, noise, found)
        return found

    def _judged(self, found: Tracked) -> tuple[Tracked, tuple[str, ...]]:
        """A frame's values, none where they mean nothing, and what to say of them."""
        if not found.positive:
            return found, (NO_FRINGES,)
        if found.chi * self.noise > LOST:
            nothing = np.full(len(self.keys), np.nan)
            return replace(found, values=nothing, standard_uncertainty=nothing), (_FAR,)
        said = (_AGAIN,) if found.searched else ()
        return found, (*said, _POOR) if found.chi > POOR_CHI else said


def _sliding(scene: Scene) -> Scene:
    """The scene of a video by time, whose frames are all of one kind."""
    if scene.frames.sliding_speed_mm_per_s is None or scene.friction is None:
        return scene
    return scene.with_values({"friction.static_state_first": False})


def _begun(scene: Scene, key: ProcessedFrame) -> Scene:
    """The scene with a key frame's own values, where it has numbers and the frame told them.

    What is not tracked, as an unknown gamma or a smooth stress, stays as the key frame says.
    """
    if key.fit is None or key.failed:
        return scene
    values = {
        name: float(value)
        for name, value in zip(key.fit.keys, key.fit.values, strict=True)
        if np.isfinite(value) and (name in (GAMMA, *SMOOTH_KEYS) or _is_number(scene, name))
    }
    return scene.with_values(values)


def _is_number(scene: Scene, key: str) -> bool:
    value = scene.get(key)
    return isinstance(value, int | float) and not isinstance(value, bool)
