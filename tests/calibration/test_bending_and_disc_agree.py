"""A beam and a disc of one material give one fringe value, within what both state."""

import json

import numpy as np
import pytest

from isochrome.calibration import calibrate_bending, calibrate_disc
from isochrome.samples import samples_path


@pytest.mark.long
def test_the_sample_beam_and_disc_agree():
    samples = samples_path()
    beam = calibrate_bending(samples / "bending" / "set.toml")
    disc = calibrate_disc(samples / "disc" / "set.toml")
    away = beam.fringe_value_n_per_mm - disc.fringe_value_n_per_mm
    assert abs(away) < 2 * np.hypot(beam.standard_uncertainty, disc.standard_uncertainty)
    # sizes and loads are exact in these sets, so that the images' own part must cover it as well
    noise = [
        next(b for b in found.budget if b.name == "image noise and fit").contribution_n_per_mm
        for found in (beam, disc)
    ]
    assert abs(away) < 4 * np.hypot(*noise)
    for found, name in ((beam, "bending"), (disc, "disc")):
        truth = json.loads((samples / name / "truth.json").read_text("utf-8"))
        assert found.fringe_value_n_per_mm == pytest.approx(
            truth["fringe_value_n_per_mm"], rel=1e-3
        )
        assert found.order_at_zero_load == pytest.approx(truth["order_at_zero_load"], abs=0.005)
