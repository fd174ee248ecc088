"""The stress difference on the camera's pixels, from a known sliding pressure, after set-up."""

import numpy as np

from isochrome.reference import hertz_pressure, sliding_hertz_stress
from isochrome.stress import PixelGrid, make_field_grid, stress_difference

from . import paper_procedure as paper
from .common import FRICTION, HALF_WIDTH, OURS, PAPER, PEAK, plain, timed, with_ratios
from .rows import Row

PIXELS = PixelGrid(rows=494, cols=659, left_mm=-2.0, top_mm=0.0, pixel_mm=0.00607)
FOLDS = (1, 6)
"""Elements a pixel; six is the contact grid that `isochrome simulate` chooses here."""
KINDS = (np.complex64, np.complex128)
EDGES, LAGS = "over edges", "by lags"
TIMED_ROWS = 10
"""The direct sum is timed on every tenth row and scaled; its rows all cost the same."""
_SCALED = f" (every {TIMED_ROWS}th row)"


def stress(quick):
    """Rows against the closed form (with the error of the elements) and the exact sum (without)."""
    pixels = PIXELS.every(16) if quick else PIXELS
    return [row for fold in ((1,) if quick else FOLDS) for row in _stress(pixels, fold, quick)]


def closed_form(pixels):
    """The field of a sliding Hertz contact without coupling (rows, cols), MPa."""
    at = pixels.x_mm[None, :], pixels.z_mm[:, None]
    size = {"half_width_mm": HALF_WIDTH, "peak_pressure_mpa": PEAK}
    field = sliding_hertz_stress(*at, friction=FRICTION, **size)
    return field.sigma_x - field.sigma_z + 2j * field.tau_xz


def tractions(nodes):
    """Pressure and shear of that contact at the nodes, MPa."""
    p = hertz_pressure(nodes, half_width_mm=HALF_WIDTH, peak_pressure_mpa=PEAK)
    return p, FRICTION * p


def _stress(pixels, fold, quick):
    h = pixels.pixel_mm / fold
    count = 2 * int(1.3 * HALF_WIDTH / h) + 1
    nodes = h * (np.arange(count) - count // 2)
    p, q = tractions(nodes)
    here = pixels.x_mm, pixels.z_mm[::TIMED_ROWS], nodes[0], h, p, q
    share = pixels.rows / len(pixels.z_mm[::TIMED_ROWS])
    view = f"{pixels.cols} x {pixels.rows}, {fold}/px"
    place = {"left_mm": nodes[0], "spacing_mm": h, "nodes": count}
    setup, grids = _set_up(pixels, place, f"stress, {view}, set-up", quick)
    calls = [lambda: paper.stress_by_edges(*here), lambda: paper.stress_by_lags(*here)]
    calls += [lambda grid=grid: stress_difference(grid, p, q) for grid in grids]
    fields, seconds = timed(calls, repeats=1 if quick else 5)
    seconds = [seconds[0] * share, seconds[1] * share, *seconds[2:]]
    fields[2:] = [field[::TIMED_ROWS] for field in fields[2:]]
    truth = closed_form(pixels)[::TIMED_ROWS]
    exact = [exact_steps(*here)] * 2 + [exact_hats(*here)] * 2
    names = [(PAPER, f"{EDGES}{_SCALED}"), (PAPER, f"{LAGS}{_SCALED}")]
    names += [
        (OURS, f"{kind.__name__}: {plain(seconds[0] / sec)} x {EDGES}")
        for kind, sec in zip(KINDS, seconds[2:], strict=True)
    ]
    rows = []
    for kind, truths in (("closed form", [truth] * 4), ("exact sum", exact)):
        for (method, how), field, true, sec in zip(names, fields, truths, seconds, strict=True):
            error = float(np.abs(field - true).max() / PEAK)
            rows.append(Row(f"stress, {view}, to {kind}", method, how, error, sec))
    return with_ratios(rows) + setup


def _set_up(pixels, place, case, quick):
    """Rows with the time and memory of the kernels, and the grids that hold them."""
    calls = [lambda kind=kind: make_field_grid(pixels, dtype=kind, **place) for kind in KINDS]
    grids, seconds = timed(calls, repeats=1 if quick else 3)
    rows = []
    for kind, grid, sec in zip(KINDS, grids, seconds, strict=True):
        size = sum(band.cauchy.nbytes + band.slope.nbytes for band in grid.bands)
        rows.append(Row(case, OURS, f"{kind.__name__}: kernels {1e-6 * size:.3g} MB", seconds=sec))
    return rows, grids


def exact_steps(x, z, first, h, p, q):
    """The paper's sum in extended precision: what its own rounding is measured against."""
    return paper.stress_by_lags(*(np.asarray(v, np.longdouble) for v in (x, z, first, h, p, q)))


def exact_hats(x, z, first, h, p, q):
    r"""The sum over tractions linear between nodes, in extended precision, term by term.

    With ζ = x - iz: -(2/π) Σ [(p + iq) z ∫hat/(ζ-t)² dt + q ∫hat/(ζ-t) dt], the integrals as second
    differences of -ln ζ and ζ ln ζ everywhere: apart from the code that is measured.
    """
    x, z, first, h = (np.asarray(v, np.longdouble) for v in (x, z, first, h))
    fold = round(float((x[1] - x[0]) / h))
    n = len(p)
    lags = (x[0] - first) / h + np.arange(-n, fold * (len(x) - 1) + 2)
    field = np.empty((len(z), len(x)), np.clongdouble)
    pi = 4 * np.arctan(np.ones_like(h))
    for row, depth in enumerate(z):
        zeta = lags - 1j * (depth / h)
        log = np.log(zeta)
        first_sum = np.diff(zeta * log, 2)  # ∫ hat/(ζ-t) dt: second difference of ζ ln ζ
        second_sum = -np.diff(log, 2) * (depth / h)  # z ∫ hat/(ζ-t)² dt
        both = second_sum, 1j * second_sum + first_sum
        parts = [
            np.einsum("ij,j->i", np.lib.stride_tricks.sliding_window_view(k, n)[::fold], t[::-1])
            for k, t in zip(both, (p, q), strict=True)
        ]
        field[row] = -2 / pi * (parts[0] + parts[1])
    return field
