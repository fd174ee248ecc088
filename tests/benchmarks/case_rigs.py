"""Beams on the rigs of `outside_rigs`, each with one or two facts that its set leaves out: the
fringe value in its uncertainty, what is named, lenses that are not there, and the cost."""

import time
import warnings
from dataclasses import replace
from functools import partial

import numpy as np

from isochrome import calibrate_bending
from isochrome.errors import IsochromeError

from .outside_camera import NONE
from .outside_rigs import Rig
from .report import lines_of, machine, of_seeds, share_figure
from .rows import RigRow

RIGS = {"clean": 12, "rigs": 60}

F_SIGMA, HEIGHT, INNER, OUTER = 14.6, 20.0, 40.0, 100.0
PER_MPA = 4.0 / F_SIGMA
"""Fringes a MPa of a beam 4 mm thick."""

SPAN_MM = 0.03
"""Standard uncertainty of the spans, by which what is stated is off."""


def _either_way(rng, low, high):
    return float(rng.choice([-1.0, 1.0]) * rng.uniform(low, high))


FACTS = {
    "moment": lambda rng: {"uneven": _either_way(rng, 0.005, 0.02)},
    "edge": lambda rng: {
        "edge": tuple(PER_MPA * _either_way(rng, 0.2, 0.5) for _ in range(2)),
        "depth": float(rng.uniform(0.02, 0.06)),
    },
    "rollers": lambda rng: {"rollers": True, "inner": float(rng.uniform(4.4, 5.2))},
    "axial": lambda rng: {"axial": _either_way(rng, 0.04, 0.1)},
    "offset": lambda rng: {"offset": _either_way(rng, 0.05, 0.15)},
    "creep": lambda rng: {"creep": _either_way(rng, 0.0015, 0.004)},
    "lens": lambda rng: {
        str(rng.choice(["distortion", "keystone_x", "keystone_z"])): _either_way(rng, 0.005, 0.02)
    },
    "roll": lambda rng: {"roll_deg": float(rng.uniform(-2.0, 2.0))},
    "light": lambda rng: {"bar": float(rng.uniform(0.2, 0.7))},
    "stray load": lambda rng: {"stray": _either_way(rng, 0.06, 0.2)},
}  # fmt: skip
"""What a rig adds, and how strong it is drawn: the sizes of PHYSICS.md's table."""

LENSES = ("camera.distortion", "camera.keystone")
SAID = {
    "moment": ("the moment changes",), "offset": ("the moment changes",),
    "edge": ("machined edges",), "rollers": ("rollers' own",), "axial": ("axial force",),
    "creep": ("creep",), "lens": LENSES, "light": ("more uneven",),
    "stray load": ("load cell", "the loads an offset"),
}  # fmt: skip
"""What the sentence of each has in it; a roll is an angle of the beam."""


def cases():
    return {kind: partial(of_seeds, judged, kind, range(n)) for kind, n in RIGS.items()}


def rig(kind, seed):
    """A rig, the names of its facts, the orders at the edge as stated, and one without load."""
    rng = np.random.default_rng([seed, 39, list(RIGS).index(kind)])
    names = list(FACTS)
    first = names[seed % len(names)]
    others = [name for name in names if name != first]
    chosen = [] if kind == "clean" else [first, *rng.choice(others, seed // len(names) % 2)]
    values = {key: value for name in chosen for key, value in FACTS[name](rng).items()}
    camera = {key: values.pop(key) for key in list(values) if hasattr(NONE, key)}
    defects = replace(NONE, noise=float(rng.uniform(1.0, 3.0)), **camera)
    count = int(rng.choice([2, 3, 4, 6]))
    orders = np.linspace(0.45, 1.0, count) * rng.uniform(2.4, 3.2)
    if rng.random() < 0.5:
        orders = np.append(0.0, orders)
    made = Rig(defects=defects, down_px=float(rng.uniform(-4.0, 4.0)), **values)
    return made, chosen, orders


def judged(kind, seed):
    made, names, orders = rig(kind, seed)
    inner = made.inner * HEIGHT / 2.0
    off = SPAN_MM * np.random.default_rng([seed, 40]).normal(size=2)
    # what is stated is the orders' load; the first image's fringe value is what is asked for
    loads = np.asarray(orders) * F_SIGMA * HEIGHT**2 * 4.0 / (6.0 * (OUTER - inner))
    tables = {
        "beam": {
            "height_mm": HEIGHT,
            "inner_span_mm": inner + off[0],
            "outer_span_mm": OUTER + off[1],
        },
        "camera": {"pixel_mm": HEIGHT / made.size_px},
        "uncertainty": {"span_mm": SPAN_MM},
        "image": [
            {"file": image, "load_n": float(load)}
            for image, load in zip(made.images(orders, seed), loads, strict=True)
        ],
    }
    row = RigRow(kind, seed, ", ".join(names), images=len(orders))
    start = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = calibrate_bending(tables)
    except IsochromeError as refusal:
        return replace(row, refused=str(refusal), seconds=time.process_time() - start)
    words = " | ".join(found.warnings)
    there = [name for name, signs in SAID.items() if any(sign in words for sign in signs)]
    off = found.fringe_value_n_per_mm / F_SIGMA - 1.0
    return replace(
        row,
        percent=100.0 * off,
        spread=100.0 * found.standard_uncertainty / F_SIGMA,
        pull=off * F_SIGMA / found.standard_uncertainty,
        named=all(name in there for name in names if name in SAID),
        false_lens="lens" in there and "lens" not in names,
        found=", ".join(there),
        chi=found.chi,
        seconds=time.process_time() - start,
    )


HEAD = (
    "rigs", "count", "refused", "in 2 u", "pull rms", "named", "false lens", "median u", "seconds",
)  # fmt: skip

_FOOT = """\
u: combined standard uncertainty of the fringe value, of the first image's material; named: each
fact that has a sentence; refused ones count as named and covered. Truth by closed forms and series
that share no code with our calibration."""


def table(rows):
    """By kind, by the number of images and by fact; then the rigs beyond 2 u, or not named."""
    groups = {}
    for row in rows:
        groups.setdefault(row.kind, []).append(row)
        if row.facts:
            groups.setdefault(f" images: {row.images}", []).append(row)
            for name in row.facts.split(", "):
                groups.setdefault(f" {name}", []).append(row)
    lines = [line for line in lines_of(HEAD, [_cells(*g) for g in groups.items()], texts=1) if line]
    bad = [
        f"{row.kind} {row.seed} ({row.images}): {row.facts} -> {row.refused or row.found}; "
        f"{row.percent:+.3f} ± {row.spread:.3f} %, pull {row.pull:+.1f}, chi {row.chi:.3f}"
        for row in rows
        if row.refused or abs(row.pull) > 2.0 or not row.named or row.false_lens
    ]
    return "\n".join([*lines, "", *bad, _FOOT, machine()])


def _cells(name, some):
    fitted = [row for row in some if not row.refused]

    def share(flags, of):
        return f"{100.0 * np.mean(flags):.0f} %" if of else "-"

    pulls = np.array([row.pull for row in fitted])
    return (
        name, str(len(some)), str(len(some) - len(fitted)), share(np.abs(pulls) <= 2.0, fitted),
        f"{np.sqrt(np.mean(pulls**2)):.2f}" if fitted else "-",
        share([row.named for row in fitted], fitted), str(sum(row.false_lens for row in fitted)),
        f"{np.median([row.spread for row in fitted]):.3f} %" if fitted else "-",
        f"{np.median([row.seconds for row in some]):.1f}",
    )  # fmt: skip


def figure(rows):
    """Share of the rigs within so many standard uncertainties, a line for each kind."""
    pulls = [(row.kind, abs(row.pull)) for row in rows if not row.refused]
    return share_figure(
        pulls, "rigs", "error over standard uncertainty", "Rigs that are not ours", mark=2.0
    )
