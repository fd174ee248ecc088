"""Recordings that are cut off, damaged, growing, lying or not there: refused, in one sentence."""

import os
import struct
import tracemalloc
from contextlib import contextmanager
from fractions import Fraction
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from recordings import COLS, COUNT, EVEN, MOVING, ROWS, STILL, decoded, stack, video
from skimage.draw import polygon2mask

import isochrome.frames.video as decoding
from isochrome.errors import InputError
from isochrome.frames import open_frames, open_scene_frames
from isochrome.output import write_tiff
from isochrome.output.imagej import _filled
from isochrome.scene import parse_scene

FFV1 = MOVING["FFV1 grey"].write


def read_until_refused(path, full=255):
    """Numbers of the frames that come before the refusal, and its sentence (None: no refusal)."""
    numbers = []
    try:
        for frame in open_frames(path):
            numbers.append(decoded(frame.image, full))
    except InputError as error:
        return numbers, str(error)
    return numbers, None


CUT = ["MJPG in AVI", "uncompressed grey in AVI", "H.264 in AVI", "FFV1 grey", "FFV1 16 bit in AVI",
       "H.264 in MP4", "H.264 in MKV, uneven", "VP9, uneven", "PNG in MOV"]  # fmt: skip
SLOW = ("VP9, uneven", "PNG in MOV", "uncompressed grey in AVI", "FFV1 16 bit in AVI")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.long) if n in SLOW else n for n in CUT]
)
def test_a_video_that_breaks_off_is_never_read_as_a_whole_one(name, tmp_path, capfd):
    path = MOVING[name].write(tmp_path)
    data = path.read_bytes()
    for part in (0.02, 0.3, 0.55, 0.8, 0.97):
        path.write_bytes(data[: int(part * len(data))])
        numbers, reason = read_until_refused(path, 2 ** MOVING[name].bits - 1)
        assert reason is not None and path.name in reason and "\n" not in reason
        assert numbers == list(range(len(numbers)))
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("name", ["FFV1 grey", "VP9, uneven", "MJPG in AVI"])
def test_a_container_damaged_between_its_frames_is_refused(name, tmp_path):
    path = MOVING[name].write(tmp_path)
    data = bytearray(path.read_bytes())
    mark = b"00dc" if path.suffix == ".avi" else b"\x1f\x43\xb6\x75"
    place = data.find(mark, len(data) // 4 if path.suffix == ".avi" else 0)
    data[place : place + 4] = b"\0\0\0\0"
    path.write_bytes(data)
    numbers, reason = read_until_refused(path)
    assert numbers == [] and reason.startswith(f"{path}: is damaged at byte ")


def test_a_damaged_frame_is_named_and_not_made_up(tmp_path):
    path = MOVING["H.264 in MP4"].write(tmp_path)
    data = bytearray(path.read_bytes())
    key = data.find(b"mdat") + (len(data) - data.find(b"mdat")) // 2
    for k in range(key, key + 60):
        data[k] ^= 0x5A
    path.write_bytes(data)
    numbers, reason = read_until_refused(path)
    assert 0 < len(numbers) < COUNT and numbers == list(range(len(numbers)))
    assert f"frame {len(numbers)}" in reason


def lying_avi(folder, name):
    """An AVI whose heads claim 16000 frames, as some writers' do."""
    path = MOVING[name].write(folder)
    data = bytearray(path.read_bytes())
    for mark, skip in ((b"avih", 8 + 16), (b"strh", 8 + 32)):
        place = data.find(mark) + skip
        assert struct.unpack_from("<I", data, place) == (COUNT,)
        struct.pack_into("<I", data, place, 16000)
    path.write_bytes(data)
    return path


def test_frames_are_counted_and_heads_are_not_believed(tmp_path):
    path = lying_avi(tmp_path, "MJPG in AVI")
    reader = open_frames(path)
    assert (reader.count(), reader.claimed_count) == (COUNT, 16000)
    assert [decoded(f.image) for f in reader] == list(range(COUNT))


@pytest.mark.parametrize("name", ["H.264 in MKV, uneven", "FFV1 16 bit", "H.264 in AVI"])
def test_after_a_count_a_range_is_reached_from_the_key_frame_before_it(name, tmp_path, monkeypatch):
    reader, taken = open_frames(MOVING[name].write(tmp_path)), []
    reader.count()
    opened = decoding.open_container

    @contextmanager
    def noting(path):
        with opened(path) as (container, stream):
            packets = (taken.append(1) or packet for packet in container.demux(stream))
            yield SimpleNamespace(demux=lambda _: packets, seek=container.seek), stream

    monkeypatch.setattr(decoding, "open_container", noting)
    (frame,) = reader.iterate(30, 31)
    assert decoded(frame.image, 2**reader.bit_depth - 1) == 30
    # eight frames a key frame, some more for the codec to get going; not thirty
    assert len(taken) <= 20


@pytest.mark.parametrize("name", ["FFV1 16 bit", "FFV1 16 bit in AVI", "FFV1 RGB"])
def test_damaged_slices_of_ffv1_are_not_replaced_by_those_of_the_frame_before(name, tmp_path):
    """FFmpeg does so in silence; the slices' checksums tell."""
    import av

    path = MOVING[name].write(tmp_path)
    with av.open(str(path)) as container:
        places = [(p.pos, p.size) for p in container.demux(video=0) if p.size]
    whole = path.read_bytes()
    place, size = places[20]
    for part in (0.3, 0.6, 0.9):
        data = bytearray(whole)
        data[place + int(part * size)] ^= 0x10
        path.write_bytes(data)
        numbers, reason = read_until_refused(path, 2 ** MOVING[name].bits - 1)
        assert numbers == list(range(20)) and "frame 20 is damaged" in reason


def test_ffv1_without_checksums_is_read(tmp_path):
    path = video(tmp_path / "v.mkv", "ffv1", "gray", options={"level": "3", "slicecrc": "0"})
    assert read_until_refused(path) == (list(range(COUNT)), None)


def test_a_video_that_cannot_be_searched_is_read_from_its_start(tmp_path, monkeypatch):
    """As FFmpeg refuses to go to a key frame of a damaged index."""
    reader = open_frames(MOVING["H.264 in MP4"].write(tmp_path))
    reader.count()
    opened = decoding.open_container

    def refuse(*_, **__):
        raise PermissionError(1, "Operation not permitted")

    @contextmanager
    def without_index(path):
        with opened(path) as (container, stream):
            yield SimpleNamespace(demux=container.demux, seek=refuse), stream

    monkeypatch.setattr(decoding, "open_container", without_index)
    (frame,) = reader.iterate(30, 31)
    assert decoded(frame.image) == 30


def test_files_of_one_recording_must_be_alike(tmp_path):
    write_tiff(tmp_path / "a1.tif", stack(numbers=range(3)))
    for data in (
        stack(numbers=range(3))[:, :-2],
        stack(np.uint16, 65535, range(3)),
        np.repeat(stack(numbers=range(3))[..., None], 3, axis=-1),
    ):
        colour = {"photometric": "rgb"} if data.ndim == 4 else {}
        write_tiff(tmp_path / "a2.tif", data, **colour)
        with pytest.raises(InputError, match=r"a2\.tif: .*must be alike"):
            list(open_frames(tmp_path))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("bits", [None, 8])
def test_pixels_that_are_no_number_are_passed_on_as_such(tmp_path, value, bits):
    image = np.full((1, 6, 8), 0.5, np.float32)
    image[0, 2, 3] = value
    write_tiff(tmp_path / "f.tif", image)
    (frame,) = open_frames(tmp_path / "f.tif", bit_depth=bits)
    np.testing.assert_array_equal(frame.image, image[0])


NAMES = [
    "two words", "Versuch Öl µ", "опыт 七", "100%d", "a:b", "x[1]", "#1 'q' \"d\"", "-lead", "~",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_any_name_will_do(tmp_path, name, monkeypatch):
    path = MOVING["FFVHuff grey in AVI"].write(tmp_path)
    plain = tmp_path / f"{name}.avi"
    path.rename(plain)
    write_tiff(tmp_path / f"{name}.tif", stack())
    folder = tmp_path / f"{name} d"
    folder.mkdir()
    Image.fromarray(stack()[7]).save(folder / f"{name}.png")
    assert read_until_refused(plain) == (list(range(COUNT)), None)
    assert read_until_refused(tmp_path / f"{name}.tif") == (list(range(COUNT)), None)
    assert read_until_refused(folder) == ([7], None)
    monkeypatch.chdir(tmp_path)
    assert read_until_refused(f"{name}.tif") == (list(range(COUNT)), None)


def test_a_name_that_is_no_text_is_read_or_refused(tmp_path):
    odd = os.fsdecode(os.fsencode(tmp_path) + b"/\xff\xfe")
    for suffix, write in ((".mkv", FFV1), (".tif", STILL["plain pages"].write)):
        os.rename(write(tmp_path), odd + suffix)
        numbers, reason = read_until_refused(odd + suffix)
        assert numbers == list(range(COUNT)) or reason
    with pytest.raises(InputError):
        open_frames("a\0b.tif")


def test_links_are_followed_and_those_to_nowhere_refused(tmp_path):
    (tmp_path / "real").mkdir()
    path = FFV1(tmp_path / "real")
    (tmp_path / "link.mkv").symlink_to(path)
    (tmp_path / "folder").symlink_to(tmp_path / "real")
    for good in ("link.mkv", "folder"):
        assert read_until_refused(tmp_path / good) == (list(range(COUNT)), None)
    (tmp_path / "gone.mkv").symlink_to(tmp_path / "none.mkv")
    (tmp_path / "loop.tif").symlink_to(tmp_path / "loop.tif")
    for bad in ("gone.mkv", "loop.tif"):
        assert read_until_refused(tmp_path / bad)[1] is not None


@pytest.mark.parametrize("suffix", [".avi", ".tif", ".png", ".mkv"])
def test_folders_pipes_and_empty_files_in_a_files_place(tmp_path, suffix):
    (tmp_path / f"d{suffix}").mkdir()
    (tmp_path / f"e{suffix}").touch()
    os.mkfifo(tmp_path / f"p{suffix}")
    for name, why in (("d", "no image"), ("e", "0 bytes"), ("p", "not a file")):
        numbers, reason = read_until_refused(tmp_path / f"{name}{suffix}")
        assert numbers == [] and why in reason
    assert "not a file" in read_until_refused([tmp_path / f"d{suffix}"])[1]


@pytest.mark.parametrize("name", ["HuffYUV in AVI", "uncompressed grey in AVI", "plain pages"])
def test_a_recording_that_is_being_written_is_refused(tmp_path, name):
    path = (MOVING | STILL)[name].write(tmp_path)
    reader = open_frames(path)
    running = iter(reader)
    next(running)
    with open(path, "ab") as file:
        file.write(b"more")
    for frames in (running, reader):
        with pytest.raises(InputError, match="changed while it was read"):
            list(frames)


@pytest.mark.parametrize("stamp", [120, 450], ids=["backwards", "another's"])
def test_a_time_stamp_that_two_frames_share_is_the_firsts(tmp_path, stamp):
    path = FFV1(tmp_path)
    data = bytearray(path.read_bytes())
    place = data.find(b"\x81" + struct.pack(">h", 500))  # frame 10's, after 450 ms
    assert place > 0
    data[place + 1 : place + 3] = struct.pack(">h", stamp)
    path.write_bytes(data)
    reader = open_frames(path)
    reader.count()
    for frames in (list(open_frames(path)), list(reader), list(reader.iterate(0, COUNT))):
        assert [decoded(f.image) for f in frames] == list(range(COUNT))
        wanted = [None if i == 10 else t for i, t in enumerate(EVEN)]
        assert [f.time_s for f in frames] == pytest.approx(wanted, abs=1e-3)
    assert next(reader.iterate(10, 11)).time_s is None


def test_a_playlist_in_a_videos_clothes_opens_nothing(tmp_path):
    FFV1(tmp_path)
    for text in (
        f"#EXTM3U\n#EXTINF:1,\nfile://{tmp_path}/v.mkv\n",
        "ffconcat version 1.0\nfile v.mkv",
    ):
        (tmp_path / "x.avi").write_text(text + "\n" * 50)
        numbers, reason = read_until_refused(tmp_path / "x.avi")
        assert numbers == [] and "whatever its name says" in reason


def test_two_cameras_in_one_file_and_pixels_that_are_not_square_are_refused(tmp_path):
    import av

    cases = (("two.mkv", "ffv1", "gray", 2), ("wide.mp4", "mpeg4", "yuv420p", 1))
    for name, codec, pixels, streams in cases:
        with av.open(str(tmp_path / name), "w") as out:
            made = [out.add_stream(codec, rate=20) for _ in range(streams)]
            for stream in made:
                stream.width, stream.height, stream.pix_fmt = COLS, ROWS, pixels
                if streams == 1:
                    stream.codec_context.sample_aspect_ratio = Fraction(16, 15)
            for stream in made:
                frame = av.VideoFrame.from_ndarray(stack()[0], format="gray")
                out.mux(stream.encode(frame.reformat(format=pixels)))
                out.mux(stream.encode(None))
    assert "holds 2 video streams" in read_until_refused(tmp_path / "two.mkv")[1]
    assert "16:15, not square" in read_until_refused(tmp_path / "wide.mp4")[1]


def peak_of(action):
    tracemalloc.start()
    try:
        with pytest.raises(InputError) as caught:
            action()
        return tracemalloc.get_traced_memory()[1], str(caught.value)
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(("tag", "value"), [("SamplesPerPixel", 60_000), ("TileWidth", 2**20)])
def test_heads_that_claim_gigabytes_are_refused(tmp_path, tag, value):
    how = {"tile": (4096, 64)} if tag == "TileWidth" else {}
    tifffile.imwrite(tmp_path / "b.tif", np.zeros((4096, 64), np.uint8), **how)
    with tifffile.TiffFile(tmp_path / "b.tif", mode="r+b") as tif:
        tif.pages[0].tags[tag].overwrite(value)
    peak, reason = peak_of(lambda: open_frames(tmp_path / "b.tif"))
    assert "b.tif" in reason and peak < 50e6


def test_a_list_of_frames_may_be_permuted(tmp_path):
    """The same frame gives the same pixels, wherever in the list it stands."""
    STILL["folder of PNG"].write(tmp_path)
    order = [5, 0, 39, 12]
    files = [tmp_path / f"frame{i}.png" for i in order]
    assert [decoded(f.image) for f in open_frames(files)] == order
    reader = open_frames(files)
    assert reader.files == tuple(files)
    assert [f.name for f in reader.iterate(1, 3)] == ["frame0.png", "frame39.png"]


@pytest.mark.parametrize("bad", [(-1, 3), (3, 2)])
def test_ranges_that_are_none_are_refused(tmp_path, bad):
    with pytest.raises(InputError, match="0 <= start <= stop"):
        open_frames(STILL["plain pages"].write(tmp_path)).iterate(*bad)


def test_files_that_were_cut_from_one_clock_keep_it(tmp_path):
    """Twenty frames, and after a pause of two seconds twenty more, in a file that says so."""
    late = tuple(3.0 + t for t in EVEN)
    for name, times, numbers in (("p1", EVEN, range(20)), ("p2", late, range(20, 40))):
        video(tmp_path / f"{name}.mkv", "ffv1", "gray", times=times, numbers=numbers)
    wanted = [*EVEN[:20], *late[:20]]
    reader = open_frames(tmp_path)
    for frames in (list(reader), list(reader.iterate(0, COUNT)) if reader.count() else []):
        assert [decoded(f.image) for f in frames] == list(range(COUNT))
        assert [f.time_s for f in frames] == pytest.approx(wanted, abs=1e-3)
    # by hand in another order there is no such clock: one file follows the other
    turned = open_frames([tmp_path / "p2.mkv", tmp_path / "p1.mkv"])
    assert [f.time_s for f in turned] == pytest.approx(EVEN, abs=1e-3)
    assert [decoded(f.image) for f in turned] == [*range(20, 40), *range(20)]


@pytest.mark.parametrize("cuts", [(0, COUNT), (0, 1, COUNT), (0, 13, 14, 25, COUNT)])
def test_a_recording_gives_the_same_frames_however_it_is_split(tmp_path, cuts):
    whole = list(open_frames(video(tmp_path / "whole.mkv", "ffv1", "gray")))
    (tmp_path / "parts").mkdir()
    for n, (a, b) in enumerate(pairwise(cuts)):
        video(tmp_path / "parts" / f"p{n}.mkv", "ffv1", "gray", numbers=range(a, b))
    parts = list(open_frames(tmp_path / "parts"))
    assert [f.index for f in parts] == list(range(COUNT))
    for a, b in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(a.image, b.image)
        assert b.time_s == pytest.approx(a.time_s, abs=1e-3)  # a container's millisecond


def test_a_mask_of_too_many_corners_is_refused(tmp_path):
    """All pairs of sides are looked at: a hundred thousand corners would take 80 GB."""
    turn = np.linspace(0, 6.28, 3000)
    corners = [[float(48 + 40 * np.sin(t)), float(96 + 60 * np.cos(t))] for t in turn]
    scene = parse_scene(f"[specimen]\n[frames]\npolygon_px = {corners}\n")
    path = STILL["plain pages"].write(tmp_path)
    with pytest.raises(InputError, match="3000 corners, and 2000 are allowed"):
        open_scene_frames(path, scene)


@given(st.integers(0, 2**32 - 1))
def test_imagej_areas_hold_the_pixels_whose_centres_they_hold(seed):
    """Against scikit-image's test of every pixel by itself; no centre lies on a side."""
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(1, 40)), int(rng.integers(1, 40)))
    outline = rng.uniform(-10, 50, (int(rng.integers(3, 12)), 2))
    np.testing.assert_array_equal(_filled(outline, shape), polygon2mask(shape, outline[:, ::-1]))


@pytest.mark.parametrize("size", ["999999999", "41"])
def test_ome_notes_of_more_frames_than_there_are_are_refused(tmp_path, size):
    path = STILL["OME in disorder"].write(tmp_path)
    with tifffile.TiffFile(path, mode="r+b") as tif:
        notes = tif.pages[0].tags["ImageDescription"]
        notes.overwrite(notes.value.replace(f'SizeT="{COUNT}"', f'SizeT="{size}"'))
    peak, reason = peak_of(lambda: open_frames(path))
    assert f"name {size} frames and {COUNT} are in it" in reason and peak < 50e6
