"""Fit a scene's unknowns to the intensity of one frame, wherever the scene starts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError, PhysicsError
from isochrome.fit.frame_data import FrameData
from isochrome.fit.local import BLUR, GAMMA, FrameModel
from isochrome.fit.one_state import with_numerics, with_own_numerics
from isochrome.fit.polish import Polished, block_correlation, covariance, polish
from isochrome.fit.search import CLEAR, search_frame
from isochrome.fit.starts import Minimum
from isochrome.fit.unknowns import fit_region, free_keys
from isochrome.scene import Scene
from isochrome.stress import pixel_grid

Array = NDArray[Any]

_NEAR_PIXELS = 9_000
_HIDDEN_PX, _ROOM_PX = 14.0, 10.0
EDGE_PX = 0.75
"""Depth above which no pixel is fitted: there the surface's place decides what is seen."""

_CLOSE_CHI = 1.15
"""Residual over noise of the coarse model, on few pixels, below which a start was the right one."""

_SENSOR = (GAMMA, BLUR)
"""Unknowns that no start is scanned in: they hardly move a fringe."""

_LEAST_BLUR_PX = 0.7
"""Where a free blur starts at least: from none it has no slope."""

_RIVAL = 1.3
_RIVALS = 3
"""Minima of the search that its quick model cannot tell apart: within a factor in chi, the best."""

_CHANCE = 100.0
"""Wald's statistic of an illumination that noise alone does not reach: it leaves up to 21 where
values are searched for (18 frames), and fringes of a single grey level in 20 000 pixels 384."""

_GAMMAS = (1.0, 2.2)
"""Where an unknown exponent starts: a sensor's own, and most photographs'."""


@dataclass(frozen=True)
class FrameFit:
    """What one frame says of its scene.

    `scene` with the fitted values; `keys` and their `values`, `standard_uncertainty` (p,),
    `covariance` (p, p), and `cramer_rao_bound` (p,), the least that noise like this frame's allows,
    from the `information` (p, p) of its pixels; `freedom`, pixels less unknowns; `chi` = residual
    over noise; `others`, other minima by rising chi; `converged`; `plain`, True
    where a free illumination came out negative and one amplitude for all the frame had to do: the
    model is poor then; `positive`, False where even that is negative: the scene's fringes are not
    in the frame, nor any light that follows them by more than noise does by chance.
    """

    scene: Scene
    keys: tuple[str, ...]
    values: Array
    standard_uncertainty: Array
    covariance: Array
    cramer_rao_bound: Array
    information: Array
    freedom: int
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
    cold: bool = True,
) -> FrameFit:
    """Fit the unknowns of a one-state scene to one frame.

    First from the scene's own values on a thinned frame with a coarse contact; where that does not
    describe the frame, the search of `isochrome.fit.search`, over a factor of four in load. Then
    every trusted pixel is fitted with a fine contact. An unknown frames.gamma is an unknown more.
    Parameters: `data`; `scene`, one state (see `frame_scene`), where the fit starts; `keys`, the
    unknowns (None: `free_keys`); `cold`, False to search only where the scene's own values lead to
    no light at all. Returns a FrameFit. Raises InputError for a key that cannot be free,
    PhysicsError where no values give fringes of the right contrast.
    """
    keys = free_keys(scene) if keys is None else keys
    scene = placed(scene, data.light.shape)
    if BLUR in keys and scene.get(BLUR) < _LEAST_BLUR_PX:
        scene = scene.with_values({BLUR: _LEAST_BLUR_PX})
    known = scene.frames.gamma
    if isinstance(known, str) and GAMMA not in keys:
        keys = (*keys, GAMMA)
    if GAMMA not in keys:
        return _fit_begun(data, scene, keys, cold)
    best: FrameFit | None = None
    for gamma in dict.fromkeys((*([] if isinstance(known, str) else [known]), *_GAMMAS)):
        fit = _fit_begun(data.toned(gamma), scene.with_values({GAMMA: gamma}), keys, cold)
        if best is None or (fit.positive, -fit.chi) > (best.positive, -best.chi):
            best = fit
        if best.positive and best.chi <= _CLOSE_CHI:
            break
    assert best is not None
    return best


def _fit_begun(data: FrameData, scene: Scene, keys: tuple[str, ...], cold: bool) -> FrameFit:
    """The fit from one scene's start, and others about it."""
    others: tuple[Minimum, ...] = ()
    near = _coarse(data, scene, keys)
    if near is not None and (not cold or (near.chi <= _CLOSE_CHI and near.clear)):
        best = near.scene
    else:
        best, others = _searched(data, scene, keys)
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
        final.local.normal,
        freedom,
        float(np.sqrt(final.toned.cost / freedom)),
        others,
        final.converged and bool(told.all()),
        plain,
        final.toned.part.positive and _is_seen(model, final),
    )


def _is_seen(model: FrameModel, final: Polished) -> bool:
    """Whether more light follows the fringes than noise alone does where they are searched for.

    By Wald's statistic of the illumination, aᵀ cov(a)⁻¹ a, over the noise that the residuals show.
    """
    part, residual = final.toned.part, final.toned.residual
    count = len(model.pixels.light)
    light = part.coefficients[:count]
    gain = float(light @ np.linalg.pinv(part.inverse[:count, :count]) @ light)
    noise = max(1.0, final.toned.cost / residual.size)
    return gain > _CHANCE * noise * max(1.0, block_correlation(model.pixels.keep, residual))


@dataclass(frozen=True)
class _Coarse:
    """Where a coarse fit led: `scene`, `values` (p,), `chi`; `clear`, light well above noise."""

    scene: Scene
    values: Array
    chi: float
    clear: bool


def _coarse(data: FrameData, scene: Scene, keys: tuple[str, ...]) -> _Coarse | None:
    """The fit from a scene's own values to few pixels; None where the light comes out negative."""
    shape = (data.light.shape[0], data.light.shape[1])
    stride = thinning(data.light.size, _NEAR_PIXELS)
    region = fit_region(scene, shape, stride, _HIDDEN_PX)
    coarse = with_numerics(scene, nodes_per_pixel=1, tolerance=1e-2, room=1.4)
    assert scene.camera is not None
    sharp = scene.camera.blur_px == 0.0 and BLUR not in keys
    model = FrameModel(
        data, coarse, keys, region, stride=stride, hidden_px=_HIDDEN_PX - _ROOM_PX, rough=sharp
    )
    found = polish(model, values_of(scene, keys), tolerance=0.5, iterations=12)
    if found is None or not found.toned.part.positive:
        return None
    return _Coarse(
        _with(scene, keys, found.values),
        found.values,
        float(np.sqrt(found.toned.cost / model.pixels.size)),
        bool(np.mean(found.toned.part.amplitude) >= CLEAR),
    )


def _searched(
    data: FrameData, scene: Scene, keys: tuple[str, ...]
) -> tuple[Scene, tuple[Minimum, ...]]:
    """The scene that a search leads to, and the other minima by rising chi."""
    scanned = tuple(key for key in keys if key not in _SENSOR)
    minima = search_frame(data, scene, scanned).minima
    first = _with(scene, scanned, minima[0].values)
    minima = tuple(Minimum(values_of(_with(scene, scanned, m.values), keys), m.chi) for m in minima)
    rivals = [m for m in minima if m.chi <= _RIVAL * minima[0].chi][:_RIVALS]
    if len(rivals) == 1:
        return first, minima[1:]
    refined = [_coarse(data, _with(scene, keys, m.values), keys) for m in rivals]
    found = sorted((r for r in refined if r is not None), key=lambda r: r.chi)
    if not found:
        return first, minima[1:]
    others = [Minimum(r.values, r.chi) for r in found[1:]]
    others += [m for m in minima if m.chi > _RIVAL * minima[0].chi]
    return found[0].scene, tuple(others)


def _final(data: FrameData, scene: Scene, keys: tuple[str, ...]) -> tuple[FrameModel, Polished]:
    """Every trusted pixel, a fine contact, derivatives where the search ended."""
    shape = (data.light.shape[0], data.light.shape[1])
    start = values_of(scene, keys)
    model = FrameModel(data, scene, keys, fit_region(scene, shape, 1, EDGE_PX))
    toned = model.keep_clear(start)
    assert scene.camera is not None
    if toned is not None and (scene.camera.blur_px > 0.0 or BLUR in keys):
        model.follow_light(data, toned)
        toned = model.at(start, near=toned.model)
    final = polish(model, start, toned=toned)
    if final is None:
        raise PhysicsError(
            f"{data.name}: the scene cannot be solved where its search ended; give closer values"
        )
    return model, _better_side(model, final)


def _better_side(model: FrameModel, final: Polished) -> Polished:
    """The fit, or the one with plates turned to the other side, which nearly mirrors it."""
    plates = [j for j, key in enumerate(model.keys) if key.endswith("plate_error_deg")]
    if not plates:
        return final
    other = final.values.copy()
    other[plates] *= -1.0
    turned = polish(model, other)
    return final if turned is None or turned.toned.cost > final.toned.cost else turned


def values_of(scene: Scene, keys: tuple[str, ...]) -> Array:
    """A scene's values (p,) at some keys. Raises InputError where one is no number."""
    found = [scene.get(key) for key in keys]
    for key, value in zip(keys, found, strict=True):
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{key} = {value!r} cannot be fitted: it is no number in this scene")
    return np.array(found, dtype=float)


def _with(scene: Scene, keys: tuple[str, ...], values: Array) -> Scene:
    return scene.with_values(dict(zip(keys, np.asarray(values).tolist(), strict=True)))


def placed(scene: Scene, shape: tuple[int, ...]) -> Scene:
    """The scene with its picture's place written out; `shape` (rows, cols) of a frame.

    Raises InputError where the scene's camera has other pixels.
    """
    grid = pixel_grid(scene, (shape[0], shape[1]))
    if (grid.rows, grid.cols) != (shape[0], shape[1]):
        raise InputError(
            f"{scene.name}: the frames, or their frames.roi, are {shape[0]} x {shape[1]} pixels, "
            f"and the scene's camera {grid.rows} x {grid.cols}; correct camera.height_px and "
            "width_px, or frames.roi"
        )
    return scene.with_values({"camera.left_mm": grid.left_mm, "camera.top_mm": grid.top_mm})


def thinning(size: int, pixels: int) -> int:
    """Stride that leaves about `pixels` of `size` pixels."""
    return max(1, round((size / pixels) ** 0.5))
