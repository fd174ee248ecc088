"""Curves over distance: what is thinned keeps its peaks and its bands."""

import base64
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pages import drawing_of, made_values

from isochrome.figures import course_plot, values_plots
from isochrome.reporting import drawn_chart

PLACE, LOAD = "sliding distance (m)", "normal load (N)"


def charts_of(values):
    """The charts of some values, and the columns of their numbers."""
    charts = [chart for plot in values_plots(values) if (chart := drawn_chart(plot))]
    numbers = [np.array([[float(v or "nan") for v in row] for row in c["rows"]]) for c in charts]
    return [
        (chart, dict(zip(chart["names"], table.T, strict=True)))
        for chart, table in zip(charts, numbers, strict=True)
    ]


def test_few_values_and_a_constant_are_drawn_and_unknown_ones_left_out():
    values = made_values(30)
    (load, columns), (chi, other) = charts_of(values)
    assert load["label"] == LOAD and load["across"] == PLACE and chi["label"] == "chi"
    assert np.allclose(columns[LOAD], values.values[:, 0], rtol=1e-5)
    assert np.allclose(columns[f"{LOAD} high"] - columns[LOAD], 1.0, atol=1e-3)  # twice 0.5 N
    assert list(other) == [PLACE, "chi"]
    values = made_values(10)
    values.values[4] = np.nan
    _, columns = charts_of(values)[0]
    assert 4.0 not in columns[PLACE] and len(columns[PLACE]) == 9
    values = made_values(5)
    values.values[:] = 0.0
    values.standard_uncertainty[:] = 0.0
    chart, _ = charts_of(values)[0]
    assert chart["label"] == LOAD and PLACE in texts_in(chart)
    assert b"nan" not in base64.b64decode(chart["svg"])
    values.values[1:] = np.nan
    assert [chart["label"] for chart, _ in charts_of(values)] == ["chi"]


@pytest.mark.parametrize("count", [241, 1000, 20_000])
def test_of_many_values_none_is_outside_its_envelope(count):
    values = made_values(count)
    _, load = charts_of(values)[0]
    together = -(-count // 240)
    assert len(load[PLACE]) == -(-count // together) <= 240
    own = np.arange(count) // together
    inside = values.values[:, 0]
    slack = 1e-3  # six digits
    assert (load[f"{LOAD} least"][own] <= inside + slack).all()
    assert (inside <= load[f"{LOAD} most"][own] + slack).all()
    assert (load[f"{LOAD} low"][own] <= inside - 1.0 + slack).all()
    assert (inside + 1.0 <= load[f"{LOAD} high"][own] + slack).all()
    assert load[f"{LOAD} most"].max() == 60.0  # the one frame that is far off is seen
    assert np.isclose(np.average(load[LOAD], weights=np.bincount(own)), inside.mean(), rtol=1e-5)


def test_a_line_breaks_where_many_frames_tell_nothing():
    values = made_values(2000)
    values.values[500:600] = np.nan
    _, load = charts_of(values)[0]
    unknown = ~np.isfinite(load[LOAD])
    assert 0 < unknown.sum() < 14 and np.isfinite(load[PLACE]).all()


def texts_in(chart):
    """The ticks and the label of a chart's drawing, whose letters are outlines with a comment."""
    return [c.text.strip() for c in drawing_of(chart["svg"]).iter(ElementTree.Comment)]


@settings(max_examples=8, deadline=None)
@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_ticks_are_round_and_told_apart(low, span):
    place = np.arange(5.0)
    texts = texts_in(drawn_chart(course_plot("load (N)", "frame", place, low + span * place / 4.0)))
    middle = texts.index("frame")
    for some in (texts[:middle], texts[middle + 1 :]):
        assert 2 <= len(some) <= 10 and len(set(some)) == len(some), texts


def test_the_same_curve_is_the_same_drawing_and_no_name_is_a_formula():
    plot = course_plot("a {name} of $5", "cost in $ {0} or $^$", np.arange(3.0), np.arange(3.0))
    chart = drawn_chart(plot)
    assert chart == drawn_chart(plot) and "cost in $ {0} or $^$" in texts_in(chart)
    assert b"dc:date" not in base64.b64decode(chart["svg"])
