"""Frames processed without a model, from a point whose order is known."""

from functools import lru_cache

import numpy as np
import pytest
import tifffile

from isochrome.errors import PhysicsError
from isochrome.processing import process

SCENE = """\
[specimen]
shape = "other"

[polariscope]
field = "dark"

[camera]
pixel_mm = 0.00607
bit_depth = 8

[frames]
gamma = 1.4
"""
SAMPLES = "sample_images/line-contact-wear"
SEED = "[[frames.known_order]]\nrow_px = 235\ncol_px = 165\norder = 0.6\n"


@pytest.fixture(scope="module")
def captured(tmp_path_factory, request):
    """Two of the sample frames and the no-load frames, every second pixel, with their truth."""
    folder = tmp_path_factory.mktemp("captured")
    samples = request.config.rootpath / SAMPLES
    for name in ("captured", "no-load-dark", "no-load-bright"):
        stack = tifffile.imread(samples / f"{name}.tif")
        part = stack[[1, 3]] if stack.ndim == 3 else stack
        tifffile.imwrite(folder / f"{name}.tif", np.ascontiguousarray(part[..., ::2, ::2]))
    truth = tifffile.imread(samples / "true_fringe_order.tif")[[1, 3], ::2, ::2]
    return folder, truth


@lru_cache
def processed(folder, text, frames="captured.tif"):
    """What is found in frames with a scene; several tests look at the same."""
    scene = folder / "scene.toml"
    scene.write_text(text, encoding="utf-8")
    return process(folder / frames, scene)


NO_LOAD = 'no_load_dark = "no-load-dark.tif"\nno_load_bright = "no-load-bright.tif"\n'


@pytest.mark.long
def test_orders_come_from_one_known_point(captured):
    folder, truth = captured
    found = processed(folder, SCENE + NO_LOAD + SEED)
    for item, true in zip(found.frames, truth, strict=True):
        assert item.reading is not None and item.fit is None
        error = np.abs(item.reading.order - true)
        # pixels twice as wide as the camera's: fringes twice as fine near the contact
        assert np.nanmax(error) < 0.25 and np.sqrt(np.nanmean(error**2)) < 0.02
        assert np.isfinite(error).sum() > 0.85 * np.isfinite(true).sum()


def test_without_a_known_point_no_order_is_given_and_that_is_said(captured):
    folder, _ = captured
    found = processed(folder, SCENE + NO_LOAD)
    assert all(item.reading is None for item in found.frames)
    assert "known_order" in found.columns["warnings"][0]


UNKNOWN = SCENE.replace("gamma = 1.4", 'gamma = "unknown"')


@pytest.mark.long
def test_an_unknown_gamma_is_found_and_reported(captured):
    folder, truth = captured
    found = processed(folder, UNKNOWN + NO_LOAD + SEED)
    # the camera's is 1.4; 3 % move the light's middle by 0.01 and the order by 0.003
    assert found.columns["gamma"] == pytest.approx([1.4, 1.4], rel=0.03)
    assert all(0.0 < u < 0.05 for u in found.columns["gamma standard_uncertainty"])
    assert all("gamma = 1." in said for said in found.columns["warnings"])
    for item, true in zip(found.frames, truth, strict=True):
        error = np.abs(item.reading.order - true)
        assert np.sqrt(np.nanmean(error**2)) < 0.02
        assert np.isfinite(error).sum() > 0.85 * np.isfinite(true).sum()


@pytest.mark.long
def test_a_frame_that_does_not_tell_gamma_says_so_and_the_others_go_on(tmp_path):
    """Fringes of black and white alone: no gamma makes them a cosine's; 0.04 was said to."""
    rows, cols = np.indices((120, 160), dtype=float)
    order = cols / 23.0 + 0.004 * rows
    light = 0.05 + 0.8 * np.sin(np.pi * order) ** 2
    noise = 2.0 * np.random.default_rng(3).standard_normal(light.shape)
    hard, soft = np.where(light > 0.45, 0.85, 0.05), light
    frames = [np.rint(255.0 * each ** (1.0 / 1.4) + noise) for each in (hard, soft)]
    tifffile.imwrite(tmp_path / "mixed.tif", np.stack(frames).astype(np.uint8))
    level = 255.0 * np.array([0.05, 0.85]) ** (1.0 / 1.4)
    for name, grey in zip(("no-load-dark", "no-load-bright"), level, strict=True):
        tifffile.imwrite(tmp_path / f"{name}.tif", np.full(light.shape, grey, np.uint8))
    seed = "[[frames.known_order]]\nrow_px = 60\ncol_px = 58\norder = 2.762\n"
    found = processed(tmp_path, UNKNOWN + NO_LOAD + seed, "mixed.tif")
    told = found.columns["warnings"]
    assert "gamma cannot be found" in told[0] and "state frames.gamma" in told[0]
    assert found.frames[0].reading is None and "gamma = 1." in told[1]
    error = np.abs(found.frames[1].reading.order - order)
    assert np.sqrt(np.nanmean(error**2)) < 0.02 and np.isfinite(error).mean() > 0.6


@pytest.mark.long
def test_a_wrong_gamma_is_told_with_what_to_set_and_costs_its_pixels(captured):
    folder, truth = captured
    right = processed(folder, SCENE + NO_LOAD + SEED)
    wrong = processed(folder, SCENE.replace("gamma = 1.4", "gamma = 1.0") + NO_LOAD + SEED)
    assert not any("frames.gamma" in said for said in right.columns["warnings"])
    for said in wrong.columns["warnings"]:
        assert "frames.gamma = 1 " in said and "frames.gamma = 1.4" in said
    kept = [[np.isfinite(f.reading.order).sum() for f in run.frames] for run in (right, wrong)]
    assert all(less < more for more, less in zip(*kept, strict=True))
    for item, true in zip(wrong.frames, truth, strict=True):
        # what is left may be off by the largest uncertainty that is let through, 0.03, as an RMS
        error = np.abs(item.reading.order - true)
        assert np.sqrt(np.nanmean(error**2)) < 0.03
        # half the errors lie within 0.67 uncertainties of a normal deviate; by a wrong gamma all
        # of them lie one way, and within 0.93. It is 10 where the uncertainty is the noise's alone
        assert np.nanmedian(error / item.reading.uncertainty) < 2.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("share", "read"), [(0.09, False), pytest.param(0.015, True, marks=pytest.mark.study)]
)
def test_an_overexposed_frame_gives_no_order_without_a_bright_no_load_frame(captured, share, read):
    """The bright crests are cut off: how bright they would be is not in the picture."""
    folder, _ = captured
    frame = tifffile.imread(folder / "captured.tif")[0]
    level = np.quantile(frame, 1.0 - share)
    over = np.minimum(frame * (255.0 / level), 255.0).astype(np.uint8)
    tifffile.imwrite(folder / "over.tif", over)
    if not read:
        with pytest.raises(PhysicsError, match=r"nothing could be read in any .*saturated"):
            processed(folder, SCENE + SEED, "over.tif")
        return
    found = processed(folder, SCENE + SEED, "over.tif")
    assert found.frames[0].reading is not None and "saturated" not in found.columns["warnings"][0]
