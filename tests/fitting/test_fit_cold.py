"""Cold starts: random contacts, rendered, and fitted from values that are far off."""

import pytest

from fitting.cold_frames import LOAD_BAR, RIGHT_CHI, is_right, random_case
from isochrome.errors import InputError
from isochrome.fitting import fit_frame, placed
from isochrome.fitting.search import search_frame


def study(kind: str, seeds: range) -> list[str]:
    """Fit random cases; each that is wrong in a sentence. None may be wrong with a chi near 1."""
    wrong = []
    for seed in seeds:
        case = random_case(kind, seed)
        fit = fit_frame(case.data, case.begun, case.keys)
        if not is_right(case, fit):
            said = dict(zip(case.keys, (case.errors(fit) / fit.values).tolist(), strict=True))
            wrong.append(f"{case.data.name}: chi {fit.chi:.2f}, relative errors {said}")
            print(wrong[-1])
            assert fit.chi > RIGHT_CHI, wrong[-1]
        else:
            assert fit.chi < RIGHT_CHI, (case.data.name, fit.chi)
    return wrong


@pytest.mark.parametrize(
    ("kind", "seeds"),
    [
        pytest.param("held", range(6, 7), marks=pytest.mark.long), ("sliding", range(3, 4)),
        *(pytest.param(kind, range(8), marks=pytest.mark.study)
          for kind in ("sliding", "worn", "flat", "disc")),
    ],
    ids=str,
)  # fmt: skip
def test_contacts_and_discs_are_found_from_far_values(kind, seeds):
    assert study(kind, seeds) == []


@pytest.mark.study
def test_friction_of_a_held_contact_is_found_beside_its_forces():
    # The slip at the edges tells it: its own uncertainty says how well.
    for seed in range(8):
        case = random_case("held", seed)
        mu = case.true.friction_at(0.0)
        keys = (*case.keys, "friction.coefficient")
        begun = case.begun.with_values(
            {"load.tangential_n": 0.0, "friction.coefficient": mu * (0.4 if seed % 2 else 2.5)}
        )
        fit = fit_frame(case.data, begun, keys)
        spread = fit.standard_uncertainty[-1]
        assert fit.chi < RIGHT_CHI, case.data.name
        assert abs(fit.values[0] / case.true.load.normal_n - 1.0) < LOAD_BAR, case.data.name
        assert abs(fit.values[-1] - mu) < 4.0 * spread, (case.data.name, fit.values[-1], mu, spread)


@pytest.mark.long
@pytest.mark.parametrize(
    ("seed", "factors"), [pytest.param(1, (0.03, 0.04), marks=pytest.mark.study), (0, (9.0, 20.0))]
)
def test_a_load_outside_the_search_is_flagged_by_chi(seed, factors):
    case = random_case("held", seed, factors=factors)
    fit = fit_frame(case.data, case.begun, case.keys)
    assert fit.chi > RIGHT_CHI or is_right(case, fit), (case.data.name, fit.chi, fit.values)


@pytest.mark.long
def test_another_cylinder_than_the_scenes_is_flagged_by_chi():
    case = random_case("held", 2)
    other = 2.5 * case.true.indenter.radius_mm
    begun = case.begun.with_values({"indenter.radius_mm": other})
    fit = fit_frame(case.data, begun, case.keys)
    assert fit.chi > 1.3, fit.chi


@pytest.mark.long
def test_other_minima_have_a_value_for_each_key():
    """An unknown that nothing is scanned in has the scene's."""
    case = random_case("held", 1)
    fit = fit_frame(case.data, case.begun, ("frames.gamma", *case.keys))
    assert fit.others and all(len(m.values) == len(fit.keys) for m in fit.others)


def test_scene_values_that_lead_to_the_noise_are_taken_at_their_word(scans):
    case = random_case("held", 1)
    near = case.true.with_values({"load.normal_n": 1.03 * case.true.load.normal_n})
    found = search_frame(case.data, placed(near, case.data.light.shape), case.keys)
    assert not scans
    assert found[0].values[0] == pytest.approx(case.true.load.normal_n, rel=5e-3)
    search_frame(case.data, case.begun, case.keys)
    assert scans


def test_the_rival_a_fringe_of_bulk_stress_away_is_told():
    # Far from the contact a fringe more of bulk stress leaves sin²(pi N) as it is; the load and
    # the depth make up for what the contact's own stress then lacks.
    case = random_case("held", 1)
    specimen = case.true.specimen
    fringe = specimen.fringe_value_n_per_mm / specimen.thickness_mm
    best, *others = search_frame(case.data, case.begun, case.keys)
    bulk = case.keys.index("load.bulk_mpa")
    away = [(m.values[bulk] - best.values[bulk]) / fringe for m in others]
    assert any(abs(abs(hop) - 1.0) < 0.3 for hop in away), away
    assert [m.chi for m in others] == sorted(m.chi for m in others)
    assert others[0].chi > 1.2 * best.chi


def test_a_key_without_a_number_is_refused():
    case = random_case("sliding", 3)
    with pytest.raises(InputError, match=r"load\.bulk_mpa = None cannot be fitted"):
        search_frame(case.data, case.begun, ("load.normal_n", "load.bulk_mpa"))
