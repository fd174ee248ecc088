"""Truth for measured scars, no code of the package: a half-plane's contact worn by dh = k p ds,
scaled to the area k P s/width; roughness, tilt, form and spikes on it."""

from functools import lru_cache
from pathlib import Path

import numpy as np

RADIUS_MM, MODULUS_MPA, LOAD_N, WIDTH_MM = 24.61, 2090.0, 44.0, 4.0
DISTANCES_M = (31.0, 77.0, 155.0, 233.0)
FINISHES = ("ground", "lapped", "turned")

_HALF_MM, _STEP_MM = 1.1, 0.006


@lru_cache(maxsize=1)
def worn_table():
    """Places (n,), doses (m,), and depths over the dose (m, n), mm and mm/MPa."""
    doses = np.geomspace(2e-5, 8e-4, 45)
    x = np.arange(-round(_HALF_MM / _STEP_MM), round(_HALF_MM / _STEP_MM) + 1) * _STEP_MM
    apart = x[:, None] - x[None, :]
    integral = [_log_integral(apart + sign * _STEP_MM / 2) for sign in (1, -1)]
    compliance = -2.0 / (np.pi * MODULUS_MPA) * (integral[0] - integral[1])
    worn, dose, inside, depths = np.zeros_like(x), 0.0, np.abs(x) < 0.4, []
    for target in doses:
        for step in np.diff(np.linspace(dose, target, 25)):
            inside = inside | (np.abs(x) < 0.4)
            gap0 = x**2 / (2.0 * RADIUS_MM) + worn
            for _ in range(60):
                pressure, inside, settled = _contact(compliance, gap0, step, inside)
                if settled:
                    break
            worn = worn + step * pressure
        dose = target
        depths.append(worn / (worn.sum() * _STEP_MM) * LOAD_N / WIDTH_MM)
    return x, doses, np.array(depths)


def _log_integral(s):
    size = np.where(s == 0, 1.0, np.abs(s))
    return s * (np.log(size) - 1.0)


def _contact(compliance, gap0, step, inside):
    """Pressure that closes the gap where it is, with the wear of the step itself."""
    i = np.flatnonzero(inside)
    m = len(i)
    matrix = np.zeros((m + 1, m + 1))
    matrix[:m, :m] = compliance[np.ix_(i, i)] + step * np.eye(m)
    matrix[:m, m], matrix[m, :m] = -1.0, _STEP_MM
    found = np.linalg.solve(matrix, np.r_[-gap0[i], LOAD_N / WIDTH_MM])
    pressure = np.zeros(len(gap0))
    pressure[i] = found[:m]
    gap = gap0 + compliance @ pressure - found[m]
    after = (inside & (pressure > 0.0)) | (~inside & (gap < -1e-12))
    return pressure, after, bool((after == inside).all())


def worn_depth_um(x_mm, distance_m, coefficient):
    """Depth (n,), µm, at places from the scar's middle; its area is k P s/width."""
    x, doses, per_dose = worn_table()
    dose = coefficient * 1e3 * distance_m
    j = int(np.clip(np.searchsorted(doses, dose) - 1, 0, len(doses) - 2))
    t = np.log(dose / doses[j]) / np.log(doses[j + 1] / doses[j])
    depth = (1.0 - t) * per_dose[j] + t * per_dose[j + 1]
    return 1e3 * dose * np.interp(x_mm, x, depth)


def worn_area_mm2(distance_m, coefficient):
    return coefficient * LOAD_N * 1e3 * distance_m / WIDTH_MM


def worn_edges_mm(distance_m, coefficient):
    """Where the depth vanishes, from the scar's middle."""
    x = np.linspace(-_HALF_MM, _HALF_MM, 8801)
    worn = x[worn_depth_um(x, distance_m, coefficient) > 1e-6]
    return worn[0], worn[-1]


def rough_surface(finish, count, step_mm, rng, *, length_mm=None):
    """Heights (n,) of Ra 1: Gaussian waves of a spectrum, or the marks of a turning tool.

    ground: exponential correlation over 4 to 20 µm; lapped: a Gaussian one over 3 to 10 µm; turned:
    parabolic marks of a feed of .05 to .25 mm, unequal by a tenth, with fine roughness on them.
    `length_mm`: that correlation or feed.
    """
    if finish == "turned":
        feed = length_mm or np.exp(rng.uniform(np.log(0.05), np.log(0.25)))
        place = (np.arange(count) * step_mm + rng.uniform(0.0, feed)) / feed
        mark = place.astype(int)
        within = (place - mark - 0.5) ** 2 - 1.0 / 12.0
        unequal = 1.0 + 0.1 * rng.standard_normal(mark[-1] + 1)
        offset = 0.025 * rng.standard_normal(mark[-1] + 1)
        marks = (within * unequal[mark] + offset[mark]) / np.abs(within).mean()
        return 0.9 * marks + 0.45 * rough_surface("ground", count, step_mm, rng, length_mm=0.005)
    low, high = {"ground": (0.004, 0.02), "lapped": (0.003, 0.01)}[finish]
    length = length_mm or np.exp(rng.uniform(np.log(low), np.log(high)))
    frequency = np.fft.rfftfreq(4 * count, step_mm)  # longer than the trace: its ends do not meet
    if finish == "ground":
        power = 1.0 / (1.0 + (2.0 * np.pi * frequency * length) ** 2)
    else:
        power = np.exp(-((np.pi * frequency * length) ** 2))
    power[0] = 0.0
    wave = rng.standard_normal(len(power)) + 1j * rng.standard_normal(len(power))
    heights = np.fft.irfft(np.sqrt(power) * wave, 4 * count)[:count] * 4 * count
    return heights / np.sqrt(4.0 * power.sum()) * np.sqrt(np.pi / 2.0)  # Ra = Rq sqrt(2/pi)


def rough_trace(
    rng, distance_m, coefficient, ra_um, finish, *, count=None, form=True, spikes=True, length=None
):
    """A trace: places (n,), mm, heights (n,), µm, and the scar's middle, mm."""
    count = count or int(rng.choice([2000, 4000, 8000]))
    long = rng.uniform(6.0, 9.0)
    x = np.arange(count) * long / (count - 1)
    middle = long * (0.5 + rng.uniform(-0.08, 0.08))
    z = -worn_depth_um(x - middle, distance_m, coefficient)
    z += ra_um * rough_surface(finish, count, x[1], rng, length_mm=length)
    if form:
        u = x - long / 2.0
        z += 1e3 * np.tan(np.radians(rng.uniform(-1.0, 1.0))) * u + rng.uniform(-50.0, 50.0)
        radius = rng.choice([-1.0, 1.0]) * np.exp(rng.uniform(np.log(1e3), np.log(2e4)))
        z += 1e3 * u**2 / (2.0 * radius) + rng.uniform(-0.01, 0.01) * u**3
    if spikes:
        for _ in range(rng.integers(0, 8)):
            at = rng.integers(0, count - 5)
            z[at : at + rng.integers(1, 5)] += rng.choice([-1.0, 1.0]) * rng.uniform(2.0, 20.0)
    return x, z, middle


def write_trace(path: Path, x, z):
    np.savetxt(path, np.c_[x, z], fmt="%.5f", delimiter=",", header="x_mm,z_um", comments="")


def write_set(
    folder: Path,
    rng,
    coefficient,
    ra_um,
    finish,
    *,
    head="",
    traces=3,
    distances=DISTANCES_M,
    **how,
) -> Path:
    """A set of some distances, the paper's four, with some traces each; its file."""
    folder.mkdir(parents=True, exist_ok=True)
    text = f"[scar]\nwidth_mm = {WIDTH_MM}\n{head}"
    for distance in distances:
        for number in range(1, traces + 1):
            x, z, _ = rough_trace(rng, distance, coefficient, ra_um, finish, **how)
            name = f"{distance:g}m-{number}.csv"
            write_trace(folder / name, x, z)
            text += f'[[trace]]\nfile = "{name}"\ndistance_m = {distance}\nnormal_n = {LOAD_N}\n'
    (folder / "set.toml").write_text(text, "utf-8")
    return folder / "set.toml"
