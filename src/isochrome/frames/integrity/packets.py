"""What a video's packets tell before they are decoded.

FFV1: whether a packet is whole, by the checksums of its slices. FFmpeg puts the picture before in
the place of a damaged slice, and says so to nobody who decodes. Source: RFC 9043, FFV1 video coding
format versions 0, 1 and 3, section 4.9, slice footer.

H.264: whether a packet is one frame, and whether decoding can begin with it. MP4 and Matroska keep
an access unit in a packet; it holds one picture, which is a whole frame where the sequence
parameters allow of no fields. These are what the decoder goes by, no head of the file that may lie.
Sources: Rec. ITU-T H.264, 7.3.1 NAL unit, 7.3.2.1.1 sequence parameters, 7.3.3 slice header,
table 7-1; ISO/IEC 14496-15, 5.3.3.1 decoder configuration.
"""

from __future__ import annotations

import zlib
from itertools import islice

SLICE, KEY_SLICE, PARAMETERS = 1, 5, 7
ASIDE = (6, 8, 9, 10, 11, 12)
"""Kinds of units beside the pictures: notes, picture parameters, delimiters, ends, filler."""

KIND = 0x1F
"""The bits of a unit's first byte that tell its kind."""

FIRST = b"\x80"
"""The least second byte of a slice that begins a picture: its first macroblock is number 0."""

HIGH = (44, 83, 86, 100, 110, 118, 122, 128, 134, 135, 138, 139, 244)
"""Profiles whose sequence parameters tell of colours and bit depths too."""

LOOKED_AT = 64
"""Bytes of sequence parameters; those that count stand before."""


def length_bytes(configuration: bytes | None) -> int | None:
    """The bytes that tell a unit's length, where every access unit is sure to be one frame.

    Parameters: `configuration`, what the container keeps of the decoder's. Returns None where it is
    of another kind, or its sequence parameters allow of fields, or leave it open.
    """
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

    Parameters: `packet`; `length`, the bytes of a unit's length. Returns None where it holds no
    frame, or several, or something else than H.264 without layers.
    """
    found: bool | None = None
    place = 0
    while place < len(packet):
        begin = place + length
        place = begin + int.from_bytes(packet[place:begin], "big")
        if place == begin or place > len(packet):
            return None
        kind = packet[begin] & KIND
        if kind in (SLICE, KEY_SLICE):
            if packet[begin + 1 : place][:1] >= FIRST:
                if found is not None:
                    return None
                found = kind == KEY_SLICE
        elif kind not in ASIDE and not (kind == PARAMETERS and _frames_only(packet[begin:place])):
            return None
    return found


def _frames_only(parameters: bytes) -> bool:
    """Whether sequence parameters allow of no fields and of no gaps; False where it is not seen."""
    seen = parameters[:LOOKED_AT].replace(b"\0\0\3", b"\0\0")  # 3: put in so as not to be a mark
    bits = iter("".join(f"{byte:08b}" for byte in seen[4:]))

    def flag() -> bool:
        return next(bits) == "1"

    def number() -> int:
        zeros = 0
        while not flag():
            zeros += 1
        return (1 << zeros) - 1 + int("0" + "".join(islice(bits, zeros)), 2)

    try:
        number()  # their name
        if seen[1] in HIGH:
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


SIZE, WITHOUT, WITH = 3, 3, 8
"""Bytes of a slice's size, and of its footer without a checksum and with one."""

MIRRORED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
"""Each byte with its bits in the other order: FFV1 takes the highest first, zlib the lowest."""


def is_whole(packet: bytes) -> bool:
    """Whether all slices of a packet of version 3 are what their checksums say.

    Parameters: `packet`. Returns True too where it has no checksums, as `-slicecrc 0` writes it.
    """
    slices = _slices(packet, WITH)
    if slices:
        # the checksum of all bytes and of their checksum is zero, with a start of zero
        return all(zlib.crc32(one.translate(MIRRORED), 2**32 - 1) == 2**32 - 1 for one in slices)
    return bool(_slices(packet, WITHOUT))


def _slices(packet: bytes, footer: int) -> list[bytes]:
    """The slices, from the last, as their sizes have it; none where the sizes do not come out."""
    found, end = [], len(packet)
    while end >= footer:
        place = end - footer
        size = int.from_bytes(packet[place : place + SIZE], "big") + footer
        if size > end:
            break
        found.append(packet[end - size : end])
        end -= size
    return found if end == 0 else []
