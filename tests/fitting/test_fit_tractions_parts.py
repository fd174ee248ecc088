"""Tractions from a frame: signs, uncertainties, what is said."""

import numpy as np
import pytest

from fitting.pressed import CONTACT, Pressed
from isochrome.fitting import tractions

VIEW = Pressed((CONTACT,), cols=160, rows=120, pixel=0.025)


def test_least_squares_with_signs_meets_its_conditions():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(40, 12))
    matrix, right = root.T @ root, rng.normal(size=12)
    c = tractions.with_signs(matrix, right, 3)
    slope = matrix @ c - right
    assert c[3:].min() >= 0.0 and (c[3:] == 0.0).any() and (c[3:] > 0.0).any()
    # Karush, Kuhn and Tucker: no slope where free, none that lowers where at the bound
    free = np.r_[np.ones(3, bool), c[3:] > 0.0]
    assert np.abs(slope[free]).max() < 1e-7
    assert slope[~free].min() > 0.0


def test_uncertainties_are_widened_by_chi():
    data = VIEW.data()
    right, low = (tractions.invert_tractions(d, VIEW.scene()) for d in (data, data.with_noise(0.5)))
    assert low.chi == pytest.approx(2.0 * right.chi, rel=0.01)
    for one, other in ((low.load_n, right.load_n), (low.tangential_n, right.tangential_n)):
        # the smoothness that is most probable differs a little, and what touches its bound
        assert one.standard_uncertainty == pytest.approx(other.standard_uncertainty, rel=0.1)


@pytest.fixture(scope="module")
def stage():
    data = VIEW.data()
    search = tractions.nearest_contacts(data, VIEW.scene())
    return tractions.invert(data, search[0].scene, free_top=False), search


@pytest.mark.parametrize(("share", "said"), [(0.0098, False), (0.0102, True)])
def test_a_load_is_told_to_be_uncertain_from_one_per_cent(stage, share, said):
    found = tractions.what_to_say(*stage, tractions.Measured(44.0, 44.0 * share))
    assert len(found) == said
    assert all("the load is determined to 1.0 % only" in text for text in found)


@pytest.mark.parametrize(("chi", "said"), [(1.02, False), (1.04, True)])
def test_tractions_that_do_not_describe_the_frame_are_told_from_a_chi_of_1_03(
    stage, chi, said, monkeypatch
):
    monkeypatch.setattr(tractions.TractionModel, "chi", chi)
    found = tractions.what_to_say(*stage, tractions.Measured(44.0, 0.01))
    assert any(f"chi = {chi:.2f}: no tractions" in text for text in found) is said
