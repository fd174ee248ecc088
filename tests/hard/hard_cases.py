"""Scenes, profiles, and an independent dense contact, its influence written anew half a hat at a
time: no solution is judged by the operator that made it."""

import numpy as np
import pytest
from scipy.linalg import toeplitz

from isochrome.contact import OutputState, SlidingHistory, contact_states, make_surface
from isochrome.errors import PhysicsError
from isochrome.reference import (
    contact_modulus,
    coupling_modulus_inverse,
    dundurs_beta,
    hertz_half_width,
    hertz_peak_pressure,
)
from isochrome.scene import parse_scene

PAIR = (2100.0, 0.4, 210000.0, 0.3)
MODULUS, COUPLING = contact_modulus(*PAIR), coupling_modulus_inverse(*PAIR)
RADIUS, LOAD, WEAR = 24.61, 11.0, 2e-9
HALF_WIDTH = hertz_half_width(LOAD, RADIUS, MODULUS)
PEAK = hertz_peak_pressure(LOAD, RADIUS, MODULUS)
FLAT = 'shape = "flat"\nhalf_width_mm = 0.5'


def contact_scene(
    rest="",
    *,
    indenter=f"radius_mm = {RADIUS}",
    load=44.0,
    thickness=4.0,
    pair=(2.1, 0.4, 210.0, 0.3),
    folder=None,
):
    """The paper's pair (GPa) and load, without a camera, unless told otherwise."""
    young, poisson, other_young, other_poisson = pair
    text = f"""
[specimen]
young_gpa = {young}
poisson = {poisson}
thickness_mm = {thickness}
fringe_value_n_per_mm = 14.6
[indenter]
{indenter}
young_gpa = {other_young}
poisson = {other_poisson}
[load]
normal_n = {load}
{rest}
"""
    return parse_scene(text, folder=folder)


def constants(young, poisson, other_young, other_poisson):
    """Contact modulus (MPa), coupling (1/MPa) and Dundurs' beta of a pair in GPa."""
    mpa = (1e3 * young, poisson, 1e3 * other_young, other_poisson)
    return contact_modulus(*mpa), coupling_modulus_inverse(*mpa), dundurs_beta(*mpa)


def rough(x, seed, *, height=2e-4, shortest=0.02):
    """Seeded roughness: waves from 1 mm down to the shortest, amplitude as the wavelength."""
    rng = np.random.default_rng(seed)
    k = np.arange(1, round(1.0 / shortest) + 1)
    phase = 2.0 * np.pi * (k[:, None] * x + rng.random(len(k))[:, None])
    return height * (np.cos(phase) * rng.normal(size=len(k))[:, None] / np.sqrt(k)[:, None]).sum(0)


def refused(scene, words):
    """The scene is refused with exit code 3, and with one sentence that says what to change."""
    with pytest.raises(PhysicsError, match=words) as refusal:
        contact_states(scene)
    assert refusal.value.exit_code == 3
    assert str(refusal.value).startswith("scene") and "\n" not in str(refusal.value)


def cylinder(n=101, half=0.8, **surface):
    """Nodes x (n,), the surface of them, and the unworn cylinder's gap."""
    x = np.linspace(-half, half, n)
    surface = make_surface(n, x[1] - x[0], contact_modulus_mpa=MODULUS, **surface)
    return x, surface, x**2 / (2.0 * RADIUS)


def worn(distances, *, k=WEAR, friction=None, spacing=None, window=None, tolerance=None):
    """The text of [wear], [friction] and [numerics]."""
    lines = [f"[wear]\ncoefficient_mm2_per_n = {k}\ndistances_m = {list(map(float, distances))}"]
    if friction is not None:
        lines.append(f"[friction]\ncoefficient = {friction}")
    lines.append(numerics(spacing=spacing, window=window, tolerance=tolerance))
    return "\n".join(lines)


def numerics(*, spacing=None, window=None, tolerance=None):
    given = {"spacing_mm": spacing, "window_mm": window, "tolerance": tolerance}
    lines = [f"{key} = {value}" for key, value in given.items() if value is not None]
    return "\n".join(["[numerics]", *lines])


def write_profile(folder, x, gap, name="profile.csv", *, header="x_mm,gap_mm", mark=b""):
    """A profile file; returns the line that names it in a scene."""
    rows = [f"{float(a)!r},{float(b)!r}" for a, b in zip(x, gap, strict=True)]
    (folder / name).write_bytes(mark + "\n".join([header, *rows, ""]).encode())
    return f'profile = "{name}"'


def eliminated(matrix, gap, active, weight, load=LOAD, *, diagonal=0.0):
    """Pressure of a contact by plain elimination, and where it presses: tension leaves the trial
    set `active`, overlap joins it. `weight`, of a node's pressure in the load."""
    weight = np.broadcast_to(weight, gap.shape)
    for _ in range(100):
        on = np.flatnonzero(active)
        system = np.zeros((len(on) + 1, len(on) + 1))
        system[:-1, :-1] = matrix[np.ix_(on, on)] + diagonal * np.eye(len(on))
        system[:-1, -1], system[-1, :-1] = -1.0, weight[on]
        answer = np.linalg.solve(system, np.r_[-gap[on], load])
        p = np.zeros(len(gap))
        p[on] = answer[:-1]
        wrong = (active & (p < 0.0)) | (~active & (gap + matrix @ p - answer[-1] < -1e-15))
        if not wrong.any():
            return p, active
        active = active ^ wrong
    raise AssertionError("no contact set holds")


def influence(x, *, modulus=MODULUS, coupling=0.0, friction=0.0):
    """Dense matrix of u at even x under unit hats, mm/MPa: closed form, half a hat at a time."""
    n, h = len(x), x[1] - x[0]
    distance = h * np.arange(n)
    logarithm = _half_hat(distance, h) + _half_hat(-distance, h)
    ahead = np.r_[0.5 * h, np.zeros(n - 1)], np.r_[0.5 * h, np.full(n - 1, h)]
    return -2.0 / (np.pi * modulus) * toeplitz(logarithm) - (
        0.5 * coupling * friction * toeplitz(*ahead)
    )


def _half_hat(y, h):
    """∫_0^h (1 - s/h) ln|y - s| ds, by parts."""
    return (1.0 - y / h) * (_log_1(y) - _log_1(y - h)) + (_log_y(y) - _log_y(y - h)) / h


def _log_1(y):
    """Antiderivative of ln|y|."""
    safe = np.where(y == 0.0, 1.0, np.abs(y))
    return y * np.log(safe) - y


def _log_y(y):
    """Antiderivative of y ln|y|."""
    safe = np.where(y == 0.0, 1.0, np.abs(y))
    return 0.5 * y * y * np.log(safe) - 0.25 * y * y


def violation(x, pressure, gap, load, **pair):
    """How far a pressure is from p >= 0, gap >= 0, p gap = 0 and h Σp = P' by the dense matrix: the
    largest of tension, overlap, opening and imbalance, each relative; zero for an exact solution.
    """
    u = influence(x, **pair) @ pressure
    inside = pressure > 0.0
    level = gap + u
    level = level - level[inside].mean()
    return max(
        -pressure.min() / pressure.max(), -level[~inside].min(initial=0.0) / np.ptp(u),
        np.abs(level[inside]).max() / np.ptp(u), abs(pressure.sum() * (x[1] - x[0]) / load - 1.0),
    )  # fmt: skip


def patches(pressure):
    """Count of separate stretches of contact."""
    inside = np.r_[False, pressure > 0.0]
    return int(np.count_nonzero(np.diff(inside.astype(int)) == 1))


def parabola(x):
    return x**2 / (2 * RADIUS)


def table(*points):
    """What goes with the distance, for a scene."""
    return {"distance_m": [p[0] for p in points], "value": [p[1] for p in points]}


def constant_course(load, distances_m, *, dose_per_m, friction=0.0):
    """History and states at constant load (N/mm), friction and wear rate (1000 kappa, mm/MPa/m)."""
    wanted = np.asarray(distances_m, dtype=float)
    ends = np.unique([0.0, wanted.max()])
    shape = np.ones(len(ends))
    history = SlidingHistory(ends, dose_per_m * ends, load * shape, friction * shape)
    return history, [OutputState(d, dose_per_m * d, load, friction) for d in wanted.tolist()]
