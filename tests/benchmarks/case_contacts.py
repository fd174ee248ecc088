"""Frames of real contacts by `outside_tractions`, with one or two facts that the scene leaves out,
and by `outside_unlisted`, with one that is in no list: load and friction in their uncertainties,
and what is named; of what is in no list, whether anything is said."""

from functools import partial

import numpy as np

from isochrome.estimation import prepare_frame
from isochrome.fitting import cause_messages
from isochrome.frames import Frame
from isochrome.scene import load_scene

from . import case_defects, outside_unlisted
from .outside_camera import Defects
from .outside_tractions import RealContact
from .report import of_seeds
from .rows import DefectRow

FRAMES = {"clean": 50, "single": 100, "two": 100, "unlisted": 100}

FACTS = {
    "modulus": lambda rng: {"modulus_change": rng.uniform(-0.2, 0.2)},
    "layer": lambda rng: {"layer_mm_per_mpa": rng.uniform(1e-5, 1e-4)},
    "wave": lambda rng: {
        "wave_mm": rng.uniform(1e-4, 1e-3), "wavelength_mm": rng.uniform(0.08, 0.5)
    },
    "flat": lambda rng: {"flat_mm": rng.uniform(1e-4, 1e-3)},
    "grain": lambda rng: {
        "grain_mm": rng.uniform(2e-4, 1e-3), "grain_at": rng.uniform(-0.7, 0.7),
        "grain_width_mm": rng.uniform(0.02, 0.1),
    },
    "uneven shear": lambda rng: {"uneven": rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.5)},
    "uncoupled": lambda rng: {"coupled": False},
    "smooth": lambda rng: {
        "smooth_mpa": rng.uniform(-0.4, 0.4), "bending_mpa_per_mm": rng.uniform(-0.15, 0.15)
    },
}  # fmt: skip
"""What a real contact has, and how strong it is drawn."""

MODULUS, TRACTIONS, SMOOTH = (
    "another modulus of the specimen, or another radius of what presses on it",
    "tractions that are not the model's",
    "a smooth stress besides the contact's",
)
LAYER = "a soft or rough layer between the bodies"
NAMES = dict.fromkeys(FACTS, TRACTIONS) | {"modulus": MODULUS, "layer": LAYER, "smooth": SMOOTH}
"""What each is called."""

NAMED = 0.9
_TOLD = {"an order that no cause explains", "a stress that no cause explains"}
"""What is said to be there without a cause."""


def cases():
    return {kind: partial(of_seeds, judged, kind, range(n)) for kind, n in FRAMES.items()}


def contact(kind, seed):
    """A contact that slides, the names of its facts, and the numbers that are drawn on."""
    rng = np.random.default_rng([seed, 38, list(FRAMES).index(kind)])
    facts, kind_of = (
        (outside_unlisted.FACTS, outside_unlisted.UnlistedContact)
        if kind == "unlisted" else (FACTS, RealContact)
    )  # fmt: skip
    names = list(facts)
    chosen = [] if kind == "clean" else [names[seed % len(names)]]
    if kind == "two":
        chosen = rng.choice(names, 2, replace=False).tolist()
    values = {key: value for name in chosen for key, value in facts[name](rng).items()}
    shape = 164, 220
    made = kind_of(
        load_n=rng.uniform(25.0, 60.0), friction=rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.3),
        shape=shape, pixel_mm=4.0 / shape[1], left_mm=-2.0 + rng.uniform(-0.2, 0.2),
        defects=Defects(noise=rng.uniform(1.0, 3.0), fall_off=rng.uniform(0.0, 0.4)), **values,
    )  # fmt: skip
    return made, chosen, rng


def judged(kind, seed):
    made, names, rng = contact(kind, seed)
    image = made.frame(int(rng.integers(2**31)))
    tables = made.scene()
    scene = load_scene(tables | {"load": {"normal_n": made.load_n * rng.uniform(0.8, 1.2)}})
    data = prepare_frame(Frame(0, image, None, "contact"), scene, bit_depth=8)
    truth = {"load.normal_n": made.load_n, "friction.coefficient": made.friction}
    wanted = {NAMES[name] for name in names if name in NAMES}

    def told(freed):
        there = {name for name, chance in freed.chances.items() if chance >= NAMED} - _TOLD
        others = sorted(name.split(",")[0] for name in there - wanted)
        return {
            "found": ", ".join([name for name in names if NAMES.get(name) in there] + others),
            "named": wanted <= there if wanted or not names else bool(cause_messages(freed)),
            "first": there <= wanted,
        }

    row = DefectRow(kind, seed, ", ".join(names))
    return case_defects.fitted(row, data, scene, truth, told)


_FOOT = """\
u: standard uncertainty; pulls: errors over it, root mean square; named, first: what is there is
named by a chance of 0.9 at least; freed in vain: something else was named; over bound: median of
the uncertainty over the Cramér-Rao bound of the scene as stated; cost: median processor time over
that of the fit as stated. Frames of 220 x 164 pixels by strips of even traction, which share no
code with our contact, stress, optics and camera."""

table = partial(case_defects.table, foot=_FOOT)
figure = case_defects.figure
