"""`process` with a no-load stepped set: residual stress out of the maps, and what it refuses."""

import numpy as np
import pytest
import tifffile

from imagej_heads import has_whole_head, heads_of
from isochrome.errors import InputError
from isochrome.output import read_csv, write_tiff
from isochrome.processing import process
from isochrome.scene import dump_scene
from processing.test_process_stepped import image_only as bare
from stepped_sets import contact, layer_residual, small, with_residual

KEY = {"frames.no_load_steps": "no-load-steps.tif"}


@pytest.fixture(scope="module")
def sets():
    """A sliding contact on a block with residual stress, three pixels in one."""
    scene = small(contact(0.3))
    return scene, with_residual(scene, layer_residual(scene, 0.3, 3.0), exposure=0.8)


def folder_of(tmp_path, scene, sets, *, unloaded=None, **values):
    """The captured frames, the no-load set and the scene as files; returns frames and scene."""
    write_tiff(tmp_path / "set.tif", sets.loaded)
    write_tiff(tmp_path / "no-load-steps.tif", sets.unloaded if unloaded is None else unloaded)
    text = dump_scene(scene.with_values(KEY | values))
    (tmp_path / "scene.toml").write_text(text, "utf-8")
    return tmp_path / "set.tif", tmp_path / "scene.toml"


@pytest.mark.long
def test_the_folder_holds_the_loads_field_and_the_residual_one(sets, tmp_path):
    scene, truth = sets
    found = process(*folder_of(tmp_path, bare(scene), truth), tmp_path / "out")
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "frames.csv", "fringe_order.tif", "confidence.tif", "isoclinic.tif", "normalised.tif",
        "residual_order.tif", "residual_isoclinic.tif", "skeleton.csv", "scene.toml",
        "provenance.json", "process.png", "report.html", "run.zarr", "records",
    }  # fmt: skip
    order = tifffile.imread(tmp_path / "out" / "fringe_order.tif")
    error = (order - truth.order)[np.isfinite(order)]
    assert error.size > 0.95 * truth.order.size
    assert np.sqrt(np.mean(error**2)) <= 0.005 and np.abs(error).max() < 0.25
    turned = tifffile.imread(tmp_path / "out" / "isoclinic.tif")
    turn = np.abs((turned - truth.direction + 90.0) % 180.0 - 90.0)
    assert np.nanmedian(turn) <= 0.1
    own = tifffile.imread(tmp_path / "out" / "residual_order.tif")
    wrong = (own - truth.residual_order)[np.isfinite(own)]
    assert own.shape == truth.order.shape and own.dtype == np.float32
    assert wrong.size > 0.95 * own.size and np.sqrt(np.mean(wrong**2)) <= 0.005
    table = read_csv(tmp_path / "out" / "frames.csv")
    # the largest of 36 000 pixels, some at the edge with the noise of one: five of 0.005
    assert table["residual_order_max"] == pytest.approx([0.3], abs=0.025)
    assert found.warnings == (
        f"residual stress of up to {found.residual.largest:.2f} fringe (no-load-steps.tif) was "
        "taken out as a tensor: all maps are the load's alone",
    )
    assert "no-load-steps.tif" in (tmp_path / "out" / "provenance.json").read_text("utf-8")


@pytest.mark.long
def test_the_lines_are_those_of_the_loads_order(sets, tmp_path):
    scene, truth = sets
    process(*folder_of(tmp_path, scene, truth), tmp_path / "out")
    heads = heads_of(tmp_path / "out")
    assert {"residual_order.tif", "residual_isoclinic.tif"} <= heads.keys()
    for name, head in heads.items():  # of a scene that has a scale
        assert has_whole_head(*head, placed=True), (name, head)
    lines = read_csv(tmp_path / "out" / "skeleton.csv")
    rows, cols = (np.rint(lines[name]).astype(int) for name in ("row_px", "col_px"))
    slope = np.hypot(*np.gradient(truth.order))[rows, cols]
    # half a pixel to the nearest centre on either axis, and the reading's noise
    assert (np.abs(truth.order[rows, cols] - lines["order"]) < 0.71 * slope + 0.03).all()
    kinds = {"dark" if float(order).is_integer() else "bright" for order in lines["order"]}
    assert kinds == set(lines["kind"]) and set(lines["order"]) >= {0.5, 1.0, 1.5, 2.0, 2.5}
    assert min(lines["x_mm"]) < -1.0 and max(lines["x_mm"]) > 1.0  # from the contact's middle


def test_without_residual_stress_nothing_is_said(sets, tmp_path):
    scene, _ = sets
    truth = with_residual(scene, np.zeros((164, 219), complex))
    found = process(*folder_of(tmp_path, bare(scene), truth))
    assert found.warnings == () and found.columns["residual_order_max"] == [0.0]
    error = found.frames[0].reading.order - truth.order
    assert np.isfinite(error).mean() > 0.95 and np.sqrt(np.nanmean(error**2)) <= 0.005


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda u: u[:9], "holds 9 frames and the polariscope has 10 steps"),
        (lambda u: u[:, :-1], r"is \(163, 219\) pixels .* captured frames \(164, 219\)"),
        (lambda u: np.zeros_like(u), "the same light in every step, or none"),
        (lambda u: np.full_like(u, 255), "has no pixel that can be trusted"),
    ],
    ids=["one missing", "size", "black", "white"],
)
def test_no_load_sets_that_cannot_be_used_are_refused(sets, tmp_path, change, words):
    scene, truth = sets
    files = folder_of(tmp_path, bare(scene), truth, unloaded=change(truth.unloaded))
    with pytest.raises(InputError, match=words):
        process(*files, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_no_load_sets_of_noise_in_another_order_or_missing_are_refused(sets, tmp_path):
    scene, truth = sets
    noise = np.random.default_rng(3).normal(120.0, 3.0, truth.unloaded.shape).astype(np.uint8)
    files = folder_of(tmp_path, bare(scene), truth, unloaded=noise)
    with pytest.raises(InputError, match=r"frames\.no_load_steps has no pixel that can be read"):
        process(*files)
    files = folder_of(tmp_path, bare(scene), truth, unloaded=truth.unloaded[::-1])
    with pytest.raises(InputError, match="in order"):
        process(*files)
    files = folder_of(tmp_path, bare(scene), truth)
    (tmp_path / "no-load-steps.tif").unlink()
    with pytest.raises(InputError, match="no such file"):
        process(*files)
    with pytest.raises(InputError, match="no_load_steps needs"):
        process(files[0], bare(scene).with_values(KEY | {"polariscope.step": ()}))
