"""Scenes without a contact: a disc, whose rim gives place and scale, and one without a model."""

from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import Any

from isochrome.drafting.draft_figure import draft_figure, frame_figure
from isochrome.drafting.scene_draft import (
    QUANTITIES,
    DraftValue,
    KnownValues,
    OpenKey,
    SceneDraft,
    file_values,
    frame_of,
    frames_to_look_at,
    given_values,
    light_tables,
    light_values,
    open_of_set,
    refuse_unclear,
    written_draft,
)
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import POOR_CHI, RIVAL_CHI, FrameData, prepare_frame
from isochrome.fitting import GAMMA, TOO_FAR, FrameFit, evaluate_model, fit_frame, free_keys
from isochrome.frames import FrameReader, as_turned
from isochrome.messages import message
from isochrome.processing import placed_disc
from isochrome.scene import Scene, load_scene

FIELD, TURN, PIXEL = "polariscope.field", "frames.rotate_deg", "camera.pixel_mm"

_DISC = ("diameter_mm", "thickness_mm", "fringe_value_n_per_mm")

_NOTES = {
    "load.normal_n": "by the fringes",
    "camera.left_mm": "of the first column's outer edge, from the disc's middle",
    "camera.top_mm": "of the first row's outer edge, below the disc's top",
    GAMMA: "the camera stores light^(1/gamma)",
}

_STANDARD = {
    FIELD: 'polariscope\'s field, "dark" or "bright"; taken as "dark" until then',
    GAMMA: "camera's exponent, 1 for most cameras, 2.2 for photographs; taken as 1 until then",
    TURN: "quarter turns, 90, 180 or 270, by which the pictures are turned; none until then",
}
"""Keys that have a value of their own where a scene does not give them."""


def draft_disc(frames: FrameReader, given: KnownValues) -> SceneDraft:
    """Draft the scene of a disc under diametral load; see `draft_scene`.

    Its rim gives place and scale roughly, and its fringes closely, with load, field, gamma, and
    whether it lies on its side.
    """
    refuse_unclear(frames, given)
    frame = frame_of(frames, frames_to_look_at(frames, given)[0], given)
    bare = _disc_scene(given)
    data, fit = _fitted(prepare_frame(frame, bare, bit_depth=frames.bit_depth), bare, given)
    turned = fit.scene.frames.rotate_deg in (90, 270)
    values = [DraftValue(key="specimen.shape", value="disc", origin="given")]
    values += [*given_values(given, _DISC), *file_values(frames, given, turned=turned)]
    values += [*_disc_values(fit, given), *light_values(given)]
    sentences = [
        f"Frame {frame.index} was looked at: the disc's fringes leave {fit.chi:.2f} times "
        "its noise."
    ]
    notes = [message("chi_disc_fringes_leave", chi=fit.chi)]
    return written_draft(
        frames,
        frame.index,
        sentences,
        values,
        open_of_set(frames, given),
        warnings=[] if fit.chi <= POOR_CHI else notes,
        chi=fit.chi,
        draw=partial(draft_figure, data, fit.scene, values),
    )


def draft_without_model(frames: FrameReader, given: KnownValues) -> SceneDraft:
    """Draft a scene without a model, whose frames are read from the image alone."""
    refuse_unclear(frames, given)
    frame = frame_of(frames, frames_to_look_at(frames, given)[0], given)
    values = [DraftValue(key="specimen.shape", value="other", origin="given")]
    values += given_values(given, ("thickness_mm", "fringe_value_n_per_mm"))
    values += file_values(frames, given, turned=given.rotate_deg in (90, 270))
    if given.pixel_mm is None and frames.pixel_mm is not None:
        values.append(DraftValue(key=PIXEL, value=frames.pixel_mm, origin="file"))
    values += [*_stated(given), *light_values(given)]
    open_keys = _open_of(values, ("thickness_mm", "fringe_value_n_per_mm", "pixel_mm"))
    order = "orders that are known, such as [{ row_px = 480, col_px = 20, order = 0.0 }]"
    open_keys += [*open_of_set(frames, given), OpenKey("frames.known_order", order)]
    sentences = [message("specimen_has_no_model")]
    picture = as_turned(frame.image, given.rotate_deg or 0, given.flip)
    draw = partial(frame_figure, picture)
    return written_draft(frames, frame.index, sentences, values, open_keys, draw=draw)


def _stated(given: KnownValues) -> list[DraftValue]:
    """What was given of scale, field, gamma and turn."""
    stated = {PIXEL: given.pixel_mm, FIELD: given.field, GAMMA: given.gamma, TURN: given.rotate_deg}
    return [DraftValue(key=k, value=v, origin="given") for k, v in stated.items() if v]


def _open_of(values: list[DraftValue], names: Sequence[str]) -> list[OpenKey]:
    """What is open of some quantities, and what has a value of its own until it is filled in."""
    present = {value.key for value in values}
    quantities = [QUANTITIES[name] for name in names]
    keys = [OpenKey(q.key, q.question) for q in quantities if q.key not in present]
    return keys + [OpenKey(key, hint) for key, hint in _STANDARD.items() if key not in present]


def _disc_scene(given: KnownValues) -> Scene:
    """The disc before it is placed."""
    tables: dict[str, Any] = {
        "specimen": {"shape": "disc"} | {name: getattr(given, name) for name in _DISC},
        "load": {"normal_n": given.load_n},
        "camera": {} if given.pixel_mm is None else {"pixel_mm": given.pixel_mm},
    }
    return load_scene(tables | light_tables(given))


def _fitted(data: FrameData, bare: Scene, given: KnownValues) -> tuple[FrameData, FrameFit]:
    """The disc's fit, and the frame as it lies, under the turn and field that explain it best.

    Half a turn changes nothing. Raises PhysicsError where the fringes of none are in the frame, or
    those of two.
    """
    turns = (0, 90) if given.rotate_deg is None else (given.rotate_deg,)
    fields = ("dark", "bright") if given.field is None else (given.field,)
    fits: list[tuple[FrameData, FrameFit]] = []
    for turn, field in product(turns, fields):
        turned = data.lying(partial(as_turned, rotate_deg=turn, flip=given.flip))
        scene, _ = placed_disc(bare.with_values({FIELD: field, TURN: turn}), turned)
        given_values = {GAMMA: given.gamma, PIXEL: given.pixel_mm}
        keys = (*free_keys(scene), *(key for key, value in given_values.items() if value is None))
        try:
            fit = fit_frame(turned, scene, keys)
            lost = _is_lost(turned, fit)
        except (InputError, PhysicsError):
            continue  # the fit has left the picture
        if not lost:
            fits.append((turned, fit))
    fits.sort(key=lambda pair: pair[1].chi)
    if not fits:
        raise PhysicsError(message("disc_fringes_not_frame", name=data.name))
    if len(fits) > 1 and fits[1][1].chi < RIVAL_CHI * fits[0][1].chi:
        ways = " and ".join(
            f"turned by {fit.scene.frames.rotate_deg} in the {fit.scene.polariscope.field} field"
            for _, fit in fits[:2]
        )
        raise PhysicsError(message("two_scenes_explain_frame", name=data.name, ways=ways))
    return fits[0]


def _is_lost(data: FrameData, fit: FrameFit) -> bool:
    """Whether a fit is so far off that its values say nothing, as `process` has it."""
    if not fit.positive:
        return True
    sigma = data.toned(fit.scene.get(GAMMA)).sigma
    return not fit.chi * evaluate_model(data, fit.scene).contrast_noise(sigma) <= TOO_FAR


def _disc_values(fit: FrameFit, given: KnownValues) -> list[DraftValue]:
    """Place, scale, load and gamma by the fringes; turn and field."""
    values = [
        DraftValue(
            key=key,
            value=float(fit.scene.get(key)),
            origin="found",
            standard_uncertainty=float(spread),
            note=_NOTES.get(key, ""),
        )
        for key, spread in zip(fit.keys, fit.standard_uncertainty, strict=True)
    ]
    if given.field is None:
        values.append(DraftValue(key=FIELD, value=fit.scene.polariscope.field, origin="found"))
    turn = fit.scene.frames.rotate_deg
    if given.rotate_deg is None and turn:
        values.append(DraftValue(key=TURN, value=turn, origin="found"))
    return values + _stated(given)
