"""`check`: what is wrong with frames, and what one of them asks for, before a long run."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

from isochrome.errors import InputError, PhysicsError
from isochrome.frames import (
    Check,
    Finding,
    Frame,
    FrameReader,
    Level,
    load_no_load,
    look_through,
    open_scene_frames,
    with_file_scale,
)
from isochrome.messages import message
from isochrome.output import named_frames
from isochrome.processing.frame_task import own_scene
from isochrome.processing.kinds.image_only import told_exposure
from isochrome.processing.kinds.known_loads import known_series, process_known_loads, tells_load
from isochrome.processing.kinds.with_model import frame_causes
from isochrome.processing.result import Capture
from isochrome.runs import single_threaded
from isochrome.scene import FramesLike, Scene, SceneLike, load_scene

_FIRST = 3
"""Frames from the first on in which the scene's fringes are looked for, and then one in the middle
of the set: one takes seconds."""


_OF_LOST = {"disc": "disc_of_residual_stress"}
"""What there is for a scene that explains no frame, by its model."""


def check(path: FramesLike, scene: SceneLike) -> Check:
    """Look through captured frames once, and say what is wrong with them for this scene.

    Counts, sizes, times, bit depth, exposure, saturation, noise and no-load frames are looked at,
    in one pass with one frame in memory; a frame that shows the unloaded specimen among loaded ones
    is named. Where they can be the scene's, and it has a model, the
    first frame that shows its fringes is fitted, and what it asks for besides what the scene states
    is a warning, as `process` says it: the key that mends it, and its value. A slip in the scene
    with which nothing can be read, such as a picture that lies otherwise, is an error, and so is a
    model that is too far from all frames that are looked at: `process` gives no value then. Without
    a model frames that are exposed otherwise than both no-load frames are named with their factor.

    Parameters
    ----------
    path : str, Path, sequence of them, array or sequence of arrays
        The frames, as for `open_frames`.
    scene : str, Path, Scene or mapping
        What stood in front of the camera, as `load_scene` takes it.

    Returns
    -------
    Check
        The findings, errors first; frames that cannot be read are a finding, not an exception.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("ring").with_values({
    ...     "load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
    ...     "camera.pixel_mm": 0.36, "camera.noise_grey": 1.0})
    >>> simulated = isochrome.simulate(scene, "simulated")
    >>> found = isochrome.check("simulated/frames.tif", scene)
    >>> found.ok, found.count
    (True, 1)
    """
    scene = load_scene(scene)
    result = look_through(path, scene)
    frames = scene.frames
    tells = scene.has_model or (frames.no_load_dark and frames.no_load_bright)
    orders_told = scene.polariscope.tells_orders  # by their states themselves
    if not result.ok or not result.count or orders_told or not tells:
        return result
    with single_threaded():
        return result.with_more(_by_fringes(path, scene, result.count))


def _by_fringes(path: FramesLike, scene: Scene, count: int) -> Iterator[Finding]:
    """What the fringes of some frames say of the scene."""
    with open_scene_frames(path, scene) as reader:
        scene = with_file_scale(scene, reader)
        capture = Capture(reader.bit_depth, *load_no_load(scene, full_shape=reader.full_shape))
        if scene.frames.has_known_loads:
            yield from _against_others(reader, scene, capture)
            return
        if not scene.has_model:
            for frame in islice(reader, _FIRST + 1):  # exposed otherwise than no-load frames
                for text in told_exposure(frame, own_scene(scene, frame), capture):
                    yield Finding("warning", f"{named_frames([frame.index])}: " + text, frame.index)
            return
        tried = {*range(_FIRST), count // 2}
        frames = (frame for frame in islice(reader, max(tried) + 1) if frame.index in tried)
        yield from _asked(frames, scene, capture, count)


def _against_others(reader: FrameReader, scene: Scene, capture: Capture) -> Iterator[Finding]:
    """What some frames' loads say, each read against the frames of known loads."""
    try:
        series = known_series(scene, reader)
    except (InputError, PhysicsError) as error:
        yield Finding("error", str(error))
        return
    capture_of_set = replace(capture, series=series)
    looked = [f for f in reader if f.index in (0, len(scene.frames.known_loads_n) // 2)]
    result = [process_known_loads(frame, scene, capture_of_set) for frame in looked]
    read = any(tells_load(frame) for frame in result)
    for frame in result:
        for text in frame.warnings[:1] if not tells_load(frame) else ():
            level: Level = "warning" if read else "error"
            yield Finding(level, f"{named_frames([frame.index])}: " + text, frame.index)


def _asked(
    frames: Iterator[Frame], scene: Scene, capture: Capture, count: int
) -> Iterator[Finding]:
    """What the first frame that the scene explains asks for; why, where it explains none."""
    bare: list[int] = []
    lost: list[Finding] = []
    refused = None
    for frame in frames:
        reading = None
        try:
            reading = frame_causes(frame, own_scene(scene, frame), capture)
        except (InputError, PhysicsError) as error:
            refused = refused or str(error)
        if reading is None:
            bare.append(frame.index)
            continue
        texts, explained = reading
        level: Level = "error" if explained == "with a slip" else "warning"
        findings = [
            Finding(level, f"{named_frames([frame.index])}: {t}", frame.index) for t in texts
        ]
        if explained != "not at all":
            yield from findings
            return
        lost = lost or findings
    code = _OF_LOST.get(scene.model or "")
    more = message(code) if code else ""
    if lost:
        *before, last = lost
        yield from before
        yield replace(last, level="error", text=last.text + more)
    if bare:
        text = refused or message("scene_fringes_not_there") + more
        grave: Level = "error" if len(bare) == count else "warning"
        yield Finding(grave, f"{named_frames(bare)}: " + text)
