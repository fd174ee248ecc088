"""Hertz's pressure by other solvers, where installed. None has a free line contact: a strip of
elements a metre long has its displacement, less (x/length)²."""

from importlib.util import find_spec

import numpy as np

from isochrome.contact import make_surface, solve_pressure

from .case_pressure import HALF_MM, peak_error
from .common import LOAD, MODULUS, OURS, RADIUS, timed, with_ratios
from .rows import Row

TAMAAS, CONTACT_MECHANICS = "tamaas", "ContactMechanics"
LENGTH_MM = 1e3
TOLERANCES = {
    TAMAAS: (1e-4, 1e-6, 1e-8),
    CONTACT_MECHANICS: (1e-7, 1e-8, 1e-9),
    OURS: (1e-3, 1e-6, 1e-10),
}


def peers(quick):
    """Rows for N = 1024, after set-up; a peer that is absent or fails has a row that says so."""
    n = 256 if quick else 1024
    case = f"peers: Hertz, N = {n}"
    dx = 2.0 * HALF_MM / (n - 1)
    x = dx * (np.arange(n) - (n - 1) / 2)
    runs, silent = [], []
    for name, make in {TAMAAS: _tamaas, CONTACT_MECHANICS: _contact_mechanics, OURS: _ours}.items():
        if name != OURS and find_spec(name) is None:
            silent.append(Row(case, name, "not installed, not run"))
            continue
        try:
            solve = make(x, dx)
            solve(TOLERANCES[name][0])
        except Exception as failure:  # whatever it is, the bench goes on and the row tells
            silent.append(Row(case, name, f"installed, but failed: {_first_words(failure)}"))
        else:
            runs += [(name, solve, t) for t in TOLERANCES[name]]
    calls = [lambda solve=solve, t=t: solve(t) for _, solve, t in runs]
    solutions, seconds = timed(calls, repeats=1 if quick else 5)
    rows = [
        Row(case, name, f"tolerance {t:g}", peak_error(x, pressure), sec)
        for (name, _, t), pressure, sec in zip(runs, solutions, seconds, strict=True)
    ]
    return silent + with_ratios(rows)


def _first_words(failure):
    return f"{type(failure).__name__} {failure}".split("\n")[0][:50]


def _ours(x, dx):
    surface = make_surface(len(x), dx, contact_modulus_mpa=MODULUS)
    gap = x**2 / (2.0 * RADIUS)
    return lambda tolerance: solve_pressure(surface, gap, LOAD, tolerance=tolerance).pressure


def _tamaas(x, dx):
    import tamaas

    tamaas.set_log_level(tamaas.LogLevel.error)
    size = [len(x) * dx, LENGTH_MM]
    model = tamaas.Model(tamaas.model_type.basic_2d, size, [len(x), 1])
    model.E, model.nu = MODULUS, 0.0
    tamaas.ModelFactory.registerNonPeriodic(model, "free")
    heights = -(x**2)[:, None] / (2.0 * RADIUS)

    def solve(tolerance):
        model.traction[:] = 0.0
        solver = tamaas.PolonskyKeerRey(model, heights, tolerance)
        solver.setIntegralOperator("free")
        solver.solve(LOAD / size[0])
        return np.array(model.traction)[:, 0]

    return solve


def _contact_mechanics(x, dx):
    from ContactMechanics import FreeFFTElasticHalfSpace
    from ContactMechanics.Systems import NonSmoothContactSystem
    from SurfaceTopography import Topography

    shape, size = (len(x), 1), (len(x) * dx, LENGTH_MM)
    substrate = FreeFFTElasticHalfSpace(shape, MODULUS, size)
    heights = Topography(-(x**2)[:, None] / (2.0 * RADIUS), size)
    system = NonSmoothContactSystem(substrate, heights)

    def solve(tolerance):
        system.minimize_proxy(external_force=LOAD * LENGTH_MM, pentol=tolerance, maxiter=3000)
        return np.array(substrate.force)[: len(x), 0] / (dx * LENGTH_MM)

    return solve
