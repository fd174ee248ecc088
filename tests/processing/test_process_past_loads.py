"""A worn block remembers the loads that it was worn under: the wear coefficient's ± covers it."""

from math import hypot, sqrt

import pytest

from isochrome.processing import with_past_loads
from isochrome.scene import load_scene

LOAD, WEAR, SPREAD = "load.normal_n", "wear.coefficient_mm2_per_n", "standard_uncertainty"
SCENE = load_scene("line-contact-wear")


def table(loads, **more):
    """Frames after 50, 100 and 150 m, with a wear coefficient of 2e-9 that is surely known."""
    known = {f"{LOAD} {SPREAD}": [1e-3] * 3, f"{WEAR} {SPREAD}": [1e-14] * 3}
    return {"distance_m": [50, 100, 150], LOAD: list(loads), WEAR: [2e-9] * 3} | known | more


def test_a_frame_by_itself_is_as_unsure_as_its_load_was_another():
    """40, 44 and 48 N: by hand a mean of 44 N and of 1944 N² over the way, and so before it."""
    found = with_past_loads(table([40.0, 44.0, 48.0]), SCENE)
    scatter = 0.3 * sqrt(1944.0 - 44.0**2) / 44.0
    by_hand = [2e-9 * hypot(scatter, 44.0 / load - 1.0) for load in (40.0, 44.0, 48.0)]
    # of 50 and 100 m the mean until then: 44 N, and (50 x 44 + 50 x 42) / 100 = 43 N
    by_hand[1] = 2e-9 * hypot(0.3 * sqrt((1944.0 + 1768.0) / 2.0 - 43.0**2) / 43.0, 43 / 44 - 1)
    assert found[f"{WEAR} {SPREAD}"] == pytest.approx(by_hand)
    assert with_past_loads(found, SCENE) is found  # once is enough


def test_a_followed_frame_knows_the_loads_since_its_track_began():
    by = {"found_by": ["whole frame", "track", "track"]}
    found = with_past_loads(table([40.0, 44.0, 48.0], **by), SCENE)
    begun = 0.3 * sqrt(8.0) / 44.0  # at 50 m: a third of the way at the end
    assert found[f"{WEAR} {SPREAD}"][1:] == pytest.approx([2e-9 * begun / 2, 2e-9 * begun / 3])
    given = table([44.0] * 3)
    assert with_past_loads(given, SCENE) is given
    given = {name: column for name, column in table([40.0, 44.0, 48.0]).items() if LOAD not in name}
    assert with_past_loads(given, SCENE) is given
    given = {name: column[:1] for name, column in table([40.0, 44.0, 48.0]).items()}
    assert with_past_loads(given, SCENE) is given
