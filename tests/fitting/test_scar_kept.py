"""Which scars of a track are kept: one below any area that a track may go back to."""

import numpy as np
import pytest

from isochrome.fitting.tracking.wear_state import Drive, TrackPast, WornScar, _with_one_more
from isochrome.scene import load_scene


@pytest.mark.parametrize("growth", [5e-5, 1e-3, 6e-3, 0.03])
@pytest.mark.parametrize("noise", [0.0, 3e-3])
@pytest.mark.parametrize("elastic", [0.0, 10.0])
def test_a_scar_is_kept_below_any_area_that_a_track_goes_back_to(growth, noise, elastic):
    """A box of worn areas begins 3 % behind the last: its scar was worn from nought, evenly. Of a
    film that grows by .6 % a frame the wear coefficient then jumped by 4 %; of one whose scar was
    small beside what the elasticity takes up, by which boxes are wide, by 11 %."""
    rng = np.random.default_rng(3)
    kept: list[WornScar] = []
    largest = 0
    for i in range(int(1.5 / growth)):
        area = (1.0 + growth) ** i * (1.0 + noise * rng.standard_normal())
        kept = _with_one_more(kept, WornScar(area, np.zeros(3)), elastic)
        largest = max(largest, len(kept))
        assert [scar.worn_mm2 for scar in kept] == sorted(scar.worn_mm2 for scar in kept)
        if area > 1.2:  # from where nine tenths, and noise, lie beyond the first scar
            whole = area + elastic
            for wanted in (area - 0.08 * whole, area - 0.03 * whole):
                if wanted < kept[0].worn_mm2 and kept[0].worn_mm2 < 1.1:
                    continue  # all are kept, from the first on
                below = max(scar.worn_mm2 for scar in kept if scar.worn_mm2 <= wanted)
                # between two kept ones lie a hundredth, a frame, and its noise on both sides
                assert below > wanted - 0.01 * whole - wanted * (growth + 8.0 * noise)
    assert largest < 20


def test_a_scar_grows_on_where_the_load_in_hand_touches_it():
    """11 N/mm wore it, 6 N/mm are on it: the half-width of a contact goes with the root of these.
    Boxes wore on by loads of long ago, and what a frame says of its wear was wrong by half."""
    past = TrackPast()
    wear = {"distances_m": (0.0, 0.1), "coefficient_mm2_per_n": 2e-9, "law": "archard"}
    scene = load_scene("line-contact-wear")
    past.use(scene.with_values({f"wear.{key}": value for key, value in wear.items()}))
    past.begin(Drive(np.array([0.0]), np.array([11.0]), np.array([0.0])))
    for area in (0.0, 1e-5, 2e-5):
        past.passed(area, 11.0, 0.0)
    past.wear([1.8e-5, 4e-5], (2.2e-5, 6.0, 0.0), scale=1.0, elastic_mm2=1.7e-3)
    low, high = (scar.depth_mm for scar in past._scars[-2:])
    wide = [np.count_nonzero(depth > 0.05 * depth.max()) for depth in (low, high - low)]
    assert wide[1] / wide[0] == pytest.approx(
        np.sqrt(6.0 / 11.0), rel=0.03
    )  # a scar widens it by 1 %
