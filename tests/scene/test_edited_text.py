"""Keys and lists of tables set in TOML text or taken out of it: all else stays."""

import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isochrome.errors import InputError
from isochrome.scene import (
    parse_toml,
    toml_text,
    with_list_value,
    with_table_list,
    with_value,
    without_value,
)

TEXT = """\
# my bench
[specimen]           # block
thickness_mm = 4.0   # calliper

[camera]
pixel_mm = { value = 0.006, standard_uncertainty = 1e-5 } # chessboard
# the camera is new
bit_depth = 12

[frames]
roi = { top_px = 1, left_px = 2, height_px = 30, width_px = 40 }   # cropped
polygon_px = [
  [1.0, 2.0], # first
  [30.0, 2.0],
  [30.0, 39.0],
]
gamma = "unknown"

[[frames.known_order]]
row_px = 4
col_px = 5
order = 0.0  # corner

# what comes next
[load]
normal_n = 44.0
"""


def comments_of(text):
    return [line.partition("#")[2].strip() for line in text.splitlines() if "#" in line]


@pytest.mark.parametrize(
    ("key", "written"),
    [
        ("camera.pixel_mm", "0.00607"), ("camera.bit_depth", "8"), ("camera.left_mm", "-2.0"),
        ("frames.gamma", "1.4"),
        ("frames.roi", "{ top_px = 0, left_px = 0, height_px = 3, width_px = 4 }"),
        ("friction.coefficient", "0.25"),
        ("load.normal_n", "{ value = 44.0, standard_uncertainty = 0.1 }"),
    ],
)  # fmt: skip
def test_one_value_changes_and_every_comment_stays(key, written):
    found = with_value(TEXT, key, written)
    wanted = tomllib.loads(TEXT)
    table, name = key.split(".")
    wanted.setdefault(table, {})[name] = tomllib.loads(f"v = {written}")["v"]
    assert tomllib.loads(found) == wanted and comments_of(found) == comments_of(TEXT)


def test_values_of_several_lines_lists_and_tables_are_values():
    found = with_value(TEXT, "frames.polygon_px", "[[0.0, 0.0], [9.0, 0.0], [9.0, 9.0]]")
    assert tomllib.loads(found)["frames"]["polygon_px"][1] == [9.0, 0.0]
    assert [c for c in comments_of(TEXT) if c != "first"] == comments_of(found)
    text = "[frames]\nknown_order = [{ row_px = 1, col_px = 2, order = 0.0 }]\ngamma = 1.4\n"
    found = with_table_list(text, "frames.known_order", [{"row_px": 3, "col_px": 4, "order": 1.0}])
    data = tomllib.loads(found)["frames"]
    assert data == {"gamma": 1.4, "known_order": [{"row_px": 3, "col_px": 4, "order": 1.0}]}
    text = "[frames.roi]\ntop_px = 1\n# mine\n[load]\nnormal_n = 1.0\n"
    found = with_value(text, "frames.roi", "{ top_px = 9 }")
    assert tomllib.loads(found) == {"frames": {"roi": {"top_px": 9}}, "load": {"normal_n": 1.0}}
    assert "# mine" in found


@pytest.mark.parametrize("key", ["camera.bit_depth", "frames.roi", "frames.gamma", "load.normal_n"])
def test_a_key_goes_with_its_own_comment_alone(key):
    found = without_value(TEXT, key)
    wanted = tomllib.loads(TEXT)
    table, name = key.split(".")
    del wanted[table][name]
    assert tomllib.loads(found) in (wanted, {k: v for k, v in wanted.items() if v})
    own = {"frames.roi": "cropped"}.get(key)
    assert comments_of(found) == [c for c in comments_of(TEXT) if c != own]


@pytest.mark.parametrize(
    "text",
    [
        "frames = { gamma = 1.4, channel = 'red' }\n",
        "frames = { channel = 'red', gamma = 1.4 } # both\n",
        "frames.channel = 'red'\nframes.gamma = 1.4\n",
        "[frames]\ngamma = 1.4\nchannel = 'red'",
        "[frames]\r\nchannel = 'red' # gamma = 3\r\ngamma = 1.4\r\n",
    ],
)
def test_a_key_goes_from_any_layout(text):
    assert tomllib.loads(without_value(text, "frames.gamma")) == {"frames": {"channel": "red"}}


def test_a_key_that_is_not_there_leaves_all_and_what_cannot_be_edited_is_said():
    assert without_value(TEXT, "frames.flip") == TEXT and without_value(TEXT, "wear") == TEXT
    with pytest.raises(InputError, match=r"my: .* set load\.normal_n = 3 in it by hand"):
        with_value("load = [1]", "load.normal_n", "3", name="my")
    with pytest.raises(InputError, match="its layout cannot be edited"):
        with_value(TEXT, "camera.bit_depth", "8", comment="new\nseed = 3")


def test_a_list_of_tables_is_replaced_and_taken_out():
    entries = [{"row_px": 7, "col_px": 8, "order": 1.5}, {"row_px": 1, "col_px": 2, "order": 0.0}]
    found = with_table_list(TEXT, "frames.known_order", entries)
    assert tomllib.loads(found)["frames"]["known_order"] == entries
    assert comments_of(found) == [c for c in comments_of(TEXT) if c != "corner"]
    gone = with_table_list(found, "frames.known_order", [])
    assert "known_order" not in gone and comments_of(gone) == comments_of(found)


PLAIN = st.recursive(
    st.booleans() | st.integers(-(2**60), 2**60) | st.text()
    | st.floats(allow_nan=False, allow_infinity=False),
    lambda inner: st.lists(inner, max_size=3),
    max_leaves=5,
)  # fmt: skip


@settings(max_examples=20, deadline=None)
@given(value=PLAIN)
def test_any_value_is_written_so_that_it_is_read_again(value):
    found = with_value(TEXT, "frames.gamma", toml_text(value))
    assert tomllib.loads(found)["frames"]["gamma"] == value


COMMENTED = """\
# what is known
[[frames.known_order]]
row_px = 1  # the edge
col_px = 2
order = 0.0
# the corner
[[frames.known_order]]
row_px = 3
# counted twice
col_px = 4
order = 1.0

[camera]
pixel_mm = 0.1
"""


def test_a_lists_tables_that_stay_keep_their_comments_and_a_table_that_goes_takes_its_own():
    first, second, third = ({"row_px": r, "col_px": r + 1, "order": r / 2 - 0.5} for r in (1, 3, 5))
    key = "frames.known_order"
    added = with_table_list(COMMENTED, key, [first, second, third])
    new = "\n[[frames.known_order]]\nrow_px = 5\ncol_px = 6\norder = 2.0\n"
    assert added == COMMENTED.replace("order = 1.0\n", "order = 1.0\n" + new)
    assert with_table_list(added, key, [first, second]).split() == COMMENTED.split()
    left = with_table_list(COMMENTED, key, [first])
    assert "the edge" in left and "counted twice" not in left and "pixel_mm = 0.1" in left
    windows = COMMENTED.replace("\n", "\r\n")
    assert with_table_list(windows, key, [first, second, third]) == added.replace("\n", "\r\n")


def test_a_list_in_another_order_is_written_anew_and_one_that_stands_apart_left():
    second, first = ({"row_px": r, "col_px": r + 1, "order": r / 2 - 0.5} for r in (3, 1))
    found = with_table_list(COMMENTED, "frames.known_order", [second, first])
    assert parse_toml(found, "scene")["frames"]["known_order"] == [second, first]
    text = "frames.gamma = 1.4 # mine\n"
    found = with_table_list(text, "image", [{"file": "a.png", "load_n": 1.0}])
    assert found == text + '\n[[image]]\nfile = "a.png"\nload_n = 1.0\n'
    # the library would move its second table to the first
    text = IMAGES.replace("[[image]]\nfile = 'b'", "[camera]\npixel_mm = 1\n[[image]]\nfile = 'b'")
    with pytest.raises(InputError, match="its layout cannot be edited"):
        with_value(text, "camera.pixel_mm", "2.0")


IMAGES = "[[image]]\nfile = 'a'  # first\nload_n = 1  # cell\n[[image]]\nfile = 'b'\n# blurred\n"


def test_one_entry_of_a_lists_table_changes_or_is_added():
    found = with_list_value(IMAGES, "image", 0, "load_n", 2.5)
    assert found == IMAGES.replace("load_n = 1 ", "load_n = 2.5 ")
    added = with_list_value(IMAGES, "image", 1, "load_n", 2.5)
    assert tomllib.loads(added)["image"][1] == {"file": "b", "load_n": 2.5}
    assert comments_of(added) == comments_of(IMAGES)
