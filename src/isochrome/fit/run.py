"""`fit`: a scene's unknowns from captured frames, each with its standard uncertainty."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from isochrome.fit.figure import fit_figure
from isochrome.fit.frame_fit import FrameFit, placed
from isochrome.fit.frame_set import FrameSet
from isochrome.fit.history import alone_scene
from isochrome.fit.joint import JointFit, fit_of_one, fit_together
from isochrome.fit.joint_start import fit_alone, starting_values
from isochrome.fit.laws import WEAR, compare_laws, mean_coefficients, segment_ends, segments
from isochrome.fit.local import GAMMA
from isochrome.fit.over_distance import over_distance_figure
from isochrome.fit.refuse import refuse_alike, refuse_keys
from isochrome.fit.result import Fit, fitted_scene, make_result
from isochrome.fit.sequence import make_sequence
from isochrome.fit.smooth import ASKED_CHI, with_smooth_stress
from isochrome.fit.told import WearLaws
from isochrome.fit.tractions import refuse_without_contact
from isochrome.fit.tractions_run import asked_for, with_tractions, write_tractions
from isochrome.output import provenance, staged, write_csv, write_figure, write_json, write_text
from isochrome.progress import Progress
from isochrome.scene import Scene, dump_scene, load_scene

__all__ = ["Fit", "fit", "fitted_scene"]

_PASSES = 12
"""Times that a joint fit mostly goes through all frames."""


def fit(
    frames: str | Path,
    scene: str | Path | Scene,
    free: list[str] | tuple[str, ...],
    *,
    per_frame: list[str] | tuple[str, ...] = (),
    follow: bool = False,
    tractions: bool = False,
    out: str | Path | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Fit unknowns of a scene, named by their keys, to the intensities of captured frames.

    Frames of a worn contact are states of one run: the wear is simulated with the load, friction
    and wear that the unknowns stand for, over all distances, in every step of the fit.
    Parameters: `frames`, one a state; `scene`, where the fit starts; `free`, keys that all frames
    share, such as 'load.normal_n' (an unknown frames.gamma is one of them); `per_frame`, keys with
    a value a frame; `follow`, whether a frame is looked for where the last one was, and there
    alone; `tractions`, whether each frame's pressure and shear are found without a contact model
    too; `out`, a folder for fit.csv, scene.toml (fitted), fit.json, provenance.json, fit.png, of
    several frames fit_over_distance.png and wear_laws.csv, and with `tractions` tractions.csv,
    tractions.png, sigma_1_mpa.tif, sigma_2_mpa.tif and fringe_order.tif; `progress`, called with
    (done, all).
    Returns a Fit. Raises InputError for unknown keys and those that cannot be told apart,
    PhysicsError where the frames do not hold the scene's fringes.
    """
    scene = load_scene(scene)
    shared, own = tuple(free), tuple(per_frame)
    refuse_keys(scene, shared, own)
    if tractions:
        refuse_without_contact(scene)
    if scene.frames.gamma == "unknown":
        scene = scene.with_values({GAMMA: scene.frames.first_gamma})
        shared += () if GAMMA in own + shared else (GAMMA,)
    data = FrameSet(frames, scene)
    steps = _Steps(progress, len(data))
    joint, alone = _fitted(data, shared, own, follow=follow, steps=steps)
    joint, laws, notes = _explained(data, joint, steps)
    refuse_alike(tuple(u.key for u in joint.unknowns), joint.covariance)
    result = make_result(joint, alone, laws, notes)
    if tractions:
        given = [placed(alone_scene(data.scene, i), data.shape) for i in range(len(data))]
        free_top = "camera.top_mm" in shared + own
        result = with_tractions(result, data, joint, given, free_top=free_top, told=steps.one)
    else:
        result = replace(result, warnings=(*result.warnings, *asked_for(result)))
    if out is not None:
        with staged(out) as folder:
            write_csv(folder / "fit.csv", result.table())
            if result.wear_laws is not None:
                write_csv(folder / "wear_laws.csv", result.wear_laws.table())
            write_text(folder / "scene.toml", dump_scene(result.scene))
            write_json(folder / "fit.json", result.to_json())
            write_json(folder / "provenance.json", provenance(dump_scene(scene), [Path(frames)]))
            write_figure(folder / "fit.png", fit_figure(scene.name, data, joint.scenes))
            if tractions:
                write_tractions(folder, data, joint, result)
            over_distance = over_distance_figure(scene.name, result)
            if over_distance is not None:
                write_figure(folder / "fit_over_distance.png", over_distance)
    steps.end()
    return result


def _fitted(
    data: FrameSet,
    shared: tuple[str, ...],
    own: tuple[str, ...],
    *,
    follow: bool,
    steps: _Steps,
) -> tuple[JointFit, list[FrameFit]]:
    """Each frame on its own, then all of them together."""
    sequence = make_sequence(placed(data.scene, data.shape), len(data), shared, own)
    alone = fit_alone(data, sequence, follow=follow, told=steps.one)
    data.plain |= {i for i, fit in enumerate(alone) if fit.plain}
    start = starting_values(sequence, alone)
    only = fit_of_one(sequence, alone[0]) if len(alone) == 1 else None
    if only is not None:
        return only, alone
    return fit_together(data, sequence, start, shape=data.shape, told=steps.one), alone


def _explained(
    data: FrameSet, joint: JointFit, steps: _Steps
) -> tuple[JointFit, WearLaws | None, tuple[str, ...]]:
    """The fit, with a smooth stress where it misses one, the wear laws, and what is to be said."""
    laws = _laws(data, joint, steps)
    if laws is not None and laws.chi <= ASKED_CHI:
        return joint, laws, ()  # what the fit misses is the wear's, and no stress besides
    wider, notes = with_smooth_stress(data, joint, shape=data.shape, told=steps.one)
    if laws is not None and wider is not joint:
        laws = _laws(data, wider, steps)
    return wider, laws, notes


def _laws(data: FrameSet, joint: JointFit, steps: _Steps) -> WearLaws | None:
    """The wear laws, compared by what was worn between the frames; None where nothing tells."""
    sequence = segments(joint.sequence)
    if sequence is None:
        return None
    rest = [k for k, u in enumerate(joint.unknowns) if u.key != WEAR]
    ends = segment_ends(sequence)
    start = np.concatenate([joint.values[rest], mean_coefficients(joint.scene, ends)])
    free = fit_together(data, sequence, start, shape=data.shape, told=steps.one)
    worn = slice(len(rest), None)
    between = [
        {"from_m": before, "to_m": end, "value": value, "standard_uncertainty": spread}
        for before, end, value, spread in zip(
            [0.0, *ends[:-1].tolist()],
            ends.tolist(),
            free.values[worn].tolist(),
            free.standard_uncertainty[worn].tolist(),
            strict=True,
        )
    ]
    laws = compare_laws(
        free.sequence, free.values, free.information, cost=free.cost, freedom=free.freedom
    )
    return WearLaws(laws, tuple(between), free.chi)


class _Steps:
    """Progress over passes whose number is not known before."""

    def __init__(self, progress: Progress | None, count: int) -> None:
        self.progress, self.count, self.done = progress, count, 0
        self.all = count * (1 + _PASSES)
        self._tell()

    def one(self) -> None:
        """One frame of one pass is done."""
        self.done += 1
        if self.done >= self.all:
            self.all += self.count
        self._tell()

    def end(self) -> None:
        """All is done."""
        self.done = self.all
        self._tell()

    def _tell(self) -> None:
        if self.progress is not None:
            self.progress(self.done, self.all)
