"""`process` on colour frames in white light: order by the colours, from files to files."""

import numpy as np
import pytest
import tifffile

from isochrome.errors import InputError, PhysicsError
from isochrome.optics import expose
from isochrome.output import read_csv, write_tiff
from isochrome.processing import process
from isochrome.scene import parse_scene
from isochrome.simulation import simulate
from scene_texts import WORN_CONTACT, camera_text

SCENE = WORN_CONTACT + 'light = "white"\n\n'
SCENE += camera_text(
    330, 247, 0.01214, left_mm=-2.0, top_mm=0.0, bit_depth=8, brightness=0.9, background=0.03,
    vignette=0.3, noise_grey=3.0, colour="true",
)  # fmt: skip
NO_LOAD = '\n[frames]\nno_load_dark = "dark.tif"\nno_load_bright = "bright.tif"\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The rendered frames, their no-load frames, and their true order."""
    place = tmp_path_factory.mktemp("colour")
    scene = parse_scene(SCENE)
    found = simulate(scene)
    write_tiff(place / "frames.tif", found.frames, photometric="rgb")
    lit = np.ones(found.frames.shape[1:])
    for i, (name, signal) in enumerate((("dark", 0.0 * lit), ("bright", lit))):
        image = expose(signal, scene.camera, rng=np.random.default_rng([5, i]))
        write_tiff(place / f"{name}.tif", image[None], photometric="rgb")
    np.save(place / "order.npy", found.orders)
    return place


def in_folder(text, folder):
    return parse_scene(text, name="mine").model_copy(update={"folder": folder})


def right_to_the_bar(order, true):
    known = np.isfinite(order)
    assert known.mean() > 0.95
    error = (order - true)[known]
    assert np.sqrt(np.mean(error**2)) <= 0.02  # the bar for colour
    assert np.mean(np.abs(error) > 0.5) <= 1e-3


@pytest.mark.long
def test_colour_frames_are_read_to_the_bar_from_themselves(folder):
    found = process(folder / "frames.tif", in_folder(SCENE, folder))
    true = np.load(folder / "order.npy")
    assert found.fitted is None and found.columns["label"] == ["initial sliding", "77 m"]
    assert found.columns["distance_m"] == [0.0, 77.0]
    for item, order in zip(found.frames, true, strict=True):
        right_to_the_bar(item.reading.order, order)
        assert 0.9 < item.chi < 1.15 and "from the frame itself" in item.warnings[0]
    assert found.columns["n_max"] == pytest.approx([o.max() for o in true], abs=0.05)


@pytest.mark.long
def test_with_no_load_frames_the_folder_holds_maps_table_and_figure(folder, tmp_path):
    out = tmp_path / "out"
    found = process(folder / "frames.tif", in_folder(SCENE + NO_LOAD, folder), out)
    assert {p.name for p in out.iterdir()} == {
        "frames.csv", "fringe_order.tif", "confidence.tif", "normalised.tif", "scene.toml",
        "skeleton.csv", "provenance.json", "process.png", "report.html", "run.zarr",
        "records",
    }  # fmt: skip
    orders, sure = (tifffile.imread(out / f"{n}.tif") for n in ("fringe_order", "confidence"))
    assert orders.shape == (2, 247, 330) and orders.dtype == np.float32
    assert ((sure > 0.0) == np.isfinite(orders)).all()
    for order, true in zip(orders, np.load(folder / "order.npy"), strict=True):
        right_to_the_bar(order, true)
    table = read_csv(out / "frames.csv")
    assert max(table["strange_share"]) < 0.01 and not found.warnings
    assert all(0.9 < chi < 1.15 for chi in table["chi"])


@pytest.mark.long
def test_colour_needs_no_model_and_keeps_to_a_mask_and_a_right_gamma(folder):
    polariscope, camera = SCENE.split("[polariscope]")[1].split("[camera]")
    text = f"[specimen]\nshape = 'other'\n[polariscope]{polariscope}[camera]{camera}"
    found = process(folder / "frames.tif", in_folder(text + NO_LOAD, folder))
    assert found.model is None and found.warnings == ()
    assert np.isfinite(found.frames[0].reading.order).mean() > 0.95
    corners = "[[60.0, 50.0], [60.0, 250.0], [200.0, 250.0], [200.0, 50.0]]"
    text = SCENE + NO_LOAD + f"polygon_px = {corners}\n"
    known = np.isfinite(process(folder / "frames.tif", in_folder(text, folder)).frames[0]
                        .reading.order)  # fmt: skip
    assert known[62:199, 52:249].mean() > 0.99
    known[60:201, 50:251] = False
    assert not known.any()
    text = SCENE + NO_LOAD + "gamma = 2.2\n"
    said = r"nothing could be read in any of its 2 frames \(.*are not the table's.*frames\.gamma"
    with pytest.raises(PhysicsError, match=said):
        process(folder / "frames.tif", in_folder(text, folder))


def test_a_pixel_that_is_saturated_in_a_no_load_frame_is_not_used(folder, tmp_path):
    write_tiff(tmp_path / "one.tif", tifffile.imread(folder / "frames.tif")[1:], photometric="rgb")
    write_tiff(tmp_path / "dark.tif", tifffile.imread(folder / "dark.tif")[None], photometric="rgb")
    bright = tifffile.imread(folder / "bright.tif").copy()
    bright[150:170, 100:140] = 255
    write_tiff(tmp_path / "bright.tif", bright[None], photometric="rgb")
    text = (SCENE + NO_LOAD).replace("[0.0, 77.0]", "[77.0]")
    (item,) = process(tmp_path / "one.tif", in_folder(text, tmp_path)).frames
    known = np.isfinite(item.reading.order)
    assert not known[151:169, 101:139].any() and known[180:].mean() > 0.95
    write_tiff(tmp_path / "grey.tif", tifffile.imread(folder / "frames.tif")[..., 1])
    with pytest.raises(InputError, match=r"grey\.tif: is grey"):
        process(tmp_path / "grey.tif", parse_scene(SCENE))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("colour = true", "colour = false", r"set camera\.colour = true"),
        ("[camera]", '[frames]\nchannel = "green"\n\n[camera]', r"leave out frames\.channel"),
        (
            'light = "white"',
            'light = "white"\n\n[[polariscope.step]]\npolariser_deg = 90\nanalyser_deg = 0',
            r"remove \[\[polariscope\.step\]\]",
        ),
        ('light = "white"', 'light = "white"\nfield = "plane"', "isoclinics have no colour"),
    ],
)
def test_what_tells_no_colours_is_refused_before_the_frames(old, new, words):
    with pytest.raises(InputError, match=f"^mine: .*several wavelengths.*{words}"):
        process("nowhere.tif", parse_scene(SCENE.replace(old, new), name="mine"))
