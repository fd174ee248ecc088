"""Frames read without a model: what is called known, and is not so. Specimens are `outside_fields`,
lamps `outside_camera`'s; of three or more known points one in ten is wrong by one."""

import re
import time
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter

from isochrome.frames import Frame, to_linear
from isochrome.scene import parse_scene

from .outside_camera import SAMPLES, Defects, _band, _stored, lit
from .outside_fields import KINDS, order_field
from .rows import FringeRow, SilentRow

FRAMES, PER_LIGHT = 400, 6
FREE, BLIND = "one frame, no-load frames", "one frame, blind"
SHAPE = 330, 440
_ASKED = re.compile(r"at row (\d+), column (\d+)(?: settles it)?: [\d.]+ or [\d.]+")
WRONG = 0.5
"""Fringes from which a pixel is on a wrong branch."""

_SCENE = """
[specimen]
shape = "other"
thickness_mm = 4.0
[camera]
bit_depth = 8
"""


@dataclass(frozen=True)
class Case:
    """A frame (grey levels), no-load frames or none, the true order, and known points.

    `order` (rows, cols), NaN where there is no specimen; `known`, (row, col, order) as stated;
    `wrong`, which of them are; `on_line`, which lie on a fringe line.
    """

    kind: str
    image: np.ndarray
    no_load: tuple[np.ndarray, np.ndarray] | None
    order: np.ndarray
    known: tuple[tuple[float, float, float], ...]
    wrong: tuple[bool, ...]
    on_line: tuple[bool, ...]


def drawn(seed, **flaws):
    """The frame of a seed, with further flaws of the light or the lens (`band_nm`, `blur_px`)."""
    rng = np.random.default_rng([seed, 17])
    kind = list(KINDS)[seed % len(KINDS)]
    highest = float(rng.uniform(1.2, 6.0))
    fine, body = order_field(kind, SHAPE, [seed, 18], highest=highest, samples=SAMPLES)
    defects = replace(lamp(rng), **flaws)
    rows, cols = SHAPE
    middle = SAMPLES // 2
    inside = body.reshape(rows, SAMPLES, cols, SAMPLES).all(axis=(1, 3))
    order = np.where(inside, fine[middle::SAMPLES, middle::SAMPLES], np.nan)
    image = exposed(np.where(body, _band(fine, None, defects), 0.0), defects, rng)
    no_load = None
    if rng.random() < 0.5:
        few = replace(defects, noise=0.25 * defects.noise, jpeg=None)
        no_load = tuple(exposed(np.full(fine.shape, s), few, rng) for s in (0.0, 1.0))
    return Case(kind, image, no_load, order, *points(order, rng))


def lamp(rng):
    """Light of 1 : 3 at most, stray light, noise of 1 to 10, and in a third of frames a JPEG."""
    return Defects(
        fall_off=float(rng.uniform(0.0, 0.6)), spot=float(rng.choice([0.0, rng.uniform(0.0, 0.6)])),
        bar=float(rng.choice([0.0, rng.uniform(0.0, 0.4)])),
        background=float(rng.uniform(0.02, 0.1)), background_slope=float(rng.uniform(-0.5, 0.5)),
        noise=float(np.exp(rng.uniform(0.0, np.log(10.0)))),
        jpeg=int(rng.integers(80, 96)) if rng.random() < 1.0 / 3.0 else None,
    )  # fmt: skip


def exposed(signal, defects, rng):
    """The stored picture of a signal on samples."""
    light = lit(signal, defects)
    if defects.blur_px:
        light = gaussian_filter(light, defects.blur_px, mode="nearest")
    return _stored(light, defects, rng)


def points(order, rng):
    """One to five known points: their stated orders, which are wrong, which lie on lines."""
    slope = np.hypot(*np.gradient(order))
    away = np.isfinite(slope) & (slope < 0.1)
    for axis in (0, 1):
        for step in (-12, 12):
            away &= np.isfinite(np.roll(order, step, axis))
    away[:12] = away[-12:] = False
    away[:, :12] = away[:, -12:] = False
    from_line = np.abs(2.0 * order - np.rint(2.0 * order)) / 2.0
    known, wrong, lines = [], [], []
    number = int(rng.integers(1, 6))
    for _ in range(number):
        line = bool(rng.random() < 1.0 / 3.0)
        near = away & (from_line < 0.01 if line else from_line > 0.1)
        if not near.any():
            continue
        row, col = (int(v) for v in rng.choice(np.argwhere(near)))
        value = float(np.rint(2.0 * order[row, col]) / 2.0 if line else round(order[row, col], 2))
        off = number >= 3 and len(known) >= 1 and not any(wrong) and rng.random() < 0.1
        known.append((row, col, abs(value + rng.choice([-1.0, 1.0])) if off else value))
        wrong.append(off)
        lines.append(line)
    return tuple(known), tuple(wrong), tuple(lines)


def read(case):
    """What `process` makes of a frame."""
    from isochrome.processing.kinds.image_only import read_alone
    from isochrome.processing.result import Capture

    scene = parse_scene(_SCENE)
    listed = tuple({"row_px": r, "col_px": c, "order": n} for r, c, n in case.known)
    scene = scene.with_values({"frames.known_order": listed})
    ends = (None, None)
    if case.no_load is not None:
        ends = tuple(to_linear(i, bit_depth=8, allow_blank=True) for i in case.no_load)
    frame = Frame(0, case.image, None, "frame")
    return read_alone(frame, scene, Capture(8, *ends), inside=np.isfinite(case.order))[0]


def judged(seed):
    """The row of the frame of a seed."""
    return judged_case(drawn(seed))


def judged_case(case):
    start = time.process_time()
    found = read(case)
    seconds = time.process_time() - start
    body = np.isfinite(case.order)
    order = np.full(body.shape, np.nan) if found.reading is None else found.reading.order
    known = np.isfinite(order) & body
    error = np.abs(order - case.order)[known]
    spread = found.reading.uncertainty[known] if found.reading is not None else np.zeros(0)
    right = error <= WRONG
    return SilentRow(
        case.kind,
        light="both" if case.no_load is not None else "none",
        points=", ".join(
            f"{n:g}{' line' if line else ''}{' wrong' if bad else ''}"
            for (_, _, n), line, bad in zip(case.known, case.on_line, case.wrong, strict=True)
        ),
        wrong=float((error > WRONG).sum() / max(1, body.sum())),
        kept=float(known.sum() / max(1, body.sum())),
        rms=float(np.sqrt(np.mean(error[right] ** 2))) if right.any() else float("nan"),
        pull=float(np.sqrt(np.mean((error[right] / spread[right]) ** 2)))
        if right.any()
        else float("nan"),
        said=" | ".join(found.warnings),
        seconds=seconds,
    )


def asked(found):
    """Row and column of the point that a reading asks for to settle a question; None if none."""
    for said in found.warnings:
        place = _ASKED.search(said)
        if place:
            return int(place[1]), int(place[2])
    return None


def settled(case):
    """Whether a true point where a reading asks for one makes it known, and rightly so (a wrong
    branch differs by 0.2 fringe); None where nothing is asked for."""
    place = asked(read(case))
    if place is None:
        return None
    row, col = place
    found = read(replace(case, known=(*case.known, (row, col, round(float(case.order[place]), 2)))))
    if found.reading is None:
        return False
    near = np.s_[max(0, row - 5) : row + 6, max(0, col - 5) : col + 6]
    away = np.abs(found.reading.order[near] - case.order[near])
    return bool(np.isfinite(away).any() and np.nanmedian(away) < 0.1)


def one_of_four_wrong(seed):
    """The frame of a seed with four points between lines, the last one off by one fringe."""
    rng = np.random.default_rng([seed, 19])
    case = drawn(seed)
    known = []
    while len(known) < 4:
        drawn_points, _, on_line = points(case.order, rng)
        known += [
            (row, col, round(float(case.order[row, col]), 2))
            for (row, col, _), line in zip(drawn_points, on_line, strict=True)
            if not line
        ]
    row, col, order = known[3]
    wrong = (row, col, order - 1.0 if order > 1.0 else order + 1.0)
    return replace(case, known=(*known[:3], wrong))


def fringes(kind, quick=False):
    """Rows of one kind of specimen for `bench fringes`: some frames of either light together."""
    seeds = range(list(KINDS).index(kind), FRAMES, len(KINDS))
    cases = [drawn(seed) for seed in seeds[: 4 * PER_LIGHT]]
    rows = []
    for method, blind in ((FREE, False), (BLIND, True)):
        some = [case for case in cases if (case.no_load is None) is blind][
            : 1 if quick else PER_LIGHT
        ]
        found = [judged_case(case) for case in some]
        mean = {
            key: float(np.nanmean([getattr(row, key) for row in found]))
            for key in ("wrong", "kept", "seconds")
        }
        mean["wrong"] /= max(mean["kept"], 1e-9)
        read = [row.rms for row in found if row.rms == row.rms]
        rms = float(np.sqrt(np.mean(np.square(read)))) if read else float("nan")
        rows.append(FringeRow(f"{kind}, others' light", method, rms=rms, **mean))
    return rows
