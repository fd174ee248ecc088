"""Frames of a block of finite size, their stress by finite elements, fitted as a half-plane's."""

import re

import numpy as np
import pytest
import tifffile

from finite_block import LINE_LOAD, THICKNESS, Solid, block_difference
from fitting.engine_frames import picture_of
from isochrome.fitting import LENS, fit
from isochrome.optics import expose
from isochrome.output import write_tiff
from isochrome.processing import process
from isochrome.scene import load_scene, parse_scene
from isochrome.simulation import make_picture, picture_signal, simulate
from isochrome.stress import pixel_grid
from scene_texts import PAPER_CONTACT, SMALL_CAMERA

SMALL, WHOLE = (
    {
        "camera.width_px": cols, "camera.height_px": rows, "camera.pixel_mm": pixel,
        "camera.vignette": 0.3, "camera.noise_grey": 3.0, "camera.seed": 5,
    }
    for cols, rows, pixel in ((220, 165, 0.01821), (659, 494, 0.00607))
)  # fmt: skip
LOAD = LINE_LOAD * THICKNESS
PLACE = {"camera.left_mm": -1.98, "camera.top_mm": 0.01}
FREE = ["load.normal_n", "camera.left_mm", "camera.top_mm"]
SMOOTH = ["load.bulk_mpa", "load.bulk_along_x_mpa_per_mm", "load.bulk_along_z_mpa_per_mm"]
SIZE = {"specimen.shape": "block", "specimen.width_mm": 60.0, "specimen.height_mm": 40.0}


def scene_of(solid, camera, *, friction=None):
    sliding = solid.friction if friction is None else friction
    text = f"\n[friction]\ncoefficient = {sliding}\n" if sliding else ""
    return parse_scene(PAPER_CONTACT + SMALL_CAMERA + text).with_values(camera)


def photographed(solid, camera, path):
    """A frame of the block as finite elements know it; returns its fringe order (rows, cols)."""
    scene = scene_of(solid, camera)
    pixels = pixel_grid(scene)
    stress = block_difference(solid, pixels.x_mm, pixels.z_mm)
    picture = make_picture(scene, stress, pixels)
    frame = expose(picture_signal(scene, picture), scene.camera, rng=np.random.default_rng(7))
    write_tiff(path, frame[None], pixel_mm=scene.camera.pixel_mm)
    return picture.order


def order_error(found, truth):
    """Root mean square over all pixels, and the share on a wrong branch."""
    error = found - truth
    known = np.isfinite(error)
    assert known.mean() > 0.98
    return np.sqrt(np.mean(error[known] ** 2)), np.mean(np.abs(error[known]) > 0.25)


@pytest.mark.long
def test_a_half_plane_reads_the_load_of_a_block_once_its_smooth_stress_is_fitted_too(tmp_path):
    solid = Solid(spacing_mm=0.04)
    truth = photographed(solid, SMALL, tmp_path / "frame.tif")
    begun = scene_of(solid, SMALL).with_values({"load.normal_n": 1.08 * LOAD})
    found = fit(tmp_path / "frame.tif", begun, FREE)
    assert found.shared["load.normal_n"]["value"] == pytest.approx(LOAD, rel=1e-3)
    assert found.chi == pytest.approx(1.0, abs=0.03)
    rms, wrong = order_error(picture_of(found.scene).order, truth)
    assert rms < 0.005 and wrong < 2e-3

    # what was freed is told, and no pixel is left out for it: the half-plane alone is 1 % off
    (said,) = found.warnings
    assert re.search(r"load\.normal_n comes out \+1(\.\d)? % off", said)
    assert all(key in said for key in SMOOTH)
    # finite elements of the whole block give 0.134 MPa: tests/stress/test_stress_block.py
    assert found.shared[SMOOTH[0]]["value"] == pytest.approx(0.134, abs=0.004)


def test_a_frame_that_the_contact_alone_explains_has_nothing_freed(tmp_path):
    scene = scene_of(Solid(), SMALL)
    write_tiff(tmp_path / "frame.tif", simulate(scene).frames, pixel_mm=0.01821)
    found = fit(tmp_path / "frame.tif", scene.with_values({"load.normal_n": 46.0}), FREE)
    assert set(found.shared) == set(FREE) and found.warnings == ()


@pytest.mark.study
def test_a_static_and_a_sliding_frame_of_a_block_share_all_but_what_the_shear_adds(tmp_path):
    solids = (Solid(), Solid(friction=0.25))
    for i, solid in enumerate(solids):
        photographed(solid, WHOLE, tmp_path / f"frame{i}.tif")
    frames = [tifffile.imread(tmp_path / f"frame{i}.tif").squeeze() for i in range(2)]
    write_tiff(tmp_path / "both.tif", np.stack(frames), pixel_mm=0.00607)
    begun = scene_of(solids[1], WHOLE, friction=0.22).with_values(
        {"friction.static_state_first": True, "load.normal_n": 0.95 * LOAD}
    )
    found = fit(tmp_path / "both.tif", begun, FREE, per_frame=["friction.coefficient"])
    assert found.shared["load.normal_n"]["value"] == pytest.approx(LOAD, rel=5e-4)
    assert found.frames[1]["friction.coefficient"]["value"] == pytest.approx(0.25, abs=1e-3)
    assert found.chi == pytest.approx(1.0, abs=0.02)
    # a shear bends the block's surface along x, a normal force does not, by symmetry
    static, sliding = (frame[SMOOTH[1]]["value"] for frame in found.frames)
    assert abs(static) < 1e-3 and sliding > 3e-3


@pytest.mark.study
def test_process_reads_a_blocks_orders_with_its_smooth_stress(tmp_path):
    solid = Solid(friction=0.25)
    truth = photographed(solid, WHOLE, tmp_path / "frame.tif")
    begun = scene_of(solid, WHOLE, friction=0.2).with_values({"load.normal_n": 0.92 * LOAD})
    found = process(tmp_path / "frame.tif", begun, tmp_path / "out")
    assert found.columns["load.normal_n"][0] == pytest.approx(LOAD, rel=5e-4)
    assert "load.normal_n comes out +" in found.warnings[0]
    order = tifffile.imread(tmp_path / "out" / "fringe_order.tif")
    rms, wrong = order_error(order, truth)
    # the noise of a pixel's order, not the model: the half-plane's leaves 0.013
    assert rms < 0.006 and wrong < 1e-4
    fitted = load_scene(tmp_path / "out" / "fitted_scene.toml")
    assert order_error(picture_of(fitted).order, truth)[0] < 0.003


@pytest.mark.study
def test_a_smooth_stress_that_explains_little_is_not_kept(tmp_path):
    # a contact of another width: the flat's pressure is no smooth stress
    flat = PAPER_CONTACT.replace("radius_mm = 24.61", 'shape = "flat"\nhalf_width_mm = 0.45')
    scene = parse_scene(flat + SMALL_CAMERA).with_values(SMALL)
    write_tiff(tmp_path / "frame.tif", simulate(scene).frames, pixel_mm=0.01821)
    found = fit(tmp_path / "frame.tif", scene_of(Solid(), SMALL), FREE)
    assert set(found.shared) == set(FREE)
    assert found.chi > 1.3 and any("does not describe" in w for w in found.warnings)


@pytest.mark.study
@pytest.mark.parametrize(
    ("friction", "support", "bulk_free"),
    [  # each with each of the others once
        (0.0, "fixed", True), (0.0, "sliding", False), (0.25, "fixed", False),
        (0.25, "sliding", True),
    ],
)  # fmt: skip
def test_a_finite_blocks_frame_gives_load_and_order_within_the_bars(
    tmp_path, friction, support, bulk_free
):
    solid = Solid(friction=friction, support=support)
    truth = photographed(solid, WHOLE, tmp_path / "frame.tif")
    begun = scene_of(solid, WHOLE, friction=0.9 * friction)
    begun = begun.with_values({"load.normal_n": 0.92 * LOAD, **PLACE})
    keys = [*FREE, "friction.coefficient"] if friction else FREE
    if bulk_free:
        begun, keys = begun.with_values({"load.bulk_mpa": 0.0}), [*keys, "load.bulk_mpa"]
    found = fit(tmp_path / "frame.tif", begun, keys)
    assert found.shared["load.normal_n"]["value"] == pytest.approx(LOAD, rel=5e-4)
    if friction:
        assert found.shared["friction.coefficient"]["value"] == pytest.approx(friction, abs=1e-3)
    rms, wrong = order_error(picture_of(found.scene).order, truth)
    assert rms < 0.003 and wrong < 1e-4
    assert found.chi == pytest.approx(1.0, abs=0.02)


@pytest.mark.study
@pytest.mark.parametrize("friction", [0.0, 0.25])
def test_a_block_in_the_scene_leaves_nothing_to_free(tmp_path, friction):
    solid = Solid(friction=friction)
    truth = photographed(solid, WHOLE, tmp_path / "frame.tif")
    begun = scene_of(solid, WHOLE, friction=0.9 * friction).with_values(SIZE)
    keys = [*FREE, "friction.coefficient"] if friction else FREE
    found = fit(tmp_path / "frame.tif", begun.with_values({"load.normal_n": 0.92 * LOAD}), keys)
    # no smooth stress; the elements err by 2e-4, which may look like a camera 0.01 degree off
    assert not set(found.shared) & set(SMOOTH)
    assert set(found.shared) - set(keys) <= set(LENS)
    assert found.shared["load.normal_n"]["value"] == pytest.approx(LOAD, rel=3e-4)
    rms, wrong = order_error(picture_of(found.scene).order, truth)
    assert rms < 0.003 and wrong < 1e-4
