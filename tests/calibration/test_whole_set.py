"""All images of a calibration in one model: its derivatives, and what it shows besides."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.outside_specimens import Bench, beam_images, disc_images
from isochrome.calibration import whole_set
from isochrome.calibration.disc.api import RESIDUAL, disc_model, simple_residual
from isochrome.calibration.four_point_bending import MOMENT, beam_kind, fit_beam
from isochrome.calibration.whole_set import SHARED, SetModel

from .conftest import BEAM, F_SIGMA, HEIGHT, as_shots, bending_from_images, bending_load

BENCH = Bench(shape=(60, 76), size_px=44.0, angle_deg=1.0)
ORDERS = (1.2, 2.0)


def beam_model(**options):
    shots = as_shots([*beam_images(ORDERS, BENCH)], [1.0, 2.0], sigma=2.0)
    views, fits = zip(*(fit_beam(shot, BENCH.size_px) for shot in shots), strict=True)
    rows, cols = fits[0].model.rows, fits[0].model.cols
    model = SetModel(
        kind=beam_kind(views[0], BENCH.shape[1]), shots=shots, rows=rows, cols=cols,
        masks=np.concatenate([f.model.masks for f in fits]), **options,
    )  # fmt: skip
    free = *SHARED, MOMENT
    model = replace(model, free=free, exposed=not model.apart)
    own = np.concatenate([f.values for f in fits])
    shared = [0.005, -0.003, 0.002, 64.0, 0.1, 1.1]
    return model, np.concatenate([own, np.zeros(2 * model.exposed), shared, [0.01, -0.01]])


def stressed_model():
    shots = as_shots([*disc_images((0.0, *ORDERS), BENCH)], [0.0, 1.0, 2.0], sigma=2.0)
    shots = [*shots[1:], shots[0]]
    own = np.array([[n, 33.0, 34.0, 22.0, 0.02] for n in ORDERS])
    model = replace(disc_model(shots, own, {}), free=(RESIDUAL,), exposed=True)
    return model, np.concatenate([own.ravel(), [0.1, -0.2, 0.0, 0.0], simple_residual(0.2, 0.3)])


@pytest.mark.long
@pytest.mark.parametrize(
    "made",
    [beam_model, lambda: beam_model(apart=True), stressed_model],
    ids=["beam", "apart", "disc"],
)
def test_the_gradient_is_the_differences_of_the_cost(made):
    """Of every unknown: r r falls by 2 g for a step of one, the light free at each."""
    model, values = made()
    point = model.at(values)
    found, steps = point.gradient, np.sqrt(np.diag(point.normal))
    for i in range(model.size):
        if not steps[i]:
            continue
        step = np.zeros(model.size)
        step[i] = 1e-3 / steps[i]
        costs = [model.at(values + sign * step).cost for sign in (-1.0, 1.0)]
        slope = (costs[0] - costs[1]) / (4.0 * step[i])
        # beside tens of standard uncertainties one-sided differences are off by a part of one; what
        # a kind has besides leaves out how its slope blurs, some more where fringes are fine
        rel, near = (
            (5e-2, 2.0)
            if any(i in model.places.get(name, ()) for name in model.kind.besides)
            else (2e-2, 0.5)
        )
        assert slope == pytest.approx(found[i], rel=rel, abs=near * steps[i])


def bowed(edges, bow):
    """Frames of a beam whose orders leave the straight line by a share of them that is most at its
    edges and least in its middle: the slopes take part of it up."""
    rng, (rows, cols), pixel = np.random.default_rng(3), (100, 120), 0.23
    y = np.arange(rows)[:, None]
    eta = (y - rows / 2 - 4.0) * pixel
    share = 1.0 + bow * np.cos(2.0 * np.pi * y / rows)
    frames = []
    for edge in edges:
        order = edge * eta / (0.5 * HEIGHT) * share
        wave = np.where(np.abs(eta) < 0.5 * HEIGHT, np.sin(np.pi * order) ** 2, 0.0)
        light = 12.0 + 200.0 * wave + rng.normal(0.0, 3.0, (rows, cols))
        frames.append(np.clip(np.rint(light), 0, 255).astype(np.uint8))
    return bending_from_images(frames, [bending_load(e) for e in edges], BEAM, pixel)


def test_an_order_that_is_in_no_list_is_in_the_uncertainty():
    """Two in a thousand, within a pixel's noise, is four of the ± that noise alone gives an order;
    the line through two orders has their scatter, and would hide that."""
    edges = (2.5, 4.0)
    found = bowed(edges, 0.002)
    for image, edge in zip(found.images, edges, strict=True):
        assert abs(image.order - edge) < 2.0 * image.standard_uncertainty
    assert abs(found.fringe_value_n_per_mm - F_SIGMA) < 2.0 * found.standard_uncertainty


def test_a_fit_that_is_far_worse_under_even_light_is_a_rival_under_uneven(monkeypatch):
    lit = SimpleNamespace(positive=True)
    best, rival, worse = (SimpleNamespace(chi=chi, point=lit) for chi in (1.0, 1.5, 1.6))
    uneven = {1.0: 0.98, 1.5: 0.985, 1.6: 1.6}
    monkeypatch.setattr(
        whole_set, "unevenly_lit", lambda fit: SimpleNamespace(chi=uneven[fit.chi], point=lit)
    )
    found, alike = whole_set.alike_fits([best, rival, worse])
    assert [fit.chi for fit in found][:2] == [0.98, 0.985]
    assert [fit.chi for fit in alike] == [1.0, 0.98, 0.985]
