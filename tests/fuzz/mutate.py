"""Valid files made invalid: bytes, sizes, pieces and words changed, by a seeded generator."""

import re
from collections.abc import Sequence

import numpy as np

NUMBERS = (0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x10000, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
WORDS = ("nan", "inf", "-inf", "-1", "0", "1e308", "1e-308", "9" * 30, "true", '""', "[]", "{}",
         '"\\u0000"', "[[[[1]]]]", "1979-05-27", '"../../x"', "0x7fffffffffffffff",
         '"é中\\n"', "[1, 2, 3]", "{ a = 1 }")  # fmt: skip


def mutated(data: bytes, rng: np.random.Generator, others: Sequence[bytes], text: bool) -> bytes:
    """One to a few changes of a valid file; `others`, of which pieces are taken; `text`: TOML."""
    for _ in range(int(rng.integers(1, 5))):
        data = _changed_text(data, rng) if text and rng.random() < 0.8 else _changed(
            data, rng, others)  # fmt: skip
    return data


def _changed(data: bytes, rng: np.random.Generator, others: Sequence[bytes]) -> bytes:
    if not data:
        return bytes(rng.integers(0, 256, 8, dtype=np.uint8))
    out, at = bytearray(data), int(rng.integers(len(data)))
    head = min(len(data), 400)  # heads hold what matters most
    at = int(rng.integers(head)) if rng.random() < 0.6 else at
    length = int(rng.integers(1, 1 + min(64, len(data))))
    kind = int(rng.integers(8))
    if kind == 0:
        out[at] ^= 1 << int(rng.integers(8))
    elif kind == 1:
        out[at : at + length] = rng.integers(0, 256, length, dtype=np.uint8).tobytes()
    elif kind == 2:
        size, order = int(rng.choice([1, 2, 4, 8])), str(rng.choice(["little", "big"]))
        number = int(rng.choice(NUMBERS)) % 256**size
        out[at : at + size] = number.to_bytes(size, order)  # type: ignore[arg-type]
    elif kind == 3:
        del out[at : at + length]
    elif kind == 4:
        out[at:at] = out[at : at + length]
    elif kind == 5:
        del out[at:]
    elif kind == 6:
        other = others[int(rng.integers(len(others)))]
        start = int(rng.integers(max(len(other), 1)))
        out[at : at + length] = other[start : start + length]
    else:
        out[at : at + 4] = ((int.from_bytes(out[at : at + 4], "little") + int(
            rng.integers(-3, 4))) % 2**32).to_bytes(4, "little")  # fmt: skip
    return bytes(out[:200_000])


def _changed_text(data: bytes, rng: np.random.Generator) -> bytes:
    lines = data.decode("utf-8", "replace").split("\n")
    at = int(rng.integers(len(lines)))
    kind = int(rng.integers(5))
    if kind == 0:
        key = lines[at].split("=")[0]
        lines[at] = f"{key}= {rng.choice(WORDS)}"
    elif kind == 1:
        del lines[at]
    elif kind == 2:
        lines.insert(int(rng.integers(len(lines) + 1)), lines[at])
    elif kind == 3:
        lines[at] = re.sub(r"[0-9.]+", lambda _: str(rng.choice(WORDS)), lines[at], count=1)
    else:
        other = int(rng.integers(len(lines)))
        lines[at], lines[other] = lines[other], lines[at]
    return "\n".join(lines).encode("utf-8", "replace")
