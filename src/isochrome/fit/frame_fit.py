"""Fit a scene's unknowns to the intensity of one frame, from several starts."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.fit.frame_data import FrameData
from isochrome.fit.intensity import IntensityFit, fit_intensity
from isochrome.fit.renderer import SceneRenderer, safe_signal, with_numerics
from isochrome.fit.starts import Minimum, several_starts
from isochrome.scene import Scene
from isochrome.stress import PixelGrid, pixel_grid

Array = NDArray[Any]

LOAD_FACTORS = (0.8, 0.9, 1.0, 1.1, 1.25)
"""Starts in load; a fit's basin is about 0.8 to 1.1 of the truth."""

PLACE_PX = (-10.0, 0.0, 10.0)
"""Starts in place, in both directions, from the nominal one."""

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


def free_keys(scene: Scene) -> tuple[str, ...]:
    """The unknowns that a single frame of a one-state scene can tell, by default.

    The load and the place; the friction where there is sliding, the tangential load where the
    contact is held, the wear where there is a worn depth.
    """
    keys = ["load.normal_n", "camera.left_mm", "camera.top_mm"]
    if scene.model == "beam":
        keys.remove("camera.left_mm")
    if scene.load is not None and scene.load.tangential_n is not None:
        keys.append("load.tangential_n")
    elif scene.friction is not None:
        keys.append("friction.coefficient")
    if scene.wear is not None:
        keys.append("wear.coefficient_mm2_per_n")
    return tuple(keys)


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
    starts = _starts(coarse, keys, load_factors, place_px)
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


def _search(data: FrameData, scene: Scene, keys: tuple[str, ...], starts: Array) -> Any:
    """The best of several starts on a thinned frame."""
    stride = thinning(data.light.size, _COARSE_PIXELS)
    thin = data.every(stride)
    renderer = SceneRenderer(scene, data.light.shape, stride=stride)
    mask = thin.valid & fit_region(scene, data.light.shape, stride, _HIDDEN_PX)
    return several_starts(
        thin.light,
        lambda values: safe_signal(renderer, _with(scene, keys, values)),
        starts,
        illumination=thin.illumination,
        background=thin.background,
        mask=mask,
        sigma=thin.sigma,
        scale=scales(scene, keys),
        apart=5e-3,
        refine=2,
        tolerance=0.3,
        central=False,
        **bounds(scene, keys),
    )


def _polish(data: FrameData, scene: Scene, keys: tuple[str, ...]) -> IntensityFit:
    """The fit once more, on more pixels and with a finer contact."""
    stride = thinning(data.light.size, _FINE_PIXELS)
    thin = data.every(stride)
    renderer = SceneRenderer(scene, data.light.shape, stride=stride)
    mask = thin.valid & fit_region(scene, data.light.shape, stride, EDGE_PX)
    return fit_intensity(
        thin.light,
        lambda values: safe_signal(renderer, _with(scene, keys, values)),
        [scene.get(key) for key in keys],
        illumination=thin.illumination,
        background=thin.background,
        mask=mask,
        sigma=thin.sigma,
        scale=scales(scene, keys),
        tolerance=0.03,
        central=False,
        **bounds(scene, keys),
    )


def _with(scene: Scene, keys: tuple[str, ...], values: Array) -> Scene:
    return scene.with_values(dict(zip(keys, np.asarray(values).tolist(), strict=True)))


def placed(scene: Scene, shape: tuple[int, ...]) -> Scene:
    """The scene with its picture's place written out."""
    grid = pixel_grid(scene, (shape[0], shape[1]))
    return scene.with_values({"camera.left_mm": grid.left_mm, "camera.top_mm": grid.top_mm})


def thinning(size: int, pixels: int) -> int:
    """Stride that leaves about `pixels` of `size` pixels."""
    return max(1, round((size / pixels) ** 0.5))


def fit_region(scene: Scene, shape: tuple[int, ...], stride: int, hidden_px: float) -> Array:
    """Pixels that a fit uses: away from where the place, or the model, decides what is seen.

    False within `hidden_px` of a contact's surface; in a disc, near the rim and the two loads.
    """
    grid = pixel_grid(scene, (shape[0], shape[1])).every(stride)
    if scene.model == "disc":
        return _disc_inside(scene, grid)
    if scene.model != "contact":
        return np.ones((grid.rows, grid.cols), dtype=bool)
    assert scene.camera is not None and scene.camera.pixel_mm is not None
    below = grid.z_mm >= hidden_px * scene.camera.pixel_mm
    return np.repeat(below[:, None], grid.cols, axis=1)


def _disc_inside(scene: Scene, grid: PixelGrid) -> Array:
    """A disc without its outermost 6 % and without 0.3 R about the loads, which are no points."""
    assert scene.specimen.diameter_mm is not None
    radius = 0.5 * scene.specimen.diameter_mm
    x, z = grid.x_mm[None, :] / radius, grid.z_mm[:, None] / radius - 1.0
    loads = np.minimum(np.hypot(x, z - 1.0), np.hypot(x, z + 1.0))
    return (np.hypot(x, z) < 0.94) & (loads > 0.3)


def _starts(
    scene: Scene, keys: tuple[str, ...], factors: tuple[float, ...], offsets: tuple[float, ...]
) -> Array:
    """All combinations of load factors and place offsets; the rest stays at the scene's values."""
    assert scene.camera is not None and scene.camera.pixel_mm is not None
    pixel = scene.camera.pixel_mm
    choices = []
    for key in keys:
        value = scene.get(key)
        if not isinstance(value, int | float):
            raise InputError(f"{key} = {value!r} cannot be fitted: it is no number in this scene")
        if key == "load.normal_n":
            choices.append([value * factor for factor in factors])
        elif key in ("camera.left_mm", "camera.top_mm"):
            choices.append([value + pixel * offset for offset in offsets])
        else:
            choices.append([float(value)])
    return np.array(list(product(*choices)))


def scales(scene: Scene, keys: tuple[str, ...]) -> Array:
    """A natural change of each unknown, 1e-4 of which is a difference step above its noise."""
    assert scene.camera is not None and scene.camera.pixel_mm is not None
    found = []
    for key in keys:
        value = abs(float(scene.get(key)))
        if key in ("camera.left_mm", "camera.top_mm"):
            found.append(100.0 * scene.camera.pixel_mm)
        elif key == "friction.coefficient":
            found.append(3.0)
        elif key == "load.tangential_n" or key == "load.bulk_mpa":
            assert scene.load is not None
            found.append(max(10.0 * value, scene.load.normal_n if "load.t" in key else 10.0))
        else:
            found.append(10.0 * value if value else 1.0)
    return np.array(found)


def bounds(scene: Scene, keys: tuple[str, ...]) -> dict[str, Any]:
    """Where the search may go: not below zero, not far from the start."""
    low, high = [], []
    for key in keys:
        value = float(scene.get(key))
        if key == "friction.coefficient":
            low.append(-2.0)
            high.append(2.0)
        elif key.startswith("camera.") and key.endswith(("left_mm", "top_mm")):
            low.append(-np.inf)
            high.append(np.inf)
        elif value > 0.0:
            low.append(0.1 * value)
            high.append(10.0 * value)
        else:
            low.append(-np.inf)
            high.append(np.inf)
    return {"lower": np.array(low), "upper": np.array(high)}
