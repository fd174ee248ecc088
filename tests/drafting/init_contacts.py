"""Judges what `init` makes of a drawn contact: the right scene, a wrong one, or a refusal."""

from dataclasses import dataclass

from drawn_contacts import WIDTH_MM, DrawnContact

import isochrome
from isochrome.drafting import SceneDraft

SIGMAS, SHARE = 3.0, 0.01
"""A right value: within three of its standard uncertainties, or within 1 %."""


@dataclass(frozen=True)
class Verdict:
    """`kind`, 'right', 'wrong' or 'refused'; `words`, why; `draft`, what was made."""

    kind: str
    words: str
    draft: SceneDraft | None = None


def known_of(case: DrawnContact) -> dict:
    """What the user of a drawn contact knows."""
    specimen, indenter = case.true.specimen, case.true.indenter
    return {
        "young_gpa": specimen.young_gpa, "poisson": specimen.poisson,
        "thickness_mm": specimen.thickness_mm,
        "fringe_value_n_per_mm": specimen.fringe_value_n_per_mm, "radius_mm": indenter.radius_mm,
        "indenter_young_gpa": indenter.young_gpa, "indenter_poisson": indenter.poisson,
        "load_n": case.about_n, "pixel_mm": case.true.camera.pixel_mm,
    }  # fmt: skip


def truth_unmirrored(case: DrawnContact) -> dict:
    """What a scene without frames.flip must say: a mirror is the contact that slides otherwise.
    A picture that is mirrored top to bottom is one turned by half a turn and mirrored left to
    right."""
    friction, left = case.true.friction.coefficient, case.true.camera.left_mm
    mirrored = case.flip is not None
    return {
        "load.normal_n": case.true.load.normal_n,
        "friction.coefficient": -friction if mirrored else friction,
        "camera.left_mm": -left - WIDTH_MM if mirrored else left,
        "camera.top_mm": case.true.camera.top_mm,
        "frames.gamma": case.gamma,
        "frames.rotate_deg": (case.turn + 180 * (case.flip == "vertical")) % 360,
        "polariscope.field": case.field,
    }


def judged(case: DrawnContact) -> Verdict:
    """What `init` makes of a drawn contact."""
    try:
        draft = isochrome.init(case.captured, known_of(case))
    except isochrome.PhysicsError as error:
        return Verdict("refused", str(error))
    return judged_draft(case, draft)


def judged_draft(case: DrawnContact, draft: SceneDraft) -> Verdict:
    """Whether a scene that was made of a drawn contact is the right one."""
    truth = truth_unmirrored(case)
    wrong = [
        f"{key} = {draft.scene.get(key)} for {truth[key]}"
        for key in ("frames.rotate_deg", "polariscope.field")
        if draft.scene.get(key) != truth[key]
    ]
    spread = {value.key: value.standard_uncertainty for value in draft.values}
    for key in ("load.normal_n", "friction.coefficient"):
        error = abs(draft.scene.get(key) - truth[key])
        if error > max(SIGMAS * spread[key], SHARE * abs(truth[key])):
            wrong.append(f"{key} = {draft.scene.get(key):.6g} for {truth[key]:.6g}")
    for key in ("camera.left_mm", "camera.top_mm"):
        if abs(draft.scene.get(key) - truth[key]) > 2.0 * case.true.camera.pixel_mm:
            wrong.append(f"{key} = {draft.scene.get(key):.6g} for {truth[key]:.6g}")
    if abs(draft.scene.frames.gamma / case.gamma - 1.0) > 0.02:
        wrong.append(f"frames.gamma = {draft.scene.frames.gamma:.4g} for {case.gamma:.4g}")
    return Verdict("wrong" if wrong else "right", "; ".join(wrong), draft)
