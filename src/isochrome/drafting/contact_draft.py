"""The scene of a contact: the first frame that it explains, and each value with what it is from."""

from __future__ import annotations

from functools import partial

from isochrome.drafting.captured_set import (
    described_set,
    file_values,
    frame_of,
    frames_to_look_at,
    light_values,
    open_of_set,
    refuse_unclear,
)
from isochrome.drafting.contact_fit import FOUND, ContactFit, find_contact, start_scene
from isochrome.drafting.draft_figure import draft_figure
from isochrome.drafting.fringeless import has_no_fringes
from isochrome.drafting.known_values import QUANTITIES, KnownValues, refuse_missing
from isochrome.drafting.scene_draft import DraftValue, Origin, SceneDraft
from isochrome.drafting.scene_text import written_draft
from isochrome.errors import IsochromeError, PhysicsError
from isochrome.estimation import prepare_frame
from isochrome.fitting import FRICTION, GAMMA
from isochrome.frames import Frame, FrameReader
from isochrome.output import named_frames
from isochrome.scene import Scene

_HAS_SIDE = 4.0
"""Standard uncertainties beyond which friction has a side."""


def draft_contact(frames: FrameReader, given: KnownValues) -> SceneDraft:
    """Draft the scene of a contact. Raises InputError, PhysicsError; see `draft_scene`."""
    refuse_missing(given)
    refuse_unclear(frames, given)
    pixel_mm = given.pixel_mm or frames.pixel_mm
    assert pixel_mm is not None
    scene = start_scene(pixel_mm, frames.shape, given)
    contact = _first_explained(frames, scene, given)
    turned = contact.lying.rotate_deg in (90, 270)
    values = [*_given_values(given), *file_values(frames, given, turned=turned)]
    origin: Origin = "file" if given.pixel_mm is None else "given"
    values.append(DraftValue(key="camera.pixel_mm", value=pixel_mm, origin=origin))
    values += [*_found_values(contact, given), *light_values(given)]
    open_keys = open_of_set(frames, given)
    head = [
        f"Drafted by isochrome init from {described_set(frames)}",
        f"Frame {contact.frame} was looked at: the contact's fringes leave {contact.fit.chi:.2f} "
        "times its noise.",
        "What follows ± is the standard uncertainty by the frame's noise alone: what was given is "
        "taken as exact. Where that is measured, { value = ..., standard_uncertainty = ... } says "
        "how well.",
    ]
    return written_draft(
        head,
        values,
        open_keys,
        warnings=contact.messages,
        frame=contact.frame,
        chi=contact.fit.chi,
        draw=partial(draft_figure, contact.data, contact.fit.scene, values),
    )


def _first_explained(frames: FrameReader, scene: Scene, given: KnownValues) -> ContactFit:
    """The contact in the first frame that it explains; else what was said of the first frame that
    shows fringes."""
    refused: IsochromeError | None = None
    bare: list[Frame] = []
    for index in frames_to_look_at(frames, given):
        frame = frame_of(frames, index, given)
        try:
            return find_contact(frame, scene, given, bit_depth=frames.bit_depth)
        except PhysicsError as error:
            if has_no_fringes(prepare_frame(frame, scene, bit_depth=frames.bit_depth)):
                bare.append(frame)
            else:
                refused = refused or error
    if refused is None:
        first = bare[0]
        raise PhysicsError(
            f"{first.name}: no fringes in {named_frames([one.index for one in bare])}, whose light "
            "is smooth all over; is it loaded? take a loaded frame, by another --frame"
        )
    raise refused


def _given_values(given: KnownValues) -> list[DraftValue]:
    """What the user knows of the bodies."""
    names = (
        "young_gpa", "poisson", "thickness_mm", "fringe_value_n_per_mm", "radius_mm",
        "indenter_young_gpa", "indenter_poisson",
    )  # fmt: skip
    return [
        DraftValue(
            key=QUANTITIES[name].key,
            value=getattr(given, name),
            origin="given",
            note=QUANTITIES[name].unit,
        )
        for name in names
    ]


def _found_values(contact: ContactFit, given: KnownValues) -> list[DraftValue]:
    """What the frame tells."""
    fit, lying = contact.fit, contact.lying
    spread = dict(zip(fit.keys, fit.standard_uncertainty.tolist(), strict=True))
    notes = {
        "load.normal_n": f"about {given.load_n:g} was given",
        FRICTION: _side(contact),
        "camera.left_mm": "of the first column's outer edge, from the middle of the contact",
        "camera.top_mm": _surface(contact),
        GAMMA: "the camera stores light^(1/gamma)",
    }
    more = [key for key in fit.keys if key not in (*FOUND, GAMMA)]
    for key, names in contact.unsure.items():
        others = " or ".join(names)
        notes[key] = f"the frame asks for it, or for {others}, and cannot tell which"
    values = [
        DraftValue(
            key=key,
            # a friction that is not seen would state a side
            value=float(fit.scene.get(key)) if key != FRICTION or _is_seen(contact) else 0.0,
            origin="found",
            standard_uncertainty=spread[key],
            note=notes.get(key, "the frame asks for it"),
        )
        for key in (*FOUND, *((GAMMA,) if GAMMA in fit.keys else ()), *more)
    ]
    if given.gamma is not None:
        values.append(DraftValue(key=GAMMA, value=given.gamma, origin="given"))
    origin: Origin = "found" if given.field is None else "given"
    values.append(DraftValue(key="polariscope.field", value=lying.field, origin=origin))
    if lying.rotate_deg:
        origin = "found" if given.rotate_deg is None else "given"
        note = "quarter turns, counter-clockwise, after which the load comes from above"
        values.append(
            DraftValue(key="frames.rotate_deg", value=lying.rotate_deg, origin=origin, note=note)
        )
    return values


def _is_seen(contact: ContactFit) -> bool:
    """Whether friction is more than nothing."""
    place = contact.fit.keys.index(FRICTION)
    spread = float(contact.fit.standard_uncertainty[place])
    return abs(float(contact.fit.values[place])) > _HAS_SIDE * spread


def _side(contact: ContactFit) -> str:
    """Which way friction points, and that a mirror would look the same."""
    value = float(contact.fit.scene.get(FRICTION))
    if not _is_seen(contact):
        return "no friction is seen in this frame"
    side = "right" if value > 0.0 else "left"
    again = "without --flip" if contact.lying.flip else "with --flip horizontal"
    return (
        f"the cylinder drags the surface to the {side} of the picture; if it slides the other way "
        f"on the bench, a mirror was between: run init again {again}"
    )


def _surface(contact: ContactFit) -> str:
    """Where the surface is in the picture."""
    camera = contact.fit.scene.camera
    assert camera is not None and camera.top_mm is not None and camera.pixel_mm is not None
    row = -camera.top_mm / camera.pixel_mm
    seen = f"is row {row:.1f}" if row >= 0.0 else f"is {-row:.1f} rows above the picture"
    return f"of the first row's outer edge, below the surface, which {seen}"
