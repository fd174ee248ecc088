"""A sliding contact in a captured frame: searched for, fitted, and held against its rivals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from isochrome.drafting.known_values import KnownValues
from isochrome.errors import InputError, PhysicsError
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
from isochrome.frames import Frame
from isochrome.scene import Scene, check_moduli, check_pixel, load_scene

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
    """The scene of a contact before anything is found. Raises InputError for a wrong value."""
    tables: dict[str, Any] = {
        "specimen": {
            "young_gpa": given.young_gpa,
            "poisson": given.poisson,
            "thickness_mm": given.thickness_mm,
            "fringe_value_n_per_mm": given.fringe_value_n_per_mm,
        },
        "indenter": {
            "radius_mm": given.radius_mm,
            "young_gpa": given.indenter_young_gpa,
            "poisson": given.indenter_poisson,
        },
        "load": {"normal_n": given.load_n},
        "friction": {"coefficient": _FRICTION_TO_BEGIN},
        "polariscope": {"field": given.field or "dark"},
        "camera": {"pixel_mm": pixel_mm, "left_mm": 0.0, "top_mm": 0.0},
        "frames": {"gamma": 1.0 if given.gamma is None else given.gamma},
    }
    if given.wavelength_nm is not None:
        tables["polariscope"]["wavelength_nm"] = given.wavelength_nm
    scene = load_scene(tables)
    check_moduli(scene)
    check_pixel(scene, shape)
    return scene


def find_contact(
    frame: Frame, scene: Scene, given: KnownValues, *, bit_depth: int | None
) -> ContactFit:
    """Find a contact in a frame.

    Parameters: `frame`, as captured; `scene`, see `start_scene`; `given`; `bit_depth`. Returns a
    ContactFit. Raises InputError on a blank frame, PhysicsError where no contact explains it, or
    two do.
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
    best, first = _best_start(starts, _keys(given), frame)
    _refuse_far_load(first, given, frame)
    freed = fit_with_causes(best.data, first.scene, _keys(given), cold=False, slips=False)
    fit = freed.fit
    _refuse_wrong(fit, starts, best, given, frame)
    rivals = rival_causes(freed)
    messages = cause_messages(freed, rivals=rivals, light=light_matters(freed))
    poor = fit.chi > POOR_CHI
    if poor:
        messages += (
            f"chi = {fit.chi:.2f}: the frame holds more than this scene and noise, so that load "
            "and friction may be off by far more than their ±; measure the indenter's radius, the "
            "fringe value and the pixel, then run isochrome check",
        )
    unsure = {
        key: rivals[cause.name]
        for cause in freed.causes
        for key in cause.keys
        if cause.name in rivals
    }
    return ContactFit(frame.index, best.lying, freed.data, fit, messages, unsure)


def _keys(given: KnownValues) -> tuple[str, ...]:
    """The unknowns of the fit."""
    return FOUND if given.gamma is not None else (*FOUND, GAMMA)


def _best_start(
    starts: tuple[PictureStart, ...], keys: tuple[str, ...], frame: Frame
) -> tuple[PictureStart, FrameFit]:
    """The start that leads to the least residual, and its fit.

    Raises PhysicsError where none leads to fringes, or two leave the same.
    """
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
                f"{frame.name}: two scenes explain frame {frame.index} alike, "
                f"{_in_words(fit, start)} and {_in_words(other, second)}; give --load-n more "
                "closely, --rotate-deg or --field, or a --frame with more fringes"
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
        f"{frame.name}: no contact explains frame {frame.index} ({best}); check --radius-mm, "
        "--thickness-mm, --fringe-value-n-per-mm, --young-gpa and --pixel-mm, give --load-n within "
        "a factor of three, or another --frame, which shows the middle of the contact"
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


def _refuse_wrong(
    fit: FrameFit,
    starts: tuple[PictureStart, ...],
    best: PictureStart,
    given: KnownValues,
    frame: Frame,
) -> None:
    """Refuse a fit that a contact's fringes do not explain. Raises PhysicsError."""
    others = [s.chi for s in starts if s is not best and s.lying[:3] != best.lying[:3]]
    rival = min(others, default=float("inf"))
    clear = fit.chi <= _CLEAR and rival > _CLEAR * fit.chi
    if not fit.positive or _is_no_bench(fit) or (fit.chi > POOR_CHI and not clear):
        raise _unexplained(frame, fit.chi if fit.positive else None)
    _refuse_far_load(fit, given, frame)


def _refuse_far_load(fit: FrameFit, given: KnownValues, frame: Frame) -> None:
    """Refuse a fit whose load is another than the stated one. Raises PhysicsError."""
    load = float(fit.scene.get(LOAD))
    assert given.load_n is not None
    if not 1.0 / _FARTHEST < load / given.load_n < _FARTHEST:
        raise PhysicsError(
            f"{frame.name}: the fringes of frame {frame.index} are those of {load:.3g} N, and "
            f"--load-n is {given.load_n:g}; give the load within a factor of three"
        )
