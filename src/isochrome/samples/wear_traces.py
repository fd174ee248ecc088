"""The sample of a wear test: traces across the scars of the true contact, and its friction."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import SurfaceState, contact_states
from isochrome.output import write_csv, write_json, write_text
from isochrome.samples.contact_images import SCENE, true_contact
from isochrome.samples.sensor import sample_text
from isochrome.scene import Scene, load_scene

Array = NDArray[np.floating]

RA_UM, CORRELATION_MM = 0.12, 0.012
"""Ra of the ground surface, and the length over which its heights forget each other by 1/e."""

POINTS, LENGTH_MM = 2000, 7.0
TILT_DEG, ROUND_MM, OFF_MM = 0.5, (2e3, 9e3), 0.3
"""Largest tilt, radii of the block's form, and the scar's largest distance from the middle."""

_DUST, _HIGHEST_UM = 4, 8.0
"""Most points with dust on them, and how high it is."""


SPEED_MM_PER_S, RATE_HZ, SCATTER, KEEP = 257.7, 5.0, 0.006, 0.8
"""The cylinder's 100 revolutions a minute; rows a second of the friction's file, and the scatter of
its tester, of which this part is still there in the next row."""


def render_wear(folder: Path, seed: int) -> None:
    """Write the traces, the friction, the calibration set and the truth to a folder."""
    truth = true_contact(load_scene(SCENE))
    states = {state.distance_m: state for state in contact_states(truth)}
    text = sample_text("wear-set.toml")
    places, areas = {}, {}
    for number, item in enumerate(tomllib.loads(text)["trace"]):
        state = states[item["distance_m"]]
        x, z, middle = _trace(state, np.random.default_rng([seed, 30, number]))
        write_csv(folder / item["file"], {"x_mm": x.tolist(), "z_um": z.tolist()})
        places[item["file"]] = middle
        worn = float(np.trapezoid(state.wear_depth_mm, state.grid.x_mm))
        areas[f"{item['distance_m']:g}"] = float(f"{worn:.6g}")
    write_csv(folder / "friction.csv", _friction(truth, np.random.default_rng([seed, 31])))
    write_text(folder / "set.toml", text)
    values: dict[str, Any] = {
        "rendered": "by Isochrome: every value below was put in, none was measured",
        "seed": seed,
        "load.normal_n": truth.get("load.normal_n"),
        "wear.coefficient_mm2_per_n": truth.get("wear.coefficient_mm2_per_n"),
        "worn_area_mm2_by_distance_m": areas,
        "scar_middle_mm": places,
        "friction_distance_m": list(truth.get("friction.coefficient").distance_m),
        "friction.coefficient": list(truth.get("friction.coefficient").value),
        "sliding_speed_mm_per_s": SPEED_MM_PER_S,
        "ra_um": RA_UM,
        "correlation_mm": CORRELATION_MM,
    }
    write_json(folder / "truth.json", values)


def _friction(truth: Scene, rng: np.random.Generator) -> dict[str, list[float]]:
    """The friction that a tester recorded over the test's time: the true one, and scatter."""
    assert truth.wear is not None
    end_s = 1e3 * max(truth.wear.distances_m) / SPEED_MM_PER_S
    time = np.arange(int(end_s * RATE_HZ) + 2) / RATE_HZ
    scatter = SCATTER * _correlated(len(time), KEEP, rng)
    coefficient = truth.friction_at(1e-3 * SPEED_MM_PER_S * time) + scatter
    return {"time_s": np.round(time, 1).tolist(), "coefficient": np.round(coefficient, 4).tolist()}


def _trace(state: SurfaceState, rng: np.random.Generator) -> tuple[Array, Array, float]:
    """Places (n,), mm, heights (n,), µm, both rounded as a file has them, and the scar's middle."""
    x = np.round(np.linspace(0.0, LENGTH_MM, POINTS), 4)
    middle = round(float(0.5 * LENGTH_MM + rng.uniform(-OFF_MM, OFF_MM)), 4)
    z = -1e3 * np.interp(x - middle, state.grid.x_mm, state.wear_depth_mm, left=0.0, right=0.0)
    z += RA_UM * _ground(x, rng)
    u = x - 0.5 * LENGTH_MM
    z += 1e3 * np.tan(np.radians(rng.uniform(-TILT_DEG, TILT_DEG))) * u
    z += 1e3 * u**2 / (2.0 * rng.uniform(*ROUND_MM))
    dust = rng.integers(0, POINTS, rng.integers(0, _DUST + 1))
    z[dust] += rng.uniform(0.3, 1.0, len(dust)) * _HIGHEST_UM
    return x, np.round(z, 3), middle


def _ground(x: Array, rng: np.random.Generator) -> Array:
    """Gaussian heights (n,) of Ra 1 that are correlated as exp(-distance/length)."""
    keep = float(np.exp(-(x[1] - x[0]) / CORRELATION_MM))
    return np.asarray(_correlated(len(x), keep, rng) * np.sqrt(np.pi / 2.0))  # Ra = Rq sqrt(2/pi)


def _correlated(count: int, keep: float, rng: np.random.Generator) -> Array:
    """Gaussian numbers (count,) of variance 1, of each of which a part is in the next."""
    fresh = rng.standard_normal(count) * np.sqrt(1.0 - keep**2)
    numbers = np.empty(count)
    last = rng.standard_normal()
    for i, new in enumerate(fresh):
        last = keep * last + new
        numbers[i] = last
    return numbers
