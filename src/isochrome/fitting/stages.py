"""A fit's stages: each frame on its own, as chunks of a long run; then all of them together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import POOR_CHI, FrameData, Minimum
from isochrome.fitting.causes.freeing import Freed, fit_with_causes, free_causes
from isochrome.fitting.causes.report import cause_messages, opposite_shear
from isochrome.fitting.causes.solution import FrameSolution
from isochrome.fitting.frame.frame_estimate import FrameFit
from isochrome.fitting.frame.frame_fit import fit_frame, placed
from isochrome.fitting.frame.inputs import inputs_of_rows, stated_inputs
from isochrome.fitting.frame.unknowns import WEAR
from isochrome.fitting.frame_set import PreparedFrames
from isochrome.fitting.joint.frame_sequence import Sequence, alone_scene
from isochrome.fitting.joint.joint_fit import JointFit
from isochrome.fitting.joint.joint_solution import JointSolution, solve_jointly
from isochrome.fitting.joint.measured_scars import scar_messages
from isochrome.fitting.joint.separate_fits import (
    fit_of_each,
    is_each,
    refuse_undetermined,
    starting_values,
    with_scars,
)
from isochrome.fitting.refusals import CORRECT, refuse_alike
from isochrome.fitting.result import Fit, make_result
from isochrome.fitting.wear_laws.law_evidence import (
    compare_laws,
    mean_coefficients,
    segment_ends,
    segments,
)
from isochrome.fitting.wear_laws.law_report import WearLaws
from isochrome.output import messages_of_frames
from isochrome.runs import Results

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

    `follow`, whether a frame is looked for where the last one was, and there alone; `as_stated`,
    whether nothing else is fitted.
    Where nothing ties the frames together, that is the fit: what a frame asks for is freed in it,
    and unknowns that it does not tell apart are refused.
    """

    data: PreparedFrames
    sequence: Sequence
    follow: bool = False
    as_stated: bool = False

    def __call__(self, start: int, stop: int, left: Any = None) -> Results:
        """Frames [start, stop), each from the scene, or from where the one before ended.

        `left`, the last chunk's values where frames are followed. Raises InputError, PhysicsError.
        """
        rows = []
        for i, data in enumerate(self.data.some(start, stop), start):
            fit = self._row(i, data, left)
            rows.append(fit)
            if self.follow:
                values = zip(fit["keys"], fit["values"], strict=True)
                left = dict(values) if fit["positive"] else None
        good = [row["positive"] and row["chi"] <= POOR_CHI for row in rows]
        more = [{"status": "ok" if ok else "flagged"} for ok in good]
        return Results({}, rows, more, left=left)

    def restored(self, index: int, row: Row) -> FrameFit:
        """The fit of a frame, from its row."""
        parts: dict[str, Any] = {name: np.array(row[name], dtype=float) for name in _ARRAYS}
        parts |= {name: row[name] for name in _PLAIN} | {"keys": tuple(row["keys"])}
        parts["inputs"] = inputs_of_rows(row["inputs"])
        parts["others"] = tuple(Minimum(np.array(values), chi) for values, chi in row["others"])
        start = placed(alone_scene(self.sequence.scene, index), self.data.shape)
        found = dict(zip(row["keys"], row["values"], strict=True))
        return FrameFit(scene=start.with_values(found), **parts)

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
            freed = fit_with_causes(data, scene, keys, cold=last is None, stated=stated)
            freed = self._explained(freed)
            fit, messages = freed.fit, cause_messages(freed)
            light = freed.data.lamp.terms if freed.light else None
        row = {name: getattr(fit, name).tolist() for name in _ARRAYS}
        row |= {name: getattr(fit, name) for name in _PLAIN} | {"keys": list(fit.keys)}
        others = [[other.values.tolist(), float(other.chi)] for other in fit.others]
        row["inputs"] = [list(item) for item in fit.inputs.rows]
        return row | {"others": others, "said": list(messages), "light": light}

    def _explained(self, freed: Freed[FrameSolution]) -> Freed[FrameSolution]:
        """What was freed, or the fit as stated where its unknowns are not told apart any more.

        Raises PhysicsError where they are not even then, in a frame that is all there is.
        """
        stated = freed.stated.fit
        # what a frame does not tell, a measured scar may
        if not self.sequence.areas and (stated.positive or self.sequence.count == 1):
            refuse_alike(stated.keys, stated.information, stated.inputs.keys)
        try:
            now = freed.now.fit
            refuse_alike(now.keys, now.information, now.inputs.keys)
        except PhysicsError:
            return freed.undone()  # chi stays, and is told
        return freed


def joint_stage(
    data: PreparedFrames,
    sequence: Sequence,
    alone: list[FrameFit],
    messages: Iterable[tuple[int, str]],
    progress: Progress,
    *,
    as_stated: bool = False,
) -> tuple[Fit, JointFit]:
    """All frames together, from what each says on its own.

    Where nothing ties them together, their own fits are the result, and no frame is read again.
    Parameters: `data`; `sequence`; `alone`, each frame's fit; `messages` of frames, by their
    numbers; `progress`, called with each frame of each pass; `as_stated`, whether nothing else is
    fitted. Returns the Fit and the JointFit behind it. Raises PhysicsError for unknowns that the
    frames do not tell, or not apart.
    """
    if not any(fit.positive for fit in alone):
        cause = next(iter(messages_of_frames(messages, single=sequence.count == 1)), CORRECT)
        raise PhysicsError(
            f"{data.given.name}: nothing could be read in any of the {len(alone)} frames: the "
            f"scene's fringes are not in them; {cause}"
        )
    data.plain = {i for i, fit in enumerate(alone) if fit.plain}
    data.noises = {i: fit.noise_ratio for i, fit in enumerate(alone) if fit.noise_ratio > 1.0}
    if is_each(sequence) and _frame_tells_all(sequence, alone):
        for key in dict.fromkeys(u.key for u in sequence.unknowns):
            refuse_undetermined(key, (f for i, f in enumerate(alone) if key in sequence.acting(i)))
        joint = fit_of_each(sequence, alone)
        said = tuple(messages_of_frames(messages, single=sequence.count == 1))
        if sequence.areas:
            joint = with_scars(joint, alone[0])
            said += scar_messages(sequence.areas, joint.scene)
        return make_result(joint, alone, None, (*said, *_opposite_shears(joint))), joint
    start = starting_values(sequence, alone)
    now = solve_jointly(data, sequence, start, progress)
    apart = _worn_apart(now)
    notes: tuple[str, ...] = ()
    joint = now.fit
    if not as_stated:
        # what a law of wear leaves is no cause: asked is the fit that needs none
        freed = free_causes(now if apart is None else apart)
        notes = cause_messages(freed)
        if not freed.is_plain:
            now = freed.now if apart is None else now.joined(freed.now)
            apart = None if apart is None else freed.now
            data.lights, data.outside = now.data.lights, now.data.outside
        joint = freed.fit if apart is None else now.fit
    assert now.fit.information is not None
    refuse_alike(tuple(u.key for u in joint.unknowns), now.fit.information, joint.known)
    laws = None if apart is None else _laws(apart.fit)
    notes += (*scar_messages(sequence.areas, joint.scene), *_opposite_shears(joint))
    return make_result(joint, alone, laws, notes), joint


def _frame_tells_all(sequence: Sequence, alone: list[FrameFit]) -> bool:
    """Whether scars, if any were measured, add to a frame that tells all unknowns by itself."""
    if not sequence.areas:
        return True
    (fit,) = alone
    try:
        refuse_alike(fit.keys, fit.information, fit.inputs.keys)
    except PhysicsError:
        return False
    return fit.positive and bool(np.isfinite(fit.standard_uncertainty).all())


def _worn_apart(now: JointSolution) -> JointSolution | None:
    """The fit with a wear coefficient between each two frames; None where nothing tells it."""
    sequence = segments(now.fit.sequence)
    if sequence is None:
        return None
    rest = [k for k, u in enumerate(now.fit.unknowns) if u.key != WEAR]
    worn = mean_coefficients(now.fit.scene, segment_ends(sequence))
    start = np.concatenate([now.fit.values[rest], worn])
    return solve_jointly(now.data, sequence, start, now.progress)


def _opposite_shears(joint: JointFit) -> list[str]:
    """What to say where frames show the scene's shear the other way."""
    messages = []
    found = zip(joint.unknowns, joint.values, joint.standard_uncertainty, strict=True)
    for unknown, value, spread in found:
        first = unknown.frames[0]
        given = alone_scene(joint.sequence.scene, first)
        text = opposite_shear(given, unknown.key, float(value), float(spread))
        if text is not None and first not in joint.lost:
            messages.append((first, text))
    return messages_of_frames(messages, single=joint.sequence.count == 1)


def _laws(free: JointFit) -> WearLaws:
    """The wear laws, compared by what was worn between the frames of a fit without one."""
    ends = segment_ends(free.sequence)
    assert free.information is not None
    worn = [k for k, u in enumerate(free.unknowns) if u.key == WEAR]
    names = ("from_m", "to_m", "value", "standard_uncertainty")
    columns = np.array(
        [[0.0, *ends[:-1]], ends, free.values[worn], free.standard_uncertainty[worn]]
    )
    between = [dict(zip(names, row, strict=True)) for row in columns.T.tolist()]
    laws = compare_laws(
        free.sequence, free.values, free.information, cost=free.cost, freedom=free.freedom
    )
    return WearLaws(laws, tuple(between), free.chi)
