"""Hertz's pressure: speed against error on one grid."""

import numpy as np

from isochrome.contact import ContactState, make_surface, solve_pressure
from isochrome.reference import hertz_pressure

from . import paper_procedure as paper
from .common import HALF_WIDTH, LOAD, MODULUS, OURS, PAPER, PEAK, RADIUS, timed, with_ratios
from .rows import Row

HALF_MM = 1.0
PAPER_TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)
OUR_TOLERANCES = (1e-3, 1e-4, 1e-6, 1e-10)


def pressure(quick):
    """Rows for N = 256, 1024, 4096 at several tolerances, after set-up."""
    rows = []
    for n in (256,) if quick else (256, 1024, 4096):
        runs = [(PAPER, t) for t in PAPER_TOLERANCES] + [(OURS, t) for t in OUR_TOLERANCES]
        x, calls = _calls(n, runs)
        solutions, seconds = timed(calls, repeats=1 if quick else 5)
        rows += with_ratios(
            [
                Row(f"pressure, N = {n}", method, _setting(t, s), peak_error(x, s.pressure), sec)
                for (method, t), s, sec in zip(runs, solutions, seconds, strict=True)
            ]
        )
    return rows


def peak_error(x, pressure):
    """Largest error of p over the contact's middle half, over p0; at x = 0 alone it can be zero by
    luck."""
    exact = hertz_pressure(x, half_width_mm=HALF_WIDTH, peak_pressure_mpa=PEAK)
    return float(np.abs(pressure - exact)[np.abs(x) < 0.5 * HALF_WIDTH].max() / PEAK)


def _setting(tolerance, solution):
    """Ours tells its complementarity residual; the paper's stops on its change per iteration."""
    if isinstance(solution, ContactState):
        return f"tolerance {tolerance:g}, residual {solution.residual:.0e}"
    return f"tolerance {tolerance:g}"


def _calls(n, runs):
    elements = paper.make_elements(n, HALF_MM, contact_modulus_mpa=MODULUS)
    surface = make_surface(n, elements.dx_mm, contact_modulus_mpa=MODULUS)
    gap = elements.x_mm**2 / (2.0 * RADIUS)
    calls = [
        (lambda t=t: paper.solve(elements, gap, LOAD, tolerance=t))
        if method == PAPER
        else (lambda t=t: solve_pressure(surface, gap, LOAD, tolerance=t))
        for method, t in runs
    ]
    return elements.x_mm, calls
