"""The scene of a contact: the first frame that it explains, and each value with what it is from.

A frame that is refused may simply not be loaded. A smooth polynomial is fitted to its light,
robustly; where next to no pixel lies farther from it than noise does, there is no fringe. A frame
with texture, dust or an edge in it is never taken for one: then nothing is said of it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.drafting.draft_figure import draft_figure
from isochrome.drafting.scene_draft import (
    DraftValue,
    KnownValues,
    Origin,
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
from isochrome.errors import InputError, IsochromeError, PhysicsError
from isochrome.estimation import ALIKE_CHI, POOR_CHI, FrameData, prepare_frame
from isochrome.fitting import (
    FRICTION,
    GAMMA,
    FrameFit,
    Lying,
    PictureStart,
    cause_messages,
    fit_frame,
    fit_with_causes,
    light_matters,
    rival_causes,
    search_picture,
)
from isochrome.frames import Frame, FrameReader
from isochrome.messages import message
from isochrome.output import named_frames
from isochrome.scene import Scene, check_moduli, check_pixel, load_scene

Array = NDArray[Any]

_DEGREE = 4
"""Of the polynomial: a lamp's, and no fringe's."""

_FAR, _FEW = 5.0, 0.002
"""Standard deviations, and the share of pixels that may lie beyond them. Unloaded frames of the
sample's bench leave 0.0006 at the most, a contact of a fifth of a fringe 0.0004, one of a third
0.008, and one of half a fringe 0.03."""

_RIM, _DIM = 0.06, 0.6
"""Share of the rows or columns at an edge that may be a holder's shadow, and how dim it is."""

_MOST_PIXELS, _ROUNDS = 60_000, 4


def has_no_fringes(data: FrameData) -> bool:
    """Tell whether smooth light alone explains a prepared frame."""
    light = np.asarray(data.light, dtype=float)
    rows, cols = (_within(np.median(light, axis=axis), np.median(light)) for axis in (1, 0))
    step = max(1, round((light.size / _MOST_PIXELS) ** 0.5))
    inner = tuple(slice(part.start, part.stop, step) for part in (rows, cols))
    light, sigma, valid = light[inner], np.asarray(data.sigma[inner], float), data.valid[inner]
    if valid.sum() < 10 * (_DEGREE + 1) ** 2:
        return False
    far = np.abs(_smooth_residual(light, sigma, valid)[valid]) / sigma[valid]
    return bool(np.mean(far > _FAR) < _FEW)


def _within(level: Array, usual: float) -> slice:
    """The lines of a frame without those of a dark rim, by each line's `level`."""
    count, most = len(level), max(1, int(_RIM * len(level)))
    bright = level >= _DIM * usual
    first = int(bright[:most].argmax()) if bright[:most].any() else most
    last = int(bright[::-1][:most].argmax()) if bright[::-1][:most].any() else most
    # the line beside a rim is blurred
    return slice(first + (first > 0), count - last - (last > 0))


def _smooth_residual(light: Array, sigma: Array, valid: NDArray[np.bool_]) -> Array:
    """What a polynomial leaves of the light (rows, cols), pixels that lie far off counting less."""
    y, x = (np.linspace(-1.0, 1.0, n) for n in light.shape)
    powers = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
    basis = np.stack([np.outer(y**i, x**j)[valid] for i, j in powers], axis=1)
    weight = 1.0 / sigma[valid]
    trust, error = np.ones(len(weight)), light[valid]
    for _ in range(_ROUNDS):
        use = weight * trust
        solution = np.linalg.lstsq(basis * use[:, None], light[valid] * use, rcond=None)[0]
        error = light[valid] - basis @ solution
        size = np.abs(error) * weight
        usual = 3.0 * max(float(np.median(size)) / 0.6745, 1e-9)
        trust = np.sqrt(np.minimum(1.0, usual / np.maximum(size, 1e-9)))
    residual = np.zeros(light.shape)
    residual[valid] = error
    return residual


LOAD, LEFT, TOP = "load.normal_n", "camera.left_mm", "camera.top_mm"

FOUND = (LOAD, FRICTION, LEFT, TOP)

_RIVAL, _MOST_RIVALS = 2.5, 4
"""Ratio of the search's chi within which its minima are fitted, for it knows gamma only roughly."""

_CLEAR = 3.0
"""chi up to which a scene that leaves more than noise is still written, with a warning, where every
other turn and field is as many times worse. A radius or fringe value 10 % off leaves 2.8."""

_HOPELESS, _ASTRAY = 5.0, 12.0
"""chi of a fit beyond which no cause that a frame may ask for is looked for, and of the search
beyond which nothing is fitted. The search, which knows gamma roughly, left at most 4 where it was
right (60 drawn contacts)."""

_FARTHEST = 4.0
"""Factor from the stated load beyond which a fit has found something else."""

_MOST_FRICTION, _GAMMAS = 1.5, (0.3, 4.0)
"""Friction and gammas of benches. Beyond them a fit makes up for a contact that it has not found,
and enough light would make it look right."""

_FRICTION_TO_BEGIN = 0.2


@dataclass(frozen=True)
class ContactFit:
    """A contact that was found in a frame.

    `lying`, how the picture is taken; `data`, the frame so; `fit`, with what the frame asked for;
    `messages`, what is to be said of it; `unsure`, causes that the frame cannot tell from that of a
    key which it asked for.
    """

    frame: int
    lying: Lying
    data: FrameData
    fit: FrameFit
    messages: tuple[str, ...]
    unsure: Mapping[str, tuple[str, ...]]


def start_scene(pixel_mm: float, shape: tuple[int, int], given: KnownValues) -> Scene:
    """The scene of a contact before anything is found."""
    tables: dict[str, Any] = {
        "specimen": {
            name: getattr(given, name)
            for name in ("young_gpa", "poisson", "thickness_mm", "fringe_value_n_per_mm")
        },
        "indenter": {
            "radius_mm": given.radius_mm,
            "young_gpa": given.indenter_young_gpa,
            "poisson": given.indenter_poisson,
        },
        "load": {"normal_n": given.load_n},
        "friction": {"coefficient": _FRICTION_TO_BEGIN},
        "camera": {"pixel_mm": pixel_mm, "left_mm": 0.0, "top_mm": 0.0},
    }
    scene = load_scene(tables | light_tables(given))
    check_moduli(scene)
    check_pixel(scene, shape)
    return scene


def find_contact(
    frame: Frame, scene: Scene, given: KnownValues, *, bit_depth: int | None
) -> ContactFit:
    """Find a contact in a frame as captured, from its `start_scene`.

    InputError on a blank frame, PhysicsError where no contact explains it, or two do.
    """
    data = prepare_frame(frame, scene, bit_depth=bit_depth)
    choices: dict[str, Any] = {"flip": given.flip}
    if given.rotate_deg is not None:
        choices["turns"] = (given.rotate_deg,)
    if given.field is not None:
        choices["fields"] = (given.field,)
    if given.gamma is not None:
        choices["gammas"] = (given.gamma,)
    starts = search_picture(data, scene, **choices)
    keys = FOUND if given.gamma is not None else (*FOUND, GAMMA)
    best, first = _best_start(starts, keys, frame)
    _refuse_far_load(first, given, frame)
    answer = fit_with_causes(best.data, first.scene, keys, cold=False, slips=False)
    fit = answer.fit
    others = [s.chi for s in starts if s is not best and s.lying[:3] != best.lying[:3]]
    clear = fit.chi <= _CLEAR and min(others, default=float("inf")) > _CLEAR * fit.chi
    if not fit.positive or _is_no_bench(fit) or (fit.chi > POOR_CHI and not clear):
        raise _unexplained(frame, fit.chi if fit.positive else None)
    _refuse_far_load(fit, given, frame)
    rivals = rival_causes(answer)
    messages = cause_messages(answer, rivals=rivals, light=light_matters(answer))
    poor = fit.chi > POOR_CHI
    if poor:
        messages += (message("chi_frame_holds_more", chi=fit.chi),)
    unsure = {
        key: rivals[cause.name]
        for cause in answer.causes
        for key in cause.keys
        if cause.name in rivals
    }
    return ContactFit(frame.index, best.lying, answer.data, fit, messages, unsure)


def _best_start(
    starts: tuple[PictureStart, ...], keys: tuple[str, ...], frame: Frame
) -> tuple[PictureStart, FrameFit]:
    """The start that leads to the least residual, and its fit; refused where two leave the same."""
    if starts[0].chi > _ASTRAY:
        raise _unexplained(frame, starts[0].chi)
    fits: list[tuple[FrameFit, PictureStart]] = []
    for start in [s for s in starts if s.chi <= _RIVAL * starts[0].chi][:_MOST_RIVALS]:
        try:
            fit = fit_frame(start.data, start.scene, keys, cold=False)
        except (InputError, PhysicsError):
            continue  # it has left the picture, or its contact cannot be solved
        if fit.positive and not _is_no_bench(fit):
            fits.append((fit, start))
    fits.sort(key=lambda pair: pair[0].chi)
    if not fits or fits[0][0].chi > _HOPELESS:
        raise _unexplained(frame, fits[0][0].chi if fits else None)
    for (fit, start), (other, second) in pairwise(fits[:2]):
        if other.chi < ALIKE_CHI * fit.chi and not _same(fit, start, other, second):
            raise PhysicsError(
                message(
                    "two_scenes_explain_frame_alike",
                    name=frame.name,
                    index=frame.index,
                    in_words=_in_words(fit, start),
                    in_words_2=_in_words(other, second),
                )
            )
    return fits[0][1], fits[0][0]


def _is_no_bench(fit: FrameFit) -> bool:
    """Whether a fit has run to a friction or a gamma that no bench has."""
    least, most = _GAMMAS
    gamma = GAMMA in fit.keys and not least < fit.scene.get(GAMMA) < most
    return bool(gamma or abs(fit.scene.get(FRICTION)) > _MOST_FRICTION)


def _unexplained(frame: Frame, chi: float | None) -> PhysicsError:
    """What is said where no contact explains a frame."""
    best = "none leads to fringes" if chi is None else f"the best leaves {chi:.1f} times its noise"
    return PhysicsError(
        message("no_contact_explains_frame", name=frame.name, index=frame.index, best=best)
    )


def _same(fit: FrameFit, start: PictureStart, other: FrameFit, second: PictureStart) -> bool:
    """Whether two starts have led to one scene."""
    alike = start.lying[:3] == second.lying[:3]
    loads, frictions = ([f.scene.get(key) for f in (fit, other)] for key in (LOAD, FRICTION))
    near = abs(loads[1] / loads[0] - 1.0) < 0.01 and abs(frictions[1] - frictions[0]) < 0.01
    return alike and near


def _in_words(fit: FrameFit, start: PictureStart) -> str:
    turn, _, field, _ = start.lying
    load, friction = fit.scene.get(LOAD), fit.scene.get(FRICTION)
    return f"{load:.3g} N with friction {friction:.2f} (turned by {turn} degrees, {field} field)"


def _refuse_far_load(fit: FrameFit, given: KnownValues, frame: Frame) -> None:
    """Refuse a fit whose load is another than the stated one."""
    load = float(fit.scene.get(LOAD))
    assert given.load_n is not None
    if not 1.0 / _FARTHEST < load / given.load_n < _FARTHEST:
        raise PhysicsError(
            message(
                "fringes_frame_those_load",
                name=frame.name,
                index=frame.index,
                load=load,
                load_n=given.load_n,
            )
        )


_HAS_SIDE = 4.0
"""Standard uncertainties beyond which friction has a side."""


def draft_contact(frames: FrameReader, given: KnownValues) -> SceneDraft:
    """Draft the scene of a contact; see `draft_scene`."""
    refuse_unclear(frames, given)
    pixel_mm = given.pixel_mm or frames.pixel_mm
    assert pixel_mm is not None
    scene = start_scene(pixel_mm, frames.shape, given)
    contact = _first_explained(frames, scene, given)
    turned = contact.lying.rotate_deg in (90, 270)
    values = [*given_values(given, _GIVEN), *file_values(frames, given, turned=turned)]
    origin: Origin = "file" if given.pixel_mm is None else "given"
    values.append(DraftValue(key="camera.pixel_mm", value=pixel_mm, origin=origin))
    values += [*_found_values(contact, given), *light_values(given)]
    sentences = [
        f"Frame {contact.frame} was looked at: the contact's fringes leave {contact.fit.chi:.2f} "
        "times its noise.",
        "What follows ± is the standard uncertainty by the frame's noise alone: what was given is "
        "taken as exact. Where that is measured, { value = ..., standard_uncertainty = ... } says "
        "how well.",
    ]
    return written_draft(
        frames,
        contact.frame,
        sentences,
        values,
        open_of_set(frames, given),
        warnings=contact.messages,
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
            message(
                "no_fringes_whose_light",
                name=first.name,
                named_frames=named_frames([one.index for one in bare]),
            )
        )
    raise refused


_GIVEN = (
    "young_gpa", "poisson", "thickness_mm", "fringe_value_n_per_mm", "radius_mm",
    "indenter_young_gpa", "indenter_poisson",
)  # fmt: skip
"""What the user knows of the bodies."""


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
    place = f"is row {row:.1f}" if row >= 0.0 else f"is {-row:.1f} rows above the picture"
    return f"of the first row's outer edge, below the surface, which {place}"
