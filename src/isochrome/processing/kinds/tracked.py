"""A contact's video: key frames are processed wholly, the frames between them are followed.

Where maps of all frames are wanted, the orders of each are read on the branches of its followed
model, by the same reading as of a frame that is processed by itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from isochrome.errors import InputError, IsochromeError, PhysicsError
from isochrome.fitting import (
    GAMMA,
    SMOOTH_KEYS,
    Tracked,
    Tracker,
    VainSearch,
    free_keys,
    nothing_found,
    placed,
    slid_until,
    sliding_scene,
)
from isochrome.frames import Frame, FrameReader
from isochrome.processing.frame_task import FrameSource, FrameTask, place_of
from isochrome.processing.kinds.largest_order import largest_with_model
from isochrome.processing.kinds.with_model import of_share, read_frame
from isochrome.processing.result import (
    FollowedFrame,
    ProcessedFrame,
    failed_frame,
    frame_fields,
)
from isochrome.scene import Scene
from isochrome.specimens import surface_field_grid

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
    if scene.indenter is None:
        what = f"a {scene.model}" if scene.model else "a scene without a model"
        raise InputError(
            f"{scene.name}: {what} cannot be tracked, only a contact can; leave --track out"
        )
    if scene.polariscope.tells_orders:
        raise InputError(
            f"{scene.name}: phase steps and colours determine each state by itself, and are not "
            "tracked; leave --track out"
        )
    Tracker(placed(sliding_scene(scene), shape), free_keys(scene), bit_depth=None)


def is_followed(scene: Scene, reader: FrameReader) -> bool:
    """Whether a set is a video of a contact whose frames can be followed."""
    if reader.kind != "video":
        return False
    try:
        check_tracked(scene, reader.shape, EVERY)
    except InputError:
        return False
    return True


def tracked_states(
    source: FrameSource, start: int, stop: int
) -> Iterator[ProcessedFrame | FollowedFrame]:
    """What is found in the frames [start, stop) of a video.

    Key frames, each `recipe.every`-th from 0, are processed as if there were no others; each of
    the other frames is followed from the key frame before it, whose own chunk thus suffices.
    Parameters: `source`; `start`, a key frame; `stop`. Raises InputError, PhysicsError.
    """
    every = source.recipe.every
    assert every is not None and start % every == 0
    course = KeyFrames(source)
    for index, frames in source.captured(start, stop):
        frame = replace(frames[0], index=index)
        if index % every == 0:
            key = source.processed(index, frames)
            surface_field_grid.cache_clear()  # of its own place, as large as ten pictures
            course = KeyFrames(source)
            course.begin(frame, key)
            yield key
        else:
            yield course.follow(frame)


class KeyFrames:
    """The frames from one key frame to the next."""

    def __init__(self, source: FrameSource) -> None:
        """`source`, where frames are processed wholly too."""
        self.source, self.capture = source, source.capture
        self.recipe: FrameTask = source.recipe
        apparatus = self.recipe.apparatus
        given = self.recipe.scene if apparatus is None else apparatus.scene
        self.scene = placed(sliding_scene(given), source.reader.shape)
        self.keys = free_keys(self.scene)
        self._tracker: Tracker | None = None
        self._vain = VainSearch(source.capture.bit_depth)

    def begin(self, frame: Frame, whole: ProcessedFrame) -> None:
        """Start the track where the fit of a wholly processed frame ended, if it told values."""
        if not whole.has_values:
            if not whole.failed:
                self._vain.remember(frame)
            return
        assert whole.fit is not None
        tracker = Tracker(
            _begun(self.scene, whole),
            self.keys,
            bit_depth=self.capture.bit_depth,
            no_load=(self.capture.dark, self.capture.bright),
            apparatus=self.recipe.apparatus,
            usual_load_n=self.scene.load_at(0.0),
        )
        fit, distance = whole.fit, slid_until(self.scene, frame)
        tracker.begin(frame, fit.scene, fit.chi, distance)
        self._tracker = tracker

    def follow(self, frame: Frame) -> FollowedFrame:
        """One frame more. Raises InputError, PhysicsError."""
        label, distance = place_of(self.recipe.scene, frame)
        fields = frame_fields(frame, self.scene) | {"label": label, "distance_m": distance}
        result = FollowedFrame(**fields, keys=self.keys)
        try:
            tracked, whole = self._tracked(frame)
            result = replace(result, tracked=tracked, warnings=tracked.warnings)
            return self._with_map(result, frame, whole) if self.recipe.maps == "all" else result
        except IsochromeError as error:
            if not self.recipe.keep_going:
                raise
            return replace(result, tracked=None, warnings=(str(error),), failed=True)

    def _tracked(self, frame: Frame) -> tuple[Tracked, ProcessedFrame | None]:
        """The tracked values; where there is no track yet, those of the whole frame, as a search.

        What is not tracked, as an unknown gamma or a smooth stress, a whole frame alone tells. The
        whole frame is given too where the values are its own.
        """
        if self._tracker is not None:
            return self._tracker.track(frame, slid_until(self.scene, frame)), None
        if self._vain.is_repeated(frame):
            return nothing_found(len(self.keys)), None
        whole = self._whole(frame)
        self.begin(frame, whole)
        if not whole.has_values:
            return nothing_found(len(self.keys)), None
        return self._of_whole(whole), whole

    def _with_map(
        self, found: FollowedFrame, frame: Frame, whole: ProcessedFrame | None
    ) -> FollowedFrame:
        """A followed frame with its orders, read on the branches of the followed model.

        Raises InputError, PhysicsError.
        """
        tracked = found.tracked
        if whole is not None and whole.fit is not None:
            own = {name: getattr(whole, name) for name in ("reading", "noise", "largest")}
            return replace(found, scene=whole.fit.scene, **own)
        if self._tracker is None or tracked is None or not tracked.positive:
            return found
        data, seen, scene = self._tracker.model_frame(frame)
        reading, noise, lost = read_frame(
            frame, data, seen, chi=tracked.chi, positive=tracked.positive
        )
        if lost:
            return found
        largest, of_largest = largest_with_model(reading, seen, scene)
        said = (*found.warnings, *of_share(reading), *of_largest)
        return replace(
            found, reading=reading, noise=noise, scene=scene, largest=largest, warnings=said
        )

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
        result = np.full((3, len(self.keys)), np.nan)
        for k, key in enumerate(self.keys):
            if key in fit.keys:
                j = fit.keys.index(key)
                result[:, k] = fit.values[j], fit.standard_uncertainty[j], fit.cramer_rao_bound[j]
        values, spread, bound = result
        return Tracked(
            values=values,
            standard_uncertainty=spread,
            cramer_rao_bound=bound,
            chi=fit.chi,
            searched=True,
            positive=True,
        )


def _begun(scene: Scene, key: ProcessedFrame) -> Scene:
    """The scene with a key frame's own values, where it has numbers and the frame told them.

    What is not tracked, as an unknown gamma or a smooth stress, stays as the key frame says.
    """
    if key.fit is None or key.failed:
        return scene
    own = (GAMMA, *SMOOTH_KEYS)
    values = {
        name: float(value)
        for name, value in zip(key.fit.keys, key.fit.values, strict=True)
        if np.isfinite(value) and (name in own or isinstance(scene.get(name), int | float))
    }
    return scene.with_values(values)
