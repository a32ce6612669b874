# SPDX-License-Identifier: Apache-2.0
"""Damage to files: what failing disks, careless programs and hostile hands do."""

from __future__ import annotations

import random
import re
import struct

_ODD_TEXT = (
    '', ' ', 'nan', 'inf', '-inf', '1e400', '-', '9' * 400, '1_0', '0x1f', '"', '"1', ';', ',,',
    '\t', '\0', 'ΩΩ', '٣', '1,5', '1.5.5', '=1+1', '\r', '\x1b[2J', '1e308', '-1e-400',
    'null', '#',
)  # fmt: skip
_NUMBER = re.compile(rb'[0-9]+')
_MCAP, _ROS1, _SQLITE = b'\x89MCAP0\r\n', b'#ROSBAG V2.0\n', b'SQLite format 3\0'
_HUGE = (0, 1, 0x7F, 0xFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 1 << 40, 1 << 62, (1 << 64) - 1)


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Return a damaged copy of the bytes of a file."""
    if not data:
        return rng.randbytes(20)
    ways = [_cut, _flip, _overwrite, _zeros, _hole, _repeat, _swap]
    if data.startswith((_MCAP, _ROS1, _SQLITE)) or b'\0' in data[:4096]:
        ways += [_length] * 5
    else:
        ways += [_text] * 5
    for _ in range(rng.choice((1, 1, 1, 2, 5))):
        data = rng.choice(ways)(data, rng) or data
    return data


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.choice((0, 1, rng.randrange(len(data)), len(data) - 1))]


def _flip(data: bytes, rng: random.Random) -> bytes:
    content = bytearray(data)
    for _ in range(rng.choice((1, 10, 100))):
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    return bytes(content)


def _overwrite(data: bytes, rng: random.Random) -> bytes:
    content = bytearray(data)
    for _ in range(rng.choice((1, 5, 20))):
        at, size = rng.randrange(len(content)), rng.choice((1, 2, 4, 8))
        content[at : at + size] = rng.choice((b'\xff', b'\0', b'\x7f')) * size
    return bytes(content)


def _zeros(data: bytes, rng: random.Random) -> bytes:
    """Return data with a part of zeros, as a file system leaves it after a power failure."""
    at, size = rng.randrange(len(data)), rng.choice((16, 512, 4096, len(data)))
    return data[:at] + bytes(min(size, len(data) - at)) + data[at + size :]


def _hole(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + data[at + rng.randrange(1, 5000) :]


def _repeat(data: bytes, rng: random.Random) -> bytes:
    at, start = rng.randrange(len(data)), rng.randrange(len(data))
    return data[:at] + data[start : start + rng.randrange(1, 5000)] + data[at:]


def _swap(data: bytes, rng: random.Random) -> bytes:
    """Return data with two parts exchanged."""
    first, second, third = sorted(rng.randrange(len(data)) for _ in range(3))
    return data[:first] + data[second:third] + data[first:second] + data[third:]


def _length(data: bytes, rng: random.Random) -> bytes:
    """Return data with a wrong number where the format has a length, a count or a place."""
    at, size = rng.choice(_places(data))
    content = bytearray(data)
    old = int.from_bytes(content[at : at + size], 'little')
    value = rng.choice((*_HUGE, old + 1, old - 1, 2 * old, rng.randrange(1 << 32)))
    content[at : at + size] = (value % (1 << 8 * size)).to_bytes(size, 'little')
    return bytes(content)


def _places(data: bytes) -> list[tuple[int, int]]:
    """Return where lengths are, and of how many bytes; a guess where the format hides them."""
    found: list[tuple[int, int]] = []
    at = len(_MCAP)
    if data.startswith(_MCAP):
        while at + 9 <= len(data):
            size = int.from_bytes(data[at + 1 : at + 9], 'little')
            # the length of the record, and the fields that most records begin with
            found += [(at + 1, 8), (at, 1), (at + 9, 2), (at + 9, 8), (at + 25, 8), (at + 37, 4)]
            at += 9 + min(size, len(data))
    elif data.startswith(_ROS1):
        at = len(_ROS1)
        while at + 8 <= len(data):
            for _ in range(2):
                found.append((at, 4))
                at += 4 + min(
                    struct.unpack_from('<I', data.ljust(at + 4, b'\0'), at)[0], len(data)
                )
    elif data.startswith(_SQLITE):
        pages = range(0, len(data), 4096)
        found = [(page + place, 2) for page in pages for place in (0, 1, 3, 5, 7, 8, 10, 12, 100)]
        found += [(place, 4) for place in range(16, 100, 4)]
    else:
        edges = [*range(min(300, len(data))), *range(max(0, len(data) - 200), len(data))]
        found = [(place, size) for place in edges for size in (1, 2, 4)]
    return [(place, size) for place, size in found if place + size <= len(data)] or [(0, 1)]


def _text(data: bytes, rng: random.Random) -> bytes:
    """Return text with odd words or other numbers in it."""
    numbers = list(_NUMBER.finditer(data))
    for match in sorted(rng.sample(numbers, min(len(numbers), rng.choice((1, 1, 5, 50)))),
                        key=lambda match: -match.start()):  # fmt: skip
        if rng.random() < 0.5:
            word = str(rng.choice((*_HUGE, -1, rng.randrange(1000)))).encode()
        else:
            word = rng.choice(_ODD_TEXT).encode()
        data = data[: match.start()] + word + data[match.end() :]
    return data
