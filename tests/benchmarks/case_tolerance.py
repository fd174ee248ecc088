"""Random courses: are p_max and depth within numerics.tolerance of a run at a hundredth of it?
Truths by other code stand in tests/contact/test_contact_tolerance.py."""

import time
from functools import partial

import numpy as np

from isochrome.contact import contact_states
from isochrome.errors import PhysicsError

from .courses import random_course
from .rows import ToleranceRow

COURSES, FINER = 300, 100.0
TOLERANCES = (1e-3, 1e-4, 1e-5)


def cases():
    """A case for each tolerance."""
    return {f"tolerance {t:g}": partial(courses, t) for t in TOLERANCES}


def courses(tolerance, quick, seeds=range(COURSES)):
    """A row for each seed, or with `quick` for the first."""
    return [judged(seed, tolerance) for seed in (seeds[:1] if quick else seeds)]


def judged(seed, tolerance):
    """The row of one course at a tolerance: refused, or beside a finer run."""
    scene, words = random_course(seed)
    start = time.process_time()
    try:
        values = largest(scene, tolerance)
        seconds = time.process_time() - start
        exact = largest(scene, tolerance / FINER)
    except PhysicsError as error:
        seconds = time.process_time() - start
        return ToleranceRow(seed, words, tolerance, np.nan, np.nan, str(error), seconds)
    # a state before any wear has no depth to err in
    error = np.abs(values - exact) / np.maximum(exact, 1e-300) / tolerance
    return ToleranceRow(seed, words, tolerance, *error.max(axis=0).tolist(), "", seconds)


def largest(scene, tolerance):
    """Largest pressure and depth of each state (m, 2)."""
    states = contact_states(scene.with_values({"numerics.tolerance": tolerance}))
    return np.array([(state.p_max_mpa, state.wear_depth_mm.max()) for state in states])
