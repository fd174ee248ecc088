"""Rendered frames of random contacts, as a laboratory's camera takes them, for tests of the fit."""

import numpy as np

from isochrome import simulation
from isochrome.estimation import prepare_frame
from isochrome.fitting import JointProblem, fit_frame
from isochrome.frames import Frame
from isochrome.output import write_tiff
from isochrome.scene import parse_scene
from isochrome.stress import pixel_grid
from scene_texts import PAPER_CONTACT, SMALL_CAMERA

PIXEL_MM = 0.00607
CAMERA = {
    "camera.width_px": 659, "camera.height_px": 494, "camera.pixel_mm": PIXEL_MM,
    "camera.vignette": 0.3, "camera.noise_grey": 3.0,
}  # fmt: skip
HALF_SIZE = {"camera.width_px": 330, "camera.height_px": 247, "camera.pixel_mm": 2.0 * PIXEL_MM}
KINDS = ("static", "slide", "worn", "bulk", "tangential", "worn, bulk")


def random_contact(rng, kind):
    """A scene of one state, and the values drawn for its unknowns."""
    text = PAPER_CONTACT + SMALL_CAMERA
    true = {
        "load.normal_n": rng.uniform(25.0, 60.0),
        "camera.left_mm": -2.0 + rng.uniform(-0.25, 0.25),
        "camera.top_mm": rng.uniform(-0.08, 0.05),
    }
    if kind in ("slide", "worn", "worn, bulk"):
        text += "\n[friction]\ncoefficient = 0.2\n"
        true["friction.coefficient"] = rng.uniform(0.05, 0.35) * rng.choice([-1.0, 1.0])
    if kind.startswith("worn"):
        text += "\n[wear]\ncoefficient_mm2_per_n = 2e-9\ndistances_m = [120.0]\n"
        true["wear.coefficient_mm2_per_n"] = rng.uniform(1e-9, 4e-9)
    if kind in ("bulk", "tangential", "worn, bulk"):
        true["load.bulk_mpa"] = rng.uniform(-4.0, 4.0)
    if kind == "tangential":
        text += "\n[friction]\ncoefficient = 0.3\n"
        true["load.tangential_n"] = rng.uniform(-0.24, 0.24) * true["load.normal_n"]
    scene = parse_scene(text)
    return scene.with_values(CAMERA | true), true


def captured(scene, seed):
    """The camera's frame of a scene's last state."""
    image = simulation.simulate(scene.with_values({"camera.seed": seed})).frames[-1]
    return Frame(0, image, None, "captured")


def prepared(image, scene, *, bit_depth=8, **options):
    """An image as a fit reads it."""
    frame = Frame(0, np.ascontiguousarray(image), None, "frame")
    return prepare_frame(frame, scene, bit_depth=bit_depth, **options)


def written(folder, scene):
    """A scene's frames in a file; returns its path."""
    path = folder / "frames.tif"
    write_tiff(path, simulation.simulate(scene).frames, pixel_mm=scene.camera.pixel_mm)
    return path


def within(found, true, sigmas=4.0):
    """A fitted value is the true one, to some of its own standard uncertainties."""
    assert 0.0 < found["standard_uncertainty"] < np.inf
    assert abs(found["value"] - true) < sigmas * found["standard_uncertainty"], (found, true)


def begun(rng, scene, true, *, share=0.02, place_px=5.0):
    """The scene with values off by up to a share, and its place by some pixels."""
    pixel = scene.camera.pixel_mm
    start = {}
    for key, value in true.items():
        off = rng.uniform(-1.0, 1.0)
        step = place_px * pixel if key.startswith("camera.") else share * abs(value)
        start[key] = value + off * step
    return scene.with_values(start)


def fitted(frame, start, keys, **options):
    """The fit of a frame from a scene's values."""
    data = prepare_frame(frame, start, bit_depth=8, gamma_found=True)
    return fit_frame(data, start, tuple(keys), **options)


def picture_of(scene, state=None):
    """A scene's state, or its last, on the camera's pixels, by the direct simulation."""
    grid = pixel_grid(scene)
    state = simulation.scene_states(scene)[-1] if state is None else state
    return simulation.make_picture(scene, simulation.state_difference(scene, state, grid), grid)


def light_of(scene, state=None):
    """The camera's light of it, without noise (rows, cols)."""
    return simulation.picture_signal(scene, picture_of(scene, state))


def pulls(fit, true):
    """Errors over standard uncertainties."""
    return (fit.values - np.array([true[key] for key in fit.keys])) / fit.standard_uncertainty


def fit_jointly(frames, sequence, start, *, shape):
    """Prepared frames fitted together, from values in the right basin."""
    return JointProblem(frames, sequence, start, shape).fitted(start)
