"""Rows of frames become columns, small where there are many."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isochrome.output import Floats, csv_text, plain
from isochrome.processing import TrackedFilm, cell_values, kind_of, row_of_set, tabulate_set
from isochrome.scene import load_scene, parse_scene

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


def test_numbers_take_eight_bytes_and_a_text_that_comes_again_none():
    rows = [{"warnings": "", "chi": 1.0 + k, "wear": float(k)} for k in range(100)]
    table = tabulate_set(rows)
    assert list(table) == ["chi", "wear", "warnings"]  # the longest texts last
    assert isinstance(table["chi"], Floats) and table["chi"].itemsize == 8
    assert isinstance(tabulate_set([*rows, {"warnings": ""}])["wear"], list)
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
    assert plain({"x": found}) == plain({"x": values})
    np.testing.assert_array_equal(np.asarray(found), values)
    long = Floats("d", [math.nan] * 5000)
    assert plain(long) == [None] * 5000


ENDS = ("", "_row_px", "_col_px", "_uncertainty", "_from")
CONTACT = load_scene("line-contact-wear")
KNOWN = "[[frames.known_order]]\nrow_px = 2\ncol_px = 2\norder = 0.0\n"
UNLOADED = parse_scene("[specimen]\nthickness_mm = 4.0\n")


def columns_of(scene, *, tracked=False):
    """The columns of frames.csv of a scene's frames."""
    return (TrackedFilm() if tracked else kind_of(scene)).columns(scene)


@pytest.mark.parametrize("tracked", [False, True], ids=["whole", "tracked"])
def test_columns_are_the_scenes_whatever_is_found(tracked):
    """A lost frame added `fringe_lines`, one with a cause its keys, a first that failed none."""
    columns = columns_of(CONTACT, tracked=tracked)
    keys = ("load.normal_n", "camera.left_mm", "friction.coefficient", "wear.coefficient_mm2_per_n")
    assert set(keys) < set(columns) and columns[-1] == "warnings" and columns.count("causes") == 1
    rows = [{"frame": 0}, {"frame": 1, "fringe_lines": 3}, dict.fromkeys(columns, 1.0)]
    for row in rows:
        assert tuple(row_of_set(row, columns, CONTACT)) == columns


def test_what_a_frame_asked_for_is_in_its_causes_to_the_last_digit():
    columns = columns_of(CONTACT)
    value, spread = 0.1 + 0.2, 1.0 / 3.0
    row = {
        f"camera.roll_deg{end}": v for end, v in (("", value), (" standard_uncertainty", spread))
    }
    row |= {f"camera.distortion{end}": -1e-5 for end in ("", " standard_uncertainty")}
    found = row_of_set(row | {"load.normal_n": 44.0}, columns, CONTACT)
    assert found["load.normal_n"] == 44.0 and "camera.roll_deg" not in found
    assert cell_values(found["causes"]) == {
        "camera.roll_deg": (value, spread), "camera.distortion": (-1e-5, -1e-5)
    }  # fmt: skip
    assert cell_values("") == {}


def test_columns_follow_the_scenes_kind():
    plain = columns_of(UNLOADED)
    assert plain[-2:] == ("fringe_lines", "warnings") and "kept_share" not in plain
    known = columns_of(parse_scene("[specimen]\nthickness_mm = 4.0\n" + KNOWN))
    own = {"kept_share", "order_uncertainty", *(f"n_max{end}" for end in ENDS)}
    assert set(known) - set(plain) == own
