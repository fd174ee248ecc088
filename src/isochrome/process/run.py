"""`process`: the fringe order of every captured frame, one frame in memory at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from isochrome.errors import InputError
from isochrome.fit.one_state import frame_scene, scene_at
from isochrome.frames import Frame, FrameReader, load_no_load, open_scene_frames
from isochrome.fringes.residual import Residual
from isochrome.fringes.steps import make_design
from isochrome.optics import make_chain
from isochrome.output.roi import load_roifile
from isochrome.process.colour import (
    check_colour,
    colour_capture,
    colour_frames,
    process_colour,
)
from isochrome.process.folder import write_folder
from isochrome.process.image_only import process_image_only
from isochrome.process.processed import Processed, collect
from isochrome.process.result import Capture, ProcessedFrame
from isochrome.process.stepped import load_residual, process_stepped, states_of
from isochrome.process.with_model import process_with_model
from isochrome.progress import Progress, counted
from isochrome.scene import Scene, load_scene


def process(
    frames: str | Path,
    scene: str | Path | Scene,
    out: str | Path | None = None,
    *,
    rois: bool = False,
    progress: Progress | None = None,
) -> Processed:
    """Fringe order of every frame of a captured set.

    With a model, each frame's unknowns (load, place, friction, wear) are fitted to its intensity
    on their own, and each pixel is read on the branch that the fit names. Without one, frames are
    normalised and their fringe skeletons found; that is said in the warnings. Where the scene has
    [[polariscope.step]], as many frames as steps make one state, whose order and isoclinic angle
    are read from them without any model; with frames.no_load_steps the residual stress is taken
    out of them. So is the order of colour frames in light of several wavelengths, from their
    colours.
    Parameters: `frames`, a TIFF stack, image, folder or video; `scene`; `out`, a folder for
    frames.csv, fringe_order.tif, confidence.tif, normalised.tif, skeleton.csv (fringe lines, where
    no model was fitted), isoclinic.tif (steps: degrees, direction of sigma_1), residual_order.tif
    and residual_isoclinic.tif (of the no-load steps), fitted_scene.toml (to simulate what was
    found), scene.toml, provenance.json and process.png; `rois`, whether skeleton.csv and
    skeleton.zip, the lines as ImageJ ROIs that lie on these maps, are wanted of every frame;
    `progress`, called with (done, all).
    Returns Processed, with the frames in memory only without `out`. Raises InputError,
    PhysicsError.
    """
    scene = load_scene(scene)
    coloured = scene.polariscope.several_wavelengths
    if coloured:
        check_colour(scene)
    elif scene.frames.colour_table is not None:
        raise InputError(
            f"{scene.name}: frames.colour_table is for light of several wavelengths; add "
            "polariscope.light = 'white', or remove the table"
        )
    steps = len(scene.polariscope.step)
    if rois:
        load_roifile()  # missing, it is to be said before hours of work
    if scene.model is None and scene.polariscope.field == "plane" and not steps:
        raise InputError(
            f"{scene.name}: polariscope.field = 'plane': without a model, isoclinics cannot be "
            "told from fringes; capture the circular dark or bright field, or describe the model"
        )
    if steps:
        _check_steps(scene)
    elif scene.frames.no_load_steps is not None:
        raise InputError(
            f"{scene.name}: frames.no_load_steps needs [[polariscope.step]], one for each of its "
            "frames; add them, or remove the key"
        )
    with open_scene_frames(frames, scene) as reader:
        count = reader.count()
        _check_set(scene, reader, count)
        residual = load_residual(scene, reader)
        if coloured:
            states = _coloured(frames, reader, scene)
        else:
            states = _stepped(reader, scene, residual) if steps else _processed(reader, scene)
        done = counted(states, count // max(steps, 1), progress)
        if out is None:
            kept = list(done)
            return collect(scene, [item.row() for item in kept], kept, reader.shape, residual)
        return write_folder(
            done, scene, Path(out), frames, reader.shape, residual=residual, rois=rois
        )


def _processed(reader: FrameReader, scene: Scene) -> Iterator[ProcessedFrame]:
    """Frame after frame, each on its own."""
    dark, bright = load_no_load(scene, full_shape=reader.full_shape)
    capture = Capture(reader.bit_depth, dark, bright)
    for frame in reader:
        if scene.model is None:
            yield process_image_only(frame, scene, capture)
        else:
            own, label, distance = _state_of(scene, frame)
            found = process_with_model(frame, own, capture)
            yield replace(found, label=label, distance_m=distance)


def _stepped(
    reader: FrameReader, scene: Scene, residual: Residual | None
) -> Iterator[ProcessedFrame]:
    """State after state of a phase-stepped set, each on its own."""
    capture = Capture(reader.bit_depth)
    for index, frames in enumerate(states_of(reader, scene)):
        if scene.model is None:
            yield process_stepped(frames, scene, capture, index=index, residual=residual)
            continue
        first = replace(frames[0], index=index)
        own, label, distance = _state_of(scene, first)
        found = process_stepped(frames, own, capture, index=index, residual=residual)
        label = found.label if label == first.name else label
        yield replace(found, label=label, distance_m=distance)


def _coloured(path: str | Path, reader: FrameReader, scene: Scene) -> Iterator[ProcessedFrame]:
    """Colour frame after colour frame, each on its own."""
    capture = colour_capture(scene, reader)
    for frames in colour_frames(path, scene):
        own, label, distance = scene, frames[0].name, float("nan")
        if scene.model is not None:
            own, label, distance = _state_of(scene, frames[0])
        yield replace(process_colour(frames, own, capture), label=label, distance_m=distance)


def _state_of(scene: Scene, frame: Frame) -> tuple[Scene, str, float]:
    """The one-state scene of a frame, its label and distance (m)."""
    speed = scene.frames.sliding_speed_mm_per_s
    if speed is not None:
        if frame.time_s is None:
            raise InputError(
                f"frame {frame.index} ({frame.name}) has no time, which "
                "frames.sliding_speed_mm_per_s needs; remove that key, or give a video"
            )
        distance = 1e-3 * speed * frame.time_s
        return scene_at(scene, distance), f"{distance:.4g} m", distance
    own = frame_scene(scene, frame.index)
    if scene.model != "contact":
        return own, frame.name, 0.0
    if own.wear is not None:
        distance = own.wear.distances_m[0]
        return own, f"{distance:g} m", distance
    return own, "initial sliding" if own.friction else "static", 0.0


def _check_set(scene: Scene, reader: FrameReader, count: int) -> None:
    """Refuse a set that cannot be this scene's, before the first frame is processed."""
    if count == 0:
        raise InputError(f"{reader.path}: holds no frame; check the file")
    rows, cols = reader.shape
    camera = scene.camera
    steps = max(1, len(scene.polariscope.step))
    alone = bool(scene.polariscope.step) or scene.polariscope.several_wavelengths
    fitted = scene.model in ("contact", "beam") and not alone
    if fitted and (camera is None or camera.pixel_mm is None):
        raise InputError(f"{scene.name}: camera.pixel_mm is missing, and a fit needs it; add it")
    if count % steps:
        raise InputError(
            f"{reader.path}: {count} frames are not a multiple of the polariscope's {steps} steps; "
            "give one frame for each [[polariscope.step]]"
        )
    wanted = (camera.height_px or rows, camera.width_px or cols) if camera else (rows, cols)
    if wanted != (rows, cols):
        raise InputError(
            f"{reader.path}: frames are {rows} rows x {cols} columns and the scene's camera "
            f"{wanted[0]} x {wanted[1]}; correct camera.height_px and width_px, or frames.roi"
        )
    if scene.wear is None or scene.frames.sliding_speed_mm_per_s is not None:
        return
    first = scene.friction is not None and scene.friction.static_state_first
    states = len(scene.wear.distances_m) + int(first)
    if count != states * steps:
        each = f" for each of its {steps} steps" if steps > 1 else ""
        raise InputError(
            f"{reader.path}: {count} frames, and the scene has {states} states (wear.distances_m"
            f"{' and the static state first' if first else ''}); give one frame a "
            f"state{each}, correct the list, or set frames.sliding_speed_mm_per_s for a video"
        )


def _check_steps(scene: Scene) -> None:
    """Refuse steps that cannot tell the order."""
    polariscope = scene.polariscope
    try:
        make_design([make_chain(polariscope, step) for step in range(len(polariscope.step))])
    except InputError as error:
        raise InputError(f"{scene.name}: {error}") from error
