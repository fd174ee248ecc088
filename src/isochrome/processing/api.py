"""`process`: the fringe order of every captured frame, chunk by chunk, in bounded memory."""

import hashlib
import json
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from isochrome.errors import InputError
from isochrome.frames import FrameReader, absolute, input_files, open_scene_frames, with_file_scale
from isochrome.output import load_roifile
from isochrome.processing.figure import PREVIEW
from isochrome.processing.folder import (
    finish_set_folder,
    process_chunk,
    process_in_memory,
    set_layout,
)
from isochrome.processing.frame_task import FrameTask, close_kept, count_of, identity_of, open_set
from isochrome.processing.kinds.kind import KEY_EVERY, FrameKind, accepts_keys, kind_of
from isochrome.processing.processed import Processed, restore
from isochrome.progress import RunProgress, Tally
from isochrome.runs import (
    PROVENANCE,
    STORE,
    Job,
    RunOptions,
    holds_results,
    refuse_without_folder,
    run_job,
    single_threaded,
    working_folder,
)
from isochrome.scene import FramesLike, Scene, SceneLike, check_pixel, frames_of, load_scene


def process(
    frames: FramesLike,
    scene: SceneLike,
    out: str | Path | None = None,
    *,
    rois: bool = False,
    track: bool = False,
    each: bool = False,
    every: int | None = None,
    maps: str | None = None,
    preview: bool = False,
    as_stated: bool = False,
    workers: int | None = 1,
    cluster: str | None = None,
    restart: bool = False,
    keep_going: bool = False,
    progress: RunProgress | None = None,
) -> Processed:
    """Find the fringe order of every frame of a captured set.

    With a model, each frame's unknowns (load, place, friction, wear) are fitted to its intensity I
    = B + A sin²(πN) (dark field), and each pixel's order N is read on the branch that the fit
    names. Without one, frames are normalised and their fringe skeletons found; that is said in the
    warnings. Where the scene has [[polariscope.step]], as many frames as steps make one state,
    whose order and isoclinic angle are read from them without any model; with frames.no_load_steps
    the residual stress is taken out of them. The order of colour frames in light of several
    wavelengths is read from their colours, without a model too.

    Parameters
    ----------
    frames : str, Path, sequence of them, array or sequence of arrays
        A TIFF stack, image, video, or a folder, list or glob of them, or frames in memory, as for
        `open_frames`.
    scene : str, Path, Scene or mapping
        A TOML file, the name of a scene of the package, a Scene, or its tables, which say what
        stood in front of the camera.
    out : str or Path, optional
        Folder for frames.csv, fringe_order.tif, confidence.tif, normalised.tif, skeleton.csv
        (fringe lines, of single frames without a fitted model), isoclinic.tif (steps: degrees,
        direction of sigma_1), residual_order.tif and residual_isoclinic.tif (of the no-load steps),
        fitted_scene.toml (to simulate what was found), scene.toml, provenance.json, process.png,
        report.html and run.zarr, which has all of it with named axes (see `open_run`).
    rois : bool, default False
        Whether skeleton.csv and skeleton.zip, the lines as ImageJ ROIs that lie on these maps, are
        wanted of every frame.
    track : bool, default False
        Whether only each `every`-th frame of a contact's stack or folder is processed wholly, and
        load, friction, wear and place are followed through the others; of a specimen without a
        model, whether the orders of each `every`-th frame are carried through the others. All
        frames have their row of frames.csv, and their orders are read on the branches of the
        followed model. Videos of both are followed without it; one of a specimen without a model
        whose frames lie too far apart has them read one by one, and says so.
    each : bool, default False
        Whether every frame of a video is processed wholly too, as if there were no others.
    every : int, optional
        Frames from one key frame to the next of what is followed, 200.
    maps : {'all', 'key', 'none'}, optional
        The frames of a followed video whose maps are written: with 'all', order (in steps of 1e-4
        fringe where it stays below 6.5) and confidence of every frame in run.zarr, and those of the
        key frames as TIFF stacks besides. By default all, where they take less than 20 GB (8 GB in
        memory), else those of the key frames.
    preview : bool, default False
        Whether the last frame that was read, and its orders, are written every few seconds to
        OUT.partial/preview.png.
    as_stated : bool, default False
        Whether all that the scene states is held, and nothing else is fitted than its unknowns;
        else what a frame asks for is fitted too and named in the warnings: the camera's roll,
        distortion and keystone, gamma, blur, plates, band of wavelengths, a smooth stress, uneven
        light, and dust is left out. With `track` a few frames are asked, and all hold the same.
    workers : int or None, default 1
        Processes on this machine; None: as many as are useful. A script that asks for more than
        one needs the usual ``if __name__ == "__main__":``.
    cluster : str, optional
        Address of a Dask scheduler, in place of `workers`, such as 'tcp://host:8786'.
    restart : bool, default False
        Whether to begin anew where an earlier run was interrupted or is complete.
    keep_going : bool, default False
        Whether frames that fail are left out, with the reason in their warnings, instead of ending
        the run with the first.
    progress : callable, optional
        Called with a Tally of the frames.

    Returns
    -------
    Processed
        The table of the frames, the fitted scene, and as `dataset` the maps over (frame, z_mm,
        x_mm), which are in memory only without `out`. Orders are in fringes, lengths in mm, loads
        in N.

    Raises
    ------
    InputError
        Where the frames, the scene or an option are wrong; it names the file, the value and the
        fix.
    PhysicsError
        Where the frames do not hold the scene's fringes.

    Notes
    -----
    What is finished is kept in ``OUT.partial`` until all is: after a crash, the same call resumes
    from there. The order is N = t (sigma_1 - sigma_2)/f_sigma, with the thickness t (mm) and the
    material fringe value f_sigma (N/mm per fringe): Dally & Riley (1991), Experimental Stress
    Analysis, section 12.2.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("ring").with_values({
    ...     "load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
    ...     "camera.pixel_mm": 0.36, "camera.noise_grey": 1.0})
    >>> simulated = isochrome.simulate(scene, "simulated")
    >>> found = isochrome.process("simulated/frames.tif", scene)
    >>> print(f"{found.table['load.normal_n'][0]:.1f} N")
    60.0 N

    From arrays, without any file:

    >>> frames = isochrome.simulate(scene).frames
    >>> found = isochrome.process(frames, scene)
    >>> order = found.dataset.fringe_order[0]
    >>> print(f"{order.sel(x_mm=0.0, z_mm=9.0, method='nearest').item():.2f} fringes")
    0.78 fringes
    """
    scene = load_scene(scene)
    check_scene(scene)
    _check_options(track, each, maps, preview, out)
    if rois:
        load_roifile()  # missing, it is to be said before hours of work
    refuse_without_folder(out, workers, cluster)
    if out is not None:
        working_folder(Path(out))  # no place for results: to be said before anything is read
    frames = frames_of(frames)
    with single_threaded(), open_scene_frames(frames, scene) as reader, ExitStack() as opened:
        opened.callback(close_kept)  # before the reader that it reads from is closed
        scene = with_file_scale(scene, reader)
        check_pixel(scene, reader.shape)
        files = input_files(reader, scene)
        if cluster is not None:
            frames, scene = absolute(frames, scene)
            reader = open_scene_frames(frames, scene)
        kind = _kind_of_set(scene, reader, track=track, each=each, every=every, maps=maps)
        shown = working_folder(Path(out)) / PREVIEW if out is not None and preview else None
        task = FrameTask(
            frames=frames, scene=scene, reader=reader, key="not yet known", kind=kind, rois=rois,
            as_stated=as_stated, keep_going=keep_going, preview=shown,
        )  # fmt: skip
        identity = partial(identity_of, task, files)
        if out is not None and not restart and _is_done(Path(out), identity):
            result = restore(scene, Path(out), reader.shape, open_set(task).capture.residual)
        else:
            options = RunOptions(workers, cluster, restart, keep_going)
            result = _processed(task, identity, out, options, progress)
        return replace(result, as_stated=as_stated)


def _check_options(
    track: bool, each: bool, maps: str | None, preview: bool, out: str | Path | None
) -> None:
    """Refuse options that say two things, or nothing."""
    if track and each:
        raise InputError("track_each_set_followed")
    if maps not in (None, "all", "key", "none"):
        raise InputError("maps_give_all_key", maps=maps)
    if preview and out is None:
        raise InputError("preview_written_beside_results")


def _kind_of_set(
    scene: Scene, reader: FrameReader, track: bool, each: bool, every: int | None, maps: str | None
) -> FrameKind:
    """How a set is processed: followed where that is asked, or is usual; else state by state."""
    keyed = accepts_keys(scene) and (track or (not each and reader.kind == "video"))
    if not keyed and (track or (not each and is_followed(scene, reader))):
        from isochrome.processing.kinds.tracked import TrackedFilm

        return TrackedFilm(every=every or KEY_EVERY, wanted=maps)
    for name, value in (("every", None if keyed else every), ("maps", maps)):
        if value is not None:
            raise InputError("video_followed_add_track", name=name, value=value)
    if not keyed:
        return kind_of(scene)
    from isochrome.processing.kinds.followed_film import KeyedFilm

    return KeyedFilm(key_every=every or KEY_EVERY, by_default=not track)


def is_followed(scene: Scene, reader: FrameReader) -> bool:
    """Whether a set is a video of a contact whose frames can be followed."""
    if reader.kind != "video":
        return False
    from isochrome.processing.kinds.tracked import check_tracked

    try:
        check_tracked(scene, reader.shape, KEY_EVERY)
    except InputError:
        return False
    return True


def _processed(
    task: FrameTask,
    identify: Callable[[], Mapping[str, Any]],
    out: str | Path | None,
    options: RunOptions,
    progress: RunProgress | None,
) -> Processed:
    """All states of a set, in memory or into a folder."""
    scene, reader, count = task.scene, task.reader, count_of(task)
    kind, text = task.kind.sized(scene, reader.shape, count, on_disk=out is not None)
    source = open_set(replace(task, kind=kind))
    task = source.task = replace(task, kind=kind.shared(source, count, progress))
    if text and progress is not None:  # what is refused before is one line
        progress(Tally(0, count, 0, 0, text))
    if out is None:
        return process_in_memory(source, count // task.steps, progress)
    identity = identify()
    digest = hashlib.sha256(json.dumps(identity).encode()).hexdigest()
    task = source.task = replace(task, key=digest)  # opened, it need not be opened again
    job = Job(partial(process_chunk, task), set_layout(source, count // task.steps), identity)

    residual = source.capture.residual
    finish = partial(finish_set_folder, Path(out).absolute(), job, task, residual)
    result = run_job(job, out, finish, options=options, progress=progress)
    return result or restore(task.scene, Path(out), reader.shape, residual)


def _is_done(out: Path, identify: Callable[[], Mapping[str, Any]]) -> bool:
    """Whether a finished run has left all, by what the files hold: no frame is decoded for it."""
    complete = (out / PROVENANCE).is_file() and (out / STORE / "zarr.json").is_file()
    if not complete or working_folder(out).exists():  # an unfinished run, or one that is at work
        return False
    return holds_results(out.resolve(), identify())


def check_scene(scene: Scene) -> None:
    """Refuse a scene whose light, field or steps cannot tell the order, before opening frames."""
    kind_of(scene).check(scene)
