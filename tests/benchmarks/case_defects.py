"""Random contacts by `outside_camera` with no defect, one or three: value, uncertainty and cause,
and what the asking costs."""

import time
from dataclasses import asdict, replace
from functools import partial

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import prepare_frame
from isochrome.fitting import fit_frame, fit_with_causes
from isochrome.frames import Frame
from isochrome.scene import load_scene

from .outside_camera import Defects, frame
from .report import lines_of, machine, of_seeds, share_figure
from .rows import DefectRow

FRAMES = {"clean": 60, "single": 150, "three": 90}

ROWS_ABOVE = 40

STRENGTHS = {
    "roll": {"roll_deg": (-2.0, 2.0)}, "distortion": {"distortion": (-0.02, 0.02)},
    "keystone x": {"keystone_x": (-0.02, 0.02)}, "keystone z": {"keystone_z": (-0.02, 0.02)},
    "gamma": {"gamma": (0.45, 2.2)}, "blur": {"blur_px": (0.8, 2.0)},
    "plates": {"plate_error_deg": (3.0, 15.0)}, "band": {"band_nm": (10.0, 40.0)},
    "light": {"spot": (0.05, 0.5), "bar": (0.05, 0.5)},
    "stray light": {"background": (0.05, 0.3), "background_slope": (0.2, 1.0)},
    "dust": {"dust": (10, 40)}, "shadow": {"shadow_px": (2, 8)},
    "noise": {"row_noise": (0.2, 1.0), "flicker": (0.0, 0.005)}, "jpeg": {"jpeg": (80, 95)},
    "deep": {"bits": (12, 12), "container": (16, 16)},
}  # fmt: skip
"""Defects by name, and between what their strengths are drawn."""

UNNAMED = ("noise", "jpeg", "deep")
"""What is a property of the sensor, and no cause to be found."""

KEYS = {
    "roll": "camera.roll_deg", "distortion": "camera.distortion", "keystone x": "camera.keystone_x",
    "keystone z": "camera.keystone_z", "gamma": "frames.gamma", "blur": "camera.blur_px",
    "plates": "polariscope.input_plate_error_deg", "band": "polariscope.bandwidth_nm",
}  # fmt: skip
"""The key in which a defect is to be found; others by richer light, or by what is left out."""


def cases():
    return {kind: partial(of_seeds, judged, kind, range(n)) for kind, n in FRAMES.items()}


def judged(kind, seed):
    rng = np.random.default_rng([seed, list(FRAMES).index(kind)])
    scene = contact(rng)
    names = drawn(kind, seed, rng)
    image = frame(scene, defects(names, rng), int(rng.integers(2**31)))
    data = prepare_frame(Frame(0, image, None, "bench"), scene, bit_depth=8 * image.itemsize)
    known = ("load.normal_n", *(("friction.coefficient",) if scene.friction else ()))
    truth = {key: scene.get(key) for key in known}
    begun = scene.with_values({"load.normal_n": truth["load.normal_n"] * rng.uniform(0.8, 1.2)})

    def told(freed):
        groups = found_of(freed)
        found = [name for group in groups for name in group]
        first = {name for group in groups[: 2 if kind == "three" else 1] for name in group}
        return {
            "found": ", ".join(found),
            "named": all(name in found for name in names if name not in UNNAMED),
            "first": bool(first & set(names)) or set(names) <= set(UNNAMED),
        }

    return fitted(DefectRow(kind, seed, ", ".join(names)), data, begun, truth, told)


def fitted(row, data, begun, truth, told):
    """A row with what a frame's fit gives: `told` of it what is found, the `truth` its errors."""
    try:
        plain = time.process_time()
        fit_frame(data, begun)
        start = time.process_time()
        freed = fit_with_causes(data, begun)
        seconds = time.process_time() - start
    except PhysicsError as error:
        return replace(row, refused=str(error))
    fit = freed.fit
    at = {key: fit.keys.index(key) for key in truth}
    pulls = {
        key: (fit.values[j] - truth[key]) / fit.standard_uncertainty[j] for key, j in at.items()
    }
    bounds = [fit.standard_uncertainty[j] / fit.cramer_rao_bound[j] for j in at.values()]
    load = fit.values[at["load.normal_n"]] / truth["load.normal_n"] - 1.0
    return replace(
        row, **told(freed), over_bound=float(max(bounds)), load_percent=100.0 * load,
        load_pull=pulls["load.normal_n"],
        friction_pull=pulls.get("friction.coefficient", float("nan")), chi=fit.chi,
        flagged=bool(freed.asked) or fit.chi > 1.3 or not fit.positive,
        cost=seconds / max(start - plain, 1e-9), seconds=seconds,
    )  # fmt: skip


def contact(rng):
    """A static, a sliding or a worn contact in a picture of 659 x 494 pixels."""
    values = {
        "load.normal_n": float(rng.uniform(25.0, 60.0)), "friction.static_state_first": False,
        "friction.coefficient": float(rng.uniform(0.1, 0.3)),
        "wear.distances_m": (float(rng.uniform(20.0, 230.0)),), "polariscope.wavelength_nm": 587.0,
        "camera.left_mm": float(-2.0 + rng.uniform(-0.2, 0.2)),
    }  # fmt: skip
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


HEAD = (
    "frames", "count", "within 3 u", "beyond 6 u, not flagged", "pull load", "pull friction",
    "worst load", "named", "first", "freed in vain", "over bound", "cost",
)  # fmt: skip

_FOOT = """\
u: standard uncertainty; pulls: errors over it, root mean square; named: each defect is among what
was found; first: one of them is said first (of three: among the first two); freed in vain:
something else was; over bound: median of the uncertainty over its Cramér-Rao bound; cost: median
processor time over that of the fit as stated. Frames of 659 x 494 pixels by a script that shares no
code with our optics and camera."""

_BEYOND, _FAR = 3.0, 6.0


def table(rows: list[DefectRow], foot: str = _FOOT) -> str:
    """By kind of frame and single defect; then each frame whose values are beyond 3 u."""
    groups = {}
    for row in rows:
        groups.setdefault(row.defects if row.kind == "single" else row.kind, []).append(row)
    cells = [_cells(name, some) for name, some in groups.items()]
    beyond = [
        f"{row.kind} {row.seed}: {row.defects} -> {row.found}; load {row.load_percent:+.3f} %, "
        f"pulls {row.load_pull:+.1f}, {row.friction_pull:+.1f}, chi {row.chi:.2f}"
        for row in rows
        if not row.refused and _worst(row) > _BEYOND
    ]
    reasons = [
        f"{row.kind} {row.seed}: {row.defects}: {row.refused}" for row in rows if row.refused
    ]
    return "\n".join([*lines_of(HEAD, cells, texts=1), "", *beyond, *reasons, foot, machine()])


def _cells(name: str, some: list[DefectRow]) -> tuple[str, ...]:
    kept = [row for row in some if not row.refused]
    within = np.mean([_worst(row) <= _BEYOND for row in kept]) if kept else np.nan
    far = sum(_worst(row) > _FAR and not row.flagged for row in kept)
    vain = sum(not _asked_for(row) for row in kept)
    pulls = ([getattr(row, key) for row in kept] for key in ("load_pull", "friction_pull"))
    worst = max((abs(row.load_percent) for row in kept), default=np.nan)
    named, first = (
        np.mean([getattr(row, key) for row in kept] or [np.nan]) for key in ("named", "first")
    )
    return (
        name, str(len(some)), f"{100.0 * within:.0f} %", str(far),
        *(f"{_rms(values):.2f}" for values in pulls), f"{worst:.3f} %", f"{100.0 * named:.0f} %",
        f"{100.0 * first:.0f} %", str(vain),
        f"{np.median([row.over_bound for row in kept] or [np.nan]):.2f}",
        f"{np.median([row.cost for row in kept] or [np.nan]):.1f}",
    )  # fmt: skip


def _asked_for(row: DefectRow) -> bool:
    """Whether nothing was found that is not there; light and dust have two names each."""
    alike = {"light": "stray light", "stray light": "light", "dust": "shadow", "shadow": "dust"}
    there = set(row.defects.split(", "))
    there |= {alike[name] for name in there if name in alike}
    return set(row.found.split(", ")) - {""} <= there


def _worst(row: DefectRow) -> float:
    return float(np.nanmax(np.abs([row.load_pull, row.friction_pull])))


def _rms(values: list[float]) -> float:
    known = [value for value in values if value == value]  # a static contact has no friction
    return float(np.sqrt(np.mean(np.square(known)))) if known else float("nan")


def figure(rows: list[DefectRow]):
    """Share of the frames within so many standard uncertainties, a line for each kind."""
    kept = [(row.kind, _worst(row)) for row in rows if not row.refused]
    return share_figure(
        kept, "frames", "error over standard uncertainty", "Frames of benches that are not ours",
        mark=_BEYOND,
    )  # fmt: skip
