"""Where a contact is in a picture of which nothing is known but its scale: a search over windows.

The fringes of a contact are computed once for each load and friction, on a field much larger than
the picture: each window of that field is a place that the picture may show. Every window is held
against the picture's quarter turns, under a few exponents of the camera. What a window explains
does not depend on the light's sign, which then tells the field: cos² = 1 - sin² is sin² under a
negative light. A picture that is mirrored left to right is that of a contact which slides the other
way, so that quarter turns and both signs of friction stand for all that a picture may lie like.
The best windows descend as a cold start does (`search.descents`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import FrameData
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.renderer import scene_optics
from isochrome.fitting.frame.unknowns import fit_region, thinning
from isochrome.fitting.search.coarse_fields import (
    FRICTION,
    LEFT,
    LOAD,
    TOP,
    ContactField,
    PressureTable,
    SearchPixels,
    Space,
    descend,
    pressure_table,
    search_values,
    theta_of,
)
from isochrome.frames import as_turned
from isochrome.scene import Scene
from isochrome.stress import PixelGrid

SEARCHED = ("load.normal_n", "friction.coefficient", "camera.left_mm", "camera.top_mm")
"""What a search of the picture finds, besides how the picture lies."""

_PIXELS, _FINE_PIXELS = 800, 900
_LOADS = np.geomspace(1.0 / 3.3, 3.3, 21)
"""Loads over the stated one: a little beyond a factor of three, 12 % apart, which one basin is."""
_FRICTIONS = np.array([-0.7, -0.5, -0.3, -0.1, 0.1, 0.3, 0.5, 0.7])
_GAMMAS = (0.5, 0.7, 1.0, 1.4, 2.0)
"""Exponents that are tried: from each the fit finds one up to 1.2 times off."""

_ABOVE, _BELOW = 0.55, 0.2
"""The surface's place, in heights of the picture: so far down in it, so far above its first row."""
_SIDES = 0.05
"""Share of the width at either side in which no contact's middle is looked for."""
_HIDDEN = 1.0 / 13.0
"""Share of the picture's height below the surface where the contact decides what is seen."""

_SHADES = ((0, 0), (0, 1), (1, 0), (1, 1), (0, 2), (2, 0))
"""Powers of z and x that any picture's slow changes of light are taken for."""
_RIDGE = 1e-5
_BEST, _STARTS, _STEPS = 400, 48, 10
"""How many windows are compared, how many descend, and by how many steps."""

_WINDOWS_APART = np.array([0.15, 0.3, 0.04, 0.04])
_APART = np.array([0.02, 0.03, 0.005, 0.005])
"""Distance of two windows, and of two minima: ln P, mu, widths of the picture across and down."""


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
        Residual over noise of the search's quick model.
    """

    lying: Lying
    scene: Scene
    data: FrameData
    chi: float


@dataclass(frozen=True)
class _Window:
    """A place, load and friction that explain a picture but for `left` of its variation."""

    left: float
    lying: Lying
    theta: Array


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
    placed = scene.with_values({"camera.left_mm": 0.0, "camera.top_mm": 0.0})
    table = pressure_table(placed)
    result: list[_Window] = []
    for sideways in (False, True):
        own = [
            (turn, partial(as_turned, rotate_deg=turn, flip=flip))
            for turn in turns
            if (turn in (90, 270)) == sideways
        ]
        if own:
            pictures = [
                (Lying(turn, flip, "dark", gamma), np.maximum(move(data.raw), 0.0) ** gamma)
                for turn, move in own
                for gamma in gammas
            ]
            result += _Windows(placed, table, pictures).best(fields)
    starts = _spread(sorted(result, key=lambda w: w.left), data.shape[1] * _pixel_of(scene))
    minima = sorted(_descended(data, placed, table, starts), key=lambda s: s.chi)
    if not minima:
        raise PhysicsError("nothing_frame_follows_contact", name=data.name)
    return _distinct(minima)


def _pixel_of(scene: Scene) -> float:
    assert scene.camera is not None and scene.camera.pixel_mm is not None
    return scene.camera.pixel_mm


class _Windows:
    """Windows of a wide field, held against pictures (rows, cols) that lie alike."""

    def __init__(
        self, scene: Scene, table: PressureTable, pictures: Sequence[tuple[Lying, Array]]
    ) -> None:
        shape = pictures[0][1].shape
        stride = thinning(shape[0] * shape[1], _PIXELS)
        self.pixel = _pixel_of(scene) * stride
        self.lyings = [lying for lying, _ in pictures]
        self.light = np.array([light[::stride, ::stride] for _, light in pictures])
        self.rows, self.cols = self.light.shape[1:]
        first, last = round(_SIDES * self.cols), round((1.0 - _SIDES) * self.cols)
        self.above, below = round(_ABOVE * self.rows), round(_BELOW * self.rows)
        self.shifts, self.steps, self.last = last - first + 1, self.above + below + 1, last
        wide = PixelGrid(
            rows=self.rows + self.steps - 1, cols=self.cols + self.shifts - 1,
            left_mm=-last * self.pixel, top_mm=-self.above * self.pixel, pixel_mm=self.pixel,
        )  # fmt: skip
        theta = theta_of(scene)
        loads, frictions = np.meshgrid(theta[LOAD] + np.log(_LOADS), _FRICTIONS, indexing="ij")
        self.theta = np.tile(theta, (loads.size, 1))
        self.theta[:, LOAD], self.theta[:, FRICTION] = loads.ravel(), frictions.ravel()
        field = ContactField(scene, wide, np.ones((wide.rows, wide.cols), dtype=bool), table)
        signal = scene_optics(scene).signal(field.difference(self.theta)).astype(np.float32)
        self.signal = signal.reshape(-1, wide.rows, wide.cols)
        z, x = np.meshgrid(
            *(np.linspace(-1.0, 1.0, n) for n in self.light.shape[1:]), indexing="ij"
        )
        self.shades = np.array([z**i * x**j for i, j in _SHADES])
        self.fall = x**2 + z**2

    def best(self, fields: Sequence[str]) -> list[_Window]:
        """The windows that explain the pictures best, with the field that their light's sign tells.

        `fields`, those that may be.
        """
        windows = [w for step in range(self.steps) for w in self._of_step(step, fields)]
        return sorted(windows, key=lambda w: w.left)[:_BEST]

    def _of_step(self, step: int, fields: Sequence[str]) -> Iterator[_Window]:
        """Of each column and picture the best load and friction, the surface at one row.

        Pictures have smooth light without fringes; rows above the surface, and hidden ones near it,
        have that alone.
        """
        depth = np.arange(self.rows) + 0.5 + step - self.above
        begin = int(np.argmax(depth > _HIDDEN * self.rows))
        rest = _variation(self.light[:, :begin], self.shades[:3, :begin])[1]
        data, energy = _variation(self.light[:, begin:], self.shades[:, begin:])
        whole = rest + energy
        window = _WindowLight(data, self.shades[:, begin:], self.fall[begin:])
        below = self.signal[:, step + begin : step + self.rows]
        for shift in range(self.shifts):
            seen = below[:, :, shift : shift + self.cols].reshape(len(self.theta), -1)
            gain, bright = window.explained(seen)
            left = (whole - gain) / whole
            if len(fields) == 1:
                left = np.where(bright == (fields[0] == "bright"), left, np.inf)
            for k, row in enumerate(np.argmin(left, axis=0)):
                theta = self.theta[row].copy()
                theta[LEFT] = (shift - self.last) * self.pixel
                theta[TOP] = (step - self.above) * self.pixel
                lying = self.lyings[k]._replace(field="bright" if bright[row, k] else "dark")
                yield _Window(float(left[row, k]), lying, theta)


class _WindowLight:
    """Pictures' pixels `data` (k, n), smooth light taken out, and the light that fringes may have.

    A signal s explains them by (u + v r²) s, once smooth light is taken out of that too.
    """

    def __init__(self, data: Array, shades: Array, fall: Array) -> None:
        smooth = _orthonormal(shades).T
        self.fall = fall.ravel().astype(np.float32)
        linear = np.concatenate([smooth, data]).astype(np.float32)
        self.columns = np.concatenate([linear, linear * self.fall]).T.copy()
        squares = [np.ones_like(self.fall), self.fall, self.fall**2]
        self.squares = np.array(squares).T.copy()
        self.parts = np.cumsum([len(smooth), len(data), len(smooth)])

    def explained(self, signal: Array) -> tuple[Array, Array]:
        """What signals (m, n) explain of each picture (m, k), and whether by negative light."""
        square = (signal * signal) @ self.squares
        even, data, uneven, fallen = np.split(signal @ self.columns, self.parts, axis=1)
        ridge = _RIDGE * signal.shape[1]
        a = square[:, :1] - np.sum(even**2, axis=1, keepdims=True) + ridge
        b = square[:, 1:2] - np.sum(even * uneven, axis=1, keepdims=True)
        c = square[:, 2:] - np.sum(uneven**2, axis=1, keepdims=True) + ridge
        u, v = (np.array([c * data - b * fallen, a * fallen - b * data])) / (a * c - b * b)
        return u * data + v * fallen, u + v * self.fall.mean() < 0.0


def _orthonormal(shades: Array) -> Array:
    """Columns (n, j) that span smooth images (j, rows, cols)."""
    return np.linalg.qr(shades.reshape(len(shades), -1).T)[0]


def _variation(light: Array, shades: Array) -> tuple[Array, Array]:
    """Pictures (k, n) without their smooth light, and what is left of each, squared (k,)."""
    flat = light.reshape(len(light), -1)
    if flat.shape[1] <= len(shades):
        return np.zeros_like(flat), np.zeros(len(flat))
    smooth = _orthonormal(shades)
    flat = flat - (flat @ smooth) @ smooth.T
    return flat, np.einsum("kn,kn->k", flat, flat)


def _spread(windows: Sequence[_Window], width_mm: float) -> list[_Window]:
    """The best windows that are not next to each other."""
    apart = _WINDOWS_APART * np.array([1.0, 1.0, width_mm, width_mm])
    selected: list[_Window] = []
    for window in windows:
        if not any(
            other.lying == window.lying and _near(other.theta, window.theta, apart)
            for other in selected
        ):
            selected.append(window)
        if len(selected) == _STARTS:
            break
    return selected


def _near(theta: Array, other: Array, apart: Array) -> bool:
    chosen = [LOAD, FRICTION, LEFT, TOP]
    return bool(np.all(np.abs(theta[chosen] - other[chosen]) < apart))


def _descended(
    data: FrameData, scene: Scene, table: PressureTable, windows: Sequence[_Window]
) -> Iterator[PictureStart]:
    """Where each window leads."""
    turned: dict[Lying, FrameData] = {}
    for window in windows:
        lying = window.lying
        if lying not in turned:
            move = partial(as_turned, rotate_deg=lying.rotate_deg, flip=lying.flip)
            turned[lying] = data.toned(lying.gamma).lying(move)
        start = _start(turned[lying], scene, table, window)
        if start is not None:
            yield start


def _start(
    data: FrameData, scene: Scene, table: PressureTable, window: _Window
) -> PictureStart | None:
    """Where one window leads; None where that is to no light."""
    (rows, cols), lying = data.shape, window.lying
    seen = {
        "camera.height_px": rows,
        "camera.width_px": cols,
        "polariscope.field": lying.field,
        "frames.gamma": lying.gamma,
    }
    here = scene.with_values(seen | search_values(window.theta, SEARCHED))
    usable = data.valid & fit_region(here, data.shape, 1, _HIDDEN * rows)
    if not usable.any():
        return None
    stride = thinning(int(np.count_nonzero(usable)), _FINE_PIXELS)
    field = partial(ContactField, here)
    pixels = SearchPixels(data, here, lambda grid, keep: field(grid, keep, table), usable, stride)
    size = np.ones(len(window.theta))
    size[[LEFT, TOP]] = cols * _pixel_of(scene)
    space = Space(np.array([LOAD, FRICTION, LEFT, TOP]), size, held=False)
    led = descend(pixels, theta_of(here)[None], space, steps=_STEPS)
    if not (led.sound[0] and np.isfinite(led.chi[0])):
        return None
    there = here.with_values(search_values(led.theta[0], SEARCHED))
    return PictureStart(lying, there, data, float(led.chi[0]))


def _distinct(starts: Sequence[PictureStart]) -> tuple[PictureStart, ...]:
    """Those that are not next to a better one of the same turn and field."""
    selected: list[PictureStart] = []
    for start in starts:
        width = start.data.shape[1] * _pixel_of(start.scene)
        apart = _APART * np.array([1.0, 1.0, width, width])
        if not any(
            other.lying[:3] == start.lying[:3]
            and _near(theta_of(other.scene), theta_of(start.scene), apart)
            for other in selected
        ):
            selected.append(start)
    return tuple(selected)
