"""How fast each discretisation converges: in the mesh, in the grid, in the step."""

import numpy as np

import isochrome.contact.scar as scar_module
from hard.hard_cases import constant_course
from isochrome.contact import make_mesh, scar_history
from isochrome.reference import hertz_half_width

RADIUS, MODULUS, LOAD = 24.61, 2473.2, 11.0
COUPLING, FRICTION = 1.6e-4, 0.25
UNIT = 2.0 * hertz_half_width(LOAD, RADIUS, MODULUS) / MODULUS
COURSE, STOPS = constant_course(LOAD, [1.0], dose_per_m=3.1 * UNIT, friction=FRICTION)
"""The paper's 233 m: the pressure is flat, and steep at its edges."""


def scar(intervals, monkeypatch, tolerance=1e-6):
    monkeypatch.setattr(scar_module, "make_mesh", lambda _: make_mesh(intervals))
    history = scar_history(RADIUS, MODULUS, COUPLING, COURSE, STOPS, tolerance=tolerance)
    return next(history)


def orders(values, exact, refinement=2.0):
    """Slope of the logarithm of the error from one value to the next."""
    error = np.abs(np.array(values) - exact)
    return np.log(error[:-1] / error[1:]) / np.log(refinement)


def test_the_worn_pressure_converges_by_the_fourth_order_in_the_mesh(monkeypatch):
    """p ~ distance^γ at the edges, γ = 0.2 here: the crowding as φ⁴ makes it φ^0.8, and the load
    that an edge's interval holds err as its width^(4 + 0.8); the derivative of h is of the fourth.
    """
    peaks = {}
    for n in (24, 32, 48, 64, 128):
        worn = scar(n, monkeypatch)
        peaks[n] = worn.pressure_mpa[n // 2]  # at the middle: a node of every mesh
    for pair in ((24, 48), (32, 64)):
        (order,) = orders([peaks[n] for n in pair], peaks[128])
        assert 3.6 < order < 5.0, pair


def test_a_mesh_far_finer_than_its_steps_does_not_ring(monkeypatch):
    """Goes wrong if the first steps, whose forecast knows nothing of the past, are not corrected
    until they hold: an edge seems to draw back, and the run ends."""
    rough, exact = scar(64, monkeypatch, tolerance=1e-3), scar(64, monkeypatch)
    assert rough.pressure_mpa.max() / exact.pressure_mpa.max() - 1.0 < 1e-3


def test_the_unworn_width_converges_by_the_fourth_order_in_the_mesh(monkeypatch):
    """Hertz's p is sin³φ and a little more: the trapezoidal rule feels that as its fourth power."""
    course, stops = constant_course(LOAD, [0.0, 1.0], dose_per_m=1e-12 * UNIT)
    half = {}
    for n in (16, 32, 64):
        monkeypatch.setattr(scar_module, "make_mesh", lambda _, n=n: make_mesh(n))
        half[n] = next(scar_history(RADIUS, MODULUS, 0.0, course, stops, tolerance=1e-4)).x_mm[-1]
    got = orders([half[n] for n in (16, 32, 64)], hertz_half_width(LOAD, RADIUS, MODULUS))
    assert ((got > 3.8) & (got < 4.2)).all(), got
