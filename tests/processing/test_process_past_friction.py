"""A worn block remembers the friction that it was worn under: a frame's ± covers it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from isochrome.processing import process
from isochrome.processing.in_common import with_past_friction
from isochrome.samples import samples_path
from isochrome.scene import load_scene

KEY = "friction.coefficient"
SPREAD = f"{KEY} standard_uncertainty"
SCENE = load_scene("line-contact-wear")


def table(frictions, distances, uncertainty=1e-6):
    return {"distance_m": list(distances), KEY: list(frictions), SPREAD: [uncertainty] * 4}


def test_a_friction_that_was_another_before_is_wider_by_what_the_scar_remembers():
    """0.20 until 50 m, then rising to 0.30 at 100 m: by hand a mean of 0.2 and of 0.225."""
    found = with_past_friction(table([None, 0.2, 0.2, 0.3], [0, 0, 50, 100]), SCENE)
    assert found[SPREAD][:3] == [1e-6] * 3
    assert found[SPREAD][3] == pytest.approx(0.015 * 0.075)
    assert with_past_friction(found, SCENE) is found  # once is enough


def test_a_friction_that_is_always_the_same_and_a_block_that_wears_not_stay():
    given = table([0.2] * 4, [0, 31, 77, 155])
    assert with_past_friction(given, SCENE) is given
    given = table([0.2, 0.2, 0.2, 0.3], [0, 31, 77, 155])
    assert with_past_friction(given, SCENE.model_copy(update={"wear": None})) is given


@pytest.mark.long
def test_the_samples_frictions_lie_within_their_uncertainty_with_gamma_held():
    """They rise from 0.236 to 0.252: with the images' ± alone, that of 77 m was 3.7 of them off."""
    folder = samples_path() / "line-contact-wear"
    truth = json.loads((folder / "truth.json").read_text())["friction.coefficient"]
    columns = process(folder / "captured.tif", folder / "scene.toml").columns
    for value, spread, true in list(zip(columns[KEY], columns[SPREAD], truth, strict=True))[1:]:
        assert abs(value - true) < 3.0 * spread
    wide = np.array(columns[SPREAD][3:], dtype=float)
    assert (wide < 1e-3 * np.array(truth[3:])).all()  # a thousandth of the friction, no more
