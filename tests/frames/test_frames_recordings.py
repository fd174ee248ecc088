"""Which recordings names stand for, told without decoding a video."""

import numpy as np
import pytest

from isochrome.errors import InputError
from isochrome.frames import one_recording, open_frames, recordings_of
from isochrome.output import write_tiff

IMAGE = np.full((1, 8, 9), 7, np.uint8)


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Videos that nobody could decode, stacks, single images, a folder."""
    monkeypatch.chdir(tmp_path)
    for name in ("run1.avi", "run2.avi", "run10.avi", "other.mkv", "notes.txt"):
        (tmp_path / name).write_bytes(b"no video")
    for name in ("stack1.tif", "stack2.tif", "stack10.tif"):
        write_tiff(tmp_path / name, np.repeat(IMAGE, 3, 0))
    for name in ("img1.tif", "img2.tif", "img10.tif"):
        write_tiff(tmp_path / name, IMAGE)
    (tmp_path / "folder").mkdir()
    (tmp_path / "second.d").mkdir()
    return tmp_path


def found(*names, join=False):
    return [
        [str(p) for p in r] if isinstance(r, tuple) else str(r)
        for r in recordings_of(names, join=join)
    ]


@pytest.mark.parametrize(
    ("names", "recordings"),
    [
        (["run*.avi"], ["run1.avi", "run2.avi", "run10.avi"]),
        (["run1.avi", "run10.avi", "run2.avi"], ["run1.avi", "run2.avi", "run10.avi"]),
        (["run2.avi", "run1.avi"], ["run2.avi", "run1.avi"]),
        (["stack*.tif"], ["stack1.tif", "stack2.tif", "stack10.tif"]),
        (["other.mkv", "stack1.tif"], ["other.mkv", "stack1.tif"]),
        (["run1.avi", "run*.avi", "./run2.avi"], ["run1.avi", "run2.avi", "run10.avi"]),
        (["folder", "run1.avi"], ["folder", "run1.avi"]),
        (["second.d", "folder"], ["second.d", "folder"]), (["img*.tif"], ["img*.tif"]),
        (["img1.tif", "img10.tif", "img2.tif"], [["img1.tif", "img2.tif", "img10.tif"]]),
        (["img2.tif", "img1.tif"], [["img2.tif", "img1.tif"]]), (["run1.avi"], ["run1.avi"]),
        (["run1*.mkv", "run1.avi"], None), (["folder"], ["folder"]),
        (["missing.avi"], ["missing.avi"]),
        (["missing.avi", "run1.avi"], ["missing.avi", "run1.avi"]),
    ],
)  # fmt: skip
def test_names_of_recordings(place, names, recordings):
    if recordings is None:
        with pytest.raises(InputError, match=r"run1\*\.mkv: no such file"):
            found(*names)
    else:
        assert found(*names) == recordings


def test_a_stack_that_does_not_tell_goes_with_the_rest(place):
    whole = (place / "stack2.tif").read_bytes()
    (place / "stack2.tif").write_bytes(whole[: len(whole) // 2])
    (place / "stack3.tif").write_bytes(b"no TIFF")
    assert len(found("stack*.tif")) == 4
    (place / "img2.tif").write_bytes(b"no TIFF")
    assert found("img*.tif") == ["img*.tif"]


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["img1.tif", "stack1.tif"], "img1.tif: is a single image and stack1.tif a whole"),
        (["*.tif"], "is a single image"),
        (["img1.tif", "run1.avi"], "is a single image and run1.avi a whole recording"),
        (["img1.tif", "folder"], "is a single image and folder a whole recording"),
        (["run*.avi", "notes.txt"], "notes.txt: frames cannot be read from a file of this kind"),
        (["*"], "notes.txt: frames cannot be read"),
        ([], "no frames are named"),
    ],
)
def test_mixtures_are_refused(place, names, said):
    with pytest.raises(InputError, match=said):
        recordings_of(names)


def test_several_recordings_are_joined_or_refused_where_one_is_wanted(place):
    assert found("run*.avi", join=True) == ["run*.avi"]
    assert found("run2.avi", "run1.avi", join=True) == [["run2.avi", "run1.avi"]]
    assert found("run1.avi", "run10.avi", "run2.avi", join=True) == [
        ["run1.avi", "run2.avi", "run10.avi"]
    ]
    with pytest.raises(InputError, match="folder: is a folder, which is a recording by itself"):
        recordings_of(["folder", "run1.avi"], join=True)
    assert one_recording(["img*.tif"]) == "img*.tif"
    assert one_recording(["run*.avi"], join=True) == "run*.avi"
    with pytest.raises(InputError, match=r"run1\.avi, run2\.avi \.\.\.: 3 recordings.*--join"):
        one_recording(["run*.avi"])


def test_a_folder_among_the_images_of_a_glob_is_named(tmp_path):
    (tmp_path / "sub").mkdir()
    write_tiff(tmp_path / "one.tif", IMAGE)
    with pytest.raises(InputError, match="sub: frames cannot be read from a file of this kind"):
        open_frames(tmp_path / "*")
