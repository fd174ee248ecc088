"""The frames from one key frame of a tracked video to the next: followed, lost and found."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import IsochromeError, PhysicsError
from isochrome.fit.frame_fit import placed
from isochrome.fit.local import GAMMA
from isochrome.fit.smooth import SMOOTH_KEYS
from isochrome.fit.tracker import Tracked, Tracker
from isochrome.fit.unknowns import free_keys
from isochrome.frames import Frame, estimate_noise
from isochrome.process.followed import AGAIN, FAR, NO_FRINGES, POOR, FollowedFrame
from isochrome.process.recipe import OpenSet, Recipe, place_of
from isochrome.process.result import Capture, ProcessedFrame, failed_frame
from isochrome.process.with_model import LOST, POOR_CHI
from isochrome.scene import Scene

Array = NDArray[Any]

_SAME = 1.05
"""Difference of two pictures over what their noise makes of it, up to which they show the same."""
_STRIDE = 4


def is_told(found: ProcessedFrame) -> bool:
    """Whether a frame that was processed wholly shows the scene, and so has values."""
    return found.fit is not None and bool(np.isfinite(found.fit.values).all())


class Course:
    """The frames from one key frame to the next."""

    def __init__(self, source: OpenSet) -> None:
        """`source`, where frames are processed wholly too."""
        assert isinstance(source.capture, Capture)
        self.source, self.capture = source, source.capture
        self.recipe: Recipe = source.recipe
        self.scene = placed(sliding(self.recipe.scene), source.reader.shape)
        self.keys = free_keys(self.scene)
        self.noise = float("nan")
        self._tracker: Tracker | None = None
        self._vain: tuple[Array, float] | None = None
        self._doubt = False

    def begin(self, frame: Frame, whole: ProcessedFrame) -> None:
        """Start the track in a frame that was processed wholly, where it told its values.

        The track begins where that fit ended; a worn contact is searched for there once more, as
        its track begins with its scar.
        """
        if not is_told(whole):
            if not whole.failed:
                self._remember(frame)
            return
        assert whole.fit is not None
        begun = _begun(self.scene, whole)
        tracker = Tracker(
            begun,
            self.keys,
            bit_depth=self.capture.bit_depth,
            no_load=(self.capture.dark, self.capture.bright),
        )
        distance = self._slid(frame)
        if begun.wear is None:
            course = tracker.course
            values = course.from_scene(whole.fit.scene, course.start(distance))
            tracker.resume(
                {
                    "values": values.tolist(),
                    "pace": [0.0] * len(self.keys),
                    "reference": max(1.0, whole.fit.chi),
                    "course": course.state(),
                }
            )
        tracker.track(frame, distance)
        self._tracker, self.noise = tracker, whole.noise

    def follow(self, frame: Frame) -> FollowedFrame:
        """One frame more. Raises InputError, PhysicsError."""
        label, distance = place_of(self.recipe.scene, frame)
        pixel = self.scene.camera.pixel_mm if self.scene.camera else None
        found = FollowedFrame(
            frame.index, frame.name, label, distance, frame.time_s, pixel, self.keys, None, ()
        )
        try:
            tracked = self._tracked(frame)
        except IsochromeError as error:
            if not self.recipe.keep_going:
                raise
            return replace(found, warnings=(str(error),), failed=True)
        if tracked is None:
            return replace(found, tracked=_nothing(len(self.keys)), warnings=(NO_FRINGES,))
        tracked, warnings = self._judged(tracked)
        return replace(found, tracked=tracked, warnings=warnings)

    def _slid(self, frame: Frame) -> float | None:
        """The distance (m) as the tracker takes it: none where nothing wears."""
        return place_of(self.recipe.scene, frame)[1] if self.scene.wear else None

    def _tracked(self, frame: Frame) -> Tracked | None:
        """The tracked values, None where the frame does not show the scene's fringes.

        What a search has found is processed wholly, which alone tells fringes from what is none.
        """
        if self._is_vain(frame):
            return None
        if self._tracker is None:
            whole = self._whole(frame)
            self.begin(frame, whole)
            return self._of_whole(whole) if is_told(whole) else None
        found = self._tracker.track(frame, self._slid(frame))
        searched = found.searched or self._doubt
        if not found.positive or (searched and not is_told(self._whole(frame))):
            self._doubt = found.positive  # it is followed from there, until it is seen anew
            self._remember(frame)
            return None
        self._doubt, self._vain = False, None
        return replace(found, searched=searched)

    def _whole(self, frame: Frame) -> ProcessedFrame:
        """A frame as if it were a key frame; nothing where the physics is refused."""
        try:
            return self.source.processed(frame.index, [frame])
        except PhysicsError as error:
            return replace(failed_frame(frame, str(error)), failed=False)

    def _of_whole(self, whole: ProcessedFrame) -> Tracked:
        """The values of a frame that was processed wholly, as if they had been tracked."""
        fit = whole.fit
        assert fit is not None
        found = np.full((3, len(self.keys)), np.nan)
        for k, key in enumerate(self.keys):
            if key in fit.keys:
                j = fit.keys.index(key)
                found[:, k] = fit.values[j], fit.standard_uncertainty[j], fit.cramer_rao_bound[j]
        values, spread, bound = found
        return Tracked(values, spread, bound, fit.chi, searched=True, positive=True)

    def _is_vain(self, frame: Frame) -> bool:
        """Whether a frame shows the same as the last one that was searched in vain."""
        if self._vain is None:
            return False
        picture, noise = self._vain
        change = float(np.sqrt(np.nanmean(np.square(_thin(frame) - picture))))
        return change <= _SAME * np.sqrt(2.0) * noise

    def _remember(self, frame: Frame) -> None:
        """Keep a frame that was searched in vain."""
        thin = _thin(frame)
        model = estimate_noise(frame.image, frame.mask, bit_depth=self.capture.bit_depth)
        self._vain = thin, float(np.sqrt(np.nanmean(np.square(model.sigma(thin)))))

    def _judged(self, found: Tracked) -> tuple[Tracked, tuple[str, ...]]:
        """A frame's values, none where they mean nothing, and what to say of them."""
        if found.chi * self.noise > LOST:
            return _nothing(len(self.keys), found.chi), (FAR,)
        said = (AGAIN,) if found.searched else ()
        return found, (*said, POOR) if found.chi > POOR_CHI else said


def _thin(frame: Frame) -> Array:
    """Some of a frame's pixels."""
    return frame.image[::_STRIDE, ::_STRIDE].astype(np.float32)


def _nothing(count: int, chi: float = float("nan")) -> Tracked:
    """A frame without values."""
    nan = np.full(count, np.nan)
    return Tracked(nan, nan, nan, chi, searched=False, positive=False)


def sliding(scene: Scene) -> Scene:
    """The scene of a video by time, all of whose frames slide: none is static first."""
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
