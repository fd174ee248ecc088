"""Rendered frames whose fringe order is known: specimens, and a poor camera that looks at them.

The truth is the mechanics' (closed forms, or the contact's solution), never a reading's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt

from isochrome.errors import PhysicsError
from isochrome.frames import Linear, estimate_noise, normalise, to_linear
from isochrome.optics import expose
from isochrome.reference import hole_stress
from isochrome.scene import Camera, Load, Scene, Specimen, load_scene
from isochrome.simulate import Picture, make_picture, picture_signal, scene_states, state_difference
from isochrome.stress import StressComponents, pixel_grid, principal_direction

ROWS, COLS = 494, 659
FRINGE_VALUE = 14.6
DISC_MM, BEAM_MM = 10.0, 10.0
AVERAGED = 16
"""No-load frames are the mean of this many exposures, as a laboratory takes them."""

CONTACTS = {
    "contact": {},
    "contact, mu 0.3": {"friction.coefficient": 0.3},
    "worn contact": {"wear.distances_m": (77.0,)},
    "worn contact, mu 0.3": {"friction.coefficient": 0.3, "wear.distances_m": (77.0,)},
    "worn contact, mu 0.3, bulk": {
        "friction.coefficient": 0.3,
        "wear.distances_m": (77.0,),
        "load.bulk_mpa": 4.0,
    },
    "contact, bulk": {"load.bulk_mpa": -3.0},
}
OTHERS = ("disc", "beam", "hole")
NAMES = (*CONTACTS, *OTHERS)


@dataclass(frozen=True)
class View:
    """A specimen before the camera: its `scene` and the `picture`, order and direction in it."""

    name: str
    scene: Scene
    picture: Picture

    @property
    def order(self) -> np.ndarray:
        """True fringe order (rows, cols), NaN where there is no specimen."""
        return self.picture.order.astype(float)

    @property
    def material(self) -> np.ndarray:
        """True on the specimen (rows, cols)."""
        return self.picture.material

    @property
    def isoclinic(self) -> np.ndarray:
        """True direction of sigma_1 (rows, cols), degrees."""
        return np.degrees(principal_direction(self.picture.difference))


@dataclass(frozen=True)
class Shot:
    """A frame of a view, `dark` and `bright` of the unloaded specimen (grey levels), `camera`."""

    view: View
    frame: np.ndarray
    dark: np.ndarray
    bright: np.ndarray
    camera: Camera


@dataclass(frozen=True)
class Light:
    """A shot made ready to be read: linear `light` and its `sigma`, ends, `wave`, `valid`."""

    light: np.ndarray
    sigma: np.ndarray
    background: np.ndarray
    contrast: np.ndarray
    wave: np.ndarray
    wave_sigma: np.ndarray
    valid: np.ndarray


@lru_cache(maxsize=32)
def view(name: str) -> View:
    """One of NAMES, or 'disc N' and 'beam N', with the order N at the centre and at the edges."""
    if name in CONTACTS:
        return contact_view(name, CONTACTS[name])
    shape, _, order = name.partition(" ")
    if shape == "hole":
        return _hole_view(name)
    return (_disc_view if shape == "disc" else _beam_view)(name, float(order or 4.0))


def contact_view(name: str, values: dict[str, Any]) -> View:
    """The paper's contact with some of its scene's values changed; its last state."""
    scene = load_scene("line-contact-wear")
    plain = {
        "friction.coefficient": 0.0,
        "friction.static_state_first": False,
        "wear.distances_m": (0.0,),
    }
    scene = scene.with_values(plain)
    if scene.load is not None and "load.bulk_mpa" in values:
        load = scene.load.model_copy(update={"bulk_mpa": values["load.bulk_mpa"]})
        scene = scene.model_copy(update={"load": load})
    scene = scene.with_values(values)
    pixels = pixel_grid(scene)
    difference = state_difference(scene, scene_states(scene)[-1], pixels)
    return View(name, scene, make_picture(scene, difference, pixels))


def _disc_view(name: str, order: float) -> View:
    """A disc with the given order at its centre, N = 8 P/(π D f)."""
    pixel = DISC_MM / 460.0
    specimen = Specimen(
        shape="disc", diameter_mm=DISC_MM, thickness_mm=6.0, fringe_value_n_per_mm=FRINGE_VALUE
    )
    load = Load(normal_n=order * np.pi * DISC_MM * FRINGE_VALUE / 8.0)
    return _of_scene(name, specimen, load, pixel, top=-17 * pixel)


def _beam_view(name: str, order: float) -> View:
    """A beam with the given order at its edges, N = 6 M/(f h²), M = P (L - l)/4."""
    pixel = BEAM_MM / 460.0
    specimen = Specimen(
        shape="beam", height_mm=BEAM_MM, thickness_mm=6.0, fringe_value_n_per_mm=FRINGE_VALUE
    )
    moment = order * FRINGE_VALUE * BEAM_MM**2 / 6.0
    load = Load(normal_n=4.0 * moment / 30.0, inner_span_mm=40.0, outer_span_mm=70.0)
    return _of_scene(name, specimen, load, pixel, top=-17 * pixel)


def _of_scene(name: str, specimen: Specimen, load: Load, pixel: float, *, top: float) -> View:
    scene = Scene(specimen=specimen, load=load, camera=_geometry(pixel, top))
    pixels = pixel_grid(scene)
    difference = state_difference(scene, scene_states(scene)[-1], pixels)
    return View(name, scene, make_picture(scene, difference, pixels))


def _hole_view(name: str) -> View:
    """A plate under tension of order 1.5 far away, three times that at the hole's rim."""
    pixel, radius, thickness, far = 0.02, 1.2, 6.0, 1.5
    specimen = Specimen(shape="other", thickness_mm=thickness, fringe_value_n_per_mm=FRINGE_VALUE)
    scene = Scene(specimen=specimen, camera=_geometry(pixel, -0.5 * ROWS * pixel))
    pixels = pixel_grid(scene)
    stress = hole_stress(
        pixels.x_mm[None, :],
        pixels.z_mm[:, None],
        tension_mpa=far * FRINGE_VALUE / thickness,
        radius_mm=radius,
    )
    field = StressComponents(stress.sigma_x, stress.sigma_z, stress.tau_xz)
    return View(name, scene, make_picture(scene, field.difference, pixels))


def _geometry(pixel: float, top: float) -> Camera:
    return Camera(
        width_px=COLS, height_px=ROWS, left_mm=-0.5 * COLS * pixel, top_mm=top, pixel_mm=pixel
    )


def shoot(
    seen: View,
    *,
    noise: float = 3.0,
    gamma: float = 1.0,
    blur: float = 0.0,
    saturated: float = 0.0,
    brightness: float = 0.85,
    background: float = 0.05,
    vignette: float = 0.3,
    seed: int = 0,
) -> Shot:
    """An 8-bit frame of a view, and its no-load frames; `saturated`, share of its pixels."""
    signal = np.where(seen.material, picture_signal(seen.scene, seen.picture), 0.0)
    camera = Camera(
        bit_depth=8,
        brightness=brightness,
        background=background,
        vignette=vignette,
        gamma=gamma,
        blur_px=blur,
        noise_grey=noise,
    )
    if saturated > 0.0:
        ideal = camera.model_copy(update={"bit_depth": None, "noise_grey": 0.0, "gamma": 1.0})
        light = (expose(signal, ideal) - background) / brightness
        level = float(np.quantile(light[seen.material], 1.0 - saturated))
        camera = camera.model_copy(update={"brightness": (1.0 - background) / level})
    averaged = camera.model_copy(update={"noise_grey": noise / np.sqrt(AVERAGED)})
    rng = np.random.default_rng([seed, 7])
    return Shot(
        seen,
        expose(signal, camera, rng=rng),
        expose(0.0 * signal, averaged, rng=rng),
        expose(0.0 * signal + 1.0, averaged, rng=rng),
        camera,
    )


def light_of(shot: Shot, *, no_load: bool = True, gamma: float | None = None) -> Light:
    """The shot as a reading is given it: normalised with its no-load frames, or without any.

    `gamma`, that the user says the camera has (None: the true one).
    """
    said = shot.camera.gamma if gamma is None else gamma
    linear, dark, bright = (
        to_linear(image, bit_depth=8, gamma=said, allow_blank=True)
        for image in (shot.frame, shot.dark, shot.bright)
    )
    inside = Linear(linear.image, linear.valid & shot.view.material)
    done = normalise(inside, *((dark, bright) if no_load else ()))
    noise = estimate_noise(shot.frame, inside.valid, bit_depth=8)
    # at a smoothed level, so that a pixel's weight does not follow its own noise
    level = (dark.image + done.contrast * 0.5) ** (1.0 / said) * 255.0
    sigma = noise.linear_sigma(level, bit_depth=8, gamma=said)
    contrast = np.where(done.valid, done.contrast, 1.0)
    return Light(
        np.where(done.valid, linear.image, 0.0),
        sigma,
        done.background,
        done.contrast,
        np.where(done.valid, 1.0 - 2.0 * done.signal, 0.0),
        2.0 * sigma / contrast,
        done.valid,
    )


def known_point(seen: View) -> tuple[int, int, float]:
    """A point whose order a user could give: deep in the specimen, half-way between two crests."""
    order = np.where(seen.material, seen.order, 0.0)
    between = np.abs(np.mod(2.0 * order, 1.0) - 0.5) < 0.1
    steep = np.hypot(*np.gradient(order)) > 0.05
    deep = distance_transform_edt(np.pad(seen.material & ~steep, 1))[1:-1, 1:-1]
    row, col = np.unravel_index(int(np.where(between, deep, 0.0).argmax()), order.shape)
    return int(row), int(col), float(order[row, col])


@lru_cache(maxsize=32)
def random_scene(seed: int) -> tuple[View, dict[str, float]]:
    """A contact that a laboratory might have, of order 1 to 6, and the camera that sees it.

    Returns the view and the keywords of `shoot`. The same seed gives the same scene.
    """
    rng = np.random.default_rng([seed, 2024])
    while True:
        values = {
            "load.normal_n": float(np.exp(rng.uniform(np.log(15.0), np.log(150.0)))),
            "specimen.thickness_mm": float(rng.uniform(2.0, 8.0)),
            "camera.left_mm": -2.0 + float(rng.uniform(-0.5, 0.5)),
            "camera.top_mm": float(rng.uniform(-0.15, 0.15)),
            "friction.coefficient": float(rng.uniform(-0.3, 0.3)),
            "wear.distances_m": (float(rng.choice([0.0, rng.uniform(10.0, 200.0)])),),
            "load.bulk_mpa": float(rng.choice([0.0, rng.uniform(-4.0, 4.0)])),
        }
        camera = {
            "noise": float(rng.uniform(1.0, 6.0)),
            "brightness": float(rng.uniform(0.6, 0.85)),
            "background": float(rng.uniform(0.03, 0.1)),
            "vignette": float(rng.uniform(0.0, 0.4)),
        }
        try:
            seen = contact_view(f"random {seed}", values)
        except PhysicsError:
            continue
        # the contact's edge, where wear makes the stress steep, is no measure of the fringes
        if 1.0 < float(np.nanpercentile(seen.order, 99.5)) < 6.0:
            return seen, camera
