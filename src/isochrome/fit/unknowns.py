"""The unknowns of a scene: which a frame can tell, where to begin, and what to look at."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.scene import Scene
from isochrome.stress import PixelGrid, pixel_grid

Array = NDArray[Any]

_SCALES = {"frames.gamma": 10.0, "camera.blur_px": 100.0}
"""Scales that the values themselves do not tell."""

_BOUNDS = {
    "friction.coefficient": (-2.0, 2.0),
    "frames.gamma": (0.2, 5.0),
    "camera.blur_px": (0.0, 50.0),
}

_WEAR = "wear.coefficient_mm2_per_n"
_MICROMETRE = 1e-7
"""Wear coefficient (mm²/N) times distance (m) that wears a micrometre under 10 MPa."""
_LITTLE = 0.01
"""Share of that below which a coefficient says nothing of how far it may change."""

_SIGNED = ("camera.left_mm", "camera.top_mm", "load.tangential_n")
"""Unknowns of either sign, which a start at a small value says nothing of."""


def free_keys(scene: Scene) -> tuple[str, ...]:
    """The unknowns that a single frame of a one-state scene can tell, by default.

    The load and the place; the friction where there is sliding, the tangential load where the
    contact is held, the wear where there is a worn depth.
    """
    keys = ["load.normal_n", "camera.left_mm", "camera.top_mm"]
    if scene.model == "beam":
        keys.remove("camera.left_mm")
    if _is_held(scene):
        keys.append("load.tangential_n")
    elif scene.friction is not None:
        keys.append("friction.coefficient")
    if scene.wear is not None:
        keys.append("wear.coefficient_mm2_per_n")
    return tuple(keys)


def scales(scene: Scene, keys: tuple[str, ...]) -> Array:
    """A natural change of each unknown, 1e-4 of which is a difference step above its noise."""
    assert scene.camera is not None and scene.camera.pixel_mm is not None
    found = []
    for key in keys:
        value = abs(float(scene.get(key)))
        if key in ("camera.left_mm", "camera.top_mm"):
            found.append(100.0 * scene.camera.pixel_mm)
        elif key in _SCALES:
            found.append(_SCALES[key])
        elif key.endswith("_error_deg"):
            found.append(100.0)
        elif key == "camera.pixel_mm":
            found.append(0.3 * value)
        elif key == "friction.coefficient":
            found.append(3.0)
        elif key == _WEAR:
            found.append(10.0 * max(value, _LITTLE * _visible_wear(scene)))
        elif key == "load.tangential_n" or key.startswith("load.bulk"):
            found.append(max(10.0 * value, scene.load_at(0.0) if "load.t" in key else 10.0))
        else:
            found.append(10.0 * value if value else 1.0)
    return np.array(found)


def bounds(scene: Scene, keys: tuple[str, ...]) -> dict[str, Any]:
    """Where the search may go: not below zero, not far from the start.

    A contact may have stood still until a frame: nothing is worn then, and no start says so.
    """
    low, high = [], []
    for key in keys:
        value = float(scene.get(key))
        if key in _BOUNDS or key.endswith("_error_deg"):
            least, most = _BOUNDS.get(key, (-45.0, 45.0))
            if key == "friction.coefficient" and _is_held(scene):
                # only what it holds counts: the shear's sign is the tangential force's
                least, most = (0.0, most) if value >= 0.0 else (least, 0.0)
            low.append(least)
            high.append(most)
        elif key in _SIGNED or key.startswith("load.bulk"):
            low.append(-np.inf)
            high.append(np.inf)
        elif key == _WEAR:
            low.append(0.0)
            high.append(10.0 * max(value, _visible_wear(scene)))
        elif value > 0.0:
            low.append(0.1 * value)
            high.append(10.0 * value)
        else:
            low.append(-np.inf)
            high.append(np.inf)
    return {"lower": np.array(low), "upper": np.array(high)}


def _visible_wear(scene: Scene) -> float:
    """A wear coefficient (mm²/N) that a frame would show at the scene's last distance."""
    slid = max(scene.wear.distances_m) if scene.wear else 0.0
    return _MICROMETRE / slid if slid > 0.0 else 0.0


def _is_held(scene: Scene) -> bool:
    return scene.load is not None and scene.load.tangential_n is not None


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
