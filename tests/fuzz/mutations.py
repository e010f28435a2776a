"""Ways in which files are damaged, each from a random generator alone."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Callable, Mapping

import numpy as np

Random = np.random.Generator
_EXTREME = (0, 1, 2, 7, 8, 16, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 65520, 10**6)


def flipped(data: bytes, random: Random) -> bytes:
    """Some bits."""
    changed = bytearray(data)
    for at in random.integers(len(data), size=int(random.integers(1, 9))):
        changed[at] ^= 1 << int(random.integers(8))
    return bytes(changed)


def left_out(data: bytes, random: Random) -> bytes:
    """A byte, or a stretch of them."""
    at, length = int(random.integers(len(data))), int(random.choice([1, 1, 2, 4, 12, 100]))
    return data[:at] + data[at + length :]


def cut(data: bytes, random: Random) -> bytes:
    """Shorter."""
    return data[: int(random.integers(len(data)))]


def doubled(data: bytes, random: Random) -> bytes:
    """A stretch of bytes, many times."""
    at, length = int(random.integers(len(data))), int(random.choice([1, 12, 40, 400]))
    return data[:at] + data[at : at + length] * int(random.choice([2, 3, 50])) + data[at + length :]


def overwritten(data: bytes, random: Random) -> bytes:
    """A number at some place, more often in the head."""
    changed, wide = bytearray(data), int(random.choice([1, 2, 4, 8]))
    last = max(1, len(data) - wide)
    at = int(random.integers(min(last, 300) if random.random() < 0.6 else last))
    value = int(random.choice(_EXTREME)) % 256**wide
    changed[at : at + wide] = value.to_bytes(wide, "little" if random.random() < 0.5 else "big")
    return bytes(changed)


def other_digits(data: bytes, random: Random) -> bytes:
    """A digit of a text within, and what stands for numbers in none."""
    places = [i for i, sign in enumerate(data) if 48 <= sign <= 57]
    if not places:
        return flipped(data, random)
    at = int(random.choice(places))
    words = (b"-", b"9" * 20, b"1e400", b"NaN", b"[" * 3000, b'"', b"null", b"\xff", b"\x1b[2J", b"\0", b"")
    return data[:at] + words[int(random.integers(len(words)))] + data[at + 1 :]


def joined(data: bytes, random: Random) -> bytes:
    """Halves in another order."""
    at = int(random.integers(len(data)))
    return data[at:] + data[:at] if random.random() < 0.3 else data[:at] + data


MUTATIONS: tuple[Callable[[bytes, Random], bytes], ...] = (
    flipped, left_out, cut, doubled, overwritten, overwritten, other_digits, joined,
)  # fmt: skip


def damaged(data: bytes, random: Random) -> bytes:
    """A file damaged once to three times; sometimes with sums that are right again, so that readers go on."""
    inside = _INSIDE.get(data[:4])
    if inside is not None and random.random() < 0.5:
        return inside(data, random)
    for _ in range(int(random.integers(1, 4))):
        data = MUTATIONS[int(random.integers(len(MUTATIONS)))](data, random) or b"\0"
    return data


def _png(data: bytes, random: Random) -> bytes:
    """A PNG of which one chunk is damaged, with its check sum."""
    chunks, at = [], 8
    while at + 12 <= len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    which = int(random.integers(len(chunks)))
    name, content = chunks[which]
    if name == b"IDAT" and random.random() < 0.5:
        content = zlib.compress(damaged(zlib.decompress(b"".join(c for n, c in chunks if n == b"IDAT")), random))
    else:
        content = damaged(content or b"\0", random)
    chunks[which] = (name, content)
    if random.random() < 0.2:
        chunks.insert(1, chunks[int(random.integers(len(chunks)))])
    parts = (struct.pack(">I", len(c)) + n + c + struct.pack(">I", zlib.crc32(n + c)) for n, c in chunks)
    return data[:8] + b"".join(parts)


def _npz(data: bytes, random: Random) -> bytes:
    """An npz of which one array is damaged, with its check sum."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members: Mapping[str, bytes] = {name: archive.read(name) for name in archive.namelist()}
    which = str(random.choice(list(members)))
    file = io.BytesIO()
    kinds = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    with zipfile.ZipFile(file, "w", kinds[int(random.choice([0, 1, 1, 2, 3]))]) as archive:
        for name, content in members.items():
            archive.writestr(name, damaged(content, random) if name == which else content)
    return file.getvalue()


_INSIDE = {b"\x89PNG": _png, b"PK\3\4": _npz}
