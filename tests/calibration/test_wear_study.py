"""How often the truth lies within the ±: seeded sets of twelve traces by `worn_scars`, Ra .05 to .8
µm, ground, lapped and turned, with tilt, form and spikes; inputs exact."""

import numpy as np
import pytest

from isochrome.calibration import calibrate_wear
from isochrome.errors import InputError, PhysicsError
from worn_scars import FINISHES, worn_depth_um, write_set


def judged(folder, numbers, *, roughest=0.8):
    """Error and uncertainty over the truth (n,), whether the interval holds it, and Ra (n,)."""
    errors, spreads, held, roughness = [], [], [], []
    for number in numbers:
        rng = np.random.default_rng([2026, 18, number])
        k = 2e-9 * np.exp(rng.uniform(-0.4, 0.4))
        ra = np.exp(rng.uniform(np.log(0.05), np.log(roughest)))
        path = write_set(folder / str(number), rng, k, ra, FINISHES[number % 3])
        try:
            found = calibrate_wear(path)
        except (PhysicsError, InputError):
            continue  # no distance with clear scars, or a form taken for a shoulder: refused
        errors.append(found.coefficient_mm2_per_n / k - 1.0)
        spreads.append(found.standard_uncertainty / k)
        held.append(found.interval_95[0] <= k <= found.interval_95[1])
        roughness.append(ra)
    return np.array(errors), np.array(spreads), np.array(held), np.array(roughness)


@pytest.mark.long
def test_the_pulls_of_some_sets_are_those_of_their_uncertainty(tmp_path):
    """Nine sets: mean square pull within what chi squared of nine allows, 1 in 1000."""
    errors, spreads, _, ra = judged(tmp_path, range(300, 309))
    assert len(errors) == 9
    pulls = errors / spreads
    assert 0.10 < np.mean(pulls**2) < 3.1
    assert np.abs(errors[ra < 0.2]).max() < 0.01


@pytest.mark.study
def test_the_interval_holds_the_truth_in_eight_hundred_sets(tmp_path):
    """93 to 97 %: 800 draws scatter by 0.8 %, where 200 scatter by 1.5."""
    errors, spreads, held, ra = judged(tmp_path, [*range(200), *range(1000, 1600)])
    print(
        f"{len(held)} sets of 800: within the 95 % interval {np.mean(held):.3f}, pulls "
        f"{np.std(errors / spreads):.2f}, largest {np.abs(errors / spreads).max():.2f}; where Ra < "
        f".2 µm: {np.mean(np.abs(errors[ra < 0.2]) < 0.01):.3f} within 1 %"
    )
    assert len(held) >= 780
    assert 0.93 <= np.mean(held) <= 0.97
    assert np.mean(np.abs(errors[ra < 0.2]) < 0.01) > 0.97
    assert np.abs(errors / spreads).max() < 4.0


@pytest.mark.study
def test_a_shallow_scar_has_a_wide_uncertainty_or_is_refused(tmp_path):
    """Ra from half the depth after 31 m to all of it. Student's t of some twenty degrees of freedom
    lies beyond 3 of its standard deviations once in 200 draws."""
    pulls = []
    for number in range(100):
        rng = np.random.default_rng([2026, 19, number])
        k = 2e-9 * np.exp(rng.uniform(-0.4, 0.4))
        deepest = worn_depth_um(np.zeros(1), 31.0, k)[0]
        ra = deepest * rng.uniform(0.5, 1.0)
        path = write_set(
            tmp_path / str(number), rng, k, ra, FINISHES[number % 3], distances=(31.0,)
        )
        try:
            found = calibrate_wear(path)
        except (InputError, PhysicsError):
            continue
        pulls.append((found.coefficient_mm2_per_n - k) / found.standard_uncertainty)
    print(
        f"{100 - len(pulls)} of 100 refused; pulls of the others {np.abs(pulls).max():.2f} at most"
    )
    assert np.abs(pulls).max() < 3.0
