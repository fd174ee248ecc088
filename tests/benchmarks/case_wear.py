"""Wear to 233 m with friction and coupling: this project's runs beside explicit steps."""

import numpy as np

from isochrome import contact

from . import paper_procedure as paper
from .common import (
    COUPLING,
    FRICTION,
    LOAD,
    MODULUS,
    OURS,
    PAPER,
    RADIUS,
    WEAR,
    plain,
    timed,
    with_ratios,
)
from .rows import Row

HALF_MM, NODES = 0.8, 512
DISTANCES_M = np.array([31.0, 77.0, 155.0, 233.0])
TIGHT, LOOSE = 1e-6, 1e-3
"""Change per iteration at which the conjugate gradients stop; the paper does not give it. With the
loose one a small step has a single iteration, which lags behind and yet errs no more."""
EXPLICIT = ((paper.STEP_MM, TIGHT), (100.0, TIGHT))
EXPLICIT += ((6.25, LOOSE), (paper.STEP_MM, LOOSE), (100.0, LOOSE), (400.0, LOOSE))
QUICK_M, QUICK = 5.0, (EXPLICIT[0], EXPLICIT[4])
MESH, GRID = "tolerance", "any profile, tolerance"
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6)
GRID_TOLERANCES = (1e-3, 1e-4)
REFERENCE = 2e-7
"""Tolerance of the converged run; half of it moves nothing by 1e-7."""


def wear(quick):
    """Rows against one converged run on the moving mesh, on the same nodes. Paper's elements and
    fixed grid err in space by 2e-5, which no step mends; none beyond the explicit limit."""
    n, distances = (64, np.array([QUICK_M])) if quick else (NODES, DISTANCES_M)
    limit = paper.explicit_limit_mm(2.0 * HALF_MM / (n - 1), WEAR, MODULUS)
    runs = [(PAPER, run) for run in (QUICK if quick else EXPLICIT) if run[0] < limit]
    runs += [(MESH, t) for t in (TOLERANCES[:1] if quick else TOLERANCES)]
    runs += [(GRID, t) for t in (GRID_TOLERANCES[:1] if quick else GRID_TOLERANCES)]
    solve = _solvers(n, distances)
    calls = [lambda kind=kind, value=value: solve[kind](value) for kind, value in runs]
    histories, seconds = timed(calls, repeats=1 if quick else 5)
    truth = solve[MESH](1e-5 if quick else REFERENCE)
    case = f"wear to {distances[-1]:g} m, N = {n}"
    rows = []
    for (kind, value), history, sec in zip(runs, histories, seconds, strict=True):
        if kind == PAPER:
            method, setting = PAPER, _steps(*value, distances)
        else:
            method, setting = OURS, f"{kind} {value:g}: {plain(seconds[0] / sec)} x the paper's"
        rows.append(Row(case, method, setting, largest_error(history, truth), sec))
    return with_ratios(rows)


def _steps(size_mm, tolerance, distances):
    count = sum(np.ceil(np.diff(1e3 * distances, prepend=0.0) / size_mm - 1e-9))
    whose = ", the paper's" if (size_mm, tolerance) == EXPLICIT[0] else ""
    return f"{count:.0f} steps of {size_mm:g} mm, CG to {tolerance:g}{whose}"


def largest_error(history, reference):
    """Largest relative error of p_max and of the depth over the states asked for."""
    return float(
        max(
            abs(got.max() / true.max() - 1.0)
            for state, exact in zip(history, reference, strict=True)
            for got, true in zip(state, exact, strict=True)
        )
    )


def _solvers(n, distances):
    """A function of its setting for each kind: (pressure, depth) at each distance."""
    kinds = {"contact_modulus_mpa": MODULUS, "coupling_per_mpa": COUPLING}
    elements = paper.make_elements(n, HALF_MM, friction=FRICTION, **kinds)
    surface = contact.make_surface(n, elements.dx_mm, **kinds)
    gap = elements.x_mm**2 / (2.0 * RADIUS)
    ends, rate = np.array([0.0, max(distances)]), 1e3 * WEAR
    course = contact.SlidingHistory(ends, rate * ends, np.full(2, LOAD), np.full(2, FRICTION))
    stops = [contact.OutputState(s, rate * s, LOAD, FRICTION) for s in distances]

    def explicit(run):
        step, tolerance = run
        kinds = {"step_mm": step, "tolerance": tolerance}
        return paper.wear(elements, gap, LOAD, WEAR, distances, **kinds)

    def on_mesh(tolerance):
        scars = contact.scar_history(RADIUS, MODULUS, COUPLING, course, stops, tolerance=tolerance)
        return [contact.scar_on_nodes(scar, elements.x_mm) for scar in scars]

    def on_grid(tolerance):
        states = contact.wear_history(surface, gap, course, stops, tolerance=tolerance)
        return [(state.contact.pressure, state.depth_mm) for state in states]

    return {PAPER: explicit, MESH: on_mesh, GRID: on_grid}
