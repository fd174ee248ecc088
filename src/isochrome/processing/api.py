"""`process`: the fringe order of every captured frame, chunk by chunk, in bounded memory.

The files that `process` makes when all frames are done: tables, figure, dataset, scene.

A chunk of a set: what is found in its frames, as pictures, rows and parts of files.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import isochrome
from isochrome.errors import InputError
from isochrome.frames import FrameReader, absolute, input_files, open_scene_frames, with_file_scale
from isochrome.fringes import skeleton_table
from isochrome.messages import frame_messages, message
from isochrome.output import (
    add_rois,
    columns_of,
    counted,
    csv_text,
    imagej_view,
    load_roifile,
    numbers,
    replacing,
    roi_entries,
    write_csv,
    write_figure,
    write_text,
    write_tiff,
)
from isochrome.processing.figure import (
    PREVIEW,
    process_report,
    run_figure,
    set_figure,
    shown_items,
    write_preview,
)
from isochrome.processing.frame_task import (
    FrameSource,
    FrameTask,
    close_kept,
    count_of,
    identity_of,
    open_set,
    release_caches,
)
from isochrome.processing.kinds.kind import (
    CONFIDENCE,
    KEY_EVERY,
    MOST_IN_MEMORY,
    ORDER,
    FrameKind,
    accepts_keys,
    kind_of,
)
from isochrome.processing.processed import (
    FIGURE,
    Processed,
    collect,
    refuse_unread,
    restore,
    set_grid,
    shift_of,
    tabulate_set,
)
from isochrome.processing.result import PICTURE, ProcessedFrame
from isochrome.progress import RunProgress, Tally
from isochrome.reporting import write_report
from isochrome.runs import (
    PROVENANCE,
    REPORT,
    STORE,
    Column,
    Job,
    Layer,
    Results,
    RunFolder,
    RunLayout,
    RunOptions,
    WorkerPool,
    add_columns,
    attributes,
    chunk_size,
    column,
    holds_results,
    make_dataset,
    open_run,
    parts,
    refuse_without_folder,
    rows,
    run_job,
    single_threaded,
    stored_arrays,
    trim_heap,
    working_folder,
    write_stack,
)
from isochrome.scene import (
    FramesLike,
    Scene,
    SceneLike,
    check_pixel,
    dump_scene,
    frames_of,
    load_scene,
)
from isochrome.simulation import picture_axes
from isochrome.stress import PixelGrid

if TYPE_CHECKING:
    from isochrome.fringes import ResidualStress
    from isochrome.runs import RunDataset

LINES, ROIS = "skeleton.csv", "skeleton.zip"

FILM = (ORDER.name, CONFIDENCE.name)
"""Maps of every frame of a video that is followed."""


def set_layout(source: FrameSource, count: int) -> RunLayout:
    """What a set's run leaves: its maps over frame, row and column."""
    rows, cols = source.reader.shape
    kind = source.task.kind
    return RunLayout(
        axes={"frame": count}, shape={"row": rows, "col": cols},
        layers=kind.layers(source.task.scene),
        chunk=kind.key_step or chunk_size(count, 4 * rows * cols), every=kind.key_step or 1,
    )  # fmt: skip


def process_chunk(task: FrameTask, start: int, stop: int) -> Results:
    """What is found in the states [start, stop) of a set, which are let go one by one.

    Raises InputError, PhysicsError.
    """
    layers = task.kind.layers(task.scene)
    pictures = defaultdict[str, list[Any]](list)
    rows, more = [], []
    tables: list[str] = []
    rois: list[tuple[str, bytes]] = []
    for item in task.kind.states(open_set(task), start, stop):
        item = _within(item, layers)
        if task.preview is not None:
            write_preview(task.preview, item)
        rows.append(task.kind.row(item, task.scene))
        more.append(more_of(item, task.scene))
        for layer in layers:
            if layer.compact is not None:
                made = item.maps().get(layer.name)
                pictures[layer.name].append(None if made is None else layer.compact.pack(made))
            elif item.normalised is not None:
                pictures[layer.name].append(picture_of(item, layer.name, item.normalised.shape))
        if item.normalised is None:
            continue
        # with a model, which can draw them anew, for who asks alone
        wanted = task.rois or (item.fit is None and task.kind.draws_lines)
        if lines := item.skeleton() if wanted else []:
            left, top = item.corner_mm(task.scene)
            points = skeleton_table(lines, pixel_mm=item.pixel_mm, left_mm=left, top_mm=top)
            number = np.full(len(points["line"]), item.index)
            tables.append(csv_text({"frame": number, **points}, header=not tables))
        if task.rois:
            rois += roi_entries(lines, item.index)
    parts = {LINES: "".join(tables).encode()} if tables else {}
    if task.rois:
        data = io.BytesIO()
        with zipfile.ZipFile(data, "w") as archive:
            add_rois(archive, rois)
        parts[ROIS] = data.getvalue()
    return Results(pictures, rows, more, parts)


def _within(item: ProcessedFrame, layers: Sequence[Layer]) -> ProcessedFrame:
    """A frame, that says where its orders go beyond what the store's steps reach."""
    kind = next((layer.compact for layer in layers if layer.name == ORDER.name), None)
    if kind is None or item.reading is None:
        return item
    above = int(np.count_nonzero(item.reading.order > kind.largest))
    if not above:
        return item
    text = message("pixels_have_orders_above", above=above, largest=kind.largest)
    return replace(item, warnings=(*item.warnings, text))


def picture_of(item: ProcessedFrame, name: str, shape: tuple[int, ...]) -> np.ndarray:
    """A layer's picture of a frame (rows, cols).

    Where it has none, no order is known, and none can be relied on.
    """
    if (result := item.maps().get(name)) is not None:
        return result
    return np.full(shape, 0.0 if name == CONFIDENCE.name else np.nan, dtype=np.float32)


def more_of(item: ProcessedFrame, scene: Scene) -> dict[str, Any]:
    """What the dataset and the figure need to know besides the row."""
    left, top = item.corner_mm(scene)
    return {
        "status": item.status, "messages": frame_messages(item.warnings), "time_s": item.time_s,
        "left_mm": left, "top_mm": top, "read": item.reading is not None,
        "kept": item.reading.kept if item.reading is not None else None,
    }  # fmt: skip


_COORDINATES = ("frame", "name", "label", "distance_m", "time_s")
_MORE = ("status", "time_s", "left_mm", "top_mm")


def finish_set_folder(
    out: Path, job: Job, task: FrameTask, residual: ResidualStress | None, run_folder: RunFolder
) -> Processed:
    """Make the files that need all frames, from what is kept of their chunks.

    `out`, where the results will lie; `residual`, what was taken out of the frames. PhysicsError
    where nothing could be read in any frame.
    """
    release_caches()
    folder, scene, shape = run_folder.results, task.scene, task.reader.shape
    table = tabulate_set(row for row, _ in rows(run_folder))
    more = columns_of(others for _, others in rows(run_folder))
    refuse_unread(scene, str(task.reader.path), table, more["kept"])
    result = collect(scene, table, more, None, shape, residual)
    table = result.columns
    write_csv(folder / "frames.csv", table)
    _join_lines(run_folder, task)
    if result.fitted is not None:
        write_text(folder / "fitted_scene.toml", dump_scene(result.fitted))
    write_text(folder / "scene.toml", dump_scene(scene))
    _add_to_store(run_folder, job, result, more, shape)
    stored = stored_arrays(folder)
    draw = partial(set_figure, scene, table, shown_items(table, stored, more["status"]))
    more.clear()  # a picture needs room: of a long run no more than the table is left then
    trim_heap()
    result = replace(result, draw=draw, load=partial(open_run, out))
    write_figure(folder / FIGURE, result.figure())
    trim_heap()
    write_report(folder / REPORT, process_report(stored, result, job.identity))
    return result


def _add_to_store(
    run_folder: RunFolder, job: Job, result: Processed, more: dict[str, Any], shape: tuple[int, int]
) -> None:
    """Add the table to run.zarr, and what ImageJ shows to the stacks.

    The columns as arrays live no longer than this: a long run's are as large as its table.
    """
    columns, axes = _set_columns(result, more, shape)
    add_columns(run_folder.results / STORE, columns, axes, attributes(job.identity))
    grid = set_grid(result.scene, result.fitted, result.columns, shape)
    place: dict[str, Any] = {"pixel_mm": None} if grid is None else grid.scale
    _write_stacks(run_folder, result.columns, axes, place)
    if (residual := result.residual) is not None:
        for layer, name in (("fringe_order", "order"), ("isoclinic", "isoclinic")):
            view = imagej_view(layer, (0.0, residual.largest), labels=["without load"], **place)
            path, values = run_folder.results / f"residual_{name}.tif", getattr(residual, name)
            write_tiff(path, values[None], pixel_mm=place["pixel_mm"], metadata=view)


def _join_lines(run_folder: RunFolder, task: FrameTask) -> None:
    """skeleton.csv where a line was found, and skeleton.zip where it was asked for."""
    if next(parts(run_folder, LINES), None) is not None:
        with replacing(run_folder.results / LINES) as beside, open(beside, "wb") as file:
            for number, part in enumerate(parts(run_folder, LINES)):  # the head of the first alone
                file.write(part if number == 0 else part.partition(b"\n")[2])
    if task.rois:
        with (
            replacing(run_folder.results / ROIS) as beside,
            zipfile.ZipFile(beside, "w") as archive,
        ):
            for part in parts(run_folder, ROIS):
                with zipfile.ZipFile(io.BytesIO(part)) as inner:
                    add_rois(archive, ((name, inner.read(name)) for name in inner.namelist()))


def process_in_memory(source: FrameSource, count: int, progress: RunProgress | None) -> Processed:
    """All states, kept in memory."""
    task, shape, flagged = source.task, source.reader.shape, 0
    kind = task.kind
    pictures = -(-count // (kind.key_step or 1))
    needed = 4 * len(kind_of(task.scene).layers(task.scene)) * pictures
    film: dict[str, list[np.ndarray]] = {}
    if kind.maps_of_all:
        film = {name: [] for name in FILM}
        needed += 4 * len(FILM) * count
    needed *= math.prod(shape)
    if needed > MOST_IN_MEMORY:
        raise InputError(
            "maps_take_gb_gb", path=source.reader.path, counted=counted(pictures, "frame"),
            needed=needed / 1e9, most_in_memory=MOST_IN_MEMORY / 1e9,
        )  # fmt: skip
    rows, others, selected = list[dict[str, Any]](), list[dict[str, Any]](), list[ProcessedFrame]()
    for item in kind.states(source, 0, count):
        others.append(more_of(item, task.scene))
        rows.append(kind.row(item, task.scene))
        for name, film_maps in film.items():
            film_maps.append(picture_of(item, name, shape))
        if item.normalised is not None:
            selected.append(item)
        flagged += item.status != "ok"
        if progress is not None:
            progress(Tally(len(rows), count, 0, flagged))
    table, more = tabulate_set(rows), columns_of(others)
    refuse_unread(task.scene, str(source.reader.path), table, more["kept"])
    result = collect(task.scene, table, more, selected, shape, source.capture.residual)
    result = replace(result, load=partial(set_dataset, result, more, selected, film, shape))
    return replace(result, draw=partial(run_figure, result))


def set_dataset(
    result: Processed, more: Mapping[str, list[Any]], frames: Sequence[ProcessedFrame],
    film: Mapping[str, list[np.ndarray]], shape: tuple[int, int],
) -> RunDataset:  # fmt: skip
    """The dataset of a set in memory, as run.zarr has it; `film`, maps of all frames by name."""
    scene, table = result.scene, result.columns
    columns, axes = _set_columns(result, more, shape)
    few = "key_frame" if PICTURE in table else "frame"
    maps = {
        layer.name: Column(
            ("frame" if layer.name in film else few, "row", "col"),
            np.stack(
                film.get(layer.name) or [picture_of(item, layer.name, shape) for item in frames]
            ),
            {"units": layer.units, "long_name": layer.what},
        )
        for layer in (kind_of(scene).layers(scene) if frames else ())
    }
    known = {"isochrome": isochrome.__version__, "scene": dump_scene(scene)}
    return make_dataset(maps | columns, axes, attributes(known))


def _write_stacks(
    run_folder: RunFolder,
    table: Mapping[str, list[Any]],
    axes: Mapping[str, Column],
    place: Mapping[str, float | None],
) -> None:
    """The maps as stacks with scale, origin, labels, range, colours, interval. Raises OSError."""
    names = [str(label or name) for label, name in zip(table["label"], table["name"], strict=True)]
    times = axes["time_s"].values
    highest = numbers(table["n_max"]) if "n_max" in table else np.zeros(0)
    largest = float(np.nanmax(highest)) if np.isfinite(highest).any() else 1.0
    for layer in run_folder.layout.layers:
        pages = run_folder.layout.paged_items(layer)
        view = imagej_view(
            layer.name, (0.0, largest), labels=[names[k] for k in pages],
            times_s=[times[k] for k in pages], **place,
        )  # fmt: skip
        write_stack(run_folder, layer, view, pixel_mm=place["pixel_mm"])


def _set_columns(
    result: Processed, more: Mapping[str, list[Any]], shape: tuple[int, int]
) -> tuple[dict[str, Column], dict[str, Column]]:
    """The columns of frames.csv over frame, and the axes' coordinates.

    x = left + (col + 1/2) pixel,  z = top + (row + 1/2) pixel, of the place that was found, the
    mean of the frames'; shift_x_mm and shift_z_mm over frame say how far each lies from there.
    """
    scene, table = result.scene, result.columns
    grid = set_grid(scene, result.fitted, table, shape)
    outcome = table | {name: more[name] for name in _MORE} | {"messages": result.messages}
    # all are there, whatever is known of them: a dataset's axes do not come and go
    columns = {name: column(values, "frame", name) for name, values in outcome.items()}
    axes = {name: columns.pop(name) for name in _COORDINATES}
    axes |= _set_axes(scene, grid, table, shape)
    if PICTURE in table and any(at is not None for at in table[PICTURE]):
        keys = [k for k, at in enumerate(table[PICTURE]) if at is not None]
        axes["key_frame"] = Column(("key_frame",), np.array(keys), {})
        for name in ("shift_x_mm", "shift_z_mm") if grid is not None else ():
            shift = axes[name]
            axes[f"key_{name}"] = Column(("key_frame",), shift.values[keys], shift.attributes)
    return columns, axes


def _set_axes(
    scene: Scene, grid: PixelGrid | None, table: Mapping[str, Sequence[Any]], shape: tuple[int, int]
) -> dict[str, Column]:
    """Coordinates of a set's maps, rows and columns, in mm where a scale is known, and shifts."""
    if grid is None:
        return {
            name: Column((name,), np.arange(count), {"units": "pixel"})
            for name, count in zip(("row", "col"), shape, strict=True)
        }
    axes = picture_axes(grid)
    for name, edge, what in (
        ("x", "left", "along the surface"),
        ("z", "top", "depth below the surface"),
    ):
        if not scene.has_model:
            stated = scene.camera and getattr(scene.camera, f"{edge}_mm") is not None
            long_name = what if stated else "from the picture's outer edge"
            axes[f"{name}_mm"] = replace(
                axes[f"{name}_mm"], attributes={"units": "mm", "long_name": long_name}
            )
        attribute = {"units": "mm", "long_name": f"of the frame's own place from {name}_mm"}
        axes[f"shift_{name}_mm"] = Column(("frame",), shift_of(edge, grid, table), attribute)
    return axes


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
        Frames from one key frame to the next of what is followed, by default 200; of a contact at
        most so many, in stretches that are alike.
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
        light, and dust is left out. With `track` one frame is asked, and all hold the same.
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
    if track and each:
        raise InputError("track_each_set_followed")
    if maps not in (None, "all", "key", "none"):
        raise InputError("maps_give_all_key", maps=maps)
    if preview and out is None:
        raise InputError("preview_written_beside_results")
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
        kind = replace(kind, as_stated=as_stated)
        shown = working_folder(Path(out)) / PREVIEW if out is not None and preview else None
        task = FrameTask(
            frames=frames, scene=scene, reader=reader, kind=kind, rois=rois,
            keep_going=keep_going, preview=shown,
        )  # fmt: skip
        identity = partial(identity_of, task, files)
        if out is not None and not restart and _is_done(Path(out), identity):
            result = restore(scene, Path(out), reader.shape, open_set(task).capture.residual)
        else:
            options = RunOptions(workers, cluster, restart, keep_going)
            result = _processed(task, identity, out, options, progress)
        return replace(result, as_stated=as_stated)


def _kind_of_set(
    scene: Scene, reader: FrameReader, track: bool, each: bool, every: int | None, maps: str | None
) -> FrameKind:
    """How a set is processed: followed where that is asked, or is usual; else state by state."""
    keyed = accepts_keys(scene) and (track or (not each and reader.kind == "video"))
    if not keyed and (track or (not each and is_followed(scene, reader))):
        from isochrome.processing.kinds.tracked import TrackedFilm

        return TrackedFilm(every=every, wanted=maps)
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
    count, source = count_of(task), open_set(task)
    workers = min(options.workers or 1, set_layout(source, count // task.steps).chunks)
    with ExitStack() as opened:
        if workers > 1 and options.cluster is None:  # they start while frames are asked
            pool = WorkerPool(workers, (process_chunk, task.kind))
            options = replace(options, pool=opened.enter_context(pool))
        kind = task.kind.shared(source, count, progress, on_disk=out is not None)
        task = source.task = replace(task, kind=kind)
        if out is None:
            return process_in_memory(source, count // task.steps, progress)
        job = Job(partial(process_chunk, task), set_layout(source, count // task.steps), identify())
        residual = source.capture.residual
        finish = partial(finish_set_folder, Path(out).absolute(), job, task, residual)
        result = run_job(job, out, finish, options=options, progress=progress)
    return result or restore(task.scene, Path(out), task.reader.shape, residual)


def _is_done(out: Path, identify: Callable[[], Mapping[str, Any]]) -> bool:
    """Whether a finished run has left all, by what the files hold: no frame is decoded for it."""
    if not (out / PROVENANCE).is_file() or working_folder(out).exists():  # which one at work has
        return False
    return holds_results(out.resolve(), identify())


def check_scene(scene: Scene) -> None:
    """Refuse a scene whose light, field or steps cannot tell the order, before opening frames."""
    kind_of(scene).check(scene)
