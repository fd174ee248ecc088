"""A cold start: from a frame and a scene whose values are far off to the basin of the truth.

The basin of an intensity fit is only 0.8 to 1.1 of the load. Here a quick model of the same scene
(`isochrome.fit.search_field`) is held against some hundred pixels at thousands of values, the best
few descend side by side, and their rivals a fringe of bulk stress away are tried as well. A scene
whose own values lead to the noise is taken at its word, and nothing else is tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError, PhysicsError
from isochrome.fit.frame_data import FrameData
from isochrome.fit.search_descent import Descended, Space, bulk_hops, descend
from isochrome.fit.search_field import (
    BULK,
    LEFT,
    THETA,
    TOP,
    WEAR,
    field_maker,
    theta_of,
    values_of,
)
from isochrome.fit.search_grid import best_of_scan, starting_rows
from isochrome.fit.search_pixels import SearchPixels
from isochrome.fit.starts import Minimum
from isochrome.fit.unknowns import fit_region
from isochrome.scene import Scene

Array = NDArray[Any]

FOUND_CHI = 1.1
"""Residual over noise at which a search has arrived."""

CLEAR = 25.0
"""Light over noise above which a wrong basin cannot look as good as that (a hop leaves 0.02 of the
light): in a frame that is noisier the scan is never left out."""

_SCAN_PIXELS, _FINE_PIXELS = 520, 1200
_NOISIEST = 8.0
_HIDDEN = 1.0 / 13.0
"""Share of the picture's height below the surface where the contact decides what is seen."""

_STARTS, _LEFT, _KEPT, _HOPPED = 48, 16, 6, 2
"""How many minima go on: from the scan, after a first descent, to the fine pixels, to hop from."""

_STEPS = 4
_APART = np.array([0.02, 0.03, 0.03, 0.1, 0.1, 0.005, 0.005])
"""Distance of two minima: ln P, Q/P, mu, ln k, fringes of bulk stress, widths of the picture."""


@dataclass(frozen=True)
class Search:
    """What a search found: `minima`, by rising chi, their values in the order of `keys`.

    `scanned`, False where the scene's own values led to the noise and nothing else was tried.
    """

    keys: tuple[str, ...]
    minima: tuple[Minimum, ...]
    scanned: bool


def search_frame(data: FrameData, scene: Scene, keys: tuple[str, ...]) -> Search:
    """Find the values that a frame's fringes may have come from.

    Parameters: `data`; `scene`, one state with its place written out: load, wear and friction may
    be far off; `keys`, the unknowns (those that are not in `search_field.THETA` stay as they are).
    Returns a Search. Raises InputError for a key that is no number in the scene, PhysicsError
    where no values give fringes of the right contrast.
    """
    space = _space(scene, keys, data.light.shape[1])
    own = theta_of(scene)
    pixels = _thinning(data, scene)
    fine = pixels(_FINE_PIXELS)
    near = _with_hops(fine, descend(fine, own[None], space, steps=12), space)
    noisy = (CLEAR / max(float(near.gain[0]), 1e-3)) ** 2
    if near.sound[0] and near.chi[0] <= FOUND_CHI and noisy <= 1.0:
        return Search(keys, _minima(near, scene, keys), scanned=False)
    coarse = pixels(_SCAN_PIXELS)
    rows = starting_rows(own, space, contact=scene.model == "contact")
    starts = best_of_scan(coarse, rows, space, _STARTS)
    if len(starts):
        first = _distinct(descend(coarse, starts, space, steps=_STEPS), space, _LEFT)
        led = _distinct(descend(coarse, first.theta, space, steps=_STEPS), space, _KEPT)
        if noisy > 1.0:
            fine = pixels(round(_FINE_PIXELS * min(noisy, _NOISIEST)))
            near = descend(fine, near.theta, space, steps=_STEPS)
        found = descend(fine, led.theta, space, steps=_STEPS)
        near = _with_hops(fine, _distinct(near.joined(found), space, _KEPT), space)
    if not np.isfinite(near.chi[0]):
        raise PhysicsError(
            "no start gives a positive illumination; is the field (dark or bright) the right one?"
        )
    return Search(keys, _minima(near, scene, keys), scanned=True)


def _space(scene: Scene, keys: tuple[str, ...], width_px: int) -> Space:
    """What of θ is free."""
    for key in keys:
        if not isinstance(scene.get(key), int | float):
            raise InputError(
                f"{key} = {scene.get(key)!r} cannot be fitted: it is no number in this scene"
            )
    free = [i for i, key in enumerate(THETA) if key in keys]
    wear = scene.wear
    if wear is None or not scene.wear_coefficient_at(0.0) or not max(wear.distances_m):
        free = [i for i in free if i != WEAR]
    specimen, camera = scene.specimen, scene.camera
    assert specimen.thickness_mm is not None and specimen.fringe_value_n_per_mm is not None
    assert camera is not None and camera.pixel_mm is not None
    size = np.ones(len(THETA))
    size[BULK] = specimen.fringe_value_n_per_mm / specimen.thickness_mm
    size[[LEFT, TOP]] = width_px * camera.pixel_mm
    held = scene.load is not None and scene.load.tangential_n is not None
    return Space(np.array(free, dtype=np.intp), size, held)


def _thinning(data: FrameData, scene: Scene) -> Callable[[int], SearchPixels]:
    """A function that takes about so many pixels, away from where the model decides the picture."""
    shape = (data.light.shape[0], data.light.shape[1])
    usable = data.valid & fit_region(scene, shape, 1, _HIDDEN * shape[0])
    if not usable.any():
        raise InputError(f"{data.name}: no valid pixel below the contact; check the mask and place")
    make_field = field_maker(scene)

    def pixels(count: int) -> SearchPixels:
        stride = max(1, round((np.count_nonzero(usable) / count) ** 0.5))
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
    kept: list[int] = []
    for i in found.order:
        if kept and (len(kept) == count or not np.isfinite(found.chi[i])):
            break
        far = np.abs(found.theta[kept] - found.theta[i])[:, space.free] / apart
        if not kept or (far.size and far.max(axis=1).min() > 1.0):
            kept.append(int(i))
    return found.rows(kept)


def _minima(found: Descended, scene: Scene, keys: tuple[str, ...]) -> tuple[Minimum, ...]:
    """The minima as values of the keys."""
    minima: list[Minimum] = []
    for i in found.order:
        if np.isfinite(found.chi[i]) and (not minima or found.sound[i]):
            values = {key: float(scene.get(key)) for key in keys}
            values |= values_of(found.theta[i], keys)
            minima.append(Minimum(np.array([*values.values()]), float(found.chi[i])))
    return tuple(minima)
