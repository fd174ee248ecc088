"""What a fit finds in seeded frames of 659 x 494 whose truth is known: errors, pulls, and its
processor time over one evaluation of its renderer, which is the claim."""

import importlib
import sys
import time
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from isochrome.benchmarks import benchmarks_folder
from isochrome.figures import LINE_COLOURS

from .report import lines_of, machine
from .rows import FitRow

ONE, COLD, SEQUENCE = "one frame", "cold start", "sequence of six"
LOAD, FRICTION = "load.normal_n", "friction.coefficient"
WEAR = "wear.coefficient_mm2_per_n"
SEED = 20


@contextmanager
def _tests():
    """The folders of the tests on the path, whose modules make the frames."""
    root = benchmarks_folder().parent
    own = [str(root), str(root / "fitting")]
    sys.path[:0] = own
    try:
        yield
    finally:
        for name in own:
            sys.path.remove(name)


@lru_cache(maxsize=8)
def made_by(name):
    """A module of the tests that makes frames, such as 'engine_frames'."""
    with _tests():
        return importlib.import_module(name)


def timed(work):
    """What some work gives, and its processor time in seconds, on one thread."""
    from isochrome.runs import single_threaded

    with single_threaded():
        start = time.process_time()
        found = work()
        return found, time.process_time() - start


@lru_cache(maxsize=1)
def evaluation_s():
    """Processor time (s) of one evaluation of a sliding contact's light at every pixel."""
    from isochrome.fitting import SceneRenderer, with_numerics

    frames = made_by("engine_frames")
    scene, _ = frames.random_contact(np.random.default_rng(SEED), "slide")
    scene = with_numerics(scene)
    renderer = SceneRenderer(scene, (494, 659))
    renderer.signal(scene)
    loads = [scene.get(LOAD) * (1.0 + 1e-4 * k) for k in range(1, 8)]
    moved = [scene.with_values({LOAD: load}) for load in loads]
    return float(np.median([timed(lambda s=s: renderer.signal(s))[1] for s in moved]))


class Rows:
    """The rows of one problem, which carry the same cost."""

    def __init__(self, problem, case, seconds):
        self.problem, self.case, self.seconds, self.found = problem, case, seconds, []

    def add(self, quantity, error, bar, unit, *, pull=float("nan")):
        """An error in some unit beside its bar; `pull`, of all keys, as a root mean square."""
        ratio = self.seconds / evaluation_s()
        self.found.append(
            FitRow(
                self.problem, self.case, quantity, float(error), bar, unit, float(pull),
                1e3 * self.seconds, ratio,
            )
        )  # fmt: skip


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def one_frame(quick=False):
    """Load, place and friction of sliding contacts, from 10 % and ten pixels off."""
    frames = made_by("engine_frames")
    errors, orders, pulls, seconds = [], [], [], []
    count = 1 if quick else 8
    for seed in range(count):
        scene, true = frames.random_contact(np.random.default_rng([SEED, seed]), "slide")
        scene = scene.with_values(frames.HALF_SIZE) if quick else scene
        rng = np.random.default_rng([SEED, seed, 1])
        start = frames.begun(rng, scene, true, share=0.1, place_px=10.0)
        frame = frames.captured(scene, seed)
        fit, cost = timed(lambda f=frame, s=start, t=true: frames.fitted(f, s, t))
        off = dict(zip(fit.keys, fit.values, strict=True))[LOAD] / true[LOAD] - 1.0
        errors.append(off)
        off = frames.picture_of(fit.scene).order - frames.picture_of(scene).order
        orders.append(rms(off[np.isfinite(off)]))
        pulls.append(frames.pulls(fit, true))
        seconds.append(cost)
    rows = Rows(ONE, f"{count} contacts, start within 10 %", float(np.median(seconds)))
    rows.add("load, worst", 100.0 * np.abs(errors).max(), 0.02, "%", pull=rms(pulls))
    rows.add("fringe order, worst RMS", max(orders), 3e-4, "fringe")
    return rows.found


def cold_start(quick=False):
    """Held contacts in partial slip, with bulk stress, from a load up to four times off."""
    from isochrome.fitting import fit_frame

    frames = made_by("cold_frames")
    load, shear, pulls, seconds, wrong, silent = [], [], [], [], 0, 0
    count = 1 if quick else 100
    for seed in range(count):
        case = frames.random_case("held", 1000 * SEED + seed)
        fit, cost = timed(lambda c=case: fit_frame(c.data, c.begun, c.keys))
        seconds.append(cost)
        if not frames.is_right(case, fit):
            wrong += 1
            silent += fit.chi <= frames.RIGHT_CHI
            continue
        off = case.errors(fit)
        load.append(abs(off[0]) / case.true.load.normal_n)
        shear.append(abs(off[case.keys.index("load.tangential_n")] / case.true.load.tangential_n))
        pulls.append(off / fit.standard_uncertainty)
    rows = Rows(COLD, f"{count} contacts, load off by up to 4", float(np.median(seconds)))
    rows.add("wrong", 100.0 * wrong / count, 2.0, "%")
    rows.add("wrong, and chi near 1", 100.0 * silent / count, 0.0, "%")
    if load:
        rows.add("load, worst", 100.0 * max(load), 0.03, "%", pull=rms(pulls))
        rows.add("tangential force, worst", 100.0 * max(shear), 0.15, "%")
    return rows.found


DISTANCES = (0.0, 31.0, 77.0, 155.0, 233.0)
RISING = {"distance_m": DISTANCES, "value": (0.12, 0.18, 0.24, 0.28, 0.30)}


def sequence(quick=False):
    """Six frames of one run of the paper's case: constant wear, rising friction, one load; from
    values that are off."""
    from isochrome.fitting import fit
    from isochrome.output import write_tiff
    from isochrome.scene import parse_scene
    from isochrome.simulation import simulate

    frames = made_by("engine_frames")
    texts = made_by("scene_texts")
    text = texts.PAPER_CONTACT + texts.SMALL_CAMERA
    text += "\n[friction]\ncoefficient = 0.2\nstatic_state_first = true\n\n[wear]\n"
    text += f"coefficient_mm2_per_n = 2.3e-9\ndistances_m = {list(DISTANCES)}\n"
    camera = frames.CAMERA | (frames.HALF_SIZE if quick else {})
    begun = parse_scene(text).with_values(camera)
    truth = begun.with_values({WEAR: 2e-9, FRICTION: RISING})
    with TemporaryDirectory() as folder:
        path = Path(folder) / "frames.tif"
        write_tiff(path, simulate(truth).frames, pixel_mm=truth.camera.pixel_mm)
        found, seconds = timed(lambda: fit(path, begun, [WEAR, LOAD], per_frame=[FRICTION]))
    k = found.shared[WEAR]
    sliding = zip(found.frames[1:], RISING["value"], strict=True)
    told = [(own[FRICTION], true) for own, true in sliding]
    errors = [own["value"] - true for own, true in told]
    pulls = [(own["value"] - true) / own["standard_uncertainty"] for own, true in told]
    rows = Rows(SEQUENCE, "Archard's law, friction 0.12 to 0.30", seconds)
    pull = (k["value"] - 2e-9) / k["standard_uncertainty"]
    rows.add("wear coefficient", 100.0 * abs(k["value"] / 2e-9 - 1.0), 0.5, "%", pull=abs(pull))
    rows.add("friction, worst", np.abs(errors).max(), 0.003, "", pull=rms(pulls))
    return rows.found


def cases():
    """Each problem's case by its name."""
    return {ONE: one_frame, COLD: cold_start, SEQUENCE: sequence}


HEAD = ("problem", "case", "quantity", "error", "bar", "pull", "CPU", "evaluations")
_LEAST = 1e-4
"""Share of its bar at which an error that is none is drawn."""


def table(rows: list[FitRow]) -> str:
    """The rows as a table in plain text, with what they mean."""
    cells, last = [], None
    for row in rows:
        own = row.problem, row.case
        cells.append(_cells(row, first=own != last))
        last = own
    return "\n".join([*lines_of(HEAD, cells, texts=3), "", _FOOT, machine()])


_FOOT = """\
error: of what was found against the truth, beside the bar it is to stay below; pull: errors over
their standard uncertainties, root mean square over all keys of the case where there are several.
CPU: processor time of one thread of one fit (the median of several), and how many evaluations of
the light of a sliding contact at all 659 x 494 pixels would take as long.
Rendered frames of 659 x 494 pixels, 8 bits, noise of 3 grey levels, 30 % vignette."""


def _cells(row: FitRow, *, first: bool) -> tuple[str, ...]:
    """A row's texts; what its case has in common stands in the first of its rows."""
    return (
        row.problem, row.case if first else "", row.quantity, _with_unit(row.error, row.unit),
        _with_unit(row.bar, row.unit), f"{row.pull:.2f}" if row.pull == row.pull else "-",
        f"{row.cpu_ms:.0f} ms" if first else "", f"{row.evaluations:.0f}" if first else "",
    )  # fmt: skip


def _with_unit(value: float, unit: str) -> str:
    return f"{value:.2g} {unit}".rstrip() if value < 100.0 else f"{value:.0f} {unit}".rstrip()


def share(row: FitRow) -> float:
    """A row's error over its bar; 1 and less is good."""
    if row.bar == 0.0:
        return 0.0 if row.error == 0.0 else float("inf")
    return row.error / row.bar


def figure(rows: list[FitRow]):
    """Each error as a share of its bar, and what a fit of each case costs."""
    from isochrome.figures import new_figure, style_axes

    blue, orange = LINE_COLOURS[:2]
    picture = new_figure(11.0, 0.34 * len(rows) + 1.9)
    errors, costs = picture.subplots(1, 2, sharey=True, width_ratios=(1.3, 1.0))
    cases = {(row.problem, row.case) for row in rows}
    several = {p for p, _ in cases if sum(p == other for other, _ in cases) > 1}
    names, last = [], None
    for k, row in enumerate(rows):
        names.append(f"{row.case if row.problem in several else row.problem}: {row.quantity}")
        part = min(max(share(row), _LEAST), 1.0 / _LEAST)
        colour = blue if share(row) <= 1.0 else orange
        errors.plot([_LEAST, part], [k, k], color=colour, lw=1.2, alpha=0.5)
        errors.plot(part, k, "o", color=colour, ms=6)
        if (row.problem, row.case) != last:
            costs.plot(row.evaluations, k, "s", color=blue, ms=6)
            costs.annotate(
                f"{1e-3 * row.cpu_ms:.2g} s", (row.evaluations, k), (7, 0),
                textcoords="offset points", va="center", fontsize="small",
            )  # fmt: skip
        last = row.problem, row.case
    errors.axvline(1.0, color="0.3", lw=1.0, ls="--")
    errors.set_xscale("log")
    costs.set_xscale("log")
    costs.set_xlim(1.0, 4.0 * max(row.evaluations for row in rows))
    errors.set_yticks(range(len(rows)), names)
    errors.invert_yaxis()
    titles = ("Error over its bar (dashed)", "Processor time of one fit, one thread")
    labels = ("error / bar", "evaluations of the renderer")
    for axes, title, label in zip((errors, costs), titles, labels, strict=True):
        style_axes(axes, x_label=label, z_label="", title=title)
        axes.tick_params(labelsize="small")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.grid(alpha=0.3, lw=0.5)
        axes.set_axisbelow(True)
    picture.suptitle("What a fit finds in rendered frames, against the truth")
    return picture
