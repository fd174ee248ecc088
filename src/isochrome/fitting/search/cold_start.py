"""A cold start: from a frame and a scene whose values are far off to the truth.

What a fit of few pixels comes to rest in (`FarModel.settled`) from a scene's own values, if that is
the noise alone in clear light; or else from the best values of a scan (`search.scan`), one after
the other until one leaves the noise alone, and from that one's nearest rivals.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice, product

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import FrameData, Minimum, Prior, linear_costs, no_prior, prepare
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.frame.far_model import FarModel
from isochrome.fitting.frame.renderer import scene_optics
from isochrome.fitting.frame.single_state import is_held, with_numerics
from isochrome.fitting.frame.unknowns import (
    BULK,
    FRICTION,
    LEFT,
    LOAD,
    SMOOTH_KEYS,
    TANGENTIAL,
    fit_region,
    moved_scene,
    thinning,
    values_of,
)
from isochrome.fitting.search.scan import (
    HIDDEN,
    LOAD_STEP,
    SHEAR_STEP,
    Rung,
    ladder,
    rungs,
    shears_to,
)
from isochrome.scene import Scene
from isochrome.stress import PixelGrid, pixel_grid, regular_modes

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
    """Where a start came to rest: `scene`, `values` (p,), `chi`; `gain`, light over noise.

    Not `positive`: the light is none.
    """

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

    @property
    def minimum(self) -> Minimum:
        """Its values and chi."""
        return Minimum(self.values, self.chi)


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
    gain = float(np.mean(result.gamma_fit.part.amplitude))
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
    """Find the values that a frame's fringes may have come from.

    Parameters: `data`; `scene`, one state with its place written out; `keys`, the unknowns, with a
    `prior`; `cold`, whether load, friction and bulk stress may be far off, so that what the
    scene's own values lead to may be wrong. Returns those with light first, by rising chi: one
    where the scene's own values led to the noise and no others were tried. Raises InputError for a
    key that is no number in the scene, PhysicsError where no values give fringes of the right
    contrast.
    """
    values_of(scene, keys)  # numbers, or refused
    near = settle_frame(data, scene, keys, prior)
    if near is not None and (near.found or (near.positive and not cold)):
        return (near,)
    lattice = _Lattice.of(data, scene, keys)
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

    @classmethod
    def of(cls, data: FrameData, scene: Scene, keys: tuple[str, ...]) -> _Lattice:
        """That of a frame."""
        usable = _usable(data, scene)
        if not usable.any():
            raise InputError("no_valid_pixel_below", name=data.name)
        return cls(scene, keys, thinning(int(np.count_nonzero(usable)), _SCAN_PIXELS))

    @property
    def held(self) -> bool:
        """Whether a tangential force holds the contact."""
        return is_held(self.scene)

    @property
    def loads(self) -> Array:
        """Loads, N."""
        load = self.scene.load_at(0.0)
        return load * ladder(_WIDEST_LOAD, LOAD_STEP) if LOAD in self.keys else np.array([load])

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
    def places(self) -> int:
        """How many of the strided pixels the contact may lie aside, either way."""
        return _PLACES if LEFT in self.keys and self.scene.is_contact else 0

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
        """A fringe pattern's nearest rivals, a fringe of bulk stress away: far from the contact
        that adds a constant.
        """
        if BULK not in self.keys:
            return []
        return [
            scene.with_values({BULK: scene.get(BULK) + hop * self.fringe_mpa}) for hop in (-1, 1)
        ]

    def alike(self, scene: Scene, other: Scene) -> bool:
        """Whether two scenes are within a step of each other in all that is scanned."""
        return bool(np.abs(self._steps(scene) - self._steps(other)).max() <= 1.0 + 1e-6)

    def _steps(self, scene: Scene) -> Array:
        """A scene's values in steps."""
        assert scene.load is not None
        return np.array([
            np.log(scene.load_at(0.0)) / LOAD_STEP,
            _shear(scene) / SHEAR_STEP,
            scene.get(LEFT) / self._aside_mm,
            (scene.load.bulk_mpa or 0.0) / self.fringe_mpa * 3.0,
        ])  # fmt: skip

    @property
    def _aside_mm(self) -> float:
        assert self.scene.camera is not None and self.scene.camera.pixel_mm is not None
        return self.stride * self.scene.camera.pixel_mm


def _shear(scene: Scene) -> float:
    """A scene's friction, or Q/P where it is held."""
    if is_held(scene):
        assert scene.load is not None and scene.load.tangential_n is not None
        return scene.load.tangential_n / scene.load_at(0.0)
    return float(scene.friction_at(0.0)) if scene.friction else 0.0


def _usable(data: FrameData, scene: Scene) -> Mask:
    """Pixels (rows, cols) away from where the model decides the picture."""
    return data.valid & fit_region(scene, data.shape, 1, HIDDEN * data.shape[0])


def _scanned(data: FrameData, scene: Scene, lattice: _Lattice) -> Iterator[Scene]:
    """The scenes of a lattice that leave least, best first, none within a step of another."""
    thin = data.every(lattice.stride)
    keep = _usable(data, scene)[:: lattice.stride, :: lattice.stride]
    problem = prepare(thin.light, mask=keep, sigma=thin.sigma, light=thin.lamp)
    grid, aside = pixel_grid(scene, data.shape).every(lattice.stride), lattice.places
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
    for rung in rungs(scene, wide, lattice.loads.tolist()):
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
