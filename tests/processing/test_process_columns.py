"""Rows of frames become columns, small where there are many."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isochrome.output import Floats, csv_text, json_pieces
from isochrome.processing.processed import tabulate_set

CELLS = st.one_of(st.none(), st.integers(), st.floats(), st.booleans(), st.sampled_from("ab"))
ROWS = st.lists(
    st.fixed_dictionaries({"frame": st.integers()}, optional={"chi": st.floats(), "note": CELLS}),
    min_size=1,
    max_size=9,
)


def same(one, other):
    """Equal, of one type, and as unknown as the other."""
    unknown = isinstance(one, float) and math.isnan(one)
    return type(one) is type(other) and (math.isnan(other) if unknown else one == other)


@given(rows=ROWS)
def test_columns_hold_what_the_rows_do(rows):
    table = tabulate_set(rows)
    assert set(table) == set().union(*rows)
    for name, values in table.items():
        assert len(values) == len(rows)
        assert all(same(value, row.get(name)) for value, row in zip(values, rows, strict=True))


def test_numbers_take_eight_bytes_as_long_as_all_are():
    rows = [{"warnings": "", "chi": 1.0 + k, "wear": float(k)} for k in range(100)]
    table = tabulate_set(rows)
    assert list(table) == ["chi", "wear", "warnings"]  # the longest texts last
    assert isinstance(table["chi"], Floats) and table["chi"].itemsize == 8
    assert isinstance(tabulate_set([*rows, {"warnings": ""}])["wear"], list)


def test_a_text_that_comes_again_is_the_one_before():
    texts = ["".join(["fo", "llowed"]) for _ in range(3)]
    assert texts[0] is not texts[1]
    found = tabulate_set({"found_by": text} for text in texts)["found_by"]
    assert found[0] is found[1] is found[2]


def test_floats_are_like_a_list_of_them():
    values = [1.5, -0.0, 3.0]
    found = Floats("d", values)
    assert found == values and values == found and found != [1.5] and found != 3
    assert found == pytest.approx([1.5, 0.0, 3.0]) and repr(found) == repr(values)
    assert csv_text({"x": found}) == csv_text({"x": values})
    assert "".join(json_pieces({"x": found})) == "".join(json_pieces({"x": values}))
    np.testing.assert_array_equal(np.asarray(found), values)
    long = Floats("d", [math.nan] * 5000)
    assert "".join(json_pieces(long)) == "[" + ", ".join(["null"] * 5000) + "]"
