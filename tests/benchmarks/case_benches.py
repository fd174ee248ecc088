"""Frames of benches by `outside_bench`, static, sliding and worn, with one to four facts that the
scene leaves out: load, friction and modulus in their uncertainties, what is named, and the cost."""

from functools import partial

import numpy as np

from isochrome.estimation import prepare_frame
from isochrome.frames import Frame
from isochrome.scene import load_scene

from . import case_defects
from .outside_bench import BenchContact
from .outside_camera import Defects
from .report import lines_of, machine, of_seeds, share_figure
from .rows import BenchRow

FRAMES = {"clean": 100, "benches": 300, "atlas": 200, "material": 100, "plane": 100}


def _either_way(rng, low, high):
    return rng.choice([-1.0, 1.0]) * rng.uniform(low, high)


FACTS = {
    "modulus": lambda rng: {"modulus_change": _either_way(rng, 0.02, 0.2)},
    "plane": lambda rng: {"plane_stress": True},
    "layer": lambda rng: {"layer_mm_per_mpa": rng.uniform(1e-5, 1e-4)},
    "rough": lambda rng: {"roughness_mm": rng.uniform(1e-4, 4e-4)},
    "tilt": lambda rng: {"tilt": rng.uniform(0.1, 0.7)},
    "focus": lambda rng: {"focus_mm": _either_way(rng, 0.1, 1.0)},
    "edge": lambda rng: {
        "edge_mpa": _either_way(rng, 0.1, 0.5), "edge_mm": rng.uniform(0.15, 0.6)
    },
    "fringe": lambda rng: {"fringe_change": rng.uniform(-0.01, 0.01)},
    "swing": lambda rng: {"swing": rng.uniform(0.01, 0.05)},
    "roll": lambda rng: {"roll_deg": _either_way(rng, 0.1, 0.5)},
    "blur": lambda rng: {"blur_px": rng.uniform(0.3, 1.0)},
    "smooth": lambda rng: {
        "smooth_mpa": rng.uniform(-0.4, 0.4), "bending_mpa_per_mm": rng.uniform(-0.15, 0.15)
    },
}  # fmt: skip
"""What a bench has, and how strong it is drawn: the sizes of PHYSICS.md's table."""

_OF_CAMERA = ("roll_deg", "blur_px")

_MODULUS = "another modulus of the specimen, or another radius of what presses on it"
_SOFT = ("a soft or rough layer between the bodies", "rough surfaces")
NAMES = {
    "modulus": (_MODULUS,), "plane": (_MODULUS, "a plate in plane stress"),
    "layer": _SOFT, "rough": _SOFT, "tilt": ("a load that is uneven through the thickness",),
    "focus": ("a focus off the middle of the plate",),
    "edge": ("stress along a machined surface",),
    "swing": ("a load that swings within the exposure",),
    "roll": ("the camera's roll",), "blur": ("blur",),
    "smooth": ("a smooth stress besides the contact's",),
}  # fmt: skip
"""What each may be called; the fringe value is within what the scene states, and has no name."""

NAMED = 0.9
"""Chance from which on a cause counts as named, as in `case_contacts`."""

_LEFT_OVER = {
    "an order that no cause explains", "a stress that no cause explains",
    "what the scene states with an uncertainty",
}  # fmt: skip
"""What is said to be there without a cause."""

PRIORS = {
    "camera.pixel_mm": 0.001, "specimen.fringe_value_n_per_mm": 0.003, "load.normal_n": 0.005,
    "specimen.young_gpa": 0.1,
}  # fmt: skip
"""Relative standard uncertainties of what is stated where the material is asked for."""

_EITHER = 0.5
"""Share of plane stress from which on a frame says that its plate is in plane stress."""

_DRIFT = 0.006
"""Relative standard uncertainty of the fringe value where it is off by up to 1 %."""


def cases():
    return {kind: partial(of_seeds, judged, kind, range(n)) for kind, n in FRAMES.items()}


def bench(kind, seed):
    """A bench, the names of its facts, and the numbers that are drawn on; its state by the seed."""
    rng = np.random.default_rng([seed, 39, list(FRAMES).index(kind)])
    names = _drawn(kind, seed, rng)
    values = {key: value for name in names for key, value in FACTS[name](rng).items()}
    camera = {key: values.pop(key) for key in _OF_CAMERA if key in values}
    state = ("static", "sliding", "worn")[(seed if kind != "atlas" else seed // len(FACTS)) % 3]
    if kind == "material":
        values["modulus_change"] = rng.uniform(-0.05, 0.05)
    if state != "static":
        values["friction"] = _either_way(rng, 0.1, 0.3)
    if state == "worn":
        values["worn_m"] = rng.uniform(20.0, 233.0)
    shape = 164, 220
    made = BenchContact(
        load_n=rng.uniform(25.0, 60.0), shape=shape, pixel_mm=4.0 / shape[1],
        left_mm=-2.0 + rng.uniform(-0.2, 0.2), **values,
        defects=Defects(noise=rng.uniform(1.0, 3.0), fall_off=rng.uniform(0.0, 0.4), **camera),
    )  # fmt: skip
    return made, names, state, rng


def _drawn(kind, seed, rng):
    """Names of a bench's facts: none, each in turn, or one to four of which no two are alike."""
    names = list(FACTS)
    if kind == "plane":
        return ["plane"] if seed // 3 % 2 else []
    if kind in ("clean", "material"):
        return []
    if kind == "atlas":
        return [names[seed % len(names)]]
    for alike in (("modulus", "plane"), ("layer", "rough")):
        names.remove(rng.choice(alike))
    return rng.choice(names, 1 + seed // 3 % 4, replace=False).tolist()


def stated(kind, made, names, rng):
    """The scene as its user states it: the load off by up to a fifth, or inputs by their priors."""
    spread = PRIORS if kind == "material" else {}
    if "fringe" in names:
        spread = {"specimen.fringe_value_n_per_mm": _DRIFT}
    scene = load_scene(made.scene())
    if kind == "plane":
        scene = scene.with_values({"specimen.plane": "unknown"})
    values = {"load.normal_n": made.load_n * rng.uniform(0.8, 1.2)}
    for key, relative in spread.items():
        # the modulus begins at the data sheet's, whose uncertainty holds the truth
        off = relative * rng.normal() if kind == "material" and key != "specimen.young_gpa" else 0.0
        number = scene.get(key)
        values[key] = {
            "value": number * (1.0 + off), "standard_uncertainty": relative * number
        }  # fmt: skip
    return scene.with_values(values)


def judged(kind, seed):
    made, names, state, rng = bench(kind, seed)
    image = made.frame(int(rng.integers(2**31)))
    scene = stated(kind, made, names, rng)
    data = prepare_frame(Frame(0, image, None, "bench"), scene, bit_depth=8)
    truth = {"load.normal_n": made.load_n}
    if made.friction:
        truth["friction.coefficient"] = made.friction
    young = made.young_gpa * (1.0 + made.modulus_change)

    def told(freed):
        there = {name for name, chance in freed.chances.items() if chance >= NAMED} - _LEFT_OVER
        wanted = [set(NAMES[name]) for name in names if name in NAMES]
        right = set().union(*wanted)
        causes = [cause.name for cause in freed.causes if cause.name not in _LEFT_OVER]
        first = causes[0] if causes else None
        of_modulus = _young(freed.fit, young) if not made.plane_stress else {}
        if kind == "plane":
            share = freed.fit.values[freed.fit.keys.index("specimen.plane_stress_share")]
            verdict = (share > _EITHER) == made.plane_stress
            return {
                "found": "; ".join(sorted(there)),
                "named": verdict,
                "first": verdict,
                "freed_in_vain": len(there),
            }
        return of_modulus | {
            "found": "; ".join(sorted(there)),
            "named": all(some & there for some in wanted),
            "first": first in right if right else not there,
            "freed_in_vain": len(there - right),
        }

    row = BenchRow(kind, seed, ", ".join(names), state=state)
    return case_defects.fitted(row, data, scene, truth, told)


def _young(fit, young):
    """Error of the modulus, in per cent and over its uncertainty, and this; where it is fitted."""
    if "specimen.young_gpa" not in fit.keys:
        return {}
    at = fit.keys.index("specimen.young_gpa")
    off, spread = fit.values[at] - young, fit.standard_uncertainty[at]
    return {
        "young_percent": 100.0 * off / young, "young_pull": off / spread,
        "young_spread": 100.0 * spread / young,
    }  # fmt: skip


HEAD = (
    "frames", "count", "load in 2 u", "friction", "modulus", "u of it", "named", "first", "in vain",
    "chi .97-1.03", "over bound", "worst load", "seconds", "of clean",
)  # fmt: skip

_WITHIN, _CHI = 2.0, 0.03

_FOOT = """\
u: combined standard uncertainty; named, first: each fact, and one of them before all else, by a
chance of 0.9 at least; in vain: frames of which something else was named; over bound: median of the
uncertainty over the Cramér-Rao bound of the scene as stated; seconds: median processor time, and
over that of the clean frames. Frames of 220 x 164 pixels by strips and traced rays, which share no
code with our contact, stress, optics and camera."""


def table(rows):
    """By kind, by state, by number of facts, and by single fact; then the frames beyond 4 u."""
    groups = {}
    for row in rows:
        groups.setdefault(row.kind, []).append(row)
        if row.kind == "benches":
            groups.setdefault(f" {row.state}", []).append(row)
            groups.setdefault(f" facts: {row.defects.count(',') + 1}", []).append(row)
        if row.kind == "atlas":
            groups.setdefault(f" {row.defects}", []).append(row)
    clean = [row.seconds for row in rows if row.kind == "clean" and not row.refused]
    clean = np.median(clean) if clean else np.nan
    cells = [_cells(name, some, clean) for name, some in groups.items()]
    beyond = [
        f"{row.kind} {row.seed} ({row.state}): {row.defects} -> {row.found}; load "
        f"{row.load_percent:+.3f} %, pulls {row.load_pull:+.1f}, {row.friction_pull:+.1f}, "
        f"{row.young_pull:+.1f}, chi {row.chi:.2f}"
        for row in rows
        if not row.refused and _worst(row) > 2.0 * _WITHIN
    ]
    gone = [f"{row.kind} {row.seed}: {row.defects}: {row.refused}" for row in rows if row.refused]
    lines = [line for line in lines_of(HEAD, cells, texts=1) if line]
    return "\n".join([*lines, "", *beyond, *gone, _FOOT, machine()])


def _cells(name, some, clean):
    fitted = [row for row in some if not row.refused]
    if not fitted:
        return (name, str(len(some)), *["-"] * (len(HEAD) - 2))

    def share(flags):
        return f"{100.0 * np.mean(flags):.0f} %" if len(flags) else "-"

    pulls = {
        key: [abs(getattr(row, key)) for row in fitted if getattr(row, key) == getattr(row, key)]
        for key in ("load_pull", "friction_pull", "young_pull", "young_spread")
    }
    seconds = np.median([row.seconds for row in fitted])
    spread = pulls.pop("young_spread")
    return (
        name, str(len(some)),
        *(share(np.array(values) <= _WITHIN) for values in pulls.values()),
        f"{np.median(spread):.2f} %" if spread else "-",
        *(share([getattr(row, key) for row in fitted]) for key in ("named", "first")),
        str(sum(row.freed_in_vain > 0 for row in fitted)),
        share([abs(row.chi - 1.0) <= _CHI for row in fitted]),
        f"{np.median([row.over_bound for row in fitted]):.2f}",
        f"{max(abs(row.load_percent) for row in fitted):.2f} %", f"{seconds:.1f}",
        f"{seconds / clean:.1f}",
    )  # fmt: skip


def _worst(row):
    return float(np.nanmax(np.abs([row.load_pull, row.friction_pull, row.young_pull])))


def figure(rows):
    """Share of the frames within so many standard uncertainties, a line for each kind."""
    fitted = [(row.kind, _worst(row)) for row in rows if not row.refused]
    return share_figure(
        fitted, "frames", "error over standard uncertainty", "Benches that are not ours",
        mark=_WITHIN,
    )  # fmt: skip
