"""Fit a scene's unknowns to the intensity of one frame, from several starts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError, PhysicsError
from isochrome.fit.frame_data import FrameData
from isochrome.fit.intensity import Response
from isochrome.fit.local import GAMMA, FrameModel
from isochrome.fit.one_state import with_numerics, with_own_numerics
from isochrome.fit.polish import Polished, covariance, polish
from isochrome.fit.renderer import SceneRenderer, safe_signal
from isochrome.fit.starts import Minimum, SeveralStarts, several_starts
from isochrome.fit.unknowns import (
    LOAD_FACTORS,
    PLACE_PX,
    bounds,
    fit_region,
    free_keys,
    scales,
    starting_points,
)
from isochrome.scene import Scene
from isochrome.stress import pixel_grid

Array = NDArray[Any]

_NEAR_PIXELS = 9_000
_COARSE_PIXELS = 20_000
_HIDDEN_PX = 14.0
EDGE_PX = 2.0

_CLOSE_CHI = 1.15
"""Residual over noise of the coarse model, on few pixels, below which a start was the right one."""

_SENSOR = (GAMMA, "camera.blur_px")
"""Unknowns that no start is scanned in: they hardly move a fringe."""

_GAMMAS = (1.0, 2.2)
"""Where an unknown exponent starts: a sensor's own, and most photographs'."""


@dataclass(frozen=True)
class FrameFit:
    """What one frame says of its scene.

    `scene` with the fitted values; `keys` and their `values`, `standard_uncertainty` (p,),
    `covariance` (p, p), and `cramer_rao_bound` (p,), the least that noise like this frame's allows;
    `chi` = residual over noise; `others`, other minima by rising chi; `converged`; `plain`, True
    where a free illumination came out negative and one amplitude for all the frame had to do: the
    model is poor then; `positive`, False where even that is negative: the scene's fringes are not
    in the frame.
    """

    scene: Scene
    keys: tuple[str, ...]
    values: Array
    standard_uncertainty: Array
    covariance: Array
    cramer_rao_bound: Array
    chi: float
    others: tuple[Minimum, ...]
    converged: bool
    plain: bool
    positive: bool


def fit_frame(
    data: FrameData,
    scene: Scene,
    keys: tuple[str, ...] | None = None,
    *,
    load_factors: tuple[float, ...] = LOAD_FACTORS,
    place_px: tuple[float, ...] = PLACE_PX,
) -> FrameFit:
    """Fit the unknowns of a one-state scene to one frame.

    First from the scene's own values on a thinned frame with a coarse contact; where that does not
    describe the frame, several starts in load and place are scanned and the best few refined. Then
    every trusted pixel is fitted with a fine contact. An unknown frames.gamma is an unknown more.
    Parameters: `data`; `scene`, one state (see `frame_scene`), where the fit starts; `keys`, the
    unknowns (None: `free_keys`); `load_factors`, `place_px`, the starts of the search. Returns a
    FrameFit. Raises InputError for a key that cannot be free,
    PhysicsError where no start gives fringes of the right contrast.
    """
    keys = free_keys(scene) if keys is None else keys
    scene = placed(scene, data.light.shape)
    if isinstance(scene.frames.gamma, str):
        keys = keys if GAMMA in keys else (*keys, GAMMA)
        toned = [scene.with_values({GAMMA: gamma}) for gamma in _GAMMAS]
    else:
        toned = [scene]
    if GAMMA in keys:
        fits = [
            _fit_begun(data.toned(s.frames.stated_gamma), s, keys, load_factors, place_px)
            for s in toned
        ]
        return min(fits, key=lambda fit: fit.chi if fit.positive else np.inf)
    return _fit_begun(data, scene, keys, load_factors, place_px)


def _fit_begun(
    data: FrameData,
    scene: Scene,
    keys: tuple[str, ...],
    load_factors: tuple[float, ...],
    place_px: tuple[float, ...],
) -> FrameFit:
    """The fit from one scene's start, and others about it."""
    coarse = with_numerics(scene, nodes_per_pixel=1, tolerance=1e-2, room=1.4)
    others: tuple[Minimum, ...] = ()
    best = _near(data, coarse, keys)
    if best is None:
        scanned = tuple(key for key in keys if key not in _SENSOR)
        starts = starting_points(coarse, scanned, load_factors, place_px)
        first = _search(data.plain(), coarse, scanned, starts)
        best, others = _with(coarse, scanned, first.best.values), first.others
    fine = with_own_numerics(best.model_copy(update={"numerics": scene.numerics}))
    model, final = _final(data, fine, keys)
    plain = not final.toned.part.positive
    if plain:
        model, final = _final(data.plain(), fine, keys)
    fitted = _with(fine, keys, final.values).model_copy(update={"numerics": scene.numerics})
    bound, told = final.local.bound, final.local.determined
    spread = covariance(model, final)
    freedom = max(1, model.pixels.size - len(keys) - len(final.toned.part.coefficients))
    return FrameFit(
        fitted,
        keys,
        final.values,
        np.where(told, np.sqrt(np.maximum(np.diag(spread), 0.0)), np.inf),
        spread,
        bound,
        float(np.sqrt(final.toned.cost / freedom)),
        others,
        final.converged and bool(told.all()),
        plain,
        final.toned.part.positive,
    )


def _near(data: FrameData, scene: Scene, keys: tuple[str, ...]) -> Scene | None:
    """The scene that the fit from its own values leads to, None where that is not the frame's."""
    shape = (data.light.shape[0], data.light.shape[1])
    stride = thinning(data.light.size, _NEAR_PIXELS)
    region = fit_region(scene, shape, stride, _HIDDEN_PX)
    model = FrameModel(data, scene, keys, region, stride=stride)
    found = polish(model, values_of(scene, keys), tolerance=0.5, iterations=12)
    if found is None or not found.toned.part.positive:
        return None
    close = found.toned.cost <= _CLOSE_CHI**2 * model.pixels.size
    return _with(scene, keys, found.values) if close else None


def _final(data: FrameData, scene: Scene, keys: tuple[str, ...]) -> tuple[FrameModel, Polished]:
    """Every trusted pixel, a fine contact, derivatives where the search ended."""
    shape = (data.light.shape[0], data.light.shape[1])
    start = values_of(scene, keys)
    model = FrameModel(data, scene, keys, fit_region(scene, shape, 1, EDGE_PX))
    model.keep_clear(start)
    final = polish(model, start)
    if final is None:
        raise PhysicsError(
            f"{data.name}: the scene cannot be solved where its search ended; give closer values"
        )
    return model, final


def values_of(scene: Scene, keys: tuple[str, ...]) -> Array:
    """A scene's values (p,) at some keys. Raises InputError where one is no number."""
    found = [scene.get(key) for key in keys]
    for key, value in zip(keys, found, strict=True):
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{key} = {value!r} cannot be fitted: it is no number in this scene")
    return np.array(found, dtype=float)


def _search(data: FrameData, scene: Scene, keys: tuple[str, ...], starts: Array) -> SeveralStarts:
    """The best of several starts on a thinned frame."""
    light, response, options = _problem(data, scene, keys, _COARSE_PIXELS, _HIDDEN_PX)
    return several_starts(
        light, response, starts, apart=5e-3, refine=2, tolerance=0.3, central=False, **options
    )


def _problem(
    data: FrameData, scene: Scene, keys: tuple[str, ...], pixels: int, hidden_px: float
) -> tuple[Array, Response, dict[str, Any]]:
    """A thinned frame's light, the response to the unknowns, and the rest of a fit's arguments."""
    stride = thinning(data.light.size, pixels)
    thin = data.every(stride)
    renderer = SceneRenderer(scene, data.light.shape, stride=stride)
    options = {
        "illumination": thin.illumination,
        "background": thin.background,
        "mask": thin.valid & fit_region(scene, data.light.shape, stride, hidden_px),
        "sigma": thin.sigma,
        "scale": scales(scene, keys),
        **bounds(scene, keys),
    }
    return thin.light, lambda values: safe_signal(renderer, _with(scene, keys, values)), options


def _with(scene: Scene, keys: tuple[str, ...], values: Array) -> Scene:
    return scene.with_values(dict(zip(keys, np.asarray(values).tolist(), strict=True)))


def placed(scene: Scene, shape: tuple[int, ...]) -> Scene:
    """The scene with its picture's place written out."""
    grid = pixel_grid(scene, (shape[0], shape[1]))
    return scene.with_values({"camera.left_mm": grid.left_mm, "camera.top_mm": grid.top_mm})


def thinning(size: int, pixels: int) -> int:
    """Stride that leaves about `pixels` of `size` pixels."""
    return max(1, round((size / pixels) ** 0.5))
