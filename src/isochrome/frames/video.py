"""Frames from a video by PyAV, and where each of them is, by its packets or once all are decoded.

FFmpeg reads over gaps, puts the picture before in the place of a damaged slice of FFV1, and says so
to nobody: whether a file is whole, its container's sizes tell, and the slices' checksums. In MP4
and Matroska a packet of H.264 is a whole frame where the sequence parameters allow of no fields.
Its conversion truncates, and takes deep colour through 8 bits: luminance and chrominance are turned
into RGB here instead, rounded once. Sources: AVI RIFF file reference (Microsoft) with the OpenDML
extensions; RFC 9559, Matroska; RFC 9043, FFV1, section 4.9; Rec. ITU-T H.264, 7.3.1, 7.3.2.1.1,
7.3.3, table 7-1; ISO/IEC 14496-12, and -15, 5.3.3.1.
"""

import os
import struct
import sys
import zlib
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import chain, islice
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np

from isochrome.errors import InputError
from isochrome.frames import reading
from isochrome.messages import message

SUFFIXES = (
    ".avi", ".mp4", ".mkv", ".mov", ".m4v", ".wmv", ".mpg", ".mpeg", ".webm", ".ts", ".mts",
)  # fmt: skip

WEIGHTS = {1: (0.2126, 0.0722)} | dict.fromkeys((9, 10), (0.2627, 0.0593))
"""Weights of red and blue in the luminance by FFmpeg's number of the colour space."""

WEIGHTS_601 = (0.299, 0.114)
"""The same of ITU-R BT.601, which also stands for 'not specified'."""


def to_image(frame: Any, path: Path) -> tuple[np.ndarray, int | None]:
    """A frame's pixels (row, col) or (row, col, 3) in RGB, and bits of a value (None: float)."""
    form, name = frame.format, str(frame.format.name)
    if name.startswith(("yu", "uyvy", "yvyu", "nv", "p0", "p2", "p4")):
        return _rgb_of_yuv(frame)
    if name.startswith(("gray", "ya")):
        grey = plane_of(frame, 0)[:, :: 2 if name.startswith("ya") else 1]
        return np.array(grey, order="C"), None if "f" in name else _bits(frame)
    if name.startswith(("gbrp", "gbrap")) and "f" not in name:
        green, blue, red = (plane_of(frame, k) for k in range(3))
        return np.stack([red, green, blue], axis=-1), _bits(frame)
    if name.startswith(("rgb48", "bgr48", "rgba64", "bgra64")):
        return frame.to_ndarray(format="rgb48le").astype(np.uint16, copy=False), 16
    packed = (form.is_rgb and not form.is_bayer) or form.has_palette or name.startswith("mono")
    if packed and max(part.bits for part in form.components) <= 8:
        return frame.to_ndarray(format="rgb24"), 8
    raise InputError("holds_pixels_format_which", path=path, name=name)


def _bits(frame: Any) -> int:
    return int(frame.format.components[0].bits)


def plane_of(frame: Any, number: int) -> np.ndarray:
    """One plane as it is stored, (row, col), in native byte order; packed pixels as bytes. It is
    looked at where the decoder has it, and goes on from: to be copied before it is given out."""
    plane, form = frame.planes[number], frame.format
    bits = _bits(frame)
    dtype = np.dtype(np.uint8 if bits <= 8 else np.float32 if bits == 32 else np.uint16)
    if form.name.endswith("be" if sys.byteorder == "little" else "le"):
        dtype = dtype.newbyteorder()
    width, packed = plane.width, len(form.components) > 1 and not form.is_planar
    if packed:
        width = -(-plane.width * form.padded_bits_per_pixel // (8 * dtype.itemsize))
    elif form.name.startswith("nv") and number == 1:
        width *= 2
    stored = np.frombuffer(plane, np.uint8)[: plane.line_size * plane.height]
    rows = stored.reshape(plane.height, plane.line_size)[:, : width * dtype.itemsize]
    return rows.view(dtype).astype(dtype.newbyteorder("="), copy=False)


def _rgb_of_yuv(frame: Any) -> tuple[np.ndarray, int | None]:
    """RGB = Y' + matrix (Cb, Cr), in the bits of the frame; without colour, without arithmetic.
    Source: ITU-R BT.601-7, BT.709-6, BT.2020-2; Rec. ITU-T H.273 for the levels."""
    from av.video.reformatter import ColorRange

    bits = _bits(frame)
    # else black and white lie at 16 and 235 of 255
    full = frame.format.name.startswith("yuvj") or frame.color_range == ColorRange.JPEG
    if len(frame.planes) < 3:  # the same values in another order
        _, part, _ = frame.format.components
        share = 4 // (frame.width // part.width)
        form = f"yuv4{share}{share if part.height == frame.height else 0}p"
        frame = frame.reformat(format=form if bits == 8 else f"{form}{bits}le")
    luma, cb, cr = (plane_of(frame, k) for k in range(3))
    half, top = 1 << (bits - 1), float(2**bits - 1)
    black, white = (0, 2**bits - 1) if full else (16 << (bits - 8), 235 << (bits - 8))
    if (cb == half).all() and (cr == half).all():  # mono, stored as colour
        grey = np.rint((luma.astype(float) - black) * top / (white - black)).clip(0, top)
        return np.broadcast_to(grey.astype(luma.dtype)[..., None], (*luma.shape, 3)), bits
    red, blue = WEIGHTS.get(int(frame.colorspace), WEIGHTS_601)
    scale = np.float32(top / (2**bits - 1 if full else 224 << (bits - 8)))
    light = (luma.astype(np.float32) - black) * np.float32(top / (white - black))
    # planes of fewer rows and columns, each value on all pixels that it was taken of
    down, across = (-(-size // part) for size, part in zip(luma.shape, cb.shape, strict=True))
    wide = (c.repeat(down, axis=0).repeat(across, axis=1) for c in (cb, cr))
    b, r = ((c[: luma.shape[0], : luma.shape[1]].astype(np.float32) - half) * scale for c in wide)
    green = 1 - red - blue
    out = np.empty((*luma.shape, 3), luma.dtype)
    shares = (
        2 * (1 - red) * r,
        -2 * (blue * (1 - blue) * b + red * (1 - red) * r) / green,
        2 * (1 - blue) * b,
    )
    for k, share in enumerate(shares):
        out[..., k] = np.clip(np.rint(light + share), 0, top)
    return out, bits


SLICE, KEY_SLICE, PARAMETERS = 1, 5, 7
ASIDE = range(6, 13)
"""Kinds of units beside the pictures: notes, parameters, delimiters, ends, filler."""

FIRST = b"\x80"
"""The least second byte of a slice that begins a picture: its first macroblock is number 0."""

PLAIN = (66, 77, 88)
"""Profiles whose sequence parameters tell of no colours and bit depths; all others' do."""


def length_bytes(configuration: bytes | None) -> int | None:
    """The bytes of a unit's length, by a decoder's configuration; None unless a unit is a frame."""
    if not configuration or len(configuration) < 6 or configuration[0] != 1:
        return None
    count, place = configuration[5] & 0x1F, 6
    for _ in range(count):
        stop = place + 2 + int.from_bytes(configuration[place : place + 2], "big")
        if not _frames_only(configuration[place + 2 : stop]):
            return None
        place = stop
    return (configuration[4] & 3) + 1 if count else None


def begins_anew(packet: bytes, length: int) -> bool | None:
    """Whether decoding can begin with the one frame of a packet, which no later one looks beyond.
    `length`, the bytes of a unit's length. None where it holds no frame, or several, or layers."""
    is_key: bool | None = None
    place = 0
    while place < len(packet):
        begin = place + length
        place = begin + int.from_bytes(packet[place:begin], "big")
        if place == begin or place > len(packet):
            return None
        kind = packet[begin] & 0x1F
        if kind in (SLICE, KEY_SLICE):
            if packet[begin + 1 : place][:1] >= FIRST:
                if is_key is not None:
                    return None
                is_key = kind == KEY_SLICE
        elif kind not in ASIDE or (kind == PARAMETERS and not _frames_only(packet[begin:place])):
            return None
    return is_key


def _frames_only(parameters: bytes) -> bool:
    """Whether sequence parameters allow of no fields and of no gaps; False where it is not seen."""
    head = parameters.replace(b"\0\0\3", b"\0\0")  # 3: put in so as not to be a mark
    bits = chain.from_iterable(f"{byte:08b}" for byte in head[4:])

    def flag() -> bool:
        return next(bits) == "1"

    def number() -> int:
        zeros = 0
        while not flag():
            zeros += 1
        return (1 << zeros) - 1 + int("0" + "".join(islice(bits, zeros)), 2)

    try:
        number()  # their name
        if head[1] not in PLAIN:
            if number() == 3:  # colours in all pixels
                flag()
            number(), number(), flag()  # bit depths, lossless
            if flag():  # scaling lists, which are long and rare
                return False
        number()  # how far frames are counted
        order = number()
        if order == 0:
            number()
        elif order != 2:
            return False
        number()  # frames that are kept
        gaps = flag()
        number(), number()  # size
        return flag() and not gaps
    except (StopIteration, IndexError):
        return False


SIZE, WITH = 3, 8
"""Bytes of a slice's size, which is its footer without a checksum, and of its footer with one."""

MIRRORED = np.packbits(np.unpackbits(np.arange(256, dtype=np.uint8), bitorder="little")).tobytes()
"""Each byte with its bits in the other order: FFV1 takes the highest first, zlib the lowest."""


def is_whole(packet: bytes) -> bool:
    """Whether all slices of a packet of version 3 are what their checksums say, if it has any."""
    for footer in (WITH, SIZE):
        slices, end = list[bytes](), len(packet)
        while end >= footer:
            size = int.from_bytes(packet[end - footer :][:SIZE], "big") + footer
            if size > end:
                break
            slices.append(packet[end - size : end])
            end -= size
        if slices and end == 0:  # the sizes come out
            # the checksum of all bytes and of their checksum is zero, with a start of zero
            sums = (zlib.crc32(one.translate(MIRRORED), 2**32 - 1) for one in slices)
            return footer == SIZE or all(each == 2**32 - 1 for each in sums)
    return False


Container = Literal["avi", "matroska", "mp4", "asf", "mpeg"]

SEGMENT, CLUSTER = b"\x18\x53\x80\x67", b"\x1f\x43\xb6\x75"
INSIDE = {
    name: frozenset(map(bytes.fromhex, inside.split()))
    for name, inside in {
        b"": "1a45dfa3 18538067 ec bf",
        SEGMENT: "114d9b74 1549a966 1f43b675 1654ae6b 1c53bb6b 1941a469 1043a770 1254c367 ec bf",
        CLUSTER: "e7 5854 a7 ab a3 a0 af ec bf",
    }.items()
}
"""Matroska's elements, by the one that they may stand in."""

LISTS = (b"AVI ", b"AVIX", b"movi", b"rec ")
"""Kinds of AVI's lists whose chunks are gone through."""

BOXES = (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"uuid", b"moof", b"mfra", b"sidx",
         b"meta", b"styp", b"pnot", b"udta", b"PICT", b"ssix", b"prft", b"emsg")  # fmt: skip


def check_whole(path: Path) -> Container:
    """Walk through a video's structure, without decoding, and give its container. A recording that
    was never closed (sizes of zero or 'unknown') passes when all it holds is whole."""
    with reading.refusing(path), open(path, "rb") as file:
        container, end = container_of(file), file.seek(0, 2)
        if container in _WALKS:
            _WALKS[container](file, 0, end, path)
        if container is not None:
            return container
    raise InputError("no_avi_mp_mov", path=path)


def container_of(file: BinaryIO) -> Container | None:
    """A video's container by its first bytes; None where it is none that is known."""
    file.seek(0)
    head = file.read(16)
    if head[:4] == b"RIFF" and head[8:12] == b"AVI ":
        return "avi"
    if head[:4] == b"\x1a\x45\xdf\xa3":
        return "matroska"
    if head[4:8] in BOXES:
        return "mp4"
    if head == bytes.fromhex("3026b2758e66cf11a6d900aa0062ce6c"):
        return "asf"
    if head[:4] in (b"\x00\x00\x01\xba", b"\x00\x00\x01\xb3"):
        return "mpeg"
    file.seek(188)  # a transport stream: packets of 188 bytes, each begun by 0x47
    return "mpeg" if head[:1] == b"\x47" == file.read(1) else None


def _broken(path: Path, place: int, end: int) -> InputError:
    return InputError("breaks_off_part_begins", path=path, place=place, end=end)


def _damaged(path: Path, place: int) -> InputError:
    return InputError("damaged_byte_frames_after", path=path, place=place)


def _avi(file: BinaryIO, place: int, end: int, path: Path, depth: int = 0) -> None:
    """RIFF lists: AVI, and AVIX for what follows after a gigabyte; in them, chunks of frames."""
    while place + 8 <= end:
        file.seek(place)
        name, size, kind = struct.unpack("<4sI4s", file.read(12).ljust(12))
        if depth == 0 and (name != b"RIFF" or kind not in LISTS):
            return  # something else behind the recording, such as a signature
        if not name.isascii() or not name.decode().isprintable():
            raise _damaged(path, place)
        unclosed = name in (b"RIFF", b"LIST") and size == 0
        stop = end if unclosed else place + 8 + size
        if stop > end + (depth == 0):  # some writers leave out the last byte of an even number
            raise _broken(path, place, end)
        if name in (b"RIFF", b"LIST") and kind in LISTS and depth < 4:
            _avi(file, place + 12, min(stop, end), path, depth + 1)
        place = stop + stop % 2


def _mp4(file: BinaryIO, place: int, end: int, path: Path) -> None:
    """Boxes one behind the other; each says how long it is."""
    boxes = set()
    while place < end:
        file.seek(place)
        head = file.read(16)
        if len(head) < 8:
            raise _broken(path, place, end)
        size, name = struct.unpack(">I4s", head[:8])
        if size == 1 and len(head) == 16:
            size = int.from_bytes(head[8:], "big")
        if name not in BOXES:
            if b"moov" in boxes and b"mdat" in boxes:
                return  # something else behind the recording
            raise _damaged(path, place)
        boxes.add(name)
        size = size or end - place
        if size < 8:
            raise _damaged(path, place)
        if place + size > end:
            raise _broken(path, place, end)
        place += size
    if b"moov" not in boxes:
        raise InputError("index_missing_recording_never", path=path)


def _matroska(
    file: BinaryIO, place: int, end: int, path: Path, names: frozenset[bytes] = INSIDE[b""]
) -> None:
    """Elements of these names one behind the other; each says how long it is (RFC 8794)."""
    while place < end:
        file.seek(place)
        head = file.read(12)
        if len(head) < 2 or head[0] < 0x10:
            raise _damaged(path, place)
        width = 9 - head[0].bit_length()
        name, digits = head[:width], head[width:]
        if name not in names or not digits or digits[0] == 0:
            raise _damaged(path, place)
        length = 9 - digits[0].bit_length()
        if len(digits) < length:
            raise _broken(path, place, place + len(head))
        unknown = (1 << 7 * length) - 1
        size = int.from_bytes(digits[:length], "big") & unknown
        place += width + length
        if size != unknown:
            if place + size > end:
                raise _broken(path, place - width - length, end)
            if name in INSIDE:
                _matroska(file, place, place + size, path, INSIDE[name])
            place += size
        elif name in INSIDE:  # it ends where the next element is of those that it stands in
            names |= INSIDE[name]
        else:
            raise _damaged(path, place - width - length)


_WALKS: dict[Container | None, Callable[[BinaryIO, int, int, Path], None]] = {
    "avi": _avi, "matroska": _matroska, "mp4": _mp4,
}  # fmt: skip


OPEN = {"protocol_whitelist": "file", "format_whitelist": "avi,mov,mp4,m4a,3gp,3g2,mj2,matroska,"
        "webm,asf,mpeg,mpegvideo,mpegts"}  # fmt: skip
"""Nothing but this one file is opened, whatever it names inside."""

DECODE = {"err_detect": "crccheck+explode", "max_pixels": str(reading.MAX_PIXELS)}
"""A damaged frame is an error, and not something like a frame."""

PATIENCE = {"strict": "1"}
"""H.264 need not say how far its frames are out of order; those that come late are not lost."""

PIXEL_BYTES = 6
"""Of a pixel in 16-bit colour, the most that is decoded."""

FRAME_BY_PACKET = ("rawvideo", "ffv1", "mjpeg", "png", "huffyuv", "ffvhuff", "utvideo")
"""Codecs whose every packet is one frame, in the order of display."""


Decoded = tuple[Any, int | None, float | None]
"""A frame as PyAV gives it, its tick and its time since the first (s), None where unknown."""


def decoded(path: Path, kind: Container, key: tuple[int, int] | None = None) -> Generator[Decoded]:
    """Every frame of a video in the order of display, from the first or a key frame (number, tick),
    before which some may come. AVI knows no times, only how many frames come before a packet in the
    order of the file, not of display: the frames take the packets' numbers in rising order."""
    with open_container(path) as (container, stream):
        if key is not None:
            with reading.refusing(path, message("frame_cannot_found_again", key=key[0])):
                container.seek(key[1], stream=stream, backward=True, any_frame=False)
        count = key[0] if key else 0
        numbers, first, last = list[int](), None, -np.inf
        context = stream.codec_context
        in_slices = context.name == "ffv1" and bool(context.extradata)
        packets = container.demux(stream)
        while True:
            with reading.refusing(path, f"frame {count} cannot be decoded"):
                packet = next(packets, None)
                if packet is None:
                    return
                if kind == "avi" and packet.size and packet.dts is not None:
                    heappush(numbers, packet.dts)
                frames = _decode(packet, path, count, in_slices=in_slices)
            for frame in frames:
                tick = frame.pts if kind != "avi" else heappop(numbers) if numbers else None
                time = None
                if tick is not None and tick > last:
                    first = tick if first is None else first
                    last, time = tick, float((tick - first) * stream.time_base)
                yield frame, tick, time
                count += 1


def _decode(packet: Any, path: Path, count: int, *, in_slices: bool) -> list[Any]:
    """The frames that a packet completes; InputError where it, or one of them, is damaged."""
    if packet.is_corrupt:
        raise InputError("breaks_off_damaged_after", path=path, count=count - 1)
    if not in_slices or packet.size == 0 or is_whole(bytes(packet)):
        frames: list[Any] = packet.decode()
        if not any(frame.is_corrupt for frame in frames):
            return frames
    raise InputError("frame_damaged_copy_file", path=path, count=count)


@contextmanager
def open_container(path: Path) -> Iterator[tuple[Any, Any]]:
    """An open container and its one video stream, ready to decode in this thread alone."""
    import av
    from av.stream import Disposition

    with ExitStack() as stack:
        with reading.refusing(path, "not a readable video"):
            container = av.open(os.fspath(path.absolute()), container_options=OPEN)
            stack.callback(container.close)
            cover = Disposition.attached_pic
            streams = [s for s in container.streams.video if not s.disposition & cover]
            if len(streams) != 1:
                raise InputError("holds_video_streams_one", path=path, streams_count=len(streams))
            context = streams[0].codec_context
            if context is None:
                raise InputError("codec_not_known_save", path=path)
            if context.height <= 0 or context.width <= 0:  # FFmpeg keeps no size it will not decode
                raise InputError("names_no_frame_size", path=path, max_pixels=reading.MAX_PIXELS)
            reading.check_size(path, context.height, context.width, PIXEL_BYTES)
            aspect = streams[0].sample_aspect_ratio
            across, down = (aspect.numerator, aspect.denominator) if aspect else (1, 1)
            if min(across, down) > 0 and across != down:
                raise InputError("says_pixels_not_square", path=path, across=across, down=down)
            context.options = DECODE | (PATIENCE if context.name == "h264" else {})
            context.thread_count = 1
        yield container, streams[0]


def checksum(frame: Any) -> int:
    """A checksum of the first plane's pixels (grey, luminance, green, or all of packed colours)."""
    return zlib.crc32(np.ascontiguousarray(plane_of(frame, 0)).data)


@dataclass(frozen=True)
class Places:
    """What is known of each frame: `times_s` from the first (NaN: unknown), `stamps`, the file's
    own ticks, `sums`, checksums of the first plane (None: packets alone have told it, and frames
    are held against stamps), `keys`, where decoding can begin: (frame, tick), and `end_s`."""

    times_s: np.ndarray
    stamps: np.ndarray
    sums: np.ndarray | None
    keys: np.ndarray
    end_s: float | None

    def is_frame(self, index: int, item: Decoded) -> bool:
        """Whether a decoded frame is the one of that number."""
        if self.sums is None:
            return bool(item[1] == self.stamps[index])
        return bool(checksum(item[0]) == self.sums[index])


def by_packets(path: Path, kind: Container) -> Places | None:
    """What the packets tell; None where they may be other than a frame each."""
    ticks, keys = list[int](), list[int]()
    with open_container(path) as (container, stream):
        context = stream.codec_context
        unit = length_bytes(context.extradata) if context.name == "h264" else None
        if unit is None and context.name not in FRAME_BY_PACKET:
            return None
        base, packets = stream.time_base, container.demux(stream)
        try:
            with reading.refusing(path):
                for packet in packets:
                    tick = packet.dts if kind == "avi" else packet.pts
                    if packet.size == 0 and tick is None:  # the end
                        break
                    if packet.size == 0 or packet.is_corrupt or packet.is_discard or tick is None:
                        return None
                    key = packet.is_keyframe if unit is None else begins_anew(bytes(packet), unit)
                    if key is None:
                        return None
                    keys += [len(ticks)] * key
                    ticks.append(tick)
        except InputError:  # decoding says it better
            return None
    return _in_order(np.array(ticks, np.int64), keys, base, reordered=unit is not None)


def _in_order(ticks: np.ndarray, keys: list[int], base: Any, *, reordered: bool) -> Places | None:
    """Places by the packets' ticks, which rise but where frames are `reordered`; None else."""
    stamps = np.sort(ticks) if reordered else ticks
    if len(stamps) < 2 or not (np.diff(stamps) > 0).all():
        return None
    if reordered:  # all that comes before a key frame in the file has to be shown before it
        closed = (stamps == ticks) & (np.maximum.accumulate(ticks) == ticks)
        if 0 not in keys or not closed[keys].all():
            return None
    times = np.array([float((int(tick) - int(stamps[0])) * base) for tick in stamps])
    places = np.array([(key, ticks[key]) for key in keys], np.int64)
    return Places(
        times, stamps, None, places, reading.next_time(float(times[-2]), float(times[-1]))
    )


class Video:
    """One video file; decoded from its start, or from a key frame once its frames are known."""

    def __init__(self, path: Path) -> None:
        self.path, self.stamp, self.container = path, reading.Stamp.of(path), check_whole(path)
        self.places: Places | None = None
        # of the first frame, which is decoded before any is asked for
        self.form: reading.StoredForm

    def extent(self) -> reading.Extent:
        """Decode all frames once, remember their places, and count them."""
        if self.places is None:
            self.places = self._survey()
        return reading.Extent(len(self.places.times_s), self.places.end_s)

    def listed(self) -> reading.Extent:
        """The same by the packets, without decoding, where each of them is a frame by itself."""
        if self.places is None:
            self.places = by_packets(self.path, self.container)
            self.stamp.check(self.path)
        return self.extent()

    def begins(self, start: int) -> int:
        """The frame that decoding begins with to come to frame `start`."""
        return 0 if self.places is None else self._key(self.places, start)[0]

    def frames(self, start: int) -> Generator[reading.Frame]:
        """The frames from number `start` on; those before are decoded, but not converted."""
        places = self.places
        known = enumerate(self.decoded()) if places is None else self._known(places, start)
        for index, (frame, _, time) in known:
            if index < start:
                continue
            with reading.refusing(self.path, f"frame {index} cannot be decoded"):
                image = to_image(frame, self.path)[0]
                self.form.check(self.path, image, f"frame {index}")
            if places is not None:
                time = float(places.times_s[index])
                time = time if np.isfinite(time) else None
            yield reading.Frame(index, image, time, f"{self.path.name}[{index}]")
        self.stamp.check(self.path)

    def decoded(self, key: tuple[int, int] | None = None) -> Generator[Decoded]:
        """Every frame in the order of display, from the first or from a key frame's tick on."""
        self.stamp.check(self.path)
        return decoded(self.path, self.container, key)

    def _survey(self) -> Places:
        times, ticks, sums, keys = list[float](), [], [], []
        listed = by_packets(self.path, self.container)
        running: Iterator[Decoded] = self.decoded()
        if listed is not None:  # FFmpeg passes over damaged frames of H.264 in silence
            running = (item for _, item in self._known(listed, 0))
        for frame, tick, time in running:
            if frame.key_frame and tick is not None:
                keys.append((len(times), tick))
            times.append(np.nan if time is None else time)
            ticks.append(-1 if tick is None else tick)
            sums.append(checksum(frame))
        if not times:
            raise InputError("no_frame_video_can", path=self.path)
        self.stamp.check(self.path)
        if len(times) > 1:
            end = reading.next_time(*times[-2:])
        else:  # how long a frame stands
            end = float((getattr(frame, "duration", None) or np.nan) * (frame.time_base or np.nan))
        return Places(
            np.array(times), np.array(ticks, np.int64), np.array(sums, np.uint32),
            np.array(keys, np.int64).reshape(-1, 2), None if end is None or np.isnan(end) else end,
        )  # fmt: skip

    def _known(self, places: Places, start: int) -> Iterator[tuple[int, Decoded]]:
        """The frames from number `start` on, each held against what is known of it: from the last
        key frame before, or from the first where one is not as it was (no key frame)."""
        first, begin = self._key(places, start)
        for key in dict.fromkeys((first, 0)):
            index, ended = key, False
            with suppress(InputError) if key else nullcontext():
                for item in self.decoded((key, begin) if key else None):
                    if index == key > 0 and (item[1] is None or item[1] < begin):
                        continue  # before the key frame in time
                    if index >= len(places.stamps) or not places.is_frame(index, item):
                        break
                    if index >= start:
                        yield index, item
                        start = index + 1
                    index += 1
                else:
                    ended = True
                    if index == len(places.stamps):
                        return
        if places.sums is not None:
            raise InputError("frame_not_what_when", path=self.path, number=index)
        if not ended:
            raise InputError("frame_not_one_packet", path=self.path, index=index)
        count = len(places.stamps)
        raise InputError(
            "gives_frames_packets_copy", path=self.path, index=index, stamps_count=count
        )

    def _key(self, places: Places, start: int) -> tuple[int, int]:
        """Number and tick of the last key frame before `start`; (0, 0) where none can be sought."""
        keys = places.keys[places.keys[:, 0] <= start]
        number, tick = map(int, keys[-1]) if len(keys) else (0, 0)
        return (number, tick) if np.count_nonzero(places.stamps == tick) == 1 else (0, 0)


def open_video(path: Path) -> reading.Source:
    """Decode the first frame of a video."""
    video = Video(path)
    with closing(video.decoded()) as running:
        first = next(running, None)
        if first is None:
            raise InputError("no_frame_video_can", path=path)
        frame, tick, _ = first
        with reading.refusing(path, "frame 0 cannot be decoded"):
            image, bits = to_image(frame, path)
            start_s = None if tick is None else float(tick * frame.time_base)
    with open_container(path) as (_, stream):
        claimed, lossy = stream.frames, bool(stream.codec_context.codec.lossy)
    video.form = reading.StoredForm.of(image)
    return reading.Source(
        kind="video", form=video.form, sensor_bits=bits, frames=video.frames, extent=video.extent,
        listed=video.listed, begins=video.begins, files=(path,), claimed=claimed or None,
        lossy=lossy, start_s=start_s,
    )  # fmt: skip
