"""Each recording's folder has a name of its own, which leads nowhere else."""

import unicodedata
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from isochrome.campaigns import SUMMARIES, folder_names

TEXT = st.text(
    st.sampled_from("aAéẞßǆ.- _:*?\\<|\x07\udc80") | st.characters(blacklist_characters="/\x00"),
    max_size=8,
)


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (["run 1.avi", "Läufe 場.mkv"], ["run 1", "Läufe 場"]),
        (["a/film.avi", "b/film.avi", "b/other.avi"], ["a-film", "b-film", "other"]),
        (["a/film.avi", "b/FILM.mkv"], ["a-film", "b-FILM"]),
        (["a/film.avi", "a/film.mkv"], ["a-film", "a-film-2"]),
        (["x/a/film.avi", "y/a/film.avi", "y/a-film.avi"], ["a-film", "a-film-2", "a-film-3"]),
        (["summary.csv.avi", "con.avi", "a.partial.avi"], ["_summary.csv", "_con", "a_partial"]),
        (["...avi", ". .avi", "../..avi"], ["recording", "recording-2", "recording-3"]),
        (["a:b?.avi", "nul.x.avi"], ["a_b_", "_nul.x"]),
    ],
)
def test_names(files, names, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = folder_names(files)
    # those without letters of their own are told apart by where they are
    expected = [n if "recording" not in n else found[i] for i, n in enumerate(names)]
    assert list(found) == expected
    assert len(set(found)) == len(found)


@pytest.mark.parametrize("letter", ["n", "é", "場"])
def test_long_names_leave_room_for_what_is_put_after_them(letter, tmp_path):
    """A file system takes 255 bytes, of which a working folder's ending needs some."""
    long = 251 // len(letter.encode()) * letter  # and .avi: as long as a file's name can be
    found = folder_names([f"a/{long}.avi", f"a/{long}.mkv", f"b/{long}.avi", f"c/{long}m.avi"])
    assert len(set(found)) == 4
    for name in found:
        assert letter * 60 in name
        (tmp_path / f"{name}.partial").mkdir()


def test_a_folder_keeps_what_looks_like_an_ending(tmp_path):
    (tmp_path / "2024.01.05").mkdir()
    assert folder_names([tmp_path / "2024.01.05"]) == ("2024.01.05",)


def test_accents_in_two_spellings_are_one_name():
    composed, apart = (unicodedata.normalize(form, "é") for form in ("NFC", "NFD"))
    one, two = folder_names([f"x/{composed}.avi", f"y/{apart}.avi"])
    assert (one[0], two[0]) == ("x", "y")


@given(st.lists(st.tuples(st.sampled_from(["", "a/", "b/", "../"]), TEXT), min_size=1, max_size=6))
def test_any_names_give_plain_ones_all_different(parts):
    found = folder_names([f"{folder}{stem}.avi" for folder, stem in parts])
    keys = {unicodedata.normalize("NFC", name).casefold() for name in found}
    assert len(keys) == len(parts)
    for name in found:
        assert Path(name).name == name and name not in ("", ".", "..")
        assert not set(name) & set('<>:"/\\|?*\x00') and name == name.strip(" .")
        assert not name.casefold().endswith(".partial") and name.casefold() not in SUMMARIES
        assert len(f"{name}.partial".encode()) <= 255
