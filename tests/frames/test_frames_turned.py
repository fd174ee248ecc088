"""Pictures that do not lie as the scene does: frames.rotate_deg and frames.flip."""

from itertools import product

import numpy as np
import pytest
import tifffile
from PIL import Image

from isochrome import check, fit, process, track
from isochrome.calibration import CalibrationSet, ColourSet, read_colour_shots, read_shots
from isochrome.errors import InputError
from isochrome.frames import as_captured, open_frames, open_scene_frames
from isochrome.scene import dump_scene, parse_scene
from isochrome.simulation import simulate
from scene_texts import BENDING_BEAM, PAPER_CONTACT, SMALL_CAMERA
from stepped_sets import CIRCULAR, small
from stepped_sets import contact as sliding

TURNS, FLIPS = (0, 90, 180, 270), (None, "horizontal", "vertical")
# a flip after three quarter turns is the other flip after one, and so on: eight pictures differ
WAYS = list(product(TURNS, (None, "horizontal")))
ROWS, COLS = 24, 32


def lying(image, turn, flip):
    """The picture that the turn and the flip make `image` of: undone by hand, last thing first."""
    if flip is not None:
        image = np.flip(image, axis=1 if flip == "horizontal" else 0)
    return np.ascontiguousarray(np.rot90(image, k=-(turn // 90)))


def stated(scene, turn, flip):
    return scene.with_values({"frames.rotate_deg": turn} | ({"frames.flip": flip} if flip else {}))


@pytest.fixture(scope="module")
def levels():
    return np.random.default_rng(5).integers(0, 255, (ROWS, COLS, 3), dtype=np.uint8)


def test_a_quarter_turn_is_counter_clockwise_and_a_flip_comes_after_it(tmp_path):
    seen = np.array([[1, 2, 3], [4, 5, 6]], dtype=np.uint8)
    tifffile.imwrite(tmp_path / "f.tif", seen)
    wanted = {
        (90, None): [[3, 6], [2, 5], [1, 4]],  # what was at the right is at the top
        (90, "horizontal"): [[6, 3], [5, 2], [4, 1]],
        (90, "vertical"): [[1, 4], [2, 5], [3, 6]],
        (0, "horizontal"): [[3, 2, 1], [6, 5, 4]],
        (0, "vertical"): [[4, 5, 6], [1, 2, 3]],
        (180, None): [[6, 5, 4], [3, 2, 1]],
        (270, None): [[4, 1], [5, 2], [6, 3]],
    }
    for (turn, flip), rows in wanted.items():
        with open_frames(tmp_path / "f.tif", rotate_deg=turn, flip=flip) as reader:
            assert reader.shape == np.shape(rows) and next(iter(reader)).image.tolist() == rows


@pytest.mark.parametrize(("turn", "flip"), list(product(TURNS, FLIPS)))
@pytest.mark.parametrize("kind", ["tif", "png", "avi"])
def test_every_file_and_channel_is_turned_before_its_roi(tmp_path, levels, turn, flip, kind):
    turned = lying(levels, turn, flip)
    np.testing.assert_array_equal(as_captured(levels, turn, flip), turned)
    path = tmp_path / f"f.{kind}"
    if kind == "avi":
        cv2 = pytest.importorskip("cv2")
        # grey, as a codec may store colours more coarsely than light
        turned = np.repeat(turned[..., :1], 3, axis=2)
        codec = cv2.VideoWriter_fourcc(*"HFYU")  # without loss
        out = cv2.VideoWriter(str(path), codec, 10.0, turned.shape[1::-1])
        if not out.isOpened():
            pytest.skip("this OpenCV writes no HuffYUV")
        out.write(np.ascontiguousarray(turned[..., ::-1]))
        out.write(np.ascontiguousarray(turned[..., ::-1]))
        out.release()
    else:
        Image.fromarray(turned).save(path)
    scene = parse_scene(
        "[specimen]\n[frames]\nchannel = 'red'\n"
        "roi = { top_px = 3, left_px = 5, height_px = 12, width_px = 20 }\n"
    )
    with open_scene_frames(path, stated(scene, turn, flip)) as reader:
        assert reader.full_shape == (ROWS, COLS)
        for frame in reader:
            np.testing.assert_array_equal(frame.image, levels[3:15, 5:25, 0])


@pytest.fixture(scope="module")
def contact(tmp_path_factory):
    """Two noisy frames and no-load frames of a contact, and its scene with roi, mask and seed."""
    folder = tmp_path_factory.mktemp("contact")
    scene = parse_scene(PAPER_CONTACT + SMALL_CAMERA + "noise_grey = 2.0\n")
    size = {"camera.width_px": 80, "camera.height_px": 60, "camera.pixel_mm": 0.05}
    scene = scene.with_values(size)
    image = simulate(scene).frames[0]
    bright, dark = np.full(image.shape, 228, np.uint8), np.full(image.shape, 12, np.uint8)
    mask = np.full((60, 80), 255, np.uint8)
    mask[:, 75:] = 0
    # two rows and columns more on two sides, so that a roi in the wrong picture would show
    pictures = {"f": image, "dark": dark, "bright": bright, "mask": mask}
    pictures = {k: np.pad(v, ((7, 0), (3, 0)), mode="edge") for k, v in pictures.items()}
    text = dump_scene(scene) + (
        "\n[frames]\nroi = { top_px = 7, left_px = 3, height_px = 60, width_px = 80 }\n"
        "no_load_dark = 'dark.tif'\nno_load_bright = 'bright.tif'\nmask = 'mask.tif'\n"
    )
    return folder, pictures, text


def written(folder, pictures, turn, flip):
    """The files as a camera that lies otherwise leaves them; masks are of the turned picture."""
    folder.mkdir(exist_ok=True)
    for name, picture in pictures.items():
        lies = picture if name == "mask" else lying(picture, turn, flip)
        tifffile.imwrite(folder / f"{name}.tif", lies)
    return folder / "f.tif"


@pytest.fixture(scope="module")
def upright(contact):
    folder, pictures, text = contact
    path = written(folder / "upright", pictures, 0, None)
    scene = parse_scene(text, folder=folder / "upright")
    return {
        "frames.csv": processed(path, scene, folder / "out"),
        "fit.csv": fitted(path, scene, folder / "fit"),
        "check": check(path, scene).findings,
    }


def processed(path, scene, out):
    process(path, scene, out)
    return (out / "frames.csv").read_bytes()


def fitted(path, scene, out):
    fit(path, scene, ["load.normal_n"], out=out)
    return (out / "fit.csv").read_bytes()


@pytest.mark.long
@pytest.mark.parametrize(
    ("turn", "flip"),
    [
        pytest.param(*way, marks=pytest.mark.study if k % 3 else ())
        for k, way in enumerate(WAYS[1:])
    ],
)
def test_a_turned_file_with_the_turn_stated_gives_the_same_bytes(
    tmp_path, contact, upright, turn, flip
):
    _, pictures, text = contact
    path = written(tmp_path / "files", pictures, turn, flip)
    scene = stated(parse_scene(text, folder=tmp_path / "files"), turn, flip)
    assert processed(path, scene, tmp_path / "out") == upright["frames.csv"]
    if (turn, flip) == (90, "horizontal"):  # fit and check open frames as process does
        assert fitted(path, scene, tmp_path / "fit") == upright["fit.csv"]
        assert check(path, scene).findings == upright["check"]


@pytest.mark.long
def test_a_tracked_recording_is_turned_too(tmp_path, contact):
    _, pictures, text = contact
    found = []
    for turn, flip in ((0, None), (270, "vertical")):
        folder = tmp_path / str(turn)
        path = written(folder, pictures, turn, flip)
        stack = np.stack([lying(pictures["f"], turn, flip)] * 3)
        tifffile.imwrite(path, stack, photometric="minisblack")
        scene = stated(parse_scene(text, folder=folder), turn, flip)
        tracked = track(path, scene, ["load.normal_n"])
        found.append({k: v for k, v in tracked.columns.items() if k != "file"})
    assert found[0]["value"][2] == pytest.approx(44.0, rel=0.01) and str(found[0]) == str(found[1])


@pytest.mark.long
def test_steps_and_their_no_load_steps_are_turned_alike(tmp_path):
    scene = small(sliding(0.3, steps=CIRCULAR), 8)
    sets = {
        name: simulate(scene.with_values({"load.normal_n": load, "camera.seed": k})).frames
        for k, (name, load) in enumerate((("f", 44.0), ("none", 1.0)))
    }
    made = []
    for turn, flip in ((0, None), (90, "vertical")):
        folder = tmp_path / str(turn)
        folder.mkdir()
        for name, frames in sets.items():
            lies = np.stack([lying(frame, turn, flip) for frame in frames])
            tifffile.imwrite(folder / f"{name}.tif", lies, photometric="minisblack")
        known = stated(scene.with_values({"frames.no_load_steps": "none.tif"}), turn, flip)
        known = known.model_copy(update={"folder": folder})
        made.append(processed(folder / "f.tif", known, folder / "out"))
    assert made[0] == made[1]


PART = '[frames]\nno_load_dark = "dark.png"\n'
PART += "roi = { top_px = 2, left_px = 4, height_px = 15, width_px = 21 }\n"
BEAM_SET = f'{BENDING_BEAM}[camera]\npixel_mm = 0.05\n{PART}no_load_bright = "bright.png"\n'
BEAM_SET += '[[image]]\nfile = "f.png"\nload_n = 100.0\n'
COLOUR_SET = '[polariscope]\nwavelength_nm = 540.0\nlight = "white"\n[camera]\ncolour = true\n'
COLOUR_SET += f'{PART}[[image]]\nfile = "f.png"\n'


@pytest.mark.parametrize(("turn", "flip"), WAYS[1:])
@pytest.mark.parametrize(("text", "kind"), [(BEAM_SET, CalibrationSet), (COLOUR_SET, ColourSet)])
def test_a_calibration_set_is_turned_with_its_no_load_frames(
    tmp_path, levels, turn, flip, text, kind
):
    """Beams and discs are read by the one function, colours by the other."""
    read = read_shots if kind is CalibrationSet else lambda given: read_colour_shots(given)[0]
    found = []
    for ways in ((0, None), (turn, flip)):
        folder = tmp_path / str(ways[0] + bool(ways[1]))
        folder.mkdir()
        for name, picture in (("f", levels), ("dark", levels // 9), ("bright", 255 - levels // 5)):
            shown = picture if kind is ColourSet else picture[..., 0]
            Image.fromarray(lying(shown, *ways)).save(folder / f"{name}.png")
        keys = f"rotate_deg = {ways[0]}\n" + (f"flip = '{ways[1]}'\n" if ways[1] else "")
        (folder / "set.toml").write_text(text.replace("[frames]\n", "[frames]\n" + keys))
        shots = read(kind.read(folder / "set.toml"))
        found.append(shots[0] if isinstance(shots, tuple) else shots)
    for name, value in vars(found[0]).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(value, getattr(found[1], name))


@pytest.mark.parametrize("key", ["rotate_deg", "flip"])
@pytest.mark.parametrize("value", ["45", "-90", "360", "1", "true", "'left'", "''", "[90]"])
def test_other_turns_and_flips_are_refused_with_what_is_allowed(key, value):
    with pytest.raises(InputError, match=rf"frames\.{key} = .* is not allowed"):
        parse_scene(f"[specimen]\n[frames]\n{key} = {value}\n")


def test_a_turn_written_with_a_point_is_the_turn():
    assert parse_scene("[specimen]\n[frames]\nrotate_deg = 90.0\n").frames.rotate_deg == 90


@pytest.mark.parametrize("given", [{"rotate_deg": 45}, {"flip": "left"}])
def test_a_function_refuses_them_too(tmp_path, given):
    tifffile.imwrite(tmp_path / "f.tif", np.zeros((4, 5), np.uint8))
    with pytest.raises(InputError, match=next(iter(given))):
        open_frames(tmp_path / "f.tif", **given)


def test_a_roi_of_the_unturned_picture_is_refused_with_the_turn_named(tmp_path):
    tifffile.imwrite(tmp_path / "f.tif", np.zeros((40, 90), np.uint8))
    scene = parse_scene(
        "[specimen]\n[frames]\nrotate_deg = 90\n"
        "roi = { top_px = 0, left_px = 0, height_px = 40, width_px = 90 }\n"
    )
    with pytest.raises(InputError, match=r"90 rows and 40 columns after its turn by frames.rot"):
        open_scene_frames(tmp_path / "f.tif", scene)


@pytest.mark.parametrize(("shape", "named"), [((80, 60), True), ((60, 81), False)])
def test_a_picture_on_its_side_is_told_from_one_of_another_size(tmp_path, contact, shape, named):
    tifffile.imwrite(tmp_path / "f.tif", np.zeros(shape, np.uint8))
    scene = parse_scene(contact[2].split("[frames]")[0])
    (found,) = (f.text for f in check(tmp_path / "f.tif", scene).findings if "camera is" in f.text)
    assert ("frames.rotate_deg = 90 or 270" in found) is named
