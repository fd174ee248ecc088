"""Results on disk: whole or not at all, and read back as written."""

import json
from pathlib import Path

import numpy as np
import pytest
import tifffile
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from isochrome import output
from isochrome.errors import InputError
from isochrome.frames import open_tiff

SAME_FOLDER = settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def stacks(dtype):
    shape = hnp.array_shapes(min_dims=3, max_dims=3, min_side=1, max_side=9)
    return hnp.arrays(dtype, shape, elements=hnp.from_dtype(np.dtype(dtype)))


@SAME_FOLDER
@given(stack=st.one_of(*(stacks(d) for d in (np.uint8, np.uint16, np.float32))))
def test_any_stack_comes_back_with_its_shape_type_and_values(tmp_path, stack):
    output.write_tiff(tmp_path / "s.tif", stack, pixel_mm=0.00607)
    with tifffile.TiffFile(tmp_path / "s.tif") as tif:
        back = np.stack([page.asarray() for page in tif.pages])
        if min(stack.shape[1:]) > 1:  # a lone row or column is a plain TIFF
            assert tif.is_imagej and tif.imagej_metadata["unit"] == "mm"
    assert back.dtype == stack.dtype
    np.testing.assert_array_equal(back, stack)
    # The resolution is a ratio of 32-bit integers: 1e-6 is far above its rounding.
    assert open_tiff(tmp_path / "s.tif").pixel_mm == pytest.approx(0.00607, rel=1e-6)


def test_streamed_stack_equals_the_one_written_at_once_and_carries_the_scale(tmp_path):
    stack = np.arange(5 * 6 * 7, dtype=np.uint16).reshape(5, 6, 7)
    kind, notes = (stack.shape, stack.dtype), {"Info": "by hand"}
    output.write_frames(tmp_path / "a.tif", iter(stack), *kind, pixel_mm=0.00607, metadata=notes)
    output.write_frames(tmp_path / "b.tif", stack, *kind, pixel_mm=0.00607, metadata=notes)
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()
    with tifffile.TiffFile(tmp_path / "a.tif") as tif:
        assert tif.series[0].axes == "TYX" and tif.imagej_metadata["Info"] == "by hand"
    # The resolution is stored as a ratio of 32-bit integers: 1e-6 is far above its rounding.
    assert open_tiff(tmp_path / "a.tif").pixel_mm == pytest.approx(0.00607, rel=1e-6)


def test_stack_beyond_imagejs_limit_becomes_bigtiff_with_the_same_scale(tmp_path, monkeypatch):
    monkeypatch.setattr(output.imagej, "IMAGEJ_LIMIT", 10)
    output.write_tiff(tmp_path / "b.tif", np.ones((2, 3, 4), np.float32), pixel_mm=0.01)
    with tifffile.TiffFile(tmp_path / "b.tif") as tif:
        assert tif.is_bigtiff and tif.asarray().shape == (2, 3, 4)
    assert open_tiff(tmp_path / "b.tif").pixel_mm == pytest.approx(0.01, rel=1e-6)


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_colour_frames_come_back_with_their_scale_and_8_bit_ones_in_imagejs_layout(
    tmp_path, dtype, count
):
    stack = np.arange(count * 5 * 7 * 3).reshape(count, 5, 7, 3).astype(dtype)
    output.write_tiff(tmp_path / "c.tif", stack, pixel_mm=0.01, photometric="rgb")
    with pytest.raises(InputError, match="frame"):
        output.write_tiff(tmp_path / "d.tif", stack[..., 0], photometric="rgb")
    with tifffile.TiffFile(tmp_path / "c.tif") as tif:
        assert {int(page.photometric) for page in tif.pages} == {2}  # RGB
        assert tif.is_imagej == (dtype is np.uint8)
        np.testing.assert_array_equal(np.stack([page.asarray() for page in tif.pages]), stack)
    assert open_tiff(tmp_path / "c.tif").pixel_mm == pytest.approx(0.01, rel=1e-6)


def test_dots_per_inch_are_no_scale(tmp_path):
    tifffile.imwrite(
        tmp_path / "dpi.tif", np.zeros((4, 5), np.uint8), resolution=(72, 72), resolutionunit="INCH"
    )
    assert open_tiff(tmp_path / "dpi.tif").pixel_mm is None


def test_failed_stream_leaves_nothing_and_keeps_the_old_file(tmp_path):
    output.write_text(tmp_path / "s.tif", "old")

    def frames():
        yield np.zeros((3, 4), np.uint8)
        raise RuntimeError("the source is gone")

    with pytest.raises(RuntimeError, match="gone"):
        output.write_frames(tmp_path / "s.tif", frames(), (2, 3, 4), np.dtype(np.uint8))
    assert [p.name for p in tmp_path.iterdir()] == ["s.tif"]
    assert (tmp_path / "s.tif").read_text() == "old"


@pytest.mark.parametrize(
    "bad", [np.zeros((2, 3)), np.zeros((0, 3, 4), np.uint8), np.zeros((1, 2, 3), np.int32)]
)
def test_stack_of_wrong_form_is_refused(tmp_path, bad):
    with pytest.raises(InputError, match=r"bad\.tif"):
        output.write_tiff(tmp_path / "bad.tif", bad)
    assert not list(tmp_path.iterdir())


def test_staged_results_appear_together_or_not_at_all(tmp_path):
    with pytest.raises(ZeroDivisionError), output.staged(tmp_path / "out") as stage:  # noqa: PT012
        output.write_text(stage / "a.txt", "half")
        _ = 1 / 0
    assert not (tmp_path / "out").exists()
    with output.staged(tmp_path / "out") as stage:
        output.write_text(stage / "a.txt", "whole")
        output.write_csv(stage / "sub.csv", {"n": [1]})
        assert not (tmp_path / "out" / "a.txt").exists()
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["a.txt", "sub.csv"]


def test_failed_stage_keeps_a_folder_that_was_there(tmp_path):
    output.write_text(tmp_path / "mine.txt", "mine")
    with pytest.raises(KeyError), output.staged(tmp_path):
        raise KeyError
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


def test_output_folder_refuses_a_file(tmp_path):
    output.write_text(tmp_path / "file", "")
    for bad in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(InputError, match="name another"):
            output.output_folder(bad)
    assert output.output_folder(tmp_path / "a" / "b").is_dir()


def test_writing_into_a_missing_folder_or_over_a_folder_is_refused(tmp_path):
    for bad in (tmp_path / "none" / "a.txt", tmp_path):
        with pytest.raises(InputError, match="cannot be written"):
            output.write_text(bad, "x")


def test_json_takes_numpy_and_makes_nan_null(tmp_path):
    obj = {"a": np.float32(0.5), "b": [np.nan, np.inf, np.int64(3)], "c": np.eye(2), "d": Path("x")}
    output.write_json(tmp_path / "o.json", obj)
    back = json.loads((tmp_path / "o.json").read_text())
    assert back == {"a": 0.5, "b": [None, None, 3], "c": [[1, 0], [0, 1]], "d": "x"}


@SAME_FOLDER
@given(values=st.lists(st.floats(allow_infinity=False, width=64), min_size=1, max_size=8))
def test_table_comes_back_to_nine_digits_with_nan_as_empty(tmp_path, values):
    output.write_csv(tmp_path / "t.csv", {"depth_um": values, "name": [f"a{v}" for v in values]})
    back = output.read_csv(tmp_path / "t.csv")
    # Nine significant digits: half a unit in the ninth is 5e-9 at most.
    np.testing.assert_allclose(back["depth_um"], values, rtol=5e-9, atol=0)
    assert back["name"] == [f"a{v}" for v in values]
    if np.isnan(values[0]):
        assert (tmp_path / "t.csv").read_text().splitlines()[1].startswith(",")


def test_table_with_unequal_columns_or_rows_is_refused(tmp_path):
    with pytest.raises(InputError, match="differ in length"):
        output.write_csv(tmp_path / "t.csv", {"a": [1], "b": [1, 2]})
    (tmp_path / "t.csv").write_text("a,b\n1,2\n3\n")
    with pytest.raises(InputError, match="line 3"):
        output.read_csv(tmp_path / "t.csv")


def test_table_put_together_of_parts_is_the_one_written_at_once(tmp_path):
    x = np.array([1 / 3, np.nan, 2e-9, -4.0])
    names = ['a "quoted" one', "b, c", "d", "e"]
    output.write_csv(tmp_path / "once.csv", {"x_mm": x.tolist(), "name": names})
    text = "".join(
        output.csv_text({"x_mm": x[part], "name": names[part]}, header=part.start == 0)
        for part in (slice(0, 1), slice(1, 2), slice(2, 4))
    )
    assert text.encode() == (tmp_path / "once.csv").read_bytes()


def test_failed_table_leaves_nothing_and_keeps_the_old_one(tmp_path):
    output.write_text(tmp_path / "t.csv", "old")
    with pytest.raises(InputError, match=r"t\.csv"):
        output.write_csv(tmp_path / "t.csv", {"a": [1], "b": [1, 2]})

    class Broken:
        def __str__(self):
            raise RuntimeError("it has no text")

    with pytest.raises(RuntimeError, match="no text"):
        output.write_csv(tmp_path / "t.csv", {"a": [1, Broken()]})
    assert [p.name for p in tmp_path.iterdir()] == ["t.csv"]
    assert (tmp_path / "t.csv").read_text() == "old"


def test_figure_is_a_png_without_pyplot(tmp_path):
    from matplotlib.figure import Figure

    figure = Figure(figsize=(1, 1))
    figure.subplots().plot([0, 1])
    output.write_figure(tmp_path / "f.png", figure)
    assert (tmp_path / "f.png").read_bytes().startswith(b"\x89PNG")


def test_provenance_names_version_scene_seed_and_hashes(tmp_path):
    (tmp_path / "a.txt").write_bytes(b"abc")
    record = output.provenance("[specimen]", [tmp_path], seed=3)
    assert record["scene"] == "[specimen]" and record["seed"] == 3
    # SHA-256 of "abc", from FIPS 180-2, appendix B.1.
    assert record["inputs_sha256"][str(tmp_path / "a.txt")].startswith("ba7816bf8f01cfea414140de")
    with pytest.raises(InputError, match=r"none\.tif"):
        output.provenance(None, [tmp_path / "none.tif"])


def test_a_table_that_a_spreadsheet_saved_has_its_first_column(tmp_path):
    """Excel writes a byte-order mark before UTF-8, CR and LF, and empty lines at the end."""
    (tmp_path / "t.csv").write_bytes(b"\xef\xbb\xbfx_mm,Gr\xc3\xb6\xc3\x9fe\r\n1,2.5\r\n3,\r\n\r\n")
    table = output.read_csv(tmp_path / "t.csv")
    assert list(table) == ["x_mm", "Größe"] and table["x_mm"] == [1.0, 3.0]
    np.testing.assert_array_equal(table["Größe"], [2.5, np.nan])


@pytest.mark.parametrize(
    ("unit", "mm"), [("mm", 1.0), ("cm", 10.0), ("m", 1e3), ("micron", 1e-3), ("nm", 1e-6)]
)
def test_imagejs_units_become_millimetres(tmp_path, unit, mm):
    """Four pixels a unit: a quarter of it is a pixel's side."""
    tifffile.imwrite(
        tmp_path / "s.tif", np.zeros((2, 4, 5), np.uint8), imagej=True, resolution=(4, 4),
        metadata={"axes": "TYX", "unit": unit},
    )  # fmt: skip
    assert open_tiff(tmp_path / "s.tif").pixel_mm == pytest.approx(0.25 * mm, rel=1e-6)


def test_pixels_of_no_size_have_no_scale_and_those_that_are_not_square_are_refused(tmp_path):
    path, image = tmp_path / "s.tif", np.zeros((4, 5), np.uint8)
    tifffile.imwrite(path, image, resolution=(0, 0), resolutionunit="CENTIMETER")
    assert open_tiff(path).pixel_mm is None
    tifffile.imwrite(path, image, resolution=(4, 5), resolutionunit="CENTIMETER")
    with pytest.raises(InputError, match="4 pixels a unit across and 5 down"):
        open_tiff(path)


def test_a_stage_that_cannot_give_all_files_their_places_puts_the_old_ones_back(tmp_path):
    """The last file is to go into a folder whose name a file of the user's has."""
    output.write_text(tmp_path / "a.txt", "old")
    output.write_text(tmp_path / "z", "mine")
    with pytest.raises(OSError, match="z"), output.staged(tmp_path) as stage:  # noqa: PT012
        output.write_text(stage / "a.txt", "new")
        output.write_text(stage / "b.txt", "new")
        (stage / "z").mkdir()
        output.write_text(stage / "z" / "c.txt", "new")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.txt", "z"]
    assert (tmp_path / "a.txt").read_text() == "old"
    assert (tmp_path / "z").read_text() == "mine"
