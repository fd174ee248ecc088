"""Random courses of load, friction and wear coefficient over the distance, by their seed."""

import numpy as np

from isochrome.scene import load_scene

LENGTH_M = 200.0
SPACINGS_MM = (0.012, 0.006, 0.003)
LOADS_N, COEFFICIENTS, FRICTION = (10.0, 60.0), (1e-10, 1e-8), 0.6
UNCOUPLED, SHARE_UNCOUPLED = {"specimen.poisson": 0.0, "indenter.poisson": 0.5}, 0.3
"""A pair whose coupling is three times the paper's, and how many courses have it."""
KINDS = ("constant", "rising", "falling", "turning", "jumping")
OVERLOAD, SHARE_OVERLOADED = (1.2, 3.0), 0.6
"""Load of a pause over the load before it, and how many pauses have another load."""
STATES = 5


def random_course(seed):
    """A scene whose load, friction and wear coefficient (which may pause) are tables over 200 m, at
    the default tolerance, and a line that says of what kinds."""
    rng = np.random.default_rng([seed, 14])
    kinds = [str(rng.choice(KINDS)) for _ in range(3)]
    load = _table(rng, kinds[0], *LOADS_N)
    friction = _table(rng, kinds[1], 0.0, FRICTION)
    if rng.random() < 0.3:
        friction["value"] = [v - 0.5 * FRICTION for v in friction["value"]]
    low = 10.0 ** rng.uniform(*np.log10(COEFFICIENTS))
    wear = _table(rng, kinds[2], 0.3 * low, low)
    pauses = _pauses(rng)
    for start, end in pauses:
        wear = _paused(wear, start, end)
        if rng.random() < SHARE_OVERLOADED:
            load = _overloaded(load, start, end, rng.uniform(*OVERLOAD), rng.random() < 0.5)
    asked = np.sort(rng.uniform(1.0, LENGTH_M, STATES - len(pauses)))
    asked = np.sort(np.r_[asked, [rng.uniform(*pause) for pause in pauses]])
    spacing = float(rng.choice(SPACINGS_MM))
    values = {
        "load.normal_n": load,
        "friction.coefficient": friction,
        "friction.static_state_first": False,
        "wear.coefficient_mm2_per_n": wear,
        "wear.distances_m": tuple(float(round(s, 2)) for s in asked),
        "numerics.spacing_mm": spacing,
        "camera.pixel_mm": spacing,  # the grid divides the pixel
    }
    strong = rng.random() < SHARE_UNCOUPLED
    values |= UNCOUPLED if strong else {}
    words = f"load {kinds[0]}, friction {kinds[1]}, wear {kinds[2]}, {len(pauses)} pauses"
    return load_scene("line-contact-wear").with_values(values), (
        f"{words}, {1e3 * spacing:g} um{', strongly coupled' if strong else ''}"
    )


def _table(rng, kind, low, high):
    """Two to five points of a kind, from 0 to the course's end or nearly so."""
    if kind == "constant":
        return {"distance_m": [0.0, LENGTH_M], "value": [float(rng.uniform(low, high))] * 2}
    places = np.sort(rng.uniform(0.0, LENGTH_M, 2 if kind == "jumping" else rng.integers(2, 6)))
    values = rng.uniform(low, high, len(places))
    if kind == "rising":
        values = np.sort(values)
    elif kind == "falling":
        values = np.sort(values)[::-1]
    elif kind == "jumping":
        places = np.array([places[0], places[0] + rng.uniform(0.01, 1.0)])
    places += 1e-3 * np.arange(len(places))
    return {"distance_m": [float(round(s, 4)) for s in places], "value": [float(v) for v in values]}


def _pauses(rng):
    """None, one or two stretches in which nothing wears."""
    count = int(rng.integers(0, 3))
    ends = np.sort(rng.uniform(5.0, LENGTH_M - 5.0, 2 * count)).reshape(-1, 2)
    return [(float(a), float(max(b, a + 1.0))) for a, b in ends]


def _paused(table, start, end):
    """A table that falls to zero over half a metre at `start` and returns at `end`."""
    s, value = np.array(table["distance_m"]), np.array(table["value"])
    outside = (s < start) | (s > end)
    edge = 0.5 if end - start > 1.5 else 0.2 * (end - start)
    places = np.array([start, start + edge, end - edge, end])
    added = np.interp(places, s, value) * np.array([1.0, 0.0, 0.0, 1.0])
    s, value = np.r_[s[outside], places], np.r_[value[outside], added]
    order = np.argsort(s, kind="stable")
    keep = np.r_[True, np.diff(s[order]) > 1e-9]
    return {"distance_m": s[order][keep].tolist(), "value": value[order][keep].tolist()}


def _overloaded(table, start, end, factor, lasting):
    """A table that rises by a factor within a pause, and with `lasting` stays there after it."""
    s, value = np.array(table["distance_m"]), np.array(table["value"])
    at = start + np.array([0.4, 0.6, 0.8, 0.95]) * (end - start)
    raised = np.interp(at, s, value) * np.array([1.0, factor, factor, factor if lasting else 1.0])
    before, after = s < at[0], s > at[-1]
    later = value[after] * (factor if lasting else 1.0)
    places, values = np.r_[s[before], at, s[after]], np.r_[value[before], raised, later]
    return {"distance_m": places.tolist(), "value": values.tolist()}
