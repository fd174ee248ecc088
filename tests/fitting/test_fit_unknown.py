"""What no list of causes has: its place in the model, and frames of benches that have it."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import case_contacts
from benchmarks.outside_unlisted import UnlistedContact
from fitting.engine_frames import prepared
from fitting.sliding_bench import bench
from isochrome.estimation import Nuisance, Regions, ScoreProducts, weighed
from isochrome.fitting import SceneRenderer, fit_with_causes
from isochrome.fitting.causes.score import ORDER, STRESS, Asked
from isochrome.fitting.frame.renderer import scene_optics, with_waves
from isochrome.frames import Frame
from isochrome.processing import process
from isochrome.scene import load_scene


def test_waves_are_a_share_of_the_order_and_a_stress_besides():
    """A plate of another thickness; a window in the light's way, whose fringes add as vectors."""
    scene = bench(60, 80)
    field = SceneRenderer(scene, (60, 80)).field_alone(scene)
    order = scene_optics(scene).order
    ones, none = np.ones(field.shape, np.float32), np.zeros(field.shape, np.float32)
    thicker = with_waves(scene, field, np.stack((0.02 * ones, none, none)))
    # single precision
    assert order(thicker) == pytest.approx(1.02 * order(field), rel=1e-5)
    window = with_waves(scene, field, np.stack((none, 0.3 * ones, -0.4 * ones)))
    fringes = order(field) * np.exp(1j * np.angle(field))
    assert order(window) == pytest.approx(np.abs(fringes + 0.3 - 0.4j), abs=1e-4)
    assert order(with_waves(scene, 0.0 * field, np.stack((none, 0.3 * ones, -0.4 * ones)))) == (
        pytest.approx(0.5, rel=1e-5)
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("seed", "name"),
    [
        (52, ORDER),
        pytest.param(92, ORDER, marks=pytest.mark.study),
        (23, STRESS),
        pytest.param(13, STRESS, marks=pytest.mark.study),
    ],
)
def test_what_no_cause_explains_is_fitted_and_nothing_else_is_named_for_it(seed, name):
    """Fringes that are a few per cent more near a warm surface: another modulus was named for them,
    and friction was off by 4 of its ±. A clamp beside the contact: chi stayed at 1.08."""
    row = case_contacts.judged("unlisted", seed)
    assert row.first and row.flagged and row.chi < 1.03, (name, row.found)
    assert max(abs(row.load_pull), abs(row.friction_pull)) < 4.0


@pytest.mark.long
def test_orders_of_a_warm_surface_are_read():
    """Held against the orders that the frame was made of, also where the scene's own are off."""
    made = UnlistedContact(
        load_n=50.0, friction=0.2, shape=(164, 220), pixel_mm=4.0 / 220, warm=0.03
    )
    scene = load_scene(made.scene())
    found = process(made.frame(3)[None], scene)
    z = made.top_mm + made.pixel_mm * (np.arange(164) + 0.5)[:, None]
    x = made.left_mm + made.pixel_mm * (np.arange(220) + 0.5)[None, :]
    true = made.orders(x, z, made.load_n)
    (item,) = found.frames
    error = item.reading.order - true
    known = np.isfinite(error)
    assert known.mean() > 0.8
    # the noise of 2 grey levels over a pooled neighbourhood
    assert np.sqrt(np.mean(error[known] ** 2)) < 0.005
    assert any("no known cause explains" in text for text in found.warnings)


def test_what_has_no_form_of_its_own_is_as_uncertain_as_parts_of_the_picture_say():
    """One unknown beside a wave that explains nothing: four parts say 1, 1, -1 and -1."""
    region, ones = np.repeat(np.arange(4), 100), np.ones((1, 400))
    residual = np.where(region < 2, 1.0, -1.0)
    nuisance = Nuisance(
        name=ORDER, columns=None, now=np.zeros(1), roots=(1e-9 * np.eye(1),), weights=np.zeros(0)
    )
    products = ScoreProducts([(ones[:0], ones, 0.0 * ones, residual)])
    found = weighed(
        [nuisance], products, noise=1.0, fitted={ORDER}, chance=0.999, unknowns=np.arange(1), size=1
    )
    regions = Regions(
        region=region, fitted=ones, unknowns=np.arange(1), columns=0.0 * ones, residual=residual
    )
    asked = Asked(**vars(found), causes=(), order_power=np.empty((0, 0)), regions=regions)
    # without one part the mean is a third of one or the other: 3 times the variance of these
    assert asked.best == {ORDER} and asked.undecided == pytest.approx(np.array([[1.0 / 3.0]]))
    assert replace(asked, regions=None).undecided == pytest.approx(np.zeros((1, 1)), abs=1e-12)


def test_a_frame_as_its_scene_says_has_nothing_unknown():
    scene = bench(82, 110)
    image = SceneRenderer(scene, (82, 110)).signal(scene)
    grey = 20.0 + 200.0 * image + np.random.default_rng(0).normal(0.0, 2.0, image.shape)
    frame = Frame(0, np.clip(grey, 0, 255).astype(np.uint8), None, "clean")
    freed = fit_with_causes(prepared(frame.image, scene, bit_depth=8), scene)
    assert freed.now.waves is None and not {ORDER, STRESS} & freed.names
