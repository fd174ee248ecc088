"""The unknowns of a scene, and what it states of its measured numbers: priors, or inputs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

from isochrome.errors import InputError
from isochrome.estimation import Bounds, Prior
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.single_state import is_held
from isochrome.scene import Scene
from isochrome.specimens import specimen_model
from isochrome.stress import pixel_grid

LOAD, FRICTION, WEAR = "load.normal_n", "friction.coefficient", "wear.coefficient_mm2_per_n"
TANGENTIAL = "load.tangential_n"
EARLIER = "friction.earlier_change"
"""Another friction while the block wore: the scar's shape remembers it."""
BETWEEN = LAYER, ROUGHNESS = "contact.layer_um_per_mpa", "contact.roughness_um"
LEAST_BETWEEN = 1e-3
"""The least of these that is fitted where there is wear, in their units: a bare contact wears on a
mesh of its own, to which no difference may be taken."""
PLANE = "specimen.plane_stress_share"
FOCUS, SWING, TILT = "camera.focus_mm", "load.swing", "load.tilt"
EDGE = EDGE_STRESS, EDGE_DEPTH = "specimen.edge_stress_mpa", "specimen.edge_depth_mm"
LEFT, TOP, GAMMA, BLUR = "camera.left_mm", "camera.top_mm", "frames.gamma", "camera.blur_px"

LENS = ("camera.roll_deg", "camera.distortion", "camera.keystone_x", "camera.keystone_z")
_ROLL, *_BENT = LENS
BULK = "load.bulk_mpa"

SMOOTH_KEYS = (BULK, "load.bulk_along_x_mpa_per_mm", "load.bulk_along_z_mpa_per_mm")
"""A smooth stress besides the contact's, as a block's sides, its support and clamps make: sigma_x
along the surface, its change along it, and bending, the first terms of the series in
`half_plane.regular`. Left out, they go into the load: 0.13 MPa in the paper's block, 0.035 fringe,
read as 1.3 % of load."""

_SCALES = {_ROLL: 60.0} | dict.fromkeys((BLUR, FOCUS, SWING, TILT), 100.0)
"""Scales that the values themselves do not tell: of a lens a twentieth of a pixel at its edge."""

_BOUNDS = dict.fromkeys((FRICTION, EARLIER), (-2.0, 2.0))
_BOUNDS |= {GAMMA: (0.2, 5.0), BLUR: (0.0, 50.0), _ROLL: (-45.0, 45.0)}
_BOUNDS |= dict.fromkeys(_BENT, (-0.1, 0.1)) | {
    SWING: (0.0, 0.5),
    PLANE: (-1.0, 2.0),
    FOCUS: (-20.0, 20.0),
}
_BOUNDS |= dict.fromkeys((LAYER, ROUGHNESS, TILT), (0.0, 10.0))

_MICROMETRE = 1e-7
"""Wear coefficient (mm²/N) times distance (m) that wears a micrometre under 10 MPa."""
_LITTLE = 0.01
"""Share of that below which a coefficient says nothing of how far it may change."""

_SIGNED = (LEFT, TOP, TANGENTIAL, FOCUS, EDGE_STRESS)
"""Unknowns of either sign, which a start at a small value says nothing of."""


def free_keys(scene: Scene) -> tuple[str, ...]:
    """The unknowns that a frame of a one-state scene can tell: load and place, wear, and the
    friction where there is sliding, the tangential load where the contact is held.
    """
    keys = list(specimen_model(scene).unknowns)
    if is_held(scene):
        keys.append(TANGENTIAL)
    elif scene.friction is not None:
        keys.append(FRICTION)
    if scene.wear is not None:
        keys.append(WEAR)
    if scene.is_contact and scene.specimen.share_of_plane_stress is None:
        keys.append(PLANE)
    return tuple(keys)


def values_of(scene: Scene, keys: tuple[str, ...]) -> Array:
    """A scene's values (p,) at some keys. Raises InputError where one is no number."""
    values = [scene.get(key) for key in keys]
    for key, value in zip(keys, values, strict=True):
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError("cannot_fitted_no_number", key=key, value=value)
    return np.array(values, dtype=float)


def scene_value(scene: Scene, key: str) -> Any:
    """A scene's value at a key, None where its tables have none."""
    try:
        return scene.get(key)
    except InputError:
        return None


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
    return max(10.0 * value, 1.0)


def limits(scene: Scene, keys: tuple[str, ...], shape: tuple[int, int] | None = None) -> Bounds:
    """Where the search may go: not below zero, not far from the start; in a picture of a `shape`
    (rows, cols) the place moves by half of that at most, lest the specimen leaves it. A contact may
    have stood still until a frame: nothing is worn then, and no start says so.
    """
    ends = np.array([_limit(scene, key) for key in keys]).reshape(-1, 2)
    for key, pixels in zip((TOP, LEFT), shape or (), strict=False):
        if key in keys:
            assert scene.camera is not None and scene.camera.pixel_mm is not None
            half = 0.5 * pixels * scene.camera.pixel_mm
            ends[keys.index(key)] = float(scene.get(key)) + np.array([-half, half])
    return Bounds(ends[:, 0], ends[:, 1])


def _limit(scene: Scene, key: str) -> tuple[float, float]:
    value = float(scene.get(key))
    if key == FRICTION and is_held(scene):
        # only what it holds counts: the shear's sign is the tangential force's
        least, most = _BOUNDS[key]
        return (0.0, most) if value >= 0.0 else (least, 0.0)
    if key in BETWEEN and scene.wear is not None:
        return LEAST_BETWEEN, _BOUNDS[key][1]
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
    """Pixels that a fit uses: below `hidden_px`, where the specimen's model is trusted."""
    full_frame = pixel_grid(scene, shape)
    grid = full_frame.every(stride)
    trusted = specimen_model(scene).trusted(scene, grid, hidden_px * full_frame.pixel_mm)
    return np.array(np.broadcast_to(trusted, (grid.rows, grid.cols)))


def thinning(size: int, pixels: int = 30_000) -> int:
    """Stride that leaves about `pixels` of `size` pixels, by default as many as tell the light: it
    then errs by 0.015 of one pixel's noise, a tenth of what is left of that in a pooled order.
    """
    return max(1, round(sqrt(size / pixels)))


PIXEL = "camera.pixel_mm"
_FOLLOWED = (LEFT, TOP, PIXEL, BLUR, FOCUS, GAMMA, *LENS)
"""What fringes follow of the camera and the frames; all measured numbers of other tables."""

_MATTER = (
    PIXEL, "specimen.thickness_mm", "specimen.fringe_value_n_per_mm", "load.normal_n",
    "specimen.diameter_mm", "specimen.hole_mm", "specimen.height_mm", "specimen.width_mm",
    "load.inner_span_mm", "load.outer_span_mm", "indenter.radius_mm", "indenter.half_width_mm",
    "specimen.young_gpa", "indenter.young_gpa", "specimen.poisson", "indenter.poisson",
    "load.tangential_n", "load.bulk_mpa", "friction.coefficient", WEAR, LEFT, TOP,
)  # fmt: skip
"""Measured numbers that the fringes of some scene follow, those that move a load most first."""

_OF_CONTACT = ("specimen.young_gpa", "specimen.poisson")
_OF_BLOCK = ("specimen.height_mm", "specimen.width_mm")


@dataclass(frozen=True)
class StatedInputs:
    """Measured numbers with their uncertainties: `keys` (m,), `values` (m,), `spread` (m,)."""

    keys: tuple[str, ...]
    values: Array
    spread: Array

    def prior(self, keys: tuple[str, ...]) -> Prior:
        """The prior of some unknowns (p,)."""
        at = {key: k for k, key in enumerate(self.keys)}
        values, weight = np.zeros(len(keys)), np.zeros(len(keys))
        for j, key in enumerate(keys):
            if key in at:
                values[j], weight[j] = self.values[at[key]], self.spread[at[key]] ** -2.0
        return Prior(values, weight)

    def some(self, keys: tuple[str, ...], *, free: bool) -> StatedInputs:
        """Those that are unknowns of a fit, among `keys`, or those that it holds."""
        chosen = [k for k, key in enumerate(self.keys) if (key in keys) == free]
        return StatedInputs(
            tuple(self.keys[k] for k in chosen), self.values[chosen], self.spread[chosen]
        )

    @property
    def rows(self) -> tuple[tuple[str, float, float], ...]:
        """Key, value and standard uncertainty of each, as plain numbers."""
        return tuple(zip(self.keys, self.values.tolist(), self.spread.tolist(), strict=True))


def stated_inputs(scene: Scene, given: Scene | None = None) -> StatedInputs:
    """The measured numbers of a scene with an uncertainty that move its fringes, no tables;
    `given`, what one frame's scene was made of, whose wear may be counted by another law.
    """
    entries = []
    for key, spread in scene.uncertainties.items():
        value = scene_value(scene, key)
        outside = key.split(".")[0] in ("camera", "frames") and key not in _FOLLOWED
        if key == WEAR and given is not None and isinstance(value, int | float):
            stated = given.get(key)
            spread *= value / stated if isinstance(stated, float) and stated else 0.0
        if spread > 0.0 and isinstance(value, int | float) and not outside:
            entries.append((key, float(value), spread))
    return inputs_of_rows(entries)


def stated_pairs(scene: Scene) -> dict[str, tuple[float, float]]:
    """Key to value and standard uncertainty of what a scene states and its fringes follow."""
    return {key: (value, spread) for key, value, spread in stated_inputs(scene).rows}


def inputs_of_rows(rows: Iterable[tuple[str, float, float]]) -> StatedInputs:
    """Stated inputs from their keys, values and standard uncertainties."""
    keys, values, spread = tuple(zip(*rows, strict=True)) or ((), (), ())
    return StatedInputs(tuple(keys), np.array(values, float), np.array(spread, float))


def taken_as_exact(
    scene: Scene, keys: tuple[str, ...], *, tracked: bool = False
) -> tuple[str, ...]:
    """The measured numbers that move a scene's fringes and that a fit of `keys` takes as exact,
    those that move a load most first; none that state an uncertainty, 0 too, but in a track.
    """
    free = keys if tracked else (*keys, *scene.uncertainties)
    used = (key for key in _MATTER if key not in free and _is_used(scene, key))
    return tuple(key for key in used if scene_value(scene, key) is not None)


def _is_used(scene: Scene, key: str) -> bool:
    """Whether a scene's model has a key in it."""
    contact = scene.is_contact
    if key in _OF_CONTACT:
        return contact
    if key in _OF_BLOCK:
        return not contact or scene.specimen.shape is not None
    if key == WEAR and scene.wear is not None and scene.frames.sliding_speed_mm_per_s is None:
        return max(scene.wear.distances_m) > 0.0
    return True
