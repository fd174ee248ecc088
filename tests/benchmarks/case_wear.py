"""Wear to 233 m with friction and coupling: this project's runs beside explicit steps."""

from __future__ import annotations

import numpy as np

from isochrome.bench import Row
from isochrome.contact import (
    constant_course,
    make_surface,
    scar_history,
    scar_on_nodes,
    wear_history,
)

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
    timed,
    with_ratios,
)

HALF_MM, NODES = 0.8, 512
DISTANCES_M = np.array([31.0, 77.0, 155.0, 233.0])
STEPS_MM = (paper.STEP_MM, 100.0, 400.0)
MESH, GRID = "tolerance", "fixed grid (any profile), tolerance"
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6)
GRID_TOLERANCES = (1e-3, 1e-4)
REFERENCE = 2e-7
"""Tolerance of the converged run; half of it moves nothing by 1e-7."""


def wear(quick):
    """Rows at several steps and tolerances, each against one converged run on the moving mesh.

    All are compared on the same nodes, the mesh's scar being carried onto them (that is timed). The
    paper's elements and the fixed grid err in space as well, by about 1e-5 here: below the error of
    explicit steps. That grid and mesh, which share no discretisation, agree is tested in
    tests/contact/test_contact_scar.py. Steps beyond the explicit limit are left out.
    """
    n, distances = (64, DISTANCES_M[:1]) if quick else (NODES, DISTANCES_M)
    limit = paper.explicit_limit_mm(2.0 * HALF_MM / (n - 1), WEAR, MODULUS)
    steps = [s for s in (STEPS_MM[2:] if quick else STEPS_MM) if s < limit]
    runs = [(PAPER, s) for s in steps]
    runs += [(MESH, t) for t in (TOLERANCES[:1] if quick else TOLERANCES)]
    runs += [(GRID, t) for t in (GRID_TOLERANCES[:1] if quick else GRID_TOLERANCES)]
    solve = _solvers(n, distances)
    calls = [lambda kind=kind, value=value: solve[kind](value) for kind, value in runs]
    histories, seconds = timed(calls, repeats=1 if quick else 5)
    truth = solve[MESH](1e-5 if quick else REFERENCE)
    case = f"wear to {distances[-1]:g} m, N = {n}"
    rows = []
    for (kind, value), history, sec in zip(runs, histories, seconds, strict=True):
        method, setting = OURS, f"{kind} {value:g}"
        if kind == PAPER:
            method, setting = PAPER, _steps(value, distances)
        rows.append(Row(case, method, setting, largest_error(history, truth), sec))
    return with_ratios(rows)


def _steps(size_mm, distances):
    count = sum(np.ceil(np.diff(1e3 * distances, prepend=0.0) / size_mm - 1e-9))
    whose = ", the paper's" if size_mm == paper.STEP_MM else ""
    return f"{count:.0f} steps of {size_mm:g} mm{whose}"


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
    """A function of step or tolerance for each kind: (pressure, depth) at each distance."""
    kinds = {"contact_modulus_mpa": MODULUS, "coupling_per_mpa": COUPLING}
    elements = paper.make_elements(n, HALF_MM, friction=FRICTION, **kinds)
    surface = make_surface(n, elements.dx_mm, **kinds)
    gap = elements.x_mm**2 / (2.0 * RADIUS)
    course, stops = constant_course(LOAD, distances, dose_per_m=1e3 * WEAR, friction=FRICTION)

    def explicit(step_mm):
        return paper.wear(elements, gap, LOAD, WEAR, distances, step_mm=step_mm)

    def on_mesh(tolerance):
        scars = scar_history(RADIUS, MODULUS, COUPLING, course, stops, tolerance=tolerance)
        return [scar_on_nodes(scar, elements.x_mm) for scar in scars]

    def on_grid(tolerance):
        states = wear_history(surface, gap, course, stops, tolerance=tolerance)
        return [(state.contact.pressure, state.depth_mm) for state in states]

    return {PAPER: explicit, MESH: on_mesh, GRID: on_grid}
