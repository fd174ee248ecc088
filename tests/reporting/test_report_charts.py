"""Curves over distance: what is thinned keeps its peaks and its bands."""

import base64
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pages import drawing_of, made_values

from isochrome.reporting import curves_of, make_curve


def test_few_values_and_a_constant_are_drawn_and_unknown_ones_left_out():
    values = made_values(30)
    load, chi = curves_of(values)
    assert load.label == "normal load (N)" and load.across == "sliding distance (m)"
    assert load.together == 1 and (load.value == values.values[:, 0]).all()
    assert np.allclose(load.high - load.value, 1.0)  # two standard uncertainties of 0.5 N
    assert (chi.low == chi.high).all()
    values = made_values(10)
    values.values[4] = np.nan
    load = curves_of(values)[0]
    assert 4.0 not in load.place and len(load.place) == 9
    values = made_values(5)
    values.values[:] = 0.0
    values.standard_uncertainty[:] = 0.0
    curve = curves_of(values)[0]
    assert curve.label == "normal load (N)" and "sliding distance (m)" in texts_in(curve)
    assert b"nan" not in base64.b64decode(curve.svg)


@pytest.mark.parametrize("count", [241, 1000, 20_000])
def test_of_many_values_none_is_outside_its_envelope(count):
    values = made_values(count)
    load = curves_of(values)[0]
    assert len(load.place) <= 240 and load.together == -(-count // 240)
    own = np.arange(count) // load.together
    inside = values.values[:, 0]
    assert (load.least[own] <= inside).all() and (inside <= load.most[own]).all()
    assert (load.low[own] <= inside - 1.0).all() and (inside + 1.0 <= load.high[own]).all()
    assert load.most.max() == 60.0  # the one frame that is far off is seen
    assert np.isclose(np.average(load.value, weights=np.bincount(own)), inside.mean())


def texts_in(curve):
    """The ticks and the label of a curve's drawing, whose letters are outlines with a comment."""
    return [c.text.strip() for c in drawing_of(curve.svg).iter(ElementTree.Comment)]


@settings(max_examples=8, deadline=None)
@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_ticks_are_round_and_told_apart(low, span):
    place = np.arange(5.0)
    texts = texts_in(make_curve("load (N)", "frame", place, low + span * place / 4.0))
    middle = texts.index("frame")
    for some in (texts[:middle], texts[middle + 1 :]):
        assert 2 <= len(some) <= 10 and len(set(some)) == len(some), texts


def test_the_same_curve_is_the_same_drawing_and_no_name_is_a_formula():
    curve = make_curve("a {name} of $5", "cost in $ {0} or $^$", np.arange(3.0), np.arange(3.0))
    assert curve.svg == replace(curve).svg and "cost in $ {0} or $^$" in texts_in(curve)
    assert b"dc:date" not in base64.b64decode(curve.svg)
