"""Frames of `outside_camera` whose stated inputs, the load too, are drawn about the truth: whether
the whole uncertainty covers it."""

import time
from functools import partial

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import prepare_frame
from isochrome.fitting import fit_frame, fit_with_causes
from isochrome.frames import Frame
from isochrome.scene import parse_scene

from .common import PAPER_CONTACT
from .outside_camera import Defects, frame
from .report import lines_of, machine, of_seeds, share_figure
from .rows import InputRow

FRAMES = 1000
COVERED = 1.96
"""Standard uncertainties that hold 95 of 100 of a normal distribution."""

STATED = {
    "camera.pixel_mm": 0.002, "specimen.thickness_mm": 0.005,
    "specimen.fringe_value_n_per_mm": 0.005, "specimen.young_gpa": 0.02,
    "indenter.radius_mm": 0.001, "load.normal_n": 0.005,
}  # fmt: skip
"""Relative standard uncertainties of the inputs: caliper, calibration, data sheet, load cell."""

_TRUTHS = ((44.0, 0.2), (32.0, 0.12), (56.0, 0.28))
"""Loads (N) and friction coefficients of the frames, in turn."""

_SCENE = (
    PAPER_CONTACT
    + """\
[friction]
coefficient = 0.2
[camera]
width_px = 220
height_px = 165
left_mm = -2.0
top_mm = 0.1
pixel_mm = 0.018
bit_depth = 8
"""
)


def cases():
    """All that is stated held, with its budget; and fitted with its priors where a frame asks."""
    return {kind: partial(of_seeds, judged, kind, range(FRAMES)) for kind in ("held", "asked")}


def true_scene(seed):
    """The scene of a frame as it truly is."""
    load, friction = _TRUTHS[seed % len(_TRUTHS)]
    values = {"load.normal_n": load, "friction.coefficient": friction}
    return parse_scene(_SCENE).with_values(values)


def stated_scene(true, rng):
    """The scene as its user states it: each input off by chance, with its uncertainty."""
    values = {}
    for key, relative in STATED.items():
        spread = relative * true.get(key)
        stated = true.get(key) + spread * rng.normal()
        values[key] = {"value": stated, "standard_uncertainty": spread}
    return true.with_values(values)


def judged(kind, seed):
    true = true_scene(seed)
    rng = np.random.default_rng([seed, 16])
    image = frame(true, Defects(), int(rng.integers(2**31)))
    scene = stated_scene(true, rng)
    data = prepare_frame(Frame(0, image, None, "bench"), scene, bit_depth=8)
    start = time.process_time()
    try:
        found = fit_frame(data, scene) if kind == "held" else fit_with_causes(data, scene).fit
    except PhysicsError as error:
        return InputRow(kind, seed, refused=str(error))
    seconds = time.process_time() - start
    at = {key: found.keys.index(key) for key in ("load.normal_n", "friction.coefficient")}
    pulls = {
        key: (found.values[k] - true.get(key)) / found.standard_uncertainty[k]
        for key, k in at.items()
    }
    load = at["load.normal_n"]
    return InputRow(
        kind, seed, load_percent=100.0 * (found.values[load] / true.load_at(0.0) - 1.0),
        load_pull=pulls["load.normal_n"], friction_pull=pulls["friction.coefficient"],
        combined_percent=100.0 * found.standard_uncertainty[load] / true.load_at(0.0),
        noise_percent=100.0 * found.noise_uncertainty[load] / true.load_at(0.0),
        freed=len(found.keys) > len(_KEYS), chi=found.chi, seconds=seconds,
    )  # fmt: skip


_KEYS = ("load.normal_n", "friction.coefficient", "camera.left_mm", "camera.top_mm")


HEAD = (
    "inputs", "frames", "load within 1.96 u", "friction", "pull load", "pull friction", "u load",
    "of it noise", "freed", "CPU ms",
)  # fmt: skip

_FOOT = """\
u: combined standard uncertainty; pulls: errors over it, root mean square. Inputs are drawn about
the truth: pixel 0.2 %, thickness and f_sigma 0.5 %, E 2 %, R 0.1 %, and the load cell 0.5 %.
held: as stated, with their budget; asked: fitted with their priors where the frame asks. Frames of
220 x 165 pixels by a script that shares no code with our optics and camera."""


def table(rows: list[InputRow]) -> str:
    """By what is done with the inputs; then what was refused."""
    kinds = dict.fromkeys(row.kind for row in rows)
    cells = [_cells(kind, [row for row in rows if row.kind == kind]) for kind in kinds]
    reasons = [f"{row.kind} {row.seed}: {row.refused}" for row in rows if row.refused]
    return "\n".join([*lines_of(HEAD, cells, texts=1), "", *reasons, _FOOT, machine()])


def _cells(kind: str, some: list[InputRow]) -> tuple[str, ...]:
    kept = [row for row in some if not row.refused]
    if not kept:
        return (kind, str(len(some)), *["-"] * (len(HEAD) - 2))
    pulls = np.array([(row.load_pull, row.friction_pull) for row in kept])
    within = np.mean(abs(pulls) <= COVERED, axis=0)
    return (
        kind, str(len(some)), *(f"{100.0 * share:.1f} %" for share in within),
        *(f"{rms:.2f}" for rms in np.sqrt(np.mean(pulls**2, axis=0))),
        f"{np.median([row.combined_percent for row in kept]):.3f} %",
        f"{np.median([row.noise_percent for row in kept]):.4f} %",
        f"{100.0 * np.mean([row.freed for row in kept]):.0f} %",
        f"{1e3 * np.median([row.seconds for row in kept]):.0f}",
    )  # fmt: skip


def figure(rows: list[InputRow]):
    """Share of the loads within so many standard uncertainties, beside a normal distribution's."""
    from scipy.stats import halfnorm

    kept = [(row.kind, abs(row.load_pull)) for row in rows if not row.refused]
    picture = share_figure(
        kept, "inputs", "error of the load over combined standard uncertainty",
        "Inputs that are off by chance",
    )  # fmt: skip
    (axes,) = picture.axes
    place = np.linspace(0.0, 4.0, 200)
    axes.plot(place, halfnorm.cdf(place), color="0.5", lw=0.9, ls="--", label="normal")
    axes.legend(title="inputs", frameon=False)
    return picture
