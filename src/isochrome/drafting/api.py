"""`init`: a commented scene from captured frames and what is known besides.

Of a contact the first frame that it explains is fitted, of a disc, whose rim gives place and scale
roughly, the first of all; of a specimen without a model nothing is found.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome import estimation, figures, fitting
from isochrome.drafting import scene_draft
from isochrome.drafting.fields import QUANTITIES
from isochrome.drafting.scene_draft import SceneDraft
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import POOR_CHI, FrameData, light_basis, prepare_frame, total_degree
from isochrome.frames import Frame, FrameReader, as_turned, open_frames
from isochrome.messages import message
from isochrome.output import named_frames, staged, write_figure, write_text
from isochrome.processing import placed_disc
from isochrome.runs import single_threaded
from isochrome.scene import FramesLike, Scene, check_moduli, check_pixel, load_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

Floats = NDArray[np.floating]


def draft_figure(data: FrameData, scene: Scene, values: Sequence[scene_draft.DraftValue]) -> Figure:
    """Draw a frame, as a scene of one state takes it, beside the scene's fringes."""
    model_frame = fitting.evaluate_model(data, scene)
    light = model_frame.background + model_frame.illumination * np.nan_to_num(model_frame.signal(1))
    stored = np.maximum(light, 0.0) ** (1.0 / scene.frames.stated_gamma)
    model = np.where(model_frame.picture.material, stored, np.nan)

    def drawn(axes: Axes, _: int, *, image: Floats) -> AxesImage:
        shown = _in_grey(axes, image, like=data.raw, **model_frame.pixels.scale)
        # the surface and the middle of what presses on it, no farther than the picture
        ends = axes.get_xlim(), axes.get_ylim()
        axes.axhline(0.0, ls="-", color=figures.OVERLAY_COLOUR, lw=figures.LINE_PT)
        axes.axvline(0.0, ls=":", color=figures.OVERLAY_COLOUR, lw=figures.LINE_PT)
        axes.set(xlim=ends[0], ylim=ends[1])
        return shown

    images = {"the frame": data.raw, "the scene that was found": model}
    kinds = [
        figures.PictureKind(name=k, draw=partial(drawn, image=one)) for k, one in images.items()
    ]
    # without the place, which the axes show
    texts = [
        f"{value.key} = {value.words}"
        for value in values
        if value.origin == "found" and value.key not in ("camera.left_mm", "camera.top_mm")
    ]
    lines = "Line: surface, or top (z = 0); dotted: middle (x = 0)"
    panels = figures.PaperPanels(kinds=kinds, labels=[""])
    return figures.panels_figure(panels, f"{'    '.join(texts)}\n{lines}")


def _in_grey(axes: Axes, image: Floats, *, like: Floats, **place: Any) -> AxesImage:
    """Draw an image with the greys of a frame: all but its outermost are told apart."""
    low, high = (float(v) for v in np.nanpercentile(like, [0.5, 99.5]))
    return figures.show_image(axes, image, cmap=figures.FRAME_MAP, vmin=low, vmax=high, **place)


_FAR, _FEW = 5.0, 0.002
"""Standard deviations, and the share of pixels that may lie beyond them: unloaded frames leave
0.0006 at the most, a contact of a fifth of a fringe 0.0004, of a third 0.008, of a half 0.03."""

_RIM = 0.03
"""Share of the rows and columns at each edge that may lie in a holder's shadow."""


def has_no_fringes(data: FrameData) -> bool:
    """Whether a frame is smooth light; one with texture, dust or an edge is never taken for one."""
    rows, cols = (math.ceil(_RIM * n) for n in data.shape)
    inner = np.zeros(data.shape, dtype=bool)
    inner[rows:-rows, cols:-cols] = data.valid[rows:-rows, cols:-cols]
    weight = 1.0 / data.sigma[inner]
    basis = weight * light_basis(data.shape, total_degree(estimation.FIRST_DEGREES[1]))[:, inner]
    light = weight * data.light[inner]
    error = light - np.linalg.lstsq(basis.T, light, rcond=None)[0] @ basis
    return bool(np.mean(np.abs(error) > _FAR) < _FEW)


LOAD, LEFT, TOP = "load.normal_n", "camera.left_mm", "camera.top_mm"
FIELD, PIXEL = "polariscope.field", "camera.pixel_mm"

FOUND = (LOAD, fitting.FRICTION, LEFT, TOP)

_MOST_RIVALS = 4
"""Minima of the search that are fitted, for it knows gamma only roughly."""

CLEAR_CHI = 3.0
"""chi up to which a scene that leaves more than noise is still written, with a warning, where every
other turn and field is as many times worse. A radius or fringe value 10 % off leaves 2.8."""

_FARTHEST = 4.0
"""Factor from the stated load beyond which a fit has found something else."""

_MOST_FRICTION, _GAMMAS = 1.5, (0.3, 4.0)
"""Friction and gammas of benches. Beyond them a fit makes up for a contact that it has not found,
and enough light would make it look right."""


def start_scene(given: scene_draft.KnownValues, **tables: dict[str, Any]) -> Scene:
    """The scene of a specimen before anything is found, with more `tables`."""
    for name in scene_draft.NEEDED[given.shape]:
        table, _, entry = QUANTITIES[name].key.partition(".")
        tables.setdefault(table, {})[entry] = getattr(given, name)
    light = {"field": given.field or "dark", "wavelength_nm": given.wavelength_nm}
    tables["polariscope"] = {key: value for key, value in light.items() if value is not None}
    tables["frames"] = {"gamma": 1.0 if given.gamma is None else given.gamma}
    return load_scene(tables)


def find_contact(
    frame: Frame, scene: Scene, given: scene_draft.KnownValues, *, bit_depth: int | None
) -> tuple[fitting.Lying, fitting.Freed[Any]]:
    """How a frame as captured lies, and its fit; PhysicsError: no contact explains it, or two."""
    data = prepare_frame(frame, scene, bit_depth=bit_depth)
    stated = {"turns": given.rotate_deg, "fields": given.field, "gammas": given.gamma}
    choices: dict[str, Any] = {name: (v,) for name, v in stated.items() if v is not None}
    starts = fitting.search_picture(data, scene, flip=given.flip, **choices)
    keys = FOUND if given.gamma is not None else (*FOUND, fitting.GAMMA)
    first, best = _clear_best(_ranked(starts[:_MOST_RIVALS], keys, cold=False), frame)
    answer = fitting.fit_with_causes(best.data, first.scene, keys, cold=False, slips=False)
    fit = answer.fit
    other_ways = [s.chi for s in starts if s is not best and s.lying[:3] != best.lying[:3]]
    rivals = min(other_ways, default=float("inf"))
    clear = fit.chi <= CLEAR_CHI and rivals > CLEAR_CHI * fit.chi
    load, load_n = float(fit.scene.get(LOAD)), given.load_n
    assert load_n is not None
    far = not 1.0 / _FARTHEST < load / load_n < _FARTHEST
    # what explains a frame poorly, or but a part of it, tells no load but the given one
    poor = (fit.chi > POOR_CHI or answer.odd is not None) and (far or not clear)
    if not fit.positive or _is_no_bench(fit) or poor:
        raise _unexplained(frame, fit.chi if fit.positive else None)
    if far:
        raise PhysicsError(
            "fringes_frame_those_load", name=frame.name, index=frame.index, load=load, load_n=load_n
        )
    return best.lying, answer


def _ranked(
    starts: Iterable[fitting.PictureStart], keys: tuple[str, ...], *, cold: bool
) -> list[tuple[fitting.FrameFit, fitting.PictureStart]]:
    """The fits that starts lead to, by rising chi, without those that no bench has."""
    fits: list[tuple[fitting.FrameFit, fitting.PictureStart]] = []
    for start in starts:
        try:
            fit = fitting.fit_frame(start.data, start.scene, keys, cold=cold)
        except (InputError, PhysicsError):
            continue  # it has left the picture, or its contact cannot be solved
        if fit.positive and not _is_no_bench(fit):
            fits.append((fit, start))
    return sorted(fits, key=lambda pair: pair[0].chi)


def _is_lost(fit: fitting.FrameFit, start: fitting.PictureStart) -> bool:
    """Whether a fit is so far off that its values say nothing, as `process` has it."""
    sigma = start.data.toned(fit.scene.get(fitting.GAMMA)).sigma
    noise = fitting.evaluate_model(start.data, fit.scene).contrast_noise(sigma)
    return fit.chi * noise > fitting.TOO_FAR


def _clear_best(
    fits: list[tuple[fitting.FrameFit, fitting.PictureStart]], frame: Frame
) -> tuple[fitting.FrameFit, fitting.PictureStart]:
    """The best fit of a contact; refused where it says nothing, or another leaves as little."""
    if not fits or _is_lost(*fits[0]):
        raise _unexplained(frame, fits[0][0].chi if fits else None)
    two = [
        (fit.scene.get(LOAD), fit.scene.get(fitting.FRICTION), *s.lying[:3]) for fit, s in fits[:2]
    ]
    if len(two) > 1 and fits[1][0].chi < estimation.ALIKE_CHI * fits[0][0].chi:
        (load, friction, *lying), (load_2, friction_2, *lying_2) = two
        near = abs(load_2 / load - 1.0) < 0.01 and abs(friction_2 - friction) < 0.01
        if not near or lying != lying_2:
            words, words_2 = (
                f"{load:.3g} N with friction {mu:.2f} (turned by {turn} degrees, {field} field)"
                for load, mu, turn, _, field in two
            )
            raise PhysicsError(
                "two_scenes_explain_frame_alike",
                name=frame.name, index=frame.index, in_words=words, in_words_2=words_2,
            )  # fmt: skip
    return fits[0]


def _is_no_bench(fit: fitting.FrameFit) -> bool:
    """Whether a fit has run to a friction or a gamma that no bench has."""
    least, most = _GAMMAS
    gamma = fitting.GAMMA in fit.keys and not least < fit.scene.get(fitting.GAMMA) < most
    return bool(gamma or abs(fit.scene.friction_at(0.0)) > _MOST_FRICTION)


def _unexplained(frame: Frame, chi: float | None) -> PhysicsError:
    """What is said where no contact explains a frame."""
    best = "none leads to fringes" if chi is None else f"the best leaves {chi:.1f} times its noise"
    return PhysicsError("no_contact_explains_frame", name=frame.name, index=frame.index, best=best)


_HAS_SIDE = 4.0
"""Standard uncertainties beyond which friction has a side."""


def draft_contact(frames: FrameReader, given: scene_draft.KnownValues) -> SceneDraft:
    """Draft a contact's scene by the first frame that it explains, or raise the first refusal."""
    pixel_mm = given.pixel_mm or frames.pixel_mm
    assert pixel_mm is not None
    camera = {"pixel_mm": pixel_mm, "left_mm": 0.0, "top_mm": 0.0}
    scene = start_scene(given, friction={"coefficient": 0.0}, camera=camera)
    check_moduli(scene)
    check_pixel(scene, frames.shape)
    refused, bare = None, list[Frame]()
    for index in scene_draft.frames_to_look_at(frames, given):
        frame = scene_draft.frame_of(frames, index, given)
        try:
            lying, answer = find_contact(frame, scene, given, bit_depth=frames.bit_depth)
            break
        except PhysicsError as error:
            if has_no_fringes(prepare_frame(frame, scene, bit_depth=frames.bit_depth)):
                bare.append(frame)
            else:
                refused = refused or error
    else:
        if refused is None:
            frames_named = named_frames([one.index for one in bare])
            refused = PhysicsError(
                "no_fringes_whose_light", name=bare[0].name, named_frames=frames_named
            )
        raise refused
    fit, messages = answer.fit, fitting.cause_messages(answer, light=fitting.light_matters(answer))
    if answer.fit.chi > POOR_CHI:
        messages += (message("chi_frame_holds_more", chi=fit.chi),)
    values = _found_values(lying, answer, given)
    sentences = [
        f"Frame {index} was looked at: the contact's fringes leave {fit.chi:.2f} times its noise.",
        "What follows ± is the standard uncertainty by the frame's noise alone: what was given is "
        "taken as exact. Where that is measured, { value = ..., standard_uncertainty = ... } says "
        "how well.",
    ]
    draw = partial(draft_figure, answer.data, fit.scene, values)
    return scene_draft.written_draft(
        frames, given, index, sentences, values, draw, warnings=messages, chi=fit.chi
    )


def _found_values(
    lying: fitting.Lying, answer: fitting.Freed[Any], given: scene_draft.KnownValues
) -> list[scene_draft.DraftValue]:
    """What the frame tells, with the keys that it cannot tell from other causes."""
    fit, rivals = answer.fit, fitting.rival_causes(answer)
    number = fit.keys.index(fitting.FRICTION)
    friction, spread = float(fit.values[number]), float(fit.standard_uncertainty[number])
    has_side = abs(friction) > _HAS_SIDE * spread
    side = "right" if friction > 0.0 else "left"
    again = "without --flip" if lying.flip else "with --flip horizontal"
    dragged = (
        f"the cylinder drags the surface to the {side} of the picture; if it slides the other way "
        f"on the bench, a mirror was between: run init again {again}"
    )
    camera = fit.scene.camera
    assert camera is not None and camera.top_mm is not None and camera.pixel_mm is not None
    row = -camera.top_mm / camera.pixel_mm
    place = f"is row {row:.1f}" if row >= 0.0 else f"is {-row:.1f} rows above the picture"
    notes = {
        LOAD: f"about {given.load_n:g} was given",
        fitting.FRICTION: dragged if has_side else "no friction is seen in this frame",
        LEFT: "of the first column's outer edge, from the middle of the contact",
        TOP: f"of the first row's outer edge, below the surface, which {place}",
    }
    for cause in answer.causes:
        if cause.name in rivals:
            others = " or ".join(rivals[cause.name])
            note = f"the frame asks for it, or for {others}, and cannot tell which"
            notes |= dict.fromkeys(cause.keys, note)
    values = fitted_values(fit, notes, given, lying)
    if has_side:
        return values
    # a friction that is not seen would state a side
    return [replace(one, value=0.0) if one.key == fitting.FRICTION else one for one in values]


def fitted_values(
    fit: fitting.FrameFit,
    notes: Mapping[str, str],
    given: scene_draft.KnownValues,
    lying: fitting.Lying,
) -> list[scene_draft.DraftValue]:
    """What a fit tells, and how the picture lies; a key without a note the frame asks for."""
    spread = dict(zip(fit.keys, fit.standard_uncertainty.tolist(), strict=True))
    notes = {fitting.GAMMA: "the camera stores light^(1/gamma)"} | dict(notes)
    values = [
        scene_draft.DraftValue(key, float(fit.scene.get(key)), "found", spread[key],
                   notes.get(key, "the frame asks for it"))
        for key in dict.fromkeys((*FOUND, fitting.GAMMA, *fit.keys))
        if key in spread
    ]  # fmt: skip
    values += [scene_draft.DraftValue(FIELD, lying.field, "found")] * (given.field is None)
    if given.rotate_deg is None and lying.rotate_deg:
        note = "quarter turns, counter-clockwise, after which the load comes from above"
        values += [scene_draft.DraftValue(scene_draft.TURN, lying.rotate_deg, "found", note=note)]
    return values


_NOTES = {
    LOAD: "by the fringes",
    LEFT: "of the first column's outer edge, from the disc's middle",
    TOP: "of the first row's outer edge, below the disc's top",
    PIXEL: "",
}

_STANDARD = {
    FIELD: 'polariscope\'s field, "dark" or "bright"; taken as "dark" until then',
    fitting.GAMMA: (
        "camera's exponent, 1 for most cameras, 2.2 for photographs; taken as 1 until then"
    ),
    scene_draft.TURN: (
        "quarter turns, 90, 180 or 270, by which the pictures are turned; none until then"
    ),
}
"""Keys that have a value of their own where a scene does not give them."""


def draft_disc(frames: FrameReader, given: scene_draft.KnownValues) -> SceneDraft:
    """Draft the scene of a disc; PhysicsError where no turn and field explains it, or two."""
    frame = scene_draft.frame_of(frames, scene_draft.frames_to_look_at(frames, given)[0], given)
    camera = {} if given.pixel_mm is None else {"pixel_mm": given.pixel_mm}
    bare = start_scene(given, specimen={"shape": "disc"}, camera=camera)
    data = prepare_frame(frame, bare, bit_depth=frames.bit_depth)
    # half a turn changes nothing
    turns = (0, 90) if given.rotate_deg is None else (given.rotate_deg,)
    starts = []
    for turn, field in product(turns, (given.field,) if given.field else ("dark", "bright")):
        turned = data.lying(partial(as_turned, rotate_deg=turn, flip=given.flip))
        scene, _ = placed_disc(bare.with_values({FIELD: field, scene_draft.TURN: turn}), turned)
        lying = fitting.Lying(turn, given.flip, field, scene.frames.stated_gamma)
        starts.append(fitting.PictureStart(lying, scene, turned, math.nan))
    stated = {fitting.GAMMA: given.gamma, PIXEL: given.pixel_mm}
    keys = (*fitting.free_keys(scene), *(key for key, value in stated.items() if value is None))
    fits = _ranked(starts, keys, cold=True)
    if not fits or _is_lost(*fits[0]):
        raise PhysicsError("disc_fringes_not_frame", name=data.name)
    if len(fits) > 1 and fits[1][0].chi < estimation.RIVAL_CHI * fits[0][0].chi:
        ways = " and ".join(
            f"turned by {start.lying.rotate_deg} in the {start.lying.field} field"
            for _, start in fits[:2]
        )
        raise PhysicsError("two_scenes_explain_frame", name=data.name, ways=ways)
    fit, best = fits[0]
    values = fitted_values(fit, _NOTES, given, best.lying)
    sentences = [
        f"Frame {frame.index} was looked at: the disc's fringes leave {fit.chi:.2f} times its noise"
        "."
    ]
    warnings = [] if fit.chi <= POOR_CHI else [message("chi_disc_fringes_leave", chi=fit.chi)]
    draw = partial(draft_figure, best.data, fit.scene, values)
    return scene_draft.written_draft(
        frames, given, frame.index, sentences, values, draw, warnings=warnings, chi=fit.chi
    )


def draft_without_model(frames: FrameReader, given: scene_draft.KnownValues) -> SceneDraft:
    """Draft a scene without a model, whose frames are read from the image alone."""
    frame = scene_draft.frame_of(frames, scene_draft.frames_to_look_at(frames, given)[0], given)
    quantities = (QUANTITIES[k] for k in (*scene_draft.NEEDED_BESIDE, "pixel_mm"))
    hints = {quantity.key: quantity.question for quantity in quantities} | _STANDARD
    open_keys = [scene_draft.OpenKey(key, hint) for key, hint in hints.items()]
    image = as_turned(frame.image, given.rotate_deg or 0, given.flip)
    kind = figures.PictureKind(name="", draw=lambda axes, _: _in_grey(axes, image, like=image))
    panels = figures.PaperPanels(kinds=[kind], labels=["the frame"])
    draw, sentences = partial(figures.panels_figure, panels, ""), [message("specimen_has_no_model")]
    return scene_draft.written_draft(
        frames, given, frame.index, sentences, (), draw, open_keys=open_keys
    )


PREVIEW_FILE = "scene.png"


def draft_scene(
    frames: FramesLike, given: scene_draft.KnownValues, leave_out: Sequence[str | Path]
) -> SceneDraft:
    """Draft a scene from frames as captured and what is known besides; nothing is written.
    InputError names the option without which nothing can be found; PhysicsError: no fringes."""
    drafts = {"contact": draft_contact, "disc": draft_disc, "other": draft_without_model}
    taken = {name: getattr(given, name) for name in ("channel", "wavelength_nm", "bit_depth")}
    with open_frames(frames, **taken, leave_out=leave_out) as reader, single_threaded():
        scene_draft.refuse_unclear(reader, given)
        return drafts[given.shape](reader, given)


def init(
    frames: FramesLike,
    known: scene_draft.KnownValues | Mapping[str, Any],
    out: str | Path | None = None,
    *,
    replace: bool = False,
) -> SceneDraft:
    """Write a commented scene from captured frames and what is known of the bench.

    Of a sliding contact the load, friction and its side, the place of surface and contact, the
    polariscope's field, the camera's gamma and how the picture lies are found in one frame; its
    size, bits and scale are the file's. A disc's place and scale are its rim's. What nobody knows
    is a line to fill in.

    Parameters
    ----------
    frames : str, Path, sequence of them, array or sequence of arrays
        The frames, as for `open_frames`. Files of a folder that its scene.toml names besides, or
        whose names say that they are no-load frames, are none of them.
    known : KnownValues or mapping
        What is known, by the names of the fields of `isochrome.drafting.KnownValues`; of a contact
        young_gpa, poisson, thickness_mm, fringe_value_n_per_mm, radius_mm, indenter_young_gpa,
        indenter_poisson, and load_n within a factor of three.
    out : str or Path, optional
        Folder for scene.toml and scene.png, a preview of what was found.
    replace : bool, default False
        Whether a scene.toml that is there is replaced.

    Returns
    -------
    SceneDraft
        The scene, its text, its values with where they come from, what is open, and warnings.

    Raises
    ------
    InputError
        Where the frames cannot be read, something must be known besides, or a scene is there.
    PhysicsError
        Where no contact or disc explains any frame that was looked at, or two do.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("line-contact-wear").with_values({
    ...     "wear.distances_m": [0.0], "friction.static_state_first": False, "camera.width_px": 164,
    ...     "camera.height_px": 123, "camera.pixel_mm": 0.0243, "camera.noise_grey": 1.0})
    >>> simulated = isochrome.simulate(scene, "simulated")
    >>> known = {
    ...     "young_gpa": 2.1, "poisson": 0.4, "thickness_mm": 4.0, "fringe_value_n_per_mm": 14.6,
    ...     "radius_mm": 24.61, "indenter_young_gpa": 210.0, "indenter_poisson": 0.3,
    ...     "load_n": 60.0}
    >>> found = isochrome.init("simulated/frames.tif", known, "bench")
    >>> round(found.scene.load.normal_n, 1), found.scene.polariscope.field
    (44.0, 'dark')
    """
    given = scene_draft.known_values(known)
    _refuse_existing(out, replace)
    draft = draft_scene(frames, given, scene_draft.not_among_frames(frames))
    if out is not None:
        _refuse_existing(out, replace)  # somebody may have written one meanwhile
        with staged(out) as folder:
            write_text(folder / scene_draft.SCENE_FILE, draft.text)
            write_figure(folder / PREVIEW_FILE, draft.figure())
    return draft


def _refuse_existing(out: str | Path | None, replace: bool) -> None:
    """Refuse to write over a scene that is not to be replaced."""
    path = Path(out or "") / scene_draft.SCENE_FILE
    if out is not None and not replace and os.path.lexists(path):
        raise InputError("there_already_name_another", path=path)
