"""The side-by-side figure through its Figure object, the helpers, and frame sets from disk."""

from functools import cache

import matplotlib
import numpy as np
import pytest
from matplotlib.text import Text

from figures.drawn_texts import drawn_texts, outside
from isochrome.comparison import ComparedFrames, compare_frames, load_frame_set, side_by_side
from isochrome.errors import InputError
from isochrome.figures import style as figures
from isochrome.output import write_csv, write_figure, write_tiff

PIXEL_MM = 0.02


def frame_sets(count, **more):
    row, col = np.indices((60, 80), dtype=float)
    order = np.stack([np.hypot(row, col - 40) / (18 + k) for k in range(count)])
    place = {"pixel_mm": PIXEL_MM, "left_mm": -0.8, "top_mm": 0.1, **more}
    labels = tuple(f"sliding, {31 * k} m" for k in range(count))
    measured = order + 0.02
    measured[:, :5, :5] = np.nan
    return tuple(
        ComparedFrames(signal=np.sin(np.pi * each) ** 2, order=each, labels=labels, **place)
        for each in (measured, order)
    )


def drawn(experiment, simulation):
    return side_by_side(experiment, simulation, compare_frames(experiment, simulation))


@cache
def figure_of(count):
    """The figure of so many frames, at which several tests look."""
    return drawn(*frame_sets(count))


def panels(figure):
    return [axes for axes in figure.axes if axes.images and not hasattr(axes, "_colorbar")]


def titles_of(shown):
    return [" ".join(axes.get_title(loc="left").split()) for axes in shown]


def all_text(figure):
    return " ".join(" ".join(text.get_text().split()) for text in figure.findobj(Text))


@pytest.mark.parametrize("count", [1, pytest.param(2, marks=pytest.mark.long)])
def test_panels_letters_labels_and_numbers(count):
    figure = figure_of(count)
    shown = panels(figure)
    assert len(shown) == 3 * count
    titles = titles_of(shown)
    assert [title[:3] for title in titles] == [f"({letter})" for letter in "abcdefghijklmnopqr"][
        : 3 * count
    ]
    assert titles[0] == "(a) experiment, sliding, 0 m"
    text = all_text(figure)
    assert text.count("wrong branch 0 %") == count
    assert "95 % below 0.02" in text and "NCC" in text and "µm" in text


@pytest.mark.long
def test_axes_are_in_millimetres_and_shared_or_count_pixels():
    figure = figure_of(2)
    shown = panels(figure)
    for axes in shown:
        assert axes.get_xlim() == pytest.approx((-0.8, 0.8))
        assert axes.get_ylim() == pytest.approx((1.3, 0.1))  # z points down
        assert axes.get_aspect() == 1.0
    assert shown[0].get_ylabel() == "z (mm)"
    assert [axes.get_xlabel() for axes in shown] == [""] * 3 + ["x (mm)"] * 3
    figure = drawn(*frame_sets(1, pixel_mm=None))
    assert panels(figure)[0].get_xlabel() == "column (px)" and "No pixel scale" in all_text(figure)


@pytest.mark.long
def test_one_grey_range_and_differences_follow_what_is_known():
    shown = panels(drawn(*frame_sets(3)))
    greys = {axes.images[0].get_clim() for k, axes in enumerate(shown) if k % 3 < 2}
    differences = {axes.images[0].get_clim() for axes in shown[2::3]}
    assert len(greys) == 1
    ((low, high),) = differences
    assert low == -high and shown[2].images[0].get_cmap().name == figures.DIFFERENCE_MAP
    experiment, simulation = frame_sets(1)
    bars = [a.get_xlabel() for a in figure_of(1).axes]
    assert "difference of fringe order (fringes)" in bars
    plain = ComparedFrames(signal=experiment.signal, pixel_mm=PIXEL_MM)
    figure = drawn(plain, simulation)
    assert "difference of signal (0 to 1)" in [axes.get_xlabel() for axes in figure.axes]
    assert "wrong branch" not in all_text(figure)


def test_lines_of_the_simulation_lie_on_its_dark_fringes():
    first = panels(figure_of(1))[0]
    assert len(first.lines) >= 3
    x, z = first.lines[0].get_data()
    row, col = (z - 0.1) / PIXEL_MM - 0.5, (x + 0.8) / PIXEL_MM - 0.5
    np.testing.assert_allclose(np.hypot(row, col - 40) / 18, 1.0, atol=0.01)


@pytest.mark.long
def test_many_frames_are_thinned_and_the_foot_says_so():
    figure = drawn(*frame_sets(11))
    assert len(panels(figure)) == 24 and "8 of 11 frames shown" in all_text(figure)
    titles = titles_of(panels(figure)[::3])
    assert titles[0].endswith(" 0 m") and titles[-1].endswith(" 310 m")


@pytest.mark.long
def test_words_stay_inside_the_figure_and_no_global_state_is_left(tmp_path):
    experiment, simulation = frame_sets(2, noise=np.full(2, 0.01))
    figure = drawn(experiment, simulation)
    assert not outside(drawn_texts(figure), figure)
    before = dict(matplotlib.rcParams)
    path = tmp_path / "side.png"
    write_figure(path, drawn(*frame_sets(1)), dpi=50)
    assert path.stat().st_size > 5000 and dict(matplotlib.rcParams) == before


def test_show_image_marks_unknown_pixels_and_has_a_bar():
    figure = figures.new_figure(4, 3)
    axes = figure.add_subplot()
    image = np.array([[1.0, np.nan], [2.0, 3.0]])
    drawn = figures.show_image(axes, image, pixel_mm=0.5, colour_label="fringe order (fringes)")
    assert drawn.get_array().mask.tolist() == [[False, True], [False, False]]
    assert matplotlib.colors.to_hex(axes.get_facecolor()) == figures.UNKNOWN_COLOUR
    assert figure.axes[1].get_ylabel() == "fringe order (fringes)"
    with pytest.raises(InputError, match="2-D"):
        figures.show_image(axes, np.zeros(3))
    colour = np.array([[[0, 128, 255], [255, 0, 51]]])
    drawn = figures.show_image(axes, np.where(colour == 51, np.nan, colour), vmin=0, vmax=255)
    shown = drawn.get_array()
    np.testing.assert_allclose(shown[0, 0], [0, 128 / 255, 1, 1])
    assert shown[0, 1, 3] == 0.0  # not known: what is behind shows
    with pytest.raises(InputError, match="above zero"):
        figures.new_figure(0, 3)


@pytest.mark.parametrize(
    ("values", "limit"), [([0.012], 0.015), ([-0.3], 0.3), ([0.0], 1.0), ([np.nan], 1.0), ([8], 10)]
)
def test_colour_limits_are_round(values, limit):
    assert figures.centred_limit(values) == pytest.approx(limit)


def write_result(folder, signal_name, table_name, table, signal, order, *, more=""):
    folder.mkdir()
    kind = "rgb" if signal.ndim == 4 else "minisblack"
    write_tiff(folder / signal_name, signal, pixel_mm=PIXEL_MM, photometric=kind)
    write_tiff(folder / "fringe_order.tif", order.astype(np.float32), pixel_mm=PIXEL_MM)
    write_csv(folder / table_name, table)
    scene = "[specimen]\n[camera]\nleft_mm = -0.8\ntop_mm = 0.1\nbit_depth = 8\n" + more
    (folder / "scene.toml").write_text(scene, encoding="utf-8")


def test_result_folders_become_frame_sets(tmp_path):
    experiment, simulation = frame_sets(3)
    frames = np.round(255 * simulation.signal).astype(np.uint8)
    table = {"state": [0, 1, 2], "label": ["static", "initial sliding", "sliding, 31 m"]}
    write_result(tmp_path / "sim", "frames.tif", "history.csv", table, frames, simulation.order)
    table = {"frame": [0, 1, 2], "noise": [0.01, 0.02, 0.03]}
    normalised = experiment.signal.astype(np.float32)
    name = "normalised.tif"
    write_result(tmp_path / "exp", name, "frames.csv", table, normalised, experiment.order)

    simulated = load_frame_set(tmp_path / "sim")
    assert simulated.labels == ("static", "initial sliding", "sliding, 31 m")
    assert simulated.pixel_mm == pytest.approx(PIXEL_MM, rel=1e-5)
    assert (simulated.left_mm, simulated.top_mm) == (-0.8, 0.1)
    np.testing.assert_allclose(simulated.signal, simulation.signal, rtol=0, atol=0.003)
    processed = load_frame_set(tmp_path / "exp")
    assert np.isnan(processed.order[:, :5, :5]).all() and processed.noise_of(1) == 0.02
    found = compare_frames(processed, simulated)
    assert found[2].order_bias_fringe == pytest.approx(0.02, abs=1e-5)


def test_off_the_specimen_a_simulated_frame_is_not_known(tmp_path):
    """A camera sees black there, which no experiment's background need be."""
    _, simulation = frame_sets(1)
    order = simulation.order.copy()
    order[:, :9] = np.nan
    frames = np.round(255 * simulation.signal).astype(np.uint8)
    table = {"state": [0], "distance_m": [0.0]}
    write_result(tmp_path / "sim", "frames.tif", "history.csv", table, frames, order)
    found = load_frame_set(tmp_path / "sim")
    np.testing.assert_array_equal(np.isnan(found.signal), np.isnan(found.order))
    assert np.isnan(found.signal[:, :9]).all() and np.isfinite(found.signal[:, 9:]).any()
    counts = np.array([[[0, 65535], [511, 256]]] * 2, dtype=np.uint16)
    write_tiff(tmp_path / "bare.tif", counts, pixel_mm=PIXEL_MM)
    found = load_frame_set(tmp_path / "bare.tif")
    assert found.signal.shape == (2, 2, 2) and found.signal.max() == 1.0 and found.order is None
    assert found.pixel_mm == pytest.approx(PIXEL_MM, rel=1e-5) and found.label(1) == "frame 1"


def test_loading_refuses_what_does_not_fit(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_frame_set(tmp_path / "absent")
    _, simulation = frame_sets(2)
    frames = np.round(255 * simulation.signal).astype(np.uint8)
    table = {"distance_m": [0.0]}
    write_result(tmp_path / "rows", "frames.tif", "history.csv", table, frames, simulation.order)
    with pytest.raises(InputError, match="1 rows for 2 frames"):
        load_frame_set(tmp_path / "rows")
    table = {"distance_m": [0.0, 1.0]}
    short = simulation.order[:, :-1]
    write_result(tmp_path / "short", "frames.tif", "history.csv", table, frames, short)
    with pytest.raises(InputError, match="mixes two runs"):
        load_frame_set(tmp_path / "short")
    (tmp_path / "short" / "scene.toml").write_text("[camera", encoding="utf-8")
    with pytest.raises(InputError, match="not valid TOML"):
        load_frame_set(tmp_path / "short")
    steps = "[[polariscope.step]]\npolariser_deg = 90.0\nanalyser_deg = 0.0\n" * 4
    orders = simulation.order
    frames = np.repeat(frames, 4, axis=0)
    write_result(tmp_path / "set", "frames.tif", "history.csv", table, frames, orders, more=steps)
    with pytest.raises(InputError, match=r"phase-stepped set, 4 frames for each of 2 states.*take"):
        load_frame_set(tmp_path / "set")


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize(
    ("more", "channel"),
    [
        ("", 1),  # green, as everywhere where nothing is said
        ("[polariscope]\nwavelength_nm = 470.0\n", 2),
        ('[polariscope]\nwavelength_nm = 470.0\n[frames]\nchannel = "red"\n', 0),
        ('[frames]\nchannel = "mean"\n', None),
    ],
    ids=["green", "by wavelength", "by name", "mean"],
)
def test_of_colour_frames_one_channel_is_compared(tmp_path, count, more, channel):
    _, simulation = frame_sets(count)
    counts = np.round(60 * simulation.signal).astype(np.uint8)
    colour = np.stack([counts, 2 * counts, 3 * counts], axis=-1)
    table = {"distance_m": [0.0] * count}
    name = "frames.tif"
    write_result(tmp_path / "sim", name, "history.csv", table, colour, simulation.order, more=more)
    found = load_frame_set(tmp_path / "sim")
    factor = 2 if channel is None else channel + 1
    np.testing.assert_allclose(found.signal, factor * counts / 255.0, rtol=1e-6)  # float32
