"""Random contacts by `outside_camera` with no defect, one or three: value, uncertainty and cause,
and what the asking costs."""

import time
from dataclasses import asdict
from functools import partial

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import prepare_frame
from isochrome.fitting import fit_frame, fit_with_causes
from isochrome.frames import Frame
from isochrome.scene import load_scene

from .outside_camera import Defects, frame
from .rows import DefectRow

FRAMES = {"clean": 60, "single": 150, "three": 90}

ROWS_ABOVE = 40

STRENGTHS = {
    "roll": {"roll_deg": (-2.0, 2.0)},
    "distortion": {"distortion": (-0.02, 0.02)},
    "keystone x": {"keystone_x": (-0.02, 0.02)},
    "keystone z": {"keystone_z": (-0.02, 0.02)},
    "gamma": {"gamma": (0.45, 2.2)},
    "blur": {"blur_px": (0.8, 2.0)},
    "plates": {"plate_error_deg": (3.0, 15.0)},
    "band": {"band_nm": (10.0, 40.0)},
    "light": {"spot": (0.05, 0.5), "bar": (0.05, 0.5)},
    "stray light": {"background": (0.05, 0.3), "background_slope": (0.2, 1.0)},
    "dust": {"dust": (10, 40)},
    "shadow": {"shadow_px": (2, 8)},
    "noise": {"row_noise": (0.2, 1.0), "flicker": (0.0, 0.005)},
    "jpeg": {"jpeg": (80, 95)},
    "deep": {"bits": (12, 12), "container": (16, 16)},
}
"""Defects by name, and between what their strengths are drawn."""

UNNAMED = ("noise", "jpeg", "deep")
"""What is a property of the sensor, and no cause to be found."""

KEYS = {
    "roll": "camera.roll_deg",
    "distortion": "camera.distortion",
    "keystone x": "camera.keystone_x",
    "keystone z": "camera.keystone_z",
    "gamma": "frames.gamma",
    "blur": "camera.blur_px",
    "plates": "polariscope.input_plate_error_deg",
    "band": "polariscope.bandwidth_nm",
}
"""The key in which a defect is to be found; others by richer light, or by what is left out."""


def cases():
    """A case for each kind of frame."""
    return {kind: partial(frames, kind) for kind in FRAMES}


def frames(kind, quick, seeds=None):
    """A row for each frame of a kind, or with `quick` for the first."""
    seeds = range(FRAMES[kind]) if seeds is None else seeds
    return [judged(kind, seed) for seed in (seeds[:1] if quick else seeds)]


def judged(kind, seed):
    """The row of one frame."""
    rng = np.random.default_rng([seed, list(FRAMES).index(kind)])
    scene = contact(rng)
    names = drawn(kind, seed, rng)
    image = frame(scene, defects(names, rng), int(rng.integers(2**31)))
    data = prepare_frame(Frame(0, image, None, "bench"), scene, bit_depth=8 * image.itemsize)
    known = ("load.normal_n", *(("friction.coefficient",) if scene.friction else ()))
    truth = {key: scene.get(key) for key in known}
    begun = scene.with_values({"load.normal_n": truth["load.normal_n"] * rng.uniform(0.8, 1.2)})
    try:
        plain = time.process_time()
        fit_frame(data, begun)
        start = time.process_time()
        freed = fit_with_causes(data, begun)
        seconds = time.process_time() - start
    except PhysicsError as error:
        return DefectRow(kind, seed, ", ".join(names), refused=str(error))
    fit = freed.fit
    at = {key: fit.keys.index(key) for key in truth}
    pulls = {
        key: (fit.values[j] - truth[key]) / fit.standard_uncertainty[j] for key, j in at.items()
    }
    groups = found_of(freed)
    found = [name for group in groups for name in group]
    first = {name for group in groups[: 2 if kind == "three" else 1] for name in group}
    bounds = [fit.standard_uncertainty[j] / fit.cramer_rao_bound[j] for j in at.values()]
    load = fit.values[at["load.normal_n"]] / truth["load.normal_n"] - 1.0
    return DefectRow(
        kind,
        seed,
        ", ".join(names),
        found=", ".join(found),
        named=all(name in found for name in names if name not in UNNAMED),
        first=bool(first & set(names)) or set(names) <= set(UNNAMED),
        over_bound=float(max(bounds)),
        load_percent=100.0 * load,
        load_pull=pulls["load.normal_n"],
        friction_pull=pulls.get("friction.coefficient", float("nan")),
        chi=fit.chi,
        flagged=bool(freed.asked) or fit.chi > 1.3 or not fit.positive,
        cost=seconds / max(start - plain, 1e-9),
        seconds=seconds,
    )


def contact(rng):
    """A static, a sliding or a worn contact in a picture of 659 x 494 pixels."""
    values = {
        "load.normal_n": float(rng.uniform(25.0, 60.0)),
        "friction.static_state_first": False,
        "friction.coefficient": float(rng.uniform(0.1, 0.3)),
        "wear.distances_m": (float(rng.uniform(20.0, 230.0)),),
        "polariscope.wavelength_nm": 587.0,
        "camera.left_mm": float(-2.0 + rng.uniform(-0.2, 0.2)),
    }
    scene = load_scene("line-contact-wear").with_values(values)
    if rng.random() < 0.5:  # the surface is in view, below up to 40 rows
        rows = float(rng.uniform(0.0, ROWS_ABOVE))
        scene = scene.with_values({"camera.top_mm": -rows * scene.camera.pixel_mm})
    absent = (("friction", "wear"), ("wear",), ())[rng.integers(3)]
    return scene.model_copy(update=dict.fromkeys(absent))


def drawn(kind, seed, rng):
    """Names of a frame's defects: singles go through all of them in turn."""
    names = list(STRENGTHS)
    if kind == "clean":
        return []
    return [names[seed % len(names)]] if kind == "single" else list(rng.choice(names, 3, False))


def defects(names, rng):
    """The defects with their random strengths."""
    values = {}
    for name in names:
        for key, (low, high) in STRENGTHS[name].items():
            whole = isinstance(low, int)
            values[key] = (
                int(rng.integers(low, high + 1)) if whole else float(rng.uniform(low, high))
            )
    return Defects(**(asdict(Defects()) | values))


def found_of(freed):
    """The defects that were found, in the order in which they are said; light has two names."""
    names = {key: name for name, key in KEYS.items()}
    found = [(names[key],) for cause in freed.causes for key in cause.keys if key in names]
    found += [("light", "stray light")] if freed.light else []
    return found + ([("dust", "shadow")] if freed.outside else [])
