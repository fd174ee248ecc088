"""Fit a scene's unknowns to the intensity of one frame, from several starts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.frame_data import FrameData
from isochrome.fit.intensity import IntensityFit, Response, fit_intensity
from isochrome.fit.one_state import with_numerics
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

_COARSE_PIXELS = 20_000
_FINE_PIXELS = 90_000
_HIDDEN_PX = 14.0
EDGE_PX = 2.0


@dataclass(frozen=True)
class FrameFit:
    """What one frame says of its scene.

    `scene` with the fitted values; `keys` and their `values`, `standard_uncertainty` (p,),
    `covariance` (p, p); `chi` = residual over noise; `others`, other minima by rising chi;
    `converged`; `plain`, True where a free illumination came out negative and one amplitude for
    all the frame had to do: the model is poor then; `positive`, False where even that is negative:
    the scene's fringes are not in the frame.
    """

    scene: Scene
    keys: tuple[str, ...]
    values: Array
    standard_uncertainty: Array
    covariance: Array
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

    Several starts in load and place are scanned on a thinned frame with a coarse contact; the best
    few are refined; the winner is fitted again with the fine one.
    Parameters: `data`; `scene`, one state (see `frame_scene`), where the fit starts; `keys`, the
    unknowns (None: `free_keys`). Returns a FrameFit. Raises InputError for a key that cannot be
    free, PhysicsError where no start gives fringes of the right contrast.
    """
    keys = free_keys(scene) if keys is None else keys
    scene = placed(scene, data.light.shape)
    coarse = with_numerics(scene, nodes_per_pixel=1, tolerance=1e-2, room=1.4)
    starts = starting_points(coarse, keys, load_factors, place_px)
    first = _search(data.plain(), coarse, keys, starts)
    best = coarse.with_values(dict(zip(keys, first.best.values.tolist(), strict=True)))
    fine = best.model_copy(update={"numerics": scene.numerics})
    fine = with_numerics(fine, nodes_per_pixel=3, tolerance=3e-4, room=1.2)
    final = _polish(data, fine, keys)
    plain = not final.positive
    if plain:
        final = _polish(data.plain(), fine, keys)
    values = dict(zip(keys, final.values.tolist(), strict=True))
    fitted = fine.with_values(values).model_copy(update={"numerics": scene.numerics})
    return FrameFit(
        fitted,
        keys,
        final.values,
        final.standard_uncertainty,
        final.covariance,
        final.chi,
        first.others,
        final.converged,
        plain,
        final.positive,
    )


def _search(data: FrameData, scene: Scene, keys: tuple[str, ...], starts: Array) -> SeveralStarts:
    """The best of several starts on a thinned frame."""
    light, response, options = _problem(data, scene, keys, _COARSE_PIXELS, _HIDDEN_PX)
    return several_starts(
        light, response, starts, apart=5e-3, refine=2, tolerance=0.3, central=False, **options
    )


def _polish(data: FrameData, scene: Scene, keys: tuple[str, ...]) -> IntensityFit:
    """The fit once more, on more pixels and with a finer contact."""
    light, response, options = _problem(data, scene, keys, _FINE_PIXELS, EDGE_PX)
    start = [scene.get(key) for key in keys]
    return fit_intensity(light, response, start, tolerance=0.03, central=False, **options)


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
