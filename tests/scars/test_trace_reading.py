"""Traces as profilometers' programs write them, and what is none."""

import re

import numpy as np
import pytest

from isochrome.errors import InputError
from isochrome.scars import Trace, read_trace
from refusals import refusal

X = np.linspace(0.0, 6.0, 121)
Z = np.sin(X) - 1.5


def table(head, cell, *, x=X, z=Z):
    return head + "\n".join(cell.format(a, b) for a, b in zip(x, z, strict=True)) + "\n"


def comma(text):
    """A table's text with decimal commas."""
    head, sep, body = text.partition("\n")
    return head + sep + body.replace(".", ",")


FORMS = {
    "the issue's own": table("x_mm,z_um\n", "{:.4f},{:.5f}"),
    "other columns beside": table("n,z_um,x_mm\n", "7,{1:.5f},{0:.4f}"),
    "blanks and other units": table("x_um z_nm\n", "{0:.4f}e3   {1:.5f}e3"),
    "mm": table("x_mm,z_mm\n", "{:.4f},{:.5f}e-3"),
    "m": table("x_m;z_m\n", "{:.4f}e-3;{:.5f}e-6"),
    "brackets": table("Messung 7\n\nX [mm];Z [µm]\n", "{:.4f};{:.5f}"),
    "decimal comma": comma(table("Position (mm);Height (um)\n", "{:.4f};{:.5f}")),
    "tabs, a line of units": comma(table("Position\tHeight\n", "{:.4f}\t{:.5f}")).replace(
        "\n", "\nmm\tµm\n", 1
    ),
    "comments": "# a scar\nx_mm, z_um\n# begin\n" + table("", "{:.4f}, {:.5f}"),
    "quotes": table('"x_mm","z_um"\n', '"{:.4f}","{:.5f}"'),
    "from right to left": table("x_mm,z_um\n", "{:.4f},{:.5f}", x=X[::-1], z=Z[::-1]),
    "windows": table("x_mm,z_um\n", "{:.4f},{:.5f}").replace("\n", "\r\n"),
}


@pytest.mark.parametrize("name", FORMS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_a_trace_is_read_in_the_forms_that_programs_write(tmp_path, name, encoding):
    path = tmp_path / "trace.csv"
    path.write_bytes(FORMS[name].encode(encoding))
    found = read_trace(path)
    np.testing.assert_allclose(found.x_mm, X, atol=1e-4)
    np.testing.assert_allclose(found.z_um, Z, atol=1e-5)
    assert found.name == str(path)


SDF = (
    "{}\nManufacID = Sine\nNumPoints = {}\nNumProfiles = {}\nXscale = 5e-5\nYscale = 0\n"
    "Zscale = 1.0e-9\nZresolution = 0\nDataType = 5\nCheckType = 0\n*\n{}\n*\n"
)


@pytest.mark.parametrize("version", ["aBCR-1.0", "aBC-1.0", "aISO-1.0"])
def test_a_profile_in_the_ascii_form_of_iso_25178_71_is_read(tmp_path, version):
    """Heights times Zscale and points times Xscale, in metres."""
    path = tmp_path / "trace.sdf"
    heights = np.rint(1e3 * Z).astype(int)
    path.write_text(SDF.format(version, len(X), 1, "\n".join(map(str, heights))), "utf-8")
    found = read_trace(path)
    np.testing.assert_allclose(found.x_mm, X, atol=1e-12)
    np.testing.assert_allclose(found.z_um, 1e-3 * heights, atol=1e-12)


SDF_WRONG = {
    "an area": (("aISO-1.0", 121, 4, "1 " * 121), "holds 4 profiles"),
    "too few": (("aISO-1.0", 121, 1, "1 " * 120), "has 120 heights where its head says 121"),
    "not measured": (("aISO-1.0", 121, 1, "1 " * 120 + "BAD"), "'BAD' among its heights"),
    "no count": (("aISO-1.0", "many", 1, "1"), "is no number"),
}


@pytest.mark.parametrize("name", SDF_WRONG)
def test_an_sdf_file_that_is_no_profile_is_refused(tmp_path, name):
    parts, what = SDF_WRONG[name]
    path = tmp_path / "trace.sdf"
    path.write_text(SDF.format(*parts), "utf-8")
    with pytest.raises(InputError, match=what):
        read_trace(path)


GOOD = FORMS["the issue's own"]
WRONG = {
    "empty": ("", "is empty"),
    "text": ("The scar of the block\nwas deep.\n", "no line of numbers"),
    "text in a cell": (GOOD.replace("3.0000,", "deep,"), "line 62 has 'deep'"),
    "a cell that is not there": (GOOD.replace("3.0000,", ""), "line 62 has ''"),
    "not a number": (GOOD.replace("3.0000,", "nan,"), "line 62 has 'nan'"),
    "no names": (GOOD.partition("\n")[2], "no line names its columns"),
    "no units": (GOOD.replace("x_mm", "x"), "'x' has no unit"),
    "two traces": (GOOD.replace("x_mm,", "x_mm,z_um,"), "several columns"),
    "one point": ("x_mm,z_um\n0.0,1.0\n", "has 1 points"),
    "µm for mm": (table("x_mm,z_um\n", "{:.4f}e3,{:.5f}"), "is 6000 mm long"),
    "mm for µm": (table("x_um,z_um\n", "{:.4f},{:.5f}"), "is 0.006 mm long"),
    "heights in µm for mm": (table("x_mm,z_mm\n", "{:.4f},{:.5f}"), "heights span 2000 µm"),
    "back and forth": (GOOD.replace("3.0000,", "2.5000,"), "must go one way"),
    "a gap": (table("x_mm,z_um\n", "{:.4f},{:.5f}", x=X + 2.0 * (X > 3.0)), "a gap of over 5 %"),
    "no text": ("x_mm,z_um\n\x00\x01\n", "is no text"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_trace_is_refused_in_a_line_that_names_the_file(tmp_path, name):
    text, what = WRONG[name]
    path = tmp_path / "trace.csv"
    path.write_text(text, "utf-8")
    sentence = refusal(read_trace, path)
    assert sentence.startswith(str(path)) and re.search(what, sentence)


def test_files_that_are_none_or_far_too_large_are_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_trace(tmp_path / "missing.csv")
    with pytest.raises(InputError, match="is not a file"):
        read_trace(tmp_path)
    huge = tmp_path / "huge.csv"
    with huge.open("wb") as file:
        file.truncate(20_000_000)
    with pytest.raises(InputError, match="larger than"):
        read_trace(huge)


def test_arrays_are_checked_as_files_are():
    with pytest.raises(InputError, match="121 places and 120 heights"):
        Trace(x_mm=X, z_um=Z[1:])
    with pytest.raises(InputError, match="point 5"):
        Trace(x_mm=X, z_um=np.where(np.arange(121) == 4, np.inf, Z))
