"""H.264 counted by its packets: only where each is sure to be a frame, and none is lost."""

import importlib
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recordings import COLS, COUNT, RATE, ROWS, UNEVEN, _frame, coded, decoded, video

from isochrome.errors import InputError
from isochrome.frames import begins_anew, length_bytes, open_frames


def number(value):
    """An Exp-Golomb code: as many zeros as digits follow the first of value + 1."""
    digits = f"{value + 1:b}"
    return "0" * (len(digits) - 1) + digits


def parameters(
    profile=100, *, order=0, gaps=0, frames_only=1, scaling=0, colours=1, sizes=(12, 6)
) -> bytes:
    """Sequence parameters by the standard's table of them (Rec. ITU-T H.264, 7.3.2.1.1)."""
    bits = number(0)
    if profile in (100, 110, 122, 244):
        bits += number(colours) + ("0" if colours == 3 else "") + number(0) * 2 + f"0{scaling}"
        bits += "0" * 8 * scaling  # no list of the eight
    bits += number(4) + number(order)
    bits += {0: number(5), 1: "0" + number(2) + number(1) + number(0), 2: ""}[order]
    bits += number(3) + str(gaps) + number(sizes[0] - 1) + number(sizes[1] - 1) + str(frames_only)
    bits += ("" if frames_only else "0") + "1" + "0" + "0" + "1"
    bits += "0" * (-len(bits) % 8)
    body = bytes(int(bits[k : k + 8], 2) for k in range(0, len(bits), 8))
    return marked(bytes([0x67, profile, 0, 30]) + body)


def marked(raw: bytes) -> bytes:
    """With a 3 put between two zeros and a byte up to 3, as every unit has it."""
    out = bytearray()
    for byte in raw:
        if byte <= 3 and out[-2:] == b"\0\0":
            out.append(3)
        out.append(byte)
    return bytes(out)


def configuration(*sets: bytes, length: int = 4) -> bytes:
    kept = b"".join(len(one).to_bytes(2, "big") + one for one in sets)
    return bytes([1, 100, 0, 30, 0xFC | (length - 1), 0xE0 | len(sets)]) + kept


@pytest.mark.parametrize("length", [1, 2, 4])
@pytest.mark.parametrize(
    "how",
    [{}, {"profile": 66}, {"profile": 77, "order": 2}, {"profile": 244, "colours": 3},
     {"profile": 66, "sizes": (4096, 4096)}],
)  # fmt: skip
def test_parameters_of_frames_alone_are_known(how, length):
    assert length_bytes(configuration(parameters(**how), length=length)) == length
    assert length_bytes(configuration(parameters(), parameters(**how), length=length)) == length


@pytest.mark.parametrize(
    "sets",
    [
        [parameters(frames_only=0)],
        [parameters(66, frames_only=0)],
        [parameters(gaps=1)],
        [parameters(), parameters(frames_only=0)],
        [parameters(order=1)],  # these two could be looked through; such streams are decoded
        [parameters(scaling=1)],
        [parameters()[:6]],
        [b""],
        [],
    ],
)
def test_parameters_that_leave_it_open_are_not_relied_on(sets):
    assert length_bytes(configuration(*sets)) is None


def test_another_configuration_or_a_packet_that_breaks_off_is_not_relied_on():
    whole = configuration(parameters())
    assert length_bytes(b"\0\0\0\1" + parameters()) is None  # as AVI has it
    assert length_bytes(None) is None and length_bytes(b"") is None and length_bytes(b"\1") is None
    assert all(length_bytes(whole[:k]) is None for k in range(len(whole) - 4))
    whole = packet(NOTE, KEY)
    assert all(begins_anew(whole[:k], 4) is None for k in range(len(whole)))


NOTE, KEY, PLAIN, REST = b"\x06\x05", b"\x65\x88\x84", b"\x41\x9a\x02", b"\x41\x42\x02"
"""A note, a slice that begins a key frame, one that begins another, one that goes on with it."""


def packet(*units: bytes, length: int = 4) -> bytes:
    return b"".join(len(one).to_bytes(length, "big") + one for one in units)


@pytest.mark.parametrize(
    ("units", "key"),
    [
        ([NOTE, KEY], True),
        ([PLAIN], False),
        ([b"\x09\x10", b"\x68\xee", PLAIN, REST, REST, b"\x0c\xff\x80", b"\x0a"], False),
        ([parameters(), KEY, b"\x65\x20"], True),
        ([parameters(frames_only=0), KEY], None),
        ([PLAIN, PLAIN], None),
        ([KEY, PLAIN], None),
        ([REST], None),
        ([NOTE], None),
        ([], None),
        ([b"\x02\x80", PLAIN], None),  # a slice in parts
        ([PLAIN, b"\x74\x80\x00\x00\x80"], None),  # another layer
        ([PLAIN, b""], None),
    ],
)
@pytest.mark.parametrize("length", [1, 2, 4])
def test_a_packet_of_one_frame_is_known(units, key, length):
    assert begins_anew(packet(*units, length=length), length) is key


@given(st.binary(max_size=80), st.sampled_from([1, 2, 4]))
def test_any_bytes_are_looked_at_without_failing(data, length):
    assert length_bytes(b"\1\0\0\0\xff\xe1" + data) in (None, 4)
    assert begins_anew(data, length) in (None, True, False)


def places_of(path):
    """What the packets alone tell of a video."""
    module = importlib.import_module("isochrome.frames.video")
    return module.by_packets(path, "mp4" if path.suffix == ".mp4" else "matroska")


@pytest.mark.parametrize(
    ("how", "keys"),
    [
        ("bframes=3", [0, 8, 16, 24, 32]),
        ("bframes=0:slices=4", [0, 8, 16, 24, 32]),
        ("open-gop=1:bframes=3", [0]),  # frames after the next ones look back beyond them
        ("intra-refresh=1", [0]),
        ("interlaced=1", None),
    ],
)
@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_decoding_begins_where_nothing_looks_further_back(tmp_path, how, keys, suffix):
    path = video(
        tmp_path / f"v{suffix}", "libx264", "yuv420p", options={"x264-params": how}, times=UNEVEN
    )
    found = places_of(path)
    if keys is None:
        assert found is None
    else:
        assert found.keys[:, 0].tolist() == keys
        assert found.times_s == pytest.approx(UNEVEN, abs=1.01e-3)
    with open_frames(path) as reader:
        assert reader.count(decode=False) == COUNT
        assert [decoded(f.image) for f in reader] == list(range(COUNT))


def test_damage_shows_when_the_frame_is_read(tmp_path):
    import av

    path = video(tmp_path / "v.mp4", "libx264", "yuv420p")
    with av.open(str(path)) as container:
        places = [(p.pos, p.size) for p in container.demux(video=0) if p.size]
    data = bytearray(path.read_bytes())
    place, size = places[24]  # a key frame: as many come before it in the file as in time
    data[place + 8 : place + size] = bytes(b ^ 0x5A for b in data[place + 8 : place + size])
    path.write_bytes(data)
    numbers = []
    with open_frames(path) as reader:
        assert reader.count(decode=False) == COUNT
        with pytest.raises(InputError, match=r"v\.mp4: frame 2\d cannot be decoded"):
            numbers.extend(decoded(f.image) for f in reader)
        with pytest.raises(InputError, match=r"v\.mp4: frame 2\d "):
            list(reader.iterate(24, 26))
    assert numbers == list(range(len(numbers))) and 20 <= len(numbers) <= 24


@pytest.mark.parametrize("decode", [True, False])
def test_frames_that_ffmpeg_passes_over_in_silence_are_missed(tmp_path, decode):
    """One bit of a slice's head, and it gives 34 frames of 40 and no word."""
    import av

    path = video(tmp_path / "v.mp4", "libx264", "yuv420p", options={"x264-params": "bframes=0"})
    with av.open(str(path)) as container:
        place = [p.pos for p in container.demux(video=0) if p.size][9]
    data = bytearray(path.read_bytes())
    data[place + 5] ^= 1
    path.write_bytes(data)
    with av.open(str(path)) as container:
        assert sum(1 for _ in container.decode(video=0)) < COUNT

    def read():
        with open_frames(path) as reader:
            reader.count(decode=decode)
            list(reader)

    with pytest.raises(InputError, match=r"v\.mp4: .*packet"):
        read()


def test_a_recording_cut_by_its_edit_list_begins_where_that_says(tmp_path):
    """The frames from the key frame before are in the file, to be decoded and not shown."""
    import av

    path = tmp_path / "v.mp4"
    with av.open(str(path), "w", options={"avoid_negative_ts": "disabled"}) as out:
        stream = out.add_stream("libx264", rate=RATE, options={"g": "8"})
        stream.width, stream.height, stream.pix_fmt = COLS, ROWS, "yuv420p"
        packets = []
        for k in range(COUNT):
            frame = _frame(av, coded(k), "yuv420p", 8)
            frame.pts, frame.time_base = k, Fraction(1, RATE)
            packets += stream.encode(frame)
        for each in packets + stream.encode(None):
            each.pts, each.dts = each.pts - 10, each.dts - 10
            out.mux(each)
    with open_frames(path) as reader:
        assert reader.count(decode=False) == COUNT - 10
        assert [decoded(f.image) for f in reader] == list(range(10, COUNT))


def copied(path, change):
    """A copy of a video, its packets after a change of them."""
    import av

    with av.open(str(path)) as given, av.open(str(path.with_name("copy.mkv")), "w") as out:
        source = given.streams.video[0]
        stream = out.add_stream_from_template(source)
        for each in change([p for p in given.demux(source) if p.size]):
            each.stream = stream
            out.mux(each)
    return path.with_name("copy.mkv")


def from_second_key(packets):
    return packets[[k for k, p in enumerate(packets) if p.is_keyframe][1] :]


def shown_late(packets):
    """The last frame before a key frame comes after it by its time, and before it by its order."""
    packets[15].pts = packets[16].pts + packets[15].duration // 2
    return packets


@pytest.mark.parametrize(
    ("how", "change", "numbers"),
    [
        ("open-gop=1:bframes=3", from_second_key, range(8, COUNT)),
        ("bframes=0", shown_late, range(COUNT)),
    ],
)
def test_a_stream_whose_packets_are_more_or_in_another_order_is_decoded(
    tmp_path, how, change, numbers
):
    path = video(tmp_path / "v.mkv", "libx264", "yuv420p", options={"x264-params": how})
    path = copied(path, change)
    assert places_of(path) is None
    with open_frames(path) as reader:
        assert reader.count(decode=False) == len(numbers)
        assert [decoded(f.image) for f in reader] == list(numbers)


def silent(sps: bytes) -> bytes:
    """The same sequence parameters, of x264's high profile, without what describes the use."""
    bits, at = "".join(f"{b:08b}" for b in sps.replace(b"\0\0\3", b"\0\0")), 32

    def skip(codes):
        nonlocal at
        for _ in range(codes):
            at += 2 * (bits.index("1", at) - at) + 1

    skip(4)  # name, colours, bit depths
    at += 2
    skip(4)  # frames' numbers, and how far they are counted; frames that are kept
    at += 1
    skip(2)  # size
    at += 2
    assert bits[at] == "0"  # cropped: it is not
    left = bits[: at + 1] + "0" + "1"
    left += "0" * (-len(left) % 8)
    plain = marked(bytes(int(left[k : k + 8], 2) for k in range(0, len(left), 8)))
    return plain.ljust(len(sps), b"\0")


@pytest.mark.parametrize("decode", [True, False])
def test_no_frame_is_lost_where_the_stream_does_not_say_how_far_it_is_out_of_order(
    tmp_path, decode
):
    """FFmpeg guesses, and drops a frame that comes later than it has guessed."""
    import av

    rng = np.random.default_rng(5)
    noise = rng.normal(0, 20, (7, ROWS, COLS))
    path = video(
        tmp_path / "v.mkv", "libx264", "yuv420p",
        options={"g": "40", "x264-params": "bframes=8:b-pyramid=normal:b-adapt=2:ref=8"},
        image=lambda k: np.clip(coded(k) + (noise[k % 7] if k > 15 else 0), 0, 255),
    )  # fmt: skip
    with av.open(str(path)) as container:
        told = bytes(container.streams.video[0].codec_context.extradata)
        order = [p.pts for p in container.demux(video=0) if p.size]
    sps = told[8 : 8 + int.from_bytes(told[6:8], "big")]
    data = path.read_bytes()
    assert order != sorted(order) and data.count(sps) == 1
    path.write_bytes(data.replace(sps, silent(sps)))
    with open_frames(path) as reader:
        assert reader.count(decode=decode) == COUNT
        assert [decoded(f.image) for f in reader] == list(range(COUNT))
