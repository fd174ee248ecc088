"""Phase-stepped sets of rendered specimens, loaded and not; the truth is the mechanics', never a
reading's."""

from dataclasses import dataclass

import numpy as np

from isochrome.fringes import read_steps
from isochrome.optics import expose, make_chain
from isochrome.scene import Polariscope, parse_scene
from isochrome.simulation import (
    make_picture,
    picture_signal,
    scene_states,
    simulate,
    state_difference,
)
from isochrome.stress import pixel_grid
from scene_texts import PAPER_CONTACT, beam_text, disc_text

CIRCULAR = [
    (90, 45, -45, 0), (90, 45, -45, 90),
    (90, 45, 0, 0), (90, 45, 45, 45), (90, 45, 90, 90), (90, 45, 135, 135),
]  # fmt: skip
PLANE = [(90.0 + b, None, None, b) for b in (0.0, 22.5, 45.0, 67.5)]
TEN = CIRCULAR + PLANE

OPTICS = "\n[polariscope]\nwavelength_nm = 587.0\n"
CAMERA = """
[camera]
width_px = 659
height_px = 494
bit_depth = 8
brightness = 0.85
background = 0.05
vignette = 0.3
noise_grey = 3.0
blur_px = 0.25
"""
DISC = disc_text(450.0, fringe_value=7.0, diameter_mm=30.0) + OPTICS + CAMERA
BEAM = beam_text(200.0, fringe_value=7.0) + OPTICS + CAMERA
CONTACT = PAPER_CONTACT + OPTICS + CAMERA


def as_steps(angles):
    names = ("polariser_deg", "input_plate_deg", "output_plate_deg", "analyser_deg")
    return tuple(
        {n: a for n, a in zip(names, four, strict=True) if a is not None} for four in angles
    )


def a_scene(text, *, pixel_mm, steps=TEN, **values):
    scene = parse_scene(text + f"pixel_mm = {pixel_mm}\n")
    return scene.with_values({"polariscope.step": as_steps(steps)} | values)


def disc(pixel_mm=0.0625, **values):
    return a_scene(DISC, pixel_mm=pixel_mm, **values)


def contact(mu=0.0, **values):
    text = CONTACT.replace("[load]", f"[friction]\ncoefficient = {mu}\n[load]") if mu else CONTACT
    return a_scene(text, pixel_mm=0.00607, **values)


def small(scene, factor=3):
    """The same picture with fewer pixels."""
    return scene.with_values(
        {
            "camera.pixel_mm": factor * scene.camera.pixel_mm,
            "camera.width_px": 659 // factor,
            "camera.height_px": 494 // factor,
        }
    )


def chains_at(angles, **values):
    """The elements of steps at four angles each, in the sodium lamp's light."""
    scope = Polariscope(**{"wavelength_nm": 587.0, "step": as_steps(angles)} | values)
    return [make_chain(scope, i) for i in range(len(angles))]


def chains_of(scene):
    return [make_chain(scene.polariscope, i) for i in range(len(scene.polariscope.step))]


def truth(scene):
    """Order (fringes) and direction of sigma_1 (degrees) of the scene's own field."""
    pixels = pixel_grid(scene)
    (state,) = scene_states(scene)
    difference = state_difference(scene, state, pixels)
    picture = make_picture(scene, difference, pixels)
    # z grows downward in the image: counter-clockwise for the camera is minus the stress' angle
    return picture.order, -0.5 * np.degrees(np.angle(difference))


def captured(scene):
    """Light of the steps, pixels that are not saturated, and the noise, all of full scale."""
    light, good, sigma = light_of(simulate(scene).frames, scene)
    return light, good.all(axis=0), sigma


def read(scene, **options):
    light, valid, sigma = captured(scene)
    return read_steps(light, chains_of(scene), sigma=sigma, valid=valid, **options)


def errors(found, scene):
    """Errors of the order (fringes) and of the isoclinic (degrees), where each is known."""
    order, direction = truth(scene)
    known, turned = np.isfinite(found.order), np.isfinite(found.isoclinic)
    assert np.isfinite(order[known]).all()  # nothing is read where there is no specimen
    turn = (found.isoclinic - direction + 90.0) % 180.0 - 90.0
    return (found.order - order)[known], turn[turned], known.sum() / np.isfinite(order).sum()


# Residual stress: closed forms in equilibrium, free of load, which no load could make


def stress_of_a_fringe(scene):
    """The stress difference (MPa) of one fringe."""
    return scene.specimen.fringe_value_n_per_mm / scene.specimen.thickness_mm


def disc_residual(scene, highest):
    """(sigma_x - sigma_z) + 2i tau_xz (MPa) as a quench leaves: sigma_r = s (r²/R² - 1), sigma_t =
    s (3 r²/R² - 1), whose difference has `highest` fringes at the rim."""
    pixels = pixel_grid(scene)
    radius = 0.5 * scene.specimen.diameter_mm
    x, z = pixels.x_mm[None, :], pixels.z_mm[:, None] - radius
    return highest * stress_of_a_fringe(scene) * (x + 1j * z) ** 2 / radius**2


def layer_residual(scene, highest, height_mm):
    """The same along x over a height, without force or moment: sigma_x = s (3 u² - 1)/2, u = -1..1,
    of `highest` fringes at both faces."""
    pixels = pixel_grid(scene)
    u = 2.0 * pixels.z_mm / height_mm - 1.0
    stress = highest * stress_of_a_fringe(scene) * (1.5 * u**2 - 0.5)
    return np.repeat(stress[:, None], pixels.cols, axis=1).astype(complex)


def waves_residual(scene, rng, highest):
    """The same of an Airy function, phi = sum of -a cos(k·r + c)/k²: in equilibrium, compatible
    with nothing, `highest` fringes at most."""
    pixels = pixel_grid(scene)
    half = 0.5 * pixels.rows * pixels.pixel_mm
    x, z = pixels.x_mm[None, :] / half, (pixels.z_mm[:, None] - pixels.top_mm) / half
    field = np.zeros((pixels.rows, pixels.cols), complex)
    for _ in range(rng.integers(1, 5)):
        size, turn, shift = rng.uniform(0.5, 3.5), rng.uniform(0.0, np.pi), rng.uniform(0.0, 6.3)
        kx, kz = size * np.cos(turn), size * np.sin(turn)
        wave = rng.normal() * np.cos(kx * x + kz * z + shift) / size**2
        # (sigma_x - sigma_z) + 2i tau_xz of phi = -wave: phi_zz - phi_xx - 2i phi_xz
        field += wave * (kz**2 - kx**2 - 2j * kx * kz)
    return highest * stress_of_a_fringe(scene) * field / np.abs(field).max()


@dataclass(frozen=True)
class Sets:
    """`unloaded` and `loaded` frames (steps, rows, cols) of a specimen with a residual stress.

    `order` (fringes) and `direction` of sigma_1 (degrees) of the load alone, `shown` and
    `residual_order`, what the frames show loaded and not; (rows, cols), NaN off the specimen.
    """

    unloaded: np.ndarray
    loaded: np.ndarray
    order: np.ndarray
    direction: np.ndarray
    shown: np.ndarray
    residual_order: np.ndarray


def with_residual(scene, residual, *, exposure=1.0):
    """Sets of a scene with a residual stress (rows, cols), MPa; `exposure` of the unloaded one."""
    pixels = pixel_grid(scene)
    load = state_difference(scene, scene_states(scene)[0], pixels)
    dimmed = scene.with_values({"camera.brightness": exposure * scene.camera.brightness})
    alone = make_picture(scene, load, pixels)
    frames, pictures = [], []
    fields = (np.where(np.isfinite(load), residual, np.nan), load + residual)
    for seed, (own, field) in enumerate(zip((dimmed, scene), fields, strict=True)):
        picture, rng = make_picture(own, field, pixels), np.random.default_rng([11, seed])
        steps = range(len(own.polariscope.step))
        frames.append(
            [expose(picture_signal(own, picture, step), own.camera, rng=rng) for step in steps]
        )
        pictures.append(picture)
    return Sets(
        np.stack(frames[0]), np.stack(frames[1]), alone.order, -0.5 * np.degrees(np.angle(load)),
        pictures[1].order, pictures[0].order,
    )  # fmt: skip


def light_of(frames, scene):
    """Light of 8-bit frames, which of it is not saturated, and the noise, all of full scale."""
    # rounding to whole grey levels is noise of variance 1/12
    sigma = np.sqrt(scene.camera.noise_grey**2 + 1.0 / 12.0) / 255.0
    return frames.astype(np.float32) / 255.0, frames < 255, float(sigma)
