"""`process`: the fringe order of every captured frame, chunk by chunk, in bounded memory.

`process_frame`: one frame of a set, without the others. `check`: what is wrong with frames, and
what one of them asks for, before a long run.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import isochrome
from isochrome import output, runs
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import light_basis
from isochrome.fitting import LOAD
from isochrome.frames import (
    Check,
    Finding,
    Frame,
    FrameReader,
    Level,
    absolute,
    input_files,
    look_through,
    open_scene_frames,
    with_file_scale,
)
from isochrome.fringes import skeleton_table
from isochrome.messages import frame_messages, message
from isochrome.processing.figure import (
    PREVIEW,
    process_report,
    processed_panels,
    set_figure,
    shown_items,
    write_preview,
)
from isochrome.processing.kinds.kind import (
    CONFIDENCE,
    KEY_EVERY,
    MOST_IN_MEMORY,
    ORDER,
    FrameKind,
    FrameSource,
    FrameTask,
    accepts_keys,
    close_kept,
    count_of,
    identity_of,
    kind_of,
    open_set,
    own_scene,
)
from isochrome.processing.result import (
    FIGURE,
    PICTURE,
    Capture,
    FrameResult,
    Processed,
    ProcessedFrame,
    collect,
    restore,
    set_grid,
    shift_of,
    tabulate_set,
)
from isochrome.progress import RunProgress, Tally
from isochrome.reporting import write_report
from isochrome.runs import Column
from isochrome.scene import FramesLike, Scene, SceneLike, check_pixel, dump_scene, frames_of
from isochrome.simulation import picture_axes
from isochrome.specimens import surface_field_grid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from isochrome.fringes import ResidualStress
    from isochrome.processing.kinds.image_only import AnchorPreview
    from isochrome.runs import RunDataset

LINES, ROIS = "skeleton.csv", "skeleton.zip"


def set_layout(source: FrameSource, count: int) -> runs.RunLayout:
    """What a set's run leaves: its maps over frame, row and column."""
    height, width = source.reader.shape
    kind = source.task.kind
    return runs.RunLayout(
        axes={"frame": count}, shape={"row": height, "col": width},
        layers=kind.layers(source.task.scene),
        chunk=kind.key_step or runs.chunk_size(count, 4 * height * width),
        every=kind.key_step or 1,
    )  # fmt: skip


def process_chunk(task: FrameTask, start: int, stop: int) -> runs.Results:
    """What is found in the states [start, stop) of a set, which are let go one by one."""
    scene, layers = task.scene, task.kind.layers(task.scene)
    pictures = defaultdict[str, list[Any]](list)
    rows, more = [], []
    tables: list[str] = []
    rois: list[tuple[str, bytes]] = []
    for item in task.kind.states(open_set(task), start, stop):
        item = _within(item, layers)
        if task.preview is not None:
            write_preview(task.preview, item)
        for layer in layers:
            if layer.compact is not None:
                made = item.maps().get(layer.name)
                pictures[layer.name].append(None if made is None else layer.compact.pack(made))
            elif item.normalised is not None:
                pictures[layer.name].append(picture_of(item, layer.name, item.normalised.shape))
        rows.append(task.kind.row(item, scene))
        more.append(more_of(item, scene))
        # with a model, which can draw them anew, for who asks alone
        wanted = task.rois or (item.fit is None and task.kind.draws_lines)
        if lines := item.skeleton() if wanted and item.normalised is not None else []:
            left, top = item.corner_mm(scene)
            points = skeleton_table(lines, pixel_mm=item.pixel_mm, left_mm=left, top_mm=top)
            number = np.full(len(points["line"]), item.index)
            tables.append(output.csv_text({"frame": number, **points}, header=not tables))
        if task.rois:
            rois += output.roi_entries(lines, item.index)
    parts = {LINES: "".join(tables).encode()} if tables else {}
    if task.rois:
        data = io.BytesIO()
        with zipfile.ZipFile(data, "w") as archive:
            output.add_rois(archive, rois)
        parts[ROIS] = data.getvalue()
    return runs.Results(pictures, rows, more, parts)


def _within(item: ProcessedFrame, layers: Sequence[runs.Layer]) -> ProcessedFrame:
    step = next((layer.compact for layer in layers if layer.name == ORDER.name), None)
    if step is None or item.reading is None:
        return item
    above = int(np.count_nonzero(item.reading.order > step.largest))
    text = message("pixels_have_orders_above", above=above, largest=step.largest)
    return replace(item, warnings=(*item.warnings, text)) if above else item


def picture_of(item: ProcessedFrame, name: str, shape: tuple[int, ...]) -> np.ndarray:
    """A layer's picture of a frame (rows, cols); 0 or NaN where it has none."""
    if (result := item.maps().get(name)) is not None:
        return result
    return np.full(shape, 0.0 if name == CONFIDENCE.name else np.nan, dtype=np.float32)


def more_of(item: ProcessedFrame, scene: Scene) -> dict[str, Any]:
    """What the dataset and the figure need to know besides the row."""
    left, top = item.corner_mm(scene)
    return {
        "status": item.status, "messages": frame_messages(item.warnings), "time_s": item.time_s,
        "left_mm": left, "top_mm": top,
    }  # fmt: skip


def finish_set_folder(
    out: Path, job: runs.Job, task: FrameTask, residual: ResidualStress | None,
    run_folder: runs.RunFolder,
) -> Processed:  # fmt: skip
    """Make the files that need all frames, of what is kept of their chunks; skeleton.csv where a
    line was found."""
    close_kept()
    light_basis.cache_clear()  # what the frames shared: all of them are done
    surface_field_grid.cache_clear()
    runs.trim_heap()
    folder, scene, shape = run_folder.results, task.scene, task.reader.shape
    more = output.columns_of(others for _, others in runs.rows(run_folder))
    table = tabulate_set(row for row, _ in runs.rows(run_folder))
    result = collect(scene, table, more, None, shape, residual, name=str(task.reader.path))
    table = result.columns
    output.write_csv(folder / "frames.csv", table)
    if next(runs.parts(run_folder, LINES), None) is not None:
        with output.replacing(folder / LINES) as beside, open(beside, "wb") as file:
            for number, part in enumerate(runs.parts(run_folder, LINES)):
                # the head of the first alone
                file.write(part if number == 0 else part.partition(b"\n")[2])
    if task.rois:
        with output.replacing(folder / ROIS) as beside, zipfile.ZipFile(beside, "w") as archive:
            for part in runs.parts(run_folder, ROIS):
                with zipfile.ZipFile(io.BytesIO(part)) as inner:
                    entries = ((name, inner.read(name)) for name in inner.namelist())
                    output.add_rois(archive, entries)
    if result.fitted is not None:
        output.write_text(folder / "fitted_scene.toml", dump_scene(result.fitted))
    output.write_text(folder / "scene.toml", dump_scene(scene))
    _add_to_store(run_folder, job, result, more, shape)
    stored = runs.stored_arrays(folder)
    draw = partial(set_figure, scene, table, shown_items(table, stored, more["status"]))
    more.clear()  # a picture needs room: of a long run no more than the table is left then
    runs.trim_heap()
    result = replace(result, draw=draw, load=partial(runs.open_run, out))
    output.write_figure(folder / FIGURE, result.figure())
    runs.trim_heap()
    write_report(folder / runs.REPORT, process_report(stored, result, job.identity))
    return result


def _add_to_store(
    run_folder: runs.RunFolder, job: runs.Job, result: Processed, more: dict[str, Any],
    shape: tuple[int, int],
) -> None:  # fmt: skip
    """Add the table to run.zarr, and write the stacks. The columns as arrays live no longer than
    this: a long run's are as large as its table."""
    layout, table = run_folder.layout, result.columns
    columns, axes = _set_columns(result, more, shape)
    about = runs.attributes(job.identity)
    runs.add_columns(run_folder.results / runs.STORE, columns, axes, about)
    grid = set_grid(result.scene, result.fitted, table, shape)
    place: dict[str, Any] = {"pixel_mm": None} if grid is None else grid.scale
    names = [str(label or name) for label, name in zip(table["label"], table["name"], strict=True)]
    highest = output.numbers(table.get("n_max", ()))
    largest = float(np.nanmax(highest)) if np.isfinite(highest).any() else 1.0
    for layer in layout.layers:
        pages = layout.paged_items(layer)
        view = output.imagej_view(
            layer.name, (0.0, largest), labels=[names[k] for k in pages],
            times_s=[axes["time_s"].values[k] for k in pages], **place,
        )  # fmt: skip
        runs.write_stack(run_folder, layer, view, pixel_mm=place["pixel_mm"])
    if (residual := result.residual) is not None:
        span, labels = (0.0, residual.largest), ["without load"]
        for layer_name, name in (("fringe_order", "order"), ("isoclinic", "isoclinic")):
            view = output.imagej_view(layer_name, span, labels=labels, **place)
            path, values = run_folder.results / f"residual_{name}.tif", getattr(residual, name)
            output.write_tiff(path, values[None], pixel_mm=place["pixel_mm"], metadata=view)


def process_in_memory(source: FrameSource, count: int, progress: RunProgress | None) -> Processed:
    """All states, kept in memory."""
    task, shape, flagged = source.task, source.reader.shape, 0
    kind, layers = task.kind, task.kind.layers(task.scene)
    few = -(-count // (kind.key_step or 1))  # whose maps are kept, but for those of all frames
    needed = 4 * math.prod(shape) * sum(few if one.compact is None else count for one in layers)
    if needed > MOST_IN_MEMORY:
        raise InputError(
            "maps_take_gb_gb", path=source.reader.path, counted=output.counted(few, "frame"),
            needed=needed / 1e9, most_in_memory=MOST_IN_MEMORY / 1e9,
        )  # fmt: skip
    rows, others, selected = list[dict[str, Any]](), list[dict[str, Any]](), list[ProcessedFrame]()
    pictures: dict[str, list[np.ndarray]] = {layer.name: [] for layer in layers}
    for item in kind.states(source, 0, count):
        others.append(more_of(item, task.scene))
        rows.append(kind.row(item, task.scene))
        for layer in layers:
            if layer.compact is not None or item.normalised is not None:
                pictures[layer.name].append(picture_of(item, layer.name, shape))
        if item.normalised is not None:
            selected.append(item)
        flagged += item.status != "ok"
        if progress is not None:
            progress(Tally(len(rows), count, 0, flagged))
    more, residual = output.columns_of(others), source.capture.residual
    table, name = tabulate_set(rows), str(source.reader.path)
    result = collect(task.scene, table, more, selected, shape, residual, name=name)
    result = replace(result, load=partial(_dataset, result, more, layers, pictures, shape))
    return replace(result, draw=partial(_figure, result, more["status"]))


def _figure(result: Processed, status: list[str]) -> Figure:
    items = shown_items(result.columns, result.dataset, status)
    return set_figure(result.scene, result.columns, items)


def _dataset(
    result: Processed, more: Mapping[str, list[Any]], layers: Sequence[runs.Layer],
    pictures: Mapping[str, list[np.ndarray]], shape: tuple[int, int],
) -> RunDataset:  # fmt: skip
    columns, places = _set_columns(result, more, shape)
    maps = {}
    for layer in layers:
        few = PICTURE in result.columns and layer.compact is None
        axes = ("key_frame" if few else "frame", "row", "col")
        about = {"units": layer.units, "long_name": layer.what}
        maps[layer.name] = Column(axes, np.stack(pictures[layer.name]), about)
    known = {"isochrome": isochrome.__version__, "scene": dump_scene(result.scene)}
    return runs.make_dataset(maps | columns, places, runs.attributes(known))


def _set_columns(
    result: Processed, more: Mapping[str, list[Any]], shape: tuple[int, int]
) -> tuple[dict[str, Column], dict[str, Column]]:
    """The columns of frames.csv over frame, and the axes' coordinates, in mm where these are known.
    x = left + (col + 1/2) pixel, z = top + (row + 1/2) pixel, of the place that was found, the mean
    of the frames'; shift_x_mm and shift_z_mm over frame say how far each lies from there."""
    scene, table = result.scene, result.columns
    grid = set_grid(scene, result.fitted, table, shape)
    outcome = table | {name: more[name] for name in ("status", "time_s", "left_mm", "top_mm")}
    outcome["messages"] = result.messages
    # all are there, whatever is known of them: a dataset's axes do not come and go
    columns = {name: runs.column(values, "frame", name) for name, values in outcome.items()}
    axes = {k: columns.pop(k) for k in ("frame", "name", "label", "distance_m", "time_s")}
    edges = (("x", "left", "along the surface"), ("z", "top", "depth below the surface"))
    if grid is None:
        for name, size in zip(("row", "col"), shape, strict=True):
            axes[name] = Column((name,), np.arange(size), {"units": "pixel"})
    else:
        axes |= picture_axes(grid)
        for name, edge, what in edges:
            if not scene.has_model:
                stated = scene.camera and getattr(scene.camera, f"{edge}_mm") is not None
                long_name = what if stated else "from the picture's outer edge"
                about = {"units": "mm", "long_name": long_name}
                axes[f"{name}_mm"] = replace(axes[f"{name}_mm"], attributes=about)
            about = {"units": "mm", "long_name": f"of the frame's own place from {name}_mm"}
            axes[f"shift_{name}_mm"] = Column(("frame",), shift_of(edge, grid, table), about)
    if keys := [k for k, at in enumerate(table.get(PICTURE, ())) if at is not None]:
        axes["key_frame"] = Column(("key_frame",), np.array(keys), {})
        for shift in ("shift_x_mm", "shift_z_mm") if grid is not None else ():
            at_keys = replace(axes[shift], axes=("key_frame",), values=axes[shift].values[keys])
            axes[f"key_{shift}"] = at_keys
    return columns, axes


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
    scene = isochrome.load_scene(scene)
    check_scene(scene)
    if track and each:
        raise InputError("track_each_set_followed")
    if maps not in (None, "all", "key", "none"):
        raise InputError("maps_give_all_key", maps=maps)
    if preview and out is None:
        raise InputError("preview_written_beside_results")
    if rois:
        output.load_roifile()  # missing, it is to be said before hours of work
    runs.refuse_without_folder(out, workers, cluster)
    if out is not None:
        runs.working_folder(Path(out))  # no place for results: said before anything is read
    frames = frames_of(frames)
    with runs.single_threaded(), open_scene_frames(frames, scene) as reader, ExitStack() as opened:
        opened.callback(close_kept)  # before the reader that it reads from is closed
        scene = with_file_scale(scene, reader)
        check_pixel(scene, reader.shape)
        files = input_files(reader, scene)
        if cluster is not None:
            frames, scene = absolute(frames, scene)
            reader = open_scene_frames(frames, scene)
        kind = _kind_of_set(scene, reader, track=track, each=each, every=every, maps=maps)
        kind = replace(kind, as_stated=as_stated)
        shown = runs.working_folder(Path(out)) / PREVIEW if out is not None and preview else None
        task = FrameTask(
            frames=frames, scene=scene, reader=reader, kind=kind, rois=rois,
            keep_going=keep_going, preview=shown,
        )  # fmt: skip
        options = runs.RunOptions(workers, cluster, restart, keep_going)
        result = _processed(task, partial(identity_of, task, files), out, options, progress)
        return replace(result, as_stated=as_stated, arrange=processed_panels)


def _kind_of_set(
    scene: Scene, reader: FrameReader, track: bool, each: bool, every: int | None, maps: str | None
) -> FrameKind:
    followed = track or (not each and reader.kind == "video")
    keyed = followed and accepts_keys(scene)
    if followed and not keyed:
        from isochrome.processing.kinds.tracked import TrackedFilm, check_tracked

        with suppress(InputError):
            if not track:  # a video of what cannot be followed has its frames read one by one
                check_tracked(scene, reader.shape, KEY_EVERY)
            return TrackedFilm(every=every, wanted=maps)
    for name, value in (("every", None if keyed else every), ("maps", maps)):
        if value is not None:
            raise InputError("video_followed_add_track", name=name, value=value)
    if not keyed:
        return kind_of(scene)
    from isochrome.processing.kinds.followed_film import KeyedFilm

    return KeyedFilm(key_every=every or KEY_EVERY, by_default=not track)


def _processed(
    task: FrameTask,
    identify: Callable[[], Mapping[str, Any]],
    out: str | Path | None,
    options: runs.RunOptions,
    progress: RunProgress | None,
) -> Processed:
    place = Path(out or "").absolute()
    if (
        out is not None
        and not options.restart
        # by what the files hold: no frame is decoded for it
        and (place / runs.PROVENANCE).is_file()
        and not runs.working_folder(place).exists()  # which one at work has
        and runs.faults_of(place.resolve(), identify()) == {}
    ):
        return restore(task.scene, Path(out), task.reader.shape, open_set(task).capture.residual)
    count, source = count_of(task), open_set(task)
    workers = min(options.workers or 1, set_layout(source, count // task.steps).chunks)
    with ExitStack() as opened:
        if workers > 1 and options.cluster is None:  # they start while frames are asked
            pool = runs.WorkerPool(workers, (process_chunk, task.kind))
            options = replace(options, pool=opened.enter_context(pool))
        kind = task.kind.shared(source, count, progress, on_disk=out is not None)
        task = source.task = replace(task, kind=kind)
        count //= task.steps
        if out is None:
            return process_in_memory(source, count, progress)
        job = runs.Job(partial(process_chunk, task), set_layout(source, count), identify())
        residual = source.capture.residual
        finish = partial(finish_set_folder, place, job, task, residual)
        result = runs.run_job(job, out, finish, options=options, progress=progress)
    return result or restore(task.scene, Path(out), task.reader.shape, residual)


def check_scene(scene: Scene) -> None:
    """Refuse a scene whose light, field or steps cannot tell the order, before opening frames."""
    kind_of(scene).check(scene)


def process_frame(frames: FramesLike, scene: Scene, index: int) -> FrameResult:
    """Read one frame of a set, as `process` reads it, by its number, or its state's, from 0."""
    with _captured(frames, scene, index) as (source, states):
        result = source.processed(index, states)
        row = source.task.kind.row(result, scene)
    one_state = Processed(
        scene=scene, model=scene.model, columns=tabulate_set([row]), frames=[result], fitted=None,
        warnings=result.warnings, messages=[frame_messages(result.warnings)],
    )  # fmt: skip
    return FrameResult(result, row, one_state.summary_text)


def anchor_preview(frames: FramesLike, scene: Scene, index: int) -> AnchorPreview:
    """Follow the fringes of one frame, to say what known orders would make of it."""
    if scene.polariscope.tells_orders:
        raise InputError("colours_phase_steps_read", name=scene.name)
    from isochrome.processing.kinds.image_only import AnchorPreview

    with _captured(frames, scene, index) as (source, states):
        return AnchorPreview(states[0], scene, source.capture)


@contextmanager
def _captured(
    frames: FramesLike, scene: Scene, index: int
) -> Iterator[tuple[FrameSource, list[Frame]]]:
    check_scene(scene)
    with runs.single_threaded(), open_scene_frames(frames, scene) as reader:
        scene = with_file_scale(scene, reader)
        check_pixel(scene, reader.shape)
        task = FrameTask(frames=frames, scene=scene, reader=reader, kind=kind_of(scene))
        source = FrameSource(task)
        try:
            ((_, states),) = source.captured(index, index + 1)
            yield source, states
        finally:
            source.close()


_FIRST = 3
"""Frames from the first on in which the scene's fringes are looked for, and then one in the middle
of the set: one takes seconds."""


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
    scene = isochrome.load_scene(scene)
    result = look_through(path, scene)
    frames = scene.frames
    tells = scene.has_model or (frames.no_load_dark and frames.no_load_bright)
    # states of some lights tell their orders themselves
    if not (result.ok and result.count and tells) or scene.polariscope.tells_orders:
        return result
    with runs.single_threaded():
        return result.with_more(_by_fringes(path, scene, result.count))


def _by_fringes(path: FramesLike, scene: Scene, count: int) -> Iterator[Finding]:
    with open_scene_frames(path, scene) as reader:
        scene = with_file_scale(scene, reader)
        kind, loads = kind_of(scene), scene.frames.known_loads_n
        try:
            capture = kind.prepare(scene, reader)
        except (InputError, PhysicsError) as error:
            yield Finding("error", str(error))
            return
        if scene.frames.has_known_loads:  # each read against the frames of known loads
            few = (0, len(loads) // 2)
            result = [kind.read([f], scene, capture) for f in reader if f.index in few]
            untold = [frame for frame in result if not np.isfinite(frame.columns[LOAD])]
            level: Level = "warning" if len(untold) < len(result) else "error"
            for item in untold:
                for text in item.warnings[:1]:
                    text = f"{output.named_frames([item.index])}: " + text
                    yield Finding(level, text, item.index)
        elif scene.has_model:
            tried = {*range(_FIRST), count // 2}
            frames = (frame for frame in islice(reader, max(tried) + 1) if frame.index in tried)
            yield from _asked(frames, scene, capture, count)
        else:
            from isochrome.processing.kinds.image_only import told_exposure

            for frame in islice(reader, _FIRST + 1):  # exposed otherwise than no-load frames
                for text in told_exposure(frame, own_scene(scene, frame), capture):
                    text = f"{output.named_frames([frame.index])}: " + text
                    yield Finding("warning", text, frame.index)


def _asked(
    frames: Iterator[Frame], scene: Scene, capture: Capture, count: int
) -> Iterator[Finding]:
    """What the first frame that the scene explains asks for; why, where it explains none."""
    from isochrome.processing.kinds.with_model import frame_causes

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
            Finding(level, f"{output.named_frames([frame.index])}: {t}", frame.index) for t in texts
        ]
        if explained != "not at all":
            yield from findings
            return
        lost = lost or findings
    more = message("disc_of_residual_stress") if scene.rim_diameter_mm is not None else ""
    if lost:
        *before, last = lost
        yield from before
        yield replace(last, level="error", text=last.text + more)
    if bare:
        text = refused or message("scene_fringes_not_there") + more
        grave: Level = "error" if len(bare) == count else "warning"
        yield Finding(grave, f"{output.named_frames(bare)}: " + text)
