"""The unknowns of a scene: which a frame can tell, where to begin, and what to look at."""

from __future__ import annotations

from math import sqrt

import numpy as np

from isochrome.errors import InputError
from isochrome.estimation import Bounds
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.single_state import is_held
from isochrome.scene import Scene
from isochrome.specimens import specimen_model
from isochrome.stress import pixel_grid

LOAD, FRICTION, WEAR = "load.normal_n", "friction.coefficient", "wear.coefficient_mm2_per_n"
TANGENTIAL = "load.tangential_n"
EARLIER = "friction.earlier_change"
"""Another friction while the block wore: the scar's shape remembers it."""
LEFT, TOP, GAMMA, BLUR = "camera.left_mm", "camera.top_mm", "frames.gamma", "camera.blur_px"

LENS = ("camera.roll_deg", "camera.distortion", "camera.keystone_x", "camera.keystone_z")

SMOOTH_KEYS = (
    "load.bulk_mpa",
    "load.bulk_along_x_mpa_per_mm",
    "load.bulk_along_z_mpa_per_mm",
)
"""A smooth stress besides the contact's, as a block's sides, its support and clamps make: sigma_x
along the surface, its change along it, and bending, the first terms of the series in
`half_plane.regular`. Left out, they go into the load: 0.13 MPa in the paper's block, 0.035 fringe,
read as 1.3 % of load."""

_SCALES = {GAMMA: 10.0, BLUR: 100.0, FRICTION: 3.0, EARLIER: 3.0, LENS[0]: 60.0} | dict.fromkeys(
    LENS[1:], 1.0
)
"""Scales that the values themselves do not tell: of a lens a twentieth of a pixel at its edge."""

_BOUNDS = dict.fromkeys((FRICTION, EARLIER), (-2.0, 2.0))
_BOUNDS |= {GAMMA: (0.2, 5.0), BLUR: (0.0, 50.0), LENS[0]: (-45.0, 45.0)}
_BOUNDS |= dict.fromkeys(LENS[1:], (-0.1, 0.1))

_MICROMETRE = 1e-7
"""Wear coefficient (mm²/N) times distance (m) that wears a micrometre under 10 MPa."""
_LITTLE = 0.01
"""Share of that below which a coefficient says nothing of how far it may change."""

_SIGNED = (LEFT, TOP, TANGENTIAL)
"""Unknowns of either sign, which a start at a small value says nothing of."""


def free_keys(scene: Scene) -> tuple[str, ...]:
    """The unknowns that a single frame of a one-state scene can tell, by default.

    These are the load and the place; the friction where there is sliding, the tangential load where
    the contact is held, the wear where there is a worn depth.

    Parameters
    ----------
    scene : Scene
        One state.

    Returns
    -------
    tuple of str
        Keys of the scene.
    """
    keys = list(specimen_model(scene).unknowns)
    if is_held(scene):
        keys.append(TANGENTIAL)
    elif scene.friction is not None:
        keys.append(FRICTION)
    if scene.wear is not None:
        keys.append(WEAR)
    return tuple(keys)


def values_of(scene: Scene, keys: tuple[str, ...]) -> Array:
    """A scene's values (p,) at some keys. Raises InputError where one is no number."""
    values = [scene.get(key) for key in keys]
    for key, value in zip(keys, values, strict=True):
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{key} = {value!r} cannot be fitted: it is no number in this scene")
    return np.array(values, dtype=float)


def moved_scene(scene: Scene, keys: tuple[str, ...], values: Array) -> Scene:
    """A scene with some values (p,) at its keys."""
    return scene.with_values(dict(zip(keys, np.asarray(values, float).tolist(), strict=True)))


def scales(scene: Scene, keys: tuple[str, ...]) -> Array:
    """A natural change of each unknown, 1e-4 of which is a difference step above its noise."""
    return np.array([_scale(scene, key) for key in keys])


def _scale(scene: Scene, key: str) -> float:
    value = abs(float(scene.get(key)))
    if key in _SCALES:
        return _SCALES[key]
    if key.endswith("_error_deg"):
        return 100.0
    if key in (LEFT, TOP):
        assert scene.camera is not None and scene.camera.pixel_mm is not None
        return 100.0 * scene.camera.pixel_mm
    if key == "camera.pixel_mm":
        return 0.3 * value
    if key == WEAR:
        return 10.0 * max(value, _LITTLE * _visible_wear(scene))
    if key == TANGENTIAL:
        return max(10.0 * value, scene.load_at(0.0))
    if key.startswith("load.bulk"):
        return max(10.0 * value, 10.0)
    return 10.0 * value if value else 1.0


def limits(scene: Scene, keys: tuple[str, ...]) -> Bounds:
    """Where the search may go: not below zero, not far from the start.

    A contact may have stood still until a frame: nothing is worn then, and no start says so.
    """
    ends = np.array([_limit(scene, key) for key in keys]).reshape(-1, 2)
    return Bounds(ends[:, 0], ends[:, 1])


def _limit(scene: Scene, key: str) -> tuple[float, float]:
    value = float(scene.get(key))
    if key == FRICTION and is_held(scene):
        # only what it holds counts: the shear's sign is the tangential force's
        least, most = _BOUNDS[key]
        return (0.0, most) if value >= 0.0 else (least, 0.0)
    if key in _BOUNDS:
        return _BOUNDS[key]
    if key.endswith("_error_deg"):
        return -45.0, 45.0
    if key == WEAR:
        return 0.0, 10.0 * max(value, _visible_wear(scene))
    if value <= 0.0 or key in _SIGNED or key.startswith("load.bulk"):
        return -np.inf, np.inf
    return 0.1 * value, 10.0 * value


def _visible_wear(scene: Scene) -> float:
    """A wear coefficient (mm²/N) that a frame would show at the scene's last distance."""
    slid = max(scene.wear.distances_m) if scene.wear else 0.0
    return _MICROMETRE / slid if slid > 0.0 else 0.0


def fit_region(scene: Scene, shape: tuple[int, int], stride: int, hidden_px: float) -> Array:
    """Pixels that a fit uses: away from where the place, or the model, decides what is seen.

    False within `hidden_px` of a contact's surface; else where the specimen's model says so.
    """
    full_frame = pixel_grid(scene, shape)
    grid = full_frame.every(stride)
    trusted = specimen_model(scene).trusted(scene, grid, hidden_px * full_frame.pixel_mm)
    return np.array(np.broadcast_to(trusted, (grid.rows, grid.cols)))


def thinning(size: int, pixels: int) -> int:
    """Stride that leaves about `pixels` of `size` pixels."""
    return max(1, round(sqrt(size / pixels)))
