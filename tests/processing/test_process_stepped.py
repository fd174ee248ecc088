"""`process` on phase-stepped sets: from frames on disk to maps, tables and a figure."""

import numpy as np
import pytest
import tifffile

from isochrome.comparison import compare
from isochrome.errors import InputError
from isochrome.output import read_csv, write_tiff
from isochrome.processing import process
from isochrome.scene import dump_scene, load_scene, parse_scene
from isochrome.simulation import simulate
from stepped_sets import BEAM, PLANE, TEN, a_scene, as_steps, contact, small


def image_only(scene):
    """The scene without what would make a model of it."""
    bare = "[specimen]\n\n[polariscope]\nwavelength_nm = 587.0\n\n[camera]\nbit_depth = 8\n"
    return parse_scene(bare, name="bare").with_values({"polariscope.step": scene.polariscope.step})


@pytest.fixture(scope="module")
def worn():
    """Two states of ten steps: the scene, its frames and true orders."""
    wear = {"coefficient_mm2_per_n": 2e-9, "distances_m": [0.0, 40.0]}
    scene = load_scene(small(contact(0.25)).model_dump(exclude_unset=True) | {"wear": wear})
    simulation = simulate(scene)
    return scene, simulation.frames, simulation.orders


@pytest.mark.long
def test_frames_become_maps_one_a_state(worn, tmp_path):
    scene, frames, orders = worn
    assert len(frames) == 20
    write_tiff(tmp_path / "set.tif", frames)
    (tmp_path / "scene.toml").write_text(dump_scene(scene), "utf-8")
    found = process(tmp_path / "set.tif", tmp_path / "scene.toml", tmp_path / "out")
    assert found.frames is None and found.fitted is None and found.warnings == ()
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "frames.csv", "fringe_order.tif", "confidence.tif", "isoclinic.tif", "normalised.tif",
        "skeleton.csv", "scene.toml", "provenance.json", "process.png", "report.html", "run.zarr",
        "records",
    }  # fmt: skip
    order = tifffile.imread(tmp_path / "out" / "fringe_order.tif")
    assert order.shape == (2, 164, 219) and order.dtype == np.float32
    error = (order - orders)[np.isfinite(order)]
    assert np.sqrt(np.mean(error**2)) <= 0.005 and np.abs(error).max() < 0.25
    confidence = tifffile.imread(tmp_path / "out" / "confidence.tif")
    assert ((confidence > 0.0) == np.isfinite(order)).all()
    turned = tifffile.imread(tmp_path / "out" / "isoclinic.tif")
    assert np.nanmin(turned) >= -90.0 and np.nanmax(turned) <= 90.0
    table = read_csv(tmp_path / "out" / "frames.csv")
    assert table["label"] == ["initial sliding", "40 m"] and table["distance_m"] == [0.0, 40.0]
    assert min(table["kept_share"]) > 0.95 and table["whole_order_from"] == ["equilibrium"] * 2
    for k in (0, 1):
        place = int(table["n_max_row_px"][k]), int(table["n_max_col_px"][k])
        assert table["n_max"][k] == pytest.approx(float(order[(k, *place)]), abs=1e-6)
    dark = tifffile.imread(tmp_path / "out" / "normalised.tif")
    expected = np.sin(np.pi * orders) ** 2
    # noise of 3 in 217 x 0.7 grey levels, times √2/2 for two images of cos δ
    assert np.nanstd(dark - expected) < 0.02
    plain = {"polariscope.step": (), "camera.noise_grey": 0.0, "camera.vignette": 0.0}
    simulate(scene.with_values(plain), tmp_path / "simulation")
    compared = compare(tmp_path / "out", tmp_path / "simulation", tmp_path / "comparison")
    assert min(compared.columns["ncc"]) > 0.99


def test_a_set_needs_no_model_and_each_state_stands_alone(worn, tmp_path):
    scene, frames, orders = worn
    write_tiff(tmp_path / "both.tif", frames)
    write_tiff(tmp_path / "last.tif", frames[10:])
    both = process(tmp_path / "both.tif", image_only(scene))
    last = process(tmp_path / "last.tif", image_only(scene))
    assert both.model is None and both.warnings == ()
    assert len(both.frames) == 2 and len(last.frames) == 1
    for item, true in zip(both.frames, orders, strict=True):
        error = (item.reading.order - true)[np.isfinite(item.reading.order)]
        assert np.sqrt(np.mean(error**2)) <= 0.005 and np.abs(error).max() < 0.25
    one, other = both.frames[1], last.frames[0]
    assert np.array_equal(one.reading.order, other.reading.order, equal_nan=True)
    assert np.array_equal(one.isoclinic, other.isoclinic, equal_nan=True)


def test_known_orders_of_the_scene_are_used_and_one_light_in_all_steps_refused(worn, tmp_path):
    scene, frames, orders = worn
    write_tiff(tmp_path / "set.tif", frames[:10])
    row, col = np.unravel_index(np.nanargmin(np.abs(orders[0] - 1.72)), orders[0].shape)
    seed = {"row_px": int(row), "col_px": int(col), "order": 1.72}
    seeded = image_only(scene).with_values({"frames.known_order": (seed,)})
    assert process(tmp_path / "set.tif", seeded).columns["whole_order_from"] == ["known order"]
    scene, frames, _ = worn
    write_tiff(tmp_path / "set.tif", np.repeat(frames[:1], 20, axis=0))
    with pytest.raises(InputError, match="the same light in every step"):
        process(tmp_path / "set.tif", scene)


def test_the_models_load_may_be_off_where_only_the_model_tells(tmp_path):
    scene = small(a_scene(BEAM, pixel_mm=0.05))
    rendered = simulate(scene)
    write_tiff(tmp_path / "set.tif", rendered.frames)
    found = process(tmp_path / "set.tif", scene.with_values({"load.normal_n": 210.0}))
    assert found.columns["whole_order_from"] == ["model"]
    assert "taken from the scene's model" in found.warnings[0]
    (item,) = found.frames
    error = (item.reading.order - rendered.orders[0])[np.isfinite(item.reading.order)]
    assert error.size > 10_000 and np.abs(error).max() < 0.25


@pytest.mark.parametrize(
    ("count", "words"),
    [
        (19, "19 frames are not a multiple of the polariscope's 10 steps"),
        (10, r"10 frames, and the scene has 2 states .* for each of its 10 steps"),
    ],
)
def test_frames_that_are_no_whole_sets_are_refused(worn, tmp_path, count, words):
    scene, frames, _ = worn
    write_tiff(tmp_path / "set.tif", frames[:count])
    with pytest.raises(InputError, match=words):
        process(tmp_path / "set.tif", scene, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_steps_that_cannot_tell_the_order_and_an_unknown_gamma_are_refused(tmp_path):
    plane = contact().with_values({"polariscope.step": as_steps(PLANE)})
    with pytest.raises(InputError, match=r"\[\[polariscope.step\]\]: the 4 steps do not determine"):
        process("nowhere.tif", plane)
    # Steps are compared as light: they do not tell the curve from the angles.
    scene = image_only(contact()).with_values({"frames.gamma": "unknown"})
    write_tiff(tmp_path / "set.tif", np.tile(np.arange(40, dtype=np.uint8), (len(TEN), 40, 1)))
    with pytest.raises(InputError, match=r"frames\.gamma = 'unknown'"):
        process(tmp_path / "set.tif", scene)
