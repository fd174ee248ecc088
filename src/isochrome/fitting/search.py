"""A cold start: from a frame and a scene whose values are far off to the truth.

What a fit of few pixels comes to rest in (`FarModel.settled`) from a scene's own values, if that is
the noise alone in clear light; or else from the best values of a scan, one after
the other until one leaves the noise alone, and from that one's nearest rivals.

On the pixels of a picture the stress difference of a contact is nearly a straight line in its
friction, or in its tangential force over the load; a bulk stress adds a constant, and another place
of the contact is another window of a wider picture. So a scan solves no more contacts than it tries
loads. What a signal leaves of the pixels' light is told for all of them by one elimination of
illumination and background (`estimation.linear_costs`).

How a picture of a contact may lie, and where in it the contact is (`search_picture`): nothing is
known of the place, the quarter turns, the friction, the field and the exponent of the camera, and
the load is known roughly. A scan solves the contact for each load on pixels much wider than the
picture: each window of them is a place that the picture may show. Every window is held against the
picture's quarter turns, under a few exponents of the camera, beside smooth light. What a window
explains does not depend on the light's sign, which then tells the field: cos² = 1 - sin² is sin²
under a negative light. A picture that is mirrored left to right is that of a contact which slides
the other way, so that quarter turns and both signs of friction stand for all that a picture may lie
like. The best windows settle as a cold start does.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, product
from typing import Literal, NamedTuple

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import FrameData, Prior, channel_light, linear_costs, no_prior, prepare
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.frame.far_model import FarModel
from isochrome.fitting.frame.renderer import scene_optics
from isochrome.fitting.frame.single_state import is_held, with_numerics, with_part
from isochrome.fitting.frame.unknowns import (
    BULK,
    FRICTION,
    GAMMA,
    LEFT,
    LOAD,
    PIXEL,
    SMOOTH_KEYS,
    TANGENTIAL,
    TOP,
    fit_region,
    moved_scene,
    thinning,
    values_of,
)
from isochrome.frames import as_turned
from isochrome.scene import Scene
from isochrome.simulation import SceneState, scene_states, state_difference
from isochrome.stress import PixelGrid, pixel_grid, regular_modes

LOAD_STEP, SHEAR_STEP = 0.19, 0.2
"""Steps of ln P and of the friction, or Q/P, within which a start leads to the next minimum."""

HIDDEN = 1.0 / 13.0
"""Share of the picture's height below the surface where the contact decides what is seen."""
_FRICTION = 0.2
"""What a contact slides with whose own friction says nothing of the shear."""


@dataclass(frozen=True)
class Rung:
    """A solved contact at a `load` (N). Its stress difference (rows, cols), MPa: `even`, and `odd`,
    by one of friction or Q/P.
    """

    load: float
    even: Array
    odd: Array

    def fields(self, shears: Array) -> Array:
        """The differences (m, rows, cols) at some shears (m,)."""
        return np.asarray(self.even + shears[:, None, None].astype(np.float32) * self.odd)


def ladder(widest: float, step: float) -> Array:
    """Factors from 1/widest to widest, about a step of their logarithm apart."""
    end = np.log(widest)
    return np.exp(np.linspace(-end, end, 1 + int(np.ceil(2.0 * end / step))))


def shears_to(limit: float) -> Array:
    """Frictions or Q/P about zero, to `limit` either way, at the middles of equal steps."""
    count = 2 * max(1, int(np.ceil(limit / SHEAR_STEP)))
    return limit * (2.0 * np.arange(count) + 1.0 - count) / count


def rungs(scene: Scene, pixels: PixelGrid, loads: Sequence[float]) -> Iterator[Rung]:
    """The rungs of a scene, its contact coarse; PhysicsError where none is solved."""
    held, sliding = is_held(scene), scene.friction is not None
    shear = scene.friction_at(0.0) if sliding else 0.0  # a friction, or Q/P, to solve contacts with
    if held:
        shear = 0.5 * abs(shear)
    elif sliding:
        shear = shear or _FRICTION
    reason: PhysicsError | None = PhysicsError("contact_cannot_solved_any", name=scene.name)
    for load in map(float, loads):
        one = with_part(scene, "load", normal_n=load)
        if held:
            one = with_part(one, "load", tangential_n=shear * load)
        elif sliding:
            one = with_part(one, "friction", coefficient=shear)
        try:
            one = with_numerics(one, nodes_per_pixel=1, tolerance=1e-2)
            even, odd = _parts(one, scene_states(one)[-1], pixels)
        except InputError:  # a block is not known so far out
            continue
        except PhysicsError as error:
            reason = reason and error
            continue
        reason = None
        yield Rung(load, even, odd / np.float32(shear or 1.0))
    if reason is not None:
        raise reason


def _parts(scene: Scene, state: SceneState, pixels: PixelGrid) -> tuple[Array, Array]:
    """The stress difference's part that stays as the shear turns round, and the one that does."""
    here = np.nan_to_num(state_difference(scene, state, pixels))
    if state.surface is None or not state.surface.shear_mpa.any():
        return here, np.zeros_like(here)
    turned = replace(state, surface=replace(state.surface, shear_mpa=-state.surface.shear_mpa))
    back = np.nan_to_num(state_difference(scene, turned, pixels))
    return 0.5 * (here + back), 0.5 * (here - back)


CLEAR = 25.0
"""Light over noise above which a wrong solution cannot look as good as that (a hop leaves 0.02 of
the light): in a frame that is noisier the scan is never left out."""
CLOSE_CHI = 1.15
"""Residual over noise of the coarse model, on few pixels, below which a start was the right one."""

_SCAN_PIXELS, _PIXELS = 520, 4_000
_HIDDEN_PX, _ROOM_PX = 14.0, 10.0

_STARTS = 6
"""Starts of a scan that are tried (of 60 contacts, the first leads to the truth in 56)."""
_WIDEST_LOAD = 4.2
"""Factor in load, either way, that is scanned."""
_MOST_SHEAR = 0.5
"""Largest Q/P that is scanned where friction itself is unknown."""
_SLIPPING = 0.98
"""Largest tangential force of a held contact that is tried, over what friction can hold."""
_PLACES = 2
"""Places across that are scanned, either way, a few hundredths of the picture apart."""
_BULK_FRINGES, _SLOPE_FRINGES = np.arange(-12, 13) / 3.0, np.arange(-3, 4) / 2.0
"""Fringes of a bulk stress, and at the picture's rim of its slopes, that are scanned."""


@dataclass(frozen=True)
class Settled:
    """Where a start came to rest; `gain`, light over noise; not `positive`: the light is none."""

    scene: Scene
    values: Array
    chi: float
    gain: float
    positive: bool

    @property
    def close(self) -> bool:
        """Whether it leaves the noise alone."""
        return self.positive and self.chi <= CLOSE_CHI

    @property
    def found(self) -> bool:
        """The same in light so clear that nothing else does."""
        return self.close and self.gain >= CLEAR


def settle_frame(
    data: FrameData, scene: Scene, keys: tuple[str, ...], prior: Prior | None = None
) -> Settled | None:
    """Where few pixels lead from a scene's values; None where those make no scene."""
    stride = thinning(data.light.size, _PIXELS)
    region = fit_region(scene, data.shape, stride, _HIDDEN_PX)
    try:
        coarse = with_numerics(scene, nodes_per_pixel=1, tolerance=1e-2, room=1.4)
        model = FarModel(
            data, coarse, keys, region, stride=stride, hidden_px=_HIDDEN_PX - _ROOM_PX,
            prior=prior or no_prior(len(keys)),
        )  # fmt: skip
        result = model.settled(values_of(scene, keys), robust=False)
    except PhysicsError:
        return None
    if result is None:
        return None
    gain = float(np.mean(result.gamma_fit.amplitude))
    return Settled(
        moved_scene(scene, keys, result.values), result.values, result.chi, gain, result.positive
    )


def search_frame(
    data: FrameData,
    scene: Scene,
    keys: tuple[str, ...],
    prior: Prior | None = None,
    *,
    cold: bool = True,
) -> tuple[Settled, ...]:
    """The values that a frame's fringes may have come from: with light first, by rising chi.
    `scene`, one state with its place written out; `cold`, whether load, friction and bulk stress
    may be far off, so that what the scene's own values lead to may be wrong: without, or where they
    led to the noise, no others are tried. InputError for a key that is no number in the scene,
    PhysicsError where no values give fringes of the right contrast.
    """
    values_of(scene, keys)  # numbers, or refused
    near = settle_frame(data, scene, keys, prior)
    if near is not None and (near.found or (near.positive and not cold)):
        return (near,)
    usable = int(np.count_nonzero(_usable(data, scene)))
    if not usable:
        raise InputError("no_valid_pixel_below", name=data.name)
    lattice = _Lattice(scene, keys, thinning(usable, _SCAN_PIXELS))
    found = [near] if near else []
    for start in islice(_scanned(data, scene, lattice), _STARTS):
        one, before = settle_frame(data, start, keys, prior), found
        found = _with(found, one, lattice)
        again = one is not None and bool(before) and lattice.alike(one.scene, before[0].scene)
        if found and (found[0].close or again):
            break
    if not found:
        raise PhysicsError("no_start_gives_positive")
    for rival in lattice.rivals(found[0].scene):
        found = _with(found, settle_frame(data, rival, keys, prior), lattice)
    return tuple(found)


def _with(found: list[Settled], one: Settled | None, lattice: _Lattice) -> list[Settled]:
    """What was found with one more, by rising chi; of two that are alike, the better."""
    result: list[Settled] = []
    for each in sorted([*found, *([one] if one else [])], key=lambda s: (not s.positive, s.chi)):
        if not any(lattice.alike(each.scene, other.scene) for other in result):
            result.append(each)
    return result


@dataclass(frozen=True)
class _Lattice:
    """The values of some `keys` that are scanned about a `scene`'s, on every `stride`-th pixel."""

    scene: Scene
    keys: tuple[str, ...]
    stride: int

    @property
    def held(self) -> bool:
        """Whether a tangential force holds the contact."""
        return is_held(self.scene)

    @property
    def shears(self) -> Array:
        """Frictions, or Q/P."""
        friction = self.scene.friction_at(0.0) if self.scene.friction else 0.0
        if self.held and TANGENTIAL in self.keys:
            limit = 0.9 * abs(friction)
            return shears_to(max(limit, _MOST_SHEAR) if FRICTION in self.keys else limit)
        if FRICTION in self.keys and not self.held:
            return shears_to(max(0.6, 1.5 * abs(friction)))
        return np.array([_shear(self.scene)])

    @property
    def fringe_mpa(self) -> float:
        """The bulk stress of a fringe."""
        return 1.0 / scene_optics(self.scene).order_per_mpa

    def smooth(self, pixels: PixelGrid) -> tuple[list[dict[str, float]], Array]:
        """Smooth stresses besides the scene's, by key, and as fields of pixels (m, rows, cols)."""
        rim = 0.5 * pixels.pixel_mm * max(pixels.rows, pixels.cols)
        hops, fields = [], np.zeros((0, pixels.rows, pixels.cols))
        for key, mode in zip(SMOOTH_KEYS, regular_modes(1), strict=True):
            if key in self.keys:
                fringes = _BULK_FRINGES if key == BULK else _SLOPE_FRINGES / rim
                hops.append([(key, mpa) for mpa in (self.fringe_mpa * fringes).tolist()])
                field = np.broadcast_to(mode.difference(*pixels.places), fields.shape[1:])
                fields = np.concatenate((fields, field[None]))
        every = [dict(one) for one in product(*hops)]
        sizes = np.array([list(one.values()) for one in every])
        return every, np.tensordot(sizes, fields, 1).astype(np.complex64)

    def moved(self, load: float, aside: int, shear: float, smooth: Mapping[str, float]) -> Scene:
        """The scene of one of its places."""
        values: dict[str, float] = {LOAD: load}
        if LEFT in self.keys:
            values[LEFT] = self.scene.get(LEFT) + aside * self._aside_mm
        if self.held:
            values[TANGENTIAL] = shear * load
            if FRICTION in self.keys:
                values[FRICTION] = max(abs(self.scene.get(FRICTION)), abs(shear) / _SLIPPING)
        elif self.scene.friction is not None:
            values[FRICTION] = shear
        values |= {key: self.scene.get(key) + more for key, more in smooth.items()}
        return self.scene.with_values(values)

    def rivals(self, scene: Scene) -> list[Scene]:
        """Rivals a fringe of bulk stress away: far from the contact that adds a constant."""
        if BULK not in self.keys:
            return []
        return [
            scene.with_values({BULK: scene.get(BULK) + hop * self.fringe_mpa}) for hop in (-1, 1)
        ]

    def alike(self, scene: Scene, other: Scene) -> bool:
        """Whether two scenes are within a step of each other in all that is scanned."""
        one, two = (
            np.array([
                np.log(each.load_at(0.0)) / LOAD_STEP,
                _shear(each) / SHEAR_STEP,
                each.get(LEFT) / self._aside_mm,
                (each.get(BULK) or 0.0) / self.fringe_mpa * 3.0,
            ])
            for each in (scene, other)
        )  # fmt: skip
        return bool(np.abs(one - two).max() <= 1.0 + 1e-6)

    @property
    def _aside_mm(self) -> float:
        return self.stride * float(self.scene.get(PIXEL))


def _shear(scene: Scene) -> float:
    """A scene's friction, or Q/P where it is held."""
    if is_held(scene):
        return float(scene.get(TANGENTIAL)) / scene.load_at(0.0)
    return float(scene.friction_at(0.0)) if scene.friction else 0.0


def _usable(data: FrameData, scene: Scene) -> Mask:
    """Pixels (rows, cols) away from where the model decides the picture."""
    return data.valid & fit_region(scene, data.shape, 1, HIDDEN * data.shape[0])


def _scanned(data: FrameData, scene: Scene, lattice: _Lattice) -> Iterator[Scene]:
    """The scenes of a lattice that leave least, best first, none within a step of another."""
    thin = data.every(lattice.stride)
    keep = _usable(data, scene)[:: lattice.stride, :: lattice.stride]
    problem = prepare(thin.light, mask=keep, sigma=thin.sigma, light=thin.lamp)
    grid = pixel_grid(scene, data.shape).every(lattice.stride)
    aside = _PLACES if LEFT in lattice.keys and scene.is_contact else 0
    loads = scene.load_at(0.0) * (
        ladder(_WIDEST_LOAD, LOAD_STEP) if LOAD in lattice.keys else np.ones(1)
    )
    wide = grid if not aside else PixelGrid(
        rows=grid.rows, cols=grid.cols + 2 * aside, left_mm=grid.left_mm - aside * grid.pixel_mm,
        top_mm=grid.top_mm, pixel_mm=grid.pixel_mm,
    )  # fmt: skip
    optics, shears = scene_optics(scene), lattice.shears
    smooth, besides = lattice.smooth(grid)
    besides = besides[:, keep]
    columns = problem.columns
    solved: list[Rung] = []
    costs: list[Array] = []
    for rung in rungs(scene, wide, loads.tolist()):
        fields = rung.fields(shears)
        windows = [fields[:, :, k : k + grid.cols][:, keep] for k in range(2 * aside + 1)]
        every = np.array(windows)[:, :, None] + besides
        signals = optics.signal(every.reshape(-1, problem.size)).astype(np.float32)
        cost, light = linear_costs(*columns, problem.data[None], signals)
        costs.append(np.where(light > 0.0, cost, np.inf).reshape(every.shape[:3]))
        solved.append(rung)
    every = np.array(costs)
    chosen: list[Scene] = []
    for flat in np.argsort(every, axis=None, kind="stable"):
        k, place, shear, j = np.unravel_index(flat, every.shape)
        if not np.isfinite(every[k, place, shear, j]):
            return
        rung = solved[k]
        one = lattice.moved(rung.load, int(place) - aside, float(shears[shear]), smooth[j])
        if not any(lattice.alike(one, other) for other in chosen):
            chosen.append(one)
            yield one


_PICTURE_PIXELS = 800
_PICTURE_LOAD, _MOST_FRICTION = 3.3, 0.8
"""Factor in load, either way, and friction that are scanned."""
_GAMMAS = (0.5, 0.7, 1.0, 1.4, 2.0)
"""Exponents that are tried: from each the fit finds one up to 1.2 times off."""

_ABOVE, _BELOW = 0.55, 0.2
"""The surface's place, in heights of the picture: so far down in it, so far above its first row."""
_SIDES = 0.05
"""Share of the width at either side in which no contact's middle is looked for."""

_WINDOWS = 10
"""How many windows settle."""


class Lying(NamedTuple):
    """How a picture is taken: quarter turns, counter-clockwise; how the turned picture is mirrored,
    horizontally or vertically; the polariscope's field; the exponent from grey levels to light.
    """

    rotate_deg: int
    flip: str | None
    field: Literal["dark", "bright"]
    gamma: float


@dataclass(frozen=True)
class PictureStart:
    """Where the fit of a picture may begin: the `scene` with load, friction and place for `data`,
    the turned picture with its light by the exponent, and chi of a fit to few pixels.
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
    """How a picture of a sliding contact may lie, and where its contact is: by rising chi. `data`,
    as captured; `scene`, one state: bodies, light, camera.pixel_mm; its load is within a factor of
    three, its friction any number, its place is not looked at. `turns`, `fields` and `gammas` are
    tried of a picture mirrored by `flip`. PhysicsError where the contact cannot be solved at any
    load near the scene's, or nothing in the picture follows a contact's fringes.
    """
    placed = scene.with_values({LEFT: 0.0, TOP: 0.0})
    windows: list[_Window] = []
    for sideways in (False, True):
        own = [turn for turn in turns if (turn in (90, 270)) == sideways]
        if own:
            windows += _windows(placed, own, data, flip, gammas, fields)
    keys = (LOAD, FRICTION, LEFT, TOP, *([GAMMA] if len(gammas) > 1 else []))
    starts: list[PictureStart] = []
    for window in _apart(sorted(windows, key=lambda w: w.share))[:_WINDOWS]:
        start, found = _led(data, placed, window, keys)
        if start is not None and not any(_same(start, other) for other in starts):
            starts.append(start)
        if found:
            break
    if not starts:
        raise PhysicsError("nothing_frame_follows_contact", name=data.name)
    return tuple(sorted(starts, key=lambda s: s.chi))


@dataclass(frozen=True)
class _Window:
    """What leaves a `share` of a picture's variation, `at` (4,) of a lattice."""

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
    stride = thinning(pictures[0].size, _PICTURE_PIXELS)
    pictures = pictures[:, ::stride, ::stride]
    rows, cols = pictures.shape[1:]
    light = pictures.reshape(len(lyings), -1)
    pixel = float(scene.get(PIXEL)) * stride
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
    loads = scene.load_at(0.0) * ladder(_PICTURE_LOAD, LOAD_STEP)
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
        if len(chosen) == _WINDOWS:
            break
        if not any(
            other.lying[:3] == window.lying[:3]
            and np.abs(np.subtract(other.at, window.at)).max() <= 1
            for other in chosen
        ):
            chosen.append(window)
    return chosen


def _led(
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
