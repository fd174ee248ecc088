"""`process`: the fringe order of every captured frame, chunk by chunk, in bounded memory."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from isochrome.errors import InputError
from isochrome.frames import (
    FrameReader,
    FramesPath,
    absolute,
    input_files,
    open_scene_frames,
    with_file_scale,
)
from isochrome.fringes.steps import make_design
from isochrome.optics import make_chain
from isochrome.output.roi import load_roifile
from isochrome.process.chunk import layers_of, process_chunk, row_of
from isochrome.process.colour import check_colour
from isochrome.process.folder import finish_folder
from isochrome.process.inputs import identity_of, set_pixel
from isochrome.process.processed import Processed, collect, refuse_unread, restore, tabulate
from isochrome.process.recipe import OpenSet, Recipe, keeping_none, let_go, opened
from isochrome.process.result import ProcessedFrame
from isochrome.process.tracked import EVERY, check_tracked, tracked_states
from isochrome.progress import RunProgress, Tally
from isochrome.runs import Bench, Job, Layout, Means, chunk_size, run_job, single_threaded
from isochrome.runs.store import STORE
from isochrome.runs.workers import waiting_workers
from isochrome.runs.workplace import PROVENANCE, holds_results, working_folder
from isochrome.scene import Scene, check_pixel, load_scene


def process(
    frames: FramesPath,
    scene: str | Path | Scene,
    out: str | Path | None = None,
    *,
    rois: bool = False,
    track: bool = False,
    every: int | None = None,
    workers: int | None = 1,
    cluster: str | None = None,
    restart: bool = False,
    keep_going: bool = False,
    progress: RunProgress | None = None,
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
    found), scene.toml, provenance.json, process.png and run.zarr, which has all of it with named
    axes (`isochrome.open_run`); `rois`, whether skeleton.csv and skeleton.zip, the lines as ImageJ
    ROIs that lie on these maps, are wanted of every frame; `track`, to process only each `every`-th
    frame of a contact's video wholly, and follow load, friction, wear and place through the others:
    all have their row of frames.csv, and the maps are those of the key frames.
    What is finished is kept in OUT.partial until all is: the same call after a crash goes on there.
    `workers`, processes on this machine, None: as many as there are processors, where that pays (a
    script that asks for more than one needs the usual `if __name__ == "__main__":`); `cluster`, the
    address of a Dask scheduler instead; `restart`, to begin anew; `keep_going`, to leave out frames
    that fail, with the reason in their warnings, instead of ending with the first; `progress`,
    called with a Tally.
    Returns Processed, with the frames in memory only without `out`. Raises InputError,
    PhysicsError.
    """
    scene = load_scene(scene)
    check_scene(scene)
    if every is not None and not track:
        raise InputError(f"--every {every}: is for --track; add that, or leave it out")
    if rois:
        load_roifile()  # missing, it is to be said before hours of work
    if out is None and (cluster is not None or workers != 1):
        raise InputError("workers and a cluster write to a folder: give out")
    if out is not None:
        working_folder(Path(out))  # no place for results: to be said before anything is read
    frames = frames if isinstance(frames, str | Path) else tuple(frames)
    with single_threaded(), open_scene_frames(frames, scene) as reader, keeping_none():
        scene = with_file_scale(scene, reader)
        check_pixel(scene, reader.shape)
        files = input_files(reader, scene)
        if cluster is not None:
            frames, scene = absolute(frames, scene)
            reader = open_scene_frames(frames, scene)
        every = (every or EVERY) if track else None
        recipe = Recipe(frames, scene, reader, "not yet known", rois, keep_going, every)
        if out is not None and not restart and _is_done(Path(out), recipe, files):
            return restore(scene, Path(out), reader.shape, opened(recipe).residual)
        several = (workers or 1) > 1 and cluster is None
        early = waiting_workers(workers or 1, process_chunk) if several else nullcontext()
        with early as waiting:
            means = Means(workers, cluster, restart, keep_going, waiting)
            return _processed(recipe, files, out, means, progress)


def _processed(
    recipe: Recipe,
    files: Sequence[Path],
    out: str | Path | None,
    means: Means,
    progress: RunProgress | None,
) -> Processed:
    """All states of a set, in memory or into a folder."""
    reader, every = recipe.reader, recipe.every
    count = reader.count(decode=every is None)
    _check_set(recipe.scene, reader, count)
    if every is not None:
        check_tracked(recipe.scene, reader.shape, every)
    source = opened(recipe)
    if out is None:
        return _in_memory(source, count // recipe.steps, progress)
    identity = identity_of(recipe, files)
    layout = _layout(source, count // recipe.steps)
    return _to_folder(source, identity, layout, Path(out), means, progress)


def _is_done(out: Path, recipe: Recipe, files: Sequence[Path]) -> bool:
    """Whether a finished run has left all, by what the files hold: no frame is decoded for it."""
    there = (out / PROVENANCE).is_file() and (out / STORE / "zarr.json").is_file()
    if not there or working_folder(out).exists():  # an unfinished run, or one that is at work
        return False
    return holds_results(out.resolve(), identity_of(recipe, files))


def _in_memory(source: OpenSet, count: int, progress: RunProgress | None) -> Processed:
    """All states, kept in memory."""
    recipe, flagged = source.recipe, 0
    rows, status, kept = [], [], list[ProcessedFrame]()
    found = source.states if recipe.every is None else partial(tracked_states, source)
    for item in found(0, count):
        rows.append(row_of(item, recipe))
        status.append(item.status)
        if isinstance(item, ProcessedFrame):
            kept.append(item)
        flagged += item.status != "ok"
        if progress is not None:
            progress(Tally(len(rows), count, 0, flagged))
    table = tabulate(rows)
    shares = [item.reading.kept if item.reading else None for item in kept]
    refuse_unread(recipe.scene, str(source.reader.path), table, shares)
    return collect(recipe.scene, table, status, kept, source.reader.shape, source.residual)


def _layout(source: OpenSet, count: int) -> Layout:
    """What a set's run leaves: its maps over frame, row and column."""
    rows, cols = source.reader.shape
    every = source.recipe.every
    return Layout(
        {"frame": count},
        {"row": rows, "col": cols},
        layers_of(source.recipe.scene),
        every or chunk_size(count, 4 * rows * cols),
        set_pixel(source),
        every=every or 1,
    )


def _to_folder(
    source: OpenSet,
    identity: Mapping[str, Any],
    layout: Layout,
    out: Path,
    means: Means,
    progress: RunProgress | None,
) -> Processed:
    """All states, by whoever computes them, into a folder."""
    scene, shape, residual = source.recipe.scene, source.reader.shape, source.residual
    digest = hashlib.sha256(json.dumps(identity).encode()).hexdigest()
    recipe = replace(source.recipe, key=digest)
    source.recipe = recipe  # opened under this name, it need not be opened again
    job = Job(partial(process_chunk, recipe), layout, identity)

    def finish(bench: Bench) -> Processed:
        let_go()
        return finish_folder(bench, job, recipe, shape, residual)

    found = run_job(job, out, finish, means=means, progress=progress)
    return found or restore(scene, out, shape, residual)


def check_scene(scene: Scene) -> None:
    """Refuse a scene whose frames cannot be read, before they are opened. Raises InputError."""
    steps = len(scene.polariscope.step)
    if scene.polariscope.several_wavelengths:
        check_colour(scene)
    elif scene.frames.colour_table is not None:
        raise InputError(
            f"{scene.name}: frames.colour_table is for light of several wavelengths; add "
            "polariscope.light = 'white', or remove the table"
        )
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
    for i, known in enumerate(scene.frames.known_order, start=1):
        if known.row_px >= rows or known.col_px >= cols:
            raise InputError(
                f"{scene.name}: frames.known_order[{i}] at row {known.row_px}, column "
                f"{known.col_px} lies outside {rows} x {cols} pixels; move it"
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
