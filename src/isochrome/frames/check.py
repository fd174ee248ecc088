"""What is wrong with a set of frames, in plain words, before a long run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from isochrome.errors import InputError
from isochrome.frames.findings import Finding, of_depth, of_light, of_no_load
from isochrome.frames.opening import check_scale, open_scene_frames, with_file_scale
from isochrome.frames.reader import FrameReader, FramesPath
from isochrome.frames.survey import Survey, survey
from isochrome.scene import Scene, check_pixel


@dataclass(frozen=True)
class Check:
    """What was found: `findings`, errors first; `count` of frames read; `shape` (rows, cols)."""

    findings: tuple[Finding, ...]
    count: int
    shape: tuple[int, int] | None

    @property
    def ok(self) -> bool:
        """Whether no finding is an error."""
        return all(f.level != "error" for f in self.findings)


def check_frames(path: FramesPath, scene: Scene) -> Check:
    """Look through captured frames once, and say what is wrong with them for this scene.

    Parameters: `path`, as for `open_frames`; `scene`. Returns a Check; frames that cannot be read
    are a finding of it, not an exception.
    """
    found = list(_of_scene(scene))
    try:
        reader = open_scene_frames(path, scene, any_scale=True)
    except InputError as error:
        return _sorted([Finding("error", None, str(error)), *found], 0, None)
    with reader:
        seen = survey(reader)
    if seen.failure is not None:
        found.append(Finding("error", seen.count, seen.failure))
    found += _of_file(reader, scene)
    if seen.failure is None:
        found += _of_count(reader, seen, scene)
    found += of_depth(reader, seen)
    found += of_light(reader, seen)
    found += of_no_load(reader, seen, scene)
    return _sorted(found, seen.count, reader.shape)


def _sorted(found: Iterable[Finding], count: int, shape: tuple[int, int] | None) -> Check:
    order = ("error", "warning", "note")
    return Check(tuple(sorted(found, key=lambda f: order.index(f.level))), count, shape)


def _of_scene(scene: Scene) -> Iterator[Finding]:
    shape = scene.specimen.shape
    rest = "process still gives normalised frames, fringe lines, and orders from known points"
    if scene.model is None and shape is not None:
        what = "a ring" if shape == "ring" else f"a specimen of shape '{shape}'"
        yield Finding("warning", None, f"{what} has no model yet: no simulation and no fit; {rest}")
    elif scene.model is None:
        text = f"the scene has no [indenter] and no specimen.shape, so it has no model; {rest}"
        yield Finding("note", None, text)


def _of_file(reader: FrameReader, scene: Scene) -> Iterator[Finding]:
    rows, cols = reader.shape
    camera = scene.camera
    for check in (
        lambda: check_scale(reader, camera),
        lambda: check_pixel(with_file_scale(scene, reader), reader.shape),
    ):
        try:
            check()
        except InputError as error:
            yield Finding("error", None, str(error))
    if camera is not None:
        wanted = (camera.height_px or rows, camera.width_px or cols)
        if wanted != (rows, cols):
            after = "after the roi" if reader.roi else "(no frames.roi is set)"
            yield Finding(
                "error",
                None,
                f"frames are {rows} rows x {cols} columns {after} and the scene's camera is "
                f"{wanted[0]} x {wanted[1]}; correct camera.height_px and width_px, or frames.roi",
            )
    for i, known in enumerate(scene.frames.known_order, start=1):
        if known.row_px >= rows or known.col_px >= cols:
            text = f"frames.known_order[{i}] at row {known.row_px}, column {known.col_px} lies "
            yield Finding("error", None, f"{text}outside {rows} x {cols} pixels; move it")
    if reader.channel is not None:
        text = f"colour frames: the {reader.channel} channel is used; frames.channel changes it"
        yield Finding("note", None, text)
    names = reader.names or (str(reader.path),)
    if reader.mask is not None:
        text = f"the mask takes {100 * reader.mask.mean():.1f} % of the pixels for the specimen"
        yield Finding("note", None, text)
    lossy = reader.kind == "video" or names[0].lower().endswith((".jpg", ".jpeg", ".webp"))
    if lossy:
        text = (
            "JPEG and video are compressed with loss, which hides camera noise; chi will look "
            "better than it is: TIFF or PNG keep it"
        )
        yield Finding("note", None, text)
    if scene.frames.gamma == 1 and (lossy or reader.channel is not None):
        text = (
            "frames.gamma = 1 says that grey levels are proportional to light; ordinary cameras "
            "store light^(1 / 2.2) in such files: set frames.gamma = 2.2 if yours does"
        )
        yield Finding("note", None, text)


def _of_count(reader: FrameReader, seen: Survey, scene: Scene) -> Iterator[Finding]:
    steps, wear = len(scene.polariscope.step), scene.wear
    timed = scene.frames.sliding_speed_mm_per_s is not None
    if steps and seen.count % steps:
        yield Finding(
            "error",
            None,
            f"{seen.count} frames are not a multiple of the polariscope's {steps} steps; give one "
            "frame for each [[polariscope.step]]",
        )
    elif wear is not None and not timed:
        first = scene.friction is not None and scene.friction.static_state_first
        states = (len(wear.distances_m) + int(first)) * max(steps, 1)
        if seen.count != states:
            what = "wear.distances_m" + (" and the static state first" if first else "")
            yield Finding(
                "error",
                None,
                f"{seen.count} frames, and the scene has {states} states ({what}); give one frame "
                "a state, correct the list, or set frames.sliding_speed_mm_per_s for a video",
            )
    if timed and seen.untimed:
        text = f"{seen.untimed} of {seen.count} frames carry no time, and sliding_speed_mm_per_s "
        yield Finding("error", None, text + "needs it; remove that key, or give a timed video")
    claimed = reader.claimed_count
    if claimed is not None and claimed != seen.count:
        text = f"the video's head claims {claimed} frames and {seen.count} can be decoded; is it "
        yield Finding("warning", None, text + "whole? (some writers claim wrongly)")
