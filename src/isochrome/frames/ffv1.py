"""Whether a packet of FFV1 is whole, by the checksums of its slices.

FFmpeg puts the picture before in the place of a damaged slice, and says so to nobody who decodes.
Source: RFC 9043, FFV1 video coding format versions 0, 1 and 3, section 4.9, slice footer.
"""

from __future__ import annotations

import zlib

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
