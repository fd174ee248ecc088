"""Rendered frames whose fringe order is known: specimens, and a poor camera that looks at them.
The truth is the mechanics' (closed forms, or the contact's solution), never a reading's."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from isochrome import simulation
from isochrome.errors import PhysicsError
from isochrome.frames import Linear, estimate_noise, normalise, to_linear
from isochrome.fringes import fit_background_modulation
from isochrome.optics import expose
from isochrome.reference import hole_stress
from isochrome.scene import Camera, Load, Polariscope, Scene, Specimen, load_scene
from isochrome.stress import StressComponents, pixel_grid, principal_direction

ROWS, COLS = 494, 659
FRINGE_VALUE = 14.6
SODIUM = Polariscope(wavelength_nm=587.0)
DISC_MM, BEAM_MM = 10.0, 10.0
AVERAGED = 16
"""No-load frames are the mean of this many exposures, as a laboratory takes them."""

CONTACTS = {
    "contact": {},
    "contact, mu 0.3": {"friction.coefficient": 0.3},
    "worn contact": {"wear.distances_m": (77.0,)},
    "worn contact, mu 0.3": {"friction.coefficient": 0.3, "wear.distances_m": (77.0,)},
    "worn contact, mu 0.3, bulk": {
        "friction.coefficient": 0.3, "wear.distances_m": (77.0,), "load.bulk_mpa": 4.0,
    },
    "contact, bulk": {"load.bulk_mpa": -3.0},
}  # fmt: skip
OTHERS = ("disc", "beam", "hole")
NAMES = (*CONTACTS, *OTHERS)


@dataclass(frozen=True)
class View:
    """A specimen before the camera: its `scene` and the `picture`, order and direction in it."""

    name: str
    scene: Scene
    picture: simulation.Picture

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
    """A shot made ready to be read: linear `light` and its `sigma`, ends, `wave`, `valid`.
    `settled`, whether the search for the ends that no no-load frame gave came to rest; `error` of
    the signal by what it left open; `tone`, the exponent that was found, 1 where none was asked."""

    light: np.ndarray
    sigma: np.ndarray
    background: np.ndarray
    contrast: np.ndarray
    wave: np.ndarray
    wave_sigma: np.ndarray
    valid: np.ndarray
    settled: bool
    error: np.ndarray
    tone: float = 1.0


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
    """The paper's contact with some of its scene's values changed; its last state.
    Without a friction coefficient it does not slide, without distances it is not worn."""
    scene = load_scene("line-contact-wear")
    scene = scene.with_values({"friction.static_state_first": False})
    absent = {
        part: None
        for part, key in (("friction", "friction.coefficient"), ("wear", "wear.distances_m"))
        if key not in values
    }
    scene = scene.model_copy(update=absent).with_values(values)
    pixels = pixel_grid(scene)
    difference = simulation.state_difference(scene, simulation.scene_states(scene)[-1], pixels)
    return View(name, scene, simulation.make_picture(scene, difference, pixels))


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
    scene = Scene(specimen=specimen, load=load, camera=_geometry(pixel, top), polariscope=SODIUM)
    pixels = pixel_grid(scene)
    difference = simulation.state_difference(scene, simulation.scene_states(scene)[-1], pixels)
    return View(name, scene, simulation.make_picture(scene, difference, pixels))


def _hole_view(name: str) -> View:
    """A plate under tension of order 1.5 far away, three times that at the hole's rim."""
    pixel, radius, thickness, far = 0.02, 1.2, 6.0, 1.5
    specimen = Specimen(shape="other", thickness_mm=thickness, fringe_value_n_per_mm=FRINGE_VALUE)
    scene = Scene(
        specimen=specimen, camera=_geometry(pixel, -0.5 * ROWS * pixel), polariscope=SODIUM
    )
    pixels = pixel_grid(scene)
    stress = hole_stress(
        pixels.x_mm[None, :], pixels.z_mm[:, None], tension_mpa=far * FRINGE_VALUE / thickness,
        radius_mm=radius,
    )  # fmt: skip
    field = StressComponents(stress.sigma_x, stress.sigma_z, stress.tau_xz)
    return View(name, scene, simulation.make_picture(scene, field.difference, pixels))


def _geometry(pixel: float, top: float) -> Camera:
    return Camera(
        width_px=COLS, height_px=ROWS, left_mm=-0.5 * COLS * pixel, top_mm=top, pixel_mm=pixel
    )


def camera(
    *,
    noise: float = 3.0,
    gamma: float = 1.0,
    blur: float = 0.0,
    brightness: float = 0.85,
    background: float = 0.05,
    vignette: float = 0.3,
) -> Camera:
    """A camera of 8 bits: noise in grey levels, blur in pixels."""
    return Camera(
        bit_depth=8, brightness=brightness, background=background, vignette=vignette, gamma=gamma,
        blur_px=blur, noise_grey=noise,
    )  # fmt: skip


def shoot(
    seen: View, *, glare: float = 0.0, saturated: float = 0.0, seed: int = 0, **how: float
) -> Shot:
    """An 8-bit frame of a view, and its no-load frames; `how`, of `camera`.
    `glare`, share of the picture under round reflections of lamps, which saturate in all frames;
    `saturated`, share of the specimen's pixels that are overexposed, in the bright frame far more.
    """
    signal = np.where(seen.material, simulation.picture_signal(seen.scene, seen.picture), 0.0)
    lamps = 4.0 * _lamps(signal.shape, glare, np.random.default_rng([seed, 8]))
    taken = camera(**how)
    if saturated > 0.0:
        ideal = taken.model_copy(update={"bit_depth": None, "noise_grey": 0.0, "gamma": 1.0})
        light = (expose(signal, ideal) - taken.background) / taken.brightness
        level = float(np.quantile(light[seen.material], 1.0 - saturated))
        taken = taken.model_copy(update={"brightness": (1.0 - taken.background) / level})
    averaged = taken.model_copy(update={"noise_grey": taken.noise_grey / np.sqrt(AVERAGED)})
    rng = np.random.default_rng([seed, 7])
    return Shot(
        seen, expose(signal + lamps, taken, rng=rng),
        expose(0.0 * signal + lamps, averaged, rng=rng),
        expose(0.0 * signal + 1.0 + lamps, averaged, rng=rng), taken,
    )  # fmt: skip


def _lamps(shape: tuple[int, int], share: float, rng: np.random.Generator) -> np.ndarray:
    """Half a dozen round spots (rows, cols), 1 in them, which cover a share of the picture."""
    rows, cols = np.ogrid[: shape[0], : shape[1]]
    spots = np.zeros(shape)
    while spots.mean() < share:
        place = rng.uniform(0.0, 1.0, 2) * shape
        radius = np.sqrt(share * spots.size / (6.0 * np.pi))
        spots[np.hypot(rows - place[0], cols - place[1]) < radius] = 1.0
    return spots


def light_of(shot: Shot, *, ends: str = "both", gamma: float | str | None = None) -> Light:
    """The shot as a reading is given it, normalised with its no-load frames.
    Parameters: `ends`, which no-load frames there are: 'both', 'dark', or 'none'; what is missing
    is found from the fringes. `gamma`, that the user says the camera has (None: the true one), or
    'unknown', and found from the fringes too."""
    unknown = gamma == "unknown"
    said = 1.0 if unknown else shot.camera.gamma if gamma is None else float(gamma)
    linear, dark, bright = (
        to_linear(image, bit_depth=8, gamma=said, allow_blank=True)
        for image in (shot.frame, shot.dark, shot.bright)
    )
    valid = linear.valid & shot.view.material
    noise = estimate_noise(shot.frame, valid, bit_depth=8)
    # at a smoothed level, so that a pixel's weight does not follow its own noise
    level = gaussian_filter(shot.frame.astype(float), 1.5)
    sigma = noise.linear_sigma(level, bit_depth=8, gamma=said)
    light, error, tone = np.where(valid, linear.image, 0.0), np.zeros(valid.shape), 1.0
    if ends == "both" and not unknown:
        done = normalise(Linear(linear.image, valid), dark, bright)
        low, contrast, valid, settled = done.background, done.contrast, done.valid, True
    else:
        found = fit_background_modulation(
            light, sigma, valid, dark=dark.image if ends in ("dark", "both") else None,
            bright=bright.image if ends == "both" else None, tone=unknown,
        )  # fmt: skip
        low, contrast, settled = found.dark, found.bright - found.dark, found.settled
        error, tone = found.signal_uncertainty(light), found.tone
        valid = valid & (contrast > 0.05 * np.median(contrast[valid]))
        sigma = tone * np.maximum(light, sigma) ** (tone - 1.0) * sigma
        light = light**tone
    scale = np.where(valid, contrast, 1.0)
    wave = np.where(valid, 1.0 - 2.0 * (light - low) / scale, 0.0)
    return Light(
        light, sigma, low, contrast, wave, 2.0 * sigma / scale, valid, settled, error, tone
    )


def known_point(seen: View, within: np.ndarray | None = None) -> tuple[int, int, float]:
    """A point whose order a user could give: deep in the specimen, half-way between two crests.
    `within`, True where it may lie, such as where a shot is trusted."""
    inside = seen.material if within is None else seen.material & within
    order = np.where(seen.material, seen.order, 0.0)
    between = np.abs(np.mod(2.0 * order, 1.0) - 0.5) < 0.1
    steep = np.hypot(*np.gradient(order)) > 0.1
    deep = distance_transform_edt(np.pad(inside & ~steep, 1))[1:-1, 1:-1]
    row, col = np.unravel_index(int(np.where(between, deep, 0.0).argmax()), order.shape)
    return int(row), int(col), float(order[row, col])


@lru_cache(maxsize=32)
def random_scene(seed: int) -> tuple[View, dict[str, float]]:
    """A contact that a laboratory might have, of order 1 to 6, and the camera that sees it.
    Returns the view and the keywords of `shoot`. The same seed gives the same scene."""
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
            "noise": float(rng.uniform(1.0, 6.0)), "brightness": float(rng.uniform(0.6, 0.85)),
            "background": float(rng.uniform(0.03, 0.1)), "vignette": float(rng.uniform(0.0, 0.4)),
        }  # fmt: skip
        try:
            seen = contact_view(f"random {seed}", values)
        except PhysicsError:
            continue
        # the contact's edge, where wear makes the stress steep, is no measure of the fringes
        if 1.0 < float(np.nanpercentile(seen.order, 99.5)) < 6.0:
            return seen, camera
