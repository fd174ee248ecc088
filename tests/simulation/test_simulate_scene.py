"""From scene to frames: the paper's case, discs and beams, files whole or not at all, refusals."""

from contextlib import nullcontext

import numpy as np
import pytest
import tifffile

from isochrome.errors import InputError, PhysicsError
from isochrome.frames import open_frames, open_tiff
from isochrome.output import read_csv
from isochrome.scene import dump_scene, load_scene, parse_scene
from isochrome.simulation import (
    make_picture,
    picture_signal,
    scene_states,
    simulate,
    state_count,
    state_difference,
)
from isochrome.stress import pixel_grid
from scene_texts import beam_text, camera_text, disc_text

PAPER = load_scene("line-contact-wear")

# a quarter of the pixels each way and a loose step: for tests that need frames, not figures
SMALL = PAPER.with_values(
    {
        "camera.width_px": 165, "camera.height_px": 123, "camera.pixel_mm": 4 * 0.00607,
        "numerics.spacing_mm": 2 * 0.00607, "numerics.tolerance": 1e-3,
        "wear.distances_m": (0.0, 77.0, 233.0),
    }
)  # fmt: skip


@pytest.fixture(scope="module")
def paper():
    """The shipped scene as `isochrome simulate line-contact-wear` runs it, in memory."""
    return simulate("line-contact-wear")


def test_static_peak_and_width_are_hertz_to_the_issues_bars(paper):
    # 18.758 ± 0.005 MPa and 0.7466 ± 0.004 mm
    assert paper.history["label"][0] == "static"
    assert paper.history["p_max_mpa"][0] == pytest.approx(18.758, abs=0.005)
    assert paper.history["contact_width_mm"][0] == pytest.approx(0.7466, abs=0.004)
    assert paper.history["friction"][0] == 0.0


def test_the_largest_fringe_order_starts_below_the_surface_and_leans_ahead_when_sliding(paper):
    history = paper.history
    # 0.6006 p0 d/f at 0.786 a
    assert history["n_max"][0] == pytest.approx(3.0866, abs=1e-3)
    assert history["n_max_z_mm"][0] == pytest.approx(0.786 * 0.3733, abs=0.00607)
    assert abs(history["n_max_x_mm"][0]) < 0.00607
    assert history["n_max"][1] > history["n_max"][0]
    assert history["n_max_x_mm"][1] > 0.1 and history["n_max_z_mm"][1] < history["n_max_z_mm"][0]


def test_wear_flattens_the_pressure_and_moves_the_largest_shear_to_the_surface_at_the_edge(paper):
    """What the paper reports, qualitatively, from 31 m to 233 m."""
    history = paper.history
    assert (np.diff(history["p_max_mpa"][1:]) < 0).all()
    assert (np.diff(history["contact_width_mm"][1:]) > 0).all()
    assert (np.diff(history["wear_depth_um"][1:]) > 0).all()
    right_edge = paper.states[-1].surface.edges_mm[1]
    assert history["n_max_z_mm"][-1] < 0.00607  # the first row of pixels
    assert history["n_max_x_mm"][-1] == pytest.approx(right_edge, abs=2 * 0.00607)
    assert history["n_max_x_mm"][1] < paper.states[1].surface.edges_mm[1] - 0.05


@pytest.mark.long
def test_worn_states_are_right_to_the_scenes_own_tolerance_and_fields_below_the_first_rows(paper):
    """Against a hundredth of its tolerance, which is 1e-4."""
    converged = simulate(PAPER.with_values({"numerics.tolerance": 1e-6}))
    for column in ("p_max_mpa", "wear_depth_um"):
        np.testing.assert_allclose(paper.history[column], converged.history[column], rtol=1e-4)
    # the fringe orders that the camera sees: what error there is sits at the moving edge
    error = np.abs(paper.orders - converged.orders)
    # measured 2.3e-4 of a fringe below 0.1 mm, 6e-3 in the edge's own pixel, 2.6e-3 of n_max
    assert np.nanmax(error[:, 16:]) < 5e-4
    assert np.nanmax(error) < 0.01
    np.testing.assert_allclose(paper.history["n_max"], converged.history["n_max"], rtol=5e-3)


def test_frames_are_sine_squared_of_the_order_in_the_cameras_grey_levels(paper):
    assert paper.frames.shape == (6, 494, 659) and paper.frames.dtype == np.uint8
    order = paper.orders.astype(float)
    ideal = 255 * np.sin(np.pi * order) ** 2
    # half a grey level, what a pixel's area takes from contrast ((pi g)²/6 of it, g < 0.06 fringe
    # a pixel away from the edges), and single precision
    rows = np.s_[:, 20:]
    assert np.abs(paper.frames[rows] - ideal[rows]).max() < 0.5 + 255 * (np.pi * 0.06) ** 2 / 6


def test_bright_field_is_the_dark_fields_complement():
    dark = simulate(SMALL)
    bright = simulate(SMALL.with_values({"polariscope.field": "bright"}))
    total = dark.frames.astype(int) + bright.frames
    # each rounded by half a level
    assert np.abs(total - 255).max() <= 1


def test_a_phase_stepped_scene_gives_a_frame_for_each_step_and_state():
    steps = tuple({"polariser_deg": 90.0 + b, "analyser_deg": b} for b in (0.0, 22.5, 45.0, 67.5))
    out = simulate(SMALL.with_values({"polariscope.step": steps}))
    assert out.frames.shape == (4 * 4, 123, 165) and out.orders.shape == (4, 123, 165)
    # four plane frames at 22.5 degrees: I_1 + I_3 = I_2 + I_4 = sin²(pi N) in every pixel
    one = out.frames[:4].astype(int)
    dark = simulate(SMALL).frames[0].astype(int)
    assert np.abs(one[0] + one[2] - dark).max() <= 2
    assert np.abs(one[1] + one[3] - dark).max() <= 2


@pytest.mark.long
@pytest.mark.parametrize(
    ("bits", "dtype"), [(8, np.uint8), (12, np.uint16), (None, np.float32)], ids=str
)
def test_a_colour_cameras_frames_are_rgb_in_memory_and_on_disk(tmp_path, bits, dtype):
    steps = ({"polariser_deg": 90.0, "analyser_deg": 0.0},) * 2
    scene = SMALL.with_values(
        {
            "camera.colour": True, "camera.bit_depth": bits, "polariscope.light": "white",
            "polariscope.step": steps, "wear.distances_m": (0.0,),
        }
    )  # fmt: skip
    frames = simulate(scene).frames
    assert frames.shape == (2 * 2, 123, 165, 3) and frames.dtype == dtype
    assert (frames[..., 0] != frames[..., 2]).any()
    simulate(scene, tmp_path)
    with tifffile.TiffFile(tmp_path / "frames.tif") as tif:
        assert {int(page.photometric) for page in tif.pages} == {2}  # RGB
        np.testing.assert_array_equal(np.stack([page.asarray() for page in tif.pages]), frames)
    for k, channel in enumerate(("red", "green", "blue")):
        with open_frames(tmp_path / "frames.tif", channel=channel) as reader:
            np.testing.assert_array_equal(np.stack([f.image for f in reader]), frames[..., k])


DISC = disc_text(120.0, fringe_value=12.0) + camera_text(241, 241, 0.09)
BEAM = beam_text(500.0, fringe_value=12.0) + camera_text(120, 240, 0.1)


def test_a_beams_order_is_linear_over_its_height_and_dark_on_the_neutral_axis():
    scene = parse_scene(BEAM)
    out = simulate(scene)
    pixels = pixel_grid(scene)
    eta = pixels.z_mm - 10.0
    moment, inertia = 500 * (100 - 40) / 4, 6 * 20**3 / 12
    exact = np.abs(moment * eta / inertia) * 6 / 12
    inside = np.abs(eta) <= 10
    column = out.orders[0, :, 60]
    np.testing.assert_allclose(column[inside], exact[inside], rtol=1e-6)
    assert np.isnan(column[~inside]).all()


def test_a_beams_edge_rows_are_as_sharp_as_the_rest():
    """The step from the largest order to nothing at the edge is no fringe finer than a pixel."""
    scene = parse_scene(BEAM)
    (state,) = scene_states(scene)
    pixels = pixel_grid(scene)
    picture = make_picture(scene, state_difference(scene, state, pixels), pixels)
    assert picture.too_fine == 0.0
    # one straight gradient of N = 9.4/100 a pixel at most, all over
    known = picture.visibility[picture.material]
    assert known.min() > np.sinc(0.12)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The small scene's folder, which nobody changes, what was returned, and the progress."""
    out, steps = tmp_path_factory.mktemp("written") / "here" / "out", []
    return out, simulate(SMALL, out, progress=steps.append), tuple(steps)


def test_simulate_leaves_its_files_whole(written):
    out, result, told = written
    steps = list(told)
    assert result.frames is None and result.orders is None
    assert sorted(p.name for p in out.iterdir()) == [
        "frames.tif", "fringe_order.tif", "history.csv", "pressure.csv", "provenance.json",
        "report.html", "scene.toml", "simulation.png",
    ]  # fmt: skip
    assert [(step.done, step.count) for step in steps] == [(k, 4) for k in range(5)]
    memory = simulate(SMALL, progress=steps.append)
    assert [(step.done, step.count) for step in steps[5:]] == [(k, 4) for k in range(1, 5)]
    np.testing.assert_array_equal(tifffile.imread(out / "frames.tif"), memory.frames)
    np.testing.assert_array_equal(tifffile.imread(out / "fringe_order.tif"), memory.orders)
    # tags hold rationals of 32 bits
    for name in ("frames.tif", "fringe_order.tif"):
        assert open_tiff(out / name).pixel_mm == pytest.approx(4 * 0.00607, rel=1e-6)
    history = read_csv(out / "history.csv")
    assert set(memory.history) <= set(history) and history["label"] == memory.history.pop("label")
    for name, values in memory.history.items():
        np.testing.assert_allclose(history[name], values, rtol=1e-8)
    assert parse_scene((out / "scene.toml").read_text("utf-8")) == parse_scene(dump_scene(SMALL))
    pressure = read_csv(out / "pressure.csv")
    first = np.array(pressure["state"]) == 0
    # the pressures written carry the load: 9 digits
    x, p = (np.array(pressure[k])[first] for k in ("x_mm", "pressure_mpa"))
    assert p.sum() * (x[1] - x[0]) == pytest.approx(11.0, rel=1e-7)


def test_pressure_table_leaves_out_only_zeros(written):
    """Rows run over the loaded and worn nodes, with a zero at both ends where contact can end."""
    table = {k: np.array(v) for k, v in read_csv(written[0] / "pressure.csv").items()}
    for index, state in enumerate(scene_states(SMALL)):
        surface, rows = state.surface, table["state"] == index
        x = surface.grid.x_mm
        written = np.isin(np.round(x, 7), np.round(table["x_mm"][rows], 7))
        assert written.sum() == rows.sum() < surface.grid.nodes
        for name, values in (
            ("pressure_mpa", surface.pressure_mpa),
            ("shear_mpa", surface.shear_mpa),
            ("wear_depth_um", 1e3 * surface.wear_depth_mm),
        ):
            np.testing.assert_allclose(table[name][rows], values[written], rtol=5e-9)  # 9 digits
            assert not values[~written].any()
            assert (table[name][rows][[0, -1]] == 0.0).all()


SLIDING, WORN = "[friction]\ncoefficient = 0.2\n", "[wear]\ncoefficient_mm2_per_n = 2e-9\n"
FIRST, DISTANCES = "static_state_first = true\n", "distances_m = [5.0, 0.0]\n"


@pytest.mark.parametrize(
    "parts",
    ["", WORN + DISTANCES, SLIDING, SLIDING + WORN + DISTANCES, SLIDING + FIRST + WORN + DISTANCES,
     SLIDING + FIRST, SLIDING + "held"],
)  # fmt: skip
def test_states_are_counted_before_they_are_solved(parts):
    text = dump_scene(SMALL).split("[friction]")[0]
    if parts.endswith("held"):
        text = text.replace("[load]", "[load]\ntangential_n = 3.0")
    scene = parse_scene(text + parts.removesuffix("held") + "[numerics]\nspacing_mm = 0.01\n")
    assert state_count(scene) == len(scene_states(scene))


@pytest.mark.parametrize("cut", [0.4, 0.0, -0.4])
def test_a_row_that_the_surface_cuts_is_not_the_specimens(cut):
    """It sees the indenter too. A row that begins at the surface is whole, rounding aside."""
    scene = SMALL.with_values({"camera.top_mm": (cut - 3.0) * 4 * 0.00607})
    pixels = pixel_grid(scene)
    (state, *_) = scene_states(scene.with_values({"wear.distances_m": (0.0,)}))
    picture = make_picture(scene, state_difference(scene, state, pixels), pixels)
    above = {0.4: 3, 0.0: 3, -0.4: 4}[cut]
    assert not picture.material[:above].any() and picture.material[above:].all()
    assert np.isnan(picture.order[:above]).all() and np.isfinite(picture.order[above:]).all()
    assert not picture_signal(scene, picture)[:above].any()


RING = '[specimen]\nshape = "ring"\n'
NOTHING = "[specimen]\nthickness_mm = 4.0\n"
NO_CAMERA = dump_scene(SMALL).split("[camera]")[0] + "[numerics]\nspacing_mm = 0.012\n"


@pytest.mark.parametrize(
    ("scene", "kind", "words"),
    [
        (SMALL.with_values({"specimen.fringe_value_n_per_mm": 0.05}), PhysicsError,
         r"fringes finer than two pixels .*camera.pixel_mm.*use smaller pixels"),
        (SMALL.with_values({"camera.width_px": 20}), PhysicsError,
         r"the contact is .* mm wide, wider than the picture .*widen the camera"),
        (SMALL.with_values({"numerics.window_mm": 0.9}), PhysicsError,
         r"reaches the edge of its grid.*numerics.window_mm"),
        (parse_scene(NO_CAMERA), InputError, r"\[camera\] is missing, and a picture needs it"),
        (parse_scene(RING), InputError, r"a ring has no model without.*isochrome process"),
        (parse_scene(NOTHING), InputError, r"no \[indenter\] and no shape"),
        (SMALL.with_values({"load.normal_n": 44e6}), PhysicsError,
         r"half-plane under a parabola no longer holds; lower load.normal_n"),
    ],
    ids=["too-fine", "too-wide", "window", "no-camera", "ring", "no-model", "too-heavy"],
)  # fmt: skip
def test_a_refusal_says_what_to_change_and_leaves_nothing_behind(tmp_path, scene, kind, words):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(kind, match=words) as refusal:
        simulate(scene, tmp_path)
    assert refusal.value.exit_code == {InputError: 2, PhysicsError: 3}[kind]
    assert "\n" not in str(refusal.value)
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(("fringe_value", "fits"), [(2.95, True), (2.85, False)])
def test_three_hundredths_of_the_fringes_may_be_finer_than_two_pixels(fringe_value, fits):
    """Shares of the fringed pixels by numpy's own central differences of the order."""
    scene = SMALL.with_values({"specimen.fringe_value_n_per_mm": fringe_value})
    scene = scene.model_copy(update={"wear": None, "friction": None})
    pixels = pixel_grid(scene)
    (state,) = scene_states(scene)
    order = np.abs(state_difference(scene, state, pixels)) * 4.0 / fringe_value
    steep = np.hypot(*np.gradient(order)) > 0.5
    share = np.count_nonzero(steep & (order > 0.5)) / np.count_nonzero(order > 0.5)
    assert abs(share - 0.03) < 0.002 and (share < 0.03) == fits
    refused = pytest.raises(PhysicsError, match=rf"in {100 * share:.1f} % of the fringed picture")
    with nullcontext() if fits else refused:
        assert simulate(scene).frames.shape == (1, 123, 165)


@pytest.mark.parametrize(("columns", "fits"), [(31, True), (30, False)])
def test_a_picture_is_as_wide_as_the_contact_at_least(columns, fits):
    """2a is 0.7466 mm; 30 pixels are 0.728 mm and 31 are 0.753 mm."""
    scene = SMALL.with_values({"camera.width_px": columns})
    scene = scene.model_copy(update={"wear": None, "friction": None})
    words = r"is 0\.74\d mm wide, wider than .* \(0\.728 mm\)"
    with nullcontext() if fits else pytest.raises(PhysicsError, match=words):
        assert simulate(scene).frames.shape == (1, 123, 31)


def test_a_later_states_refusal_leaves_nothing_of_the_earlier_ones(tmp_path):
    done = []
    scene = SMALL.with_values({"camera.width_px": 45})  # 1.09 mm: too narrow for the last scar
    with pytest.raises(PhysicsError, match="wider than the picture"):
        simulate(scene, progress=done.append)
    assert [tally.done for tally in done] == [1, 2, 3]
    with pytest.raises(PhysicsError, match="wider than the picture"):
        simulate(scene, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
