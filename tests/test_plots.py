"""The plots for scripts and notebooks: on the caller's Axes or on their own, in mm, z down."""

import matplotlib
import numpy as np
import pytest

import isochrome
from refusals import refusal

matplotlib.use("Agg")
from matplotlib import pyplot  # once the back-end is chosen

RING = isochrome.load_scene("ring").with_values(
    {
        "load.normal_n": 60.0, "camera.width_px": 96, "camera.height_px": 96,
        "camera.pixel_mm": 0.48, "camera.noise_grey": 1.0,
    }
)  # fmt: skip
CONTACT = isochrome.load_scene("line-contact-wear").with_values(
    {"camera.width_px": 96, "camera.height_px": 72, "camera.pixel_mm": 0.04}
)


@pytest.fixture(scope="module")
def ring():
    simulated = isochrome.simulate(RING)
    return isochrome.process(simulated.frames, RING), simulated


@pytest.fixture(scope="module")
def states():
    return isochrome.scene_states(CONTACT)


@pytest.fixture(autouse=True)
def no_figure_stays():
    yield
    pyplot.close("all")


def plots(ring, states):
    found, simulated = ring
    return {
        "frame": lambda axes: isochrome.plot_frame(simulated.dataset.frames[0], axes),
        "order": lambda axes: isochrome.plot_order(found.dataset.fringe_order[0], axes),
        "over distance": lambda axes: isochrome.plot_over_distance(found, "load.normal_n", axes),
        "pressure": lambda axes: isochrome.plot_pressure(states, axes),
        "scar": lambda axes: isochrome.plot_scar(states, axes),
    }


NAMES = ("frame", "order", "over distance", "pressure", "scar")


@pytest.mark.parametrize("name", NAMES)
def test_a_plot_is_drawn_on_the_axes_that_are_given_or_on_its_own(ring, states, name):
    draw = plots(ring, states)[name]
    pyplot.close("all")
    mine = pyplot.figure().subplots()
    assert draw(mine) is mine and len(pyplot.get_fignums()) == 1
    own = draw(None)
    assert own.figure.number in pyplot.get_fignums() and own is not mine
    for axes in (mine, own):
        assert axes.has_data() and axes.get_xlabel() and axes.get_ylabel()
        axes.figure.canvas.draw()


@pytest.mark.parametrize("name", ["frame", "order"])
def test_a_picture_lies_where_its_coordinates_say(ring, states, name):
    axes = plots(ring, states)[name](None)
    left, right, bottom, top = axes.get_images()[0].get_extent()
    # an order is drawn where it was found: to a hundredth of a pixel, some ten of the fit's ±
    assert (left, right) == pytest.approx((-23.04, 23.04), abs=0.0048)
    assert bottom > top and axes.get_xlabel() == "x (mm)" and axes.get_ylabel() == "z (mm)"


def test_a_plain_array_is_drawn_in_pixels_or_by_the_scale_that_is_given():
    frame = np.zeros((4, 6), np.uint16)
    image = isochrome.plot_frame(frame).get_images()[0]
    assert image.get_extent() == [-0.5, 5.5, 3.5, -0.5] and image.get_clim() == (0, 65535)
    image = isochrome.plot_frame(frame, pixel_mm=0.5, left_mm=-1.0, full=4095).get_images()[0]
    assert image.get_extent() == [-1.0, 2.0, 2.0, 0.0] and image.get_clim() == (0, 4095)
    axes = isochrome.plot_order(np.full((4, 6), np.nan), lines=False)
    assert axes.get_images()[0].get_clim() == (0, 1)


def test_lines_of_the_order_lie_on_their_order(ring):
    """Each drawn line runs along a half order of the map."""
    order = ring[1].dataset.fringe_order[0]
    axes = isochrome.plot_order(order)
    assert len(axes.get_lines()) > 4
    for line in axes.get_lines():
        x, z = line.get_data()
        here = order.interp(x_mm=("at", x), z_mm=("at", z)).values
        here = here[np.isfinite(here)]
        assert here.size == 0 or np.median(np.abs(2 * here - np.rint(2 * here))) < 0.1


def test_pressure_and_scar_are_those_of_the_states(states):
    for plot, name, factor in (
        (isochrome.plot_pressure, "pressure_mpa", 1.0), (isochrome.plot_scar, "wear_depth_mm", 1e3)
    ):  # fmt: skip
        axes = plot(states)
        lines = axes.get_lines()
        assert [line.get_label() for line in lines] == [state.label for state in states]
        for line, state in zip(lines, states, strict=True):
            assert np.array_equal(line.get_ydata(), factor * getattr(state.surface, name))
        assert axes.yaxis_inverted() == (name == "wear_depth_mm")
        one = plot(states[1])
        assert len(one.get_lines()) == 1


def test_experiment_and_simulation_stand_side_by_side(ring):
    found, simulated = ring
    three = isochrome.plot_side_by_side(found, simulated)
    assert len({axes.figure.number for axes in three}) == 1
    mine = pyplot.figure().subplots(1, 3)
    again = isochrome.plot_side_by_side(found, simulated, mine, lines=False)
    assert list(again) == list(mine) and not mine[0].get_lines() and three[0].get_lines()
    shown = np.ma.filled(mine[2].get_images()[0].get_array().astype(float), np.nan)
    # pixel by pixel, as compare does: the axes are of the found place and of the stated one
    wanted = found.dataset.fringe_order[0].values - simulated.dataset.fringe_order[0].values
    assert np.allclose(shown, wanted, equal_nan=True)
    bare = isochrome.plot_side_by_side(simulated.frames, simulated.frames)
    assert np.abs(bare[2].get_images()[0].get_array()).max() < 1e-6


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda f, s: isochrome.plot_over_distance(f, "load.n"), "those that have: load.normal_n"),
        (lambda f, s: isochrome.plot_order(np.zeros((2, 3, 4))), "one (rows, cols)"),
        (lambda f, s: isochrome.plot_frame(np.zeros(4)), "one 2-D image"),
        (lambda f, s: isochrome.plot_side_by_side(f, s, frame=1), "frame = 1"),
        (lambda f, s: isochrome.plot_side_by_side(f, s, [1, 2]), "give three"),
        (lambda f, s: isochrome.plot_pressure(isochrome.scene_states(RING)), "of a contact"),
        (lambda f, s: isochrome.plot_pressure([]), "of a contact"),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_one_line(ring, call, words):
    assert words in refusal(call, *ring)
