"""Which scars of a track are kept: one below any area that a track may go back to."""

from __future__ import annotations

import numpy as np
import pytest

from isochrome.fitting.tracking.scar_growth import _with_last
from isochrome.fitting.tracking.scar_steps import WornScar


@pytest.mark.parametrize("growth", [5e-5, 1e-3, 6e-3, 0.03])
@pytest.mark.parametrize("noise", [0.0, 3e-3])
def test_a_scar_is_kept_below_any_area_that_a_track_goes_back_to(growth, noise):
    """A box of worn areas begins 3 % behind the last: its scar was worn from nought, evenly.

    Of a film that grows by .6 % a frame the wear coefficient then jumped by 4 %.
    """
    rng = np.random.default_rng(3)
    kept: list[WornScar] = []
    largest = 0
    for i in range(int(1.5 / growth)):
        area = (1.0 + growth) ** i * (1.0 + noise * rng.standard_normal())
        kept = _with_last(kept, WornScar(area, np.zeros(3)))
        largest = max(largest, len(kept))
        if area > 1.2:  # from where nine tenths, and noise, lie beyond the first scar
            for wanted in (0.92 * area, 0.97 * area):
                below = max(scar.worn_mm2 for scar in kept if scar.worn_mm2 <= wanted)
                # between two kept ones lie a hundredth, a frame, and its noise on both sides
                assert below > wanted * (1.0 - 0.01 - growth - 8.0 * noise)
    assert largest < 20
