"""A fit's second stage: from the frames' own fits to what all of them say together."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.fit.frame_fit import FrameFit
from isochrome.fit.frame_set import FrameSet
from isochrome.fit.joint import JointFit, fit_together
from isochrome.fit.joint_each import fit_of_each, is_each
from isochrome.fit.joint_start import refuse_untold, starting_values
from isochrome.fit.laws import WEAR, compare_laws, mean_coefficients, segment_ends, segments
from isochrome.fit.refuse import CORRECT, refuse_alike
from isochrome.fit.result import Fit, make_result, said_of_frames
from isochrome.fit.sequence import Sequence
from isochrome.fit.smooth import ASKED_CHI, with_smooth_stress
from isochrome.fit.told import WearLaws

Told = Callable[[], None]


def conclude(
    data: FrameSet,
    sequence: Sequence,
    alone: list[FrameFit],
    said: Iterable[tuple[int, str]],
    told: Told,
) -> tuple[Fit, JointFit]:
    """All frames together, from what each says on its own.

    Where nothing ties them together, their own fits are the result, and no frame is read again.
    Parameters: `data`; `sequence`; `alone`, each frame's fit; `said` of frames, by their numbers;
    `told`, called with each frame of each pass. Returns the Fit and the JointFit behind it. Raises
    PhysicsError for unknowns that the frames do not tell, or not apart.
    """
    if not any(fit.positive for fit in alone):
        raise PhysicsError(
            f"{data.given.name}: nothing could be read in any of the {len(alone)} frames: the "
            f"scene's fringes are not in them; {CORRECT}"
        )
    data.plain = {i for i, fit in enumerate(alone) if fit.plain}
    if is_each(sequence):
        for key in dict.fromkeys(u.key for u in sequence.unknowns):
            refuse_untold(key, (f for i, f in enumerate(alone) if key in sequence.acting(i)))
        joint = fit_of_each(sequence, alone)
        notes = tuple(said_of_frames(said, single=sequence.count == 1))
        return make_result(joint, alone, None, notes), joint
    start = starting_values(sequence, alone)
    joint = fit_together(data, sequence, start, shape=data.shape, told=told)
    joint, laws, notes = _explained(data, joint, told)
    assert joint.covariance is not None
    refuse_alike(tuple(u.key for u in joint.unknowns), joint.covariance)
    return make_result(joint, alone, laws, notes), joint


def _explained(
    data: FrameSet, joint: JointFit, told: Told
) -> tuple[JointFit, WearLaws | None, tuple[str, ...]]:
    """The fit, with a smooth stress where it misses one, the wear laws, and what is to be said."""
    laws = _laws(data, joint, told)
    if laws is not None and laws.chi <= ASKED_CHI:
        return joint, laws, ()  # what the fit misses is the wear's, and no stress besides
    wider, notes = with_smooth_stress(data, joint, shape=data.shape, told=told)
    if laws is not None and wider is not joint:
        laws = _laws(data, wider, told)
    return wider, laws, notes


def _laws(data: FrameSet, joint: JointFit, told: Told) -> WearLaws | None:
    """The wear laws, compared by what was worn between the frames; None where nothing tells."""
    sequence = segments(joint.sequence)
    if sequence is None:
        return None
    rest = [k for k, u in enumerate(joint.unknowns) if u.key != WEAR]
    ends = segment_ends(sequence)
    start = np.concatenate([joint.values[rest], mean_coefficients(joint.scene, ends)])
    free = fit_together(data, sequence, start, shape=data.shape, told=told)
    assert free.information is not None
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
