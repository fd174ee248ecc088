"""`fit`: each frame on its own, as chunks of a long run; then all of them together.

`track`: a video's frames one after the other, each followed from the one before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import POOR_CHI, FrameData, Minimum, Unevenness
from isochrome.fitting.causes.freeing import ADDED, Freed, fit_with_causes, free_causes
from isochrome.fitting.causes.report import cause_messages, opposite_shear
from isochrome.fitting.causes.solution import FrameSolution
from isochrome.fitting.folder import (
    figure_of_frames,
    kept_values,
    restore_fit,
    write_fit,
    write_track,
)
from isochrome.fitting.frame.frame_fit import FrameFit, fit_frame, placed
from isochrome.fitting.frame.single_state import slid_until, sliding_scene
from isochrome.fitting.frame.unknowns import GAMMA, TOP, WEAR, inputs_of_rows, stated_inputs
from isochrome.fitting.frame_set import (
    CORRECT,
    PreparedFrames,
    refuse_alike,
    refuse_keys,
    refuse_states,
)
from isochrome.fitting.joint.frame_sequence import Sequence, alone_scene, make_sequence
from isochrome.fitting.joint.joint_fit import (
    JointFit,
    JointSolution,
    fit_of_each,
    is_each,
    refuse_undetermined,
    solve_jointly,
    starting_values,
)
from isochrome.fitting.joint.normal_equations import measured_areas, scar_messages
from isochrome.fitting.result import Fit, Track, make_result, make_track, restored_track, track_row
from isochrome.fitting.tracking.tracker import Apparatus, Tracker, find_apparatus
from isochrome.fitting.tractions import invert_tractions, refuse_without_contact
from isochrome.fitting.wear_laws import WearLaws, mean_coefficients, segment_ends, segments
from isochrome.frames import absolute, input_files, load_no_load, open_scene_frames, with_file_scale
from isochrome.messages import message
from isochrome.output import messages_of_frames, named_frames
from isochrome.progress import RunProgress, Tally
from isochrome.runs import (
    Job,
    Results,
    RunFolder,
    RunLayout,
    RunOptions,
    chunk_size,
    computed,
    refuse_without_folder,
    rows,
    run_identity,
    run_job,
    single_threaded,
)
from isochrome.scene import FramesLike, SceneLike, check_pixel, dump_scene, frames_of, load_scene

Progress = Callable[[], None]
_ARRAYS = (
    "values", "standard_uncertainty", "covariance", "noise_uncertainty", "sensitivity",
    "cramer_rao_bound", "information",
)  # fmt: skip
_PLAIN = ("keys", "freedom", "chi", "converged", "plain", "positive", "noise_ratio")
Row = dict[str, Any]


@dataclass(frozen=True)
class FrameWork:
    """Fits frames of `data` for the unknowns of `sequence` that act in them, whoever calls it.
    `follow`: a frame is looked for where the last one was, and there alone; `as_stated`: nothing
    else is fitted. Where nothing ties the frames together, that is the fit: what a frame asks for
    is freed in it, and unknowns that it does not tell apart are refused.
    """

    data: PreparedFrames
    sequence: Sequence
    follow: bool = False
    as_stated: bool = False

    def __call__(self, start: int, stop: int, last_values: Any = None) -> Results:
        """Frames [start, stop), each from the scene, or from where the one before ended
        (`last_values`).
        """
        rows = []
        for i, data in enumerate(self.data.some(start, stop), start):
            fit = self._row(i, data, last_values)
            rows.append(fit)
            if self.follow:
                values = zip(fit["keys"], fit["values"], strict=True)
                last_values = dict(values) if fit["positive"] else None
        good = [row["positive"] and row["chi"] <= POOR_CHI for row in rows]
        more = [{"status": "ok" if ok else "flagged"} for ok in good]
        return Results({}, rows, more, left=last_values)

    def restored(self, index: int, row: Row) -> FrameFit:
        """The fit of a frame, from its row."""
        parts: dict[str, Any] = {name: np.array(row[name], dtype=float) for name in _ARRAYS}
        parts |= {name: row[name] for name in _PLAIN} | {"keys": tuple(row["keys"])}
        parts["inputs"] = inputs_of_rows(row["inputs"])
        parts["others"] = tuple(Minimum(np.array(values), chi) for values, chi in row["others"])
        start = placed(alone_scene(self.sequence.scene, index), self.data.shape)
        fitted_values = dict(zip(row["keys"], row["values"], strict=True))
        if row.get("tractions") is not None:
            fitted_values[ADDED] = row["tractions"]
        return FrameFit(scene=start.with_values(fitted_values), **parts)

    def _row(self, index: int, data: FrameData, last: Mapping[str, float] | None) -> Row:
        """A frame's fit as plain numbers; `last`, values to look for it at, and there alone."""
        scene, keys = alone_scene(self.sequence.scene, index), self.sequence.acting(index)
        stated = stated_inputs(scene, self.sequence.scene)
        if last is not None:
            scene = scene.with_values({key: last[key] for key in keys if key in last})
        messages: tuple[str, ...] = ()
        light = None
        if self.as_stated or not is_each(self.sequence):
            fit = fit_frame(data, scene, keys, cold=last is None, stated=stated)
        else:
            extended = fit_with_causes(data, scene, keys, cold=last is None, stated=stated)
            extended = self._explained(extended)
            fit, messages = extended.fit, cause_messages(extended)
            light = extended.data.lamp.uneven
        row = {name: getattr(fit, name).tolist() for name in _ARRAYS}
        row |= {name: getattr(fit, name) for name in _PLAIN} | {"keys": list(fit.keys)}
        others = [[other.values.tolist(), float(other.chi)] for other in fit.others]
        row["inputs"] = [list(item) for item in fit.inputs.rows]
        added = fit.scene.added_tractions
        row["tractions"] = added and added.model_dump(mode="json")
        return row | {"others": others, "said": list(messages), "light": light}

    def _explained(self, extended: Freed[FrameSolution]) -> Freed[FrameSolution]:
        """What was freed, or the fit as stated where its unknowns are not told apart any more.
        Raises PhysicsError where they are not even then, in a frame that is all there is.
        """
        stated = extended.stated.fit
        if stated.positive or self.sequence.count == 1:
            refuse_alike(stated.keys, stated.information, stated.inputs.keys)
        try:
            now = extended.now.fit
            refuse_alike(now.keys, now.information, now.inputs.keys)
        except PhysicsError:
            return extended.undone()  # chi stays, and is told
        return extended


def _joint_stage(
    work: FrameWork,
    single_fits: list[FrameFit],
    messages: list[tuple[int, str]],
    progress: Progress,
) -> tuple[Fit, JointFit]:
    """All frames together, from what each says on its own: the Fit and the JointFit behind it.
    Where nothing ties them together, their own fits are the result, and no frame is read again.
    PhysicsError for unknowns that the frames do not tell, or not apart.
    """
    data, sequence = work.data, work.sequence
    if not any(fit.positive for fit in single_fits):
        causes = messages_of_frames(messages, single=sequence.count == 1)
        cause, count = next(iter(causes), message(CORRECT)), len(single_fits)
        raise PhysicsError(
            "nothing_could_read_any", name=data.given.name, single_fits_count=count, cause=cause
        )
    data.plain = {i for i, fit in enumerate(single_fits) if fit.plain}
    data.noises = {i: fit.noise_ratio for i, fit in enumerate(single_fits) if fit.noise_ratio > 1.0}
    if is_each(sequence):
        for key in dict.fromkeys(u.key for u in sequence.unknowns):
            having = (f for i, f in enumerate(single_fits) if key in sequence.acting(i))
            refuse_undetermined(key, having)
        joint = fit_of_each(sequence, single_fits)
        notices = messages_of_frames(messages, single=sequence.count == 1)
        return make_result(joint, single_fits, None, (*notices, *_opposite_shears(joint))), joint
    now = solve_jointly(data, sequence, starting_values(sequence, single_fits), progress)
    apart = _worn_apart(now)
    notes: tuple[str, ...] = ()
    joint = now.fit
    if not work.as_stated:
        # what a law of wear leaves is no cause: asked is the fit that needs none
        extended = free_causes(apart or now)
        notes = cause_messages(extended)
        if not extended.is_plain:
            wider = extended.now
            now, apart = (now.joined(wider), wider) if apart else (wider, None)
            data.lights, data.outside = now.data.lights, now.data.outside
        joint = now.fit if apart else extended.fit
    refuse_alike(tuple(u.key for u in joint.unknowns), now.fit.information, joint.inputs.keys)
    laws = WearLaws.of(apart.fit) if apart else None
    notes += (*scar_messages(sequence.areas, joint.scene), *_opposite_shears(joint))
    return make_result(joint, single_fits, laws, notes), joint


def _worn_apart(now: JointSolution) -> JointSolution | None:
    """The fit with a wear coefficient between each two frames; None where nothing tells it."""
    sequence = segments(now.fit.sequence)
    if sequence is None:
        return None
    others = [k for k, u in enumerate(now.fit.unknowns) if u.key != WEAR]
    worn = mean_coefficients(now.fit.scene, segment_ends(sequence))
    start = np.concatenate([now.fit.values[others], worn])
    return solve_jointly(now.data, sequence, start, now.progress)


def _opposite_shears(joint: JointFit) -> list[str]:
    """What to say where frames show the scene's shear the other way."""
    messages = []
    estimates = zip(joint.unknowns, joint.values, joint.standard_uncertainty, strict=True)
    for unknown, value, spread in estimates:
        first = unknown.frames[0]
        given = alone_scene(joint.sequence.scene, first)
        text = opposite_shear(given, unknown.key, float(value), float(spread))
        if text is not None and first not in joint.lost:
            messages.append((first, text))
    return messages_of_frames(messages, single=joint.sequence.count == 1)


_PASSES = 12
"""Times that a joint fit mostly goes through all frames."""


def fit(
    frames: FramesLike,
    scene: SceneLike,
    free: list[str] | tuple[str, ...],
    *,
    per_frame: list[str] | tuple[str, ...] = (),
    follow: bool = False,
    tractions: bool = False,
    as_stated: bool = False,
    out: str | Path | None = None,
    workers: int | None = 1,
    cluster: str | None = None,
    restart: bool = False,
    progress: RunProgress | None = None,
) -> Fit:
    """Fit unknowns of a scene, named by their keys, to the intensities of captured frames.

    The sum of ((I_measured - I_model)/sigma)² over all pixels is made least; background and
    illumination are linear in it, and are solved for at each step. Each frame is fitted on its own
    first, then all together. Frames of a worn contact are states of one run: the wear is simulated
    with the load, friction and wear that the unknowns stand for, over all distances, in every step
    of the fit. Where frames share neither an unknown nor a history, their own fits are the result.
    Scars of such a run, [[scar]] in the scene, are observations too: the worn area of each counts
    by its own uncertainty beside the frames.

    Parameters
    ----------
    frames : str, Path, sequence of them, array or sequence of arrays
        A TIFF stack, image, video, or a folder, list or glob of them, or frames in memory, as for
        `open_frames`; one
        frame a state.
    scene : str, Path, Scene or mapping
        A TOML file, the name of a scene of the package, a Scene, or its tables, where the fit
        starts.
    free : list or tuple of str
        Keys that all frames share, such as 'load.normal_n' (an unknown frames.gamma is one of
        them).
    per_frame : list or tuple of str, optional
        Keys that have a value in each frame.
    follow : bool, default False
        Whether a frame is looked for where the last one was, and there alone.
    tractions : bool, default False
        Whether each frame's pressure and shear are found without a contact model too.
    as_stated : bool, default False
        Whether all that the scene states is held, and nothing else is fitted than its unknowns;
        else what a frame asks for is fitted too and named in the warnings: the camera's roll,
        distortion and keystone, gamma, blur, plates, band of wavelengths, a smooth stress, uneven
        light, and dust is left out. Frames that share an unknown or a history are asked together,
        and what they ask for is one unknown of all of them.
    out : str or Path, optional
        Folder for fit.csv, scene.toml (fitted), fit.json, provenance.json, fit.png, report.html,
        run.zarr (values over frame, see `open_run`), of several frames fit_over_distance.png and
        wear_laws.csv, and with `tractions` tractions.csv, tractions.png, sigma_1_mpa.tif,
        sigma_2_mpa.tif and fringe_order.tif.
    workers : int or None, default 1
        Processes on this machine; None: as many as are useful. A script that asks for more than
        one needs the usual ``if __name__ == "__main__":``.
    cluster : str, optional
        Address of a Dask scheduler, in place of `workers`, such as 'tcp://host:8786'.
    restart : bool, default False
        Whether to begin anew where an earlier run was interrupted or is complete.
    progress : callable, optional
        Called with a Tally of the frames, a pass over them counting as often as there are.

    Returns
    -------
    Fit
        Values, standard uncertainties and Cramér-Rao bounds by key, in the units that the keys
        name; chi, the residual over the noise; the fitted scene.

    Raises
    ------
    InputError
        Where a key is unknown, or two keys cannot be told apart in these frames.
    PhysicsError
        Where the frames do not hold the scene's fringes.

    Notes
    -----
    What is finished is kept in ``OUT.partial`` until all is: after a crash, the same call
    resumes from there. Source of the separable least squares: Golub & Pereyra (2003), Inverse
    Problems 19, R1; of the bounds: Kay (1993), Fundamentals of Statistical Signal Processing I,
    section 3.7.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("ring").with_values({
    ...     "load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
    ...     "camera.pixel_mm": 0.36, "camera.noise_grey": 1.0})
    >>> simulated = isochrome.simulate(scene, "simulated")
    >>> start = scene.with_values({"load.normal_n": 63.0})
    >>> found = isochrome.fit("simulated/frames.tif", start, ["load.normal_n"])
    >>> print(f"{found.table['value'][0]:.1f} N")
    60.0 N
    """
    scene = load_scene(scene)
    shared, per_frame_keys = tuple(free), tuple(per_frame)
    refuse_keys(scene, shared, per_frame_keys)
    if tractions:
        refuse_without_contact(scene)
    refuse_without_folder(out, workers, cluster)
    if scene.frames.gamma == "unknown":
        scene = scene.with_values({GAMMA: scene.frames.first_gamma})
        shared += () if GAMMA in per_frame_keys + shared else (GAMMA,)
    frames = frames_of(frames)
    files = input_files(open_scene_frames(frames, scene), scene)
    if cluster is not None:
        frames, scene = absolute(frames, scene)
    keys = shared + per_frame_keys
    with single_threaded(), closing(PreparedFrames(frames, scene)) as data:
        count, (height, width) = len(data), data.shape
        sequence = _sequence(data, shared, per_frame_keys)
        work = FrameWork(data, sequence, follow, as_stated)
        steps = _Steps(progress, count, 1 + _PASSES * (not is_each(sequence)) + tractions)
        concluded = partial(_concluded, work, steps, keys, tractions)
        layout = RunLayout(axes={"frame": count}, chunk=chunk_size(count, 4 * height * width))
        if out is None:
            return concluded(computed(Job(work, layout, {}, in_turn=follow), steps.run))[0]
        options = {"free": list(shared), "per_frame": list(per_frame_keys), "follow": follow}
        options |= {"tractions": tractions} | ({"as_stated": True} if as_stated else {})
        identity = run_identity(dump_scene(data.given), files, options)
        job = Job(work, layout, identity, in_turn=follow)

        def finish(run_folder: RunFolder) -> Fit:
            result, joint = concluded(row for row, _ in rows(run_folder))
            write_fit(run_folder, job, data.given.name, data, result, joint)
            return result

        run = partial(run_job, job, out, finish, progress=steps.run)
        results = run(options=RunOptions(workers, cluster, restart))
        if results is None and tractions:  # a folder does not hold all of them
            results = run(options=RunOptions(workers, cluster, restart=True))
        return results or restore_fit(Path(out), data.given, None if as_stated else keys)


def _sequence(
    data: PreparedFrames, shared: tuple[str, ...], per_frame: tuple[str, ...]
) -> Sequence:
    """The unknowns of some frames, with the worn areas that were measured of their run."""
    sequence = make_sequence(placed(data.scene, data.shape), len(data), shared, per_frame)
    if not data.scene.scar:
        return sequence
    if not sequence.run:  # its frames do not show the wear that a scar measures
        raise InputError("scar_measured_one_run", name=sequence.scene.name)
    return replace(sequence, areas=measured_areas(data.scene))


def _concluded(
    work: FrameWork, steps: _Steps, keys: tuple[str, ...], tractions: bool, results: Iterable[Row]
) -> tuple[Fit, JointFit]:
    """What the frames' own fits come to, of some `keys`."""
    data, results = work.data, list(results)
    single_fits = [work.restored(i, row) for i, row in enumerate(results)]
    messages = [(i, text) for i, row in enumerate(results) for text in row["said"]]
    data.lights = {i: Unevenness(*row["light"]) for i, row in enumerate(results) if row["light"]}
    result, joint = _joint_stage(work, single_fits, messages, steps.one)
    result = replace(result, asked=None if work.as_stated else keys)
    if tractions:
        result = _with_tractions(result, data, joint, free_top=TOP in keys, progress=steps.one)
    else:
        result = replace(result, warnings=(*result.warnings, *asked_for(result)))
    steps.end()
    frames = data.path, data.given, frozenset(data.plain), dict(data.lights)
    return replace(result, draw=partial(figure_of_frames, *frames, joint.scenes)), joint


ASK_CHI = 1.1
"""Residual over noise of a model's fit from which tractions are the better description."""


def asked_for(result: Fit) -> tuple[str, ...]:
    """What to say of a contact's fit without tractions: whether they are called for."""
    poor = [i for i, chi in enumerate(result.frame_chi) if chi > ASK_CHI]
    if not poor or result.scene.indenter is None:
        return ()
    worst, frames = max(result.frame_chi), named_frames(poor)
    return (message("chi_contact_model_does", frame_chi=worst, named_frames=frames),)


def _with_tractions(
    result: Fit, data: PreparedFrames, joint: JointFit, *, free_top: bool, progress: Progress
) -> Fit:
    """A fit with each frame's tractions, from the `joint` fit's scenes, then those given."""
    plain, data.plain = data.plain, set()  # a poor model's light is not the frame's
    outcome, messages = [], list[str]()
    head = "tractions of frame {i}: " if len(data) > 1 else "tractions: "
    for i, frame in enumerate(data):
        given = placed(alone_scene(data.scene, i), data.shape)
        one = invert_tractions(frame, joint.scenes[i], given, free_top=free_top)
        messages += [head.format(i=i) + text for text in one.warnings]
        outcome.append(one)
        progress()
    data.plain = plain
    return replace(result, tractions=tuple(outcome), warnings=(*result.warnings, *messages))


class _Steps:
    """Progress over passes whose number is not known before."""

    def __init__(self, progress: RunProgress | None, count: int, passes: int) -> None:
        self.progress, self.count = progress, count
        self.tally = Tally(0, count * passes, 0, 0)

    def run(self, tally: Tally) -> None:
        """How far the first pass is."""
        self._tell(replace(tally, count=self.tally.count))

    def one(self) -> None:
        """One frame of one pass is done."""
        done, count = self.tally.done + 1, self.tally.count
        self._tell(replace(self.tally, done=done, count=count + self.count * (done > count)))

    def end(self) -> None:
        """All is done."""
        self._tell(replace(self.tally, done=self.tally.count))

    def _tell(self, tally: Tally) -> None:
        self.tally = tally
        if self.progress is not None:
            self.progress(tally)


CHUNK = 250
"""Frames that are kept together: a killed track goes on from the last of them."""


def track(
    frames: FramesLike,
    scene: SceneLike,
    keys: list[str] | tuple[str, ...],
    *,
    as_stated: bool = False,
    out: str | Path | None = None,
    workers: int | None = None,
    cluster: str | None = None,
    restart: bool = False,
    progress: RunProgress | None = None,
) -> Track:
    """Follow keys of a contact scene through a video, each frame from the one before.

    One frame is in memory. Of a worn contact, the worn area at a frame is what the tracked loads
    and frictions have worn until then by the scene's law; its distance comes from the frames' times
    and frames.sliding_speed_mm_per_s, or from wear.distances_m, one a frame.

    Parameters
    ----------
    frames : str, Path, sequence of them, array or sequence of arrays
        A TIFF stack, image, video, or a folder, list or glob of them, or frames in memory, as for
        `open_frames`.
    scene : str, Path, Scene or mapping
        A TOML file, the name of a scene of the package, a Scene, or its tables, where the first
        frame's search starts.
    keys : list or tuple of str
        Keys to follow: load.normal_n, load.tangential_n, load.bulk_mpa, friction.coefficient,
        wear.coefficient_mm2_per_n, camera.left_mm, camera.top_mm.
    as_stated : bool, default False
        Whether all that the scene states is held; else the first frame (or the middle or last one,
        where that shows nothing) is asked for what belongs to the apparatus (the camera's roll,
        distortion and keystone, gamma, blur, plates, band of wavelengths, uneven light, dust), and
        what is found is held in all frames and named in the warnings.
    out : str or Path, optional
        Folder for fit.csv, scene.toml (the means), fit.json, provenance.json, fit.png,
        report.html, run.zarr (values over frame, see `open_run`).
    workers : int or None, optional
        Only one process can follow a track: more than one is refused.
    cluster : str, optional
        Refused, as more than one worker is.
    restart : bool, default False
        Whether to begin anew where an earlier run was interrupted or is complete.
    progress : callable, optional
        Called with a Tally of the frames.

    Returns
    -------
    Track
        Values and standard uncertainties (frame, key), in the units that the keys name, and chi
        (frame,).

    Raises
    ------
    InputError
        Where keys or the scene cannot be tracked, or frames are bad.
    PhysicsError
        Where no frame determines a value.

    Notes
    -----
    What is finished is kept in ``OUT.partial`` until all is: after a crash, the same call
    resumes from there. The worn area is W' = ∫ k P' ds over the sliding distance s, with the
    wear coefficient k (mm²/N) and the load P' on a unit of thickness (N/mm): Archard (1953), J.
    Appl. Phys. 24, 981.

    Examples
    --------
    A video of a contact, which this page has none of:

    >>> import isochrome
    >>> found = isochrome.track(
    ...     "recording.avi", "scene.toml", ["load.normal_n", "camera.left_mm"], out="tracked"
    ... )  # doctest: +SKIP
    >>> found.table  # doctest: +SKIP
    """
    scene = load_scene(scene)
    keys = tuple(keys)
    refuse_keys(scene, (), keys)
    frames = frames_of(frames)
    with single_threaded(), open_scene_frames(frames, scene) as reader:
        scene = with_file_scale(scene, reader)
        check_pixel(scene, reader.shape)
        given = sliding_scene(scene)
        no_load = load_no_load(given, full_shape=reader.full_shape)
        apparatus = Apparatus(scene=placed(given, reader.shape))
        make_tracker = partial(Tracker, keys=keys, bit_depth=reader.bit_depth, no_load=no_load)
        make_tracker(apparatus.scene)  # what cannot be tracked is refused
        if (count := reader.count(decode=False)) == 0:
            raise InputError("holds_no_frame_check", path=reader.path)
        if scene.frames.sliding_speed_mm_per_s is None:
            refuse_states(reader.path, count, given)
        if not as_stated:
            apparatus = find_apparatus(reader, given, keys, count=count, no_load=no_load)
            given = apparatus.scene

        def work(start: int, stop: int, left: Any) -> Results:
            tracker = make_tracker(apparatus.scene, apparatus=apparatus)
            if left is not None:
                tracker.resume(left)
            found = []
            for index in range(start, stop):
                frame = reader.frame(index)
                distance = slid_until(given, frame)
                found.append(track_row(index, distance, keys, tracker.track(frame, distance)))
            more = [{"status": "flagged" if row["messages"] else "ok"} for row in found]
            return Results({}, found, more, {}, tracker.state())

        layout = RunLayout(axes={"frame": count}, chunk=CHUNK)
        result_of = partial(make_track, keys=keys, scene=given, said=apparatus.warnings)
        if out is None:
            return result_of(computed(Job(work, layout, {}, in_turn=True), progress))
        options = {"track": list(keys)} | ({"as_stated": True} if as_stated else {})
        identity = run_identity(dump_scene(scene), input_files(reader, scene), options)
        job = Job(work, layout, identity, in_turn=True)

        def finish(run_folder: RunFolder) -> Track:
            result = result_of(row for row, _ in rows(run_folder))
            write_track(run_folder, job, result, [more["status"] for _, more in rows(run_folder)])
            return result

        options_of_run = RunOptions(workers, cluster, restart)
        result = run_job(job, out, finish, options=options_of_run, progress=progress)
    return result or restored_track(*kept_values(Path(out), scene), keys)
