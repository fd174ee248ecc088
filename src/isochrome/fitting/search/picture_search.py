"""How a picture of a contact may lie, and where in it the contact is.

Nothing is known of the place, the quarter turns, the friction, the field and the exponent of the
camera, and the load is known roughly. A scan (`search.scan`) solves the contact for each load on
pixels much wider than the picture: each window of them is a place that the picture may show. Every
window is held against the picture's quarter turns, under a few exponents of the camera, beside
smooth light. What a window explains does not depend on the light's sign, which then tells the
field: cos² = 1 - sin² is sin² under a negative light. A picture that is mirrored left to right is
that of a contact which slides the other way, so that quarter turns and both signs of friction stand
for all that a picture may lie like. The best windows settle as a cold start does
(`search.cold_start`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import FrameData, channel_light, linear_costs
from isochrome.fitting.frame.renderer import scene_optics
from isochrome.fitting.frame.unknowns import FRICTION, GAMMA, LEFT, LOAD, TOP, thinning
from isochrome.fitting.search.cold_start import settle_frame
from isochrome.fitting.search.scan import HIDDEN, LOAD_STEP, ladder, rungs, shears_to
from isochrome.frames import as_turned
from isochrome.scene import Scene
from isochrome.stress import PixelGrid

_PIXELS = 800
_WIDEST_LOAD, _MOST_FRICTION = 3.3, 0.8
"""Factor in load, either way, and friction that are scanned."""
_GAMMAS = (0.5, 0.7, 1.0, 1.4, 2.0)
"""Exponents that are tried: from each the fit finds one up to 1.2 times off."""

_ABOVE, _BELOW = 0.55, 0.2
"""The surface's place, in heights of the picture: so far down in it, so far above its first row."""
_SIDES = 0.05
"""Share of the width at either side in which no contact's middle is looked for."""

_STARTS = 10
"""How many windows settle."""


class Lying(NamedTuple):
    """How a picture is taken.

    Parameters
    ----------
    rotate_deg : int
        Quarter turns, counter-clockwise, degrees.
    flip : {'horizontal', 'vertical'} or None
        How the turned picture is mirrored.
    field : {'dark', 'bright'}
        The polariscope's field.
    gamma : float
        The exponent from grey levels to light.
    """

    rotate_deg: int
    flip: str | None
    field: Literal["dark", "bright"]
    gamma: float


@dataclass(frozen=True)
class PictureStart:
    """Where the fit of a picture may begin.

    Parameters
    ----------
    lying : Lying
        How the picture is taken.
    scene : Scene
        With load, friction and place, for the turned picture.
    data : FrameData
        The picture, turned, its light by that exponent.
    chi : float
        Residual over noise of a fit to few pixels.
    """

    lying: Lying
    scene: Scene
    data: FrameData
    chi: float


def search_picture(
    data: FrameData,
    scene: Scene,
    *,
    turns: Sequence[int] = (0, 90, 180, 270),
    flip: str | None = None,
    fields: Sequence[str] = ("dark", "bright"),
    gammas: Sequence[float] = _GAMMAS,
) -> tuple[PictureStart, ...]:
    """Find how a picture of a sliding contact may lie, and where its contact is.

    Parameters
    ----------
    data : FrameData
        The picture as captured.
    scene : Scene
        One state: bodies, light, camera.pixel_mm; its load is within a factor of three, its
        friction any number, its place is not looked at.
    turns : sequence of int, optional
        Quarter turns that are tried, counter-clockwise, degrees.
    flip : {'horizontal', 'vertical'}, optional
        How the turned picture is mirrored.
    fields : sequence of str, optional
        Fields that are tried.
    gammas : sequence of float, optional
        Exponents that are tried.

    Returns
    -------
    tuple of PictureStart
        What explains the picture best, by rising chi, each once.

    Raises
    ------
    PhysicsError
        Where the contact cannot be solved at any load near the scene's, or nothing in the picture
        follows a contact's fringes.
    """
    placed = scene.with_values({LEFT: 0.0, TOP: 0.0})
    windows: list[_Window] = []
    for sideways in (False, True):
        own = [turn for turn in turns if (turn in (90, 270)) == sideways]
        if own:
            windows += _windows(placed, own, data, flip, gammas, fields)
    keys = (LOAD, FRICTION, LEFT, TOP, *([GAMMA] if len(gammas) > 1 else []))
    starts: list[PictureStart] = []
    for window in _apart(sorted(windows, key=lambda w: w.share))[:_STARTS]:
        start, found = _start(data, placed, window, keys)
        if start is not None and not any(_same(start, other) for other in starts):
            starts.append(start)
        if found:
            break
    if not starts:
        raise PhysicsError("nothing_frame_follows_contact", name=data.name)
    return tuple(sorted(starts, key=lambda s: s.chi))


@dataclass(frozen=True)
class _Window:
    """What leaves a `share` of a picture's variation: a place on the lattice of windows, loads and
    frictions, `at` (4,), and its `values`.
    """

    share: float
    lying: Lying
    at: tuple[int, ...]
    values: dict[str, float]


def _windows(
    scene: Scene,
    turns: Sequence[int],
    data: FrameData,
    flip: str | None,
    gammas: Sequence[float],
    fields: Sequence[str],
) -> Iterator[_Window]:
    """Of each window the best load and friction, for turns of a picture that give it one shape."""
    lyings = [Lying(turn, flip, "dark", gamma) for turn in turns for gamma in gammas]
    pictures = np.array([
        np.maximum(as_turned(data.raw, rotate_deg=one.rotate_deg, flip=flip), 0.0) ** one.gamma
        for one in lyings
    ])  # fmt: skip
    stride = thinning(pictures[0].size, _PIXELS)
    pictures = pictures[:, ::stride, ::stride]
    rows, cols = pictures.shape[1:]
    light = pictures.reshape(len(lyings), -1)
    assert scene.camera is not None and scene.camera.pixel_mm is not None
    pixel = scene.camera.pixel_mm * stride
    first, last = round(_SIDES * cols), round((1.0 - _SIDES) * cols)
    above, below = round(_ABOVE * rows), round(_BELOW * rows)
    wide = PixelGrid(
        rows=rows + above + below, cols=cols + last - first, left_mm=-last * pixel,
        top_mm=-above * pixel, pixel_mm=pixel,
    )  # fmt: skip
    z, x = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in (rows, cols)), indexing="ij")
    falls = np.array([np.ones(x.size), (x**2 + z**2).ravel()])
    smooth = np.linalg.qr(channel_light(rows, cols).reshape(-1, x.size).T)[0].T
    light = light - (light @ smooth.T) @ smooth
    variation = np.sum(light**2, axis=1)
    loads = scene.load_at(0.0) * ladder(_WIDEST_LOAD, LOAD_STEP)
    shears = shears_to(_MOST_FRICTION)
    solved = list(rungs(scene, wide, loads.tolist()))
    optics = scene_optics(scene)
    signals = np.concatenate([optics.signal(rung.fields(shears)) for rung in solved])
    signals = np.where(wide.z_mm[:, None] > HIDDEN * rows * pixel, signals, 0.0).astype(np.float32)
    for step in range(above + below + 1):
        for shift in range(last - first + 1):
            seen = signals[:, step : step + rows, shift : shift + cols].reshape(len(signals), -1)
            cost, sign = linear_costs(falls, smooth, light, seen)
            share = cost / variation
            if len(fields) == 1:
                share = np.where((sign < 0.0) == (fields[0] == "bright"), share, np.inf)
            for k, best in enumerate(np.argmin(share, axis=0)):
                rung, shear = divmod(int(best), len(shears))
                yield _Window(
                    float(share[best, k]),
                    lyings[k]._replace(field="bright" if sign[best, k] < 0.0 else "dark"),
                    (step, shift, rung, shear),
                    {
                        LOAD: solved[rung].load,
                        FRICTION: float(shears[shear]),
                        LEFT: (shift - last) * pixel,
                        TOP: (step - above) * pixel,
                    },
                )


def _apart(windows: Sequence[_Window]) -> list[_Window]:
    """The best windows that are not next to a better one of the same turn and field."""
    chosen: list[_Window] = []
    for window in windows:
        if len(chosen) == _STARTS:
            break
        if not any(
            other.lying[:3] == window.lying[:3]
            and np.abs(np.subtract(other.at, window.at)).max() <= 1
            for other in chosen
        ):
            chosen.append(window)
    return chosen


def _start(
    data: FrameData, scene: Scene, window: _Window, keys: tuple[str, ...]
) -> tuple[PictureStart | None, bool]:
    """Where one window leads, None where that is to no light; and whether nothing else would do."""
    lying = window.lying
    move = partial(as_turned, rotate_deg=lying.rotate_deg, flip=lying.flip)
    turned = data.lying(move).toned(lying.gamma)
    rows, cols = turned.shape
    seen = {
        "camera.height_px": rows,
        "camera.width_px": cols,
        "polariscope.field": lying.field,
        GAMMA: lying.gamma,
    }
    led = settle_frame(turned, scene.with_values(seen | window.values), keys)
    if led is None or not led.positive:
        return None, False
    gamma = led.scene.frames.stated_gamma
    lying = lying._replace(gamma=gamma)
    return PictureStart(lying, led.scene, turned.toned(gamma), led.chi), led.found


def _same(start: PictureStart, other: PictureStart) -> bool:
    """Whether two starts of one turn and field have led to one scene."""
    loads = [s.scene.load_at(0.0) for s in (start, other)]
    near = abs(np.log(loads[0] / loads[1])) < LOAD_STEP
    return start.lying[:3] == other.lying[:3] and near
