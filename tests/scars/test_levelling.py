"""Levelled traces against truths that share no code with the package (`worn_scars`)."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from isochrome import scars
from isochrome.errors import InputError
from worn_scars import (
    DISTANCES_M,
    FINISHES,
    rough_surface,
    rough_trace,
    worn_area_mm2,
    worn_depth_um,
    worn_edges_mm,
)

K = 2e-9


def trace_of(seed, distance=155.0, ra=0.1, finish="ground", **how):
    x, z, middle = rough_trace(np.random.default_rng(seed), distance, K, ra, finish, **how)
    return scars.Trace(x_mm=x, z_um=z), middle


def pull(found, distance):
    return (found.worn_area_mm2 - worn_area_mm2(distance, K)) / found.worn_area_uncertainty_mm2


@pytest.mark.parametrize(
    ("distance", "finish"), list(zip(DISTANCES_M, (*FINISHES, "ground"), strict=True))
)
def test_area_and_edges_are_within_their_uncertainty(finish, distance):
    """4.5: Student's t of six degrees of freedom, beyond which one in 250 lies."""
    trace, middle = trace_of([1, int(distance)], distance, 0.08, finish)
    found = scars.levelled(trace)
    assert abs(pull(found, distance)) < 4.5
    for edge, u, true in zip(
        found.edges_mm, found.edge_uncertainty_mm, worn_edges_mm(distance, K), strict=True
    ):
        assert abs(edge - middle - true) < 4.0 * u
        assert u < 0.06
    assert found.messages == ()


def test_a_smooth_scar_has_its_area_to_a_part_in_a_thousand():
    """Bins of 29 µm cut the run-out at its edges; roughness of 1 nm is next to none."""
    trace, _ = trace_of(3, 233.0, 1e-3, "lapped", form=False, spikes=False)
    found = scars.levelled(trace)
    assert found.worn_area_mm2 == pytest.approx(worn_area_mm2(233.0, K), rel=1e-3)


def test_a_line_or_another_origin_changes_nothing():
    """The level is linear in the heights, and a tilt is free in it."""
    trace, _ = trace_of(4, spikes=False)
    one = scars.levelled(trace)
    tilted = replace(trace, x_mm=trace.x_mm + 3.0, z_um=trace.z_um + 8.0 * trace.x_mm - 40.0)
    two = scars.levelled(tilted)
    assert two.worn_area_mm2 == pytest.approx(one.worn_area_mm2, rel=1e-6)
    assert two.edges_mm[0] - 3.0 == pytest.approx(one.edges_mm[0], abs=1e-5)
    back = scars.levelled(scars.Trace(x_mm=-trace.x_mm, z_um=trace.z_um))
    assert back.worn_area_mm2 == pytest.approx(one.worn_area_mm2, rel=2e-3)


def test_heights_that_go_downward_are_turned_and_said():
    trace, _ = trace_of(5)
    one, two = scars.levelled(trace), scars.levelled(replace(trace, z_um=-trace.z_um))
    assert two.worn_area_mm2 == pytest.approx(one.worn_area_mm2, rel=1e-9)
    assert one.messages == () and "stands up" in two.messages[0]


def test_spikes_do_not_matter():
    trace, _ = trace_of(6, spikes=False)
    plain = scars.levelled(trace)
    z = trace.z_um.copy()
    inside = int(np.searchsorted(trace.x_mm, plain.centre_mm))
    for at in (100, inside, inside + 40):
        z[at : at + 3] += 15.0  # one alone would add .05 of the 3.4 µm mm
    found = scars.levelled(replace(trace, z_um=z))
    assert found.spikes - plain.spikes == 9
    off = found.worn_area_mm2 - plain.worn_area_mm2
    assert abs(off) < 0.3 * plain.worn_area_uncertainty_mm2


def test_ridges_beside_a_scar_are_said_and_are_no_wear():
    trace, middle = trace_of(7, 155.0, 0.05, "lapped", form=False)
    left, right = worn_edges_mm(155.0, K)
    u = trace.x_mm - middle
    ridge = sum(1.5 * np.exp(-(((u - at) / 0.05) ** 2)) for at in (left - 0.1, right + 0.1))
    found = scars.levelled(replace(trace, z_um=trace.z_um + ridge))
    assert "ridges" in found.messages[0]
    # 1.5 sqrt(pi) .05 µm mm, a little of which lies beyond the flank
    assert np.array(found.ridges_mm2) == pytest.approx(1.5e-3 * np.sqrt(np.pi) * 0.05, rel=0.15)
    assert found.worn_area_mm2 == pytest.approx(worn_area_mm2(155.0, K), rel=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_a_shallow_scar_is_wide_or_refused(seed):
    """1 µm deep in an Ra of .8 µm: below twice the roughness."""
    trace, _ = trace_of([8, seed], 31.0, 0.8, FINISHES[seed % 3])
    with suppress(scars.UnclearScarError):
        assert abs(pull(scars.levelled(trace), 31.0)) < 3.0


def test_nothing_worn_is_no_scar():
    rng = np.random.default_rng(9)
    x = np.linspace(0.0, 7.0, 3000)
    z = 0.3 * rough_surface("ground", 3000, x[1], rng) + 0.4 * (x - 3.0) ** 2
    with pytest.raises(scars.UnclearScarError, match="no scar stands out"):
        scars.levelled(scars.Trace(x_mm=x, z_um=z, name="flat.csv"))


@pytest.mark.parametrize("half", [0.4, 0.7, 1.0])
def test_a_trace_without_shoulders_is_refused(half):
    """A form that is free would take up the scar, and leave a tenth of its area."""
    x = np.linspace(-half, half, 2000)
    z = -worn_depth_um(x, 233.0, K) + 0.05 * np.random.default_rng(1).standard_normal(2000)
    with pytest.raises(InputError, match="too little to level it"):
        scars.levelled(scars.Trace(x_mm=x, z_um=z))


def test_millimetres_called_micrometres_are_refused():
    trace, _ = trace_of(10, form=False, spikes=False)
    with pytest.raises(InputError, match="check the unit of z"):
        scars.levelled(replace(trace, z_um=1e-3 * trace.z_um))


@pytest.mark.long
def test_a_deep_waviness_widens_the_area():
    """Waves as long as the scar cannot be told from it: the ± has to hold them."""
    plain, waved = [], []
    for seed in range(3):
        trace, _ = trace_of([11, seed], 155.0, 0.05, "lapped", spikes=False)
        phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi)
        wave = 0.2 * np.sin(2.0 * np.pi * trace.x_mm / 1.1 + phase)
        plain.append(scars.levelled(trace).worn_area_uncertainty_mm2)
        found = scars.levelled(replace(trace, z_um=trace.z_um + wave))
        waved.append(found.worn_area_uncertainty_mm2)
        assert abs(pull(found, 155.0)) < 4.5
    assert np.median(waved) > 3.0 * np.median(plain)


def test_the_depths_covariance_is_that_of_the_area():
    trace, _ = trace_of(12)
    found = scars.levelled(trace)
    low, high = found.window_mm
    step = found.x_mm[1] - found.x_mm[0]
    overlap = np.minimum(found.x_mm + step / 2, high) - np.maximum(found.x_mm - step / 2, low)
    weights = 1e-3 * np.clip(overlap, 0.0, step)
    assert weights @ found.depth_um == pytest.approx(found.worn_area_mm2, rel=1e-9)
    u = np.sqrt(weights @ found.depth_covariance_um2 @ weights)
    # the area's own has what the degrees of the form disagree besides
    assert 0.7 * found.worn_area_uncertainty_mm2 < u < 1.001 * found.worn_area_uncertainty_mm2


def test_white_roughness_has_the_variance_of_white_noise():
    """A flat spectrum of unit density: u² = σ² Σ w² for weights that vary slowly enough."""
    bands = scars.make_bands(200, 0.03)
    members = np.bincount(bands.band)
    flat = scars.Roughness(0.03, bands.edges_per_mm, members / members.sum(), np.eye(len(members)))
    weights = np.exp(-(((np.arange(200) - 90) / 12.0) ** 2))
    weights = weights - weights.mean()  # no power at no frequency, which no band has
    variance, freedom = flat.variance(weights)
    assert flat.rq_um == pytest.approx(1.0)
    assert variance == pytest.approx(np.sum(weights**2), rel=0.05)
    assert 2.0 <= freedom <= 2.0 * len(members)


def test_the_spectrum_of_known_waves_is_found():
    """An exponential correlation of 30 µm: the power of each octave within its uncertainty."""
    rng = np.random.default_rng(13)
    step, count, length = 0.02, 240, 0.03
    pulls = []
    for _ in range(4):
        z = 0.2 * rough_surface("ground", count * 20, step / 20, rng, length_mm=length)
        z = z.reshape(count, 20).mean(axis=1)
        form = np.polynomial.legendre.legvander(np.linspace(-1, 1, count), 4)
        found = scars.fit_roughness(z, np.ones(count, bool), form, step)
        edges, sigma = found.edges_per_mm[2:6], 0.2 * np.sqrt(np.pi / 2.0)
        shares = np.arctan(2.0 * np.pi * length * edges) * 2.0 / np.pi
        true = np.log(np.diff(shares) * sigma**2)  # below 6/mm, a bin's mean changes little
        spread = np.sqrt(np.diag(found.log_covariance))[2:5]
        pulls.append((np.log(found.power_um2[2:5]) - true) / spread)
    assert np.abs(np.mean(pulls)) < 4.0 / np.sqrt(np.size(pulls)) + 0.3
    assert np.sqrt(np.mean(np.square(pulls))) < 1.6


def test_a_places_covariance_is_that_of_all_its_unknowns():
    """Truth: depth, place, width, exponent and form side by side, by central differences."""
    x = np.linspace(0.0, 6.0, 241)
    noise, truth = 0.05, np.array([4.0, 3.1, 0.9, 2.5])

    def depth(values):
        fine = x[:, None] + (x[1] - x[0]) * (np.arange(40) + 0.5 - 20.0) / 40.0
        u = np.abs((fine - values[1]) / values[2])
        return values[0] * np.mean(np.maximum(1.0 - u ** values[3], 0.0) ** 1.2, axis=1)

    size = 1e-3 * truth
    slopes = [(depth(truth + e) - depth(truth - e)) / (2.0 * e.sum()) for e in np.diag(size)]
    form = np.polynomial.legendre.legvander(x / 3.0 - 1.0, 4)
    rows = np.column_stack([*slopes, form])
    normal = rows.T @ rows / noise**2 + np.diag(
        1.0 / np.r_[[np.inf] * 4, scars.form_spread(x, 4)] ** 2
    )
    normal[3, 3] += 1.0 / 0.7**2  # what is known of the exponent beforehand
    start = scars.ScarShape(3.0, 1.0, 2.5, np.eye(3))
    found = scars.refine_place(
        x, -depth(truth), start, scars.whitening(x, noise**2 * np.eye(len(x)))
    )
    assert (found.centre_mm, found.half_mm) == pytest.approx((3.1, 0.9), abs=1e-3)
    # shapes are means of five points of a bin, and slopes one-sided differences of a hundredth
    expected = np.linalg.inv(normal)[1:4, 1:4]
    spread = np.sqrt(np.diag(expected))
    assert found.covariance / np.outer(spread, spread) == pytest.approx(
        expected / np.outer(spread, spread), abs=0.05
    )
