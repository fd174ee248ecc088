"""Wear to 233 m with friction and coupling: implicit steps beside the paper's explicit ones."""

from __future__ import annotations

import numpy as np

from isochrome.bench import Row
from isochrome.contact import constant_course, make_surface, wear_history

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

HALF_MM, NODES = 0.8, 192
DISTANCES_M = np.array([31.0, 77.0, 155.0, 233.0])
STEPS_MM = (paper.STEP_MM, 100.0, 400.0, 1600.0)
TOLERANCES = (1e-3, 1e-4, 1e-5)
REFERENCE = 1e-6


def wear(quick):
    """Rows at several steps and tolerances; errors against our run at 1e-6 on the same grid.

    The two discretisations of the pressure differ by about 1e-5 on this grid, below the errors of
    the explicit steps. The explicit limit is about 2200 mm here: every step shown is stable.
    """
    n, distances = (64, DISTANCES_M[:1]) if quick else (NODES, DISTANCES_M)
    steps, tolerances = (STEPS_MM[2:], TOLERANCES[:1]) if quick else (STEPS_MM, TOLERANCES)
    runs = [(PAPER, s) for s in steps] + [(OURS, t) for t in (*tolerances, REFERENCE)]
    histories, seconds = timed(_calls(n, distances, runs), repeats=1 if quick else 5)
    rows = []
    for (method, value), history, sec in zip(runs[:-1], histories, seconds, strict=False):
        error = largest_error(history, histories[-1])
        rows.append(
            Row(_name(n, distances), method, _setting(method, value, distances), error, sec)
        )
    text = f"tolerance {REFERENCE:g}, the reference"
    return [*with_ratios(rows), Row(_name(n, distances), OURS, text, seconds=seconds[-1])]


def _name(n, distances):
    return f"wear to {distances[-1]:g} m, N = {n}"


def _setting(method, value, distances):
    if method == OURS:
        return f"tolerance {value:g}"
    count = sum(np.ceil(np.diff(1e3 * distances, prepend=0.0) / value - 1e-9))
    whose = ", the paper's" if value == paper.STEP_MM else ""
    return f"{count:.0f} steps of {value:g} mm{whose}"


def largest_error(history, reference):
    """Largest relative error of p_max and of the depth over the states asked for."""
    return float(
        max(
            abs(got.max() / true.max() - 1.0)
            for state, exact in zip(history, reference, strict=True)
            for got, true in zip(state, exact, strict=True)
        )
    )


def _calls(n, distances, runs):
    kinds = {"contact_modulus_mpa": MODULUS, "coupling_per_mpa": COUPLING}
    elements = paper.make_elements(n, HALF_MM, friction=FRICTION, **kinds)
    surface = make_surface(n, elements.dx_mm, **kinds)
    gap = elements.x_mm**2 / (2.0 * RADIUS)
    course, stops = constant_course(LOAD, distances, dose_per_m=1e3 * WEAR, friction=FRICTION)

    def ours(tolerance):
        states = wear_history(surface, gap, course, stops, tolerance=tolerance)
        return [(state.contact.pressure, state.depth_mm) for state in states]

    def explicit(step_mm):
        return paper.wear(elements, gap, LOAD, WEAR, distances, step_mm=step_mm)

    return [
        (lambda v=v: explicit(v)) if method == PAPER else (lambda v=v: ours(v))
        for method, v in runs
    ]
