"""A cold start: from a frame and a scene whose values are far off to the basin of the truth.

The basin of an intensity fit is only 0.8 to 1.1 of the load. Here a quick model of the same scene
(`search.coarse_fields`) is held against some hundred pixels at thousands of values, over all that a
cold scene may be wrong by; the best few descend side by side, and their rivals a fringe of bulk
stress away are tried as well. A scene whose own values lead to the noise is taken at its word, and
nothing else is tried.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import FrameData, Minimum
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.renderer import scene_optics
from isochrome.fitting.frame.single_state import is_held
from isochrome.fitting.frame.unknowns import fit_region, thinning, values_of
from isochrome.fitting.search.coarse_fields import (
    BULK,
    FRICTION,
    LEFT,
    LOAD,
    SHEAR,
    THETA,
    TOP,
    WEAR,
    Descended,
    SearchPixels,
    Space,
    bulk_hops,
    descend,
    field_maker,
    search_values,
    theta_of,
)
from isochrome.scene import Scene

FOUND_CHI = 1.1
"""Residual over noise at which a search has arrived."""

CLEAR = 25.0
"""Light over noise above which a wrong solution cannot look as good as that (a hop leaves 0.02 of
the light): in a frame that is noisier the scan is never left out."""

_SCAN_PIXELS, _FINE_PIXELS = 520, 1200
_NOISIEST = 8.0
_HIDDEN = 1.0 / 13.0
"""Share of the picture's height below the surface where the contact decides what is seen."""

_STARTS, _LEFT, _KEPT, _HOPPED = 48, 16, 6, 2
"""How many minima go on: from the scan, after a first descent, to the fine pixels, to hop from."""

_STEPS = 4
_APART = np.array([0.02, 0.03, 0.03, 0.1, 0.1, 0.005, 0.005])
"""Distance of two minima: ln P, Q/P, mu, ln k, fringes of bulk stress, widths of the picture."""

WIDEST_LOAD = 4.2
"""Factor in load, either way, that is tried."""

_CONTACT_LOADS, _BODY_LOADS = 24, 96
"""Loads tried: in a contact the far pixels, of low order, keep a basin of 10 %; a disc has none."""

_SHEAR_STEP = 0.2
_MOST_SHEAR = 0.5
"""Largest Q/P that is tried where friction itself is unknown."""

_WEAR = np.geomspace(0.3, 3.3, 5)
_PLACES = np.linspace(-0.075, 0.075, 5)
"""Places tried across, in widths of the picture."""

_BULK_FRINGES = np.arange(-12, 13) / 3.0
_ROWS = 40


@dataclass(frozen=True)
class Search:
    """What a search found: `minima`, by rising chi, their values in the order of its keys.

    `scanned`, False where the scene's own values led to the noise and nothing else was tried.
    """

    minima: tuple[Minimum, ...]
    scanned: bool


def search_frame(data: FrameData, scene: Scene, keys: tuple[str, ...]) -> Search:
    """Find the values that a frame's fringes may have come from.

    Parameters: `data`; `scene`, one state with its place written out: load, wear and friction may
    be far off; `keys`, the unknowns (those that are not in `coarse_fields.THETA` stay as they are).
    Returns a Search. Raises InputError for a key that is no number in the scene, PhysicsError
    where no values give fringes of the right contrast.
    """
    space = _space(scene, keys, data.shape[1])
    own = theta_of(scene)
    pixels = _thinning(data, scene)
    fine = pixels(_FINE_PIXELS)
    near = _with_hops(fine, descend(fine, own[None], space, steps=12), space)
    noisy = (CLEAR / max(float(near.gain[0]), 1e-3)) ** 2
    if near.sound[0] and near.chi[0] <= FOUND_CHI and noisy <= 1.0:
        return Search(_minima(near, scene, keys), scanned=False)
    coarse = pixels(_SCAN_PIXELS)
    rows = starting_rows(own, space, contact=scene.indenter is not None)
    starts = best_of_scan(coarse, rows, space, _STARTS)
    if len(starts):
        first = _distinct(descend(coarse, starts, space, steps=_STEPS), space, _LEFT)
        led = _distinct(descend(coarse, first.theta, space, steps=_STEPS), space, _KEPT)
        if noisy > 1.0:
            fine = pixels(round(_FINE_PIXELS * min(noisy, _NOISIEST)))
            near = descend(fine, near.theta, space, steps=_STEPS)
        result = descend(fine, led.theta, space, steps=_STEPS)
        near = _with_hops(fine, _distinct(near.joined(result), space, _KEPT), space)
    if not np.isfinite(near.chi[0]):
        raise PhysicsError("no_start_gives_positive")
    return Search(_minima(near, scene, keys), scanned=True)


def _space(scene: Scene, keys: tuple[str, ...], width_px: int) -> Space:
    """What of θ is free."""
    values_of(scene, keys)  # numbers, or refused
    free = [i for i, key in enumerate(THETA) if key in keys]
    wear = scene.wear
    if wear is None or not scene.wear_coefficient_at(0.0) or not max(wear.distances_m):
        free = [i for i in free if i != WEAR]
    optics = scene_optics(scene)
    assert scene.camera is not None and scene.camera.pixel_mm is not None
    size = np.ones(len(THETA))
    size[BULK] = optics.fringe_value_n_per_mm / optics.thickness_mm
    size[[LEFT, TOP]] = width_px * scene.camera.pixel_mm
    return Space(np.array(free, dtype=np.intp), size, is_held(scene))


def _thinning(data: FrameData, scene: Scene) -> Callable[[int], SearchPixels]:
    """A function that takes about so many pixels, away from where the model decides the picture."""
    usable = data.valid & fit_region(scene, data.shape, 1, _HIDDEN * data.shape[0])
    if not usable.any():
        raise InputError("no_valid_pixel_below", name=data.name)
    make_field = field_maker(scene)

    def pixels(count: int) -> SearchPixels:
        stride = thinning(int(np.count_nonzero(usable)), count)
        return SearchPixels(data, scene, make_field, usable, stride)

    return pixels


def _with_hops(pixels: SearchPixels, found: Descended, space: Space) -> Descended:
    """Minima and what lies a fringe of bulk stress beside the best of them, by rising chi."""
    hops = bulk_hops(found.theta[:_HOPPED], space)
    if len(hops):
        found = found.joined(descend(pixels, hops, space, steps=_STEPS))
    return _distinct(found, space, len(found.chi))


def _distinct(found: Descended, space: Space, count: int) -> Descended:
    """The best `count` minima that are not next to each other, sound ones first; one at least."""
    apart = (_APART * space.size)[space.free]
    selected: list[int] = []
    for i in found.order:
        if selected and (len(selected) == count or not np.isfinite(found.chi[i])):
            break
        far = np.abs(found.theta[selected] - found.theta[i])[:, space.free] / apart
        if not selected or (far.size and far.max(axis=1).min() > 1.0):
            selected.append(int(i))
    return found.rows(selected)


def _minima(found: Descended, scene: Scene, keys: tuple[str, ...]) -> tuple[Minimum, ...]:
    """The minima as values of the keys."""
    minima: list[Minimum] = []
    for i in found.order:
        if np.isfinite(found.chi[i]) and (not minima or found.sound[i]):
            values = dict(zip(keys, values_of(scene, keys).tolist(), strict=True))
            values |= search_values(found.theta[i], keys)
            minima.append(Minimum(np.array([*values.values()]), float(found.chi[i])))
    return tuple(minima)


def starting_rows(theta: Array, space: Space, *, contact: bool) -> Array:
    """Rows θ (m, 7) over load, shear or friction, wear and place about a scene's; bulk stays."""
    choices = [np.array([value]) for value in theta]
    free = set(space.free.tolist())
    if LOAD in free:
        count = _CONTACT_LOADS if contact else _BODY_LOADS
        choices[LOAD] = theta[LOAD] + np.log(WIDEST_LOAD) * np.linspace(-1.0, 1.0, count)
    if SHEAR in free:
        limit = 0.9 * abs(theta[FRICTION])
        if FRICTION in free:
            limit = max(limit, _MOST_SHEAR)
        choices[SHEAR] = _middles(limit)
    elif FRICTION in free and not space.held:
        choices[FRICTION] = _middles(max(0.6, 1.5 * abs(theta[FRICTION])))
    if WEAR in free:
        choices[WEAR] = theta[WEAR] + np.log(_WEAR)
    if LEFT in free and contact:
        choices[LEFT] = theta[LEFT] + space.size[LEFT] * _PLACES
    return space.allowed(np.array(list(product(*choices))))


def best_of_scan(pixels: SearchPixels, rows: Array, space: Space, count: int) -> Array:
    """The best `count` starts (count, 7) among rows θ (m, 7), each with many bulk stresses."""
    bulks = _BULK_FRINGES * space.size[BULK] if BULK in space.free else np.zeros(1)
    chi = np.concatenate(list(_scanned(pixels, rows, bulks)))
    order = np.argsort(chi, axis=None, kind="stable")[:count]
    order = order[np.isfinite(chi.ravel()[order])]
    row, bulk = np.unravel_index(order, chi.shape)
    starts = rows[row].copy()
    starts[:, BULK] += bulks[bulk]
    return starts


def _scanned(pixels: SearchPixels, rows: Array, bulks: Array) -> Iterator[Array]:
    """chi (some, bulks) of the rows, some at a time: bulk stress only adds to their fields."""
    for first in range(0, len(rows), _ROWS):
        field = pixels.field.difference(rows[first : first + _ROWS])
        chi = np.empty((len(field), len(bulks)))
        for i, bulk in enumerate(bulks):
            chi[:, i] = pixels.misfit(pixels.optics.signal(field + bulk if bulk else field)).chi
        yield chi


def _middles(limit: float) -> Array:
    """Values about zero, to `limit` either way, at the middles of equal steps."""
    count = 2 * max(1, int(np.ceil(limit / _SHEAR_STEP)))
    return limit * (2.0 * np.arange(count) + 1.0 - count) / count
