"""One contract for all readers: the right frame, its time and its bit depth, or a refusal."""

import importlib
import pickle
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from recordings import COLS, COUNT, MOVING, ROWS, STILL, coded, decoded, packed_tiff, video

from isochrome.errors import InputError
from isochrome.frames import open_frames

RANGES = ((0, 0), (0, 1), (5, 9), (8, 8 + 9), (16, 19), (31, COUNT), (COUNT - 1, COUNT), (3, 4))
"""Within a group of frames of one key frame (8 frames), at it, over it, at the files' ends."""

QUICK = (
    "OpenCV's MJPG in AVI", "FFV1 10 bit", "FFV1 16 bit", "H.264 in MP4, uneven", "H.264 in AVI",
    "glob of H.264 with B-frames in AVI", "folder of FFV1 16 bit",
)  # fmt: skip
VIDEOS = [n if n in QUICK else pytest.param(n, marks=pytest.mark.long) for n in MOVING]


def same(a, b):
    return (
        (a.index, a.time_s, a.name) == (b.index, b.time_s, b.name)
        and a.image.dtype == b.image.dtype
        and np.array_equal(a.image, b.image)
    )


def check_contract(recording, path):
    full = 1.0 if recording.bits is None else 2.0**recording.bits - 1
    with open_frames(path) as reader:
        assert (reader.kind, reader.shape, reader.bit_depth) == (
            recording.kind, (ROWS, COLS), recording.bits,
        )  # fmt: skip
        frames = list(reader)
        assert [decoded(f.image, full) for f in frames] == list(range(COUNT))
        assert [f.index for f in frames] == list(range(COUNT))
        assert all(f.image.dtype == reader.dtype and f.image.shape == reader.shape for f in frames)
        if recording.times is None:
            assert {f.time_s for f in frames} == {None}
        else:  # containers round to a millisecond
            assert [f.time_s for f in frames] == pytest.approx(list(recording.times), abs=1.01e-3)
        for f in frames:
            wanted = coded(f.index, full)
            if recording.exact:
                np.testing.assert_array_equal(f.image, wanted.astype(reader.dtype))
            else:  # a lossy codec's error, and rounding on the way to it: under 3 % of full scale
                inner = np.s_[ROWS // 2 : -8, 8:24]
                assert abs(float(f.image[inner].mean()) - wanted[inner].mean()) < 0.03 * full
        if reader.kind in ("folder", "list"):
            assert [Path(name).stem for name in reader.names] == [f"frame{i}" for i in range(COUNT)]
        if recording.pixel_mm is not None:
            assert reader.pixel_mm == pytest.approx(recording.pixel_mm, rel=1e-5)
        # any part of it, by a reader that has not counted, by those that have, and by a copy
        assert all(same(a, b) for a, b in zip(reader, frames, strict=True)), "reads again"
        fresh, listed = (pickle.loads(pickle.dumps(reader)) for _ in range(2))
        assert reader.count() == COUNT and listed.count(decode=False) == COUNT
        assert all(same(a, b) for a, b in zip(listed, frames, strict=True)), "as listed"
        for one in (fresh, reader, listed, pickle.loads(pickle.dumps(reader))):
            assert all(0 <= one.first_decoded(start) <= start for start, _ in RANGES)
            for start, stop in RANGES:
                part = list(one.iterate(start, stop))
                assert len(part) == stop - start
                assert all(same(a, b) for a, b in zip(part, frames[start:stop], strict=True))
        with pytest.raises(InputError, match="ends before frame"):
            list(reader.iterate(COUNT - 2, COUNT + 1))


@pytest.mark.parametrize("name", STILL)
def test_stills_keep_the_contract(name, tmp_path):
    check_contract(STILL[name], STILL[name].write(tmp_path))


@pytest.mark.parametrize("name", VIDEOS)
def test_videos_keep_the_contract(name, tmp_path):
    check_contract(MOVING[name], MOVING[name].write(tmp_path))


LISTED = {
    "rawvideo": "avi", "ffv1": "mkv", "mjpeg": "avi", "png": "mov", "huffyuv": "avi",
    "ffvhuff": "avi", "utvideo": "avi", "libx264": "mp4",
}  # fmt: skip
PIXELS = {"rawvideo": "gray", "ffv1": "gray16le", "mjpeg": "yuvj420p", "huffyuv": "yuv422p",
          "utvideo": "gbrp", "libx264": "yuv420p"}  # fmt: skip


@pytest.mark.parametrize("codec", LISTED)
def test_packets_that_are_frames_are_counted_without_decoding(codec, tmp_path, monkeypatch):
    path = video(tmp_path / f"v.{LISTED[codec]}", codec, PIXELS.get(codec, "rgb24"))
    module = importlib.import_module("isochrome.frames.video")
    with open_frames(path) as reader, monkeypatch.context() as patch:
        patch.setattr(module, "decoded", None)
        assert reader.count(decode=False) == COUNT
        # the others have no frame that needs another; here each eighth of these
        assert reader.first_decoded(21) == (16 if codec in ("ffv1", "libx264") else 21)


@pytest.mark.parametrize(
    ("name", "codec"), [("v.mkv", "ffv1"), ("v.avi", "rawvideo"), ("v.mkv", "libx265")]
)
def test_what_is_done_to_a_frame_does_not_come_back_in_another(name, codec, tmp_path):
    """The decoder goes on from the pictures that it has given out."""
    path = video(tmp_path / name, codec, "gray", options={"x265-params": "log-level=none"})
    wanted = [frame.image.copy() for frame in open_frames(path)]
    for frame, whole in zip(open_frames(path), wanted, strict=True):
        np.testing.assert_array_equal(frame.image, whole)
        frame.image[...] = 0


@pytest.mark.parametrize(("pixels", "bits"), [("yuv420p", 8), ("yuv422p10le", 10)])
def test_levels_between_black_and_white_are_spread_over_all(pixels, bits, tmp_path):
    """Black at 16 and white at 235 of 255: ITU-R BT.601-7."""
    stored = np.arange(COLS * ROWS) * 7919 % 2**bits
    spread = [Fraction(int(y) - (16 << bits - 8), 219 << bits - 8) for y in range(2**bits)]
    wanted = np.array([round(min(max(s, 0), 1) * (2**bits - 1)) for s in spread])
    path = tmp_path / "v.mkv"
    write_luminance(path, stored.reshape(ROWS, COLS), pixels, bits)
    (frame,) = open_frames(path)
    np.testing.assert_array_equal(frame.image, wanted[stored].reshape(ROWS, COLS))


def write_luminance(path, luminance, pixels, bits):
    """One frame of FFV1 without colour, its luminance as given."""
    import av

    dtype = np.uint8 if bits == 8 else np.uint16
    with av.open(str(path), "w") as out:
        stream = out.add_stream("ffv1", rate=10)
        stream.width, stream.height, stream.pix_fmt = COLS, ROWS, pixels
        frame = av.VideoFrame(COLS, ROWS, pixels)
        for plane, values in zip(
            frame.planes, (luminance, 1 << bits - 1, 1 << bits - 1), strict=True
        ):
            rows = np.zeros((plane.height, plane.line_size // np.dtype(dtype).itemsize), dtype)
            rows[:, : plane.width] = values
            plane.update(rows.tobytes())
        out.mux(stream.encode(frame))
        out.mux(stream.encode(None))


def test_a_packet_that_is_no_frame_shows_when_it_is_read(tmp_path):
    path = video(tmp_path / "v.avi", "mjpeg", "yuvj420p")
    data, at = bytearray(path.read_bytes()), -1
    for _ in range(6):
        at = data.index(b"\xff\xd8\xff", at + 1)  # the head of the sixth picture
    data[at : at + 800] = bytes(800)
    path.write_bytes(data)
    with open_frames(path) as reader:
        assert reader.count(decode=False) == COUNT
        with pytest.raises(InputError, match=r"v\.avi: .*frame 5"):
            list(reader)
        with pytest.raises(InputError, match=r"v\.avi: .*frame 5"):
            list(reader.iterate(5, 7))


# 100 % colour bars, (Y, Cb, Cr) of red, green and blue: ITU-R BT.601-7 and BT.709-6, 8 bits
BARS = {
    "601": ((81, 90, 240), (145, 54, 34), (41, 240, 110)),
    "709": ((63, 102, 240), (173, 42, 26), (32, 240, 118)),
}


@pytest.mark.parametrize("pixels", ["yuv444p", "yuv420p", "yuv422p10le"])
@pytest.mark.parametrize("space", BARS)
def test_colours_of_a_video_are_those_of_the_standard(tmp_path, space, pixels):
    import av

    deep = 2 if "10" in pixels else 0
    with av.open(str(tmp_path / "v.mkv"), "w") as out:
        stream = out.add_stream("ffv1", rate=10)
        stream.width, stream.height, stream.pix_fmt = COLS, ROWS, pixels
        stream.codec_context.colorspace = {"601": 6, "709": 1}[space]
        for bar in BARS[space]:
            frame = av.VideoFrame(COLS, ROWS, pixels)
            frame.colorspace = stream.codec_context.colorspace
            for plane, value in zip(frame.planes, bar, strict=True):
                dtype = np.uint16 if deep else np.uint8
                plane.update(np.full(plane.buffer_size // (1 + deep // 2), value << deep, dtype))
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    top = 255 << deep | (3 if deep else 0)
    for k, name in enumerate(("red", "green", "blue")):
        levels = [f.image for f in open_frames(tmp_path / "v.mkv", channel=name)]
        assert all(np.ptp(level) == 0 for level in levels)
        # the bars' own numbers are rounded: one level of luminance, two of chrominance
        wanted = [top if i == k else 0 for i in range(3)]
        assert [int(level[0, 0]) for level in levels] == pytest.approx(wanted, abs=0.012 * top)


@pytest.mark.parametrize("bits", [10, 12])
def test_packed_pixels_of_the_other_fill_order_are_refused(tmp_path, bits):
    """With the lowest bit first the same bytes are other grey levels."""
    with pytest.raises(InputError, match=rf"packs {bits}-bit pixels in a way that is not read"):
        list(open_frames(packed_tiff(bits, fill=2)(tmp_path)))
