# SPDX-License-Identifier: Apache-2.0
"""zstd, lz4 and bz2, whole or cut off, with a limit on what comes out; checksums."""

from __future__ import annotations

import bz2
from functools import cache
from pathlib import Path
import shutil
import sys
from typing import Any, BinaryIO

from imu_bench.errors import needed, RecordingError

try:
    from isal import isal_zlib as zlib
except ImportError:  # whose checksum takes some fifteen times as long: docs/decisions/0031
    import zlib  # type: ignore[no-redef]

MAX_EXPANDED = 1 << 27
"""Bytes of a chunk, at most: two of them and what is made of them fit into half a gigabyte."""

MAX_MESSAGE = 1 << 25
"""Bytes of a message of a topic that is read, at most; an Imu has some 300."""

_RATIO = 1000
"""
Times that anything can be larger than it is compressed, unless it is small.

Of a sensor that shows nothing but zeros: 27 times sqlite3 as a whole; its messages alone 40 times
with lz4, 240 with zstd, 370 with bz2.
"""

_SMALL, _SMALL_FILE = 1 << 24, 1 << 26
"""Bytes of a chunk or message, and of a storage file, that count as small."""

ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
"""First bytes of a frame: RFC 8878, section 3.1.1."""

_STEP = 1 << 23
_FILE_STEP = 1 << 16
_SALVAGE_STEP = 1 << 12


@cache
def _zstd() -> Any:
    """Return the module of zstd, which neither Ubuntu 24.04 nor rosdep has."""
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        with needed('backports.zstd', 'what is compressed with zstd'):
            from backports import zstd
    return zstd


@cache
def _lz4() -> Any:
    """Return the module of lz4 frames; rosdep has no key for it."""
    with needed('lz4', 'what is compressed with lz4'):
        import lz4.frame
    return lz4.frame


def _damaged(algorithm: str) -> tuple[type[Exception], ...]:
    """Return what a decompressor raises for damaged data."""
    return (RuntimeError, EOFError, OSError, *([_zstd().ZstdError] if algorithm == 'zstd' else []))


def crc32(data: bytes | bytearray | memoryview) -> int:
    """
    Return the checksum that mcap stores.

    Examples
    --------
    >>> hex(crc32(b'123456789'))
    '0xcbf43926'
    """
    return zlib.crc32(data)


def expand(
    data: bytes | memoryview, algorithm: str, size: int | None = None, most: int = MAX_EXPANDED
) -> bytes | memoryview:
    """Return decompressed data."""
    most = min(most, _room(data))
    if size is not None and size > most:
        raise RecordingError(f'claims {size} bytes, more than {most}')
    if not algorithm:
        out: bytes | memoryview = data
        complete = True
    else:
        decompressor = _decompressor(algorithm)
        try:
            # one more than expected, so that the decompressor reaches the end of its frame
            out = _expanded(decompressor, data, (most if size is None else size) + 1)
        except _damaged(algorithm) as problem:
            raise RecordingError(f'{algorithm} data damaged: {problem}') from problem
        if size is None and len(out) > most:
            raise RecordingError(f'larger than {most} bytes')
        complete = decompressor.eof
    if not complete or (size is not None and len(out) != size):
        raise RecordingError(f'{algorithm or "stored"} data damaged after {len(out)} bytes')
    return out


def expand_part(data: bytes | memoryview, algorithm: str) -> bytes | memoryview:
    """Return what can be decompressed from the beginning of cut-off data."""
    if not algorithm:
        return data
    decompressor = _decompressor(algorithm)
    view = memoryview(data)
    parts: list[bytes] = []
    room = min(MAX_EXPANDED, _room(data))
    try:
        # in small steps, so that what comes before a damaged place is kept
        for start in range(0, len(view), _SALVAGE_STEP):
            if decompressor.eof or room <= 0:
                break
            part = decompressor.decompress(view[start : start + _SALVAGE_STEP], max_length=room)
            parts.append(part)
            room -= len(part)
    except _damaged(algorithm):
        pass  # the caller knows that the data is damaged: this is what is left of it
    return b''.join(parts)


def _expanded(decompressor: Any, data: bytes | memoryview, room: int) -> bytes | memoryview:
    """Return what comes out, up to so many bytes; of much one copy at a time."""
    if room <= _STEP:
        all_of_it: bytes = decompressor.decompress(data, max_length=room)
        return all_of_it
    whole = bytearray()
    while len(whole) < room and not decompressor.eof:
        part = decompressor.decompress(data, max_length=min(_STEP, room - len(whole)))
        if not part:
            break
        whole += part
        data = b''
    return memoryview(whole)


def _room(packed: bytes | memoryview) -> int:
    return max(_SMALL, _RATIO * len(packed))


def compress(data: bytes) -> bytes:
    """Return data as one zstd frame."""
    packed: bytes = _zstd().compress(data, level=1)
    return packed


def expand_file(source: Path, target: Path) -> str:
    """
    Decompress a zstd file; return why that is not all of it, nothing if it is.

    What could be decompressed is in the target in either case.
    """
    with source.open('rb') as packed, target.open('wb') as plain:
        room = max(_SMALL_FILE, _RATIO * source.stat().st_size)
        try:
            return _copy(packed, plain, room)
        except OSError as problem:
            free = shutil.disk_usage(target.parent).free
            raise RecordingError(
                f'{source}: cannot decompress into {target.parent} ({free >> 20} MiB free): '
                f'{problem.strerror}; set TMPDIR to a folder with more room'
            ) from problem


def _copy(packed: BinaryIO, plain: BinaryIO, room: int) -> str:
    decompressor = _zstd().ZstdDecompressor()
    while True:
        data = b''
        if decompressor.eof:
            data = decompressor.unused_data or packed.read(_FILE_STEP)
            if not data:
                return ''
            decompressor = _zstd().ZstdDecompressor()
        elif decompressor.needs_input and not (data := packed.read(_FILE_STEP)):
            return 'damaged or cut off: read up to the damage'
        try:
            room -= plain.write(decompressor.decompress(data, max_length=min(_STEP, room + 1)))
        except _zstd().ZstdError:
            return 'damaged or cut off: read up to the damage'
        if room < 0:
            return f'more than {_RATIO} times as large as it is compressed: read up to there'


def _decompressor(algorithm: str) -> Any:
    if algorithm == 'zstd':
        return _zstd().ZstdDecompressor()
    if algorithm == 'bz2':
        return bz2.BZ2Decompressor()
    if algorithm == 'lz4':
        return _lz4().LZ4FrameDecompressor()
    raise RecordingError(f'compression {algorithm!r} is unknown; known are zstd, lz4 and bz2')
