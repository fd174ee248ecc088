"""Friction and load from files: read as they stand, long ones by few lines, or refused."""

import json
from pathlib import Path

import numpy as np
import pytest
from scenes_of_files import file_scene, write_table

from isochrome.comparison import compare
from isochrome.contact import contact_states
from isochrome.errors import InputError
from isochrome.fitting import fit
from isochrome.processing import process
from isochrome.scene import Scene, dump_scene, load_scene, parse_scene
from isochrome.simulation import simulate
from isochrome.sweeps import sweep
from refusals import refusal

S, MU = [0.0, 5.0, 40.0, 233.0], [0.1, 0.2, 0.24, 0.25]
INLINE = "coefficient = {distance_m = [0.0, 5.0, 40.0, 233.0], value = [0.1, 0.2, 0.24, 0.25]}"
ROWS = "0;0,1\n5;0,2\n40;0,24\n233;0,25\n"


def friction_of(folder: Path, text: str | bytes, more: str = "") -> Scene:
    """The scene whose friction stands in a file of this text."""
    data = text.encode() if isinstance(text, str) else text
    (folder / "mu.csv").write_bytes(data)
    return file_scene(folder, friction='file = "mu.csv"\n' + more)


@pytest.mark.parametrize(
    "text",
    [
        "distance_m,coefficient\n0,0.1\n5,0.2\n40,.24\n233,2.5e-1\n",
        "distance_m;coefficient\n" + ROWS,
        "distance_m;coefficient\n" + ROWS.replace(",", "."),
        "distance_m\tcoefficient\r\n" + ROWS.replace(";", "\t").replace("\n", "\r\n"),
        "distance_m coefficient\n" + ROWS.replace(";", "   "),
        "\ufeffdistance_m;coefficient\n" + ROWS,
        "# a tester\n\n coefficient , note, distance_m\n0.1,a,0\n.2,b,5\n.24,c,40\n\n.25,d,233\n",
        '"distance_m","coefficient"\n"0","0.1"\n"5","0.2"\n"40","0.24"\n"233","0.25"\n',
        "distance_m,time_s,coefficient\n0,0,0.1\n5,1,.2\n40,2,.24\n233,3,0.25\n",
    ],
    ids=["commas", "semicolons", "points", "tabs", "spaces", "mark", "more", "quoted", "both"],
)
def test_a_short_file_is_the_table_that_stands_in_it(tmp_path, text):
    found = friction_of(tmp_path, text)
    assert found.friction == file_scene(tmp_path, friction=INLINE).friction


def test_times_become_distances_by_the_sliding_speed(tmp_path):
    text = "time_s,coefficient\n0,0.1\n20,0.2\n160,0.24\n932,0.25\n"
    own = friction_of(tmp_path, text, "sliding_speed_mm_per_s = 250")
    assert own.friction.coefficient.distance_m == tuple(S)
    frames = "\n[frames]\nsliding_speed_mm_per_s = 500.0\n"
    shared = file_scene(tmp_path, friction='file = "mu.csv"', more=frames)
    assert shared.friction.coefficient.distance_m == tuple(2.0 * s for s in S)
    both = file_scene(
        tmp_path, friction='file = "mu.csv"\nsliding_speed_mm_per_s = 250.0', more=frames
    )
    assert both.friction == own.friction, "its own speed comes first"
    with pytest.raises(InputError, match=r"mu.csv: has times.*friction.sliding_speed_mm_per_s"):
        friction_of(tmp_path, text)


HEAD = "distance_m,coefficient\n"
STEADY = "".join(f"{k},0.2\n" for k in range(10))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["an empty table"]),
        (HEAD, ["0 rows", "two or more"]),
        (HEAD + "0,0.1\n", ["1 rows", "two or more"]),
        (HEAD + "0,0.1\n2,0.2\n1,0.2\n", ["line 4", "distance_m = 1", "rise", "sort it"]),
        (HEAD + "0,0.1\n2,0.2\n2,0.2\n", ["line 4", "distance_m = 2", "rise"]),
        (HEAD + "-1,0.1\n2,0.2\n", ["line 2", "distance_m = -1", "0 or more"]),
        (HEAD + "0,0.1\n\n1,nan\n", ["line 4", "coefficient = 'nan'", "finite number"]),
        (HEAD + "0,0.1\n1,inf\n", ["line 3", "coefficient = 'inf'", "finite number"]),
        (HEAD + "0,0.1\n1,\n", ["line 3", "coefficient = ''", "finite number"]),
        (HEAD + "0,0.1\n1,high\n", ["line 3", "coefficient = 'high'", "finite number"]),
        (HEAD + "0,0.1\n1,1_0\n", ["line 3", "coefficient = '1_0'", "finite number"]),
        (HEAD + "0,0.1\n1,25\n", ["line 3", "coefficient = 25", "-5 to 5"]),
        (HEAD + "0,0,1\n5,0,2\n", ["line 2", "3 cells", "decimal points"]),
        ("distance_m;coefficient\n0;1.000,5\n1;0,2\n", ["line 2", "'1.000,5'"]),
        ("distance_mm,coefficient\n0,0.1\n1,0.2\n", ["distance_mm", "distance_m or time_s"]),
        ("time_min,coefficient\n0,0.1\n1,0.2\n", ["time_min", "distance_m or time_s"]),
        ("distance_m,mu\n0,0.1\n1,0.2\n", ["distance_m, mu", "coefficient; name them so"]),
        ("distance_m,distance_m\n0,0.1\n1,0.2\n", ["distance_m stands there twice"]),
        ("0,0.1\n1,0.2\n", ["no names", "name them so"]),
        (HEAD + STEADY + "200,0.3\n", ["lines 11 and 12", "191 m apart", "from 0.2 to 0.3"]),
        ("\0" * 500, ["is no text"]),
        ("a" * 500 + ",b\n1,2\n2,3\n", ["a" * 80 + "...", "name them so"]),
        (b"\xff\xfed\x00i\x00", ["not UTF-8 text", "save it as UTF-8"]),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_in_a_line(tmp_path, text, words):
    sentence = refusal(friction_of, tmp_path, text)
    for word in (str(tmp_path / "mu.csv"), *words):
        assert word in sentence


@pytest.mark.parametrize(
    "text",
    [
        HEAD + STEADY + "200,0.2\n",  # nothing has changed over the gap
        HEAD + STEADY + "20,0.3\n",  # ten steps are no gap
        HEAD + "0,.1\n.1,.1\n1,.1\n10,.1\n100,.12\n1e3,.2\n",  # each step ten times the last
    ],
)
def test_steps_that_are_no_gap_are_read(tmp_path, text):
    assert len(friction_of(tmp_path, text).friction.coefficient.value) == text.count("\n") - 1


@pytest.mark.parametrize(
    ("friction", "load", "words"),
    [
        ('file = "none.csv"', "normal_n = 44.0", ["none.csv", "cannot be read", "check its name"]),
        ('file = "."', "normal_n = 44.0", ["is not a file"]),
        ("file = 3", "normal_n = 44.0", ["friction.file = 3", "name of a CSV file"]),
        ('fil = "mu.csv"', "normal_n = 44.0", ["unknown key 'friction.fil'; did you mean 'file'"]),
        ("sliding_speed_mm_per_s = 3.0", "normal_n = 44.0", ["friction.file = None"]),
        ('file = "mu.csv"\ncoefficient = 0.2', "normal_n = 44.0", ["exclude each other"]),
        ('file = "mu.csv"\nsliding_speed_mm_per_s = -3', "normal_n = 44.0", ["above 0, in mm/s"]),
        ("coefficient = 0.2", 'file = "mu.csv"',
         ["has the columns", "load.file needs", "normal_n"]),
        ("coefficient = 0.2", 'file = "p.csv"', ["p.csv: line 3: normal_n = 0", "above 0"]),
    ],
)  # fmt: skip
def test_keys_of_a_file_that_are_wrong_are_refused(tmp_path, friction, load, words):
    write_table(tmp_path / "mu.csv", distance_m=S, coefficient=MU)
    (tmp_path / "p.csv").write_text("distance_m,normal_n\n0,44\n1,0\n")
    sentence = refusal(file_scene, tmp_path, friction=friction, load=load)
    for word in words:
        assert word in sentence


def test_a_file_is_found_beside_the_scene_from_a_file_a_text_and_a_dictionary(tmp_path):
    scene = friction_of(tmp_path, HEAD + "0,0.1\n9,0.2\n")
    text = dump_scene(load_scene("line-contact-wear"))
    file = tmp_path / "one.toml"
    file.write_text(text.replace("coefficient = 0.25", 'file = "mu.csv"'))
    loaded = load_scene(file)
    tables = load_scene("line-contact-wear").model_dump(exclude_unset=True, exclude_none=True)
    tables["friction"] = {"file": "mu.csv"}
    made = Scene(**tables, folder=tmp_path)
    for found in (scene, loaded, made):
        assert found.friction.coefficient.value == (0.1, 0.2)
        assert found.files(of_frames=False) == [tmp_path / "mu.csv"]
    changed = loaded.with_values({"friction.coefficient": 0.3})
    assert changed.friction_at(5.0) == 0.3 and changed.name == "one"


def test_a_scene_is_written_with_the_table_and_needs_the_file_no_more(tmp_path):
    scene = friction_of(tmp_path, HEAD + "0,0.1\n9,0.2\n")
    (tmp_path / "mu.csv").unlink()
    again = parse_scene(dump_scene(scene), name=scene.name)
    assert again.friction == scene.friction and again.table_files == ()


FEW, FOLLOWED = 200, 2e-4
"""Points of which each is used as it stands, and the share of the largest that lines may miss."""
ROW_COUNT = 20_000
PLACES = np.linspace(0.0, 240.0, ROW_COUNT)


def true_friction(s):
    """A running-in, and a slow wave."""
    return 0.25 - 0.12 * np.exp(-s / 20.0) + 0.02 * np.sin(s / 15.0)


def true_load(s):
    """A load that is raised from 38 to 50 N about 100 m."""
    return 44.0 + 6.0 * np.tanh((s - 100.0) / 8.0)


def load_integral(s):
    """∫ P ds from 0, N m."""
    return 44.0 * s + 48.0 * np.log(np.cosh((s - 100.0) / 8.0) / np.cosh(100.0 / 8.0))


def few_lines(folder, value, places=PLACES):
    """Places and values that a scene has of a file of them, as its friction or as its load."""
    if np.abs(value).max() < 5.0:
        write_table(folder / "mu.csv", distance_m=places, coefficient=value)
        course = file_scene(folder, friction='file = "mu.csv"').friction.coefficient
    else:
        write_table(folder / "p.csv", distance_m=places, normal_n=value)
        course = file_scene(folder, load='file = "p.csv"').load.normal_n
    return np.array(course.distance_m), np.array(course.value)


@pytest.mark.parametrize("curve", [true_friction, true_load])
def test_a_long_smooth_file_is_followed_within_what_is_stated(tmp_path, curve):
    value = curve(PLACES)
    s, v = few_lines(tmp_path, value)
    assert len(s) <= FEW // 2
    # a line is off by three times its mean over a quarter where that holds a parabola's end
    assert np.abs(np.interp(PLACES, s, v) - value).max() < 3.0 * FOLLOWED * np.abs(value).max()
    step = PLACES[1]
    whole = [np.trapezoid(x, dx=step) for x in (value, np.interp(PLACES, s, v))]
    assert whole[1] == pytest.approx(whole[0], rel=1e-9), "the integral is kept"


@pytest.mark.parametrize("memory", [0.0, 0.95], ids=["white", "of 20 rows"])
def test_noise_is_averaged_and_not_followed(tmp_path, memory):
    from scipy.signal import lfilter

    noise = lfilter([1.0], [1.0, -memory], np.random.default_rng(3).normal(size=ROW_COUNT))
    sigma = 0.01
    value = true_friction(PLACES) + sigma * noise / noise.std()
    s, v = few_lines(tmp_path, value)
    assert len(s) <= 40
    off = np.interp(PLACES, s, v) - true_friction(PLACES)
    # means over a stretch of noise of such memory, (1+m)/(1-m) rows long, and what is not followed
    rows = ROW_COUNT / len(s) * (1.0 - memory) / (1.0 + memory)
    assert off.std() < 3.0 * sigma / rows**0.5 + 4.0 * FOLLOWED


def test_a_jump_of_a_long_file_is_found_to_a_row(tmp_path):
    value = np.where(PLACES < 100.0, 40.0, 48.0)
    s, v = few_lines(tmp_path, value)
    off = np.abs(np.interp(PLACES, s, v) - value) > 0.01
    assert np.count_nonzero(off) <= 4


@pytest.mark.parametrize("count", [FEW, FEW + 1])
def test_few_rows_are_used_as_they_stand(tmp_path, count):
    s = np.linspace(0.0, 1.0, count)
    value = 0.2 + 1e-3 * np.random.default_rng(0).normal(size=count)
    found = few_lines(tmp_path, value, s)
    assert (len(found[0]) == count) == (count == FEW)


def test_a_file_that_swings_with_each_stroke_is_refused_not_averaged_to_nothing(tmp_path):
    strokes = 0.25 * np.sign(np.sin(PLACES * 2.0 * np.pi / 0.02))
    with pytest.raises(InputError, match=r"mu.csv: swings by 0\.2.*means over the strokes"):
        few_lines(tmp_path, strokes)


def test_a_long_noisy_load_wears_what_its_integral_says(tmp_path):
    """Worn area = k ∫P ds / t, whatever the law of the load: in closed form."""
    rng = np.random.default_rng(8)
    noisy = true_load(PLACES) + 0.5 * rng.normal(size=ROW_COUNT)
    write_table(tmp_path / "p.csv", distance_m=PLACES, normal_n=noisy)
    scene = file_scene(tmp_path, load='file = "p.csv"')
    state = contact_states(scene)[-1]
    area = 2e-9 * 1e3 * load_integral(233.0) / 4.0
    mean_error = 0.5 / 44.0 / ROW_COUNT**0.5
    assert state.worn_area_mm2 == pytest.approx(area, rel=4.0 * mean_error + 1e-4)
    # 4 means over the rows of a stretch of 25
    assert state.line_load_n_per_mm * 4.0 == pytest.approx(true_load(233.0), abs=0.05)


@pytest.fixture
def with_files(tmp_path):
    """A small scene whose friction and load stand in files, and the same with the tables in it."""
    write_table(tmp_path / "mu.csv", distance_m=S, coefficient=MU)
    write_table(tmp_path / "p.csv", distance_m=[0.0, 100.0], normal_n=[40.0, 48.0])
    camera = {
        "camera.width_px": 120, "camera.height_px": 90, "camera.pixel_mm": 0.0333,
        "camera.noise_grey": 1.0, "numerics.tolerance": 1e-3, "wear.distances_m": (5.0, 77.0),
        "friction.static_state_first": False,
    }  # fmt: skip
    found = file_scene(tmp_path, friction='file = "mu.csv"', load='file = "p.csv"')
    load = "normal_n = {distance_m = [0.0, 100.0], value = [40.0, 48.0]}"
    inline = file_scene(tmp_path, friction=INLINE, load=load)
    return found.with_values(camera), inline.with_values(camera)


def test_states_from_files_are_those_from_the_tables(with_files):
    found, inline = (contact_states(scene) for scene in with_files)
    assert [state.friction for state in found] == pytest.approx([0.2, 0.24 + 0.01 * 37.0 / 193.0])
    assert [state.line_load_n_per_mm for state in found] == pytest.approx([10.1, 11.54])
    for one, two in zip(found, inline, strict=True):
        assert (one.pressure_mpa == two.pressure_mpa).all()


@pytest.mark.long
def test_simulate_fit_process_compare_and_sweep_take_files(with_files, tmp_path):
    found, _ = with_files
    frames, orders = tmp_path / "frames", tmp_path / "orders"
    simulate(found, frames)
    inputs = json.loads((frames / "provenance.json").read_text())["inputs_sha256"]
    assert {Path(name).name for name in inputs} == {"mu.csv", "p.csv"}
    again = load_scene(frames / "scene.toml")
    assert again.friction == found.friction and again.load == found.load
    place = ("camera.left_mm", "camera.top_mm")
    result = fit(frames / "frames.tif", found, place, as_stated=True, out=tmp_path / "fit")
    for key, true in zip(place, (-2.0, 0.0), strict=True):
        value = result.shared[key]
        assert abs(value["value"] - true) < 4.0 * value["standard_uncertainty"]
    fitted = load_scene(tmp_path / "fit" / "scene.toml")
    assert fitted.friction == found.friction and fitted.load == found.load
    friction = ("friction.coefficient",)
    own = fit(frames / "frames.tif", found, place, per_frame=friction, as_stated=True)
    for state, mu in zip(own.frames, (0.2, 0.2419), strict=True):
        # before the first frame it is constant in the fit, and in the file it began at 0.1
        assert state["friction.coefficient"]["value"] == pytest.approx(mu, abs=1e-3)
    # each frame by itself: what a load that changes has worn before it is refused, file or not
    steady = found.with_values({"load.normal_n": 44.0, "wear.distances_m": (77.0,)})
    simulate(steady, tmp_path / "steady")
    read = process(tmp_path / "steady" / "frames.tif", steady, orders)
    assert len(read.columns["frame"]) == 1
    assert max(compare(orders, tmp_path / "steady").columns["order_rms_fringe"]) < 0.05
    assert sweep(found, {"specimen.young_gpa": [2.0, 2.1]}, tmp_path / "grid").points == 2
