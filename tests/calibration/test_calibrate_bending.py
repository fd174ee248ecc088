"""Four-point bending: rendered beams of a known material, hostile sets, and the set's file."""

import json
import math

import numpy as np
import pytest
import tifffile

from isochrome.calibration import Uncertainty, calibrate_bending, load_set
from isochrome.errors import InputError, PhysicsError
from scene_texts import BENDING_BEAM

from .conftest import BEAM, F_SIGMA, PIXEL, assert_agrees, bending_from_images, bending_load

SMALL = {"shape": (110, 147), "pixel": 0.21}
"""The same beam at a third of the resolution: 95 pixels high, 8 fringes at most in the defaults."""
HALF = {"shape": (165, 220), "pixel": 0.14}


def calibrated(frame, edges, seed=0, uncertainty=None, **options):
    rng = np.random.default_rng(seed)
    images = [frame(edge, rng, **options) for edge in edges]
    loads = [bending_load(edge) for edge in edges]
    bright = options.get("bright", False)
    return bending_from_images(
        images, loads, BEAM, options.get("pixel", PIXEL), bright=bright, uncertainty=uncertainty
    )


def assert_right(found, bar):
    assert_agrees(found, bar)
    assert 0.9 < found.chi < 1.1
    assert abs(found.order_at_zero_load) < 4 * found.order_at_zero_load_uncertainty


@pytest.mark.long
def test_a_rendered_beam_of_full_size_gives_its_fringe_value(beam_frame):
    """Two loads at the full size, of which every second column is fitted."""
    assert_right(calibrated(beam_frame, (2.0, 4.0)), 2e-4)  # u = 4e-5


@pytest.mark.long
# the bars are 3 to 6 standard uncertainties of these frames; most beyond 3 are set by the fringes
@pytest.mark.parametrize(
    ("edges", "options", "bar"),
    [
        ((2.0, 4.0), SMALL | {"tilt": -4.0}, 5e-4),
        ((2.0, 4.0), SMALL | {"bright": True}, 5e-4),
        # the beam is taller than the frame
        pytest.param((3.0, 6.0), {"pixel": 0.04}, 5e-4, marks=pytest.mark.study),
        ((0.6, 1.0), SMALL, 2e-3),
        pytest.param((4.0, 9.0), {"blur": 1.5}, 5e-4, marks=pytest.mark.study),
        ((2.0, 4.0), SMALL | {"noise": 12.0}, 1.5e-3),
    ],
)
def test_rendered_beams_give_their_fringe_value(beam_frame, edges, options, bar):
    assert_right(calibrated(beam_frame, edges, **options), bar)


@pytest.mark.long
def test_tilt_axis_and_orders_are_those_of_the_frame(beam_frame):
    whole = calibrated(beam_frame, (2.0, 3.0, 4.0), **SMALL)
    for image, edge in zip(whole.images, (2.0, 3.0, 4.0), strict=True):
        assert image.order == pytest.approx(edge, abs=1e-3)
        assert image.predicted_order == pytest.approx(edge, abs=3e-3)
        assert image.geometry["tilt_deg"] == pytest.approx(2.0, abs=0.02)
        row = 110 / 2 + 4.0 + 0.15 / SMALL["pixel"] / math.cos(math.radians(2.0))
        assert image.geometry["neutral_axis_row_px"] == pytest.approx(row, abs=0.2)


@pytest.mark.long
def test_residual_bending_is_the_intercept(beam_frame):
    found = calibrated(beam_frame, (1.5, 2.0, 3.0, 4.0), residual=0.3, **SMALL)
    assert found.fringe_value_n_per_mm == pytest.approx(F_SIGMA, rel=2e-3)
    assert found.order_at_zero_load == pytest.approx(0.3, abs=0.02)
    assert any("stays at zero load" in w for w in found.warnings)


def test_one_load_leaves_the_order_at_zero_load_unknown(beam_frame):
    found = calibrated(beam_frame, (4.0,), **SMALL)
    assert found.fringe_value_n_per_mm == pytest.approx(F_SIGMA, rel=1.5e-4)  # u = 3e-5
    assert found.order_at_zero_load is None
    assert found.to_json()["order_at_zero_load"] is None
    assert any("one load only" in w for w in found.warnings)
    assert any("no uncertainty is given for load, height" in w for w in found.warnings)


def test_the_budget_adds_up(beam_frame):
    known = Uncertainty(load_percent=0.5, height_mm=0.02, span_mm=0.1, pixel_mm=1e-4)
    found = calibrated(beam_frame, (2.0, 4.0), uncertainty=known, **SMALL)
    parts = {b.name: b.contribution_n_per_mm / F_SIGMA for b in found.budget}
    assert parts["load"] == pytest.approx(0.005, rel=1e-3)
    assert parts["height"] == pytest.approx(3 * 0.02 / BEAM.height_mm, rel=1e-3)
    assert parts["spans"] == pytest.approx(
        math.sqrt(2) * 0.1 / (BEAM.outer_span_mm - BEAM.inner_span_mm), rel=1e-3
    )
    assert parts["pixel scale"] == pytest.approx(1e-4 / SMALL["pixel"], rel=1e-3)
    total = math.sqrt(sum(b.contribution_n_per_mm**2 for b in found.budget))
    assert found.standard_uncertainty == pytest.approx(total)
    assert sum(b.share for b in found.budget) == pytest.approx(1.0)
    assert not any("no uncertainty is given" in w for w in found.warnings)


@pytest.mark.long
@pytest.mark.parametrize(
    "options", [{"blur": 1.0}, {"background": 70.0}], ids=["blur", "a tenth clipped"]
)
def test_blurred_and_clipped_images_are_exact_within_what_is_stated(beam_frame, options):
    frame = beam_frame(4.0, np.random.default_rng(0), **HALF, **options)
    assert "blur" in options or 0.05 < np.mean(frame == 255) < 0.15
    found = calibrated(beam_frame, (2.5, 4.0), **HALF, **options)
    assert_agrees(found, 1e-3)


@pytest.mark.study
def test_a_poor_fit_is_said_and_widens_the_uncertainty(beam_frame):
    """Interference in a plate of glass: stripes finer than any light, in every image."""

    def striped(edge, rng, **options):
        frame = beam_frame(edge, rng, background=40.0, noise=2.0).astype(float)
        y, x = np.mgrid[: frame.shape[0], : frame.shape[1]]
        stripes = 6.0 * np.sin(2.0 * np.pi * (y + 0.2 * x) / 45.0)
        return np.clip(np.rint(frame - 20.0 + stripes), 0, 255).astype(np.uint8)

    found = calibrated(striped, (2.5, 4.0))
    assert found.chi > 1.3
    assert any("does not describe" in w for w in found.warnings)
    clean = calibrated(beam_frame, (2.5, 4.0))
    assert found.standard_uncertainty > 3.0 * clean.standard_uncertainty
    assert abs(found.fringe_value_n_per_mm - F_SIGMA) < 3 * found.standard_uncertainty


@pytest.mark.long
def test_low_orders_are_exact_where_the_images_share_their_light(beam_frame):
    """The bar at one fringe is 0.1 %, from several loads with the residual order free."""
    for edges in ((0.5, 0.75, 1.0), (0.0, 0.6, 1.0)):
        found = calibrated(beam_frame, edges, **HALF)
        assert_agrees(found, 1e-3)


@pytest.mark.long
def test_an_unloaded_image_bounds_the_order_that_one_load_cannot_tell(beam_frame):
    found = calibrated(beam_frame, (0.0, 4.0), **SMALL)
    assert found.order_at_zero_load == 0.0
    # noise of 1.5 % of the light over 1e4 pixels leaves a squared order of some 1e-5 open
    assert 1e-4 < found.order_at_zero_load_uncertainty < 0.02
    assert "order at zero load" in {b.name for b in found.budget}
    bent = calibrated(beam_frame, (0.0, 3.0), residual=0.2, **SMALL)
    assert bent.order_at_zero_load_uncertainty == pytest.approx(0.2, abs=0.01)
    assert abs(bent.fringe_value_n_per_mm - F_SIGMA) < 2 * bent.standard_uncertainty


@pytest.mark.long
def test_hostile_images_are_refused(beam_frame):
    rng, pixel = np.random.default_rng(0), SMALL["pixel"]
    frames = [beam_frame(e, rng, **SMALL) for e in (2.0, 4.0)]
    loads = [bending_load(e) for e in (2.0, 4.0)]
    with pytest.raises(PhysicsError, match="lengths are in mm"):
        bending_from_images(frames, [1e4 * p for p in loads], BEAM, pixel)
    with pytest.raises(PhysicsError, match=r"no fringes|too few|not those of pure bending"):
        bending_from_images([rng.normal(100, 3, (200, 300))], [1.0], BEAM, pixel)


SET = BENDING_BEAM + "[camera]\npixel_mm = 0.07\nbit_depth = 8\n"
SMALL_SET = SET.replace("pixel_mm = 0.07", f"pixel_mm = {SMALL['pixel']}")


def write_set(folder, frame, text=SET, edges=(2.0, 3.0, 4.0), extra="", **options):
    rng = np.random.default_rng(5)
    for i, edge in enumerate(edges):
        tifffile.imwrite(folder / f"b{i}.tif", frame(edge, rng, **options))
        text += f'[[image]]\nfile = "b{i}.tif"\nload_n = {bending_load(edge)}\n'
    path = folder / "set.toml"
    path.write_text(text + extra, "utf-8")
    return path


@pytest.mark.long
def test_a_set_from_its_file(beam_frame, tmp_path):
    rest = beam_frame(0.0, np.random.default_rng(1), **SMALL)
    tifffile.imwrite(tmp_path / "rest.tif", rest)
    extra = '[[image]]\nfile = "rest.tif"\nload_n = 0.0\n[uncertainty]\nload_percent = 0.2\n'
    found = calibrate_bending(write_set(tmp_path, beam_frame, SMALL_SET, extra=extra, **SMALL))
    assert found.fringe_value_n_per_mm == pytest.approx(F_SIGMA, rel=4e-4)  # u of the images 9e-5
    record = json.loads(json.dumps(found.to_json()))
    assert record["standard_uncertainty"] == pytest.approx(0.002 * F_SIGMA, rel=0.05)
    assert [i["file"] for i in record["images"]] == ["b0.tif", "b1.tif", "b2.tif"]
    assert {"fringe_value_n_per_mm", "chi", "order_at_zero_load", "budget"} <= set(record)
    assert not any("rest.tif" in w for w in record["warnings"])


@pytest.mark.long
def test_a_tone_curve_that_is_given_is_undone(beam_frame, tmp_path):
    text = SMALL_SET + "gamma = 2.2\n"
    found = calibrate_bending(write_set(tmp_path, beam_frame, text, gamma=2.2, **SMALL))
    assert found.fringe_value_n_per_mm == pytest.approx(F_SIGMA, rel=5e-4)
    assert found.chi < 1.3


@pytest.mark.long
def test_no_load_frames_take_the_unevenness(beam_frame, tmp_path):
    rng = np.random.default_rng(8)
    tifffile.imwrite(tmp_path / "dark.tif", beam_frame(0.0, rng, **SMALL))
    tifffile.imwrite(tmp_path / "bright.tif", beam_frame(0.0, rng, bright=True, **SMALL))
    text = SMALL_SET + '[frames]\nno_load_dark = "dark.tif"\nno_load_bright = "bright.tif"\n'
    found = calibrate_bending(write_set(tmp_path, beam_frame, text, **SMALL))
    assert found.fringe_value_n_per_mm == pytest.approx(F_SIGMA, rel=5e-4)
    assert found.chi < 1.1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("inner_span_mm = 40.0", "inner_span_mm = 140.0"), "swapped"),
        (("height_mm", "hieght_mm"), r"hieght_mm.*height_mm"),
        (("pixel_mm = 0.07\n", ""), "camera.pixel_mm"),
        (("[beam]", "[disc]\ndiameter_mm = 3\n[beam]"), r"either \[beam\] or \[disc\]"),
        (("height_mm = 20.0", "height_mm = -2"), "beam.height_mm = -2"),
        (("[beam]", '[polariscope]\nfield = "plane"\n[beam]'), "circular dark or bright field"),
        (("[beam]", '[polariscope]\nwavelength_nm = 587.0\nlight = "white"\n[beam]'),
         "at one wavelength"),
        (("bit_depth = 8", "bit_depth = 8\n[[image]]\nload_n = 3.0"), "file.*missing"),
    ],
)  # fmt: skip
def test_a_wrong_set_is_refused_by_name(beam_frame, tmp_path, change, message):
    text = SET.replace(*change) + '[[image]]\nfile = "b.tif"\nload_n = 1.0\n'
    path = tmp_path / "set.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(InputError, match=message) as caught:
        load_set(path, specimen="beam")
    assert "set.toml" in str(caught.value)
