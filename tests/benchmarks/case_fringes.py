"""Fringe order by every method on the specimens of `tests/fringes/specimens.py`. Given besides: a
point of known order, or for the model a scene 5 % off in load and 3 pixels in place."""

import importlib.util
import sys
import time
from functools import lru_cache, partial

import numpy as np

from isochrome.benchmarks import benchmarks_folder

from . import case_silent
from .case_silent import BLIND, FREE
from .rows import FringeRow

ARCSINE = "arcsine, branch given"
MODEL = "one frame, model"
STEPS = "ten phase steps"
COLOUR = "one colour frame"
NOISE, SEED, HARD_NOISE = 3.0, 0, 10.0
HARD = "worn contact, mu 0.3"
ALL = "all specimens"
WRONG, SURE, SAID = 0.5, 0.05, 0.95

CIRCULAR = (
    (90, 45, -45, 0), (90, 45, -45, 90),
    (90, 45, 0, 0), (90, 45, 45, 45), (90, 45, 90, 90), (90, 45, 135, 135),
)  # fmt: skip
PLANE = tuple((90.0 + turn, None, None, turn) for turn in (0.0, 22.5, 45.0, 67.5))
ELEMENTS = ("polariser_deg", "input_plate_deg", "output_plate_deg", "analyser_deg")


@lru_cache(maxsize=1)
def specimens():
    """The module of the tests that renders the specimens."""
    path = benchmarks_folder().parent / "fringes" / "specimens.py"
    spec = importlib.util.spec_from_file_location("isochrome_specimens", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def arcsine(seen, noise):
    """Each pixel's arccos(1 - 2 s)/2π on the branch nearest to the truth: what light alone says."""
    light = specimens().light_of(specimens().shoot(seen, noise=noise, seed=SEED))

    def read():
        base = np.arccos(np.clip(light.wave, -1.0, 1.0)) / (2.0 * np.pi)
        truth = seen.picture.order
        both = [sign * base + np.rint(truth - sign * base) for sign in (1.0, -1.0)]
        nearer = np.abs(both[0] - truth) < np.abs(both[1] - truth)
        return np.where(light.valid, np.where(nearer, *both), np.nan), None

    return read


def with_model(seen, noise):
    """The scene fitted to the frame, from a start that is off, and the order on its branch."""
    from isochrome.frames import Frame, to_linear
    from isochrome.processing.kinds.with_model import process_with_model
    from isochrome.processing.result import Capture

    if seen.scene.model is None:
        return None
    shot = specimens().shoot(seen, noise=noise, seed=SEED)
    dark, bright = (
        to_linear(image, bit_depth=8, allow_blank=True) for image in (shot.dark, shot.bright)
    )
    scene, camera = seen.scene, seen.scene.camera
    start = scene.with_values(
        {
            "load.normal_n": 1.05 * scene.get("load.normal_n"),
            "camera.left_mm": camera.left_mm + 3.0 * camera.pixel_mm,
        }
    )

    def read():
        frame = Frame(0, shot.frame, None, "frame")
        found = process_with_model(frame, start, Capture(8, dark, bright)).reading
        return found.order, found.confidence

    return read


def one_frame(seen, noise, *, ends):
    """The reading without a model, with both no-load frames or with none."""
    from isochrome.fringes import read_free, widened

    shot = specimens().shoot(seen, noise=noise, seed=SEED)
    known = [specimens().known_point(seen)]

    def read():
        light = specimens().light_of(shot, ends=ends)
        found = read_free(light.wave, light.wave_sigma, light.valid, known).reading
        found = widened(found, light.error)
        return found.order, found.confidence

    return read


def steps(seen, noise):
    """Six circular and four plane steps of the specimen."""
    from isochrome.fringes import read_steps
    from isochrome.optics import expose, make_chain
    from isochrome.simulation import picture_signal

    angles = [
        {name: a for name, a in zip(ELEMENTS, step, strict=True) if a is not None}
        for step in CIRCULAR + PLANE
    ]
    scene = seen.scene.with_values({"polariscope.step": tuple(angles)})
    camera, rng = specimens().camera(noise=noise), np.random.default_rng([SEED, 9])
    frames = np.stack(
        [
            expose(
                np.where(seen.material, picture_signal(scene, seen.picture, i), 0.0),
                camera,
                rng=rng,
            )
            for i in range(len(angles))
        ]
    )
    chains = [make_chain(scene.polariscope, i) for i in range(len(angles))]
    known = [specimens().known_point(seen)]

    def read():
        found = read_steps(
            frames.astype(np.float32) / 255.0,
            chains,
            sigma=float(np.sqrt(noise**2 + 1.0 / 12.0)) / 255.0,
            valid=(frames < 255).all(axis=0) & seen.material,
            known_order=known,
        ).reading
        return found.order, found.confidence

    return read


def colour(seen, noise):
    """One frame in white light with its no-load frames, and the table of the forward model."""
    from isochrome.fringes import read_colour, spectral_table
    from isochrome.optics import camera_response, expose
    from isochrome.simulation import picture_signal

    scene = seen.scene.with_values({"polariscope.light": "white", "camera.colour": True})
    signal = np.where(seen.material[..., None], picture_signal(scene, seen.picture), 0.0)
    camera, few = (specimens().camera(noise=level) for level in (noise, 0.25 * noise))
    rng = np.random.default_rng([SEED, 11])
    frame = expose(signal, camera, rng=rng)
    dark, bright = (expose(0.0 * signal + level, few, rng=rng) / 255.0 for level in (0.0, 1.0))
    table = spectral_table(scene.polariscope, camera_response(scene.camera))

    def read():
        found = read_colour(
            frame / 255.0,
            table,
            sigma=float(np.sqrt(noise**2 + 1.0 / 12.0)) / 255.0,
            dark=dark,
            bright=bright,
            valid=frame < 255,
            specimen=seen.material,
        )
        return found.order, found.confidence

    return read


METHODS = {
    ARCSINE: arcsine,
    MODEL: with_model,
    FREE: partial(one_frame, ends="both"),
    BLIND: partial(one_frame, ends="none"),
    STEPS: steps,
    COLOUR: colour,
}


def cases():
    """Each specimen's case by its name, then the hard one, then the specimens of others' light."""
    names = {name: partial(fringes, name, NOISE) for name in specimens().NAMES}
    hard = f"{HARD}, noise {HARD_NOISE:g}"
    silent = {
        f"{kind}, others' light": partial(case_silent.fringes, kind) for kind in case_silent.KINDS
    }
    return names | {hard: partial(fringes, HARD, HARD_NOISE, hard)} | silent


def fringes(name, noise, label=None, quick=False):
    """Rows of one specimen, one a method; `quick`: the methods of one frame alone."""
    seen = specimens().view(name)
    methods = dict.fromkeys((ARCSINE, FREE)) if quick else METHODS
    rows = []
    for method in methods:
        read = METHODS[method](seen, noise)
        if read is not None:
            if method not in _WARM and not quick:
                read()  # the first call of a method also imports
                _WARM.add(method)
            start = time.perf_counter()
            order, confidence = read()
            seconds = time.perf_counter() - start
            rows.append(judged(label or name, method, seen, order, confidence, seconds))
    return rows


_WARM: set[str] = set()


def judged(name, method, seen, order, confidence, seconds):
    """The errors of what was kept of the specimen."""
    kept = np.isfinite(order) & seen.material
    error = np.abs(order - seen.order)[kept]
    share = float(kept.sum() / seen.material.sum())
    nan = float("nan")
    if not error.size:
        return FringeRow(name, method, kept=share, seconds=seconds)
    right = nan
    if confidence is not None:
        said = confidence[kept] >= SAID
        right = float((error[said] <= SURE).mean()) if said.any() else nan
    return FringeRow(
        name,
        method,
        float((error > WRONG).mean()),
        float(np.sqrt(np.mean(error**2))),
        float(np.median(error)),
        share,
        right,
        seconds,
    )
