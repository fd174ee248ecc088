"""A file is what its first bytes say, whatever it is called."""

import io

import numpy as np
import pytest
import tifffile
from PIL import Image

from isochrome.errors import InputError
from isochrome.frames import load_mask, open_frames, recordings_of
from isochrome.scene import parse_scene
from refusals import refusal

GREY = (np.arange(40 * 60).reshape(40, 60) * 7 % 251).astype(np.uint8)


def saved(kind):
    """The picture as a file of a kind: its bytes."""
    data = io.BytesIO()
    if kind == "TIFF":
        tifffile.imwrite(data, GREY)
    else:
        options = (
            {"lossless": True} if kind == "WEBP" else {"quality": 95} if kind == "JPEG" else {}
        )
        image = Image.fromarray(GREY)
        (image.convert("RGB") if kind == "WEBP" else image).save(data, kind, **options)
    return data.getvalue()


@pytest.mark.parametrize("kind", ["TIFF", "PNG", "BMP", "JPEG", "PPM", "WEBP"])
@pytest.mark.parametrize("name", ["a.tif", "a.jpg", "a.png", "a.bmp", "a.webp", "a.avi", "a.pgm"])
def test_a_picture_is_read_as_what_it_is_under_any_name(tmp_path, kind, name):
    (tmp_path / name).write_bytes(saved(kind))
    with open_frames(tmp_path / name) as reader:
        (frame,) = reader
    decoded = np.asarray(Image.open(io.BytesIO(saved("JPEG"))))  # lossy: as Pillow does it
    expected = decoded if kind == "JPEG" else GREY
    np.testing.assert_array_equal(frame.image, expected)


def test_a_stack_and_a_folder_of_misnamed_files_are_read(tmp_path):
    stack = np.stack([GREY, GREY[::-1], GREY[:, ::-1]])
    tifffile.imwrite(tmp_path / "f.tif", stack, photometric="minisblack")
    (tmp_path / "f.tif").rename(tmp_path / "f.jpg")
    with open_frames(tmp_path / "f.jpg") as reader:
        assert reader.count() == 3
        np.testing.assert_array_equal([f.image for f in reader], stack)
    (tmp_path / "g.png").write_bytes((tmp_path / "f.jpg").read_bytes())
    names = [tmp_path / "f.jpg", tmp_path / "g.png"]
    assert len(recordings_of(names)) == 2  # two stacks are a recording each
    mixed = tmp_path / "mixed"
    mixed.mkdir()
    for name, kind in (("1.tif", "PNG"), ("2.png", "TIFF"), ("3.jpg", "BMP")):
        (mixed / name).write_bytes(saved(kind))
    with open_frames(mixed) as reader:
        np.testing.assert_array_equal([f.image for f in reader], [GREY] * 3)


def test_a_mask_is_what_it_is_and_a_jpeg_is_refused_under_another_name(tmp_path):
    scene = parse_scene('[specimen]\n[frames]\nmask = "mask.jpg"\n', folder=tmp_path)
    inside = (GREY > 100).astype(np.uint8)
    tifffile.imwrite(tmp_path / "m.tif", inside)
    (tmp_path / "m.tif").rename(tmp_path / "mask.jpg")
    np.testing.assert_array_equal(load_mask(scene, GREY.shape, GREY.shape), inside > 0)
    (tmp_path / "mask.jpg").write_bytes(saved("JPEG"))
    (tmp_path / "mask.jpg").rename(tmp_path / "mask.png")
    lossy = parse_scene('[specimen]\n[frames]\nmask = "mask.png"\n', folder=tmp_path)
    with pytest.raises(InputError, match=r"mask\.png: frames\.mask is compressed with loss"):
        load_mask(lossy, GREY.shape, GREY.shape)


@pytest.mark.parametrize(
    ("data", "seems"),
    [
        (b"%PDF-1.7\n" + bytes(90), "a PDF document"), (b"PK\x03\x04" + bytes(90), "a ZIP archive"),
        (b"\x89HDF\r\n\x1a\n" + bytes(90), "HDF5 data"), (b"GIF89a" + bytes(90), "a GIF"),
        (b"\x89PNG\n\x1a\n" + bytes(90), "a PNG that was changed on its way"),
        (b"\x00\x00\x00\x18ftypheic" + bytes(90), "a HEIF or AVIF photograph"),
        (b"load_n, frame\n44, a.tif\n", "a text that begins 'load_n,'"),
        ("Grüße aus dem Labor\n".encode(), "a text that begins 'Grüße'"),
        (b"<!DOCTYPE html>", "a web page or XML"), (bytes(600), "nothing but zeros"),
        (b"\x01\x02\x03\xfe\xff\xf0\xf1\xf2" + bytes(90), "first bytes 01 02 03 fe"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("name", ["a.tif", "a.jpg", "a.avi"])
def test_a_file_that_is_no_picture_is_refused_with_what_it_seems_to_be(tmp_path, data, seems, name):
    (tmp_path / name).write_bytes(data)
    said = refusal(lambda: list(open_frames(tmp_path / name)))
    assert said.startswith(f"{tmp_path / name}: is not an image") and seems in said
    assert "check the file" in said
