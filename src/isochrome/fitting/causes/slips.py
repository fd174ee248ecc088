"""A frame that its scene does not explain: what small slip in the scene would make it do so.

Each slip is tried by a search. What explains the frame is named, and never applied: such a scene is
wrong.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import product
from math import sqrt
from typing import Any

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import FrameData, is_explained
from isochrome.fitting.frame.frame_fit import PHOTOGRAPHS, Fitted, placed
from isochrome.fitting.frame.unknowns import BLUR, GAMMA, LEFT, LENS, PIXEL, TOP, free_keys
from isochrome.fitting.frame_set import TOO_FAR
from isochrome.fitting.search import Settled, search_frame, settle_frame
from isochrome.frames import as_turned
from isochrome.messages import message
from isochrome.scene import STIFFEST_GPA, Scene

_LEAST = 2.0
"""Residual over noise up to which no slip is looked for: small causes are enough."""
_LEFT = 0.0625
"""Part of what chi² is too large by that a slip may leave, for its small causes."""
_ALIKE = 0.8
"""Ratio of chi below which a later trial is the better one: mirrored pictures often look alike."""
_ACROSS, _DOWN = 0.15, 0.25
"""Steps of the contact's places that are tried, in widths and heights of the picture."""


@dataclass(frozen=True)
class Slip:
    """What a slip is, the `line` that mends it, its `chi`, and that `before`, inf: no light."""

    what: str
    line: str
    chi: float
    before: float

    def sentence(self) -> str:
        """What is wrong with the scene, and what to write in it."""
        stands = "no light" if np.isinf(self.before) else f"chi = {self.before:.1f}"
        return message(
            "scene_explains_frame_chi", what=self.what, line=self.line, chi=self.chi, stands=stands
        )


_Candidate = tuple[str, str, FrameData, Scene]
"""What is tried: what it is, the line that mends it, a frame as it would lie, and a scene."""


def is_lost(fitted: Fitted) -> bool:
    """Whether a fit is so far off that its values say nothing. What it leaves is held against its
    light; beside more than noise also against the picture's own, as fringes vary by 1/sqrt(8) of
    theirs: a field of no fringe has any light.
    """
    fit, pixels = fitted.fit, fitted.model.pixels
    light = float(np.mean(fitted.final.gamma_fit.amplitude))
    if fit.chi > _LEAST:
        light = min(light, sqrt(8.0) * float(np.std(pixels.raw * pixels.weight)))
    return not fit.positive or fit.chi > TOO_FAR * light


def explaining_slip(
    data: FrameData, scene: Scene, keys: tuple[str, ...] | None, before: float, *, lost: bool = True
) -> Slip | None:
    """The slip in a scene that explains a frame far better, None: none does. `scene`, where the fit
    began, or ended where its values are not `lost`; `before`, its chi, inf where it gave no light.
    """
    if before <= _LEAST:
        return None  # noise alone: no scene explains it better
    scene = placed(scene, data.shape)
    keys = free_keys(scene) if keys is None else keys
    keys = tuple(k for k in keys if k not in (GAMMA, BLUR, *LENS))
    found = {LEFT, TOP} <= set(keys)
    if scene.indenter is not None:
        keys = tuple(dict.fromkeys((*keys, LEFT, TOP)))
    best: Slip | None = None
    limit = np.inf
    for what, line, picture, start in _slips(data, scene):
        ended = _tried(picture, start, keys, lost)
        # without a line it may be another minimum of the scene itself
        if ended is None or (found and not line and _is_there(ended.scene, scene, data.shape)):
            continue
        chi, end = ended.chi, ended.scene
        if is_explained(before, chi, _LEFT) and chi < limit:
            line = line or f"{LEFT} = {end.get(LEFT):.3g} and {TOP} = {end.get(TOP):.3g}"
            best, limit = Slip(what, line, chi, before), _ALIKE * chi
            if chi <= _LEAST:
                break
    return best


def _slips(data: FrameData, scene: Scene) -> Iterator[_Candidate]:
    """All that is tried, the likeliest first."""
    other = {"dark": "bright", "bright": "dark"}.get(scene.polariscope.field)
    if other is not None and not scene.polariscope.step:
        changed = scene.with_values({"polariscope.field": other})
        line = f'polariscope.field = "{other}"'
        yield message("picture_one_field", other=other), line, data, changed
    yield from _turns(data, scene, ((180, None),))
    yield from _units(data, scene, stiff=True)
    yield from _places(data, scene)
    yield from _turns(data, scene, ((0, "horizontal"), (0, "vertical")))
    yield from _turns(data, scene, tuple(product((90, 270), (None, "horizontal"))))
    if data.lamp.bright is None:
        for gamma in (round(1.0 / PHOTOGRAPHS, 2), PHOTOGRAPHS):
            if gamma != data.gamma:
                line = f"{GAMMA} = {gamma}"
                gamma_fit = scene.with_values({GAMMA: gamma})
                yield message("tone_curve_another"), line, data.toned(gamma), gamma_fit
    yield from _units(data, scene, stiff=False)


def _turns(
    data: FrameData, scene: Scene, ways: tuple[tuple[int, str | None], ...]
) -> Iterator[_Candidate]:
    """The picture lying otherwise; a quarter turn keeps its middle where it was."""
    rows, cols = data.shape
    for turn, flip in ways:
        line, what = lying_otherwise(scene, turn, flip)
        start = scene
        if turn in (90, 270) and rows != cols:
            size = {"camera.width_px": rows, "camera.height_px": cols}
            changed = {key: value for key, value in size.items() if scene.get(key) is not None}
            line += "".join(f" and {key} = {value}" for key, value in changed.items())
            left = scene.get(LEFT) + 0.5 * (cols - rows) * scene.get(PIXEL)
            start = scene.with_values(changed | {LEFT: left})
        yield what, line, data.lying(partial(as_turned, rotate_deg=turn, flip=flip)), start


def lying_otherwise(scene: Scene, turn: int, flip: str | None) -> tuple[str, str]:
    """The keys that turn a picture on top of what the scene turns already, and what it is then."""
    frames = scene.frames
    whole, mirrored = _together((frames.rotate_deg, frames.flip), (turn, flip))
    parts = [f"frames.rotate_deg = {whole}"] if whole != frames.rotate_deg else []
    if mirrored != frames.flip:
        parts.append(f'frames.flip = "{mirrored}"' if mirrored else "no frames.flip")
    line = " and ".join(parts)
    if (turn, flip) == (180, None) and not frames.flip:
        line += message("frames_flip_vertical_instead")
    placed = frames.known_order, frames.known_line, frames.free_boundary
    if frames.roi or frames.mask or frames.polygon_px or any(placed):
        line += message("roi_mask_known_orders")
    if turn == 180:
        return line, message("picture_upside_down")
    return line, "the picture is mirrored" if turn == 0 else message("picture_lies_side")


def _together(first: tuple[int, Any], then: tuple[int, Any]) -> tuple[int, str | None]:
    """The one turn and flip that do what two pairs of them do, one after the other."""
    marked = np.arange(6).reshape(2, 3)
    wanted = as_turned(as_turned(marked, *first), *then)
    ways = product((0, 90, 180, 270), (None, "horizontal", "vertical"))
    return next(w for w in ways if np.array_equal(as_turned(marked, *w), wanted))


def _units(data: FrameData, scene: Scene, stiff: bool) -> Iterator[_Candidate]:
    """Young's moduli in MPa or Pa: `stiff` beyond all bodies, or, late, a soft specimen's."""
    if scene.indenter is None:
        return
    keys = ("specimen.young_gpa", "indenter.young_gpa")
    given = {key: value for key in keys if (value := scene.get(key)) is not None}
    wrong = [key for key, value in given.items() if value > STIFFEST_GPA]
    chosen = wrong if stiff else [*({keys[0]} & given.keys() - set(wrong))]
    for group in dict.fromkeys([tuple(chosen), *((key,) for key in chosen)]):
        shares = {key: 1e-9 if given[key] > 1e3 * STIFFEST_GPA else 1e-3 for key in group}
        if shares:
            changed = {key: given[key] * share for key, share in shares.items()}
            unit = "Pa" if 1e-9 in shares.values() else "MPa"
            line = " and ".join(f"{key} = {value:g}" for key, value in changed.items())
            yield message("young_modulus_given", unit=unit), line, data, scene.with_values(changed)


def _places(data: FrameData, scene: Scene) -> Iterator[_Candidate]:
    """The contact elsewhere in the picture; where the place is an unknown, beyond the search."""
    if scene.indenter is None:
        return
    height, width = (n * scene.get(PIXEL) for n in data.shape)
    steps = ((0, 0), (-1, 0), (1, 0), (-2, 0), (2, 0), (-3, 0), (3, 0), (0, -1), (0, 1))
    for across, down in (np.array(steps) * (_ACROSS * width, _DOWN * height)).tolist():
        place = {LEFT: scene.get(LEFT) + across, TOP: scene.get(TOP) + down}
        yield message("contact_elsewhere_picture"), "", data, scene.with_values(place)


def _is_there(end: Scene, scene: Scene, shape: tuple[int, int]) -> bool:
    """Whether a contact lies where its scene says, nearer than halfway to the next place tried."""
    height, width = (n * scene.get(PIXEL) for n in shape)
    across = abs(end.get(LEFT) - scene.get(LEFT)) < 0.5 * _ACROSS * width
    down = abs(end.get(TOP) - scene.get(TOP)) < 0.5 * _DOWN * height
    return bool(across and down)


def _tried(data: FrameData, scene: Scene, keys: tuple[str, ...], lost: bool) -> Settled | None:
    """Where a quick fit ended, a search if `lost`; None where it explains nothing."""
    try:
        if lost:
            best: Settled | None = search_frame(data, scene, keys)[0]
        else:
            best = settle_frame(data, scene, keys)
    except (InputError, PhysicsError):
        return None
    return best if best and best.positive and best.chi <= TOO_FAR * best.gain else None
