"""Fringe order by every method on the specimens of `tests/fringes/specimens.py`. Given besides: a
point of known order, or for the model a scene 5 % off in load and 3 pixels in place."""

import importlib.util
import sys
import time
from functools import lru_cache, partial

import numpy as np

from isochrome.benchmarks import benchmarks_folder
from isochrome.figures import LINE_COLOURS

from . import case_silent
from .case_silent import BLIND, FREE
from .report import lines_of, machine
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
    from isochrome.processing.kinds.with_model import WithModel
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
        found = WithModel().read([frame], start, Capture(8, dark, bright)).reading
        return found.order, found.confidence

    return read


def one_frame(seen, noise, *, ends):
    """The reading without a model, with both no-load frames or with none."""
    from isochrome.fringes import KnownOrders, KnownPlaces, read_free, widened

    shot = specimens().shoot(seen, noise=noise, seed=SEED)
    row, col, order = specimens().known_point(seen)
    known = KnownOrders((KnownPlaces(((row, col),), order),))

    def read():
        light = specimens().light_of(shot, ends=ends)
        none = np.zeros(light.wave.shape)
        found = read_free(light.wave, light.wave_sigma, light.valid, known, error=none).reading
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
            frames.astype(np.float32) / 255.0, chains,
            sigma=float(np.sqrt(noise**2 + 1.0 / 12.0)) / 255.0,
            valid=(frames < 255).all(axis=0) & seen.material, known_order=known,
        ).reading  # fmt: skip
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
            frame / 255.0, table, sigma=float(np.sqrt(noise**2 + 1.0 / 12.0)) / 255.0, dark=dark,
            bright=bright, valid=frame < 255, specimen=seen.material,
        )  # fmt: skip
        return found.order, found.confidence

    return read


METHODS = {
    ARCSINE: arcsine, MODEL: with_model, FREE: partial(one_frame, ends="both"),
    BLIND: partial(one_frame, ends="none"), STEPS: steps, COLOUR: colour,
}  # fmt: skip


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
        name, method, float((error > WRONG).mean()), float(np.sqrt(np.mean(error**2))),
        float(np.median(error)), share, right, seconds,
    )  # fmt: skip


HEAD = ("specimen", "method", "wrong", "RMS", "median", "kept", "right", "time")
BLUE, ORANGE, GREEN, PINK, SKY, YELLOW = LINE_COLOURS
LOOKS = {
    ARCSINE: (ORANGE, "x"), MODEL: (PINK, "v"), FREE: (BLUE, "s"), BLIND: (SKY, "D"),
    STEPS: (GREEN, "o"), COLOUR: (YELLOW, "^"),
}  # fmt: skip


def over_all(rows: list[FringeRow]) -> list[FringeRow]:
    """One row a method, of the specimens that it read: root mean square, worst of medians and
    shares, median time; `kept`, the mean over all."""
    found = []
    for method in METHODS:
        of = [r for r in rows if r.method == method]
        read = [r for r in of if r.rms == r.rms]
        if read:
            right = [r.right for r in read if r.right == r.right]
            found.append(
                FringeRow(
                    ALL, method, max(r.wrong for r in read),
                    float(np.sqrt(np.mean([r.rms**2 for r in read]))),
                    max((r.median for r in read if r.median == r.median), default=float("nan")),
                    float(np.mean([r.kept for r in of])), min(right) if right else float("nan"),
                    float(np.median([r.seconds for r in of])),
                )
            )  # fmt: skip
    return found


def table(rows: list[FringeRow]) -> str:
    """The rows as a table in plain text, the specimens together at its end."""
    cells = [_cells(r) for r in (*rows, *over_all(rows))]
    return "\n".join([*lines_of(HEAD, cells, texts=2), "", _FOOT, machine()])


_FOOT = """\
Wrong: share of the kept pixels that is off by over half a fringe; RMS, median: their error in
fringes; kept: share of the specimen; right: of the pixels called 95 % sure, those right to 0.05.
All specimens: root mean square, worst median, wrong and right, mean kept, median time.
Rendered frames of 659 x 494 pixels, 8 bits, noise of 3 grey levels, 30 % vignette; one point of
known order given, or a scene 5 % off in load and 3 pixels in place. Arcsine: the truth's branch.
Others' light: 330 x 440 pixels by a script that shares no code with ours, lamps of 1 : 3 at most,
noise of 1 to 10, one to five points of known order, some on lines and some wrong; RMS of what is on
its branch."""


def _cells(row: FringeRow) -> tuple[str, ...]:
    return (
        row.specimen, row.method, _number(row.wrong, "{:.2f} %", 100.0),
        *(_number(v, "{:.4f}", 1.0) for v in (row.rms, row.median)),
        _number(row.kept, "{:.1f} %", 100.0), _number(row.right, "{:.1f} %", 100.0),
        _number(row.seconds, "{:.2f} s", 1.0),
    )  # fmt: skip


def _number(value: float, how: str, factor: float) -> str:
    return how.format(factor * value) if value == value else "-"


def figure(rows: list[FringeRow]):
    """RMS error against what is kept and against time: a point a specimen, the largest of a colour
    all of them."""
    from isochrome.figures import new_figure, style_axes

    picture = new_figure(10.5, 5.0)
    together = over_all(rows)
    panels = (
        ("kept of the specimen (%)", "Error and what is kept", lambda r: 100.0 * r.kept),
        ("time a state (s)", "Error and time", lambda r: r.seconds),
    )
    for axes, (x_label, title, place) in zip(picture.subplots(1, 2), panels, strict=True):
        for method, (colour, marker) in LOOKS.items():
            for part, size, alpha in ((rows, 25.0, 0.55), (together, 130.0, 1.0)):
                points = [(place(r), r.rms) for r in part if r.method == method and r.rms == r.rms]
                if points:
                    axes.scatter(
                        *zip(*points, strict=True), s=size, c=colour, marker=marker, alpha=alpha,
                        linewidths=1.6 if marker == "x" else 0.0,
                        label=method if part is together else None,
                    )  # fmt: skip
        axes.set_yscale("log")
        for which in ("major", "minor"):
            axes.tick_params(axis="y", which=which, labelsize="small")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(_first_digits)
        style_axes(axes, x_label=x_label, z_label="RMS error (fringes)", title=title)
        axes.grid(alpha=0.3, lw=0.5, which="both")
        axes.set_axisbelow(True)
    picture.axes[1].set_xscale("log")
    picture.axes[1].xaxis.set_major_formatter("{x:g}")
    handles, labels = picture.axes[0].get_legend_handles_labels()
    picture.legend(
        handles, labels, loc="outside lower center", frameon=False, fontsize="small",
        ncols=len(labels), markerscale=0.6,
    )  # fmt: skip
    picture.suptitle("Fringe order by every method: a point a specimen, large ones all of them")
    return picture


def _first_digits(value: float, _: object) -> str:
    """Between powers of ten: 2 and 5 alone, the others would crowd."""
    return f"{value:g}" if f"{value:e}"[0] in "25" else ""
