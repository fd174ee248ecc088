"""What a plan says beside what happens: the scatter of virtual runs of the same experiment, their
noise and their inputs drawn anew, each read as `fit` reads a frame."""

import time
from functools import partial

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import prepare_frame
from isochrome.fitting import fit_frame, fit_with_causes, frame_scene, free_keys, stated_inputs
from isochrome.frames import Frame
from isochrome.planning import plan
from isochrome.scene import parse_scene
from isochrome.simulation import camera_frame, polariscope_light, scene_states, stress_map

from .common import PAPER_CONTACT
from .report import lines_of, machine
from .rows import PlanRow

RUNS = 200
BAR = 0.10
"""How far a planned uncertainty may be from the scatter."""

STATED = {
    "camera.pixel_mm": 0.002, "specimen.thickness_mm": 0.003,
    "specimen.fringe_value_n_per_mm": 0.005, "specimen.young_gpa": 0.02,
    "indenter.radius_mm": 0.001,
}  # fmt: skip
"""Relative standard uncertainties of the inputs, of those that a scene has."""

_CONTACT = (
    PAPER_CONTACT
    + """\
[camera]
width_px = 220
height_px = 164
left_mm = -2.0
top_mm = 0.1
pixel_mm = 0.018
bit_depth = 8
brightness = 0.75
background = 0.1
noise_grey = 2.0
"""
)
_SLIDING = """
[friction]
coefficient = 0.2
"""
_WORN = """
[wear]
coefficient_mm2_per_n = 2e-9
distances_m = [77]
"""
_BODY = """
[specimen]
shape = "{shape}"
thickness_mm = 6.0
fringe_value_n_per_mm = 14.6
{sizes}
[camera]
width_px = 220
height_px = 220
pixel_mm = {pixel}
bit_depth = 8
brightness = 0.75
background = 0.1
noise_grey = 2.0
[load]
{load}
"""
_BODIES = {
    "disc": ("diameter_mm = 40.0", "0.19", "normal_n = 300.0"),
    "ring": ("diameter_mm = 40.0\nhole_mm = 20.0", "0.19", "normal_n = 150.0"),
    "beam": ("height_mm = 20.0", "0.11",
             "normal_n = 150.0\ninner_span_mm = 40.0\nouter_span_mm = 100.0"),
}  # fmt: skip
_CONTACTS = {
    "static": _CONTACT, "sliding": _CONTACT + _SLIDING, "worn": _CONTACT + _SLIDING + _WORN
}  # fmt: skip
_COUNTS = {"static": 4, "sliding": 5, "worn": 5, "disc": 2, "ring": 2, "beam": 2}
"""Scenes of each kind, 20 together, each with a load, noise and friction of its own."""


def cases():
    """Each kind of scene."""
    return {kind: partial(rows_of, kind) for kind in _COUNTS}


def rows_of(kind, *, quick):
    return [row for k in range(1 if quick else _COUNTS[kind])
            for row in judged(kind, k, 3 if quick else RUNS)]  # fmt: skip


def planned_scene(kind, number):
    """A scene of a kind with its stated inputs."""
    rng = np.random.default_rng([number, 39])
    if kind in _CONTACTS:
        scene = parse_scene(_CONTACTS[kind])
    else:
        sizes, pixel, load = _BODIES[kind]
        scene = parse_scene(_BODY.format(shape=kind, sizes=sizes, pixel=pixel, load=load))
    load, noise = scene.get("load.normal_n") * rng.uniform(0.6, 1.4), rng.uniform(1.0, 4.0)
    values = {"load.normal_n": load, "camera.noise_grey": noise}
    if kind in ("sliding", "worn"):
        values["friction.coefficient"] = rng.uniform(0.1, 0.3)
    for key, relative in STATED.items():
        part, _, name = key.partition(".")
        value = getattr(getattr(scene, part), name, None)
        if value is not None:
            values[key] = {"value": value, "standard_uncertainty": relative * value}
    return scene.with_values(values)


def virtual_run(scene, seed):
    """The true scene of a run, its inputs drawn about what is stated, and its frame."""
    rng = np.random.default_rng(seed)
    truth = scene.with_values({
        key: scene.get(key) + spread * rng.normal() for key, spread in scene.uncertainties.items()
    })  # fmt: skip
    light = polariscope_light(truth, stress_map(truth, scene_states(truth)[-1]))
    image = np.asarray(camera_frame(truth, light, rng=rng))
    frame = Frame(0, image, None, "run")
    return truth, prepare_frame(frame, frame_scene(scene, 0), bit_depth=8)


def all_keys(one):
    """The unknowns of a one-state scene, and its inputs, which have priors."""
    return (*free_keys(one), *stated_inputs(one).keys)


def judged(kind, number, runs, *, as_stated=True):
    """A row for each wanted value: the plan beside so many runs."""
    scene = planned_scene(kind, number)
    start = time.process_time()
    vary = {"load.normal_n": [scene.get("load.normal_n")]}
    now = plan(scene, vary, frames=(1,), as_stated=as_stated).now.values
    seconds = time.process_time() - start
    errors, refused = {key: [] for key in now}, 0
    for run in range(runs):
        truth, data = virtual_run(scene, [list(_COUNTS).index(kind), number, run])
        one = frame_scene(scene, 0)
        try:
            if as_stated:
                found = fit_frame(data, one, all_keys(one))
            else:
                found = fit_with_causes(data, one).fit
        except PhysicsError:
            refused += 1
            continue
        for key, values in errors.items():
            value = found.values[found.keys.index(key)]
            values.append(value / truth.get(key) - 1.0)
    rows = []
    for key, values in errors.items():
        scatter = float(np.sqrt(np.mean(np.square(values)))) if values else float("nan")
        share = now[key].relative
        rows.append(
            PlanRow(
                scene=f"{kind} {number}", key=key, planned=share, scatter=scatter,
                ratio=share / scatter, runs=len(values), refused=refused, seconds=seconds,
            )
        )  # fmt: skip
    return rows


HEAD = ("scene", "value", "planned", "scatter", "ratio", "runs", "refused", "CPU s")

_FOOT = """\
planned: relative standard uncertainty that `plan` says; scatter: root mean square of the errors of
virtual runs. In each run inputs are drawn about what is stated (pixel 0.2 %, thickness 0.3 %,
f_sigma 0.5 %, E 2 %, R 0.1 %), with noise of 1 to 4 grey levels; frames of 220 x 164 and 220 x 220
pixels. The scatter of 200 runs is itself known to 5 %."""


def table(rows: list[PlanRow]) -> str:
    """A line for each value of each scene."""
    cells = [
        (row.scene, row.key, f"{100 * row.planned:.3g} %", f"{100 * row.scatter:.3g} %",
         f"{row.ratio:.2f}", str(row.runs), str(row.refused), f"{row.seconds:.2f}")
        for row in rows
    ]  # fmt: skip
    return "\n".join([*lines_of(HEAD, cells, texts=2), "", _FOOT, machine()])


def figure(rows: list[PlanRow]):
    """Planned uncertainties over the scatter."""
    from isochrome.figures import LINE_COLOURS, new_figure, style_axes

    picture = new_figure(8.0, 5.0)
    axes = picture.subplots()
    for key, colour in zip(dict.fromkeys(row.key for row in rows), LINE_COLOURS, strict=False):
        some = [row for row in rows if row.key == key]
        axes.loglog([100 * r.scatter for r in some], [100 * r.planned for r in some], "o",
                    color=colour, label=key)  # fmt: skip
    ends = np.array(axes.get_xlim())
    axes.loglog(ends, ends, color="0.5", lw=0.8)
    for bar in (1.0 - BAR, 1.0 + BAR):
        axes.loglog(ends, bar * ends, color="0.5", lw=0.8, ls="--")
    axes.legend(frameon=False)
    style_axes(axes, x_label="scatter of the runs (%)", z_label="planned (%)")
    return picture
